"""Who broke the link, and what was open then."""

from __future__ import annotations

import pickle

import pytest

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.ending import Ending
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7.parameters import Parameters
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


# ---- in words -------------------------------------------------------------------------------------------------------


def ended(
    how: str = "fin", side: int = SERVER, frame: int = 20, time_ns: int = 5 * SECOND
) -> tuple[Ending, Connection]:
    """An end at 5 s in packet 20, by the server."""
    connection = Connection(1, TcpConnection(Endpoint(b"\x0a\0\0\1", 50000), Endpoint(b"\x0a\0\0\2", 102), 0, 1, 0))
    tcp = connection.tcp
    tcp.ended, tcp.ended_by, tcp.ended_frame, tcp.ended_ns = how, side, frame, time_ns
    return Ending(connection, [], 21, 6 * SECOND), connection


@each(
    ("frame", "time_ns", "said"),
    [
        (10, 3 * SECOND, "the server closed the connection 2.00 s later"),
        (10, 5 * SECOND, "the server closed the connection 0 µs later"),
        (19, 5 * SECOND + 1, "the server closed the connection"),  # the clock ran backwards
        (20, 6 * SECOND, "sent 1.00 s after the server closed the connection"),
        (21, 5 * SECOND + 1000, "sent 1.0 µs after the server closed the connection"),
    ],
)
def test_the_time_of_the_end_after_a_request(frame: int, time_ns: int, said: str) -> None:
    ending, connection = ended()
    assert ending.deed_after(connection, frame, time_ns) == said
    ending, connection = ended("open", -1)
    assert ending.deed_after(connection, frame, time_ns) == ""


def test_a_reset_by_the_other_side_that_no_time_is_known_of() -> None:
    ending, connection = ended()
    ending.reset_frame, ending.reset_side = 22, CLIENT
    assert ending.deed_after(connection, 10, 4 * SECOND) == (
        "the server closed the connection, the client reset it, 1.00 s later"
    )
    assert ending.deed_after(connection, 10, 6 * SECOND) == "the server closed the connection, the client reset it"
    ending.reset_side = SERVER
    assert ending.deed(connection) == "the server closed the connection and reset it"


@each(
    ("oldest_frame", "oldest_ns", "frame", "said"),
    [
        (10, 3 * SECOND, 20, "2.00 s old"),
        (10, 5 * SECOND, 20, "0 µs old"),
        (19, 5 * SECOND + 1, 20, "of unknown age, the clock ran backwards"),
        (20, 5 * SECOND + 1000, 20, "sent 1.0 µs after the end had begun"),
        (19, 5 * SECOND + 1, 0, "of unknown age, the clock ran backwards"),
        (10, 3 * SECOND, 0, "2.00 s old"),
    ],
)
def test_how_old_the_oldest_open_request_was(oldest_frame: int, oldest_ns: int, frame: int, said: str) -> None:
    ending, _ = ended(frame=frame)
    ending.oldest_frame, ending.oldest_ns = oldest_frame, oldest_ns
    assert ending.age() == said


def test_the_last_message_of_the_server() -> None:
    ending, _ = ended()
    assert ending.last_heard() == ""
    ending.last_answer, ending.last_answer_ns = Parameters(b"\x04", 3), 4 * SECOND
    assert ending.last_heard() == "; last answer 1.00 s earlier"
    assert ending.last_heard("response") == "; last response 1.00 s earlier"
    ending.last_encrypted_ns = 4 * SECOND
    assert ending.last_heard() == "; last answer 1.00 s earlier"
    ending.last_encrypted_ns = 4 * SECOND + SECOND // 2
    assert ending.last_heard() == "; last encrypted message of the server 500 ms earlier"


@each(
    ("asked", "answered", "encrypted", "silence"),
    [
        (0, 0, 0, None),
        (3, 2, 0, 2),
        (2, 3, 0, 2),
        (2, 3, 4, 1),
        (5, 0, 0, 0),
    ],
)
def test_the_silence_before_the_end(asked: int, answered: int, encrypted: int, silence: int | None) -> None:
    ending, _ = ended()
    ending.last_request_ns, ending.last_answer_ns = asked * SECOND, answered * SECOND
    ending.last_encrypted_ns = encrypted * SECOND
    assert ending.silence_ns == (None if silence is None else silence * SECOND)


@each(
    ("how", "requests", "connecting", "cut"),
    [
        ("fin", 1, False, True),
        ("fin", 0, False, False),
        ("fin", 0, True, True),
        ("reset", 2, False, True),
        ("open", 2, True, False),
        ("reused", 2, True, False),
    ],
)
def test_what_is_cut(how: str, requests: int, connecting: bool, cut: bool) -> None:
    ending, _ = ended(how)
    ending.open_requests, ending.connecting = requests, connecting
    assert ending.cut is cut


def test_an_end_shows_how_and_where() -> None:
    assert repr(ended()[0]) == "Ending(fin, packet 20)"
    assert repr(ended("open", frame=0)[0]) == "Ending(open)"


def test_the_time_of_an_end_that_no_packet_shows() -> None:
    assert ended("open", -1, 0, 0)[0].time_ns == 6 * SECOND  # when the capture ended
    ending, connection = ended("evicted", -1, 0, 0)
    assert ending.time_ns == 0
    connection.tcp.last_ns = 4 * SECOND
    assert Ending(connection, [], 21, 6 * SECOND).time_ns == 4 * SECOND  # when it was last heard of


@each(("asked", "answered", "how"), [(4, 4, "disconnect"), (5, 4, "fin"), (4, 5, "fin"), (3, 2, "disconnect")])
def test_a_cotp_end_counts_unless_something_was_sent_after_it(asked: int, answered: int, how: str) -> None:
    _, connection = ended(frame=30)
    connection._note_iso_end("DR", "disconnect", CLIENT, 18, 4)
    connection.last_request_ns, connection.last_answer_ns = asked, answered
    ending = Ending(connection, [], 31, 6 * SECOND)
    assert (ending.how, ending.side, ending.frame, ending.time_ns) == (
        ("disconnect", CLIENT, 18, 4) if how == "disconnect" else ("fin", SERVER, 30, 5 * SECOND)
    )


@each(
    ("how", "frame", "resets"),
    [("fin", 25, True), ("fin", 20, False), ("fin", 0, False), ("reused", 25, False), ("open", 25, False)],
)
def test_a_reset_after_an_end_of_another_kind(how: str, frame: int, resets: bool) -> None:
    _, connection = ended(how)
    connection.tcp.reset_by, connection.tcp.reset_frame, connection.tcp.reset_ns = CLIENT, frame, 7
    ending = Ending(connection, [], 31, 8)
    found = (ending.reset_side, ending.reset_frame, ending.reset_ns)
    assert found == ((CLIENT, 25, 7) if resets else (-1, 0, 0))


@each(
    ("change", "connecting"),
    [("", True), ("no request", False), ("confirmed", False), ("data", False), ("octets", False), ("own octets", True)],
)
def test_a_connect_request_that_had_no_answer_of_any_kind(change: str, connecting: bool) -> None:
    _, connection = ended()
    connection.cr_seen = change != "no request"
    connection.tpdu_size = 1024 if change == "confirmed" else 0
    connection.pdus = 1 if change == "data" else 0
    if "octets" in change:
        connection.tcp.streams[0 if change == "own octets" else 1].octets = 1
    assert Ending(connection, [], 21, 6 * SECOND).connecting is connecting


def test_a_copy_of_an_end_is_the_same_without_its_connection() -> None:
    ending, _ = ended("reset", CLIENT, 9, 77)
    copied = pickle.loads(pickle.dumps(ending))
    assert (copied.how, copied.side, copied.frame, copied.time_ns) == ("reset", CLIENT, 9, 77)
    assert repr(copied) == "Ending(reset, packet 9)"


def test_of_several_requests_one_of_which_was_answered_in_a_gap_none_is_called_open(talk: Talk) -> None:
    """It is not known which."""
    for number in (2, 3):
        talk.ask(read(number, dbw(1, 2)))
    talk.lose(SERVER, words(2, 7))
    talk.packet(CLIENT)
    talk.packet(CLIENT, flags=FIN | ACK)
    told = ending(talk)
    assert (told.open_requests, told.cut, talk.connections[0].missed) == (0, False, 0)
