"""First pass: records which octets of each stream are kept or replaced."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import Backlog, ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import keys_of, reverse_key
from dissect.engine.transactions.transaction import Transaction
from dissect.files.anonymize.account import FULL, MANY, UNCERTAIN, Account
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.messages import codes_inside, codes_of, plan_netlink, plan_tpdu, plan_tsdu
from dissect.files.anonymize.plus import PlusRules
from dissect.files.anonymize.rewrite_plan import RewritePlan
from dissect.files.anonymize.rules import Rules
from dissect.files.anonymize.track import COST, Room, Track, track_at
from dissect.packets.tcp.connection import TcpConnection
from dissect.protocols.ibh.packet import HEADER as IBH_HEADER
from dissect.protocols.ibh.packet import parse_packet
from dissect.protocols.ibh.tables import KIND_DATA, KIND_FRAGMENT
from dissect.protocols.iso.cotp import MAX_TSDU, parse_tpdu
from dissect.protocols.iso.tables import DT
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, classify
from dissect.protocols.s7plus.assembly import MAX_PDU, PlusAssembler
from dissect.protocols.s7plus.tables import KEEP_ALIVE, SYSTEM_EVENT
from dissect.wire.octets import u16

if TYPE_CHECKING:
    from dissect.meaning.bindings.engine import ScdCarrier

#: Maximum number of directions that are followed; packets of later ones are written with zeroed contents.
MAX_TRACKS: Final = 65_536
#: The prefix of UDP keys.
UDP: Final = b"udp"
#: Maximum number of parts of an incomplete message.
MAX_PARTS: Final = 8192
#: Maximum number of packets with messages whose transactions are incomplete.
MAX_WAITING: Final = 1024
_DT_HEAD: Final = 7


class _Part:
    """A part of a message: its header, the position of its data in the stream, and the data."""

    __slots__ = ("data", "data_at", "head", "head_at")

    def __init__(self, head: RewritePlan, head_at: int, data_at: int, data: bytes) -> None:
        self.head = head
        self.head_at = head_at
        self.data_at = data_at
        self.data = data


class _Frame:
    """A whole TSDU of S7comm-plus: its parts, its octets, and whether it is outside of any PDU, even between its frames."""

    __slots__ = ("alone", "octets", "parts")

    def __init__(self, parts: list[_Part], octets: bytes) -> None:
        self.parts = parts
        self.octets = octets
        self.alone = len(octets) < 4 or octets[1] in {KEEP_ALIVE, SYSTEM_EVENT}

    def apply(self, track: Track, plan: RewritePlan) -> None:
        """Record the plan of the TSDU, divided among its parts."""
        at = 0
        for part in self.parts:
            track.apply(part.head, part.head_at)
            track.apply(plan, part.data_at - at, at, at + len(part.data))
            at += len(part.data)


class _Message:
    """The parts of an incomplete message in one direction."""

    __slots__ = ("assembler", "claimed", "dropping", "frames", "holes", "missing", "parts", "plus", "reported", "size")

    def __init__(self, largest: i64) -> None:
        self.parts: list[_Part] = []
        self.assembler = PlusAssembler(largest)
        self.frames: list[_Frame] = []  # of an S7comm-plus PDU whose last frame is missing
        self.size = 0
        self.holes = 0
        self.missing = 0  # their size
        self.dropping = False  # up to its end
        self.plus = False  # an S7comm-plus PDU continues in the next message
        self.claimed = False  # a binding says that it contains SCD
        self.reported = 0  # end of the latest TPKT that was reported

    @property
    def idle(self) -> bool:
        """True if no part is kept."""
        return not (self.parts or self.dropping or self.frames or self.plus or self.assembler.parts is not None)


class Survey(Observer):
    """Observes the first pass. Afterwards `find` returns the track for the octets of a packet, one of ``tracks``.

    ``largest``: maximum size of an S7comm-plus PDU; the contents of a larger one become zeros.
    """

    def __init__(
        self,
        key: Key,
        rules: Rules,
        plus: PlusRules,
        counts: Account,
        carrier: ScdCarrier | None = None,
        largest: i64 = MAX_PDU,
    ) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.wants_pdus = True
        self._key = key
        self._rules = rules
        self._plus = plus
        self._account = counts
        self._room = Room()
        self._largest: i64 = largest
        self.tracks: dict[bytes, list[Track]] = {}
        self._count = 0
        # By direction; if there are too many, the oldest are dropped.
        self._messages: OrderedDict[bytes, tuple[Track, _Message]] = OrderedDict()
        self._carrier = carrier
        self._tsdu: list[_Part] = []  # the parts of the latest one that a binding claims
        self._units: Units | None = None
        self._datagrams: dict[int, list[tuple[int, bytes]]] = {}
        # Messages whose transaction is incomplete, by connection and packet: their track, their position and their octets.
        self._waiting: OrderedDict[tuple[int, int], list[tuple[Track, int, bytes]]] = OrderedDict()

    # ---- observer ---------------------------------------------------------------------------------------------------

    def connection_opened(self, connection: Connection) -> None:
        """Make tracks for both directions of a connection, so that its packets are recognised."""
        tcp = connection.tcp
        for index, direction in enumerate(_keys(tcp, bool(connection.udp))):
            tracks = self.tracks.setdefault(direction, [])
            if tracks and tracks[-1].stream is tcp.streams[index]:
                continue  # a new transport connection on the same TCP connection
            if self._count >= MAX_TRACKS:
                self._account.warn(MANY)
                return
            self._count += 1
            tracks.append(Track(tcp, tcp.streams[index], self._room))

    def connection_closed(self, connection: Connection) -> None:
        """End incomplete messages of a connection; the VLANs of its packets are known now."""
        self._plan_units()
        self._join(connection)
        for index, direction in enumerate(_keys(connection.tcp, bool(connection.udp))):
            known = self._messages.get(direction)
            if known is not None and known[0].stream is connection.tcp.streams[index]:
                self._flush(*known)
                known[0].expect(known[1].reported, -1)
                del self._messages[direction]

    def _join(self, connection: Connection) -> None:
        """Register the tracks of a connection for its other VLANs, too."""
        tcp = connection.tcp
        for also in range(1, len(tcp.also) + 1):
            for own, other in zip(_keys(tcp, False), _keys(tcp, False, also), strict=True):
                there = self.tracks.setdefault(other, [])
                there += [track for track in self.tracks.get(own, ()) if track.tcp is tcp and track not in there]
                there.sort(key=lambda track: track.first_frame)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Plan a whole TPKT."""
        track, message = self._direction(side)
        if track is None:
            return
        start = int(side.framer.passed + side.missing) - len(octets)
        if message.holes != side.holes:
            self._judge_hole(track, message, side)
        track.expect(message.reported, start)
        message.reported = start + len(octets)
        message.claimed = self._carrier is not None and self._carrier.claims_tsdus(side.connection)
        if octets[4] == 2 and octets[5] == 0xF0:
            if octets[6] >= 0x80 and classify(octets, _DT_HEAD, len(octets)) == S7COMM and message.idle:
                data = octets[_DT_HEAD:]
                track.keep(start, start + _DT_HEAD)
                codes = codes_inside(side, data)
                if codes is None:
                    self._wait(int(side.connection.number), int(frame), track, start + _DT_HEAD, data)
                track.apply(plan_tsdu(data, self._rules, self._account, True, codes or ()), start + _DT_HEAD)
                return
            head = RewritePlan(octets, self._account)
            head.keep(0, _DT_HEAD)
            self._part(side, track, message, _Part(head, start, start + _DT_HEAD, octets[_DT_HEAD:]), octets[6] >= 0x80)
            return
        tpdu = parse_tpdu(octets[4:])
        if tpdu.type != DT or tpdu.malformed:
            self._flush(track, message)
            track.apply(plan_tpdu(octets, tpdu, self._key, self._account), start)
            return
        size = len(octets) - len(tpdu.data)
        head = plan_tpdu(octets[:size], tpdu, self._key, self._account)
        self._part(side, track, message, _Part(head, start, start + size, tpdu.data), tpdu.field("eot") == 1)

    def _wait(self, connection: int, frame: int, track: Track, at: int, octets: bytes) -> None:
        """Keep a message until its transaction shows whether there are return codes inside its values."""
        while len(self._waiting) >= MAX_WAITING:
            self._waiting.popitem(last=False)
        self._waiting.setdefault((connection, frame), []).append((track, at, octets))

    def transaction(self, transaction: Transaction) -> None:
        """Keep the return codes inside the answer of a complete transaction."""
        if not self._waiting:
            return
        waited = self._waiting.pop((int(transaction.connection.number), int(transaction.response_frame)), None)
        if waited is None:
            return
        answer = transaction.response_octets
        others = [message for message in waited if message[2] != answer]
        if others:
            self._waiting[int(transaction.connection.number), int(transaction.response_frame)] = others
        if len(others) == len(waited):
            return
        codes = codes_of(transaction)
        for track, at, octets in waited:
            for code in codes if octets == answer else ():
                track.keep_one(at + code, octets[code : code + 1])

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Plan an S7 PDU that the capture cut: its TPKT was not reported."""
        if cut:
            self._cut(side, octets)

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Plan an S7comm-plus PDU that the capture cut."""
        if cut:
            self._cut(side, octets)

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Plan a whole IBH-NetLink packet, which may contain a part of a message."""
        track, message = self._direction(side)
        framer = side.ibh
        if track is None or framer is None:
            return
        passed = int(framer.passed) + int(side.framer.framed) + int(side.framer.skipped)
        start = passed + int(side.missing) - len(octets)
        self._judge_hole(track, message, side)
        packet = parse_packet(octets)
        head = plan_netlink(packet, self._account)
        if packet.kind in (KIND_DATA, KIND_FRAGMENT):
            part = _Part(head, start, start + int(packet.data_at), packet.data)
            self._part(side, track, message, part, packet.kind == KIND_DATA)
        else:  # a receipt between two parts of a message comes after the first
            self._part(side, track, message, _Part(head, start, start + len(octets), b""), False)

    # ---- messages ---------------------------------------------------------------------------------------------------

    def _direction(self, side: Side) -> tuple[Track | None, _Message]:
        known = self._messages.get(side.key)
        if known is not None and known[0].stream is side.stream:
            return known
        for track in reversed(self.tracks.get(side.key, [])):
            if track.stream is side.stream:
                if len(self._messages) >= MAX_TRACKS:
                    self._flush(*self._messages.popitem(last=False)[1])
                fresh = (track, _Message(self._largest))
                self._messages[side.key] = fresh
                return fresh
        return None, _Message(self._largest)

    def _judge_hole(self, track: Track, message: _Message, side: Side) -> None:
        """End a message that has a gap."""
        if message.holes != int(side.holes):
            message.holes = int(side.holes)
            message.missing = int(side.missing)
            self._flush(track, message)

    def _part(self, side: Side, track: Track, message: _Message, part: _Part, last: bool) -> None:
        """Take a part of a message; the data of one that is too long stay zeros."""
        if message.dropping or (not last and not part.data and not message.parts):
            self._plan_frames(track, message)
            track.apply(part.head, part.head_at)
            message.dropping = message.dropping and not last
            return
        message.parts.append(part)
        message.size += len(part.data)
        if message.size > MAX_TSDU or len(message.parts) > MAX_PARTS:
            self._flush(track, message)
            message.dropping = not last
        elif last:
            self._whole(side, track, message)

    def _whole(self, side: Side, track: Track, message: _Message) -> None:
        """Plan a whole message, and divide the plan among its parts."""
        parts = message.parts
        octets = parts[0].data if len(parts) == 1 else b"".join([part.data for part in parts])
        upper = classify(octets, 0, len(octets)) if octets else -1
        frame = _Frame(parts, octets)
        message.parts = []
        message.size = 0
        if upper == S7COMM_PLUS:
            self._plus_frame(side, track, message, frame)
            return
        self._plan_frames(track, message)
        if message.claimed and upper != S7COMM:
            self._tsdu = parts  # it is planned when it is reported as SCD
            plan = RewritePlan(octets, self._account)
        else:
            plan = plan_tsdu(octets, self._rules, self._account, codes=codes_inside(side, octets) or ())
        frame.apply(track, plan)

    def _plus_frame(self, side: Side, track: Track, message: _Message, frame: _Frame) -> None:
        """Take a frame of S7comm-plus; the last frame completes the plan of its PDU."""
        assembler = message.assembler
        if assembler.interrupted(frame.octets):
            self._plan_frames(track, message)
        whole = assembler.push(frame.octets)
        message.frames.append(frame)
        frame.alone = frame.alone or assembler.passed
        if assembler.left_out:
            self._blank_frames(track, message)
            return
        if assembler.parts is not None or whole is None:
            return  # more frames follow
        new = self._plus.message(whole, side)
        if new is None:
            self._blank_frames(track, message)
            return
        frames, message.frames = message.frames, []
        message.plus = False
        at = 0
        for one in frames:
            if one.alone and one is not frame:
                one.apply(track, plan_tsdu(one.octets, self._rules, self._account))
                continue
            plan = RewritePlan(one.octets, self._account)
            plan.write(new[at : at + len(one.octets)])
            one.apply(track, plan)
            at += len(one.octets)

    def _plan_frames(self, track: Track, message: _Message) -> None:
        """Plan the frames of the current PDU, which is complete or broken off."""
        message.assembler.finish()
        self._blank_frames(track, message)
        message.plus = False

    def _blank_frames(self, track: Track, message: _Message) -> None:
        """Plan the frames of an incomplete or unreadable PDU: pairing fields stay, contents become zeros."""
        for frame in message.frames:
            octets = frame.octets
            frame.apply(track, plan_tsdu(octets, self._rules, self._account, not message.plus))
            if not frame.alone:
                message.plus = octets[-4:] != octets[:2] + b"\0\0"
        message.frames = []

    def _flush(self, track: Track, message: _Message) -> None:
        """Plan an incomplete message: its headers stay, its data become zeros."""
        self._plan_frames(track, message)
        for part in message.parts:
            track.apply(part.head, part.head_at)
        message.parts = []
        message.size = 0

    def _cut(self, side: Side, octets: bytes) -> None:
        """Plan a message that the capture cut, alone in its TPKT: it ends where the gap begins that was just reported."""
        track, message = self._direction(side)
        iso, gateway = side.framer, side.ibh
        packet = iso.cut_packet if gateway is None else gateway.cut_packet
        if track is None or not octets or not packet.endswith(octets):
            return
        whole = u16(packet, 2) if gateway is None else IBH_HEADER + packet[2]
        missing = int(side.missing) - message.missing if int(side.holes) == message.holes + 1 else -1
        if iso.synced if gateway is None else gateway.synced:
            missing = whole - len(packet) - int(iso.skip if gateway is None else gateway.skip)
        lost = int(side.missing) - missing
        self._judge_hole(track, message, side)
        if missing < 0:
            self._account.warn(UNCERTAIN)
            return
        passed = int(iso.framed) + int(iso.skipped)
        if gateway is not None:
            passed += int(gateway.framed) + int(gateway.skipped)
        start = passed + lost - len(packet)
        data = len(packet) - len(octets)
        head = RewritePlan(packet, self._account)
        head.keep(0, data)
        self._part(side, track, message, _Part(head, start, start + data, octets), True)

    # ---- SCD --------------------------------------------------------------------------------------------------------

    def scd(self, frame: i64, time_ns: i64, side: Side, message: ScdMessage) -> None:
        """Plan an SCD message in a datagram, a stream or a TSDU."""
        if self._rules.scd is None:
            return
        plan = RewritePlan(message.octets, self._account)
        plan.write(self._rules.scd.message(message))
        at = int(message.offset)
        if side.connection.udp:
            self._in_datagram(int(frame), at, plan)
        elif isinstance(side.kept, Backlog):
            self._in_stream(side, message, plan)
        elif self._tsdu:
            track, _ = self._direction(side)
            begin = 0
            for part in self._tsdu:
                end = begin + len(part.data)
                if track is None:
                    return
                track.apply(plan, part.data_at - begin + at, max(begin - at, 0), max(end - at, 0))
                begin = end

    def _in_datagram(self, frame: int, at: int, plan: RewritePlan) -> None:
        if not self._room.take(len(plan.octets) + COST):
            self._account.warn(FULL)
            return
        new = b"".join([piece or plan.octets[begin:end] for begin, end, piece in plan.pieces])
        self._datagrams.setdefault(frame, []).append((at, new))

    def _in_stream(self, side: Side, scd_message: ScdMessage, plan: RewritePlan) -> None:
        """Plan messages of a bound stream.

        Messages that are reported together end at the position up to which the stream was processed. If anything else follows
        them, they begin where the last one ended. A wrong position is harmless: it reveals no octets of the capture.
        """
        backlog = side.kept
        track, message = self._direction(side)
        if track is None or backlog is None:
            return
        end = int(backlog.framed) + int(backlog.skipped) + int(side.missing)
        units = self._units
        if units is None or units.track is not track or units.end != end:
            self._plan_units()
            units = self._units = Units(track, end)
        if side.framer.synced or not scd_message.message.numbers:
            units.plans.append(plan)
            message.reported = end
            return
        track.apply(plan, message.reported)
        message.reported += len(plan.octets)
        if message.missing != int(side.missing):
            message.missing = int(side.missing)
            self._account.warn(UNCERTAIN)

    def _plan_units(self) -> None:
        """Plan messages of a stream that follow one another; the position of the end of the last one is known."""
        units, self._units = self._units, None
        if units is not None:
            at = units.end - sum([len(plan.octets) for plan in units.plans])
            for plan in units.plans:
                units.track.apply(plan, at)
                at += len(plan.octets)

    def headers(self, octets: bytes) -> bytes | None:
        """Return the rewritten form of SCD that no binding claims; None if it is something else."""
        return self._rules.scd.headers(octets) if self._rules.scd is not None else None

    def datagram(self, frame: int, octets: bytes) -> bytes:
        """Return the rewritten payload of a datagram that a binding claims: zeros where nothing is known of it."""
        new = bytearray(len(octets))
        for at, rewritten in self._datagrams.get(frame, ()):
            new[at : at + len(rewritten)] = rewritten
        return bytes(new[: len(octets)])

    # ---- afterwards -------------------------------------------------------------------------------------------------

    def settle(self) -> None:
        """End the first pass: incomplete messages stay incomplete."""
        self._plan_units()
        for track, message in self._messages.values():
            self._flush(track, message)
            track.expect(message.reported, -1)
        self._messages.clear()
        for tracks in self.tracks.values():
            for track in tracks:
                track.settle()
                if track.full:
                    self._account.warn(FULL)

    def find(self, key: bytes, frame: int) -> Track | None:
        """Return the track for packet ``frame`` with this key; None if its connection was not followed."""
        return track_at(self.tracks.get(key), frame)


class Units:
    """Messages of a bound stream that were reported together; the last one ends at ``end``."""

    __slots__ = ("end", "plans", "track")

    def __init__(self, track: Track, end: int) -> None:
        self.track = track
        self.end = end
        self.plans: list[RewritePlan] = []


def _keys(tcp: TcpConnection, udp: bool, also: int = 0) -> tuple[bytes, bytes]:
    """Return the keys of the packets of both directions; ``also`` is the index of a further VLAN they were captured in."""
    key = keys_of(tcp)[also]
    if udp:
        return UDP + key, UDP + reverse_key(key)
    return key, reverse_key(key)
