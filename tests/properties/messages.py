"""TPKTs, TPDUs and S7 PDUs built octet by octet for the property tests. Independent of the package."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import pairwise
from random import Random
from typing import Final, NamedTuple

from tests.build import (
    ACK,
    ACK_DATA,
    JOB,
    READ,
    USERDATA,
    WRITE,
    any_item,
    data_item,
    dt,
    joined,
    pdu,
    refused_item,
    setup_block,
    tpkt,
    userdata_head,
)
from tests.build import payload as payload_of

#: Octets of an element and the transport size of its answer, by the request's transport size.
SIZES: Final = {
    0x01: (1, 0x03),
    0x02: (1, 0x04),
    0x03: (1, 0x09),
    0x04: (2, 0x04),
    0x05: (2, 0x05),
    0x06: (4, 0x04),
    0x07: (4, 0x05),
    0x08: (4, 0x07),
    0x1C: (2, 0x09),
    0x1D: (2, 0x09),
}


#: The acknowledgement of an answer by Siemens stacks (reference 2.5).
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


def setup(rosctr: int, ref: int, amq: int = 1, length: int = 480) -> bytes:
    """Return a Setup communication PDU: a job, or its answer."""
    return pdu(rosctr, ref, setup_block(amq, amq, length))


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
        return any_item(self.size, self.length, self.db, self.area, self.address)

    def data(self, content: bytes, code: int = 0xFF) -> bytes:
        """Return the data item with ``content``; with a ``code`` other than success it is empty."""
        if code not in {0xFF, 0x00}:
            return refused_item(code)
        return data_item(code, SIZES[self.size][1], content, self.length if self.size == 0x01 else None)


def read_job(ref: int, items: Sequence[Item]) -> bytes:
    """Return a Read Var job."""
    return pdu(JOB, ref, bytes((READ, len(items))) + b"".join([item.build() for item in items]))


def read_answer(ref: int, items: Sequence[Item], contents: Sequence[bytes | int]) -> bytes:
    """Return the answer to a Read Var: for each item its content, or the return code of its refusal."""
    pieces = [
        item.data(b"", content) if isinstance(content, int) else item.data(content)
        for item, content in zip(items, contents, strict=True)
    ]
    return pdu(ACK_DATA, ref, bytes((READ, len(items))), joined(pieces))


def write_job(ref: int, items: Sequence[Item], contents: Sequence[bytes]) -> bytes:
    """Return a Write Var job."""
    param = bytes((WRITE, len(items))) + b"".join([item.build() for item in items])
    data = joined([item.data(content, 0) for item, content in zip(items, contents, strict=True)])
    return pdu(JOB, ref, param, data)


def write_answer(ref: int, codes: Sequence[int]) -> bytes:
    """Return the answer to a Write Var: a return code for each item."""
    return pdu(ACK_DATA, ref, bytes((WRITE, len(codes))), bytes(codes))


def userdata(ref: int, kind: int, group: int, subfunction: int, payload: bytes = b"", error: int = 0) -> bytes:
    """Return a userdata PDU; ``kind`` 0 is a push, 1 a request (short head), 2 an answer."""
    head = userdata_head(kind, group, subfunction, 0, None if kind == 1 else 0, error=error)
    return pdu(USERDATA, ref, head, payload_of(payload))


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


__all__ = [
    "ACK",
    "ACK_DATA",
    "EMPTY_DT",
    "JOB",
    "READ",
    "SIZES",
    "USERDATA",
    "WRITE",
    "Item",
    "connect",
    "disconnect",
    "dt",
    "fragments",
    "pdu",
    "random_items",
    "read_answer",
    "read_job",
    "setup",
    "tpkt",
    "userdata",
    "write_answer",
    "write_job",
]
