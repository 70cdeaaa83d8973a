"""Conversations made up at random, octet by octet, for both sides of the comparison to read.

Nothing here comes from the package: not a layout, not a table, not a layer; parts with an inner structure are worked examples
of the reference. All traffic is legal or as real devices send it; lengths are always right. `conversation` gives the packets of
one TCP connection, `write_capture` a file of several.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Final

from tests.build import any_item, data_item, dt, joined, pdu, setup_block, tpdu, userdata_head
from tests.build import payload as payload_of
from tests.examples import S7

SYN: Final = 0x02
FIN: Final = 0x01
PUSH_ACK: Final = 0x18
ACK: Final = 0x10

CODES: Final = (0xFF, 0xFF, 0xFF, 0xFF, 0x0A, 0x05, 0x07, 0x03, 0x01, 0x06)
#: Octets of one element and the transport size of the answer, by request transport size.
SIZES: Final = {
    1: (1, 3),
    2: (1, 4),
    3: (1, 9),
    4: (2, 4),
    5: (2, 5),
    6: (4, 4),
    7: (4, 5),
    8: (4, 7),
    0x1C: (2, 9),
    0x1D: (2, 9),
}
AREAS: Final = (0x03, 0x05, 0x06, 0x80, 0x81, 0x82, 0x83, 0x84, 0x84, 0x84, 0x85, 0x86, 0x87, 0x1C, 0x1D, 0x77)


def octets(rng: Random, most: int, least: int = 0) -> bytes:
    """Return some random octets."""
    return rng.randbytes(rng.randint(least, most))


# ---- TPKT and COTP ---------------------------------------------------------------------------------------------------


def parameter(code: int, value: bytes) -> bytes:
    """Return one parameter of a variable part."""
    return bytes([code, len(value)]) + value


def tsap(rng: Random) -> bytes:
    """Return a TSAP: two octets, or a text."""
    if rng.random() < 0.6:
        return bytes([rng.choice((1, 2, 3, 0x10)), rng.randrange(256)])
    return rng.choice((b"SIMATIC-ROOT-HMI", b"MW", b"\x02\x00\x00\x01", b"0-0ABCD0", b"\x4d"))


def connect(rng: Random, code: int, reference: int) -> bytes:
    """Return a CR (0xE0) or CC (0xD0) with parameters in any order."""
    parts = [parameter(0xC1, tsap(rng)), parameter(0xC2, tsap(rng)), parameter(0xC0, bytes([rng.randint(7, 0x0D)]))]
    if rng.random() < 0.2:
        parts.append(parameter(0xF0, rng.choice((b"\x08", b"\x01\x00", b"\x02\x00"))))
    if rng.random() < 0.2:
        parts.append(parameter(0xC6, bytes([rng.randrange(16)])))
    if rng.random() < 0.1:
        parts.append(parameter(0xC4, b"\x01"))
    if rng.random() < 0.1:
        parts.append(parameter(0x99, octets(rng, 5, 1)))
    rng.shuffle(parts)
    parts = parts[: rng.choice((1, 2, len(parts), len(parts), len(parts)))]
    head = struct.pack(">BHHB", code, 0 if code == 0xE0 else reference, rng.randrange(1, 65536), 0)
    return tpdu(head, b"".join(parts))


def other_tpdu(rng: Random) -> bytes:
    """Return one of the rare TPDUs, in a form that Wireshark knows."""
    reference = rng.randrange(65536)
    number = rng.randrange(128)
    wide = rng.randrange(1 << 31)
    return rng.choice(
        (
            tpdu(
                struct.pack(">BHHB", 0x80, reference, rng.randrange(65536), rng.choice((0, 1, 2, 3, 0x80, 0x83, 0x8A)))
            ),
            tpdu(struct.pack(">BHH", 0xC0, reference, rng.randrange(65536))),
            tpdu(struct.pack(">BHB", 0x70, reference, rng.randrange(4)), parameter(0xC1, octets(rng, 6, 1))),
            tpdu(struct.pack(">BHB", 0x60 | rng.randrange(16), reference, number)),
            tpdu(struct.pack(">BHIH", 0x60, reference, wide, rng.randrange(65536))),
            tpdu(struct.pack(">BHB", 0x20, reference, number)),
            tpdu(struct.pack(">BHI", 0x20, reference, wide)),
            tpdu(struct.pack(">BHB", 0x50 | rng.randrange(16), reference, number)),
            tpdu(struct.pack(">BHIH", 0x50, reference, wide, rng.randrange(65536))),
            tpdu(struct.pack(">BHB", 0x10, reference, 0x80 | number), data=octets(rng, 16, 1)),
            tpdu(struct.pack(">BHI", 0x10, reference, 0x80000000 | wide), data=octets(rng, 16, 1)),
        )
    )


# ---- S7 --------------------------------------------------------------------------------------------------------------


def setup(rng: Random, rosctr: int, reference: int) -> bytes:
    """Return a Setup communication."""
    amq = rng.randint(1, 8)
    return pdu(rosctr, reference, setup_block(amq, rng.randint(1, 8), rng.choice((240, 480, 960))))


class Item:
    """A variable of a request, and the form of its answer."""

    def __init__(self, rng: Random) -> None:
        self.size = rng.choice((*SIZES, *SIZES, 0x09, 0x13, 0x7E))
        self.count = 1 if self.size == 1 else rng.randint(1, 9)
        self.foreign = rng.random() < 0.1
        if self.foreign:
            self.request = self._foreign(rng)
        else:
            address, db, area = rng.randrange(1 << 24), rng.randrange(65536), rng.choice(AREAS)
            self.request = any_item(self.size, self.count, db, area, address)
        octets_each, self.answer_size = SIZES.get(self.size, (1, 4))
        self.octets = octets_each * self.count

    @staticmethod
    def _foreign(rng: Random) -> bytes:
        """An item of another syntax, some of odd size."""
        areas = [
            struct.pack(">BHH", rng.randint(1, 20), rng.randrange(300), rng.randrange(300))
            for _ in range(rng.randint(1, 3))
        ]
        body = rng.choice(
            (
                b"\xb0" + bytes([len(areas)]) + b"".join(areas),
                b"\x82" + octets(rng, 7, 7),
                b"\xa2" + octets(rng, 9, 9),
                b"\x55" + octets(rng, 6, 1),
            )
        )
        return bytes([0x12, len(body)]) + body

    def data(self, rng: Random, code: int) -> bytes:
        """Return the data item: of a write request (code 0), or of the answer to a read."""
        if code not in {0xFF, 0x00}:
            return bytes([code]) + rng.choice((b"\0\0\0", b"\0\0\x04", b"\x04\0\x08"))
        content = octets(rng, self.octets, self.octets)
        return data_item(code, self.answer_size, content)


def read_pair(rng: Random, reference: int) -> tuple[bytes, bytes]:
    """Return a Read Var and its answer."""
    items = [Item(rng) for _ in range(rng.choice((1, 1, 2, 3, rng.randint(1, 19))))]
    request = pdu(1, reference, bytes([4, len(items)]) + joined([item.request for item in items]))
    if rng.random() < 0.1:
        return request, pdu(rng.choice((2, 3)), reference, b"", error=rng.choice((0x8104, 0x8500, 0xD241)))
    answer = joined([item.data(rng, rng.choice(CODES)) for item in items])
    return request, pdu(3, reference, bytes([4, len(items)]), answer)


def write_pair(rng: Random, reference: int) -> tuple[bytes, bytes]:
    """Return a Write Var and its answer."""
    items = [Item(rng) for _ in range(rng.choice((1, 1, 2, rng.randint(1, 12))))]
    parameters = bytes([5, len(items)]) + joined([item.request for item in items])
    data = joined([item.data(rng, 0) for item in items])
    if len(data) & 1 and rng.random() < 0.3:
        data += b"\x00"  # one client pads the last item, too
    codes = bytes([rng.choice(CODES) for _ in items])
    return pdu(1, reference, parameters, data), pdu(3, reference, bytes([5, len(items)]), codes)


#: Userdata functions (group and subfunction) unknown to Wireshark, so that it cannot call their payload wrong.
UNREAD: Final = (0x0209, 0x0309, 0x0560, 0x3F01, 0x2003)
SZL: Final = 0x0401
CLOCK: Final = 0x0701
TIME: Final = b"\x00\x19\x24\x03\x04\x05\x06\x07\x00\x02"
#: S7 PDUs with an inner structure: the worked examples of the reference that are unique.
WORKED: Final = [
    example.octets[7:] for example in S7 if example.octets[5:8] == b"\xf0\x80\x32" and "part" not in example.title
]


def payload(rng: Random, kind: int, function: int) -> bytes:
    """Return a possible payload of a Userdata request (kind 1), answer (2) or push (0)."""
    if function == SZL:
        wanted = struct.pack(">HH", rng.choice((0x0011, 0x001C, 0x0424, 0x0F00)), rng.randrange(256))
        return wanted if kind == 1 else wanted + struct.pack(">HH", 0, 0)
    if function == CLOCK:
        return b"" if kind == 1 else TIME
    return octets(rng, 60, 2)


def userdata(rng: Random, reference: int, kind: int, function: int, sequence: int, short: bool) -> bytes:
    """Return a Userdata PDU of type ``kind``; ``function`` is group and subfunction."""
    group, subfunction = divmod(function, 256)
    error = rng.choice((0, 0, 0xD402, 0x8104)) if kind == 2 else 0
    unit = None if short else rng.randrange(256)
    parameters = userdata_head(kind, group, subfunction, sequence, unit, 0, error)
    carried = payload(rng, kind, function) if not error and rng.random() < 0.7 else b""
    return pdu(7, reference, parameters, payload_of(carried))


def userdata_pair(rng: Random, reference: int) -> tuple[bytes, bytes]:
    """Return a Userdata request and its answer."""
    function = rng.choice((*UNREAD, SZL, CLOCK))
    sequence = rng.randrange(256)
    request = userdata(rng, reference, 1, function, 0, rng.random() < 0.8)
    return request, userdata(rng, reference, 2, function, sequence, short=False)


def worked_pair(rng: Random, reference: int) -> tuple[bytes, bytes]:
    """Return two of the worked examples, which need not be related."""
    request, answer = rng.choice(WORKED), rng.choice(WORKED)
    number = struct.pack(">H", reference)
    return request[:4] + number + request[6:], answer[:4] + number + answer[6:]


def control_pair(rng: Random, reference: int) -> tuple[bytes, bytes]:
    """Return a PI service, a PLC stop or an end of upload, and its answer."""
    parameters = rng.choice(
        (
            b"\x28\x00\x00\x00\x00\x00\x00\xfd\x00\x00\x09P_PROGRAM",
            b"\x29\x00\x00\x00\x00\x00\x09P_PROGRAM",
            b"\x1f\x00\x00\x00\x00\x00\x00\x07",
        )
    )
    return pdu(1, reference, parameters), pdu(3, reference, parameters[:1])


# ---- TCP -------------------------------------------------------------------------------------------------------------


class Connection:
    """One TCP connection over IPv4 and Ethernet; ``packets`` are whole frames. Side 0 opens the connection."""

    def __init__(self, rng: Random, number: int, port: int = 102) -> None:
        self.addresses = (struct.pack(">BBH", 10, 1, number), struct.pack(">BBH", 10, 2, number))
        self.ports = (1024 + rng.randrange(60000), port)
        self.sequence = [rng.choice((rng.randrange(1 << 32), 0xFFFFFF00)) for _ in range(2)]
        self.packets: list[bytes] = []

    def put(self, side: int, flags: int, payload: bytes = b"", sequence: int | None = None) -> None:
        """Add a packet, by default with the next octets of its side."""
        at = self.sequence[side] if sequence is None else sequence
        tcp = struct.pack(
            ">HHIIBBHHH", self.ports[side], self.ports[1 - side], at, self.sequence[1 - side], 0x50, flags, 8192, 0, 0
        )
        size = 20 + len(tcp) + len(payload)
        ip = struct.pack(">BBHHHBBH", 0x45, 0, size, 0, 0, 64, 6, 0) + self.addresses[side] + self.addresses[1 - side]
        self.packets.append(bytes(12) + b"\x08\x00" + ip + tcp + payload)
        if sequence is None:
            grown = len(payload) + (1 if flags & (SYN | FIN) else 0)
            self.sequence[side] = (at + grown) & 0xFFFFFFFF

    def open(self) -> None:
        """Shake hands."""
        self.put(0, SYN)
        self.put(1, SYN | ACK)
        self.put(0, ACK)

    def close(self) -> None:
        """End from both sides."""
        self.put(0, FIN | ACK)
        self.put(1, FIN | ACK)
        self.put(0, ACK)

    def send(self, rng: Random, side: int, stream: bytes, most: int = 3) -> None:
        """Send octets in up to ``most`` segments, some of them twice."""
        cuts = (
            sorted(rng.randrange(1, len(stream)) for _ in range(rng.choice((0, 0, 0, rng.randrange(most)))))
            if stream
            else []
        )
        for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
            if begin < end:
                at = self.sequence[side]
                self.put(side, PUSH_ACK, stream[begin:end])
                if rng.random() < 0.03:
                    self.put(side, PUSH_ACK, stream[begin:end], at)
        if rng.random() < 0.3:
            self.put(1 - side, ACK)


def fragments(rng: Random, message: bytes) -> bytes:
    """Return an S7 PDU in its TPKT, or in several DTs."""
    number = rng.randrange(128) if rng.random() < 0.1 else 0
    if len(message) < 40 or rng.random() < 0.9:
        return dt(message, number=number)
    cut = rng.randrange(1, len(message))
    return dt(message[:cut], eot=False) + dt(message[cut:])


PAIRS: Final = (
    read_pair,
    read_pair,
    read_pair,
    write_pair,
    write_pair,
    userdata_pair,
    control_pair,
    worked_pair,
    worked_pair,
)


def sent_again(rng: Random, number: int) -> list[bytes]:
    """Return the packets of a connection whose answers are partly lost, and sent again cut otherwise, after later ones.

    The client acknowledges the data without a gap several times, like a receiver that misses something.
    """
    connection = Connection(rng, number)
    connection.open()
    connection.put(0, PUSH_ACK, connect(rng, 0xE0, 0))
    connection.put(1, PUSH_ACK, connect(rng, 0xD0, 1))
    connection.put(0, PUSH_ACK, dt(setup(rng, 1, 1)))
    connection.put(1, PUSH_ACK, dt(setup(rng, 3, 1)))
    pairs = [rng.choice((read_pair, write_pair))(rng, reference) for reference in range(2, rng.randint(6, 10))]
    connection.put(0, PUSH_ACK, b"".join(dt(request) for request, _ in pairs))
    answers = [dt(answer) for _, answer in pairs]
    stream, start = b"".join(answers), connection.sequence[1]
    edges = [sum(map(len, answers[:index])) for index in range(len(answers) + 1)]
    if rng.random() < 0.4:
        edges = sorted({0, len(stream), *(rng.randrange(1, len(stream)) for _ in answers)})
    plan = [places for places in pairwise(edges) if rng.random() < 0.8]
    for _ in range(rng.randint(1, 3)):
        first = rng.randrange(len(edges) - 1)
        last = min(first + rng.randint(1, 3), len(edges) - 1)
        plan.insert(rng.randint(0, len(plan)), (edges[first], edges[last]))
    reached = 0
    for index, (begin, end) in enumerate(plan):
        connection.put(1, PUSH_ACK, stream[begin:end], (start + begin) & 0xFFFFFFFF)
        for low, high in sorted(plan[: index + 1]):
            reached = max(reached, high) if low <= reached else reached
        connection.sequence[1] = (start + reached) & 0xFFFFFFFF
        for _ in range(rng.choice((0, 0, 1, 3, 4))):
            connection.put(0, ACK)
    connection.sequence[1] = (start + len(stream)) & 0xFFFFFFFF
    connection.close()
    return connection.packets


def conversation(rng: Random, number: int, ports: Sequence[int] = (102, 102, 102, 10102)) -> list[bytes]:
    """Return the packets of one connection to one of ``ports``, from the handshake to its end."""
    connection = Connection(rng, number, rng.choice(ports))
    connection.open()
    connection.send(rng, 0, connect(rng, 0xE0, 0))
    connection.send(rng, 1, connect(rng, 0xD0, 1))
    reference = rng.randrange(65536)
    connection.send(rng, 0, dt(setup(rng, 1, reference)))
    connection.send(rng, 1, dt(setup(rng, 3, reference)))
    for _ in range(rng.randint(1, 12)):
        pairs = []
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            reference = (reference + 1) & 0xFFFF
            pairs.append(rng.choice(PAIRS)(rng, reference))
        connection.send(rng, 0, b"".join(fragments(rng, request) for request, _ in pairs))
        before = dt(b"", eot=False) if rng.random() < 0.2 else b""
        connection.send(rng, 1, before + b"".join(fragments(rng, answer) for _, answer in pairs))
        if rng.random() < 0.1:
            connection.send(rng, 1, dt(userdata(rng, 0, 0, rng.choice(UNREAD), 1, rng.random() < 0.5)))
        if rng.random() < 0.1:
            connection.send(rng, rng.randrange(2), other_tpdu(rng))
    if rng.random() < 0.7:
        connection.close()
    return connection.packets


def disordered(rng: Random, packets: Sequence[bytes]) -> list[bytes]:
    """Return the packets of one connection with some neighbours changed about, all of which carry octets."""
    mixed = list(packets)
    at = 4
    while at < len(mixed) - 1:
        if rng.random() < 0.1 and min(len(mixed[at]), len(mixed[at + 1])) > 60:
            mixed[at], mixed[at + 1] = mixed[at + 1], mixed[at]
            at += 1
        at += 1
    return mixed


def interleaved(rng: Random, flows: Iterable[list[bytes]]) -> list[bytes]:
    """Return the packets of several connections mixed, each connection's in its order."""
    waiting = [iter(flow) for flow in flows]
    mixed = []
    while waiting:
        flow = rng.choice(waiting[:8])
        packet = next(flow, None)
        if packet is None:
            waiting.remove(flow)
        else:
            mixed.append(packet)
    return mixed


def write_capture(path: Path, packets: Iterable[bytes], most: int = 65535) -> Path:
    """Write a classic pcap, one packet per millisecond, with up to ``most`` octets of each."""
    out = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    for index, packet in enumerate(packets):
        kept = packet[:most]
        head = struct.pack("<IIII", 1_700_000_000 + index // 1000, index % 1000 * 1000, len(kept), len(packet))
        out.append(head + kept)
    path.write_bytes(b"".join(out))
    return path
