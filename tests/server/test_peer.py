"""One client without its socket: whatever comes, in whatever pieces."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.server.desk import Desk
from dissect.server.peer import ABORT, CLOSE, SEND, Deed, Peer
from dissect.server.player import Stage
from dissect.testing.talk import Talk, read, words
from tests.server.support import CONNECT, dt, small

STAGE = Stage(small())
READ = dt(read("DB10.DBW4").octets)
LEAVE = bytes.fromhex("0300000b0680000100010080")[:11]


def deeds(*pieces: bytes, stage: Stage = STAGE) -> list[Deed]:
    peer = Peer(1, Desk(stage))
    return [deed for piece in pieces for deed in peer.feed(piece)]


def test_whole_and_cut_at_every_octet_it_is_the_same() -> None:
    said = CONNECT + READ + READ + LEAVE
    whole = deeds(said)
    assert [deed.kind for deed in whole] == [SEND, SEND, SEND, SEND, CLOSE]
    for at in range(1, len(said)):
        assert deeds(said[:at], said[at:]) == whole
    assert deeds(*[bytes((octet,)) for octet in said]) == whole


def test_a_request_in_several_tpdus_is_one() -> None:
    pdu = read("DB10.DBW4").octets
    parts = b"".join(
        [b"\x03\x00" + (len(part) + 7).to_bytes(2, "big") + b"\x02\xf0" + end + part
         for part, end in ((pdu[:5], b"\x00"), (pdu[5:9], b"\x00"), (pdu[9:], b"\x80"))]
    )  # fmt: skip
    assert deeds(CONNECT, parts) == deeds(CONNECT, READ)


def test_an_empty_tpdu_is_everyday_and_nothing_comes_of_it() -> None:
    assert deeds(CONNECT, bytes.fromhex("0300000702f000"), READ) == deeds(CONNECT, READ)


@given(st.lists(st.binary(max_size=200), max_size=5), st.booleans())
def test_nothing_raises(pieces: list[bytes], connected: bool) -> None:
    peer = Peer(1, Desk(STAGE))
    if connected:
        peer.feed(CONNECT)
    for piece in pieces:
        peer.feed(piece)
        assert len(peer._waiting) <= 1000


@given(st.lists(st.binary(min_size=1, max_size=200), max_size=5))
def test_no_message_raises(messages: list[bytes]) -> None:
    peer = Peer(1, Desk(STAGE))
    peer.feed(CONNECT)
    for message in messages:
        assert all(deed.kind == SEND for deed in peer.feed(dt(message)))


@pytest.mark.parametrize(
    ("end", "kinds"), [("fin", [SEND, CLOSE]), ("reset", [SEND, ABORT]), ("disconnect", [SEND, SEND, CLOSE])]
)
def test_the_end_comes_when_all_was_asked(end: str, kinds: list[str]) -> None:
    talk = Talk()
    talk >> read("MW0") << words(1)
    talk >> read("MW2") << words(2)
    recording = talk.recording()
    recording.scripts[0].steps = recording.scripts[0].steps[1:]
    recording.scripts[0].end = end
    peer = Peer(1, Desk(Stage(recording)))
    peer.feed(CONNECT)
    for _ in range(2):
        assert [deed.kind for deed in peer.feed(dt(read("MW0").octets))] == [SEND]
    assert [deed.kind for deed in peer.feed(dt(read("MW2").octets))] == kinds
    assert peer.over


def test_nothing_is_said_behind_the_end() -> None:
    assert deeds(CONNECT + LEAVE + READ)[-1] == Deed(CLOSE)
