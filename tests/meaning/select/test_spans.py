"""Where the octets of a PDU are: over several segments, fragments and packets, against what was put into the stream."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.engine.transactions.side import Side
from dissect.meaning.select import spans
from dissect.meaning.select.spans import Span, SpanBook, SpanIndex, TimedSpan
from tests.meaning.report.support import WORD, begun, observed
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Talk
from tests.protocols.s7plus.pdus import asked, framed

MASK = 0xFFFFFFFF


class Watching(Observer):
    """Asks for the range of each PDU as soon as it is told."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = self.wants_pdus = True
        self.book = SpanBook()
        self.found: list[tuple[int, bytes, Span | None]] = []

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        self.book.tpkt(side, octets)

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        self.book.pdu(side, int(frame), len(octets))
        span = self.book.pop(int(side.connection.number), int(side.index), int(frame), len(octets))
        self.found.append((int(side.index), octets, span))


def put_and_found(talk: Talk, cuts: list[int], stream: bytes) -> list[tuple[int, bytes, Span | None]]:
    """Send ``stream`` from side 0 in segments that end at ``cuts``; return the PDUs of it that were found."""
    watching = Watching()
    at = 0
    for cut in [*sorted(cuts), len(stream)]:
        if cut > at:
            talk.send(0, stream[at:cut])
            at = cut
    observed(watching, talk.packets())
    return [one for one in watching.found[2:] if one[0] == 0]


@given(st.integers(0, 2**32), st.lists(st.integers(1, 900), max_size=8), st.sampled_from([1000, MASK - 500]))
def test_the_range_is_where_the_pdu_was_put(seed: int, cuts: list[int], isn: int) -> None:
    rng = Random(seed)
    talk = Talk(isns=(isn, 7)).handshake()
    talk.send(0, messages.connect(0xE0)).send(1, messages.connect(0xD0))
    talk.send(0, dt(messages.setup(messages.JOB, 0))).send(1, dt(messages.setup(messages.ACK_DATA, 0)))
    start = talk.next[0]
    stream = b""
    expected = []
    for ref in range(1, 8):
        pdu = messages.read_job(ref, [WORD] * rng.randrange(1, 4))
        framed = dt(pdu) if rng.random() < 0.6 else messages.fragments(pdu, sorted(rng.sample(range(1, len(pdu)), 2)))
        expected.append((pdu, (start + len(stream)) & MASK, len(framed)))
        stream += framed
    found = put_and_found(talk, cuts, stream)
    assert [octets for _, octets, _ in found] == [pdu for pdu, _, _ in expected]
    for (_, _, span), (_, seq, size) in zip(found, expected, strict=True):
        assert span is not None
        assert (span.seq, span.size) == (seq, size)


def test_beside_octets_of_no_tpkt_the_range_is_too_long_rather_than_too_short() -> None:
    talk = begun()
    start = talk.next[0]
    first, second = dt(messages.read_job(1, [WORD])), dt(messages.read_job(2, [WORD]))
    stream = first + b"garbage!" + second
    (_, _, one), (_, _, other) = put_and_found(talk, [10, len(first) + 12], stream)
    assert one is not None
    assert other is not None
    assert one.seq == start
    assert len(first) <= one.size <= len(first) + len("garbage!")
    end = start + len(stream)
    assert other.seq <= end - len(second)
    assert other.seq + other.size >= end


@pytest.mark.parametrize("count", [2, 3])
def test_pdus_of_one_size_that_one_packet_completes_share_a_range(count: int) -> None:
    """Which of them a transaction means is not known: each has the range of all, and none is without one."""

    class Later(Watching):
        """Asks only when all have come, as transactions do."""

        def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
            self.book.pdu(side, int(frame), len(octets))
            self.found.append((int(side.index), octets, None))

    talk = begun()
    start = talk.next[0]
    framed_ = [dt(messages.read_job(ref, [WORD])) for ref in range(1, count + 1)]
    stream = b"".join(framed_)
    before = len(talk.packets())
    talk.send(0, stream[:9]).send(0, stream[9:])
    watching = Later()
    observed(watching, talk.packets())
    size = len(messages.read_job(1, [WORD]))
    found = [watching.book.pop(1, 0, before + 2, size) for _ in range(count + 1)]
    assert [(span.seq, span.size) for span in found if span is not None] == [(start, len(stream))] * count
    assert found[count] is None


def test_a_range_overlaps_what_shares_an_octet_with_it() -> None:
    span = Span(b"", MASK - 1, 5)  # ..., MASK-1, MASK, 0, 1, 2
    carried = [
        (seq, size)
        for seq in (MASK - 4, MASK - 2, MASK, 1, 2, 3, 9)
        for size in (0, 1, 2, 20)
        if span.overlaps(seq, size)
    ]
    assert carried == [
        (MASK - 4, 20),
        (MASK - 2, 2),
        (MASK - 2, 20),
        *((seq, size) for seq in (MASK, 1, 2) for size in (1, 2, 20)),
    ]
    assert not Span(b"", 5, 0).overlaps(0, 100)


def test_what_is_remembered_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spans, "MAX_SPANS", 5)
    monkeypatch.setattr(spans, "MAX_DIRECTIONS", 1)

    class Hoarding(Watching):
        def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
            self.book.pdu(side, int(frame), len(octets))

    hoarding = Hoarding()
    talk = begun()
    for ref in range(1, 21):
        talk.send(0, dt(messages.read_job(ref, [WORD])))
        talk.send(1, dt(messages.read_answer(ref, [WORD], [b"ab"])))
    observed(hoarding, talk.packets())
    assert hoarding.book.forgotten == 42 - 5


def test_nothing_is_known_of_a_pdu_without_tpkt() -> None:
    book = SpanBook()
    assert book.pop(1, 0, 5, 20) is None


class WatchingPlus(Watching):
    """The same for S7comm-plus."""

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        self.pdu(frame, time_ns, side, octets, cut)


@given(st.lists(st.integers(1, 4), min_size=1, max_size=6), st.lists(st.integers(1, 400), max_size=6), st.booleans())
def test_the_range_of_a_pdu_in_several_frames_begins_with_the_first(
    sizes: list[int], cuts: list[int], between: bool
) -> None:
    """A system event between two frames is a PDU of its own."""
    watching = WatchingPlus()
    talk = Talk().handshake()
    talk.send(0, messages.connect(0xE0)).send(1, messages.connect(0xD0))
    start = talk.next[0]
    stream = b""
    expected = []
    alert = dt(b"\x72\xfe\0\x10" + bytes(16))
    for number, frames in enumerate(sizes, 1):
        data = asked(number, 0x04CA, body=bytes(30))
        begin = len(stream)
        for at in range(frames):
            stream += dt(framed(data if at == 0 else b"piece", 2, trailer=at == frames - 1))
            if between and at < frames - 1:
                expected.append((len(stream), len(alert)))
                stream += alert
        expected.append((begin, len(stream) - begin))
    at = 0
    for cut in [*sorted(cuts), len(stream)]:
        if cut > at:
            talk.send(0, stream[at:cut])
            at = cut
    observed(watching, talk.packets())
    found = [span for _, _, span in watching.found]
    assert [(span.seq - start, span.size) for span in found if span is not None] == expected


@given(
    st.lists(st.tuples(st.integers(-3000, 9000), st.integers(0, 5000), st.integers(0, 9), st.integers(0, 9))),
    st.lists(st.tuples(st.integers(-3000, 9000), st.integers(0, 3000), st.integers(0, 9))),
)
def test_an_index_finds_what_a_search_through_all_spans_finds(
    spans: list[tuple[int, int, int, int]], segments: list[tuple[int, int, int]]
) -> None:
    """Sequence numbers are those around the end of their range."""
    index = SpanIndex()
    known = [TimedSpan(Span(b"", seq & MASK, size), begin, end) for seq, size, begin, end in spans]
    for timed in known:
        index.add(timed)
    for seq, size, time_ns in segments:
        expected = any(one.from_ns <= time_ns <= one.to_ns and one.span.overlaps(seq & MASK, size) for one in known)
        assert index.carries(time_ns, seq & MASK, size) == expected


def test_a_search_looks_at_few_of_many_spans() -> None:
    class Counted(Span):
        looked = 0

        def overlaps(self, seq: int, size: int) -> bool:
            Counted.looked += 1
            return super().overlaps(seq, size)

    index = SpanIndex()
    for number in range(20_000):
        index.add(TimedSpan(Counted(b"", number * 300, 300), 0, 1))
    assert index.carries(0, 3_000_000, 300)
    assert not index.carries(0, 7_000_000, 300)
    assert Counted.looked < 20


def test_a_span_over_a_huge_gap_takes_no_more_room_than_another(monkeypatch: pytest.MonkeyPatch) -> None:
    touched: list[int] = []
    found = spans._touched

    def counted(seq: int, size: int, bits: int) -> list[int]:
        blocks = found(seq, size, bits)
        touched.append(len(blocks))
        return blocks

    monkeypatch.setattr(spans, "_touched", counted)
    index = SpanIndex()
    for size in (1, 1500, 1 << 20, (1 << 31) + 5, MASK):
        for seq in (0, 77, MASK - 3):
            index.add(TimedSpan(Span(b"", seq, size), 0, 1))
    assert max(touched) <= 2
    assert index.carries(0, 1 << 30, 1)
