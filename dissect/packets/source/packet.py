"""`Reader`, which reads any source of packets, and `PacketSink`, which it delivers them to."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.wire.copies import leaves
from dissect.wire.errors import CaptureError

__all__ = ["READING_FAILED", "CaptureError", "PacketSink", "Reader", "SourceFile"]

#: Damage that begins like this is not in the file: the system or the network did not deliver more of it, but may do so later.
READING_FAILED: Final = "reading failed after byte"


#: A file whose first packet comes this soon after the last one of the file before it continues its connections.
CONTINUES_NS: Final = 60_000_000_000


@mypyc_attr(allow_interpreted_subclasses=True)
class PacketSink:
    """Takes packets one at a time, as `dissect.engine.pipeline.Pipeline` does.

    The base class drops everything, so a sink only overrides what it wants.
    """

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Take one packet, whose octets are ``buf[start:end]``.

        ``time_ns`` is nanoseconds since 1970-01-01 UTC. ``wire_length`` is the size of the packet on the wire in octets, larger
        than ``end - start`` when the capture cut it. ``link_type`` is the LINKTYPE number of pcap and pcapng. ``buf`` may hold
        many packets; it is never changed after the call.
        """

    def comment(self, text: str) -> None:
        """Take a comment that the capture holds about the packet delivered next."""

    def secrets(self, text: bytes) -> None:
        """Take the TLS key log of a Decryption Secrets Block, which may come anywhere in the capture."""


@mypyc_attr(allow_interpreted_subclasses=True)
class Reader:
    """Reads a capture: the base class of the readers of every kind of file and pipe.

    ``packets`` and ``octets`` count what was read so far. ``damage`` is empty, or one sentence that says where the capture was
    found damaged or cut; everything before that was delivered. ``rejected`` counts damaged blocks after which reading
    continued. ``notes`` are sentences about these and other oddities, one for each kind, with its first place and its count.
    ``interface`` is the name of the interface that captured the packet being delivered, empty if the capture has no name for
    it.
    """

    def __init__(self) -> None:
        self.packets: i64 = 0
        self.octets: i64 = 0
        self.damage: str = ""
        self.rejected: i64 = 0
        self.notes: list[str] = []
        self.interface: str = ""

    def step(self, sink: PacketSink) -> bool:
        """Read some more and deliver its packets to ``sink``; return False when there is nothing more to read.

        One call delivers a bounded number of packets (64 to 256 KiB of input), so that the caller can use results, show
        progress or stop in between. Nothing that the capture holds raises an error.
        """
        return False

    def stated_loss(self) -> str:
        """Return in words how many packets were lost during the capture, if the file has that number; empty for none."""
        return ""

    def close(self) -> None:
        """Release the file. May be called twice."""


class SourceFile:
    """One file of a run.

    ``first_frame`` is the number of its first packet in the run. ``first_ns`` and ``last_ns`` are the times of its first and
    last packet, nanoseconds since 1970; 0 before they are read. The other attributes are as in `Reader`.
    """

    def __init__(self, name: str, first_frame: i64) -> None:
        self.name: str = name
        self.first_frame: i64 = first_frame
        self.packets: i64 = 0
        self.octets: i64 = 0
        self.first_ns: i64 = 0
        self.last_ns: i64 = 0
        self.damage: str = ""
        self.rejected: i64 = 0
        self.notes: list[str] = []

    def __repr__(self) -> str:
        return f"SourceFile({self.name!r}, {self.packets} packets{f', {self.loss}' if self.loss else ''})"

    @property
    def loss(self) -> str:
        """The unreadable parts of the file: damage, a cut, damaged blocks. Empty when all of it was read."""
        said = [self.damage] if self.damage else []
        if self.rejected:
            blocks = "1 damaged block" if self.rejected == 1 else f"{self.rejected} damaged blocks"
            said.append(f"{blocks} skipped, the contents are missing")
        return "; ".join(said)


leaves(SourceFile)
