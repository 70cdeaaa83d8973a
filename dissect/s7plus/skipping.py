"""Passes over values without making anything of them, so that judging a PDU costs little where nobody looks at its values.

Only what is sound and plain is passed; everything else is left to `dissect.s7plus.value_reading`, which knows what is wrong and
where. That both agree is a property test (tests/s7plus/test_skipping.py).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.blobs import COMPRESSED, may_swell
from dissect.s7plus.tables import ATTRIBUTE_TAG, RELATION_TAG, VARIABLE_NUMBERS
from dissect.s7plus.value_tables import (
    ADDRESS_ARRAY,
    ARRAY,
    BLOB,
    FIXED_SIZES,
    NULL,
    SPARSE_ARRAY,
    STRUCT,
    VARIABLE_SIZES,
    WSTRING,
    is_packed,
)
from dissect.s7plus.walk import MAX_DEPTH, STEP, Walk
from dissect.wire.octets import u16
from dissect.wire.varint import VLQ, read_varint

_OTHER: Final = 0x80
#: By type: octets of one element; what is `_OTHER` has a length of its own, or is a number of variable size.
_SIZES: Final = bytes([FIXED_SIZES.get(type_, _OTHER) for type_ in range(256)])
#: Structures inside each other that are passed over; deeper ones are read.
_MAX_NESTED: Final = 8
#: Octets of the id of an object.
_RID: Final = 4
#: Of a list of variables (`dissect.s7plus.variables`): its id, a variable without its numbers, its attributes within that, and
#: by their highest four bits how many numbers of four octets there are.
_LIST_ID: Final = 4
_VARIABLE: Final = 16
_ATTRIBUTES: Final = 9
_NUMBERS: Final = bytes(VARIABLE_NUMBERS)
#: What a table of attributes says of one: it may hold compressed blobs, or somebody wants it.
_CAREFUL: Final = 1
_WANTED: Final = 2
#: Ids that such a table knows; attributes have at most two octets of seven bits.
_IDS: Final = 1 << 14


def table(wanted: frozenset[int]) -> bytes:
    """Return for each id of an attribute whether it is among those that are wanted, for `Skipper.attributes`."""
    said = bytearray(_IDS)
    for id_ in COMPRESSED:
        said[id_] = _CAREFUL
    for id_ in wanted:
        said[id_] = _WANTED
    return bytes(said)


def is_wanted(wanted: bytes, id_: int) -> bool:
    """Tell whether a table wants an attribute; it does not know ids beyond its own, and so wants them."""
    return id_ >= len(wanted) or wanted[id_] == _WANTED


def _is_passed(type_: i64) -> bool:
    """Tell whether elements of a type without a fixed size are passed over: no Variant, and nothing unknown."""
    return type_ == NULL or type_ == WSTRING or type_ == BLOB or type_ in VARIABLE_SIZES


class Skipper:
    """Passes over values of ``octets``, from ``at`` on and before ``end``.

    ``spent`` is the work that reading them would cost.
    """

    __slots__ = ("_careful", "_end", "_octets", "at", "spent")

    def __init__(self, octets: bytes, at: i64, end: i64) -> None:
        self._octets: bytes = octets
        self._end: i64 = end
        self._careful = False
        self.at: i64 = at
        self.spent: i64 = 0

    def value(self, depth: i64, nested: i64 = 0) -> bool:
        """Pass over a value; False when it must be read, and then ``at`` means nothing.

        ``depth`` is that of the walk around it.
        """
        octets = self._octets
        at: i64 = self.at
        if at + 2 > self._end:
            return False
        flags: i64 = octets[at]
        type_: i64 = octets[at + 1]
        self.at = at + 2
        self.spent += STEP
        if type_ == STRUCT:
            return flags & (SPARSE_ARRAY | ARRAY | ADDRESS_ARRAY) == 0 and self._struct(depth, nested)
        if flags & SPARSE_ARRAY:
            return self._sparse(type_)
        count: i64 = 1
        if flags & (ARRAY | ADDRESS_ARRAY):
            count = self.number()
            if count < 0 or type_ == NULL:
                return False
            self.spent += count
        size: i64 = _SIZES[type_]
        if size < _OTHER:
            self.at += size * count
            return self.at <= self._end
        if count > self._end - self.at or not _is_passed(type_):
            return False
        while count > 0:
            if not self._one(type_):
                return False
            count -= 1
        return True

    def attributes(self, wanted: bytes, depth: i64) -> None:
        """Pass over attributes that nobody wants, and relations, up to something else, whose tag is then at ``at``.

        ``wanted`` is made by `table`. Blobs that may become large are left to be read.
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
                self._careful = wanted[id_] == _CAREFUL
                passed = self.value(depth)
                self._careful = False
            if not passed:
                self.at = start
                self.spent = spent
                return

    def number(self) -> i64:
        """Read a number of at most 32 bits without sign, -1 for none."""
        at: i64 = self.at
        if at >= self._end:
            return -1
        first: i64 = self._octets[at]
        if first < _OTHER:
            self.at = at + 1
            return first
        if at + 1 < self._end:  # most ids have two octets
            second: i64 = self._octets[at + 1]
            if second < _OTHER:
                self.at = at + 2
                return (first & 0x7F) << 7 | second
        value, behind = read_varint(self._octets, at, self._end, VLQ)
        self.at = behind
        return value

    def _one(self, type_: i64) -> bool:
        """Pass over an element that has no fixed size."""
        if type_ == NULL:
            return True
        if type_ == WSTRING or type_ == BLOB:
            if type_ == BLOB:
                root = self.number()
                if root < 0 or root > 1:
                    return False  # then more stands in front of the length
            size = self.number()
            if size < 0:
                return False
            begin: i64 = self.at
            self.at = begin + size
            if self.at > self._end:
                return False
            return not (self._careful and type_ == BLOB and may_swell(self._octets[begin : self.at]))
        kind = VARIABLE_SIZES.get(type_, 0)
        if kind == 0:
            return False  # a Variant, or no type at all
        at: i64 = self.at
        if at < self._end and self._octets[at] < _OTHER:
            self.at = at + 1
            return True
        self.at = read_varint(self._octets, at, self._end, kind)[1]
        return self.at >= 0

    def _sparse(self, type_: i64) -> bool:
        """Pass over pairs of keys and values up to the key 0."""
        size: i64 = _SIZES[type_]
        while True:
            key = self.number()
            if key <= 0:
                return key == 0 and (size < _OTHER or _is_passed(type_))
            if size < _OTHER:
                self.at += size
                if self.at > self._end:
                    return False
            elif not self._one(type_):
                return False

    def _struct(self, depth: i64, nested: i64) -> bool:
        """Pass over a structure whose members stand there one by one, and hold nothing that is compressed."""
        octets = self._octets
        at: i64 = self.at
        if at + 4 > self._end or nested >= _MAX_NESTED or depth + nested + 1 > MAX_DEPTH:
            return False
        if is_packed(int.from_bytes(octets[at : at + 4], "big")):
            return False
        self.at = at + 4
        while True:
            id_ = self.number()
            if id_ <= 0:
                return id_ == 0
            if id_ in COMPRESSED or not self.value(depth, nested + 1):
                return False


def passed(walk: Walk) -> bool:
    """Pass over the value at which a walk is; False, and nothing is done, where it must be read."""
    skipper = Skipper(walk.octets, walk.at, walk.end)
    if not skipper.value(walk.depth):
        return False
    walk.at = skipper.at
    walk.spend(skipper.spent, "value")
    return True


def pass_variables(octets: bytes, at: i64, limit: i64) -> tuple[i64, i64]:
    """Pass over a list of variables behind its tag. Returns (where it ends, how many there are), (-1, 0) to be read."""
    count: i64 = 0
    begun = False
    while at + 2 <= limit:
        end: i64 = at + 2 + u16(octets, at)
        at += 2
        if end == at:
            return at, count
        if end > limit:
            return -1, 0
        if not begun:
            begun = True
            at += _LIST_ID
        while at < end:
            if at + _VARIABLE > end:
                return -1, 0
            numbers: i64 = _NUMBERS[octets[at + _ATTRIBUTES] >> 4]
            at += _VARIABLE + 4 * numbers
            count += 1
        if at != end:
            return -1, 0
    return -1, 0


def pass_names(octets: bytes, at: i64, limit: i64) -> tuple[i64, i64]:
    """Pass over a list of names behind its tag. Returns (where it ends, how many there are), (-1, 0) to be read."""
    count: i64 = 0
    while at + 2 <= limit:
        end: i64 = at + 2 + u16(octets, at)
        at += 2
        if end == at:
            return at, count
        if end > limit:
            return -1, 0
        while at < end:
            length: i64 = octets[at]
            at += 1 + length
            if at >= end or octets[at] != 0:
                return -1, 0
            at += 1
            count += 1
    return -1, 0
