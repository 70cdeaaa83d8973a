"""S7comm-plus as Scapy layers: a frame, its message, and the parts of that (docs/s7plus.md).

``S7Plus(content=[S7Plus_Request(function="GetMultiVariables", sequence=5, session_id=0x386, body=…)])`` builds a whole PDU of
one frame: lengths and trailer are filled in. A frame that the next TSDU continues has ``trailer=b""``; a continuation has a
`Raw` as content; `plus_message` and `plus_frames` join and cut them. After the fixed part comes a list of parts, in ``body``:
those of `dissect.layers.plus_tables`, separated by the engine's own parser, or octets.
"""

from __future__ import annotations

from typing import Any, Final

from scapy.fields import ConditionalField
from scapy.packet import Packet, Raw

from dissect.layers.fields import (
    OctetsField,
    Piece,
    PiecesField,
    ScapyField,
    WireLayer,
    consumed,
    fill_number,
    header_fields,
)
from dissect.layers.parts import CLASSES, PartsField, pieces_of
from dissect.protocols.iso.upper import S7COMM_PLUS, classify
from dissect.protocols.s7plus import layouts, tables
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.message import parse_plus
from dissect.wire.layout import Layout
from dissect.wire.part import OCTETS

_HEADER: Final = layouts.HEADER.size


def is_s7plus(octets: bytes) -> bool:
    """Return whether a TSDU is S7comm-plus."""
    return classify(octets, 0, len(octets)) == S7COMM_PLUS


def _carve_body(pkt: Packet, rest: bytes) -> list[Piece]:
    """Return the parts of a message that is completely in one frame; for any other its octets."""
    frame = pkt.parent
    if isinstance(frame, S7Plus) and rest:
        pdu = parse_plus(frame.original)
        contents = parse_contents(pdu)
        if pdu.whole and pdu.frames == 1 and sum([part.end - part.offset for part in contents.parts]) == len(rest):
            return pieces_of(contents.parts, pdu.data)
    return [(CLASSES[OCTETS], rest)] if rest else []


class S7Plus_Body(WireLayer):
    """The content of a frame: the fixed part by its layout, ``body`` for the parts after it."""

    name = "S7comm-plus body"
    show_summary = False

    def line(self) -> str:
        """Return a description of it."""
        return ""


def _fields(layout: Layout, **defaults: int) -> list[ScapyField]:
    return [*header_fields(layout, defaults), PartsField("body", _carve_body)]


class S7Plus_Request(S7Plus_Body):
    """A request; with bit 6 of ``transport_flags`` it expects no response."""

    name = "S7comm-plus request"
    least = layouts.REQUEST.size
    fields_desc = _fields(
        layouts.REQUEST, opcode=tables.REQUEST, function=tables.GET_MULTI_VARIABLES, transport_flags=0x34
    )

    def line(self) -> str:
        """Return function, sequence number and session."""
        no = " no-response" if self.transport_flags & tables.NO_RESPONSE else ""
        name = tables.FUNCTIONS.name(self.function)
        return f"Request {name} seq={self.sequence} session=0x{self.session_id:08x}{no}"


class S7Plus_Response(S7Plus_Body):
    """A response; ``body`` begins with the return value."""

    name = "S7comm-plus response"
    least = layouts.RESPONSE.size
    fields_desc = _fields(
        layouts.RESPONSE, opcode=tables.RESPONSE, function=tables.GET_MULTI_VARIABLES, transport_flags=0x34
    )

    def line(self) -> str:
        """Return function and sequence number."""
        return f"{tables.OPCODES.name(self.opcode)} {tables.FUNCTIONS.name(self.function)} seq={self.sequence}"


class S7Plus_Notification(S7Plus_Body):
    """A notification of V2 or V3; ``body`` begins with its number."""

    name = "S7comm-plus notification"
    least = layouts.NOTIFICATION.size
    fields_desc = _fields(layouts.NOTIFICATION, opcode=tables.NOTIFICATION, unknown_1=0x0400)

    def line(self) -> str:
        """Return the subscription."""
        return f"Notification subscription=0x{self.subscription_id:08x}"


class S7Plus_NotificationV1(S7Plus_Body):
    """A notification of V1, whose form one source describes."""

    name = "S7comm-plus notification"
    least = layouts.NOTIFICATION_V1.size
    fields_desc = _fields(layouts.NOTIFICATION_V1, opcode=tables.NOTIFICATION)

    def line(self) -> str:
        """Return a description of it."""
        return "Notification"


class S7Plus_Event(S7Plus_Body):
    """A system event; ``message`` is its text, often empty."""

    name = "S7comm-plus system event"
    least = layouts.EVENT.size
    fields_desc = [*header_fields(layouts.EVENT), OctetsField("message", lambda _, s: len(s))]

    def line(self) -> str:
        """Return the octets that it confirms."""
        return f"system event confirmed={self.confirmed_octets}"


_BODIES: Final[dict[int, type[S7Plus_Body]]] = {
    tables.REQUEST: S7Plus_Request,
    tables.RESPONSE: S7Plus_Response,
    tables.RESPONSE2: S7Plus_Response,
    tables.NOTIFICATION: S7Plus_Notification,
}


def body_class(version: int, opcode: int) -> type[S7Plus_Body] | None:
    """Return the class of the content of a frame, None if it is unknown."""
    if version == tables.SYSTEM_EVENT:
        return S7Plus_Event
    if version == tables.V1 and opcode == tables.NOTIFICATION:
        return S7Plus_NotificationV1
    return _BODIES.get(opcode)


def _carve(pkt: Packet, rest: bytes) -> list[Piece]:
    """Return the content of a frame as one piece, none if it is empty."""
    octets = rest[: max(0, _frame_end(pkt) - consumed(pkt, rest))]
    if not octets:
        return []
    body = body_class(pkt.version, octets[0])
    return [(body if body is not None and len(octets) >= body.least else Raw, octets)]


def _frame_end(pkt: Packet) -> int:
    return _HEADER + int(pkt.length)


def _has_digest(pkt: Packet) -> bool:
    return bool(pkt.version == tables.V3 and pkt.length != 0)


class _TrailerField(OctetsField):
    """The trailer of a frame. None, the default, is the usual trailer; a system event has none."""

    def __init__(self) -> None:
        super().__init__("trailer", lambda _, s: len(s))
        self.default = None

    def i2m(self, pkt: Packet | None, x: Any) -> bytes:
        """Return the octets to build (Scapy's interface)."""
        if x is not None:
            return bytes(x)
        if pkt is None or pkt.version == tables.SYSTEM_EVENT:
            return b""
        return bytes((tables.PROTOCOL_ID, pkt.version, 0, 0))


class S7Plus(WireLayer):
    """One frame: header, in V3 the digest, ``content`` (a list of one layer), and the ``trailer`` that ends a PDU.

    ``length`` and ``digest_length`` are filled in when left out; the digest itself is not computed, it needs the session's key.
    """

    name = "S7comm-plus"
    least = layouts.HEADER.size
    fields_desc = [
        *header_fields(layouts.HEADER, {"protocol_id": tables.PROTOCOL_ID, "version": tables.V2, "length": None}),
        *(ConditionalField(field, _has_digest) for field in header_fields(layouts.INTEGRITY, {"digest_length": None})),
        ConditionalField(
            OctetsField("digest", lambda pkt, s: min(pkt.digest_length, _frame_end(pkt) - consumed(pkt, s))),
            _has_digest,
        ),
        PiecesField("content", _carve),
        _TrailerField(),
    ]

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> Any:
        """Return the class for the octets: the keep-alive has its own; an incomplete header stays Raw."""
        if not _pkt:
            return cls
        if len(_pkt) < cls.least or (_pkt[1] == tables.V3 and len(_pkt) == _HEADER and any(_pkt[2:4])):
            return Raw
        return S7Plus_KeepAlive if _pkt[1] == tables.KEEP_ALIVE and cls is S7Plus else cls

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the two lengths (Scapy's interface)."""
        field, trailer = self.getfield_and_val("trailer")
        size = len(pkt) - _HEADER - len(field.addfield(self, b"", trailer))
        if _has_digest(self) and self.getfieldval("digest_length") is None:
            pkt = fill_number(pkt, _HEADER, 1, len(self.digest), "the size of the S7comm-plus digest")
        if self.getfieldval("length") is None:
            pkt = fill_number(pkt, 2, 2, size, "the S7comm-plus length")
        return pkt + pay

    @property
    def body(self) -> Packet | None:
        """The content of the frame, None if it is empty."""
        return self.content[0] if self.content else None

    def hashret(self) -> bytes:
        """Return the sequence number, which request and response have in common (Scapy's interface)."""
        body = self.body
        if isinstance(body, S7Plus_Request | S7Plus_Response):
            return b"P" + int(body.sequence).to_bytes(2, "big")
        return b"P"

    def answers(self, other: Packet) -> int:
        """Return whether this is the response to the request ``other`` (Scapy's interface)."""
        mine, theirs = self.body, other.body if isinstance(other, S7Plus) else None
        if not isinstance(mine, S7Plus_Response) or not isinstance(theirs, S7Plus_Request):
            return 0
        same = mine.function == theirs.function or mine.function in tables.ERRORS
        return int(same and mine.sequence == theirs.sequence)

    def line(self) -> str:
        """Return one line."""
        body = self.body
        text = body.line() if isinstance(body, S7Plus_Body) else "fragment"
        goes_on = " goes on" if self.getfieldval("trailer") == b"" and self.version != tables.SYSTEM_EVENT else ""
        version = "" if self.version == tables.SYSTEM_EVENT else f"{tables.VERSIONS.name(self.version)} "
        return f"S7comm-plus {version}{text}{goes_on}"


class S7Plus_KeepAlive(WireLayer):
    """The keep-alive: nothing but a header with a number."""

    name = "S7comm-plus keep-alive"
    least = layouts.KEEP_ALIVE.size
    fields_desc = header_fields(layouts.KEEP_ALIVE, {"protocol_id": tables.PROTOCOL_ID, "version": tables.KEEP_ALIVE})

    def line(self) -> str:
        """Return one line."""
        return f"S7comm-plus keep-alive {self.number}"
