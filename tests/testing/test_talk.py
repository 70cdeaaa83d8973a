"""Conversations written by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.golden import diff_sessions, parse_golden, read_session
from dissect.s7.message import parse_pdu
from dissect.server import Server
from dissect.session import analyze
from dissect.testing import talk as module
from dissect.testing.talk import (
    CLIENT,
    SERVER,
    Ask,
    Talk,
    Tell,
    answer,
    data,
    dints,
    done,
    done_item,
    dwords,
    error,
    granted,
    ints,
    items,
    job,
    octets,
    push,
    read,
    reals,
    refused,
    setup,
    szl,
    userdata,
    values,
    words,
    write,
)
from tests.proxy.support import WRONG, tshark
from tests.server.support import Plain


def said(ask: Ask, tell: Tell) -> str:
    return tell.build(parse_pdu(ask.octets)).hex()


@pytest.mark.parametrize(
    ("ask", "octets_of_it"),
    [
        (read("DB10.DBW4"), "32010000000000 0e0000 0401 120a10040001000a84000020"),
        (read("DB10.DBW4 WORD"), "32010000000000 0e0000 0401 120a10040001000a84000020"),
        (read("DB10.DBX4.1", "MB20 x3"), "32010000000000 1a0000 0402 120a10010001000a84000021 120a10020003000083 0000a0"),
        (read("T5", "C3 x2"), "32010000000000 1a0000 0402 120a101d000100001d000005 120a101c000200001c000003"),
        (write("DB10.DBW4 INT = -5"), "32010000000000 0e0006 0501 120a10050001000a84000020 00050010 fffb"),
        (
            write("M0.0 = true", "MB2 = 7"),
            "32010000000000 1a000b 0502 120a10010001000083000000 120a10020001000083000010 00030001 01 00 00040008 07",
        ),
        (setup(960, 8, 8), "32010000000000 080000 f000 0008 0008 03c0"),
        (szl(0x11, 2), "32070000000000 080008 0001120411440100 ff090004 0011 0002"),
        (userdata(7, 1), "32070000000000 080004 0001120411470100 0a000000"),
        (push(4, 6, b"\x01"), "32070000000000 0c0005 000112081204060000000000 ff090001 01"),
        (job(b"\x29\x00", b"\x01"), "32010000000000 020001 2900 01"),
    ],
)  # fmt: skip
def test_requests_as_octets(ask: Ask, octets_of_it: str) -> None:
    assert ask.octets.hex() == octets_of_it.replace(" ", "")
    assert parse_pdu(ask.octets).malformed == []


TWO = read("DB1.DBW0", "DB1.DBX2.0")


@pytest.mark.parametrize(
    ("ask", "tell", "octets_of_it"),
    [
        (read("MW0"), words(1234), "0401 ff040010 04d2"),
        (read("MW0 x2"), words(1, 65535), "0401 ff040020 0001ffff"),
        (read("MW0 INT"), ints(-1), "0401 ff050010 ffff"),
        (read("MD0"), dwords(1), "0401 ff040020 00000001"),
        (read("MD0 DINT"), dints(-2), "0401 ff050020 fffffffe"),
        (read("MD0 REAL"), reals(1.5), "0401 ff070004 3fc00000"),
        (read("MD0 REAL"), values(1.5), "0401 ff070004 3fc00000"),
        (read("MB0 CHAR x2"), values("OK"), "0401 ff090002 4f4b"),
        (read("M0.1"), values(True), "0401 ff030001 01"),
        (read("MB0 x3"), octets(b"\x01\x02\x03"), "0401 ff040018 010203"),
        (read("MW0"), refused(), "0401 0a000000"),
        (TWO, items(words(1), refused(0x05)), "0402 ff040010 0001 05000000"),
        (write("MW0 = 1", "MW2 = 2"), done(), "0502 ff ff"),
        (write("MW0 = 1", "MW2 = 2"), items(done_item(), refused(0x05)), "0502 ff 05"),
        (setup(960), granted(240), "f000 0001 0001 00f0"),
        (job(b"\x29\x00"), done(), "29"),
    ],
)
def test_answers_as_octets(ask: Ask, tell: Tell, octets_of_it: str) -> None:
    told = said(ask, tell)
    assert told[24:] == octets_of_it.replace(" ", "")
    assert told.startswith("320300000000")
    assert parse_pdu(bytes.fromhex(told)).malformed == []


def test_answers_to_userdata_and_refusals() -> None:
    assert said(szl(0x11), data(b"\x01\x02")) == "32070000000000 0c0006 000112081284010000000000 ff090002 0102".replace(
        " ", ""
    )
    assert said(szl(0x11), data(code=0xD402))[-12:] == "d402" + "0a000000"
    assert said(szl(0x11), error(0xD402)) == said(szl(0x11), data(code=0xD402))
    assert said(read("MW0"), error()) == "320200000000000000008104"
    assert said(read("MW0"), answer(b"\x32" * 12)) == "32" * 12


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda: read("DB10.DBW4 = 5"), "a read has no values"),
        (lambda: write("DB10.DBW4"), "takes a value"),
        (lambda: write("DB10.DBW4 INT = 40000"), "beyond the type"),
        (lambda: read("X7"), "no item|no address"),
        (lambda: read("DB1.DBD4 LONG"), "is no type"),
        (lambda: words(-1), "beyond what the type holds"),
        (lambda: refused(0xFF), "no return code that refuses"),
        (lambda: Ask(b"\x32"), "at least 10 octets"),
        (lambda: said(TWO, words(1)), "2 items were asked for, the answer has 1"),
        (lambda: said(read("MW0"), words(1, 2)), "MW0 has 2 octets, the answer 4"),
        (lambda: said(szl(1), words(1)), "only a read or a write has items"),
        (lambda: said(read("MW0"), data(b"\x01")), "is no userdata"),
        (lambda: Talk() << words(1), "the server answers, but nothing"),
        (lambda: Talk() >> words(1), "the client answers, but nothing"),
        (lambda: Talk().unanswered(), "no request open"),
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
