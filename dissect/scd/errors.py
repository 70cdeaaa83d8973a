"""Errors of SCD: codes of this library, errors of a dictionary, numbers of ``scd_err_t`` (R52).

A *code* such as ``E_RANGE`` gives the reason why this library could not do something. An ``scd_err_t`` is what one device tells
another in a message.
"""

from __future__ import annotations

from types import MappingProxyType, TracebackType
from typing import Final, Self

from dissect.wire import errors

E_ACCESS: Final = "E_ACCESS"
E_COUNT: Final = "E_COUNT"
E_CRC: Final = "E_CRC"
E_DICTIONARY: Final = "E_DICTIONARY"
E_INDEX: Final = "E_INDEX"
E_KIND: Final = "E_KIND"
E_LENGTH: Final = "E_LENGTH"
E_LONG: Final = "E_LONG"
E_MAP: Final = "E_MAP"
E_PDO_NUMBER: Final = "E_PDO_NUMBER"
E_PROTOCOL: Final = "E_PROTOCOL"
E_RANGE: Final = "E_RANGE"
E_SHORT: Final = "E_SHORT"
E_SUB: Final = "E_SUB"
E_TYPE: Final = "E_TYPE"
E_UTF8: Final = "E_UTF8"
E_VALUE: Final = "E_VALUE"

#: All codes of this library, with their meanings.
CODES: Final = MappingProxyType(
    {
        E_ACCESS: "the access attribute does not allow this",
        E_COUNT: "values are missing or too many",
        E_CRC: "the checksum differs",
        E_DICTIONARY: "the dictionary breaks a rule",
        E_INDEX: "no object of this index",
        E_KIND: "no such kind of message",
        E_LENGTH: "the value is longer than its field, or a block of a different length",
        E_LONG: "bytes are left over",
        E_MAP: "the variable cannot be mapped like this",
        E_PDO_NUMBER: "no PDO of this number",
        E_PROTOCOL: "a constant field has a different value",
        E_RANGE: "the number is outside of its type",
        E_SHORT: "bytes are missing",
        E_SUB: "no sub-index of this number",
        E_TYPE: "no type of this index or name",
        E_UTF8: "the string is invalid in its encoding",
        E_VALUE: "a value of a different kind",
    }
)

#: scd_err_t: 0 good, < 0 error, > 0 status of the application (profile; based on the abort codes of CiA 301 and POWERLINK).
ERROR_TEXTS: Final = MappingProxyType(
    {
        0: "good",
        -1: "general error",
        -2: "unsupported access",
        -3: "read of a write-only object",
        -4: "write of a read-only object",
        -5: "no such object",
        -6: "no such sub-index",
        -7: "length or type does not match",
        -8: "value too long",
        -9: "value too short",
        -10: "value out of range",
        -11: "object cannot be mapped",
        -12: "mapping longer than a PDO",
        -13: "time-out",
        -14: "unknown command",
        -15: "out of memory",
        -16: "hardware error",
        -17: "value cannot be stored",
        -18: "refused, local control",
        -19: "refused in this state of the device",
        -20: "no dictionary, or a different one",
        -21: "CRC error",
    }
)


#: Errors of one file that are kept.
MOST_TROUBLES: Final = 1000
#: The longest piece of user data that an error shows.
_MOST_SHOWN: Final = 100


def shown(value: object) -> str:
    """Return ``value`` for a sentence: its ``repr``, shortened if it is long, described if it has none."""
    if isinstance(value, int) and value.bit_length() > 8 * _MOST_SHOWN:
        return f"a number of {value.bit_length()} bits"
    if isinstance(value, (str, bytes, bytearray)) and len(value) > _MOST_SHOWN:
        return f"{value[:_MOST_SHOWN]!r}... ({len(value)} in all)"
    try:
        text = repr(value)
    except (RecursionError, ValueError):
        return f"a {type(value).__name__} that cannot be shown"
    return text if len(text) <= 2 * _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."


class Error(errors.Error):
    """An error of this library: ``code`` (one of `CODES`), ``where`` (object, field, offset), ``detail``."""

    def __init__(self, code: str, where: str, detail: str = "") -> None:
        self.code = code
        self.where = where
        self.detail = detail or CODES[code]
        super().__init__(code, where, self.detail)

    def __str__(self) -> str:
        return f"{self.code}: {self.where}: {self.detail}" if self.where else f"{self.code}: {self.detail}"


class DictionaryError(Error):
    """A dictionary that breaks a rule; it is not used at all.

    ``where`` is the place inside (an object, a key, an octet). ``rule`` is the broken requirement ("R73"; empty if there is no
    number). ``path`` is the file, ``line`` the line of a TOML source from 1 on (0: unknown), ``index`` the index of the entry
    (-1: none). ``others`` are further errors of the same file. A ``consequence`` only follows from another error, for example a
    missing type that could not be read, and is left out.
    """

    def __init__(
        self,
        where: str,
        detail: str,
        *,
        rule: str = "",
        code: str = E_DICTIONARY,
        index: int = -1,
        path: str = "",
        line: int = 0,
        consequence: bool = False,
    ) -> None:
        super().__init__(code, where, detail)
        self.others: tuple[DictionaryError, ...] = ()
        self.consequence = consequence
        self.rule = rule
        self.index = index
        self.path = path
        self.line = line

    def of_file(self, path: str) -> Self:
        """Set the path, also of the ``others``; return the error."""
        self.path = path
        for error in self.others:
            error.path = path
        return self

    def __str__(self) -> str:
        place = f"{self.path}:{self.line}" if self.line else self.path
        rule = f" ({self.rule})" if self.rule else ""
        return ": ".join(part for part in (place, self.where, self.detail) if part) + rule


class Troubles:
    """Collects the errors of a file, so that all are reported at once: ``with troubles:`` around each part that may fail."""

    def __init__(self) -> None:
        self.found: list[DictionaryError] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if not isinstance(error, DictionaryError):
            return False
        room = max(MOST_TROUBLES - len(self.found), 0)
        self.found += [one for one in (error, *error.others) if not one.consequence][:room]
        error.others = ()
        return True

    def done(self) -> None:
        """Raise the first error with the others, if there are any."""
        if self.found:
            first = self.found[0]
            first.others = tuple(self.found[1:])
            raise first
