"""What of a capture is served."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from dissect.golden import golden_text, read_session
from dissect.golden.masking import mask_s7
from dissect.server import ServerError, load_recording, recording
from dissect.source.packet import CaptureError
from dissect.testing.talk import SERVER, Talk, answer, pdu, push, read, words

FOLDER = Path(__file__).resolve().parent.parent.parent / "captures"
NAMES = [
    "read-areas",
    "write-areas",
    "multi-items",
    "item-errors",
    "szl",
    "clock",
    "nodes7-poll",
    "setup-pdu-sizes",
    "plc-control",
]


@pytest.mark.parametrize("name", NAMES)
def test_every_request_is_a_step(name: str) -> None:
    found = load_recording(FOLDER / f"{name}.pcapng")
    expected = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))["expected"]
    assert (len(found.scripts), found.steps) == (expected["connections"], expected["answered"] + expected["unanswered"])
    assert found.notes == []
    assert all(step.answer for script in found.scripts for step in script.steps)
    assert not any(step.then for script in found.scripts for step in script.steps)


@pytest.mark.parametrize(
    "name", ["read-areas", "szl", "transfer", "two-clients", "cut-with-reset", "refused-full", "bsend"]
)
def test_a_golden_serves_as_its_capture_does_but_for_references(name: str, tmp_path: Path) -> None:
    path = tmp_path / "x.s7.txt"
    path.write_text(golden_text(read_session(FOLDER / f"{name}.pcapng")), encoding="utf-8")
    ours, theirs = load_recording(FOLDER / f"{name}.pcapng"), load_recording(path)
    scripts = sorted(
        theirs.scripts, key=lambda script: (script.refused, script.called or b""), reverse=name == "two-clients"
    )
    assert len(ours.scripts) == len(scripts)
    for script, other in zip(ours.scripts, scripts, strict=True):
        assert (script.calling, script.called, script.end, script.refused) == (
            other.calling,
            other.called,
            other.end,
            other.refused,
        )
        assert [(mask_s7(step.request), mask_s7(step.answer)) for step in script.steps] == [
            (step.request, step.answer) for step in other.steps
        ]
        assert [len(step.then) for step in script.steps] == [len(step.then) for step in other.steps]
        assert script.pdu_length == other.pdu_length


def test_the_end_is_the_servers_only_where_it_was() -> None:
    ends = {
        name: load_recording(FOLDER / f"{name}.pcapng").scripts[-1].end
        for name in ("szl", "cut-with-fin", "cut-with-reset")
    }
    assert ends == {"szl": "", "cut-with-fin": "fin", "cut-with-reset": "reset"}
    assert [script.refused for script in load_recording(FOLDER / "refused-full.pcapng").scripts] == [False, True]


def test_what_the_server_said_by_itself_stands_behind_the_step_before_it() -> None:
    talk = Talk()
    talk >> read("MW0") << words(1)
    talk << push(4, 6, b"\x01")
    talk << pdu(bytes.fromhex("32010000000000020000") + b"\x1c\x00")
    talk >> answer(bytes.fromhex("320300000000000100000000") + b"\x1c")
    talk >> read("MW0") << words(2)
    steps = talk.recording().scripts[0].steps
    assert [[said.waits for said in step.then] for step in steps] == [[], [False, True], []]


def test_what_comes_before_any_request_is_left_out_and_told() -> None:
    found = load_recording(FOLDER / "mid-stream.pcapng")
    assert found.notes == ["connection 1: 1 messages of the server come before any request and are left out"]
    assert found.steps == 4


def test_octets_that_are_no_s7comm_make_no_script() -> None:
    talk = Talk(begin=False)
    talk.raw(0, b"\x03\x00\x00\x16\x11\xe0\x00\x00\x00\x01\x00\xc0\x01\x0a\xc1\x02\x01\x00\xc2\x02\x01\x02")
    talk.reset(SERVER)
    script = talk.recording().scripts[0]
    assert (script.refused, script.end, script.steps) == (True, "reset", [])
    with pytest.raises(ServerError, match="nothing to serve"):
        Talk(begin=False).recording()


def test_captures_with_nothing_to_serve_and_no_captures(tmp_path: Path) -> None:
    with pytest.raises(ServerError, match=r"refused-port\.pcapng: no connection in it speaks S7comm over TCP"):
        load_recording(FOLDER / "refused-port.pcapng")
    other = tmp_path / "notes.txt"
    other.write_text("no capture")
    with pytest.raises(CaptureError, match="not a capture file"):
        load_recording(other)
    broken = tmp_path / "broken.s7.txt"
    broken.write_text("s7dissect golden 1\n\nconnection one\n")
    with pytest.raises(ServerError, match=r"broken\.s7\.txt"):
        load_recording(broken)


def test_what_is_longer_than_a_test_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "MAX_STEPS", 72)
    with pytest.raises(ServerError, match="more than 72 transactions; cut it first"):
        load_recording(FOLDER / "read-areas.pcapng")
    monkeypatch.setattr(recording, "MAX_STEPS", 73)
    assert load_recording(FOLDER / "read-areas.pcapng").steps == 73
    monkeypatch.setattr(recording, "MAX_OCTETS", 100)
    with pytest.raises(ServerError, match="MiB of messages; cut it first"):
        load_recording(FOLDER / "read-areas.pcapng")


def test_damage_is_told(tmp_path: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes((FOLDER / "read-areas.pcapng").read_bytes()[:-700])
    found = load_recording(cut)
    assert 60 < found.steps < 73
    assert len(found.notes) == 1
    assert "cut.pcapng" in found.notes[0]
