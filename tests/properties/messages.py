"""TPKTs, TPDUs and S7 PDUs built octet by octet for the property tests. Independent of the package."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import pairwise
from random import Random
from typing import Final, NamedTuple

JOB: Final = 1
ACK: Final = 2
ACK_DATA: Final = 3
USERDATA: Final = 7

READ: Final = 0x04
WRITE: Final = 0x05

#: Octets of an element, and (transport size, length in bits) of its answer, by the request's transport size.
SIZES: Final = {
    0x01: (1, 0x03, True),
    0x02: (1, 0x04, True),
    0x03: (1, 0x09, False),
    0x04: (2, 0x04, True),
    0x05: (2, 0x05, True),
    0x06: (4, 0x04, True),
    0x07: (4, 0x05, True),
    0x08: (4, 0x07, False),
    0x1C: (2, 0x09, False),
    0x1D: (2, 0x09, False),
}


def tpkt(tpdu: bytes) -> bytes:
    """Return a TPDU in its TPKT."""
    return struct.pack(">BBH", 3, 0, len(tpdu) + 4) + tpdu


def dt(data: bytes, *, eot: bool = True) -> bytes:
    """Return user data in a DT in a TPKT."""
    return tpkt(b"\x02\xf0" + (b"\x80" if eot else b"\x00") + data)


#: What Siemens stacks send to acknowledge an answer (reference 2.5).
EMPTY_DT: Final = dt(b"", eot=False)


def fragments(data: bytes, cuts: Sequence[int]) -> bytes:
    """Return user data in several DTs, cut before the octets ``cuts``."""
    edges = [0, *cuts, len(data)]
    return b"".join([dt(data[start:end], eot=end == len(data)) for start, end in pairwise(edges)])


def connect(code: int = 0xE0, size: int = 0x0A, called: bytes = b"\x01\x02") -> bytes:
    """Return a CR (0xE0) or CC (0xD0) in a TPKT."""
    variable = bytes((0xC0, 1, size)) + b"\xc1\x02\x01\x00" + b"\xc2" + bytes((len(called),)) + called
    fixed = struct.pack(">BHHB", code, 0 if code == 0xE0 else 7, 7 if code == 0xE0 else 1, 0)
    return tpkt(bytes((len(fixed) + len(variable),)) + fixed + variable)


def disconnect(reason: int = 0) -> bytes:
    """Return a DR in a TPKT."""
    return tpkt(struct.pack(">BBHHB", 6, 0x80, 7, 1, reason))


def pdu(rosctr: int, ref: int, param: bytes, data: bytes = b"", error: int = 0) -> bytes:
    """Return an S7 PDU; ROSCTR 2 and 3 carry ``error`` (class << 8 | code)."""
    head = struct.pack(">BBHHHH", 0x32, rosctr, 0, ref, len(param), len(data))
    if rosctr in {ACK, ACK_DATA}:
        head += struct.pack(">H", error)
    return head + param + data


def setup(rosctr: int, ref: int, amq: int = 1, length: int = 480) -> bytes:
    """Return a Setup communication PDU: a job, or its answer."""
    return pdu(rosctr, ref, struct.pack(">BBHHH", 0xF0, 0, amq, amq, length))


class Item(NamedTuple):
    """A variable as an S7ANY item names it; ``length`` counts elements."""

    size: int = 0x02
    length: int = 1
    db: int = 1
    area: int = 0x84
    address: int = 0

    @property
    def octets(self) -> int:
        """Octets of the content."""
        return SIZES[self.size][0] * self.length

    def build(self) -> bytes:
        """Return the item of a request."""
        fixed = struct.pack(">BBBBHHB", 0x12, 0x0A, 0x10, self.size, self.length, self.db, self.area)
        return fixed + self.address.to_bytes(3, "big")

    def data(self, content: bytes, code: int = 0xFF) -> bytes:
        """Return the data item that carries ``content``; with another ``code`` than success it carries nothing."""
        if code not in {0xFF, 0x00}:
            return bytes((code, 0, 0, 0))
        _, transport, in_bits = SIZES[self.size]
        length = self.length if self.size == 0x01 else len(content) * 8 if in_bits else len(content)
        return struct.pack(">BBH", code, transport, length) + content


def _joined(pieces: Sequence[bytes]) -> bytes:
    """Return data items with the fill octet after each odd one but the last."""
    padded = [piece + b"\x00" * (len(piece) & 1) for piece in pieces[:-1]]
    return b"".join([*padded, *pieces[-1:]])


def read_job(ref: int, items: Sequence[Item]) -> bytes:
    """Return a Read Var job."""
    return pdu(JOB, ref, bytes((READ, len(items))) + b"".join([item.build() for item in items]))


def read_answer(ref: int, items: Sequence[Item], contents: Sequence[bytes | int]) -> bytes:
    """Return the answer to a Read Var: for each item its content, or the return code that refuses it."""
    pieces = [
        item.data(b"", content) if isinstance(content, int) else item.data(content)
        for item, content in zip(items, contents, strict=True)
    ]
    return pdu(ACK_DATA, ref, bytes((READ, len(items))), _joined(pieces))


def write_job(ref: int, items: Sequence[Item], contents: Sequence[bytes]) -> bytes:
    """Return a Write Var job."""
    param = bytes((WRITE, len(items))) + b"".join([item.build() for item in items])
    data = _joined([item.data(content, 0) for item, content in zip(items, contents, strict=True)])
    return pdu(JOB, ref, param, data)


def write_answer(ref: int, codes: Sequence[int]) -> bytes:
    """Return the answer to a Write Var: a return code for each item."""
    return pdu(ACK_DATA, ref, bytes((WRITE, len(codes))), bytes(codes))


def userdata(ref: int, kind: int, group: int, subfunction: int, payload: bytes = b"", error: int = 0) -> bytes:
    """Return a userdata PDU; ``kind`` 0 is a push, 1 a request (short head), 2 an answer."""
    head = bytes((kind << 6 | group, subfunction, 0))
    if kind == 1:
        param = b"\x00\x01\x12\x04\x11" + head
    else:
        param = b"\x00\x01\x12\x08\x12" + head + b"\x00\x00" + struct.pack(">H", error)
    content = struct.pack(">BBH", 0xFF if payload else 0x0A, 0x09 if payload else 0, len(payload)) + payload
    return pdu(USERDATA, ref, param, content)


def random_items(rng: Random, most: int = 4) -> list[Item]:
    """Return variables of every kind whose answer size is certain."""
    items = []
    for _ in range(rng.randint(1, most)):
        size = rng.choice(tuple(SIZES))
        area = size if size >= 0x1C else rng.choice((0x81, 0x82, 0x83, 0x84))
        length = 1 if size == 0x01 else rng.randint(1, 5)
        address = rng.randrange(256) if size >= 0x1C else rng.randrange(500) * 8
        if size == 0x01:
            address += rng.randrange(8)
        items.append(Item(size, length, rng.randrange(1, 300) if area == 0x84 else 0, area, address))
    return items
