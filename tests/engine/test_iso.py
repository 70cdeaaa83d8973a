"""The short road of the usual TPKT and the general one: whatever comes, they tell the same."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random
from typing import Final

from dissect.engine.pipeline import Options
from dissect.engine.transactions.side import Side
from tests import build
from tests.cases import each
from tests.engine.transactions import talk as line
from tests.properties.books import Record, Result, check_books, facts
from tests.properties.messages import JOB, Item, connect, dt, read_answer, read_job, setup, write_answer, write_job
from tests.properties.packets import Packet, Segment, Talk, captured
from tests.properties.traffic import conversations, merged, reordered, segments

WORD: Final = Item(0x04, 1, 10, 0x84, 4 * 8)
EMPTY_DT: Final = bytes.fromhex("0300000702f000")
#: Octets that mean something to TPKT, COTP or S7, and their neighbours.
TELLING: Final = (0x00, 0x01, 0x02, 0x03, 0x04, 0x07, 0x08, 0x10, 0x32, 0x72, 0x7F, 0x80, 0x81, 0xE0, 0xF0, 0xFF)


class Watched(Record):
    """Asks for each TPDU, for which all of them have to take the general road."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.tpdus = 0

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.tpdus += 1


def run(packets: Iterable[Packet], record: Record) -> tuple[Result, object]:
    """Return the result, and all that was told and counted, in order."""
    result = Result((), finish=False, options=Options(strict=True), record=record)
    for packet in packets:
        result.feed(packet)
    result.pipeline.finish()
    pipeline = result.pipeline
    transactions = [
        (
            facts(one), one.number, one.connection.number, one.request_frame, one.request_ns, one._request_ack,
            one.response_frame, one.response_ns, one._flags, one.reason,
        )
        for one in record.transactions
    ]  # fmt: skip
    findings = [(one.slug, one.connection, one.frames, one.time_ns, one.detail) for one in record.findings]
    counted = [protocol.describe() for protocol in pipeline.protocols]
    closed = [(one.number, one.pdus, one.answered, one.unanswered, one.errors) for one in record.closed]
    return result, (transactions, findings, counted, closed, pipeline.counters.packet_counts(), pipeline.finding_counts)


def both(packets: list[Packet]) -> Result:
    """Hold the two roads against each other; return the result of the short one."""
    result, short = run(packets, Record())
    watched = Watched()
    general = run(packets, watched)[1]
    assert short == general
    assert watched.tpdus == sum(result.pipeline.iso.tpdus.counts())
    check_books(result.pipeline, result.record)
    return result


def damaged(rng: Random, sent: list[Segment]) -> list[Segment]:
    """Return segments of which some are missing and some have another octet somewhere."""
    kept = []
    for segment in sent:
        chance = rng.random()
        if chance < 0.03:
            continue
        if segment.payload and chance < 0.09:
            at = min(rng.randrange(len(segment.payload)), rng.randrange(24))
            octet = rng.choice((rng.randrange(256), rng.choice(TELLING)))
            payload = segment.payload[:at] + bytes((octet,)) + segment.payload[at + 1 :]
            kept.append(segment._replace(payload=payload))
        else:
            kept.append(segment)
    return kept


@each("seed", range(24))
def test_whatever_comes_both_roads_tell_the_same(seed: int) -> None:
    rng = Random(seed)
    made = conversations(rng, 3, 30, silent=0.1)
    streams = [
        reordered(rng, segments(one, rng, cut=0.1 * (seed % 3), join=0.2), 2.0 * (seed % 2), 0.05) for one in made
    ]
    if seed % 4:
        streams = [damaged(rng, stream) for stream in streams]
    result = both(captured(merged(rng, streams)))
    assert len(result.transactions) > 50


@each(("at", "asks"), [(at, asks) for at in range(24) for asks in (True, False)])
def test_each_octet_of_a_pdu_may_be_any(at: int, asks: bool) -> None:
    """One message of a session that goes on has another octet, from the first of its TPKT to the first behind the S7 header."""
    for octet in TELLING:
        request = dt(read_job(2, [WORD]))
        answer = dt(read_answer(2, [WORD], [b"\x00\x2a"]))
        told = request if asks else answer
        other = told[:at] + bytes((octet,)) + told[at + 1 :]
        talk = Talk().handshake()
        talk.send(0, connect(0xE0)).send(1, connect(0xD0))
        talk.send(0, dt(setup(JOB, 0, 8))).send(1, dt(setup(3, 0, 8)))
        talk.send(0, dt(read_job(1, [WORD]))).send(1, dt(read_answer(1, [WORD], [b"\x00\x2b"])))
        talk.send(0, other if asks else request).send(1, answer if asks else other)
        talk.send(0, dt(write_job(3, [WORD], [b"\x00\x2c"]))).send(1, dt(write_answer(3, [0xFF])))
        result = both(captured(talk.segments))
        assert len(result.transactions) >= 2


@each(("octet", "asks"), [(octet, asks) for octet in TELLING for asks in (True, False)])
def test_short_segments_between_pdus(octet: int, asks: bool) -> None:
    """An empty DT, or nearly one, whole or in pieces, comes before each message of a session that goes on."""
    side = 0 if asks else 1
    others = [EMPTY_DT[:at] + bytes((octet,)) + EMPTY_DT[at + 1 :] for at in range(len(EMPTY_DT))]
    pieces: list[tuple[bytes, ...]] = [(one,) for one in [EMPTY_DT, *others]]
    pieces += [(EMPTY_DT, EMPTY_DT), (EMPTY_DT * 2,), *[(EMPTY_DT[:at], EMPTY_DT[at:]) for at in range(1, 7)]]
    for sent in pieces:
        talk = Talk().handshake()
        talk.send(0, connect(0xE0)).send(1, connect(0xD0))
        talk.send(0, dt(setup(JOB, 0, 8))).send(1, dt(setup(3, 0, 8)))
        for ref in (1, 2, 3):
            for part in sent:
                talk.send(side, part)
            talk.send(0, dt(read_job(ref, [WORD]))).send(1, dt(read_answer(ref, [WORD], [b"\x00\x2b"])))
        both(captured(talk.segments))


def test_empty_dts_and_numbered_ones_are_counted() -> None:
    talk = Talk().handshake()
    talk.send(0, connect(0xE0)).send(1, connect(0xD0))
    talk.send(0, dt(setup(JOB, 0, 8))).send(1, dt(setup(3, 0, 8)))
    for ref in range(1, 9):
        request, answer = dt(read_job(ref, [WORD])), dt(read_answer(ref, [WORD], [b"\x00\x2b"]))
        talk.send(0, request[:6] + bytes((0x80 | ref,)) + request[7:]).send(1, EMPTY_DT).send(1, answer)
    result = both(captured(talk.segments))
    assert sum(result.pipeline.iso.tpdus.counts()) == 2 + 2 + 3 * 8
    assert len(result.transactions) == 9
    assert result.pipeline.finding_counts["cotp.tpdu_nr"] == 1


def test_a_numbered_request_of_either_kind_may_be_the_reason_of_a_silence() -> None:
    """A job shows that it asks in its second octet, userdata in its sixteenth; what answers or tells something asks nothing."""
    szl = line.userdata(1, line.head(1, 4, 1))
    for pdu, asks in (
        (line.read(1, line.dbw(1, 0)), True), (szl, True), (line.userdata(1, line.head(0, 4, 1)), False),
        (line.words(1, 1), False),
    ):  # fmt: skip
        talk = line.Talk()
        talk.open(1, 1)
        for number in (1, 2, 3):
            talk.packet(line.CLIENT, build.dt(pdu[:4] + bytes((0, number)) + pdu[6:], number=number))
            talk.wait(line.SECOND)
        talk.close()
        assert ("cotp.number_unanswered" in talk.pipeline.finding_counts) is asks, pdu


@each("number", [0, 1, 127])
def test_numbered_data_of_any_length_is_taken(number: int) -> None:
    """Also of none and of one octet, at the end of what was captured: the next message is read as ever."""
    for data in (b"", b"\x32", b"\x00", b"\x32\x01", b"\x32\x03"):
        talk = line.Talk()
        talk.open()
        talk.packet(line.CLIENT, build.dt(data, number=number))
        talk.ask(line.read(1, line.dbw(1, 0)))
        talk.tell(line.words(1, 1))
        talk.close()
        assert "answered" in talk.outcomes(), (data, number)
        assert talk.pipeline.counters.octets.failed == 0
