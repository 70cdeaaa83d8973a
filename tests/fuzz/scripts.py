"""TCP connections and datagrams as a fuzzer can write them: events of a few octets each, turned into packets with headers.

An event is an octet (bit 7: the side; bits 6-5: which connection of `FLOWS`; bits 4-0: what happens, `EVENTS`) and what that
needs: two octets of size and the payload, an offset in the stream, flags, a step of time.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Final

from dissect.packets.tcp.ip import UDP, FragmentStore
from dissect.packets.tcp.segment import find_segment
from tests.fuzz.taking import Taker
from tests.properties.packets import ACK, EPOCH_NS, MASK, MS, Flow, Packet, Talk

DATA: Final = 0  # the next octets
AWAY: Final = 1  # octets at another place: an offset of two octets with a sign comes before
FLAGS: Final = 2  # flags, and octets
AGAIN: Final = 3  # the packet this many packets ago
WAIT: Final = 4  # time passes, or runs backwards
FRAGMENTS: Final = 5  # octets, in IP fragments of this many times eight octets
CUT: Final = 6  # octets, the last of which (this many) are missing from the capture
LOST: Final = 7  # octets that are not in the capture
BARE: Final = 8  # an acknowledgement: of all, or of this much less or more
DATAGRAM: Final = 9  # octets over UDP
EVENTS: Final = 10

FLOWS: Final = (
    Flow("10.0.0.1", "10.0.0.2", (49152, 102)),
    Flow("10.0.0.3", "10.0.0.2", (49152, 102), vlans=(7,)),
    Flow("10.0.0.1", "10.0.0.4", (49153, 1099)),
    Flow("fe80::1", "fe80::2", (49152, 102)),
)
#: The same with the ports of captures/scd, if the first octet says so.
SCD_FLOWS: Final = (
    Flow("10.0.0.1", "10.0.0.2", (49152, 102)),
    Flow("10.0.0.3", "10.0.0.2", (49152, 5601)),
    Flow("10.0.0.1", "10.0.0.2", (49152, 5600)),
    Flow("10.0.0.1", "10.0.0.2", (49152, 5602)),
)
_SCD: Final = 2
_STEPS_NS: Final = (0, MS, 40 * MS, 500 * MS, 1_500 * MS, 30_000 * MS, 400_000 * MS, -2_000 * MS)
#: Maximum number of packets of one script.
MOST_PACKETS: Final = 200


def _signed(number: int) -> int:
    return number - 0x10000 if number & 0x8000 else number


class Script:
    """Plays events; ``packets`` are the captured ones."""

    def __init__(self, octets: bytes) -> None:
        self.packets: list[Packet] = []
        self._taker = Taker(octets)
        start = self._taker.number()
        # By the first octet: where the streams begin, a little before the numbers wrap or anywhere.
        isns = (0xFFFFFF00 + start, 0xFFFFFF80) if start & 1 else (1000 + start, 500_000)
        self._talks = [Talk(flow, isns) for flow in (SCD_FLOWS if start & _SCD else FLOWS)]
        self._now_ns = EPOCH_NS
        while self._taker.left and len(self.packets) < MOST_PACKETS:
            self._play()

    def _play(self) -> None:
        octet = self._taker.number()
        side = octet >> 7
        talk = self._talks[octet >> 5 & 3]
        event = (octet & 0x1F) % EVENTS
        if event == WAIT:
            self._now_ns += _STEPS_NS[self._taker.number() % len(_STEPS_NS)]
        elif event == AGAIN:
            self._again(self._taker.number())
        elif event == DATAGRAM:
            self._datagram(talk.flow, side, self._taker.octets(self._taker.number(2)))
        elif event == LOST:
            talk.skip(side, self._taker.number(2))
        elif event == BARE:
            there = talk.next[1 - side]
            talk.next[1 - side] = (there + _signed(self._taker.number(2))) & MASK
            talk.ack(side)
            talk.next[1 - side] = there
            self._show(talk)
        else:
            self._data(talk, side, event)

    def _data(self, talk: Talk, side: int, event: int) -> None:
        number = self._taker.number(2 if event == AWAY else 1) if event != DATA else 0
        payload = self._taker.octets(self._taker.number(2))
        if event == FLAGS:
            talk.put(side, number & 0x3F, payload)
            self._show(talk)
            return
        before = talk.next[side]
        if event == AWAY:
            talk.skip(side, _signed(number) & MASK)
        segment = talk.put(side, ACK, payload)
        if event == AWAY:  # the next event continues at the old place
            talk.next[side] = before
        if event == FRAGMENTS:
            talk.segments.clear()
            size = max(8, number * 8, len(payload) // 64 * 8)
            for piece in talk.flow.fragments(segment, size, len(self.packets)):
                self._add(Packet(self._now_ns, piece, len(piece), talk.flow.link))
        else:
            self._show(talk, number if event == CUT else 0)

    def _datagram(self, flow: Flow, side: int, payload: bytes) -> None:
        ports = flow.ports if side == 0 else flow.ports[::-1]
        frame = flow.wrap(side, UDP, struct.pack(">HHHH", *ports, 8 + len(payload), 0) + payload)
        self._add(Packet(self._now_ns, frame, len(frame), flow.link))

    def _show(self, talk: Talk, missing: int = 0) -> None:
        frame = talk.segments.pop().frame()
        self._add(Packet(self._now_ns, frame[: max(1, len(frame) - missing)], len(frame), talk.flow.link))

    def _again(self, back: int) -> None:
        if back < len(self.packets):
            self._add(self.packets[-1 - back]._replace(time_ns=self._now_ns))

    def _add(self, packet: Packet) -> None:
        self._now_ns += MS
        self.packets.append(packet)


_SERVERS: Final = frozenset((102, 1099, 5600, 5601, 5602))
_FLOW_OF: Final = {1099: 2, 5601: 1, 5600: 2, 5602: 3}


def written(packets: Iterable[Packet]) -> bytes:
    """Return a script that does the same as packets of TCP and UDP; a script has four connections with similar addresses."""
    script = bytearray(b"\0")
    store = FragmentStore()
    flows: dict[bytes, int] = {}
    expected: dict[bytes, int] = {}
    for packet in packets:
        found = find_segment(packet.octets, 0, len(packet.octets), packet.link_type, store, packet.time_ns, True)
        if found.problem or len(found.octets) > 0xF000:
            continue
        key = bytes(found.key[:12]) if len(found.key) < 36 else bytes(found.key[:36])
        half = len(key) // 2 - 2
        other = key[half : 2 * half] + key[:half] + key[-2:] + key[-4:-2]
        ports = int.from_bytes(key[-4:-2], "big"), int.from_bytes(key[-2:], "big")
        server = ports[0] in _SERVERS or (ports[1] not in _SERVERS and ports[0] < ports[1])
        name = other if server else key
        scd = 5600 <= min(ports) <= 5602
        at = flows.setdefault(name, _FLOW_OF.get(min(ports), len(flows) % (1 if script[0] else 2)))
        script[0] |= _SCD if scd else 0
        head = (0x80 if server else 0) | at << 5
        flags = int(found.word) & 0x3F
        seq = int(found.seq)
        size = len(found.octets).to_bytes(2, "big")
        away = (seq - expected.get(key, seq)) & MASK
        if found.protocol == UDP:
            script += bytes((head | DATAGRAM,)) + size + found.octets
            continue
        if flags & 7:
            script += bytes((head | FLAGS, flags)) + size + found.octets
        elif found.octets and away and (away < 0x8000 or away > MASK - 0x7FFF):
            script += bytes((head | AWAY,)) + (away & 0xFFFF).to_bytes(2, "big") + size + found.octets
            continue
        elif found.octets:
            script += bytes((head | DATA,)) + size + found.octets
        else:
            script += bytes((head | BARE, 0, 0))
        expected[key] = (seq + len(found.octets) + bool(flags & 3)) & MASK
    return bytes(script)
