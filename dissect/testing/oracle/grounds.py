"""The grounds that explain a difference: predicates over the octets, one for each entry of `dissect.testing.oracle.known`.

They use the octets of the message and, if a difference originates in TCP, `Streams`. They never use the results of the engine,
except whether it reports the message as malformed. `Streams` is built only from tshark's sequence numbers and payloads. It
shows how Wireshark's reassembly treated a packet, and is not compared itself: which octets a packet delivered first, whether
earlier octets were still missing, and whether certain octets are in a stream, and in which order.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Final

from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.tables import DR, DT, ED, ER, ER_CAUSES, TPDU_TYPES
from dissect.protocols.iso.tpkt import MIN_LENGTH
from dissect.protocols.s7 import layouts as s7
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.tables import LENGTH_IN_BITS
from dissect.testing.oracle import facts
from dissect.testing.oracle.facts import FieldPlace, Record, Value
from dissect.testing.oracle.theirs import Frame
from dissect.testing.oracle.tshark import Segment, read_segments
from dissect.wire.malformed import Malformed

_MASK: Final = 0xFFFFFFFF
_HALF: Final = 0x80000000
#: Maximum size of a TPKT: the greatest distance between a segment and the beginning of its message.
_REACH: Final = 65535


class Arrival:
    """A segment in its stream: ``at`` counts from the first octet of its direction.

    ``new``: number of octets that no earlier segment delivered; ``fresh``: their range within the segment; ``ahead``: earlier
    octets were still missing.
    """

    __slots__ = ("ahead", "at", "fresh", "new", "segment")

    def __init__(self, segment: Segment, at: int, new: int, ahead: bool, fresh: Sequence[tuple[int, int]] = ()) -> None:
        self.segment = segment
        self.at = at
        self.new = new
        self.ahead = ahead
        self.fresh = fresh

    def brought(self, octets: bytes) -> list[bool]:
        """Return, for each position of the octets in the segment, whether earlier segments delivered all of them."""
        return [
            not any(begin < place + len(octets) and place < end for begin, end in self.fresh)
            for place in _places(octets, self.segment.payload)
        ]


def _places(octets: bytes, payload: bytes) -> list[int]:
    """Return every position of octets in a payload."""
    places = []
    place = payload.find(octets) if octets else -1
    while place >= 0:
        places.append(place)
        place = payload.find(octets, place + 1)
    return places


class _Flow:
    """One direction: contiguous stretches of octets, in order; the first copy of an octet counts."""

    def __init__(self, sequence: int) -> None:
        self._origin = sequence
        self._latest = 0
        self._starts: list[int] = []
        self._stretches: list[bytearray] = []

    def add(self, segment: Segment) -> Arrival:
        ahead = (segment.sequence - self._origin - self._latest) & _MASK
        start = self._latest + (ahead - _MASK - 1 if ahead >= _HALF else ahead)
        missing = bool(self._starts) and start > self._starts[0] + len(self._stretches[0])
        self._latest = max(self._latest, start + len(segment.payload))
        fresh = [(begin - start, end - start) for begin, end in self._insert(start, segment.payload)]
        return Arrival(segment, start, sum(end - begin for begin, end in fresh), missing, fresh)

    def _insert(self, start: int, payload: bytes) -> list[tuple[int, int]]:
        """Insert the octets that are new; return their range."""
        index = max(bisect_right(self._starts, start) - 1, 0)
        if index == len(self._starts) - 1 and self._starts[index] + len(self._stretches[index]) == start:
            self._stretches[index] += payload
            return [(start, start + len(payload))]
        while index < len(self._starts) and self._starts[index] + len(self._stretches[index]) < start:
            index += 1
        joined = bytearray(payload)
        begin, reached, last = start, start, start + len(payload)
        fresh = []
        while index < len(self._starts) and self._starts[index] <= last:
            at, old = self._starts.pop(index), self._stretches.pop(index)
            end = max(begin + len(joined), at + len(old))
            if at > reached:
                fresh.append((reached, at))
            reached = max(reached, min(last, at + len(old)))
            merged = bytearray(end - min(begin, at))
            low = min(begin, at)
            merged[begin - low : begin - low + len(joined)] = joined
            merged[at - low : at - low + len(old)] = old
            joined, begin = merged, low
        self._starts.insert(index, begin)
        self._stretches.insert(index, joined)
        return [*fresh, (reached, last)] if reached < last else fresh

    def find(self, octets: bytes, begin: int, end: int) -> list[int]:
        """Return every position of the octets in the stretches between two positions."""
        offsets = []
        for start, stretch in zip(self._starts, self._stretches, strict=True):
            low, high = max(begin - start, 0), max(end - start, 0)
            offsets += [start + low + place for place in _places(octets, bytes(stretch[low:high]))]
        return offsets

    def places(self, pieces: Sequence[tuple[int, bytes]]) -> list[int | None]:
        """Return the position of each piece (position of its segment, octets) near there, after the previous piece."""
        passed = list(self._starts)  # for each stretch, the end of the last piece found in it
        places: list[int | None] = []
        for at, octets in pieces:
            index = bisect_right(self._starts, at) - 1
            start = max(passed[index], at - _REACH) - self._starts[index]
            place = self._stretches[index].find(octets, start, at + 2 * _REACH - self._starts[index])
            places.append(self._starts[index] + place if place >= 0 else None)
            if place >= 0:
                passed[index] = self._starts[index] + place + len(octets)
        return places


class Streams:
    """All segments of a capture, by frame; the capture is read once, on the first access."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._flows: dict[str, _Flow] = {}
        self._arrivals: dict[int, Arrival] | None = None
        self._protocols: dict[str, set[str]] = {}

    def protocols(self, segment: Segment) -> set[str]:
        """Return the protocols that Wireshark finds in both directions of a segment's connection."""
        return self._protocols.get(segment.stream, set())

    def arrival(self, frame: int) -> Arrival | None:
        """Return the segment of a frame, None if it has no TCP payload."""
        if self._arrivals is None:
            self._arrivals = {}
            for segment in read_segments(self._path):
                flow = self._flows.setdefault(segment.flow, _Flow(segment.sequence))
                self._arrivals[segment.frame] = flow.add(segment)
                self._protocols.setdefault(segment.stream, set()).update(segment.protocols)
        return self._arrivals.get(frame)

    def headers(self, arrival: Arrival, octets: bytes) -> list[int]:
        """Return the possible stream positions of the header of a TPKT that begins or ends in a segment."""
        size = int.from_bytes(octets[2:4], "big")
        end = arrival.at + len(arrival.segment.payload)
        return [
            at
            for at in self._flows[arrival.segment.flow].find(octets, arrival.at - _REACH, end)
            if at >= arrival.at or arrival.at < at + size <= end
        ]

    def follow(self, pieces: Sequence[tuple[int, bytes]]) -> list[bool]:
        """Return, for pieces (frame, octets) in the order they were found, whether each follows its predecessor in its stream.

        The result is False for a message that is counted twice or found inside another one.
        """
        return [place is not None for place in self.places(pieces)]

    def places(self, pieces: Sequence[tuple[int, bytes]]) -> list[int | None]:
        """Return the positions of pieces as for `follow`, None for one that does not follow."""
        by_flow: dict[str, list[int]] = {}
        arrivals: dict[int, Arrival] = {}
        for index, (frame, _) in enumerate(pieces):
            arrival = self.arrival(frame)
            if arrival is not None:
                arrivals[index] = arrival
                by_flow.setdefault(arrival.segment.flow, []).append(index)
        places: list[int | None] = [None] * len(pieces)
        for name, indexes in by_flow.items():
            placed = [(arrivals[index].at, pieces[index][1]) for index in indexes]
            for index, place in zip(indexes, self._flows[name].places(placed), strict=True):
                places[index] = place
        return places


#: Names without a Wireshark field: a whole record, its packet, its octets.
WHOLE: Final = "(whole)"
FRAME: Final = "(packet)"
OCTETS: Final = "(octets)"

RETURN_CODE: Final = s7.DATA_ITEM.fields[0].wireshark
TRANSPORT_SIZE: Final = s7.DATA_ITEM.fields[1].wireshark
LENGTH: Final = s7.DATA_ITEM.fields[2].wireshark
SUBFUNCTIONS: Final = ("s7comm.param.userdata.subfunc", "s7comm.param.modetrans.subfunc")
_LI: Final = "cotp.li"
_TYPE: Final = "cotp.type"
#: The reasons of a DR that Wireshark has names for.
_REASONS: Final = frozenset((0, 1, 2, 3, 0x80, 0x81, 0x82, 0x83, 0x84, 0x85, 0x87, 0x88, 0x8A))
#: Wireshark's names of the protocols of Remote Desktop, and of those of H.323 that use TPKT without COTP.
_RDP: Final = frozenset(("rdp", "t125"))
_H323: Final = frozenset(("q931", "h225", "h245"))
#: Return codes whose items Wireshark reads; for all others it keeps the values of the item before.
_READ_CODES: Final = frozenset((0x00, 0x0A, 0xFF))


class Evidence:
    """Evidence from the TCP streams, for differences that originate there; the streams are only read if there is one."""

    def __init__(self, path: str, records: dict[str, list[tuple[int, bytes]]]) -> None:
        self._streams = Streams(path)
        self._messages = records
        self._standing: dict[str, list[bool]] = {}
        self._tpkts: dict[str, list[tuple[int, int]]] = {}

    def arrival(self, frame: int) -> Arrival | None:
        """Return the TCP segment of a packet, None if it has no payload."""
        return self._streams.arrival(frame)

    def of_one_flow(self, frame: int, other: int) -> bool:
        """Return whether two packets belong to the same direction of the same connection."""
        mine, its = self.arrival(frame), self.arrival(other)
        return mine is not None and its is not None and mine.segment.flow == its.segment.flow

    def stands(self, record: Record) -> bool:
        """Return whether our record is at the expected position, after all our earlier records.

        A TPKT must be in the TCP stream, a PDU in the user data of the DTs there.
        """
        self._locate()
        return self._standing[record.kind][record.number]

    def inside(self, frame: int, octets: bytes) -> bool:
        """Return whether a TPKT header of a packet is inside a TPKT that we found, and nowhere at the beginning of one.

        The outer TPKT must follow another one, or begin its direction: otherwise it could be the wrong one of the two.
        """
        arrival = self.arrival(frame)
        if arrival is None:
            return False
        self._locate()
        tpkts = self._tpkts.get(arrival.segment.flow, [])
        within = False
        for at in self._streams.headers(arrival, octets):
            index = bisect_right(tpkts, (at, _REACH + 1)) - 1
            begin, end = tpkts[index] if index >= 0 else (at, at)
            if at == begin:
                return False
            follows = begin == 0 or (index > 0 and tpkts[index - 1][1] == begin)
            within = within or (at < end and follows)
        return within

    def carries(self, frame: int, protocols: frozenset[str]) -> bool:
        """Return whether Wireshark finds one of these protocols anywhere in the connection of a packet."""
        arrival = self.arrival(frame)
        return arrival is not None and not self._streams.protocols(arrival.segment).isdisjoint(protocols)

    def _locate(self) -> None:
        """Locate all our records in the streams, once."""
        if self._standing:
            return
        tpdus = self._messages[facts.TPDU]
        places = self._streams.places(tpdus)
        self._standing[facts.TPDU] = [place is not None for place in places]
        self._standing[facts.PDU] = self._follow_pdus()
        for (frame, octets), place in zip(tpdus, places, strict=True):
            arrival = self.arrival(frame)
            if arrival is not None and place is not None:
                self._tpkts.setdefault(arrival.segment.flow, []).append((place, place + len(octets)))
        for tpkts in self._tpkts.values():
            tpkts.sort()

    def _follow_pdus(self) -> list[bool]:
        joined: dict[str, bytearray] = {}
        for (frame, octets), stands in zip(self._messages[facts.TPDU], self._standing[facts.TPDU], strict=True):
            arrival = self.arrival(frame)
            if stands and arrival is not None and octets[facts.TPKT_SIZE + 1] >> 4 == DT:
                user_data = facts.TPKT_SIZE + octets[facts.TPKT_SIZE] + 1
                joined.setdefault(arrival.segment.flow, bytearray()).extend(octets[user_data:])
        passed = dict.fromkeys(joined, 0)
        standing = []
        for frame, octets in self._messages[facts.PDU]:
            arrival = self.arrival(frame)
            flow = arrival.segment.flow if arrival is not None else ""
            place = joined[flow].find(octets, passed[flow]) if flow in joined else -1
            if place >= 0:
                passed[flow] = place + len(octets)
            standing.append(place >= 0)
        return standing


class Case:
    """A difference with everything an entry may use; ``ours`` and ``theirs`` are None if a side has nothing."""

    __slots__ = ("evidence", "frame", "our_record", "ours", "place", "their_record", "theirs")

    def __init__(
        self,
        place: FieldPlace,
        ours: Value | None,
        theirs: Value | None,
        our_record: Record | None,
        their_record: Record | None,
        frame: Frame | None,
        evidence: Evidence,
    ) -> None:
        self.place = place
        self.ours = ours
        self.theirs = theirs
        self.our_record = our_record
        self.their_record = their_record
        self.frame = frame
        self.evidence = evidence

    @property
    def octets(self) -> bytes:
        """Our octets of the TPDU (its TPKT header and its own) or of the PDU."""
        return self.our_record.octets if self.our_record is not None else b""

    def beside(self, name: str) -> Value | None:
        """Return our value of another field of the same item."""
        return self.our_record.value(self.place.part, name, self.place.number) if self.our_record is not None else None


# ---- data items ------------------------------------------------------------------------------------------------------


def length_in_bits(case: Case) -> bool:
    """Whether ours is a number of bits and theirs the number of octets that contain them."""
    bits = case.ours
    counts_bits = case.beside(TRANSPORT_SIZE) in LENGTH_IN_BITS
    return (
        isinstance(bits, int)
        and counts_bits
        and case.beside(RETURN_CODE) in _READ_CODES
        and case.theirs == (bits + 7) // 8
    )


def kept_from_before(case: Case) -> bool:
    """Whether Wireshark shows the values of the item before for an item that it does not read."""
    if case.place.part != facts.IN_DATA_ITEM or case.their_record is None or case.beside(RETURN_CODE) in _READ_CODES:
        return False
    before = case.their_record.value(facts.IN_DATA_ITEM, case.place.name, case.place.number - 1)
    return case.theirs == (before or 0)


def damaged(case: Case) -> bool:
    """Whether we report the PDU as malformed."""
    if not case.octets:
        return False
    pdu = parse_pdu(case.octets)
    return bool(pdu.malformed or parse_body(pdu).malformed)


# ---- userdata --------------------------------------------------------------------------------------------------------


def split_in_fours(case: Case) -> bool:
    """Whether both sides split the octet of type and group, ours 2 + 6 and theirs 4 + 4."""
    at = s7.HEADER.size + 5
    if len(case.octets) <= at:
        return False
    octet = case.octets[at]
    # Groups 0x10, 0x20 and 0x30 become group 0, whose subfunctions have other names.
    if case.place.name in SUBFUNCTIONS:
        value = case.ours if case.ours is not None else case.theirs
        return octet & 0x3F > octet & 0x0F == 0 and value == case.octets[at + 1]
    if case.place.name == "s7comm.param.userdata.type":
        return case.ours == octet >> 6 and case.theirs == octet >> 4
    return case.ours == octet & 0x3F and case.theirs == octet & 0x0F


def mode_transition(case: Case) -> bool:
    """Whether Wireshark shows a field we do not have in a mode transition."""
    at = s7.HEADER.size
    return case.ours is None and case.octets[1:2] == b"\x07" and case.octets[at : at + 1] == b"\x01"


def parameter_of_ack(case: Case) -> bool:
    """Whether only we show a field of the parameters of an Ack."""
    return case.theirs is None and case.ours is not None and case.octets[1:2] == b"\x02"


def usend(case: Case) -> bool:
    """Whether only one side shows a field of a PDU whose parameters have the syntax id of USEND."""
    at = s7.HEADER.size + 4
    one_sided = (case.ours is None) != (case.theirs is None)
    return one_sided and case.octets[1:2] == b"\x07" and case.octets[at : at + 1] == b"\x13"


# ---- COTP ------------------------------------------------------------------------------------------------------------


def _refused(case: Case, type_: int) -> bool:
    """Whether Wireshark shows only the TPKT header of a TPDU of this type."""
    return _field_of(case, _TYPE) == type_ and _nothing_but_tpkt(case.their_record)


def _nothing_but_tpkt(record: Record | None) -> bool:
    return record is not None and all(place.part == facts.IN_TPKT for place in record.facts)


def _field_of(case: Case, name: str) -> int:
    value = case.our_record.value(facts.IN_TPDU, name) if case.our_record is not None else None
    return value if isinstance(value, int) else -1


def expedited(case: Case) -> bool:
    """Whether Wireshark does not show an ED in the form of RFC 1006."""
    return _refused(case, ED) and _field_of(case, _LI) == 2


def reason(case: Case) -> bool:
    """Whether Wireshark does not show a DR with a reason it has no name for."""
    return _refused(case, DR) and _field_of(case, "cotp.cause") not in _REASONS


def rejection(case: Case) -> bool:
    """Whether Wireshark does not show an ER with an unknown cause or a long header."""
    return _refused(case, ER) and (_field_of(case, "cotp.reject_cause") not in ER_CAUSES or _field_of(case, _LI) > 8)


def contradictory(case: Case) -> bool:
    """Whether Wireshark does not show a TPDU that we report as malformed."""
    return _nothing_but_tpkt(case.their_record) and bool(_complaints(case))


def _complaints(case: Case) -> list[Malformed]:
    return parse_tpdu(case.octets[facts.TPKT_SIZE :]).malformed


def _size_code(case: Case) -> tuple[int, int]:
    """Return the length of the parameter from which Wireshark took a TPDU size, and the octet it took."""
    fact = case.their_record.facts.get(case.place) if case.their_record is not None else None
    if fact is None:
        return -1, -1
    at = facts.TPKT_SIZE + fact.offset
    return (case.octets[at - 1], case.octets[at]) if at < len(case.octets) else (-1, -1)


def size_of_65531(case: Case) -> bool:
    """Whether Wireshark masks TPDU size code 0x10 to 0, which it shows as 1."""
    return _size_code(case) == (1, 0x10) and case.ours == 65531 and case.theirs == 1


def no_size(case: Case) -> bool:
    """Whether Wireshark shows a size for a parameter that contains none."""
    length, code = _size_code(case)
    stated = length == 1 and 7 <= code <= 16
    return case.ours is None and not stated and case.theirs == 1 << (code & 0x0F)


def broken_parameter(case: Case) -> bool:
    """Whether Wireshark shows code or length of a parameter that does not fit into the header."""
    if case.ours is not None or case.their_record is None:
        return False
    at = case.their_record.facts[case.place].offset
    return any(complaint.field == "parameter" and complaint.offset in {at, at - 1} for complaint in _complaints(case))


def no_tpdu(case: Case) -> bool:
    """Whether Wireshark shows a TPKT header that no TPDU can follow: by its length, or by the two octets after it."""
    record = case.their_record
    if case.ours is not None or record is None or not _nothing_but_tpkt(record):
        return False
    length = int.from_bytes(record.octets[2:4], "big")
    arrival = case.evidence.arrival(record.frame)
    if length < MIN_LENGTH or arrival is None:
        return length < MIN_LENGTH
    at = arrival.segment.payload.find(record.octets) + facts.TPKT_SIZE
    head = arrival.segment.payload[at : at + 2]
    if len(head) < 2:
        return False
    return head[0] in {0, 255} or head[0] + 1 > length - facts.TPKT_SIZE or head[1] >> 4 not in TPDU_TYPES


def is_rdp(case: Case) -> bool:
    """Whether Wireshark classifies the packet, or one of the same connection, as Remote Desktop."""
    if (case.ours if case.place.name == WHOLE else case.theirs) is not None or case.frame is None:
        return False
    if not case.frame.protocols.isdisjoint(_RDP):
        return True
    # A server that is not asked to negotiate confirms without a negotiation: its CC alone could belong to any protocol.
    return case.their_record is not None and case.evidence.carries(case.their_record.frame, _RDP)


def is_h323(case: Case) -> bool:
    """Whether Wireshark shows only the header of a TPKT that contains, according to it, H.323 without COTP."""
    if case.frame is None or not _nothing_but_tpkt(case.their_record):
        return False
    return "cotp" not in case.frame.protocols and not case.frame.protocols.isdisjoint(_H323)


def inside_a_message(case: Case) -> bool:
    """Whether Wireshark shows a TPKT header in the middle of a TPKT that is in the stream."""
    record = case.their_record
    if case.ours is not None or record is None or record.kind != facts.TPDU:
        return False
    return case.evidence.inside(record.frame, record.octets)


def cut_frame(case: Case) -> bool:
    """Whether the packet was captured incompletely."""
    return case.ours is None and case.frame is not None and case.frame.cut


# ---- TCP -------------------------------------------------------------------------------------------------------------


def lost_by_tcp(case: Case) -> bool:
    """Whether a record that only we show is in the TCP stream, in its order."""
    return case.theirs is None and case.our_record is not None and case.evidence.stands(case.our_record)


def shown_at_the_gap(case: Case) -> bool:
    """Whether tshark, with reordering, shows a message where a gap closed, and we show it in the packet that contained it."""
    if case.our_record is None or case.their_record is None or case.our_record.frame >= case.their_record.frame:
        return False
    arrival = case.evidence.arrival(case.our_record.frame)
    return arrival is not None and arrival.ahead and case.evidence.stands(case.our_record)


def closes_a_gap(case: Case) -> bool:
    """Whether tshark shows a message after a gap, and we show it in the later packet that closed the gap."""
    if case.our_record is None or case.their_record is None or case.our_record.frame <= case.their_record.frame:
        return False
    mine, its = case.evidence.arrival(case.our_record.frame), case.evidence.arrival(case.their_record.frame)
    if mine is None or its is None or not its.ahead:
        return False
    return mine.new > 0 and mine.at < its.at and case.evidence.stands(case.our_record)


def shown_in_a_retransmission(case: Case) -> bool:
    """Whether tshark shows a message only in a retransmission, and we show it in the packet that first contained it."""
    if case.our_record is None or case.their_record is None or case.our_record.frame >= case.their_record.frame:
        return False
    return _brought(case, case.their_record) and case.evidence.stands(case.our_record)


def _brought(case: Case, record: Record) -> bool:
    """Whether all octets of a tshark record at its position were delivered by earlier segments."""
    arrival = case.evidence.arrival(record.frame)
    if arrival is None or arrival.new == 0:
        return arrival is not None
    places = arrival.brought(record.octets)
    # The headers of the DTs in a segment are equal, so the right one cannot be determined.
    return any(places) and (record.kind == facts.TPDU or all(places))


def unfinished(case: Case) -> bool:
    """Whether tshark shows the part of a message in its segment, and we show the whole message when it was complete."""
    record = case.their_record
    if record is None:
        return False
    arrival = case.evidence.arrival(record.frame)
    if arrival is None:
        return False
    payload = arrival.segment.payload
    if record.kind == facts.PDU:
        lengths = [record.value(facts.IN_HEADER, name) for name in ("s7comm.header.parlg", "s7comm.header.datlg")]
        claimed = s7.HEADER.size + sum(length for length in lengths if isinstance(length, int))
        # Only the end: between the parts of a PDU in several DTs there are headers.
        return case.ours is None and claimed > len(record.octets) and payload.endswith(record.octets[-4:])
    if case.our_record is None or case.our_record.frame <= record.frame or not case.evidence.stands(case.our_record):
        return False
    return payload.rfind(record.octets) + int.from_bytes(record.octets[2:4], "big") > len(payload)


def joined_over_a_gap(case: Case) -> bool:
    """Whether a PDU is longer than the segment it is shown in, which follows missing octets."""
    if case.ours is not None or case.their_record is None or case.their_record.kind != facts.PDU:
        return False
    arrival = case.evidence.arrival(case.their_record.frame)
    if arrival is None or "tcp.analysis.lost_segment" not in arrival.segment.remarks:
        return False
    return len(case.their_record.octets) > len(arrival.segment.payload)


def brought_before(case: Case) -> bool:
    """Whether tshark shows again what earlier segments delivered: no octet of it is new."""
    return case.ours is None and case.their_record is not None and _brought(case, case.their_record)
