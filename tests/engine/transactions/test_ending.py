"""Who broke the link, and what was open then."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.ending import Ending
from tests.cases import each
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONNECT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    SYN,
    Talk,
    ack_data,
    dbw,
    read,
    refused,
    tpkt,
    words,
)


def ending(talk: Talk, connection: int = 0) -> Ending:
    talk.finish()
    found = talk.connections[connection].ending
    assert found is not None
    return found


@pytest.fixture
def talk() -> Talk:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 7))
    return talk


def test_nothing_refused_is_no_last_error(talk: Talk) -> None:
    talk.packet(CLIENT, flags=FIN | ACK)
    found = ending(talk)
    assert (found.last_error, found.last_error_ns, found.last_error_code) == (None, 0, 0)


@pytest.mark.parametrize(("side", "role"), [(CLIENT, "client"), (SERVER, "server")])
@pytest.mark.parametrize(("flags", "how", "deed"), [(FIN | ACK, "fin", "closed"), (RST, "reset", "reset")])
def test_a_side_ends_it(talk: Talk, side: int, role: str, flags: int, how: str, deed: str) -> None:
    asked = talk.ask(read(2, dbw(1, 2), dbw(1, 4)), after_ns=SECOND)
    talk.ask(read(3, dbw(1, 6)), after_ns=SECOND)
    frame = talk.packet(side, flags=flags, after_ns=100 * MS)
    found = ending(talk)
    assert (found.how, found.side, found.frame) == (how, side, frame)
    assert found.deed(talk.connections[0]) == f"the {role} {deed} the connection"
    assert found.cut
    assert (found.open_requests, found.oldest_frame) == (2, asked)
    assert found.oldest is not None
    assert found.oldest.subject == "Read Var DB1.DBW2, DB1.DBW4"
    assert found.time_ns - found.oldest_ns == SECOND + 100 * MS
    assert found.age() == "1.10 s old"
    assert found.last_request is not None
    assert found.last_request.subject == "Read Var DB1.DBW6"
    assert found.time_ns - found.last_answer_ns == 2 * SECOND + 100 * MS
    assert found.silence_ns == 100 * MS
    assert (found.last_error, found.connecting) == (None, False)


@each(
    ("resets", "said"),
    [
        (SERVER, "the server closed the connection and reset it"),
        (CLIENT, "the server closed the connection, the client reset it,"),
    ],
)
def test_a_request_after_the_end(resets: int, said: str) -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.packet(SERVER, flags=FIN | ACK)
    asked = talk.ask(read(2, dbw(1, 2)), after_ns=2 * MS)
    talk.packet(resets, flags=RST | ACK)
    found = ending(talk)
    assert (found.how, found.side, found.reset_side, found.oldest_frame) == ("fin", SERVER, resets, asked)
    assert found.deed(talk.connections[0]) == said
    assert found.age() == "sent 2.00 ms after the end had begun"
    unanswered = [finding.detail for finding in talk.findings if finding.slug == "transaction.unanswered"]
    assert unanswered == ["Read Var DB1.DBW2: sent 2.00 ms after the server closed the connection"]


def test_a_connection_that_ends_in_order(talk: Talk) -> None:
    talk.close()
    found = ending(talk)
    assert (found.how, found.side, found.open_requests, found.oldest, found.cut) == ("fin", CLIENT, 0, None, False)


def test_an_answer_after_the_fin_is_none_that_is_missing(talk: Talk) -> None:
    talk.ask(read(2, dbw(1, 2)))
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.tell(words(2, 7))
    talk.packet(SERVER, flags=FIN | ACK)
    found = ending(talk)
    assert (found.open_requests, found.cut) == (0, False)


def test_the_last_refusal(talk: Talk) -> None:
    talk.ask(read(2, dbw(9, 0)))
    talk.tell(ack_data(2, b"\x04\x01", refused(0x0A)))
    talk.ask(read(3, dbw(1, 0)))
    talk.tell(words(3, 1))
    talk.close()
    found = ending(talk)
    assert found.last_error is not None
    assert (found.last_error.subject, found.last_error_code) == ("Read Var DB9.DBW0", 0)
    assert found.time_ns - found.last_error_ns == 3 * MS


@pytest.mark.parametrize(("octets", "how"), [("06800001000080", "disconnect"), ("0470000102", "error_tpdu")])
def test_a_cotp_end_counts_before_that_of_tcp(talk: Talk, octets: str, how: str) -> None:
    frame = talk.packet(SERVER, tpkt(bytes.fromhex(octets)))
    talk.close()
    found = ending(talk)
    assert (found.how, found.side, found.frame) == (how, SERVER, frame)
    assert found.deed(talk.connections[0]).startswith("the server ended the connection (COTP ")


def test_an_er_after_which_the_talk_goes_on_ended_nothing(talk: Talk) -> None:
    talk.packet(SERVER, tpkt(bytes.fromhex("0470000102")))
    talk.ask(read(2, dbw(1, 2)))
    talk.tell(words(2, 7))
    talk.close()
    assert ending(talk).how == "fin"


def test_the_capture_ends(talk: Talk) -> None:
    talk.ask(read(2, dbw(1, 2)))
    talk.packet(SERVER, after_ns=SECOND)
    found = ending(talk)
    assert (found.how, found.side, found.frame, found.open_requests) == ("open", -1, 0, 1)
    assert (found.deed(talk.connections[0]), found.cut, found.silence_ns) == ("", False, SECOND)


def test_addresses_used_again(talk: Talk) -> None:
    talk.ask(read(2, dbw(1, 2)))
    talk.seq = [5_000_000, 6_000_000]
    frame = talk.packet(CLIENT, flags=SYN)
    talk.packet(SERVER, flags=SYN | ACK)
    found = ending(talk)
    assert (found.how, found.side, found.open_requests) == ("reused", -1, 1)
    assert found.frame >= frame


def test_another_connect_request(talk: Talk) -> None:
    frame = talk.packet(CLIENT, CONNECT)
    found = ending(talk)
    assert (found.how, found.side, found.frame) == ("replaced", -1, frame)


def test_a_connect_request_without_answer() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, flags=RST)
    found = ending(talk)
    assert (found.connecting, found.cut, found.silence_ns) == (True, True, None)


@pytest.mark.parametrize("answer", ["06800001000082", "0470000102", "ff"])
def test_a_connect_request_with_an_answer_of_any_kind(answer: str) -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, tpkt(bytes.fromhex(answer)) if len(answer) > 2 else b"\xff")
    talk.packet(SERVER, flags=RST)
    assert not ending(talk).connecting


def test_the_oldest_of_those_that_share_a_reference(talk: Talk) -> None:
    first = talk.ask(read(2, dbw(1, 2)))
    talk.ask(read(2, dbw(1, 2)))
    talk.ask(read(3, dbw(1, 4)))
    talk.packet(SERVER, flags=RST)
    found = ending(talk)
    assert (found.open_requests, found.oldest_frame) == (3, first)


@pytest.mark.parametrize("asked_after", [False, True])
def test_whose_answer_may_be_in_a_hole_is_not_called_open(talk: Talk, asked_after: bool) -> None:
    talk.ask(read(2, dbw(1, 2)))
    talk.lose(SERVER, words(2, 7))
    talk.ask(read(3, dbw(1, 4)))
    talk.tell(words(3, 7), after_ns=2 * SECOND)
    talk.wait(2 * SECOND)
    last = talk.ask(read(4, dbw(1, 6))) if asked_after else 0
    talk.packet(CLIENT, flags=FIN | ACK)
    told = ending(talk)
    assert talk.connections[0].unanswered == 1 + asked_after
    assert (told.open_requests, told.oldest_frame) == (int(asked_after), last)
