"""Real TCP: cut anywhere, out of order, duplicated, overlapping, wrapped, begun in the middle, begun again."""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.pdus import READ, cc, cr, dt, pattern, read_bytes, setup, values
from captures.craft.talk import CLIENT, MODULUS, SERVER, Talk


@crafts(
    "TPKTs across segments: every octet in one of its own, the header cut after each octet, several in one segment."
)
def segments(case: Case) -> None:
    talk = Talk(case)
    talk.open()
    connect, confirm = cr(), cc()
    talk.send(CLIENT, connect, *range(1, len(connect)))
    talk.send(SERVER, confirm, 3)
    request, answer = dt(setup(0, 480, 8, 8)), dt(setup(0, 480, 8, 8, answer=True))
    talk.send(CLIENT, request, 1, 2, 3, 4)
    talk.send(SERVER, answer, 2)
    case.pair(0xF0)
    for cut in range(1, 12):
        talk.send(CLIENT, dt(read_bytes(cut, 2)), cut)
        talk.send(SERVER, dt(values(cut, b"\x00\x01")), 12 - cut)
        case.pair(READ)
    request, answer = dt(read_bytes(20, 3)), dt(values(20, b"\x01\x02\x03"))
    talk.send(CLIENT, request, *range(1, len(request)))
    talk.send(SERVER, answer, *range(1, len(answer)))
    case.pair(READ)
    # Four requests in one segment, their answers in another.
    talk.send(CLIENT, b"".join(dt(read_bytes(number, 2)) for number in range(30, 34)))
    talk.send(SERVER, b"".join(dt(values(number, pattern(2, number))) for number in range(30, 34)))
    case.pair(*[READ] * 4)
    # Four requests and four answers cut in the middle of TPKTs: inside headers and inside PDUs.
    stream = b"".join(dt(read_bytes(number, 30)) for number in range(40, 44))
    talk.send(CLIENT, stream, 36, 31 * 3 + 1)
    stream = b"".join(dt(values(number, pattern(30, number))) for number in range(40, 44))
    talk.send(SERVER, stream, 3, 60, 110, 111)
    case.pair(*[READ] * 4)
    # A long answer in three segments; its end comes together with the whole next answer.
    talk.send(CLIENT, dt(read_bytes(50, 440)) + dt(read_bytes(51, 2)))
    talk.send(SERVER, dt(values(50, pattern(440))) + dt(values(51, b"\x00\x02")), 200, 400)
    case.pair(READ, READ)
    talk.close()
    case.tshark_shows(
        43,
        "until a segment begins with a whole TPKT header, it takes shorter ones for no TPKT: Setup, its answer, the first read",
    )


@crafts("Segments out of order: requests, answers, pieces of one TPKT, behind their own acknowledgement, behind a FIN.")
def disorder(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    # Two requests in reverse order, then their answers.
    first, second = (talk.make(CLIENT, dt(read_bytes(number, 2))) for number in (1, 2))
    case.put(second, first)
    first, second = (talk.make(SERVER, dt(values(number, b"\x00\x01"))) for number in (1, 2))
    case.put(second, first)
    case.pair(READ, READ)
    # Three pieces of one answer: last, first, middle.
    talk.send(CLIENT, dt(read_bytes(3, 300)))
    answer = dt(values(3, pattern(300)))
    pieces = [talk.make(SERVER, answer[start : start + 120]) for start in range(0, len(answer), 120)]
    case.put(pieces[2], pieces[0], pieces[1])
    case.pair(READ)
    # Six requests backwards, all answered in one segment.
    case.put(*reversed([talk.make(CLIENT, dt(read_bytes(number, 2))) for number in range(10, 16)]))
    talk.send(SERVER, b"".join(dt(values(number, b"\x00\x03")) for number in range(10, 16)))
    case.pair(*[READ] * 6)
    # An answer captured only after the client acknowledged it and went on.
    talk.send(CLIENT, dt(read_bytes(20, 2)))
    late = talk.make(SERVER, dt(values(20, b"\x00\x04")))
    talk.ack(CLIENT)
    talk.send(CLIENT, dt(read_bytes(21, 2)))
    talk.send(SERVER, dt(values(21, b"\x00\x05")))
    case.put(late)
    case.pair(READ, READ)
    talk.poll(3)
    # The last answer is captured after the FIN that follows it.
    talk.send(CLIENT, dt(read_bytes(30, 2)))
    late = talk.make(SERVER, dt(values(30, b"\x00\x06")))
    end = talk.make(SERVER, flags="FA")
    case.put(end, late)
    case.pair(READ)
    case.put(talk.make(CLIENT, flags="FA"))
    talk.ack(SERVER)
    case.tshark_shows(22, "it puts nothing in order (its default): what comes late it calls a retransmission")


@crafts(
    "Octets that come twice with the same content: duplicates at once and late, overlaps of every kind, keep- "
    "alives, a window probe, a connection captured twice."
)
def retransmissions(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    repeat(case, talk)
    repeat_out_of_turn(case, talk)
    probe(case, talk)
    talk.close()
    double(case)
    case.tshark_shows(
        24,
        "it drops a segment that begins with old octets, with the new ones behind them; and it puts nothing in order",
    )


def repeat(case: Case, talk: Talk) -> None:
    # The same segment twice in a row, as a mirror of two ports shows it; then an answer again, one exchange later.
    request = talk.make(CLIENT, dt(read_bytes(1, 2)))
    answer = talk.make(SERVER, dt(values(1, b"\x00\x01")))
    case.put(request, request, answer, answer)
    case.pair(READ)
    talk.poll()
    case.put(answer)
    # The end of the last segment again, followed by a new request: in one segment, then cut elsewhere.
    old = dt(read_bytes(2, 4))
    talk.send(CLIENT, old)
    talk.send(SERVER, dt(values(2, b"\x00\x01\x00\x02")))
    case.pair(READ)
    new = dt(read_bytes(3, 2))
    here = talk.seq[CLIENT]
    case.put(talk.make(CLIENT, old[-10:] + new, seq=here - 10))
    talk.seq[CLIENT] = here + len(new)
    talk.send(SERVER, dt(values(3, b"\x00\x03")))
    case.pair(READ)
    # Sent in two segments, repeated in one; sent in one, repeated in two.
    here = talk.seq[CLIENT]
    request_octets = dt(read_bytes(4, 20))
    talk.send(CLIENT, request_octets, 15)
    case.put(talk.make(CLIENT, request_octets, seq=here))
    here = talk.seq[SERVER]
    answer_octets = dt(values(4, pattern(20)))
    talk.send(SERVER, answer_octets)
    case.put(talk.make(SERVER, answer_octets[:20], seq=here), talk.make(SERVER, answer_octets[20:], seq=here + 20))
    case.pair(READ)


def repeat_out_of_turn(case: Case, talk: Talk) -> None:
    # A segment that comes too early appears twice, then bit by bit together with the octets before it.
    here = talk.seq[CLIENT]
    stream = dt(read_bytes(5, 2)) + dt(read_bytes(6, 2))
    ahead = talk.make(CLIENT, stream[31:], seq=here + 31)
    case.put(ahead, ahead, talk.make(CLIENT, stream[25:40], seq=here + 25), talk.make(CLIENT, stream[:35], seq=here))
    talk.seq[CLIENT] = here + len(stream)
    talk.send(SERVER, dt(values(5, b"\x00\x05")) + dt(values(6, b"\x00\x06")))
    case.pair(READ, READ)


def probe(case: Case, talk: Talk) -> None:
    # Keep-alives: one octet before the next, with any value, or no octet; and the answer.
    for octets in (b"\x00", b"\xff", b""):
        case.pause(2_000)
        case.put(talk.make(CLIENT, octets, flags="A", seq=talk.seq[CLIENT] - 1))
        talk.ack(SERVER)
    # A window probe: the first octet of the next data, not accepted, then the whole.
    request_octets = dt(read_bytes(7, 2))
    case.put(talk.make(CLIENT, request_octets[:1], flags="A", seq=talk.seq[CLIENT]))
    talk.ack(SERVER)
    talk.send(CLIENT, request_octets)
    talk.send(SERVER, dt(values(7, b"\x00\x07")))
    case.pair(READ)


def double(case: Case) -> None:
    """A connection of which every packet was captured twice."""
    start = len(case.packets)
    twice = Talk(case, client_port=49153, isn=(5_000, 6_000))
    twice.begin()
    twice.poll(3)
    twice.close()
    doubled = [packet.octets for packet in case.packets[start:] for _ in range(2)]
    del case.packets[start:]
    case.counts["packets"] = start
    case.now_ns = case.packets[-1].time_ns
    case.put(*doubled)


@crafts(
    "Retransmissions that carry other octets than the first copy, whole and overlapping. The first copy counts: "
    "every other copy asks for a PLC stop."
)
def conflicts(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    stop = dt(read_bytes(0xBAD, 2)).replace(b"\x04\x01\x12", b"\x29\x01\x12")
    # A whole copy.
    here = talk.seq[CLIENT]
    talk.send(CLIENT, dt(read_bytes(1, 2)))
    case.put(talk.make(CLIENT, stop, seq=here))
    case.find("stream.conflict")
    talk.send(SERVER, dt(values(1, b"\x00\x01")))
    case.pair(READ)
    # A copy of the answer, after the answer was taken.
    talk.send(CLIENT, dt(read_bytes(2, 2)))
    here = talk.seq[SERVER]
    talk.send(SERVER, dt(values(2, b"\x00\x02")))
    case.pair(READ)
    case.put(talk.make(SERVER, dt(values(2, b"\xff\xff")), seq=here))
    case.find("stream.conflict")
    # The second half of a request overlaps the first with different octets; its new octets belong to the stream.
    request = dt(read_bytes(3, 2))
    here = talk.seq[CLIENT]
    case.put(
        talk.make(CLIENT, request[:20], seq=here),
        talk.make(CLIENT, b"\xee" * 5 + request[20:], seq=here + 15),
    )
    talk.seq[CLIENT] = here + len(request)
    case.find("stream.conflict")
    talk.send(SERVER, dt(values(3, b"\x00\x03")))
    case.pair(READ)
    # Two different copies that come too early, then the missing octets before them.
    stream = dt(read_bytes(4, 2)) + dt(read_bytes(5, 2))
    here = talk.seq[CLIENT]
    case.put(
        talk.make(CLIENT, stream[31:], seq=here + 31),
        talk.make(CLIENT, stop, seq=here + 31),
        talk.make(CLIENT, stream[:31], seq=here),
    )
    talk.seq[CLIENT] = here + len(stream)
    case.find("stream.conflict")
    talk.send(SERVER, dt(values(4, b"\x00\x04")) + dt(values(5, b"\x00\x05")))
    case.pair(READ, READ)
    talk.close()
    case.tshark_shows(10, "it puts nothing in order (its default): what comes late it calls a retransmission")


@crafts(
    "Sequence numbers that wrap at 2**32 in both directions: inside a TPKT, in disorder, in a retransmission, at "
    "the SYN."
)
def sequence_wrap(case: Case) -> None:
    talk = Talk(case, isn=(MODULUS - 120, MODULUS - 100))
    talk.begin()
    talk.poll(3, 60)
    talk.close()
    # The sequence number wraps inside a request that comes out of order and twice.
    request = dt(read_bytes(1, 2))
    talk = Talk(case, client_port=49153, isn=(MODULUS - 1 - len(cr()) - 25 - 10, MODULUS - 60))
    talk.begin()
    here = talk.seq[CLIENT]
    pieces = [
        talk.make(CLIENT, request[:5], seq=here),
        talk.make(CLIENT, request[5:15], seq=here + 5),
        talk.make(CLIENT, request[15:], seq=here + 15),
    ]
    talk.seq[CLIENT] = (here + len(request)) % MODULUS
    case.put(pieces[2], pieces[0], pieces[2], pieces[1], pieces[0])
    talk.send(SERVER, dt(values(1, b"\x00\x01")))
    case.pair(READ)
    talk.poll(2)
    talk.close()
    # SYN and SYN/ACK have the last numbers there are.
    talk = Talk(case, client_port=49154, isn=(MODULUS - 1, MODULUS - 1))
    talk.begin()
    talk.poll()
    talk.close()
    case.tshark_shows(19, "it puts nothing in order (its default): what comes late it calls a retransmission")


@crafts(
    "The capture begins inside TPKTs: the end of an answer nobody saw begin, an answer whose request nobody saw, "
    "then ordinary traffic. On port 102 and on another one."
)
def mid_packet(case: Case) -> None:
    case.ports = [102, 2102]
    for port in case.ports:
        talk = Talk(case, port=port)
        case.count(connections=1)
        # The lost octets also look like the beginning of a TPKT, but of one without a TPDU.
        tail = dt(values(0, b"\x03\x00\x00\x40\xff\xff" + pattern(74)))[20:]
        talk.send(SERVER, tail)
        case.skip(len(tail))
        talk.ack(CLIENT)
        talk.send(SERVER, dt(values(9, b"\x00\x01")))
        case.orphan(READ)
        talk.poll(4)
        talk.close()
    case.find("session.unusual_port")


@crafts(
    "One pair of addresses and ports for six connections: after FIN, after RST from either end, while the one "
    "before is open, with SYN and SYN/ACK sent twice, after refused attempts."
)
def reuse(case: Case) -> None:
    number = 0

    def again() -> Talk:
        nonlocal number
        number += 1
        return Talk(case, isn=(number * 77_777_777, MODULUS - number * 88_888_888))

    talk = again()
    talk.begin()
    talk.poll(2)
    talk.close()
    # At once after FIN; ends with RST.
    talk = again()
    talk.begin()
    talk.poll()
    case.put(talk.make(CLIENT, flags="RA"))
    talk = again()
    talk.begin()
    talk.poll()
    case.put(talk.make(SERVER, flags="R"))
    # Open, with an open request, when the next SYN comes.
    talk = again()
    talk.begin()
    talk.send(CLIENT, dt(read_bytes(1, 2)))
    case.unanswered(READ, "connection_closed")
    case.find("transaction.unanswered")
    case.find("stream.reused")
    # The same reference in the next connection is another request. The SYN and the SYN/ACK come twice.
    talk = again()
    syn, syn_ack = talk.make(CLIENT, flags="S"), talk.make(SERVER, flags="SA")
    case.put(syn, syn, syn_ack, syn_ack)
    talk.ack(CLIENT)
    case.count(connections=1)
    talk.connect()
    talk.setup()
    talk.exchange(READ, read_bytes(1, 2), values(1, b"\x00\x01"))
    talk.close(SERVER)
    # Three failed connection attempts; the last one is answered.
    for _ in range(3):
        talk = again()
        case.put(talk.make(CLIENT, flags="S"), talk.make(SERVER, flags="RA"))
        case.find("stream.refused")
    talk = again()
    talk.begin()
    talk.poll(2)
    talk.close()


@crafts(
    "Connections taken up again whose TCP close and handshake were not captured: a CR after data begins another "
    "connection, with sequence numbers that go on, jump ahead, or fall back."
)
def reuse_without_syn(case: Case) -> None:
    for place, jump in enumerate((0, 600_000_000, -600_000_000)):
        talk = Talk(case, client_port=49152 + place, isn=(700_000_000, 1_900_000_000))
        talk.begin()
        talk.poll(2)
        talk.send(CLIENT, dt(read_bytes(1, 2)))
        case.unanswered(READ, "connection_closed")
        case.find("transaction.unanswered")
        talk.seq = [talk.seq[CLIENT] + jump, talk.seq[SERVER] + 2 * jump]
        if jump:
            case.find("stream.reused")
        talk.connect()
        case.count(connections=1)
        talk.setup()
        talk.exchange(READ, read_bytes(1, 2), values(1, b"\x00\x01"))
        talk.poll(10)
        case.pause(100)
        talk.poll(2)
        talk.close()
    case.tshark_shows(77, "it takes a connection whose sequence numbers fell back for retransmissions")


@crafts(
    "How connections end: half-closed and still answered, FIN twice, RST in the middle of a request, RST from "
    "elsewhere."
)
def endings(case: Case) -> None:
    # The client closes its half; both requests are still answered.
    talk = Talk(case)
    talk.begin()
    talk.send(CLIENT, dt(read_bytes(1, 2)) + dt(read_bytes(2, 2)))
    end = talk.make(CLIENT, flags="FA")
    case.put(end, end)
    talk.send(SERVER, dt(values(1, b"\x00\x01")))
    talk.send(SERVER, dt(values(2, b"\x00\x02")))
    case.pair(READ, READ)
    case.put(talk.make(SERVER, flags="FA"))
    talk.ack(CLIENT)
    # The server resets while a request is open.
    talk = Talk(case, client_port=49153)
    talk.begin()
    talk.poll()
    talk.send(CLIENT, dt(read_bytes(1, 2)))
    case.unanswered(READ, "connection_closed")
    case.find("transaction.unanswered")
    case.put(talk.make(SERVER, flags="R"))
    # A reset with an impossible sequence number, then normal traffic.
    talk = Talk(case, client_port=49154)
    talk.begin()
    case.put(talk.make(SERVER, flags="R", seq=talk.seq[SERVER] + 1_000_000_000))
    case.find("stream.reset_ignored")
    case.table("ignored", reset_ignored=1)
    talk.poll(2)
    talk.close()
    # The capture ends with a request open for a tenth of a second: too short for a judgement.
    talk = Talk(case, client_port=49155)
    talk.begin()
    talk.send(CLIENT, dt(read_bytes(1, 2)))
    case.unanswered(READ, "capture_ended")
    case.pause(100)
    talk.ack(SERVER)
    case.tshark_shows(
        18, "it believes the reset with the absurd sequence number, and calls the two answers behind it retransmissions"
    )
