"""`PcapReader` for classic pcap files, and `ChunkReader`, the base class of it and of the reader of pcapng.

The format is draft-ietf-opsawg-pcap: a header of 24 octets, then records of a header of 16 octets and the packet. It reads both
byte orders, microseconds and nanoseconds, the "modified" format of old tcpdump patches (magic 0xa1b2cd34, record headers of 24
octets), and the swapped length fields of files older than version 2.4.
"""

from __future__ import annotations

import struct
from typing import Final, Protocol

from librt.strings import read_i32_le, read_i64_be, read_i64_le
from mypy_extensions import i64

from dissect.packets.source.packet import PacketSink, Reader
from dissect.wire.build import COMPILED

#: How many octets are read at a time. Above 128 KiB the C library may map and unmap memory for every chunk, which was measured
#: to cost up to three times as much as reading the packets; below, the cost does not depend on the state of the heap.
CHUNK: Final = 64 * 1024

#: The largest packet accepted, on Ethernet and on any other link; a record that claims more is damaged. (libpcap uses the first
#: bound for all links.)
MAX_ETHERNET_PACKET: Final = 256 * 1024
MAX_PACKET: Final = 16 * 1024 * 1024

LINKTYPE_ETHERNET: Final = 1

#: The first four octets of a pcap file -> (big-endian, nanoseconds, size of a record header).
PCAP_MAGICS: Final[dict[bytes, tuple[bool, bool, int]]] = {
    b"\xd4\xc3\xb2\xa1": (False, False, 16),
    b"\xa1\xb2\xc3\xd4": (True, False, 16),
    b"\x4d\x3c\xb2\xa1": (False, True, 16),
    b"\xa1\xb2\x3c\x4d": (True, True, 16),
    b"\x34\xcd\xb2\xa1": (False, False, 24),
    b"\xa1\xb2\xcd\x34": (True, False, 24),
}

_FILE_HEADER: Final = 24

_ODD_FRACTION: Final = "a time stamp holds {} parts of a second, a whole second or more, and was read as it stands"
#: The note about a packet with an impossible wire length; for pcapng as well.
SHORT_WIRE: Final = "a packet claims only {} bytes on the wire, fewer than were captured, and was treated as complete"
#: If files were joined with cat, the first 16 octets of the second file header look like the record of an empty packet. Its
#: last 8 octets look like the beginning of a record, whose packet size is in fact the time of the next packet.
_JOINED: Final = "another pcap file begins there; join files with mergecap, not with cat"
_ODD_VERSION: Final = "the file says it is version {} of the format, and was read as version 2.4"


def u32le(octets: bytes, at: i64) -> i64:
    """Return the four octets at ``at`` as a little-endian number; IndexError when they are not there."""
    return i64(read_i32_le(octets, at)) & 0xFFFFFFFF


def packet_limit(link_type: i64) -> i64:
    """Return the largest packet, in octets, that is accepted on ``link_type``."""
    return MAX_ETHERNET_PACKET if link_type == LINKTYPE_ETHERNET else MAX_PACKET


class OctetSource(Protocol):
    """The octets of a capture, decompressed, from any kind of input (see `files`)."""

    @property
    def damage(self) -> str:
        """Empty, or what went wrong while reading: a failing disk, compressed data that is cut or corrupt."""

    def read(self, size: int) -> bytes:
        """Return up to ``size`` octets, waiting for them if need be; none at the end. Never raises.

        A zstd block is returned whole, even if it has more than ``size`` octets (128 KiB at most).
        """

    def close(self) -> None:
        """Release all resources. May be called twice."""


class _Oddity:
    """Something odd in a capture: a sentence with a number in it, where it was first found, and how often."""

    def __init__(self, sentence: str, number: i64, offset: i64) -> None:
        self.text: str = sentence.replace("{}", str(number))
        self.offset: i64 = offset
        self.count: i64 = 0

    def __str__(self) -> str:
        times = f", the first of {self.count} like it" if self.count > 1 else ""
        return f"{self.text} (at byte {self.offset}{times})"


class ChunkReader(Reader):
    """The base class of readers of records, which ``source`` gives in chunks of any size.

    ``head`` are the octets already taken from ``source`` to recognise its format. ``octets`` counts the decompressed octets of
    the source. A subclass scans `_buf` from `_pos`, and calls `_fill` with the size that the next record needs.
    """

    def __init__(self, source: OctetSource, head: bytes) -> None:
        super().__init__()
        self.octets = len(head)
        self._source: OctetSource = source
        self._buf: bytes = head
        self._pos: i64 = 0
        self._rest: bytes = b""  # the latest chunk; its octets before `_rest_at` are in `_buf` already
        self._rest_at: i64 = 0
        self._need: i64 = 0
        self._done: bool = False
        self._oddities: dict[str, _Oddity] = {}
        self._told: bool = True

    def close(self) -> None:
        """Release the file. May be called twice; nothing is read after it."""
        self._done = True
        self._buf = b""
        self._pos = 0
        self._rest = b""
        self._rest_at = 0
        self._source.close()

    def _offset(self, at: i64) -> i64:
        """Return the offset of ``_buf[at]`` in the capture."""
        return self.octets - len(self._rest) + self._rest_at - len(self._buf) + at

    def _fill(self, need: i64) -> bool:
        """Make sure that ``_buf`` has at least ``need`` octets from ``_pos`` on; return False when the source ends before."""
        have: i64 = len(self._buf) - self._pos
        if have >= need:
            return True
        # Pieces are joined only once, because a pipe may give one octet at a time. The old buffer is freed first, so that its
        # memory is there for the next piece.
        pieces = [self._buf[self._pos :]] if have else []
        self._buf = b""
        self._pos = 0
        try:
            while have < need:
                if not self._rest:
                    piece = self._source.read(CHUNK)
                    if not piece:
                        break
                    self.octets += len(piece)
                    self._rest = piece
                    self._rest_at = 0
                if have == 0:
                    # Use the chunk itself as the buffer, without a copy.
                    self._buf = self._rest
                    self._pos = self._rest_at
                    have = len(self._buf) - self._pos
                    self._rest = b""
                    self._rest_at = 0
                    if have >= need:
                        return True
                    pieces.append(self._buf[self._pos :])
                    continue
                # Copy only the part of the chunk that belongs to the record.
                stop: i64 = min(self._rest_at + need - have, len(self._rest))
                pieces.append(self._rest[self._rest_at : stop])
                have += stop - self._rest_at
                if stop == len(self._rest):
                    self._rest = b""
                    stop = 0
                self._rest_at = stop
        finally:
            # Also after an interrupt (Ctrl-C) in `read`: no octets already read are lost.
            if pieces:
                self._buf = pieces[0] if len(pieces) == 1 else b"".join(pieces)
                self._pos = 0
        return have >= need

    def _goes_on(self) -> bool:
        """Make sure that ``_buf`` has the next record if all of it was read; return False if ``source`` must be read first."""
        left: i64 = len(self._rest) - self._rest_at
        if left == 0 or self._done:
            return False
        return len(self._buf) - self._pos + left >= self._need and self._fill(self._need)

    def _finish(self, inside: str) -> None:
        """The source has ended, so end too. ``inside`` says what is cut if octets are left over."""
        damage = self._source.damage
        if self._pos < len(self._buf):
            at = f"at byte {self.octets}, {inside}"
            damage = f"{damage}; the capture that could be read ends {at}" if damage else f"cut off {at}"
        self._end(damage)

    def _stop(self, at: i64, why: str) -> None:
        """End at ``_buf[at]``: this record cannot be read, and the next one cannot be found."""
        packets = "1 packet" if self.packets == 1 else f"{self.packets} packets"
        self._end(f"damaged at byte {self._offset(at)}, after {packets}: {why}")

    def _end(self, damage: str) -> None:
        self.damage = damage
        self._tell()
        self.close()

    def _note(self, sentence: str, number: i64, at: i64) -> None:
        """Count an oddity at ``_buf[at]`` by its sentence.

        Braces in the sentence are replaced by the ``number`` of the first occurrence.
        """
        oddity = self._oddities.get(sentence)
        if oddity is None:
            oddity = _Oddity(sentence, number, self._offset(at))
            self._oddities[sentence] = oddity
        oddity.count += 1
        self._told = False

    def _reject(self, sentence: str, number: i64, at: i64) -> None:
        """Give up the block at ``_buf[at]`` and note why."""
        self.rejected += 1
        self._note(sentence, number, at)

    def _tell(self) -> None:
        """Bring ``notes`` up to date."""
        if not self._told:
            self.notes = [str(oddity) for oddity in self._oddities.values()]
            self._told = True


class PcapReader(ChunkReader):
    """A classic pcap file. ``head`` begins with one of `PCAP_MAGICS`."""

    def __init__(self, source: OctetSource, head: bytes) -> None:
        super().__init__(source, head)
        big, nanoseconds, header = PCAP_MAGICS[head[:4]]
        self._big: bool = big
        self._parts: i64 = 1_000_000_000 if nanoseconds else 1_000_000
        self._header: i64 = header
        self._record: struct.Struct = struct.Struct(">IIII" if big else "<IIII")
        self._old: bool = False
        self._link_type: i64 = 0
        self._ends: bytes = b""  # the last octets of the file header: snap length and link type
        self._begun: bool = False
        self._need = _FILE_HEADER

    def step(self, sink: PacketSink) -> bool:
        """Read about one chunk and deliver its packets to ``sink``; return False when there is nothing more to read."""
        if self._done:
            return False
        if not self._fill(self._need):
            inside = f"inside the record of packet {self.packets + 1}" if self._begun else "inside the file header"
            self._finish(inside)
            return False
        if not self._begun:
            self._begin()
        self._scan(sink)
        while self._goes_on():
            self._scan(sink)
        self._tell()
        return not self._done

    def _begin(self) -> None:
        """Read the file header; its time zone, accuracy and snap length are ignored."""
        order = ">" if self._big else "<"
        major, minor, link = struct.unpack_from(f"{order}4xHH12xI", self._buf)
        if major != 2 or minor > 4:
            self._note(_ODD_VERSION.replace("{}", f"{major}.{minor}"), 0, 4)
        self._old = major == 2 and minor < 4
        # The upper half describes frame check sequences, which come after the end given by the IP length.
        self._link_type = link & 0xFFFF
        self._ends = self._buf[16:_FILE_HEADER]
        self._begun = True
        self._pos = _FILE_HEADER

    def _scan(self, sink: PacketSink) -> None:
        """Deliver every whole record in the buffer."""
        buf = self._buf
        size: i64 = len(buf)
        pos: i64 = self._pos
        count: i64 = self.packets
        header: i64 = self._header
        need: i64 = header
        link_type: i64 = self._link_type
        limit: i64 = packet_limit(link_type)
        parts: i64 = self._parts
        unit: i64 = 1_000_000_000 // parts
        big = self._big
        compiled = COMPILED
        unpack = self._record.unpack_from
        seconds: i64
        fraction: i64
        captured: i64
        wire: i64
        pair: i64
        absurd: i64 = 0
        try:
            while pos + header <= size:
                if not compiled:
                    seconds, fraction, captured, wire = unpack(buf, pos)
                elif big:  # each read gives two numbers
                    pair = read_i64_be(buf, pos)
                    seconds, fraction = pair >> 32 & 0xFFFFFFFF, pair & 0xFFFFFFFF
                    pair = read_i64_be(buf, pos + 8)
                    captured, wire = pair >> 32 & 0xFFFFFFFF, pair & 0xFFFFFFFF
                else:
                    pair = read_i64_le(buf, pos)
                    seconds, fraction = pair & 0xFFFFFFFF, pair >> 32 & 0xFFFFFFFF
                    pair = read_i64_le(buf, pos + 8)
                    captured, wire = pair & 0xFFFFFFFF, pair >> 32 & 0xFFFFFFFF
                if wire < captured and self._old:
                    captured, wire = wire, captured
                start = pos + header
                end = start + captured
                if end > size or captured > limit:
                    if captured > limit:
                        absurd = captured
                    else:
                        need = header + captured
                    break
                if wire < captured:
                    self._note(SHORT_WIRE, wire, pos)
                    wire = captured
                if fraction >= parts:
                    self._note(_ODD_FRACTION, fraction, pos)
                pos = end
                count += 1
                sink.frame(seconds * 1_000_000_000 + fraction * unit, buf, start, end, wire, link_type)
        finally:
            self._pos = pos
            self.packets = count
            self._need = need
        if absurd:
            if buf[pos : pos + 8] == self._ends:
                self._stop(pos - 16, _JOINED)
            else:
                self._stop(pos, f"a record claims a packet of {absurd} bytes")
