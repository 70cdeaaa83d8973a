"""CSV: a row for each item, every value whole, the columns of the transaction the same in each of its rows."""

from __future__ import annotations

import csv
import io
import json
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.observer import Observer
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import TransactionFeed
from dissect.meaning.report.writers.csv import CSV_COLUMNS, CsvRows, CsvWriter, quoted
from dissect.packets.source.packet import SourceFile
from dissect.protocols.s7.singles import real
from tests.cli.support import run
from tests.meaning.report.support import ROOT, WORD, begun, observed, read, transactions
from tests.properties import messages
from tests.properties.messages import Item, dt

ONE = Places([SourceFile("one.pcap", 1)], False)
SEVERAL = Places([SourceFile("one.pcap", 1), SourceFile("two.pcap", 9)], True)


def rows(transaction: Transaction, places: Places = ONE) -> list[dict[str, str]]:
    made = CsvRows(places)
    lines = made.lines(transaction)
    assert made.octets(transaction).decode().split("\n") == lines
    return [dict(zip(made.columns(), row, strict=True)) for row in csv.reader(lines)]


class BothWays(Observer):
    """Has each transaction written both ways by one `CsvRows`, as a run does."""

    def __init__(self) -> None:
        super().__init__()
        self.made = CsvRows(ONE)
        self.several = 0

    def transaction(self, transaction: Transaction) -> None:
        lines = CsvRows(ONE).lines(transaction)
        assert self.made.octets(transaction) == "\n".join(lines).encode()
        self.several += len(lines) > 1


def test_octets_are_lines_with_all_that_is_kept_from_transactions_before() -> None:
    several = 0
    for path in sorted((ROOT / "captures").rglob("*.pcapng")):
        both = BothWays()
        run = Run([path], both)
        while run.step():
            pass
        several += both.several
    assert several > 50


def test_a_read_of_one_item() -> None:
    told = transactions(read(read(begun(), 1), 2, WORD, 0x0A).packets())
    assert rows(told[1]) == [
        {
            "number": "2",
            "connection": "1",
            "asked_by": "10.0.0.1:49152",
            "answered_by": "10.0.0.2:102",
            "pdu_ref": "1",
            "rosctr": "1",
            "function": "4",
            "function_name": "Read Var",
            "request_frame": "8",
            "response_frame": "9",
            "request_time": "2024-03-04T05:06:07.007000000Z",
            "response_time": "2024-03-04T05:06:07.008000000Z",
            "latency_ns": "1000000",
            "outcome": "answered",
            "reason": "",
            "certainty": "sure",
            "doubt": "",
            "item": "1",
            "address": "DB10.DBW4",
            "name": "",
            "return_code": "255",
            "result": "Success",
            "value": "1234",
            "value_text": "",
            "unit": "",
            "octets": "04d2",
            "errors": "",
            "subject": "",
        }
    ]
    (refused,) = rows(told[2])
    assert (refused["return_code"], refused["result"], refused["value"]) == ("10", "Object does not exist", "")
    assert refused["errors"] == "item 1: 0x0a Object does not exist"


def test_each_item_has_a_row_and_its_own_error() -> None:
    items = [Item(0x02, 1, 1, 0x84, 8 * number) for number in range(20)]
    talk = begun().send(0, dt(messages.read_job(1, items)))
    talk.send(1, dt(messages.read_answer(1, items, [*[b"\x07"] * 19, 0x05])))
    told = rows(transactions(talk.packets())[1])
    assert [row["item"] for row in told] == [str(number) for number in range(1, 21)]
    assert [row["address"] for row in told] == [f"DB1.DBB{number}" for number in range(20)]
    assert [row["value"] for row in told] == ["7"] * 19 + [""]
    assert [row["errors"] for row in told] == [""] * 19 + ["item 20: 0x05 Invalid address"]
    assert len({tuple(list(row.values())[:15]) for row in told}) == 1


def test_a_long_value_is_whole() -> None:
    many = Item(0x02, 200, 1, 0x84, 0)
    octets = bytes(range(200))
    talk = begun().send(0, dt(messages.read_job(1, [many]))).send(1, dt(messages.read_answer(1, [many], [octets])))
    (told,) = rows(transactions(talk.packets())[1])
    assert told["octets"] == octets.hex()
    assert (told["value"], told["value_text"]) == (octets.hex(" "), "")
    assert "…" not in "".join(told.values())


@pytest.mark.parametrize(
    ("octets", "text"),
    [
        (b"Pump\x00\x00", "Pump"),
        (b"\x0a\x05Valve\x00", "Valve"),  # an S7 STRING
        (b"=SUM(A1)", "'=SUM(A1)"),  # no formula for a spreadsheet
        (b"\x14\x15", ""),
    ],
)
def test_an_array_of_bytes_is_hexadecimal_with_the_text_that_it_spells(octets: bytes, text: str) -> None:
    item = Item(0x02, len(octets), 1, 0x84, 0)
    talk = begun().send(0, dt(messages.read_job(1, [item]))).send(1, dt(messages.read_answer(1, [item], [octets])))
    (told,) = rows(transactions(talk.packets())[1])
    assert (told["value"], told["value_text"], told["octets"]) == (octets.hex(" "), text, octets.hex())


@given(st.lists(st.text(st.sampled_from("a\",;\r\n='é")), min_size=2, max_size=6))
def test_cells_are_quoted_so_that_a_reader_gets_them_back(cells: list[str]) -> None:
    line = ",".join([quoted(text) for text in cells])
    assert list(csv.reader(io.StringIO(line, newline=""), strict=True)) == [cells]
    expected = io.StringIO(newline="")
    csv.writer(expected).writerow(cells)
    assert line + "\r\n" == expected.getvalue()


def test_singles_are_written_as_json_writes_their_values() -> None:
    numbers = [0.0, -0.0, 1.0, 123.456, 1e7, 1e20, 1.5e-5, 3.4e38, 1e-45, 854.16736, math.inf, -math.inf, math.nan]
    item = Item(0x08, 1, 1, 0x84, 0)
    several = Item(0x08, len(numbers), 1, 0x84, 0)
    asked = [item] * len(numbers) + [several]
    octets = [struct.pack(">f", number) for number in numbers]
    talk = begun().send(0, dt(messages.read_job(1, asked)))
    talk.send(1, dt(messages.read_answer(1, asked, [*octets, b"".join(octets)])))
    said = [json.dumps(real(one)) for one in octets]
    told = rows(transactions(talk.packets())[1])
    assert [row["value"] for row in told] == [*said, f"[{', '.join(said)}]"]


@pytest.mark.parametrize(
    ("item", "octets", "value"),
    [
        (Item(0x03, 6, 1, 0x84, 0), b"Pump_1", "Pump_1"),
        (Item(0x03, 6, 1, 0x84, 0), b"=Pump1", "'=Pump1"),
        (Item(0x03, 6, 1, 0x84, 0), b'Pu"mp,', 'Pu"mp,'),
        (Item(0x03, 3, 1, 0x84, 0), b"-12", "-12"),
        (Item(0x03, 5, 1, 0x84, 0), b"A-=+@", "A-=+@"),  # no formula behind another character
        (Item(0x03, 5, 1, 0x84, 0), b" =A-1", "' =A-1"),  # but behind blanks
        (Item(0x03, 5, 1, 0x84, 0), b"A;=B1", "A;'=B1"),
        (Item(0x03, 4, 1, 0x84, 0), b"\xe4\x00\xa0\x7f", "ä\\x00\xa0\\x7f"),
        (Item(0x13, 3, 1, 0x84, 0), "ä\ue000\u4e00".encode("utf-16-be"), "ä\\ue000\u4e00"),
        (Item(0x13, 2, 1, 0x84, 0), "\uff1d1".encode("utf-16-be"), "'\uff1d1"),
        (Item(0x13, 1, 1, 0x84, 0), b"\xd8\x00", "\ufffd"),
        (Item(0x03, 60, 1, 0x84, 0), b"p" * 60, "p" * 60),
        (Item(0x0C, 1, 1, 0x84, 0), b"\x21\x23", "S5T#2m3s"),
        (Item(0x0C, 1, 1, 0x84, 0), b"\x2f\xff", ""),
        (Item(0x0C, 2, 1, 0x84, 0), b"\x21\x23\x2f\xff", '["S5T#2m3s", null]'),
        (Item(0x0C, 2, 1, 0x84, 0), b"\x2f\xff\x2f\xff", "[null, null]"),
        (Item(0x0B, 1, 1, 0x84, 0), b"\xff\xff\xff\xff", "T#-1ms"),
        (Item(0x0B, 2, 1, 0x84, 0), b"\xff\xff\xff\xff\0\0\0\1", '["T#-1ms", "T#1ms"]'),
    ],
)
def test_texts_and_times(item: Item, octets: bytes, value: str) -> None:
    talk = begun().send(0, dt(messages.read_job(1, [item])))
    talk.send(1, dt(messages.read_answer(1, [Item(0x02, len(octets))], [octets])))
    (told,) = rows(transactions(talk.packets())[1])
    assert (told["value"], told["octets"]) == (value, octets.hex())


@given(st.sampled_from([0x02, 0x03, 0x0B, 0x0C, 0x0F, 0x13]), st.binary(min_size=1, max_size=12))
def test_values_of_any_octets_are_the_same_in_both_ways(kind: int, octets: bytes) -> None:
    size = {0x02: 1, 0x03: 1, 0x0B: 4, 0x0F: 8}.get(kind, 2)
    item = Item(kind, max(1, len(octets) // size), 1, 0x84, 0)
    talk = begun().send(0, dt(messages.read_job(1, [item])))
    talk.send(1, dt(messages.read_answer(1, [Item(0x02, len(octets))], [octets])))
    (told,) = rows(transactions(talk.packets())[1])
    assert told["octets"] == octets.hex()


def test_a_transaction_without_items_says_what_it_is_about() -> None:
    (told,) = rows(transactions(begun().packets())[0])
    assert (told["item"], told["subject"]) == ("", "granted PDU 480, AmQ 1/1")


def test_halves() -> None:
    talk = begun().send(1, dt(messages.read_answer(9, [WORD], [b"\x00\x01"])))
    talk.send(0, dt(messages.pdu(messages.JOB, 2, b"\x1d"))).send(
        1, dt(messages.pdu(messages.ACK, 2, b"", b"", 0x8104))
    )
    talk.send(0, dt(messages.read_job(3, [WORD])))
    found = [row for each in transactions(talk.packets())[1:] for row in rows(each)]
    keys = ("request_frame", "response_frame", "request_time", "response_time", "latency_ns", "outcome", "reason")
    told = {row["outcome"]: [row[key] for key in keys] for row in found}
    assert told["orphan_answer"] == ["", "8", "", "2024-03-04T05:06:07.007000000Z", "", "orphan_answer", ""]
    assert told["unanswered"] == ["11", "", "2024-03-04T05:06:07.010000000Z", "", "", "unanswered", "capture_ended"]
    assert next(row["errors"] for row in found if row["outcome"] == "answered").startswith("header: 0x8104 ")


def test_files_are_named_when_there_are_several() -> None:
    (row,) = rows(transactions(read(begun(), 1).packets())[1], SEVERAL)
    assert (row["request_frame"], row["request_file"]) == ("8", "one.pcap")
    assert (row["response_frame"], row["response_file"]) == ("1", "two.pcap")
    assert CsvRows(ONE).columns() == CSV_COLUMNS
    assert [name for name in CsvRows(SEVERAL).columns() if not name.endswith("_file")] == CSV_COLUMNS


def test_lines_are_rfc_4180() -> None:
    collected = CsvWriter()
    collected.begin(ONE)
    observed(
        TransactionFeed(collected, lambda transaction: transaction.number > 1), read(read(begun(), 1), 2).packets()
    )
    table = list(
        csv.reader(io.StringIO("\n".join([line.decode() for line in collected.take() if isinstance(line, bytes)])))
    )
    assert table[0] == CSV_COLUMNS
    assert [row[0] for row in table[1:]] == ["2", "3"]
    assert collected.take() == []


def test_items_of_s7comm_plus_have_rows_as_they_have_in_json(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """Whole values; what an error names is the number of the item; what creates a subscription says what it is about."""
    path = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
    told = [json.loads(line) for line in run(capfdbinary, "transactions", "-T", "jsonl", path).out.splitlines()]
    made = list(csv.DictReader(io.StringIO(run(capfdbinary, "transactions", "-T", "csv", path).out)))
    kinds = set()
    for transaction in told:
        mine = [row for row in made if row["number"] == str(transaction["number"])]
        items = transaction["items"]
        kinds.add((transaction["function"]["name"], len(items) > 1))
        assert len(mine) == max(1, len(items))
        for row, item in zip(mine, items, strict=False):
            assert (row["item"], row["address"]) == (str(item["number"]), item["address"])
            assert row["return_code"] == ("" if item["return_code"] is None else str(item["return_code"]))
            assert row["octets"] == (item["data"] or "")
            value = None if row["value"] == "" else row["value"]
            assert (json.loads(value) if value and not isinstance(item["value"], str) else value) == item["value"]
            refused = [error for error in transaction["errors"] if error["where"] == f"item {item['number']}"]
            assert row["errors"] == "".join([f"{one['where']}: 0x{one['code']:02x} {one['name']}" for one in refused])
            assert bool(row["subject"]) == (transaction["function"]["name"] == "CreateObject")
    assert {("CreateObject", True), ("notification", True), ("GetMultiVariables", False)} <= kinds
