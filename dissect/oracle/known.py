"""The differences that are understood: for each what the two sides say, which octets decide it, and who is right.

This is the one place where a difference may be excused. An entry names the field and says by a predicate, which looks at the
octets, exactly when it holds; what no entry claims is unexplained, and the tests fail on it. ``side`` says who is right: `OURS`,
`SCOPE` where the package leaves something out on purpose, `FORM` where both say the same in other words.
docs/oracle.md shows this table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.iso.cotp import parse_tpdu
from dissect.iso.tables import DR, ED, ER, ER_CAUSES
from dissect.oracle import facts
from dissect.oracle.facts import Place, Record, Value
from dissect.oracle.streams import Arrival, Streams
from dissect.oracle.theirs import Frame
from dissect.s7 import layouts as s7
from dissect.s7.tables import LENGTH_IN_BITS
from dissect.wire.malformed import Malformed

OURS: Final = "ours is right"
SCOPE: Final = "left out on purpose"
FORM: Final = "the same in another form"

#: Names that are no field of Wireshark's: a record as a whole, the packet it stands in, its octets, a field's position.
WHOLE: Final = "(whole)"
FRAME: Final = "(packet)"
OCTETS: Final = "(octets)"

_RETURN_CODE: Final = s7.DATA_ITEM.fields[0].wireshark
_TRANSPORT_SIZE: Final = s7.DATA_ITEM.fields[1].wireshark
_LENGTH: Final = s7.DATA_ITEM.fields[2].wireshark
_SUBFUNCTIONS: Final = ("s7comm.param.userdata.subfunc", "s7comm.param.modetrans.subfunc")
_LI: Final = "cotp.li"
_TYPE: Final = "cotp.type"
#: The reasons of a DR that Wireshark has names for.
_REASONS: Final = frozenset((0, 1, 2, 3, 0x80, 0x81, 0x82, 0x83, 0x84, 0x85, 0x87, 0x88, 0x8A))
#: What is missing when Wireshark shows nothing of a TPDU.
_ALL_OF_TPDU: Final = (OCTETS, *facts.NAMES[facts.IN_TPDU], *facts.NAMES[facts.IN_PARAMETER])
#: Return codes whose items Wireshark reads; at every other one it keeps what it read before.
_READ_CODES: Final = frozenset((0x00, 0x0A, 0xFF))


class Evidence:
    """What the TCP streams say, for differences that begin there; they are only read when there is one."""

    def __init__(self, path: str, found: dict[str, list[tuple[int, bytes]]]) -> None:
        self._streams = Streams(path)
        self._found = found
        self._standing: dict[str, list[bool]] = {}

    def arrival(self, frame: int) -> Arrival | None:
        """Return the TCP segment of a packet, None when it has no octets."""
        return self._streams.arrival(frame)

    def of_one_flow(self, frame: int, other: int) -> bool:
        """Tell whether two packets belong to the same direction of the same connection."""
        mine, its = self.arrival(frame), self.arrival(other)
        return mine is not None and its is not None and mine.segment.flow == its.segment.flow

    def stands(self, record: Record) -> bool:
        """Tell whether what we found is in the TCP stream, behind everything we found there before."""
        if record.kind not in self._standing:
            self._standing[record.kind] = self._streams.follow(self._found[record.kind])
        return self._standing[record.kind][record.number]


class Case:
    """A difference with everything an entry may look at; ``ours`` and ``theirs`` are None where a side has nothing."""

    __slots__ = ("evidence", "frame", "our_record", "ours", "place", "their_record", "theirs")

    def __init__(
        self,
        place: Place,
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
        """Return what we read for another field of the same item."""
        return self.our_record.value(self.place.part, name, self.place.number) if self.our_record is not None else None


class Known:
    """One understood difference; ``names`` are the fields it may claim, ``applies`` decides by the octets."""

    __slots__ = ("applies", "id", "names", "reference", "side", "what", "why")

    def __init__(
        self, id_: str, side: str, names: tuple[str, ...], what: str, why: str, reference: str, applies: Callable[[Case], bool]
    ) -> None:
        self.id = id_
        self.side = side
        self.names = frozenset(names)
        self.what = what
        self.why = why
        self.reference = reference
        self.applies = applies


def explain(case: Case) -> str:
    """Return the id of the entry that explains a difference, empty when none does."""
    for entry in KNOWN:
        if case.place.name in entry.names and entry.applies(case):
            return entry.id
    return ""


# ---- data items ------------------------------------------------------------------------------------------------------


def _length_in_bits(case: Case) -> bool:
    bits = case.ours
    counts_bits = case.beside(_TRANSPORT_SIZE) in LENGTH_IN_BITS
    return isinstance(bits, int) and counts_bits and case.beside(_RETURN_CODE) in _READ_CODES and case.theirs == (bits + 7) // 8


def _kept_from_before(case: Case) -> bool:
    if case.place.part != facts.IN_DATA_ITEM or case.their_record is None or case.beside(_RETURN_CODE) in _READ_CODES:
        return False
    before = case.their_record.value(facts.IN_DATA_ITEM, case.place.name, case.place.number - 1)
    return case.theirs == (before or 0)


# ---- userdata --------------------------------------------------------------------------------------------------------


def _split_in_fours(case: Case) -> bool:
    at = s7.HEADER.size + 5
    if len(case.octets) <= at:
        return False
    octet = case.octets[at]
    if case.place.name in _SUBFUNCTIONS:  # groups 0x10, 0x20 and 0x30 become group 0, whose subfunctions are called otherwise
        told = case.ours if case.ours is not None else case.theirs
        return octet & 0x3F > octet & 0x0F == 0 and told == case.octets[at + 1]
    if case.place.name == "s7comm.param.userdata.type":
        return case.ours == octet >> 6 and case.theirs == octet >> 4
    return case.ours == octet & 0x3F and case.theirs == octet & 0x0F


def _mode_transition(case: Case) -> bool:
    at = s7.HEADER.size
    return case.ours is None and case.octets[1:2] == b"\x07" and case.octets[at : at + 1] == b"\x01"


# ---- COTP ------------------------------------------------------------------------------------------------------------


def _refused(case: Case, type_: int) -> bool:
    """Whether Wireshark shows nothing of a TPDU of this type but its TPKT header."""
    return _field_of(case, _TYPE) == type_ and _nothing_but_tpkt(case.their_record)


def _nothing_but_tpkt(record: Record | None) -> bool:
    return record is not None and all(place.part == facts.IN_TPKT for place in record.facts)


def _field_of(case: Case, name: str) -> int:
    value = case.our_record.value(facts.IN_TPDU, name) if case.our_record is not None else None
    return value if isinstance(value, int) else -1


def _expedited(case: Case) -> bool:
    return _refused(case, ED) and _field_of(case, _LI) == 2


def _reason(case: Case) -> bool:
    return _refused(case, DR) and _field_of(case, "cotp.cause") not in _REASONS


def _rejection(case: Case) -> bool:
    return _refused(case, ER) and (_field_of(case, "cotp.reject_cause") not in ER_CAUSES or _field_of(case, _LI) > 8)


def _contradictory(case: Case) -> bool:
    """Whether Wireshark shows nothing of a TPDU that is malformed by our reading."""
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


def _size_of_65531(case: Case) -> bool:
    return _size_code(case) == (1, 0x10) and case.ours == 65531 and case.theirs == 1


def _no_size(case: Case) -> bool:
    length, code = _size_code(case)
    stated = length == 1 and 7 <= code <= 16
    return case.ours is None and not stated and case.theirs == 1 << (code & 0x0F)


def _broken_parameter(case: Case) -> bool:
    """Whether Wireshark shows code or length of a parameter that does not fit into the header."""
    if case.ours is not None or case.their_record is None:
        return False
    at = case.their_record.facts[case.place].offset
    return any(told.field == "parameter" and told.offset in {at, at - 1} for told in _complaints(case))


def _no_tpdu(case: Case) -> bool:
    return case.ours is None and _nothing_but_tpkt(case.their_record)


def _is_rdp(case: Case) -> bool:
    return case.ours is None and case.frame is not None and not case.frame.protocols.isdisjoint(("rdp", "t125"))


# ---- TCP -------------------------------------------------------------------------------------------------------------


def _lost_by_tcp(case: Case) -> bool:
    """Whether what only we show stands in the TCP stream, in its order."""
    return case.theirs is None and case.our_record is not None and case.evidence.stands(case.our_record)


def _before_its_turn(case: Case) -> bool:
    """Whether tshark shows a TPKT in a segment before which octets were missing, and we when they had come."""
    if case.our_record is None or case.their_record is None or case.their_record.frame >= case.our_record.frame:
        return False
    arrival = case.evidence.arrival(case.their_record.frame)
    return arrival is not None and arrival.ahead and case.evidence.stands(case.our_record)


def _brought_before(case: Case) -> bool:
    """Whether tshark shows again what an earlier segment brought: not one octet of this one is new."""
    if case.ours is not None or case.their_record is None:
        return False
    arrival = case.evidence.arrival(case.their_record.frame)
    return arrival is not None and arrival.new == 0


KNOWN: Final = (
    Known(
        "length-in-octets",
        OURS,
        (_LENGTH,),
        "`s7comm.data.length` of a data item that counts bits is shown in octets.",
        "The field on the wire holds bits for transport sizes 3, 4 and 5; its octets are kept as they stand.",
        "6.5, 3.5",
        _length_in_bits,
    ),
    Known(
        "kept-from-before",
        OURS,
        (_LENGTH, _TRANSPORT_SIZE),
        "A data item with a return code other than 0x00, 0x0a and 0xff shows transport size and length of the item before.",
        "Wireshark does not read such an item and shows what its variables still hold (0 for the first item).",
        "6.5",
        _kept_from_before,
    ),
    Known(
        "userdata-type-of-four-bits",
        OURS,
        ("s7comm.param.userdata.type", "s7comm.param.userdata.funcgroup", *_SUBFUNCTIONS),
        "Type and function group of userdata are split into four and four bits.",
        "Two bits of type and six of group are the only reading that makes sense of groups 0x20 and 0x3f; newer Wireshark has it.",
        "4.1, 6.5",
        _split_in_fours,
    ),
    Known(
        "mode-transition-as-head",
        OURS,
        (
            "s7comm.param.item.varspec",
            "s7comm.param.item.varspec_length",
            "s7comm.param.item.syntaxid",
            "s7comm.param.userdata.type",
            "s7comm.param.userdata.funcgroup",
            "s7comm.param.userdata.seq_num",
        ),
        "The mode transition push is shown with the parameter head of other userdata.",
        "Its parameters have a layout of their own: as a length the fourth octet would say 16 where four follow.",
        "4.1, 4.9",
        _mode_transition,
    ),
    Known(
        "broken-parameter",
        OURS,
        tuple(sorted(facts.NAMES[facts.IN_PARAMETER])),
        "Code and length are shown of a COTP parameter that does not fit into its header.",
        "Without its value, or with a code alone, it is no parameter; we report it as malformed.",
        "2.1",
        _broken_parameter,
    ),
    Known(
        "expedited-refused",
        OURS,
        _ALL_OF_TPDU,
        "The ED of RFC 1006 (LI 2) is not dissected.",
        "RFC 1006 section 6 defines it; Wireshark knows the forms of X.224 only, with LI 4 or 7.",
        "2.2, 6.5",
        _expedited,
    ),
    Known(
        "reason-refused",
        OURS,
        _ALL_OF_TPDU,
        "A DR whose reason is not in Wireshark's list is not dissected.",
        "An unknown reason is a number like any other; the references are read all the same.",
        "2.4, 6.5",
        _reason,
    ),
    Known(
        "rejection-refused",
        OURS,
        _ALL_OF_TPDU,
        "An ER with a cause above 3, or longer than LI 8, is not dissected.",
        "The rejected header, which class 0 demands as parameter 0xc1, alone can be longer.",
        "2.3, 2.4",
        _rejection,
    ),
    Known(
        "malformed-tpdu",
        OURS,
        _ALL_OF_TPDU,
        "Nothing is shown of a TPDU of unknown type, or whose header is too short for its type or longer than its TPKT.",
        "What is there is kept, and reported as malformed.",
        "1.2, 2.1",
        _contradictory,
    ),
    Known(
        "size-of-65531",
        OURS,
        (facts.TPDU_SIZE,),
        "TPDU size code 0x10 is shown as 1.",
        "Wireshark masks the code with 0x0f; RFC 1006 stacks mean 65531 octets.",
        "2.3, 6.5",
        _size_of_65531,
    ),
    Known(
        "size-without-meaning",
        FORM,
        (facts.TPDU_SIZE,),
        "A TPDU size code below 7 or above 16, or one of several octets, is shown as a power of two.",
        "X.224 gives it no meaning, so we state no size.",
        "2.3",
        _no_size,
    ),
    Known(
        "header-without-tpdu",
        OURS,
        (WHOLE,),
        "A TPKT header is shown that no TPDU follows.",
        "With a length below 7 or an LI of 0 there is no whole TPDU: we report the length, skip, and search for the next TPKT.",
        "1.2, 1.3",
        _no_tpdu,
    ),
    Known(
        "rdp",
        SCOPE,
        (WHOLE,),
        "TPKTs of Remote Desktop are dissected.",
        "A CR or CC with an RDP negotiation instead of parameters names the connection; it is counted and followed no further.",
        "1.4",
        _is_rdp,
    ),
    Known(
        "lost-by-tcp",
        OURS,
        (WHOLE,),
        "A message is not shown: its segment was taken for a retransmission (an answer captured after its own acknowledgement),"
        " came out of order, or stood behind octets that fit no TPKT.",
        "It stands in the TCP stream, in its order, as tshark's own sequence numbers and payloads put together show.",
        "1.3, 5.5",
        _lost_by_tcp,
    ),
    Known(
        "before-its-turn",
        OURS,
        (FRAME,),
        "A message is shown in the packet that brought it although octets before it were still missing.",
        "A stream is read in its order: the packet that filled the gap completed the message.",
        "5.5",
        _before_its_turn,
    ),
    Known(
        "shown-again",
        OURS,
        (WHOLE,),
        "A segment that was sent again is dissected again (seen where it ends exactly at the wrap of the sequence number).",
        "An earlier segment brought every octet of it (shown on tshark's own sequence numbers): a PDU counts once.",
        "5.5",
        _brought_before,
    ),
)
