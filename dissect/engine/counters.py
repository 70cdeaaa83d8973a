"""Counts the packets (by treatment) and octets of a run, knows its current time, and reports irregular packets."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.bare import BareConnections
from dissect.engine.findings.reporter import Reporter
from dissect.engine.findings.transaction_rules import DISORDER_NS
from dissect.engine.transactions.accounts import CATEGORIES, NO_PAYLOAD, PAYLOAD, OctetAccount
from dissect.engine.transactions.connection import ISO_TSAP_PORT
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import endpoints
from dissect.packets.tcp.ip import TCP, FragmentStore
from dissect.packets.tcp.segment import Segment, find_segment
from dissect.wire.octets import Tally
from dissect.wire.text import duration_text

#: The first packet of each kind that is not opened is a detailed finding, for at most this many kinds. The number of kinds has
#: no other limit.
_MAX_SEALED: Final = 32
#: Later than every packet.
_NEVER_NS: Final = 0x7FFF_FFFF_FFFF_FFFF


class Counters:
    """The accounts of a run. ``frames`` counts packets; ``first_ns`` and ``now_ns`` are the times of the first and latest one.

    Times are nanoseconds since 1970. `earliest_ns` and `latest_ns` differ from these only if the clock ran backwards, and cost
    no time otherwise (`widen`).
    """

    def __init__(self, reporter: Reporter) -> None:
        self._reporter: Reporter = reporter
        self.fragments: FragmentStore = FragmentStore()
        self.octets: OctetAccount = OctetAccount()
        self.bare: BareConnections = BareConnections()
        self.frames: i64 = 0
        self.cut_frames: i64 = 0
        self.first_ns: i64 = 0
        self.now_ns: i64 = 0
        self._lowest_ns: i64 = _NEVER_NS
        self._highest_ns: i64 = 0
        self._ahead_ns: i64 = 0  # the latest time before the last step back that was reported
        self.packets: Tally = Tally(len(CATEGORIES), PAYLOAD, NO_PAYLOAD)
        self._sealed: set[str] = set()  # the kinds of packets that were reported as not opened

    @property
    def earliest_ns(self) -> int:
        """The smallest time of all packets so far, whatever their order; 0 before the first."""
        return int(min(self.first_ns, self._lowest_ns))

    @property
    def latest_ns(self) -> int:
        """The largest time of all packets so far, whatever their order; 0 before the first."""
        return int(max(self.now_ns, self._highest_ns))

    @property
    def disordered(self) -> bool:
        """True when some packet is older than the first one, or newer than the last one."""
        return self.first_ns - self.earliest_ns > DISORDER_NS or self.latest_ns - self.now_ns > DISORDER_NS

    def widen(self, earliest_ns: i64, latest_ns: i64) -> None:
        """Take the times of two packets between which the clock ran backwards; both may be outside `first_ns` to `now_ns`."""
        self._lowest_ns = min(self._lowest_ns, earliest_ns)
        self._highest_ns = max(self._highest_ns, latest_ns)

    def note(self, slug: str, detail: str = "", connection: i64 = 0) -> None:
        """Count and, within the bounds, detail a finding about the packet at hand."""
        if self._reporter.wants(slug, connection, self.frames, self.frames, self.now_ns):
            self.detail(slug, detail, connection)

    def wants_between(self, slug: str, client: str, server: str) -> bool:
        """Count a finding about the current packet and two hosts without a connection; True if it should be detailed."""
        return self._reporter.wants_between(slug, client, server, self.frames, self.frames, self.now_ns)

    def detail(self, slug: str, detail: str, connection: i64 = 0) -> None:
        """Detail a finding about the packet at hand, which was counted."""
        frames: list[int] = []
        if self.frames:
            frames.append(self.frames)
        self._reporter.detail(slug, connection, frames, self.now_ns, detail)

    def note_of(self, slug: str, frames: list[int], time_ns: i64, detail: str, connection: i64 = 0) -> None:
        """Count a finding about packets before the current one, and detail it if the bounds allow."""
        self._reporter.note(slug, connection, frames, time_ns, detail)

    def note_between(self, slug: str, client: str, server: str, frames: list[int], time_ns: i64, detail: str) -> None:
        """Do as `note_of` does, about two hosts that have no connection."""
        if self._reporter.wants_between(slug, client, server, frames[0], frames[-1], time_ns):
            self._reporter.detail(slug, 0, frames, time_ns, detail)

    def packet_counts(self) -> dict[str, int]:
        """Return the numbers of packets by category; the numbers add up to ``frames``."""
        counts = dict(zip(CATEGORIES, self.packets.counts(), strict=True))
        # A fragment's fate is known later than its packet, so the store of fragments counts it.
        counts["fragment_waiting"] = self.fragments.waiting
        counts["fragment_used"] = self.fragments.used
        counts["fragment_dropped"] = self.fragments.dropped
        return counts

    def restart(self, time_ns: i64) -> None:
        """Another capture begins: waiting fragments are forgotten, but stay counted."""
        if time_ns < self.now_ns:
            self.widen(time_ns, self.now_ns)
        self.now_ns = time_ns
        self._ahead_ns = time_ns
        old = self.fragments
        fragments = FragmentStore()
        fragments.used = old.used
        fragments.dropped = old.dropped + old.waiting
        fragments.conflicts = old.conflicts
        fragments.invalid = old.invalid
        fragments.evicted = old.evicted
        fragments.expired = old.expired
        self.fragments = fragments

    def add_up(self, side: Side) -> None:
        """Add the octets of one direction of a finished connection to the totals."""
        self.octets.delivered += side.stream.octets
        side.protocol.add_up(side, self.octets)

    def note_once(self, slug: str, detail: str) -> None:
        """Count a finding about the current packet; only the first one is detailed."""
        if slug in self._reporter.counts:
            self._reporter.count(slug, 0, self.frames, self.now_ns)
        else:
            self.note(slug, detail)

    def note_sealed(self, name: str) -> None:
        """Count a packet inside a tunnel or encryption that is not opened; the first of each ``name`` is detailed."""
        slug = "capture.not_opened"
        if name in self._sealed or len(self._sealed) >= _MAX_SEALED:
            self._reporter.count(slug, 0, self.frames, self.now_ns)
        else:
            self._sealed.add(name)
            self.note(slug, f"{name}, first seen here")

    def note_step_back(self, time_ns: i64) -> None:
        """Take note that the current packet, of ``time_ns``, is older than the one before it.

        It is compared with the latest time since the last reported step: a clock that makes small steps back again and again
        also runs backwards. That latest time is always a time just before a step back.
        """
        self.widen(time_ns, self.now_ns)
        self._ahead_ns = max(self._ahead_ns, self.now_ns)
        back_ns: i64 = self._ahead_ns - time_ns
        if back_ns > DISORDER_NS:
            self._ahead_ns = time_ns
            self.note("capture.time_backwards", f"by {duration_text(int(back_ns))}")

    def note_cut(self, size: i64, wire_length: i64) -> None:
        """The capture kept ``size`` of ``wire_length`` octets of the packet at hand."""
        self.cut_frames += 1
        if self._reporter.wants("capture.cut_frames", 0, self.frames, self.frames, self.now_ns):
            detail = f"{size} of {wire_length} bytes kept"
            self._reporter.detail("capture.cut_frames", 0, [self.frames], self.now_ns, detail)

    def note_ignored(self, side: Side, what: str) -> None:
        """A reset or FIN does not fit its connection and is ignored."""
        if side.connection.followed:
            self.note("stream.reset_ignored", f"{what} from {side.tcp.ends[side.index]}", side.connection.number)

    def note_damaged(self, side: Side | None, found: Segment) -> None:
        """Report a segment or datagram with a wrong checksum; ignore it on connections that are not followed."""
        if side is not None and side.connection.followed:
            self.note(
                "stream.bad_checksum",
                f"{len(found.octets)} bytes at TCP sequence number {found.seq}",
                side.connection.number,
            )
        elif side is None and found.protocol == TCP:
            sender, receiver = endpoints(found.key)
            if ISO_TSAP_PORT in {sender.port, receiver.port}:
                client, server = (sender, receiver) if receiver.port == ISO_TSAP_PORT else (receiver, sender)
                if self.wants_between("stream.bad_checksum", client.host, server.host):
                    self.detail("stream.bad_checksum", f"{sender} -> {receiver}")

    def find_segment(self, buf: bytes, start: i64, end: i64, link_type: i64, udp: bool, checksums: bool) -> Segment:
        """Return the TCP segment of a frame, or a UDP datagram if ``udp`` asks for these, or the reason why there is none."""
        fragments = self.fragments
        conflicts: i64 = fragments.conflicts
        evicted: i64 = fragments.evicted
        dropped: i64 = fragments.invalid
        found = find_segment(buf, start, end, link_type, fragments, self.now_ns, udp, checksums)
        if found.sealed:
            self.note_sealed(found.sealed)
        if found.problem == "bad_header":
            self.note_once("ip.bad_header", "first seen here")
        if fragments.invalid > dropped:
            self.note_once("ip.fragment_invalid", "first seen here")
        if fragments.conflicts > conflicts:
            self.note("ip.fragment_conflict", f"in a datagram that holds {'TCP, UDP' if udp else 'TCP'} or a tunnel")
        if fragments.evicted > evicted:
            self.note("ip.fragments_evicted")
        return found
