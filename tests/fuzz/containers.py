"""Fuzz target ``container``: capture files of every kind, from the first octet to the packets in them."""

from __future__ import annotations

from typing import Final

from dissect.packets.source.files import find_reader
from dissect.packets.source.packet import CaptureError, PacketSink
from tests.fuzz.checks import check_line
from tests.properties.captures import Memory

#: A compressed file may contain very much more than its size: only the beginning of such a file is read.
MOST_STEPS: Final = 24


class Trickle(Memory):
    """A source that gives few octets at a time, as a pipe does."""

    def __init__(self, octets: bytes, most: int) -> None:
        super().__init__(octets)
        self._most = most

    def read(self, size: int) -> bytes:
        return super().read(min(size, self._most))


class Packets(PacketSink):
    """Checks what a reader delivers against the rules, and keeps it."""

    def __init__(self) -> None:
        self.told: list[tuple[int, bytes, int, int]] = []
        self.comments: list[str] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        assert 0 <= start <= end <= len(buf)
        assert wire_length >= end - start
        assert 0 <= link_type <= 0xFFFF_FFFF
        assert -(2**63) <= time_ns < 2**63
        self.told.append((time_ns, buf[start:end], wire_length, link_type))

    def comment(self, text: str) -> None:
        self.comments.append(text)


def read(source: Memory, steps: int = MOST_STEPS) -> tuple[Packets, list[str], bool]:
    """Return the packets of a source, the remarks about it, and whether it was read to its end."""
    packets = Packets()
    try:
        reader = find_reader(source, "fuzz")
    except CaptureError as error:
        check_line(str(error))
        return packets, [str(error)], True
    more = True
    while more and steps:
        more = reader.step(packets)
        steps -= 1
        assert reader.packets == len(packets.told)
    assert not reader.step(packets) or more
    check_line(reader.damage)
    for note in reader.notes:
        check_line(note)
    assert reader.rejected >= 0
    reader.close()
    reader.close()
    return packets, [reader.damage, str(reader.rejected), *reader.notes], not more


def container(octets: bytes) -> None:
    """A capture file; in whatever pieces it comes, the packets are the same."""
    whole, said, ended = read(Memory(octets))
    piece = 1 + len(octets) % 61
    again, said_again, ended_again = read(Trickle(octets, piece), MOST_STEPS + len(octets) // piece + 2)
    if ended and ended_again:
        assert again.told == whole.told
        assert again.comments == whole.comments
        assert said_again == said
