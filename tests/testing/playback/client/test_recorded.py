"""What is read of a recording: its connections in the order in which they began, and where each of them stood."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.packets.source.packet import CaptureError
from dissect.testing.golden import golden_text, read_session
from dissect.testing.golden.model import Session, Span
from dissect.testing.playback.client import ReplayError, load_recorded
from tests.meaning.report.support import begun, read, saved
from tests.properties import messages
from tests.properties.packets import Flow, captured
from tests.testing.playback.client.support import CAPTURES, mixed

EPOCH = 1_700_000_000_000_000_000
MS = 1_000_000


def flow(port: int) -> Flow:
    return Flow(ports=(port, 102))


def two(path: Path, close: bool = True) -> Path:
    """Write two connections, the second inside the first: packets 1 to 9, 10 to 18, 19 to 21."""
    outer, inner = begun(flow(40_002)), begun(flow(40_001))
    read(outer, 1)
    read(inner, 1)
    inner_segments = list(inner.segments)
    outer_segments = list(outer.segments)
    if close:
        outer.close(1)
    return saved(path, captured(outer_segments + inner_segments + outer.segments[len(outer_segments) :], EPOCH, MS))


def spans_of(session: Session) -> list[Span]:
    return [link.span for link in session.as_begun if link.span is not None]


def test_connections_stand_in_the_order_in_which_they_began_and_with_their_ends(tmp_path: Path) -> None:
    recorded = load_recorded(two(tmp_path / "a.pcapng"))
    assert [link.addresses[0] for link in recorded.as_begun] == ["10.0.0.1:40002", "10.0.0.1:40001"]
    spans = spans_of(recorded)
    first = spans[0].first_ns
    assert spans == [Span(1, 1, first, 19, first + 18 * MS), Span(2, 10, first + 9 * MS, 18, first + 17 * MS)]


def test_where_no_end_was_captured_it_is_the_last_packet(tmp_path: Path) -> None:
    recorded = load_recorded(two(tmp_path / "a.pcapng", close=False))
    assert [span.last_frame for span in spans_of(recorded)] == [9, 18]


def test_a_reset_and_a_disconnect_are_ends(tmp_path: Path) -> None:
    reset = read(begun(), 1).reset(1)
    told = read(begun(), 1).send(0, messages.disconnect(1)).ack(1).close(1)
    for talk in (reset, told):
        recorded = load_recorded(saved(tmp_path / "a.pcapng", talk.packets()))
        assert [span.last_frame for span in spans_of(recorded)] == [10]


def test_transactions_know_the_packet_they_began_with(tmp_path: Path) -> None:
    recorded = load_recorded(two(tmp_path / "a.pcapng"))
    assert [each.frame for link in recorded.as_begun for each in link.transactions] == [6, 8, 15, 17]


def test_a_golden_knows_no_times(tmp_path: Path) -> None:
    golden = tmp_path / "a.s7.txt"
    golden.write_text(golden_text(read_session(two(tmp_path / "a.pcapng"))), "utf-8")
    recorded = load_recorded(golden)
    assert spans_of(recorded) == []
    assert recorded.as_begun == recorded.links
    assert {each.frame for each in recorded.transactions} == {0}


def test_damage_is_told_and_what_is_whole_is_played() -> None:
    recorded = load_recorded(CAPTURES / "crafted" / "cut-pcap.pcap")
    assert recorded.damage != []
    assert recorded.transactions != []


def test_what_cannot_be_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="no such file"):
        load_recorded(tmp_path / "none.pcapng")
    nonsense = tmp_path / "a.pcapng"
    nonsense.write_bytes(b"nonsense" * 9)
    with pytest.raises(CaptureError):
        load_recorded(nonsense)
    golden = tmp_path / "a.s7.txt"
    text = golden_text(read_session(mixed(tmp_path / "b.pcapng")))
    golden.write_text(text.replace("READ", "REED", 1), "utf-8")
    with pytest.raises(ReplayError, match=r"a\.s7\.txt"):
        load_recorded(golden)
