"""`PlusParameters`: the function of an S7comm-plus PDU in the form that pairing uses."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7plus.tables import FUNCTIONS, INIT_SSL, NOTIFICATION, OPCODES
from dissect.wire.copies import leaves

#: `Parameters.rosctr` and `Transaction.rosctr` of S7comm-plus, which has no ROSCTR; never shown.
PLUS: Final = 0x72

#: Added to a function code, so that it differs from all codes of S7comm.
_FUNCTION: Final = 0x20000
#: `Parameters.function` of a notification, which has no function.
_NOTIFICATION: Final = 0x30000
#: The functions with names are within this many codes from this one on.
_FIRST: Final = 0x0480
_CODES: Final = 0x0200
#: The row of statistics for all functions without a name; there may be sixty thousand of them.
_UNKNOWN: Final = 0x30001


def is_plus_key(key: int) -> bool:
    """Return whether a row of statistics is about S7comm-plus."""
    return key >= _FUNCTION


def names_function(key: int) -> bool:
    """Return whether such a row is for one function, whose code is in its lower 16 bits."""
    return key < _NOTIFICATION


#: The name of the protocol, before the name of a function.
TITLE: Final = "S7comm-plus"


class PlusParameters(Parameters):
    """Shared by all S7comm-plus PDUs of a function. ``code`` is the function on the wire, -1 for a notification."""

    __slots__ = ("_row", "code")

    def __init__(self, code: i64) -> None:
        super().__init__(b"", PLUS)
        self.code: i64 = code
        self.function = _FUNCTION | code if code >= 0 else _NOTIFICATION
        known: bool = code < 0 or code in FUNCTIONS
        self._row: int = self.function if known else _UNKNOWN

    @property
    def function_name(self) -> str:
        """Name of the protocol and of the function."""
        return f"{TITLE} {self.code_name or OPCODES.name(NOTIFICATION).lower()}"

    @property
    def code_name(self) -> str:
        """Name of the function alone, empty for a notification."""
        return FUNCTIONS.name(self.code) if self.code >= 0 else ""

    @property
    def statistics_key(self) -> int:
        """Number of the row of statistics in which this function counts."""
        return self._row

    @property
    def statistics_name(self) -> str:
        """Name of that row."""
        return self.function_name if self.code < 0 or self.code in FUNCTIONS else f"{TITLE} unknown function"

    @property
    def starts_tls(self) -> bool:
        """True for the function after which TLS follows."""
        return self.code == INIT_SSL


class PlusParameterCache:
    """One `PlusParameters` object for each function; when the cache is full, it is emptied."""

    CAPACITY: Final = 4096

    def __init__(self) -> None:
        self._named: list[PlusParameters | None] = [None] * (
            _CODES + 1
        )  # of functions with names; the last one of notifications
        self._by_code: dict[int, PlusParameters] = {}  # of all others

    def get(self, code: i64) -> PlusParameters:
        """Return the object for a function code, -1 for notifications."""
        at: i64 = code - _FIRST if code >= 0 else _CODES
        if 0 <= at < _CODES or code < 0:
            named = self._named[at]
            if named is None:
                named = PlusParameters(code)
                self._named[at] = named
            return named
        found = self._by_code.get(code)
        if found is None:
            if len(self._by_code) >= self.CAPACITY:
                self._by_code.clear()
            found = PlusParameters(code)
            self._by_code[code] = found
        return found


leaves(PlusParameters, without=("good_answer", "good_heads", "good_layout"))
