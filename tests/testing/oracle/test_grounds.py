"""The grounds of explanations: each holds for what it is meant for, and for nothing that only looks like it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

import pytest

from dissect.testing.oracle import grounds
from dissect.testing.oracle.facts import (
    IN_DATA_ITEM,
    IN_PARAMETERS,
    IN_TPDU,
    IN_TPKT,
    PDU,
    TPDU,
    FieldPlace,
    LocatedValue,
    Record,
    Value,
)
from dissect.testing.oracle.grounds import FRAME, LENGTH, TRANSPORT_SIZE, WHOLE, Arrival, Case, Evidence
from dissect.testing.oracle.ours import pdu_record, tpdu_record
from dissect.testing.oracle.theirs import Frame
from dissect.testing.oracle.tshark import Segment
from tests.build import dt, pdu, tpdu, tpkt
from tests.testing.oracle.traffic import parameter

TYPE: Final = FieldPlace(IN_PARAMETERS, 0, "s7comm.param.userdata.type")
GROUP: Final = FieldPlace(IN_PARAMETERS, 0, "s7comm.param.userdata.funcgroup")
SUBFUNCTION: Final = FieldPlace(IN_PARAMETERS, 0, "s7comm.param.userdata.subfunc")
SIZE: Final = FieldPlace(IN_TPDU, 0, "cotp.tpdu_size")


class Stub(Evidence):
    """Evidence that says what a test wants."""

    def __init__(
        self, payload: bytes = b"", new: int = 0, ahead: bool = False, remarks: str = "", stands: bool = False
    ) -> None:
        super().__init__("any", {})
        self._arrival = Arrival(Segment(9, "flow", 0, payload, frozenset(remarks.split())), 0, new, ahead)
        self._stands = stands

    def arrival(self, frame: int) -> Arrival | None:
        return self._arrival

    def stands(self, record: Record) -> bool:
        return self._stands


def a_frame(protocols: str = "tcp:tpkt:cotp", kept: int = 80) -> Frame:
    return Frame(
        {
            "frame": {
                "frame.number": "9",
                "frame.protocols": protocols,
                "frame.len": "80",
                "frame.cap_len": str(kept),
            }
        }
    )


def case(
    place: FieldPlace,
    ours: Value | None,
    theirs: Value | None,
    our_record: Record | None = None,
    their_record: Record | None = None,
    *,
    evidence: Evidence | None = None,
    frame: Frame | None = None,
) -> Case:
    return Case(place, ours, theirs, our_record, their_record, frame or a_frame(), evidence or Stub())


def theirs_of(octets: bytes, facts: dict[FieldPlace, LocatedValue] | None = None, frame: int = 9) -> Record:
    """A TPDU as Wireshark shows it; without facts, only its TPKT header."""
    return Record(TPDU, frame, octets, facts or {FieldPlace(IN_TPKT, 0, "tpkt.length"): LocatedValue(9, 2)})


# ---- data items ------------------------------------------------------------------------------------------------------


def answer(*items: bytes) -> Record:
    return pdu_record(1, pdu(3, 1, bytes([4, len(items)]), b"".join(items)))


@pytest.mark.parametrize(
    ("item", "theirs", "holds"),
    [
        (b"\xff\x04\x00\x18abc", 3, True),
        (b"\xff\x03\x00\x01\x01", 1, False),  # then there is no difference
        (b"\xff\x05\x00\x09ab", 2, True),
        (b"\x0a\x04\x00\x18", 3, True),
        (b"\xff\x04\x00\x18abc", 4, False),
        (b"\xff\x09\x00\x18" + bytes(24), 3, False),
        (b"\x05\x04\x00\x18", 3, False),
    ],
)
def test_length_in_bits(item: bytes, theirs: int, holds: bool) -> None:
    record = answer(item)
    ours = record.value(IN_DATA_ITEM, LENGTH, 1)
    there = case(FieldPlace(IN_DATA_ITEM, 1, LENGTH), ours, theirs, record, record)
    assert (grounds.length_in_bits(there) and ours != theirs) == holds


@pytest.mark.parametrize(
    ("first", "second", "number", "name", "theirs", "holds"),
    [
        (b"\xff\x09\x00\x02ab", b"\x05\x00\x00\x00", 2, LENGTH, 2, True),
        (b"\xff\x09\x00\x02ab", b"\x05\x00\x00\x00", 2, TRANSPORT_SIZE, 9, True),
        (b"\xff\x09\x00\x02ab", b"\x05\x00\x00\x00", 2, LENGTH, 3, False),
        (b"\xff\x09\x00\x02ab", b"\xff\x09\x00\x00", 2, LENGTH, 2, False),
        (b"\x05\x00\x00\x04", b"\x05\x00\x00\x00", 1, LENGTH, 0, True),
        (b"\x05\x00\x00\x04", b"\x05\x00\x00\x00", 1, LENGTH, 1, False),
    ],
)
def test_kept_from_before(first: bytes, second: bytes, number: int, name: str, theirs: int, holds: bool) -> None:
    record = answer(first, second)
    place = FieldPlace(IN_DATA_ITEM, number, name)
    there = case(place, record.value(IN_DATA_ITEM, name, number), theirs, record, record)
    assert grounds.kept_from_before(there) == holds


def clock(size: int) -> Record:
    """The answer to reading a clock, with so many octets of its ten."""
    head = b"\x00\x01\x12\x08\x12\x87\x01\x02\x00\x00\x00\x00"
    return pdu_record(1, pdu(7, 1, head, b"\xff\x09\x00" + bytes([size]) + b"\x00" * size))


def test_damaged() -> None:
    whole = pdu(1, 1, b"\x04\x01\x12\x0a\x10\x02\x00\x03\x00\x01\x84\x00\x00\x50")
    place = FieldPlace(IN_PARAMETERS, 0, "s7comm.param.itemcount")
    assert not grounds.damaged(case(place, 1, 2, pdu_record(1, whole)))
    assert grounds.damaged(case(place, 1, 2, pdu_record(1, whole + b"more")))
    assert grounds.damaged(case(place, 1, 2, clock(7))), "what is wrong inside the body counts as well"
    assert not grounds.damaged(case(place, 1, 2, clock(10)))


# ---- userdata --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("octet", "place", "ours", "theirs", "holds"),
    [
        (0x44, TYPE, 1, 4, True),
        (0x84, TYPE, 2, 8, True),
        (0x84, TYPE, 2, 4, False),
        (0x84, TYPE, 8, 8, False),
        (0x60, GROUP, 0x20, 0, True),
        (0x60, GROUP, 0x20, 6, False),
        (0x60, SUBFUNCTION, 3, None, True),
        (0x60, SUBFUNCTION, None, 3, True),
        (0x60, SUBFUNCTION, 4, None, False),
        (0x44, SUBFUNCTION, 3, None, False),
        (0x00, SUBFUNCTION, 3, None, False),
    ],
)
def test_split_in_fours(octet: int, place: FieldPlace, ours: Value | None, theirs: Value | None, holds: bool) -> None:
    record = pdu_record(1, pdu(7, 1, b"\x00\x01\x12\x04\x11" + bytes([octet, 3, 0])))
    assert grounds.split_in_fours(case(place, ours, theirs, record)) == holds


def test_split_in_fours_of_a_cut_pdu() -> None:
    assert not grounds.split_in_fours(case(TYPE, 1, 4, pdu_record(1, pdu(7, 1, b"\x00\x01"))))


@pytest.mark.parametrize(
    ("rosctr", "parameters", "ours", "transition", "send"),
    [
        (7, b"\x01\x00\x10\x10\x00\x00\x02\x00", None, True, False),
        (7, b"\x01\x00\x10\x10\x00\x00\x02\x00", 5, False, False),
        (7, b"\x00\x01\x12\x08\x13\x06\x02\x00\x00\x00\x00\x01", None, False, True),
        (7, b"\x00\x01\x12\x08\x12\x06\x02\x00\x00\x00\x00\x01", None, False, False),
        (1, b"\x01\x00\x10\x10\x13\x00\x02\x00", None, False, False),
    ],
)
def test_own_parameter_heads(rosctr: int, parameters: bytes, ours: Value | None, transition: bool, send: bool) -> None:
    there = case(TYPE, ours, 1, pdu_record(1, pdu(rosctr, 1, parameters)))
    assert (grounds.mode_transition(there), grounds.usend(there)) == (transition, send)


# ---- COTP ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("octets", "predicate"),
    [
        (tpdu(b"\x10\x80", data=b"x"), grounds.expedited),
        (tpdu(struct.pack(">BHHB", 0x80, 1, 7, 0x86)), grounds.reason),
        (tpdu(struct.pack(">BHB", 0x70, 1, 4)), grounds.rejection),
        (tpdu(struct.pack(">BHB", 0x70, 1, 2), parameter(0xC1, b"abc")), grounds.rejection),
        (tpkt(b"\x03\x40\x00\x00"), grounds.contradictory),
        (tpkt(b"\x09\xe0\x00\x00"), grounds.contradictory),
    ],
)
def test_refused(octets: bytes, predicate: Callable[[Case], bool]) -> None:
    place = FieldPlace(IN_TPDU, 0, "cotp.li")
    record = tpdu_record(1, octets)
    assert predicate(case(place, 1, None, record, theirs_of(octets[:4])))
    shown = theirs_of(octets[:4], {place: LocatedValue(2, 0)})
    assert not predicate(case(place, 1, None, record, shown)), "something of it is shown"
    fine = tpdu_record(1, dt(b"2"))
    assert not predicate(case(place, 1, None, fine, theirs_of(octets[:4]))), "there is nothing wrong with it"


@pytest.mark.parametrize(
    "octets",
    [
        tpdu(struct.pack(">BHB", 0x10, 1, 0x80), data=b"x"),
        tpdu(struct.pack(">BHHB", 0x80, 1, 7, 0x8A)),
        tpdu(struct.pack(">BHB", 0x70, 1, 3), parameter(0xC1, b"ab")),
    ],
)
def test_nothing_excuses_what_wireshark_knows(octets: bytes) -> None:
    there = case(FieldPlace(IN_TPDU, 0, "cotp.li"), 1, None, tpdu_record(1, octets), theirs_of(octets[:4]))
    refusals = (grounds.expedited, grounds.reason, grounds.rejection, grounds.contradictory)
    assert not any(predicate(there) for predicate in refusals)


@pytest.mark.parametrize(
    ("value", "ours", "theirs", "masked", "meaningless"),
    [
        (b"\x10", 65531, 1, True, False),
        (b"\x10", 65531, 2, False, False),
        (b"\x0a", 1024, 1, False, False),
        (b"\x05", None, 32, False, True),
        (b"\x05", None, 64, False, False),
        (b"\x12", None, 4, False, True),
        (b"\x0a\x0b", None, 1024, False, True),
        (b"\x0a", None, 1024, False, False),
    ],
)
def test_sizes(value: bytes, ours: Value | None, theirs: int, masked: bool, meaningless: bool) -> None:
    record = tpdu_record(1, tpdu(struct.pack(">BHHB", 0xE0, 0, 1, 0), parameter(0xC0, value)))
    shown = theirs_of(record.octets, {SIZE: LocatedValue(theirs, 9)})
    there = case(SIZE, ours, theirs, record, shown)
    assert (grounds.size_of_65531(there), grounds.no_size(there)) == (masked, meaningless)


def test_sizes_wireshark_does_not_show() -> None:
    record = tpdu_record(1, tpdu(struct.pack(">BHHB", 0xE0, 0, 1, 0), parameter(0xC0, b"\x10")))
    there = case(SIZE, 65531, None, record, theirs_of(record.octets))
    assert not grounds.size_of_65531(there)
    assert not grounds.no_size(there)


@pytest.mark.parametrize(("at", "holds"), [(7, False), (8, False), (10, True), (11, True), (12, False)])
def test_broken_parameter(at: int, holds: bool) -> None:
    record = tpdu_record(1, tpdu(struct.pack(">BHHB", 0xE0, 0, 1, 0), parameter(0xC0, b"\x0a") + b"\xc1\x09\x01"))
    place = FieldPlace(IN_TPDU, 2, "cotp.parameter_code")
    there = case(place, None, 1, record, theirs_of(record.octets, {place: LocatedValue(1, at)}))
    assert grounds.broken_parameter(there) == holds
    assert not grounds.broken_parameter(
        case(place, 2, 1, record, theirs_of(record.octets, {place: LocatedValue(1, at)}))
    )


@pytest.mark.parametrize(
    ("header", "behind", "holds"),
    [
        ("03000005", "00", True),
        ("03000009", "00f080aabb", True),
        ("03000009", "fff080aabb", True),
        ("03000009", "09f080aabb", True),
        ("03000009", "0200800000", True),
        ("03000009", "02f0803200", False),
        ("03000009", "02", False),
    ],
)
def test_no_tpdu(header: str, behind: str, holds: bool) -> None:
    record = theirs_of(bytes.fromhex(header))
    evidence = Stub(bytes.fromhex("0300000702f080" + header + behind))
    place = FieldPlace("", 0, WHOLE)
    assert grounds.no_tpdu(case(place, None, record.octets, None, record, evidence=evidence)) == holds
    assert not grounds.no_tpdu(case(place, b"", record.octets, record, record, evidence=evidence))


@pytest.mark.parametrize(
    ("protocols", "name", "ours", "theirs", "holds"),
    [
        ("tcp:tpkt:cotp:rdp", WHOLE, None, b"x", True),
        ("tcp:tpkt:cotp:t125", WHOLE, None, b"x", True),
        ("tcp:tpkt:cotp:s7comm", WHOLE, None, b"x", False),
        ("tcp:tpkt:cotp:rdp", WHOLE, b"x", None, False),
        ("tcp:tpkt:cotp:rdp", "cotp.parameter_code", 1, None, True),
        ("tcp:tpkt:cotp:rdp", "cotp.parameter_code", None, 1, False),
    ],
)
def test_rdp(protocols: str, name: str, ours: Value | None, theirs: Value | None, holds: bool) -> None:
    assert grounds.is_rdp(case(FieldPlace("", 0, name), ours, theirs, frame=a_frame(protocols))) == holds


class Carrying(Stub):
    """Evidence of a connection in which Wireshark finds a protocol."""

    def __init__(self, *protocols: str) -> None:
        super().__init__()
        self._protocols = frozenset(protocols)

    def carries(self, frame: int, protocols: frozenset[str]) -> bool:
        return frame == 9 and not self._protocols.isdisjoint(protocols)


def test_rdp_of_the_other_packets() -> None:
    place, confirm = FieldPlace("", 0, WHOLE), theirs_of(b"\x03\x00\x00\x0b\x06\xd0")
    assert grounds.is_rdp(case(place, None, b"x", None, confirm, evidence=Carrying("rdp")))
    assert grounds.is_rdp(case(place, None, b"x", None, confirm, evidence=Carrying("t125")))
    assert not grounds.is_rdp(case(place, None, b"x", None, confirm, evidence=Carrying("s7comm")))
    assert not grounds.is_rdp(case(place, b"x", None, confirm, None, evidence=Carrying("rdp")))


@pytest.mark.parametrize(
    ("protocols", "whole", "holds"),
    [
        ("tcp:h245:h245", False, True),
        ("tcp:tpkt:h245", False, True),
        ("tcp:q931:h225", False, True),
        ("tcp:tpkt:cotp", False, False),
        ("tcp:tpkt:cotp:h245", False, False),
        ("tcp:tpkt", False, False),
        ("tcp:h245", True, False),
    ],
)
def test_h323(protocols: str, whole: bool, holds: bool) -> None:
    """Only where Wireshark shows no more than the TPKT header, whatever we make of the bytes behind it."""
    told = {FieldPlace(IN_TPDU, 0, "cotp.li"): LocatedValue(2, 4)} if whole else None
    for place, ours, theirs in ((FieldPlace("", 0, WHOLE), None, b"x"), (FieldPlace(IN_TPDU, 0, "cotp.li"), 2, None)):
        record = theirs_of(b"\x03\x00\x00\x0f", told)
        assert grounds.is_h323(case(place, ours, theirs, None, record, frame=a_frame(protocols))) == holds


def test_cut() -> None:
    place = FieldPlace("", 0, WHOLE)
    assert grounds.cut_frame(case(place, None, b"x", frame=a_frame(kept=79)))
    assert not grounds.cut_frame(case(place, None, b"x", frame=a_frame(kept=80)))
    assert not grounds.cut_frame(case(place, b"x", None, frame=a_frame(kept=79)))


# ---- TCP -------------------------------------------------------------------------------------------------------------

OURS: Final = Record(PDU, 12, b"2 octets", {}, 0)
THEIRS: Final = Record(PDU, 9, b"2 octets", {})


def test_lost_by_tcp() -> None:
    place = FieldPlace("", 0, WHOLE)
    assert grounds.lost_by_tcp(case(place, b"", None, OURS, evidence=Stub(stands=True)))
    assert not grounds.lost_by_tcp(case(place, b"", None, OURS, evidence=Stub(stands=False)))
    assert not grounds.lost_by_tcp(case(place, None, b"", None, THEIRS, evidence=Stub(stands=True)))


@pytest.mark.parametrize(
    ("ahead", "stands", "ours", "theirs", "holds"),
    [
        (True, True, 9, 12, True),
        (False, True, 9, 12, False),
        (True, False, 9, 12, False),
        (True, True, 12, 9, False),
    ],
)
def test_shown_at_the_gap(ahead: bool, stands: bool, ours: int, theirs: int, holds: bool) -> None:
    mine, its = Record(PDU, ours, b"2", {}, 0), Record(PDU, theirs, b"2", {})
    there = case(FieldPlace("", 0, FRAME), ours, theirs, mine, its, evidence=Stub(ahead=ahead, stands=stands))
    assert grounds.shown_at_the_gap(there) == holds


class Captured(Stub):
    """Evidence of several packets."""

    def __init__(self, stands: bool = True, **arrivals: Arrival) -> None:
        super().__init__(stands=stands)
        self._arrivals = arrivals

    def arrival(self, frame: int) -> Arrival | None:
        return self._arrivals.get(f"frame{frame}")


def arrived(
    at: int, new: int, ahead: bool = False, payload: bytes = b"", fresh: tuple[tuple[int, int], ...] = ()
) -> Arrival:
    return Arrival(Segment(1, "flow", 0, payload, frozenset()), at, new, ahead, fresh)


@pytest.mark.parametrize(
    ("ours", "theirs", "mine", "its", "stands", "holds"),
    [
        (12, 9, arrived(10, 5), arrived(20, 8, True), True, True),
        (12, 9, arrived(10, 5), arrived(20, 8, False), True, False),  # nothing was missing there
        (12, 9, arrived(10, 0), arrived(20, 8, True), True, False),  # ours brought nothing
        (12, 9, arrived(30, 5), arrived(20, 8, True), True, False),  # ours brought nothing before it
        (12, 9, arrived(10, 5), arrived(20, 8, True), False, False),
        (9, 12, arrived(10, 5), arrived(20, 8, True), True, False),
    ],
)
def test_closes_a_gap(ours: int, theirs: int, mine: Arrival, its: Arrival, stands: bool, holds: bool) -> None:
    evidence = Captured(stands, **{f"frame{ours}": mine, f"frame{theirs}": its})
    one, other = Record(PDU, ours, b"2", {}, 0), Record(PDU, theirs, b"2", {})
    assert grounds.closes_a_gap(case(FieldPlace("", 0, FRAME), ours, theirs, one, other, evidence=evidence)) == holds


PART_NEW: Final = arrived(0, 3, payload=b"newold", fresh=((0, 3),))
TWICE: Final = arrived(0, 3, payload=b"old old", fresh=((0, 3),))


@pytest.mark.parametrize(
    ("ours", "theirs", "octets", "there", "stands", "holds"),
    [
        (9, 12, b"old", arrived(0, 0), True, True),
        (9, 12, b"old", PART_NEW, True, True),
        (9, 12, b"new", PART_NEW, True, False),
        (9, 12, b"old", arrived(0, 0), False, False),
        (12, 9, b"old", arrived(0, 0), True, False),
    ],
)
def test_shown_in_a_retransmission(
    ours: int, theirs: int, octets: bytes, there: Arrival, stands: bool, holds: bool
) -> None:
    one, other = Record(PDU, ours, octets, {}, 0), Record(PDU, theirs, octets, {})
    evidence = Captured(stands, **{f"frame{theirs}": there})
    assert (
        grounds.shown_in_a_retransmission(case(FieldPlace("", 0, FRAME), ours, theirs, one, other, evidence=evidence))
        == holds
    )


@pytest.mark.parametrize(
    ("kind", "octets", "there", "holds"),
    [
        (PDU, b"old", PART_NEW, True),
        (PDU, b"new", PART_NEW, False),
        (PDU, b"wold", PART_NEW, False),
        (PDU, b"none", PART_NEW, False),
        (PDU, b"old", TWICE, False),
        (TPDU, b"old", TWICE, True),  # headers are alike: one of them was brought before
        (TPDU, b"new", PART_NEW, False),
    ],
)
def test_brought_before_in_part(kind: str, octets: bytes, there: Arrival, holds: bool) -> None:
    record = Record(kind, 9, octets, {})
    found = case(FieldPlace("", 0, WHOLE), None, octets, None, record, evidence=Captured(frame9=there))
    assert grounds.brought_before(found) == holds


def test_brought_before() -> None:
    place = FieldPlace("", 0, WHOLE)
    assert grounds.brought_before(case(place, None, b"", None, THEIRS, evidence=Stub(new=0)))
    assert not grounds.brought_before(case(place, None, b"", None, THEIRS, evidence=Stub(new=1)))
    assert not grounds.brought_before(case(place, b"", None, OURS, evidence=Stub(new=0)))


@pytest.mark.parametrize(
    ("payload", "remarks", "kind", "holds"),
    [
        (b"short", "tcp.analysis.lost_segment", PDU, True),
        (b"short", "", PDU, False),
        (b"as long as it", "tcp.analysis.lost_segment", PDU, False),
        (b"short", "tcp.analysis.lost_segment", TPDU, False),
    ],
)
def test_joined_over_a_gap(payload: bytes, remarks: str, kind: str, holds: bool) -> None:
    record = Record(kind, 9, b"2 octets", {})
    evidence = Stub(payload, remarks=remarks)
    assert (
        grounds.joined_over_a_gap(case(FieldPlace("", 0, WHOLE), None, b"", None, record, evidence=evidence)) == holds
    )
