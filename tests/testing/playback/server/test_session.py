"""One client without its socket: whatever comes, in whatever pieces."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.testing.playback.server.model import ServerMessage
from dissect.testing.playback.server.player import Stage
from dissect.testing.playback.server.request_log import RequestLog
from dissect.testing.playback.server.session import ABORT, CLOSE, SEND, Action, ClientSession
from dissect.testing.talk import Talk, read, words
from tests.testing.playback.server.support import CONNECT, dt, small

STAGE = Stage(small())
READ = dt(read("DB10.DBW4").octets)
LEAVE = bytes.fromhex("0300000b0680000100010080")[:11]


def actions(*pieces: bytes, stage: Stage = STAGE) -> list[Action]:
    peer = ClientSession(1, RequestLog(stage))
    return [deed for piece in pieces for deed in peer.feed(piece)]


def test_whole_and_cut_at_every_octet_it_is_the_same() -> None:
    said = CONNECT + READ + READ + LEAVE
    whole = actions(said)
    assert [deed.kind for deed in whole] == [SEND, SEND, SEND, SEND, CLOSE]
    for at in range(1, len(said)):
        assert actions(said[:at], said[at:]) == whole
    assert actions(*[bytes((octet,)) for octet in said]) == whole


def test_a_request_in_several_tpdus_is_one() -> None:
    pdu = read("DB10.DBW4").octets
    parts = b"".join(
        [b"\x03\x00" + (len(part) + 7).to_bytes(2, "big") + b"\x02\xf0" + end + part
         for part, end in ((pdu[:5], b"\x00"), (pdu[5:9], b"\x00"), (pdu[9:], b"\x80"))]
    )  # fmt: skip
    assert actions(CONNECT, parts) == actions(CONNECT, READ)


def test_an_empty_tpdu_is_everyday_and_nothing_comes_of_it() -> None:
    assert actions(CONNECT, bytes.fromhex("0300000702f000"), READ) == actions(CONNECT, READ)


@given(st.lists(st.binary(max_size=200), max_size=5), st.booleans())
def test_nothing_raises(pieces: list[bytes], connected: bool) -> None:
    peer = ClientSession(1, RequestLog(STAGE))
    if connected:
        peer.feed(CONNECT)
    for piece in pieces:
        peer.feed(piece)
        assert len(peer._waiting) <= 1000


@given(st.lists(st.binary(min_size=1, max_size=200), max_size=5))
def test_no_message_raises(messages: list[bytes]) -> None:
    peer = ClientSession(1, RequestLog(STAGE))
    peer.feed(CONNECT)
    for message in messages:
        assert all(deed.kind == SEND for deed in peer.feed(dt(message)))


@pytest.mark.parametrize(
    ("end", "kinds"),
    [
        ("fin", [SEND, CLOSE]),
        ("reset", [SEND, ABORT]),
        ("disconnect", [SEND, SEND, CLOSE]),
        ("error_tpdu", [SEND, SEND, CLOSE]),
    ],
)
def test_the_end_comes_when_all_was_asked(end: str, kinds: list[str]) -> None:
    talk = Talk()
    talk >> read("MW0") << words(1)
    talk >> read("MW2") << words(2)
    recording = talk.recording()
    recording.scripts[0].steps = recording.scripts[0].steps[1:]
    recording.scripts[0].end = end
    peer = ClientSession(1, RequestLog(Stage(recording)))
    peer.feed(CONNECT)
    for _ in range(2):
        assert [deed.kind for deed in peer.feed(dt(read("MW0").octets))] == [SEND]
    assert [deed.kind for deed in peer.feed(dt(read("MW2").octets))] == kinds
    assert peer.over


def test_nothing_is_said_behind_the_end() -> None:
    assert actions(CONNECT + LEAVE + READ)[-1] == Action(CLOSE)


def ending(end: str, farewell: bytes = b"") -> list[Action]:
    """Play a request and the end of a connection that was recorded with this one."""
    talk = Talk()
    talk >> read("MW0") << words(1)
    recording = talk.recording()
    recording.scripts[0].steps = recording.scripts[0].steps[1:]
    recording.scripts[0].end, recording.scripts[0].farewell = end, farewell
    peer = ClientSession(1, RequestLog(Stage(recording), latency_ms=5))
    peer.feed(CONNECT[:8] + b"\x12\x34" + CONNECT[10:])
    return peer.feed(dt(read("MW0").octets))


@pytest.mark.parametrize(
    ("end", "recorded", "said"),
    [
        ("error_tpdu", "0970004b03c1030a0b0c", "0300000e0970123403c1030a0b0c"),
        ("error_tpdu", "", "0300000904701234 00"),
        ("disconnect", "0680004b000585", "0300000b06801234000585"),
        ("disconnect", "", "0300000b06801234000180"),
    ],
)
def test_a_dr_or_er_is_that_of_the_recording_with_the_reference_of_the_client(
    end: str, recorded: str, said: str
) -> None:
    answer, farewell, close = ending(end, bytes.fromhex(recorded))
    assert farewell == Action(SEND, bytes.fromhex(said), last=True)
    assert close == Action(CLOSE, last=True)
    assert answer.delay_s == 0.005


def test_the_end_comes_behind_what_the_client_still_answers() -> None:
    job = bytes.fromhex("32010000000700020000") + b"\x1c\x00"
    talk = Talk()
    talk >> read("MW0") << words(1)
    recording = talk.recording()
    recording.scripts[0].steps = recording.scripts[0].steps[1:]
    recording.scripts[0].steps[0].then = [ServerMessage(job, True, 1), ServerMessage(b"\x32\x07" + bytes(8))]
    recording.scripts[0].end = "fin"
    peer = ClientSession(1, RequestLog(Stage(recording)))
    peer.feed(CONNECT)
    assert [deed.octets[7:] for deed in peer.feed(dt(read("MW0").octets))][1:] == [job]
    told = peer.feed(dt(bytes.fromhex("320300000007000100000000") + b"\x1c"))
    assert [deed.kind for deed in told] == [SEND, CLOSE]


def test_jobs_that_the_server_asked_at_once_are_answered_in_any_order() -> None:
    def job(reference: int) -> bytes:
        return bytes.fromhex(f"3201000000{reference:02x}00020000") + b"\x1c\x00"

    def answer(reference: int) -> bytes:
        return dt(bytes.fromhex(f"3203000000{reference:02x}000100000000") + b"\x1c")

    talk = Talk()
    talk >> read("MW0") << words(1)
    recording = talk.recording()
    recording.scripts[0].steps[-1].then = [
        ServerMessage(job(1), True),
        ServerMessage(job(2), True, 2),
        ServerMessage(job(3), False),
    ]
    log = RequestLog(Stage(recording))
    peer = ClientSession(1, log)
    peer.feed(CONNECT)
    assert [deed.octets[7:] for deed in peer.feed(dt(read("MW0").octets))][1:] == [job(1), job(2)]
    assert peer.feed(answer(2)) == []
    assert [deed.octets[7:] for deed in peer.feed(answer(1))] == [job(3)]
    assert peer.feed(answer(3)) == []  # nobody answered it when it was recorded; nothing is wrong with an answer
    assert log.unmatched == []
    peer.feed(answer(3))
    assert [request.lacking for request in log.unmatched] == ["ignored"]
