"""The order of TPDUs, and what a connect confirm may say."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONFIRM,
    CONNECT,
    FIN,
    SERVER,
    SYN,
    Talk,
    dbw,
    dt,
    granted,
    read,
    setup,
    tpkt,
    words,
)

DISCONNECT = tpkt(bytes.fromhex("06800001000080"))


def test_a_client_that_does_not_connect() -> None:
    talk = Talk()
    talk.hello()
    frame = talk.ask(setup(0))
    talk.tell(granted(0))
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    assert [(finding.slug, finding.frames, finding.detail) for finding in talk.findings] == [
        ("cotp.bad_start", [frame], "the first TPDU of the client is DT")
    ]
    assert talk.outcomes() == ["answered", "answered"]


def test_a_server_that_does_not_confirm() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.ask(setup(0))
    talk.tell(granted(0))
    talk.tell(words(1, 1))
    assert [finding.detail for finding in talk.findings if finding.slug == "cotp.bad_start"] == [
        "the first TPDU of the server is DT, after a connect request"
    ]


@pytest.mark.parametrize("lost", [CLIENT, SERVER])
def test_after_a_hole_nobody_knows(lost: int) -> None:
    talk = Talk()
    talk.hello()
    talk.seq[lost] += len(CONNECT)
    if lost == SERVER:
        talk.packet(CLIENT, CONNECT)
    talk.packet(CLIENT)
    talk.packet(SERVER)
    talk.ask(setup(0))
    talk.tell(granted(0))
    talk.wait(3_000_000_000)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.finish()
    assert "cotp.bad_start" not in talk.slugs()


def test_with_the_cr_as_the_first_packet_what_came_before_is_not_known() -> None:
    talk = Talk()
    talk.packet(CLIENT, CONNECT)
    talk.tell(words(1, 1))
    talk.finish()
    assert "cotp.bad_start" not in talk.slugs()


def test_octets_under_way_when_a_connection_is_replaced() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, CONNECT)
    talk.tell(words(1, 1))
    talk.packet(SERVER, CONFIRM)
    talk.finish()
    assert "cotp.bad_start" not in talk.slugs()


def test_what_follows_a_disconnect_is_told_once() -> None:
    talk = Talk()
    talk.open()
    ended = talk.packet(SERVER, DISCONNECT)
    first = talk.tell(words(1, 1))
    talk.tell(words(2, 1))
    talk.packet(SERVER, DISCONNECT)
    (finding,) = [finding for finding in talk.findings if finding.slug == "cotp.after_disconnect"]
    assert (finding.frames, finding.detail) == ([ended, first], "DT from 10.0.0.2:102")


def test_after_a_disconnect_a_size_still_counts() -> None:
    talk = Talk()
    talk.open(1, 1, 2000)
    talk.packet(CLIENT, DISCONNECT)
    talk.tell(words(1, *range(600)))
    talk.tell(words(2, *range(600)))
    assert talk.slugs().count("cotp.size_exceeded") == 2


def test_a_new_connection_after_a_disconnect_is_a_new_one() -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, DISCONNECT)
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, CONFIRM)
    talk.ask(setup(0))
    talk.tell(granted(0))
    talk.finish()
    assert len(talk.connections) == 2


def test_numbers_of_both_sides_are_told_once_each() -> None:
    talk = Talk()
    talk.open()
    for number in range(1, 4):
        for side, pdu in ((CLIENT, read(number, dbw(1, 0))), (SERVER, words(number, 1))):
            talk.packet(side, tpkt(bytes((2, 0xF0, 0x80 | number)) + pdu))
    assert talk.slugs() == ["cotp.tpdu_nr"] * 2
    assert talk.outcomes() == ["answered"] * 3


def test_a_number_does_not_hide_the_end_of_a_message() -> None:
    """A message in two DTs, both of them numbered."""
    talk = Talk()
    talk.open()
    octets = read(1, dbw(1, 0))
    talk.packet(CLIENT, tpkt(b"\x02\xf0\x01" + octets[:9]) + tpkt(b"\x02\xf0\x82" + octets[9:]))
    talk.tell(words(1, 1))
    assert talk.outcomes() == ["answered"]


def test_a_confirm_with_several_faults_is_one_finding() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, tpkt(bytes.fromhex("11d00009000220c1020100c2020103c0010d")))
    (finding,) = talk.findings
    assert finding.detail == (
        "destination reference 0x0009, the request has 0x0001; class 2, requested 0;"
        " TPDU size 8192, requested 1024; called TSAP 01.03, requested 01.02"
    )


def test_a_request_without_a_size_asks_for_the_largest() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, tpkt(bytes.fromhex("06e00000000100")))
    talk.packet(SERVER, tpkt(bytes.fromhex("09d00001000200c0010d")))
    assert talk.findings == []


@given(st.lists(st.tuples(st.integers(0, 1), st.binary(min_size=3, max_size=12)), max_size=8))
def test_any_order_of_any_tpdus(tpdus: list[tuple[int, bytes]]) -> None:
    talk = Talk()
    talk.hello()
    for side, octets in tpdus:
        talk.packet(side, tpkt(octets))
    talk.packet(CLIENT, dt(read(1, dbw(1, 0))))
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(CLIENT, flags=SYN)
    talk.finish()
    assert "internal.bug" not in talk.slugs()


#: The three forms of an ED: RFC 1006, and normal and extended of X.224.
FORMS = (b"\x02\x10\x80", b"\x04\x10\x00\x21\x80", b"\x07\x10\x00\x21\x80\x00\x00\x00")


@pytest.mark.parametrize("head", FORMS)
@pytest.mark.parametrize("side", [CLIENT, SERVER])
def test_expedited_data_may_have_16_bytes(head: bytes, side: int) -> None:
    for size in (0, 1, 15, 16, 17, 32, 500):
        talk = Talk()
        talk.open()
        frame = talk.packet(side, tpkt(head + bytes(size)))
        talk.close()
        said = [(one.slug, one.frames, one.detail) for one in talk.findings]
        who = ("10.0.0.1:50000", "10.0.0.2:102")[side]
        assert said == [("cotp.expedited_too_long", [frame], f"{size} bytes from {who}")] * (size > 16), size
