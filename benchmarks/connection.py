"""A TCP connection under construction: segments with the right numbers, from the SYN to the end."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

from benchmarks.frames import ACK, FIN, PSH, RST, SYN, Host, Sender

if TYPE_CHECKING:
    from random import Random

    from benchmarks.truth import Unit

CLIENT: Final = 0
PLC: Final = 1
US: Final = 1000
MS: Final = 1_000_000
#: TCP options of a SYN: maximum segment 1460, no-operations, SACK permitted.
_SYN_OPTIONS: Final = bytes.fromhex("020405b401010402")


class RewritePlan:
    """A segment before it is sent; `build` makes the frame, once."""

    __slots__ = ("ack", "flags", "frame", "options", "payload", "sender", "seq", "time_ns", "units")

    def __init__(
        self, time_ns: int, sender: Sender, flags: int, ack: int, payload: bytes = b"", units: tuple[Unit, ...] = ()
    ) -> None:
        self.time_ns = time_ns
        self.sender = sender
        self.flags = flags
        self.seq = sender.seq
        self.ack = ack
        self.payload = payload
        self.units = units
        self.options = b""
        self.frame = b""

    def again(self, time_ns: int) -> RewritePlan:
        """Return a copy sent at another time, which completes nothing."""
        copy = RewritePlan(time_ns, self.sender, self.flags, self.ack, self.payload)
        copy.seq = self.seq
        return copy

    def build(self) -> bytes:
        """Return the frame."""
        if not self.frame:
            self.frame = self.sender.segment(self.flags, self.seq, self.ack, self.payload, self.time_ns, self.options)
        return self.frame


class Connection:
    """Both directions of one connection; each method appends to ``drafts`` in order of time."""

    def __init__(self, rng: Random, client: Host, port: int, plc: Host, *, stamps: bool, pad: bool) -> None:
        self._rng = rng
        self.senders = (
            Sender(client, port, plc, 102, rng.getrandbits(32)),
            Sender(plc, 102, client, port, rng.getrandbits(32)),
        )
        for sender in self.senders:
            sender.stamps = stamps
        self.senders[PLC].pad = pad
        self.senders[CLIENT].window = 64240
        self.drafts: list[RewritePlan] = []

    def _put(
        self, time_ns: int, side: int, flags: int, payload: bytes = b"", units: tuple[Unit, ...] = ()
    ) -> RewritePlan:
        sender = self.senders[side]
        draft = RewritePlan(time_ns, sender, flags, self.senders[1 - side].seq, payload, units)
        sender.seq = (sender.seq + len(payload)) & 0xFFFFFFFF
        self.drafts.append(draft)
        return draft

    def open(self, time_ns: int, trip_ns: int) -> int:
        """Shake hands; return the time when it is done."""
        client, plc = self.senders
        syn = RewritePlan(time_ns, client, SYN, 0)
        client.seq = (client.seq + 1) & 0xFFFFFFFF
        both = RewritePlan(time_ns + trip_ns, plc, SYN | ACK, client.seq)
        plc.seq = (plc.seq + 1) & 0xFFFFFFFF
        syn.options = both.options = _SYN_OPTIONS
        self.drafts += (syn, both)
        return self.ack(time_ns + trip_ns + 40 * US, CLIENT)

    def ack(self, time_ns: int, side: int) -> int:
        """Acknowledge the data from the other side."""
        self._put(time_ns, side, ACK)
        return time_ns

    def send(self, time_ns: int, side: int, pieces: list[tuple[bytes, Unit]], cuts: tuple[int, ...] = ()) -> int:
        """Send TPKTs in one segment, or in several cut before the octets ``cuts``; return the time of the last segment."""
        payload = b"".join([octets for octets, _ in pieces])
        if not cuts:
            for _, unit in pieces:
                unit.parts += 1
            self._put(time_ns, side, ACK | PSH, payload, tuple([unit for _, unit in pieces]))
            return time_ns
        edges = [0, *cuts, len(payload)]
        for start, end in pairwise(edges):
            units: list[Unit] = []
            at = 0
            for octets, unit in pieces:
                if at < end and at + len(octets) > start:
                    unit.parts += 1
                    units.append(unit)
                at += len(octets)
            self._put(time_ns, side, ACK | PSH, payload[start:end], tuple(units))
            time_ns += self._rng.randrange(15, 90) * US
        return time_ns

    def finish(self, time_ns: int, side: int) -> int:
        """Close in good order, ``side`` first."""
        for closing in (side, 1 - side):
            self._put(time_ns, closing, FIN | ACK)
            sender = self.senders[closing]
            sender.seq = (sender.seq + 1) & 0xFFFFFFFF
            time_ns += self._rng.randrange(80, 900) * US
        return self.ack(time_ns, side)

    def reset(self, time_ns: int, side: int) -> int:
        """Break the connection off."""
        self._put(time_ns, side, RST | ACK)
        return time_ns

    def keep_alive(self, time_ns: int, side: int) -> int:
        """Send one octet of old data (with a zero in it, as most stacks do); the other side acknowledges."""
        probe = RewritePlan(time_ns, self.senders[side], ACK, self.senders[1 - side].seq, b"\x00")
        probe.seq = (probe.seq - 1) & 0xFFFFFFFF
        self.drafts.append(probe)
        return self.ack(time_ns + 300 * US, 1 - side)
