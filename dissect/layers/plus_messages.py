"""Messages of S7comm-plus put together: from frames and to frames, from values and objects, and answers to requests."""

from __future__ import annotations

from typing import Any, Final

from scapy.packet import Packet, Raw

from dissect.layers.part_classes import (
    S7Plus_Fill,
    S7Plus_IntegrityId,
    S7Plus_ObjectId,
    S7Plus_Piece,
    S7Plus_ReturnValue,
)
from dissect.layers.parts import pieces_of
from dissect.layers.s7plus import S7Plus, S7Plus_Body, S7Plus_Request, S7Plus_Response, body_class
from dissect.protocols.s7plus import layouts, tables
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.message import DIGEST_SIZE, fixed_part, parse_plus
from dissect.protocols.s7plus.objects import Element, build_elements, read_elements
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.values import Value, build_value
from dissect.protocols.s7plus.walk import FormatError, Walk
from dissect.wire.part import Part

#: Octets of a message that go into one frame, the size that the captured CPUs use.
MOST: Final = 900


def plus_parts(*things: Value | Element) -> list[Packet]:
    """Return the parts of values and of objects, attributes, relations and lists.

    See `dissect.protocols.s7plus.values`, ``.objects``.

    Raises ValueError or TypeError for contents that do not fit their type, and ValueError for more than 40 levels.
    """
    packets: list[Packet] = []
    for thing in things:
        octets = build_value(thing) if isinstance(thing, Value) else build_elements([thing])
        walk = Walk(octets, 0, len(octets), True)
        try:
            if isinstance(thing, Value):
                read_value(walk, layouts.VALUE, 0)
            else:
                read_elements(walk)
        except FormatError as error:
            message = f"{error.field} does not fit at byte {error.at}: give fewer levels, or names of fewer bytes"
            raise ValueError(message) from None
        packets += _packets(walk.parts, octets)
    return packets


def _packets(parts: list[Part], octets: bytes) -> list[Packet]:
    return [cls(piece) for cls, piece in pieces_of(parts, octets)]


def plus_message(*frames: Packet | bytes) -> S7Plus_Body:
    """Return the message in several frames, with their data joined: an `S7Plus_Request`, for example, with its parts.

    Raises ValueError if they are not exactly the frames of one message.
    """
    pdu = parse_plus(b"".join([bytes(frame) for frame in frames]))
    layout = fixed_part(pdu)
    cls = body_class(pdu.version, pdu.opcode)
    if not pdu.whole or layout is None or cls is None or len(pdu.data) < layout.size:
        why = str(pdu.malformed[0]) if pdu.malformed else f"a {pdu.kind} is none"
        message = f"no whole S7comm-plus message ({why}): give all its frames in order, the last one with its trailer"
        raise ValueError(message)
    made = cls(pdu.data[: layout.size])
    if pdu.version == tables.SYSTEM_EVENT:
        made.message = pdu.message
    else:
        made.body = _packets(parse_contents(pdu).parts, pdu.data)
    return made


def plus_frames(
    message: S7Plus_Body, version: int = tables.V2, most: int = MOST, digests: list[bytes] | None = None
) -> list[S7Plus]:
    """Return the frames of a message, each with up to ``most`` octets of it, the last one with the trailer.

    Each `S7Plus_Piece` of a stream gets a separate frame, as the protocol requires, whatever its size. ``digests`` are those of
    the frames in version 3, zeros by default: they need the session's key.
    """
    cuts = _cuts(message, most)
    frames = []
    for number, octets in enumerate(cuts):
        last = number == len(cuts) - 1
        frame = S7Plus(version=version, content=[message.copy() if len(cuts) == 1 else Raw(octets)])
        if not last:
            frame.trailer = b""
        if version == tables.V3:
            known = digests[number] if digests is not None and number < len(digests) else bytes(DIGEST_SIZE)
            frame.digest = known
        frames.append(frame)
    return frames


def _cuts(message: S7Plus_Body, most: int) -> list[bytes]:
    octets = bytes(message)
    body: list[Any] = message.getfieldval("body") if "body" in message.default_fields else []
    pieces = [number for number, part in enumerate(body) if isinstance(part, S7Plus_Piece)]
    if not pieces:
        return [octets[at : at + most] for at in range(0, len(octets), most)]
    sizes = [len(bytes(part)) for part in body[pieces[0] :]]
    starts = [len(octets) - sum(sizes[number - pieces[0] :]) for number in pieces]
    return [octets[at:end] for at, end in zip([0, *starts], [*starts, len(octets)], strict=True)]


def plus_reply(request: S7Plus, *body: Packet, return_value: int = 0) -> S7Plus:
    """Return the response to a request: its version, function and sequence number, and the integrity id that follows from both.

    ``body`` are the parts between return value and end. Raises TypeError for anything but a request.
    """
    asked = request.body
    if not isinstance(asked, S7Plus_Request):
        message = "only a request is answered: give an S7Plus with an S7Plus_Request"
        raise TypeError(message)
    parts: list[Packet] = [S7Plus_ReturnValue(return_value=return_value), *body]
    known = [part for part in asked.body if isinstance(part, S7Plus_IntegrityId)]
    if known:
        id_ = S7Plus_IntegrityId(integrity_id=(known[0].integrity_id + asked.sequence) & 0xFFFFFFFF)
        # The answer to Explore has the id after that of the object, every other answer at its end.
        early = asked.function == tables.EXPLORE and request.version == tables.V3
        at = next((number + 1 for number, part in enumerate(parts) if isinstance(part, S7Plus_ObjectId)), len(parts))
        parts.insert(at if early else len(parts), id_)
    answer = S7Plus_Response(function=asked.function, sequence=asked.sequence, body=[*parts, S7Plus_Fill()])
    frame = S7Plus(version=request.version, content=[answer])
    if request.version == tables.V3:
        frame.digest = bytes(DIGEST_SIZE)
    return frame
