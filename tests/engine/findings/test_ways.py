"""What shows itself only in what stays unanswered: when it is said, when it is not, and how long findings wait for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import pytest

from dissect.engine.findings.explaining import WAIT_NS
from dissect.engine.transactions.table import MAX_CONNECTIONS
from tests import build
from tests.cases import each
from tests.engine.findings.cause_scenarios import begin
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    SYN,
    Talk,
    ack,
    dbw,
    item,
    read,
    words,
)

NUMBER: Final = "cotp.number_unanswered"
FRAGMENTS: Final = "cotp.fragments_unanswered"
SMALL: Final = "session.tpdu_too_small"

Send = Callable[[Talk, int], None]


def numbered(talk: Talk, reference: int) -> None:
    talk.packet(CLIENT, build.dt(read(reference, dbw(1, 0)), number=reference))


def in_parts(talk: Talk, reference: int) -> None:
    pdu = read(reference, dbw(1, 0))
    talk.packet(CLIENT, build.dt(pdu[:12], eot=False) + build.dt(pdu[12:]))


WAYS: Final = [(NUMBER, numbered), (FRAGMENTS, in_parts)]
EACH: Final = pytest.mark.parametrize(("slug", "send"), WAYS, ids=["numbered", "fragments"])


def close(talk: Talk) -> None:
    talk.wait(2 * SECOND)
    talk.close()


def counts(talk: Talk) -> dict[str, int]:
    return talk.pipeline.finding_counts


# ---- when it is said ------------------------------------------------------------------------------------------------


@EACH
@pytest.mark.parametrize("ending", ["client", "server", "reset", "capture"])
def test_it_is_said_however_the_connection_ends(slug: str, send: Send, ending: str) -> None:
    talk = Talk()
    begin(talk)
    send(talk, 1)
    talk.wait(3 * SECOND)
    if ending == "capture":
        talk.packet(CLIENT)
        talk.finish()
    elif ending == "client":
        talk.close()
    else:
        talk.packet(SERVER, flags=RST if ending == "reset" else FIN | ACK)
        talk.finish()
    assert counts(talk)[slug] == 1
    assert "transaction.unanswered" not in counts(talk)
    (cause,) = [finding for finding in talk.findings if finding.slug == slug]
    assert cause.frames == [8]
    assert ": no answer; 1 other request answered" in cause.detail


@EACH
def test_it_is_said_once_and_counts_the_requests(slug: str, send: Send) -> None:
    talk = Talk()
    begin(talk)
    for reference in (1, 2, 3):
        send(talk, reference)
    close(talk)
    assert counts(talk)[slug] == 1
    (cause,) = [finding for finding in talk.findings if finding.slug == slug]
    assert cause.detail.startswith("3 requests of 10.0.0.1:50000 ")
    assert talk.pipeline.exchange.reporter.explained[slug, "transaction.unanswered"] == 3


@EACH
def test_a_reference_that_is_used_again_is_explained_as_well(slug: str, send: Send) -> None:
    """The first request is given up long before the end of the connection."""
    talk = Talk()
    begin(talk, jobs=1)
    for _ in range(3):
        send(talk, 1)
        talk.wait(3 * SECOND)
    talk.close()
    reporter = talk.pipeline.exchange.reporter
    assert reporter.explained[slug, "transaction.unanswered"] == 3
    assert "transaction.unanswered" not in counts(talk)


# ---- when it is not -------------------------------------------------------------------------------------------------


def one_answered(talk: Talk, send: Send) -> None:
    send(talk, 1)
    talk.tell(words(1, 1))
    send(talk, 2)
    close(talk)


def answered_late(talk: Talk, send: Send) -> None:
    send(talk, 1)
    send(talk, 2)
    talk.tell(words(2, 1), after_ns=2 * SECOND)
    close(talk)


def refused(talk: Talk, send: Send) -> None:
    """A refusal is an answer."""
    send(talk, 1)
    talk.tell(ack(1, 0x8104))
    send(talk, 2)
    close(talk)


def another_too(talk: Talk, send: Send) -> None:
    talk.ask(read(1, dbw(1, 0)))
    send(talk, 2)
    close(talk)


def answer_lost(talk: Talk, send: Send) -> None:
    """Later packets of the client acknowledge octets that the capture does not have."""
    send(talk, 1)
    talk.lose(SERVER, words(1, 1))
    send(talk, 2)
    close(talk)


def gap_of_the_server(talk: Talk, send: Send) -> None:
    send(talk, 1)
    talk.lose(SERVER, words(1, 1))
    talk.tell(words(9, 1))
    send(talk, 2)
    close(talk)


def gap_of_the_client(talk: Talk, send: Send) -> None:
    talk.lose(CLIENT, read(8, dbw(1, 0)))
    send(talk, 1)
    close(talk)


def source_lost(talk: Talk, send: Send) -> None:
    """The source says that it lost packets since."""
    send(talk, 1)
    talk.packet(CLIENT)
    talk.pipeline.note_dropped("3 packets")
    close(talk)


def too_early(talk: Talk, send: Send) -> None:
    """The capture ends before an answer is due."""
    send(talk, 1)
    talk.finish()


def hasty(talk: Talk, send: Send) -> None:
    """The client itself closes at once."""
    send(talk, 1)
    talk.packet(CLIENT, flags=RST, after_ns=MS)
    talk.finish()


SILENT: Final = [
    one_answered,
    answered_late,
    refused,
    another_too,
    answer_lost,
    gap_of_the_server,
    gap_of_the_client,
    source_lost,
    too_early,
    hasty,
]


@EACH
@pytest.mark.parametrize("told", SILENT, ids=lambda told: told.__name__)
def test_it_is_not_said(slug: str, send: Send, told: Callable[[Talk, Send], None]) -> None:
    talk = Talk()
    begin(talk)
    told(talk, send)
    assert slug not in counts(talk)
    assert talk.pipeline.exchange.reporter.explained == {}


@EACH
def test_a_server_that_answers_nothing_at_all_proves_nothing(slug: str, send: Send) -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    for reference in (1, 2):
        send(talk, reference)
    close(talk)
    assert slug not in counts(talk)
    assert counts(talk)["transaction.unanswered"] >= 1


@EACH
def test_where_only_the_client_was_captured(slug: str, send: Send) -> None:
    talk = Talk()
    talk.packet(CLIENT, flags=SYN)
    talk.packet(CLIENT)
    for reference in range(5):
        send(talk, reference)
    talk.finish()
    assert slug not in counts(talk)


@EACH
def test_a_server_that_takes_it_is_never_suspected(slug: str, send: Send) -> None:
    """As PLC4X sends: every request that way, each answered. Nothing waits, and a later silence has no such cause."""
    talk = Talk()
    begin(talk)
    for reference in range(1, 130):
        send(talk, reference % 127 + 1)
        talk.tell(words(reference % 127 + 1, 1))
    assert talk.pipeline.exchange.causes.waiting == {}
    send(talk, 5)
    close(talk)
    assert slug not in counts(talk)
    assert counts(talk)["transaction.unanswered"] == 1


def test_an_eviction_decides_nothing() -> None:
    talk = Talk()
    begin(talk)
    numbered(talk, 1)
    for port in range(MAX_CONNECTIONS + 600):
        other = Talk(client_port=1024 + port, beside=talk)
        other.hosts = [7, 2]
        other.packet(CLIENT, b"\x03\x00\x00\x07\x02\xf0\x00", after_ns=1000)
    assert counts(talk)["stream.evicted"]
    assert counts(talk)["transaction.unanswered"] == 1
    assert NUMBER not in counts(talk)
    assert talk.pipeline.exchange.causes.waiting == {}


# ---- how long findings wait -----------------------------------------------------------------------------------------


def waiting() -> Talk:
    """Two numbered requests are open although one job was granted: that may be explained later."""
    talk = Talk()
    begin(talk, jobs=1)
    numbered(talk, 1)
    numbered(talk, 2)
    assert "session.too_many_jobs" not in counts(talk)
    return talk


def test_they_wait_until_an_answer_refutes_the_cause() -> None:
    talk = waiting()
    talk.tell(words(1, 1))
    talk.tell(words(2, 1))
    numbered(talk, 3)  # this shows that the ones before were answered
    assert counts(talk)["session.too_many_jobs"] == 1
    assert talk.slugs()[-1] == "session.too_many_jobs"
    talk.tell(words(3, 1))
    talk.close()
    assert talk.pipeline.exchange.reporter.explained == {}


@pytest.mark.parametrize("answered", [False, True])
def test_they_do_not_wait_long(answered: bool) -> None:
    """Alerts must not be late: after five seconds it is decided by what is known."""
    talk = waiting()
    if answered:
        talk.tell(words(1, 1))
        talk.tell(words(2, 1))
    talk.silence(WAIT_NS - SECOND)
    assert NUMBER not in counts(talk)
    assert "session.too_many_jobs" not in counts(talk)
    talk.silence(2 * SECOND)
    if answered:
        assert counts(talk)["session.too_many_jobs"] == 1
        assert NUMBER not in counts(talk)
    else:
        assert "session.too_many_jobs" not in counts(talk)
        assert counts(talk)[NUMBER] == 1
        assert talk.slugs()[-2:] == [NUMBER, "session.too_many_jobs"]
    assert talk.pipeline.exchange.causes.waiting == {}


def test_what_comes_after_the_cause_waits_no_longer() -> None:
    talk = waiting()
    talk.silence(2 * WAIT_NS)
    told = len(talk.findings)
    numbered(talk, 3)
    numbered(talk, 4)
    assert [(finding.slug, finding.because) for finding in talk.findings[told:]] == [("session.too_many_jobs", NUMBER)]
    talk.wait(SECOND)
    talk.close()
    assert counts(talk)[NUMBER] == 1
    assert talk.pipeline.exchange.reporter.explained == {
        (NUMBER, "session.too_many_jobs"): 2,
        (NUMBER, "session.cut"): 1,
        (NUMBER, "transaction.unanswered"): 4,
    }


def test_an_answer_after_the_cause_ends_it() -> None:
    talk = waiting()
    talk.silence(2 * WAIT_NS)
    talk.tell(words(1, 1))
    talk.tell(words(2, 1))
    numbered(talk, 3)
    close(talk)
    reporter = talk.pipeline.exchange.reporter
    assert reporter.counts["transaction.unanswered"] == 1
    assert (NUMBER, "transaction.unanswered") not in reporter.explained


def test_findings_of_other_connections_do_not_wait() -> None:
    talk = waiting()
    second = Talk(client_port=50001, beside=talk)
    second.open()
    second.ask(read(1, dbw(1, 0)))
    second.ask(read(2, dbw(1, 0)))
    assert counts(talk)["session.too_many_jobs"] == 1
    assert talk.findings[-1].connection == 2


# ---- answers that do not fit the TPDU size --------------------------------------------------------------------------


def large(reference: int, size: int = 600) -> bytes:
    return read(reference, item(0x84, 1, 0, 2, size))


@each("size", [491, 492, 600, 942, 943])
def test_the_sizes_are_compared_to_the_octet(size: int) -> None:
    """A TPDU of 512 carries a PDU of 509; a read of 492 bytes is answered by one of 510. A PDU of 960 holds 942 bytes."""
    talk = Talk()
    begin(talk, 960, 9)
    talk.ask(large(1, size))
    talk.packet(SERVER, flags=RST)
    talk.finish()
    assert (SMALL in counts(talk)) is (492 <= size <= 942)
    assert ("session.read_too_long" in counts(talk)) is (size > 942)
    if SMALL in counts(talk):
        (cause,) = [finding for finding in talk.findings if finding.slug == SMALL]
        assert cause.detail.partition("; seen with")[0] == (
            f"Read Var DB1.DBB0 x{size}: the answer takes {size + 21} bytes, TPDU size 512 as the client asked;"
            " the PDU length of 960 allows it"
        )


def in_one_tpdu(talk: Talk) -> None:
    """The server has shown that it sends such answers all the same."""
    talk.ask(large(1))
    talk.tell(build.pdu(build.ACK_DATA, 1, b"\4\1", build.data_item(0xFF, 4, bytes(600))))
    talk.ask(large(2))
    talk.packet(SERVER, flags=RST)


def in_several_tpdus(talk: Talk) -> None:
    talk.ask(large(1))
    pdu = build.pdu(build.ACK_DATA, 1, b"\4\1", build.data_item(0xFF, 4, bytes(600)))
    talk.packet(SERVER, build.dt(pdu[:500], eot=False) + build.dt(pdu[500:]))
    talk.ask(large(2))
    talk.packet(SERVER, flags=RST)


def lost_since(talk: Talk) -> None:
    talk.ask(large(1))
    talk.lose(SERVER, words(1, 1))
    talk.packet(CLIENT)
    talk.packet(SERVER, flags=RST)


def client_closes_at_once(talk: Talk) -> None:
    talk.ask(large(1))
    talk.packet(CLIENT, flags=RST)


def capture_ends(talk: Talk) -> None:
    talk.ask(large(1))


@each("told", [in_one_tpdu, in_several_tpdus, lost_since, client_closes_at_once, capture_ends])
def test_the_tpdu_size_is_not_to_blame(told: Callable[[Talk], None]) -> None:
    talk = Talk()
    begin(talk, 960, 9)
    told(talk)
    talk.finish()
    assert SMALL not in counts(talk)
    assert talk.pipeline.exchange.reporter.explained == {}


def test_a_client_that_waits_and_asks_again_gets_the_same_explanation() -> None:
    """One reference for all requests, as S7netplus has it: each read is given up when the next one comes."""
    talk = Talk()
    begin(talk, 960, 9, jobs=1)
    for _ in range(3):
        talk.ask(large(0), after_ns=3 * SECOND)
    close(talk)
    reporter = talk.pipeline.exchange.reporter
    assert reporter.counts[SMALL] == 1
    assert reporter.explained[SMALL, "transaction.unanswered"] == 3
    assert "transaction.unanswered" not in reporter.counts
