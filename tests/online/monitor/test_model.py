"""Events folded into what is shown: bounded, in an order that holds still, and what deserves attention does not roll by."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.online.live.events import ALERT, PROBLEM, TRANSACTION, Event
from dissect.online.monitor import filter as wanted_module
from dissect.online.monitor.entries import Entry
from dissect.online.monitor.filter import Wanted
from dissect.online.monitor.lists import ConnectionList
from dissect.online.monitor.model import Model
from tests.meaning.report.support import begun, read
from tests.online.monitor.support import events_of, model_of, of_capture, of_packets

S = 1_000_000_000


def transactions(entries: list[Entry]) -> list[Transaction]:
    return [entry.what for entry in entries if isinstance(entry.what, Transaction)]


def polled(count: int, refused: int = 0) -> list[Event]:
    """Return the events of so many reads, of which the first ``refused`` are refused."""
    talk = begun()
    for ref in range(1, count + 1):
        read(talk, ref, content=0x0A if ref <= refused else b"\x04\xd2")
    return events_of(of_packets(talk.packets()))


def test_everything_of_a_capture_is_there() -> None:
    session = of_capture("nodes7-poll-missing")
    model = model_of(session)
    entries = model.entries
    assert [type(entry.what) for entry in entries] == [Transaction, Operation, Transaction, Transaction]
    assert [entry.failed for entry in entries] == [False, False, True, True]
    (connection,) = model.connections(session.status().now_ns)
    assert (connection.state, connection.over, connection.answered, connection.errors) == ("closed", True, 3, 2)
    assert (connection.unanswered, connection.failed, connection.waiting) == (0, 2, 0)
    assert connection.latency_ns == transactions(entries)[-1].latency_ns
    assert connection.worst[-1] == connection.latency_ns
    (finding,) = model.findings(session.run.pipeline.finding_counts)
    assert (finding.key, finding.times, len(finding.details)) == ("transaction.item_error", 4, 4)


@pytest.mark.parametrize(
    ("name", "states"),
    [
        ("client-killed", ["closed"]),
        ("refused-full", ["ended", "reset"]),
        ("cut-with-reset", ["reset"]),
        ("refused-port", []),
    ],
)
def test_the_state_of_a_connection_in_a_word(name: str, states: list[str]) -> None:
    session = of_capture(name)
    assert sorted([facts.state for facts in model_of(session).connections(session.status().now_ns)]) == states


def test_what_fails_stays_when_the_rest_rolls_by() -> None:
    model = Model(most=10)
    events = polled(100, refused=3)
    model.take(events)
    assert len(model.entries) == 10
    assert not any([entry.failed for entry in model.entries])
    model.filter("failed")
    assert [int(one.pdu_ref) for one in transactions(model.entries)] == [1, 2, 3]
    assert model.came == len([event for event in events if isinstance(event.what, (Transaction, Operation))])


def test_in_pieces_or_whole_is_the_same() -> None:
    events = polled(100, refused=3)
    whole, pieces = Model(most=20), Model(most=20)
    for typed in ("", "failed"):
        whole.filter(typed)
        pieces.filter(typed)
        whole.take(events)
        for at in range(0, len(events), 7):
            pieces.take(events[at : at + 7])
        assert [entry.order for entry in whole.entries] == [entry.order for entry in pieces.entries]


def test_slow_answers_are_marked_and_kept() -> None:
    model = Model(slow_ns=0, most=10)
    model.take(polled(20))
    assert all([entry.slow for entry in model.entries])
    model.filter("slow")
    assert len(model.entries) == 10
    assert Wanted("slow", 10 * S).takes(model.entries[0].what) is False


def test_what_is_filtered_stays_while_the_rest_rolls_by() -> None:
    model = Model(most=5)
    model.filter("setup")
    model.take(polled(100))
    assert [one.function_name for one in transactions(model.entries)] == ["Setup communication"]
    model.filter("")
    assert [int(one.pdu_ref) for one in transactions(model.entries)] == [96, 97, 98, 99, 100]


@pytest.mark.parametrize(
    ("typed", "found"),
    [
        ("", 4),
        ("FAILED", 2),
        ("DB99", 2),
        ("read db99", 2),
        ("read mb20", 2),
        ("read nonsense", 0),
        ("127.0.0.1", 4),
        (":102 setup", 1),
        ("c1", 4),
        ("c2", 0),
        ("c1 failed", 2),
        ("object", 2),
        ("connect", 1),
        ("slow", 0),
        ("slow failed", 2),
        ("  ", 4),
    ],
)
def test_filters(typed: str, found: int) -> None:
    model = model_of(of_capture("nodes7-poll-missing"))
    model.filter(typed)
    assert len(model.entries) == found


def test_a_number_is_the_whole_number() -> None:
    model = model_of(of_capture("nodes7-poll-missing"))
    model.filter("c11")
    assert model.entries == []


def test_a_word_is_put_in_and_taken_out() -> None:
    assert Wanted("db1").toggled("failed") == "db1 failed"
    assert Wanted("db1 Failed").toggled("failed") == "db1"
    assert Wanted("").toggled("slow") == "slow"


def test_too_much_that_is_new_is_counted_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wanted_module, "_NEW_AT_ONCE", 1)
    events = [event for event in polled(3) if event.kind == TRANSACTION]
    model = Model()
    model.filter("read")
    model.take(events)  # the setup is looked at; the first read would be the second new one
    assert (len(model.entries), model.wanted.unsearched) == (0, 3)
    model.take(events)
    assert (len(model.entries), model.wanted.unsearched) == (3, 3)


def test_what_is_remembered_of_requests_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wanted_module, "_REMEMBERED", 2)
    wanted = Wanted("nothing")
    for event in polled(1) * 3:
        if isinstance(event.what, Transaction):
            wanted.takes(event.what)
    assert len(wanted._said) <= 2


def test_the_latest_alert_or_problem_is_kept_however_many_there_were() -> None:
    model = Model()
    for at in range(100):
        model.take([Event(PROBLEM if at % 2 else ALERT, 0, f"number {at}")])
        assert (model.said, model.latest) == (at + 1, f"{'PROBLEM ' if at % 2 else ''}number {at}")


def connections(count: int) -> list[Connection]:
    """Return connections that differ in their numbers, every other one over."""
    (closed,) = [event.what for event in polled(1) if event.kind == "connection_closed"]
    assert isinstance(closed, Connection)
    made = []
    for number in range(1, count + 1):
        one = Connection(number, closed.tcp)
        one.ending = None if number % 2 else closed.ending
        made.append(one)
    return made


def test_the_list_of_connections_is_bounded() -> None:
    listed = ConnectionList(4)
    for one in connections(9):
        listed.note(one)
    facts = listed.facts(0)
    assert [one.key for one in facts] == [3, 5, 7, 9]  # 1 went when only open ones were left
    assert listed.left_out == 5


def test_closed_ones_leave_first_and_then_the_silent() -> None:
    listed = ConnectionList(3)
    one, two, three, _, five, _, seven = connections(7)
    for other in (one, two, three):
        listed.note(other)
    listed.note(five)
    assert [facts.key for facts in listed.facts(0)] == [1, 3, 5]
    listed.transaction(one, S, 1)
    listed.note(seven)
    assert [facts.key for facts in listed.facts(0)] == [1, 5, 7]


def test_open_ones_stand_before_closed_ones() -> None:
    listed = ConnectionList()
    for one in connections(6):
        listed.note(one)
    assert [facts.key for facts in listed.facts(0)] == [1, 3, 5, 6, 4, 2]
