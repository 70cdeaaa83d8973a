"""A second, slow and simple way to count a synthetic capture: whole file in memory, octet by octet, without the package.

It relies on what the traffic guarantees (Ethernet, IPv4 without options, one S7 PDU per DT) and on nothing else.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.readers import read_capture

#: An answer captured before its request is at most this far from it.
_DISORDER_NS = 2_000_000


def checksum(octets: bytes) -> int:
    """The Internet checksum as defined in RFC 1071, in a loop."""
    if len(octets) % 2:
        octets += b"\x00"
    total = 0
    for at in range(0, len(octets), 2):
        total += octets[at] << 8 | octets[at + 1]
        total = (total & 0xFFFF) + (total >> 16)
    return total ^ 0xFFFF


def checksums_right(frame: bytes) -> bool:
    """Whether the checksums of IP and TCP in an Ethernet frame are right (true for anything except TCP over IPv4)."""
    if frame[12:14] != b"\x08\x00" or frame[23] != 6:
        return True
    total = int.from_bytes(frame[16:18], "big")
    segment = frame[34 : 14 + total]
    pseudo = frame[26:34] + b"\x00\x06" + len(segment).to_bytes(2, "big")
    return checksum(frame[14:34]) == 0 and checksum(pseudo + segment) == 0


class Direction:
    """The data that one side of a connection sent: (offset in the stream, octets, packet number, time) of each segment."""

    def __init__(self, base: int) -> None:
        self.base = base
        self.segments: list[tuple[int, bytes, int, int]] = []

    def runs(self) -> list[tuple[bytes, list[int], set[int]]]:
        """Stretches without a gap: octets, the packet that first brought each octet, where segments begin."""
        brought: dict[int, tuple[int, int]] = {}
        starts = {offset for offset, octets, _, _ in self.segments if len(octets) > 1}
        for offset, octets, number, _ in self.segments:
            for step, octet in enumerate(octets):
                brought.setdefault(offset + step, (octet, number))
        found: list[tuple[bytes, list[int], set[int]]] = []
        places = sorted(brought)
        first = 0
        for at in range(1, len(places) + 1):
            if at == len(places) or places[at] != places[at - 1] + 1:
                stretch = places[first:at]
                begins = {offset - stretch[0] for offset in starts}
                found.append((bytes(brought[p][0] for p in stretch), [brought[p][1] for p in stretch], begins))
                first = at
        return found

    def tpkts(self) -> list[tuple[int, bytes]]:
        """Whole TPKTs with the packet that completed each. After a gap, frames begin again where a segment does."""
        found: list[tuple[int, bytes]] = []
        for octets, numbers, begins in self.runs():
            at = 0
            while at + 4 <= len(octets):
                size = int.from_bytes(octets[at + 2 : at + 4], "big")
                if (
                    octets[at : at + 2] != b"\x03\x00"
                    or size < 7
                    or octets[at + 4 : at + 6] not in _KINDS.get(octets[at + 5], ())
                ):
                    later = [begin for begin in begins if begin > at]
                    if not later:
                        break
                    at = min(later)
                    continue
                if at + size > len(octets):
                    break
                # In order: nothing is complete before everything in front of it.
                found.append((max(numbers[: at + size]), octets[at : at + size]))
                at += size
        return found


_KINDS = {0xF0: (b"\x02\xf0",), 0xE0: (b"\x11\xe0",), 0xD0: (b"\x11\xd0",), 0x80: (b"\x06\x80",)}
_NAMES = {0xF0: "DT", 0xE0: "CR", 0xD0: "CC", 0x80: "DR"}


def count(path: Path) -> dict[str, object]:
    """Count a capture in the terms of the truth file."""
    _, packets = read_capture(path)
    connections: list[dict[bytes, Direction]] = []
    current: dict[bytes, dict[bytes, Direction]] = {}
    times = [time_ns for time_ns, _, _ in packets]
    empty = 0
    for number, (time_ns, frame, _) in enumerate(packets):
        if frame[12:14] != b"\x08\x00" or frame[23] != 6:
            continue
        data = 34 + (frame[46] >> 4) * 4
        payload = frame[data : 14 + int.from_bytes(frame[16:18], "big")]
        seq = int.from_bytes(frame[38:42], "big")
        flags = frame[47]
        empty += not payload
        here = frame[26:30] + frame[34:36]
        there = frame[30:34] + frame[36:38]
        pair = min(here, there) + max(here, there)
        if flags & 0x12 == 0x02 or pair not in current:
            current[pair] = {}
            connections.append(current[pair])
        sides = current[pair]
        if here not in sides:
            sides[here] = Direction(seq + (1 if flags & 2 else 0))
        if payload:
            offset = (seq - sides[here].base + 0x80000000) % 0x100000000 - 0x80000000
            sides[here].segments.append((offset, payload, number, time_ns))
    told: dict[str, object] = {"packets": len(packets), "empty_segments": empty, "connections": len(connections)}
    tpdus: dict[str, int] = {}
    rosctr: dict[str, int] = {}
    deals = {"answered": 0, "unanswered": 0, "orphan_answers": 0, "unsolicited": 0}
    items = 0
    for sides in connections:
        pdus: list[tuple[int, bytes]] = []
        for direction in sides.values():
            for number, tpkt in direction.tpkts():
                name = _NAMES[tpkt[5]]
                tpdus[name] = tpdus.get(name, 0) + 1
                if name == "DT" and tpkt[7:8] == b"\x32":
                    pdus.append((number, tpkt[7:]))
                    rosctr[str(tpkt[8])] = rosctr.get(str(tpkt[8]), 0) + 1
                    items += tpkt[18] if tpkt[8] == 1 and tpkt[17] in (4, 5) else 0
        _pair(sorted(pdus), times, deals)
    told["tpdus"] = dict(sorted(tpdus.items()))
    told["rosctr"] = dict(sorted(rosctr.items()))
    told["transactions"] = deals
    told["items"] = items
    return told


def _pair(pdus: list[tuple[int, bytes]], times: list[int], deals: dict[str, int]) -> None:
    """Pair the PDUs of a connection, in order of completion, by reference and kind."""
    asked: dict[tuple[bytes, bool], int] = {}
    early: dict[tuple[bytes, bool], int] = {}
    for number, pdu in pdus:
        userdata = pdu[1] == 7
        kind = pdu[15] >> 6 if userdata else {1: 1, 2: 2, 3: 2}[pdu[1]]
        key = pdu[4:6], userdata
        if kind == 0:
            deals["unsolicited"] += 1
        elif kind == 1:
            if key in asked:
                deals["unanswered"] += 1
                del asked[key]
            if key in early and times[number] - times[early[key]] < _DISORDER_NS:
                del early[key]
                deals["answered"] += 1
            else:
                asked[key] = number
        elif key in asked:
            del asked[key]
            deals["answered"] += 1
        else:
            deals["orphan_answers"] += key in early
            early[key] = number
    deals["unanswered"] += len(asked)
    deals["orphan_answers"] += len(early)
