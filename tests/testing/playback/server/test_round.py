"""golden, serve, replay, diff: nothing is different at the end of the round."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.golden import diff_sessions, golden_text, read_session
from dissect.testing.playback.client import (
    Permissions,
    ReplayOutcome,
    load_recorded,
    make_plan,
    places_of,
    read_target,
    replay,
)
from dissect.testing.playback.client.permissions import NO_ANSWER
from dissect.testing.playback.client.plan import plan_lines
from dissect.testing.playback.server import Server
from dissect.testing.talk import Talk, answer, data, pdu, read, refused, szl, userdata, words
from tests.engine.findings.events import bsend
from tests.engine.transactions.talk import userdata as userdata_pdu

FOLDER = Path(__file__).resolve().parent.parent.parent.parent.parent / "captures"
ALL = Permissions(write=True, control=True)
#: Further pieces of a BSEND, in both directions: whether each goes on.
PIECES = [(b"first", True), (b"second", True), (b"third", True), (b"last", False)]


def played(path: Path, again: Path, permissions: Permissions = ALL) -> ReplayOutcome:
    """Serve a recording, play it to that server, and keep what passed."""
    with Server(path, writer=PcapngWriter(str(again))) as server:
        target = read_target(f"127.0.0.1:{server.port}")
        recorded = load_recorded(str(path))
        outcome = replay(recorded, make_plan(recorded), places_of(target, allow_remote=False), target, permissions)
        assert [difference.text for difference in outcome.differences()] == []
        assert [str(request) for request in server.unmatched] == []
    return outcome


def as_golden(path: Path, folder: Path) -> Path:
    golden = folder / "x.s7.txt"
    golden.write_text(golden_text(read_session(path)), encoding="utf-8")
    return golden


def differences(one: Path, other: Path) -> list[str]:
    return [difference.text for difference in diff_sessions(read_session(one), read_session(other))]


@pytest.mark.parametrize("form", ["golden", "capture"])
@pytest.mark.parametrize(
    "name", ["blocks", "blocks-python", "bsend", "transfer", "answer-twice", "szl", "clock", "password"]
)
def test_the_round_changes_nothing(name: str, form: str, tmp_path: Path) -> None:
    capture = FOLDER / f"{name}.pcapng"
    path = as_golden(capture, tmp_path) if form == "golden" else capture
    played(path, tmp_path / "again.pcapng")
    assert differences(path, tmp_path / "again.pcapng") == []


def piece(number: int, octets: bytes, more: bool, sequence: int) -> bytes:
    announced = 20 if number == 0 else -1
    part = number + 5 if more else -(number + 5)
    return bsend(0, octets, announced, sequence if number else 0, part)


def taken(sequence: int) -> bytes:
    """The answer to a piece."""
    return userdata_pdu(0, b"\x00\x01\x12\x08\x12\x86\x01" + bytes((sequence,)) + bytes(4), b"\x0a\0\0\0")


def spoken(sequences: tuple[int, int]) -> Talk:
    """A BSEND in pieces of the client and one of the server, between two reads; each has the number of its receiver."""
    talk = Talk()
    talk >> read("DB1.DBW0") << words(1)
    for number, (octets, more) in enumerate(PIECES):
        talk >> pdu(piece(number, octets, more, sequences[0])) << answer(taken(sequences[0]))
    for number, (octets, more) in enumerate(PIECES):
        talk << pdu(piece(number, octets, more, sequences[1]))
        talk >> answer(taken(sequences[1]))
    talk >> read("DB1.DBW2") << words(2)
    talk.close()
    return talk


@pytest.mark.parametrize("sequences", [(1, 1), (3, 200)])
@pytest.mark.parametrize("form", ["golden", "capture"])
def test_a_bsend_in_pieces_of_either_end_comes_whole(form: str, sequences: tuple[int, int], tmp_path: Path) -> None:
    capture = tmp_path / "x.pcapng"
    spoken(sequences).capture(str(capture))
    path = as_golden(capture, tmp_path) if form == "golden" else capture
    outcome = played(path, tmp_path / "again.pcapng")
    assert outcome.answered == 1 + 2 + len(PIECES)
    assert outcome.served == len(PIECES)
    assert differences(path, tmp_path / "again.pcapng") == []


def test_what_a_plc_sends_is_answered_with_permission_only(tmp_path: Path) -> None:
    capture = tmp_path / "x.pcapng"
    spoken((1, 1)).capture(str(capture))
    recorded = load_recorded(str(capture))
    outcome = played(capture, tmp_path / "again.pcapng", Permissions())
    kept = [one for one in outcome.withheld if one.reason == NO_ANSWER]
    assert (len(kept), outcome.served) == (len(PIECES), 0)
    lines = plan_lines(make_plan(recorded), Permissions())
    assert sum([line.endswith(NO_ANSWER) for line in lines]) == len(PIECES)
    lines = plan_lines(make_plan(recorded), ALL)
    assert sum([line.endswith("which the PLC sends") for line in lines]) == len(PIECES)


def test_a_refusal_that_names_no_request_stays_one(tmp_path: Path) -> None:
    """Some servers answer what they refuse with the reference of the answer before."""
    talk = Talk()
    talk >> szl(0x11) << data(b"\x00\x11\x00\x00\x00\x00\x00\x00")
    for block in (b"0A00099A", b"0C00001A"):
        talk >> userdata(3, 3, block)
        talk.unanswered()
        wrong = userdata_pdu(0, b"\x00\x01\x12\x08\x12\x83\x03" + bytes(3) + b"\xd2\x09", b"\x0a\0\0\0")
        talk << pdu(wrong)
    talk >> read("DB1.DBW0") << refused()
    talk.close()
    capture = tmp_path / "x.pcapng"
    talk.capture(str(capture))
    golden = as_golden(capture, tmp_path)
    assert golden.read_text().count("answer without request") == 2
    played(golden, tmp_path / "again.pcapng")
    assert differences(golden, tmp_path / "again.pcapng") == []
