"""Skips values without making objects of them, so that the judgement of a PDU costs little if its values are not needed.

Only sound and plain values are skipped; others are left to `dissect.protocols.s7plus.value_reading`, which finds their faults
and the places of these. A property test ensures that both agree (tests/protocols/s7plus/test_cursor.py).
"""

from __future__ import annotations

from typing import Final

from librt.strings import read_i16_be, read_i64_be
from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7plus.blobs import COMPRESSED, MAX_INFLATED, check_blob, is_compressed, may_swell
from dissect.protocols.s7plus.cursor_lists import pass_names, pass_variables
from dissect.protocols.s7plus.ids import is_packed
from dissect.protocols.s7plus.tables import (
    ATTRIBUTE_TAG,
    NAMES_TAG,
    OBJECT_END_TAG,
    OBJECT_TAG,
    RELATION_TAG,
    TAG_DESCRIPTION_TAG,
    VARIABLES_TAG,
)
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    ARRAY,
    BLOB,
    FIXED_SIZES,
    NULL,
    PACKED_COUNT_TWICE,
    SPARSE_ARRAY,
    STRUCT,
    VARIABLE_SIZES,
    VARIANT,
    WSTRING,
)
from dissect.protocols.s7plus.walk import MAX_DEPTH, STEP, Walk
from dissect.wire.octets import u32
from dissect.wire.varint import SIGNED64, VLQ64, pass_varint

_BIT_7: Final = 0x80
#: Number of octets that are read at once, if possible; then the number of bits after the first octet, after two, after three.
_WORD: Final = 8
_BEHIND_1: Final = 56
_BEHIND_2: Final = 48
_BEHIND_3: Final = 40
#: Octets of the longest number of 32 bits.
_LONGEST: Final = 5
_SEVERAL: Final = SPARSE_ARRAY | ARRAY | ADDRESS_ARRAY
#: Kinds of types without a fixed size: numbers of variable size with 32 or 64 bits, or others.
_OTHER: Final = 0x80
_NUMBER: Final = 0x81
_WIDE: Final = 0x82
_TEXT: Final = 0x83
_BLOB: Final = 0x84
_VARIANT: Final = 0x85
_UNKNOWN: Final = 0xFF
_KINDS: Final = {
    NULL: 0, WSTRING: _TEXT, BLOB: _BLOB, VARIANT: _VARIANT, **FIXED_SIZES,
    **{type_: _WIDE if kind in (VLQ64, SIGNED64) else _NUMBER for type_, kind in VARIABLE_SIZES.items()},
}  # fmt: skip
#: By type: size of one element, or one of these kinds.
_SIZES: Final = bytes([_KINDS.get(type_, _UNKNOWN) for type_ in range(256)])
#: Compressed blobs that may swell are inflated at once if they are not larger than this, because many tools send the same ones
#: again and again.
_SMALL: Final = 64
#: Nested structures up to this depth are skipped; deeper ones are read.
_MAX_NESTED: Final = 8
#: Octets of the id of an object or a structure.
_RID: Final = 4
#: Octets at the beginning of a structure that is sent as raw octets.
_INTERFACE_TIME: Final = 8
#: Bits in a table of attributes: it may contain compressed blobs; it is wanted.
_CAREFUL: Final = 1
_WANTED: Final = 2
#: Bit in `Cursor.seen`: an attribute or class that was given to `marks` was met.
MET: Final = 2
#: Bit in a table of `marks`: the place of the attribute is noted (`Cursor.noted`).
_NOTED: Final = 4
#: From this bit on, `_pass_attribute` returns the table's entry for the attribute; below it the size.
_MARK: Final = 16
_PASSED: Final = 0xFFFF
#: Number of ids in such a table; ids of attributes have at most two octets of seven bits.
_IDS: Final = 1 << 14


def table(wanted: frozenset[int]) -> bytes:
    """Return a table for `Cursor.attributes`, by attribute id; ``wanted`` are the needed ones."""
    said = bytearray(_IDS)
    for id_ in COMPRESSED:
        said[id_] = _CAREFUL
    for id_ in wanted:
        said[id_] = _WANTED
    return bytes(said)


#: By id, whether an attribute or member may contain compressed blobs.
_COMPRESSED: Final = table(frozenset())


def marks(attributes: frozenset[int], classes: frozenset[int], noted: frozenset[int] = frozenset()) -> bytes:
    """Return a table for `Cursor.elements`, with `MET` for the ids of these attributes and classes.

    ``noted`` are the attributes whose places are noted.
    """
    said = bytearray(2 * _IDS)
    for id_ in COMPRESSED:
        said[id_] = _CAREFUL
    for id_ in attributes:
        said[id_] |= MET
    for id_ in noted:
        said[id_] |= _NOTED
    for id_ in classes:
        said[_IDS + id_] = MET
    return bytes(said)


def is_wanted(wanted: bytes, id_: int) -> bool:
    """Return whether a table wants an attribute; ids beyond the table are wanted."""
    return id_ >= len(wanted) or wanted[id_] == _WANTED


@mypyc_attr(acyclic=True, free_list_len=1)  # made for each PDU and value, and then reused: most recent first
class Cursor:
    """Passes over values and objects in ``octets``, from ``at`` up to an end.

    ``spent`` is the work that reading them would cost. ``seen`` has the bits of the table of `elements` for all classes and
    attributes that were met. ``noted`` are the places of the tags of objects, of their ends, of lists, and of the attributes
    that the table marks; None if places are not needed.
    """

    __slots__ = ("_careful", "_end", "_inflated", "_octets", "at", "noted", "seen", "spent")

    def __init__(self, octets: bytes, at: i64, end: i64) -> None:
        self._octets: bytes = octets
        self._end: i64 = end
        self._inflated: i64 = 0  # octets of inflated small blobs
        self._careful = False
        self.at: i64 = at
        self.spent: i64 = 0
        self.seen: i64 = 0
        self.noted: list[int] | None = None

    def value(self, depth: i64, nested: i64 = 0) -> bool:
        """Skip a value; return False if it must be read: then ``at`` has no meaning.

        ``depth`` is the depth of the walk around the value.
        """
        octets = self._octets
        end: i64 = self._end
        at: i64 = self.at
        if at + 2 > end:
            return False
        head: i64 = i64(read_i16_be(octets, at))
        type_: i64 = head & 0xFF
        at += 2
        self.spent += STEP
        if head & (_SEVERAL << 8) == 0 and type_ != STRUCT:
            kind: i64 = _SIZES[type_]
            if kind < _OTHER:
                self.at = at + kind
                return at + kind <= end
            self.at = at
            return self._one(kind)
        self.at = at
        flags: i64 = head >> 8 & 0xFF
        if type_ == STRUCT:
            return self._struct(flags, depth, nested)
        if flags & SPARSE_ARRAY:
            return self._sparse(type_)
        count = self.number()
        size: i64 = _SIZES[type_]
        if count < 0 or type_ == NULL or size == _UNKNOWN:
            return False
        self.spent += count
        if size < _OTHER:
            self.at += size * count
            return self.at <= end
        if count > end - self.at:
            return False
        if size == _NUMBER:
            return self.numbers(count)
        while count > 0:
            if not self._one(size):
                return False
            count -= 1
        return True

    def careful_value(self, depth: i64, careful: bool) -> bool:
        """Skip a value as `value` does; if ``careful``, a blob that may become large must be read."""
        self._careful = careful
        passed = self.value(depth)
        self._careful = False
        return passed

    def attributes(self, wanted: bytes, depth: i64) -> None:
        """Skip relations and unwanted attributes up to something else, whose tag is then at ``at``.

        ``wanted`` is made by `table`. A blob that may become large must be read.
        """
        octets = self._octets
        while True:
            start: i64 = self.at
            if start + 2 > self._end:
                return
            tag: i64 = octets[start]
            if tag != ATTRIBUTE_TAG and tag != RELATION_TAG:
                return
            spent: i64 = self.spent
            self.at = start + 1
            id_ = self.number()
            if tag == RELATION_TAG:
                passed: bool = id_ >= 0 and self.at + _RID <= self._end
                self.at += _RID
            elif id_ < 0 or id_ >= _IDS or wanted[id_] == _WANTED:
                passed = False
            else:
                passed = self.careful_value(depth, wanted[id_] == _CAREFUL)
            if not passed:
                self.at = start
                self.spent = spent
                return

    def elements(self, bits: bytes) -> bool:
        """Skip objects with their contents, up to an octet that is not a tag; return False if they must be read.

        ``bits`` is made by `marks`; its bits for the classes and attributes met are added to ``seen``.
        """
        octets = self._octets
        end: i64 = self._end
        last: i64 = len(octets) - _WORD
        noted = self.noted
        level: i64 = 0
        while self.at < end:
            at: i64 = self.at
            if at <= last:
                passed: i64 = _pass_attribute(read_i64_be(octets, at), bits)
                if passed > 0:
                    self.at = at + (passed & _PASSED)
                    self.spent += STEP
                    if passed > _PASSED:
                        self.seen |= passed >> _MARK & MET
                        if noted is not None and passed >> _MARK & _NOTED:
                            noted.append(at)
                    continue
            tag: i64 = octets[at]
            self.at = at + 1
            if tag == ATTRIBUTE_TAG:
                id_ = self.number()
                if id_ < 0:
                    return False
                mark: i64 = 0
                if id_ < _IDS:
                    mark = bits[id_]
                self.seen |= mark & MET
                if noted is not None and mark & _NOTED:
                    noted.append(at)
                if not self.careful_value(level, mark & _CAREFUL != 0):
                    return False
            elif tag == RELATION_TAG:
                self.number()  # if it is missing, nothing is left
                self.at += _RID
                if self.at > end:
                    return False
            else:
                if tag == OBJECT_TAG:
                    level += 1
                    if level > MAX_DEPTH or not self._head(bits):
                        return False
                elif tag == OBJECT_END_TAG and level > 0:
                    level -= 1
                elif tag == VARIABLES_TAG:
                    if not self._listed(pass_variables(octets, at + 1, end)):
                        return False
                elif tag == NAMES_TAG:
                    if not self._listed(pass_names(octets, at + 1, end)):
                        return False
                else:
                    self.at = at
                    return level == 0 and tag != TAG_DESCRIPTION_TAG
                if noted is not None:
                    noted.append(at)
        return level == 0 and self.at == end

    def number(self) -> i64:
        """Read an unsigned number of at most 32 bits, -1 if there is none."""
        at: i64 = self.at
        if at + 1 < self._end:
            two: i64 = i64(read_i16_be(self._octets, at))
            if two >= 0:
                self.at = at + 1
                return two >> 8
            if two & _BIT_7 == 0:
                self.at = at + 2
                return (two >> 1 & 0x3F80) | (two & 0x7F)
        return self._long_number()

    def _long_number(self) -> i64:
        """Read a number as `number` does, of any length, even close to the end."""
        octets = self._octets
        at: i64 = self.at
        stop: i64 = min(at + _LONGEST, self._end)
        value: i64 = 0
        while at < stop:
            octet: i64 = octets[at]
            at += 1
            value = value << 7 | octet & 0x7F
            if octet < _BIT_7:
                self.at = at
                return value & 0xFFFFFFFF
        self.at = self._end  # so that nothing more is found
        return -1

    def numbers(self, count: i64) -> bool:
        """Skip ``count`` numbers of at most 32 bits; return False if they are not there."""
        octets = self._octets
        end: i64 = self._end
        at: i64 = self.at
        while count > 0:
            if at < end and octets[at] < _BIT_7:
                at += 1
            else:
                at = pass_varint(octets, at, end, False)
                if at < 0:
                    return False
            count -= 1
        self.at = at
        return True

    def ids(self, count: i64) -> bool:
        """Pass over ``count`` ids of attributes.

        If the last one may be compressed, the next `value` takes this into account.
        """
        id_: i64 = 0
        while count > 0:
            id_ = self.number()
            if id_ < 0:
                return False
            count -= 1
        self._careful = id_ < _IDS and _COMPRESSED[id_] != 0
        return True

    def items(self, most: i64 = _BIT_7 - 1) -> i64:
        """Skip plain values that are numbered 1, 2, 3 …, at most ``most``; return how many there were."""
        octets = self._octets
        at: i64 = self.at
        last: i64 = self._end - _WORD
        count: i64 = 0
        most = min(most, _BIT_7 - 1)
        while at <= last and count < most:
            word: i64 = read_i64_be(octets, at)
            if word >> _BEHIND_1 != count + 1:
                break
            passed: i64 = pass_plain(word, _BEHIND_1)
            if passed == 0 or at + passed > self._end:
                break
            at += passed
            count += 1
        self.spent += STEP * count
        self.at = at
        return count

    def wide(self) -> bool:
        """Skip an unsigned number of 64 bits; return False if it is not there."""
        self.at = pass_varint(self._octets, self.at, self._end, True)
        return self.at >= 0

    def members(self, depth: i64, nested: i64) -> bool:
        """Skip pairs of id and value up to the id 0; return False if they must be read."""
        if nested >= _MAX_NESTED or depth + nested + 1 > MAX_DEPTH:
            return False
        careful = self._careful
        octets = self._octets
        end: i64 = self._end
        last: i64 = end - _WORD
        while True:
            at: i64 = self.at
            if at <= last:
                passed: i64 = _pass_member(read_i64_be(octets, at))
                if passed > 0 and at + passed <= end:
                    self.at = at + passed
                    self.spent += STEP
                    continue
            id_ = self.number()
            if id_ <= 0:
                self._careful = careful
                return id_ == 0
            self._careful = id_ < _IDS and _COMPRESSED[id_] != 0
            if not self.value(depth, nested + 1):
                return False

    def _head(self, bits: bytes) -> bool:
        """Pass over the beginning of an object, after its tag."""
        self.spent += STEP
        self.at += _RID
        class_id = self.number()
        self.number()  # flags
        attribute = self.number()  # missing if one before it is
        if attribute < 0 or (attribute > 0 and self.number() < 0):
            return False
        if class_id < _IDS:
            self.seen |= bits[_IDS + class_id]
        return True

    def _listed(self, passed: tuple[i64, i64]) -> bool:
        """Take the result of `pass_variables` or `pass_names`."""
        self.at = passed[0]
        self.spent += STEP * passed[1]
        return self.at >= 0

    def _one(self, kind: i64) -> bool:
        """Pass over an element without a fixed size."""
        if kind == _NUMBER or kind == _WIDE:
            at: i64 = self.at
            if at < self._end and self._octets[at] < _BIT_7:
                self.at = at + 1
                return True
            self.at = pass_varint(self._octets, at, self._end, kind == _WIDE)
            return self.at >= 0
        if kind == _TEXT or kind == _BLOB:
            if kind == _BLOB:
                root = self.number()
                if root < 0 or root > 1:
                    return False  # otherwise more octets come before the length
            size = self.number()
            if size < 0:
                return False
            begin: i64 = self.at
            self.at = begin + size
            if self.at > self._end:
                return False
            return not (self._careful and kind == _BLOB and self._is_risky(self._octets[begin : self.at]))
        return False  # a Variant, or an unknown type

    def _is_risky(self, blob: bytes) -> bool:
        """Return whether a compressed blob may become large, or is small and not sound."""
        if not is_compressed(blob) or not may_swell(blob):
            return False
        if len(blob) > _SMALL:
            return True
        opened = check_blob(blob)
        self._inflated += opened.size
        return len(opened.fault) > 0 or self._inflated > MAX_INFLATED

    def _sparse(self, type_: i64) -> bool:
        """Pass over pairs of key and value up to the key 0."""
        size: i64 = _SIZES[type_]
        if size == _UNKNOWN:
            return False
        while True:
            key = self.number()
            if key <= 0:
                return key == 0
            self.spent += 1
            if size < _OTHER:
                self.at += size
                if self.at > self._end:
                    return False
            elif type_ == VARIANT:
                if self.number() < 0:
                    return False
            elif not self._one(size):
                return False

    def _struct(self, flags: i64, depth: i64, nested: i64) -> bool:
        """Skip a structure, with separate members or as raw octets, or an array of structures."""
        at: i64 = self.at
        if flags & SPARSE_ARRAY or at + _RID > self._end:
            return False
        self.at = at + _RID
        if is_packed(u32(self._octets, at)):
            return self._packed()
        if flags & (ARRAY | ADDRESS_ARRAY) == 0:
            return self.members(depth, nested)
        count = self.number()
        if count < 0 or count > self._end - self.at:
            return False
        self.spent += count
        while count > 0:
            if not self.members(depth, nested):
                return False
            count -= 1
        return True

    def _packed(self) -> bool:
        """Skip a structure that is sent as raw octets."""
        self.at += _INTERFACE_TIME
        flags = self.number()
        size = self.number()
        if flags & PACKED_COUNT_TWICE:
            size = self.number()
        self.at += size
        return size >= 0 and self.at <= self._end


def _pass_attribute(word: i64, bits: bytes) -> i64:
    """Return the size of an attribute, given its first eight octets (``word``, tag included); 0 if it needs a closer look.

    Only plain values (`pass_plain`) have a result; compressed blobs are not plain. The entry of ``bits`` for the attribute is
    in the result from bit `_MARK` on. The caller checks that all octets are present.
    """
    if word >> 56 != ATTRIBUTE_TAG - 0x100:  # the tag with its sign
        return 0
    id_: i64 = word >> _BEHIND_2 & 0xFF
    left: i64 = _BEHIND_2
    if id_ >= _BIT_7:
        second: i64 = word >> _BEHIND_3 & 0xFF
        if second >= _BIT_7:
            return 0
        id_ = (id_ & 0x7F) << 7 | second
        left = _BEHIND_3
    passed = pass_plain(word, left)
    if passed == 0:
        return 0
    mark: i64 = bits[id_]
    return passed | mark << _MARK


def _pass_member(word: i64) -> i64:
    """Return the size of a structure member, given its first eight octets (``word``); 0 if it needs a closer look.

    Only plain values (`pass_plain`) have a result, with ids of one or two octets.
    """
    first: i64 = word >> _BEHIND_1 & 0xFF
    if first < _BIT_7:
        if first == 0:
            return 0
        return pass_plain(word, _BEHIND_1)
    second: i64 = word >> _BEHIND_2 & 0xFF
    if second >= _BIT_7 or first + second == _BIT_7:
        return 0
    return pass_plain(word, _BEHIND_2)


def pass_plain(word: i64, left: i64) -> i64:
    """Return the end of a plain value, counted from the first of the eight octets in ``word``; 0 if it needs a closer look.

    The value begins after the bits ``left`` of the word. A plain value has a fixed size, or is a number that ends within the
    word, or a text whose one-octet length is present.
    """
    left -= 16
    head: i64 = word >> left & 0xFFFF
    if head > 0xFF:
        return 0
    kind: i64 = _SIZES[head]
    behind: i64 = _WORD - (left >> 3)
    if kind < _OTHER:
        return behind + kind
    if kind != _NUMBER and kind != _WIDE:
        if kind != _TEXT or left < 8:
            return 0
        left -= 8
        size: i64 = word >> left & 0xFF
        if size >= _BIT_7:
            return 0
        return behind + 1 + size
    while left > 0:
        left -= 8
        behind += 1
        if word >> left & _BIT_7 == 0:
            return behind
    return 0


def passed(walk: Walk) -> bool:
    """Skip the value at the position of ``walk``; return False and do nothing if it must be read."""
    cursor = Cursor(walk.octets, walk.at, walk.end)
    if not cursor.value(walk.depth):
        return False
    walk.at = cursor.at
    walk.spend(cursor.spent, "value")
    return True


def member_at(octets: bytes, at: int, end: int, id_: int) -> int:
    """Return where the value of the first member with this id begins, in the structure at ``at``; -1 if it is not found."""
    cursor = Cursor(octets, at + 2 + _RID, end)
    if cursor.at > end or is_packed(u32(octets, at + 2)):
        return -1
    while True:
        found = cursor.number()
        if found == id_:
            return int(cursor.at)
        if found <= 0 or not cursor.value(0):
            return -1
