"""Answers in several parts: joined, never ended, without a beginning, and bounded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.multipart import MAX_CHAINS, MAX_OCTETS, MAX_PLACES, MAX_UNFINISHED, Chain, Joiner
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.szl import SZL_HEAD
from dissect.wire.malformed import Malformed
from dissect.wire.part import SURPLUS
from tests.engine.findings.events import bsend
from tests.engine.transactions.talk import CLIENT, SERVER, Talk, dbw, read, userdata, words

CAPTURE: Final = Path(__file__).resolve().parents[3] / "captures" / "bsend.pcapng"

FIRST: Final = bytes.fromhex("0000 0000 0002 0006 0000 0f00 0011")
SECOND: Final = bytes.fromhex("0f11 001c 0131")


def question(pdu_ref: int, sequence: int = 0, subfunction: int = 1) -> bytes:
    if sequence:
        return userdata(pdu_ref, bytes((0, 1, 0x12, 8, 0x12, 0x44, subfunction, sequence, 0, 0, 0, 0)))
    return userdata(pdu_ref, bytes((0, 1, 0x12, 4, 0x11, 0x44, subfunction, 0)), b"\xff\x09\x00\x04\x00\x00\x00\x00")


def answer(
    pdu_ref: int, payload: bytes, sequence: int, ref: int = 0, last: int = 0, code: int = 0, subfunction: int = 1
) -> bytes:
    head = bytes((0, 1, 0x12, 8, 0x12, 0x84, subfunction, sequence, ref, last)) + code.to_bytes(2, "big")
    if code:
        return userdata(pdu_ref, head)
    return userdata(pdu_ref, head, b"\xff\x09" + len(payload).to_bytes(2, "big") + payload)


def transactions(*exchanges: tuple[bytes | None, bytes]) -> list[Transaction]:
    talk = Talk()
    talk.open()
    for asked, told in exchanges:
        if asked is not None:
            talk.ask(asked)
        talk.tell(told)
    talk.close()
    return [transaction for transaction in talk.transactions if transaction.response_size]


def joined(joiner: Joiner, given_: list[Transaction]) -> list[Chain]:
    return [chain for chain in (joiner.feed(transaction) for transaction in given_) if chain is not None]


def test_two_parts() -> None:
    joiner = Joiner()
    given_ = transactions((question(1), answer(1, FIRST, 3, 213, 1)), (question(2, 3), answer(2, SECOND, 3, 213)))
    (chain,) = joined(joiner, given_)
    assert chain.octets == FIRST + SECOND
    assert (chain.whole, chain.transactions, chain.size) == (True, 2, len(FIRST + SECOND))
    assert (chain.group, chain.subfunction, chain.type, chain.sequence, chain.data_unit_ref) == (4, 1, 2, 3, 213)
    assert (chain.first, chain.last) == (given_[0], given_[1])
    told: list[Malformed] = []
    parts = chain.parts(told)
    assert told == []
    assert [part.number("listed_id") for part in parts[1:]] == [0x0000, 0x0F00, 0x0011, 0x0F11, 0x001C, 0x0131]
    assert (joiner.open_count, joiner.unfinished_count, joiner.headless, joiner.close()) == (0, 0, 0, [])


def test_one_part() -> None:
    (chain,) = joined(Joiner(), transactions((question(1), answer(1, FIRST, 3))))
    assert (chain.octets, chain.transactions, chain.whole) == (FIRST, 1, True)


def test_a_part_that_is_not_the_last_is_no_whole_answer_without_a_reference_either() -> None:
    joiner = Joiner()
    first, last = transactions((question(1), answer(1, FIRST, 3, 0, 1)), (question(2, 3), answer(2, SECOND, 3, 0)))
    assert joiner.feed(first) is None
    assert joiner.open_count == 1
    assert joiner.feed(last) is not None


def test_chains_of_two_lists_at_once() -> None:
    joiner = Joiner()
    given_ = transactions(
        (question(1), answer(1, b"a", 3, 1, 1)),
        (question(2, subfunction=0x13), answer(2, b"b", 3, 2, 1, subfunction=0x13)),
        (question(3, 3), answer(3, b"c", 3, 1)),
        (question(4, 3, 0x13), answer(4, b"d", 3, 2, subfunction=0x13)),
    )
    assert [chain.octets for chain in joined(joiner, given_)] == [b"ac", b"bd"]


def test_a_part_in_a_gap() -> None:
    """What is on both sides of it is not joined: together it would say what nobody said."""
    talk = Talk()
    talk.open()
    talk.ask(question(1))
    talk.tell(answer(1, FIRST, 3, 213, 1))
    talk.ask(question(2, 3))
    talk.lose(SERVER, answer(2, bytes(28), 3, 213, 1))
    talk.ask(question(3, 3))
    talk.tell(answer(3, SECOND, 3, 213))
    talk.close()
    (operation,) = [one for one in talk.operations if one.kind == "long_answer"]
    assert (operation.result, operation.content) == ("not_captured", b"")


def test_a_part_without_the_first() -> None:
    joiner = Joiner()
    assert joined(joiner, transactions((question(2, 3), answer(2, SECOND, 3, 213)))) == []
    assert joined(joiner, transactions((None, answer(9, SECOND, 3, 213)))) == []
    assert (joiner.headless, joiner.open_count) == (2, 0)


def test_a_first_part_whose_request_was_not_seen() -> None:
    joiner = Joiner()
    given_ = transactions((None, answer(1, FIRST, 3, 213, 1)), (question(2, 3), answer(2, SECOND, 3, 213)))
    given_.sort(key=lambda transaction: transaction.response_frame)
    assert [chain.octets for chain in joined(joiner, given_)] == [FIRST + SECOND]


def test_a_chain_that_never_ends() -> None:
    joiner = Joiner()
    assert joined(joiner, transactions((question(1), answer(1, FIRST, 3, 213, 1)))) == []
    (chain,) = joiner.close()
    assert (chain.octets, chain.whole) == (FIRST, False)
    assert repr(chain) == f"Chain(4, 1, {len(FIRST)} bytes in 1, open)"
    assert (joiner.unfinished_count, joiner.open_count) == (1, 0)


@pytest.mark.parametrize(
    "then",
    [
        (question(2), answer(2, FIRST, 3, 214, 1)),
        (question(2, 3), answer(2, SECOND, 3, 9)),
        (question(2, 3), answer(2, b"", 3, code=0xD402)),
    ],
    ids=["asked anew", "another data unit reference", "refused"],
)
def test_a_chain_that_is_broken_off(then: tuple[bytes, bytes]) -> None:
    joiner = Joiner()
    assert joined(joiner, transactions((question(1), answer(1, FIRST, 3, 213, 1)), then)) == []
    assert [chain.octets for chain in joiner.unfinished] == [FIRST]
    assert joiner.unfinished_count == 1


def test_what_is_no_userdata_answer() -> None:
    joiner = Joiner()
    assert joined(joiner, transactions((read(1, dbw(1, 0)), words(1, 7)))) == []
    assert joined(joiner, transactions((question(1), answer(1, b"", 3, code=0xD402)))) == []
    assert joiner.close() == []


def test_open_chains_are_bounded() -> None:
    joiner = Joiner()
    count = MAX_CHAINS + MAX_UNFINISHED + 5
    given_ = transactions(*[(question(number), answer(number, b"x", number, 1, 1)) for number in range(1, count + 1)])
    assert joined(joiner, given_) == []
    assert joiner.open_count == MAX_CHAINS
    assert joiner.unfinished_count == count - MAX_CHAINS
    assert len(joiner.close()) == MAX_UNFINISHED
    assert joiner.unfinished_count == count


def test_octets_are_bounded() -> None:
    """A chain that grows without end is given up, and its octets with it."""
    joiner = Joiner()
    piece = bytes(4000)
    first, more = transactions((question(1), answer(1, piece, 3, 1, 1)), (question(2, 3), answer(2, piece, 3, 1, 1)))
    joiner.feed(first)
    needed = MAX_OCTETS // len(piece)
    for _ in range(needed):
        assert joiner.unfinished_count == 0
        assert joiner.feed(more) is None
    assert (joiner.open_count, joiner.unfinished_count) == (0, 1)
    joiner.feed(more)
    assert joiner.headless == 1


def sends(*pdus: bytes, code: int = 0) -> list[Transaction]:
    """The BSENDs ``pdus``, each answered with nothing; the last one with an error code."""
    answers = [userdata(pdu_ref, bytes.fromhex("000112081286010200000000")) for pdu_ref in range(1, len(pdus) + 1)]
    answers[-1] = userdata(len(pdus), bytes.fromhex("00011208128601020000") + code.to_bytes(2, "big"))
    return transactions(*zip(pdus, answers, strict=True))


def test_a_bsend_alone() -> None:
    (chain,) = joined(Joiner(), sends(bsend(1, b"data", 4, r_id=7)))
    assert (chain.r_id, chain.sent, chain.announced, chain.whole, chain.transactions) == (7, b"data", 4, True, 1)
    told: list[Malformed] = []
    assert [part.layout.name for part in chain.parts(told)] == ["R_ID", "BSEND length", "BSEND data"]
    assert told == []


def test_a_bsend_in_pieces() -> None:
    joiner = Joiner()
    pieces = (
        bsend(1, b"ab", 6, part=5),
        bsend(2, b"ef", 2, r_id=2),
        bsend(3, b"cd", sequence=2, part=6),
        bsend(4, b"ef", sequence=2, part=-7),
        bsend(5, b"gh", sequence=2, part=-7),  # of which the beginning is missing
    )
    given_ = sends(*pieces)
    assert [(one.r_id, one.sent, one.announced) for one in joined(joiner, given_)] == [(2, b"ef", 2), (1, b"abcdef", 6)]
    assert (joiner.open_count, joiner.unfinished_count, joiner.headless) == (0, 0, 1)


def test_a_bsend_that_is_refused_or_begun_again() -> None:
    joiner = Joiner()
    given_ = sends(bsend(1, b"ab", 6, part=5), bsend(2, b"ab", 6, part=6), bsend(3, b"cd", sequence=2, part=7), code=1)
    assert joined(joiner, given_) == []
    assert [(one.sent, one.whole) for one in joiner.close()] == [(b"ab", False), (b"ab", False)]


def test_bsends_that_never_end_are_bounded() -> None:
    joiner = Joiner()
    assert joined(joiner, sends(*[bsend(n, b"ab", 6, part=5, r_id=n) for n in range(1, MAX_CHAINS + 3)])) == []
    assert (joiner.open_count, joiner.unfinished_count) == (MAX_CHAINS, 2)
    first, more = sends(bsend(1, b"", 9, part=5), bsend(2, bytes(60000), sequence=2, part=5))
    joiner = Joiner()
    joiner.feed(first)
    for _ in range(MAX_OCTETS // 60000 + 1):
        assert joiner.feed(more) is None
    assert (joiner.open_count, joiner.unfinished_count) == (0, 1)


def test_what_is_no_whole_bsend_is_left_out() -> None:
    joiner = Joiner()
    cut = userdata(1, bytes.fromhex("000112081246010000000000"), bytes.fromhex("ff09000712061300000000"))
    short = bsend(2, b"")
    (chain,) = joined(joiner, sends(cut, short))
    assert (chain.r_id, chain.sent, chain.announced) == (1, b"", -1)
    assert joined(joiner, transactions((question(1), answer(1, FIRST, 3))))[0].r_id == -1


def test_the_bsend_of_two_partners() -> None:
    joiners: dict[Connection, Joiner] = {}
    found = []
    for event in dissect.open(str(CAPTURE), pdus=False):
        if isinstance(event, Transaction):
            chain = joiners.setdefault(event.connection, Joiner()).feed(event)
            if chain is not None and chain.r_id >= 0:
                found.append((chain.last.asked_by, chain.r_id, chain.announced, chain.transactions, chain.sent))
    long = bytes(range(256)) * 5 + bytes(range(220))
    assert found == [(0, 1, 8, 1, b"level 17"), (1, 2, 200, 1, bytes(range(200))), (0, 1, 1500, 4, long)]


def lists(path: Path) -> Iterator[tuple[Joiner, Chain]]:
    joiners: dict[Connection, Joiner] = {}
    for event in dissect.open(str(path), pdus=False):
        if isinstance(event, Transaction):
            joiner = joiners.setdefault(event.connection, Joiner())
            chain = joiner.feed(event)
            if chain is not None and (chain.group, chain.subfunction) == (4, 1):
                yield joiner, chain


@pytest.mark.parametrize(
    ("name", "several"),
    [
        ("tia_s300_goOnline.pcapng", 17),
        ("s7comm_reading_plc_status.pcap", 2),
        ("s7comm_reading_setting_plc_time.pcap", 1),
        ("s7comm_downloading_block_db1.pcap", 0),
        ("step7_s300_AuthPassword.pcapng", 0),
        ("s7ident_refused_upload.pcap", 0),
    ],
)
def test_recorded_lists_are_whole(corpus: Path, name: str, several: int) -> None:
    count = 0
    for joiner, chain in lists(corpus / name):
        count += chain.transactions > 1
        told: list[Malformed] = []
        parts = chain.parts(told)
        assert told == []
        assert SURPLUS not in [part.layout for part in parts]
        head = parts[0]
        assert head.layout is SZL_HEAD
        records = 0 if (head.number("szl_id") >> 8) & 0xF == 0xF else head.number("record_count")
        assert chain.size == 8 + head.number("record_length") * records
        assert (joiner.headless, joiner.unfinished_count) == (0, 0)
    assert count == several


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2), st.integers(0, 2), st.binary(max_size=6)), max_size=12))
def test_never_raises_and_keeps_count(exchanges: list[tuple[int, int, int, bytes]]) -> None:
    given_ = transactions(
        *[
            (question(number, asked), answer(number, payload, asked or 1, ref, last))
            for number, (asked, ref, last, payload) in enumerate(exchanges, 1)
        ]
    )
    joiner = Joiner()
    whole = joined(joiner, given_)
    joiner.close()
    assert joiner.open_count == 0
    seen = sum(chain.transactions for chain in whole) + sum(chain.transactions for chain in joiner.unfinished)
    assert seen + joiner.headless == len(given_)


@pytest.mark.parametrize("asked", [True, False])
def test_octets_of_chains_are_counted_while_they_are_open(asked: bool) -> None:
    joiner = Joiner()
    first, second, other, last = transactions(
        (question(1) if asked else None, answer(1, b"abc", 3, 213, 1)),
        (question(2, 3), answer(2, b"defg", 3, 213, 1)),
        (question(3), answer(3, b"x", 4, 214, 1)),
        (question(4, 3), answer(4, b"h", 3, 213)),
    )
    sizes = []
    for one in sorted((first, second, other, last), key=lambda one: one.response_frame):
        chain = joiner.feed(one)
        sizes.append((joiner.octets, joiner.open_count, chain is not None))
    assert sizes == [(3, 1, False), (7, 1, False), (8, 2, False), (1, 1, True)]
    assert len(joiner.close()) == 1
    assert (joiner.octets, joiner.open_count) == (0, 0)


def test_each_part_has_its_place_and_its_packet() -> None:
    given_ = transactions((question(1), answer(1, FIRST, 3, 213, 1)), (question(2, 3), answer(2, SECOND, 3, 213)))
    (chain,) = joined(Joiner(), given_)
    sizes = (len(FIRST), len(FIRST + SECOND))
    assert chain.places == [*zip(sizes, [one.response_frame for one in given_], strict=True)]
    assert repr(chain) == f"Chain(4, 1, {sizes[1]} bytes in 2, whole)"
    assert (chain.sent, chain.announced) == (b"", -1)


def test_packets_are_remembered_for_a_bounded_number_of_parts() -> None:
    joiner = Joiner()
    first, more = transactions((question(1), answer(1, b"x", 3, 1, 1)), (question(2, 3), answer(2, b"y", 3, 1, 1)))
    joiner.feed(first)
    for _ in range(MAX_PLACES + 5):
        joiner.feed(more)
    (chain,) = joiner.close()
    assert (chain.transactions, chain.size, len(chain.places)) == (MAX_PLACES + 6, MAX_PLACES + 6, MAX_PLACES)


def test_answers_of_the_two_sides_are_apart() -> None:
    """Both ask for the same list, and get the same sequence number."""
    talk = Talk()
    talk.open()
    talk.ask(question(1))
    talk.tell(answer(1, b"a", 3, 1, 1))
    talk.tell(question(1))
    talk.ask(answer(1, b"b", 3, 1, 1))
    talk.ask(question(2, 3))
    talk.tell(answer(2, b"c", 3, 1))
    talk.tell(question(2, 3))
    talk.ask(answer(2, b"d", 3, 1))
    talk.close()
    assert [one.octets for one in joined(Joiner(), [one for one in talk.transactions if one.response_size])] == [
        b"ac",
        b"bd",
    ]


def test_a_chain_does_not_go_on_over_a_gap() -> None:
    """Octets of its sender are missing between two parts, though the next part names the chain."""
    talk = Talk()
    talk.open()
    talk.ask(question(1))
    talk.tell(answer(1, FIRST, 3, 213, 1))
    joiner = Joiner()
    assert joined(joiner, talk.transactions[-1:]) == []
    talk.lose(SERVER, answer(9, bytes(28), 3, 213, 1))
    talk.packet(CLIENT)
    talk.ask(question(2, 3))
    talk.tell(answer(2, SECOND, 3, 213))
    for _ in range(2):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60_000_000)
    last = next(one for one in talk.transactions if one.pdu_ref == 2)
    assert last.outcome == "answered"
    assert joined(joiner, [last]) == []
    assert (joiner.headless, joiner.unfinished_count, joiner.open_count) == (1, 1, 0)


@pytest.mark.parametrize("size", range(6))
def test_a_payload_has_at_most_the_size_that_its_head_states(size: int) -> None:
    """What follows it in the data block is no part of it, and what is missing there is missing."""
    data = b"\xff\x09" + size.to_bytes(2, "big") + b"abc"
    head = bytes((0, 1, 0x12, 8, 0x12, 0x84, 1, 3, 0, 0, 0, 0))
    (chain,) = joined(Joiner(), transactions((question(1), userdata(1, head, data))))
    assert chain.octets == b"abc"[:size]
    (chain,) = joined(Joiner(), transactions((question(1), userdata(1, head, data[:size]))))
    assert chain.octets == b"abc"[: max(0, size - 4)]


def test_bsends_of_different_kinds_with_one_id_are_apart() -> None:
    """A BSEND that a station pushes is not continued by one that is requested."""
    joiner = Joiner()
    given_ = sends(bsend(1, b"ab", 4, part=5), bsend(2, b"CD", 4, part=6, r_id=2), bsend(3, b"cd", sequence=2, part=-7))
    assert joiner.octets == 0
    (chain,) = joined(joiner, given_)
    assert (chain.r_id, chain.sent, chain.size) == (1, b"abcd", 14)
    assert (joiner.octets, joiner.open_count) == (12, 1)


@pytest.mark.parametrize(("lost", "whole"), [("piece", False), ("answer", True), ("nothing", True)])
def test_pieces_of_a_bsend_are_joined_unless_octets_of_their_sender_are_missing(lost: str, whole: bool) -> None:
    """An answer of the partner carries no data."""
    talk = Talk()
    talk.open()
    told = bytes.fromhex("000112081286010200000000")
    joiner = Joiner()
    found = []
    seen = 0
    for number, piece in enumerate((b"ab", b"cd", b"ef"), 1):
        last = number == 3
        octets = bsend(
            number, piece, 6 if number == 1 else -1, sequence=0 if number == 1 else 2, part=-7 if last else 5
        )
        if number == 2 and lost == "piece":
            talk.lose(CLIENT, octets)
            talk.tell(userdata(number, told))
        else:
            talk.ask(octets)
            if number == 2 and lost == "answer":
                talk.lose(SERVER, userdata(number, told))
            else:
                talk.tell(userdata(number, told))
        for _ in range(2):
            talk.packet(CLIENT)
            talk.packet(SERVER, after_ns=60_000_000)
        found += joined(joiner, sorted(talk.transactions[seen:], key=lambda one: one.request_frame))
        seen = len(talk.transactions)
    talk.finish()
    found += joined(joiner, talk.transactions[seen:])
    assert [chain.sent for chain in found] == ([b"abcdef"] if whole else [])
