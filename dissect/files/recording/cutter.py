"""The second reading of a capture: writes the wanted packets, and some packets around them, to a pcapng file. Compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.files.recording.recent import KeptPacket, RecentPackets
from dissect.packets.source.packet import PacketSink, Reader
from dissect.packets.source.packet_blocks import PacketBlocks

if TYPE_CHECKING:  # interpreted
    from dissect.meaning.select.selection import Choice
    from dissect.packets.source.pcapng_writer import PcapngWriter

#: Maximum number of octets of packets that are held, in case a later packet is wanted.
MAX_HELD: Final = 64 * 1024 * 1024

_FOREVER_NS: Final = 2**62
_MAX_COMMENTS: Final = 64
#: Size of the groups of blocks that go to the writer together, in octets.
_TOGETHER: Final = 65_536


class Around:
    """The amount that is written around each wanted packet: ``packets`` packets, and all within ``ns`` nanoseconds."""

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
        self.frames: i64 = 0
        self.chosen: i64 = 0
        self.beside: i64 = 0
        self.commented: i64 = 0
        self.secrets_kept: i64 = 0
        self.numbers: dict[int, int] = {}
        self._mark: i64 = mark
        self._choice: Choice = choice
        self._findings: dict[int, list[str]] = choice.comments
        self._everything: bool = choice.everything  # between these two times
        self._from_ns: i64 = max(choice.times[0], -_FOREVER_NS)
        self._to_ns: i64 = min(choice.times[1], _FOREVER_NS)
        self._writer: PcapngWriter = writer
        self._blocks: PacketBlocks | None = None  # packets of this interface that are not given to the writer yet
        self._link_type: i64 = -1
        self._name: str = ""
        around = around if around is not None else Around()
        self._after: Around = around
        self._recent: RecentPackets | None = None
        if around.packets or around.ns:
            self._recent = RecentPackets(MAX_HELD, around.ns or _FOREVER_NS, around.packets)
        self._left: i64 = 0  # number of packets still to be written after the last wanted one
        self._until_ns: int = -1
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
        self._give()

    def comment(self, text: str) -> None:
        """Take a comment in the capture on the next packet, which keeps it."""
        if len(self._comments) < _MAX_COMMENTS:
            self._comments.append(text)

    def secrets(self, text: bytes) -> None:
        """Copy TLS keys in the capture, so that the written file can be decrypted, too."""
        self.secrets_kept += 1
        self._give()
        self._writer.secrets(text)

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Take a packet: write it, hold it, or drop it."""
        self.frames += 1
        wanted: bool
        if self._everything:
            wanted = self._from_ns <= time_ns <= self._to_ns
        else:
            wanted = self._choice.takes(int(self.frames), int(time_ns), buf, int(start), int(end), int(link_type))
        comments = self._comments
        if self._recent is None and (not wanted or (not comments and self._is_plain())):
            if wanted:
                self._gather(time_ns, buf, start, end, wire_length, link_type)
            elif comments:
                self._comments = []
            return
        self._comments = []  # a new list: the packet keeps the old one
        packet = KeptPacket(
            int(self.frames),
            int(time_ns),
            buf[start:end],
            int(wire_length),
            int(link_type),
            self._interface(),
            comments,
        )
        if wanted:
            self._take(packet)
        elif self._left > 0 or packet.time_ns <= self._until_ns:
            self._left -= 1
            self.beside += 1
            self._write(packet)
        elif self._recent is not None:
            self._recent.add(packet)

    def _is_plain(self) -> bool:
        """Return whether a packet has no finding, and its number in the written file is not needed."""
        return self.chosen > 0 and self.frames != self._mark and int(self.frames) not in self._findings

    def _interface(self) -> str:
        return self._reader.interface if self._reader is not None else ""

    def _gather(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Write a wanted packet without comments, together with others."""
        self.chosen += 1
        name = self._interface()
        blocks = self._blocks
        if blocks is None or link_type != self._link_type or name != self._name:
            self._give()
            blocks = self._writer.blocks(int(link_type), name)
            self._blocks = blocks
            self._link_type = link_type
            self._name = name
        blocks.add(int(time_ns), buf[start:end], wire_length)
        if blocks.octets >= _TOGETHER:
            self._writer.put(blocks)

    def _give(self) -> None:
        """Give the gathered packets to the writer: the next packet does not belong to them."""
        if self._blocks is not None:
            self._writer.put(self._blocks)

    def _take(self, packet: KeptPacket) -> None:
        self.chosen += 1
        self._give()
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
        self._give()
        findings = self._findings.get(packet.frame)
        if findings or packet.frame == self._mark:
            self.numbers[packet.frame] = self._writer.packets + 1
        if findings:
            self.commented += 1
            packet.comments.extend(findings)
        self._writer.packet(
            packet.time_ns, packet.octets, packet.wire_length, packet.link_type, packet.comments, packet.interface
        )
