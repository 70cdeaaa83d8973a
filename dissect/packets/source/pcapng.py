"""`PcapngReader` for pcapng files (draft-ietf-opsawg-pcapng), with any number of sections and interfaces, in either byte order.

It reads the Section Header, Interface Description, Enhanced Packet and Simple Packet Blocks and the obsolete Packet Block, the
comments of packets, and TLS key logs in Decryption Secrets Blocks; Interface Statistics Blocks are kept. Other blocks are
skipped. A Simple Packet Block has no time; its packet gets the time of the packet before it (0 when there is none).

An inconsistent block is skipped, counted in ``rejected`` and explained in ``notes``. Reading ends only if the next block cannot
be found: at an impossible block length, or after two blocks in a row whose lengths at start and end differ.
"""

from __future__ import annotations

import struct
from typing import Final

from librt.strings import read_i64_le
from mypy_extensions import i64

from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcap import SHORT_WIRE, ChunkReader, OctetSource, packet_limit, u32le
from dissect.wire.build import COMPILED
from dissect.wire.octets import u32

#: The first four octets of a section, which are the same in both byte orders, and the octets at offset 8.
PCAPNG_MAGIC: Final = b"\x0a\x0d\x0d\x0a"
BYTE_ORDER_MAGICS: Final = (b"\x1a\x2b\x3c\x4d", b"\x4d\x3c\x2b\x1a")

#: The largest block accepted (libpcap's and Wireshark's bound), and the most interfaces kept for a section.
MAX_BLOCK: Final = 16 * 1024 * 1024
MAX_INTERFACES: Final = 65_536

#: Types of blocks and codes of options; `dissect.packets.source.pcapng_writer` uses them as well.
SECTION: Final = 0x0A0D0D0A
INTERFACE: Final = 1
_OLD_PACKET: Final = 2
_SIMPLE_PACKET: Final = 3
STATISTICS: Final = 5
ENHANCED_PACKET: Final = 6
DECRYPTION_SECRETS: Final = 10
#: The type of secrets that is a TLS key log ("TLSK").
TLS_KEY_LOG: Final = 0x544C534B

_MIN_BLOCK: Final = 12
_MIN_SECTION: Final = 28
_MIN_INTERFACE: Final = 20
_MIN_SIMPLE: Final = 16
#: The largest statistics block kept; real ones have about a hundred octets.
_MAX_STATISTICS: Final = 4096
#: How many statistics blocks are kept, for a section and for the earlier ones together; a file joined from parts has a section
#: for each part.
_MOST_STATISTICS: Final = 4096
_MIN_PACKET: Final = 32
_MIN_SECRETS: Final = 20

OPT_END: Final = 0
OPT_COMMENT: Final = 1
IF_NAME: Final = 2
IF_TSRESOL: Final = 9
IF_FILTER: Final = 11
_IF_TSOFFSET: Final = 14

_MAX_TIME: Final = 2**63 - 1
#: Octets of an interface's name that are kept.
_MAX_NAME: Final = 255

_OPTION_OVERRUN: Final = "an option claims {} bytes, more than its block holds, and was ignored with those after it"
_OPTION_SIZE: Final = "a time option of an interface holds {} bytes, which is not its size, and was ignored"
_ODD_RESOLUTION: Final = (
    "an interface claims a time resolution of 10 or 2 to the minus {}, and was given the finest one supported"
)
_ODD_TIME: Final = "the time of a packet is before 1970 or after 2262, and was put to the nearest of the two"
_NO_TIME: Final = "a Simple Packet Block has no time, and was given that of the packet before it"
_TRAILER: Final = "a block repeats its length as {} at its end, which differs from the length at its start"
_SHORT_BLOCK: Final = "a block of {} bytes is shorter than its kind must be"
_NO_INTERFACE: Final = "a packet names interface {}, which its section has not described"
_LONG_PACKET: Final = "a packet claims {} captured bytes, more than its block holds or its link can carry"
_LONG_SECRETS: Final = "a Decryption Secrets Block claims {} bytes of secrets, more than it holds"
_MANY_INTERFACES: Final = f"a section describes more than {MAX_INTERFACES} interfaces"


class Interface:
    """The description of an interface, as far as its packets need it.

    ``link_type`` is a LINKTYPE number, -1 when the description could not be read; ``name`` is empty when it has none. A tick of
    its clock is ``base ** -exponent`` seconds (``base`` 2 or 10), counted from ``offset`` seconds after 1970-01-01 UTC. If a
    tick is a whole number of nanoseconds and ``offset`` is 0, ``multiplier`` is that number; times whose upper 32 bits are less
    than ``safe_high`` then fit 64 bits of nanoseconds.
    """

    __slots__ = (
        "base",
        "divisor",
        "exponent",
        "limit",
        "link_type",
        "multiplier",
        "name",
        "offset",
        "safe_high",
        "snaplen",
    )

    def __init__(self, link_type: i64, snaplen: i64) -> None:
        self.link_type: i64 = link_type
        self.snaplen: i64 = snaplen
        self.name: str = ""
        self.limit: i64 = packet_limit(link_type)
        self.base: int = 10
        self.exponent: int = 6
        self.offset: int = 0
        self.divisor: int = 1
        self.multiplier: i64 = 0
        self.safe_high: i64 = 0
        self.settle()

    def settle(self) -> None:
        """Calculate ``divisor`` (ticks per second), ``multiplier`` and ``safe_high`` from the other attributes."""
        self.divisor = self.base**self.exponent
        if self.base == 10 and self.exponent <= 9 and self.offset == 0:
            multiplier = 10 ** (9 - self.exponent)
            self.multiplier = multiplier
            self.safe_high = (_MAX_TIME // multiplier) >> 32
        else:
            self.multiplier = 0
            self.safe_high = 0

    def exact_time_ns(self, ticks: int) -> int:
        """Return the time of ``ticks`` in nanoseconds since 1970-01-01 UTC, rounded down; it may need more than 64 bits."""
        return ticks * 1_000_000_000 // self.divisor + self.offset * 1_000_000_000


class PcapngReader(ChunkReader):
    """A pcapng file. ``head`` begins with `PCAPNG_MAGIC`.

    ``statistics`` holds, by interface number, the last Interface Statistics Block of each interface of the section being read;
    ``earlier_statistics`` holds those of the sections before. `dissect.packets.source.statistics` reads these blocks.
    """

    def __init__(self, source: OctetSource, head: bytes) -> None:
        super().__init__(source, head)
        self._big: bool = False
        self._single: struct.Struct = struct.Struct("<I")
        self._pair: struct.Struct = struct.Struct("<II")
        self._fields: struct.Struct = struct.Struct("<IIIII")
        self._interfaces: list[Interface] = []
        self._latest: Interface | None = None  # the interface of the last packet; its number is `_number`
        self._number: i64 = 0
        self._time_ns: i64 = 0
        self._doubt: bool = False
        self._need = _MIN_BLOCK
        self.statistics: dict[int, bytes] = {}
        self.earlier_statistics: list[bytes] = []

    def stated_loss(self) -> str:
        """Return in words what was lost according to the statistics of all sections; empty for nothing."""
        blocks = [*self.earlier_statistics, *self.statistics.values()]
        if not blocks:
            return ""
        from dissect.packets.source.statistics import loss_in  # late: few captures have them

        return loss_in(blocks)

    def step(self, sink: PacketSink) -> bool:
        """Read about one chunk and deliver its packets to ``sink``; return False when there is nothing more to read."""
        if self._done:
            return False
        if not self._fill(self._need):
            after = f", after packet {self.packets}" if self.packets else ""
            self._finish(f"inside the block at byte {self._offset(self._pos)}{after}")
            return False
        self._scan(sink)
        while self._goes_on():
            self._scan(sink)
        self._tell()
        return not self._done

    def _scan(self, sink: PacketSink) -> None:
        """Deliver the packets of every whole block in the buffer."""
        buf = self._buf
        size: i64 = len(buf)
        at: i64 = self._pos
        kind: i64
        total: i64
        trailer: i64
        compiled = COMPILED
        self._need = _MIN_BLOCK
        while at + _MIN_BLOCK <= size:
            if not compiled:
                kind, total = self._pair.unpack_from(buf, at)
            elif self._big:
                kind, total = u32(buf, at), u32(buf, at + 4)
            else:
                pair: i64 = read_i64_le(buf, at)
                kind, total = pair & 0xFFFFFFFF, pair >> 32 & 0xFFFFFFFF
            if kind == SECTION:
                if not self._order(at):
                    return
                total = self._u32(at + 4)
            if total < _MIN_BLOCK or total > MAX_BLOCK or total & 3:
                self._stop(at, f"a block claims a length of {total} bytes")
                return
            if at + total > size:
                self._need = total
                return
            # Set before the packet is delivered, so that a sink that raises does not get the packet again.
            self._pos = at + total
            if not compiled:
                (trailer,) = self._single.unpack_from(buf, at + total - 4)
            else:
                trailer = self._u32(at + total - 4)
            if trailer != total:
                self._contradiction(sink, kind, at, total, trailer)
            else:
                self._doubt = False
                if kind == ENHANCED_PACKET or kind == _OLD_PACKET:
                    self._packet(sink, kind, buf, at, total)
                else:
                    self._block(sink, kind, at, total)
            if self._done:
                return
            at += total

    def _u32(self, at: i64) -> i64:
        return u32(self._buf, at) if self._big else u32le(self._buf, at)

    def _order(self, at: i64) -> bool:
        """Take the byte order of the section that begins at ``at``; if it has none, end and return False."""
        magic = self._buf[at + 8 : at + 12]
        if magic not in BYTE_ORDER_MAGICS:
            self._stop(at, f"a section header has no byte-order magic but {magic.hex(' ')}")
            return False
        self._big = magic == BYTE_ORDER_MAGICS[0]
        order = ">" if self._big else "<"
        self._single = struct.Struct(f"{order}I")
        self._pair = struct.Struct(f"{order}II")
        self._fields = struct.Struct(f"{order}IIIII")
        return True

    def _contradiction(self, sink: PacketSink, kind: i64, at: i64, total: i64, trailer: i64) -> None:
        """Handle a block whose two lengths differ: skip it, but read a section or interface, which later blocks need."""
        if self._doubt:
            self._stop(at, "two blocks one after the other have different lengths at start and end")
            return
        self._doubt = True
        if kind == SECTION or kind == INTERFACE:
            self._note(_TRAILER, trailer, at)
            self._block(sink, kind, at, total)
        else:
            self._reject(_TRAILER, trailer, at)

    def _block(self, sink: PacketSink, kind: i64, at: i64, total: i64) -> None:
        """Read one whole block, of any kind that `_packet` does not read."""
        if kind == SECTION:
            self._section(at, total)
        elif kind == INTERFACE:
            self._interface(at, total)
        elif kind == _SIMPLE_PACKET:
            self._simple(sink, at, total)
        elif kind == STATISTICS and total <= _MAX_STATISTICS:
            number = self._u32(at + 8)
            if number < len(self._interfaces) and (
                number in self.statistics or len(self.statistics) < _MOST_STATISTICS
            ):
                self.statistics[number] = self._buf[at : at + total]
        elif kind == DECRYPTION_SECRETS:
            self._secrets(sink, at, total)

    def _secrets(self, sink: PacketSink, at: i64, total: i64) -> None:
        """Deliver a TLS key log; secrets of other protocols are ignored."""
        if total < _MIN_SECRETS:
            self._reject(_SHORT_BLOCK, total, at)
            return
        size = self._u32(at + 12)
        if size > total - _MIN_SECRETS:
            self._reject(_LONG_SECRETS, size, at)
        elif self._u32(at + 8) == TLS_KEY_LOG:
            sink.secrets(self._buf[at + 16 : at + 16 + size])

    def _section(self, at: i64, total: i64) -> None:
        """Begin a section: the interfaces of the one before no longer count."""
        if total < _MIN_SECTION:
            self._stop(at, f"a section header claims a length of {total} bytes")
            return
        version = self._u32(at + 12)
        major = version >> 16 if self._big else version & 0xFFFF
        if major != 1:
            self._stop(at, f"a section is of version {major} of the format, which is not defined")
            return
        self._interfaces = []
        self._latest = None
        room = _MOST_STATISTICS - len(self.earlier_statistics)
        self.earlier_statistics += list(self.statistics.values())[:room]
        self.statistics = {}

    def _interface(self, at: i64, total: i64) -> None:
        """Add an interface. An unreadable one also gets a number, so that the numbers of those after it are right."""
        if len(self._interfaces) >= MAX_INTERFACES:
            self._reject(_MANY_INTERFACES, 0, at)
            return
        if total < _MIN_INTERFACE:
            self._interfaces.append(Interface(-1, 0))
            self._reject(_SHORT_BLOCK, total, at)
            return
        link = self._u32(at + 8)
        interface = Interface(link >> 16 if self._big else link & 0xFFFF, self._u32(at + 12))
        self._interfaces.append(interface)
        option = at + 16
        end = at + total - 4
        while True:
            code, start, length = self._option(option, end)
            if code == OPT_END:
                break
            if code == IF_NAME:
                named = self._buf[start : start + min(length, _MAX_NAME)]
                interface.name = named.decode("utf-8", "backslashreplace")
            elif code == IF_TSRESOL or code == _IF_TSOFFSET:
                self._clock(interface, code, start, length)
            option = start + ((length + 3) & ~3)
        interface.settle()

    def _option(self, at: i64, end: i64) -> tuple[i64, i64, i64]:
        """Return code, value offset and value size of the option at ``at``; the code is `OPT_END` when there is none."""
        if at + 4 > end:
            return OPT_END, at, 0
        word = self._u32(at)
        code = word >> 16 if self._big else word & 0xFFFF
        length = word & 0xFFFF if self._big else word >> 16
        if code == OPT_END:
            return OPT_END, at, 0
        if at + 4 + length > end:
            self._note(_OPTION_OVERRUN, length, at)
            return OPT_END, at, 0
        return code, at + 4, length

    def _clock(self, interface: Interface, code: i64, start: i64, length: i64) -> None:
        """Take the resolution or the offset of an interface's clock."""
        if length != (1 if code == IF_TSRESOL else 8):
            self._note(_OPTION_SIZE, length, start - 4)
        elif code == _IF_TSOFFSET:
            octets = self._buf[start : start + 8]
            interface.offset = int.from_bytes(octets, "big" if self._big else "little", signed=True)
        else:
            value: i64 = self._buf[start]
            exponent = value & 0x7F
            # With finer ticks 64 bits would not last a second.
            finest: i64 = 63 if value & 0x80 else 19
            if exponent > finest:
                self._note(_ODD_RESOLUTION, exponent, start - 4)
                exponent = finest
            interface.base = 2 if value & 0x80 else 10
            interface.exponent = exponent

    def _packet(self, sink: PacketSink, kind: i64, buf: bytes, at: i64, total: i64) -> None:
        """Deliver the packet of an Enhanced Packet Block or an obsolete Packet Block; only their first field differs."""
        if total < _MIN_PACKET:
            self._reject(_SHORT_BLOCK, total, at)
            return
        number: i64
        high: i64
        low: i64
        captured: i64
        wire: i64
        if not COMPILED:
            number, high, low, captured, wire = self._fields.unpack_from(buf, at + 8)
        elif self._big:
            number, high, low = u32(buf, at + 8), u32(buf, at + 12), u32(buf, at + 16)
            captured, wire = u32(buf, at + 20), u32(buf, at + 24)
        else:  # each read gives two numbers
            pair: i64 = read_i64_le(buf, at + 8)
            number, high = pair & 0xFFFFFFFF, pair >> 32 & 0xFFFFFFFF
            pair = read_i64_le(buf, at + 16)
            low, captured = pair & 0xFFFFFFFF, pair >> 32 & 0xFFFFFFFF
            wire = u32le(buf, at + 24)
        if kind == _OLD_PACKET:
            number = number >> 16 if self._big else number & 0xFFFF
        interface = self._latest
        if number != self._number or interface is None:
            if number >= len(self._interfaces) or self._interfaces[number].link_type < 0:
                self._reject(_NO_INTERFACE, number, at)
                return
            interface = self._interfaces[number]
            self._latest = interface
            self._number = number
        start = at + 28
        end = start + captured
        if captured > total - _MIN_PACKET or captured > interface.limit:
            self._reject(_LONG_PACKET, captured, at)
            return
        if high < interface.safe_high:
            self._time_ns = ((high << 32) | low) * interface.multiplier
        else:
            self._time_ns = self._slow_time(interface, high, low, at)
        option = start + ((captured + 3) & ~3)
        if option + 4 <= at + total - 4:
            self._comments(sink, option, at + total - 4)
        self._deliver(sink, interface, buf, start, end, wire)

    def _simple(self, sink: PacketSink, at: i64, total: i64) -> None:
        """Deliver the packet of a Simple Packet Block: of interface 0, without a time, cut at that interface's snap length."""
        if total < _MIN_SIMPLE:
            self._reject(_SHORT_BLOCK, total, at)
            return
        if not self._interfaces or self._interfaces[0].link_type < 0:
            self._reject(_NO_INTERFACE, 0, at)
            return
        interface = self._interfaces[0]
        wire = self._u32(at + 8)
        captured = min(wire, interface.snaplen) if interface.snaplen else wire
        if captured > total - _MIN_SIMPLE or captured > interface.limit:
            self._reject(_LONG_PACKET, captured, at)
            return
        self._note(_NO_TIME, 0, at)
        self._deliver(sink, interface, self._buf, at + 12, at + 12 + captured, wire)

    def _deliver(self, sink: PacketSink, interface: Interface, buf: bytes, start: i64, end: i64, wire: i64) -> None:
        if wire < end - start:
            self._note(SHORT_WIRE, wire, start)
            wire = end - start
        self.packets += 1
        if self.interface is not interface.name:
            self.interface = interface.name
        sink.frame(self._time_ns, buf, start, end, wire, interface.link_type)

    def _slow_time(self, interface: Interface, high: i64, low: i64, at: i64) -> i64:
        """Return a time that may not fit 64 bits: of a binary or fine resolution, with an offset, or huge (then clamped)."""
        upper: int = high
        lower: int = low
        exact = interface.exact_time_ns(upper << 32 | lower)
        if exact < 0 or exact > _MAX_TIME:
            self._note(_ODD_TIME, 0, at)
            return 0 if exact < 0 else _MAX_TIME
        return exact

    def _comments(self, sink: PacketSink, at: i64, end: i64) -> None:
        """Deliver the comments among the options of a packet."""
        while True:
            code, start, length = self._option(at, end)
            if code == OPT_END:
                return
            if code == OPT_COMMENT and length:
                sink.comment(self._buf[start : start + length].decode("utf-8", "backslashreplace"))
            at = start + ((length + 3) & ~3)
