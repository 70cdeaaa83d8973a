"""The second reading of a capture: writes the wanted packets, and some packets around them, to a pcapng file."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.recording.recent import KeptPacket, RecentPackets
from dissect.select.selection import Choice
from dissect.source.packet import PacketSink, Reader
from dissect.source.pcapng_writer import PcapngWriter

#: At most so many octets of packets are held, in case a later packet is wanted.
MAX_HELD: Final = 64 * 1024 * 1024

_FOREVER_NS: Final = 2**62
_MAX_COMMENTS: Final = 64


class Around:
    """How much is written around each wanted packet: so many ``packets``, and all within ``ns`` nanoseconds."""

    __slots__ = ("ns", "packets")

    def __init__(self, packets: int = 0, ns: int = 0) -> None:
        self.packets = packets
        self.ns = ns


class Cutter(PacketSink):
    """Writes the packets that ``choice`` wants, in their order, from a capture that `read_all` reads for the second time.

    ``frames`` counts the packets that were read, ``chosen`` the wanted ones, ``beside`` those written because they are near a
    wanted one, and ``commented`` those with a finding as a comment; ``shortened`` counts packets near a wanted one that could
    not be held for lack of memory. ``secrets_kept`` counts copied Decryption Secrets Blocks. ``numbers`` has the numbers in the
    written file: those of packets with a finding, that of packet ``mark`` (0: none), and under 0 that of the first wanted one.
    """

    def __init__(self, choice: Choice, writer: PcapngWriter, around: Around | None = None, mark: int = 0) -> None:
        self.frames = 0
        self.chosen = 0
        self.beside = 0
        self.commented = 0
        self.secrets_kept = 0
        self.numbers: dict[int, int] = {}
        self._mark = mark
        self._choice = choice
        self._writer = writer
        around = around if around is not None else Around()
        self._after = around
        self._recent: RecentPackets | None = None
        if around.packets or around.ns:
            self._recent = RecentPackets(MAX_HELD, around.ns or _FOREVER_NS, around.packets)
        self._left = 0  # so many further packets are written after the last wanted one
        self._until_ns = -1
        self._reader: Reader | None = None
        self._comments: list[str] = []

    @property
    def shortened(self) -> int:
        """The number of packets that may have been near a wanted one, and could not be held for lack of memory."""
        return self._recent.shortened if self._recent is not None else 0

    def read_all(self, reader: Reader) -> None:
        """Read one file to its end; call it for the files of a run in the same order as in the first reading."""
        self._reader = reader
        while reader.step(self):
            pass

    def comment(self, text: str) -> None:
        """Take a comment in the capture on the next packet, which keeps it."""
        if len(self._comments) < _MAX_COMMENTS:
            self._comments.append(text)

    def secrets(self, text: bytes) -> None:
        """Copy TLS keys in the capture, so that the written file can be decrypted, too."""
        self.secrets_kept += 1
        self._writer.secrets(text)

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Take a packet: write it, hold it, or drop it."""
        self.frames += 1
        comments = self._comments
        self._comments = []  # a new list: the packet keeps the old one
        wanted = self._choice.takes(self.frames, time_ns, buf, start, end, link_type)
        if not wanted and self._recent is None:
            return
        name = self._reader.interface if self._reader is not None else ""
        packet = KeptPacket(self.frames, int(time_ns), buf[start:end], int(wire_length), int(link_type), name, comments)
        if wanted:
            self._take(packet)
        elif self._left > 0 or packet.time_ns <= self._until_ns:
            self._left -= 1
            self.beside += 1
            self._write(packet)
        elif self._recent is not None:
            self._recent.add(packet)

    def _take(self, packet: KeptPacket) -> None:
        self.chosen += 1
        if self._recent is not None:
            for before in self._recent.within(packet.time_ns):
                self.beside += 1
                self._write(before)
            self._recent.clear()
            self._left = self._after.packets
            self._until_ns = packet.time_ns + self._after.ns if self._after.ns else -1
        self.numbers.setdefault(0, self._writer.packets + 1)
        self._write(packet)

    def _write(self, packet: KeptPacket) -> None:
        findings = self._choice.comments.get(packet.frame)
        if findings or packet.frame == self._mark:
            self.numbers[packet.frame] = self._writer.packets + 1
        if findings:
            self.commented += 1
            packet.comments.extend(findings)
        self._writer.packet(
            packet.time_ns, packet.octets, packet.wire_length, packet.link_type, packet.comments, packet.interface
        )
