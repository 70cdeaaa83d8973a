"""Violations of the rules of a session: before Setup, beyond the granted limits, too slow, at the wrong time."""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.pdus import (
    DOWNLOAD_BLOCK,
    READ,
    SETUP,
    USERDATA,
    WRITE,
    ack_data,
    ask,
    dt,
    job,
    pattern,
    read_bytes,
    setup,
    tell,
    values,
    write,
    written,
)
from captures.craft.talk import CLIENT, SERVER, Talk


@crafts(
    "Negotiation and what does not keep to it: jobs before Setup and before its answer, PDUs longer than granted, "
    "more jobs open than granted from either side, grants that are more than was asked or too little, Setup "
    "repeated."
)
def negotiation(case: Case) -> None:
    ask_too_early(case)
    say_too_much(case)
    ask_too_often(case)
    grant_wrongly(case)


def connected(case: Case, client_port: int) -> Talk:
    """A connection up to the CC."""
    talk = Talk(case, client_port=client_port)
    talk.open()
    talk.connect()
    return talk


def ask_too_early(case: Case) -> None:
    # A read before Setup.
    talk = connected(case, 49153)
    talk.poll()
    case.find("session.data_before_setup")
    talk.setup()
    talk.poll()
    talk.close()
    # A read after the Setup request, before its answer.
    talk = connected(case, 49154)
    talk.send(CLIENT, dt(setup(0, 480, 8, 8)))
    talk.send(CLIENT, dt(read_bytes(1, 2)))
    case.find("session.data_before_setup")
    talk.send(SERVER, dt(setup(0, 480, 8, 8, answer=True)))
    talk.send(SERVER, dt(values(1, b"\x00\x01")))
    case.pair(SETUP, READ)
    talk.close()


def say_too_much(case: Case) -> None:
    # PDU length 240 granted: a write of 241, a read whose answer has 241, one of exactly 240 each way.
    talk = connected(case, 49155)
    talk.exchange(SETUP, setup(0, 960, 8, 8), setup(0, 240, 8, 8, answer=True))
    for number, size in ((1, 241), (2, 240)):
        talk.exchange(WRITE, write(number, pattern(size - 28)), written(number))
    for number, size in ((3, 241), (4, 240)):
        talk.exchange(READ, read_bytes(number, size - 18), values(number, pattern(size - 18)))
    case.find("session.pdu_too_long", 2)
    case.find("security.write")
    case.find("session.read_too_long")
    # Setup again, for less: the last granted values apply.
    talk.exchange(SETUP, setup(5, 240, 8, 8), setup(5, 120, 8, 8, answer=True))
    talk.exchange(READ, read_bytes(6, 150), values(6, pattern(150)))
    case.find("session.pdu_too_long")
    case.find("session.read_too_long")
    case.find("session.repeated_setup")
    talk.close()


def ask_too_often(case: Case) -> None:
    # The client may have two jobs open, the PLC one: the client has four open at once, userdata among them, and the PLC two.
    talk = connected(case, 49156)
    talk.exchange(SETUP, setup(0, 480, 4, 4), setup(0, 480, 1, 2, answer=True))
    for number in (1, 2, 3):
        talk.send(CLIENT, dt(read_bytes(number, 2)))
    talk.send(CLIENT, dt(ask(4, 7, 1)))
    case.find("session.too_many_jobs", 2)
    for number in (1, 2, 3):
        talk.send(SERVER, dt(values(number, b"\x00\x01")))
    talk.send(SERVER, dt(tell(4, 7, 1, bytes(10))))
    case.pair(READ, READ, READ, USERDATA)
    name = b"\x00\x00\x00\x00\x00\x00\x00\x09_0A00001P"
    for number in (1, 2):
        talk.send(SERVER, dt(job(number, DOWNLOAD_BLOCK, name)))
    case.find("session.too_many_jobs")
    for number in (1, 2):
        talk.send(CLIENT, dt(ack_data(number, DOWNLOAD_BLOCK, b"\x00", b"\x00\x02\x00\xfb\x01\x02")))
    case.pair(DOWNLOAD_BLOCK, DOWNLOAD_BLOCK)
    talk.close()


def grant_wrongly(case: Case) -> None:
    # A longer PDU, more jobs, and a PDU length in which nothing fits.
    grants = ((960, 2, 2), (480, 3, 2), (480, 2, 3), (20, 2, 2))
    for client_port, (pdu_length, calling, called) in enumerate(grants, 49157):
        talk = connected(case, client_port)
        talk.exchange(SETUP, setup(0, 480, 2, 2), setup(0, pdu_length, calling, called, answer=True))
        case.find("session.bad_grant")
        talk.close()


@crafts(
    "Times: an answer after 1.2 s, one after a second to the nanosecond (not slow), answers captured before their "
    "requests, an answer that cannot be meant for the request behind it, a clock that jumps back."
)
def timing(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    for number, milliseconds in ((1, 1_200), (2, 1_000)):
        talk.send(CLIENT, dt(read_bytes(number, 2)))
        case.pause(milliseconds - 0.5)
        talk.send(SERVER, dt(values(number, b"\x00\x01")))
        case.pair(READ)
    case.find("transaction.slow")
    # Captured in the wrong order, as with a queue for each direction: directly, and with other packets between.
    request, answer = talk.make(CLIENT, dt(read_bytes(3, 2))), talk.make(SERVER, dt(values(3, b"\x00\x03")))
    case.put(answer, request)
    requests = [talk.make(CLIENT, dt(read_bytes(number, 2))) for number in (4, 5, 6)]
    answers = [talk.make(SERVER, dt(values(number, b"\x00\x04"))) for number in (4, 5, 6)]
    case.put(*answers, *requests)
    case.pair(*[READ] * 4)
    case.find("transaction.reordered", 4)
    # An answer to a request that was not captured, then a request with its reference: the answer does not acknowledge the
    # request.
    talk.send(SERVER, dt(values(7, b"\xff\xff")))
    case.orphan(READ)
    case.find("transaction.orphan")
    talk.exchange(READ, read_bytes(7, 2), values(7, b"\x00\x07"))
    # Five milliseconds back between a request and its answer.
    talk.send(CLIENT, dt(read_bytes(8, 2)))
    case.pause(-5)
    talk.send(SERVER, dt(values(8, b"\x00\x08")))
    case.pair(READ)
    case.find("capture.time_backwards")
    talk.poll(2)
    case.pause(1_500)
    talk.close()
    case.tshark_shows(19, "a request behind its own acknowledgement is a retransmission to it")


@crafts("S7 on other ports, on port 102 of the client, on port 102 at both ends (CPU to CPU).")
def other_ports(case: Case) -> None:
    case.ports = [102, 2000, 10102, 49200]
    for client_port, port in ((49152, 2000), (49153, 10102), (49154, 49200)):
        talk = Talk(case, client_port=client_port, port=port)
        talk.begin()
        talk.poll(2)
        talk.close()
        case.find("session.unusual_port")
    for client_port, port in ((102, 49200), (102, 102)):
        talk = Talk(case, client_port=client_port, port=port)
        talk.begin()
        talk.poll(2)
        talk.close()
