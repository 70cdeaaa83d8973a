"""S7comm-plus in words, in lines, in trees and in JSON."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.side import Side
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.pdu_json import PduLines
from dissect.meaning.report.plus import head_json, plus_notes
from dissect.meaning.report.tree import MAX_HEX, plus_tree_lines
from dissect.meaning.report.words import Places
from dissect.meaning.report.writers.csv import CSV_COLUMNS, CsvRows
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.meaning.report.writers.text import plus_line, transaction_line
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7plus.hiding import shown_contents
from dissect.protocols.s7plus.message import parse_plus
from dissect.wire.text import Clock
from tests.engine.transactions.talk import SECOND
from tests.engine.transactions.talk import Talk as Conversation
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import UNSAFE, analysed, begun, observed, read, report, section
from tests.properties.messages import dt
from tests.properties.packets import Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import (
    CREATE_OBJECT,
    GET_MULTI,
    INIT_SSL,
    KEEP_ALIVE,
    NOTIFICATION_V3,
    RESPONSE_V3,
    SET_VARIABLE,
    asked,
    event,
    framed,
    notified,
    told,
)
from tests.protocols.s7plus.test_bodies import FIVE, LEVEL, LOST, WORD
from tests.protocols.s7plus.test_objects import TYPE

PLACES = Places([], False)


class Everything(Observer):
    """Every line of every form."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.lines: list[str] = []
        self.jsonl: list[dict[str, Any]] = []
        self.transactions: list[str] = []
        self.cells: list[dict[str, str]] = []
        self.told: list[dict[str, Any]] = []
        self._pdus = PduLines()
        self._transactions = TransactionLines()

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        pdu = parse_plus(octets, frame, time_ns, side.connection.number, side.index, cut)
        self.lines.append(plus_line(pdu, side.connection, Clock(), PLACES).partition("102  ")[2])
        self.lines[-1] = self.lines[-1] or plus_line(pdu, side.connection, Clock(), PLACES).partition("49152  ")[2]
        self.jsonl.append(json.loads(self._pdus.plus_line(pdu, side.connection)))

    def transaction(self, transaction: Any) -> None:
        self.transactions.append(transaction_line(transaction, Clock(), PLACES))
        self.cells += [
            dict(zip(CSV_COLUMNS, row, strict=True)) for row in csv.reader(CsvRows(PLACES).lines(transaction))
        ]
        self.told.append(json.loads(self._transactions.line(transaction)))


@pytest.fixture
def talk() -> Talk:
    """A request answered, one refused, one way, a notification, an event, a keep-alive, an S7 read."""
    talk = begun()
    body = bodies.get_multi(LEVEL, WORD)
    talk.send(0, dt(framed(asked(5, body=body))))
    talk.send(1, dt(framed(told(5, body=bodies.multi_got([(1, FIVE)], [(2, LOST)])))))
    talk.send(0, dt(framed(asked(6, body=body), 3)))
    talk.send(1, dt(framed(told(6, body=b"\xff" * 8 + b"\xf4\0\0" + bodies.end(3)), 3)))
    granted = bodies.set_variable(0x70000E51, [1053], FIVE)
    talk.send(0, dt(framed(asked(7, SET_VARIABLE, flags=0x74, body=granted), 3))).send(1, dt(framed(notified())))
    talk.send(1, dt(event(99, b"LOG\x1bOUT"))).send(0, dt(KEEP_ALIVE))
    talk.send(0, dt(framed(asked(8, body=body[:20]), trailer=False))).send(0, dt(framed(body[20:])))
    talk.send(0, dt(framed(asked(9))[:-6]))
    return read(talk, 1)


def test_the_session_0_is_one_too() -> None:
    """A client that has none yet asks with it."""
    assert plus_notes(parse_plus(framed(asked(5, session=0)))) == ["session 0"]
    assert plus_notes(parse_plus(framed(told(5, body=b"\0")))) == []


@pytest.fixture
def found(talk: Talk) -> Everything:
    everything = Everything()
    observed(everything, talk.packets())
    return everything


def test_lines(found: Everything) -> None:
    damaged = "MALFORMED s7plus: length at byte 2 claims 18 bytes, the TSDU has 16"
    credit = "0x70000e51.SubscriptionCreditLimit = Int 5"
    wanted = "DB3 LID 14 [CRC 0xaabbccdd], MW100"
    assert found.lines == [
        f"S7comm-plus Request       seq 5  GetMultiVariables  session 902  {wanted}",
        "S7comm-plus Response      seq 5  GetMultiVariables  1: Int 5, 2: 0x8020ab0019d9fff4 Object not found",
        f"S7comm-plus Request       seq 6  GetMultiVariables  session 902  {wanted}",
        "S7comm-plus Response      seq 6  GetMultiVariables  return value 0xfffffffffffffff4 Object not found",
        f"S7comm-plus Request       seq 7  SetVariable  session 902, expects no response  {credit}",
        "S7comm-plus Notification  subscription 0x70000e51, number 5",
        "S7comm-plus system event  99 bytes confirmed, LOG\\x1bOUT",
        "S7comm-plus keep-alive    number 7",
        f"S7comm-plus Request       seq 8  GetMultiVariables  session 902  {wanted}  in 2 frames",
        f"S7comm-plus Request       seq 9  GetMultiVariables  {damaged}",
    ]


def test_a_transaction_says_what_is_wrong_with_its_contents() -> None:
    """Its halves contradict themselves: the line says it of the first, JSON of both, with the place in the PDU."""
    talk = begun()
    talk.send(0, dt(framed(asked(1, body=bodies.get_multi(LEVEL) + b"more"), 3)))
    talk.send(1, dt(framed(told(1, body=bodies.multi_got([], [], 3) + b"x"), 3)))
    everything = Everything()
    observed(everything, read(talk, 1).packets())
    (told_of,) = [one for one in everything.told if one.get("protocol") == "s7comm_plus"]
    request, response = told_of["asks"][-1], told_of["tells"][-1]
    assert request.startswith("MALFORMED s7plus: ")
    assert [line.partition("  MALFORMED")[2] for line in everything.lines] == [
        request.removeprefix("MALFORMED"),
        response.removeprefix("MALFORMED"),
    ]
    (line,) = [one for one in everything.transactions if "S7comm-plus" in one]
    missing = "DB3 LID 14 [CRC 0xaabbccdd] (the answer holds neither a value nor a refusal)"
    assert line.endswith(f"GetMultiVariables  {missing}, {request.replace('MALFORMED', 'MALFORMED request:')}")


def test_a_transaction_says_what_is_not_all_there() -> None:
    """The beginning of a request, of an answer and of a notification: what is said of each is not all that it says."""
    talk = begun()
    talk.send(0, dt(framed(asked(1, body=bodies.get_multi(LEVEL)), 3)))
    talk.send(1, dt(framed(told(1, body=b"\0\1\0\7\0\5"), 3, trailer=False)))
    talk.send(1, dt(framed(notified(5), 2, trailer=False)))
    talk.send(0, dt(framed(asked(2, body=bodies.get_multi(LEVEL)), 3, trailer=False)))
    everything = Everything()
    observed(everything, read(talk, 1).packets())
    lines = [line.partition("  S7comm-plus ")[2] for line in everything.transactions if "S7comm-plus" in line]
    level = "DB3 LID 14 [CRC 0xaabbccdd]"
    assert lines == [
        f"GetMultiVariables  {level} = Int 5, response incomplete",
        "notification  push  subscription 0x70000e51, number 5, notification incomplete",
        f"GetMultiVariables  NO ANSWER (capture ends)  {level}, request incomplete",
    ]


def test_transactions(found: Everything) -> None:
    plus = [line.partition("  S7comm-plus ")[2] for line in found.transactions if "S7comm-plus" in line]
    level = "DB3 LID 14 [CRC 0xaabbccdd]"
    assert plus == [
        f"GetMultiVariables  {level} = Int 5, MW100: Object not found",
        f"GetMultiVariables  REFUSED 0xfff4 Object not found  {level}: Object not found, MW100: Object not found",
        "SetVariable  one way  expects no response, 0x70000e51.SubscriptionCreditLimit = Int 5",
        "notification  push  subscription 0x70000e51, number 5",
        f"GetMultiVariables  NO ANSWER (capture ends)  {level}, MW100",
        "GetMultiVariables  NO ANSWER (capture ends)  request incomplete",
    ]
    keys = ("pdu_ref", "rosctr", "function", "function_name", "outcome", "errors")
    refused = ["6", "", "1356", "S7comm-plus GetMultiVariables", "answered", "return value: 0xfff4 Object not found"]
    assert [[row[key] for key in keys] for row in found.cells if "plus" in row["function_name"]][:6] == [
        ["5", "", "1356", "S7comm-plus GetMultiVariables", "answered", ""],  # a row for each item
        ["5", "", "1356", "S7comm-plus GetMultiVariables", "answered", "item 2: 0xfff4 Object not found"],
        refused,
        refused,
        ["7", "", "1266", "S7comm-plus SetVariable", "unsolicited", ""],
        ["", "", "", "S7comm-plus notification", "unsolicited", ""],
    ]


def test_transactions_in_json(found: Everything) -> None:
    assert [complaint for line in found.told for complaint in complaints("transaction", line, exact=True)] == []
    plus = [line for line in found.told if line.get("protocol") == "s7comm_plus"]
    assert len(found.told) - len(plus) == 2
    assert [line["pdu_ref"] for line in plus] == [5, 6, 7, None, 8, 9]
    assert {line["rosctr"] for line in plus} == {None}
    assert [line["function"] for line in plus[2:4]] == [
        {"code": SET_VARIABLE, "name": "SetVariable"},
        {"code": None, "name": "notification"},
    ]
    assert plus[0]["errors"] == [
        {"where": "item 2", "code": 0xFFF4, "name": "Object not found", "text": "The device has no such object."}
    ]
    assert plus[0]["items"] == [
        {
            "address": "DB3 LID 14 [CRC 0xaabbccdd]",
            "syntax_id": None,
            "area": 0x84,
            "db": 3,
            "start_bit": None,
            "transport_size": None,
            "count": None,
            "return_code": 255,
            "data": "0005",
            "value": 5,
            "number": 1,
            "type": "Int",
            "crc": "0xaabbccdd",
            "path": [0x8A0E0003, 2550, 14],
        },
        {
            "address": "MW100",
            "syntax_id": None,
            "area": 0x83,
            "db": 0,
            "start_bit": 800,
            "transport_size": None,
            "count": None,
            "return_code": 0xFFF4,
            "data": None,
            "value": None,
            "number": 2,
            "type": None,
            "crc": None,
            "path": [82, 3736, 3, 100, 2],
        },
    ]
    assert plus[0]["s7plus"]["request"]["integrity_id"] == 9
    assert [item["return_code"] for item in plus[4]["items"]] == [None, None]
    assert plus[1]["errors"] == [
        {"where": "return value", "code": 0xFFF4, "name": "Object not found", "text": "The device has no such object."}
    ]
    assert plus[0]["s7plus"]["request"]["session_id"] == 0x386
    assert plus[1]["s7plus"]["response"]["return_value"] == "0xfffffffffffffff4"
    assert plus[1]["s7plus"]["response"]["integrity"] == "5a" * 32
    assert (plus[2]["response_frame"], plus[2]["s7plus"]["request"]["wants_response"]) == (None, False)
    assert (plus[3]["request_frame"], plus[3]["s7plus"]["response"]["number"]) == (None, 5)


def test_pdus_in_json(found: Everything) -> None:
    assert [complaint for line in found.jsonl for complaint in complaints("pdu", line, exact=True)] == []
    assert [line["s7plus"]["kind"] for line in found.jsonl][4:8] == [
        "Request",
        "Notification",
        "system event",
        "keep-alive",
    ]
    assert [line["pdu_ref"] for line in found.jsonl] == [5, 5, 6, 6, 7, None, None, None, 8, 9]
    assert found.jsonl[6]["s7plus"]["message"] == "LOG\x1bOUT"
    octets = bytes.fromhex(found.jsonl[8]["octets"])
    assert octets.count(b"\x72\x02\x00") == 3  # two frames and the trailer
    parts = found.jsonl[8]["parts"]
    assert [part["name"] for part in parts[:3]] == ["items", "address", "address"]
    for part in parts:  # each stands where it says, also where a frame begins within it
        for field in part["fields"]:
            if isinstance(field["value"], str) and field["size"] == len(field["value"]) // 2 and field["offset"] > 60:
                assert octets[field["offset"] : field["offset"] + field["size"]].hex() == field["value"]
    assert found.jsonl[9]["malformed"]


def test_the_analysis(talk: Talk) -> None:
    values = analysis_as_dict(analysed(talk.packets()))
    assert complaints("analysis", json.loads(json.dumps(values)), exact=True) == []
    assert values["s7plus"] == {
        "pdus": 10,
        "cut": 0,
        "unpaired": 2,
        "versions": {"0x02": 5, "0x03": 3, "0xfe": 1, "0xff": 1},
        "opcodes": {"0x31": 5, "0x32": 2, "0x33": 1},
        "functions": {"0x04f2": 1, "0x054c": 6},
    }
    functions = values["functions"]
    assert isinstance(functions, list)
    assert [(one["code"], one.get("protocol"), one["name"], one["total"], one["with_errors"]) for one in functions] == [
        ("0x04", None, "Read Var", 1, 0),
        ("0xf0", None, "Setup communication", 1, 0),
        ("0x04f2", "s7comm_plus", "S7comm-plus SetVariable", 1, 0),
        ("0x054c", "s7comm_plus", "S7comm-plus GetMultiVariables", 4, 2),
        (None, "s7comm_plus", "S7comm-plus notification", 1, 0),
    ]


def test_unknown_functions_are_one_row(talk: Talk) -> None:
    for number in range(300):
        talk.send(0, dt(framed(asked(100 + number, 0x9000 + number))))
    functions = analysis_as_dict(analysed(talk.packets()))["functions"]
    assert isinstance(functions, list)
    row = functions[-1]
    assert (row["code"], row["name"], row["total"]) == (None, "S7comm-plus unknown function", 300)


@pytest.mark.parametrize(
    "octets",
    [
        RESPONSE_V3,
        NOTIFICATION_V3,
        framed(asked(1, INIT_SSL, body=b"abc")),
        framed(asked(1, body=bodies.get_multi(LEVEL, WORD)), 3),
        framed(asked(1, CREATE_OBJECT, body=bodies.create_object(3, FIVE, TYPE, integrity_id=7)), 3),
        event(5, b"x"),
        KEEP_ALIVE,
    ],
)
def test_a_tree_covers_every_octet(octets: bytes) -> None:
    packet = dt(octets)
    lines = list(plus_tree_lines(parse_plus(octets), packet))
    covered: set[int] = set()
    for line in lines[: lines.index("")]:
        where = "".join(line.split()[:1])
        if where and where.replace("-", "").isdigit():
            first, _, last = where.partition("-")
            covered |= set(range(int(first), int(last or first) + 1))
    assert covered == set(range(len(packet)))
    assert not [line for line in lines if "MALFORMED" in line]


def test_a_tree_of_several_frames_and_of_a_part() -> None:
    joined = framed(told(5, body=bytes(100)), 3, trailer=False) + framed(b"more", 3)
    lines = list(plus_tree_lines(parse_plus(joined), b""))
    assert lines[0].startswith("    reassembled from several frames or fragments; offsets count from")
    assert any(line.split() == ["data", "114", "bytes", "in", "2", "frames"] for line in lines)
    assert "    S7comm-plus trailer" in lines
    cut = list(plus_tree_lines(parse_plus(framed(asked(1))[:-4], cut=True), b""))
    assert cut[0].startswith("    the end is missing")
    assert "    S7comm-plus trailer" not in cut


def test_contents_that_were_read_are_not_read_again() -> None:
    """A line and a tree take them as they are given: those of another PDU here."""
    pdu = parse_plus(framed(asked(1, body=bodies.get_multi(LEVEL)), 3))
    other = parse_plus(framed(asked(1, body=bodies.get_multi(WORD)), 3))
    connection = Connection(1, TcpConnection(Endpoint(b"\n\0\0\1", 50000), Endpoint(b"\n\0\0\2", 102), 0, 1, 0))
    own, others = shown_contents(pdu), shown_contents(other)
    lines = [plus_line(pdu, connection, Clock(), PLACES, contents) for contents in (None, own, others)]
    assert lines[0] == lines[1] != lines[2]
    trees = [list(plus_tree_lines(pdu, b"", contents=contents)) for contents in (None, own, others)]
    assert trees[0] == trees[1] != trees[2]


@given(st.binary(max_size=70), st.booleans())
def test_any_octets(octets: bytes, cut: bool) -> None:
    pdu = parse_plus(b"\x72" + octets, cut=cut)
    lines = [*plus_tree_lines(pdu, b""), *plus_notes(pdu)]
    assert not [line for line in lines if UNSAFE.search(line)]
    assert json.loads(head_json(pdu))["kind"] == pdu.kind


def test_shared_captures_hold_the_contract(corpus: Path) -> None:
    lines = TransactionLines()
    run = Run((str(corpus / "s7comm_and_s7commplus_sll.pcap"),), lines)
    while run.step():
        pass
    told_of = [json.loads(line) for line in lines.take()]
    plus = [line for line in told_of if line.get("protocol") == "s7comm_plus"]
    assert len(plus) == 8 + 26 + 79
    assert [complaint for line in plus for complaint in complaints("transaction", line, exact=True)] == []
    assert sum(line["function"]["code"] == GET_MULTI for line in plus) == 6


def test_the_hex_view_of_a_huge_pdu_ends_and_says_so() -> None:
    data = asked(1, 0x0500) + bytes(MAX_HEX + 1000)
    frames = [data[at : at + 60000] for at in range(0, len(data), 60000)]
    octets = b"".join([framed(frame, 2, trailer=frame is frames[-1]) for frame in frames])
    lines = list(plus_tree_lines(parse_plus(octets), b""))
    assert lines[-1].strip() == f"{len(octets) - MAX_HEX} more bytes left out of this view"
    assert len(lines) < MAX_HEX // 16 + 100
    small = list(plus_tree_lines(parse_plus(framed(asked(1))), b""))
    assert not any("left out" in line for line in small)


def test_one_way_requests_are_no_pushes() -> None:
    """The report says both apart, and each row of a function adds up."""
    talk = Conversation()
    talk.hello()
    talk.connect()
    for number in range(3):
        talk.ask(framed(asked(number + 1, SET_VARIABLE, flags=0x74), 3))
    talk.tell(framed(notified(), 3))
    talk.tell(framed(told(9), 3))
    talk.tell(event(0))
    talk.wait(2 * SECOND)
    talk.close()
    analysis = Analysis()
    for transaction in talk.transactions:
        analysis.transaction(transaction)
    analysis.connection_closed(talk.connections[0])
    lines = report(analysis)
    said = "0 answered, 1 answer without request, 1 push, 3 one-way requests"
    assert [line for line in lines if said in line] == [
        f"     6 PDUs, {said}, 1 system event; closed by the client at packet 12",
        f"Transactions: {said}",
    ]
    assert [" ".join(line.split()) for line in section(lines, "Transactions")] == [
        "function count errors no answer no request pushes one-way median 95 % max",
        "S7comm-plus SetVariable 3 . . . . 3 - - -",
        "S7comm-plus GetMultiVariables 1 . . 1 . . - - -",
        "S7comm-plus notification 1 . . . 1 . - - -",
    ]
    assert (analysis.unsolicited, analysis.one_way) == (4, 3)
