"""Files of a folder or a pattern are read in the order of the times of their packets."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from mypy_extensions import i64

from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import CaptureError, PacketSink


class _FoundError(Exception):
    """There is a packet, so the rest of the file need not be read."""


class _First(PacketSink):
    """Takes the time of the first packet."""

    def __init__(self) -> None:
        self.time_ns = 0

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        self.time_ns = int(time_ns)
        raise _FoundError


def first_ns(path: str) -> int | None:
    """Return the time of a file's first packet, nanoseconds since 1970; None without one, or where it cannot be read."""
    sink = _First()
    try:
        reader = open_capture(path)
    except (CaptureError, OSError):
        return None
    try:
        while reader.step(sink):
            pass
    except _FoundError:
        return sink.time_ns
    except (CaptureError, OSError):
        return None
    finally:
        reader.close()
    return None


def by_time(paths: Iterable[str], first: Callable[[str], int | None] = first_ns) -> list[str]:
    """Return files in the order of the times of their ``first`` packets, files without one last and by name."""
    named = sorted(paths)
    if len(named) < 2:
        return named
    times = {path: first(path) for path in named}
    return sorted(named, key=lambda path: (times[path] is None, times[path] or 0))
