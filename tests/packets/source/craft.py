"""Shared by the tests of the readers: captures crafted octet by octet, a source in memory, a sink that remembers."""

from __future__ import annotations

import resource
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

from mypy_extensions import i64

from dissect.packets.source.packet import PacketSink, Reader
from dissect.packets.source.pcap import PCAP_MAGICS, PcapReader
from dissect.packets.source.pcapng import PcapngReader

NS: Final = 1_000_000_000
#: 2023-11-14 22:13:20 UTC, in seconds.
EPOCH: Final = 1_700_000_000
ETHERNET: Final = 1
SLL: Final = 113

UNRESTRICTED: Final = 1 << 20


class Frame(NamedTuple):
    """One packet as a sink gets it."""

    time_ns: int
    octets: bytes
    wire_length: int
    link_type: int


class Recorder(PacketSink):
    """Remembers packets and comments; a comment with the number of the packet it precedes."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.comments: list[tuple[int, str]] = []

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        assert 0 <= start <= end <= len(buf)
        self.frames.append(Frame(time_ns, buf[start:end], wire_length, link_type))

    def comment(self, text: str) -> None:
        self.comments.append((len(self.frames) + 1, text))


class MemorySource:
    """Octets in memory, given in pieces of at most ``piece``; counts the octets taken."""

    def __init__(self, octets: bytes, piece: int = UNRESTRICTED) -> None:
        self.damage = ""
        self.taken = 0
        self.closed = False
        self._octets = octets
        self._piece = piece

    def read(self, size: int) -> bytes:
        octets = self._octets[self.taken : self.taken + min(size, self._piece)]
        self.taken += len(octets)
        return octets

    def close(self) -> None:
        self.closed = True


def reader_of(octets: bytes, piece: int = UNRESTRICTED) -> Reader:
    """Return the reader for the first four octets, over a source in memory."""
    source = MemorySource(octets, piece)
    head = b""
    while len(head) < 4:
        head += source.read(max(4, min(piece, UNRESTRICTED)))
    return PcapReader(source, head) if head[:4] in PCAP_MAGICS else PcapngReader(source, head)


def step_to_the_end(reader: Reader, sink: PacketSink) -> None:
    """Read to the end."""
    while reader.step(sink):
        pass


def drain(reader: Reader) -> Recorder:
    """Read to the end; the counts of the reader must be those of the sink, and the end must be final."""
    recorder = Recorder()
    step_to_the_end(reader, recorder)
    assert reader.packets == len(recorder.frames)
    assert not reader.step(recorder)
    reader.close()
    reader.close()
    assert not reader.step(recorder)
    assert reader.packets == len(recorder.frames)
    return recorder


class Sample:
    """A capture under construction, the frames that it must give, and the places where it may be cut without damage.

    ``ends`` has, for each frame, the offset at which its record is complete; ``boundaries`` has every offset between two
    records.
    """

    def __init__(self, octets: bytes = b"") -> None:
        self._written = bytearray(octets)
        self.frames: list[Frame] = []
        self.ends: list[int] = []
        self.boundaries: set[int] = set()

    @property
    def octets(self) -> bytes:
        """The octets so far."""
        return bytes(self._written)

    @octets.setter
    def octets(self, octets: bytes) -> None:
        self._written = bytearray(octets)

    def add(self, octets: bytes, frame: Frame | None = None) -> None:
        """Add a record or block, with the resulting frame."""
        self._written += octets
        self.boundaries.add(len(self._written))
        if frame is not None:
            self.frames.append(frame)
            self.ends.append(len(self._written))

    def frames_before(self, size: int) -> list[Frame]:
        """Return the frames whose records are completely in the first ``size`` octets."""
        return [frame for frame, end in zip(self.frames, self.ends, strict=True) if end <= size]


class Pcap(Sample):
    """A classic pcap file."""

    def __init__(
        self,
        big: bool = False,
        nanoseconds: bool = False,
        modified: bool = False,
        version: tuple[int, int] = (2, 4),
        link_type: int = ETHERNET,
        snaplen: int = 65535,
    ) -> None:
        super().__init__()
        self.order = ">" if big else "<"
        self.unit = 1 if nanoseconds else 1000
        self.modified = modified
        self.link_type = link_type
        magic = 0xA1B2CD34 if modified else 0xA1B23C4D if nanoseconds else 0xA1B2C3D4
        self.add(struct.pack(f"{self.order}IHHiIII", magic, *version, 0, 0, snaplen, link_type))

    def record(self, seconds: int, fraction: int, captured: int, wire: int, octets: bytes) -> bytes:
        """Return a record with every field as given."""
        header = struct.pack(f"{self.order}IIII", seconds, fraction, captured, wire)
        return header + (struct.pack(f"{self.order}IHBx", 2, 0x0800, 0) if self.modified else b"") + octets

    def packet(self, time_ns: int, octets: bytes, wire: int | None = None) -> None:
        """Add a valid packet; ``time_ns`` must be a whole number of the file's units."""
        wire = len(octets) if wire is None else wire
        record = self.record(time_ns // NS, time_ns % NS // self.unit, len(octets), wire, octets)
        self.add(record, Frame(time_ns, octets, wire, self.link_type & 0xFFFF))


class Pcapng(Sample):
    """A pcapng file; ``big`` changes with every section."""

    def __init__(self, big: bool = False, begin: bool = True) -> None:
        super().__init__()
        self.order = ""
        self.link_types: list[int] = []
        if begin:
            self.section(big)

    def block(self, kind: int, body: bytes, frame: Frame | None = None) -> None:
        """Add a block with a right frame around ``body``."""
        self.add(self.framed(kind, body), frame)

    def framed(self, kind: int, body: bytes, front: int | None = None, back: int | None = None) -> bytes:
        """Return a block; ``front`` and ``back`` are its two lengths if they are to be false."""
        body += bytes(-len(body) % 4)
        total = 12 + len(body)
        return (
            struct.pack(f"{self.order}II", kind, total if front is None else front)
            + body
            + struct.pack(f"{self.order}I", total if back is None else back)
        )

    def option(self, code: int, value: bytes) -> bytes:
        """Give an option."""
        return struct.pack(f"{self.order}HH", code, len(value)) + value + bytes(-len(value) % 4)

    def section(self, big: bool = False, version: int = 1, options: bytes = b"") -> None:
        """Add a section header."""
        self.order = ">" if big else "<"
        self.link_types = []
        self.block(0x0A0D0D0A, struct.pack(f"{self.order}IHHq", 0x1A2B3C4D, version, 0, -1) + options)

    def interface(self, link_type: int = ETHERNET, snaplen: int = 0, options: bytes = b"") -> None:
        """Add an interface description."""
        self.link_types.append(link_type)
        self.block(1, struct.pack(f"{self.order}HxxI", link_type, snaplen) + options)

    def resolution(self, value: int) -> bytes:
        """Give an if_tsresol option and the end of options."""
        return self.option(9, bytes([value])) + self.option(0, b"")

    def enhanced(
        self, ticks: int, octets: bytes, number: int = 0, wire: int | None = None, options: bytes = b""
    ) -> bytes:
        """Give the body of an Enhanced Packet Block."""
        wire = len(octets) if wire is None else wire
        header = struct.pack(f"{self.order}IIIII", number, ticks >> 32, ticks & 0xFFFFFFFF, len(octets), wire)
        return header + octets + bytes(-len(octets) % 4) + options

    def packet(
        self,
        ticks: int,
        time_ns: int,
        octets: bytes,
        number: int = 0,
        wire: int | None = None,
        options: bytes = b"",
        old: bool = False,
    ) -> None:
        """Add a packet of ``ticks`` of its interface's clock, which must come out as ``time_ns``."""
        body = self.enhanced(ticks, octets, number, wire, options)
        if old:
            body = struct.pack(f"{self.order}HH", number, 0xFFFF) + body[4:]
        wire = len(octets) if wire is None else wire
        self.block(2 if old else 6, body, Frame(time_ns, octets, wire, self.link_types[number]))

    def simple(self, time_ns: int, octets: bytes, wire: int | None = None) -> None:
        """Add a packet in a Simple Packet Block, which must get the time ``time_ns``."""
        wire = len(octets) if wire is None else wire
        frame = Frame(time_ns, octets, wire, self.link_types[0])
        self.block(3, struct.pack(f"{self.order}I", wire) + octets, frame)


@contextmanager
def small_disk(most: int) -> Iterator[None]:
    """No file of this process may grow beyond this many octets: the write that would exceed it is cut short, as on a full disk.

    Keep it short: pytest's output may go to a file.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
