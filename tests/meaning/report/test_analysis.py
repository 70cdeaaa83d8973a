from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.options import Options
from dissect.engine.stations.facts import Book, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.analysis import MAX_CONNECTIONS, MAX_FAILED, MAX_SLOWEST, Analysis
from dissect.packets.source.packet import SourceFile
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from tests.build import payload
from tests.engine.findings.events import start_upload
from tests.engine.findings.operation_scenarios import read_out
from tests.engine.transactions.talk import (
    MS,
    SECOND,
    Talk,
    ack,
    ack_data,
    dbw,
    head,
    job,
    read,
    refused,
    userdata,
    words,
)
from tests.meaning.report.support import ROOT


def fold(talk: Talk) -> Analysis:
    """Give an analysis what a conversation told."""
    analysis = Analysis()
    for transaction in talk.transactions:
        analysis.transaction(transaction)
    for finding in talk.findings:
        analysis.finding(finding)
    for connection in talk.connections:
        analysis.connection_closed(connection)
    return analysis


def test_operations_are_counted_by_kind_and_result() -> None:
    talk = Talk()
    talk.open()
    read_out(talk)
    read_out(talk)
    talk.ask(start_upload(9))
    talk.close()
    analysis = Analysis()
    for operation in talk.operations:
        analysis.operation(operation)
    assert analysis.operations == {"connect": {"done": 1}, "upload": {"done": 2, "unfinished": 1}}


def sums(analysis: Analysis) -> dict[str, int]:
    names = ("total", "answered", "unanswered", "orphans", "unsolicited", "with_errors")
    return {name: int(getattr(analysis, name)) for name in names}


def everything() -> Talk:
    """One transaction of every outcome, and errors of every kind."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1), after_ns=5 * MS)
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(ack_data(2, b"\x04\x01", refused(5)), after_ns=7 * MS)
    talk.ask(job(3, b"\x1d" + bytes(17)))
    talk.tell(ack(3, 0xD209), after_ns=9 * MS)
    talk.ask(userdata(4, head(1, 4, 1)))
    talk.tell(userdata(4, head(2, 4, 1, 1, 0xD402)))
    talk.tell(userdata(0, head(0, 4, 3)))
    talk.tell(words(99, 1))
    talk.ask(read(5, dbw(1, 0)))
    talk.close()
    return talk


def test_every_outcome_is_counted() -> None:
    analysis = fold(everything())
    assert sums(analysis) == {
        "total": 7,
        "answered": 4,
        "unanswered": 1,
        "orphans": 1,
        "unsolicited": 1,
        "with_errors": 3,
    }
    assert analysis.unanswered_reasons == {"connection_closed": 1}
    slugs = [finding.slug for finding in analysis.findings]
    assert [slug for slug in slugs if slug.startswith("transaction.")] == [
        "transaction.item_error",
        "transaction.refused",
        "transaction.refused",
        "transaction.orphan",
        "transaction.unanswered",
    ]
    assert [connection.number for connection in analysis.connections] == [1]


def test_functions_by_name() -> None:
    told = {
        statistics.name: (statistics.total, statistics.answered, statistics.unanswered, statistics.errors)
        for statistics in fold(everything()).functions.values()
    }
    assert told == {
        "Read Var": (4, 2, 1, 1),
        "Start upload": (1, 1, 0, 1),
        "CPU functions: read SZL": (1, 1, 0, 1),
        "CPU functions: diagnostic message": (1, 0, 0, 0),
    }


def test_answer_times_in_all_and_by_function() -> None:
    analysis = fold(everything())
    assert analysis.latencies.as_dict() == {"min": MS, "median": 6 * MS, "p95": 9 * MS, "p99": 9 * MS, "max": 9 * MS}
    reads = analysis.functions[4].latencies
    assert (reads.count, reads.as_dict()["min"], reads.as_dict()["max"]) == (2, 5 * MS, 7 * MS)


#: What a client does next: asks and waits so long for the answer, is refused, asks in vain; or the server pushes.
STEPS = st.lists(st.sampled_from(["good", "refused", "item", "silent", "push", "orphan", "szl"]), max_size=25)


@given(STEPS)
def test_sums_add_up(steps: list[str]) -> None:
    talk = Talk()
    talk.open(8, 8)
    for number, step in enumerate(steps, 1):
        if step == "push":
            talk.tell(userdata(0, head(0, 4, 3)))
        elif step == "orphan":
            talk.tell(words(1000 + number, 1))
        elif step == "szl":
            talk.ask(userdata(number, head(1, 4, 1)))
            talk.tell(userdata(number, head(2, 4, 1, 1, 0), payload(bytes(8))))
        else:
            talk.ask(read(number, dbw(1, 0)))
            answers = {"good": words(number, 1), "refused": ack(number, 0x8104), "item": None, "silent": None}
            answer = answers[step] or ack_data(number, b"\x04\x01", refused(5))
            if step != "silent":
                talk.tell(answer)
    talk.close()
    analysis = fold(talk)
    assert sums(analysis) == {
        "total": len(steps),
        "answered": sum(steps.count(step) for step in ("good", "refused", "item", "szl")),
        "unanswered": steps.count("silent"),
        "orphans": steps.count("orphan"),
        "unsolicited": steps.count("push"),
        "with_errors": steps.count("refused") + steps.count("item"),
    }
    functions = analysis.functions.values()
    assert analysis.total == sum(statistics.total for statistics in functions)
    assert analysis.answered == sum(statistics.answered for statistics in functions) == analysis.latencies.count
    assert analysis.answered == sum(statistics.latencies.count for statistics in functions)
    assert analysis.unanswered == sum(statistics.unanswered for statistics in functions)
    assert analysis.unanswered == sum(analysis.unanswered_reasons.values())
    assert analysis.with_errors == sum(statistics.errors for statistics in functions)
    connection = talk.connections[0]
    assert connection.answered == analysis.answered + 1  # the setup, which was before
    assert (connection.unanswered, connection.orphans) == (analysis.unanswered, analysis.orphans)
    assert (connection.unsolicited, connection.errors) == (analysis.unsolicited, analysis.with_errors)
    assert len(analysis.failed) == analysis.unanswered + analysis.with_errors


# ---- what is kept ---------------------------------------------------------------------------------------------------


def taking(durations: list[int]) -> list[Transaction]:
    """Transactions that took so long."""
    talk = Talk(slow_ns=10**18)
    talk.open()
    for number, duration in enumerate(durations):
        talk.ask(read(number & 0xFFFF, dbw(1, 0)))
        talk.tell(words(number & 0xFFFF, 1), after_ns=duration)
    return talk.transactions


@given(st.lists(st.integers(0, 5), max_size=40))
def test_the_slowest_are_kept_the_earlier_first(durations: list[int]) -> None:
    analysis = Analysis()
    transactions = taking(durations)
    for transaction in transactions:
        analysis.transaction(transaction)
    expected = sorted(transactions, key=lambda one: (-(one.latency_ns or 0), one.number))[:MAX_SLOWEST]
    assert [one.number for one in analysis.slowest()] == [one.number for one in expected]


def test_failed_transactions_are_bounded_and_each_is_kept_once() -> None:
    talk = Talk()
    talk.open(8, 8)
    for number in range(MAX_FAILED + 20):
        talk.ask(read(number, dbw(1, 0)))
        talk.tell(ack(number, 0x8104))
    analysis = fold(talk)
    assert analysis.failed == talk.transactions[:MAX_FAILED]
    assert analysis.with_errors == MAX_FAILED + 20


def test_connections_are_listed_up_to_a_bound() -> None:
    talk = Talk()
    talk.open()
    talk.finish()
    analysis = Analysis()
    for _ in range(MAX_CONNECTIONS + 7):
        analysis.connection_closed(talk.connections[0])
    assert (len(analysis.connections), analysis.connections_not_listed) == (MAX_CONNECTIONS, 7)


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2), st.booleans(), st.integers(0, 3)), max_size=12))
def test_the_worst_connections_come_first(made: list[tuple[int, int, bool, int]]) -> None:
    """Most unanswered, refused and with errors, then most PDUs, then the first."""
    analysis = Analysis()
    tcp = TcpConnection(Endpoint(b"\n\0\0\1", 1024), Endpoint(b"\n\0\0\2", 102), 0, 1, 1)
    for number, (missed, errors, turned_down, pdus) in enumerate(made, 1):
        connection = Connection(number, tcp)
        connection.unanswered, connection.errors, connection.pdus = missed, errors, pdus
        connection.refused = "why" if turned_down else ""
        analysis.connection_closed(connection)
    places = sorted(range(len(made)), key=lambda at: (-sum(made[at][:3]), -made[at][3], at))
    for most in (1, 3, 20):
        assert [one.number - 1 for one in analysis.worst_connections(most)] == places[:most]


class Behind(Observer):
    """Hands on what stations state, as all do who stand between a pipeline and an analysis."""

    def __init__(self, analysis: Analysis) -> None:
        super().__init__()
        self.analysis = analysis

    def fact(self, fact: Fact) -> None:
        self.analysis.fact(fact)


def test_what_stations_state_is_kept_once() -> None:
    """The book of an analysis that is the observer itself is the engine's, any other it fills by itself: they say the same."""
    own, behind = Analysis(), Analysis()
    for observer in (own, Behind(behind)):
        run = Run([str(ROOT / "captures/szl.pcapng")], observer, Options(strict=True))
        while run.step():
            pass
    (book, engine), other = (own.stations, own.own_book), behind.stations
    assert book is engine
    assert not own.wants_facts
    assert (book.filled, other.filled) == (True, False)
    assert counts(book) == counts(other)
    assert len(counts(book)) > 1


def counts(book: Book) -> list[tuple[str, str, str, str, int]]:
    return [
        (station.host, module, key, stretch.value, stretch.count)
        for station in book.stations.values()
        for (module, key), stretches in station.facts.items()
        for stretch in stretches
    ]


def test_findings_are_kept_in_order() -> None:
    analysis = Analysis()
    findings = [Finding(CATALOGUE[slug], 0, [], 0, "") for slug in ("stream.hole", "tpkt.garbage", "stream.hole")]
    for finding in findings:
        analysis.finding(finding)
    assert [finding.slug for finding in analysis.findings] == [finding.slug for finding in findings]


@pytest.mark.parametrize(
    ("frame", "place"),
    [(1, ("a", 1)), (10, ("a", 10)), (11, ("b", 1)), (12, ("d", 1)), (500, ("d", 489))],
)
def test_a_packet_is_found_in_its_file(frame: int, place: tuple[str, int]) -> None:
    """The third file is empty, so the fourth begins with the same number."""
    talk = Talk()
    analysis = Analysis()
    analysis.take(talk.pipeline, [SourceFile("a", 1), SourceFile("b", 11), SourceFile("c", 12), SourceFile("d", 12)])
    assert analysis.locate(frame) == place


def test_an_analysis_says_what_the_contract_has() -> None:
    talk = everything()
    analysis = fold(talk)
    analysis.take(talk.pipeline, [SourceFile("a", 1)])
    told = analysis.as_dict()
    assert told["schema"] == "s7dissect.analysis/1"
    assert told["transactions"] == {
        "total": 7,
        "answered": 4,
        "unanswered": 1,
        "still_open": 0,
        "orphan_answers": 1,
        "unsolicited": 1,
        "one_way": 0,
        "with_errors": 3,
        "unanswered_reasons": {"connection_closed": 1},
    }


def test_an_answer_that_came_late_is_the_slowest() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1), after_ns=3 * SECOND)
    analysis = fold(talk)
    assert [transaction.latency_ns for transaction in analysis.slowest()] == [3 * SECOND]
    assert [finding.slug for finding in analysis.findings] == ["transaction.slow"]
