"""The fixed headers of S7comm as layouts (reference section 3)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.errors import ERROR_CLASSES, errors_of
from dissect.protocols.s7.tables import (
    AREAS,
    CPU_SERVICES,
    DATA_TRANSPORT_SIZES,
    FUNCTIONS,
    RETURN_CODES,
    ROSCTR,
    SYNTAX_IDS,
    TRANSPORT_SIZES,
    USERDATA_GROUPS,
    USERDATA_SUBFUNCTIONS,
    USERDATA_TYPES,
)
from dissect.wire.layout import COUNTS_PARTS, HOLDS_REFERENCE, Field, Layout

_HEAD: Final = [
    Field("protocol_id", 1, "Always 0x32.", "s7comm.header.protid"),
    Field("rosctr", 1, "Kind of PDU.", "s7comm.header.rosctr", ROSCTR),
    Field("redundancy_id", 2, "Redundancy identification, 0.", "s7comm.header.redid"),
    Field("pdu_ref", 2, "PDU reference, echoed by the answer.", "s7comm.header.pduref", holds=HOLDS_REFERENCE),
    Field("param_length", 2, "Bytes of the parameter block.", "s7comm.header.parlg"),
    Field("data_length", 2, "Bytes of the data block.", "s7comm.header.datlg"),
]

#: Header of ROSCTR 1 (Job) and 7 (Userdata).
HEADER: Final = Layout("S7 header", "reference section 3.1", [*_HEAD])
#: Header of ROSCTR 2 (Ack) and 3 (Ack_Data): two octets more.
ACK_HEADER: Final = Layout(
    "S7 header",
    "reference section 3.1",
    [
        *_HEAD,
        Field("error_class", 1, "Error class, 0 when all is well.", "s7comm.header.errcls", ERROR_CLASSES),
        Field("error_code", 1, "Error code within the class.", "s7comm.header.errcod"),
    ],
)

#: Position of the reference in every PDU.
PDU_REF: Final = slice(*HEADER.places(HOLDS_REFERENCE)[0])

SETUP: Final = Layout(
    "Setup communication",
    "reference section 3.4",
    [
        Field("function", 1, "0xf0.", "s7comm.param.func", FUNCTIONS),
        Field("reserved", 1, "0.", "s7comm.param.setup_reserved1"),
        Field("max_amq_calling", 2, "Open jobs towards the asking side.", "s7comm.param.maxamq_calling"),
        Field("max_amq_called", 2, "Open jobs towards the answering side.", "s7comm.param.maxamq_called"),
        Field("pdu_length", 2, "Largest S7 PDU, header included.", "s7comm.param.pdu_length"),
    ],
)

VARIABLES_HEAD: Final = Layout(
    "Read/Write Var",
    "reference section 3.5",
    [
        Field("function", 1, "0x04 read, 0x05 write.", "s7comm.param.func", FUNCTIONS),
        Field("item_count", 1, "Items that follow.", "s7comm.param.itemcount"),
    ],
)

#: Only the function octet, as in most positive answers.
FUNCTION: Final = Layout("function", "reference section 3.3", [VARIABLES_HEAD.fields[0]])

ITEM_HEAD: Final = Layout(
    "item",
    "reference section 3.5",
    [
        Field("specification", 1, "Variable specification, 0x12.", "s7comm.param.item.varspec"),
        Field("length", 1, "Bytes of the item after this one.", "s7comm.param.item.varspec_length"),
        Field("syntax_id", 1, "How the address is written.", "s7comm.param.item.syntaxid", SYNTAX_IDS),
    ],
)

S7ANY_ITEM: Final = Layout(
    "S7ANY item",
    "reference section 3.5",
    [
        *ITEM_HEAD.fields,
        Field("transport_size", 1, "Type of one element.", "s7comm.param.item.transp_size", TRANSPORT_SIZES),
        Field("count", 2, "Elements, not bytes.", "s7comm.param.item.length"),
        Field("db", 2, "DB number, 0 outside DB areas.", "s7comm.param.item.db"),
        Field("area", 1, "Memory area.", "s7comm.param.item.area", AREAS),
        Field(
            "address",
            3,
            "Byte times 8 plus bit; a plain number for counters and timers.",
            "s7comm.param.item.address",
        ),
    ],
)

DATA_ITEM: Final = Layout(
    "data item",
    "reference section 3.5",
    [
        Field("return_code", 1, "0xff success; 0 in a write request.", "s7comm.data.returncode", RETURN_CODES),
        Field("transport_size", 1, "What the length counts.", "s7comm.data.transportsize", DATA_TRANSPORT_SIZES),
        Field("length", 2, "Bits or bytes, by transport size.", "s7comm.data.length"),
    ],
)

#: Comes before the payload of each userdata PDU that has one.
DATA_HEAD: Final = Layout(
    "data head",
    "reference section 4.2",
    [
        Field("return_code", 1, "0xff success, 0x0a no payload.", "s7comm.data.returncode", RETURN_CODES),
        Field("transport_size", 1, "9 with payload, 0 without.", "s7comm.data.transportsize", DATA_TRANSPORT_SIZES),
        Field("length", 2, "Bytes of the payload.", "s7comm.data.length", counts=COUNTS_PARTS),
    ],
)

_USERDATA_HEAD: Final = [
    Field("function", 1, "0x00.", "s7comm.param.func", FUNCTIONS),
    Field("item_count", 1, "1.", "s7comm.param.itemcount"),
    Field("specification", 1, "Variable specification, 0x12.", "s7comm.param.item.varspec"),
    Field("length", 1, "4 short, 8 extended.", "s7comm.param.item.varspec_length"),
    Field("syntax_id", 1, "0x11 short, 0x12 extended.", "s7comm.param.item.syntaxid", SYNTAX_IDS),
    Field("type", 1, "Push, request or response.", "s7comm.param.userdata.type", USERDATA_TYPES, (0xC0, 6)),
    Field("group", 1, "Function group.", "s7comm.param.userdata.funcgroup", USERDATA_GROUPS, (0x3F, 0), True),
    Field("subfunction", 1, "Subfunction of the group.", "s7comm.param.userdata.subfunc"),
    Field("sequence", 1, "Sequence number or job id.", "s7comm.param.userdata.seq_num", holds=HOLDS_REFERENCE),
]

#: Userdata parameter head, short form (8 octets).
USERDATA_SHORT: Final = Layout("userdata parameters", "reference section 4.1", [*_USERDATA_HEAD])
#: Userdata parameter head, extended form (12 octets).
USERDATA_EXTENDED: Final = Layout(
    "userdata parameters",
    "reference section 4.1",
    [
        *_USERDATA_HEAD,
        Field(
            "data_unit_ref",
            1,
            "Data unit reference of a multi-part answer.",
            "s7comm.param.userdata.dataunitref",
            holds=HOLDS_REFERENCE,
        ),
        Field("last_data_unit", 1, "0 last part, 1 more to come.", "s7comm.param.userdata.lastdataunit"),
        Field("error_code", 2, "0, or why it was refused.", "s7comm.param.errcod", errors_of(CPU_SERVICES)),
    ],
)

#: Parameters of the mode transition push, the only userdata without the head above (8 octets).
MODE_TRANSITION: Final = Layout(
    "mode transition",
    "reference section 4.9",
    [
        Field("function", 1, "0x01.", "s7comm.param.func", FUNCTIONS),
        Field("item_count", 1, "0.", "s7comm.param.itemcount"),
        Field("unknown", 4, "0x10100000 in captures."),
        Field(
            "mode", 1, "Operating mode the CPU changed to.", "s7comm.param.modetrans.subfunc", USERDATA_SUBFUNCTIONS[0]
        ),
        Field("unknown_last", 1, "0 in captures."),
    ],
)
