"""`SpanBook` step by step: which octets a message has, as TPKTs are reported once their octets are accounted for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Final

import pytest

from dissect.meaning.select import spans
from dissect.meaning.select.spans import Span, SpanBook, SpanIndex, TimedSpan
from tests.cases import each

START: Final = 1000
MASK: Final = 0xFFFFFFFF
#: TPKTs of 31 octets: a DT with EOT, one without, another TPDU.
LAST: Final = b"\x03\0\0\x1f\x02\xf0\x80" + bytes(24)
PART: Final = b"\x03\0\0\x1f\x02\xf0\x00" + bytes(24)
OTHER: Final = b"\x03\0\0\x1f\x02\xd0\x80" + bytes(24)


class Way:
    """One direction of a connection, and the book of what it carries."""

    def __init__(self, start: int = START, key: bytes = b"key", number: int = 1, book: SpanBook | None = None) -> None:
        self.book = book if book is not None else SpanBook()
        self.side: Any = SimpleNamespace(
            key=key, index=0, missing=0, ibh=None, plus=None, connection=SimpleNamespace(number=number),
            stream=SimpleNamespace(start_seq=start), framer=SimpleNamespace(framed=0, skipped=0),
        )  # fmt: skip

    def comes(self, *tpkts: bytes, noise: int = 0, missing: int = 0) -> list[tuple[int, int] | None]:
        """These TPKTs come at once, with octets of no TPKT between them, or lost ones; return their ranges."""
        self.side.framer.framed += sum(map(len, tpkts))
        self.side.framer.skipped += noise
        self.side.missing += missing
        return [place(self.book.tpkt(self.side, octets)) for octets in tpkts]

    def pdu(self, size: int = 24, frame: int = 5) -> tuple[int, int] | None:
        """A PDU is complete; return its range."""
        self.book.pdu(self.side, frame, size)
        return place(self.book.pop(int(self.side.connection.number), 0, frame, size))

    def unfinished(self, is_so: bool) -> None:
        """An S7comm-plus PDU waits for its next frame."""
        self.side.plus = SimpleNamespace(parts=[b"x"] if is_so else None)


def place(span: Span | None) -> tuple[int, int] | None:
    return (span.seq, span.size) if span is not None else None


def test_a_message_has_the_octets_of_its_tpkt() -> None:
    way = Way()
    for number in range(3):
        begin = START + 31 * number
        assert way.comes(LAST) == [(begin, 31)]
        assert way.pdu() == (begin, 31)
    assert way.book.pop(1, 0, 5, 24) is None
    assert way.book.forgotten == 0


def test_of_tpkts_that_come_at_once_each_has_its_own_octets() -> None:
    way = Way()
    way.side.framer.framed = 62
    for begin in (START, START + 31):
        assert place(way.book.tpkt(way.side, LAST)) == (begin, 31)
        assert way.pdu() == (begin, 31)
    assert place(way.book.tpkt(way.side, LAST)) is None  # it was not accounted for: nothing is known of it
    assert way.pdu() is None


@each("lost", [False, True])
def test_beside_noise_and_gaps_a_message_has_all_that_came_with_it(lost: bool) -> None:
    way = Way()
    way.comes(LAST)
    noise, missing = (0, 8) if lost else (8, 0)
    assert way.comes(LAST, LAST, noise=noise, missing=missing) == [(START + 31, 70)] * 2
    assert way.pdu() == (START + 31, 70)
    assert way.comes(LAST) == [(START + 101, 31)]
    assert way.pdu() == (START + 101, 31)


def test_octets_of_ibh_netlink_count_as_well() -> None:
    way = Way()
    way.side.ibh = SimpleNamespace(framed=40, skipped=0)
    assert place(way.book.ibh_packet(way.side, bytes(40))) == (START, 40)
    way.side.ibh.framed += 25
    assert place(way.book.ibh_packet(way.side, bytes(25))) == (START + 40, 25)
    assert way.pdu() == (START, 65)  # both may be parts of it
    way.side.ibh.framed += 10
    way.side.ibh.skipped += 7
    assert place(way.book.ibh_packet(way.side, bytes(10))) == (START + 65, 17)
    assert way.pdu() == (START + 65, 17)
    assert way.comes(LAST) == [(START + 82, 31)]


def test_a_message_in_several_dts_begins_with_the_first() -> None:
    way = Way()
    way.comes(LAST)
    way.pdu()
    way.comes(PART)
    way.comes(OTHER)  # which is between them, and carries nothing
    way.comes(PART[:6] + b"\x01" + PART[7:], LAST)  # numbered, as in other classes than 0
    assert way.pdu() == (START + 31, 4 * 31)
    way.comes(PART)
    way.comes(LAST)  # a message that is no PDU
    way.comes(LAST)
    assert way.pdu() == (START + 7 * 31, 31)


def test_the_first_tpdu_of_a_connection_carries_nothing() -> None:
    way = Way()
    way.comes(OTHER)
    way.comes(LAST)
    assert way.pdu() == (START + 31, 31)


def test_a_tpdu_that_carries_nothing_is_no_beginning() -> None:
    way = Way()
    way.comes(LAST)
    way.pdu()
    for octets in (OTHER, b"\3\0\0\4", b"\3\0\0\5\0", b"\3\0\0\6\1\xe0"):
        way.comes(octets)
    at = START + 2 * 31 + 4 + 5 + 6
    way.comes(b"\3\0\0\6\1\xf0")  # a DT without a number: it ends what it carries
    way.comes(LAST)
    assert way.pdu() == (at + 6, 31)
    way.comes(b"\3\0\0\7\2\xf0\0")  # one whose message goes on
    way.comes(LAST)
    assert way.pdu() == (at + 37, 38)
    way.comes(b"\3\0\0\7\2\xf1\x80")  # a DT with a credit is one
    assert way.pdu() == (at + 75, 7)
    way.comes(PART)
    way.comes(b"\3\0\0\6\1\xf0")
    way.comes(LAST)
    assert way.pdu() == (at + 119, 31)


def test_a_pdu_of_s7comm_plus_begins_with_its_first_frame() -> None:
    way = Way()
    way.comes(LAST)
    way.pdu()
    way.comes(LAST)
    way.unfinished(True)
    way.comes(LAST)
    assert way.pdu(16) == (START + 62, 31)  # a system event between the frames
    way.comes(LAST)
    way.unfinished(False)
    assert way.pdu() == (START + 31, 93)
    assert way.pdu(7) == (START + 93, 31)  # another one in the same TPKT
    way.comes(LAST)
    assert way.pdu() == (START + 124, 31)


@each("start", [0, 1, MASK, MASK - 30, MASK - 31, MASK - 61])
def test_the_last_sequence_number_is_followed_by_0(start: int) -> None:
    way = Way(start)
    way.comes(LAST)
    assert way.pdu() == (start, 31)
    assert way.comes(LAST) == [((start + 31) & MASK, 31)]
    assert way.pdu() == ((start + 31) & MASK, 31)


def test_of_a_stream_whose_beginning_is_unknown_nothing_is_known() -> None:
    way = Way(-1)
    assert way.comes(LAST) == [None]
    assert way.pdu() is None
    assert Way().pdu() is None  # nor of a direction without a TPKT


def test_another_connection_on_the_same_ports_begins_anew() -> None:
    way = Way()
    way.comes(LAST, PART)
    way.side.stream = SimpleNamespace(start_seq=7000)
    way.side.framer = SimpleNamespace(framed=0, skipped=0)
    way.side.connection.number = 2
    assert way.comes(LAST) == [(7000, 31)]
    assert way.pdu() == (7000, 31)


def test_pdus_of_one_size_that_complete_in_one_packet_share_their_octets() -> None:
    way = Way(MASK - 40)
    way.side.framer.framed = 93
    for _ in range(3):
        way.book.tpkt(way.side, LAST)
        way.book.pdu(way.side, 5, 24)
    assert [place(way.book.pop(1, 0, 5, 24)) for _ in range(4)] == [(MASK - 40, 93)] * 3 + [None]


def test_the_oldest_pdus_are_forgotten_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spans, "MAX_SPANS", 3)
    way = Way()
    for frame in range(1, 6):
        way.comes(LAST)
        way.book.pdu(way.side, frame, 24)
    assert [frame for frame in range(7) if way.book.pop(1, 0, frame, 24)] == [3, 4, 5]
    assert way.book.forgotten == 2


def test_sixty_five_thousand_pdus_are_remembered() -> None:
    way = Way()
    way.comes(LAST)
    for frame in range(65_536):
        way.book.pdu(way.side, frame, 24)
    assert way.book.forgotten == 0
    way.book.pdu(way.side, 65_536, 24)
    assert way.book.forgotten == 1


def test_the_directions_that_are_known_longest_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spans, "MAX_DIRECTIONS", 3)
    book = SpanBook()
    ways = [Way(key=bytes((number,)), number=number, book=book) for number in range(4)]
    for way in ways:
        way.comes(LAST)
    assert [way.pdu() for way in ways] == [None, *[(START, 31)] * 3]


def test_sixteen_thousand_directions_are_known() -> None:
    way = Way()
    for number in range(16_384):
        way.side.key = number.to_bytes(2, "big")
        way.side.stream = SimpleNamespace(start_seq=START)
        way.comes(LAST)
    way.side.key = b"\0\0"
    assert way.pdu() is not None
    way.side.key = b"another"
    way.comes(LAST)
    assert way.pdu() is not None
    way.side.key = b"\0\0"
    assert way.pdu() is None


# ---- the index ------------------------------------------------------------------------------------------------------


@each("size", [1, 2, 1023, 1024, 1025, 5000, 70_000])
@each("seq", [0, 1, 1023, 1024, 4000, MASK, MASK - 1, MASK - 1023])
def test_the_first_and_the_last_octet_of_a_span_are_found(size: int, seq: int) -> None:
    index = SpanIndex()
    index.add(TimedSpan(Span(b"", seq, size), 10, 20))
    last = (seq + size - 1) & MASK
    for at, found in ((seq, True), (last, True), ((seq - 1) & MASK, False), ((last + 1) & MASK, False)):
        assert index.carries(10, at, 1) is index.carries(20, at, 1) is found
    assert index.carries(15, (seq - 5) & MASK, 6)
    assert not index.carries(15, (seq - 5) & MASK, 5)
    assert index.carries(15, (seq - 1) & MASK, size + 2)
    assert not index.carries(9, seq, 1)
    assert not index.carries(21, seq, 1)
    assert not index.carries(15, seq, 0)
    assert not index.carries(15, seq, -7)


def test_spans_of_all_sizes_are_looked_through() -> None:
    index = SpanIndex()
    for seq, size in ((100, 10), (5000, 3000), (100_000, 50_000), (104, 2)):
        index.add(TimedSpan(Span(b"", seq, size), seq, seq + 1))
    found = [
        (time_ns, at)
        for time_ns in (100, 104, 5000, 100_000)
        for at in (105, 7999, 149_999)
        if index.carries(time_ns, at, 1)
    ]
    assert found == [(100, 105), (104, 105), (5000, 7999), (100_000, 149_999)]
