"""S7comm as Scapy layers: the header, and the code that all bodies share (reference sections 3 and 4).

A body holds the parameter block and the data block: ``S7() / S7_ReadVarRequest(items=[S7_Any(db=10, …)])``. If the
two lengths in the header are left out, they are filled in from the body. Read Var and Write Var are in `variables`, userdata in
`userdata`; every other function is an `S7_Job` or an `S7_Answer`, whose blocks are lists of the parts in `parts` and the
modules it names.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, ClassVar, Final

from scapy.fields import ConditionalField, RawVal
from scapy.packet import Packet, Raw, bind_top_down

from dissect.layers.fields import (
    Leftover,
    OctetsField,
    Piece,
    ScapyField,
    WireLayer,
    consumed,
    fill_number,
    header_fields,
)
from dissect.layers.parts import PartsField, pieces_of
from dissect.protocols.s7 import layouts, tables
from dissect.protocols.s7.bodies import parse_data_parts, parse_parameter_parts
from dissect.protocols.s7.errors import NO_FUNCTION, errors_of
from dissect.protocols.s7.hiding import body_to_show
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import PROTOCOL_ID, Parameters, header_size, parse_parameters
from dissect.wire.layout import Layout
from dissect.wire.text import shortened

_ANSWERS: Final = (tables.ACK, tables.ACK_DATA)
#: Items or notes named in a summary before the rest is only counted, and characters of one note.
_NAMED: Final = 4
NOTE: Final = 80


def is_s7(octets: bytes) -> bool:
    """Return whether a TSDU is S7comm: protocol id 0x32 and a known ROSCTR."""
    return len(octets) >= 2 and octets[0] == PROTOCOL_ID and octets[1] in tables.ROSCTR


class S7(WireLayer):
    """The S7 header; error octets are in ROSCTR 2 and 3 only. ``param_length`` and ``data_length`` are filled in if left out.

    With a `Raw` for a body, all of its octets count as parameters.
    """

    name = "S7"
    __slots__ = ["body_sizes"]
    #: Octets of the parameter block and of the data block that the body was just built with.
    body_sizes: tuple[int, int]
    show_summary = False
    least = layouts.HEADER.size
    fields_desc = [
        *header_fields(
            layouts.HEADER,
            {"protocol_id": PROTOCOL_ID, "rosctr": tables.JOB, "param_length": None, "data_length": None},
        ),
        *(
            ConditionalField(field, lambda pkt: pkt.rosctr in _ANSWERS)
            for field in header_fields(layouts.ACK_HEADER)[len(layouts.HEADER.fields) :]
        ),
    ]

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> Any:
        """Return the class for the octets: an incomplete header stays Raw; ROSCTR determines its size."""
        if not _pkt:
            return cls
        return cls if len(_pkt) >= cls.least and len(_pkt) >= header_size(_pkt[1]) else Raw

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the two lengths (Scapy's interface)."""
        parameters, data = 0, 0
        if isinstance(self.payload, S7_Body):
            parameters, data = self.body_sizes
        elif type(self.payload) is Raw:
            parameters = len(self.payload.load)
        if self.getfieldval("param_length") is None:
            pkt = fill_number(pkt, 6, 2, parameters, "the S7 parameter length")
        if self.getfieldval("data_length") is None:
            pkt = fill_number(pkt, 8, 2, data, "the S7 data length")
        return pkt + pay

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Choose the body by ROSCTR and function (Scapy's interface)."""
        parameters = bytes(payload[: self.param_length])
        if not parameters:
            return S7_Data if self.param_length == 0 and self.data_length else Raw
        body: type[S7_Body] | None
        if self.rosctr == tables.USERDATA:
            body = userdata_body(parameters)
        else:
            body = BODIES.get((self.rosctr in _ANSWERS, parameters[0]))
        if body is not None and len(parameters) >= body.least:
            return body
        return S7_Job if self.rosctr == tables.JOB else S7_Answer if self.rosctr in _ANSWERS else S7_Function

    def hashret(self) -> bytes:
        """Return the bytes that request and answer have in common (Scapy's interface)."""
        kind = b"U" if self.rosctr == tables.USERDATA else b"J"
        return kind + int(self.pdu_ref).to_bytes(2, "big")

    def answers(self, other: Packet) -> int:
        """Return whether this PDU answers ``other``, regardless of which side is the PLC (reference section 5.1)."""
        if not isinstance(other, S7) or self.pdu_ref != other.pdu_ref:
            return 0
        mine, theirs = self.payload, other.payload
        if self.rosctr in _ANSWERS and other.rosctr == tables.JOB:
            asked, answered = function_of(theirs), function_of(mine)
            return int(asked is None or answered is None or asked == answered)
        if self.rosctr == other.rosctr == tables.USERDATA and isinstance(mine, S7_Body):
            return int(mine.responds_to(theirs))
        return 0

    def line(self) -> Any:
        """Return one line for header and body; every S7 of a chain has its own."""
        body = self.payload.describe() if isinstance(self.payload, S7_Body) else ""
        parts = ["S7", tables.ROSCTR.name(self.rosctr), *([body] if body else []), f"ref=0x{self.pdu_ref:04x}"]
        if isinstance(self.payload, S7_Body) and self.payload.detail():
            parts.append(self.payload.detail())
        if self.rosctr in _ANSWERS and (self.error_class or self.error_code):
            function = function_of(self.payload)
            code = self.error_class << 8 | self.error_code
            parts.append(f"error {error_text(code, NO_FUNCTION if function is None else function)}")
        return " ".join(parts), [S7]


def userdata_body(parameters: bytes) -> type[S7_Body] | None:
    """Return the class of userdata with this parameter block (one octet at least), None if its form is unknown."""
    parsed = parse_parameters(parameters, tables.USERDATA)
    return USERDATA_BODIES.get(parse_parameter_parts(parameters, 0, len(parameters), parsed, [])[0].layout)


def error_text(code: int, function: int) -> str:
    """Return an error code of the header or of userdata by number and name, as the answer to ``function``."""
    codes = errors_of(function)
    return codes.hex(code) if codes.get(code) is None else f"{codes.hex(code)} {codes.name(code)}"


def function_of(body: Packet) -> int | None:
    """Return the function octet of a body, None when it has none (an Ack, mostly)."""
    if isinstance(body, S7_Function):
        return body.function
    value = body.getfieldval("function") if isinstance(body, S7_Body) and "function" in body.default_fields else None
    return int(value) if value is not None else None


def joined(texts: list[str]) -> str:
    """Return texts one after another, those after the first few only counted."""
    more = len(texts) - _NAMED
    return ", ".join(texts[:_NAMED] + ([f"+{more} more"] if more > 0 else []))


def pdu_of(body: Packet) -> Pdu | None:
    """Return the PDU that a body belongs to; None without a header, or if a value set by the user cannot be built."""
    header = body.underlayer
    if not isinstance(header, S7):
        return None
    try:
        return parse_pdu(bytes(header))
    except (ValueError, struct.error):
        return None


def notes_of(body: Packet) -> str:
    """Return the engine's notes on the parts of a body (a file name, an SZL id …), safe to show.

    Empty for a body without a header, and while a value set by the user cannot be built.
    """
    pdu = pdu_of(body)
    if pdu is None:
        return ""
    return joined([shortened(note, NOTE) for note in body_to_show(pdu).notes])


def parameters_left(pkt: Packet, rest: bytes) -> int:
    """Return how many octets of the parameter block are left after the previous fields, while dissecting a body.

    A body dissected by itself, without an S7 header under it, takes everything as parameters.
    """
    header = pkt.underlayer
    end: int = header.param_length if isinstance(header, S7) else len(pkt.original)
    return max(0, end - consumed(pkt, rest))


def data_left(pkt: Packet, rest: bytes) -> int:
    """Return how many octets of the data block are left, while dissecting a body."""
    header = pkt.underlayer
    if not isinstance(header, S7):
        return 0
    end: int = header.param_length + header.data_length
    return max(0, end - consumed(pkt, rest))


def body_fields(*parameters: ScapyField, data: Sequence[ScapyField] = ()) -> list[ScapyField]:
    """Return the fields of a body: parameter block, data block, and the remaining octets of each."""
    return [*parameters, Leftover("parameter_rest", parameters_left), *data, Leftover("data_rest", data_left)]


class S7_Body(WireLayer):
    """A body: ``data_fields`` names the fields of the data block, all others are the parameter block.

    ``parameter_rest`` and ``data_rest`` keep octets of the blocks where none are expected. If it is called itself, it is an
    `S7_Function`, because only a header determines the body.
    """

    name = "S7 body"
    show_summary = False
    data_fields: ClassVar[tuple[str, ...]] = ("data_rest",)
    #: ROSCTR of a body that is dissected without an S7 header under it.
    rosctr_alone: ClassVar[int] = tables.JOB

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> type[Packet]:
        """Return the class that takes any body (Scapy's interface)."""
        return S7_Function

    def responds_to(self, other: Packet) -> bool:
        """Return whether this is the userdata response to the userdata request ``other`` (of the same PDU reference)."""
        return False

    def self_build(self) -> bytes:
        """Build both blocks, and set their sizes in the header (Scapy's interface).

        The sizes are those of the octets just built: a second build would draw other random values for ``fuzz()``.
        """
        octets = b""
        if self.raw_packet_cache is not None:
            octets = super().self_build()  # this checks whether the dissected octets still match the fields
        if self.raw_packet_cache is not None:
            parameters = len(octets) - sum([len(self._field_octets(b"", name)) for name in self.data_fields])
        else:
            octets, parameters = b"", 0
            for field in self.fields_desc:
                if field.name == self.data_fields[0]:
                    parameters = len(octets)
                octets = self._field_octets(octets, field.name)
        if isinstance(self.underlayer, S7):
            self.underlayer.body_sizes = parameters, len(octets) - parameters
        return octets

    def _field_octets(self, octets: bytes, name: str) -> bytes:
        """Return ``octets`` with those of a field appended."""
        field, value = self.getfield_and_val(name)
        built: bytes = octets + bytes(value) if isinstance(value, RawVal) else field.addfield(self, octets, value)
        return built

    def describe(self) -> str:
        """Return the name of this body, for the beginning of the summary."""
        function = function_of(self)
        return tables.FUNCTIONS.name(function) if function is not None else ""

    def detail(self) -> str:
        """Return the description of this body, for the end of the summary."""
        return ""


class S7_Setup(S7_Body):
    """Setup communication, request and answer alike."""

    name = "S7 Setup communication"
    least = layouts.SETUP.size
    fields_desc = body_fields(
        *header_fields(
            layouts.SETUP,
            {
                "function": tables.SETUP_COMMUNICATION,
                "max_amq_calling": 1,
                "max_amq_called": 1,
                "pdu_length": 480,
            },
        )
    )

    def detail(self) -> str:
        """Return the three values that are negotiated."""
        return f"amq={self.max_amq_calling}/{self.max_amq_called} pdu={self.pdu_length}"


def _parameters_of(body: Packet, block: bytes) -> Parameters:
    header = body.underlayer
    rosctr: int = header.rosctr if isinstance(header, S7) else body.rosctr_alone
    return parse_parameters(block, rosctr & 7)


def carve_parameters(pkt: Packet, s: bytes) -> list[Piece]:
    """Cut the rest of the parameter block into parts, as the engine does."""
    end = min(len(pkt.original), len(pkt.original) - len(s) + parameters_left(pkt, s))
    block = bytes(pkt.original[:end])
    parts = parse_parameter_parts(block, 0, end, _parameters_of(pkt, block), [])
    start = consumed(pkt, s)
    behind = [part for part in parts if part.offset >= start]
    return pieces_of(behind, block) if behind and behind[0].offset == start else []


def carve_data(pkt: Packet, s: bytes) -> list[Piece]:
    """Cut the data block into parts, as the engine does."""
    block = bytes(s[: data_left(pkt, s)])
    parameters = _parameters_of(pkt, bytes(pkt.original[: consumed(pkt, s)]))
    return pieces_of(parse_data_parts(block, 0, len(block), parameters, []), block)


class S7_Function(S7_Body):
    """Any function: both blocks as lists of parts. `S7_Job` asks, `S7_Answer` answers; this one is neither."""

    name = "S7 function"
    least = 1
    data_fields = ("data",)
    fields_desc = [PartsField("parameters", carve_parameters), PartsField("data", carve_data)]

    @property
    def function(self) -> int | None:
        """The first octet of the parameter block; None when it is empty."""
        field, parameters = self.getfield_and_val("parameters")
        octets: bytes = field.addfield(self, b"", parameters)
        return octets[0] if octets else None

    def detail(self) -> str:
        """Return the description of the parts, including an error."""
        notes = notes_of(self)
        header = self.underlayer
        refused = isinstance(header, S7) and header.rosctr in _ANSWERS and (header.error_class or header.error_code)
        return "" if refused and notes == "error" else notes


class S7_Job(S7_Function):
    """A job: PI service, PLC stop, start upload, request download …; ``parameters`` and ``data`` are lists of parts."""

    name = "S7 job"
    least = 1


class S7_Answer(S7_Function):
    """The answer to an `S7_Job`."""

    name = "S7 answer"
    least = 1
    rosctr_alone = tables.ACK_DATA


class S7_Data(S7_Body):
    """A data block without parameters."""

    name = "S7 data"
    data_fields = ("data",)
    fields_desc = [OctetsField("data", data_left)]


#: Bodies by (is it an answer, function), and those of userdata by the layout of their head. The modules that define more add
#: them.
BODIES: Final[dict[tuple[bool, int], type[S7_Body]]] = {
    (False, tables.SETUP_COMMUNICATION): S7_Setup,
    (True, tables.SETUP_COMMUNICATION): S7_Setup,
}
USERDATA_BODIES: Final[dict[Layout, type[S7_Body]]] = {}

bind_top_down(S7, S7_Answer, rosctr=tables.ACK_DATA)
