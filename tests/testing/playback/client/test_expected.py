"""What was to come, made of the recording: what a replay leaves out or cannot know is not held against a server."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.engine.transactions.transaction import CAPTURE_ENDED
from dissect.testing.golden import DiffOptions
from dissect.testing.playback.client import Permissions, Settings, load_recorded
from dissect.testing.playback.server.service import Server
from tests.testing.playback.client.support import CAPTURES, mixed, play, texts


def test_numbers_are_those_of_the_recording_and_what_was_withheld_is_missing(tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(path) as server:
        outcome = play(path, server)
    assert [each.number for each in outcome.expected.transactions] == [1, 2, 5]
    assert [each.number for each in outcome.came.transactions] == [1, 2, 3]


def test_an_end_that_was_not_recorded_is_ours() -> None:
    path = CAPTURES / "read-areas.pcapng"
    recorded = load_recorded(path)
    recorded.links[0].ended = recorded.links[0].ended_by = ""
    with Server(path) as server:
        outcome = play(recorded, server)
    assert texts(outcome) == []
    assert [(link.ended, link.ended_by) for link in outcome.expected.links] == [("fin", "client")]


def test_another_end_is_a_difference() -> None:
    path = CAPTURES / "read-areas.pcapng"
    recorded = load_recorded(path)
    recorded.links[0].ended_by = "server"
    with Server(path) as server:
        outcome = play(recorded, server, settings=Settings(timeout_s=0.05))
    assert texts(outcome) == ["connection 1, end: was fin by the server, is fin by the client"]


def test_an_answer_that_came_where_the_recording_ends_is_none_that_changed() -> None:
    path = CAPTURES / "read-areas.pcapng"
    recorded = load_recorded(path)
    last = recorded.links[0].transactions[-1]
    last.outcome, last.reason = "unanswered", CAPTURE_ENDED
    with Server(path) as server:
        outcome = play(recorded, server)
    assert texts(outcome) == []
    assert outcome.expected.transactions[-1].outcome == "answered"


@pytest.mark.parametrize("name", ["mid-stream", "bsend"])
def test_what_has_nothing_recorded_to_stand_beside_is_left_out(name: str) -> None:
    path = CAPTURES / f"{name}.pcapng"
    with Server(path) as server:
        outcome = play(path, server, Permissions(control=True))
    assert list(outcome.differences(DiffOptions())) == []
    assert len(outcome.expected.transactions) == len(outcome.came.transactions)


def test_equal_connections_are_compared_each_with_its_own() -> None:
    path = CAPTURES / "crafted" / "reuse.pcapng"
    with Server(path) as server:
        outcome = play(path, server)
    assert len({link.who for link in outcome.expected.links}) < len(outcome.expected.links)
    assert texts(outcome) == []


def test_a_golden_keeps_its_order_and_a_capture_that_of_its_beginnings() -> None:
    recorded = load_recorded(CAPTURES / "two-clients.pcapng")
    assert sorted(link.number for link in recorded.links) == [1, 2]
    assert sorted([link.span for link in recorded.links if link.span]) == [link.span for link in recorded.as_begun]
    for link in recorded.links:
        link.span = None
    assert recorded.as_begun == recorded.links
