"""The results of the check of a PDU (`dissect.protocols.s7plus.check`), and its way of reading numbers of fixed sizes."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7plus.cursor import MET, Cursor
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.pieces import USUAL_QUALIFIER
from dissect.protocols.s7plus.plain import SEQUENCE_AT, SESSION_AT
from dissect.wire.octets import u16, u32

#: Octets of an id.
_ID: Final = 4


@mypyc_attr(acyclic=True)
class Checked(Cursor):
    """A PDU and the results of its check.

    ``sound``: the contents are sound; ``odd``: they must be read. If neither is True, they were not judged: the PDU is
    incomplete, or the body of its function is unknown. Everything else has a meaning only if it is ``sound``.

    ``octets`` are the frames; ``data`` has the data of the PDU from ``begin`` to ``end``. ``code`` is the lower 16 bits of the
    return value, -1 for none. ``refuses``: items are refused; ``refusals`` are those of a notification, as (number, kind).
    ``asks``: a read may request the operating state, or the identification of the CPU; ``item`` is the number of the item that
    is the state, 0 for none or several; ``place`` is where the addresses of a read or write end, or where the ids of one
    attribute begin; ``valued`` is where its value begins. ``numbered`` is the number of values in a response if they are
    numbered from 1, else 0 or less; ``expected`` is that number in a write. ``object_id`` is the first object, ``made`` are the
    ids of created objects. ``noted`` as in `Cursor`, for CreateObject and Explore.
    """

    __slots__ = (
        "_known",
        "_made",
        "_marks",
        "_met",
        "_pdu",
        "_refused",
        "_seeking",
        "_sought",
        "_version",
        "asks",
        "begin",
        "code",
        "details",
        "expected",
        "function",
        "integrity_id",
        "item",
        "numbered",
        "object_id",
        "octets",
        "odd",
        "opcode",
        "place",
        "refuses",
        "sound",
        "valued",
    )

    def __init__(
        self, octets: bytes, data: bytes, begin: i64, end: i64, marks: bytes, pdu: PlusPdu | None = None
    ) -> None:
        super().__init__(data, begin, end)
        self.octets = octets
        self.begin: i64 = begin
        self.opcode: i64 = 0
        if begin < end:
            self.opcode = data[begin]
        self.function: i64 = -1
        self.sound = False
        self.odd = False
        self.code: i64 = -1
        self.refuses = False
        self.asks = False
        self.item: i64 = 0
        self.place: i64 = 0
        self.numbered: i64 = 0
        self.integrity_id: i64 = -1
        self.object_id: i64 = -1
        self.details = False
        self._made: list[int] | None = None
        self._refused: list[tuple[int, int]] | None = None
        self._known = True
        self._seeking = False
        self._sought: i64 = -1
        self._met: list[int] | None = None
        self.expected: i64 = 0
        self.valued: i64 = 0
        self._version: i64 = 0
        if len(octets) > 1:
            self._version = octets[1]
        self._marks = marks
        self._pdu: PlusPdu | None = pdu

    @property
    def data(self) -> bytes:
        """The buffer that contains the data."""
        return self._octets

    @property
    def end(self) -> i64:
        """The end of the data."""
        return self._end

    @property
    def made(self) -> list[int]:
        """The ids of created objects."""
        return self._made if self._made is not None else []

    @property
    def refusals(self) -> list[tuple[int, int]]:
        """The items that a notification refuses."""
        return self._refused if self._refused is not None else []

    @property
    def met(self) -> bool:
        """True if a class or attribute that matters was met: code of a block or names of variables."""
        return self.seen & MET != 0

    @property
    def sequence(self) -> i64:
        """The sequence number of a request or response."""
        return u16(self._octets, self.begin + SEQUENCE_AT)

    @property
    def subscription_id(self) -> i64:
        """The subscription of a notification, -1 if the PDU is too short."""
        at: i64 = self.begin + 1
        if at + 4 > self._end:
            return -1
        return u32(self._octets, at)

    @property
    def session_id(self) -> i64:
        """The session of a request."""
        return u32(self._octets, self.begin + SESSION_AT)

    def pdu(self) -> PlusPdu:
        """Return the PDU, parsed. Its frame, time and connection have no meaning."""
        found = self._pdu
        if found is None:
            found = self._pdu = parse_plus(self.octets)
        return found

    def _peek(self) -> i64:
        at: i64 = self.at
        if at >= self._end:
            return -1
        return self._octets[at]

    def _octet(self) -> i64:
        """Read an octet; beyond the end return a number larger than any possible octet or count."""
        at: i64 = self.at
        self.at = at + 1
        if at < self._end:  # no conditional expression: it makes an int object (mypyc)
            return self._octets[at]
        return self._end

    def _skip(self, size: i64) -> bool:
        self.at += size
        return self.at <= self._end

    def _id(self) -> bool:
        self.integrity_id = self.number()
        return self.integrity_id >= 0

    def _count(self) -> i64:
        """Read a count of elements of at least one octet each, -1 if it is too large."""
        count = self.number()
        if count > self._end - self.at:
            return -1
        return count

    def _qualifier(self) -> bool:
        """Pass over the usual qualifier."""
        at: i64 = self.at
        behind: i64 = at + len(USUAL_QUALIFIER)
        self.at = behind
        return behind <= self._end and self._octets[at:behind] == USUAL_QUALIFIER

    def _object(self) -> bool:
        """Read the id of an object."""
        at: i64 = self.at
        self.at = at + _ID
        if at + _ID > self._end:
            return False
        self.object_id = u32(self._octets, at)
        return True
