"""Captures that a program may give besides a path: an open binary file, or packets of its own."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from datetime import datetime
from typing import Any, Final, Protocol, TypeAlias, cast

from dissect.packets.source.files import PlainSource, find_reader, open_capture
from dissect.packets.source.packet import CaptureError, PacketSink, Reader
from dissect.packets.source.remote import shown
from dissect.wire.text import printable


class BinaryFile(Protocol):
    """An open binary file, with the methods that are used here."""

    def read(self, size: int, /) -> Any:
        """Return up to ``size`` octets."""


#: A packet: its time (int: nanoseconds since 1970, float: seconds, or a datetime with a time zone), its LINKTYPE number, and
#: its octets; if the capture cut it, its size on the wire follows.
Packet: TypeAlias = "tuple[int | float | datetime, int, bytes] | tuple[int | float | datetime, int, bytes, int]"

#: A capture: a path, an open binary file, or packets in their order.
Source: TypeAlias = "str | os.PathLike[str] | BinaryFile | Iterable[Packet]"

#: Packets that one step delivers.
_AT_ONCE: Final = 256
_SECOND: Final = 10**9
_MOST_LINK: Final = 0xFFFF
#: The latest time of a packet: it fits a signed number of 64 bits.
_LATEST: Final = 2**63 - 1


def open_source(source: Source) -> tuple[Reader, str]:
    """Return the reader of a capture, and its name.

    Raises `CaptureError`, and TypeError for an object that cannot be a capture.
    """
    if isinstance(source, (str, os.PathLike)):
        path = os.fspath(source)
        return open_capture(path), "stdin" if path == "-" else shown(path)
    if isinstance(source, (bytes, bytearray, memoryview)):
        raise TypeError("a capture in memory is given as io.BytesIO(octets), a path as a str")
    if hasattr(source, "read"):
        name = _name(source)
        return find_reader(PlainSource(cast(Any, _File(cast(BinaryFile, source), name)), owned=False), name), name
    if isinstance(source, Iterable):
        return _PacketReader(iter(source)), f"<{type(source).__name__}>"
    raise TypeError(f"a capture is a path, an open binary file or packets, not {type(source).__name__}")


def given_one(sources: object) -> bool:
    """Return whether this is a single source, not a list of several."""
    return isinstance(sources, (str, os.PathLike)) or hasattr(sources, "read")


def _name(file: object) -> str:
    name = getattr(file, "name", "")
    return printable(name) if isinstance(name, str) and name else f"<{type(file).__name__}>"


class _File:
    """An open file whose errors are reported in sentences."""

    def __init__(self, file: BinaryFile, name: str) -> None:
        self._file = file
        self._name = name

    def read(self, size: int, /) -> bytes | None:
        """Return up to ``size`` octets, None if no data is available yet. Raises `CaptureError` for no binary file."""
        try:
            piece = self._file.read(size)
        except ValueError as error:
            if getattr(self._file, "closed", False):
                raise CaptureError(f"{self._name}: the file is closed") from None
            raise CaptureError(f"{self._name}: cannot be read: {error}") from None
        if isinstance(piece, str):
            raise CaptureError(f'{self._name}: opened as a text; open it with mode "rb"')
        if piece is not None and not isinstance(piece, (bytes, bytearray, memoryview)):
            raise CaptureError(f"{self._name}: read() gives {type(piece).__name__}, not bytes")
        if piece is None and not hasattr(self._file, "fileno"):
            raise CaptureError(f"{self._name}: gives nothing yet, and cannot be waited for")
        return None if piece is None else bytes(piece)

    def fileno(self) -> int:
        """Return the number of the file, to wait for it."""
        number: int = cast(Any, self._file).fileno()
        return number

    def close(self) -> None:
        """Leave the file open: its owner closes it."""


class _PacketReader(Reader):
    """Reads packets that a program gives one by one."""

    def __init__(self, packets: Iterator[Packet]) -> None:
        super().__init__()
        self._given = packets

    def step(self, sink: PacketSink) -> bool:
        """Deliver the next packets.

        Raises `CaptureError` for an object that is not a packet; the packets before it were delivered.
        """
        for _ in range(_AT_ONCE):
            try:
                packet = next(self._given)
            except StopIteration:
                return False
            time_ns, link_type, octets, size = self._parts(packet)
            self.packets += 1
            self.octets += len(octets)
            sink.frame(time_ns, octets, 0, len(octets), size, link_type)
        return True

    def _parts(self, packet: Any) -> tuple[int, int, bytes, int]:
        number = int(self.packets) + 1
        if not isinstance(packet, (tuple, list)) or not 3 <= len(packet) <= 4:
            raise CaptureError(f"packet {number}: expected (time, link type, octets), got {type(packet).__name__}")
        time, link_type, octets = packet[:3]
        if not isinstance(octets, (bytes, bytearray, memoryview)):
            raise CaptureError(f"packet {number}: its octets are {type(octets).__name__}, not bytes")
        if not isinstance(link_type, int) or isinstance(link_type, bool) or not 0 <= link_type <= _MOST_LINK:
            raise CaptureError(f"packet {number}: {link_type!r} is not a LINKTYPE number: Ethernet is 1, raw IP 101")
        size = packet[3] if len(packet) == 4 else len(octets)
        if not isinstance(size, int) or size < len(octets):
            raise CaptureError(f"packet {number}: its size on the wire is below its {len(octets)} octets: {size!r}")
        return _nanoseconds(number, time), link_type, bytes(octets), min(size, _LATEST)


def _nanoseconds(number: int, time: Any) -> int:
    if isinstance(time, datetime):
        if time.tzinfo is None:
            raise CaptureError(f"packet {number}: its time has no time zone")
        whole = time.replace(microsecond=0)
        found = round(whole.timestamp()) * _SECOND + time.microsecond * 1000
    elif isinstance(time, bool) or not isinstance(time, (int, float)):
        expected = "nanoseconds as int, seconds as float or a datetime"
        raise CaptureError(f"packet {number}: expected its time as {expected}, got {type(time).__name__}")
    elif isinstance(time, float):
        if not abs(time) < _LATEST / _SECOND:
            raise CaptureError(f"packet {number}: its time is beyond the range: {time!r}")
        found = round(time * _SECOND)
    else:
        found = time
    if not 0 <= found <= _LATEST:
        raise CaptureError(f"packet {number}: its time is beyond the range: {time!r}")
    return found
