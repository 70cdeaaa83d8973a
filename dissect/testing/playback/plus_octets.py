"""Changes numbers in PDUs of S7comm-plus, for both the server's and the client's side."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.layouts import INTEGRITY_ID
from dissect.protocols.s7plus.message import HEADER_SIZE, parse_plus
from dissect.wire.octets import u16
from dissect.wire.varint import VLQ, build_varint

#: The beginning of a plain request, before its version.
PROTOCOL_ID: Final = 0x72
_SEQUENCE: Final = 7  # its position in the data
_LENGTH: Final = 2  # and the position of a frame's length in its header


def frames_of(octets: bytes) -> list[bytes]:
    """Return the TSDUs of a PDU: its frames, the last one with the trailer."""
    starts = [at for at, _, _ in parse_plus(octets).frame_places] or [0]
    return [octets[begin:end] for begin, end in zip(starts, [*starts[1:], len(octets)], strict=True)]


def with_data(octets: bytes, at: int, new: bytes) -> bytes:
    """Return a PDU with octets replaced at a position of its data, across frames; unchanged if it is too short."""
    pdu = parse_plus(octets)
    if len(pdu.data) < at + len(new):
        return octets
    made = bytearray(octets)
    for offset, octet in enumerate(new, at):
        made[pdu.place(offset)] = octet
    return bytes(made)


def with_sequence(octets: bytes, sequence: int) -> bytes:
    """Return a PDU with a different sequence number."""
    return with_data(octets, _SEQUENCE, (sequence & 0xFFFF).to_bytes(2, "big"))


def with_integrity(octets: bytes, number: int) -> bytes:
    """Return a PDU with a different integrity id, if it has one."""
    pdu = parse_plus(octets)
    places = [part for part in parse_contents(pdu).parts if part.layout is INTEGRITY_ID]
    if not places:
        return octets
    begin, end = pdu.place(places[-1].offset), pdu.place(places[-1].end - 1) + 1
    frame = [at for at, data, _ in pdu.frame_places if data <= begin][-1]
    id_ = build_varint(number & 0xFFFFFFFF, VLQ)
    length = int(u16(octets, frame + _LENGTH) + len(id_) - (end - begin))
    head = octets[: frame + _LENGTH] + length.to_bytes(2, "big") + octets[frame + HEADER_SIZE : begin]
    return head + id_ + octets[end:]
