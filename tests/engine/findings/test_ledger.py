"""The facts of each rule are those of all its events, whatever of them is detailed."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.findings import ledger
from dissect.engine.findings.catalogue import CATALOGUE, CONNECTION, EACH, ONE, REPORTED, REQUEST
from dissect.engine.findings.ledger import Ledger, Occurrences
from dissect.engine.findings.reporter import MAX_DETAILED, Reporter
from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from dissect.files.jobs.numbers import Offsets
from dissect.files.jobs.sending import receive, send
from tests.engine.transactions.talk import (
    MS,
    SECOND,
    START_NS,
    SYN,
    Talk,
    ack_data,
    dbw,
    item,
    read,
    refused,
    words,
    write,
    written,
)

DB: int = 0x84
OUTPUTS: int = 0x82


def facts(talk: Talk, slug: str) -> Occurrences:
    return talk.pipeline.exchange.reporter.ledger.rules[slug]


def put(talk: Talk, number: int, area: int = DB, code: int = 0xFF) -> int:
    """A write of a byte and its answer; return the packet of the answer."""
    talk.ask(write(number, [item(area, 1 if area == DB else 0, 8, 2)], written(4, b"\x01")), after_ns=SECOND)
    return talk.tell(ack_data(number, b"\x05\x01", bytes((code,))))


def refuse(talk: Talk, count: int) -> None:
    for number in range(1, count + 1):
        talk.ask(read(number, dbw(9, 0)), after_ns=SECOND - MS)
        talk.tell(ack_data(number, b"\x04\x01", refused(0x0A)))


def test_refusals_beyond_the_details_count() -> None:
    talk = Talk()
    talk.open()
    refuse(talk, 3 * MAX_DETAILED)
    talk.close()
    found = facts(talk, "transaction.item_error")
    assert (found.events, found.reports, found.connections) == (300, 300, 1)
    assert found.last_ns - found.first_ns == 299 * SECOND
    assert talk.slugs().count("transaction.item_error") == MAX_DETAILED
    asked = [transaction for transaction in talk.transactions if transaction.has_errors]
    assert (found.first_frame, found.last_frame) == (asked[0].request_frame, asked[-1].response_frame)


def test_writes_are_reported_once_and_all_counted() -> None:
    talk = Talk()
    talk.open()
    last = [put(talk, number) for number in range(1, 28)][-1]
    talk.close()
    found = facts(talk, "security.write")
    assert (found.events, found.reports, found.connections, found.last_frame) == (27, 1, 1, last)
    assert found.last_ns - found.first_ns == 26 * (SECOND + MS)
    assert talk.slugs().count("security.write") == 1
    assert talk.pipeline.finding_counts["security.write"] == 1


def test_a_refused_write_is_no_write() -> None:
    talk = Talk()
    talk.open()
    for number, code in enumerate((0xFF, 0x0A, 0xFF, 0x0A, 0x0A), 1):
        put(talk, number, code=code)
    talk.close()
    assert facts(talk, "security.write").events == 2
    assert (facts(talk, "security.write_refused").events, facts(talk, "security.write_refused").reports) == (3, 1)


def test_writes_to_both_kinds_of_areas_count_for_each() -> None:
    talk = Talk()
    talk.open()
    for number in range(1, 4):
        put(talk, number, OUTPUTS)
        put(talk, 100 + number, DB)
    put(talk, 200, OUTPUTS)
    talk.close()
    assert facts(talk, "security.write_outputs").events == 4
    assert facts(talk, "security.write").events == 3


def test_writes_of_several_kinds_of_areas_and_connections_are_all_counted() -> None:
    """They are added up on their way, and a few at a time are counted."""
    first = Talk()
    first.open()
    other = Talk(50001, beside=first)
    other.open()
    for number in range(1, 60):
        put(first, number, OUTPUTS if number % 7 == 0 else DB, 0x0A if number % 11 == 0 else 0xFF)
        if number % 2:
            put(other, number)
    first.finish()
    outputs, elsewhere = facts(first, "security.write_outputs"), facts(first, "security.write")
    assert (outputs.events, outputs.connections) == (len([n for n in range(1, 60) if n % 7 == 0 and n % 11]), 1)
    own = [n for n in range(1, 60) if n % 7 and n % 11]
    assert (elsewhere.events, elsewhere.connections) == (len(own) + 30, 2)
    done = [transaction for transaction in first.transactions if transaction.function == 5]
    assert elsewhere.last_frame == done[-1].response_frame
    assert elsewhere.last_ns == done[-1].response_ns
    (pair,) = first.pipeline.exchange.reporter.ledger.pairs_of("security.write")
    assert pair.records["security.write"].events == elsewhere.events


def test_what_a_rule_says_once_for_a_side_counts_each_time() -> None:
    talk = Talk()
    talk.open()
    for number in range(1, 6):
        pdu = bytearray(read(number, dbw(1, 0)))
        pdu[2:4] = b"\x12\x34"
        talk.ask(bytes(pdu))
        talk.tell(words(number, 7))
    talk.close()
    found = facts(talk, "s7.redundancy_id")
    assert (found.events, found.reports) == (5, 1)


def test_pairs_of_hosts_have_facts_of_their_own() -> None:
    first = Talk()
    first.open()
    others = []
    for host in range(11, 14):
        other = Talk(50000 + host, beside=first)
        other.hosts = [host, 2]
        other.open()
        others.append(other)
    refuse(first, 150)
    refuse(others[0], 1)
    refuse(others[1], 2)
    first.finish()
    told = first.pipeline.exchange.reporter.ledger
    slug = "transaction.item_error"
    assert [(pair.client, pair.server, pair.records[slug].events) for pair in told.pairs_of(slug)] == [
        ("10.0.0.1", "10.0.0.2", 150),
        ("10.0.0.12", "10.0.0.2", 2),
        ("10.0.0.11", "10.0.0.2", 1),
    ]
    assert told.hosts_of(slug) == 4
    assert told.rules[slug].connections == 3
    assert told.further(slug) == 0


def test_attempts_without_a_connection_have_hosts() -> None:
    talk = Talk()
    for port in range(50000, 50003):
        scan = Talk(port, beside=talk)
        scan.hosts = [port - 49990, 9]
        for _ in range(3):
            scan.packet(0, flags=SYN, seq=77, after_ns=SECOND)
    talk.finish()
    told = talk.pipeline.exchange.reporter.ledger
    assert told.rules["stream.unanswered"].events == 3
    assert {(pair.client, pair.server) for pair in told.pairs_of("stream.unanswered")} == {
        ("10.0.0.10", "10.0.0.9"),
        ("10.0.0.11", "10.0.0.9"),
        ("10.0.0.12", "10.0.0.9"),
    }
    assert {(finding.client, finding.server) for finding in talk.findings} == {
        ("10.0.0.10", "10.0.0.9"),
        ("10.0.0.11", "10.0.0.9"),
        ("10.0.0.12", "10.0.0.9"),
    }


def test_beyond_so_many_pairs_the_rest_is_added_up() -> None:
    told = Ledger()
    for host in range(ledger.MAX_PAIRS + 50):
        for _ in range(2):
            told.take("stream.refused", told.between(f"c{host}", "s"), 0, 1, 1, host, True)
    assert len(told.pairs_of("stream.refused")) == ledger.MAX_PAIRS
    assert told.further("stream.refused") == 100
    assert told.rules["stream.refused"].events == 2 * (ledger.MAX_PAIRS + 50)


def test_what_is_explained_is_in_no_other_record() -> None:
    reporter = Reporter()
    reporter.note("s7.malformed", 1, [3], 30)
    reporter.blame("s7.malformed")
    reporter.note("transaction.refused", 1, [4, 5], 40)
    reporter.because = None
    assert reporter.ledger.rules.keys() == {"s7.malformed"}
    found = reporter.ledger.explained["s7.malformed", "transaction.refused"]
    assert (found.events, found.first_frame, found.last_frame, found.last_ns) == (1, 4, 5, 40)


def test_still_in_the_last_tenth() -> None:
    found = Occurrences()
    found.take(1, 1, 1, 5 * SECOND, True)
    assert not found.lasts(0, 100 * SECOND)
    found.take(1, 2, 2, 89 * SECOND, True)
    assert not found.lasts(0, 100 * SECOND)
    found.take(1, 3, 3, 90 * SECOND, True)
    assert found.lasts(0, 100 * SECOND)


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 1000), st.booleans()), max_size=60), st.integers(0, 60))
def test_parts_add_up_to_the_whole(events: list[tuple[int, int, bool]], cut: int) -> None:
    """Connections of a later part are others than those of an earlier one."""
    whole, first, second = Occurrences(), Occurrences(), Occurrences()
    for place, (connection, time_ns, reported) in enumerate(events):
        own = connection + 100 if place >= cut and connection else connection
        whole.take(own, place, place + 1, time_ns, reported)
        (first if place < cut else second).take(connection, place, place + 1, time_ns, reported)
    first.merge(second)
    assert repr(first) == repr(whole)
    for name in ("first_ns", "first_frame", "last_ns", "last_frame", "at_least"):
        assert getattr(first, name) == getattr(whole, name), name


@given(st.lists(st.integers(1, 30), max_size=200))
def test_connections_are_counted_while_few_come_back(order: list[int]) -> None:
    found = Occurrences(8)
    for connection in order:
        found.take(connection, 1, 1, 1, True)
    assert found.connections <= len(set(order))
    if not found.at_least:
        assert found.connections == len(set(order))


def test_facts_are_sent_with_the_numbers_of_the_whole_run() -> None:
    talk = Talk()
    talk.open()
    refuse(talk, 2)
    talk.finish()
    got = receive(send(talk.pipeline.exchange.reporter.ledger), Offsets(1000, 50, 5))
    mine = facts(talk, "transaction.item_error")
    theirs = got.rules["transaction.item_error"]
    assert theirs.first_frame == mine.first_frame + 1000
    assert (theirs.events, theirs.first_ns) == (2, mine.first_ns)
    (pair,) = got.pairs.values()
    assert pair.records["transaction.item_error"].last_frame == mine.last_frame + 1000


def test_how_often_rules_report() -> None:
    assert {rule.reported for rule in CATALOGUE.values()} == {*REPORTED}
    assert [CATALOGUE[slug].reported for slug in ("security.plc_stop", "security.write", "s7.odd_address")] == [
        EACH,
        CONNECTION,
        REQUEST,
    ]
    assert CATALOGUE["ip.bad_header"].reported == ONE
    for rule in CATALOGUE.values():
        if "once per connection" in rule.advice:
            assert rule.reported == CONNECTION, rule.slug
        if "once per distinct request" in rule.advice:
            assert rule.reported == REQUEST, rule.slug


def test_a_ledger_forgets_connections_that_are_over() -> None:
    talk = Talk()
    talk.open()
    refuse(talk, 1)
    told = talk.pipeline.exchange.reporter.ledger
    assert told.pair(1).client == "10.0.0.1"
    talk.close()
    assert told.pair(1) is ledger.NO_PAIR
    assert Pipeline(Talk(), Options()).exchange.reporter.ledger.pairs == {}
    assert told.rules["transaction.item_error"].first_ns > START_NS
