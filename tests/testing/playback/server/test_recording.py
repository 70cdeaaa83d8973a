"""What of a capture is served."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from dissect.packets.source.packet import CaptureError
from dissect.testing.golden import golden_text, model, read_session
from dissect.testing.golden.exchange import S7, Exchange
from dissect.testing.golden.masking import mask_s7
from dissect.testing.golden.model import Link, Transaction
from dissect.testing.playback.server import Recording, ServerError, load_recording, recording
from dissect.testing.playback.server.arranging import Seen, arrange
from dissect.testing.playback.server.model import Script
from dissect.testing.talk import SERVER, Ask, Talk, Tell, answer, pdu, push, read, words
from dissect.wire.build import COMPILED
from tests.growth import assert_growth

FOLDER = Path(__file__).resolve().parent.parent.parent.parent.parent / "captures"
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


def as_golden(path: Path, tmp_path: Path) -> Recording:
    """Return what the golden of a capture gives to be served."""
    golden = tmp_path / f"{path.stem}.s7.txt"
    golden.write_text(golden_text(read_session(path)), encoding="utf-8")
    return load_recording(golden)


@pytest.mark.parametrize(
    ("name", "notes"),
    [
        ("mid-stream", ["connection 1: 1 answer is not served: its request is not in the recording"]),
        (
            "crafted/holes",
            [
                "connection 1: 4 answers are not served: their requests are not in the recording",
                "connection 1: 4 requests have no answers: the recording lacks bytes of the server there",
            ],
        ),
        ("crafted/ip-fragments", ["connection 1: 1 answer is not served: its request is not in the recording"]),
    ],
)
def test_answers_whose_requests_are_missing_are_not_said_by_themselves(
    name: str, notes: list[str], tmp_path: Path
) -> None:
    path = FOLDER / f"{name}.pcapng"
    for found in (load_recording(path), as_golden(path, tmp_path)):
        assert found.notes == notes
        assert not any(step.then for step in found.scripts[0].steps)


@pytest.mark.parametrize("name", ["answer-twice", "crafted/references"])
def test_answers_out_of_turn_are_said_where_their_requests_are_there(name: str, tmp_path: Path) -> None:
    path = FOLDER / f"{name}.pcapng"
    for found in (load_recording(path), as_golden(path, tmp_path)):
        assert found.notes == []
        assert sum([len(step.then) for step in found.scripts[0].steps]) == 1


def test_what_the_server_said_before_any_request_is_left_out_and_told() -> None:
    talk = Talk(begin=False)
    talk << push(4, 6, b"\x01")
    talk >> read("MW0") << words(1)
    found = talk.recording()
    assert found.notes == ["connection 1: 1 message of the server comes before any request and is ignored"]
    assert [len(step.then) for step in found.scripts[0].steps] == [0]


def test_the_server_waits_for_as_many_answers_as_it_did() -> None:
    def asks(reference: int) -> Ask:
        return pdu(bytes.fromhex(f"3201000000{reference:02x}00020000") + b"\x1c\x00")

    def gives(reference: int) -> Tell:
        return answer(bytes.fromhex(f"3203000000{reference:02x}000100000000") + b"\x1c")

    talk = Talk()
    talk >> read("MW0") << words(1)
    talk << asks(1)
    talk << asks(2)
    talk >> gives(1)
    talk << asks(3)
    talk >> gives(2)
    talk >> gives(3)
    talk << push(4, 6, b"\x01")
    then = talk.recording().scripts[0].steps[-1].then
    assert [(said.answered, said.waits) for said in then] == [(True, 0), (True, 1), (True, 2), (False, 0)]


def seen_of(request: bytes, answer: bytes, outcome: str, asked_by: str, place: int, over: int) -> Seen:
    transaction = Transaction(Link(), asked_by, Exchange(S7, b"", b""), outcome)
    transaction.recorded = (request, answer)
    transaction.place, transaction.last_frame = place, over
    return Seen(transaction, 0)


def test_nobody_waits_for_answers_to_what_is_left_out() -> None:
    job, done = bytes.fromhex("32010000000100020000") + b"\x1c\x00", bytes.fromhex("320300000001000100000000") + b"\x1c"
    early = seen_of(job, done, "answered", "server", 1, 9)
    request = seen_of(b"a", b"b", "answered", "client", 2, 3)
    later = seen_of(job, done, "", "server", 4, 8)
    script = Script(1)
    arrange(script, [early, request, later], Recording())
    assert [(said.answered, said.waits) for said in script.steps[0].then] == [(True, 1)]


def test_what_is_behind_a_malformed_header_and_alone_is_not_served() -> None:
    request = seen_of(b"a", b"b", "answered", "client", 2, 3)
    alone = [
        seen_of(b"c", b"", "behind_malformed", "client", 1, 1),
        seen_of(b"", b"d", "behind_malformed", "client", 4, 4),
        seen_of(b"", b"e", "behind_malformed", "server", 5, 5),
    ]
    script, recording = Script(1), Recording()
    arrange(script, [*alone, request], recording)
    assert [step.request for step in script.steps] == [b"a"]
    assert script.steps[0].then == []
    assert recording.notes == []


def test_many_messages_of_the_server_are_put_in_their_places_in_one_go() -> None:
    def made(count: int) -> tuple[list[Seen], Recording]:
        seen = []
        for number in range(1, count + 1):
            asked = number % 2 == 1
            outcome = "answered" if asked else "unsolicited"
            seen.append(seen_of(b"a" if asked else b"", b"b", outcome, "client", number, number))
        return seen, Recording()

    def work(count: int) -> None:
        script = Script(1)
        seen, recording = made(count)
        arrange(script, seen, recording)
        assert [len(step.then) for step in script.steps] == [1] * (count // 2)

    assert_growth(lambda: work(500), lambda: work(2_000), 6)


def test_an_er_of_the_server_is_kept_as_it_was(tmp_path: Path) -> None:
    path = FOLDER / "crafted" / "reference-examples.pcapng"
    for found, kept in (
        (load_recording(path), bytes.fromhex("0870004b01c10211e0")),
        (as_golden(path, tmp_path), bytes.fromhex("0470000001")),
    ):
        (farewell,) = [script.farewell for script in found.scripts if script.end == "error_tpdu"]
        assert farewell.startswith(kept)


@pytest.mark.parametrize("reason", [0x85, 0x77])
def test_a_dr_of_the_server_is_kept_with_its_reason(reason: int, tmp_path: Path) -> None:
    talk = Talk()
    talk >> read("MW0") << words(1)
    talk.raw(SERVER, bytes.fromhex(f"0300000b068000014431{reason:02x}"))
    talk.close(SERVER)
    path = tmp_path / "ended.pcapng"
    talk.capture(path)
    for found in (load_recording(path), as_golden(path, tmp_path)):
        script = found.scripts[0]
        assert (script.end, script.farewell[:2], script.farewell[6]) == ("disconnect", b"\x06\x80", reason)


def test_a_refusal_is_kept_of_a_golden_as_well(tmp_path: Path) -> None:
    path = FOLDER / "crafted" / "cotp-refused.pcapng"
    ours, theirs = load_recording(path), as_golden(path, tmp_path)
    assert sorted([script.confirm[6:7] for script in ours.scripts if script.confirm[1:2] == b"\x80"]) == sorted(
        [script.confirm[6:7] for script in theirs.scripts if script.confirm[1:2] == b"\x80"]
    )


def test_what_is_carried_by_something_else_is_told(tmp_path: Path) -> None:
    path = FOLDER / "crafted" / "netlink.pcapng"
    with pytest.raises(ServerError, match="no connection in it speaks S7comm over TCP"):
        load_recording(path)
    path = FOLDER / "crafted" / "netlink-faults.pcapng"
    for found in (load_recording(path), as_golden(path, tmp_path)):
        assert len(found.scripts) == 1
        assert len([note for note in found.notes if note.endswith("speaks IBH-NetLink, which is not served")]) == 4


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


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_what_is_longer_than_a_test_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "MAX_STEPS", 72)
    with pytest.raises(ServerError, match="more than 72 transactions; cut it first"):
        load_recording(FOLDER / "read-areas.pcapng")
    monkeypatch.setattr(recording, "MAX_STEPS", 73)
    assert load_recording(FOLDER / "read-areas.pcapng").steps == 73
    monkeypatch.setattr(model, "MAX_OCTETS", 100)
    with pytest.raises(ServerError, match="MiB of distinct messages; cut it first"):
        load_recording(FOLDER / "read-areas.pcapng")


def test_damage_is_told(tmp_path: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes((FOLDER / "read-areas.pcapng").read_bytes()[:-700])
    found = load_recording(cut)
    assert 60 < found.steps < 73
    assert len(found.notes) == 1
    assert "cut.pcapng" in found.notes[0]
