"""A flood of bad PDUs: the counters stay exact, the details bounded, the work linear (promise G20)."""

from __future__ import annotations

from collections.abc import Iterator

from dissect.engine.findings.reporter import MAX_DETAILED, MAX_DETAILED_ALL
from dissect.engine.pipeline import Options, Pipeline
from tests.growth import assert_growth
from tests.properties.books import Record, check_books
from tests.properties.messages import ACK_DATA, JOB, connect, dt, pdu, setup, tpkt
from tests.properties.packets import EPOCH_NS, MS, Flow, Segment, Talk

#: What is wrong, how often each connection sends it, and the finding it causes.
BAD = (
    (dt(pdu(JOB, 1, b"\x04\x05")), "s7.malformed"),  # five items announced, none there
    (dt(pdu(JOB, 2, b"\xf0\x00")[:10] + b"\xf0"), "s7.malformed"),  # lengths that lie
    (dt(b"\x32\x03\x00\x00"), "s7.malformed"),  # no header
    (dt(pdu(4, 3, b"\x04")), "s7.unknown_rosctr"),
    (tpkt(b"\x20\xf0\x80"), "cotp.malformed"),
    (b"\x03\x00\x00\x05\x00", "tpkt.bad_length"),
)
CONNECTIONS = 20
#: Bad PDUs of each kind before the next kind comes: every second one is of the first connection.
TURN = 2 * CONNECTIONS


def flood(count: int) -> Iterator[bytes]:
    """Give the packets of ``count`` bad PDUs."""
    talks = []
    for number in range(CONNECTIONS):
        talk = Talk(Flow(f"10.0.2.{number}")).handshake()
        talk.send(0, connect(0xE0)).send(1, connect(0xD0))
        talk.send(0, dt(setup(JOB, 0))).send(1, dt(setup(ACK_DATA, 0)))
        yield from [segment.frame() for segment in talk.segments]
        talk.segments.clear()
        talks.append(talk)
    # The octets of each packet but its sequence number are the same each time.
    packets = {
        (number, kind): Segment(talk.flow, 0, 0, talk.next[1], 0x18, octets).frame()
        for number, talk in enumerate(talks)
        for kind, (octets, _) in enumerate(BAD)
    }
    for at in range(count):
        number = at // 2 % CONNECTIONS if at % 2 else 0
        kind = at // TURN % len(BAD)
        frame = packets[number, kind]
        yield frame[:38] + (talks[number].next[0] & 0xFFFFFFFF).to_bytes(4, "big") + frame[42:]
        talks[number].next[0] += len(BAD[kind][0])


def run(count: int) -> tuple[Pipeline, Record]:
    """Return the pipeline and the record of a flood."""
    frames = list(flood(count))
    record = Record()
    pipeline = Pipeline(record, Options(strict=True))
    for at, frame in enumerate(frames):
        pipeline.frame(EPOCH_NS + at * MS, frame, 0, len(frame), len(frame), 1)
    pipeline.finish()
    return pipeline, record


def test_a_flood_takes_linear_work() -> None:
    assert_growth(lambda: run(480), lambda: run(1_920), 5)  # 4 when linear, 16 when quadratic


def test_a_flood_is_counted_exactly_and_detailed_within_bounds() -> None:
    count = 100_800
    assert count % (TURN * len(BAD)) == 0
    pipeline, record = run(count)
    check_books(pipeline, record)
    counts = pipeline.finding_counts
    each = count // len(BAD)
    for slug in {slug for _, slug in BAD}:
        assert counts[slug] == each * [slug for _, slug in BAD].count(slug), slug
    detailed: dict[tuple[str, int], int] = {}
    for finding in record.findings:
        key = (finding.slug, int(finding.connection))
        detailed[key] = detailed.get(key, 0) + (not finding.because)
    assert max(detailed.values()) == MAX_DETAILED
    for slug in counts:
        in_all = sum([found for (name, _), found in detailed.items() if name == slug])
        most = min(counts[slug], MAX_DETAILED_ALL, CONNECTIONS * MAX_DETAILED)
        # Requests without an answer wait for what may explain them, and are detailed by connection as these end.
        assert in_all == most or (slug == "transaction.unanswered" and MAX_DETAILED <= in_all <= most), slug
    assert sum([len(finding.detail) for finding in record.findings]) < 10 * 1024 * 1024
