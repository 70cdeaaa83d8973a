"""Octets that are not in the capture: inside TPKTs and between them, acknowledged or not; one direction missing."""

from __future__ import annotations

from collections.abc import Iterable

from captures.craft.case import Case, crafts
from captures.craft.pdus import READ, SETUP, WRITE, cc, cr, dt, pattern, read, read_bytes, setup, values, write, written
from captures.craft.talk import CLIENT, SERVER, Talk


def lost(talk: Talk, side: int, octets: bytes) -> None:
    """Octets that reached the other end and not the capture: one hole."""
    talk.make(side, octets)
    talk.case.lose(len(octets))
    talk.case.find("stream.hole")


@crafts(
    "Packets missing from the capture that the far end acknowledged: a request, an answer, the middle of a TPKT, "
    "its end with the head of the next, its head, and each half of a message in two DTs. Each costs only what it "
    "held."
)
def holes(case: Case) -> None:
    talk = Talk(case)
    talk.begin(tpdu_size=512, pdu_length=960)
    talk.poll(3)
    lose_whole(case, talk)
    lose_parts(case, talk)
    lose_fragments(case, talk)
    case.pause(1_500)
    talk.close()
    case.tshark_shows(
        157,
        "it finds nothing behind the rest of a TPKT in the same segment; a PDU it shows is made of halves of two messages",
    )


def lose_whole(case: Case, talk: Talk) -> None:
    # A request.
    lost(talk, CLIENT, dt(read_bytes(1, 2)))
    talk.send(SERVER, dt(values(1, b"\x00\x01")))
    case.orphan(READ)
    talk.poll(10)
    # An answer.
    talk.send(CLIENT, dt(read_bytes(2, 2)))
    lost(talk, SERVER, dt(values(2, b"\x00\x02")))
    case.unanswered(READ, "hole")
    talk.poll(10)


def lose_parts(case: Case, talk: Talk) -> None:
    # The middle of an answer: its end is known all the same, and the next TPKT follows.
    talk.send(CLIENT, dt(read_bytes(3, 300)))
    answer = dt(values(3, pattern(300)))
    talk.send(SERVER, answer[:100])
    lost(talk, SERVER, answer[100:200])
    talk.send(SERVER, answer[200:])
    case.skip(len(answer) - 100)
    case.unanswered(READ, "hole")
    talk.poll(10)
    # The end of an answer and the head of the next one; the rest of that is in a segment of its own.
    talk.send(CLIENT, dt(read_bytes(4, 300)) + dt(read_bytes(5, 200)))
    answers = dt(values(4, pattern(300))) + dt(values(5, pattern(200)))
    talk.send(SERVER, answers[:250])
    lost(talk, SERVER, answers[250:400])
    talk.send(SERVER, answers[400:])
    case.skip(len(answers) - 150)
    case.unanswered(READ, "hole")
    case.unanswered(READ, "hole")
    talk.poll(10)
    # The head of a request, whose rest has another request behind it in the same segment.
    requests = dt(read_bytes(6, 2)) + dt(read_bytes(7, 2))
    lost(talk, CLIENT, requests[:12])
    talk.send(CLIENT, requests[12:])
    case.skip(31 - 12)
    talk.send(SERVER, dt(values(6, b"\x00\x06")) + dt(values(7, b"\x00\x07")))
    case.orphan(READ)
    case.pair(READ)
    talk.poll(10)


def lose_fragments(case: Case, talk: Talk) -> None:
    # A message in two DTs: the second is missing, then the first of another.
    message = write(8, pattern(700))
    talk.send(CLIENT, dt(message[:500], end=False))
    lost(talk, CLIENT, dt(message[500:]))
    case.find("cotp.unfinished_tsdu")
    talk.send(SERVER, dt(written(8)))
    case.orphan(WRITE)
    talk.poll(10)
    message = write(9, pattern(700))
    lost(talk, CLIENT, dt(message[:500], end=False))
    talk.send(CLIENT, dt(message[500:]))
    talk.send(SERVER, dt(written(9)))
    case.orphan(WRITE)
    talk.poll(10)


@crafts(
    "Pairs that are sure and pairs that are only likely: octets of both directions are missing between request and "
    "answer; one answer fits two requests with one reference. And answers that are missing, surely or perhaps."
)
def certainty(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    talk.poll(3)
    # The client acknowledges what is missing with its next request, and nothing else was pending: surely answered.
    talk.send(CLIENT, dt(read_bytes(1, 2)))
    lost(talk, SERVER, dt(values(1, b"\x00\x01")))
    case.unanswered(READ, "hole")
    talk.poll(3)
    # Two requests were pending, and one answer is missing: either is perhaps answered.
    talk.send(CLIENT, dt(read_bytes(2, 2)))
    talk.send(CLIENT, dt(read_bytes(3, 2)))
    lost(talk, SERVER, dt(values(2, b"\x00\x02")))
    case.unanswered(READ, "hole")
    case.unanswered(READ, "hole")
    talk.poll(3)
    # The answer of the first is missing, and so is the second request, which may have the same reference.
    talk.send(CLIENT, dt(read_bytes(4, 2)))
    lost(talk, SERVER, dt(values(4, b"\x00\x04")))
    lost(talk, CLIENT, dt(read_bytes(4, 2)))
    talk.send(SERVER, dt(values(4, b"\x00\x44")))
    case.pair(READ)
    talk.poll(3)
    case.pause(1_500)
    talk.close()
    # Nothing is missing, and there are fewer answers than requests.
    talk = Talk(case, client_port=49153)
    talk.begin()
    talk.send(CLIENT, dt(read_bytes(7, 2)))
    talk.send(CLIENT, dt(read(7, "DB1.DBB2", count=2)))
    talk.send(SERVER, dt(values(7, b"\x00\x07")))
    case.pair(READ)
    case.unanswered(READ, "reference_reused")
    case.find("transaction.unanswered")
    case.find("session.shared_reference")
    case.pause(1_500)
    talk.close()


@crafts(
    "A capture that went through a display filter, as many published ones: the empty DTs with which the client "
    "acknowledges, and every bare TCP acknowledgement, are gone. A hole of 7 octets before each request."
)
def filtered_export(case: Case) -> None:
    talk = Talk(case)
    case.count(connections=1)
    for number in range(1, 41):
        if number > 1:
            lost(talk, CLIENT, dt(end=False))
        talk.exchange(READ, read_bytes(number, 4), values(number, pattern(4, number)))


@crafts(
    "Holes that nobody acknowledges, because only what the client sent was captured: given up after 64 segments, "
    "after a second, at the end."
)
def holes_unacknowledged(case: Case) -> None:
    # More segments behind the hole than are held.
    talk = listen(case, CLIENT, 49152)
    one_way(talk, (1, 2))
    lost(talk, CLIENT, dt(read_bytes(3, 2)))
    one_way(talk, range(4, 80))
    # Few segments, and time passes.
    talk = listen(case, CLIENT, 49153)
    one_way(talk, (1, 2))
    lost(talk, CLIENT, dt(read_bytes(3, 2)))
    one_way(talk, (4,))
    case.pause(1_500)
    one_way(talk, (5, 6))
    # The capture ends.
    talk = listen(case, CLIENT, 49154)
    one_way(talk, (1, 2))
    lost(talk, CLIENT, dt(read_bytes(3, 2)))
    one_way(talk, (4, 5))
    case.find("capture.one_sided", 3)


@crafts(
    "Connections of which one direction was captured: the client's, the server's, each with and without its "
    "beginning, for five seconds. Said once a connection, not once a PDU."
)
def one_sided(case: Case) -> None:
    for port, side in enumerate((CLIENT, SERVER), 49152):
        talk = listen(case, side, port)
        one_way(talk, range(1, 11), side, 500)
        talk = Talk(case, client_port=port + 10)
        case.count(connections=1)
        one_way(talk, range(1, 11), side, 500)
    case.find("capture.one_sided", 4)


def listen(case: Case, side: int, port: int) -> Talk:
    """A connection from its handshake to the answer to Setup, of which only what ``side`` sends is captured."""
    talk = Talk(case, client_port=port)
    case.count(connections=1)
    for frames in (
        (talk.make(CLIENT, flags="S"), talk.make(SERVER, flags="SA")),
        (talk.make(CLIENT, cr()), talk.make(SERVER, cc())),
        (talk.make(CLIENT, dt(setup(0, 480, 8, 8))), talk.make(SERVER, dt(setup(0, 480, 8, 8, answer=True)))),
    ):
        case.put(frames[side])
    half(case, side, SETUP)
    return talk


def one_way(talk: Talk, numbers: Iterable[int], side: int = CLIENT, milliseconds: int = 0) -> None:
    """Reads, of which only what ``side`` sends is captured."""
    for number in numbers:
        frames = (talk.make(CLIENT, dt(read_bytes(number, 2))), talk.make(SERVER, dt(values(number, b"\x00\x01"))))
        talk.put(frames[side])
        talk.case.pause(milliseconds)
        half(talk.case, side, READ)


def half(case: Case, side: int, function: int) -> None:
    """Half of a transaction: what ``side`` sent of it."""
    if side == SERVER:
        case.orphan(function)
    else:
        case.unanswered(function, "one_sided")
