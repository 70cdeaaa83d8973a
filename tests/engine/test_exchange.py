"""What becomes of transactions: who is told, what is judged, and what a bug of an observer or a rule costs."""

from __future__ import annotations

from typing import Final

import pytest

from captures.craft.mc7 import OB1, OB1_CHANGED
from dissect.engine.findings.ledger import Ledger
from dissect.engine.findings.reporter import MAX_DETAILED, Finding
from dissect.engine.observer import Observer
from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from dissect.engine.stations.facts import Book, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from tests import build
from tests.cases import each
from tests.engine.findings import block_scenarios, events, operation_scenarios, plus_scenarios
from tests.engine.stations.answers import identification, szl
from tests.engine.transactions.talk import (
    CLIENT,
    MS,
    SECOND,
    SERVER,
    Talk,
    ack_data,
    dbw,
    head,
    item,
    job,
    read,
    refused,
    userdata,
    words,
    write,
    written,
)
from tests.protocols.s7plus.pdus import SET_VARIABLE, asked, framed

OUTPUTS: Final = 0x82
DB: Final = 0x84
STOP: Final = b"\x29" + bytes(5) + b"\x09P_PROGRAM"
CARDS: Final = [bytes.fromhex("001b1b000001"), bytes.fromhex("001b1b000002")]


def behind(pdu: bytes) -> bytes:
    """A PDU behind the header of a DT whose length indicator is impossible."""
    return build.tpkt(b"\x00\xf0\x80" + pdu)


def put(pdu_ref: int, area: int = DB, octets: bytes = b"\x01") -> bytes:
    """A write of one octet."""
    return write(pdu_ref, [item(area, 1 if area == DB else 0, 8, 2)], written(4, octets))


def done(pdu_ref: int, code: int = 0xFF) -> bytes:
    return ack_data(pdu_ref, b"\x05\x01", bytes((code,)))


def details(talk: Talk, slug: str) -> list[str]:
    return [one.detail for one in talk.findings if one.slug == slug]


class Facts(Talk):
    """Writes down what stations say of themselves, among what else is reported."""

    def __init__(self, wants: bool = True, own_book: Book | None = None) -> None:
        super().__init__()
        self.wants_facts = wants
        self.own_book = own_book
        self.pipeline = Pipeline(self, Options(strict=True))
        self.facts: list[tuple[str, str, str]] = []
        self.told: list[str] = []

    def fact(self, fact: Fact) -> None:
        self.facts.append((fact.host, fact.key, fact.value))
        self.told.append("fact")

    def transaction(self, transaction: Transaction) -> None:
        super().transaction(transaction)
        self.told.append("transaction")

    def connection_opened(self, connection: Connection) -> None:
        self.told.append("opened")


# ---- answers in time ------------------------------------------------------------------------------------------------


@each(("after_ns", "slow"), [(SECOND - 1, False), (SECOND, False), (SECOND + 1, True)])
@each("what", ["read", "write", "refused read"])
def test_an_answer_is_slow_when_it_takes_longer_than_the_limit(what: str, after_ns: int, slow: bool) -> None:
    talk = Talk()
    talk.open()
    talk.ask(put(1) if what == "write" else read(1, dbw(1, 0)))
    answer = {"read": words(1, 1), "write": done(1), "refused read": ack_data(1, b"\x04\x01", refused(0x0A))}[what]
    talk.tell(answer, after_ns=after_ns)
    assert ("transaction.slow" in talk.slugs()) is slow
    assert talk.transactions[0].latency_ns == after_ns


@each("after_ns", [0, -1, -MS])
def test_an_answer_before_its_request_is_explained_by_its_times(after_ns: int) -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1), after_ns=after_ns)
    assert ("transaction.reordered" in talk.slugs()) is (after_ns < 0)


def test_a_limit_of_the_user_counts() -> None:
    talk = Talk(slow_ns=5 * MS)
    talk.open()
    for number, after_ns in enumerate((5 * MS, 5 * MS + 1)):
        talk.ask(read(number, dbw(1, 0)))
        talk.tell(words(number, 1), after_ns=after_ns)
    assert len(details(talk, "transaction.slow")) == 1


def test_errors_are_remembered_by_connection_with_or_without_a_request() -> None:
    talk = Talk()
    talk.open(4, 4)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x04\x01", code=0x8104))
    connection = talk.transactions[0].connection
    assert (connection.last_error_code, connection.last_error_ns) == (0x8104, talk.now_ns)
    frame_ns = talk.now_ns + MS
    talk.tell(ack_data(9, b"\x04\x01", code=0xD241))
    talk.silence(2 * SECOND)
    assert (connection.last_error_code, connection.last_error_ns) == (0xD241, frame_ns)
    assert talk.outcomes() == ["answered", "orphan_answer"]


# ---- writes ---------------------------------------------------------------------------------------------------------


def test_the_first_write_to_each_kind_of_area_is_reported_and_each_one_counted() -> None:
    talk = Talk()
    talk.open()
    for number in range(10):
        talk.ask(put(number, OUTPUTS if number % 2 else DB))
        talk.tell(done(number))
    talk.close()
    rules = talk.pipeline.exchange.ledger.rules
    assert (rules["security.write"].events, rules["security.write_outputs"].events) == (5, 5)
    assert len(details(talk, "security.write")) == len(details(talk, "security.write_outputs")) == 1
    frames = [(one.request_frame, one.response_frame) for one in talk.transactions]
    assert (rules["security.write"].first_frame, rules["security.write"].last_frame) == (frames[0][0], frames[8][1])
    assert rules["security.write_outputs"].last_frame == frames[9][1]
    assert [(act.kind, act.outcome) for act in talk.acts] == [("output_write", "accepted")]


def test_a_refused_write_is_no_write_and_one_of_several_that_succeeds_is() -> None:
    talk = Talk()
    talk.open()
    for number, code in enumerate((0xFF, 0x0A, 0xFF, 0x0A)):
        talk.ask(put(number))
        talk.tell(done(number, code))
    talk.close()
    assert talk.pipeline.exchange.ledger.rules["security.write"].events == 2
    assert len(details(talk, "security.write_refused")) == 1


def test_a_write_without_answer_is_reported_at_the_end() -> None:
    talk = Talk()
    talk.open()
    frame = talk.ask(put(1))
    talk.close()
    assert talk.outcomes() == ["unanswered"]
    (finding,) = [one for one in talk.findings if one.slug == "security.write"]
    assert finding.frames == [frame]


@each(("took_ms", "floods"), [(9, True), (20, False)])
def test_many_fast_writes_of_the_same_are_a_flood(took_ms: int, floods: bool) -> None:
    """256 of them; 5 s at the most."""
    talk = Talk()
    talk.open()
    for number in range(256):
        talk.ask(put(number))
        talk.tell(done(number), after_ns=took_ms * MS)
    talk.close()
    assert ("security.flood" in talk.slugs()) is floods
    assert talk.pipeline.exchange.ledger.rules["security.write"].events == 256


def test_refusals_by_protection_are_reported_once() -> None:
    for pdu, answer in (
        (read(1, dbw(1, 0)), ack_data(1, b"\x04\x01", refused(3))),
        (put(1), done(1, 3)),
        (job(1, STOP), ack_data(1, b"\x29", code=0xD241)),
    ):
        talk = Talk()
        talk.open()
        for _ in range(3):
            talk.ask(pdu)
            talk.tell(answer)
        assert len(details(talk, "security.protected")) == 1


# ---- behind malformed headers ---------------------------------------------------------------------------------------


@each(
    ("pdu", "slug"),
    [
        (job(1, STOP), "security.plc_stop"),
        (put(1), "security.write"),
        (put(1, OUTPUTS), "security.write_outputs"),
        (read(1, dbw(1, 0)), ""),
        (framed(asked(1, SET_VARIABLE, body=b"")), None),
    ],
)
def test_what_stands_behind_a_malformed_header_counts_for_security(pdu: bytes, slug: str | None) -> None:
    talk = Talk()
    talk.open()
    talk.findings.clear()
    frame = talk.packet(CLIENT, behind(pdu))
    talk.close()
    (transaction,) = talk.transactions
    assert transaction.is_behind
    found = [(one.slug, one.frames) for one in talk.findings if one.slug.startswith("security.")]
    if slug is not None:
        assert found == ([(slug, [frame])] if slug else [])
    assert bool(talk.acts) is (slug in {"security.plc_stop", "security.write_outputs"})


def test_an_answer_to_a_write_behind_a_malformed_header_is_no_write() -> None:
    talk = Talk()
    talk.open()
    talk.packet(SERVER, behind(done(1)))
    talk.close()
    assert [(one.is_behind, one.request_frame) for one in talk.transactions] == [(True, 0)]
    assert "security.write" not in talk.slugs()


def test_writes_behind_malformed_headers_are_reported_once() -> None:
    talk = Talk()
    talk.open()
    talk.ask(put(1))
    talk.tell(done(1))
    talk.packet(CLIENT, behind(put(2)))
    talk.packet(CLIENT, behind(put(3, OUTPUTS)))
    talk.close()
    assert len(details(talk, "security.write")) == len(details(talk, "security.write_outputs")) == 1


# ---- operations and blocks ------------------------------------------------------------------------------------------


def test_a_download_is_reported_where_its_beginning_was_captured_and_where_not() -> None:
    """With the transaction that begins it, else with what ends it."""
    talk = Talk()
    talk.open()
    first = int(talk.pipeline.frames) + 1
    operation_scenarios.load(talk)
    found = [(one.detail, one.frames) for one in talk.findings if one.slug == "security.program_change"]
    assert len(found) == 1
    assert found[0][1] == [first, first + 1]
    assert "beginning not captured" not in found[0][0]
    late = Talk()  # the capture begins amid it
    for number, more in ((10, True), (11, False)):
        late.tell(events.download_block(number))
        late.ask(events.piece(number, 0x1B, 100, more))
    late.tell(events.download_ended(90))
    late.ask(events.answered(90, 0x1C))
    found = [(one.detail, one.frames) for one in late.findings if one.slug == "security.program_change"]
    assert [detail for detail, _ in found] == [
        "10.0.0.1:50000 to 10.0.0.2:102: download DB 1, passive, 200 bytes, beginning not captured"
    ]
    assert found[0][1][0] == 1
    assert [operation.kind for operation in talk.operations] == ["connect", "download"]
    assert [operation.kind for operation in late.operations] == ["download"]


def test_an_upload_without_its_beginning_is_no_download() -> None:
    talk = Talk()
    talk.open()
    talk.ask(events.upload(2))
    talk.tell(events.piece(2, 0x1E, 78, False))
    talk.ask(events.end_upload(50))
    talk.tell(events.answered(50, 0x1F))
    assert "security.program_change" not in talk.slugs()


def test_an_operation_that_fails_is_reported() -> None:
    for code, reported in ((0, False), (0xD241, True)):
        talk = Talk()
        talk.open()
        operation_scenarios.load(talk, code=code)
        assert ("operation.failed" in talk.slugs()) is reported
        assert [(one.kind, one.result) for one in talk.operations] == [
            ("connect", "done"), ("download", "failed" if code else "done"),
        ]  # fmt: skip


def test_blocks_are_compared() -> None:
    talk = Talk()
    talk.open()
    block_scenarios.read_out(talk, OB1)
    block_scenarios.load(talk, OB1_CHANGED)
    talk.close()
    assert "block.changed" in talk.slugs()


def test_a_block_that_was_loaded_and_not_activated_is_reported_when_its_connection_ends() -> None:
    for activate, reported in ((True, False), (False, True)):
        talk = Talk()
        talk.open()
        block_scenarios.load(talk, OB1, activate=activate)
        assert "block.not_activated" not in talk.slugs()
        talk.close()
        assert ("block.not_activated" in talk.slugs()) is reported


# ---- what stations say ----------------------------------------------------------------------------------------------


def test_addresses_of_network_cards_are_facts_of_the_stations() -> None:
    talk = Facts()
    talk.macs = CARDS
    talk.open()
    assert sorted(talk.facts) == [
        ("10.0.0.1", "mac", "00:1b:1b:00:00:01"),
        ("10.0.0.2", "mac", "00:1b:1b:00:00:02"),
    ]
    assert talk.told[:3] == ["opened", "fact", "fact"]


@pytest.mark.parametrize("wants", [True, False])
def test_what_a_module_says_is_told_where_it_is_wanted_and_kept_always(wants: bool) -> None:
    book = Book()
    talk = Facts(wants, book)
    talk.open()
    szl(talk, 1, identification("6ES7 315-2EH14-0AB0", (3, 2, 6)))
    orders = [value for host, key, value in talk.facts if key == "order_number" and host == "10.0.0.2"]
    assert orders == (["6ES7 315-2EH14-0AB0"] if wants else [])
    if wants:
        assert talk.told[-2:] == ["fact", "fact"]  # after the transaction that stated them
    assert "10.0.0.2" in book.stations


@pytest.mark.parametrize("wants", [True, False])
def test_what_a_cpu_says_in_s7comm_plus_is_told_where_it_is_wanted(wants: bool) -> None:
    talk = Facts(wants)
    talk.hello()
    talk.connect()
    plus_scenarios.opened(talk, version=plus_scenarios.MODERN)
    assert ("6ES7 215-1AG40-0XB0" in [value for _, _, value in talk.facts]) is wants


# ---- userdata and services ------------------------------------------------------------------------------------------


def test_lists_and_bodies_that_are_too_short_are_reported_once_whatever_their_outcome() -> None:
    short_list = userdata(1, head(2, 4, 1, code=0), build.payload(b"\x00\x11\x00\x00\x00\x1c\x00\x09"))
    for request, answer in (
        (userdata(1, head(1, 4, 1), build.payload(b"\x00\x11\x00\x00")), short_list),
        (job(1, b"\x29" + bytes(5) + b"\x20P_PROGRAM"), ack_data(1, b"\x29")),
        (job(1, b"\x29" + bytes(5) + b"\x20P_PROGRAM"), ack_data(1, b"\x29", code=0xD241)),
        (userdata(1, head(1, 7, 2), build.payload(b"\0\0")), userdata(1, head(2, 7, 2, code=0))),
        (userdata(1, head(1, 7, 2), build.payload(b"\0\0")), userdata(1, head(2, 7, 2, code=0xD209))),
    ):
        talk = Talk()
        talk.open()
        talk.ask(request)
        talk.tell(answer)
        talk.close()
        malformed = [slug for slug in talk.slugs() if slug.endswith(".malformed") or slug.startswith("szl.")]
        assert len(malformed) == 1, (request, talk.slugs())


# ---- findings -------------------------------------------------------------------------------------------------------


class Choosy(Talk):
    """Selects findings, and has the facts of these."""

    def __init__(self, own: Ledger | None) -> None:
        super().__init__()
        self.own_ledger = own


def test_the_facts_of_the_rules_are_those_of_an_observer_that_selects() -> None:
    own = Ledger()
    assert Choosy(own).pipeline.exchange.ledger is own
    talk = Choosy(None)
    assert talk.pipeline.exchange.ledger is talk.pipeline.exchange.reporter.ledger


class Reminded(Talk):
    """Keeps what was only counted."""

    def __init__(self) -> None:
        super().__init__()
        self.left: list[tuple[str, int, list[int]]] = []

    def repeated(self, finding: Finding) -> None:
        self.left.append((finding.slug, int(finding.repeated), finding.frames))


def test_findings_beyond_the_details_are_summed_up_at_the_end_or_after_a_minute() -> None:
    for late in (False, True):
        talk = Reminded()
        talk.open()
        frame = 0
        for number in range(MAX_DETAILED + 7):
            talk.ask(read(number, dbw(1, 0)), after_ns=0)
            frame = talk.tell(ack_data(number, b"\x04\x01", refused(0x0A)), after_ns=0)
        assert (len(details(talk, "transaction.item_error")), talk.left) == (MAX_DETAILED, [])
        if late:
            talk.silence(61 * SECOND)
        else:
            talk.finish()
        assert talk.left == [("transaction.item_error", 7, [frame])]


class Broken(Talk):
    """Fails on findings or on what was only counted."""

    def __init__(self, strict: bool = False) -> None:
        super().__init__(strict=strict)
        self.failures = 0

    def finding(self, finding: Finding) -> None:
        self.failures += 1
        raise RuntimeError(f"failure {self.failures}")


def test_a_bug_of_an_observer_is_counted_and_the_first_one_kept() -> None:
    """Reporting it would fail as well."""
    talk = Broken()
    talk.open()
    frames = []
    for number in range(2):
        talk.ask(read(number, dbw(1, 0)))
        frames.append(talk.tell(ack_data(number, b"\x04\x01", refused(0x0A))))
    exchange = talk.pipeline.exchange
    assert str(exchange.bug) == "failure 1"
    assert talk.pipeline.finding_counts == {"transaction.item_error": 2, "internal.bug": 2}
    found = exchange.reporter.ledger.rules["internal.bug"]
    assert (found.first_frame, found.last_frame) == (frames[0], frames[1])


def test_a_bug_of_an_observer_raises_where_that_is_asked_for() -> None:
    talk = Broken(strict=True)
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    with pytest.raises(RuntimeError, match="failure 1"):
        talk.tell(ack_data(1, b"\x04\x01", refused(0x0A)))


class Fragile(Talk):
    """Fails on each transaction."""

    def __init__(self) -> None:
        super().__init__(strict=False)

    def transaction(self, transaction: Transaction) -> None:
        super().transaction(transaction)
        raise RuntimeError(f"failure {len(self.transactions)}")


def test_a_bug_in_one_transaction_costs_none_of_the_others() -> None:
    """Also of those that one message ends together."""
    talk = Fragile()
    talk.open(8, 8)
    for number in range(3):
        talk.ask(read(number, dbw(1, 0)))
    talk.close()
    assert talk.outcomes() == ["unanswered"] * 3
    bugs = [(one.detail, one.frames, one.connection) for one in talk.findings if one.slug == "internal.bug"]
    assert bugs[-3:] == [(f"RuntimeError: failure {number}", [int(talk.pipeline.frames)], 0) for number in (1, 2, 3)]
    assert talk.pipeline.counters.packet_counts()["failed"] == 0
    assert "failure" in str(talk.pipeline.exchange.bug)


# ---- the base class of observers ------------------------------------------------------------------------------------


def test_an_observer_without_wishes_gets_facts_and_no_octets() -> None:
    observer = Observer()
    assert (observer.wants_facts, observer.wants_every_finding) == (True, False)
    assert (observer.wants_pdus, observer.wants_tpdus) == (False, False)
    assert (observer.own_book, observer.own_ledger) == (None, None)


def test_options_say_what_they_are() -> None:
    assert repr(Options()) == (
        "Options(slow_ns=1000000000, strict=False, overdue_ns=0, memory=134217728, checksums=False)"
    )
    assert repr(Options(5, True, overdue_ns=7, memory=9, checksums=True)) == (
        "Options(slow_ns=5, strict=True, overdue_ns=7, memory=9, checksums=True)"
    )
