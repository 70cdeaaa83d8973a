"""Endless streams, each made to overload one part of an analyzer. Memory and time per packet must stay flat on all of them.

A stream is a generator of (time in ns, frame); it never ends and depends only on its arguments. ``size`` is the user data of a
hostile segment: small by default, 1400 for streams of MTU-size frames.
"""

from __future__ import annotations

import struct
from random import Random
from typing import TYPE_CHECKING, Final

from benchmarks.frames import ACK, FIN, PSH, RST, SYN, Host, Sender, ipv4
from benchmarks.pdus import ACK_DATA, JOB, READ, answer, connect_tpdu, request, setup_param, tpkt

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Stream = Iterator[tuple[int, bytes]]

_EPOCH_NS: Final = 1_709_528_767_000_000_000
_STEP_NS: Final = 20_000
_PORTS: Final = 50_000
_READ_ITEM: Final = b"\x12\x0a\x10\x02\x00\x04\x00\x01\x84\x00\x00\x00"
_READ_PARAM: Final = bytes((READ, 1)) + _READ_ITEM
_READ_DATA: Final = b"\xff\x04\x00\x20\x11\x22\x33\x44"


def _clock() -> Iterator[int]:
    """Yield times 20 µs apart: 50,000 packets a second, so that timeouts alone do not bound anything."""
    time_ns = _EPOCH_NS
    while True:
        yield time_ns
        time_ns += _STEP_NS


def _plc() -> Host:
    """Return the PLC of a stream; it counts its packets, so each stream has its own."""
    return Host(0x0A0A0102, b"\x00\x1b\x1b")


def _pair(number: int, plc: Host) -> tuple[Sender, Sender]:
    """Return the two directions of the connection ``number``: a new client port each time, then a new client address."""
    client = Host(0x0A800000 + number // _PORTS)
    port = 1025 + number % _PORTS
    return Sender(client, port, plc, 102, number * 2654435761 & 0xFFFFFFFF), Sender(plc, 102, client, port, 7 * number)


class _Talk:
    """A connection of a stream: sends in turn and keeps track of the numbers."""

    def __init__(self, number: int, plc: Host) -> None:
        self.client, self.plc = _pair(number, plc)

    def hello(self) -> Iterator[bytes]:
        """Yield the handshakes of TCP, COTP and S7."""
        client, plc = self.client, self.plc
        yield client.segment(SYN, client.seq, 0, b"")
        client.seq = client.seq + 1 & 0xFFFFFFFF
        yield plc.segment(SYN | ACK, plc.seq, client.seq, b"")
        plc.seq = plc.seq + 1 & 0xFFFFFFFF
        yield client.segment(ACK, client.seq, plc.seq, b"")
        yield self.say(client, plc, connect_tpdu(0xE0, 0, 1, 0x0A, b"\x01\x00", b"\x01\x02"))
        yield self.say(plc, client, connect_tpdu(0xD0, 1, 2, 0x0A, b"\x01\x00", b"\x01\x02"))
        yield self.say(client, plc, tpkt(request(JOB, 0, setup_param(8, 8, 480))))
        yield self.say(plc, client, tpkt(answer(ACK_DATA, 0, setup_param(8, 8, 480))))

    def say(self, sender: Sender, other: Sender, payload: bytes) -> bytes:
        """Return one segment with ``payload``."""
        frame = sender.segment(ACK | PSH, sender.seq, other.seq, payload)
        sender.seq = sender.seq + len(payload) & 0xFFFFFFFF
        return frame

    def read(self, number: int) -> Iterator[bytes]:
        """Yield a read and its answer."""
        yield self.say(self.client, self.plc, tpkt(request(JOB, number, _READ_PARAM)))
        yield self.say(self.plc, self.client, tpkt(answer(ACK_DATA, number, bytes((READ, 1)), _READ_DATA)))


def _ordinary(size: int) -> Iterator[bytes]:
    """Short whole connections: handshakes, twelve reads, an orderly end or a reset.

    Hurts analyzers that keep closed connections.
    """
    number = 0
    room = max(4, min(size, 1400) - 60)
    wide = size > 100
    param = bytes((READ, 1)) + b"\x12\x0a\x10\x02" + struct.pack(">H", room) + _READ_ITEM[6:]
    data = b"\xff\x04" + struct.pack(">H", room * 8) + bytes(room)
    host = _plc()
    while True:
        talk = _Talk(number, host)
        client, plc = talk.client, talk.plc
        yield from talk.hello()
        for reference in range(1, 13):
            if wide:
                yield talk.say(client, plc, tpkt(request(JOB, reference, param)))
                yield talk.say(plc, client, tpkt(answer(ACK_DATA, reference, bytes((READ, 1)), data)))
            else:
                yield from talk.read(reference)
        if number % 4:
            yield client.segment(FIN | ACK, client.seq, plc.seq, b"")
            yield plc.segment(FIN | ACK, plc.seq, client.seq + 1 & 0xFFFFFFFF, b"")
            yield client.segment(ACK, client.seq + 1 & 0xFFFFFFFF, plc.seq + 1 & 0xFFFFFFFF, b"")
        else:
            yield client.segment(RST | ACK, client.seq, plc.seq, b"")
        number += 1


def _synflood(size: int) -> Iterator[bytes]:
    """SYN after SYN, each from a new address. Hurts analyzers that make a connection for each."""
    rng = Random(1)
    data = bytes(size) if size > 100 else b""
    plc = _plc()
    while True:
        client = Host(0x0B000000 | rng.getrandbits(24))
        yield Sender(client, rng.randrange(1024, 65536), plc, 102, rng.getrandbits(32)).segment(SYN, 1, 0, data)


def _never_closed(size: int) -> Iterator[bytes]:
    """Connections that begin, read a few times, and stay open for ever. Hurts analyzers that wait for the end."""
    number = 0
    plc = _plc()
    while True:
        talk = _Talk(number, plc)
        yield from talk.hello()
        for reference in range(1, 4 if size <= 100 else 40):
            yield from talk.read(reference)
        number += 1


def _unanswered(size: int) -> Iterator[bytes]:
    """Requests on sixteen connections that are never answered. Hurts analyzers that keep all open requests."""
    plc = _plc()
    talks = [_Talk(number, plc) for number in range(16)]
    for talk in talks:
        yield from talk.hello()
    items = max(1, min(115, size // 12)) if size > 100 else 1
    param = bytes((READ, items)) + _READ_ITEM * items
    number = 0
    while True:
        talk = talks[number % len(talks)]
        yield talk.say(talk.client, talk.plc, tpkt(request(JOB, number // len(talks) & 0xFFFF, param)))
        number += 1


def _half_tpkts(size: int) -> Iterator[bytes]:
    """New connections that each begin a TPKT of 65,000 octets and fall silent.

    Hurts analyzers that keep unfinished messages.
    """
    number = 0
    begun = b"\x03\x00" + (65000).to_bytes(2, "big") + b"\x02\xf0\x80\x32\x01" + bytes(size)
    host = _plc()
    while True:
        client, plc = _pair(number, host)
        yield client.segment(SYN, client.seq, 0, b"")
        yield plc.segment(SYN | ACK, plc.seq, client.seq + 1 & 0xFFFFFFFF, b"")
        yield client.segment(ACK | PSH, client.seq + 1 & 0xFFFFFFFF, plc.seq + 1 & 0xFFFFFFFF, begun)
        number += 1


def _never_ended(size: int) -> Iterator[bytes]:
    """DT after DT without end of TSDU on one connection.

    Hurts analyzers that join them, especially if they start again from the beginning each time.
    """
    talk = _Talk(0, _plc())
    yield from talk.hello()
    piece = tpkt(b"\x32" + bytes(size), 0x00)
    while True:
        yield talk.say(talk.client, talk.plc, piece)


def _holes(size: int) -> Iterator[bytes]:
    """Every second segment is missing and no one acknowledges; now and then the sequence numbers jump far ahead.

    Hurts analyzers that keep or search data.
    """
    plc = _plc()
    talks = [_Talk(number, plc) for number in range(8)]
    for talk in talks:
        yield from talk.hello()
    rng = Random(2)
    pad = bytes(max(0, size - 31)) if size > 100 else b""
    number = 0
    while True:
        for talk in talks:
            number += 1
            piece = tpkt(request(JOB, number & 0xFFFF, _READ_PARAM, pad))
            yield talk.say(talk.client, talk.plc, piece)
            jump = rng.getrandbits(30) if number % 1000 == 0 else len(piece)
            talk.client.seq = talk.client.seq + jump & 0xFFFFFFFF


def _fragments(size: int) -> Iterator[bytes]:
    """IP fragments of datagrams that never become complete: a steady stream of new ones, and one in endless pieces.

    Hurts analyzers that keep or search data.
    """
    rng = Random(3)
    octets = max(8, size - size % 8)
    body = rng.randbytes(octets)
    more = 0x2000
    # The smallest possible pieces give the largest number of them.
    units = octets // 8 if size > 100 else 1
    piece = body[: 8 * units]
    steps = 8_000 // units // 2
    client, plc = Host(0x0A0A0A01), _plc()
    number = 0
    while True:
        number += 1
        source = Host(0x0A900000 + (number >> 16 << 12 | rng.getrandbits(12)))
        yield ipv4(source, plc, 6, body, number & 0xFFFF, more)
        # After ``steps`` pieces the same ones come again, as a repeater or an attacker sends them.
        yield ipv4(client, plc, 6, piece, 7, more | (2 * (number % steps) + 1) * units)


#: Sound requests, so that the faulty answers have requests to answer.
_SOUND: Final = (request(JOB, 5, _READ_PARAM), request(JOB, 6, bytes((READ, 9)) + 9 * _READ_ITEM))
#: Faulty S7 PDUs, each with its fault.
_FAULTY: Final = (
    request(JOB, 1, _READ_PARAM)[:8] + b"\xff\xff" + _READ_PARAM,  # data length beyond the TSDU
    request(JOB, 2, _READ_PARAM)[:6] + b"\x7f\xff\x00\x00" + _READ_PARAM,  # parameter length beyond the TSDU
    request(JOB, 3, bytes((READ, 200)) + _READ_ITEM),  # 200 items claimed, one there
    request(JOB, 4, bytes((READ, 1)) + b"\x12\xff\x10\x02\x00\x04"),  # item length beyond the parameters
    answer(ACK_DATA, 5, bytes((READ, 1)), b"\xff\x04\xff\xff\x11\x22"),  # value length beyond the data
    answer(ACK_DATA, 6, bytes((READ, 9)), b"\xff\x04\x00\x20\x11\x22\x33\x44"),  # nine values claimed, one there
    b"\x32\x01\x00",  # header cut
    b"\x32\x09\x00\x00\x00\x07\x00\x02\x00\x00\x04\x00",  # unknown ROSCTR
    request(7, 8, b"\x00\x01\x12\x09\x11\x44\x01\x00", b"\xff\x09\xff\xff\x00\x11"),  # userdata with false lengths
    request(JOB, 9, _READ_PARAM) + b"\x00\x01\x02",  # octets behind the PDU
)
_FLOODING: Final = 4


def _faulty(size: int) -> Iterator[bytes]:
    """Faulty S7 PDUs in sound TPKTs on four connections, one a segment. Hurts analyzers that write a line for each."""
    plc = _plc()
    talks = [_Talk(number, plc) for number in range(_FLOODING)]
    for talk in talks:
        yield from talk.hello()
    pad = bytes(size) if size > 100 else b""
    pieces = [tpkt(pdu) for pdu in _SOUND] + [tpkt(pdu + pad) for pdu in _FAULTY]
    while True:
        for piece in pieces:
            answers = piece[8] == ACK_DATA
            for talk in talks:
                asking, answering = talk.client, talk.plc
                yield talk.say(answering, asking, piece) if answers else talk.say(asking, answering, piece)


def flood_packets(rounds: int) -> int:
    """Return the number of packets in ``rounds`` rounds of ``badpdu``: ten kinds of faulty PDUs on each of four connections."""
    return _FLOODING * (7 + rounds * (len(_SOUND) + len(_FAULTY)))


#: Faulty PDUs in a round.
FLOOD_FAULTS: Final = _FLOODING * len(_FAULTY)

_STREAMS: Final[dict[str, Callable[[int], Iterator[bytes]]]] = {
    "normal": _ordinary,
    "synflood": _synflood,
    "neverclose": _never_closed,
    "unanswered": _unanswered,
    "halftpkt": _half_tpkts,
    "eotnever": _never_ended,
    "holes": _holes,
    "ipfrag": _fragments,
    "badpdu": _faulty,
}
#: The eight streams of the promises on memory and time.
ENDLESS: Final = tuple(name for name in _STREAMS if name != "badpdu")
#: All of them, with the flood of malformed PDUs.
NAMES: Final = tuple(_STREAMS)
#: User data of a hostile segment: small, and filling the frame.
SMALL: Final = 64
MTU: Final = 1400


def stream(name: str, size: int = SMALL) -> Stream:
    """Return the endless stream ``name`` (one of `NAMES`) of (time in ns, frame)."""
    if name not in _STREAMS:
        raise ValueError(f"{name!r} is no profile; choose one of {', '.join(NAMES)}")
    return zip(_clock(), _STREAMS[name](size), strict=False)


def why(name: str) -> str:
    """Return the sentence that describes the stream and the analyzers that it overloads."""
    return (_STREAMS[name].__doc__ or "").strip()
