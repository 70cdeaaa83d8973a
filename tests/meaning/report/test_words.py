from __future__ import annotations

from itertools import product

import pytest

from dissect.engine.transactions.naming import item_subject
from dissect.engine.transactions.transaction import CONNECTION_EVICTED
from dissect.meaning.report import facets, words
from dissect.packets.source.packet import SourceFile
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.values import Value
from tests import build
from tests.cases import each
from tests.meaning.report.support import UNSAFE, WORD, begun, first_transaction, read, transactions
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Talk

BYTES = Item(0x02, 4, 1, 0x84, 0)
CHARS = Item(0x03, 40, 1, 0x84, 0)


@each(
    ("ns", "text"),
    [
        (None, "-"),
        (0, "0 µs"),
        (300, "0.3 µs"),
        (9_960, "10.0 µs"),
        (52_263, "52 µs"),
        (999_499, "999 µs"),
        (999_500, "1.00 ms"),
        (3_210_000, "3.21 ms"),
        (99_994_999, "99.99 ms"),
        (99_995_000, "100 ms"),
        (999_499_999, "999 ms"),
        (999_500_000, "1.00 s"),
        (599_000_000_000, "599.00 s"),
        (600_000_000_000, "10 min 0 s"),
        (874_000_000_000, "14 min 34 s"),
        (3_600_000_000_000, "1 h 0 min 0 s"),
        (90_061_000_000_000, "1 d 1 h 1 min 1 s"),
        (-5_000, "-5.0 µs"),
        (-1_500_000, "-1.50 ms"),
        (-874_000_000_000, "-14 min 34 s"),
    ],
)
def test_duration(ns: int | None, text: str) -> None:
    assert words.duration(ns) == text


@pytest.mark.parametrize(
    ("octets", "text"),
    [(0, "0 B"), (999, "999 B"), (1000, "1.0 kB"), (5_400, "5.4 kB"), (118_200_000, "118.2 MB"), (10**10, "10.0 GB")],
)
def test_size(octets: int, text: str) -> None:
    assert words.size(octets) == text


def test_a_number_with_its_noun() -> None:
    assert [words.count(number, "packet") for number in (0, 1, 2)] == ["0 packets", "1 packet", "2 packets"]
    assert words.count(2, "push", "pushes") == "2 pushes"


def test_tsaps_say_rack_and_slot_only_where_a_siemens_device_speaks() -> None:
    calling, called = Tsap(b"\x01\x00"), Tsap(b"\x02\x43")
    assert words.tsaps(calling, called, "s7comm") == "TSAP 01.00 (PG) → 02.43 (OP, rack 2 slot 3)"
    assert words.tsaps(calling, called, "mms") == "TSAP 01.00 → 02.43"
    assert words.tsaps(None, Tsap(b"SIMATIC-ROOT-OTH"), "mms") == 'TSAP ? → "SIMATIC-ROOT-OTH"'
    assert words.tsaps(Tsap(b"\x1b[2J\x9b"), None, "") == "TSAP 1b5b324a9b → ?"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (True, "true"),
        (False, "false"),
        (1234, "1234"),
        (-3.5, "-3.5"),
        (1e20, "1e+20"),
        (float("nan"), "nan"),
        (None, "-"),
        ("Pump", "'Pump'"),
        ("\x1b[31m\u202e", "'\\x1b[31m\\u202e'"),
        ("x" * 32, "'" + "x" * 32 + "'"),
        ("x" * 37, "'" + "x" * 36 + "'… (37 characters)"),
        ("DTL#2024-11-28-13:35:59.123456789", "'DTL#2024-11-28-13:35:59.123456789'"),
        ("LT#-106751d23h47m16s854ms775us808ns", "'LT#-106751d23h47m16s854ms775us808ns'"),
        ("\x00" * 40, "'" + "\\x00" * 36 + "'… (40 characters)"),  # never cut within an escape
        ([1, None, True], "[1, -, true]"),
        ([], "[]"),
        (list(range(8)), "[0, 1, 2, 3, 4, 5, 6, 7]"),
        (list(range(64)), "[0, 1, 2, 3, 4, 5, 6, 7, … 64 in all]"),
    ],
)
def test_value(value: Value, text: str) -> None:
    assert words.value(value) == text


def test_octets() -> None:
    assert words.octets(b"") == "(empty)"
    assert words.octets(bytes(16)) == "00 " * 15 + "00"
    assert words.octets(bytes(17)) == "00 " * 15 + "00 … 17 bytes"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"Pump\x00\x00", "50 75 6d 70 00 00 'Pump'"),
        (b"\x0a\x05Valve\x00\x00", "0a 05 56 61 6c 76 65 00 00 'Valve'"),
        (b"abc", "61 62 63"),
        (b"\x41\x33\x85\x1f", "41 33 85 1f"),
        (b"    ", "20 20 20 20"),
        (b"it's" * 10, "69 74 27 73 69 74 27 73 69 74 27 73 69 74 27 73 … 40 bytes '" + "it's" * 9 + "…'"),
    ],
)
def test_octets_that_spell_a_text(content: bytes, text: str) -> None:
    assert words.octets(content) == text


@pytest.mark.parametrize(
    ("item", "content", "text"),
    [
        (WORD, b"\x04\xd2", "DB10.DBW4 = 1234"),
        (WORD, 0x0A, "DB10.DBW4: Object does not exist"),
        (WORD, 0x77, "DB10.DBW4: 0x77"),
        (BYTES, b"\x01\x02\x03\x04", "DB1.DBB0 x4 = 01 02 03 04"),
        (BYTES, 0x05, "DB1.DBB0 x4: Invalid address"),
        (CHARS, b"\x1b]0;x\x07" + bytes(34), "DB1.DBB0 x40 = '\\x1b]0;x\\x07" + "\\x00" * 30 + "'… (40 characters)"),
    ],
)
def test_an_item_with_what_became_of_it(item: Item, content: bytes | int, text: str) -> None:
    transaction = first_transaction(read(begun(), 1, item, content))
    assert facets.items(transaction) == [text]
    assert facets.subject(transaction) == text


def test_octets_that_are_no_value_are_shown_as_they_are() -> None:
    talk = begun().send(0, dt(messages.read_job(1, [WORD])))
    answer = messages.pdu(messages.ACK_DATA, 1, b"\x04\x01", b"\xff\x04\x00\x18\x01\x02\x03")
    assert facets.subject(first_transaction(talk.send(1, dt(answer)))) == "DB10.DBW4 = 01 02 03 (3 bytes instead of 2)"


def test_an_answer_nobody_asked_for_has_items_without_names() -> None:
    talk = begun().send(1, dt(messages.read_answer(9, [WORD, WORD], [b"\x00\x01", 0x05])))
    transaction = first_transaction(talk)
    assert facets.outcome(transaction) == "answer without request"
    assert facets.subject(transaction) == "item 1 = 00 01, item 2: Invalid address"


@pytest.mark.parametrize(
    ("granted", "text"),
    [
        (480, "granted PDU 480, AmQ 1/1"),
        (240, "asks PDU 480, AmQ 1/1, granted PDU 240, AmQ 1/1"),
        (None, "asks PDU 480, AmQ 1/1"),
    ],
)
def test_a_setup(granted: int | None, text: str) -> None:
    talk = begun()
    talk.segments = talk.segments[:5]
    talk.send(0, dt(messages.setup(messages.JOB, 7)))
    if granted is not None:
        talk.send(1, dt(messages.setup(messages.ACK_DATA, 7, length=granted)))
    told = transactions(talk.packets())[-1]
    assert facets.subject(told) == text
    assert facets.gist(told) == text


def test_the_gist_names_what_failed_and_never_everything() -> None:
    many = [Item(0x02, 1, 1, 0x84, 8 * number) for number in range(6)]
    talk = begun().send(0, dt(messages.read_job(1, many)))
    talk.send(1, dt(messages.read_answer(1, many, [b"\x00", 5, 5, 5, 5, b"\x00"])))
    talk.send(0, dt(messages.read_job(2, many))).send(1, dt(messages.read_answer(2, many, [b"\x00"] * 6)))
    read(talk, 3, WORD, 0x0A)
    read(talk, 4)
    _, failed, good, one, last = transactions(talk.packets())
    assert facets.gist(failed) == (
        "4 of 6 items refused: DB1.DBB1: Invalid address, DB1.DBB2: Invalid address, DB1.DBB3: Invalid address, …"
    )
    assert facets.gist(good) == "DB1.DBB0, DB1.DBB1, DB1.DBB2 and 3 more"
    assert facets.gist(one) == "DB10.DBW4: Object does not exist"
    assert facets.gist(last) == "DB10.DBW4"


def test_the_gist_of_a_write_says_of_how_much_the_answer_says_nothing() -> None:
    """Some devices answer a write of several items with one code."""
    many = [Item(0x02, 1, 1, 0x84, 8 * number) for number in range(6)]
    talk = begun()
    for number, codes in enumerate(([0xFF], [5], [0xFF] * 6), 1):
        talk.send(0, dt(messages.write_job(number, many, [b"\x01"] * 6))).send(
            1, dt(messages.write_answer(number, codes))
        )
    _, unsure, refused, good = transactions(talk.packets())
    assert facets.gist(unsure) == "5 of 6 items without a return code: DB1.DBB1, DB1.DBB2, DB1.DBB3 and 2 more"
    assert facets.gist(refused) == "1 of 6 items refused: DB1.DBB0 = 1: Invalid address"
    assert facets.gist(good) == "DB1.DBB0, DB1.DBB1, DB1.DBB2 and 3 more"


def test_outcomes() -> None:
    talk = begun()
    read(talk, 1)
    talk.send(0, dt(messages.pdu(messages.JOB, 2, b"\x1d\x00"))).send(
        1, dt(messages.pdu(messages.ACK, 2, b"", b"", 0xD241))
    )
    talk.send(1, dt(messages.userdata(0, 0, 4, 3, b"12345678", 0)))
    talk.send(1, dt(messages.userdata(0, 0, 4, 3, b"12345678", 0xD402)))
    talk.send(0, dt(messages.read_job(3, [WORD]))).reset(1)
    told = transactions(talk.packets())[1:]
    assert [facets.outcome(transaction) for transaction in told] == [
        "",
        "REFUSED 0xd241 Not permitted in current protection level",
        "push",
        "push, REFUSED 0xd402 Invalid SZL index",
        "NO ANSWER (connection closed)",
    ]


def test_nobody_knows_whether_a_side_that_was_not_captured_answered() -> None:
    asked = [dt(messages.read_job(number, [WORD])) for number in (1, 2, 3)]
    told = transactions(Talk().send(0, asked[0]).send(0, asked[1]).send(0, asked[2]).packets())
    assert [facets.outcome(transaction) for transaction in told] == ["answer not captured"] * 3
    told[0].reason = CONNECTION_EVICTED  # dropped by ourselves: the answer may be in the capture
    assert facets.outcome(told[0]) == "answer not followed (too many connections)"
    told = transactions(begun().send(0, asked[0]).packets())
    assert facets.outcome(told[-1]) == "NO ANSWER (capture ends)"


def test_a_hole_explains_what_is_missing() -> None:
    talk = begun()
    talk.send(0, dt(messages.read_job(1, [WORD]))).skip(1, 29).send(0, dt(messages.read_job(2, [WORD])))
    talk.send(1, dt(messages.read_answer(2, [WORD], [b"\x00\x01"]))).ack(0)
    told = transactions(talk.packets())[1:]
    assert sorted(facets.outcome(transaction) for transaction in told) == [
        "",
        "answered, but the answer was not captured",
    ]


@pytest.mark.parametrize("syntax", [b"\x12\x08\xb0" + b"\x1b" * 7, b"\x12\x60\xa2" + b"\x9b" * 95])
def test_an_address_of_another_syntax_is_safe_and_short(syntax: bytes) -> None:
    job = messages.pdu(messages.JOB, 1, b"\x04\x01" + syntax)
    transaction = first_transaction(begun().send(0, dt(job)))
    shown = facets.subject(transaction)
    assert not UNSAFE.search(shown)
    assert len(shown.removesuffix(": no return code")) < 130


def test_a_refused_write_shows_what_it_would_have_written() -> None:
    talk = begun().send(0, dt(messages.write_job(1, [WORD], [b"\x04\xd2"])))
    talk.send(1, dt(messages.pdu(messages.ACK_DATA, 1, b"\x05\x01", b"\x05")))
    assert facets.subject(first_transaction(talk)) == "DB10.DBW4 = 1234: Invalid address"


@pytest.mark.parametrize(
    ("area", "size", "content", "shown"),
    [
        (0x1D, 0x1D, b"\x12\x34\xef\xbe", "T0 x2 = ['S5T#23s400ms', ef be]"),
        (0x1C, 0x1C, b"\x00\x11\xca\xfe", "C0 x2 = [11, ca fe]"),
        (0x1D, 0x1D, b"\xef\xbe", "T0 = ef be"),
        (0x84, 0x0B, b"\0\0\0\1\xff\xff\xff\xff", "DB10.DBD4 x2 = ['T#1ms', 'T#-1ms']"),
        (0x84, 0x0A, b"\xff\xff\xff\xff\0\0\0\1", "DB10.DBD4 x2 = [ff ff ff ff, 'TOD#00:00:00.001']"),
    ],
)
def test_a_value_that_does_not_fit_its_type_is_shown_as_its_bytes(
    area: int, size: int, content: bytes, shown: str
) -> None:
    """In the line of a transaction, and in findings about it."""
    numbered = area != 0x84
    width = 2 if numbered else 4
    item = Item(size, len(content) // width, 0 if numbered else 10, area, 0 if numbered else 32)
    block = bytes((messages.WRITE, 1)) + item.build()
    talk = begun().send(0, dt(messages.pdu(messages.JOB, 1, block, build.data_item(0, 9, content))))
    talk.send(1, dt(messages.pdu(messages.ACK_DATA, 1, b"\x05\x01", b"\x03")))
    transaction = first_transaction(talk)
    assert facets.subject(transaction) == f"{shown}: Access not allowed"
    assert item_subject(transaction, 1, "") == shown


def test_a_write_without_return_code_is_not_called_written() -> None:
    talk = begun().send(0, dt(messages.write_job(1, [WORD, WORD], [b"\x04\xd2", b"\x00\x01"])))
    talk.send(1, dt(messages.pdu(messages.ACK_DATA, 1, b"\x05\x01", b"\xff")))
    assert facets.subject(first_transaction(talk)) == "DB10.DBW4 = 1234, DB10.DBW4 = 1: no return code"


@each(
    ("counts", "text"),
    [
        ({"08": 0, "0E": 0, "0A": 3, "0B": 1}, "3 DB, 1 SDB"),
        ({"08": 1, "0E": 2, "0C": 3, "0A": 4, "0B": 0}, "1 OB, 2 FB, 3 FC, 4 DB"),
        ({"08": 0, "0A": 0}, "no blocks"),
        ({}, ""),
    ],
)
def test_types_of_which_there_are_no_blocks_are_left_out(counts: dict[str, int], text: str) -> None:
    listed = b"".join([type_.encode() + number.to_bytes(2, "big") for type_, number in counts.items()])
    answer = build.userdata_head(2, 3, 1, 1, 0), build.payload(listed)
    pdu = parse_pdu(build.pdu(build.USERDATA, 1, *answer))
    assert facets.body_notes(pdu) == text


def test_packets_are_found_in_any_order_while_files_are_added() -> None:
    files = [SourceFile("a.pcap", 1)]
    places = words.Places(files, several=True)
    assert [places.locate(frame) for frame in (1, 7, 12)] == [("a.pcap", 1), ("a.pcap", 7), ("a.pcap", 12)]
    files += [SourceFile("b\udcff.pcap", 8), SourceFile("empty.pcap", 10), SourceFile("c.pcap", 10)]
    named = {7: ("a.pcap", 7), 8: ("b\\xff.pcap", 1), 9: ("b\\xff.pcap", 2), 10: ("c.pcap", 1), 99: ("c.pcap", 90)}
    for (first, found), (second, also) in product(named.items(), repeat=2):
        assert [places.locate(frame) for frame in (first, second)] == [found, also]
