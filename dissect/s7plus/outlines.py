"""What CreateObject and Explore say of objects: their ids and classes, and the few attributes that somebody asks for.

In one pass the contents are found sound, and the places of what matters are noted; values are read when they are asked for.
Everything else is left to `dissect.s7plus.bodies`. That both agree is a property test (tests/s7plus/test_outlines.py).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.contents import Made
from dissect.s7plus.message import parsed
from dissect.s7plus.objects import objects_at
from dissect.s7plus.plain import REQUEST_SIZE, RESPONSE_SIZE, one_frame
from dissect.s7plus.skimming import FILL, SOUND, Body, free_body
from dissect.s7plus.tables import REQUEST, RESPONSE
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ64, read_varint

_SEQUENCE: Final = 7
_SESSION_ID: Final = 9


class Outline(Made):
    """A sound request or response with objects, of which only the attributes are there that were asked for.

    Numbers that it does not have are -1.
    """

    __slots__ = ("integrity_id", "return_code", "sequence", "session_id")

    def __init__(self) -> None:
        super().__init__()
        self.integrity_id: int = -1
        self.session_id: int = -1
        self.sequence: int = -1
        self.return_code: int = -1


def outline(octets: bytes, request: bool, function: i64, marks: bytes) -> Outline | None:
    """Pass over a request of a function, or a response. None when it must be read, or is another PDU. Never raises.

    ``marks`` is made by `dissect.s7plus.skipping.marks`.
    """
    data = octets
    at, end = one_frame(octets)
    version: i64 = octets[1] if at >= 0 else 0
    if at < 0:
        pdu = parsed(octets)
        if not pdu.whole or pdu.malformed:
            return None
        data = pdu.data
        at = 0
        end = len(data)
        version = pdu.version
    size: i64 = REQUEST_SIZE if request else RESPONSE_SIZE
    opcode: i64 = REQUEST if request else RESPONSE
    if end - at < size or data[at] != opcode or u16(data, at + 3) != function:
        return None
    noted: list[int] = []
    body = free_body()
    body.begin(data, at + size, end, version, marks)
    body.skipper.noted = noted
    sound: bool = _passes(body, request, function)
    found = Outline()
    found.integrity_id = int(body.integrity_id)
    found.ids = body.ids
    if request:
        found.object_id = int(body.object_id)
        found.session_id = u32(data, at + _SESSION_ID)
    else:
        found.return_code = read_varint(data, at + size, end, VLQ64)[0] & 0xFFFF  # of what is sound
    found.sequence = u16(data, at + _SEQUENCE)
    if body.result(sound, -1) & SOUND == 0:
        return None
    found.objects = objects_at(data, noted, end)
    return found


def _passes(body: Body, request: bool, function: i64) -> bool:
    if request:
        return body.request(function) and body.ends(FILL)
    return body.skipper.wide() and body.response(function, False) and body.ends(FILL)
