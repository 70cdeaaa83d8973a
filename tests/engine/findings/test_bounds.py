"""Bounds belong to what may flood: nothing that another pair of hosts does is hidden behind them."""

from __future__ import annotations

from typing import Final

from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.findings import bounds
from dissect.engine.findings.bounds import COUNTED, KEPT, MAX_DETAILED, MAX_DETAILED_ALL, REMIND_NS, TOLD, Bounds
from dissect.engine.findings.reporter import Finding
from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from tests.engine.transactions.talk import ACK, CLIENT, FIN, MS, SECOND, SERVER, Talk, ack_data, dbw, job, read, refused

STOP: Final = bytes.fromhex("29000000000009") + b"P_PROGRAM"
SLUG: Final = "security.plc_stop"


class Watching(Talk):
    """Notes what was only counted, too."""

    def __init__(self, beside: Talk | None = None, client_port: int = 50000) -> None:
        super().__init__(client_port, beside=beside)
        self.reminders: list[Finding] = []

    def repeated(self, finding: Finding) -> None:
        self.reminders.append(finding)


def stop(first: Talk, port: int, server: int, times: int = 1) -> None:
    """A session of its own in which a client stops a PLC."""
    talk = Talk(port, beside=first)
    talk.hosts = [1, server]
    talk.hello()
    talk.connect()
    for number in range(1, times + 1):
        talk.ask(job(number, STOP), after_ns=MS // 10)
        talk.tell(ack_data(number, b"\x29"), after_ns=MS // 10)
    talk.packet(CLIENT, flags=FIN | ACK, after_ns=MS // 10)
    talk.packet(SERVER, flags=FIN | ACK, after_ns=MS // 10)


def test_many_stops_of_one_plc_do_not_hide_the_one_of_another() -> None:
    talk = Watching()
    for number in range(1100):
        stop(talk, 10_000 + number, 2)
    stop(talk, 40_000, 3)
    talk.finish()
    told = [finding for finding in talk.findings if finding.slug == SLUG]
    assert talk.pipeline.finding_counts[SLUG] == 1101
    other = [finding for finding in told if finding.server == "10.0.0.3"]
    assert [(finding.room, finding.number > 0) for finding in other] == [(KEPT, True)]
    # Each session is a connection of its own, so that the first of it is told; the report keeps so many.
    assert len(told) == 1101
    assert len([finding for finding in told if finding.room == KEPT]) == MAX_DETAILED_ALL + 1
    assert talk.reminders == []


def test_many_stops_of_one_session_are_said_once_a_minute() -> None:
    talk = Watching()
    talk.open()
    for number in range(1, 2001):
        talk.ask(read(number, dbw(9, 0)), after_ns=SECOND // 10 - MS)
        talk.tell(ack_data(number, b"\x04\x01", refused(0x0A)))
    talk.finish()
    said = [finding.repeated for finding in talk.reminders]
    assert sum(said) == 2000 - MAX_DETAILED
    # It takes 200 s: after the first ten a reminder comes each minute, and the last at the end.
    assert said == [601, 601, 601, 97]
    assert [one.detail for one in talk.reminders][:1] == ["601 more, between 10.0.0.1 and 10.0.0.2"]
    assert {(one.slug, one.connection, one.client, one.server, one.number) for one in talk.reminders} == {
        ("transaction.item_error", 0, "10.0.0.1", "10.0.0.2", 0)
    }
    times = [one.time_ns for one in talk.reminders]
    assert times == sorted(times)
    assert talk.reminders[-1].frames == [talk.transactions[-1].response_frame]


def test_a_reminder_of_several_pairs_names_those_with_most() -> None:
    made = Bounds()
    for number, count in enumerate((3, 7, 1, 5), 1):
        for _ in range(MAX_DETAILED):
            made.take(SLUG, "c", f"plc{number}", 0)
        for _ in range(count):
            assert made.take(SLUG, "c", f"plc{number}", 0) == COUNTED
            made.leave(number, number * SECOND)
    assert not made.due(SECOND + REMIND_NS - 1)
    assert made.due(SECOND + REMIND_NS)
    (one,) = made.remind()
    assert one.repeated == 16
    assert one.detail == "16 more, between c and plc2 (7), c and plc4 (5), c and plc1 (3), 1 further pair of hosts"
    assert (one.client, one.server, one.frame) == ("", "", 4)
    assert made.remind() == []
    assert not made.due(10 * REMIND_NS)


def test_very_many_pairs_cost_bounded_memory_and_each_is_told() -> None:
    made = Bounds()
    pairs = 3 * bounds.MAX_PLACES
    became = [made.take(SLUG, f"c{number}", "plc", number + 1) for number in range(pairs)]
    assert COUNTED not in became
    assert became.count(KEPT) == MAX_DETAILED_ALL + bounds.MAX_FIRST
    assert len(made._places) + len(made._older) <= bounds.MAX_PLACES
    # Half of the places are never forgotten.
    assert made.take(SLUG, f"c{pairs - bounds.MAX_PLACES // 2}", "plc", 0) == COUNTED
    # One that was forgotten is a first one again.
    assert made.take(SLUG, "c0", "plc", 0) == TOLD
    for number in range(1, pairs + 1):
        made.over(number)
    assert made._told == {}


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 4)), max_size=120),
    st.integers(0, 120),
    st.integers(1, 6),
    st.integers(1, 12),
)
def test_what_is_kept_of_parts_is_what_is_kept_of_the_whole(
    events: list[tuple[str, int]], cut: int, most: int, most_all: int
) -> None:
    """Connections of a later part are others than those of an earlier one."""

    def kept(some: list[tuple[int, str, int]]) -> list[tuple[int, str, int]]:
        made = Bounds()
        return [one for one in some if made.take(SLUG, one[1], "plc", one[2]) == KEPT]

    before = bounds.MAX_DETAILED, bounds.MAX_DETAILED_ALL
    bounds.MAX_DETAILED, bounds.MAX_DETAILED_ALL = most, most_all  # type: ignore[misc]
    try:
        numbered = [
            (place, host, number + 10 if number and place >= cut else number)
            for place, (host, number) in enumerate(events)
        ]
        assert kept(kept(numbered[:cut]) + kept(numbered[cut:])) == kept(numbered)
    finally:
        bounds.MAX_DETAILED, bounds.MAX_DETAILED_ALL = before  # type: ignore[misc]


def test_after_a_renewal_details_are_made_again() -> None:
    made = Bounds()
    taken = [made.take(SLUG, "c", "plc", 0) for _ in range(MAX_DETAILED + 1)]
    assert taken[-1] == COUNTED
    made.renew()
    assert made.take(SLUG, "c", "plc", 0) == KEPT


def test_an_observer_that_wants_every_event_gets_every_one() -> None:
    class All(Talk):
        def __init__(self) -> None:
            super().__init__()
            self.wants_every_finding = True
            self.pipeline = Pipeline(self, Options(strict=True))

    talk = All()
    talk.open()
    for number in range(1, 3 * MAX_DETAILED + 1):
        talk.ask(read(number, dbw(9, 0)))
        talk.tell(ack_data(number, b"\x04\x01", refused(0x0A)))
    talk.finish()
    found = [finding for finding in talk.findings if finding.slug == "transaction.item_error"]
    assert len(found) == 3 * MAX_DETAILED
    assert [finding.number for finding in found if finding.number] == [*range(1, MAX_DETAILED + 1)]
    assert all(finding.detail for finding in found)
