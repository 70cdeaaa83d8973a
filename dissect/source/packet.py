"""What a source of packets delivers to, whatever it reads from."""

from __future__ import annotations

from mypy_extensions import i64, mypyc_attr


@mypyc_attr(allow_interpreted_subclasses=True)
class PacketSink:
    """Takes packets one at a time; the pipeline is the one the product uses.

    The base class drops what it is given, so that a sink need only override what it wants.
    """

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Take one packet: its octets are ``buf[start:end]``.

        ``time_ns`` is nanoseconds since 1970-01-01 UTC. ``wire_length`` is what the packet measured on the wire, larger than
        ``end - start`` when the capture cut it. ``link_type`` is the LINKTYPE number of pcap and pcapng.
        ``buf`` may hold many packets; it is never changed after the call.
        """

    def comment(self, text: str) -> None:
        """Take a comment that the capture holds about the packet delivered next."""

    def secrets(self, text: bytes) -> None:
        """Take the TLS key log that the capture holds in a Decryption Secrets Block; it may stand at any place."""


@mypyc_attr(allow_interpreted_subclasses=True)
class Reader:
    """A capture being read: every kind of file or pipe gives this.

    ``packets`` and ``octets`` count what was read so far. ``damage`` is empty, or one sentence that says where the capture
    was found damaged or cut; what came before it was delivered. ``rejected`` counts blocks that were given up while reading
    went on, and ``notes`` says in sentences why, and what else in the capture is odd: one for each kind, with where it was
    first met and how often. ``interface`` is the name of the interface that captured the packet being delivered, empty where
    the capture names none.
    """

    def __init__(self) -> None:
        self.packets: i64 = 0
        self.octets: i64 = 0
        self.damage: str = ""
        self.rejected: i64 = 0
        self.notes: list[str] = []
        self.interface: str = ""

    def step(self, sink: PacketSink) -> bool:
        """Read some more and deliver its packets to ``sink``; False when there is nothing more to read.

        One call delivers a bounded number of packets (about 256 KiB of file), so that a caller can look at results,
        show progress or stop in between. Never raises on what the capture holds.
        """
        return False

    def stated_loss(self) -> str:
        """Return in words how many packets the capture states that were lost while it was made; empty for none."""
        return ""

    def close(self) -> None:
        """Release the file. May be called twice."""


class CaptureError(Exception):
    """The user's own input cannot be used: no such file, not a capture, a decompressor that is not installed."""


class SourceFile:
    """One file of a run: its name, the number of its first packet in the run, what was read of it, its damage.

    ``first_ns`` and ``last_ns`` are the times of its first and last packet, nanoseconds since 1970; 0 before they are read.
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

    @property
    def loss(self) -> str:
        """Say what of the file could not be read: damage, a cut, blocks given up. Empty when all of it was read."""
        said = [self.damage] if self.damage else []
        if self.rejected:
            blocks = "1 damaged block" if self.rejected == 1 else f"{self.rejected} damaged blocks"
            said.append(f"{blocks} skipped, the contents are missing")
        return "; ".join(said)
