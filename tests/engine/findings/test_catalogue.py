"""Every rule of the catalogue: a conversation that makes it speak, one beside it in which it keeps silent, and its words."""

from __future__ import annotations

import ast
import datetime
import re
import ssl
from pathlib import Path
from typing import Final

import dissect
from dissect.engine.findings.catalogue import CATALOGUE, KINDS, SEVERITIES
from dissect.engine.transactions.table import MAX_CONNECTIONS, MAX_HALF_OPEN
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp import ip
from dissect.protocols.s7plus.assembly import MAX_PDU
from dissect.protocols.s7plus.value_tables import DINT
from dissect.protocols.s7plus.values import Value
from tests.cases import each
from tests.engine.findings import (
    block_scenarios,
    cause_scenarios,
    events,
    operation_scenarios,
    plus_scenarios,
    scd_scenarios,
    security_scenarios,
    station_scenarios,
)
from tests.engine.findings.registry import SILENT, SPEAKS, silent, speaks
from tests.engine.transactions.talk import (
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
    head,
    item,
    job,
    read,
    refused,
    setup,
    tpkt,
    userdata,
    words,
    write,
    written,
)
from tests.protocols.ibh import packets as ibh
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus import pdus as plus
from tests.protocols.tls.talks import THEN, Wire, certificate, ec_key, in_tls, rsa_key, wire

PACKAGE: Final = Path(dissect.__file__).parent
#: An Ethernet and an IPv4 header, from 10.0.0.1 to 10.0.0.2 over TCP.
IPV4: Final = bytes(12) + bytes.fromhex("0800 45000028 0001 0000 40060000 0a000001 0a000002")
#: Rooms that may judge.
ENGINE: Final = frozenset(("engine", "engine/acts", "engine/findings", "meaning/bindings"))
#: Rooms whose findings are written in the source as "room.what".
SLUG: Final = re.compile(
    r"(capture|ip|stream|tpkt|ibh|cotp|s7|s7plus|session|transaction|function|security|scd|operation|block|device|internal)\.[a-z_0-9]+"
)


# ---- words ----------------------------------------------------------------------------------------------------------


@each("slug", CATALOGUE)
def test_words(slug: str) -> None:
    rule = CATALOGUE[slug]
    assert rule.slug == slug
    assert SLUG.fullmatch(slug)
    assert rule.severity in SEVERITIES
    assert rule.kind in KINDS
    assert rule.sentence.endswith(".")
    assert rule.sentence[0].isupper()
    assert rule.advice.endswith(".")
    assert rule.advice[0].isupper()
    assert not {"  ", "\n"} & {rule.sentence, rule.advice}


def noted(tree: ast.AST) -> set[str]:
    """The slugs that a module names."""
    return {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and SLUG.fullmatch(node.value)
    }


def test_what_the_code_notes_is_the_catalogue() -> None:
    used: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        if path.parent.relative_to(PACKAGE).as_posix() in ENGINE and path.name != "catalogue.py":
            used |= noted(ast.parse(path.read_text("utf-8")))
    assert used == set(CATALOGUE)


# ---- the rules (those about security and operations have scenarios in files of their own) --------------------------


@silent(
    "capture.damaged",
    "ip.fragments_evicted",
    "stream.half_open_evicted",
    "tpkt.bad_length",
    "tpkt.false_length",
    "stream.outside_window",
    "ip.bad_header",
    "ip.fragment_invalid",
    "session.idle",
    "tpkt.reserved",
    "cotp.error",
    "cotp.malformed",
    "cotp.tpdu_nr",
    "s7.unknown_rosctr",
    "s7.redundancy_id",
    "s7.ack_content",
    "s7.client_push",
    "internal.bug",
    "capture.dropped",
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


@speaks("capture.dropped")
def dropped(talk: Talk) -> None:
    talk.pipeline.note_dropped("3 packets")


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


@speaks("capture.not_opened")
def sealed_packets(talk: Talk) -> None:
    talk.raw(bytes(12) + b"\x88\xe5\x0c\x00" + bytes(60))


@silent("capture.not_opened")
def no_tunnel(talk: Talk) -> None:
    """ARP, and the same MACsec without encryption."""
    talk.raw(bytes(12) + b"\x08\x06" + bytes(46))
    talk.raw(bytes(12) + b"\x88\xe5" + bytes(6) + b"\x08\x06" + bytes(46))


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


def knock(talk: Talk, *after_ns: int) -> None:
    """A SYN, and the same one again after each of these times."""
    for pause in (0, *after_ns):
        talk.packet(CLIENT, flags=SYN, seq=1000, after_ns=pause)


@speaks("stream.unanswered")
def nobody_answers(talk: Talk) -> None:
    knock(talk, SECOND, 2 * SECOND)
    talk.pipeline.exchange.report_findings()
    (finding,) = talk.findings  # told at once, and not again with each further SYN
    assert finding.frames == [1, 3]
    assert finding.detail == "10.0.0.2:102 does not answer 10.0.0.1:50000 within 3.00 s"
    knock(talk, 8 * SECOND)
    other = Talk(50001, beside=talk)
    knock(other, SECOND)
    other.packet(CLIENT, flags=SYN, seq=2000, after_ns=SECOND)  # another attempt, which ends the one before
    talk.pipeline.exchange.report_findings()
    assert talk.slugs() == ["stream.unanswered"] * 2
    last = Talk(50002, beside=talk)
    knock(last, SECOND)
    talk.finish()
    assert talk.slugs() == ["stream.unanswered"] * 3
    talk.finish()
    assert talk.slugs() == ["stream.unanswered"] * 3


@silent("stream.unanswered")
def one_syn_or_an_answer_after_all(talk: Talk) -> None:
    knock(Talk(50001, 8080, beside=talk), SECOND, 2 * SECOND)
    knock(Talk(50002, beside=talk))
    knock(Talk(50003, beside=talk), MS)  # captured twice
    knock(talk, SECOND)
    talk.seq[CLIENT] = 1001
    talk.packet(SERVER, flags=SYN | ACK)
    only_asked = Talk(50004, beside=talk)  # only this direction is in the capture
    knock(only_asked, SECOND)
    only_asked.ask(read(1, dbw(1, 0)))


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
        other.packet(CLIENT, CONNECT + dt(read(1, dbw(1, 0))), after_ns=1000)


@silent("stream.evicted")
def idle_and_forgotten(talk: Talk) -> None:
    """Nothing is open on them, so that nothing is lost."""
    for number in range(MAX_CONNECTIONS + 2):
        other = Talk(1024 + number, beside=talk)
        other.packet(CLIENT, CONNECT, after_ns=1000)


@speaks("stream.bad_checksum")
def bad_checksum(talk: Talk) -> None:
    talk.verify()
    talk.open()
    talk.sums = False
    talk.ask(read(1, dbw(1, 0)))


@silent("stream.bad_checksum")
def good_checksum(talk: Talk) -> None:
    talk.verify()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))


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


@speaks("ip.bad_header")
def bad_header(talk: Talk) -> None:
    for _ in range(3):
        talk.raw(IPV4[:14] + b"\x42" + IPV4[15:] + bytes(20))
    assert talk.pipeline.finding_counts["ip.bad_header"] == 3
    talk.pipeline.exchange.report_findings()
    assert talk.slugs() == ["ip.bad_header"]


@speaks("ip.fragment_invalid")
def beyond_64_kib(talk: Talk) -> None:
    for _ in range(3):
        talk.raw(IPV4[:20] + b"\x1f\xff" + IPV4[22:] + bytes(20))
    assert talk.pipeline.finding_counts["ip.fragment_invalid"] == 3


@speaks("session.idle")
def keep_alive_probes(talk: Talk) -> None:
    for _ in range(3):
        talk.packet(CLIENT, b"\0", seq=talk.seq[CLIENT])
        talk.packet(SERVER)
    talk.finish()
    assert talk.pipeline.counters.octets.skipped == 0
    assert talk.pipeline.counters.packet_counts()["keep_alive"] == 3
    assert talk.slugs() == ["session.idle"]
    assert talk.findings[0].frames == [1, 5]


@speaks("stream.outside_window")
def outside_window(talk: Talk) -> None:
    talk.open()
    talk.acked[SERVER] = talk.seq[CLIENT]
    talk.packet(CLIENT, dt(write(9, [dbw(1, 0)], written(4, b"\x00\x01"))), seq=talk.seq[CLIENT] + (1 << 30))
    talk.packet(SERVER)
    talk.close()
    assert 5 not in [transaction.function for transaction in talk.transactions]


@speaks("tpkt.false_length")
def false_length(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, b"\x03\x00\xff\xff\x02\xf0\x80" + dt(read(1, dbw(1, 0))))


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


@silent("cotp.disconnected")
def takes_its_leave(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.packet(CLIENT, tpkt(bytes.fromhex("06800001000080")))


@silent("cotp.repeated_request", "cotp.answer_without_request")
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


@speaks("cotp.bad_start")
def data_before_connect(talk: Talk) -> None:
    talk.hello()
    talk.ask(setup(0))


@silent("cotp.bad_start")
def data_at_the_start_of_the_capture(talk: Talk) -> None:
    """Nobody knows what came before, and a server may refuse."""
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    other = Talk(50001, beside=talk)
    cotp_refused(other)


def confirm(reference: int = 1, class_: int = 0, calling: str = "0100", called: str = "0102", size: int = 10) -> bytes:
    """A connect confirm for `CONNECT`, which has reference 1, class 0, these TSAPs and a TPDU size of 1024."""
    fixed = f"11d0{reference:04x}0002{class_ << 4:02x}"
    return tpkt(bytes.fromhex(f"{fixed}c102{calling}c202{called}c001{size:02x}"))


@speaks("cotp.bad_confirm")
def bad_confirm(talk: Talk) -> None:
    for number, told in enumerate(
        (confirm(reference=2), confirm(class_=2), confirm(called="0103"), confirm(calling="0203"), confirm(size=11))
    ):
        other = Talk(50001 + number, beside=talk)
        other.hello()
        other.packet(CLIENT, CONNECT)
        other.packet(SERVER, told)
    assert [finding.detail for finding in talk.findings] == [
        "destination reference 0x0002, the request has 0x0001",
        "class 2, requested 0",
        "called TSAP 01.03, requested 01.02",
        "calling TSAP 02.03, requested 01.00",
        "TPDU size 2048, requested 1024",
    ]


@silent("cotp.bad_confirm")
def smaller_confirm(talk: Talk) -> None:
    """Less than was asked for, and no TSAPs at all."""
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, confirm(size=9))
    other = Talk(50001, beside=talk)
    other.hello()
    other.packet(CLIENT, CONNECT)
    other.packet(SERVER, tpkt(bytes.fromhex("06d00001000200")))


@speaks("cotp.after_disconnect")
def after_disconnect(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, tpkt(bytes.fromhex("06800001000080")))
    talk.ask(read(1, dbw(1, 0)))


@silent("cotp.after_disconnect")
def answer_under_way_at_a_disconnect(talk: Talk) -> None:
    """What the other side sent before it saw the DR, and a refusal after which TCP closes."""
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, tpkt(bytes.fromhex("06800001000080")))
    talk.tell(words(1, 1))
    talk.close()


@speaks("cotp.tpdu_nr")
def tpdu_nr(talk: Talk) -> None:
    talk.open()
    for number in (1, 2):
        talk.packet(CLIENT, tpkt(b"\x02\xf0" + bytes((0x80 | number,)) + read(number, dbw(1, 0))))
        talk.tell(words(number, 1))
    assert talk.slugs() == ["cotp.tpdu_nr"]
    assert talk.outcomes() == ["answered", "answered"]


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


# IBH-NetLink.


def gateway(talk: Talk, *octets: bytes) -> Talk:
    other = Talk(50001, 1099, beside=talk)
    other.hello()
    for one in octets:
        other.packet(CLIENT, one)
    return other


@speaks("ibh.malformed")
def ibh_lengths(talk: Talk) -> None:
    gateway(talk, ibh.ASK[:12] + b"\x7f" + ibh.ASK[13:])


@silent("ibh.malformed", "ibh.unfinished")
def ibh_in_fragments(talk: Talk) -> None:
    octets = words(1, 1)
    other = gateway(talk, ibh.CLAIM, ibh.ASK[:9], ibh.ASK[9:])
    other.packet(SERVER, ibh.RECEIPT + ibh.long(0xF0, octets[:9]))
    other.packet(SERVER, ibh.long(0xF1, octets[9:]))
    other.close()
    assert talk.outcomes() == ["answered"]


@speaks("ibh.unfinished")
def ibh_unfinished(talk: Talk) -> None:
    gateway(talk, ibh.CLAIM, ibh.short(0xF0, read(1, dbw(1, 0))[:9])).close()


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


@speaks("s7.plus_too_long")
def plus_too_long(talk: Talk) -> None:
    talk.hello()
    talk.connect()
    frame = b"\x72\x02\x03\x84" + bytes(900)
    for _ in range(MAX_PDU // (60 * len(frame)) + 1):
        talk.ask(*[frame] * 60)
    talk.ask(frame + b"\x72\x02\x00\x00")


@silent("s7.plus_too_long")
def plus_just_fits(talk: Talk) -> None:
    """As long as it may be."""
    talk.hello()
    talk.connect()
    frame = b"\x72\x02\x03\x84" + bytes(900)
    for _ in range(MAX_PDU // (60 * len(frame)) - 1):
        talk.ask(*[frame] * 60)
    talk.ask(frame + b"\x72\x02\x00\x00")
    assert talk.pipeline.plus.pdus == 1


@speaks("s7plus.malformed")
def plus_contents_that_lie(talk: Talk) -> None:
    talk.hello()
    talk.connect()
    body = bodies.set_variable(52, [2167], Value(0x10, DINT, [1]))
    talk.ask(plus.framed(plus.asked(1, plus.SET_VARIABLE, body=body.replace(b"\x10\x08\x01", b"\x10\x08\x7f")), 3))
    talk.tell(plus.framed(plus.told(1, plus.SET_VARIABLE, b"\0" + bodies.end(1)), 3))


@silent("s7plus.malformed")
def plus_contents_as_they_should_be(talk: Talk) -> None:
    talk.hello()
    talk.connect()
    talk.ask(
        plus.framed(plus.asked(1, plus.SET_VARIABLE, body=bodies.set_variable(52, [1], Value(0x10, DINT, [1]))), 3)
    )
    talk.tell(plus.framed(plus.told(1, plus.SET_VARIABLE, b"\0" + bodies.end(1)), 3))


@speaks("cotp.empty_dt")
def acknowledged_before_it_is_answered(talk: Talk) -> None:
    talk.open()
    for ref in (1, 2):
        talk.ask(read(ref, dbw(1, 0)))
        talk.packet(SERVER, tpkt(b"\x02\xf0\x00"))
        talk.tell(words(ref, 1))


@silent("cotp.empty_dt")
def acknowledged_once_it_is_answered(talk: Talk) -> None:
    talk.open()
    for ref in (1, 2):
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1))
        talk.packet(CLIENT, tpkt(b"\x02\xf0\x00"))


@speaks("cotp.expedited_too_long")
def expedited_data_of_17_bytes(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, tpkt(b"\x02\x10\x80" + bytes(17)))


@silent("cotp.expedited_too_long")
def expedited_data_of_16_bytes(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, tpkt(b"\x02\x10\x80" + bytes(16)))
    talk.ask(read(1, dbw(1, 0, 20)))


@speaks("s7plus.unknown_kind")
def plus_items_of_an_unknown_kind(talk: Talk) -> None:
    """An item of kind 1 and four zeros in the second part, as an S7-1500 sends it with each notification."""
    talk.hello()
    talk.connect()
    for number in (5, 6, 7):
        second = b"\x00\x70\x00\x0e\x5e\x00\x00\x01\x00\x00\x00\x00"
        talk.tell(plus.framed(plus.notified(number)[:-1] + second, 3))


@silent("s7plus.unknown_kind")
def plus_items_of_known_kinds(talk: Talk) -> None:
    """A second part with a refused item, and a value that contradicts itself."""
    talk.hello()
    talk.connect()
    second = b"\x00\x70\x00\x0e\x5e\x00\x00\x13\x00\x00\x00\x07\x00\x00\x00\x00"
    talk.tell(plus.framed(plus.notified(5)[:-1] + second, 3))
    contradictory = b"\x92\x00\x00\x00\x07\x10\x08\x7f\x01"
    talk.tell(plus.framed(plus.notified(6)[:-1] + contradictory, 3))


@speaks("s7plus.notifications_lost")
def plus_notifications_leap(talk: Talk) -> None:
    talk.hello()
    talk.connect()
    for number in (5, 6, 8):
        talk.tell(plus.framed(plus.notified(number)))


@silent("s7plus.notifications_lost")
def plus_notifications_in_order(talk: Talk) -> None:
    """Of two subscriptions, and of an old S7-1200, which counts in one octet; then a session begins anew."""
    talk.hello()
    talk.connect()
    for number, subscription in ((5, 0x70000E51), (6, 0x70000E52), (7, 0x70000E51), (1, 0x70000E53), (2, 0x70000E53)):
        talk.tell(plus.framed(plus.notified(number, subscription)))


@speaks("s7.unknown_rosctr")
def unknown_rosctr(talk: Talk) -> None:
    talk.open()
    talk.ask(b"\x32\x05" + read(1, dbw(1, 0))[2:])


@speaks("s7.redundancy_id")
def redundancy_id(talk: Talk) -> None:
    talk.open()
    for number in (1, 2):
        asked = read(number, dbw(1, 0))
        talk.ask(asked[:2] + b"\x00\x01" + asked[4:])
        talk.tell(words(number, 1))
    assert talk.slugs() == ["s7.redundancy_id"]


@speaks("s7.ack_content")
def ack_content(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack(1, 0x8104, b"\x04"))


@speaks("s7.client_push")
def client_push(talk: Talk) -> None:
    """The client mistakes the type of its request: it asked, and not the PLC."""
    talk.open()
    talk.ask(userdata(5, head(0, 4, 1), b"\xff\x09\x00\x04\x00\x11\x00\x00"))
    talk.tell(userdata(5, head(2, 4, 1, 0, 0x8104)))
    assert [finding.slug for finding in talk.findings] == ["s7.client_push", "transaction.refused"]
    asked = talk.transactions[-1]
    assert (asked.asked_by, asked.request_frame, asked.outcome) == (CLIENT, 8, "answered")


@speaks("s7.unknown_code")
def unknown_code(talk: Talk) -> None:
    talk.open(8, 8)
    talk.ask(job(1, b"\x77"), read(2, item(0x99, 0, 0, 2)), read(3, item(0x83, 0, 0, 0x55)))
    talk.ask(read(4, b"\x12\x04\x99\x00\x00\x00"), userdata(5, head(1, 4, 0x77)), userdata(6, head(1, 0x2A, 1)))
    assert [finding.detail for finding in talk.findings] == [
        "function 0x77",
        "Read Var: item 1: area 0x99",
        "Read Var: item 1: transport size 0x55",
        "Read Var: item 1: syntax 0x99",
        "subfunction 0x77 of CPU functions",
        "userdata group 0x2a",
    ]


@speaks("s7.odd_address")
def odd_address(talk: Talk) -> None:
    talk.open(8, 8)
    odd = (
        item(0x84, 1, 1 << 19, 2),
        item(0x84, 1, 3, 4),
        item(0x83, 7, 8, 2),
        item(0x1D, 0, 5, 4),
    )
    for number, one in enumerate(odd):
        talk.ask(read(number, one), read(100 + number, one))
    assert [finding.detail.partition(": ")[2] for finding in talk.findings] == [
        "DB1.DBB65536: bits above the address are set",
        "DB1.DBW0.3: bit 3 in the address of a WORD",
        "MB1: DB number 7 outside a DB",
        "T5: transport size WORD",
    ]


@silent("s7.odd_address", "s7.unknown_code")
def addresses_in_order(talk: Talk) -> None:
    """A bit, the last octet of a DB, a timer, a data record with a logical address, and a symbol."""
    talk.open(8, 8)
    items = (item(0x82, 0, 3, 1), item(0x84, 65535, 0x7FFF8, 2), item(0x1D, 0, 5, 0x1D), item(0x01, 7, 0xFFFFFF, 2))
    talk.ask(read(1, *items), read(2, b"\x12\x04\xb2\xff\x00\x00"), userdata(3, head(1, 4, 1)))


@speaks("session.repeated_setup")
def repeated_setup(talk: Talk) -> None:
    talk.open()
    talk.ask(setup(1, 1, 1, 240))


@silent("session.repeated_setup")
def setup_on_each_connection(talk: Talk) -> None:
    talk.open()
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, CONFIRM)
    talk.ask(setup(1))
    assert len(talk.connections) == 1


@speaks("session.read_too_long")
def read_too_long(talk: Talk) -> None:
    talk.open(1, 1, 240)
    talk.ask(read(1, item(0x84, 1, 0, 2, 223)))


@silent("session.read_too_long")
def longest_read(talk: Talk) -> None:
    """Two odd items, the first of them padded: 14 + 4 + 109 + 1 + 4 + 108 octets."""
    talk.open(1, 1, 240)
    talk.ask(read(1, item(0x84, 1, 0, 2, 109), item(0x84, 1, 0, 2, 108)))
    talk.ask(read(2, item(0x84, 1, 0, 2, 222)))
    talk.tell(ack_data(2, b"\x04\x01", good(4, bytes(222))))


@speaks("session.data_before_setup")
def data_before_setup(talk: Talk) -> None:
    talk.hello()
    talk.connect()
    talk.ask(read(1, dbw(1, 0)))


@silent(
    "session.data_before_setup",
    "session.bad_grant",
    "session.unusual_port",
    "session.foreign_on_102",
    "session.encrypted",
)
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


@speaks("session.shared_reference")
def shared_reference(talk: Talk) -> None:
    talk.open(3, 3)
    talk.ask(read(0, dbw(1, 0)), read(0, dbw(1, 2)))


@silent("session.shared_reference")
def one_reference_after_the_other(talk: Talk) -> None:
    """Always the same reference, but each answer is waited for; then one request that is only repeated."""
    talk.open(3, 3)
    for number in range(3):
        talk.ask(read(0, dbw(1, 2 * number)))
        talk.tell(words(0, number))
    talk.ask(read(0, dbw(1, 0)))
    talk.ask(read(0, dbw(1, 0)))


@speaks("session.bad_grant")
def bad_grant(talk: Talk) -> None:
    talk.connect()
    talk.ask(setup(1, 1, 1, 240))
    talk.tell(granted(1, 1, 1, 480))


@speaks("session.unusual_port")
def unusual_port(talk: Talk) -> None:
    other = Talk(50000, 4102, beside=talk)
    other.open()


@speaks("session.encrypted")
def encrypted(talk: Talk) -> None:
    talk.hello()
    talk.connect()
    talk.ask(plus.framed(plus.asked(1), 1))
    talk.ask(bytes.fromhex("1603010005010000010a"))


@speaks("session.tls_closed")
def keys_of_another_session(talk: Talk) -> None:
    talk.unlock(wire([]).key_log)
    in_tls(talk, wire([(0, b"x")]))


@silent("session.tls_closed", "security.tls_weak", "security.certificate_expired", "security.certificate_weak")
def keys_that_open(talk: Talk) -> None:
    found = wire([(0, b"x")])
    talk.unlock(found.key_log)
    in_tls(talk, found)
    assert talk.pipeline.tls.decrypted == 1


@speaks("security.tls_weak")
def tls_1_0(talk: Talk) -> None:
    body = b"\x03\x01" + bytes(32) + b"\x00\x00\x2f\x00"
    hello = b"\x02" + len(body).to_bytes(3, "big") + body
    in_tls(talk, Wire([(1, b"\x16\x03\x01" + len(hello).to_bytes(2, "big") + hello)]))


@speaks("security.certificate_expired")
def an_expired_certificate(talk: Talk) -> None:
    made = certificate(ec_key(), ends=THEN - datetime.timedelta(days=1))
    in_tls(talk, wire([], ssl.TLSVersion.TLSv1_2, key=ec_key(), made=made))


@speaks("security.certificate_weak")
def a_weak_certificate(talk: Talk) -> None:
    in_tls(talk, wire([], ssl.TLSVersion.TLSv1_2, "ECDHE+AESGCM:@SECLEVEL=0", rsa_key(1024)))


@speaks("session.foreign_on_102")
def foreign(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT, b"GET / HTTP/1.1\r\n\r\n")
    for _ in range(70):
        talk.packet(CLIENT, b"Host: example\r\n")


@speaks("session.cut")
def session_cut(talk: Talk) -> None:
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)), read(2, dbw(1, 2)))
    talk.packet(SERVER, flags=RST, after_ns=SECOND)


@silent("session.cut")
def one_request_cut(talk: Talk) -> None:
    """One request without answer has its own line, which says who cut it off."""
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(SERVER, flags=RST, after_ns=SECOND)
    assert talk.findings == []
    talk.finish()
    assert [finding.detail for finding in talk.findings] == [
        "Read Var DB1.DBW0: the server reset the connection 1.00 s later"
    ]


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
    "transaction.odd_data_code",
)
def good_answers(talk: Talk) -> None:
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0), dbw(1, 2)), job(2, b"\x29" + bytes(15)), write(3, [dbw(1, 0)], written(4, b"\0\1")))
    talk.tell(ack_data(1, b"\x04\x02", good(4, b"\0\1") * 2), ack_data(2, b"\x29"), ack_data(3, b"\x05\x01", b"\xff"))


#: Two alarms to be acknowledged: number of the event, then the signals whose going and coming that is for.
ALARMS: Final = bytes.fromhex("0902 1208190060000001 0101 1208190060000002 0001")


@speaks("transaction.alarm_refused")
def alarm_refused(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 4, 0x0B, ALARMS))
    talk.tell(events.tells(1, 4, 0x0B, bytes.fromhex("0902 ff0a")))
    assert [finding.detail for finding in talk.findings if finding.slug == "transaction.alarm_refused"] == [
        "CPU functions: ALARM ack: event 0x60000002: 0x0a Object does not exist"
    ]
    assert [(error.where, error.coded) for error in talk.transactions[-1].errors] == [
        ("alarm 2", "0x0a Object does not exist")
    ]


@silent("transaction.alarm_refused")
def alarms_acknowledged(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 4, 0x0B, ALARMS))
    talk.tell(events.tells(1, 4, 0x0B, bytes.fromhex("0902 ffff")))
    assert not talk.transactions[-1].has_errors


@speaks("transaction.unanswered")
def unanswered(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.close()


@speaks("transaction.overdue")
def overdue(talk: Talk) -> None:
    talk.watch(2 * SECOND)
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.silence(2 * SECOND)


@silent("transaction.overdue")
def nearly_overdue(talk: Talk) -> None:
    talk.watch(2 * SECOND)
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.silence(2 * SECOND - 2 * MS)
    talk.tell(words(1, 1))
    talk.silence(10 * SECOND)


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


@speaks("transaction.odd_data_code")
def odd_data_code(talk: Talk) -> None:
    talk.open()
    for number in (1, 2):
        talk.ask(read(number, item(0x84, 1, 8 * number, 5)))
        talk.tell(ack_data(number, b"\x04\x01", good(4, b"\0\1")))
    assert [finding.detail for finding in talk.findings] == [
        "Read Var DB1.DBW1: item 1, a INT, was returned as 0x04 instead of 0x05"
    ]


@speaks("transaction.write_size")
def write_size(talk: Talk) -> None:
    talk.open()
    talk.ask(write(1, [dbw(1, 0)], written(4, bytes(4))))
    talk.tell(ack_data(1, b"\x05\x01", b"\x07"))
    told = [finding.detail for finding in talk.findings if finding.slug == "transaction.write_size"]
    assert told == ["Write Var DB1.DBW0 = 00 00 00 00: item 1 (DB1.DBW0) needs 2 bytes, got 4"]


@silent("transaction.write_size")
def write_sizes_that_fit(talk: Talk) -> None:
    """With the trailing fill octet of one client (reference 3.5)."""
    talk.open(8, 8)
    talk.ask(write(1, [item(0x84, 1, 0, 2, 3)], written(4, bytes(3)) + b"\0"))
    talk.ask(write(2, [item(0x83, 0, 9, 1)], written(3, b"\1")))


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


# What an intruder would do: a scan for racks and slots.


def try_tsap(talk: Talk, number: int, server_says: bytes) -> None:
    other = Talk(50100 + number, beside=talk)
    other.hello()
    other.packet(CLIENT, tpkt(bytes.fromhex(f"11e00000000100c1020100c20201{number:02x}c0010a")))
    other.packet(SERVER, server_says)


@speaks("security.tsap_scan")
def tsap_scan(talk: Talk) -> None:
    for number in range(3):
        assert "security.tsap_scan" not in talk.slugs()
        try_tsap(talk, number, tpkt(bytes.fromhex("06800001000082")))


@silent("security.tsap_scan")
def one_tsap_refused_again_and_again(talk: Talk) -> None:
    """No free connection, and a client that does not give up; and five CPUs in one rack."""
    for number in range(8):
        try_tsap(talk, 2, tpkt(bytes.fromhex("06800001000082")))
        talk.ports[0] += number
    for number in range(2, 6):
        try_tsap(talk, number, tpkt(bytes.fromhex("06d00001000200")))


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
    assert failing.pipeline.finding_counts["internal.bug"] == 3  # the setup fails as well
    assert failing.findings[-1].detail == "ZeroDivisionError: out of tune"
    talk.findings.extend(failing.findings)


@each("slug", CATALOGUE)
def test_rule_speaks(slug: str) -> None:
    talk = Talk()
    SPEAKS[slug](talk)
    talk.finish()
    talk.pipeline.exchange.report_findings()
    assert slug in talk.slugs()
    for finding in talk.findings:
        if finding.slug == slug:
            assert finding.rule is CATALOGUE[slug]
            assert all(frame > 0 for frame in finding.frames)
            assert not finding.detail.endswith(".")


@each("slug", CATALOGUE)
def test_rule_keeps_silent(slug: str) -> None:
    talk = Talk()
    SILENT[slug](talk)
    talk.finish()
    assert slug not in talk.slugs()
    assert slug not in talk.pipeline.finding_counts


def test_who_wants_no_facts_gets_the_same_findings() -> None:
    """Ethernet addresses are not made facts for an observer that does not look at facts, unless they contradict."""
    for found, wanted in ((SPEAKS, True), (SPEAKS, False), (SILENT, False)):
        talk = Talk()
        talk.wants_facts = wanted
        found["device.mac_changed"](talk)
        assert ("device.mac_changed" in {finding.slug for finding in talk.findings}) is (found is SPEAKS)


def test_every_rule_has_both() -> None:
    assert {
        block_scenarios.__name__,
        cause_scenarios.__name__,
        operation_scenarios.__name__,
        plus_scenarios.__name__,
        scd_scenarios.__name__,
        security_scenarios.__name__,
        station_scenarios.__name__,
    }  # importing them entered theirs
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
    assert talk.pipeline.finding_counts["s7.unknown_rosctr"] == 5000
    assert talk.slugs().count("s7.unknown_rosctr") == 100


def test_a_live_capture_that_ended_is_no_damaged_file() -> None:
    """An interface that is gone is the same finding."""
    rule = CATALOGUE["capture.damaged"]
    assert "file" not in rule.sentence
    assert "check the interface" in rule.advice
