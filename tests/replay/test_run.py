"""Whole replays: against the fake PLC made of the same capture, against one that says something else, against a real server."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.golden import golden_text, parse_golden, read_session
from dissect.golden.masking import mask_s7
from dissect.replay import Permissions, Settings, load_recorded
from dissect.replay.kinds import NO_CONTROL, NO_WRITE
from dissect.replay.plan import SERVER_ASKED
from dissect.server.recording import load_recording
from dissect.server.service import Server
from dissect.source.pcapng_writer import PcapngWriter
from dissect.transactions.transaction import HOLE
from tests.replay.support import ALL, CAPTURES, changed, mixed, play, real_server, texts

#: Captures without a connection.
EMPTY = {"refused-port"}
NAMES = sorted({path.stem for path in CAPTURES.glob("*.pcapng")} - EMPTY)


@pytest.mark.parametrize("name", NAMES)
def test_a_capture_served_and_replayed_is_the_same(name: str) -> None:
    path = CAPTURES / f"{name}.pcapng"
    with Server(path) as server:
        outcome = play(path, server, ALL)
    assert texts(outcome) == []
    assert outcome.problems == []
    assert outcome.not_sent == []
    assert not server.unmatched
    asked = [each for each in read_session(path).transactions if each.asked_by == "client" and each.request]
    assert asked or outcome.connections
    assert {one.reason for one in outcome.withheld} <= {SERVER_ASKED, "its request is not in the recording"}
    own = name == "mid-stream"  # a Setup of our own, as none was recorded
    assert outcome.requests == len(asked) + own
    assert outcome.served == (5 if name == "transfer" else 0)


@pytest.mark.parametrize(
    "name", ["read-areas", "write-areas", "plc-control", "nodes7-poll", "szl", "transfer", "blocks"]
)
def test_without_permission_only_reads_arrive(name: str) -> None:
    path = CAPTURES / f"{name}.pcapng"
    with Server(path) as server:
        outcome = play(path, server)
        arrived = [request.octets for request in server.requests]
    assert texts(outcome) == []
    for octets in arrived:
        assert octets[1] in {1, 7}
        if octets[1] == 1:
            assert octets[10] in {0x04, 0x1D, 0x1E, 0x1F, 0xF0}
    assert len(arrived) == outcome.requests


@pytest.mark.parametrize(
    ("permissions", "arrives", "reasons"),
    [
        (Permissions(), {0xF0: 1, 0x04: 2}, {NO_WRITE: [3], NO_CONTROL: [4]}),
        (Permissions(write=True), {0xF0: 1, 0x04: 2, 0x05: 1}, {NO_CONTROL: [4]}),
        (Permissions(control=True), {0xF0: 1, 0x04: 2, 0x29: 1}, {NO_WRITE: [3]}),
        (ALL, {0xF0: 1, 0x04: 2, 0x05: 1, 0x29: 1}, {}),
    ],
)
def test_what_is_not_allowed_stays_here_and_is_told(
    permissions: Permissions, arrives: dict[int, int], reasons: dict[str, list[int]], tmp_path: Path
) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(path) as server:
        outcome = play(path, server, permissions)
        functions = [request.octets[10] for request in server.requests]
    assert {function: functions.count(function) for function in functions} == arrives
    told = {reason: [one.transaction for one in outcome.withheld if one.reason == reason] for reason in reasons}
    assert told == reasons
    assert len(outcome.withheld) == len(reasons)
    assert texts(outcome) == []
    for reason, numbers in reasons.items():
        assert f"withheld: 1 transaction, {reason} (transaction {numbers[0]})" in outcome.summary()


@pytest.mark.parametrize(
    "name", ["read-areas-python", "multi-items-python", "item-errors-python", "szl-python", "transfer"]
)
def test_a_real_server_with_the_same_memory_says_the_same(name: str) -> None:
    with real_server() as server:
        outcome = play(CAPTURES / f"{name}.pcapng", server)
    assert texts(outcome) == []
    assert outcome.problems == []
    assert outcome.answered == outcome.requests


def test_a_real_server_is_written_to_when_that_is_allowed() -> None:
    with real_server() as server:
        before = play(CAPTURES / "read-areas-python.pcapng", server)
        written = play(CAPTURES / "write-areas-python.pcapng", server, Permissions(write=True))
        after = play(CAPTURES / "read-areas-python.pcapng", server)
    assert texts(before) == []
    assert texts(written) == []
    assert written.withheld == []
    assert texts(after) != []


def test_an_answer_with_another_value_is_exactly_that_difference(tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(changed(path, 0, 4, b"\x04\xd2", b"\x04\xd3")) as server:
        outcome = play(path, server)
    assert texts(outcome) == ["transaction 5, READ DB10.DBW4: was 1234, is 1235"]


def test_a_refusal_and_a_smaller_pdu_are_exactly_those_differences(tmp_path: Path) -> None:
    path = CAPTURES / "multi-items.pcapng"
    recording = load_recording(path)
    steps = recording.scripts[0].steps
    assert steps[0].answer[-2:] == b"\x01\xe0"
    for step in steps:
        if step.request[10] == 0xF0:
            step.answer = step.answer[:-2] + b"\x00\xf0"
    with Server(recording) as server:
        outcome = play(path, server, ALL)
        longest = max(len(request.octets) for request in server.requests)
    assert longest <= 240
    left = [one for one in outcome.withheld if "do not fit the PDU length of 240 that was granted" in one.reason]
    asked = [each for each in read_session(path).transactions if len(each.request) > 240]
    assert [one.transaction for one in left] == [each.number for each in asked]
    assert left
    assert texts(outcome)[0] == "transaction 1, SETUP: granted: was PDU 480, AmQ 1/1, is PDU 240, AmQ 1/1"
    refused = {each.number for each in read_session(path).transactions if len(each.response) > 240 >= len(each.request)}
    changed_ = {difference.transaction for difference in outcome.differences()}
    assert changed_ == {1} | refused


def test_connections_are_played_one_after_another_and_one_can_be_chosen() -> None:
    path = CAPTURES / "two-clients.pcapng"
    with Server(path) as server:
        outcome = play(path, server, numbers=[2])
    assert (outcome.connections, outcome.requests) == (1, 13)
    assert [link.number for link in outcome.expected.links] == [2]
    assert texts(outcome) == []


def test_a_golden_is_replayed_like_the_capture_it_was_made_of(tmp_path: Path) -> None:
    capture = CAPTURES / "read-areas.pcapng"
    golden = tmp_path / "read-areas.s7.txt"
    golden.write_text(golden_text(read_session(capture)), "utf-8")
    with Server(capture) as server:
        outcome = play(golden, server)
    assert texts(outcome) == []
    assert outcome.requests == len(parse_golden(golden.read_text("utf-8")).transactions)


def test_another_tsap_can_be_called() -> None:
    path = CAPTURES / "nodes7-poll.pcapng"
    for called, octets in ((b"\x03\x11", b"\x03\x11"), ((2, 3), b"\x01\x43")):
        with Server(path) as server:
            outcome = play(path, server, called=called)
        assert [link.called for link in outcome.came.links] == [octets]
        assert texts(outcome) == []


def test_what_is_exchanged_is_a_capture_that_reads_like_what_came(tmp_path: Path) -> None:
    path = CAPTURES / "read-areas.pcapng"
    writer = PcapngWriter(str(tmp_path / "out.pcapng"))
    with Server(path) as server:
        outcome = play(path, server, writer=writer)
    assert golden_text(read_session(tmp_path / "out.pcapng")) == golden_text(outcome.came)
    assert writer.closed
    assert not outcome.file_trouble


def test_a_file_that_cannot_be_written_costs_the_file_only(tmp_path: Path) -> None:
    class Full(PcapngWriter):
        def packet(self, *_: object, **__: object) -> None:
            raise OSError(28, "No space left on device")

    path = CAPTURES / "connect-close.pcapng"
    with Server(path) as server:
        outcome = play(path, server, writer=Full(str(tmp_path / "out.pcapng")))
    assert outcome.file_trouble == "No space left on device"
    assert outcome.answered == 1
    assert texts(outcome) == []


def test_an_answer_that_the_recording_lost_is_not_compared() -> None:
    path = CAPTURES / "read-areas.pcapng"
    recorded = load_recorded(path)
    transaction = recorded.links[0].transactions[-1]
    transaction.outcome, transaction.reason = "unanswered", HOLE
    with Server(path) as server:
        outcome = play(recorded, server)
    assert texts(outcome) == []
    assert outcome.answered == outcome.requests


@pytest.mark.parametrize("pipelined", [False, True])
def test_the_recorded_times_are_kept_when_asked_for(pipelined: bool, tmp_path: Path) -> None:
    path = CAPTURES / "nodes7-poll-parallel.pcapng"
    with Server(path) as server:
        outcome = play(path, server, settings=Settings(pace=0.02, pipelined=pipelined))
    assert texts(outcome) == []
    recorded = load_recorded(path).links[0].transactions
    came = outcome.came.links[0].transactions
    spans = [each[-1].time_ns - each[0].time_ns for each in (recorded, came) if each[-1].time_ns and each[0].time_ns]
    assert spans[1] >= 0.02 * spans[0] * 0.99


@pytest.mark.parametrize("name", NAMES)
def test_one_bit_changed_in_a_served_capture_is_exactly_that_difference(name: str) -> None:
    """The last octet of the last answer that is played: a value, a return code, an entry of a list, a PDU length."""
    path = CAPTURES / f"{name}.pcapng"
    recording = load_recording(path)
    steps = [step for script in recording.scripts for step in script.steps]
    step = [step for step in steps if step.answer and not ALL.refusal(step.request)][-1]
    step.answer = step.answer[:-1] + bytes((step.answer[-1] ^ 1,))
    with Server(recording) as server:
        outcome = play(path, server, ALL)
    told = list(outcome.differences())
    assert len(told) == 1, [difference.text for difference in told]
    (transaction,) = [each for each in outcome.expected.transactions if each.number == told[0].transaction]
    assert transaction.request == mask_s7(step.request)
