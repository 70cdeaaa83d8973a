"""How the end of a connection reads."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.connection import Connection
from dissect.meaning.report.endings import ending_as_dict, phrase, short
from dissect.meaning.report.words import Places
from dissect.packets.source.packet import SourceFile
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONNECT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    Talk,
    ack_data,
    dbw,
    read,
    refused,
    words,
)

PLACES = Places([SourceFile("a.pcap", 1)], False)


def connection(talk: Talk) -> Connection:
    talk.finish()
    return talk.connections[0]


def test_a_cut_names_who_how_and_what_was_open() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 7))
    talk.ask(read(2, dbw(1, 2)), after_ns=100 * MS)
    talk.packet(CLIENT, flags=RST, after_ns=2 * SECOND)
    said = "reset by the client at packet 11 with 1 request pending: Read Var DB1.DBW2 (packet 10), 2.00 s old"
    assert phrase(connection(talk), PLACES) == f"{said}; last answer 2.10 s earlier"
    assert short(talk.connections[0]) == "reset by the client"


def test_in_short_only_who_ended_it() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.packet(SERVER, flags=FIN | ACK)
    assert short(connection(talk)) == "closed by the server"


def test_what_is_open_has_no_end_in_short() -> None:
    talk = Talk()
    talk.open(8, 8)
    assert short(connection(talk)) == ""


def test_several_open_requests() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(2, dbw(1, 2)), read(3, dbw(1, 4)))
    talk.packet(SERVER, flags=RST, after_ns=SECOND)
    said = "reset by the server at packet 9 with 2 requests pending: the oldest is Read Var DB1.DBW2 (packet 8), 1.00 s old"
    assert phrase(connection(talk), PLACES) == f"{said}; last answer 1.00 s earlier"


def test_a_refusal_just_before() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(2, dbw(9, 0)))
    talk.tell(ack_data(2, b"\x04\x01", refused(0x0A)))
    talk.packet(SERVER, flags=RST)
    told = connection(talk)
    assert phrase(told, PLACES) == "reset by the server at packet 10; last answer, a refusal, 1.00 ms earlier"
    ending = ending_as_dict(told, PLACES)
    assert ending is not None
    assert ending["last_error"] == {"what": "Read Var DB9.DBW0", "before_ns": MS, "code": None}


def test_an_end_in_order_is_short() -> None:
    talk = Talk()
    talk.open()
    talk.close()
    assert phrase(connection(talk), PLACES) == "closed by the client at packet 8"


def test_a_connect_request_without_answer() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, flags=RST)
    said = phrase(connection(talk), PLACES)
    assert said == "reset by the server at packet 5 before the connect request was answered"


def test_still_open() -> None:
    talk = Talk()
    talk.open()
    told = connection(talk)
    assert phrase(told, PLACES) == "still open at the end of the capture"
    ending = ending_as_dict(told, PLACES)
    assert ending is not None
    assert (ending["how"], ending["by"], ending["role"], ending["frame"]) == ("open", None, None, None)


def test_several_files_are_named() -> None:
    talk = Talk()
    talk.open()
    talk.close()
    ending = ending_as_dict(connection(talk), Places([SourceFile("a.pcap", 1), SourceFile("b.pcap", 8)], True))
    assert ending is not None
    assert (ending["file"], ending["frame"]) == ("b.pcap", 1)


def test_a_fin_that_the_plc_answers_with_a_rst_names_both() -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=RST, after_ns=MS)
    told = connection(talk)
    assert phrase(told, PLACES) == "closed by the client at packet 8, reset by the server at packet 9"
    ending = ending_as_dict(told, PLACES)
    assert ending is not None
    assert (ending["how"], ending["role"], ending["frame"]) == ("fin", "client", 8)
    reset = ending["reset"]
    assert isinstance(reset, dict)
    assert (reset["role"], reset["by"], reset["frame"]) == ("server", "10.0.0.2:102", 9)
    assert reset["time"] > ending["time"]


def test_a_rst_alone_is_told_once() -> None:
    talk = Talk()
    talk.open()
    talk.packet(SERVER, flags=RST)
    told = connection(talk)
    assert phrase(told, PLACES).startswith("reset by the server at packet 8; last answer")
    ending = ending_as_dict(told, PLACES)
    assert ending is not None
    assert (ending["how"], ending["reset"]) == ("reset", None)


def test_an_answer_after_the_fin_came_later_than_the_end() -> None:
    """A FIN ends one direction only: no time of minus 1.20 s."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)), read(2, dbw(1, 2)))
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.tell(words(1, 7), after_ns=SECOND)
    told = connection(talk)
    assert phrase(told, PLACES).endswith("; last answer 1.00 s later")
    ending = ending_as_dict(told, PLACES)
    assert ending is not None
    assert ending["last_answer"] == {"what": "Read Var DB1.DBW0", "before_ns": -SECOND}


def test_a_request_after_the_fin_of_the_other_side_is_not_of_a_negative_age() -> None:
    """A client may go on asking when the server has sent its FIN; the server then resets the connection."""
    talk = Talk()
    talk.open(8, 8)
    talk.packet(SERVER, flags=FIN | ACK)
    talk.ask(read(1, dbw(1, 0)), after_ns=3 * SECOND)
    talk.packet(SERVER, flags=RST)
    talk.close()
    said = phrase(connection(talk), PLACES)
    assert said.startswith(
        "closed by the server at packet 8, reset by the server at packet 10 with 1 request pending: "
    )
    assert "Read Var DB1.DBW0 (packet 9), sent 3.00 s after the end had begun; last answer" in said
    (told,) = [finding.detail for finding in talk.findings if finding.slug == "transaction.unanswered"]
    assert told == "Read Var DB1.DBW0: sent 3.00 s after the server closed the connection"


@pytest.mark.parametrize("closed", [True, False])
def test_a_request_whose_age_no_clock_tells(closed: bool) -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(1, dbw(1, 0)))
    if closed:
        talk.packet(SERVER, flags=RST, after_ns=-3 * SECOND)
    else:
        talk.packet(SERVER, after_ns=-3 * SECOND)
    assert "(packet 8), of unknown age, the clock ran backwards" in phrase(connection(talk), PLACES)
    told = [finding.detail for finding in talk.findings if finding.slug == "transaction.unanswered"]
    assert told == (["Read Var DB1.DBW0: the server reset the connection"] if closed else [])
