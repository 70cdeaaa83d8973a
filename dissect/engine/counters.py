"""What a pipeline keeps books of: packets by category, octets, open connections and fragments, oddities of the capture."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.findings.reporter import Reporter
from dissect.source.packet import PacketSink
from dissect.tcp.ip import TCP, FragmentStore
from dissect.tcp.segment import Segment, find_segment
from dissect.transactions.accounts import CATEGORIES, OctetAccount
from dissect.transactions.connection import ISO_TSAP_PORT
from dissect.transactions.table import ConnectionTable, Side, endpoints


class Books(PacketSink):
    """The accounts of a run. ``frames`` counts packets; ``now_ns`` is the time of the latest one."""

    def __init__(self, observer: Observer, judge: Reporter) -> None:
        self.observer: Observer = observer
        self._judge: Reporter = judge
        self.table: ConnectionTable = ConnectionTable()
        self.fragments: FragmentStore = FragmentStore()
        self.octets: OctetAccount = OctetAccount()
        self.wants_udp: bool = False
        self._checksums: bool = False
        self.frames: i64 = 0
        self.cut_frames: i64 = 0
        self.first_ns: i64 = 0
        self.now_ns: i64 = 0
        self._packets: list[int] = [0] * len(CATEGORIES)

    def comment(self, text: str) -> None:
        """Take a comment the capture holds about the packet that comes next."""
        self.observer.comment(self.frames + 1, text)

    def note_damage(self, detail: str) -> None:
        """The source found its capture damaged."""
        self._judge.note("capture.damaged", 0, [self.frames] if self.frames else [], self.now_ns, detail)

    def note_dropped(self, detail: str) -> None:
        """The source lost packets since it was last asked."""
        self._judge.note("capture.dropped", 0, [self.frames] if self.frames else [], self.now_ns, detail)

    def packet_counts(self) -> dict[str, int]:
        """Return what became of every packet, by category; the numbers add up to ``frames``."""
        counts = dict(zip(CATEGORIES, self._packets, strict=True))
        # A fragment's fate is known later than its packet: the store keeps the books.
        counts["fragment_waiting"] = self.fragments.waiting
        counts["fragment_used"] = self.fragments.used
        counts["fragment_dropped"] = self.fragments.dropped
        return counts

    def restart_clock(self, time_ns: i64) -> None:
        """Another capture begins, at any time; it may well be older than the one before, and knows nothing of it.

        Every connection must have been closed. Attempts and fragments that wait are forgotten, but stay counted.
        """
        self.now_ns = time_ns
        table = ConnectionTable()
        table.evicted = self.table.evicted
        table.half_open_evicted = self.table.half_open_evicted
        self.table = table
        old = self.fragments
        fragments = FragmentStore()
        fragments.used = old.used
        fragments.dropped = old.dropped + old.waiting
        fragments.conflicts = old.conflicts
        fragments.invalid = old.invalid
        fragments.evicted = old.evicted
        fragments.expired = old.expired
        self.fragments = fragments

    def _add_up(self, side: Side) -> None:
        """Add the octets of one direction of a connection that ended to the account."""
        framer = side.framer
        self.octets.delivered += side.stream.octets
        self.octets.framed += framer.framed
        self.octets.skipped += framer.skipped
        self.octets.buffered += framer.buffered
        ibh = side.ibh
        if ibh is not None:
            self.octets.framed += ibh.framed
            self.octets.skipped += ibh.skipped
            self.octets.buffered += ibh.buffered
        backlog = side.backlog
        if backlog is not None:
            self.octets.framed += backlog.framed
            self.octets.skipped += backlog.skipped
            self.octets.buffered += len(backlog.octets)

    def _note(self, slug: str, detail: str = "", connection: i64 = 0) -> None:
        """Count and, within the bounds, detail a finding about the packet at hand."""
        self._judge.note(slug, connection, [self.frames], self.now_ns, detail)

    def _note_once(self, slug: str, detail: str) -> None:
        """Count a finding about the packet at hand; only the first one is detailed."""
        if slug in self._judge.counts:
            self._judge.counts[slug] += 1
        else:
            self._note(slug, detail)

    def _note_cut(self, size: i64, wire_length: i64) -> None:
        self.cut_frames += 1
        if self._judge.wants("capture.cut_frames", 0):
            detail = f"{size} of {wire_length} octets kept"
            self._judge.detail("capture.cut_frames", 0, [self.frames], self.now_ns, detail)

    def _note_syn(self, key: bytes, seq: i64) -> None:
        """Remember a connection attempt."""
        evicted: i64 = self.table.half_open_evicted
        self.table.note_syn(key, seq, self.frames, self.now_ns)
        if self.table.half_open_evicted > evicted:
            self._note("stream.half_open_evicted")

    def _note_refused(self, key: bytes) -> None:
        """A connection attempt was answered with a reset; on other ports than 102 that is not our business."""
        server, client = endpoints(key)
        if server.port == ISO_TSAP_PORT:
            self._note("stream.refused", f"{server} refuses {client}")

    def _note_ignored(self, side: Side, what: str) -> None:
        """A reset or FIN is not believed."""
        if side.connection.followed:
            self._note("stream.reset_ignored", f"{what} from {side.tcp.ends[side.index]}", side.connection.number)

    def _note_damaged(self, found: Segment) -> None:
        """A segment or datagram has a wrong checksum; on connections that nobody follows that is not our business."""
        side = self.table.sides.get(found.key)
        if side is not None and side.connection.followed:
            self._note("stream.bad_checksum", f"{len(found.octets)} octets at {found.seq}", side.connection.number)
        elif side is None and found.protocol == TCP:
            sender, receiver = endpoints(found.key)
            if ISO_TSAP_PORT in {sender.port, receiver.port}:
                self._note("stream.bad_checksum", f"{sender} -> {receiver}")

    def _find_segment(self, buf: bytes, start: i64, end: i64, link_type: i64) -> Segment:
        """Return the TCP segment of a frame, or a UDP datagram when these are wanted, or why there is none."""
        fragments = self.fragments
        conflicts: i64 = fragments.conflicts
        evicted: i64 = fragments.evicted
        dropped: i64 = fragments.invalid
        found = find_segment(buf, start, end, link_type, fragments, self.now_ns, self.wants_udp, self._checksums)
        if found.problem == "bad_header":
            self._note_once("ip.bad_header", "first seen here")
        if fragments.invalid > dropped:
            self._note_once("ip.fragment_invalid", "first seen here")
        if fragments.conflicts > conflicts:
            what = "TCP or UDP" if self.wants_udp else "TCP"
            self._note("ip.fragment_conflict", f"in a datagram that holds {what}")
        if fragments.evicted > evicted:
            self._note("ip.fragments_evicted")
        return found
