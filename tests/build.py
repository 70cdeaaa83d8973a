"""TPKTs, TPDUs and S7 PDUs, octet by octet, as building blocks for the messages of tests.

Nothing here comes from the package, so that its readers and builders are compared with something independent. A test that needs
a wrong message builds it itself.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

JOB: Final = 1
ACK: Final = 2
ACK_DATA: Final = 3
USERDATA: Final = 7

READ: Final = 0x04
WRITE: Final = 0x05
SETUP: Final = 0xF0

#: Userdata without a payload, and with one.
_EMPTY: Final = b"\x0a\x00\x00\x00"
#: Transport sizes of data items whose length counts bits.
_BIT: Final = 3
_IN_BITS: Final = frozenset((_BIT, 4, 5))


def tpkt(tpdu: bytes, reserved: int = 0) -> bytes:
    """Return a TPDU in its TPKT."""
    return struct.pack(">BBH", 3, reserved, len(tpdu) + 4) + tpdu


def tpdu(head: bytes, variable: bytes = b"", data: bytes = b"") -> bytes:
    """Return a TPKT with a TPDU: its fixed part without the length indicator, its variable part, user data."""
    return tpkt(bytes((len(head) + len(variable),)) + head + variable + data)


def dt(data: bytes, *, eot: bool = True, number: int = 0) -> bytes:
    """Return user data in a DT of class 0 in a TPKT."""
    return tpdu(bytes((0xF0, eot << 7 | number)), data=data)


def pdu(
    rosctr: int, reference: int, parameters: bytes, data: bytes = b"", error: int = 0, redundancy: int = 0
) -> bytes:
    """Return an S7 PDU; ROSCTR 2 and 3 carry ``error`` (class << 8 | code)."""
    head = struct.pack(">BBHHHH", 0x32, rosctr, redundancy, reference, len(parameters), len(data))
    return head + (struct.pack(">H", error) if rosctr in {ACK, ACK_DATA} else b"") + parameters + data


def setup_block(calling: int = 1, called: int = 1, length: int = 480) -> bytes:
    """Return the parameters of a Setup communication."""
    return struct.pack(">BBHHH", SETUP, 0, calling, called, length)


def any_item(size: int, count: int, db: int, area: int, address: int) -> bytes:
    """Return an S7ANY item: ``count`` elements of transport size ``size`` at ``address``, in bits."""
    return struct.pack(">BBBBHHB", 0x12, 10, 0x10, size, count, db, area) + address.to_bytes(3, "big")


def data_item(code: int, size: int, content: bytes, length: int | None = None) -> bytes:
    """Return a data item of transport size ``size``; ``length`` counts units of that size: one bit, or the whole content."""
    if length is None:
        length = 1 if size == _BIT else len(content) * 8 if size in _IN_BITS else len(content)
    return struct.pack(">BBH", code, size, length) + content


def refused_item(code: int) -> bytes:
    """Return the data item of a read that was refused: four octets."""
    return bytes((code, 0, 0, 0))


def joined(items: Sequence[bytes]) -> bytes:
    """Return items with the fill octet after each odd one but the last."""
    return b"".join([*[item + b"\x00" * (len(item) & 1) for item in items[:-1]], *items[-1:]])


def userdata_head(
    kind: int, group: int, subfunction: int, sequence: int = 0, unit: int | None = None, last: int = 0, error: int = 0
) -> bytes:
    """Return the parameters of userdata: ``kind`` 0 a push, 1 a request, 2 an answer; extended where ``unit`` is given."""
    end = bytes((kind << 6 | group, subfunction, sequence))
    if unit is None:
        return b"\x00\x01\x12\x04\x11" + end
    return b"\x00\x01\x12\x08\x12" + end + struct.pack(">BBH", unit, last, error)


def payload(content: bytes, code: int = 0xFF) -> bytes:
    """Return the data of userdata around its payload; without octets it states that there are none."""
    return data_item(code, 9, content) if content else _EMPTY
