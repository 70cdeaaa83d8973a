"""The first reading: where in each stream everything stands that becomes something else."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.anonymize.account import FULL, MANY, UNCERTAIN, Account
from dissect.anonymize.key import Key
from dissect.anonymize.messages import codes_inside, codes_of, draft_netlink, draft_tpdu, draft_tsdu
from dissect.anonymize.plus import PlusRules
from dissect.anonymize.rewrite_plan import RewritePlan
from dissect.anonymize.rules import Rules
from dissect.anonymize.track import COST, Room, Track, track_at
from dissect.engine.observer import Observer
from dissect.ibh.packet import HEADER as IBH_HEADER
from dissect.ibh.packet import parse_packet
from dissect.ibh.tables import KIND_DATA, KIND_FRAGMENT
from dissect.iso.cotp import MAX_TSDU, parse_tpdu
from dissect.iso.tables import DT
from dissect.iso.upper import S7COMM, S7COMM_PLUS, classify
from dissect.s7plus.assembly import MAX_PDU, PlusAssembler
from dissect.s7plus.tables import KEEP_ALIVE, SYSTEM_EVENT
from dissect.tcp.connection import TcpConnection
from dissect.transactions.connection import Connection
from dissect.transactions.payloads import Backlog, ScdMessage
from dissect.transactions.side import Side
from dissect.transactions.table import keys_of, reverse_key
from dissect.transactions.transaction import Transaction
from dissect.wire.octets import u16

if TYPE_CHECKING:
    from dissect.bindings.engine import ScdCarrier

#: Directions remembered; the packets of those after them are written with zeros for contents.
MAX_TRACKS: Final = 65_536
#: What stands before the keys of UDP.
UDP: Final = b"udp"
#: Parts of one message that are waited for.
MAX_PARTS: Final = 8192
#: Packets with messages whose transactions are waited for.
MAX_WAITING: Final = 1024
_DT_HEAD: Final = 7


class _Part:
    """A part of a message: its header, where its data stand in the stream, the data."""

    __slots__ = ("data", "data_at", "head", "head_at")

    def __init__(self, head: RewritePlan, head_at: int, data_at: int, data: bytes) -> None:
        self.head = head
        self.head_at = head_at
        self.data_at = data_at
        self.data = data


class _Frame:
    """A whole TSDU of S7comm-plus: its parts, its octets, and whether it is no part of a PDU, even between its frames."""

    __slots__ = ("alone", "octets", "parts")

    def __init__(self, parts: list[_Part], octets: bytes) -> None:
        self.parts = parts
        self.octets = octets
        self.alone = len(octets) < 4 or octets[1] in {KEEP_ALIVE, SYSTEM_EVENT}

    def lay(self, track: Track, draft: RewritePlan) -> None:
        """Write what becomes of it, cut as its parts were."""
        at = 0
        for part in self.parts:
            track.lay(part.head, part.head_at)
            track.lay(draft, part.data_at - at, at, at + len(part.data))
            at += len(part.data)


class _Message:
    """The parts of a message whose end is still to come in one direction."""

    __slots__ = ("assembler", "claimed", "dropping", "frames", "holes", "missing", "parts", "plus", "size", "told")

    def __init__(self, largest: i64) -> None:
        self.parts: list[_Part] = []
        self.assembler = PlusAssembler(largest)
        self.frames: list[_Frame] = []  # of an S7comm-plus PDU whose last one is to come
        self.size = 0
        self.holes = 0
        self.missing = 0  # octets in them
        self.dropping = False  # up to its end
        self.plus = False  # an S7comm-plus PDU goes on in the next message
        self.claimed = False  # a binding says that SCD is in it
        self.told = 0  # where the TPKT told last ends

    @property
    def idle(self) -> bool:
        """True when nothing waits for what comes next."""
        return not (self.parts or self.dropping or self.frames or self.plus or self.assembler.parts is not None)


class Survey(Observer):
    """Watches the first reading. Afterwards `find` gives what becomes of the octets of a packet, of those in ``tracks``.

    ``largest``: octets of an S7comm-plus PDU; the contents of a larger one become zeros.
    """

    def __init__(
        self,
        key: Key,
        rules: Rules,
        plus: PlusRules,
        told: Account,
        carrier: ScdCarrier | None = None,
        largest: i64 = MAX_PDU,
    ) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.wants_pdus = True
        self._key = key
        self._rules = rules
        self._plus = plus
        self._account = told
        self._room = Room()
        self._largest: i64 = largest
        self.tracks: dict[bytes, list[Track]] = {}
        self._count = 0
        # By direction; the oldest leave when there are too many.
        self._messages: OrderedDict[bytes, tuple[Track, _Message]] = OrderedDict()
        self._carrier = carrier
        self._tsdu: list[_Part] = []  # the parts of the latest one that a binding claims
        self._units: Units | None = None
        self._datagrams: dict[int, list[tuple[int, bytes]]] = {}
        # Messages whose transaction is still to come, by connection and packet: where in which stream, and their octets.
        self._waiting: OrderedDict[tuple[int, int], list[tuple[Track, int, bytes]]] = OrderedDict()

    # ---- observer ---------------------------------------------------------------------------------------------------

    def connection_opened(self, connection: Connection) -> None:
        """Make room for both directions of a connection, so that its packets are known."""
        tcp = connection.tcp
        for index, direction in enumerate(_keys(tcp, bool(connection.udp))):
            tracks = self.tracks.setdefault(direction, [])
            if tracks and tracks[-1].stream is tcp.streams[index]:
                continue  # another transport connection on the same TCP connection
            if self._count >= MAX_TRACKS:
                self._account.warn(MANY)
                return
            self._count += 1
            tracks.append(Track(tcp, tcp.streams[index], self._room))

    def connection_closed(self, connection: Connection) -> None:
        """What is not whole yet will not become so; in which VLANs packets of it are is known now."""
        self._lay_units()
        self._join(connection)
        for index, direction in enumerate(_keys(connection.tcp, bool(connection.udp))):
            known = self._messages.get(direction)
            if known is not None and known[0].stream is connection.tcp.streams[index]:
                self._flush(*known)
                known[0].expect(known[1].told, -1)
                del self._messages[direction]

    def _join(self, connection: Connection) -> None:
        """Let the packets of a connection be found in the other VLANs, too."""
        tcp = connection.tcp
        for also in range(1, len(tcp.also) + 1):
            for own, other in zip(_keys(tcp, False), _keys(tcp, False, also), strict=True):
                there = self.tracks.setdefault(other, [])
                there += [track for track in self.tracks.get(own, ()) if track.tcp is tcp and track not in there]
                there.sort(key=lambda track: track.first_frame)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """A whole TPKT: work out what becomes of it."""
        track, message = self._direction(side)
        if track is None:
            return
        start = int(side.framer.passed + side.missing) - len(octets)
        if message.holes != side.holes:
            self._judge_hole(track, message, side)
        track.expect(message.told, start)
        message.told = start + len(octets)
        message.claimed = self._carrier is not None and self._carrier.claims_tsdus(side.connection)
        if octets[4] == 2 and octets[5] == 0xF0:
            if octets[6] >= 0x80 and classify(octets, _DT_HEAD, len(octets)) == S7COMM and message.idle:
                data = octets[_DT_HEAD:]
                track.keep(start, start + _DT_HEAD)
                codes = codes_inside(side, data)
                if codes is None:
                    self._wait(int(side.connection.number), int(frame), track, start + _DT_HEAD, data)
                track.lay(draft_tsdu(data, self._rules, self._account, True, codes or ()), start + _DT_HEAD)
                return
            head = RewritePlan(octets, self._account)
            head.keep(0, _DT_HEAD)
            self._part(side, track, message, _Part(head, start, start + _DT_HEAD, octets[_DT_HEAD:]), octets[6] >= 0x80)
            return
        tpdu = parse_tpdu(octets[4:])
        if tpdu.type != DT or tpdu.malformed:
            self._flush(track, message)
            track.lay(draft_tpdu(octets, tpdu, self._key, self._account), start)
            return
        size = len(octets) - len(tpdu.data)
        head = draft_tpdu(octets[:size], tpdu, self._key, self._account)
        self._part(side, track, message, _Part(head, start, start + size, tpdu.data), tpdu.field("eot") == 1)

    def _wait(self, connection: int, frame: int, track: Track, at: int, octets: bytes) -> None:
        """Keep a message of which its transaction will say where return codes are inside of it."""
        while len(self._waiting) >= MAX_WAITING:
            self._waiting.popitem(last=False)
        self._waiting.setdefault((connection, frame), []).append((track, at, octets))

    def transaction(self, transaction: Transaction) -> None:
        """A transaction is complete: return codes inside of its answer stay."""
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
        """An S7 PDU that the capture cut: its TPKT was not told."""
        if cut:
            self._cut(side, octets)

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """An S7comm-plus PDU that the capture cut."""
        if cut:
            self._cut(side, octets)

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """A whole IBH-NetLink packet, in which a part of a message may be."""
        track, message = self._direction(side)
        framer = side.ibh
        if track is None or framer is None:
            return
        passed = int(framer.passed) + int(side.framer.framed) + int(side.framer.skipped)
        start = passed + int(side.missing) - len(octets)
        self._judge_hole(track, message, side)
        packet = parse_packet(octets)
        head = draft_netlink(packet, self._account)
        if packet.kind in (KIND_DATA, KIND_FRAGMENT):
            part = _Part(head, start, start + int(packet.data_at), packet.data)
            self._part(side, track, message, part, packet.kind == KIND_DATA)
        else:  # a receipt between two parts of a message comes behind the first
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
        """A hole ends the message it falls into."""
        if message.holes != int(side.holes):
            message.holes = int(side.holes)
            message.missing = int(side.missing)
            self._flush(track, message)

    def _part(self, side: Side, track: Track, message: _Message, part: _Part, last: bool) -> None:
        """A part of a message; the data of one that is too long stay zeros."""
        if message.dropping or (not last and not part.data and not message.parts):
            self._lay_frames(track, message)
            track.lay(part.head, part.head_at)
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
        """A message is whole: what becomes of it is cut as its parts were."""
        parts = message.parts
        octets = parts[0].data if len(parts) == 1 else b"".join([part.data for part in parts])
        upper = classify(octets, 0, len(octets)) if octets else -1
        frame = _Frame(parts, octets)
        message.parts = []
        message.size = 0
        if upper == S7COMM_PLUS:
            self._plus_frame(side, track, message, frame)
            return
        self._lay_frames(track, message)
        if message.claimed and upper != S7COMM:
            self._tsdu = parts  # what becomes of it is said when it is told as SCD
            draft = RewritePlan(octets, self._account)
        else:
            draft = draft_tsdu(octets, self._rules, self._account, codes=codes_inside(side, octets) or ())
        frame.lay(track, draft)

    def _plus_frame(self, side: Side, track: Track, message: _Message, frame: _Frame) -> None:
        """Take a frame of S7comm-plus; with the last one it is known what becomes of all those of a PDU."""
        assembler = message.assembler
        if assembler.interrupted(frame.octets):
            self._lay_frames(track, message)
        whole = assembler.push(frame.octets)
        message.frames.append(frame)
        frame.alone = frame.alone or assembler.passed
        if assembler.left_out:
            self._blank_frames(track, message)
            return
        if assembler.parts is not None or whole is None:
            return  # there is more to come
        new = self._plus.message(whole, side)
        if new is None:
            self._blank_frames(track, message)
            return
        frames, message.frames = message.frames, []
        message.plus = False
        at = 0
        for one in frames:
            if one.alone and one is not frame:
                one.lay(track, draft_tsdu(one.octets, self._rules, self._account))
                continue
            draft = RewritePlan(one.octets, self._account)
            draft.lay(new[at : at + len(one.octets)])
            one.lay(track, draft)
            at += len(one.octets)

    def _lay_frames(self, track: Track, message: _Message) -> None:
        """No more frames of the PDU at hand will come."""
        message.assembler.finish()
        self._blank_frames(track, message)
        message.plus = False

    def _blank_frames(self, track: Track, message: _Message) -> None:
        """Frames of a PDU that is not whole, or not readable: what pairs it stays, its contents become zeros."""
        for frame in message.frames:
            octets = frame.octets
            frame.lay(track, draft_tsdu(octets, self._rules, self._account, not message.plus))
            if not frame.alone:
                message.plus = octets[-4:] != octets[:2] + b"\0\0"
        message.frames = []

    def _flush(self, track: Track, message: _Message) -> None:
        """A message will not become whole: its headers stay, its data become zeros."""
        self._lay_frames(track, message)
        for part in message.parts:
            track.lay(part.head, part.head_at)
        message.parts = []
        message.size = 0

    def _cut(self, side: Side, octets: bytes) -> None:
        """A message the capture cut, alone in its TPKT: it ends where the hole begins that was just told."""
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

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """An SCD message in a datagram, a stream or a TSDU: lay down what becomes of it there."""
        if self._rules.scd is None:
            return
        draft = RewritePlan(found.octets, self._account)
        draft.lay(self._rules.scd.message(found))
        at = int(found.offset)
        if side.connection.udp:
            self._in_datagram(int(frame), at, draft)
        elif isinstance(side.kept, Backlog):
            self._in_stream(side, found, draft)
        elif self._tsdu:
            track, _ = self._direction(side)
            begin = 0
            for part in self._tsdu:
                end = begin + len(part.data)
                if track is None:
                    return
                track.lay(draft, part.data_at - begin + at, max(begin - at, 0), max(end - at, 0))
                begin = end

    def _in_datagram(self, frame: int, at: int, draft: RewritePlan) -> None:
        if not self._room.take(len(draft.octets) + COST):
            self._account.warn(FULL)
            return
        new = b"".join([piece or draft.octets[begin:end] for begin, end, piece in draft.pieces])
        self._datagrams.setdefault(frame, []).append((at, new))

    def _in_stream(self, side: Side, found: ScdMessage, draft: RewritePlan) -> None:
        """Messages that are told together end where the stream was accounted for, or begin where the last one ended.

        The latter where something else stands behind them. Were the place a wrong one, no octet of the capture would be shown.
        """
        backlog = side.kept
        track, message = self._direction(side)
        if track is None or backlog is None:
            return
        end = int(backlog.framed) + int(backlog.skipped) + int(side.missing)
        units = self._units
        if units is None or units.track is not track or units.end != end:
            self._lay_units()
            units = self._units = Units(track, end)
        if side.framer.synced or not found.message.numbers:
            units.drafts.append(draft)
            message.told = end
            return
        track.lay(draft, message.told)
        message.told += len(draft.octets)
        if message.missing != int(side.missing):
            message.missing = int(side.missing)
            self._account.warn(UNCERTAIN)

    def _lay_units(self) -> None:
        """Lay down messages of a stream, one behind the other, of which the last one ends at a known place."""
        units, self._units = self._units, None
        if units is not None:
            at = units.end - sum([len(draft.octets) for draft in units.drafts])
            for draft in units.drafts:
                units.track.lay(draft, at)
                at += len(draft.octets)

    def headers(self, octets: bytes) -> bytes | None:
        """Return what becomes of SCD that no binding points at; None where it is something else."""
        return self._rules.scd.headers(octets) if self._rules.scd is not None else None

    def datagram(self, frame: int, octets: bytes) -> bytes:
        """Return what becomes of the payload of a datagram that a binding claims: zeros where nothing is known of it."""
        new = bytearray(len(octets))
        for at, made in self._datagrams.get(frame, ()):
            new[at : at + len(made)] = made
        return bytes(new[: len(octets)])

    # ---- afterwards -------------------------------------------------------------------------------------------------

    def settle(self) -> None:
        """The first reading is over: nothing more becomes whole."""
        self._lay_units()
        for track, message in self._messages.values():
            self._flush(track, message)
            track.expect(message.told, -1)
        self._messages.clear()
        for tracks in self.tracks.values():
            for track in tracks:
                track.settle()
                if track.full:
                    self._account.warn(FULL)

    def find(self, key: bytes, frame: int) -> Track | None:
        """Return what becomes of the octets in packet ``frame`` with this key; None for no connection that was followed."""
        return track_at(self.tracks.get(key), frame)


class Units:
    """Messages of a bound stream that were told together; the last one ends at ``end``."""

    __slots__ = ("drafts", "end", "track")

    def __init__(self, track: Track, end: int) -> None:
        self.track = track
        self.end = end
        self.drafts: list[RewritePlan] = []


def _keys(tcp: TcpConnection, udp: bool, also: int = 0) -> tuple[bytes, bytes]:
    """Return the keys of the packets of both directions; ``also`` counts the VLANs in which they were captured besides."""
    key = keys_of(tcp)[also]
    if udp:
        return UDP + key, UDP + reverse_key(key)
    return key, reverse_key(key)
