"""The compiled dictionary (R16): a header of 64 octets, then the records as MessagePack. All numbers little-endian.

    0   8  magic 89 53 43 44 0D 0A 1A 0A        16  4  CRC-32 of the body
    8   1  major version                        20 12  reserved, 0
    9   1  minor version                        32 32  wire id
    10  2  size of the header                   64     body
    12  4  size of the file

All of this is our profile: the text only says that dictionaries are binary files.
"""

from __future__ import annotations

import re
import struct
import zlib
from hashlib import sha256
from typing import Final

import msgspec

from dissect.scd.errors import DictionaryError
from dissect.scd.records import Body, FieldRecord, ObjectRecord, Traits
from dissect.scd.types import ENCODINGS

MAGIC: Final = b"\x89SCD\r\n\x1a\n"
MAJOR: Final = 1
#: Minor version 1 adds the encoding of strings after the other fields; a dictionary in UTF-8 is still written as 0.
MINOR: Final = 1
HEADER_SIZE: Final = 64
#: Octets of the largest dictionary.
MAX_FILE: Final = 64 << 20

_HEADER: Final = struct.Struct("<8sBBHII12s32s")
_DECODER: Final = msgspec.msgpack.Decoder(Body)
_ENCODER: Final = msgspec.msgpack.Encoder()
_NOT_UTF8: Final = "a name or text is not UTF-8"
#: No string of a dictionary is deeper in arrays than this.
_DEEPEST: Final = 12
#: The first bytes of strings in MessagePack.
_STRINGS: Final = frozenset((*range(0xA0, 0xC0), 0xD9, 0xDA, 0xDB))
_POSITION: Final = re.compile(r"\(byte (\d+)\)")


def build_file(body: Body) -> bytes:
    """Return the compiled file of checked records; the same records always give the same octets.

    Raises `DictionaryError` if the file would be larger than `MAX_FILE`.
    """
    octets, minor = _content(body)
    size = HEADER_SIZE + len(octets)
    if size > MAX_FILE:
        raise DictionaryError("file", f"{size} bytes, a dictionary has at most {MAX_FILE}")
    header = _HEADER.pack(MAGIC, MAJOR, minor, HEADER_SIZE, size, zlib.crc32(octets), bytes(12), wire_id(body))
    return header + octets


def _content(body: Body) -> tuple[bytes, int]:
    """Return the octets of the records, and the minor version that they need."""
    if body.encoding != ENCODINGS[0]:
        return _ENCODER.encode(body), MINOR
    return _ENCODER.encode(msgspec.structs.astuple(body)[:-1]), 0


def parse_file(octets: bytes, path: str = "") -> Body:
    """Return the records of a compiled file, which are still to be checked. Raises `DictionaryError`."""
    try:
        return _parse(octets)
    except DictionaryError as error:
        error.path = path
        raise


def is_compiled(octets: bytes) -> bool:
    """Return whether a file begins like a compiled dictionary, even if it is damaged after the fourth octet."""
    return octets[:4] == MAGIC[:4]


def _parse(octets: bytes) -> Body:
    size = len(octets)
    if size > MAX_FILE:
        raise DictionaryError("file", f"{size} bytes, a dictionary has at most {MAX_FILE}")
    if octets[:8] != MAGIC[:size]:
        damaged = " (damaged as by a text-mode transfer)" if is_compiled(octets) else ""
        raise DictionaryError("header, byte 0", f"not a compiled dictionary: the magic number differs{damaged}")
    if size < HEADER_SIZE:
        raise DictionaryError(f"header, byte {size}", f"the file ends within the header of {HEADER_SIZE} bytes")
    _, major, minor, header_size, file_size, crc, spare, identity = _HEADER.unpack_from(octets)
    if major != MAJOR:
        raise DictionaryError("header, byte 8", f"format {major}.{minor} is unknown, expected {MAJOR}")
    if header_size < HEADER_SIZE or header_size > size or (minor <= MINOR and header_size != HEADER_SIZE):
        raise DictionaryError("header, byte 10", f"a header of {header_size} bytes")
    if file_size != size:
        raise DictionaryError("header, byte 12", f"the file should have {file_size} bytes and has {size}")
    content = memoryview(octets)[header_size:]
    if zlib.crc32(content) != crc:
        raise DictionaryError("header, byte 16", f"the CRC-32 of the body is {zlib.crc32(content):08x}, not {crc:08x}")
    if minor <= MINOR and any(spare):
        raise DictionaryError("header, byte 20", "the reserved bytes are not 0")
    body = _decode(content, header_size)
    if minor <= MINOR and _content(body) != (bytes(content), minor):
        raise DictionaryError(
            "body", "not in the one form a dictionary has: fields too many, or numbers written longer"
        )
    if minor <= MINOR and wire_id(body) != identity:
        raise DictionaryError("header, byte 32", "the wire id does not match the body")
    return body


def _decode(content: memoryview, start: int) -> Body:
    try:
        return _DECODER.decode(content)
    except msgspec.ValidationError as error:
        text, _, path = str(error).partition(" - at ")
        raise DictionaryError(f"body {path.strip('`')}".rstrip(), text) from None
    except msgspec.DecodeError as error:
        # msgspec from 0.23 on does not report the position.
        if "UTF-8" in str(error) and (at := _not_utf8(bytes(content), _DEEPEST)) >= 0:
            raise DictionaryError(f"body, byte {start + at}", _NOT_UTF8, rule="R42") from None
        match = _POSITION.search(str(error))
        where = f"body, byte {start + int(match[1])}" if match else f"body, byte {start + len(content)}"
        raise DictionaryError(where, str(error)) from None
    except UnicodeDecodeError as error:
        at = bytes(content).find(error.object) if error.object else -1
        where = f"body, byte {start + at + error.start}" if at >= 0 else "body"
        raise DictionaryError(where, _NOT_UTF8, rule="R42") from None
    except RecursionError:
        raise DictionaryError("body", "arrays are nested too deeply") from None


def _not_utf8(packed: bytes, deepest: int) -> int:
    """Return where in MessagePack the first byte is that makes a string no UTF-8; -1 if there is none.

    Arrays are searched to the depth ``deepest``.
    """
    try:
        parts = msgspec.msgpack.decode(packed, type=list[msgspec.Raw])
    except msgspec.MsgspecError:
        head = {0xD9: 2, 0xDA: 3, 0xDB: 5}.get(packed[0], 1) if packed and packed[0] in _STRINGS else 0
        try:
            packed[head:].decode() if head else None
        except UnicodeDecodeError as error:
            return head + error.start
        return -1
    at = 0
    for part in map(bytes, parts if deepest else ()):
        at = packed.find(part, at)
        if (found := _not_utf8(part, deepest - 1)) >= 0:
            return at + found
        at += len(part)
    return -1


def wire_id(body: Body) -> bytes:
    """Return SHA-256 over everything that decoding depends on: all of the records but names, texts, units and limits."""
    deciding: tuple[object, ...] = (
        body.time_scale,
        [(row.index, row.kind, row.bits) for row in body.types],
        [(row.index, [_field(field) for field in row.fields]) for row in body.structs],
        [_object(row) for row in body.objects],
        body.envelope,
    )
    if body.encoding != ENCODINGS[0]:
        deciding += (body.encoding,)
    return sha256(_ENCODER.encode(deciding)).digest()


def _field(row: FieldRecord) -> tuple[object, ...]:
    return row.type, row.bits, row.fixed, row.access, row.mappable, row.default, _traits(row.traits)


def _object(row: ObjectRecord) -> tuple[object, ...]:
    return (
        row.index, row.object_class, row.type, row.bits, row.access, row.mandatory, row.mappable, row.count, row.used,
        row.values, [_field(field) for field in row.fields], _traits(row.traits),
    )  # fmt: skip


def _traits(traits: Traits | None) -> tuple[float, float] | None:
    return None if traits is None or (traits.scale == 1 and not traits.shift) else (traits.scale, traits.shift)
