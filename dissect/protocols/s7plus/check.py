"""Checks whether the contents of a PDU are sound (counts, lengths, depths, types, the end), without making objects of them.

This is done for every PDU. Contents that are certainly sound are skipped; all others are left to
`dissect.protocols.s7plus.bodies`, which finds their faults and the places of these. A property test ensures that no faulty PDU
passes (tests/protocols/s7plus/test_check.py).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7plus.checked import Checked
from dissect.protocols.s7plus.cursor import marks
from dissect.protocols.s7plus.ending import FILL, NOTIFICATION_FILL, RESPONSE2_FILL, read_tail, zeros_at
from dissect.protocols.s7plus.grammar import (
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
from dissect.protocols.s7plus.identification import IDENTIFICATION
from dissect.protocols.s7plus.message import SHORT_HEADS, parse_plus
from dissect.protocols.s7plus.plain import NOTIFICATION_SIZE, REQUEST_SIZE, RESPONSE_SIZE, one_frame
from dissect.protocols.s7plus.program import CODE, TYPE_INFO
from dissect.protocols.s7plus.session import ASKED_OF_OBJECTS, CPU_EXEC_UNIT, CPU_PROXY, DIAGNOSIS, OPERATING_STATE
from dissect.protocols.s7plus.tables import (
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
from dissect.protocols.s7plus.walk import MAX_WORK
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ64, read_varint

#: What matters in objects: code of a block, names of variables; and the attributes that are read.
MARKS: Final = marks(CODE, frozenset((TYPE_INFO,)), ASKED_OF_OBJECTS)
_CODE: Final = 0xFFFF
_BIT_7: Final = 0x80
#: The last two octets of the ids of the operating state, of the structure that contains it, and of the identification record.
_STATE: Final = (OPERATING_STATE >> 7 | _BIT_7) << 8 | OPERATING_STATE & (_BIT_7 - 1)
_RECORD: Final = (IDENTIFICATION >> 7 | _BIT_7) << 8 | IDENTIFICATION & (_BIT_7 - 1)
_DIAGNOSIS: Final = (DIAGNOSIS >> 7 | _BIT_7) << 8 | DIAGNOSIS & (_BIT_7 - 1)
#: Sizes in octets of: an id; a filter of Explore before its members; the octets between the parts of a notification; a time.
_ID: Final = 4
_FILTER: Final = 5
_SECOND_PART: Final = 6
_TIME: Final = 8


@mypyc_attr(acyclic=True, free_list_len=1)  # as `Cursor`
class Check(Checked):
    """Checks the contents of a PDU, and stores the results."""

    __slots__ = ()

    def seek(self, number: i64) -> i64:
        """Return where the value of the item with a number begins in a sound PDU: 0 if there is none, -1 for several."""
        self._sought = number
        self.valued = 0
        self._again()
        self._sought = -1
        return self.valued

    def places(self) -> list[int]:
        """Return for each item of a sound PDU its number and the place of its value, one after the other."""
        found: list[int] = []
        self._met = found
        self._again()
        self._met = None
        return found

    def _again(self) -> None:
        """Walk over a sound PDU once more to find its items."""
        refused = self._refused
        self._seeking = True
        self._contents(True)
        self._seeking = False
        self._refused = refused

    def _meet(self, number: i64) -> None:
        """Note where the value of an item begins, if it is sought."""
        met = self._met
        if met is not None:
            met.append(int(number))
            met.append(int(self.at))
        elif number == self._sought:
            if self.valued == 0:
                self.valued = self.at
            else:
                self.valued = -1

    def run(self, single: bool) -> None:
        """Check the contents; ``single``: they are in one frame."""
        if not self._is_read():
            return
        if not self._contents(single) or self.spent > MAX_WORK:
            self.odd = True
        else:
            self.sound = self._known

    def _is_read(self) -> bool:
        """Return whether the contents of the PDU can be checked and are long enough for its head."""
        size: i64 = self._end - self.begin
        opcode = self.opcode
        if opcode == NOTIFICATION:
            return size >= NOTIFICATION_SIZE or self._version == V1
        if opcode == REQUEST:
            return size >= REQUEST_SIZE
        return size >= RESPONSE_SIZE and (opcode == RESPONSE or opcode == RESPONSE2)

    def _contents(self, single: bool) -> bool:
        """Walk over the contents, including the end; ``single``: they are in one frame."""
        if self.opcode == NOTIFICATION:
            self.at = self.begin + NOTIFICATION_SIZE
            return self._version != V1 and self._notification(u32(self._octets, self.begin + 1))
        if self.opcode == REQUEST:
            self.at = self.begin + REQUEST_SIZE
            return self._request(single)
        self.at = self.begin + RESPONSE_SIZE
        return self._response()

    def _request(self, single: bool) -> bool:
        self.function = u16(self._octets, self.begin + 3)
        if self.function == SET_VAR_SUBSTREAMED and not single:
            return False  # each further frame is a piece of the stream
        if self.function == CREATE_OBJECT:
            self.noted = []
        return self._body(self.function, True) and (not self._known or self._ends(FILL))

    def _response(self) -> bool:
        octets = self._octets
        at: i64 = self.at
        self.function = u16(octets, self.begin + 3)
        code: i64 = 0
        if at < self._end:
            code = octets[at]
        if code >= _BIT_7:
            value = read_varint(octets, at, self._end, VLQ64)[0]
            self.details = value >> DETAILS_BIT & 1 != 0
            code = value & _CODE
        if not self.wide():
            return False
        self.code = code
        fill: i64 = FILL
        if self.opcode == RESPONSE2:
            fill = RESPONSE2_FILL
        if self.opcode == RESPONSE and (self.function == EXPLORE or self.function == CREATE_OBJECT):
            self.noted = []
        return self._body(self.function, False) and (not self._known or self._ends(fill))

    def _body(self, function: i64, request: bool) -> bool:
        """Walk over the elements of a body (`dissect.protocols.s7plus.grammar`), after the return value and without the end."""
        at: i64 = function - FIRST
        if at < 0 or at >= len(REQUESTS):
            self._known = False
            return True
        place: i64 = RESPONSES[at]
        if request:
            place = REQUESTS[at]
        element: i64 = ELEMENTS[place]
        self._known = place > 0
        while element != END:
            sound: bool = self._qualifier() if element == QUALIFIER else self._element(element)
            if not sound:
                return False
            place += 1
            element = ELEMENTS[place]
        return True

    def _element(self, element: i64) -> bool:
        """Walk over an element other than the qualifier; those of most PDUs come first."""
        if element == ADDRESSES:
            sound: bool = self._addresses() >= 0
            self.place = self.at
            return sound
        if element == ITEMS:
            return self._items()
        if element == REFUSALS:
            return self._refusals()
        if element == VALUE:
            self.valued = self.at
            return self.value(0)
        if element == OBJECT:
            return self._object()
        if element == RESERVED_1:
            return self._skip(1)
        if element == IDS:
            self.place = self.at
            return self._ids()
        if element == TARGETS:
            self.expected = self._addresses()
            self.place = self.at
            return self.expected >= 0
        if element == WRITTEN:
            return self._values(self.expected)
        if element == PATH:
            return self._path()
        if element == RESERVED_2:
            return self._skip(2)
        if element == OBJECTS:
            return self.elements(self._marks)
        return self._rare(element)

    def _rare(self, element: i64) -> bool:
        """Walk over an element that is rare or large."""
        if element == RESERVED_4:
            return self._skip(_ID)
        if element == OBJECTS_V1:
            return self._version != V1 or self.elements(self._marks)
        if element == DETAILS:
            return not self.details or self.elements(self._marks)
        if element == INTEGRITY_V3:
            return self._version != V3 or self._id()
        if element == INTEGRITY_EARLY:
            wanted: bool = self._version == V3 or (self._version == V2 and self._peek() != OBJECT_TAG)
            return not wanted or self._id()
        if element == MADE:
            return self._ids_made()
        if element == FROM:
            return self._skip(_ID) and self.number() >= 0 and self._skip(3)
        if element == GROUPS:
            return self._groups()
        if element == LINK:
            return self._skip(_ID) and self.number() >= 0 and self._skip(2)
        if element == LINKED:
            return self._skip(_ID * self._octet())
        if element == SEQUENCE:
            return self._sequence()
        if element == BEGUN:
            return self._version == V1 or self._skip(2 + _ID)
        if element == CALL:
            return self._skip(2 * _ID)
        if element == RETURN:
            return self.wide()
        if element == RETURN_OR_ITEM:
            return self._peek() == 1 or self.wide()
        # A stream: the first value states which attribute is written; whether this one may be compressed is not checked here.
        return element == STREAM and self.careful_value(0, True)

    def _notification(self, subscription: i64) -> bool:
        """Walk over the body of a notification, including its end."""
        if subscription >= SHORT_HEADS:
            self.number()  # if it is missing, so is what must follow
            if self._peek() == 0:
                self.at += _TIME
        self.at += 1
        if not self._notified():
            return False
        if self._peek() > 0:
            self.at += _SECOND_PART
            if not self._notified():
                return False
        left: i64 = self._end - self.at
        return left == 0 or (
            NOTIFICATION_FILL - 1 <= left <= NOTIFICATION_FILL and zeros_at(self._octets, self.at, self._end)
        )

    def _ends(self, fill: i64) -> bool:
        """Walk over the end of a request or response, with at most ``fill`` zeros."""
        early: i64 = self.integrity_id
        id_ = read_tail(self._octets, self.at, self._end, self._version, fill, early >= 0)
        if early < 0:
            self.integrity_id = max(id_, -1)
        return id_ >= -1

    def _ids(self) -> bool:
        """Walk over the ids of attributes; a compressed value of one must be read."""
        count = self._count()
        return count >= 0 and self.ids(count)

    def _addresses(self) -> i64:
        """Pass over the addresses of items. Return the number of their values, -1 if they must be read.

        Where a number is missing, nothing is left, so that the element after it is missing too.
        """
        if not self._skip(_ID):
            return -1
        link: i64 = u32(self._octets, self.at - _ID)
        count = self._count()
        fields = self._count()
        if count < 0 or fields < 0:
            return -1
        if link:
            if link == CPU_EXEC_UNIT:
                self._attributes(fields)
            elif not self.numbers(fields):
                return -1
            return count
        index: i64 = 0
        while index < count:
            if not self.numbers(1):
                return -1
            area = self.number()
            ids = self._count()
            if ids <= 0 or not self.numbers(ids - 1):
                return -1
            last = self.number()
            index += 1
            if area == CPU_EXEC_UNIT and last == (OPERATING_STATE if ids > 1 else DIAGNOSIS):
                self._ask(index)
            fields -= 3 + ids
        if fields != 0:
            return -1
        return count

    def _attributes(self, count: i64) -> None:
        """Walk over ``count`` attributes of the execution unit, each of which is an item."""
        index: i64 = 0
        while index < count:
            index += 1
            if self.number() == DIAGNOSIS:
                self._ask(index)

    def _ask(self, index: i64) -> None:
        """Note that an item may be the operating state."""
        self.item = 0
        if not self.asks:
            self.item = index
        self.asks = True

    def _path(self) -> bool:
        """Walk over the ids of an attribute of the preceding object."""
        first: i64 = self.at + 2 + 1  # after flags, type, and a count below 128
        if not self.value(0):
            return False
        object_id: i64 = self.object_id
        if object_id == CPU_PROXY:
            self.asks = first + 2 > self._end or u16(self._octets, first) == _RECORD
        elif object_id == CPU_EXEC_UNIT:
            last = u16(self._octets, self.at - 2)
            self.asks = last == _STATE or last == _DIAGNOSIS
        return True

    def _values(self, count: i64) -> bool:
        """Pass over ``count`` numbers with values."""
        while count > 0:
            number = self.number()
            if self._seeking:
                self._meet(number)
            if not self.value(0):
                return False
            count -= 1
        return True

    def _items(self) -> bool:
        """Walk over numbers with values up to the number 0; count them while they are numbered from 1."""
        count: i64 = 0
        if not self._seeking:
            count = self.items()
        while True:
            number = self.number()
            if number <= 0:
                self.numbered = count
                return number == 0
            if self._seeking:
                self._meet(number)
            if number != count + 1:
                count = -2  # stays negative
            count += 1
            if not self.value(0):
                return False

    def _refusals(self) -> bool:
        """Pass over numbers with return values up to the number 0."""
        while True:
            number = self.number()
            if number <= 0:
                return number == 0
            if not self.wide():
                return False
            self.refuses = True

    def _groups(self) -> bool:
        while True:
            filters = self._octet()
            count = self._octet()
            last = filters == 0
            while filters > 0:
                if not self._skip(_FILTER) or not self.members(0, 0):
                    return False
                filters -= 1
            if not self.numbers(count):
                return False
            if last:
                return True

    def _ids_made(self) -> bool:
        found: list[int] = []
        self._made = found
        count = self._octet()
        while count > 0:
            id_ = self.number()
            if id_ < 0:
                return False
            found.append(int(id_))
            count -= 1
        return True

    def _sequence(self) -> bool:
        if not self._skip(1):
            return False
        if self._version == V1:
            return True
        if not self._skip(2):
            return False
        if u16(self._octets, self.at - 2) != 1:
            return self._skip(_ID)
        index: i64 = 0
        while index < 2 and self._peek() != OBJECT_TAG:
            self.at += 1
            index += 1
        return self.elements(self._marks)

    def _notified(self) -> bool:
        """Pass over the items of a notification."""
        while True:
            kind = self._octet()
            if self.at > self._end:
                return False
            form: i64 = FORMS[kind]
            if form == REFERENCED:
                if not self._skip(_ID):
                    return False
                if self._seeking:
                    self._meet(u32(self._octets, self.at - _ID))
                if not self.value(0):
                    return False
            elif kind == 0:
                return True
            elif form == REFUSED or form == UNNAMED:
                if not self._skip(_ID):
                    return False
                if form == REFUSED:
                    self.refuses = True
                    if self._refused is None:
                        self._refused = []
                    self._refused.append((int(u32(self._octets, self.at - _ID)), int(kind)))
            elif form == REFERENCED_VLQ:
                reference = self.number()
                if self._seeking:
                    self._meet(reference)
                if not self.value(0):
                    return False
            elif form == NOTIFIED_OBJECTS:
                if not self.elements(self._marks):
                    return False
            elif form != NOTIFIED_VALUE or not self.value(0):
                return False


def check(octets: bytes, marks: bytes = MARKS) -> Check:
    """Check a PDU of version 1, 2 or 3. ``marks`` states which attributes and classes of objects matter. Never raises."""
    begin, end = one_frame(octets)
    if begin >= 0:
        found = Check(octets, octets, begin, end, marks)
        found.run(True)
        return found
    pdu = parse_plus(octets)
    found = Check(octets, pdu.data, 0, len(pdu.data), marks, pdu)
    if pdu.whole and not pdu.malformed:
        found.run(pdu.frames == 1)
    return found
