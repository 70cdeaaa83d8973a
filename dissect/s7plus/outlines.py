"""Reads what CreateObject and Explore say about objects: ids, classes, and the few attributes that are needed.

One pass checks that the contents are sound and notes the places of what matters; for a response, that is the pass that pairing
made already. Values are read when they are needed. PDUs that are not sound are left to `dissect.s7plus.bodies`. A property test
ensures that both agree (tests/s7plus/test_outlines.py).
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.s7plus.contents import Made
from dissect.s7plus.ending import FILL
from dissect.s7plus.message import parsed
from dissect.s7plus.noted import Noted, latest_noted
from dissect.s7plus.objects import PlusObject, objects_at
from dissect.s7plus.plain import REQUEST_SIZE, RESPONSE_SIZE, SEQUENCE_AT, SESSION_AT, one_frame
from dissect.s7plus.skimming import SOUND, Body, free_body
from dissect.s7plus.tables import REQUEST, RESPONSE
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ64, read_varint


class Outline(Made):
    """A sound request or response with objects; it has only the attributes that are needed.

    Numbers that it does not have are -1.
    """

    __slots__ = ("_every", "integrity_id", "return_code", "sequence", "session_id")

    def __init__(self, objects: list[PlusObject], every: list[PlusObject]) -> None:
        """``objects`` are those that are not inside another one; ``every`` are these and all objects inside them."""
        super().__init__()
        self.objects = objects
        self._every = every
        self.integrity_id: i64 = -1
        self.session_id: i64 = -1
        self.sequence: i64 = -1
        self.return_code: i64 = -1

    @property
    def every(self) -> list[PlusObject]:
        """The objects and all objects inside them, each before those inside it."""
        return self._every


def outline(octets: bytes, request: bool, function: i64, marks: bytes) -> Outline | None:
    """Return the outline of a request or response of ``function``; None if it must be read or is another PDU. Never raises.

    ``marks`` is made by `dissect.s7plus.skipping.marks`.
    """
    noted: Noted | None = None
    if not request:
        noted = latest_noted(octets, marks)
    if noted is None:
        noted = _note(octets, request, function, marks)
    if noted is None:
        return None
    data = noted.data
    at: i64 = noted.at
    if u16(data, at + 3) != function:
        return None
    objects, every = objects_at(data, noted.places, noted.end)
    found = Outline(objects, every)
    found.integrity_id = noted.integrity_id
    found.ids = noted.ids
    if request:
        found.object_id = int(noted.object_id)
        found.session_id = u32(data, at + SESSION_AT)
    else:
        found.return_code = read_varint(data, at + RESPONSE_SIZE, noted.end, VLQ64)[0] & 0xFFFF  # sound
    found.sequence = u16(data, at + SEQUENCE_AT)
    return found


def _note(octets: bytes, request: bool, function: i64, marks: bytes) -> Noted | None:
    """Skim a request or response of a function, noting the places of its objects; None if it is not sound."""
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
    noted = Noted(octets, data, at, end, marks)
    body = free_body()
    body.begin(data, at + size, end, version, marks)
    body.skipper.noted = noted.places
    sound: bool = _passes(body, request, function)
    body.tell(noted)
    return noted if body.result(sound, -1) & SOUND else None


def _passes(body: Body, request: bool, function: i64) -> bool:
    return (request or body.skipper.wide()) and body.body(function, request) and body.ends(FILL)
