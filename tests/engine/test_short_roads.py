"""The short roads of the engine, packet by packet: how often each function is called is counted on paper.

A short cut whose condition no longer holds gives right results slowly; nothing else would show it. `test_fast_roads` has the
shares of whole captures.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

import pytest

from dissect.wire.build import COMPILED
from tests import build
from tests.engine.test_iso_edges import EMPTY, Looking, opened
from tests.engine.test_pipeline import poll, ready
from tests.engine.transactions.talk import CLIENT, SERVER, Talk, dbw, dt, read, words
from tests.growth import UNCOUNTED
from tests.properties.books import Result
from tests.properties.packets import LINUX_SLL, LINUX_SLL2, NULL, RAW, Flow, captured
from tests.protocols.s7plus.pdus import asked, framed, told

pytestmark = pytest.mark.skipif(COMPILED, reason=UNCOUNTED)

FOUR: Final = ("10.0.0.1", "10.0.0.2")
SIX: Final = ("2001:db8::1", "2001:db8::2")


class Calls:
    """How often each function is called by some work."""

    def __init__(self, work: Callable[[], object]) -> None:
        self.calls: Counter[str] = Counter()
        sys.setprofile(self._count)
        try:
            work()
        finally:
            sys.setprofile(None)

    def _count(self, frame: FrameType, event: str, argument: Any) -> None:
        if event == "call":
            self.calls[frame.f_code.co_qualname] += 1

    def of(self, *names: str) -> list[int]:
        return [self.calls[name] for name in names]


def polls(talk: Talk, count: int = 10, per_segment: int = 1) -> None:
    for number in range(count):
        refs = range(number * per_segment, (number + 1) * per_segment)
        talk.ask(*[read(ref, dbw(1, 0)) for ref in refs])
        talk.tell(*[words(ref, 1) for ref in refs])


def settled(kind: type[Talk] = Talk) -> Talk:
    """A connection that has polled once, so that everything is known."""
    talk = opened(kind)
    polls(talk, 2)
    return talk


@pytest.mark.parametrize("per_segment", [1, 3])
def test_a_poll_takes_the_shortest_road(per_segment: int) -> None:
    talk = settled()
    calls = Calls(lambda: polls(talk, 10, per_segment))
    pdus = 20 * per_segment
    assert calls.of("Pipeline._packet", "Pipeline._known", "IsoOnTcp.usual", "S7.take") == [20, 20, pdus, pdus]
    assert calls.of("Dialogue.ask", "Dialogue.answer", "Exchange.completed") == [pdus // 2] * 3
    for name in (
        "Pipeline._segment", "Pipeline._slow_frame", "Pipeline._at_ends", "Pipeline._irregular", "Pipeline._turn", "usual_ip",
        "IsoOnTcp._take", "IsoOnTcp._tpkt", "IsoOnTcp.longest", "Framer.push", "Exchange._complete", "Side.note_ack",
        "HalfStream.accept", "Timers.passing", "Reporter.wants",
    ):  # fmt: skip
        assert calls.of(name) == [0], name
    assert calls.of("S7._judge") == [10 * (per_segment - 1)]  # those beside an open one


def test_an_acknowledgement_is_only_noted() -> None:
    talk = settled()

    def acknowledge() -> None:
        for number in range(20):
            talk.packet(number & 1)

    calls = Calls(acknowledge)
    assert calls.of("Pipeline._known") == [20]
    for name in ("Pipeline._segment", "Pipeline._at_ends", "Side.note_end", "IsoOnTcp.usual", "Side.note_ack"):
        assert calls.of(name) == [0], name


@pytest.mark.parametrize(
    ("flow", "usual", "six"),
    [
        (Flow(*FOUR), 0, 0),
        (Flow(*FOUR, vlans=(5,)), 1, 0),
        (Flow(*FOUR, link=LINUX_SLL), 1, 0),
        (Flow(*FOUR, link=LINUX_SLL2), 1, 0),
        (Flow(*FOUR, link=RAW), 1, 0),
        (Flow(*FOUR, link=NULL), 1, 0),
        (Flow(*SIX), 1, 1),
        (Flow(*SIX, vlans=(5,)), 1, 1),
        (Flow(*SIX, link=LINUX_SLL), 1, 1),
        (Flow(*SIX, link=RAW), 1, 1),
    ],
)
def test_over_every_everyday_link_packets_of_a_connection_are_known_at_once(flow: Flow, usual: int, six: int) -> None:
    sent = poll(ready(flow), *range(1, 12))
    packets = captured(sent.segments)
    result = Result(packets[:9], finish=False)

    def rest() -> None:
        for packet in packets[9:]:
            result.feed(packet)

    calls = Calls(rest)
    count = len(packets) - 9
    assert count == 20
    assert calls.of("usual_ip", "Pipeline._packet6", "Pipeline._known") == [usual * count, six * count, count]
    assert calls.of("Pipeline._slow_frame", "Pipeline._at_ends", "Pipeline._segment") == [0, 0, 0]


def test_those_who_look_at_tpdus_need_no_framer_where_segments_hold_whole_ones() -> None:
    talk = settled(Looking)
    calls = Calls(lambda: polls(talk, 10, 3))
    assert calls.of("IsoOnTcp._take", "IsoOnTcp._tpkt", "S7.take") == [20, 60, 60]
    assert calls.of("Framer.push", "IsoOnTcp.usual") == [0, 0]


def test_whole_tpkts_of_s7comm_plus_and_connects_need_no_framer() -> None:
    talk = Talk()
    talk.hello()

    def speak() -> None:
        talk.connect()
        for number in range(1, 11):
            talk.ask(framed(asked(number)))
            talk.tell(framed(told(number)))

    calls = Calls(speak)
    assert calls.of("IsoOnTcp._tpkt", "S7Plus.feed", "Framer.push") == [22, 20, 0]


@pytest.mark.parametrize("kind", [Talk, Looking])
def test_empty_dts_need_no_framer(kind: type[Talk]) -> None:
    talk = settled(kind)

    def speak() -> None:
        for number in range(10):
            talk.packet(CLIENT, EMPTY + dt(read(number, dbw(1, 0))))
            talk.packet(SERVER, EMPTY)
            talk.packet(SERVER, dt(words(number, 1)) + EMPTY)

    calls = Calls(speak)
    assert calls.of("Framer.push", "Assembler.push") == ([0, 0] if kind is Talk else [0, 30])
    assert calls.of("IsoOnTcp._tpkt", "IsoOnTcp._take") == ([0, 0] if kind is Talk else [50, 30])


def test_a_tpkt_in_two_segments_takes_the_framer_for_its_beginning_only() -> None:
    talk = settled()

    def speak() -> None:
        for number in range(10):
            octets = dt(read(number, dbw(1, 0)))
            talk.packet(CLIENT, octets[:20])
            talk.packet(CLIENT, octets[20:])
            talk.tell(words(number, 1))

    calls = Calls(speak)
    assert calls.of("Framer.push", "IsoOnTcp._completed", "IsoOnTcp._tpkt") == [10, 10, 0]


def test_a_numbered_dt_is_as_short_a_road_once_its_numbers_are_known_to_be_fine() -> None:
    talk = settled()

    def speak() -> None:
        for number in range(1, 11):
            talk.packet(CLIENT, build.dt(read(number, dbw(1, 0)), number=number))
            talk.tell(words(number, 1))

    calls = Calls(speak)
    # The second one finds the first one answered.
    assert calls.of("IsoOnTcp.usual", "IsoOnTcp._numbered", "IsoOnTcp._tpkt") == [20, 2, 0]


def test_segments_in_order_of_other_protocols_need_no_chunk() -> None:
    from tests.engine.test_ibh import Link
    from tests.protocols.ibh.packets import ASK, TELL

    link = Link()
    link.begin()

    def speak() -> None:
        for _ in range(10):
            link.packet(CLIENT, ASK)
            link.packet(SERVER, TELL)

    calls = Calls(speak)
    assert calls.of("IbhNetLink.feed", "HalfStream.passed", "HalfStream.accept", "Timers.chunks") == [20, 20, 0, 0]


def test_what_is_said_of_another_protocol_is_looked_at_once() -> None:
    talk = opened()
    talk.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))

    def speak() -> None:
        for _ in range(10):
            talk.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))

    calls = Calls(speak)
    assert calls.of("Foreign.tsdu", "identify", "Reporter.note") == [10, 0, 0]


def test_requests_within_what_was_granted_need_no_judgement() -> None:
    talk = settled()

    def flood() -> None:
        for number in range(8):
            talk.ask(read(number, dbw(1, 0)))

    calls = Calls(flood)
    assert calls.of("S7._judge", "judge_request") == [7, 0]  # the first one is alone
