"""The worked examples of the protocol reference: each decodes to what stands there, octet group by octet group."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.layouts import ACK_HEADER, HEADER
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE
from dissect.wire.layout import FieldValue
from dissect.wire.part import OCTETS, SURPLUS
from tests.cases import each
from tests.examples import CLIENT, EXAMPLES, S7, Example

#: Octets before an S7 PDU that came in one DT.
S7_AT: Final = 7
FRAGMENTS: Final = ("DT fragment 1 of 2", "DT fragment 2 of 2")


def is_s7(example: Example) -> bool:
    return example.octets[5:8] == b"\xf0\x80\x32"


MESSAGES: Final = [example for example in EXAMPLES if is_s7(example)]


def pdu_of(example: Example) -> Pdu:
    return parse_pdu(example.octets[S7_AT:])


def fields_of(pdu: Pdu, body: Body) -> list[FieldValue]:
    """All fields of a PDU in wire order, the header's first."""
    header = ACK_HEADER if pdu.header_size == ACK_HEADER_SIZE else HEADER
    return header.read(pdu.octets) + [value for part in body.parts for value in part.values]


def test_there_are_ninety() -> None:
    assert len(EXAMPLES) == len({example.title for example in EXAMPLES}) == 90
    assert len(MESSAGES) == 74


@each("example", EXAMPLES)
def test_the_tpkt_says_how_long_it_is(example: Example) -> None:
    assert int.from_bytes(example.octets[2:4], "big") == len(example.octets)
    tpdu = parse_tpdu(example.octets[4:])
    assert tpdu.malformed == []


@each("example", MESSAGES)
def test_it_decodes_without_a_complaint_and_without_a_rest(example: Example) -> None:
    pdu = pdu_of(example)
    body = parse_body(pdu)
    assert (pdu.malformed, body.malformed) == ([], [])
    assert [part for part in body.parts if part.layout is SURPLUS] == []
    at = pdu.header_size
    for part in body.parts:
        assert part.offset == at, "parts are without gaps"
        at = part.end
    assert at == len(pdu.octets)
    unknown = [part for part in body.parts if part.layout is OCTETS]
    if "continuation" in example.title:
        assert [part.note for part in unknown] == ["continuation"]
    else:
        assert unknown == []


@each("example", MESSAGES)
def test_a_field_begins_wherever_the_reference_begins_a_line(example: Example) -> None:
    pdu = pdu_of(example)
    ours = {value.offset + S7_AT for value in fields_of(pdu, parse_body(pdu))}
    missing = [cut for cut in example.cuts if cut > S7_AT and cut not in ours]
    assert missing == INSIDE.get(example.title, [])


#: Lines of the reference that begin inside a field of ours: records of a list in parts, values of a data item.
INSIDE: Final = {
    "Ack_Data to DBREAD: a return code before each area": [26, 28, 29],
    "Response, second and last part: continuation without the SZL header": [35, 37],
}


def test_two_fragments_are_one_pdu() -> None:
    first, second = (next(one for one in S7 if one.title.startswith(title)) for title in FRAGMENTS)
    pdu = parse_pdu(first.octets[S7_AT:] + second.octets[S7_AT:])
    assert pdu.malformed == []
    assert [item.address for item in pdu.parameters.items] == ["DB1.DBB0"]


#: What fields say, by the place where they begin (from the TPKT, as in the reference): numbers, or a part of the text.
SAYS: Final[dict[str, dict[int, int | str]]] = {
    "Job ask for 480-octet PDUs, one job each way": {17: "Setup communication", 19: 1, 21: 1, 23: 480},
    "Ack_Data the PLC lowers the PDU length to 240": {21: 1, 23: 1, 25: 240},
    "Job one item, DB10.DBW4 x 3 words": {17: "Read Var", 18: 1, 22: "WORD", 23: 3, 25: 10, 27: "data block", 28: 0x20},
    "Ack_Data six octets (length counted in bits)": {21: "Success", 22: "BYTE/WORD/DWORD", 23: 48},
    "Job three items - bit, three octets, REAL": {22: "BIT", 27: "flags", 28: 0x53, 34: "BYTE", 46: "REAL", 52: 0x40},
    "Ack_Data fill octets after odd-length items that are not the last": {22: "BIT", 26: 0, 34: 0, 36: "REAL", 37: 4},
    "Job three items - a data block, a missing data block, timers": {37: 999, 46: "TIMER", 51: "timers", 52: 5},
    "Ack_Data an item in error is four octets with no data": {27: "Object does not exist", 28: "NULL", 32: "OCTET STRING"},
    "Job DINT, three CHAR, one counter": {22: "DINT", 34: "CHAR", 46: "COUNTER", 51: "counters", 52: 5},
    "Ack_Data DINT comes as data size 0x05 in bits, CHAR and counter as octet strings 0x09": {
        22: "INTEGER",
        23: 32,
        30: "OCTET STRING",
        31: 3,
        36: 0,
        38: "OCTET STRING",
    },
    "Ack_Data to DBREAD: a return code before each area": {21: "Success", 22: "OCTET STRING", 23: 5},
    "Ack_Data one return code octet per item": {21: "Success"},
    "Job two items, odd first item so a fill octet": {22: "BYTE", 34: "WORD", 45: 8, 48: 0, 51: 32},
    "Ack_Data failure, error in header and status bit 0x02": {17: 0xD2, 18: 0xA9, 20: 1},
    "Response, second and last part: continuation without the SZL header": {25: 213, 26: 0, 31: 6},
    "Request PLC password (8 octets, reversible encoding)": {27: 8},
    "The next DT with EOT then completes a TSDU of 0 + n octets": {18: 1, 22: "BYTE", 25: 1, 28: 0},
    "Job DBREAD item (syntax 0xB0), two areas": {21: "DBREAD", 22: 2, 23: 2, 24: 68, 26: 352, 28: 1, 29: 72, 31: 48},
    "Job Sinumerik NCK item (syntax 0x82)": {21: "NCK", 22: 2, 23: 1, 25: 1, 27: 0x7F, 28: 1},
    "Job S7-1200 symbolic item (syntax 0xB2)": {21: "1200SYM", 22: 0xFF, 25: 1, 27: 0x11223344, 31: 4},
    "Job set one bit M2.0": {17: "Write Var", 22: "BIT", 27: "flags", 28: 0x10, 32: "BIT", 33: 1},
    "Ack_Data second item refused": {21: "Success", 22: "Invalid address"},
    "Job Start upload of DB 1 from the active file system": {17: "Start upload", 18: 0, 21: 0, 25: 9},
    "Ack_Data upload id and total length": {23: 7, 27: 7, 28: "216"},
    "Job Upload": {17: "Upload", 21: 7},
    "Ack_Data last piece": {20: 0, 21: 8},
    "Job End upload": {17: "End upload", 19: 0, 21: 7},
    "Job Request download of DB 1 to the passive file system": {25: 9, 35: 13, 36: "1", 37: "216", 43: "88"},
    "Job Download block, sent BY THE PLC": {17: "Download block", 25: 9},
    "Ack_Data with the block data, sent by the client, more to come": {20: 0, 21: 6},
    "Job Download ended, sent by the PLC": {17: "Download ended", 19: 0, 25: 9},
    "Job _INSE: activate the block just loaded": {17: "PI service", 25: 10, 27: 1, 37: 5, 38: "_INSE"},
    "Job _DELE: delete DB 1 from the active file system": {25: 10, 37: 5, 38: "_DELE"},
    "Job P_PROGRAM: warm restart (empty parameter block)": {25: 0, 27: 9, 28: "P_PROGRAM"},
    "Job P_PROGRAM with 'C ': cold restart": {25: 2, 27: "C", 29: 9, 30: "P_PROGRAM"},
    "Job _MODU 'EP': copy RAM to ROM": {25: 2, 27: "EP", 29: 5, 30: "_MODU"},
    "Job _GARB: compress memory": {25: 0, 27: 5, 28: "_GARB"},
    "Job PLC stop (function 0x29)": {17: "PLC stop", 23: 9, 24: "P_PROGRAM"},
    "Request SZL-ID 0x0424 index 0": {22: 1, 23: 1, 24: 0, 25: "Success", 27: 4, 31: 0},
    "Response one record of 20 octets, CPU in RUN": {22: 2, 24: 2, 31: 28, 37: 20, 39: 1, 53: "DT#2023-11-14-22:15:30.621"},
    "Response, first part (last data unit = no)": {25: 213, 26: 1, 31: 14, 37: 2, 39: 6},
    "Response error (bad index), return code 0x0a and no data": {27: "SZL", 31: 0},
    "Response four octets per type": {33: "OB", 35: 2, 37: "DB", 39: 17},
    "Request list blocks of type DB": {29: "DB"},
    "Response number, flags, language": {33: 1, 35: 0x22, 36: "DB", 37: 7},
    "Request get block info of DB 1, active file system": {29: "DB", 31: "1", 36: "active"},
    "Response get block info, 78 octets": {
        35: 74,
        43: "DB",
        44: "DB",
        45: 1,
        47: 216,
        51: 0,
        55: "2015-11-06 10:21:53.945",
        67: 56,
        69: 0,
        71: 0,
        73: 88,
        75: "AUTHOR",
        83: "FAMILY",
        91: "HEADER",
        99: "0.1",
        101: 0x63CC,
    },
    "Response with the clock": {34: 0x19, 35: "DT#2016-02-08-14:51:37.916"},
    "Request set clock": {30: 0x20, 31: "DT#2024-02-29-12:00:00.000"},
    "Response wrong password": {27: "assword", 31: 0},
    "Request message service: subscribe mode transitions": {30: 0, 31: "USER1"},
    "Response to the subscription": {33: 2, 34: 0},
    "Push mode transition to STOP (different parameter layout, no data)": {17: "Mode transition", 23: "STOP"},
    "Push diagnostic message, 20 octets": {31: 255, 32: 132, 33: 0, 35: 0, 37: 0, 41: "DT#2023-11-14-22:15:30.621"},
    "Push ALARM_8 indication": {29: "DT#2023-11-14-22:15:30.621", 38: 1, 41: "ALARM_IND", 43: 0xC2, 47: 1, 51: "Success"},
    "Request cyclic transfer, 1 s, one item": {30: 1, 31: "1 s", 32: 1, 36: "BYTE", 37: 2, 39: 7, 41: "data block", 42: 0},
    "Response the sequence number is the job id of the subscription": {24: 4, 35: "Success", 37: 16},
    "Push cyclic data for job 4, PDU reference 0": {22: 0, 24: 4, 37: 16},
    "Request unsubscribe job 4": {29: 5, 30: 4},
    "Request variable status (programmer commands use the EXTENDED form even in requests)": {
        33: 20,
        35: 8,
        39: "monitor",
        41: "once",
        43: 18,
        55: "immediately",
        57: 1,
        59: "MW",
        60: 1,
        61: 0,
        63: 6,
    },
    "BSEND request (group 6), single fragment, R_ID 1": {34: 6, 37: 1, 41: 4},
}  # fmt: skip


@each("title", SAYS)
def test_fields_say_what_stands_beside_them(title: str) -> None:
    pdu = pdu_of(next(example for example in MESSAGES if example.title == title))
    fields = fields_of(pdu, parse_body(pdu))
    for at, expected in SAYS[title].items():
        there = [value for value in fields if value.offset + S7_AT == at]
        if isinstance(expected, int):
            assert expected in {value.value for value in there if value.octets is None}, f"at {at}"
        else:
            assert any(expected in value.meaning for value in there), f"at {at}: {[value.meaning for value in there]}"


def test_only_heads_say_nothing_more() -> None:
    assert SAYS.keys() <= {example.title for example in MESSAGES}
    silent = [example for example in MESSAGES if example.title not in SAYS]
    layouts = {part.layout.name for example in silent for part in parse_body(pdu_of(example)).parts}
    assert layouts == {"function", "userdata parameters", "data head"}


def test_the_examples_are_those_of_the_reference(reference: Path) -> None:
    """Side and octets of every message, as they stand in the reference's section 8."""
    text = (reference / "s7_protocol.md").read_text(encoding="utf-8")
    text = text[text.index("## 8. Worked examples") : text.index("## Appendix A")]
    found = []
    for side, block in re.findall(
        r"\*\* \((client to PLC|PLC to client), frame \d+\)\n.*?```\n(.*?)```", text, re.DOTALL
    ):
        lines = re.findall(r"^ *\d+  ([0-9a-f]+(?: [0-9a-f]+)*)(?:  .*)?$", block, re.MULTILINE)
        found.append((side == "client to PLC", [bytes.fromhex(line) for line in lines]))
    assert len(found) == 90
    assert sorted(found) == sorted((example.from_client is CLIENT, example.groups) for example in EXAMPLES)
