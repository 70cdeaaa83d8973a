"""Whole replays: against the fake PLC made of the same capture, against one that says something else, against a real server."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

import pytest

from dissect.engine.transactions.transaction import HOLE
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.tables import JOB, READ_VAR, SETUP_COMMUNICATION, WRITE_VAR
from dissect.testing.golden import golden_text, parse_golden, read_session
from dissect.testing.golden.exchange import S7, Exchange
from dissect.testing.golden.masking import mask_s7
from dissect.testing.playback.client import Permissions, ReplayError, Settings, load_recorded, make_plan
from dissect.testing.playback.client.permissions import DOWNLOAD, NO_CONTROL, NO_WRITE
from dissect.testing.playback.client.plan import (
    ASK,
    CLIENT_PUSH,
    FOLLOWS_WITHHELD,
    NO_REQUEST,
    NOT_S7,
    SERVER_ASKED,
    playable,
)
from dissect.testing.playback.protocols import DIGESTS
from dissect.testing.playback.server.recording import load_recording
from dissect.testing.playback.server.service import Server
from tests.cases import each
from tests.testing.playback.client.support import ALL, CAPTURES, HASTY, NAMES, changed, mixed, play, real_server, texts

#: What cannot be played, and why; nothing of it is left out silently.
NOTHING: Final = {
    "refused-port.pcapng": "no connection was made",
    "crafted/false-starts.pcapng": "it only looks like S7comm",
    "crafted/netlink.pcapng": "S7comm in IBH-NetLink",
    "s7commplus_1511_opc_all_types.pcap": "S7comm-plus",
    "crafted/plus-answers.pcapng": "S7comm-plus",
    "crafted/plus-plant.pcapng": "S7comm-plus",
    "cotp_unknown_payload_rst.pcapng": "not S7comm",
    "mms_header_in_own_segment.pcap": "MMS",
    "mms_one_sided_read_request.pcap": "MMS",
    "rdp-proprietary-encryption.pcap": "RDP",
}
#: What is withheld of a recording beside jobs of a PLC and answers whose request was lost.
WITHHELD: Final = {
    "crafted/coverage-userdata.pcapng": {CLIENT_PUSH, FOLLOWS_WITHHELD, DOWNLOAD},
    "crafted/negotiation.pcapng": {"its 241 bytes do not fit the PDU length of 240 that was granted"},
    "crafted/look-alikes.pcapng": {DIGESTS},
    "crafted/netlink-faults.pcapng": {NOT_S7},
    "s7comm_and_s7commplus_sll.pcap": {DIGESTS},
}
#: Jobs of the PLC that are answered: recorded downloads.
SERVED: Final = {"transfer.pcapng": 5}
#: Uploads at the same time on one connection: the server gives them new ids and cannot tell them apart (docs/serve.md).
MIXED: Final = {"crafted/program.pcapng"}
PLAYED: Final = [name for name in NAMES if name not in NOTHING and name not in MIXED]


def round_trip(path: Path, name: str) -> None:
    """Serve a recording and play it to itself: everything is sent, or told with its reason, and nothing differs."""
    recorded = load_recorded(path)
    with Server(path) as server:
        outcome = play(recorded, server, ALL, HASTY)
    assert texts(outcome) == []
    assert outcome.problems == []
    assert outcome.not_sent == []
    assert not server.unmatched
    assert {one.reason for one in outcome.withheld} <= {SERVER_ASKED, NO_REQUEST} | WITHHELD.get(name, set())
    left = {one.transaction for one in outcome.withheld}
    told = [each for each in recorded.transactions if each.request and each.outcome != "unsolicited"]
    asked = [each for each in told if each.asked_by == "client" and each.number not in left]
    setups = [
        part for part in playable(make_plan(load_recorded(path))) if part.own_setup
    ]  # of our own: none was recorded
    assert outcome.requests == len(asked) + len(setups)
    assert asked or outcome.connections
    assert outcome.served == SERVED.get(name, outcome.served)


@each("name", PLAYED)
def test_a_capture_served_and_replayed_is_the_same(name: str) -> None:
    round_trip(CAPTURES / name, name)


def test_a_shared_capture_served_and_replayed_is_the_same(corpus: Path) -> None:
    for path in sorted(corpus.glob("*.pcap*")):
        if path.name not in NOTHING:
            round_trip(path, path.name)


def test_what_cannot_be_played_says_so(corpus: Path) -> None:
    for name in NOTHING:
        own = CAPTURES / name
        with pytest.raises(ReplayError, match="no connection in it speaks S7comm over TCP"):
            make_plan(load_recorded(own if own.exists() else corpus / name))


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


def test_one_connection_can_be_chosen() -> None:
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
def test_the_recorded_times_are_kept_when_asked_for(pipelined: bool) -> None:
    path = CAPTURES / "nodes7-poll-parallel.pcapng"
    with Server(path) as server:
        began = time.monotonic_ns()
        outcome = play(path, server, settings=Settings(pace=0.02, pipelined=pipelined))
        spent = time.monotonic_ns() - began
    assert texts(outcome) == []
    times = [each.time_ns for each in load_recorded(path).links[0].transactions if each.time_ns is not None]
    assert spent >= 0.02 * (times[-1] - times[0])


#: In these only S7comm-plus is asked; what is changed here are PDUs of S7comm (S7comm-plus: test_plus.py).
PLUS_ONLY: Final = {"crafted/look-alikes.pcapng"}
#: Recordings that have no answer which could be another one.
MUTE: Final = PLUS_ONLY | {
    "crafted/cotp-refused.pcapng",
    "crafted/holes-unacknowledged.pcapng",
    "crafted/one-sided.pcapng",
}
#: Recordings in which more than the answer depends on the last request that was granted: what, and where that is tested.
DEPENDS: Final = {
    "cut-with-fin.pcapng": "the server ends the connection after what was asked (test_expected.py)",
    "cut-with-reset.pcapng": "the same",
    "crafted/disorder.pcapng": "the same",
    "crafted/reference-examples.pcapng": "the same",
    "transfer.pcapng": "a download that is refused ends it (test_download.py)",
    "transfer-refused.pcapng": "the same",
    "program-python.pcapng": "the same",
    "crafted/coverage-userdata.pcapng": "the server goes on with messages that want no answer",
    "step7_s300_rwVarTab.pcapng": "the same",
    "step7_s300_stop.pcapng": "the same",
}
#: What is longer says nothing more to these two tests, in octets.
LONG: Final = 200_000
#: Recordings in which nothing but a connection is asked for.
ONLY_CONNECTED: Final = {"connect-close.pcapng", "setup-pdu-sizes.pcapng"}


def one_bit(path: Path) -> None:
    """Change the last octet of the last answer that is played: a value, a return code, an entry of a list, a PDU length."""
    recording = load_recording(path)
    steps = [step for script in recording.scripts for step in script.steps]
    step = [step for step in steps if step.answer and not ALL.refusal(step.request)][-1]
    step.answer = step.answer[:-1] + bytes((step.answer[-1] ^ 1,))
    with Server(recording) as server:
        outcome = play(path, server, ALL, HASTY)
    told = list(outcome.differences())
    assert len(told) == 1, [difference.text for difference in told]
    (transaction,) = [each for each in outcome.expected.transactions if each.number == told[0].transaction]
    assert transaction.request == mask_s7(step.request)


#: The last answer of this one is the request of a download: another octet of it ends that (test_download.py).
ENDS: Final = {"program-python.pcapng"}


@each("name", [name for name in PLAYED if name not in MUTE | ENDS])
def test_one_bit_changed_in_a_served_capture_is_exactly_that_difference(name: str) -> None:
    one_bit(CAPTURES / name)


def test_one_bit_changed_in_a_served_shared_capture_is_exactly_that_difference(corpus: Path) -> None:
    for path in sorted(corpus.glob("*.pcap*")):
        if path.name not in NOTHING and path.stat().st_size < LONG:
            one_bit(path)


def altered(request: bytes) -> bytes:
    """Return a request for something else: of a read or write the first item has another address."""
    asked = parse_pdu(request)
    at = 21 if asked.rosctr == JOB and asked.function in {READ_VAR, WRITE_VAR} else len(request) - 1
    return request[:at] + bytes((request[at] ^ 0x04,)) + request[at + 1 :]


def other_request(path: Path) -> None:
    """Change the last request that was granted, on the side that is played."""
    recorded = load_recorded(path)
    steps = [step for part in playable(make_plan(recorded)) for step in part.steps if step.kind == ASK]
    asked = [step.transaction for step in steps if step.transaction.function != SETUP_COMMUNICATION]
    changed_ = [each for each in asked if each.response and not each.error_code][-1]
    changed_.exchange = Exchange(S7, altered(changed_.request), changed_.response)
    with Server(path) as server:
        outcome = play(recorded, server, ALL, HASTY)
    assert [mask_s7(request.octets) for request in server.unmatched] == [mask_s7(changed_.request)]
    assert [each.transaction for each in outcome.differences()] == [changed_.number], texts(outcome)


@each("name", sorted({*PLAYED} - MUTE - ONLY_CONNECTED - {*DEPENDS}))
def test_another_request_is_told_by_the_server_and_as_exactly_that_difference(name: str) -> None:
    other_request(CAPTURES / name)


def test_another_request_of_a_shared_capture_is_exactly_that_difference(corpus: Path) -> None:
    for path in sorted(corpus.glob("*.pcap*")):
        if path.name not in {*NOTHING, *DEPENDS} and path.stat().st_size < LONG:
            other_request(path)
