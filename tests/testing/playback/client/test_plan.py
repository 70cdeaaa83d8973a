"""What is planned: connect requests, which transactions are played, what is waited for, how connections end."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.engine.transactions.transaction import CONNECTION_CLOSED, HOLE, MALFORMED_HEADER
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, parse_tpdu
from dissect.protocols.iso.tables import CR, DR
from dissect.testing.golden.exchange import PLUS, S7, SCD, Exchange
from dissect.testing.golden.model import Link, Session, Span, Transaction
from dissect.testing.playback.client import ReplayError, load_recorded, make_plan
from dissect.testing.playback.client.permissions import Permissions
from dissect.testing.playback.client.plan import (
    ASK,
    CLIENT_PUSH,
    HEAR,
    MALFORMED,
    NO_REQUEST,
    NOT_S7,
    SERVER_ASKED,
    Part,
    plan_lines,
    playable,
)
from tests.meaning.report.support import WORD
from tests.properties import messages
from tests.testing.playback.client.support import CAPTURES

READ = messages.read_job(1, [WORD])
ANSWER = messages.read_answer(1, [WORD], [b"\x04\xd2"])


def link(*transactions: tuple[str, str, Exchange, str]) -> Link:
    """Return a connection with transactions (asked by, outcome, exchange, reason) numbered from 1."""
    one = Link()
    one.number, one.protocol = 1, "S7comm"
    one.calling, one.called, one.tpdu_size_asked, one.tpdu_size = b"\x01\x00", b"\x01\x02", 1024, 1024
    for number, (asked_by, outcome, exchange, reason) in enumerate(transactions, 1):
        transaction = Transaction(one, asked_by, exchange, outcome, reason)
        transaction.number = number
        one.transactions.append(transaction)
    return one


def recorded(*links: Link) -> Session:
    session = Session("a.pcapng")
    session.links = list(links)
    return session


@pytest.mark.parametrize("size", [0, 128, 512, 1024, 8192, 65_531, 256 * 3, 16_384])
def test_the_connect_request_asks_for_what_was_recorded(size: int) -> None:
    one = link()
    one.tpdu_size_asked = size
    tpdu = parse_tpdu(Part(one).connect_request(7))
    assert (tpdu.type, tpdu.malformed, tpdu.tpdu_size, tpdu.field("src_ref")) == (CR, [], size, 7)
    assert (tpdu.parameter(CALLING_TSAP), tpdu.parameter(CALLED_TSAP)) == (b"\x01\x00", b"\x01\x02")


def test_tsaps_may_fill_a_connect_request() -> None:
    one = link()
    one.calling, one.called = b"A" * 120, b"B" * 121
    (part,) = make_plan(recorded(one))
    octets = part.connect_request(0)
    assert octets[0] == 254
    assert parse_tpdu(octets).malformed == []


@pytest.mark.parametrize("sizes", [(121, 121), (254, 2), (300, 300)])
def test_tsaps_that_have_no_room_in_a_connect_request_are_told_before_anything_is_sent(sizes: tuple[int, int]) -> None:
    one = link()
    one.calling, one.called = b"A" * sizes[0], b"B" * sizes[1]
    with pytest.raises(ReplayError, match="which has room for 254"):
        make_plan(recorded(one))


def test_tsaps_that_were_not_sent_are_not_sent() -> None:
    one = link()
    one.calling = None
    tpdu = parse_tpdu(Part(one).connect_request(1))
    assert tpdu.parameter(CALLING_TSAP) is None
    assert tpdu.parameter(CALLED_TSAP) == b"\x01\x02"


def test_where_the_beginning_was_not_recorded_it_is_a_usual_one() -> None:
    one = link(("client", "answered", Exchange(S7, READ, ANSWER), ""))
    one.calling = one.called = None
    one.tpdu_size_asked = 0
    part = Part(one)
    tpdu = parse_tpdu(part.connect_request(1))
    assert (tpdu.parameter(CALLING_TSAP), tpdu.parameter(CALLED_TSAP), tpdu.tpdu_size) == (b"\x01\0", b"\x01\x02", 1024)
    assert part.own_setup[10] == 0xF0
    assert "  send a default SETUP, none was recorded" in plan_lines([part], Permissions())


@pytest.mark.parametrize(
    ("called", "recorded_", "expected"),
    [
        (b"S7-1500", b"\x01\x02", b"S7-1500"),
        ((1, 3), b"\x02\x00", b"\x02\x23"),
        ((0, 2), b"text", b"\x01\x02"),
        ((7, 31), None, b"\x01\xff"),
    ],
)
def test_another_place_can_be_called(called: bytes | tuple[int, int], recorded_: bytes | None, expected: bytes) -> None:
    one = link()
    one.called = recorded_
    assert Part(one, called).called == expected


def test_each_transaction_is_sent_waited_for_or_withheld_with_a_reason() -> None:
    push = messages.userdata(0, 0, 4, 3, bytes(20))
    one = link(
        ("client", "orphan_answer", Exchange(S7, b"", ANSWER), ""),
        ("client", "answered", Exchange(S7, READ, ANSWER), ""),
        ("client", "unsolicited", Exchange(S7, b"", push), ""),
        ("server", "unsolicited", Exchange(S7, b"", push), ""),
        ("server", "answered", Exchange(S7, READ, ANSWER), ""),
        ("client", "answered", Exchange(PLUS, b"", b""), ""),
        ("client", "answered", Exchange(SCD, b"", b"", ("request x",)), ""),
        ("client", "orphan_answer", Exchange(S7, b"", ANSWER), ""),
        ("client", "orphan_answer", Exchange(S7, b"", ANSWER), HOLE),
        ("client", "behind_malformed", Exchange(S7, READ, b""), MALFORMED_HEADER),
        ("client", "behind_malformed", Exchange(S7, b"", ANSWER), MALFORMED_HEADER),
    )
    part = Part(one)
    assert [(step.kind, step.transaction.number) for step in part.steps] == [(ASK, 2), (HEAR, 3), (HEAR, 8)]
    assert {told.transaction: told.reason for told in part.withheld} == {
        1: NO_REQUEST,
        4: CLIENT_PUSH,
        5: SERVER_ASKED,
        6: NOT_S7,
        7: NOT_S7,
        9: NO_REQUEST,
        10: MALFORMED,
        11: MALFORMED,
    }
    lines = plan_lines([part], Permissions())
    assert len(lines) == 2 + len(one.transactions)
    assert "  send transaction 2, READ DB10.DBW4" in lines
    assert any(line.startswith("  wait for transaction 3") for line in lines)


@pytest.mark.parametrize(
    ("outcome", "reason", "silent", "unknown"),
    [
        ("answered", "", False, False),
        ("unanswered", CONNECTION_CLOSED, True, False),
        ("unanswered", HOLE, False, True),
        ("unanswered", "capture_ended", False, True),
    ],
)
def test_what_is_known_of_an_answer(outcome: str, reason: str, silent: bool, unknown: bool) -> None:
    step = Part(link(("client", outcome, Exchange(S7, READ, b""), reason))).steps[0]
    assert (step.silent, step.unknown) == (silent, unknown)


@pytest.mark.parametrize(
    ("reason", "lost"), [(CONNECTION_CLOSED, True), (HOLE, True), ("capture_ended", True), ("table_full", True)]
)
def test_where_nothing_of_the_server_was_recorded_all_answers_are_lost(reason: str, lost: bool) -> None:
    one = link(("client", "unanswered", Exchange(S7, READ, b""), reason))
    one.tpdu_size = 0
    step = Part(one).steps[0]
    assert (step.heard, step.unknown, step.lost) == (False, True, lost)
    one.ended_by = "server"
    assert Part(one).steps[0].heard


def test_how_long_a_client_waited_is_the_time_to_its_next_request_or_its_end() -> None:
    asked = ("client", "unanswered", Exchange(S7, READ, b""), "capture_ended")
    pushed = ("client", "unsolicited", Exchange(S7, b"", ANSWER), "")
    one = link(asked, pushed, asked, asked)
    for transaction, time_ns in zip(one.transactions, (100, 150, 400, 300), strict=True):
        transaction.time_ns = time_ns
    span = Span(1, 1, 100, 9, 1000)
    one.span = span
    assert [step.gap_ns for step in Part(one).steps if step.kind == ASK] == [300, 0, None]
    assert [step.lost for step in Part(one).steps if step.kind == ASK] == [False, False, True]
    one.ended, one.ended_by = "fin", "client"
    assert [step.gap_ns for step in Part(one).steps if step.kind == ASK] == [300, 0, 700]
    one.span = None
    assert [step.gap_ns for step in Part(one).steps if step.kind == ASK] == [300, 0, None]
    one.transactions[2].time_ns = None
    assert [step.gap_ns for step in Part(one).steps if step.kind == ASK] == [None, None, None]


@pytest.mark.parametrize("carrier", ["udp", "ibh"])
def test_what_another_carrier_brought_is_withheld_and_told(carrier: str) -> None:
    one = link(("client", "answered", Exchange(S7, READ, ANSWER), ""))
    one.carrier = carrier
    part = Part(one)
    assert part.steps == []
    assert [told.reason for told in part.withheld] == [NOT_S7]


@pytest.mark.parametrize(
    ("ended", "by", "end", "by_client"),
    [
        ("fin", "client", "fin", True),
        ("reset", "client", "reset", True),
        ("disconnect", "client", "disconnect", True),
        ("fin", "server", "fin", False),
        ("error_tpdu", "server", "error_tpdu", False),
        ("error_tpdu", "client", "fin", True),
        ("evicted", "", "fin", True),
        ("", "", "fin", True),
    ],
)
def test_a_connection_ends_as_it_was_recorded(ended: str, by: str, end: str, by_client: bool) -> None:
    one = link()
    one.ended, one.ended_by = ended, by
    part = Part(one)
    assert (part.end, part.by_client) == (end, by_client)


@pytest.mark.parametrize(
    ("farewell", "reason"),
    [("DR from the client: congestion at TSAP", 1), ("DR from the client: reason not specified", 0), ("", 0x80)],
)
def test_a_disconnect_request_has_the_recorded_reason(farewell: str, reason: int) -> None:
    one = link()
    one.farewell = farewell
    tpdu = parse_tpdu(Part(one).disconnect_request(3, 9))
    assert (tpdu.type, tpdu.malformed) == (DR, [])
    assert (tpdu.field("dst_ref"), tpdu.field("src_ref"), tpdu.field("reason")) == (9, 3, reason)


def test_connections_are_chosen_by_number_and_played_as_they_began() -> None:
    path = CAPTURES / "setup-pdu-sizes.pcapng"
    plan = make_plan(load_recorded(path))
    times = [part.link.transactions[0].time_ns or 0 for part in plan]
    assert times == sorted(times)
    assert [part.link.number for part in make_plan(load_recorded(path), [3, 1])] == [
        part.link.number for part in plan if part.link.number != 2
    ]


@pytest.mark.parametrize("number", [0, 2])
def test_a_connection_that_is_not_there_is_told(number: int) -> None:
    with pytest.raises(ReplayError, match=f"there is no connection {number}: it has 1"):
        make_plan(recorded(link(("client", "answered", Exchange(S7, READ, ANSWER), ""))), [number])


def test_what_speaks_something_else_is_not_played() -> None:
    other = link(("client", "answered", Exchange(PLUS, b"", b""), ""))
    beside = link(("client", "answered", Exchange(S7, READ, ANSWER), ""))
    beside.number = 2
    assert playable(make_plan(recorded(other, beside))) != []
    assert "connection 1: not played" in plan_lines(make_plan(recorded(other, beside)), Permissions())
    beside.carrier = "udp"
    with pytest.raises(ReplayError, match="no connection in it speaks S7comm over TCP"):
        make_plan(recorded(other, beside))


def test_what_is_no_recording_is_told(tmp_path: Path) -> None:
    golden = tmp_path / "bad.s7.txt"
    golden.write_text("s7dissect golden 1\n\nnonsense\n", "utf-8")
    with pytest.raises(ReplayError, match=r"bad\.s7\.txt"):
        load_recorded(golden)
