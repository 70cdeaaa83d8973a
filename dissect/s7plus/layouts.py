"""The fixed parts of S7comm-plus as layouts (reference section 1.4, docs/s7plus.md).

tshark has no dissector for this protocol, so the fields have no Wireshark names.
"""

from __future__ import annotations

from typing import Final

from dissect.s7plus.tables import FUNCTIONS, OPCODES, VERSIONS
from dissect.wire.layout import Field, Layout

_SOURCE: Final = "docs/s7plus.md"

_BEGINNING: Final = [
    Field("protocol_id", 1, "Always 0x72."),
    Field("version", 1, "Version, or kind of a PDU without opcode.", codes=VERSIONS),
]

#: Header of every frame but the keep-alive; with length 0 it is the trailer that ends a PDU.
HEADER: Final = Layout(
    "S7comm-plus header", "reference section 1.4", [*_BEGINNING, Field("length", 2, "Octets after the header.")]
)

#: The keep-alive, which is nothing but a header.
KEEP_ALIVE: Final = Layout(
    "S7comm-plus keep-alive",
    _SOURCE,
    [*_BEGINNING, Field("number", 1, "Counts keep-alives."), Field("reserved", 1, "0.")],
)

#: Before the data of every V3 frame; as many octets of a digest as it says follow.
INTEGRITY: Final = Layout(
    "S7comm-plus integrity part", "reference section 1.4", [Field("digest_length", 1, "Octets of the digest, 32.")]
)

_HEAD: Final = [
    Field("opcode", 1, "Request or response.", codes=OPCODES),
    Field("reserved_1", 2, "0."),
    Field("function", 2, "What is asked for.", codes=FUNCTIONS),
    Field("reserved_2", 2, "0."),
    Field("sequence", 2, "Sequence number, echoed by the response."),
]

REQUEST: Final = Layout(
    "S7comm-plus request",
    _SOURCE,
    [
        *_HEAD,
        Field("session_id", 4, "The session, as CreateObject answered it; responses have none."),
        Field("transport_flags", 1, "Bit 6: no response is wanted."),
    ],
)

RESPONSE: Final = Layout(
    "S7comm-plus response", _SOURCE, [*_HEAD, Field("transport_flags", 1, "Flags, 0x34 or 0x36 in captures.")]
)

#: Notifications of V2 and V3; a sequence number of variable size follows.
NOTIFICATION: Final = Layout(
    "S7comm-plus notification",
    _SOURCE,
    [
        Field("opcode", 1, "0x33.", codes=OPCODES),
        Field("subscription_id", 4, "The subscription that tells it."),
        Field("unknown_1", 2, "0x0400 in captures."),
        Field("unknown_2", 2, "0 in captures."),
        Field("unknown_3", 2, "0 in captures."),
        Field("credit_tick", 1, "Counts against the credit that the client granted."),
    ],
)

EVENT: Final = Layout(
    "S7comm-plus system event",
    _SOURCE,
    [
        Field("reserved_1", 4, "0."),
        Field("confirmed_octets", 4, "Octets received until now."),
        Field("reserved_2", 4, "0."),
        Field("reserved_3", 4, "0."),
    ],
)
