"""Connections that each read their own addresses: ``python -m benchmarks.many_connections PACKETS CONNECTIONS OUT``.

If many clients, or one that reconnects again and again, read something else each time, no parameter block is known from an
earlier connection. The comparison of few and many connections over the same number of packets shows the cost of one connection.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

from benchmarks.connection import CLIENT, MS, PLC, US, Connection
from benchmarks.frames import Host
from benchmarks.generate import parse_count
from benchmarks.pdus import Item, Variables, answer, connect_tpdu, request, setup_param, tapes, tpkt
from benchmarks.traffic import EPOCH_NS
from benchmarks.truth import Unit
from benchmarks.writers import CaptureWriter

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_SUCCESS: Final = 0xFF
_JOB, _ACK_DATA = 1, 3
_SIZES: Final = (0x02, 0x04, 0x06, 0x08)
#: Packets around the reads: the handshake, the connection request and Setup Communication with their answers, and the end.
_AROUND: Final = 12
_PLCS: Final = 30


class ManyConnections:
    """Connections one after the other, each with 3 to 11 reads of 1 to 5 items, which it repeats."""

    def __init__(self, seed: int = 1) -> None:
        self._rng = Random(seed)
        self._tapes = tapes(self._rng)
        self._plcs = [Host(0x0A0A0100 + number, b"\x00\x1b\x1b") for number in range(_PLCS)]
        self._time_ns = EPOCH_NS

    def connection(self, number: int, packets: int) -> Iterator[tuple[int, bytes]]:
        """Yield time in ns and frame of ``packets`` packets of a new connection (of 15 for fewer)."""
        rng = self._rng
        client = Host(0x0A100000 + number // 50)
        port = 20000 + number % 50 * 7
        made = Connection(rng, client, port, self._plcs[number % _PLCS], stamps=False, pad=False)
        now = made.open(self._time_ns, 200 * US)
        tsaps = b"\x01\x00", b"\x01\x02"
        now = self._exchange(made, now, connect_tpdu(0xE0, 0, 1, 0x0A, *tsaps), connect_tpdu(0xD0, 1, 2, 0x0A, *tsaps))
        setup = setup_param(1, 1, 240)
        now = self._exchange(made, now, tpkt(request(_JOB, 0, setup)), tpkt(answer(_ACK_DATA, 0, setup)))
        reads = [self._read() for _ in range(rng.randint(3, 11))]
        for turn in range(max(1, (packets - _AROUND) // 3)):
            read = reads[turn % len(reads)]
            asked = tpkt(request(_JOB, turn + 1 & 0xFFFF, read.param))
            values = read.values(rng.getrandbits(20), _SUCCESS)
            now = self._exchange(made, now, asked, tpkt(answer(_ACK_DATA, turn + 1 & 0xFFFF, read.param[:2], values)))
        self._time_ns = made.finish(now, CLIENT) + MS
        for draft in made.drafts:
            yield draft.time_ns, draft.build()

    def _read(self) -> Variables:
        rng = self._rng
        items = [
            Item(rng.choice(_SIZES), 1, rng.randint(1, 400), 0x84, rng.randrange(4000) * 8)
            for _ in range(rng.randint(1, 5))
        ]
        return Variables(0x04, items, self._tapes)

    def _exchange(self, made: Connection, now: int, asked: bytes, answered: bytes) -> int:
        made.send(now, CLIENT, [(asked, Unit("DT"))])
        now += self._rng.randrange(2 * MS, 9 * MS)
        made.send(now, PLC, [(answered, Unit("DT"))])
        return made.ack(now + 40 * US, CLIENT) + MS


def many_connections(path: Path, packets: int, connections: int) -> int:
    """Write ``packets`` packets, spread evenly over ``connections``, to ``path``; return how many there are."""
    source = ManyConnections()
    with path.open("wb") as file:
        writer = CaptureWriter(file)
        for number in range(connections):
            for time_ns, frame in source.connection(number, packets // connections):
                writer.write(time_ns, frame)
        writer.flush()
    return writer.packets


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.many_connections", description=__doc__)
    parser.add_argument("packets", type=parse_count, help="how many: 100k, 1M …")
    parser.add_argument("connections", type=parse_count)
    parser.add_argument("out", type=Path, help="the capture to write (pcap)")
    options = parser.parse_args(arguments)
    print(f"{many_connections(options.out, options.packets, options.connections)} packets")
    return 0


if __name__ == "__main__":
    sys.exit(main())
