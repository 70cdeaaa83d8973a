"""Capture files written as a stream: classic pcap (µs or ns) and pcapng, one link type a file."""

from __future__ import annotations

import struct
from typing import BinaryIO, Final

from dissect.packets.source.pcapng_writer import interface_block, packet_block, section_block

_RECORD: Final = struct.Struct("<IIII")
_SNAPLEN: Final = 262144
ETHERNET: Final = 1
#: Write the gathered octets to the file.
_BUFFER: Final = 1 << 20

FORMATS: Final = ("pcap", "pcap-ns", "pcapng")


class CaptureWriter:
    """Writes packets to an open binary file in one of `FORMATS`; memory stays at one buffer of 1 MiB.

    ``packets`` and ``octets`` (of the file) count what was written. Times are nanoseconds since 1970; ``pcap`` keeps
    microseconds, the other two formats nanoseconds.
    """

    def __init__(self, file: BinaryIO, kind: str = "pcap", link_type: int = ETHERNET) -> None:
        if kind not in FORMATS:
            raise ValueError(f"{kind!r} is no capture format; choose one of {', '.join(FORMATS)}")
        self._file = file
        self._kind = kind
        self._link_type = link_type
        self._parts: list[bytes] = []
        self._held = 0
        self.packets = 0
        self.octets = 0
        self._put(self._head())

    def _head(self) -> bytes:
        if self._kind == "pcapng":
            return section_block() + interface_block(self._link_type, snaplen=_SNAPLEN)
        magic = 0xA1B23C4D if self._kind == "pcap-ns" else 0xA1B2C3D4
        return struct.pack("<IHHiIII", magic, 2, 4, 0, 0, _SNAPLEN, self._link_type)

    def _put(self, octets: bytes) -> None:
        self._parts.append(octets)
        self._held += len(octets)
        if self._held >= _BUFFER:
            self.flush()

    def write(self, time_ns: int, frame: bytes, wire_length: int = 0) -> None:
        """Add one packet with ``wire_length`` octets on the wire (0: as many as there are)."""
        size = len(frame)
        wire = wire_length or size
        if self._kind == "pcapng":
            self._put(packet_block(0, time_ns, frame, wire))
        else:
            seconds, rest = divmod(time_ns, 1_000_000_000)
            self._put(_RECORD.pack(seconds, rest if self._kind == "pcap-ns" else rest // 1000, size, wire) + frame)
        self.packets += 1

    def flush(self) -> None:
        """Write the buffered octets to the file."""
        self.octets += self._held
        self._file.write(b"".join(self._parts))
        self._parts.clear()
        self._held = 0
