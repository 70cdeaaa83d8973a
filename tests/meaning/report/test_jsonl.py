from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.pipeline import Options
from dissect.engine.transactions.results import ALIKE, GAPS
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import HOLE, Transaction
from dissect.files.session import Run
from dissect.meaning.report.item_json import decoded_json, item_json, octets_value, write_good_item
from dissect.meaning.report.pdu_json import PduLines
from dissect.meaning.report.writer import TransactionFeed
from dissect.meaning.report.writers.jsonl import JsonlWriter, TransactionLines
from dissect.protocols.s7.items import parse_item
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.tables import SUCCESS
from dissect.protocols.s7.values import Value, decode_value
from dissect.wire.text import Clock
from tests.cases import each
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import OWN, WORD, Kept, begun, observed, read
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Packet, Talk, cut_to
from tests.protocols.s7plus.pdus import asked, framed, told

Line = dict[str, Any]


class Both(Kept):
    """Transactions and their lines, PDUs and theirs."""

    def __init__(self, locate: bool = False) -> None:
        super().__init__()
        self.wants_pdus = True
        self.lines: list[Line] = []
        self.pdus: list[Line] = []
        self._transactions = TransactionLines()
        self._pdus = PduLines()
        if locate:
            self._transactions.locate = two_files
            self._pdus.locate = two_files

    def transaction(self, transaction: Transaction) -> None:
        """Keep a transaction and its line."""
        super().transaction(transaction)
        line = self._transactions.line(transaction)
        if transaction.is_plus:  # what is remembered of others that were alike makes no difference
            alone = TransactionLines()
            alone.locate = self._transactions.locate
            assert line == alone.line(transaction)
        else:
            assert line == self._transactions._any_line(transaction)
        if self._transactions._is_usual(transaction):  # written by another road when compiled
            assert self._transactions._usual(transaction).decode("ascii") == line
        assert self._transactions.octets(transaction) == line.encode("utf-8")
        self.lines.append(parsed(line))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Keep the line of a PDU."""
        number = side.connection.number
        self.pdus.append(
            parsed(self._pdus.line(parse_pdu(octets, frame, time_ns, number, side.index, cut), side.connection))
        )


def two_files(frame: int) -> tuple[str, int]:
    return ("one \u202e\x1b.pcap", frame) if frame < 9 else ("two.pcap", frame - 8)


def parsed(line: str) -> Line:
    """Return a line as an object, if it is one line of ASCII without a key that stands twice."""
    assert line.isascii()
    assert line.isprintable()

    def unique(pairs: list[tuple[str, Any]]) -> Line:
        assert len(dict(pairs)) == len(pairs)
        return dict(pairs)

    found: Line = json.loads(line, object_pairs_hook=unique)
    return found


def both(talk: Talk) -> Both:
    """Return what is told of a talk, held to the schemas."""
    return of_packets(talk.packets())


def of_packets(packets: list[Packet]) -> Both:
    told = Both()
    observed(told, packets)
    for line in told.lines:
        assert complaints("transaction", line, exact=True) == []
    for line in told.pdus:
        assert complaints("pdu", line, exact=True) == []
    return told


# ---- values ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "null"),
        (True, "true"),
        (False, "false"),
        (-5, "-5"),
        (3.5, "3.5"),
        (float("nan"), '"nan"'),
        (float("-inf"), '"-inf"'),
        ('a"\x1b\u202e', '"a\\"\\u001b\\u202e"'),
        ([1, None, "x"], '[1,null,"x"]'),
        ([], "[]"),
    ],
)
def test_decoded_json(value: Value, text: str) -> None:
    assert decoded_json(value) == text


@given(st.integers(0, 255), st.binary(max_size=40))
def test_octets_value_is_the_decoded_value(transport_size: int, octets: bytes) -> None:
    told = json.loads(octets_value(transport_size, octets))
    assert repr(told) == repr(json.loads(decoded_json(decode_value(transport_size, octets))))


#: Characters of which JSON escapes some, surrogates among them, and halves of them.
UNITS = st.lists(st.one_of(st.integers(0, 0x7F), st.integers(0xD7FF, 0xE000), st.integers(0, 0xFFFF)), max_size=6)


@given(
    st.integers(0, 255),
    st.one_of(st.binary(max_size=40), UNITS.map(lambda units: struct.pack(f">{len(units)}H", *units))),
)
def test_good_items_are_written_as_items_are(transport_size: int, octets: bytes) -> None:
    for count in (1, len(octets) // 2, len(octets)):
        item = parse_item(struct.pack(">BBBBHHI", 0x12, 10, 0x10, transport_size, count, 1, 0x84 << 24), 0)
        out = BytesWriter()
        write_good_item(out, item, b"\xff" + octets + b"\xff", 1, len(octets))
        assert out.getvalue().decode("ascii") == item_json(item, SUCCESS, octets)


@given(st.lists(st.binary(min_size=4, max_size=4), min_size=1, max_size=5))
def test_a_real_reads_back_to_its_octets(singles: list[bytes]) -> None:
    told = json.loads(octets_value(0x08, b"".join(singles)))
    for octets, value in zip(singles, told if len(singles) > 1 else [told], strict=True):
        exact = struct.unpack(">f", octets)[0]
        assert isinstance(value, str | float)
        if isinstance(value, str):
            assert value == repr(exact)
        else:
            assert struct.pack(">f", value) == octets


# ---- transactions ---------------------------------------------------------------------------------------------------


def test_a_whole_line() -> None:
    told = both(read(begun(), 0x0102))
    assert told.lines[1] == {
        "schema": "s7dissect.transaction/1",
        "number": 2,
        "connection": 1,
        "asked_by": "10.0.0.1:49152",
        "answered_by": "10.0.0.2:102",
        "pdu_ref": 0x0102,
        "rosctr": 1,
        "function": {"code": 4, "name": "Read Var"},
        "request_frame": 8,
        "response_frame": 9,
        "request_time": "2024-03-04T05:06:07.007000000Z",
        "latency_ns": 1_000_000,
        "outcome": "answered",
        "reason": None,
        "items": [
            {
                "address": "DB10.DBW4",
                "syntax_id": 16,
                "area": 132,
                "db": 10,
                "start_bit": 32,
                "transport_size": 4,
                "count": 1,
                "return_code": 255,
                "data": "04d2",
                "value": 1234,
            }
        ],
        "errors": [],
    }


@pytest.mark.parametrize(
    ("octets", "text"),
    [
        (b"Pump\x00\x00", "Pump"),
        (b"\x0a\x05Valve\x00", "Valve"),  # an S7 STRING
        (b'"\\' * 40, '"\\' * 40),  # whole, and escaped
        (b"Pump\x7f", None),
        (b"abc", None),  # too short to mean anything
        (b"\x14\x15", None),
    ],
)
def test_an_array_of_bytes_has_the_text_that_it_spells(octets: bytes, text: str | None) -> None:
    item = Item(0x02, len(octets), 1, 0x84, 0)
    talk = read(begun(), 1, item, octets).send(0, dt(messages.write_job(2, [item], [octets])))
    told = both(talk)
    (read_item,) = told.lines[1]["items"]
    assert (read_item["data"], read_item["value"]) == (octets.hex(), list(octets))
    assert read_item.get("text") == text
    (written,) = told.pdus[-1]["data_items"]
    assert (written["value"], written.get("text")) == (list(octets), text)


def test_numbers_of_packets_are_whole() -> None:
    transaction = both(read(begun(), 1)).transactions[1]
    lines = TransactionLines()
    for frame in (1, 998, 999, 1000, 1000, 1999, 999_999, 1_000_000, 123_456_789_012, 5):
        transaction.request_frame = frame
        transaction.response_frame = frame + 1
        told = parsed(lines.line(transaction))
        assert (told["request_frame"], told["response_frame"]) == (frame, frame + 1)


def test_a_refused_write_keeps_what_was_to_be_written() -> None:
    talk = begun().send(0, dt(messages.write_job(2, [WORD], [b"\x00\x07"])))
    talk.send(1, dt(messages.write_answer(2, [0x0A])))
    (item,) = both(talk).lines[1]["items"]
    assert (item["return_code"], item["data"], item["value"]) == (0x0A, "0007", 7)


def test_keys_stand_in_one_order() -> None:
    keys = [list(line) for line in both(read(read(begun(), 1), 2, WORD, 0x0A)).lines[1:]]
    assert keys[0] == keys[1]


def test_a_setup_tells_what_was_asked_and_granted() -> None:
    talk = begun(length=960)
    (line,) = both(talk).lines
    values = {"max_amq_calling": 1, "max_amq_called": 1, "pdu_length": 960}
    assert line["setup"] == {"asked": values, "granted": values}


def test_halves() -> None:
    talk = begun().send(1, dt(messages.read_answer(9, [WORD], [b"\x00\x01"])))
    talk.send(1, dt(messages.userdata(0, 0, 4, 3, b"12345678")))
    talk.send(0, dt(messages.read_job(3, [WORD]))).reset(1)
    told = {line["outcome"]: line for line in both(talk).lines}
    orphan, push, unanswered = told["orphan_answer"], told["unsolicited"], told["unanswered"]
    for half in (orphan, push):
        assert half["request_frame"] is None
        assert half["request_time"] is None
        assert half["latency_ns"] is None
    assert orphan["response_frame"] == 8
    assert orphan["response_time"] == "2024-03-04T05:06:07.007000000Z"
    assert orphan["items"][0]["address"] is None
    assert (orphan["items"][0]["return_code"], orphan["items"][0]["data"]) == (255, "0001")
    assert push["response_time"] == "2024-03-04T05:06:07.008000000Z"
    assert push["userdata"]["subfunction_name"] == "diagnostic message"
    assert (unanswered["response_frame"], unanswered["latency_ns"]) == (None, None)
    assert unanswered["reason"] == "connection_closed"
    assert unanswered["items"][0]["return_code"] is None
    assert "response_time" not in unanswered


def test_errors_stand_in_wire_order() -> None:
    items = [WORD, Item(0x02, 1, 99, 0x84, 0), WORD]
    talk = begun().send(0, dt(messages.read_job(1, items)))
    talk.send(1, dt(messages.read_answer(1, items, [0x05, b"\x00", 0x77])))
    talk.send(0, dt(messages.userdata(2, 1, 4, 1, b"\x00\x11\x00\x00")))
    talk.send(1, dt(messages.userdata(2, 2, 4, 1, b"", 0xD402)))
    talk.send(0, dt(messages.pdu(messages.JOB, 3, b"\x1d"))).send(
        1, dt(messages.pdu(messages.ACK, 3, b"", b"", 0x8104))
    )
    _, refused, szl, job = both(talk).lines
    assert [(error["where"], error["code"], error["name"]) for error in refused["errors"]] == [
        ("item 1", 0x05, "Invalid address"),
        ("item 3", 0x77, "0x77"),
    ]
    assert [(error["where"], error["code"]) for error in szl["errors"]] == [("parameter", 0xD402)]
    assert [(error["where"], error["code"]) for error in job["errors"]] == [("header", 0x8104)]
    assert all(error["text"] for error in (*szl["errors"], *job["errors"]))


def test_several_bits_are_one_value_each_only_where_each_has_its_octet() -> None:
    bits = Item(0x01, 3, 0, 0x83, 0)
    talk = begun()
    for ref, data in ((1, b"\xff\x03\x00\x03\x01\x00\x01"), (2, b"\xff\x03\x00\x03\x05")):
        talk.send(0, dt(messages.read_job(ref, [bits]))).send(
            1, dt(messages.pdu(messages.ACK_DATA, ref, b"\x04\x01", data))
        )
    told = both(talk)
    for line, transaction in zip(told.lines, told.transactions, strict=True):
        assert [item["value"] for item in line["items"]] == [result.value for result in transaction.s7_results]
    assert told.lines[2]["items"][0]["value"] is None


def test_what_another_syntax_asks_for_is_kept_as_octets() -> None:
    job = messages.pdu(messages.JOB, 1, b"\x04\x01\x12\x08\xb0\x01\x00\x02\x00\x03\x00\x04")
    (item,) = both(begun().send(0, dt(job))).lines[1]["items"]
    assert item["syntax_id"] == 0xB0
    assert item["address"].endswith(":01000200030004")
    assert {item[key] for key in ("area", "db", "start_bit", "transport_size", "count")} == {None}


def test_only_chosen_transactions_have_lines() -> None:
    lines = JsonlWriter()
    observed(
        TransactionFeed(lines, lambda transaction: transaction.failed),
        read(read(begun(), 1), 2, WORD, 0x0A).packets(),
    )
    assert [parsed(str(line, "ascii"))["pdu_ref"] for line in lines.take() if isinstance(line, bytes)] == [2]
    assert lines.take() == []


def test_files_are_named_when_there_are_several() -> None:
    told = Both(locate=True)
    observed(told, read(read(begun(), 1), 2).send(0, dt(messages.read_job(3, [WORD]))).packets())
    places = [[line[key] for key in ("request_frame", "response_frame")] for line in told.lines]
    names = [[line[key] for key in ("request_file", "response_file")] for line in told.lines]
    one, two = "one \u202e\x1b.pcap", "two.pcap"
    assert places == [[6, 7], [8, 1], [2, 3], [4, None]]
    assert names == [[one, one], [one, two], [two, two], [two, None]]
    assert [(line["file"], line["frame"]) for line in told.pdus] == [
        (one, 6),
        (one, 7),
        (one, 8),
        (two, 1),
        (two, 2),
        (two, 3),
        (two, 4),
    ]
    assert complaints("transaction", told.lines[1], exact=True) == []
    assert complaints("pdu", told.pdus[1], exact=True) == []


# ---- PDUs -----------------------------------------------------------------------------------------------------------


def test_a_whole_pdu() -> None:
    told = both(read(begun(), 0x0102))
    head = {"schema": "s7dissect.pdu/1", "connection": 1, "protocol": "s7comm", "redundancy_id": 0, "pdu_ref": 0x0102}
    item = {
        "address": "DB10.DBW4",
        "syntax_id": 16,
        "area": 132,
        "db": 10,
        "start_bit": 32,
        "transport_size": 4,
        "count": 1,
    }
    assert told.pdus[2] == head | {
        "frame": 8,
        "time": "2024-03-04T05:06:07.007000000Z",
        "src": "10.0.0.1:49152",
        "dst": "10.0.0.2:102",
        "rosctr": 1,
        "rosctr_name": "Job",
        "param_length": 14,
        "data_length": 0,
        "error_class": None,
        "error_code": None,
        "function": {"code": 4, "name": "Read Var"},
        "item_count": 1,
        "items": [item],
        "cut": False,
        "malformed": [],
    }
    assert told.pdus[3] == head | {
        "frame": 9,
        "time": "2024-03-04T05:06:07.008000000Z",
        "src": "10.0.0.2:102",
        "dst": "10.0.0.1:49152",
        "rosctr": 3,
        "rosctr_name": "Ack_Data",
        "param_length": 2,
        "data_length": 6,
        "error_class": 0,
        "error_code": 0,
        "function": {"code": 4, "name": "Read Var"},
        "item_count": 1,
        "data_items": [{"return_code": 255, "transport_size": 4, "length": 16, "data": "04d2"}],
        "cut": False,
        "malformed": [],
    }


def test_what_a_pdu_carries() -> None:
    talk = begun()
    items = [WORD, Item(0x01, 1, 0, 0x83, 81)]
    talk.send(0, dt(messages.write_job(1, items, [b"\x00\x07", b"\x01"]))).send(
        1, dt(messages.write_answer(1, [255, 10]))
    )
    talk.send(0, dt(messages.pdu(messages.JOB, 2, b"\x28" + bytes(8), b"ab")))
    talk.send(0, dt(messages.userdata(3, 1, 4, 1, b"\x00\x11\x00\x00")))
    write, answer, service, szl = both(talk).pdus[2:]
    assert [item["value"] for item in write["data_items"]] == [7, True]
    assert [item["data"] for item in write["data_items"]] == ["0007", "01"]
    assert answer["return_codes"] == [255, 10]
    assert (service["parameters"], service["data"]) == ("28" + "00" * 8, b"ab".hex())
    assert szl["userdata"]["group_name"] == "CPU functions"
    assert szl["data"] == "ff09000400110000"


def test_a_malformed_pdu_tells_why_and_keeps_its_octets() -> None:
    octets = bytearray(messages.read_job(1, [WORD]))
    octets[7] = 99
    line = both(begun().send(0, dt(bytes(octets)))).pdus[2]
    assert [(fact["field"], fact["reason"]) for fact in line["malformed"]] == [("param_length", "length_beyond")]
    assert line["octets"] == octets.hex()


def test_a_malformed_payload_tells_why() -> None:
    line = both(begun().send(0, dt(messages.userdata(1, 1, 7, 2, b"\0\x20\x24")))).pdus[2]
    assert [(fact["field"], fact["reason"], fact["offset"]) for fact in line["malformed"]] == [
        ("clock", "too_short", 22)
    ]
    assert line["data"] == "ff090003002024"


@pytest.mark.parametrize("kept", [10, 11, 12, 20])
def test_a_cut_pdu_says_so_and_invents_nothing(kept: int) -> None:
    packets = begun().send(0, dt(messages.read_job(0x0102, [WORD]))).packets()
    octets = packets[-1].octets[54 + 7 :]
    packets[-1] = cut_to(packets[-1], 54 + 7 + kept)
    line = of_packets(packets).pdus[2]
    assert line["cut"] is True
    assert line["octets"] == octets[:kept].hex()
    assert (line["rosctr"], line["pdu_ref"], line["param_length"]) == (1, 0x0102, 14)


def test_a_header_that_is_not_all_there_is_null() -> None:
    line = both(begun().send(0, dt(b"\x32\x01\x00\x00\x00\x07"))).pdus[2]
    assert line["rosctr"] == 1
    assert {line[key] for key in ("redundancy_id", "pdu_ref", "param_length", "data_length", "error_class")} == {None}
    assert line["function"] == {"code": None, "name": None}


# ---- on captures ----------------------------------------------------------------------------------------------------


@each("path", OWN)
def test_lines_say_what_the_objects_say(path: Path) -> None:
    check(path)


def test_lines_say_what_the_objects_say_on_shared_captures(corpus: Path) -> None:
    for path in sorted(corpus.glob("*.pcap*")):
        check(path)


def check(path: Path) -> None:
    """Hold every line of a capture to the objects it was made from."""
    told = Both()
    run = Run([str(path)], told, Options(strict=True))
    while run.step():
        pass
    assert len(told.pdus) == run.pipeline.s7.pdus
    for line, transaction in zip(told.lines, told.transactions, strict=True):
        assert line["outcome"] == transaction.outcome
        assert line["latency_ns"] == transaction.latency_ns
        assert line["errors"] == [error.as_dict() for error in transaction.errors]
        if transaction.is_plus:
            continue  # tests/meaning/report/test_plus.py
        results = transaction.s7_results
        assert len(line["items"]) == len(results)
        for item, result in zip(line["items"], results, strict=True):
            assert item["data"] == (None if result.data is None else result.data.hex())
            assert item["return_code"] == (None if result.return_code < 0 else result.return_code)
            assert json.dumps(item["value"]) == json.dumps(json.loads(decoded_json(result.value)))
            if item["value"] is not None:
                assert item["value"] == json.loads(
                    decoded_json(decode_value(item["transport_size"], bytes.fromhex(item["data"])))
                )


@pytest.mark.parametrize("locate", [False, True])
@pytest.mark.parametrize("plus", [False, True])
def test_a_request_that_tcp_sent_again(plus: bool, locate: bool) -> None:
    """In lines of both protocols, with the packet as the others have it; no other transaction has the key."""
    talk = begun()
    if plus:
        talk.send(0, dt(framed(asked(5)))).send(1, dt(framed(told(5))))
    else:
        read(talk, 5)
    talk.segments.insert(-1, talk.segments[-2])
    found = Both(locate)
    observed(found, talk.packets(step_ns=300_000_000))
    line = found.lines[-1]
    assert complaints("transaction", line, exact=True) == []
    where = {"frame": 1, "file": "two.pcap"} if locate else {"frame": 9}
    assert line["sent_again"] == {"times": 1, "after_ns": 300_000_000} | where
    assert not any("sent_again" in other for other in found.lines[:-1])


@pytest.mark.parametrize("locate", [False, True])
@pytest.mark.parametrize("plus", [False, True])
@pytest.mark.parametrize(("flag", "doubt"), [(GAPS, "gaps"), (ALIKE, "alike")])
def test_a_pair_that_is_only_likely(plus: bool, locate: bool, flag: int, doubt: str) -> None:
    """It has the time of its answer, as it has no answer time by which that could be found."""
    talk = begun()
    if plus:
        talk.send(0, dt(framed(asked(5)))).send(1, dt(framed(told(5))))
    else:
        read(talk, 5)
    found = Both(locate)
    observed(found, talk.packets())
    transaction, sure = found.transactions[-1], found.lines[-1]
    assert not {"certainty", "doubt", "response_time"} & sure.keys()
    transaction._flags |= flag
    found.transaction(transaction)
    line = found.lines[-1]
    assert complaints("transaction", line, exact=True) == []
    clock = Clock()
    assert line == sure | {
        "certainty": "likely", "doubt": doubt, "latency_ns": None, "response_time": clock.iso(transaction.response_ns),
    }  # fmt: skip


@pytest.mark.parametrize("write", [False, True])
def test_a_setup_or_a_write_that_is_only_likely(write: bool) -> None:
    talk = begun()
    if write:
        talk.send(0, dt(messages.write_job(1, [WORD], [b"\x00\x01"]))).send(1, dt(messages.write_answer(1, [0xFF])))
    found = Both()
    observed(found, talk.packets())
    transaction, sure = found.transactions[-1], found.lines[-1]
    transaction._flags |= ALIKE
    found.transaction(transaction)
    line = found.lines[-1]
    assert complaints("transaction", line, exact=True) == []
    assert {key for key in line if line[key] != sure.get(key)} == {"certainty", "doubt", "latency_ns", "response_time"}


def test_an_answer_that_was_not_captured_says_perhaps() -> None:
    talk = begun().send(0, dt(messages.read_job(1, [WORD])))
    found = Both()
    observed(found, talk.packets())
    transaction = found.transactions[-1]
    transaction.reason = HOLE
    found.transaction(transaction)
    transaction._flags |= GAPS
    found.transaction(transaction)
    sure, perhaps = found.lines[-2:]
    assert (sure["reason"], "certainty" in sure) == ("hole", False)
    assert perhaps == sure | {"certainty": "likely"}
    assert complaints("transaction", perhaps, exact=True) == []
