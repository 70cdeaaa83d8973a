"""Gaps: times in which packets are missing, and whether a connection was idle in them."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.packets.source.packet import CONTINUES_NS, SourceFile

#: A connection was idle for most of a gap if it usually sends this many times the missing bytes in that time.
_IDLE: Final = 10


class Gap:
    """A time in which packets of one connection, or of all (0), are missing.

    ``idle``: bytes are missing, but far fewer than the connection usually sends in that time, so it was mostly idle.
    """

    __slots__ = ("begin_ns", "connection", "end_ns", "idle", "why")

    def __init__(self, begin_ns: int, end_ns: int, connection: int, why: str, idle: bool = False) -> None:
        self.begin_ns = begin_ns
        self.end_ns = end_ns
        self.connection = connection
        self.why = why
        self.idle = idle


class Heard:
    """The time of the latest message of a connection, and its captured and missing bytes until then.

    ``worst`` is the severity of the gravest finding on it, empty for none.
    """

    __slots__ = ("connection", "missing", "octets", "time_ns", "worst")

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.time_ns = int(connection.tcp.first_ns)
        self.missing = 0
        self.octets = 0
        self.worst = ""


def idle(heard: Heard, lost: int, took_ns: int) -> bool:
    """Return whether a connection was idle for most of a gap, in which ``lost`` bytes are missing, by its rate until then."""
    known_ns = heard.time_ns - int(heard.connection.tcp.first_ns)
    return known_ns > 0 and heard.octets * took_ns >= _IDLE * lost * known_ns


def between(files: list[SourceFile]) -> list[tuple[int, int]]:
    """Return the times between files that do not continue the file before: (end of one, beginning of the next)."""
    found = []
    known_to = 0
    for begin, end in sorted([(int(file.first_ns), int(file.last_ns)) for file in files if file.first_ns]):
        if known_to and begin - known_to > CONTINUES_NS:
            found.append((known_to, begin))
        known_to = max(known_to, begin, end)
    return found
