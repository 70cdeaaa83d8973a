"""Each capture is served, and its client played against it: to the octet what the recorded server said."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from dissect.testing.golden.reading import read_session
from dissect.testing.playback.client.plan import make_plan
from dissect.testing.playback.client.recorded import ReplayError
from dissect.testing.playback.server import Server, ServerError, load_recording
from tests.cases import each
from tests.testing.playback.server.support import Tpkts, messages, play

FOLDER: Final = Path(__file__).resolve().parent.parent.parent.parent.parent / "captures"
PATHS: Final = sorted(FOLDER.rglob("*.pcap*"))

#: Nobody spoke S7comm over TCP there, so there is nothing to serve.
NOTHING: Final = {
    "refused-port": "nobody listened",
    "false-starts": "what looks like a TPKT is none",
    "netlink": "S7comm over IBH-NetLink, not over ISO-on-TCP",
    "cotp_unknown_payload_rst": "COTP with something else in it",
    "mms_header_in_own_segment": "MMS",
    "mms_one_sided_read_request": "MMS",
    "rdp-proprietary-encryption": "RDP",
    "s7commplus_1511_opc_all_types": "S7comm-plus with digests",
    "plus-answers": "S7comm-plus with digests",
    "plus-plant": "S7comm-plus with digests",
}
#: The client goes over to TLS, which is not served: what was said inside is, to clients without TLS (test_plus.py).
SEALED: Final = {"s7commplus-tls"}
#: Connections that break off here, by number: what the client sends there no server can go on with.
BROKEN: Final = {
    ("cotp-endless", 1): "an endless message",
    ("cotp-faults", 1): "DT is unexpected",  # its header is longer than the TPDU
    ("cotp-faults", 4): "CR is unexpected",
    ("cotp-tpdus", 1): "ED is unexpected",  # class 2, which is answered in class 0
    ("cotp-tpdus", 2): "ED is unexpected",
    ("cotp-tpdus", 3): "ED is unexpected",
    ("reference-examples", 4): "ED is unexpected",
    ("reuse-without-syn", 1): "CR is unexpected",  # another connection, whose beginning was not captured
}
#: Connections of which the messages are compared, not the octets around them.
WHOLE: Final = {
    ("two-clients", 2): "the confirmation of its end has a broken variable part (captures/README.md)",
    ("cotp-faults", 2): "the TSAP of its CR is longer than the CR, so it is confirmed without one",
    ("cotp-faults", 3): "its CC came without a CR",
    ("cotp-faults", 6): "its server began a message and never ended it",
    ("cotp-fragments", 1): "its server sent empty DTs",
}
#: Connections whose answers come in another order here: that of the requests, unless they take as long as recorded.
REORDERED: Final = {("references", 1)}
#: Connections that are not served, in captures where others are.
OTHERS: Final = {
    ("s7comm_and_s7commplus_sll", 1): "speaks S7comm-plus",
    ("look-alikes", 3): "speaks S7comm-plus",
    ("look-alikes", 4): "speaks TLS",
    ("look-alikes", 5): "speaks MMS",
    ("look-alikes", 6): "speaks unknown protocol",
    ("look-alikes", 7): "speaks RDP",
    ("look-alikes", 8): "speaks RDP",
    ("plant", 1): "speaks unknown protocol",  # SCD without S7comm
}
#: Answers that are not served, because the capture lost their requests.
LOST: Final = {"holes": 4, "ip-fragments": 1, "snaplen": 3}
#: Of these, those whose other messages are known in part only as well: nobody can tell what is to come, octet by octet. What
#: the fake PLC says to those that are known is compared in tests/testing/playback/client.
IN_PART: Final = {"holes", "snaplen"}
#: What the client sent that is no request.
STRANGE: Final = {
    "coverage-userdata": 1,  # an answer to nothing
    "reference-examples": 1,  # no S7comm
    "s7-lengths": 1,
    "s7-mismatches": 3,
}


def expect_told(path: Path, lost: int) -> None:
    """Look for the line about answers whose requests are not there."""
    told = f"{lost} answer{'s are' if lost > 1 else ' is'} not served"
    assert any(told in note for note in load_recording(path).notes)


def expect_the_same(path: Path) -> None:
    """Play every connection of a capture to its fake PLC."""
    name = path.name.partition(".")[0]
    connections = Tpkts(path).connections
    with Server(path) as server:
        for number, packets in enumerate(connections, 1):
            this = (name, number)
            if name in SEALED:
                continue
            if this in OTHERS:
                told = f"connection {number} {OTHERS[this]}, which is not served"
                assert any(note.startswith(told) for note in server.recording.notes)
                continue
            if this in BROKEN:
                with pytest.raises(ConnectionResetError):
                    play(server, packets, whole=True)
                assert any(BROKEN[this] in text for text in server.problems)
                continue
            wanted, got = play(server, packets, this in WHOLE, name in LOST)
            if this in REORDERED:
                assert sorted(messages(got)) == sorted(messages(wanted))
            elif this in WHOLE:
                assert messages(got) == messages(wanted)
            else:
                assert got.hex(" ") == wanted.hex(" ")
        assert len(server.unmatched) == STRANGE.get(name, 0)
        assert not any("broken" in text for text in server.problems)


@each("path", PATHS)
def test_the_fake_plc_says_what_the_recorded_one_said(path: Path) -> None:
    expect_played(path)


def expect_played(path: Path) -> None:
    """Play a capture, or see that there is nothing to be played."""
    name = path.name.partition(".")[0]
    if name in NOTHING:
        with pytest.raises(
            ServerError, match="no connection in it speaks S7comm over TCP, so there is nothing to serve"
        ):
            load_recording(path)
        return
    if name in LOST:
        expect_told(path, LOST[name])
    if name not in IN_PART:
        expect_the_same(path)


@pytest.mark.parametrize("name", ["two-clients", "setup-pdu-sizes"])
def test_connections_at_once_do_not_mix(name: str) -> None:
    connections = Tpkts(FOLDER / f"{name}.pcapng").connections
    with Server(FOLDER / f"{name}.pcapng") as server:
        for packets in reversed(connections):
            if name == "two-clients":  # their TSAPs tell them apart
                wanted, got = play(server, packets[:-1])
                assert got == wanted
        assert server.unmatched == []


def test_public_captures_play_as_well(corpus: Path) -> None:
    paths = [path for path in sorted(corpus.glob("*.pcap*")) if path.stat().st_size < 1_000_000]
    assert len(paths) > 10
    for path in paths:
        expect_played(path)


def test_the_tables_of_exceptions_name_captures() -> None:
    here = {path.name.partition(".")[0] for path in PATHS}
    named = {name for name, _ in (*BROKEN, *WHOLE, *REORDERED)} | LOST.keys() | STRANGE.keys() | IN_PART
    assert named <= here


@pytest.mark.parametrize("name", ["crafted/plus-plant", "crafted/plus-answers"])
def test_a_capture_of_nothing_but_s7comm_plus_with_digests_is_refused_in_a_sentence(name: str) -> None:
    path = FOLDER / f"{name}.pcapng"
    why = "it speaks S7comm-plus; its messages carry digests, which cannot be computed without the session key"
    with pytest.raises(ServerError) as refused:
        load_recording(path)
    text = str(refused.value)
    assert text.endswith(f"no connection in it speaks S7comm over TCP, so there is nothing to serve: {why}")
    assert "\n" not in text
    with pytest.raises(ReplayError) as withheld:
        make_plan(read_session(path, messages=True))
    assert str(withheld.value).endswith(f"so there is nothing to replay: {why}")


def test_where_nothing_is_s7comm_plus_it_is_not_named() -> None:
    with pytest.raises(ServerError, match=r"so there is nothing to serve$"):
        load_recording(FOLDER / "refused-port.pcapng")
