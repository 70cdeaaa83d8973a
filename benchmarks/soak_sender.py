"""Send the frames of a made capture over an interface at a set rate: ``python -m benchmarks.soak_sender INTERFACE CAPTURE``.

Standard library only. The messages for ``sendmmsg`` are laid out in memory before anything is sent, so that sending costs this
program nothing per packet, and the kernel takes up to a thousand of them per call. Only TCP on port 102 is sent.

The capture is sent over and over. In each pass its hosts get other addresses, so that connections are new and not repeated: the
amount added to a client's address is subtracted from its PLC's, and every checksum stays right.

It reads orders from standard input, a line each, and answers each with a line of JSON:

    RATE SECONDS [MARKS]     packets a second (-1: as many as there can be), and marked transactions a second beside them

A marked transaction is a read by 10.77.0.1 whose reference counts up from the first one on; the answer has the wall-clock time
at which each was sent (``marks``, in ns).
"""

from __future__ import annotations

import argparse
import ctypes
import json
import mmap
import os
import socket
import struct
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from benchmarks.frames import ACK, FIN, PSH, SYN, Host, Sender
from benchmarks.pdus import ACK_DATA, JOB, READ, answer, connect_tpdu, request, setup_param, tpkt

if TYPE_CHECKING:
    from collections.abc import Sequence

#: ``struct iovec`` and ``struct mmsghdr`` of 64-bit Linux.
_PIECE: Final = struct.Struct("@PN")
_MESSAGE: Final = struct.Struct("@PI4xPNPNi4xI4x")
_RECORD: Final = struct.Struct("<IIII")
_MOST_A_CALL: Final = 1024
#: Packets of this time span, in ns, are sent together, as on a busy network.
_TURN_NS: Final = 1_000_000
_SOL_PACKET: Final = 263
_QDISC_BYPASS: Final = 20
_BUFFER: Final = 8 << 20
_ADDRESSES_AT: Final = 26
_PORTS_AT: Final = 34
_ETHERTYPE_IP: Final = b"\x08\x00"
_S7_PORT: Final = 102
#: Number of passes over the capture with different addresses: their third octet stays below 255.
_PASSES: Final = 200

MARKED: Final = "10.77.0.1"
_MARKED_CLIENT: Final = 0x0A4D0001
_MARKED_PLC: Final = 0x0A4D0002
_READ_ITEM: Final = b"\x12\x0a\x10\x02\x00\x04\x00\x01\x84\x00\x00\x00"
_READ_DATA: Final = b"\xff\x04\x00\x20\x11\x22\x33\x44"


class Load:
    """The frames of a capture as messages for ``sendmmsg``: three pieces each, the second of them the two IPv4 addresses.

    Addresses lie in a table of their own, so that `renew` changes them in all frames at once.
    """

    def __init__(self, path: Path, most: int = 0) -> None:
        with path.open("rb") as file:
            self._file = mmap.mmap(file.fileno(), 0, flags=mmap.MAP_PRIVATE, prot=mmap.PROT_READ | mmap.PROT_WRITE)
        octets = self._file
        if octets[:4] != b"\xd4\xc3\xb2\xa1":
            raise ValueError(f"{path}: not a pcap file with microseconds, as benchmarks.generate writes it")
        frames: list[tuple[int, int, int]] = []
        pairs: dict[bytes, int] = {}
        self._towards: list[bool] = []
        at, end = 24, len(octets)
        while at + 16 <= end and not (most and len(frames) == most):
            size = _RECORD.unpack_from(octets, at)[2]
            start = at + 16
            at = start + size
            if size < _PORTS_AT + 4 or octets[start + 12 : start + 14] != _ETHERTYPE_IP or octets[start + 23] != 6:
                continue
            source, dest = struct.unpack_from(">HH", octets, start + _PORTS_AT)
            if _S7_PORT not in (source, dest):
                continue
            key = octets[start + _ADDRESSES_AT : start + _PORTS_AT]
            if key not in pairs:
                pairs[key] = len(pairs)
                self._towards.append(dest == _S7_PORT)
            frames.append((start, size, pairs[key]))
        if not frames:
            raise ValueError(f"{path}: no S7 in it")
        self._originals = list(pairs)
        self._table = bytearray(b"".join(self._originals))
        self._lay_out(frames)
        self.count = len(frames)
        self._passes = 0

    def _lay_out(self, frames: list[tuple[int, int, int]]) -> None:
        base = ctypes.addressof(ctypes.c_char.from_buffer(self._file))
        table = ctypes.addressof(ctypes.c_char.from_buffer(self._table))
        self._pieces = bytearray(3 * _PIECE.size * len(frames))
        self._messages = bytearray(_MESSAGE.size * len(frames))
        pieces = ctypes.addressof(ctypes.c_char.from_buffer(self._pieces))
        at = place = 0
        for start, size, pair in frames:
            begin = base + start
            _PIECE.pack_into(self._pieces, at, begin, _ADDRESSES_AT)
            _PIECE.pack_into(self._pieces, at + _PIECE.size, table + 8 * pair, 8)
            _PIECE.pack_into(self._pieces, at + 2 * _PIECE.size, begin + _PORTS_AT, size - _PORTS_AT)
            _MESSAGE.pack_into(self._messages, place, 0, 0, pieces + at, 3, 0, 0, 0, 0)
            at += 3 * _PIECE.size
            place += _MESSAGE.size
        self.address = ctypes.addressof(ctypes.c_char.from_buffer(self._messages))

    def renew(self) -> None:
        """Give the hosts other addresses than in the pass before."""
        self._passes = (self._passes + 1) % _PASSES
        for number, original in enumerate(self._originals):
            change = self._passes if self._towards[number] else -self._passes
            first, second, third, fourth = struct.unpack(">HHHH", original)
            # In the upper halves: 10.10.x.y becomes 10.(10 + n).x.y, and the other 10.(10 - n) in words of 16 bits.
            struct.pack_into(
                ">HHHH", self._table, 8 * number, (first + change) & 0xFFFF, second, (third - change) & 0xFFFF, fourth
            )


class Line:
    """A socket that sends whole frames."""

    def __init__(self, interface: str) -> None:
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)
        self._socket.setsockopt(_SOL_PACKET, _QDISC_BYPASS, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        self._socket.bind((interface, 0))
        self._call = ctypes.CDLL(None, use_errno=True).sendmmsg
        self._call.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int)

    def many(self, address: int, count: int) -> int:
        """Send up to ``count`` messages from ``address`` on; return how many the kernel took."""
        sent = int(self._call(self._socket.fileno(), address, min(count, _MOST_A_CALL), 0))
        if sent < 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number))
        return sent

    def one(self, frame: bytes) -> None:
        """Send a frame."""
        self._socket.send(frame)


class Marks:
    """The connection of the marked transactions: ``sent`` are their times by the wall clock, ``frames`` all of its packets."""

    def __init__(self, line: Line, orders: int) -> None:
        self._line = line
        self.sent: list[int] = []
        self.frames = 0
        client, plc = Host(_MARKED_CLIENT), Host(_MARKED_PLC)
        self._client = Sender(client, 40000 + orders, plc, _S7_PORT, 1000)
        self._plc = Sender(plc, _S7_PORT, client, 40000 + orders, 5000)
        self._flags(self._client, SYN, b"\x02\x04\x05\xb4")
        self._flags(self._plc, SYN | ACK, b"\x02\x04\x05\xb4")
        self._say(self._client, self._plc, connect_tpdu(0xE0, 0, 1, 0x0A, b"\x01\x00", b"\x01\x02"))
        self._say(self._plc, self._client, connect_tpdu(0xD0, 1, 2, 0x0A, b"\x01\x00", b"\x01\x02"))
        self._say(self._client, self._plc, tpkt(request(JOB, 0xFFFF, setup_param(8, 8, 480))))
        self._say(self._plc, self._client, tpkt(answer(ACK_DATA, 0xFFFF, setup_param(8, 8, 480))))

    def send(self) -> None:
        """Send the next one: request and answer."""
        number = len(self.sent) & 0xFFFF
        self._say(self._client, self._plc, tpkt(request(JOB, number, bytes((READ, 1)) + _READ_ITEM)))
        at = time.time_ns()
        self._say(self._plc, self._client, tpkt(answer(ACK_DATA, number, bytes((READ, 1)), _READ_DATA)))
        self.sent.append(at)

    def end(self) -> None:
        """Close the connection."""
        self._flags(self._client, FIN | ACK)
        self._flags(self._plc, FIN | ACK)

    def _flags(self, sender: Sender, flags: int, options: bytes = b"") -> None:
        other = self._plc if sender is self._client else self._client
        self._line.one(sender.segment(flags, sender.seq, other.seq if flags & ACK else 0, b"", 0, options))
        sender.seq += 1
        self.frames += 1

    def _say(self, sender: Sender, other: Sender, payload: bytes) -> None:
        self._line.one(sender.segment(ACK | PSH, sender.seq, other.seq, payload))
        sender.seq += len(payload)
        self.frames += 1


class Replay:
    """Sends a load at a rate, pass after pass, and continues in the next order where the previous one ended."""

    def __init__(self, line: Line, load: Load) -> None:
        self._line = line
        self._load = load
        self._at = 0
        self._orders = 0

    def send(self, rate: int, seconds: float, marks_a_second: float = 0.0) -> dict[str, object]:
        """Send for ``seconds``; return the counts. ``behind_s`` is the longest time it was late by."""
        self._orders += 1
        marks = Marks(self._line, self._orders) if marks_a_second else None
        between = int(1e9 / marks_a_second) if marks_a_second else 0
        begun = time.monotonic_ns()
        end = begun + int(seconds * 1e9)
        next_mark = begun + between
        sent = behind = 0
        while (now := time.monotonic_ns()) < end:
            due = _MOST_A_CALL if rate < 0 else rate * (now - begun + _TURN_NS) // 1_000_000_000 - sent
            if rate > 0:
                behind = max(behind, due * 1_000_000_000 // rate - _TURN_NS)
            while due > 0 and time.monotonic_ns() < end:
                count = self._some(due)
                due -= count
                sent += count
                if marks is not None and time.monotonic_ns() >= next_mark:
                    break
            if marks is not None and now >= next_mark:
                marks.send()
                next_mark += between
            if rate >= 0:
                time.sleep(max(0, now + _TURN_NS - time.monotonic_ns()) / 1e9)
        took = (time.monotonic_ns() - begun) / 1e9
        if marks is not None:
            marks.end()
            sent += marks.frames
        return {
            "sent": sent,
            "seconds": took,
            "rate": sent / took,
            "behind_s": behind / 1e9,
            "marks": marks.sent if marks is not None else [],
        }

    def _some(self, due: int) -> int:
        load = self._load
        count = self._line.many(load.address + self._at * _MESSAGE.size, min(due, load.count - self._at))
        self._at += count
        if self._at == load.count:
            self._at = 0
            load.renew()
        return count


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak_sender", description=__doc__)
    parser.add_argument("interface")
    parser.add_argument("capture", type=Path)
    parser.add_argument("--packets", type=int, default=0, help="use only so many of the capture's (0: all)")
    options = parser.parse_args(arguments)
    with suppress(OSError):
        os.nice(-10)  # sending must not depend on how busy the watcher is
    replay = Replay(Line(options.interface), Load(options.capture, options.packets))
    print(json.dumps({"ready": True}), flush=True)
    for order in sys.stdin:
        rate, seconds, *rest = order.split()
        print(json.dumps(replay.send(int(rate), float(seconds), float(rest[0]) if rest else 0.0)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
