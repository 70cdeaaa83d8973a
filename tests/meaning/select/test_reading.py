"""Selections of a run: what is read, what is let through, which packets are cut."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dissect
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.select import SelectError, Where
from dissect.meaning.select.packets import KINDS, PacketSelection
from dissect.meaning.select.sieve import Numbers, Sieve
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from tests.meaning.report.schemas import validator
from tests.meaning.select.support import CAPTURES, ERRORS

MANY: Final = str(CAPTURES / "crafted" / "link-types.pcapng")
REUSE: Final = str(CAPTURES / "crafted" / "reuse.pcapng")


def run(path: str, observer: Observer, where: Where | None = None) -> Run:
    options = Options()
    if where is not None and where.narrows:
        options.only = where.may_hold
    made = Run([path], observer, options)
    while made.step():
        pass
    return made


# ---- what is not read -----------------------------------------------------------------------------------------------


def test_connections_that_are_ruled_out_are_not_read() -> None:
    """Work is counted, not timed: transactions made, packets looked into, connections told of."""
    whole, every = Analysis(), run(MANY, Analysis())
    run(MANY, whole)
    connections = {int(one.number): one for one in whole.connections}
    assert len(connections) > 3
    number, wanted = next(iter(sorted(connections.items(), key=lambda entry: -entry[1].pdus)))
    for expression in (
        f"connection == {number}",
        f"client == {wanted.client}",
        f"port == {wanted.client.port} and failed",
    ):
        where = Where(expression)
        part = Analysis()
        made = run(MANY, Sieve(part, where), where)
        assert made.pipeline.connections.left_out == len(connections) - 1
        assert made.pipeline.connections.count == every.pipeline.connections.count
        read = int(made.pipeline.exchange.dialogue.count)
        assert read == wanted.answered + wanted.unanswered + wanted.orphans + wanted.unsolicited
        assert read < every.pipeline.exchange.dialogue.count / 2
        counts = made.pipeline.counters.packet_counts()
        assert counts["left_out"] > counts["payload"]
        assert sum(counts.values()) == made.pipeline.frames == every.pipeline.frames
        assert made.pipeline.counters.octets.failed == 0
        assert [int(one.number) for one in part.connections] in ([number], [])


def told(path: str, only: int = 0) -> dict[int, tuple[object, ...]]:
    """Give what is known of each connection of a capture, by number; with ``only``, of that one where no other is read."""
    seen = Analysis()
    made = Run([path], seen, Options(only=(lambda one: int(one.number) == only) if only else None))
    while made.step():
        pass
    return {
        int(one.number): (
            str(one.client),
            int(one.tcp.first_frame),
            int(one.tcp.last_frame),
            int(one.pdus),
            one.tcp.ended,
        )
        for one in seen.connections
        if not only or int(one.number) == only
    }


def test_connections_keep_their_numbers_whatever_is_read() -> None:
    """Also where one begins on the addresses of another without a SYN between them, or a damaged request begins none."""
    compared = 0
    for path in sorted(CAPTURES.rglob("*.pcap*")):
        every = told(str(path))
        for number in sorted(every)[:12]:
            assert told(str(path), number) == {number: every[number]}, path.name
            compared += 1
    assert compared > 150


NARROWING: Final = (
    "port == 102",
    "connection in {1, 3, 4}",
    "not connection == 2",
    "connection == 5 or failed",
    "server == 127.0.0.1:102 and not failed",
    "not (host == 127.0.0.1)",
    "client == 10.0.0.1",
)


def test_what_is_not_read_would_not_have_been_selected() -> None:
    """The same transactions come, whether the rest was read or not; packets tell which they are."""
    for path in (ERRORS, MANY, REUSE, str(CAPTURES / "crafted" / "reuse-without-syn.pcapng")):
        for expression in NARROWING:
            where = Where(expression)
            seen: list[list[tuple[int, int, int]]] = []
            for narrowed in (None, where):
                told = _Frames()
                run(path, Sieve(told, where), narrowed)
                seen.append(sorted(told.frames))
            assert seen[0] == seen[1], (path, expression)


class _Frames(Observer):
    def __init__(self) -> None:
        super().__init__()
        self.frames: list[tuple[int, int, int]] = []

    def transaction(self, transaction: Any) -> None:
        self.frames.append(
            (int(transaction.connection.number), int(transaction.request_frame), int(transaction.response_frame))
        )


@pytest.mark.parametrize(
    ("expression", "narrows"),
    [("failed", False), ("failed and host == 10.0.0.1", True), ("latency > 1ms or asked_by == 10.0.0.1", True)],
)
def test_only_what_a_connection_decides_narrows(expression: str, narrows: bool) -> None:
    assert Where(expression).narrows is narrows


# ---- analyses and events --------------------------------------------------------------------------------------------


def test_an_analysis_adds_up_the_selection_and_says_what_it_left_out() -> None:
    whole = dissect.analyze(ERRORS)
    part = dissect.analyze(ERRORS, where="error == 0x0a and function == read")
    rest = dissect.analyze(ERRORS, where="not (error == 0x0a and function == read)")
    assert (whole.total, part.total, rest.total) == (8, 2, 6)
    assert part.with_errors == 2
    assert part.part is not None
    assert (part.part.transactions, part.part.connections) == (6, 0)
    assert sum(part.finding_counts.values()) == 4  # one of packet 11, three of packet 17
    assert {finding.frames[-1] for finding in part.findings} == {11, 17}
    assert sum(part.finding_counts.values()) + sum(rest.finding_counts.values()) == sum(whole.finding_counts.values())
    told = part.as_dict()
    assert list(validator("analysis", exact=True).iter_errors(told)) == []
    assert told["selection"]["findings_left_out"] == 11  # type: ignore[index]
    assert whole.as_dict()["selection"] is None
    none = dissect.analyze(ERRORS, where="host == 10.1.1.1")
    assert none.total == 0
    assert none.connections == []
    assert none.as_dict()["selection"]["connections_not_read"] == 1  # type: ignore[index]


def test_findings_alone_can_be_asked_for() -> None:
    part = dissect.analyze(ERRORS, where="severity >= warning and frame == 11")
    assert sum(part.finding_counts.values()) == 1
    assert part.total == 0


def test_events_are_selected() -> None:
    events = list(dissect.open(ERRORS, where="function == write"))
    assert [one.number for one in events if isinstance(one, dissect.Transaction)] == [6, 7, 8]
    assert {type(one) for one in events} == {dissect.Transaction, dissect.Finding, dissect.Connection, dissect.Pdu}
    assert len([one for one in events if isinstance(one, dissect.Pdu)]) == 6
    assert {type(one) for one in dissect.open(ERRORS, where="latency > 79us")} == {
        dissect.Transaction, dissect.Finding, dissect.Connection,
    }  # fmt: skip
    with pytest.raises(SelectError, match="no field 'hots'"):
        list(dissect.open(ERRORS, where="hots == 1"))


def test_numbers_are_remembered_in_little_memory() -> None:
    numbers = Numbers()
    for number in (0, 1, 32_767, 32_768, 5_000_000):
        numbers.add(number)
    assert [number for number in (0, 1, 2, 32_767, 32_768, 32_769, 5_000_000) if number in numbers] == [
        0, 1, 32_767, 32_768, 5_000_000,
    ]  # fmt: skip
    for page in range(600):
        numbers.add(page * 32_768 + 7)
    assert 7 not in numbers
    assert 599 * 32_768 + 7 in numbers


# ---- packets --------------------------------------------------------------------------------------------------------


class _Choosing(PacketSink):
    def __init__(self, takes: Any) -> None:
        self.frames = 0
        self.taken: set[int] = set()
        self._takes = takes

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.frames += 1
        if self._takes(self.frames, int(time_ns), buf, int(start), int(end), int(link_type)):
            self.taken.add(self.frames)


def packets(path: str | Path, expression: str) -> tuple[set[int], int]:
    """Return the packets that an expression selects, and how many there are."""
    where = Where(expression, kinds=KINDS)
    selection = PacketSelection(where)
    made = Run([path], selection)
    where.context.start = lambda: int(made.pipeline.first_ns)
    while made.step():
        pass
    choosing = _Choosing(selection.test())
    reader = open_capture(str(path))
    while reader.step(choosing):
        pass
    reader.close()
    return choosing.taken, choosing.frames


PACKET_CONDITIONS: Final = (
    "frame in {3..17}", "time > 5ms", "host == 127.0.0.1", "src == 127.0.0.1:102", "connection in {1, 2}", "port == 102",
    "slot == 2", "failed", "latency > 55us", "function == write", "error == 0x0a", "outcome == answered", "db == 99",
    "severity >= warning", "slug == transaction.item_error", "address overlaps DB2.DBD16", "value > 3",
)  # fmt: skip
PACKETS: Final = st.recursive(
    st.sampled_from(PACKET_CONDITIONS),
    lambda inner: st.one_of(
        st.builds("not ({})".format, inner),
        st.builds("({}) and ({})".format, inner, inner),
        st.builds("({}) or ({})".format, inner, inner),
    ),
    max_leaves=4,
)


@settings(max_examples=40, deadline=None)
@given(PACKETS, st.sampled_from(("item-errors", "answer-lost", "transfer", "slivers", "refused-port")))
def test_packets_that_are_selected_and_those_that_are_not_are_all(expression: str, name: str) -> None:
    path = CAPTURES / f"{name}.pcapng"
    those, count = packets(path, expression)
    others, _ = packets(path, f"not ({expression})")
    assert those | others == set(range(1, count + 1))


def test_packets_of_selected_transactions() -> None:
    assert packets(ERRORS, "number == 3")[0] == {12, 13}
    assert packets(ERRORS, "latency > 79us")[0] == {10, 11}
    assert packets(ERRORS, "not failed")[0] >= {8, 9}
    assert not packets(ERRORS, "not failed")[0] & set(range(10, 24))
    assert packets(ERRORS, "frame < 5 and src == 127.0.0.1:102")[0] == {2}
    assert packets(ERRORS, "frame == 11 and severity >= warning")[0] == {10, 11}
