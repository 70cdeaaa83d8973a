"""Conversations written by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.files.session import analyze
from dissect.testing import talk as module
from dissect.testing.golden import diff_sessions, parse_golden, read_session
from dissect.testing.playback.server import Server
from dissect.testing.talk import (
    CLIENT,
    SERVER,
    Talk,
    answer,
    done,
    error,
    items,
    job,
    push,
    read,
    refused,
    szl,
    values,
    words,
    write,
)
from tests.online.proxy.support import WRONG, tshark
from tests.testing.playback.server.support import Plain


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda: Talk() << words(1), "the server answers, but no request to it is pending"),
        (lambda: Talk() >> words(1), "the client answers, but no request to it is pending"),
        (lambda: Talk().unanswered(), "the client has no pending request"),
        (lambda: Talk().close() >> read("MW0"), "the connection is over"),
        (lambda: Talk().reset().close(), "the connection is over"),
    ],
)
def test_what_is_written_wrongly_is_told(wrong: object, why: str) -> None:
    assert callable(wrong)
    with pytest.raises(ValueError, match=why):
        wrong()


def conversation() -> Talk:
    talk = Talk()
    talk >> read("DB10.DBW4") << words(1234)
    talk >> read("DB10.DBD8 REAL", "DB99.DBW0") << items(values(2.5), refused(0x0A))
    talk >> write("DB10.DBW4 INT = -5") << done()
    talk >> szl(0x7777) << error(0xD402)
    return talk.close()


def test_a_conversation_is_the_session_it_says(tmp_path: Path) -> None:
    talk = conversation()
    path = tmp_path / "x.pcapng"
    assert path.write_bytes(talk.capture()) == len(talk.capture(path)) == path.stat().st_size
    session = talk.session()
    assert [(one.function_name, one.outcome) for one in session.transactions] == [
        ("Setup communication", "answered"),
        ("Read Var", "answered"),
        ("Read Var", "answered"),
        ("Write Var", "answered"),
        ("CPU functions: read SZL", "answered"),
    ]
    assert [item.value for item in session.transactions[2].items] == [2.5, None]
    assert session.transactions[4].error_code == 0xD402
    assert diff_sessions(session, read_session(path)) == []
    assert diff_sessions(session, parse_golden(talk.golden())) == []
    other = Talk()
    other >> read("DB10.DBW4") << words(1235)
    assert diff_sessions(session, other.session())


def test_its_capture_is_without_fault(tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    conversation().capture(path)
    assert tshark(path, WRONG) == []
    assert len(tshark(path, "s7comm")) == 10
    slugs = {finding.slug for finding in analyze(str(path)).findings}
    assert slugs == {"transaction.item_error", "transaction.refused", "security.write"}  # what is said, nothing else


def test_references_are_put_in_and_answers_find_their_requests() -> None:
    talk = Talk(begin=False)
    talk >> read("MW0") >> read("MW2") << words(1) << words(2)
    talk >> read("MW4")
    talk.unanswered()
    talk >> read("MW6") << words(6)
    said_by = [(side, int.from_bytes(octets[11:13], "big")) for side, octets in talk.octets]
    assert said_by == [(0, 1), (0, 2), (1, 1), (1, 2), (0, 3), (0, 4), (1, 4)]
    assert [one.outcome for one in talk.session().transactions] == ["answered", "answered", "unanswered", "answered"]


def test_either_side_asks_and_may_push() -> None:
    talk = Talk()
    talk << push(4, 6, b"\x01\x02")
    talk << job(b"\x1b\x00") >> answer(bytes.fromhex("320300000000000100000000") + b"\x1b")
    found = talk.session().transactions
    assert [(one.asked_by, one.outcome) for one in found[1:]] == [("client", "unsolicited"), ("server", "answered")]


def test_time_and_ends() -> None:
    talk = Talk(start_ns=10**18)
    talk >> read("MW0")
    talk.wait(250)
    talk << words(1)
    assert [one.latency_ns for one in talk.session().transactions] == [1_000_000, 251_000_000]
    assert talk.reset(CLIENT).session().links[0].ended == "reset"
    assert Talk().close(SERVER).session().links[0].ended_by == "server"
    assert talk.frames()[0][0] == 10**18
    raw = Talk(begin=False).raw(CLIENT, b"\x03\x00\x00\x07\x02\xf0\x80")
    assert raw.octets == [(CLIENT, b"\x03\x00\x00\x07\x02\xf0\x80")]


def test_it_can_be_served() -> None:
    with Server(conversation().recording()) as server, Plain(server) as client:
        assert client.words("DB10.DBW4") == [1234]
        assert server.unmatched == []


def test_the_docstring_says_what_there_is() -> None:
    scope: dict[str, object] = {}
    exec("from dissect.testing.talk import *", scope)
    assert set(module.__all__) <= set(scope)
    assert not [name for name in module.__all__ if name.startswith("_")]
