"""What a sieve passes on: each thing by its own fields, or with the transactions that are selected."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any, Final

import pytest

from dissect.engine.acts.act import Act
from dissect.engine.findings.bounds import MAX_DETAILED
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.stations.facts import MAC, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.select import Where, sieve
from dissect.meaning.select.sieve import Numbers, Sieve
from dissect.meaning.select.things import CONNECTION, FINDING, OPERATION, TRANSACTION
from tests.cases import each
from tests.engine.findings import events
from tests.engine.program.transfers import carry, upload
from tests.engine.stations.answers import identification, szl
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import CLIENT, Talk, dbw, read, words
from tests.meaning.bindings import plant as plant_of_scd

Event = tuple[str, object]


class Kept(Observer):
    """Keeps what comes, in its order."""

    def __init__(self, every: bool = False) -> None:
        super().__init__()
        self.wants_pdus = self.wants_tpdus = True
        self.wants_every_finding = every
        self.events: list[Event] = []
        self.findings: list[Finding] = []

    def of(self, kind: str) -> list[object]:
        return [what for one, what in self.events if one == kind]

    def connection_opened(self, connection: Connection) -> None:
        self.events.append(("opened", int(connection.number)))

    def connection_closed(self, connection: Connection) -> None:
        self.events.append(("closed", int(connection.number)))

    def transaction(self, transaction: Transaction) -> None:
        self.events.append(("transaction", int(transaction.number)))

    def operation(self, operation: Operation) -> None:
        self.events.append(("operation", operation.kind))

    def act(self, act: Act) -> None:
        self.events.append(("act", act.kind))

    def finding(self, finding: Finding) -> None:
        self.findings.append(finding)
        self.events.append(("finding", finding.slug))

    def fact(self, fact: Fact) -> None:
        self.events.append(("fact", (fact.key, tuple(fact.frames))))

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self.events.append(("pdu", int(frame)))

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        self.events.append(("scd", int(frame)))

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.events.append(("tpdu", int(frame)))

    def comment(self, frame: int, text: str) -> None:
        self.events.append(("comment", (int(frame), text)))


def plant(talk: Talk) -> None:
    """Transactions, each with a reference of its own: a setup, an upload (11 to 13, 911), a stop, an SZL, two reads."""
    talk.macs = [b"\2\0\0\0\0\1", b"\2\0\0\0\0\2"]
    talk.hello()
    talk.connect()
    talk.ask(line.setup(1))
    talk.tell(line.granted(1))
    carry(talk, upload(bytes(range(30)), "_0800001A", 7, 20, ref=11))
    talk.ask(events.stop(21))
    talk.tell(events.answered(21, 0x29))
    szl(talk, 31, identification("6ES7 315-2EH14-0AB0", (3, 2, 6)))
    talk.ask(read(41, dbw(9, 0)))
    talk.tell(line.ack_data(41, b"\x04\x01", line.refused(0x0A)))
    talk.ask(read(42, dbw(1, 0)))
    talk.tell(words(42, 7))
    talk.close()


def through(expression: str, say: Callable[[Talk], None] = plant, at_once: bool = False) -> tuple[Kept, Sieve, Talk]:
    """Return what came through a sieve, the sieve, and the talk."""
    kept, talk = Kept(), Talk()
    made = Sieve(kept, Where(expression), at_once) if expression else None
    talk.pipeline = Pipeline(made or kept, Options(strict=True))
    say(talk)
    return kept, made or Sieve(kept, Where("failed")), talk


class Whole(Talk):
    """A talk that keeps facts as well."""

    def __init__(self) -> None:
        super().__init__()
        self.facts: list[Fact] = []

    def fact(self, fact: Fact) -> None:
        self.facts.append(fact)


WHOLE: Final = Whole()
plant(WHOLE)


@each("one", WHOLE.transactions)
def test_with_a_transaction_come_its_connection_operation_acts_and_findings(one: Transaction) -> None:
    """Fields that only transactions and messages have: all else is selected with the transaction."""
    for at_once in (False, True):
        kept, made, talk = through(f"pdu_ref == {one.pdu_ref}", at_once=at_once)
        number, frames = int(one.number), {int(frame) for frame in one.frames}
        operations = [other for other in WHOLE.operations if number in other.transactions]
        findings = [other for other in WHOLE.findings if frames & set(map(int, other.frames))]
        assert kept.of("transaction") == [number]
        assert kept.of("operation") == [other.kind for other in operations]
        assert kept.of("act") == [act.kind for act in WHOLE.acts if number in act.transactions]
        assert (kept.of("opened"), kept.of("closed")) == ([], [1])
        facts = [fact for fact in WHOLE.facts if fact.key == MAC or frames & set(fact.frames)]
        assert kept.of("fact") == [(fact.key, tuple(fact.frames)) for fact in facts]
        assert sorted(kept.of("pdu")) == sorted(frames)  # type: ignore[type-var]
        if not at_once:
            assert sorted(map(str, kept.of("finding"))) == sorted(finding.slug for finding in findings)
            assert made.passed[FINDING] == len(findings)
        part = made.part(talk.pipeline)
        counts = (
            part.transactions,
            part.operations,
            part.connections,
            part.findings,
            part.findings_not_judged,
            part.not_read,
        )
        left = len(WHOLE.findings) - made.passed[FINDING]
        assert counts == (len(WHOLE.transactions) - 1, len(WHOLE.operations) - len(operations), 0, left, 0, 0)
        assert part.passed == 1 + len(operations) + made.passed[FINDING] + 1 + len(frames)
        assert part.where == f"pdu_ref == {one.pdu_ref}"
        assert sum(part.finding_counts.values()) + sum(part.explained_counts.values()) == made.passed[FINDING]
        assert not made.nothing


def test_the_talk_has_all_of_it() -> None:
    assert {act.kind for act in WHOLE.acts} >= {"stop", "upload"}
    assert len(WHOLE.operations) >= 2
    assert len(WHOLE.transactions) == 9
    assert {finding.slug for finding in WHOLE.findings} >= {"security.plc_stop", "transaction.item_error"}
    assert {fact.key for fact in WHOLE.facts} > {MAC}


def test_things_that_have_the_fields_are_selected_by_their_own() -> None:
    kept, made, _ = through("port == 102")
    assert (kept.of("opened"), kept.of("closed")) == ([1], [1])
    assert kept.of("transaction") == [int(one.number) for one in WHOLE.transactions]
    assert kept.of("operation") == [one.kind for one in WHOLE.operations]
    assert kept.of("act") == [one.kind for one in WHOLE.acts]
    assert made.left_out == dict.fromkeys((TRANSACTION, OPERATION, FINDING, CONNECTION), 0)
    kept, made, _ = through("kind == upload")
    assert [kind for kind, _ in kept.events if kind not in {"tpdu", "fact"}] == ["act", "operation"]
    assert made.passed == {TRANSACTION: 0, OPERATION: 1, FINDING: 0, CONNECTION: 0}
    assert not made.nothing
    assert made.left_out == {
        TRANSACTION: 9, OPERATION: len(WHOLE.operations) - 1, FINDING: len(WHOLE.findings), CONNECTION: 1,
    }  # fmt: skip
    kept, made, _ = through("slug == security.plc_stop")
    assert [event for event in kept.events if event[0] not in {"tpdu", "fact"}] == [("finding", "security.plc_stop")]
    assert (made.passed[FINDING], made.findings) == (1, {"security.plc_stop": 1})


def test_where_nothing_is_selected_nothing_comes() -> None:
    kept, made, talk = through("host == 10.0.0.9")
    assert {kind for kind, _ in kept.events} == {"tpdu", "fact"}
    assert {fact[0] for fact in kept.of("fact")} == {MAC}  # type: ignore[index]
    assert made.nothing
    part = made.part(talk.pipeline)
    assert (part.passed, part.connections, part.transactions) == (0, 1, 9)
    whole, _, _ = through("")
    assert kept.of("tpdu") == whole.of("tpdu")


def test_messages_alone_are_something() -> None:
    _, made, _ = through("src == 10.0.0.1")
    assert not made.nothing
    assert made.messages == 9
    _, made, _ = through("latency > 1h")  # messages have none
    assert (made.nothing, made.messages) == (True, 0)


def test_a_message_behind_a_malformed_header() -> None:
    """The length of the first odd header leaves out its last octet, that of the second has one too many of the PDU."""
    too_short = line.tpkt(b"\x01\xf0" + read(42, dbw(1, 0)))
    too_long = line.tpkt(b"\x03\xf0\x80" + read(43, dbw(1, 0)))

    def say(talk: Talk) -> None:
        talk.open()
        talk.packet(CLIENT, too_short)  # 8
        talk.tell(words(42, 7))
        talk.packet(CLIENT, too_long)  # 10
        talk.tell(words(43, 7))
        talk.close()

    for expression, frames in (("behind_malformed", [8]), ("not behind_malformed", [6, 7, 9, 10, 11])):
        assert through(expression, say)[0].of("pdu") == frames


def test_messages_of_scd_are_selected_by_their_own_fields() -> None:
    for expression, frames in (
        ("scd.tid == 7", [1, 2]), ("cut", []), ("not cut", [1, 2, 3]), ("behind_malformed", []), ("src == 10.0.0.2", [2]),
    ):  # fmt: skip
        kept = Kept()
        talk = Talk()
        talk.pipeline = Pipeline(Sieve(kept, Where(expression)), Options(strict=True, decoder=plant_of_scd.carrier()))
        talk.datagram(0, plant_of_scd.ask("0x6001:0", tid=7))
        talk.datagram(1, plant_of_scd.tell("0x6001:0", 50, tid=7))
        talk.datagram(0, plant_of_scd.ask("0x6001:0", tid=8))
        talk.finish()
        assert kept.of("scd") == frames


def test_findings_beyond_the_limit_of_the_engine_are_judged_as_well() -> None:
    def say(talk: Talk) -> None:
        talk.open()
        for ref in range(MAX_DETAILED + 20):
            talk.ask(read(ref, dbw(9, 0)))
            talk.tell(line.ack_data(ref, b"\x04\x01", line.refused(0x0A)))
        talk.close()

    kept, made, talk = through("slug == transaction.item_error", say)
    assert made.findings == {"transaction.item_error": MAX_DETAILED + 20}
    assert len(kept.findings) == MAX_DETAILED
    assert made.part(talk.pipeline).findings_not_judged == 0


def test_a_fact_before_any_transaction_is_of_none() -> None:
    made, kept = sieved()
    for key in ("firmware", MAC):
        made.fact(Fact("10.0.0.2", "", key, "x", "", 1, [5], 0))
    assert kept.of("fact") == [(MAC, (5,))]


def test_a_comment_of_a_packet_always_comes() -> None:
    kept = Kept()
    Sieve(kept, Where("host == 10.0.0.9")).comment(3, "hello")
    assert kept.events == [("comment", (3, "hello"))]


# ---- findings that wait ---------------------------------------------------------------------------------------------


def about(slug: str, *frames: int, connection: int = 1, **more: Any) -> Finding:
    made = Finding(CATALOGUE[slug], connection, list(frames), 0, "")
    made.client, made.server = "10.0.0.1", "10.0.0.2"
    for name, value in more.items():
        setattr(made, name, value)
    return made


SLOW: Final = "transaction.slow"
STOP: Final = next(one for one in WHOLE.transactions if one.pdu_ref == 21)
LINE: Final = WHOLE.connections[0]


def sieved(expression: str = "pdu_ref == 21", at_once: bool = False, every: bool = False) -> tuple[Sieve, Kept]:
    """A sieve with an open connection."""
    kept = Kept(every)
    made = Sieve(kept, Where(expression), at_once=True) if at_once else Sieve(kept, Where(expression))
    made.connection_opened(LINE)
    return made, kept


def frame_of(one: Transaction) -> int:
    return int(one.request_frame)


def test_a_finding_waits_for_its_transaction_until_the_connection_is_over() -> None:
    made, kept = sieved()
    made.finding(about(SLOW, frame_of(STOP)))
    made.finding(about(SLOW, 10_000))
    assert kept.events == []
    made.transaction(STOP)
    made.connection_closed(LINE)
    assert kept.events == [("transaction", int(STOP.number)), ("finding", SLOW), ("closed", 1)]
    assert (made.passed[FINDING], made.left_out[FINDING]) == (1, 1)
    made.finding(about(SLOW, frame_of(STOP)))  # late, but what it names is known
    assert made.passed[FINDING] == 2
    made.finding(about(SLOW, 10_000))
    assert made.left_out[FINDING] == 2


@each(
    ("at_once", "connection"),
    [(True, 1), (False, 2), (False, 0)],
)
def test_a_finding_is_judged_at_once_live_and_without_an_open_connection(at_once: bool, connection: int) -> None:
    made, kept = sieved(at_once=at_once)
    made.finding(about(SLOW, frame_of(STOP), connection=connection))
    assert made.left_out[FINDING] == 1
    made.transaction(STOP)
    made.connection_closed(LINE)
    assert kept.of("finding") == []


def test_the_packet_of_either_half_selects_a_finding() -> None:
    for frame in STOP.frames:
        made, kept = sieved()
        made.transaction(STOP)
        made.finding(about(SLOW, 9_999, int(frame)))
        assert kept.of("finding") == [SLOW]


def test_twenty_thousand_findings_wait() -> None:
    made, _ = sieved()
    one = about(SLOW, frame_of(STOP))
    for _ in range(20_000):
        made.finding(one)
    assert made.left_out[FINDING] == 0
    made.finding(one)
    assert made.left_out[FINDING] == 1
    made.transaction(STOP)
    made.connection_closed(LINE)
    assert made.passed[FINDING] == 20_000


def test_so_many_findings_wait_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sieve, "MAX_WAITING", 3)
    made, kept = sieved()
    for _ in range(5):
        made.finding(about(SLOW, frame_of(STOP)))
    assert made.left_out[FINDING] == 2
    made.connection_closed(LINE)
    assert made.left_out[FINDING] == 5
    made.connection_opened(LINE)  # those that waited wait no longer, so that others may
    for _ in range(5):
        made.finding(about(SLOW, frame_of(STOP)))
    assert made.left_out[FINDING] == 7
    made.transaction(STOP)
    made.connection_closed(LINE)
    assert (made.passed[FINDING], kept.of("finding")) == (3, [SLOW] * 3)


def test_what_is_selected_is_counted_by_slug_and_cause() -> None:
    made, kept = sieved("connection == 1")
    made.finding(about(SLOW, 5))
    made.finding(about(SLOW, 6))
    made.finding(about("transaction.unanswered", 7, because="tcp.gap"))
    made.finding(about("transaction.unanswered", 8, because="tcp.gap"))
    made.finding(about(SLOW, 9, reported=False, bare=True))
    made.finding(about(SLOW, 9, connection=0))
    assert made.findings == {SLOW: 2}
    assert made.explained == {("tcp.gap", "transaction.unanswered"): 2}
    assert (made.passed[FINDING], made.left_out[FINDING]) == (4, 1)
    assert [finding.frames for finding in kept.findings] == [[5], [6], [7], [8]]
    assert made.own_ledger is not None
    assert (made.own_ledger.rule(SLOW).events, made.own_ledger.rule(SLOW).reports) == (3, 2)
    assert made.own_ledger.explanation("tcp.gap", "transaction.unanswered").reports == 2


def test_an_observer_of_every_finding_gets_the_bare_ones_too() -> None:
    made, kept = sieved("connection == 1", every=True)
    made.finding(about(SLOW, 9, reported=False, bare=True))
    assert [finding.frames for finding in kept.findings] == [[9]]
    assert (made.passed[FINDING], made.findings) == (0, {})


@each(("at_once", "every"), [(False, False), (True, False), (False, True)])
def test_of_very_many_findings_a_bounded_number_is_passed_on(at_once: bool, every: bool) -> None:
    """Not live, where each is shown when it comes; explained ones have a number of their own."""
    count = MAX_DETAILED + 10
    made, kept = sieved("connection == 1", at_once, every)
    for frame in range(1, count + 1):
        made.finding(about(SLOW, frame))
        made.finding(about(SLOW, frame, because="tcp.gap"))
    shown = count if at_once or every else MAX_DETAILED
    assert len([one for one in kept.findings if not one.because]) == shown
    assert len([one for one in kept.findings if one.because]) == shown
    assert made.findings == {SLOW: count}
    assert made.explained == {("tcp.gap", SLOW): count}


def test_findings_that_a_sieve_never_got_are_said_not_to_be_judged() -> None:
    reported = len(WHOLE.findings)
    made, _ = sieved("connection == 1")
    assert made.part(WHOLE.pipeline).findings_not_judged == reported
    made.finding(about(SLOW, 5))
    made.finding(about(SLOW, 5, connection=0))  # judged, and not selected
    part = made.part(WHOLE.pipeline)
    assert (part.findings_not_judged, part.findings, part.passed) == (reported - 2, 1, 1)
    assert part.ledger is made.own_ledger
    assert part.finding_counts == {SLOW: 1}
    for _ in range(reported):
        made.finding(about(SLOW, 5))
    assert made.part(WHOLE.pipeline).findings_not_judged == 0


def test_explained_findings_that_a_sieve_never_got_count_as_well() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, line.item(0x84, 1, 0, 1, 9)))  # nine bits at once, which explains the refusal
    talk.tell(line.ack_data(1, b"\x04\x01", line.refused(0x06)))
    talk.close()
    explained = [one for one in talk.findings if one.because]
    assert 0 < len(explained) < len(talk.findings)
    made, _ = sieved()
    assert made.part(talk.pipeline).findings_not_judged == len(talk.findings)


# ---- acts -----------------------------------------------------------------------------------------------------------


def test_an_act_that_lasts_but_has_no_operation_goes_with_its_transaction() -> None:
    for expression, shown in (
        ("pdu_ref == 21", ["upload"]),
        ("pdu_ref == 22", []),
        ("transaction_count > 0 or failed", []),
    ):
        made, kept = sieved(expression)
        made.transaction(STOP)
        made.act(Act("upload", LINE, 0))
        assert kept.of("act") == shown


# ---- numbers --------------------------------------------------------------------------------------------------------


def test_every_number_of_a_page_has_a_bit_of_its_own() -> None:
    for begin in (0, 3 * 32_768, 511 * 32_768):
        numbers = Numbers()
        some = {begin, begin + 1, begin + 7, begin + 8, begin + 100, begin + 32_766, begin + 32_767}
        for number in some:
            numbers.add(number)
        assert {number for number in range(begin, begin + 32_768) if number in numbers} == some
        assert begin + 32_768 not in numbers


def test_sixteen_million_numbers_are_kept_in_two_mebibytes() -> None:
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        numbers = Numbers()
        for page in range(512):
            numbers.add(page * 32_768)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert 2 * 1024 * 1024 < after - before < 2.25 * 1024 * 1024
    assert 0 in numbers
    numbers.add(512 * 32_768)
    assert [page for page in (0, 1, 511, 512) if page * 32_768 in numbers] == [1, 511, 512]
