"""S7comm as Scapy layers: the header and what every body shares (reference sections 3 and 4).

A body holds the parameter block and the data block: ``S7() / S7_ReadVarRequest(items=[S7_Any(db=10, …)])``. The header's two
lengths are filled in from it when left out. Read Var and Write Var are in `variables`, userdata in `userdata`; a function
without a body of its own is an `S7_Function`, which names the function and keeps the octets.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Final

from scapy.fields import ConditionalField
from scapy.packet import Packet, Raw

from dissect.layers.fields import Leftover, OctetsField, ScapyField, WireLayer, consumed, fill_number, header_fields
from dissect.s7 import layouts, tables
from dissect.s7.errors import ERROR_CODES
from dissect.s7.message import PROTOCOL_ID, header_size

_ANSWERS: Final = (tables.ACK, tables.ACK_DATA)


def is_s7(octets: bytes) -> bool:
    """Tell whether a TSDU is S7comm: protocol id 0x32 and a ROSCTR that exists."""
    return len(octets) >= 2 and octets[0] == PROTOCOL_ID and octets[1] in tables.ROSCTR


class S7(WireLayer):
    """The S7 header; error octets are in ROSCTR 2 and 3 only. ``param_length`` and ``data_length`` are filled in if left out.

    With a `Raw` for a body, all of its octets count as parameters.
    """

    name = "S7"
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
        """A header that is not whole stays Raw; which size it has stands in ROSCTR."""
        if not _pkt:
            return cls
        return cls if len(_pkt) >= cls.least and len(_pkt) >= header_size(_pkt[1]) else Raw

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the two lengths (Scapy's interface)."""
        parameters, data = 0, 0
        if isinstance(self.payload, S7_Body):
            parameters, data = self.payload.block_sizes()
        elif type(self.payload) is Raw:
            parameters = len(self.payload.load)
        if self.getfieldval("param_length") is None:
            pkt = fill_number(pkt, 6, 2, parameters, "the S7 parameter length")
        if self.getfieldval("data_length") is None:
            pkt = fill_number(pkt, 8, 2, data, "the S7 data length")
        return pkt + pay

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Choose the body by ROSCTR and function (Scapy's interface)."""
        parameters = payload[: self.param_length]
        if not parameters:
            return S7_Data if self.param_length == 0 and self.data_length else Raw
        if self.rosctr == tables.USERDATA:
            candidates = USERDATA_BODIES
        else:
            candidates = [BODIES.get((self.rosctr in _ANSWERS, parameters[0]), S7_Function)]
        for body in candidates:
            if body.suits(parameters):
                return body
        return S7_Function

    def hashret(self) -> bytes:
        """Return what request and answer have in common (Scapy's interface)."""
        kind = b"U" if self.rosctr == tables.USERDATA else b"J"
        return kind + int(self.pdu_ref).to_bytes(2, "big")

    def answers(self, other: Packet) -> int:
        """Tell whether this PDU answers ``other``, whoever of the two is the PLC (reference section 5.1)."""
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
        """Return one line for header and body; every S7 of a chain wants one."""
        body = self.payload.describe() if isinstance(self.payload, S7_Body) else ""
        parts = ["S7", tables.ROSCTR.name(self.rosctr), *([body] if body else []), f"ref=0x{self.pdu_ref:04x}"]
        if isinstance(self.payload, S7_Body) and self.payload.detail():
            parts.append(self.payload.detail())
        if self.rosctr in _ANSWERS and (self.error_class or self.error_code):
            parts.append(f"error {error_text(self.error_class << 8 | self.error_code)}")
        return " ".join(parts), [S7]


def error_text(code: int) -> str:
    """Return an error code of the header or of userdata by number and name."""
    name = ERROR_CODES.name(code)
    return name if code not in ERROR_CODES else f"{ERROR_CODES.hex(code)} {name}"


def function_of(body: Packet) -> int | None:
    """Return the function octet of a body, None when it has none (an Ack, mostly)."""
    value = body.getfieldval("function") if isinstance(body, S7_Body) and "function" in body.default_fields else None
    return int(value) if value is not None else None


def parameters_left(pkt: Packet, rest: bytes) -> int:
    """Return how many octets of the parameter block the fields before left over, while dissecting a body.

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
    """Return the fields of a body: parameter block, data block, and what is left over in each."""
    return [*parameters, Leftover("parameter_rest", parameters_left), *data, Leftover("data_rest", data_left)]


class S7_Body(WireLayer):
    """A body: ``data_fields`` names the fields of the data block, all others are the parameter block.

    ``parameter_rest`` and ``data_rest`` keep octets of the blocks that stand where nothing is expected.
    """

    name = "S7 body"
    show_summary = False
    data_fields: ClassVar[tuple[str, ...]] = ("data_rest",)

    @classmethod
    def suits(cls, parameters: bytes) -> bool:
        """Tell whether a parameter block is this body's: here, whether its fixed part is there."""
        return len(parameters) >= cls.least

    def responds_to(self, other: Packet) -> bool:
        """Tell whether this is the userdata response to the userdata request ``other`` (of the same PDU reference)."""
        return False

    def block_sizes(self) -> tuple[int, int]:
        """Return the octets of the parameter block and of the data block as they would be built."""
        data = 0
        for name in self.data_fields:
            field, value = self.getfield_and_val(name)
            data += len(field.addfield(self, b"", value))
        return len(self.self_build()) - data, data

    def describe(self) -> str:
        """Return what this body is, for the summary's beginning."""
        function = function_of(self)
        return tables.FUNCTIONS.name(function) if function is not None else ""

    def detail(self) -> str:
        """Return what this body says, for the summary's end."""
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


class S7_Function(S7_Body):
    """A function without a body of its own here: named, its parameters and data kept as octets."""

    name = "S7 function"
    least = 1
    data_fields = ("data", "data_rest")
    fields_desc = body_fields(
        *header_fields(layouts.VARIABLES_HEAD)[:1],
        OctetsField("parameters", parameters_left),
        data=[OctetsField("data", data_left)],
    )


class S7_Data(S7_Body):
    """A data block without parameters."""

    name = "S7 data"
    data_fields = ("data",)
    fields_desc = [OctetsField("data", data_left)]


#: Bodies by (is it an answer, function), and those of userdata in the order they are tried. The modules that define more
#: add them.
BODIES: Final[dict[tuple[bool, int], type[S7_Body]]] = {
    (False, tables.SETUP_COMMUNICATION): S7_Setup,
    (True, tables.SETUP_COMMUNICATION): S7_Setup,
}
USERDATA_BODIES: Final[list[type[S7_Body]]] = []
