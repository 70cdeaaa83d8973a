"""Replaces values of S7comm-plus by values of the same type, structure and size (docs/anonymize.md).

A variable-size number gets a replacement of the same size, so that no length in the message changes.
"""

from __future__ import annotations

import re
from typing import Final

from dissect.files.anonymize import account
from dissect.files.anonymize.account import KEEP, SCRAMBLE, Account, Choices
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.texts import replace_text
from dissect.protocols.s7plus.identification import RECORDS, is_record
from dissect.protocols.s7plus.ids import SECRETS, is_packed
from dissect.protocols.s7plus.session import OPERATING_STATE, REFERENCE_LIST, crc_places
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    AID,
    ARRAY,
    BLOB,
    BOOL,
    FIXED_SIZES,
    NULL,
    PACKED_COUNT_TWICE,
    RID,
    SPARSE_ARRAY,
    STRUCT,
    TIMESTAMP,
    UDINT,
    VALUE_TYPES,
    VARIABLE_SIZES,
    VARIANT,
    WSTRING,
)
from dissect.protocols.s7plus.walk import FormatError, Walk
from dissect.wire.varint import SIGNED, SIGNED64, VLQ, build_varint, read_varint

#: Attributes and members whose numbers stay, because they describe the request or a state and not the process.
_NUMBERS_STAY: Final = frozenset((
    6, 299, 315, 316, 317, 318, 321, 410, 529,  # times of interfaces, the role of a client, versions
    1002, 1003, 1005, 1040, 1049, 1050, 1051, 1052, 1053, 1054, 1055, 1082,  # subscriptions
    1247, 1249, 1250, 1259, 1503, 1543, 1544, 1545, 1801, 1802, 1821, 1842, 1843,  # filters, kinds of types, protection
    2167, 2168, 2259, 2260, 2266, 2398, 2451, 2453, 2454, 2521, 2523, 2529, 2543, 2581, 2607,  # hardware and blocks
    2670, 2671, 2672, 3474, 4079,  # alarms
    3451, 3482, 3483, 3484, 3485, OPERATING_STATE, 3496, 3497, 3498, 3499, 3696, 3697, 3698, 3700,  # states
    3737, 4056, 4057, 4058, 4059, 4060, 4061, 4271, 4633, 4634, 4635, 8201,  # locations and languages
))  # fmt: skip
#: Types without any plant data, as attributes of objects: ids, times, flags.
_TYPES_STAY: Final = frozenset((AID, RID, BOOL, TIMESTAMP))
#: Attributes that contain the code of a block, which `--keep-code` keeps.
_CODE: Final = frozenset((2533, 2537, 2580))
_ORDER_NUMBER: Final = slice(8, 28)
_SERIAL_NUMBER: Final = slice(28, 44)
#: Order number and firmware of a CPU, for example "1;6ES7 215-1AG40-0XB0 ;V4.3"; only the order number is replaced.
_VERSION_TEXTS: Final = frozenset((319, 320))
_VERSION: Final = re.compile(rb"([0-9];)(.*?)( *;V[0-9.]+)")

#: Meaning of a value: a process variable or an argument of a call; any other number is the id of an attribute.
PROCESS: Final = -1


class PlusContents:
    """Replaces values according to ``choices``, and counts the replacements in ``counts``."""

    def __init__(self, key: Key, choices: Choices, counts: Account) -> None:
        self._key = key
        self._choices = choices
        self._counts = counts

    def crc(self, crc: int) -> int:
        """Return the replacement for the checksum of a symbol, which would confirm a guessed name."""
        return self._drawn(crc, VLQ, "crc") if crc else 0

    def name(self, octets: bytes) -> bytes:
        """Return the replacement for a text."""
        new = replace_text(self._key, octets)
        if new != octets:
            self._counts.replace(account.NAMES)
        return new

    def packed(self, octets: bytes) -> bytes:
        """Return the replacement for a structure of the program."""
        new = self._octets(octets, PROCESS)
        self._tell(octets, new, PROCESS, STRUCT)
        return new

    def value(self, octets: bytes, flags: int, type_: int, about: int) -> bytes:
        """Return the replacement for a value after its flags and type. ``about``: an attribute, or `PROCESS`.

        For a structure, ``octets`` are those before its members. Zeros if the octets do not fit the type.
        """
        if type_ == STRUCT:
            return octets
        walk = Walk(octets, 0, len(octets), False)
        new = b""
        try:
            new = self._content(walk, flags, type_, about)
            fits = not walk.left
        except FormatError:
            fits = False
        if not fits:
            self._counts.mask(account.UNKNOWN, octets)
            return bytes(len(octets))
        self._tell(octets, new, about, type_)
        return new

    def _tell(self, old: bytes, new: bytes, about: int, type_: int) -> None:
        if about == PROCESS and self._choices.values == KEEP:
            self._counts.keep(account.VALUES)
        elif old == new:
            return
        elif about == PROCESS:
            if self._choices.values == SCRAMBLE:
                self._counts.replace(account.VALUES)
            else:
                self._counts.mask(account.VALUES, old)
        elif about in SECRETS:
            self._counts.mask(account.PASSWORDS, old)
        elif type_ == WSTRING:
            self._counts.replace(account.NAMES)
        else:
            self._counts.mask(account.CODE if about in _CODE else account.PLUS, old)

    # ---- contents ---------------------------------------------------------------------------------------------------

    def _content(self, walk: Walk, flags: int, type_: int, about: int) -> bytes:
        if type_ not in VALUE_TYPES:
            raise FormatError("unknown_type", "type", walk.at, 0, type_)
        if flags & SPARSE_ARRAY:
            return self._sparse(walk, type_, about)
        if not flags & (ARRAY | ADDRESS_ARRAY):
            return self._one(walk, type_, about)
        start = walk.at
        count = walk.number(VLQ, "count") if type_ == NULL else walk.counted(VLQ, "count")
        head = walk.octets[start : walk.at]
        if type_ == NULL:
            return head  # any number of empty elements
        if about == REFERENCE_LIST and type_ == UDINT:
            return head + self._references(walk, count)
        return head + b"".join([self._one(walk, type_, about) for _ in range(count)])

    def _sparse(self, walk: Walk, type_: int, about: int) -> bytes:
        new: list[bytes] = []
        while True:
            start = walk.at
            key = walk.number(VLQ, "key")
            new.append(walk.octets[start : walk.at])
            if key == 0:
                return b"".join(new)
            new.append(self._number(walk, VLQ, about) if type_ == VARIANT else self._one(walk, type_, about))

    def _references(self, walk: Walk, count: int) -> bytes:
        """Replace the checksums of symbols in the reference list of a subscription."""
        start = walk.at
        numbers = [walk.number(VLQ, "reference") for _ in range(count)]
        new = bytearray(walk.octets[start : walk.at])
        at = 0
        places = set(crc_places(numbers))
        for index, number in enumerate(numbers):
            _, end = read_varint(bytes(new), at, len(new), VLQ)
            if index in places:
                replacement = build_varint(self.crc(number), VLQ)
                if len(replacement) != end - at:
                    raise FormatError("bad_value", "CRC", start + at, len(replacement), end - at)
                new[at:end] = replacement
            at = end
        return bytes(new)

    def _one(self, walk: Walk, type_: int, about: int) -> bytes:
        size = FIXED_SIZES.get(type_, 0)
        if size:
            return self._fixed(walk.take(size, "value"), type_, about)
        kind = VARIABLE_SIZES.get(type_, 0)
        if kind:
            return self._number(walk, kind, about, type_)
        if type_ == WSTRING:
            start = walk.at
            size = walk.counted(VLQ, "length")
            head = walk.octets[start : walk.at]
            return head + self._text(walk.take(size, "text"), about)
        if type_ == BLOB:
            return self._blob(walk, about)
        if type_ == NULL:
            return b""
        if type_ == STRUCT:
            return self._struct(walk, 0, about)
        return self._variant(walk, about)

    def _stays(self, type_: int, about: int) -> bool:
        if about == PROCESS:
            return self._choices.values == KEEP
        return about not in SECRETS and (about in _NUMBERS_STAY or type_ in _TYPES_STAY)

    def _fixed(self, octets: bytes, type_: int, about: int) -> bytes:
        if self._stays(type_, about):
            return octets
        if about == PROCESS and self._choices.values == SCRAMBLE:
            if type_ == BOOL:
                return bytes((octets[0] ^ (self._key.stream("bit", b"", 1)[0] & 1),))
            return self._key.stream("octets", octets, len(octets))
        return bytes(len(octets))

    def _number(self, walk: Walk, kind: int, about: int, type_: int = UDINT) -> bytes:
        start = walk.at
        number = walk.number(kind, "number")
        octets = walk.octets[start : walk.at]
        if self._stays(type_, about):
            return octets
        if about == PROCESS and self._choices.values == SCRAMBLE:
            new = build_varint(self._drawn(number, kind, "number"), kind)
        else:
            new = build_varint(_least(len(octets), kind), kind)
        return new if len(new) == len(octets) else bytes([0x80] * (len(octets) - 1) + [0])

    def _drawn(self, number: int, kind: int, purpose: str) -> int:
        """Return a number of the same encoded size as ``number``; equal numbers get equal replacements."""
        size = len(build_varint(number, kind))
        least, most = _least(size, kind), _most(size, kind)
        drawn = int.from_bytes(self._key.stream(purpose, number.to_bytes(9, "big", signed=True), 16), "big")
        return least + drawn % (most - least + 1)

    def _text(self, octets: bytes, about: int) -> bytes:
        if about == PROCESS:
            if self._choices.values == KEEP:
                return octets
            return replace_text(self._key, octets) if self._choices.values == SCRAMBLE else bytes(len(octets))
        if about in SECRETS:
            return bytes(len(octets))
        version = _VERSION.fullmatch(octets) if about in _VERSION_TEXTS else None
        if version is not None:
            return version[1] + replace_text(self._key, version[2]) + version[3]
        return replace_text(self._key, octets)

    def _blob(self, walk: Walk, about: int) -> bytes:
        start = walk.at
        root = walk.number(VLQ, "root")
        if root > 1:
            walk.take(8, "blob head")
            kind = walk.u8("kind")
            head = walk.octets[start : walk.at]
            if kind == 0:
                return head + self._members(walk, about)
            if kind not in {2, 3}:
                raise FormatError("unknown_type", "blob kind", walk.at - 1, 0, kind)
            start = walk.at
        else:
            head = b""
        size = walk.counted(VLQ, "length")
        head += walk.octets[start : walk.at]
        return head + self._octets(walk.take(size, "blob"), about)

    def _octets(self, octets: bytes, about: int) -> bytes:
        """Rewrite the bytes of a blob: texts, code, certificates, hashes, and others."""
        if about == PROCESS:
            if self._choices.values == SCRAMBLE:
                return self._key.stream("octets", octets, len(octets))
            return octets if self._choices.values == KEEP else bytes(len(octets))
        if about in _CODE and self._choices.keep_code:
            return octets
        if about in RECORDS and is_record(octets):
            new = bytearray(octets)
            for part in (_ORDER_NUMBER, _SERIAL_NUMBER):
                new[part] = replace_text(self._key, octets[part])
            self._counts.replace(account.SERIALS)
            return bytes(new)
        return bytes(len(octets))

    def _struct(self, walk: Walk, flags: int, about: int) -> bytes:
        """Rewrite a structure inside a value, starting at its id."""
        start = walk.at
        id_ = walk.fixed(4, "structure")
        if is_packed(id_):
            walk.take(8, "interface time")
            twice = walk.number(VLQ, "transport flags") & PACKED_COUNT_TWICE
            count = walk.number(VLQ, "count")
            if twice:
                count = walk.number(VLQ, "count")
            head = walk.octets[start : walk.at]
            return head + self._octets(walk.take(count, "packed structure"), about)
        count = walk.counted(VLQ, "count") if flags & (ARRAY | ADDRESS_ARRAY) else 1
        head = walk.octets[start : walk.at]
        return head + b"".join([self._members(walk, about) for _ in range(count)])

    def _members(self, walk: Walk, about: int) -> bytes:
        new: list[bytes] = []
        walk.enter("members")
        while True:
            start = walk.at
            id_ = walk.number(VLQ, "member")
            if id_ == 0:
                walk.depth -= 1
                return b"".join((*new, walk.octets[start : walk.at]))
            new.append(walk.octets[start : walk.at])
            new.append(self._variant(walk, about if about == PROCESS or about in SECRETS else id_))

    def _variant(self, walk: Walk, about: int) -> bytes:
        """Rewrite a value with its flags and type."""
        start = walk.at
        flags, type_ = walk.u8("flags"), walk.u8("type")
        head = walk.octets[start : walk.at]
        walk.enter("variant")
        whole = type_ == STRUCT and not flags & SPARSE_ARRAY
        new = self._struct(walk, flags, about) if whole else self._content(walk, flags, type_, about)
        walk.depth -= 1
        return head + new


def _least(size: int, kind: int) -> int:
    """Return the smallest number with this encoded size, 0 for one byte."""
    if size <= 1:
        return 0
    return int(1 << (_bits(size - 1, kind)))


def _most(size: int, kind: int) -> int:
    signed = kind in {SIGNED, SIGNED64}
    wide = 64 if kind not in {VLQ, SIGNED} else 32
    return int((1 << min(_bits(size, kind), wide - (1 if signed else 0))) - 1)


def _bits(size: int, kind: int) -> int:
    """Return the number of bits that fit into this many bytes: seven each, eight in the ninth, one less if there is a sign."""
    return 7 * size + (1 if size > 8 else 0) - (1 if kind in {SIGNED, SIGNED64} else 0)
