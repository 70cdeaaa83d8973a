"""golden, serve, replay, diff: of lists of blocks, uploads and downloads nothing is different at the end of the round."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.golden import diff_sessions, golden_text, read_session
from dissect.playback.client import Permissions, load_recorded, make_plan, places_of, read_target, replay
from dissect.playback.server import Server
from dissect.source.pcapng_writer import PcapngWriter

FOLDER = Path(__file__).resolve().parent.parent.parent.parent / "captures"


@pytest.mark.parametrize("name", ["blocks-python", "transfer"])
def test_the_round_of_a_golden_changes_nothing(name: str, tmp_path: Path) -> None:
    golden, again = tmp_path / "x.s7.txt", tmp_path / "again.pcapng"
    golden.write_text(golden_text(read_session(FOLDER / f"{name}.pcapng")), encoding="utf-8")
    with Server(golden, writer=PcapngWriter(str(again))) as server:
        target = read_target(f"127.0.0.1:{server.port}")
        recorded = load_recorded(str(golden))
        places = places_of(target, allow_remote=False)
        outcome = replay(recorded, make_plan(recorded), places, target, Permissions(write=True, control=True))
        assert [difference.text for difference in outcome.differences()] == []
        assert [str(request) for request in server.unmatched] == []
    differences = diff_sessions(read_session(golden), read_session(again))
    assert [difference.text for difference in differences] == []
