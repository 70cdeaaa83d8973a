"""TPKT and COTP: fragments, refusals, every TPDU, and headers that are wrong."""

from __future__ import annotations

from collections.abc import Callable

from captures.craft.case import Case, crafts
from captures.craft.pdus import READ, SETUP, WRITE, cc, cr, dt, pattern, read_bytes, setup, values, write, written
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.layers import (
    COTP,
    COTP_AK,
    COTP_CC,
    COTP_CR,
    COTP_DC,
    COTP_DR,
    COTP_EA,
    COTP_ED,
    COTP_ER,
    COTP_RJ,
    TPKT,
    COTP_AK_Extended,
    COTP_DT_Extended,
    COTP_DT_Normal,
    COTP_EA_Extended,
    COTP_ED_Extended,
    COTP_ED_Normal,
    COTP_Parameter,
    COTP_RJ_Extended,
    COTP_Unknown,
)

CALLING = COTP_Parameter.calling("01.00")
SIZE = COTP_Parameter.tpdu_size(1024)
REFS = (0x0011, 0x0022)
"""References of client and server."""


def tpkt(tpdu: COTP) -> bytes:
    """A TPKT with a TPDU."""
    return bytes(TPKT() / tpdu)


def framed(content: bytes) -> bytes:
    """A TPKT with any octets in it."""
    return b"\x03\x00" + (4 + len(content)).to_bytes(2, "big") + content


@crafts(
    "COTP fragments with something in them: a PDU length of 960 over a TPDU size of 512, in both directions at "
    "once, cut inside the S7 header, with empty DTs between and at the end, TPDU numbers counted (as PLC4X does), "
    "an empty TSDU."
)
def cotp_fragments(case: Case) -> None:
    case.find("security.write")
    talk = Talk(case)
    talk.begin(tpdu_size=512, pdu_length=960)
    most = 512 - 3

    def halves(message: bytes, *cuts: int) -> list[bytes]:
        parts = [message[start:end] for start, end in zip((0, *cuts), (*cuts, len(message)), strict=True)]
        return [*(dt(part, end=False) for part in parts[:-1]), dt(parts[-1])]

    # A write in two DTs, acknowledged as Siemens stacks do.
    for part in halves(write(1, pattern(900)), most):
        talk.send(CLIENT, part)
    talk.send(SERVER, dt(end=False))
    talk.send(SERVER, dt(written(1)))
    talk.send(CLIENT, dt(end=False))
    case.find("cotp.empty_dt")
    case.pair(WRITE)
    # A read whose answer comes in two DTs, in one segment.
    talk.send(CLIENT, dt(read_bytes(2, 900)))
    talk.send(SERVER, b"".join(halves(values(2, pattern(900)), most)))
    talk.send(CLIENT, dt(end=False))
    case.pair(READ)
    # Both directions at once: the answer to one job and the next job, fragment by fragment.
    talk.send(CLIENT, dt(read_bytes(3, 900)))
    answer, request = halves(values(3, pattern(900)), most), halves(write(4, pattern(900)), most)
    for side, part in ((SERVER, answer[0]), (CLIENT, request[0]), (SERVER, answer[1]), (CLIENT, request[1])):
        talk.send(side, part)
    talk.send(SERVER, dt(written(4)))
    case.pair(READ, WRITE)
    # Cut inside the S7 header and inside the parameters; an empty DT in the middle; the end in an empty DT.
    for number, cuts in enumerate(((1,), (9, 12), (5, 5, 20), (24,)), 5):
        for part in halves(read_bytes(number, 2), *cuts):
            talk.send(CLIENT, part)
        talk.send(SERVER, dt(values(number, b"\x00\x05")))
        case.pair(READ)
    # TPDU numbers.
    message = read_bytes(9, 2)
    talk.send(CLIENT, dt(message[:10], end=False, number=9))
    talk.send(CLIENT, dt(message[10:], number=10))
    talk.send(SERVER, dt(values(9, b"\x00\x09"), number=127))
    case.find("cotp.tpdu_nr", 2)
    case.pair(READ)
    # An empty TSDU is legal and says nothing.
    talk.send(CLIENT, dt())
    talk.poll()
    talk.close()
    # CR and CC; DTs: one for each PDU, one more for each further fragment, four empty ones that begin nothing, the empty TSDU.
    fragments = 1 + 1 + 1 + 1 + (1 + 2 + 3 + 1) + 1
    case.table("tpdus", CR=1, CC=1, DT=case.counts["s7_pdus"] + fragments + 3 + 1)
    case.table("tsdus", s7comm=case.counts["s7_pdus"], empty=1)


@crafts(
    "Connect requests that are refused: by DR (no such TSAP, congestion, negotiation failed, a reason without a "
    "name) and by ER, each before the TCP connection is closed."
)
def cotp_refused(case: Case) -> None:
    refusals: list[tuple[COTP, str]] = [
        (COTP_DR(dst_ref=1, reason=3), "cotp.refused"),
        (COTP_DR(dst_ref=1, reason=1, parameters=[COTP_Parameter(code=0xE0, value=b"full")]), "cotp.refused"),
        (COTP_DR(dst_ref=1, reason=0x82), "cotp.refused"),
        (COTP_DR(dst_ref=1, reason=0x86), "cotp.refused"),
        (COTP_ER(dst_ref=1, cause=3, parameters=[COTP_Parameter(code=0xC1, value=cr()[4:14])]), "cotp.error"),
    ]
    for place, (refusal, slug) in enumerate(refusals):
        talk = Talk(case, client_port=49152 + place)
        talk.open()
        talk.send(CLIENT, cr(called="01.1f"))
        talk.send(SERVER, tpkt(refusal))
        talk.close(SERVER)
        case.find(slug)
    case.table("tpdus", CR=5, DR=4, ER=1)


@crafts(
    "The TPDUs nobody sends to a PLC: class 2 in normal and extended formats with DT, AK, RJ, ED, EA, the "
    "expedited data of RFC 1006 in class 0; DR and DC at the end. S7 inside is S7."
)
def cotp_tpdus(case: Case) -> None:
    normal = [
        (SERVER, COTP_AK(dst_ref=REFS[CLIENT], next_nr=6, credit=3)),
        (SERVER, COTP_RJ(dst_ref=REFS[CLIENT], next_nr=6)),
        (CLIENT, COTP_ED_Normal(dst_ref=REFS[SERVER]) / b"urgent"),
        (SERVER, COTP_EA(dst_ref=REFS[CLIENT])),
    ]
    extended = [
        (SERVER, COTP_AK_Extended(dst_ref=REFS[CLIENT], next_nr=0x12346, credit_extended=300)),
        (SERVER, COTP_RJ_Extended(dst_ref=REFS[CLIENT], next_nr=0x12346)),
        (CLIENT, COTP_ED_Extended(dst_ref=REFS[SERVER]) / b"urgent"),
        (SERVER, COTP_EA_Extended(dst_ref=REFS[CLIENT])),
    ]
    speak_class_2(Talk(case), 1, lambda to: COTP_DT_Normal(dst_ref=REFS[to], tpdu_nr=5), normal)
    speak_class_2(
        Talk(case, client_port=49153), 2, lambda to: COTP_DT_Extended(dst_ref=REFS[to], tpdu_nr=0x12345), extended
    )
    talk = Talk(case, client_port=49154)
    talk.begin()
    talk.send(CLIENT, tpkt(COTP_ED() / b"urgent"))
    talk.poll()
    leave(talk)
    case.table("tpdus", CR=3, CC=3, DT=2 * 6 + 4, AK=2, RJ=2, ED=3, EA=2, DR=3, DC=3)


def speak_class_2(talk: Talk, options: int, dt_to: Callable[[int], COTP], others: list[tuple[int, COTP]]) -> None:
    """A connection of class 2: Setup, a read, the other TPDUs by side, a read; ``dt_to`` gives the DT to a side."""

    def exchange(function: int, request: bytes, answer: bytes) -> None:
        talk.send(CLIENT, bytes(TPKT() / dt_to(SERVER) / request))
        talk.send(SERVER, bytes(TPKT() / dt_to(CLIENT) / answer))
        talk.case.pair(function)

    talk.open()
    alternative = COTP_Parameter(code=0xC7, value=b"\x00")
    parameters = [SIZE, CALLING, alternative]
    talk.send(CLIENT, tpkt(COTP_CR(src_ref=REFS[CLIENT], class_=2, options=options, parameters=parameters)))
    confirm = COTP_CC(dst_ref=REFS[CLIENT], src_ref=REFS[SERVER], class_=2, options=options, parameters=[SIZE, CALLING])
    talk.send(SERVER, tpkt(confirm))
    exchange(SETUP, setup(0, 480, 1, 1), setup(0, 480, 1, 1, answer=True))
    exchange(READ, read_bytes(1, 2), values(1, b"\x00\x01"))
    for side, tpdu in others:
        talk.send(side, tpkt(tpdu))
    exchange(READ, read_bytes(2, 2), values(2, b"\x00\x02"))
    leave(talk)


def leave(talk: Talk) -> None:
    """DR and DC, then the end."""
    talk.send(CLIENT, tpkt(COTP_DR(dst_ref=REFS[SERVER], src_ref=REFS[CLIENT], reason=0x80)))
    talk.send(SERVER, tpkt(COTP_DC(dst_ref=REFS[CLIENT], src_ref=REFS[SERVER])))
    talk.close()


@crafts(
    "COTP headers that contradict themselves, a CC nobody asked for, a second CR, DTs longer than negotiated, "
    "messages that are never finished. The traffic around goes on."
)
def cotp_faults(case: Case) -> None:
    case.find("security.write")
    contradict(case)
    connect_wrongly(case)
    exceed(case)


def contradict(case: Case) -> None:
    """Headers that are wrong."""
    talk = Talk(case)
    talk.begin()
    faults = (
        framed(b"\x00\xf0\x80"),  # LI 0
        framed(b"\xff\xf0\x80" + bytes(9)),  # LI 255
        framed(b"\x20\xf0\x80" + bytes(9)),  # LI beyond the TPKT
        tpkt(COTP_Unknown(type=3, octets=b"\x00\x00\x00")),  # no TPDU has this type
        framed(b"\x03\xe0\x00\x00"),  # a CR of which only the beginning is there
    )
    for octets in faults:
        talk.send(CLIENT, octets)
        talk.poll()
    case.find("cotp.malformed", len(faults))
    talk.close()
    # A parameter of a CR that is longer than the CR.
    talk = Talk(case, client_port=49153)
    talk.open()
    broken = COTP_Parameter(code=0xC1, length=20, value=b"\x01\x00")
    talk.send(CLIENT, tpkt(COTP_CR(src_ref=1, parameters=[SIZE, broken])))
    case.find("cotp.malformed")
    talk.send(SERVER, cc())
    talk.setup()
    talk.poll()
    talk.close()


def connect_wrongly(case: Case) -> None:
    # A CC without a CR, to a client that begins with something else.
    talk = Talk(case, client_port=49154)
    talk.open()
    talk.send(CLIENT, dt(end=False))
    talk.send(SERVER, cc())
    case.find("cotp.answer_without_request")
    case.find("cotp.bad_start")
    talk.setup()
    talk.poll()
    talk.close()
    # A second CR before the CC.
    talk = Talk(case, client_port=49155)
    talk.open()
    talk.send(CLIENT, cr(called="01.00"))
    talk.connect()
    case.find("cotp.repeated_request")
    talk.setup()
    talk.poll()
    talk.close()


def exceed(case: Case) -> None:
    # TPDUs of 524 and 513 octets where 512 were negotiated, one of exactly 512.
    talk = Talk(case, client_port=49156)
    talk.begin(tpdu_size=512, pdu_length=960)
    for number, size in ((1, 524), (2, 513), (3, 512)):
        octets = pattern(size - 3 - 28)
        talk.exchange(WRITE, write(number, octets), written(number))
    case.find("cotp.size_exceeded", 2)
    talk.close()
    # Messages whose last fragment never comes.
    talk = Talk(case, client_port=49157)
    talk.begin()
    talk.send(CLIENT, dt(write(1, pattern(100))[:50], end=False))
    talk.send(SERVER, dt(values(2, pattern(100))[:50], end=False))
    case.find("cotp.unfinished_tsdu", 2)
    talk.close()


@crafts(
    "A sender that never sets the end bit: 66 KB of fragments. What it sends up to its end bit is dropped, then "
    "all is well."
)
def cotp_endless(case: Case) -> None:
    talk = Talk(case)
    talk.begin(tpdu_size=2048)
    piece = 1400
    for _ in range(48):
        talk.send(CLIENT, dt(bytes(piece), end=False))
    talk.send(CLIENT, dt(b"\x00"))
    case.find("cotp.tsdu_too_long")
    talk.poll(2)
    talk.close()


@crafts(
    "TPKT lengths of 0 to 6, version 4, a reserved octet that is not 0 (odd, not wrong), garbage between TPKTs: "
    "in a segment of its own, before and behind a TPKT in one segment. What follows is found again. One "
    "connection ends inside a TPKT."
)
def tpkt_faults(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    misstate(case, talk)
    litter(case, talk)
    # The reserved octet.
    request = dt(read_bytes(5, 2))
    talk.send(CLIENT, request[:1] + b"\x01" + request[2:])
    case.find("tpkt.reserved")
    talk.send(SERVER, dt(values(5, b"\x00\x05")))
    case.pair(READ)
    talk.close()
    # The connection ends inside a request, and inside a header.
    talk = Talk(case, client_port=49153)
    talk.begin()
    talk.poll()
    talk.send(CLIENT, dt(read_bytes(6, 2))[:20])
    talk.send(SERVER, dt(values(6, b"\x00\x06"))[:3])
    case.find("tpkt.unfinished", 2)
    talk.close()
    case.tshark_shows(33, "it finds nothing behind garbage in the same segment, nor the TPKT behind one of length 4")


def misstate(case: Case, talk: Talk) -> None:
    """Lengths that hold no TPDU."""
    for length in range(7):
        header = b"\x03\x00" + length.to_bytes(2, "big")
        octets = header + b"\x02\xf0"[: max(0, length - 4)]
        talk.send(CLIENT, octets)
        case.skip(len(octets))
        case.find("tpkt.bad_length")
        talk.poll()


def litter(case: Case, talk: Talk) -> None:
    """Octets that belong to no TPKT."""
    # Garbage in a segment of its own, then between two TPKTs, and at the end of a segment.
    line = b"GET / HTTP/1.0\r\n\r\n"
    talk.send(CLIENT, line)
    case.skip(len(line))
    case.find("tpkt.garbage")
    talk.poll()
    first, second = dt(read_bytes(1, 2)), dt(read_bytes(2, 2))
    talk.send(CLIENT, first + line + second)
    case.skip(len(line))
    case.find("tpkt.garbage")
    talk.send(SERVER, dt(values(1, b"\x00\x01")) + b"\xff" + dt(values(2, b"\x00\x02")))
    case.skip(1)
    case.find("tpkt.garbage")
    case.pair(READ, READ)
    talk.poll()
    talk.send(CLIENT, dt(read_bytes(3, 2)) + bytes(5))
    case.skip(5)
    case.find("tpkt.garbage")
    talk.send(SERVER, dt(values(3, b"\x00\x03")))
    case.pair(READ)
    talk.poll()
    # Another version, with a request in it that nobody can rely on.
    other = b"\x04" + dt(read_bytes(4, 2))[1:]
    talk.send(CLIENT, other)
    case.skip(len(other))
    case.find("tpkt.garbage")
    talk.poll()
