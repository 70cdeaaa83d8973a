"""What reports say of SCD: lines, the field tree, JSON."""

from __future__ import annotations

import csv
import json
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.bindings.binding import Binding, Bindings
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.pdu_json import PduLines
from dissect.meaning.report.scd import scd_as_dict, scd_json, scd_subject, scd_summary
from dissect.meaning.report.scd_tree import scd_tree_lines
from dissect.meaning.report.text import analysis_lines
from dissect.meaning.report.words import Places
from dissect.meaning.report.writers.csv import CSV_COLUMNS, CsvRows
from dissect.meaning.report.writers.text import scd_line, transaction_line
from dissect.packets.source.packet import SourceFile
from dissect.wire.text import Clock
from tests.engine.transactions.talk import CLIENT, SERVER, Talk, ack_data, good, item, read
from tests.meaning.bindings import plant
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import UNSAFE

ALONE: Final = Places([], False)


def listening() -> Talk:
    talk = Talk()
    talk.carry(plant.carrier())
    talk.wants_pdus = True
    return talk


def exchange(asked: bytes, answer: bytes) -> Transaction:
    talk = listening()
    talk.datagram(CLIENT, asked)
    talk.datagram(SERVER, answer)
    return talk.transactions[-1]


def sent(octets: bytes, side: int = SERVER, ports: tuple[int, int] = (49200, plant.MESSAGES)) -> Transaction:
    talk = listening()
    talk.datagram(side, octets, ports)
    talk.pipeline.finish()
    return talk.transactions[-1]


def line(transaction: Transaction) -> str:
    """The line from the function on."""
    text = transaction_line(transaction, Clock(), ALONE)
    return text[text.index("SCD ") :]


@pytest.mark.parametrize(
    ("asked", "answer", "said"),
    [
        (plant.ask("Давление 1"), plant.tell("Давление 1", 2748), "SCD read  0x6001:0 Давление 1 = 1374 кПа"),
        (plant.ask("Режим 1", 8), plant.tell("Режим 1"), "SCD write  0x6061:0 Режим 1 = 8 (автомат)"),
        (
            plant.ask("Давление 1", 100),
            plant.refuse("Давление 1", -4, service="write"),
            "SCD write  REFUSED abort -4: write of a read-only object  0x6001:0 Давление 1 = 50 кПа [access]",
        ),
        (
            plant.ask("Режим 1", 8),
            plant.tell("Режим 1", err=-19),
            "SCD write  REFUSED error -19: refused in this state of the device  0x6061:0 Режим 1 = 8 (автомат)",
        ),
        (
            plant.ask("0x6fff"),
            plant.refuse("0x6fff", -5),
            "SCD read  REFUSED abort -5: no such object  0x6fff:0  NOT DECODED E_INDEX no object 0x6fff",
        ),
        (
            plant.ask("Расход 1"),
            plant.tell("Расход 2", 5),
            "SCD read  MISMATCH (the answer names a different object)  0x6044:0 Расход 1 → 0x6844:0 Расход 2 = 5",
        ),
    ],
)
def test_an_exchange_on_a_line(asked: bytes, answer: bytes, said: str) -> None:
    assert line(exchange(asked, answer)) == said


def test_the_text_of_errors_is_that_of_the_dictionary() -> None:
    refused = exchange(plant.ask("Режим 1", 8), plant.tell("Режим 1", err=-19))
    assert refused.errors[0].text == plant.dictionary().error_text(-19)


def test_a_pdo_on_a_line_goes_from_its_sender() -> None:
    for side, name, ends in (
        (SERVER, "T1", "10.0.0.2:5600 → 10.0.0.1:49200"),
        (CLIENT, "T65", "10.0.0.1:49200 → 10.0.0.2:5600"),
    ):
        assert ends in transaction_line(sent(plant.pdo(name), side), Clock(), ALONE)
    assert line(sent(plant.pdo("T1", 0, 0, **{"Режим 1": 8}))) == (
        "SCD PDO T1  push  Состояние 1  Слово состояния 1 = 0, Расход 1 = 0, Режим 1 = 8 (автомат)"
    )
    assert line(sent(plant.pdo(err=-16))).endswith("Режим 1 = 0 (стоп)  err -16 hardware error")


def test_a_message_on_a_line() -> None:
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Давление 1", 100, 9))
    talk.datagram(SERVER, plant.refuse("Давление 1", -4, 9, "write"))
    talk.datagram(SERVER, plant.pdo()[:9])
    assert [scd_summary(found) for found in talk.messages] == [
        "SCD request   tid 9    write 0x6001:0 Давление 1 = 50 кПа [access]",
        "SCD abort     tid 9    write 0x6001:0 Давление 1  err -4 write of a read-only object  [access]",
        "SCD data      message  NOT DECODED E_SHORT 9 bytes, the header has 10",
    ]
    first = talk.messages[0]
    connection = talk.transactions[0].connection
    assert scd_line(first, connection, Clock(), ALONE).split()[:7] == [
        "1", "2020-09-13", "12:26:40.001000", "UTC", "10.0.0.1:49200", "→", "10.0.0.2:5600",
    ]  # fmt: skip


def polled() -> Transaction:
    talk = listening()
    talk.open()
    talk.ask(read(1, item(0x84, 10, 0, 2, 15)))
    talk.tell(ack_data(1, b"\x04\x01", good(4, bytes.fromhex("01C8050000000000 37020000000008"))))
    return talk.transactions[-1]


def test_contents_of_an_item_stand_behind_it() -> None:
    assert scd_subject(polled()) == (
        "SCD насос в DB10: pump_t  run = true, fault = false, speed = 1480 об/мин; "
        "SCD состояние в DB10: PDO T1 Состояние 1  Слово состояния 1 = 567, Расход 1 = 0, Режим 1 = 8 (автомат)"
    )
    assert [scd_summary(found).partition("  in ")[2] for found in polled().scd] == ["DB10.DBB0", "DB10.DBB0"]


def rows(transaction: Transaction) -> list[dict[str, str]]:
    return [dict(zip(CSV_COLUMNS, row, strict=True)) for row in csv.reader(CsvRows(ALONE).lines(transaction))]


def test_csv_rows() -> None:
    (told,) = rows(exchange(plant.ask("Давление 1", 100, 9), plant.refuse("Давление 1", -4, 9, "write")))
    assert (told["pdu_ref"], told["rosctr"], told["function"], told["function_name"]) == ("9", "", "", "SCD write")
    assert [told[key] for key in ("address", "name", "result", "value", "unit")] == [
        "0x6001:0",
        "Давление 1",
        "access",
        "50.0",
        "кПа",
    ]
    assert told["errors"] == "message: abort -4: write of a read-only object"
    (bare, *_) = rows(sent(bytes.fromhex("C1AB24FA"), ports=(49200, plant.BARE)))
    assert (bare["pdu_ref"], bare["outcome"]) == ("", "unsolicited")


def test_values_in_items_have_rows_behind_them() -> None:
    told = rows(polled())
    items = [row for row in told if row["octets"]]
    values = [row for row in told if row["name"]]
    assert told == items + values
    assert [(row["name"], row["value"], row["value_text"]) for row in values][-1] == ("Режим 1", "8", "автомат")
    assert len(values) == 6


# ---- the tree -------------------------------------------------------------------------------------------------------


def tree(found: ScdMessage) -> list[str]:
    return [text.strip() for text in scd_tree_lines(found)]


def test_every_field_with_its_octets() -> None:
    """Profile 3.3, TPDU 1: DC 10 2A 00 00 1A 00 00 07 00 37 02 18 FC FF FF 08 BB 4D."""
    octets = bytes.fromhex("DC102A00001A0000 0700 370218FCFFFF08 BB4D")
    assert tree(sent(octets).scd[0]) == [
        "SCD message, binding обмен",
        "0  protocol         0xdc",
        "1  kind             0x10 pdo",
        "1  abort            0",
        "1  response         0",
        "2  tid              42",
        "3  err              0 good",
        "4-5  index            0x1a00",
        "6  sub              0",
        "7  port             0",
        "8-9  size             7",
        "10-11  0x6041:0         Слово состояния 1 = 567, bits 0 to 15",
        "12-15  0x6044:0         Расход 1 = -1000, bits 16 to 47",
        "16  0x6061:0         Режим 1 = 8 (автомат), bits 48 to 55",
        "17-18  crc              0x4dbb",
        "",
        "0  dc 10 2a 00 00 1a 00 00  07 00 37 02 18 fc ff ff  ..*.......7.....",
        "16  08 bb 4d                                          ..M",
        "",
    ]


def test_bits_of_a_bare_pdo() -> None:
    found = sent(bytes.fromhex("C1AB24FA"), ports=(49200, plant.BARE)).scd[0]
    assert tree(found)[:5] == [
        "SCD bare T2, binding насос и давление",
        "0  0x6000:1         Насос 1.run = true, bit 0",
        "0  0x6000:2         Насос 1.fault = false, bit 1",
        "0-1  0x6001:0         Давление 1 = 1374 кПа, raw 2748, bits 4 to 15",
        "2-3  0x6000:4         Насос 1.speed = -1500 об/мин, bits 16 to 31",
    ]


def test_places_are_those_of_the_mapping_it_was_sent_with() -> None:
    talk = listening()
    for tid, (sub, value) in enumerate(((0, 0), (1, plant.entry("Режим 1", 8, 0)), (0, 1))):
        talk.datagram(CLIENT, plant.ask(f"0x1a00:{sub}", value, tid))
        talk.datagram(SERVER, plant.tell(f"0x1a00:{sub}", tid=tid))
    talk.datagram(SERVER, plant.codec().envelope.build({"kind": 0x10, "index": 0x1A00}, b"\x08"))
    assert tree(talk.messages[-1])[11] == "10  0x6061:0         Режим 1 = 8 (автомат)"


def test_an_offset_and_a_struct() -> None:
    pump, state = polled().scd
    assert tree(pump)[:4] == [
        "SCD bare pump_t, binding насос в DB10",
        "0  pump_t.run       run = true, bit 0",
        "0  pump_t.fault     fault = false, bit 1",
        "1-2  pump_t.speed     speed = 1480 об/мин, bits 8 to 23",
    ]
    assert tree(state)[0] == "SCD bare T1, binding состояние в DB10, from byte 8 of DB10.DBB0 on"


@pytest.mark.parametrize(
    ("octets", "lines"),
    [
        (plant.pdo()[:12], ["10-11  data             00 00", "MALFORMED  E_SHORT envelope: 12 bytes of 19"]),
        (b"\xdc\x02", ["0-1  data             dc 02"]),
        (plant.ask("0x6fff"), ["MALFORMED  E_INDEX 0x6fff: no object 0x6fff"]),
        (plant.ask("Давление 1", 100), ["odd        access", "10-11  0x6001:0         Давление 1 = 50 кПа [access], raw 100"]),
    ],
)  # fmt: skip
def test_what_is_wrong_stands_in_the_tree(octets: bytes, lines: list[str]) -> None:
    talk = listening()
    talk.datagram(CLIENT, octets)
    told = tree(talk.messages[0])
    assert [text for text in lines if text not in told] == []


@given(st.binary(max_size=40), st.sampled_from([plant.MESSAGES, plant.BARE]))
def test_whatever_comes_every_report_has_words_for_it(octets: bytes, port: int) -> None:
    """Lines stay lines, ranges stay inside the message, JSON holds to its schema."""
    talk = listening()
    talk.datagram(CLIENT, octets, (49200, port))
    talk.datagram(SERVER, octets, (49200, port))
    talk.pipeline.finish()
    for found in talk.messages:
        for text in (scd_summary(found), *tree(found)):
            assert not UNSAFE.search(text)
        connection = talk.connections[0]
        assert complaints("pdu", json.loads(PduLines().scd_line(found, connection)), exact=True) == []
    for transaction in talk.transactions:
        assert not UNSAFE.search(transaction_line(transaction, Clock(), ALONE))


# ---- JSON -----------------------------------------------------------------------------------------------------------


def in_json(transaction: Transaction, locate: Any = None) -> list[dict[str, Any]]:
    text = scd_json(transaction, locate)
    assert text.isascii()
    told: list[dict[str, Any]] = json.loads("{" + text[1:] + "}")["scd"]
    return told


def test_values_in_json() -> None:
    asked, answer = in_json(exchange(plant.ask("Давление 1", tid=3), plant.tell("Давление 1", 2748, 3)))
    assert (asked["half"], asked["phase"], asked["values"]) == ("request", "request", [])
    assert (answer["half"], answer["tid"], answer["err"], answer["err_text"]) == ("response", 3, 0, None)
    assert answer["values"] == [
        {"address": "0x6001:0", "name": "Давление 1", "value": 2748, "physical": 1374.0, "unit": "кПа",
         "text": None, "flags": []}
    ]  # fmt: skip


def test_what_a_bare_content_does_not_have_is_null() -> None:
    (told,) = in_json(sent(bytes.fromhex("C1AB24FA"), ports=(49200, plant.BARE)))
    assert [told[key] for key in ("tid", "err", "index", "sub", "content", "place")] == [None] * 6
    assert (told["service"], told["pdo"], told["half"], told["octets"]) == ("pdo", "T2", "response", "c1ab24fa")
    pump, _ = in_json(polled())
    assert (pump["content"], pump["place"], pump["service"]) == ("pump_t", "DB10.DBB0", None)


def test_with_several_files_a_message_names_its_own() -> None:
    told = in_json(sent(plant.pdo()), lambda frame: ("b.pcap", frame + 10))
    assert (told[0]["file"], told[0]["frame"]) == ("b.pcap", 11)
    assert "file" not in scd_as_dict(sent(plant.pdo()).scd[0], -1, None)


def test_s7_alone_has_no_key() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, item(0x84, 10, 0, 2, 3)))
    talk.tell(ack_data(1, b"\x04\x01", good(4, bytes(3))))
    assert scd_json(talk.transactions[-1], None) == ""


# ---- texts from the wire --------------------------------------------------------------------------------------------


def test_texts_of_the_wire_and_of_bindings_are_escaped() -> None:
    """Names of a dictionary have to be printable (R71); a value and the name of a binding are whatever they are."""
    key = plant.dictionary().variable("Имя станции").address
    bound = Binding("b\x1b[0m", "udp", "value", "Имя станции", "Имя станции", key, port=5600)
    talk = Talk()
    talk.wants_pdus = True
    talk.carry(ScdCarrier(plant.dictionary(), Bindings([bound])))
    talk.datagram(SERVER, 'a\x1b[31m\u202e"; = \x7f\n'.encode())
    (transaction,) = talk.transactions
    (found,) = talk.messages
    texts = [transaction_line(transaction, Clock(), ALONE), scd_summary(found), *scd_tree_lines(found)]
    texts += [text for row in rows(transaction) for text in row.values()]
    assert not [text for text in texts if UNSAFE.search(text)]
    (told,) = in_json(transaction)
    assert (told["binding"], told["values"][0]["value"]) == (bound.name, 'a\x1b[31m\u202e"; = \x7f\n')
    assert transaction.connection.identified_by == "b\\x1b[0m"


# ---- the analysis ---------------------------------------------------------------------------------------------------


def test_losses_are_told() -> None:
    talk = Talk()
    analysis = Analysis()
    talk.pipeline = Pipeline(analysis, Options(strict=True, decoder=plant.carrier()))
    talk.datagram(CLIENT, plant.ask("Расход 1"), cut=2)
    talk.datagram(CLIENT, b"\xdc\x3f" + bytes(10))
    talk.ports = [50000, plant.STREAM]
    talk.hello()
    talk.packet(CLIENT, b"GET /" + plant.ask("Расход 1"))
    talk.close()
    talk.pipeline.finish()
    analysis.take(talk.pipeline, [SourceFile("x", 1)])
    told = [text.text.strip() for text in analysis_lines(analysis)]
    begin = told.index("SCD by the dictionary Насосная 1.0.0")
    assert told[begin + 2].split() == ["обмен", "1", "0", "1"]
    assert told[begin + 9 : begin + 12] == [
        "datagrams truncated by the capture: 1",
        "messages of a kind that cannot be paired: 1",
        "stream bytes skipped because they belong to no complete message: 5",
    ]
    assert any("2 SCD messages" in text for text in told)
