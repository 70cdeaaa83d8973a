"""Answers in which a station identifies itself, octet by octet (reference sections 4.5, 4.6 and 4.12), and the requests."""

from __future__ import annotations

import struct

from tests.engine.transactions.talk import Talk, head, userdata


def answered(talk: Talk, ref: int, group: int, subfunction: int, asked: bytes, told: bytes) -> int:
    """A userdata request and its answer; return the number of the packet with the answer."""
    talk.ask(userdata(ref, head(1, group, subfunction), _data(asked)))
    return talk.tell(userdata(ref, head(2, group, subfunction, 0, 0), _data(told)))


def _data(content: bytes) -> bytes:
    return (b"\xff\x09" if content else b"\x0a\x00") + struct.pack(">H", len(content)) + content


def szl(talk: Talk, ref: int, content: bytes) -> int:
    """A list is read."""
    return answered(talk, ref, 4, 1, content[:4], content)


def listed(szl_id: int, index: int, *records: bytes) -> bytes:
    return struct.pack(">HHHH", szl_id, index, len(records[0]), len(records)) + b"".join(records)


def identification(order: str, firmware: tuple[int, int, int], hardware: int = 1) -> bytes:
    """List 0x0011: the module, its hardware and its firmware."""
    name = order.encode("latin-1").ljust(20)
    major, minor, patch = firmware
    return listed(
        0x0011,
        0,
        struct.pack(">H20sHHH", 1, name, 0xC0, hardware, 1),
        struct.pack(">H20sHHH", 6, name, 0xC0, hardware, 1),
        struct.pack(">H20sHHH", 7, bytes(20), 0xC0, ord("V") << 8 | major, minor << 8 | patch),
    )


def components(serial: str = "", station: str = "", module: str = "", plant: str = "") -> bytes:
    """List 0x001C: names and serial number; only those that are given."""
    texts = {1: station, 2: module, 3: plant, 5: serial}
    records = [struct.pack(">H32s", index, text.encode("latin-1")) for index, text in texts.items() if text]
    return listed(0x001C, 0, *records)


def mode(code: int) -> bytes:
    """List 0x0424: the operating mode."""
    return listed(0x0424, 0, struct.pack(">HBB", 0x5144, 0xFF, code) + bytes(16))


def protection(level: int, switch: int = 2) -> bytes:
    """List 0x0232, index 4."""
    return listed(0x0232, 4, struct.pack(">HHHHH", 4, 0, level, level, switch) + bytes(30))


def capability(pdu_length: int, connections: int) -> bytes:
    """List 0x0131, index 1."""
    return listed(0x0131, 1, struct.pack(">HHH", 1, pdu_length, connections) + bytes(34))
