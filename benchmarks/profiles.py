"""Write an endless stream to a file or to standard output: ``python -m benchmarks.profiles NAME SIZE OUT``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from benchmarks.generate import parse_count
from benchmarks.streams import MTU, NAMES, SMALL, stream, why
from benchmarks.writers import FORMATS, CaptureWriter

if TYPE_CHECKING:
    from collections.abc import Sequence

GIB = 1 << 30


class Extent:
    """The length of a stream: in packets, or in octets of the file."""

    __slots__ = ("octets", "packets")

    def __init__(self, packets: int = 0, octets: int = 0) -> None:
        self.packets = packets
        self.octets = octets


def parse_extent(text: str) -> Extent:
    """Return the extent written as ``0.05GiB`` or as a number of packets (``100k``, ``5M``)."""
    if not text.endswith("GiB"):
        return Extent(packets=parse_count(text))
    try:
        octets = int(float(text[:-3]) * GIB)
    except ValueError:
        octets = 0
    if octets <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no size; write for example 0.05GiB, or a number of packets")
    return Extent(octets=octets)


def write_profile(file: BinaryIO, name: str, extent: Extent, size: int = SMALL, kind: str = "pcap") -> int:
    """Write the stream ``name`` to ``file`` until ``extent`` is reached; return the number of packets."""
    writer = CaptureWriter(file, kind)
    octets = 0
    for time_ns, frame in stream(name, size):
        writer.write(time_ns, frame)
        octets += len(frame) + 16
        if writer.packets == extent.packets or (extent.octets and octets >= extent.octets):
            break
    writer.flush()
    return writer.packets


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.profiles",
        description=__doc__,
        epilog="\n".join(f"{name}: {why(name)}" for name in NAMES),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", choices=NAMES)
    parser.add_argument("size", type=parse_extent, help="0.05GiB, 1GiB, or packets: 20k, 1M")
    parser.add_argument("out", help="the capture to write, - for standard output")
    parser.add_argument("--mtu", action="store_true", help="frames that fill the MTU instead of small ones")
    parser.add_argument("--format", choices=FORMATS, default="pcap")
    options = parser.parse_args(arguments)
    size = MTU if options.mtu else SMALL
    if options.out == "-":
        packets = write_profile(sys.stdout.buffer, options.name, options.size, size, options.format)
    else:
        with Path(options.out).open("wb") as file:
            packets = write_profile(file, options.name, options.size, size, options.format)
    print(f"{options.name}: {packets} packets", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
