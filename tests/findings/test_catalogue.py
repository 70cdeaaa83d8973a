"""Every rule of the catalogue: a conversation that makes it speak, one beside it in which it keeps silent, and its words."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect.findings.catalogue import CATALOGUE
from dissect.findings.finding import SEVERITIES
from dissect.tcp import ip
from dissect.transactions.table import MAX_CONNECTIONS, MAX_HALF_OPEN
from dissect.transactions.transaction import Transaction
from tests.transactions.talk import (
    ACK,
    CLIENT,
    CONFIRM,
    CONNECT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    SYN,
    Talk,
    ack,
    ack_data,
    dbw,
    dt,
    good,
    granted,
    job,
    read,
    refused,
    setup,
    tpkt,
    words,
    write,
    written,
)

Scenario = Callable[[Talk], None]

PACKAGE: Final = Path(dissect.__file__).parent
#: Rooms and modules that may judge.
ENGINE: Final = frozenset(("tcp", "iso", "s7", "transactions", "findings", "conversation.py", "pipeline.py"))
#: Rooms whose findings are written in the source as "room.what".
SLUG: Final = re.compile(r"(capture|ip|stream|tpkt|cotp|s7|session|transaction|internal)\.[a-z_0-9]+")


# ---- words ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slug", CATALOGUE)
def test_words(slug: str) -> None:
    rule = CATALOGUE[slug]
    assert rule.slug == slug
    assert SLUG.fullmatch(slug)
    assert rule.severity in SEVERITIES
    assert rule.sentence.endswith(".")
    assert rule.sentence[0].isupper()
    assert rule.advice.endswith(".")
    assert rule.advice[0].isupper()
    assert not {"  ", "\n"} & {rule.sentence, rule.advice}


def noted(tree: ast.AST) -> set[str]:
    """The slugs that a module hands to the judge: texts in calls of something that notes, wants or details."""
    slugs = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name.lstrip("_") in {"note", "wants", "detail"}:
                slugs |= {
                    word.value
                    for argument in node.args
                    for word in ast.walk(argument)
                    if isinstance(word, ast.Constant) and isinstance(word.value, str) and SLUG.fullmatch(word.value)
                }
        elif isinstance(node, ast.Assign) and [getattr(one, "id", "") for one in node.targets] == ["slug"]:
            assert isinstance(node.value, ast.Constant)
            slugs.add(str(node.value.value))
    return slugs


def test_what_the_code_notes_is_the_catalogue() -> None:
    used: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] in ENGINE:
            used |= noted(ast.parse(path.read_text("utf-8")))
    assert used == set(CATALOGUE)


# ---- the rules ------------------------------------------------------------------------------------------------------

SPEAKS: dict[str, Scenario] = {}
SILENT: dict[str, Scenario] = {}


def speaks(slug: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        assert slug not in SPEAKS
        SPEAKS[slug] = scenario
        return scenario

    return keep


def silent(*slugs: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        for slug in slugs:
            assert slug not in SILENT
            SILENT[slug] = scenario
        return scenario

    return keep


@silent(
    "capture.damaged",
    "ip.fragments_evicted",
    "stream.evicted",
    "stream.half_open_evicted",
    "tpkt.bad_length",
    "tpkt.reserved",
    "cotp.error",
    "cotp.malformed",
    "s7.unknown_rosctr",
    "internal.bug",
)
def plain(talk: Talk) -> None:
    """Nothing is wrong at all."""
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.close()
    assert talk.findings == []


# The capture itself.


@speaks("capture.damaged")
def damaged(talk: Talk) -> None:
    talk.pipeline.note_damage("cut off")


@speaks("capture.cut_frames")
def cut(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, dt(read(1, dbw(1, 0))), cut=3)


@silent("capture.cut_frames", "capture.time_backwards", "capture.one_sided")
def nearly(talk: Talk) -> None:
    """An Ethernet trailer, half a millisecond of disorder, two PDUs of one side."""
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, dt(read(2, dbw(1, 0))) + b"", after_ns=-MS // 2)


@speaks("capture.time_backwards")
def backwards(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1), after_ns=-5 * MS)


@speaks("capture.one_sided")
def one_sided(talk: Talk) -> None:
    for number in range(3):
        talk.ask(read(number, dbw(1, 0)))


# IP and TCP.


def fragment(offset: int, more: bool, octets: bytes, number: int = 1) -> bytes:
    """A piece of an IP datagram that holds TCP."""
    flags = (0x2000 if more else 0) | offset // 8
    head = b"\x45\x00" + (20 + len(octets)).to_bytes(2, "big") + number.to_bytes(2, "big") + flags.to_bytes(2, "big")
    return bytes(12) + b"\x08\x00" + head + b"\x40\x06\x00\x00" + b"\x0a\x00\x00\x01\x0a\x00\x00\x02" + octets


@speaks("ip.fragment_conflict")
def fragment_conflict(talk: Talk) -> None:
    talk.raw(fragment(0, True, bytes(24)))
    talk.raw(fragment(8, True, b"\xff" * 16))
    talk.raw(fragment(24, False, bytes(8)))


@silent("ip.fragment_conflict")
def fragment_twice(talk: Talk) -> None:
    talk.raw(fragment(0, True, bytes(24)))
    talk.raw(fragment(8, True, bytes(16)))
    talk.raw(fragment(24, False, bytes(8)))


@speaks("ip.fragments_evicted")
def fragments_evicted(talk: Talk) -> None:
    for number in range(ip.MAX_DATAGRAMS + 1):
        talk.raw(fragment(0, True, bytes(24), number), after_ns=0)


@speaks("stream.hole")
def hole(talk: Talk) -> None:
    talk.open()
    talk.lose(CLIENT, read(1, dbw(1, 0)))
    talk.ask(read(2, dbw(1, 0)))


@silent("stream.hole")
def out_of_order(talk: Talk) -> None:
    talk.open()
    first, second = dt(read(1, dbw(1, 0))), dt(read(2, dbw(1, 0)))
    talk.packet(CLIENT, second, seq=talk.seq[CLIENT] + len(first))
    talk.packet(CLIENT, first)


@speaks("stream.conflict")
def conflict(talk: Talk) -> None:
    talk.open()
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets)
    talk.packet(CLIENT, dt(read(1, dbw(1, 2))), seq=talk.seq[CLIENT] - len(octets))


@silent("stream.conflict")
def retransmission(talk: Talk) -> None:
    talk.open()
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets)
    talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - len(octets))


@speaks("stream.reset_ignored")
def reset_ignored(talk: Talk) -> None:
    talk.open()
    talk.packet(SERVER, flags=RST | ACK, seq=talk.seq[SERVER] + 1_000_000)


@silent("stream.reset_ignored", "stream.reused")
def reset_and_again(talk: Talk) -> None:
    talk.open()
    talk.packet(SERVER, flags=RST | ACK)
    talk.seq = [5_000_000, 7_000_000]
    talk.open()


@speaks("stream.refused")
def nobody_listens(talk: Talk) -> None:
    talk.packet(CLIENT, flags=SYN)
    talk.packet(SERVER, flags=RST | ACK)


@silent("stream.refused")
def reset_without_attempt(talk: Talk) -> None:
    """A reset that answers no attempt, and one on a port that is not ours."""
    other = Talk(50000, 8080, beside=talk)
    other.packet(CLIENT, flags=SYN)
    other.packet(SERVER, flags=RST | ACK)
    talk.packet(SERVER, flags=RST | ACK)
    talk.open()
    talk.packet(SERVER, flags=RST | ACK)


@speaks("tpkt.reserved")
def reserved_octet(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, b"\x03\x01" + dt(read(1, dbw(1, 0)))[2:])


@speaks("stream.reused")
def reused(talk: Talk) -> None:
    talk.open()
    talk.seq = [5_000_000, 7_000_000]
    talk.open()


@speaks("stream.evicted")
def evicted(talk: Talk) -> None:
    for number in range(MAX_CONNECTIONS + 2):
        other = Talk(1024 + number, beside=talk)
        other.packet(CLIENT, CONNECT, after_ns=1000)


@speaks("stream.half_open_evicted")
def half_open(talk: Talk) -> None:
    for number in range(MAX_HALF_OPEN + 1):
        Talk(1024 + number, beside=talk).packet(CLIENT, flags=SYN, after_ns=1000)


# TPKT and COTP.


@speaks("tpkt.garbage")
def garbage(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, b"\xde\xad\xbe\xef" * 3)


@silent("tpkt.garbage", "tpkt.unfinished")
def in_pieces(talk: Talk) -> None:
    talk.open()
    octets = dt(read(1, dbw(1, 0)))
    for octet in octets:
        talk.packet(CLIENT, bytes((octet,)))
    talk.tell(words(1, 1))
    talk.close()


@speaks("tpkt.bad_length")
def bad_length(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, b"\x03\x00\x00\x05\x00" + dt(read(1, dbw(1, 0))))


@speaks("tpkt.unfinished")
def unfinished(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, dt(read(1, dbw(1, 0)))[:-1])
    talk.close()


@speaks("cotp.malformed")
def cotp_malformed(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, tpkt(bytes.fromhex("11e00000000100c10a0100c2020102c0010a")))


@speaks("cotp.refused")
def cotp_refused(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, tpkt(bytes.fromhex("06800001000082")))


@silent("cotp.refused")
@speaks("cotp.disconnected")
def disconnected(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, tpkt(bytes.fromhex("06800001000080")))


@silent("cotp.disconnected", "cotp.repeated_request", "cotp.answer_without_request")
def refused_and_again(talk: Talk) -> None:
    cotp_refused(talk)
    other = Talk(50001, beside=talk)
    other.open()


@speaks("cotp.error")
def cotp_error(talk: Talk) -> None:
    talk.open()
    talk.packet(SERVER, tpkt(bytes.fromhex("0470000102")))


@speaks("cotp.repeated_request")
def repeated_request(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(CLIENT, CONNECT)


@speaks("cotp.answer_without_request")
def answer_without_request(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, piece(b"", False))
    talk.packet(SERVER, CONFIRM)


@speaks("cotp.size_exceeded")
def size_exceeded(talk: Talk) -> None:
    talk.open(1, 1, 60_000)
    talk.ask(write(1, [dbw(1, 0)], written(4, bytes(1100))))


@silent("cotp.size_exceeded", "session.pdu_too_long")
def just_fits(talk: Talk) -> None:
    """The largest PDU: the granted length exactly, in a TPDU of 1024."""
    talk.open(1, 1, 1021)
    whole = write(1, [dbw(1, 0)], written(4, bytes(993)))
    assert len(whole) == 1021
    talk.ask(whole)


def piece(octets: bytes, last: bool) -> bytes:
    return tpkt(b"\x02\xf0" + (b"\x80" if last else b"\x00") + octets)


@speaks("cotp.unfinished_tsdu")
def unfinished_tsdu(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, piece(read(1, dbw(1, 0))[:9], False))
    talk.close()


@silent("cotp.unfinished_tsdu", "cotp.tsdu_too_long")
def tsdu_in_pieces(talk: Talk) -> None:
    talk.open()
    octets = read(1, dbw(1, 0))
    talk.packet(CLIENT, piece(octets[:9], False) + piece(b"", False) + piece(octets[9:], True) + piece(b"", False))
    talk.tell(words(1, 1))
    talk.close()
    assert talk.outcomes() == ["answered"]


@speaks("cotp.tsdu_too_long")
def tsdu_too_long(talk: Talk) -> None:
    talk.open()
    for _ in range(66):
        talk.packet(CLIENT, piece(bytes(1000), False))


# S7.


@speaks("s7.malformed")
def malformed(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0))[:-1])


@silent("s7.malformed")
def padded(talk: Talk) -> None:
    """One client pads its last item, and an Ack may name the function it refuses (reference 3.1, 3.5)."""
    talk.open()
    talk.ask(write(1, [dbw(1, 0)], written(4, b"\0\1\2") + b"\0"))
    talk.tell(ack(1, 0x8104, b"\x05"))


@speaks("s7.unknown_rosctr")
def unknown_rosctr(talk: Talk) -> None:
    talk.open()
    talk.ask(b"\x32\x05" + read(1, dbw(1, 0))[2:])


@speaks("session.data_before_setup")
def data_before_setup(talk: Talk) -> None:
    talk.hello()
    talk.connect()
    talk.ask(read(1, dbw(1, 0)))


@silent("session.data_before_setup", "session.bad_grant", "session.unusual_port", "session.foreign_on_102")
def setup_after_connect(talk: Talk) -> None:
    talk.connect()
    talk.ask(setup(1, 8, 8, 960))
    talk.tell(granted(1, 2, 2, 240))
    talk.ask(read(2, dbw(1, 0)))


@speaks("session.pdu_too_long")
def pdu_too_long(talk: Talk) -> None:
    talk.open(1, 1, 240)
    talk.ask(write(1, [dbw(1, 0)], written(4, bytes(213))))


@speaks("session.too_many_jobs")
def too_many_jobs(talk: Talk) -> None:
    talk.open(1, 2)
    talk.ask(*(read(number, dbw(1, 0)) for number in range(3)))


@silent("session.too_many_jobs")
def as_many_jobs_as_granted(talk: Talk) -> None:
    talk.open(1, 2)
    talk.ask(*(read(number, dbw(1, 0)) for number in range(2)))


@speaks("session.bad_grant")
def bad_grant(talk: Talk) -> None:
    talk.connect()
    talk.ask(setup(1, 1, 1, 240))
    talk.tell(granted(1, 1, 1, 480))


@speaks("session.unusual_port")
def unusual_port(talk: Talk) -> None:
    other = Talk(50000, 4102, beside=talk)
    other.open()


@speaks("session.foreign_on_102")
def foreign(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, b"GET / HTTP/1.1\r\n\r\n")
    for _ in range(70):
        talk.packet(CLIENT, b"Host: example\r\n")


# Transactions.


@speaks("transaction.refused")
def transaction_refused(talk: Talk) -> None:
    talk.open()
    talk.ask(job(1, b"\x29" + bytes(15)))
    talk.tell(ack(1, 0x8104))


@speaks("transaction.item_error")
def item_error(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x04\x01", refused(0x0A)))


@silent(
    "transaction.refused",
    "transaction.item_error",
    "transaction.function_mismatch",
    "transaction.count_mismatch",
    "transaction.size_mismatch",
)
def good_answers(talk: Talk) -> None:
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0), dbw(1, 2)), job(2, b"\x29" + bytes(15)), write(3, [dbw(1, 0)], written(4, b"\0\1")))
    talk.tell(ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2), ack_data(2, b"\x29"), ack_data(3, b"\x05\x01", b"\xff"))


@speaks("transaction.unanswered")
def unanswered(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.close()


@speaks("transaction.orphan")
def orphan(talk: Talk) -> None:
    talk.open()
    talk.tell(words(1, 1))


@silent("transaction.unanswered", "transaction.orphan")
def middle_of_a_connection(talk: Talk) -> None:
    """The capture begins before an answer and ends before another."""
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))


@speaks("transaction.slow")
def slow(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1), after_ns=SECOND + 1)


@silent("transaction.slow", "transaction.reordered", "transaction.table_full")
def just_in_time(talk: Talk) -> None:
    talk.open(8, 8)
    talk.flood(4096)
    talk.tell(words(4095, 1), after_ns=SECOND)


@speaks("transaction.function_mismatch")
def function_mismatch(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x05\x01", b"\xff"))


@speaks("transaction.count_mismatch")
def count_mismatch(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2))


@speaks("transaction.size_mismatch")
def size_mismatch(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1, 2))


@speaks("transaction.reordered")
def reordered(talk: Talk) -> None:
    talk.open()
    request = read(1, dbw(1, 0))
    talk.acked[SERVER] = talk.seq[CLIENT] + len(dt(request))
    talk.tell(words(1, 1))
    talk.ask(request)


@speaks("transaction.table_full")
def table_full(talk: Talk) -> None:
    talk.open()
    talk.flood(4097)


# Ourselves.


class Failing(Talk):
    """An observer that fails on a transaction: a bug of ours for all the pipeline knows."""

    def __init__(self) -> None:
        super().__init__(strict=False)

    def transaction(self, transaction: Transaction) -> None:
        raise ZeroDivisionError("out of tune")


@speaks("internal.bug")
def bug(talk: Talk) -> None:
    failing = Failing()
    failing.open()
    failing.ask(read(1, dbw(1, 0)))
    failing.tell(words(1, 1))
    failing.ask(read(2, dbw(1, 0)))
    failing.tell(words(2, 1))
    assert failing.pipeline.conversation.judge.counts["internal.bug"] == 3  # the setup fails as well
    assert failing.findings[-1].detail == "ZeroDivisionError: out of tune"
    talk.findings.extend(failing.findings)


@pytest.mark.parametrize("slug", CATALOGUE)
def test_rule_speaks(slug: str) -> None:
    talk = Talk()
    SPEAKS[slug](talk)
    talk.finish()
    talk.pipeline.conversation.tell_findings()
    assert slug in talk.slugs()
    for finding in talk.findings:
        if finding.slug == slug:
            assert finding.rule is CATALOGUE[slug]
            assert all(frame > 0 for frame in finding.frames)
            assert not finding.detail.endswith(".")


@pytest.mark.parametrize("slug", CATALOGUE)
def test_rule_keeps_silent(slug: str) -> None:
    talk = Talk()
    SILENT[slug](talk)
    talk.finish()
    assert slug not in talk.slugs()
    assert slug not in talk.pipeline.conversation.judge.counts


def test_every_rule_has_both() -> None:
    assert set(SPEAKS) == set(SILENT) == set(CATALOGUE)


def test_a_flood_is_counted_exactly_and_told_in_part() -> None:
    """Robustness T37, G20: every one counted, a hundred told of a connection."""
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, flags=ACK)
    for number in range(0, 5000, 100):
        talk.ask(*(b"\x32\x05" + read(number + more, dbw(1, 0))[2:] for more in range(100)))
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.finish()
    assert talk.pipeline.conversation.judge.counts["s7.unknown_rosctr"] == 5000
    assert talk.slugs().count("s7.unknown_rosctr") == 100
