"""Parameter blocks are judged once, whatever stands in them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.findings.transaction_rules import odd_address
from dissect.protocols.s7.items import parse_item
from tests.engine.transactions.talk import (
    SECOND,
    Talk,
    ack_data,
    dbw,
    good,
    item,
    job,
    read,
    userdata,
    words,
    write,
    written,
)


@pytest.fixture
def talk() -> Talk:
    talk = Talk()
    talk.open(8, 8)
    return talk


def test_polling_tells_a_block_once(talk: Talk) -> None:
    for number in range(50):
        talk.ask(read(number, item(0x84, 1, 3, 4)))
        talk.tell(words(number, 1))
    assert talk.pipeline.finding_counts == {"s7.odd_address": 1}


def test_other_items_are_another_block(talk: Talk) -> None:
    for number in range(3):
        talk.ask(read(number, item(0x84, 1, 8 * number + 3, 4)))
        talk.tell(words(number, 1))
    assert talk.slugs() == ["s7.odd_address"] * 3


def test_many_faults_are_named_in_part(talk: Talk) -> None:
    talk.ask(read(1, *(item(0x84, 1, 3, 4) for _ in range(5))))
    said = "; ".join(["DB1.DBW0.3: bit 3 in the address of a WORD"] * 3)
    assert [finding.detail for finding in talk.findings] == [f"Read Var: {said} and 2 more"]


def test_what_is_malformed_is_told_as_that_alone(talk: Talk) -> None:
    talk.ask(job(1, read(1, item(0x99, 0, 3, 0x55))[10:] + b"\x12"))
    assert talk.slugs() == ["s7.malformed"]


@pytest.mark.parametrize(
    ("octets", "odd"),
    [
        (item(0x84, 1, 0x7FFFF, 1), ""),
        (item(0x84, 1, 0x80000, 1), "bits above the address are set"),
        (item(0x84, 1, 0x80000, 2), "bits above the address are set"),
        (item(0x84, 1, 4, 2), "bit 4 in the address of a BYTE"),
        (item(0x85, 9, 8, 2), ""),
        (item(0x81, 1, 8, 2), "DB number 1 outside a DB"),
        (item(0x80, 0, 8, 2), ""),
        (item(0x1C, 0, 3, 0x1C), ""),
        (item(0x1C, 0, 3, 0x1D), "transport size TIMER"),
        (item(0x1E, 0, 3, 0x1E), ""),
        (item(0x1F, 0, 3, 0x04), ""),
        (item(0x01, 5, 0xFFFFFF, 2), ""),
        (item(0x99, 5, 0xFFFFFF, 2), ""),
    ],
)
def test_odd_addresses(octets: bytes, odd: str) -> None:
    assert odd_address(parse_item(octets, 2)) == odd


@given(st.binary(min_size=9, max_size=9))
def test_any_address_is_odd_or_not(rest: bytes) -> None:
    assert isinstance(odd_address(parse_item(b"\x12\x0a\x10" + rest, 0)), str)


@given(st.binary(max_size=40), st.binary(max_size=40))
def test_any_block_can_be_judged(asked: bytes, head: bytes) -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(job(1, b"\x04\x02" + asked), job(2, asked), userdata(3, head))
    talk.finish()


# ---- transport sizes of answers ------------------------------------------------------------------------------------


def test_a_refused_item_leaves_the_question_open(talk: Talk) -> None:
    asked = item(0x84, 1, 0, 5)
    talk.ask(read(1, asked))
    talk.tell(ack_data(1, b"\x04\x01", b"\x0a\0\0\0"))
    talk.ask(read(2, asked))
    talk.tell(ack_data(2, b"\x04\x01", good(4, b"\0\1")))
    assert talk.slugs() == ["transaction.item_error", "transaction.odd_data_code"]


@pytest.mark.parametrize(
    ("size", "told", "octets"),
    [
        (1, 3, b"\1"),
        (2, 4, b"\1"),
        (3, 9, b"a"),
        (4, 4, b"\0\1"),
        (5, 5, b"\0\1"),
        (6, 4, bytes(4)),
        (7, 5, bytes(4)),
        (8, 7, bytes(4)),
        (0x13, 9, bytes(2)),
        (0x0F, 9, bytes(8)),
        (0x0F, 4, bytes(8)),
    ],
)
def test_what_cpus_answer_with_is_not_odd(talk: Talk, size: int, told: int, octets: bytes) -> None:
    talk.ask(read(1, item(0x84, 1, 0, size)))
    talk.tell(ack_data(1, b"\x04\x01", good(told, octets)))
    assert talk.findings == []


# ---- writes ---------------------------------------------------------------------------------------------------------


def test_a_write_of_another_size_without_answer(talk: Talk) -> None:
    talk.ask(write(1, [dbw(1, 0), dbw(1, 2)], written(4, b"\0\1") + written(4, b"\0\1\2\3")))
    talk.wait(2 * SECOND)
    talk.close()
    found = {finding.slug: finding.detail for finding in talk.findings}
    assert "transaction.unanswered" in found
    assert found["transaction.write_size"].endswith("item 2 (DB1.DBW2) needs 2 bytes, got 4")


def test_an_item_of_no_octets_is_of_another_size_when_octets_come(talk: Talk) -> None:
    """A count of 0 requests nothing: its size is known, and it is 0."""
    talk.ask(read(1, dbw(1, 0, 0), dbw(1, 2)))
    talk.tell(ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2))
    talk.ask(read(2, dbw(1, 0, 0), dbw(1, 2)))
    talk.tell(ack_data(2, b"\x04\x02", good(4, b"") + good(4, b"\0\1")))
    assert [(one.slug, one.detail) for one in talk.findings] == [
        (
            "transaction.size_mismatch",
            "Read Var DB1.DBW0 x0, DB1.DBW2: item 1 (DB1.DBW0) requested 0 bytes, got 2",
        )
    ]


def test_a_write_of_no_octets_that_has_some_is_of_another_size(talk: Talk) -> None:
    talk.ask(write(1, [dbw(1, 0, 0), dbw(1, 2)], written(4, b"\0\1") * 2))
    talk.tell(ack_data(1, b"\x05\x02", b"\xff\xff"))
    talk.ask(write(2, [dbw(1, 0, 0), dbw(1, 2)], written(4, b"") + written(4, b"\0\1")))
    talk.tell(ack_data(2, b"\x05\x02", b"\xff\xff"))
    (detail,) = [finding.detail for finding in talk.findings if finding.slug == "transaction.write_size"]
    assert detail.endswith("item 1 (DB1.DBW0) needs 0 bytes, got 2")
