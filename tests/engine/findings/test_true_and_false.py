"""Rules that spoke where nothing was wrong: for each the case in which they have to, and the one in which they must not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import dissect
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.transactions.results import STILL_OPEN, UNCONFIRMED
from dissect.meaning.report.analysis import Analysis
from dissect.packets.tcp.stream import MASK
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    MS,
    RST,
    SECOND,
    SERVER,
    Talk,
    ack_data,
    dbw,
    dt,
    head,
    item,
    read,
    tpkt,
    userdata,
    words,
    write,
    written,
)


def slugs(talk: Talk) -> set[str]:
    return {found.slug for found in talk.findings}


@pytest.mark.parametrize(("codes", "found"), [(b"\x03\x03", True), (b"\xff\x03", False), (b"\x03\xff", False)])
def test_protected_is_what_refuses_all(codes: bytes, found: bool) -> None:
    """A timer that cannot be written beside a flag that was says nothing about protection."""
    talk = Talk()
    talk.open()
    values = written(4, b"\x00\x01") + written(4, b"\x00\x02")
    talk.ask(write(1, [item(0x83, 0, 0, 4), item(0x1D, 0, 0, 0x1D)], values))
    talk.tell(ack_data(1, b"\x05\x02", codes))
    talk.close()
    assert ("security.protected" in slugs(talk)) is found


@pytest.mark.parametrize(("lists", "found"), [((0x0011, 0x001C, 0x0111), True), ((0x0132, 0x0131, 0x0011), False)])
def test_reconnaissance_is_no_start_of_a_panel(lists: tuple[int, ...], found: bool) -> None:
    talk = Talk()
    talk.open()
    for number, szl_id in enumerate(lists, 1):
        talk.ask(userdata(number, head(1, 4, 1), b"\xff\x09\x00\x04" + szl_id.to_bytes(2, "big") + b"\x00\x00"))
    talk.close()
    assert ("security.reconnaissance" in slugs(talk)) is found


@pytest.mark.parametrize("midway", [True, False])
def test_a_new_writer_was_not_there_before(midway: bool) -> None:
    """Of a connection that was open when the capture began, nobody knows what it wrote before."""
    first = Talk()
    second = Talk(50001, beside=first)
    second.hosts = [7, 2]
    first.open()
    first.ask(write(1, [dbw(1, 0)], written(4, b"\x00\x01")))
    first.tell(ack_data(1, b"\x05\x01", b"\xff"))
    if not midway:
        second.open()
    for number in (1, 2):
        second.ask(write(number, [dbw(1, 0)], written(4, b"\x00\x01")))
        second.tell(ack_data(number, b"\x05\x01", b"\xff"))
    first.close()
    assert ("security.new_writer" in slugs(first)) is not midway


@pytest.mark.parametrize(
    ("variables", "answer_ns", "pause_ns", "polls", "found"),
    [
        (1, 4 * MS, MS // 2, 0, True),
        (2, 4 * MS, MS // 2, 0, True),
        (512, 4 * MS, MS // 2, 0, False),  # a recipe, variable by variable
        (1, 4 * MS, 96 * MS, 0, False),  # a heartbeat
        (1, 50 * MS, 50 * MS, 0, False),  # a heartbeat for a slow PLC
        (1, 4 * MS, 8 * MS, 0, False),  # the PLC rests more than it works
        (1, 4 * MS, MS // 2, 2, False),  # a panel that polls, and writes what was polled
    ],
)
def test_a_flood_of_writes_is_judged_by_how_fast_the_plc_answers(
    variables: int, answer_ns: int, pause_ns: int, polls: int, found: bool
) -> None:
    talk = Talk()
    talk.open()
    for number in range(1, 513):
        for _ in range(polls):
            talk.ask(read(number, dbw(2, 0)), after_ns=pause_ns)
            talk.tell(words(number, 1), after_ns=answer_ns)
        talk.ask(write(number, [dbw(1, 2 * (number // 7 % variables))], written(4, b"\x00\x01")), after_ns=pause_ns)
        talk.tell(ack_data(number, b"\x05\x01", b"\xff"), after_ns=answer_ns)
    talk.close()
    told = [finding.detail for finding in talk.findings if finding.slug == "security.flood"]
    assert bool(told) is found
    # Each of the writes has a value of its own.
    assert all(": 256 writes within " in detail and " = " not in detail for detail in told)


def test_a_flood_of_messages_counts_both_directions() -> None:
    talk = Talk()
    talk.open()
    for number in range(1, 1025):
        talk.ask(read(number, dbw(1, 0)), after_ns=1000)
        talk.tell(words(number, 1), after_ns=1000)
    (told,) = [finding.detail for finding in talk.findings if finding.slug == "security.flood"]
    assert re.fullmatch(
        r"2048 messages within 8\.05 ms between 10\.0\.0\.1:50000 and 10\.0\.0\.2:102, both directions together", told
    )


def test_a_flood_tells_the_median_of_its_answer_times() -> None:
    talk = Talk()
    talk.open()
    for number in range(1, 257):
        talk.ask(write(number, [dbw(1, 0)], written(4, b"\x00\x01")))
        # One answer in three of those that are looked at takes ten times as long.
        talk.tell(ack_data(number, b"\x05\x01", b"\xff"), after_ns=40 * MS if number % 48 == 0 else 4 * MS)
    talk.close()
    (told,) = [finding.detail for finding in talk.findings if finding.slug == "security.flood"]
    assert told.endswith("answered after 4.00 ms (median of 16 of them)")


@pytest.mark.parametrize(
    ("variables", "pause_ns", "polls", "found"),
    [
        (1, 5 * MS, 0, True),
        (512, 5 * MS, 0, False),  # a recipe, variable by variable
        (1, 8 * MS, 0, False),  # a PLC may rest as long as it works
        (1, MS, 2, False),  # a panel that polls, and writes what was polled
    ],
)
def test_a_flood_of_which_only_the_client_was_captured(variables: int, pause_ns: int, polls: int, found: bool) -> None:
    talk = Talk()
    for number in range(1, 513):
        for poll in range(polls):
            talk.ask(read(1000 + 2 * number + poll, dbw(2, 0)), after_ns=pause_ns)
        talk.ask(write(number, [dbw(1, 2 * (number // 7 % variables))], written(4, b"\x00\x01")), after_ns=pause_ns)
    talk.finish()
    told = [finding.detail for finding in talk.findings if finding.slug == "security.flood"]
    assert bool(told) is found
    assert all(detail.endswith(": 256 writes within 1.27 s, answer not captured") for detail in told)


def test_of_answers_alone_nobody_knows_which_variables_were_written() -> None:
    talk = Talk()
    for number in range(1, 513):
        talk.tell(ack_data(number, b"\x05\x01", b"\xff"))
    talk.finish()
    assert "security.flood" not in slugs(talk)


_JUDGED = ("security.flood", "security.new_writer", "security.reconnaissance", "security.protected")
_EVENTS: dict[str, dict[str, int]] = {
    "faults/flood_of_writes_part.pcap": {"security.flood": 1},
    # Tools that ask who the PLC is and what is loaded: engineering stations, scanners.
    "blocks/tia_s300_downloadOb1.pcapng": {"security.reconnaissance": 1},
    "s7comm_downloading_block_db1.pcap": {"security.reconnaissance": 1},
    "s7comm_reading_plc_status.pcap": {"security.reconnaissance": 1},
    "s7comm_reading_setting_plc_time.pcap": {"security.reconnaissance": 1},
    "s7ident_refused_upload.pcap": {"security.reconnaissance": 1, "security.protected": 1},
    "tia_s300_goOnline.pcapng": {"security.reconnaissance": 1},
    # Panels and clients at their daily work.
    "faults/wincc_s400_first_part.pcapng": {},
    "faults/retransmitted_request.pcapng": {},
    "wincc_s300_setup-alarm-read-write.pcapng": {},
    "water_pump_hmi.pcapng": {},
    "s7comm_clean.pcap": {},
    "s7comm_varservice_libnodavedemo.pcap": {},
    "step7_s300_rwVarTab.pcapng": {},
    "plc4x_manual_test_tpdu_nr.pcapng": {},
    "rdp-proprietary-encryption.pcap": {},
    "faults/rdp_part.pcap": {},
}


@pytest.mark.parametrize("name", _EVENTS)
def test_shared_captures(corpus: Path, name: str) -> None:
    """Which of the rules about floods, writers, looking around and protection speak on which capture."""
    pipeline = dissect.analyze(corpus / name).pipeline
    assert pipeline is not None
    counts = pipeline.finding_counts
    assert {slug: count for slug, count in counts.items() if slug in _JUDGED} == _EVENTS[name]


def test_no_capture_of_daily_work_is_a_flood(corpus: Path) -> None:
    for folder in ("s7plus", "blocks", "tags"):
        for path in sorted((corpus / folder).glob("*.pcap*")):
            pipeline = dissect.analyze(path).pipeline
            assert pipeline is not None
            assert "security.flood" not in pipeline.finding_counts, path


@pytest.mark.parametrize(("age_ns", "failed"), [(15 * MS, False), (52 * MS, False), (3 * SECOND, True)])
def test_a_request_is_unanswered_when_its_answer_was_due(age_ns: int, failed: bool) -> None:
    """One rule for the finding and for the list of what failed."""
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, after_ns=age_ns)
    talk.finish()
    assert ("transaction.unanswered" in slugs(talk)) is failed
    assert [transaction.failed for transaction in talk.transactions] == [failed]


def test_a_foreign_protocol_gets_no_findings_of_iso() -> None:
    talk = Talk(server_port=3389)
    talk.hello()
    talk.packet(CLIENT, tpkt(b"\x08\xe0\x00\x00\x00\x00\x00\x0d\x0a"))
    talk.packet(SERVER, tpkt(b"\x06\xd0\x00\x00\x12\x34\x00"))
    talk.packet(CLIENT, dt(b"\x7f\x65" + bytes(90)))
    for _ in range(5):
        talk.packet(SERVER, b"\x80\x2d" + bytes(43))  # fast-path octets, in no TPKT
    talk.close()
    assert slugs(talk) == set()
    assert [connection.protocol for connection in talk.connections] in (["rdp"], [])


def test_tds_gets_no_findings_of_tcp_or_iso() -> None:
    """SQL Server: a packet type, a status and a length, and octets that a retransmission shows otherwise."""
    talk = Talk(server_port=1433)
    talk.hello()
    for number in range(20):
        start = talk.seq[CLIENT]
        talk.packet(CLIENT, b"\x12\x01\x00\x10\x00\x00\x01\x00" + bytes(8))
        talk.packet(CLIENT, b"\x12\x01\x00\x10\x00\x00\x01\x00" + bytes(7) + b"\x01", seq=start)
        talk.packet(SERVER, b"\x04\x01\x00\x0c\x00\x33\x01\x00\x03\x00\x00" + bytes((number,)))
    talk.close()
    assert slugs(talk) == set()


def test_rdp_gets_no_findings(corpus: Path) -> None:
    pipeline = dissect.analyze(corpus / "faults" / "rdp_part.pcap").pipeline
    assert pipeline is not None
    kinds = {
        CATALOGUE[slug].kind
        for slug in pipeline.finding_counts
        if slug.startswith(("tpkt.", "cotp.", "s7.", "session."))
    }
    assert kinds == set()


def test_the_latency_runs_from_the_first_whole_copy_of_a_request() -> None:
    """Its retransmission also brings octets that were lost before: the client waited from the first copy on."""
    talk = Talk()
    talk.open()
    before = b"\x03\x00\x00\x07\x02\xf0\x80"
    asked = dt(read(1, dbw(1, 0)))
    start = talk.seq[CLIENT]
    first = talk.packet(CLIENT, asked, seq=(start + len(before)) & MASK)
    talk.packet(CLIENT, before + asked, seq=start, after_ns=200 * MS)
    talk.seq[CLIENT] = (start + len(before + asked)) & MASK
    talk.tell(words(1, 7), after_ns=30 * MS)
    talk.close()
    [transaction] = talk.transactions
    assert transaction.request_frame == first
    assert transaction.latency_ns == 230 * MS


def test_a_request_whose_answer_was_not_due_is_in_no_list_of_failures() -> None:
    talk = Talk()
    talk.open(3, 3)
    talk.ask(read(1, dbw(1, 0)), after_ns=2 * SECOND)
    talk.ask(read(2, dbw(1, 2)), after_ns=2 * SECOND)
    talk.packet(CLIENT, after_ns=15 * MS)
    talk.finish()
    analysis = Analysis()
    for transaction in talk.transactions:
        analysis.transaction(transaction)
    assert [transaction.number for transaction in analysis.failed] == [2]
    assert (analysis.unanswered, analysis.still_open) == (2, 1)
    assert (talk.connections[0].missed, talk.connections[0].still_open) == (1, 1)
    assert slugs(talk) == {"transaction.unanswered"}


def test_a_write_that_is_still_open_is_not_called_unconfirmed() -> None:
    assert not STILL_OPEN & UNCONFIRMED


@pytest.mark.parametrize("midway", [False, True])
@pytest.mark.parametrize("flags", [RST, RST | ACK])
def test_requests_killed_by_a_reset_are_found(midway: bool, flags: int) -> None:
    """Also where nothing but the reset, which acknowledges nothing, was captured of the server."""
    talk = Talk()
    if not midway:
        talk.open(3, 3)
    for number in (1, 2, 3):
        talk.ask(read(number, dbw(1, 2 * number)))
    talk.packet(SERVER, flags=flags, after_ns=300_000)
    talk.finish()
    assert talk.slugs() == ["session.cut"] + 3 * ["transaction.unanswered"]
    assert talk.findings[-1].detail == "Read Var DB1.DBW6: the server reset the connection 300 µs later"
    assert all(transaction.failed for transaction in talk.transactions)
