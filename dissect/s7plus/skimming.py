"""Checks whether the contents of a PDU are sound (counts, lengths, depths, types, the end), without making objects of them.

This is done for every PDU. Contents that are certainly sound are passed over; all others are left to `dissect.s7plus.bodies`,
which knows which faults they have and where. A property test ensures that no faulty PDU passes (tests/s7plus/test_skimming.py).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.ending import FILL, NOTIFICATION_FILL, RESPONSE2_FILL
from dissect.s7plus.grammar import (
    ADDRESSES,
    BEGUN,
    CALL,
    DETAILS,
    DETAILS_BIT,
    ELEMENTS,
    END,
    FIRST,
    FORMS,
    FROM,
    GROUPS,
    IDS,
    INTEGRITY_EARLY,
    INTEGRITY_V3,
    ITEMS,
    LINK,
    LINKED,
    MADE,
    NOTIFIED_OBJECTS,
    NOTIFIED_VALUE,
    OBJECT,
    OBJECTS,
    OBJECTS_V1,
    PATH,
    QUALIFIER,
    REFERENCED,
    REFERENCED_VLQ,
    REFUSALS,
    REFUSED,
    REQUESTS,
    RESERVED_1,
    RESERVED_2,
    RESERVED_4,
    RESPONSES,
    RETURN,
    RETURN_OR_ITEM,
    SEQUENCE,
    STREAM,
    TARGETS,
    UNNAMED,
    VALUE,
    WRITTEN,
)
from dissect.s7plus.message import DIGEST_SIZE, LARGEST_KEPT, SHORT_HEADS, parsed
from dissect.s7plus.noted import Noted, keep_noted
from dissect.s7plus.pieces import USUAL_QUALIFIER
from dissect.s7plus.plain import NOTIFICATION_SIZE, REQUEST_SIZE, RESPONSE_SIZE, one_frame
from dissect.s7plus.session import CPU_EXEC_UNIT, CPU_PROXY, DIAGNOSIS, OPERATING_STATE
from dissect.s7plus.skipping import Skipper, marks
from dissect.s7plus.tables import (
    CREATE_OBJECT,
    EXPLORE,
    NOTIFICATION,
    OBJECT_TAG,
    REQUEST,
    RESPONSE,
    RESPONSE2,
    SET_VAR_SUBSTREAMED,
    V1,
    V2,
    V3,
)
from dissect.s7plus.walk import MAX_WORK
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ64, read_varint

#: Bits of the result of `skim`: contents are sound; they must be read; items are refused. `MET` of skipping is another bit.
SOUND: Final = 8
UNSOUND: Final = 16
REFUSES: Final = 4
#: For a read: it may request the operating state, or the identification of the CPU.
ASKS: Final = 1
#: How many bits these take. Above them are the lower 16 bits of the return value of a response, plus 1; 0 for none.
WORDS: Final = 8
#: Mask of that: a return code plus 1.
CODES: Final = 0x1FFFF
_CODE: Final = 0xFFFF
#: From this bit on: how many values a response has, if they are numbered from 1 and none is refused; else 0. All other results
#: are below it.
VALUES: Final = 32
#: For a request to read several variables, the bits from `VALUES` on have the number of the item that is the operating state (0
#: for none or several), and those from `PLACE` on the offset in the frame at which the addresses end. If one of them exceeds
#: `PLACES`, both are left out.
PLACE: Final = 48
PLACES: Final = 0x7FFF
_WITHOUT_PLACES: Final = (1 << VALUES) - 1
_NO_CODE: Final = -1

#: Marks for objects of which nothing matters.
_NO_MARKS: Final = marks(frozenset(), frozenset())
_BIT_7: Final = 0x80
#: The last two octets of the ids of the operating state and of the structure that holds it, whatever their length.
_STATE: Final = (OPERATING_STATE >> 7 | _BIT_7) << 8 | OPERATING_STATE & (_BIT_7 - 1)
_DIAGNOSIS: Final = (DIAGNOSIS >> 7 | _BIT_7) << 8 | DIAGNOSIS & (_BIT_7 - 1)
#: Octets of: an id; a filter of Explore before its members; what is between the parts of a notification; a time.
_ID: Final = 4
_FILTER: Final = 5
_SECOND_PART: Final = 6
_TIME: Final = 8


def skim(octets: bytes, marks: bytes) -> i64:
    """Skim a PDU of version 1, 2 or 3; return `UNSOUND` if its contents must be read. Never raises.

    Else return `SOUND`, with `REFUSES`, `ASKS` and the bits of ``marks`` for the objects in it (`Skipper.seen`); from bit
    `WORDS` on the return code plus 1; from bit `VALUES` on how many values there are, or what is read. Return 0 for contents
    that are not judged: those of an incomplete PDU, or of a function whose body is not known.
    """
    at, end = one_frame(octets)
    if at >= 0:
        return _skim(octets, octets, at, end, octets[1], True, marks)
    pdu = parsed(octets)
    if not pdu.whole or pdu.malformed:
        return 0
    found = _skim(octets, pdu.data, 0, len(pdu.data), pdu.version, pdu.frames == 1, marks)
    return found & _WITHOUT_PLACES if pdu.opcode == REQUEST else found


def _skim(pdu: bytes, octets: bytes, at: i64, end: i64, version: i64, single: bool, marks: bytes) -> i64:
    """Skim the data of a PDU, ``octets[at:end]``."""
    opcode: i64 = octets[at] if at < end else 0
    if opcode == NOTIFICATION:
        if version == V1:
            return UNSOUND
        if end - at < NOTIFICATION_SIZE:
            return 0
        body = free_body()
        body.begin(octets, at + NOTIFICATION_SIZE, end, version, marks)
        return body.result(body.notification(u32(octets, at + 1)), _NO_CODE)
    request = opcode == REQUEST
    size: i64 = REQUEST_SIZE if request else RESPONSE_SIZE
    if (not request and opcode != RESPONSE and opcode != RESPONSE2) or end - at < size:
        return 0
    function = u16(octets, at + 3)
    if request and function == SET_VAR_SUBSTREAMED and not single:
        return UNSOUND
    body = free_body()
    body.begin(octets, at + size, end, version, marks)
    if request:
        return body.result(body.body(function, True) and (not body.known or body.ends(FILL)), _NO_CODE)
    code: i64 = octets[at + size] if at + size < end else 0
    if code >= _BIT_7:
        value = read_varint(octets, at + size, end, VLQ64)[0]
        body.details = value >> DETAILS_BIT & 1 != 0
        code = value & _CODE
    if not body.skipper.wide():
        return body.result(False, _NO_CODE)
    fill: i64 = RESPONSE2_FILL if opcode == RESPONSE2 else FILL
    if opcode != RESPONSE or (function != EXPLORE and function != CREATE_OBJECT) or end > LARGEST_KEPT:
        return body.result(body.body(function, False) and (not body.known or body.ends(fill)), code)
    noted = Noted(pdu, octets, at, end, marks)
    body.skipper.noted = noted.places
    sound: bool = body.body(function, False) and body.ends(fill)
    body.tell(noted)
    result = body.result(sound, code)
    keep_noted(noted if result & SOUND else None)
    return result


def skim_again(octets: bytes, asked: bytes, place: i64) -> bool:
    """Return whether a request is a sound read of the same: the octets ``asked``, which end at the offset ``place``."""
    at, end = one_frame(octets)
    begin: i64 = place - len(asked)
    if at < 0 or at + REQUEST_SIZE != begin or place > end or octets[begin:place] != asked:
        return False
    body = free_body()
    body.begin(octets, place, end, octets[1], b"")
    return body.result(body.read_ends(), _NO_CODE) & SOUND != 0


def skim_refusals(octets: bytes) -> list[tuple[int, int]] | None:
    """Return the items that a notification refuses, as (number, kind); None if it must be read, or is another PDU."""
    at, end = one_frame(octets)
    if at < 0 or end - at < NOTIFICATION_SIZE or octets[at] != NOTIFICATION or octets[1] == V1:
        return None
    body = free_body()
    body.begin(octets, at + NOTIFICATION_SIZE, end, octets[1], _NO_MARKS)
    sound = body.notification(u32(octets, at + 1))
    found = body.refusals
    return found if body.result(sound, _NO_CODE) & SOUND else None


class Body:
    """The body of a PDU, which ``skipper`` passes over. Each method returns False if the PDU must be read.

    ``refusals`` are the items that a notification refuses, as (number, kind). ``known`` is False for functions whose body is
    not known. ``details``: the return value says that objects follow. ``object_id`` is the object that comes first, ``ids`` are
    those of the created objects.
    ``integrity_id`` is -1 until one was passed.
    """

    __slots__ = (
        "_asks",
        "_end",
        "_expected",
        "_item",
        "_marks",
        "_numbered",
        "_octets",
        "_place",
        "_refused",
        "_version",
        "details",
        "ids",
        "integrity_id",
        "known",
        "object_id",
        "refusals",
        "skipper",
    )

    def __init__(self) -> None:
        self._octets = b""
        self._end: i64 = 0
        self._version: i64 = 0
        self._marks = b""
        self._asks: i64 = 0  # `ASKS`, once such an item was passed
        self._item: i64 = 0  # the number of that item, 0 for several
        self._place: i64 = 0  # where the addresses of a read end
        self._refused: i64 = 0  # `REFUSES`, once an item is refused
        self._expected: i64 = 0  # how many values follow the addresses of a write
        self.details = False
        self._numbered: i64 = 0  # how many values are numbered from 1 on
        self.integrity_id: i64 = -1
        self.object_id: i64 = -1
        self.ids: list[int] = []
        self.refusals: list[tuple[int, int]] = []
        self.known = True
        self.skipper: Skipper = Skipper(b"", 0, 0)

    def begin(self, octets: bytes, at: i64, end: i64, version: i64, marks: bytes) -> None:
        """Begin with the body of a PDU, ``octets[at:end]``."""
        self._octets = octets
        self._end = end
        self._version = version
        self._marks = marks
        self._asks = 0
        self._item = 0
        self._place = 0
        self._refused = 0
        self._numbered = 0
        self.details = False
        self.integrity_id = -1
        self.object_id = -1
        if self.ids:
            self.ids = []
        if self.refusals:
            self.refusals = []
        self.known = True
        self.skipper.begin(octets, at, end)

    def result(self, sound: bool, code: i64) -> i64:
        """Return the result of `skim`; then drop the octets and mark this object as free."""
        skipper = self.skipper
        result: i64 = UNSOUND
        if sound and skipper.spent <= MAX_WORK:
            result = 0
            if self.known:
                result = SOUND | skipper.seen | self._refused | self._asks | code + 1 << WORDS
                if self._numbered > 0 and not self._refused:
                    result |= self._numbered << VALUES
                elif 0 < self._place <= PLACES and self._item <= PLACES:
                    result |= self._item << VALUES | self._place << PLACE
        self._octets = b""
        skipper.begin(b"", 0, 0)
        _FREE.append(self)
        return result

    def tell(self, noted: Noted) -> None:
        """Copy what was seen to ``noted``, before this object is freed."""
        noted.ids = self.ids
        noted.integrity_id = self.integrity_id
        noted.object_id = self.object_id

    def body(self, function: i64, request: bool) -> bool:
        """Pass over the elements of a body (`dissect.s7plus.grammar`), after the return value and without the end."""
        at: i64 = function - FIRST
        if at < 0 or at >= len(REQUESTS):
            self.known = False
            return True
        place: i64 = REQUESTS[at] if request else RESPONSES[at]
        element: i64 = ELEMENTS[place]
        self.known = place > 0
        while element != END:
            if not self._element(element):
                return False
            place += 1
            element = ELEMENTS[place]
        return True

    def _element(self, element: i64) -> bool:
        """Pass over an element; those of most PDUs come first."""
        if element == QUALIFIER:
            return self._qualifier()
        if element == ADDRESSES:
            sound: bool = self._addresses() >= 0
            self._place = self.skipper.at
            return sound
        if element == ITEMS:
            return self._items()
        if element == REFUSALS:
            return self._refusals()
        if element == VALUE:
            return self.skipper.value(0)
        if element == OBJECT:
            return self._object()
        if element == RESERVED_1:
            return self._skip(1)
        if element == IDS:
            return self._ids()
        if element == TARGETS:
            self._expected = self._addresses()
            return self._expected >= 0
        if element == WRITTEN:
            return self._values(self._expected)
        if element == PATH:
            return self._path()
        if element == RESERVED_2:
            return self._skip(2)
        if element == OBJECTS:
            return self.skipper.elements(self._marks)
        return self._rare(element)

    def _rare(self, element: i64) -> bool:
        """Pass over an element of what is seldom sent, or large."""
        skipper = self.skipper
        if element == RESERVED_4:
            return self._skip(_ID)
        if element == OBJECTS_V1:
            return self._version != V1 or skipper.elements(self._marks)
        if element == DETAILS:
            return not self.details or skipper.elements(self._marks)
        if element == INTEGRITY_V3:
            return self._version != V3 or self._id()
        if element == INTEGRITY_EARLY:
            wanted: bool = self._version == V3 or (self._version == V2 and self._peek() != OBJECT_TAG)
            return not wanted or self._id()
        if element == MADE:
            return self._made()
        if element == FROM:
            return self._skip(_ID) and skipper.number() >= 0 and self._skip(3)
        if element == GROUPS:
            return self._groups()
        if element == LINK:
            return self._skip(_ID) and skipper.number() >= 0 and self._skip(2)
        if element == LINKED:
            return self._skip(_ID * self._octet())
        if element == SEQUENCE:
            return self._sequence()
        if element == BEGUN:
            return self._version == V1 or self._skip(2 + _ID)
        if element == CALL:
            return self._skip(2 * _ID)
        if element == RETURN:
            return skipper.wide()
        if element == RETURN_OR_ITEM:
            return self._peek() == 1 or skipper.wide()
        # A stream: the first value says which attribute is written; whether that may be compressed is not checked here.
        return element == STREAM and skipper.careful_value(0, True)

    def notification(self, subscription: i64) -> bool:
        """Pass over the body of a notification, with its end."""
        skipper = self.skipper
        if subscription >= SHORT_HEADS:
            if skipper.number() < 0:
                return False
            if self._peek() == 0 and not self._skip(_TIME):
                return False
        if not self._skip(1) or not self._notified():
            return False
        if self._peek() > 0 and not (self._skip(_SECOND_PART) and self._notified()):
            return False
        left: i64 = self._end - skipper.at
        return left == 0 or (NOTIFICATION_FILL - 1 <= left <= NOTIFICATION_FILL and self._zeros(skipper.at))

    def ends(self, fill: i64) -> bool:
        """Pass over the end of a request or response, with at most ``fill`` zeros."""
        at: i64 = self.skipper.at
        left: i64 = self._end - at
        if left == 0 or self._filled(at, fill) or (self._version == V2 and self._is_digest(at)):
            return True
        if self.integrity_id >= 0 or self._version == V1 or not self._id():
            return False
        at = self.skipper.at
        return self._filled(at, FILL) or self._is_digest(at)

    def read_ends(self) -> bool:
        """Pass over what follows the addresses of a read."""
        return self._qualifier() and self.ends(FILL)

    def _filled(self, at: i64, fill: i64) -> bool:
        left: i64 = self._end - at
        return (left == fill or (left == FILL - 1 and fill == FILL)) and self._zeros(at)

    def _zeros(self, at: i64) -> bool:
        octets = self._octets
        while at < self._end:
            if octets[at]:
                return False
            at += 1
        return True

    def _is_digest(self, at: i64) -> bool:
        return self._end - at == 1 + DIGEST_SIZE and self._octets[at] == DIGEST_SIZE

    def _peek(self) -> i64:
        at: i64 = self.skipper.at
        return self._octets[at] if at < self._end else -1

    def _octet(self) -> i64:
        """Read an octet; beyond the end return a number larger than any octet or count that could be there."""
        at: i64 = self.skipper.at
        self.skipper.at = at + 1
        return self._octets[at] if at < self._end else self._end

    def _skip(self, size: i64) -> bool:
        self.skipper.at += size
        return self.skipper.at <= self._end

    def _id(self) -> bool:
        self.integrity_id = self.skipper.number()
        return self.integrity_id >= 0

    def _count(self) -> i64:
        """Read a count of elements of at least one octet each, -1 if it is too large."""
        count = self.skipper.number()
        return count if count <= self._end - self.skipper.at else -1

    def _qualifier(self) -> bool:
        """Pass over the usual qualifier."""
        at: i64 = self.skipper.at
        behind: i64 = at + len(USUAL_QUALIFIER)
        self.skipper.at = behind
        return behind <= self._end and self._octets[at:behind] == USUAL_QUALIFIER

    def _object(self) -> bool:
        """Read the id of an object."""
        at: i64 = self.skipper.at
        self.skipper.at = at + _ID
        if at + _ID > self._end:
            return False
        self.object_id = u32(self._octets, at)
        return True

    def _ids(self) -> bool:
        """Pass over the ids of attributes; a compressed value of one must be read."""
        count = self._count()
        return count >= 0 and self.skipper.ids(count)

    def _addresses(self) -> i64:
        """Pass over the addresses of items. Return how many values they have, -1 if they must be read."""
        if not self._skip(_ID):
            return -1
        skipper = self.skipper
        link: i64 = u32(self._octets, skipper.at - _ID)
        count = self._count()
        fields = self._count()
        if count < 0 or fields < 0:
            return -1
        if link:
            passed: bool = self._attributes(fields) if link == CPU_EXEC_UNIT else skipper.numbers(fields)
            return count if passed else -1
        index: i64 = 0
        while index < count:
            if not skipper.numbers(1):
                return -1
            area = skipper.number()
            ids = self._count()
            if area < 0 or ids <= 0 or not skipper.numbers(ids - 1):
                return -1
            last = skipper.number()
            if last < 0:
                return -1
            index += 1
            if area == CPU_EXEC_UNIT and last == (OPERATING_STATE if ids > 1 else DIAGNOSIS):
                self._item = index if self._asks == 0 else 0
                self._asks = ASKS
            fields -= 3 + ids
        return count if fields == 0 else -1

    def _attributes(self, count: i64) -> bool:
        """Pass over ``count`` attributes of the execution unit, each of which is an item."""
        index: i64 = 0
        while index < count:
            id_ = self.skipper.number()
            if id_ < 0:
                return False
            index += 1
            if id_ == DIAGNOSIS:
                self._item = index if self._asks == 0 else 0
                self._asks = ASKS
        return True

    def _path(self) -> bool:
        """Pass over the ids of an attribute of the object that came before."""
        if not self.skipper.value(0):
            return False
        last = u16(self._octets, self.skipper.at - 2)
        object_id: i64 = self.object_id
        if object_id == CPU_PROXY or (object_id == CPU_EXEC_UNIT and (last == _STATE or last == _DIAGNOSIS)):
            self._asks = ASKS
        return True

    def _values(self, count: i64) -> bool:
        """Pass over ``count`` numbers with values."""
        skipper = self.skipper
        if count < 0:
            return False
        while count > 0:
            if skipper.number() < 0 or not skipper.value(0):
                return False
            count -= 1
        return True

    def _items(self) -> bool:
        """Pass over numbers with values up to the number 0; count them while they are numbered from 1."""
        skipper = self.skipper
        count: i64 = skipper.items()
        while True:
            number = skipper.number()
            if number <= 0:
                self._numbered = count
                return number == 0
            if number != count + 1:
                count = -2  # stays negative
            count += 1
            if not skipper.value(0):
                return False

    def _refusals(self) -> bool:
        """Pass over numbers with return values up to the number 0."""
        skipper = self.skipper
        while True:
            number = skipper.number()
            if number <= 0:
                return number == 0
            if not skipper.wide():
                return False
            self._refused = REFUSES

    def _groups(self) -> bool:
        skipper = self.skipper
        while True:
            filters = self._octet()
            count = self._octet()
            if skipper.at > self._end:
                return False
            last = filters == 0
            while filters > 0:
                if not self._skip(_FILTER) or not skipper.members(0, 0):
                    return False
                filters -= 1
            if not skipper.numbers(count):
                return False
            if last:
                return True

    def _made(self) -> bool:
        count = self._octet()
        while count > 0:
            id_ = self.skipper.number()
            if id_ < 0:
                return False
            self.ids.append(id_)
            count -= 1
        return True

    def _sequence(self) -> bool:
        if not self._skip(1):
            return False
        if self._version == V1:
            return True
        if not self._skip(2):
            return False
        if u16(self._octets, self.skipper.at - 2) != 1:
            return self._skip(_ID)
        index: i64 = 0
        while index < 2 and self._peek() != OBJECT_TAG:
            self.skipper.at += 1
            index += 1
        return self.skipper.at <= self._end and self.skipper.elements(self._marks)

    def _notified(self) -> bool:
        """Pass over the items of a notification."""
        skipper = self.skipper
        while True:
            kind = self._octet()
            if skipper.at > self._end:
                return False
            form: i64 = FORMS[kind]
            if form == REFERENCED:
                if not self._skip(_ID) or not skipper.value(0):
                    return False
            elif kind == 0:
                return True
            elif form == REFUSED or form == UNNAMED:
                if not self._skip(_ID):
                    return False
                if form == REFUSED:
                    self._refused = REFUSES
                    self.refusals.append((int(u32(self._octets, skipper.at - _ID)), int(kind)))
            elif form == REFERENCED_VLQ:
                if skipper.number() < 0 or not skipper.value(0):
                    return False
            elif form == NOTIFIED_OBJECTS:
                if not skipper.elements(self._marks):
                    return False
            elif form != NOTIFIED_VALUE or not skipper.value(0):
                return False


#: Free objects: making one for each PDU would take as long as skimming it. Threads do not share one. There are several, because
#: a list that is emptied and filled again and again gets new memory each time.
_FREE: Final[list[Body]] = [Body() for _ in range(8)]


def free_body() -> Body:
    """Return a free object; `Body.result` gives it back."""
    try:
        return _FREE.pop()
    except IndexError:
        return Body()
