"""Known bugs: each row of the table is sound, and where a finding tells one, its sign makes the finding tell it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.crowd import PILED_UP
from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS
from tests.cases import each
from tests.engine.findings.cause_scenarios import (
    MB0,
    MB2,
    begin,
    never_joined,
    never_taken,
    several_bits,
    short_confirm,
    too_large,
)
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONNECT,
    FIN,
    MS,
    RST,
    SERVER,
    SYN,
    Talk,
    ack,
    ack_data,
    good,
    item,
    job,
    read,
    tpkt,
    write,
    written,
)

Scenario = Callable[[Talk], None]

#: A conversation with the sign of each bug that a finding tells, and one beside it without the sign but with the finding.
TOLD: Final[dict[str, Scenario]] = {
    "numbered_tpdu": never_taken,
    "fragments": never_joined,
    "small_tpdu": too_large,
    "bit_count": several_bits,
    "short_confirm": short_confirm,
}
NOT_TOLD: Final[dict[str, Scenario]] = {}


def tells(key: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        assert key not in TOLD
        TOLD[key] = scenario
        return scenario

    return keep


def tells_not(key: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        NOT_TOLD[key] = scenario
        return scenario

    return keep


# ---- the table ------------------------------------------------------------------------------------------------------


def test_the_table_is_sound() -> None:
    for key, bug in KNOWN_BUGS.items():
        assert key == bug.key
        assert set(bug.slugs) <= set(CATALOGUE)
        for text in (bug.sign, bug.who, bug.means, bug.remedy, bug.sources):
            assert text
            assert text.strip() == text
            assert not text.endswith(".")
            assert "://" not in text
        assert bug.note == f"; seen with {bug.who}: {bug.remedy}"
        assert len(bug.note) <= 140 or not bug.told


def test_each_bug_that_is_told_has_its_sign() -> None:
    assert set(TOLD) == {key for key, bug in KNOWN_BUGS.items() if bug.told}
    assert set(NOT_TOLD) <= set(TOLD)


# ---- signs ----------------------------------------------------------------------------------------------------------


@tells("no_fill_byte")
def no_fill_byte(talk: Talk) -> None:
    begin(talk)
    talk.ask(write(1, [MB0, MB2], written(4, b"\1") + written(4, b"\2")))
    talk.tell(ack(1, 0x8104))


@tells_not("no_fill_byte")
def something_else(talk: Talk) -> None:
    begin(talk)
    talk.ask(write(1, [MB0, MB2], written(4, b"\1")))
    talk.tell(ack(1, 0x8104))


@tells("bare_command")
def bare_command(talk: Talk) -> None:
    begin(talk)
    for reference, function in ((1, b"\x29"), (2, b"\x28")):
        talk.ask(job(reference, function))
        talk.tell(ack(reference, 0x8104))


@tells_not("bare_command")
def cut_command(talk: Talk) -> None:
    begin(talk)
    talk.ask(job(1, b"\x29\0\0"))
    talk.tell(ack(1, 0x8104))


@tells("length_in_bits")
def length_in_bits(talk: Talk) -> None:
    """0x4000 DINTs are 524,288 bits, of which 16 bits cannot say so many."""
    begin(talk)
    talk.ask(read(1, item(0x84, 1, 0, 7, 0x4000)))
    talk.tell(ack_data(1, b"\4\1", good(5, bytes(20))))


@tells_not("length_in_bits")
def too_short(talk: Talk) -> None:
    begin(talk)
    talk.ask(read(1, item(0x84, 1, 0, 7, 10)))
    talk.tell(ack_data(1, b"\4\1", good(5, bytes(20))))


ODD: Final = [item(0x84, 1, 80 * number, 2, 9) for number in range(16)]


@tells("fill_bytes_forgotten")
def fill_bytes_forgotten(talk: Talk) -> None:
    """Sixteen items of nine bytes: 14 + 16 * 13 are 222, and fifteen fill bytes."""
    begin(talk, 236)
    talk.ask(read(1, *ODD))
    talk.tell(ack(1, 0x8500))


@tells_not("fill_bytes_forgotten")
def too_long_anyway(talk: Talk) -> None:
    begin(talk, 221)
    talk.ask(read(1, *ODD))
    talk.tell(ack(1, 0x8500))


def opened(talk: Talk, port: int, host: int = 1, server: int = 2) -> Talk:
    one = Talk(client_port=port, beside=talk)
    one.hosts = [host, server]
    one.open()
    return one


def refused(talk: Talk, port: int) -> Talk:
    """A connect request that is refused by a DR."""
    one = Talk(client_port=port, beside=talk)
    one.hello()
    one.packet(CLIENT, CONNECT)
    one.packet(SERVER, tpkt(bytes.fromhex("06800001000000")))
    return one


@tells("piled_up")
def piled_up(talk: Talk) -> None:
    for number in range(PILED_UP):
        opened(talk, 50000 + number)
    refused(talk, 51000)


@tells_not("piled_up")
def a_few(talk: Talk) -> None:
    for number in range(PILED_UP - 1):
        opened(talk, 50000 + number)
    refused(talk, 51000)


@each("key", list(TOLD))
def test_the_sign_is_told(key: str) -> None:
    talk = Talk()
    TOLD[key](talk)
    talk.finish()
    bug = KNOWN_BUGS[key]
    found = [finding for finding in talk.findings if finding.slug in bug.slugs and not finding.because]
    assert found
    assert all(finding.detail.endswith(bug.note) for finding in found)


@each("key", list(NOT_TOLD))
def test_without_the_sign_the_finding_does_not_tell_it(key: str) -> None:
    talk = Talk()
    NOT_TOLD[key](talk)
    talk.finish()
    bug = KNOWN_BUGS[key]
    found = [finding for finding in talk.findings if finding.slug in bug.slugs]
    assert found
    assert all(bug.note not in finding.detail for finding in found)


def test_a_bare_command_is_refused_because_it_is_malformed() -> None:
    talk = Talk()
    bare_command(talk)
    talk.finish()
    reporter = talk.pipeline.exchange.reporter
    assert reporter.explained["s7.malformed", "transaction.refused"] == 2
    assert "transaction.refused" not in reporter.counts
    assert reporter.counts["security.plc_stop"] == 1  # that a stop was tried is never explained away


# ---- connections that are open at a refusal -------------------------------------------------------------------------


def crowded() -> Talk:
    """Connections of two clients to one server, and what does not count: to another server, to another port, closed."""
    talk = Talk(client_port=40000)
    talk.hosts = [7, 3]
    talk.open()
    for number in range(32):
        opened(talk, 50000 + number)
    for number in range(8):
        opened(talk, 50000 + number, host=9)
    opened(talk, 60000, server=4)
    elsewhere = Talk(client_port=60001, server_port=1102, beside=talk)
    elsewhere.open()
    for flags in (RST, FIN | ACK):
        gone = opened(talk, 60002 + flags)
        gone.packet(CLIENT, flags=flags)
        gone.packet(SERVER, flags=flags)
    return talk


SAID: Final = "; 32 connections of 10.0.0.1 were open to it, 40 of all clients"


def detail_of(talk: Talk, slug: str) -> str:
    talk.pipeline.exchange.report_findings()
    (found,) = [finding for finding in talk.findings if finding.slug == slug]
    return found.detail


def test_a_refused_connect_request_says_what_was_open() -> None:
    talk = crowded()
    refused(talk, 61000)
    assert detail_of(talk, "cotp.refused").endswith(SAID + KNOWN_BUGS["piled_up"].note)


def test_a_refused_tcp_connection_says_what_was_open() -> None:
    talk = crowded()
    one = Talk(client_port=61000, beside=talk)
    one.packet(CLIENT, flags=SYN)
    one.packet(SERVER, flags=RST | ACK)
    assert SAID in detail_of(talk, "stream.refused")


@pytest.mark.parametrize(("by", "said"), [(SERVER, True), (CLIENT, False)])
def test_a_server_that_closes_at_once_says_what_was_open(by: int, said: bool) -> None:
    talk = crowded()
    one = Talk(client_port=61000, beside=talk)
    one.hello()
    one.packet(CLIENT, CONNECT)
    one.packet(by, flags=FIN | ACK)
    one.packet(1 - by, flags=FIN | ACK)
    one.packet(by)
    talk.silence(2000 * MS)
    cuts = [finding.detail for finding in talk.findings if finding.slug == "session.cut"]
    assert len(cuts) == 1
    assert (SAID in cuts[0]) is said


@pytest.mark.parametrize(
    ("mine", "others", "said"),
    [
        (0, 0, ""),
        (1, 0, "; 1 connection of 10.0.0.1 was open to it"),
        (2, 0, "; 2 connections of 10.0.0.1 were open to it"),
        (2, 1, "; 2 connections of 10.0.0.1 were open to it, 3 of all clients"),
        (0, 1, "; 1 connection of other clients was open to it"),
        (0, 3, "; 3 connections of other clients were open to it"),
    ],
)
def test_the_words_for_what_was_open(mine: int, others: int, said: str) -> None:
    talk = Talk(client_port=40000)
    talk.hosts = [7, 3]
    talk.open()
    for number in range(mine):
        opened(talk, 50000 + number)
    for number in range(others):
        opened(talk, 50000 + number, host=9 + number)
    refused(talk, 61000)
    detail = detail_of(talk, "cotp.refused")
    assert detail.endswith(said)
    assert ("open to it" in detail) is bool(said)


def test_other_vlans_do_not_count() -> None:
    talk = Talk(client_port=40000)
    talk.hosts = [7, 3]
    talk.open()
    other = Talk(client_port=50000, beside=talk)
    other.vlan = 5
    other.open()
    refused(talk, 61000)
    assert "open to it" not in detail_of(talk, "cotp.refused")


def test_a_scan_in_a_crowd_looks_at_it_a_bounded_number_of_times() -> None:
    """Only findings that are detailed look at all open connections."""
    talk = Talk(client_port=40000)
    talk.open()
    for number in range(300):
        one = Talk(client_port=50000 + number, beside=talk)
        one.packet(CLIENT, flags=SYN)
        one.packet(SERVER, flags=RST | ACK)
    assert talk.pipeline.finding_counts["stream.refused"] == 300
    assert len([finding for finding in talk.findings if "were open to it" in finding.detail]) == 0
    assert len([finding for finding in talk.findings if "was open to it" in finding.detail]) == 100
