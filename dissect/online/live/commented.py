"""Writes the packets of a live source as pcapng while they arrive, with findings as packet comments.

A comment is part of its packet's block, but many findings on a packet are made only when the answer arrives. So each packet is
held for a moment before it is written. A later finding is put on the next packet and names the packets that it is about.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from dissect.engine.findings.reporter import Finding
from dissect.files.recording.recent import MAX_COMMENTS, KeptPacket
from dissect.meaning.select.comments import finding_comment, frames_in_words
from dissect.online.live.run import Companion
from dissect.packets.source.live.reader import Drops
from dissect.packets.source.pcapng_writer import PcapngWriter

#: How long a packet is held, in nanoseconds by the clock of the capture: most answers come sooner, and users do not notice it.
HOLD_NS: Final = 200_000_000
#: At most this many octets are held; beyond that, packets are written early.
MAX_HELD: Final = 16 * 1024 * 1024


class CommentedStream(Companion):
    """Writes every packet to ``writer``, ``hold_ns`` after it arrived.

    ``error`` is the exception with which writing failed, None before; nothing is written after that. ``late`` are comments that
    wait for a further packet; ``dropped`` counts comments that exceeded the limit.
    """

    name = "the stream of packets with comments"
    wants_packets = True

    def __init__(self, writer: PcapngWriter, hold_ns: int = HOLD_NS, max_octets: int = MAX_HELD) -> None:
        super().__init__()
        self.error: OSError | None = None
        self.late: list[str] = []
        self.dropped = 0
        self._writer = writer
        self._hold_ns = hold_ns
        self._max_octets = max_octets
        self._frames = 0
        self._octets = 0
        self._held: deque[KeptPacket] = deque()

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Hold a packet, and write those that were held long enough."""
        self._frames += 1
        packet = KeptPacket(self._frames, time_ns, octets, wire_length, link_type, interface, self.late)
        self.late = []
        self._held.append(packet)
        self._octets += packet.size
        self._release(time_ns)

    def finding(self, finding: Finding) -> None:
        """Add a comment to those packets of a finding that are still held; if there are none, to the latest or next packet."""
        frames = sorted({int(frame) for frame in finding.frames})
        comment = finding_comment(finding)
        first = self._frames - len(self._held) + 1
        held = [self._held[frame - first] for frame in frames if first <= frame <= self._frames]
        if not held:
            comment = f"{comment} [about {frames_in_words(frames)}]"
            held = [self._held[-1]] if self._held else []
        for packet in held:
            packet.say(comment)
        if held:
            return
        if len(self.late) < MAX_COMMENTS:
            self.late.append(comment)
        else:
            self.dropped += 1

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Write the packets that were held long enough."""
        self._release(now_ns)

    def close(self) -> None:
        """Write the held packets, and end the file."""
        while self._held:
            self._write(self._held.popleft())
        try:
            if self.error is None:
                self._writer.close()
        except OSError as error:
            self.error = error
        finally:
            self._writer.abandon()

    def _release(self, now_ns: int) -> None:
        # The absolute difference: if the clock was set back, packets must not be held until it has caught up.
        while self._held and (abs(now_ns - self._held[0].time_ns) >= self._hold_ns or self._octets > self._max_octets):
            self._write(self._held.popleft())

    def _write(self, packet: KeptPacket) -> None:
        self._octets -= packet.size
        if self.error is not None:
            return
        try:
            self._writer.packet(
                packet.time_ns, packet.octets, packet.wire_length, packet.link_type, packet.comments, packet.interface
            )
        except OSError as error:
            self.error = error
