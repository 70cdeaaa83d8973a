"""SCD messages of transactions: the decoded message, and its function in the form that pairing needs.

`dissect.meaning.bindings` decodes the messages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.transactions.protocol import Kept
from dissect.protocols.s7.parameters import Parameters
from dissect.wire.copies import leaves

if TYPE_CHECKING:
    from collections.abc import Callable

    from dissect.scd.dictionary import Dictionary
    from dissect.scd.messages import Message
    from dissect.scd.model import Pdo
    from dissect.scd.wording import Row

#: The value of `Parameters.rosctr` and `Transaction.rosctr` for SCD, which has no ROSCTR; never shown.
SCD: Final = 0xDC
#: Added to the number of an SCD function, so that it differs from those of S7comm and S7comm-plus.
_FUNCTION: Final = 0x40000

#: The name of the protocol, which precedes the names of its functions.
TITLE: Final = "SCD"


def is_scd_key(key: int) -> bool:
    """Return whether ``key`` is that of a row of statistics about SCD."""
    return key >= _FUNCTION


class ScdMessage:
    """An SCD message found in traffic: ``message`` is the decoded message, ``binding`` the name of the rule that found it.

    A message whose values cannot be wrong is decoded only on demand: ``later`` decodes ``octets`` with transaction number
    ``tid``.

    ``frame`` and ``time_ns`` are those of the packet that completed it (nanoseconds since 1970), ``connection`` is the number
    of the connection, ``side`` the side that sent it. ``place`` names the S7 item or block that contains it, empty for a
    message by itself; ``offset`` is its position in octets within that, or within the datagram or TSDU. ``octets`` is the
    message as on the wire. ``mapping`` is the PDO with the mapping that it had when the message was sent, None for other
    messages.
    """

    __slots__ = (
        "_later",
        "_message",
        "_tid",
        "binding",
        "connection",
        "dictionary",
        "frame",
        "mapping",
        "octets",
        "offset",
        "place",
        "side",
        "time_ns",
    )

    def __init__(
        self,
        message: Message | None,
        dictionary: Dictionary,
        binding: str,
        octets: bytes,
        later: Callable[[bytes, int], Message] | None = None,
        tid: int = 0,
    ) -> None:
        self._message: Message | None = message
        self._later: Callable[[bytes, int], Message] | None = later
        self._tid: int = tid
        self.dictionary: Dictionary = dictionary
        self.binding: str = binding
        self.octets: bytes = octets
        self.mapping: Pdo | None = None
        self.frame: i64 = 0
        self.time_ns: i64 = 0
        self.connection: i64 = 0
        self.side: i64 = 0
        self.offset: i64 = 0
        self.place: str = ""

    @property
    def message(self) -> Message:
        """The decoded message."""
        made = self._message
        if made is None:
            later = self._later
            assert later is not None
            made = self._message = later(self.octets, self._tid)
        return made

    @property
    def subject(self) -> str:
        """The message in a few words: "read 0x6041:0 Слово состояния 1", "T1 Состояние 1"; safe to show."""
        from dissect.scd.wording import subject

        return subject(self.dictionary, self.message)

    @property
    def values(self) -> list[Row]:
        """The decoded values, in the order of the message."""
        from dissect.scd.wording import rows

        return rows(self.dictionary, self.message)

    def __repr__(self) -> str:
        return f"ScdMessage({self.binding!r}, {self.subject!r})"


class ScdParameters(Parameters):
    """The function of an SCD message: ``key`` is its row of statistics, ``name`` its name without the protocol.

    ``index`` and ``sub`` are the object it addresses (-1 for none), ``err`` its ``scd_err_t``. ``refused``: it is an abort or
    carries an error. ``settled``: nothing remains to be judged when its transaction is over.
    """

    __slots__ = ("err", "index", "name", "refused", "scd", "settled", "sub")

    def __init__(self, key: i64, name: str, scd: ScdMessage) -> None:
        super().__init__(b"", SCD)
        self.function = _FUNCTION | key
        self.name: str = name
        self.scd: ScdMessage = scd
        self.index: int = -1  # this and the next two are as wide as the dictionary's envelope specifies
        self.sub: int = -1
        self.err: int = 0
        self.refused: bool = False
        self.settled: bool = False

    @property
    def function_name(self) -> str:
        """Name of the function with the protocol before it."""
        return f"{TITLE} {self.name}"

    @property
    def subject(self) -> str:
        """The request or answer as text."""
        return f"{TITLE} {self.scd.subject}"


class Backlog(Kept):
    """The state of one direction of a TCP connection that carries SCD.

    During the search for the beginning of a message, ``pending`` are places in ``octets`` where one may begin, with its size,
    and ``scan`` is where the search continues. ``owed`` is the number of remaining octets of a content whose beginning is
    missing.
    """

    __slots__ = ("owed", "pending", "scan")

    def __init__(self) -> None:
        super().__init__()
        self.pending: list[tuple[int, int]] = []
        self.scan: i64 = 0
        self.owed: i64 = 0


def _taken(found: ScdMessage) -> tuple[Message, Dictionary, str, bytes]:
    return (
        found.message,
        found.dictionary,
        found.binding,
        found.octets,
    )  # decoded already, so that the decoder does not need this buffer later


def _taken_function(function: ScdParameters) -> tuple[int, str, ScdMessage]:
    return 0, function.name, function.scd


leaves(ScdMessage, without=("_later",), taken=_taken)
leaves(ScdParameters, taken=_taken_function)
