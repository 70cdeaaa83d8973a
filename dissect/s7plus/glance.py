"""Finds what matters in plain reads, writes and deletions, in place: no objects are made of the rest.

Most traffic is plain: one frame, a return value of 0, no refusals, the usual qualifier, an end in one of the known forms.
Everything else is left to `dissect.s7plus.bodies`, which knows which faults there are and where. A property test ensures that
both agree (tests/s7plus/test_glance.py).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.blobs import COMPRESSED
from dissect.s7plus.identification import IDENTIFICATION
from dissect.s7plus.ids import AREAS, BLOCK_KINDS, PASSWORDS, PROTECTIONS
from dissect.s7plus.loads import LOADS
from dissect.s7plus.message import DIGEST_SIZE
from dissect.s7plus.objects import numbers_at
from dissect.s7plus.pieces import USUAL_QUALIFIER
from dissect.s7plus.plain import REQUEST_SIZE, RESPONSE_SIZE, SEQUENCE_AT, SESSION_AT, one_frame
from dissect.s7plus.session import (
    CPU_EXEC_UNIT,
    CPU_PROXY,
    DIAGNOSIS,
    OPERATING_STATE,
    REFERENCE_LIST,
    SESSION_KEY,
    STATE_REQUEST,
)
from dissect.s7plus.skimming import ASKS, CODES, PLACE, PLACES, REFUSES, SOUND, VALUES, WORDS
from dissect.s7plus.skipping import Skipper
from dissect.s7plus.tables import (
    DELETE_OBJECT,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    REQUEST,
    RESPONSE,
    SET_MULTI_VARIABLES,
    V1,
    V2,
)
from dissect.s7plus.value_tables import ADDRESS_ARRAY, ARRAY, BLOB, DINT, UDINT
from dissect.wire.octets import u16, u32
from dissect.wire.varint import SIGNED, read_varint

#: Precedes the ids of an attribute that is read on its own.
_IDS: Final = bytes((ADDRESS_ARRAY, UDINT))
#: What is above the `WORDS` bits for a return value of 0, and the largest number there that is not an error.
_GOOD: Final = 1
_ERROR: Final = 0x8000
#: The last two octets of an id, which `dissect.s7plus.skimming.ASKS` compares.
_TWO_OCTETS: Final = 0x3FFF
#: Octets of the largest PDU that is handled here; longer ones have more than what matters.
_LARGEST: Final = 4096
#: Attributes whose writing is an event that needs the whole contents.
_TOLD: Final = PASSWORDS | PROTECTIONS | {STATE_REQUEST}
#: The same for a write that may be one of variables.
_TOLD_OF_VARIABLES: Final = _TOLD | LOADS | {REFERENCE_LIST, SESSION_KEY}
#: Flags and type of reference lists.
_ARRAY: Final = ARRAY << 8 | UDINT
_ADDRESS_ARRAY: Final = ADDRESS_ARRAY << 8 | UDINT
#: Areas of the outputs.
OUTPUTS: Final = frozenset((81,))


class Glance:
    """One half of a plain transaction. If ``plain`` becomes False, the PDU must be read instead, and all results are void."""

    __slots__ = ("_end", "_octets", "_skipper", "data", "plain", "version")

    def __init__(self) -> None:
        self._octets = b""
        self._end: i64 = 0
        self._skipper: Skipper = Skipper(b"", 0, 0)
        self.data: i64 = 0  # offset of the opcode
        self.version: i64 = 0
        self.plain = False

    def begin(self, octets: bytes, opcode: i64, function: i64, size: i64) -> None:
        """Begin with a PDU; it is plain if it has one frame of version 1, 2 or 3 and a fixed part of ``size`` octets."""
        at, end = one_frame(octets)
        self.plain = (
            at >= 0 and at + size <= end <= _LARGEST and octets[at] == opcode and u16(octets, at + 3) == function
        )
        if self.plain:
            self._octets = octets
            self._end = end
            self._skipper.begin(octets, at + size, end)
            self.data = at
            self.version = octets[1]

    def number(self) -> i64:
        """Read an unsigned number of at most 32 bits, -1 if there is none."""
        if not self.plain:
            return -1
        value = self._skipper.number()
        if value < 0:
            self.plain = False
        return value

    def count(self) -> i64:
        """Read a count of elements of at least one octet each."""
        count = self.number()
        if count > self._end - self._skipper.at:
            self.plain = False
        return count

    def four(self) -> i64:
        """Read a number of four octets."""
        at: i64 = self._skipper.at
        if not self.plain or at + 4 > self._end:
            self.plain = False
            return -1
        self._skipper.at = at + 4
        return u32(self._octets, at)

    def expect(self, octets: bytes) -> bool:
        """Pass over octets that must be equal to ``octets``."""
        at: i64 = self._skipper.at
        behind: i64 = at + len(octets)
        if not self.plain or behind > self._end or self._octets[at:behind] != octets:
            self.plain = False
            return False
        self._skipper.at = behind
        return True

    def go_on(self, at: i64) -> None:
        """Continue at the offset ``at``; 0 means that it is not known."""
        self._skipper.at = at
        if at == 0:
            self.plain = False

    def skip(self, size: i64) -> bool:
        """Pass over ``size`` octets with any content."""
        self._skipper.at += size
        if self._skipper.at > self._end:
            self.plain = False
        return self.plain

    def value(self) -> bool:
        """Pass over a value."""
        if not self.plain or not self._skipper.value(0):
            self.plain = False
        return self.plain

    def items(self, most: i64) -> None:
        """Pass over plain values that are numbered 1, 2, 3 …, at most ``most`` of them."""
        if self.plain and most > 0:
            self._skipper.items(most)

    def numbers(self) -> list[int]:
        """Read an array of numbers, like a reference list. Another value is not plain, and gives an empty list."""
        at: i64 = self._skipper.at
        head: i64 = u16(self._octets, at) if self.value() else 0
        if head != _ARRAY and head != _ADDRESS_ARRAY:
            self.plain = False
            return []
        return numbers_at(self._octets, at + 2, self._end)

    def state(self) -> i64:
        """Read the operating state, which CPUs send as DInt. A value of another type is not plain, and gives -1."""
        at: i64 = self._skipper.at
        octets = self._octets
        if not self.plain or at + 3 > self._end or octets[at] or octets[at + 1] != DINT:
            self.plain = False
            return -1
        value, behind = read_varint(octets, at + 2, self._end, SIGNED)
        if behind < 0:
            self.plain = False
            return -1
        self._skipper.at = behind
        return value

    def blob(self) -> bytes:
        """Read the octets of a blob. Another value is not plain, and gives empty octets."""
        at: i64 = self._skipper.at
        octets = self._octets
        if not self.plain or at + 4 > self._end or octets[at] or octets[at + 1] != BLOB or octets[at + 2] > 1:
            self.plain = False
            return b""
        self._skipper.at = at + 3
        size = self.number()
        begin: i64 = self._skipper.at
        if size < 0 or not self.skip(size):
            return b""
        return octets[begin : self._skipper.at]

    def ends(self) -> i64:
        """Read the end of a PDU; return its integrity id, -1 if it has none. Anything else is not plain."""
        if not self.plain:
            return -1
        if self._zeros(self._skipper.at) or (self.version == V2 and self._is_digest(self._skipper.at)):
            return -1
        id_ = self.number()
        at: i64 = self._skipper.at
        if id_ < 0 or self.version == V1 or not (self._zeros(at) or self._is_digest(at)):
            self.plain = False
            return -1
        return id_

    def _zeros(self, at: i64) -> bool:
        size: i64 = self._end - at
        return (size == 4 or size == 5) and u32(self._octets, self._end - 4) == 0 and self._octets[at] == 0

    def _is_digest(self, at: i64) -> bool:
        return self._end - at == 1 + DIGEST_SIZE and self._octets[at] == DIGEST_SIZE


class _Glances:
    """Both halves of a transaction. They keep their octets, which are few, until they are used again."""

    __slots__ = ("asked", "told")

    def __init__(self) -> None:
        self.asked: Glance = Glance()
        self.told: Glance = Glance()


#: Free objects, as in `dissect.s7plus.skimming`.
_FREE: Final[list[_Glances]] = [_Glances() for _ in range(4)]


def _free_glances() -> _Glances:
    try:
        return _FREE.pop()
    except IndexError:
        return _Glances()


class Seen:
    """The content of a plain transaction: ``state`` is the operating state, -1 for none; ``record`` an identification record.

    ``authenticated``: the key of a session was written. ``listed`` is the subscription whose reference list was written, -1 for
    none; ``references`` are the numbers of that list. ``deleted`` is the object that was deleted, -1 for none; ``good`` is
    False if that was refused. ``integrity_id``, ``sequence`` and ``session_id`` are those of the request. ``matters`` is False
    for a read of anything else.
    """

    __slots__ = (
        "authenticated",
        "deleted",
        "good",
        "integrity_id",
        "listed",
        "matters",
        "record",
        "references",
        "sequence",
        "session_id",
        "state",
        "stated",
    )

    def __init__(self) -> None:
        self.good = True
        self.matters = True
        self.state: i64 = -1
        self.stated = False  # the state was requested and returned
        self.record = b""
        self.authenticated = False
        self.listed: i64 = -1
        self.references: list[int] | None = None
        self.deleted: i64 = -1
        self.integrity_id: i64 = -1
        self.sequence: i64 = 0
        self.session_id: i64 = 0

    def come(self, request: bytes, at: i64) -> None:
        """Note the numbers of the request, whose data begin at ``at``."""
        self.sequence = u16(request, at + SEQUENCE_AT)
        self.session_id = u32(request, at + SESSION_AT)


#: The result for a read of one attribute that does not matter.
_NOTHING: Final = Seen()
_NOTHING.matters = False


def glance(
    function: i64, request: bytes, response: bytes, read: i64, skimmed: i64, outputs: bool, elsewhere: bool
) -> Seen | None:
    """Look at a request and its response; None if they must be read.

    ``skimmed`` is the result of `dissect.s7plus.skimming.skim` for the response, ``read`` that for a request to read.
    ``outputs`` and
    ``elsewhere``: writes to outputs, or to other areas, need no more looking at.
    """
    deletes: bool = function == DELETE_OBJECT
    code: i64 = skimmed >> WORDS & CODES
    refused: bool = function == GET_VAR_SUBSTREAMED and code > _ERROR
    if not skimmed & SOUND or skimmed & REFUSES or (code != _GOOD and not deletes and not refused):
        return None
    both = _free_glances()
    if function == GET_VAR_SUBSTREAMED:
        found = _streamed(both, request, response, refused)
        _FREE.append(both)
        return found
    asked = both.asked
    told = both.told
    asked.begin(request, REQUEST, function, REQUEST_SIZE)
    told.begin(response, RESPONSE, function, RESPONSE_SIZE)
    seen = Seen()
    if asked.plain and told.plain and (deletes or told.number() == 0):
        if function == GET_MULTI_VARIABLES:
            _got(asked, told, seen, read, skimmed >> VALUES > 0)
        elif function == SET_MULTI_VARIABLES:
            _set(asked, seen, outputs, elsewhere)
        elif deletes:
            seen.deleted = asked.four()
            seen.good = code <= _ERROR
            if asked.skip(1):
                asked.expect(USUAL_QUALIFIER)
        else:
            asked.plain = False
        seen.integrity_id = asked.ends()
    else:
        asked.plain = False
    plain: bool = asked.plain and told.plain
    if plain:
        seen.come(request, asked.data)
    _FREE.append(both)
    return seen if plain else None


def _got(asked: Glance, told: Glance, seen: Seen, read: i64, ordered: bool) -> None:
    """Look at a read of several variables, perhaps with the operating state. ``ordered``: each item comes once, in order."""
    seen.matters = False
    wanted: i64 = read >> VALUES & PLACES
    asked.go_on(read >> PLACE)
    if not asked.expect(USUAL_QUALIFIER):
        return
    if wanted == 0:
        asked.plain = not read & ASKS  # requested twice: must be read
        return
    if ordered:
        told.items(wanted - 1)
    while told.plain:
        number = told.number()
        if number <= 0:
            break
        if number == wanted:
            seen.state = told.state()
            seen.stated = told.plain
            seen.matters = True
            if ordered:
                break
        else:
            told.value()


def _streamed(both: _Glances, request: bytes, response: bytes, refused: bool) -> Seen | None:
    """Read one attribute: operating state, identification record, or another one. A refused read has no content.

    If the attribute does not matter, its response is sound and is not looked at.
    """
    asked = both.asked
    asked.begin(request, REQUEST, GET_VAR_SUBSTREAMED, REQUEST_SIZE)
    object_id = asked.four()
    if not asked.expect(_IDS):
        return None
    count = asked.number()
    first: i64 = -1
    last: i64 = -1
    while count > 0 and asked.plain:
        last = asked.number()
        if first < 0:
            first = last
        count -= 1
    if not asked.plain or last < 0 or last in COMPRESSED or not asked.expect(USUAL_QUALIFIER) or not asked.skip(2):
        return None
    integrity_id = asked.ends()
    if not asked.plain:
        return None
    if object_id == CPU_EXEC_UNIT:
        if last & _TWO_OCTETS == DIAGNOSIS:
            return None  # a structure with the operating state among its members
        if last & _TWO_OCTETS != OPERATING_STATE:
            return _NOTHING
    elif object_id != CPU_PROXY:
        return _NOTHING
    seen = Seen()
    seen.integrity_id = integrity_id
    seen.good = not refused
    seen.come(request, asked.data)
    told = both.told
    told.begin(response, RESPONSE, GET_VAR_SUBSTREAMED, RESPONSE_SIZE)
    if refused:
        return seen if told.plain else None
    if told.number() != 0 or not told.skip(1):
        return None
    if last == OPERATING_STATE and object_id == CPU_EXEC_UNIT:
        seen.state = told.state()
        seen.stated = told.plain
    elif first == IDENTIFICATION and object_id == CPU_PROXY:
        seen.record = told.blob()
    else:
        seen.matters = False
    return seen if told.plain else None


def _set(asked: Glance, seen: Seen, outputs: bool, elsewhere: bool) -> None:
    """Handle a write: the key of a session, a reference list, attributes that do not matter, or variables reported before."""
    link = asked.four()
    count = asked.count()
    fields = asked.count()
    listed: i64 = -1  # the number of the item that is a reference list
    if link:
        if link in AREAS or link >> 16 in BLOCK_KINDS:
            asked.plain = False
            return
        index: i64 = 0
        while index < fields and asked.plain:
            id_ = asked.number()
            index += 1
            if id_ in _TOLD or id_ in COMPRESSED or (id_ == REFERENCE_LIST and listed > 0):
                asked.plain = False
            elif id_ == SESSION_KEY:
                seen.authenticated = True
            elif id_ == REFERENCE_LIST:
                listed = index
    else:
        _pass_written(asked, count, fields, outputs, elsewhere)
    while count > 0 and asked.plain:
        number = asked.number()
        if number < 0:
            return
        if number == listed:
            if seen.references is not None:
                asked.plain = False  # written twice: must be read
                return
            seen.listed = link
            seen.references = asked.numbers()
        elif not asked.value():
            return
        count -= 1
    if asked.plain and asked.skip(1):
        asked.expect(USUAL_QUALIFIER)


def _pass_written(asked: Glance, count: i64, fields: i64, outputs: bool, elsewhere: bool) -> None:
    """Pass over the addresses of a write; all must be variables that need no more reports."""
    while count > 0 and asked.plain:
        asked.number()
        area = asked.number()
        ids = asked.number()
        known: bool = elsewhere
        if area in OUTPUTS:
            known = outputs
        elif area not in AREAS and area >> 16 not in BLOCK_KINDS:
            known = False
        if ids <= 0 or not known:
            asked.plain = False
            return
        fields -= 3 + ids
        last: i64 = -1
        while ids > 0 and asked.plain:
            last = asked.number()
            ids -= 1
        if last in _TOLD_OF_VARIABLES:
            asked.plain = False
        count -= 1
    if fields != 0:
        asked.plain = False
