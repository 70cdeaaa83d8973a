from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.ibh.framer import MAX_PACKET, NO, UNDECIDED, YES, PacketFramer, judge_beginning, opens
from tests.cases import each
from tests.protocols.ibh.packets import ACK, ASK, CLAIM, CLAIMED, DISCONNECT, RECEIPT, SEEN, TELL, long, packet, short

#: Octets with which no packet can begin.
JUNK = b"\x55"
PACKETS = [ASK, TELL, ACK, CLAIM, CLAIMED, DISCONNECT, RECEIPT, packet(b"", 0x97), short(0xF1, bytes(240))]


def framer(synced: bool = True) -> PacketFramer:
    made = PacketFramer()
    made.synced = synced
    return made


def fed(made: PacketFramer, segments: list[bytes]) -> list[bytes]:
    """Push segments; return the packets that became whole. Every octet is accounted for after each."""
    found: list[bytes] = []
    for segment in segments:
        before = made.framed + made.skipped + made.buffered
        made.push(segment)
        assert made.framed + made.skipped + made.buffered == before + len(segment)
        assert made.buffered < (MAX_PACKET if made.synced else 16)
        found += made.packets
        made.packets = []
    return found


def cut_at(octets: bytes, edges: list[int]) -> list[bytes]:
    places = sorted({0, len(octets), *(edge for edge in edges if edge < len(octets))})
    return [octets[start:end] for start, end in pairwise(places)]


@given(st.lists(st.sampled_from(PACKETS), max_size=10), st.lists(st.integers(1, 600), max_size=40), st.integers(0, 20))
def test_any_segmentation_gives_the_same_packets(packets: list[bytes], cuts: list[int], tail: int) -> None:
    octets = b"".join(packets) + ASK[:tail]
    for segments in ([octets] if octets else [], cut_at(octets, cuts), [bytes([octet]) for octet in octets]):
        made = framer()
        assert fed(made, segments) == packets
        assert (made.framed, made.skipped, made.buffered) == (len(octets) - tail, 0, tail)
        assert made.faults == []


@pytest.mark.parametrize("junk", [JUNK, JUNK * 40, b"\x07", b"\x07\xff", b"\xff\x07\x00\x00\x00", ASK[:11]])
def test_in_step_again_behind_garbage(junk: bytes) -> None:
    octets = ACK + JUNK + junk + ASK + TELL
    for segments in ([octets], [bytes([octet]) for octet in octets]):
        made = framer()
        assert fed(made, segments) == [ACK, ASK, TELL]
        assert made.faults == [0x55]
        assert made.skipped == len(JUNK + junk)


def test_out_of_step_a_segment_may_begin_with_less_than_is_certain() -> None:
    for first in (RECEIPT, CLAIMED):
        assert judge_beginning(first, 0, len(first)) == NO
        assert fed(framer(synced=False), [first, ASK]) == [first, ASK]
        assert fed(framer(synced=False), [JUNK + first, ASK]) == [ASK]


@given(st.lists(st.binary(max_size=300), max_size=6), st.booleans())
def test_any_octets_are_accounted_for(segments: list[bytes], synced: bool) -> None:
    fed(framer(synced), segments)


# ---- holes ----------------------------------------------------------------------------------------------------------


@each("begun", range(3, len(ASK)))
def test_a_hole_inside_a_packet_keeps_step(begun: int) -> None:
    for lost in range(1, len(ASK) - begun + 1):
        made = framer()
        made.push(ASK[:begun])
        assert made.hole(lost, False)
        assert fed(made, [ASK[begun + lost :] + CLAIMED + TELL]) == [CLAIMED, TELL]
        assert made.skipped == len(ASK) - lost


@pytest.mark.parametrize("begun", [0, 1, 2, len(ASK) - 1])
def test_a_hole_that_hides_the_end_of_a_packet_costs_step(begun: int) -> None:
    made = framer()
    made.push(ASK[:begun])
    assert not made.hole(len(ASK), False)
    assert not made.synced
    assert fed(made, [JUNK + TELL]) == [TELL]
    assert made.skipped == begun + 1


def test_two_holes_in_one_packet() -> None:
    made = framer()
    made.push(ASK[:10])
    assert made.hole(4, False)
    made.push(ASK[14:20])
    assert made.hole(2, False)
    assert fed(made, [ASK[22:] + ACK]) == [ACK]


def test_what_the_capture_cut_is_kept() -> None:
    made = framer()
    made.push(ASK[:20])
    assert made.hole(len(ASK) - 20, True)
    assert (made.cut_packet, made.framed, made.skipped) == (ASK[:20], 20, 0)
    assert fed(made, [TELL]) == [TELL]
    made.push(ASK[:20])
    made.hole(1, False)
    assert made.cut_packet == b""


# ---- recognition ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("octets", [bytes.fromhex(octets) for octets, *_ in SEEN[:-1]])
def test_on_its_port_every_known_packet_opens_a_connection(octets: bytes) -> None:
    assert opens(octets, True, True)
    assert opens(octets, True, False)
    for size in range(1, 8):
        assert opens(octets[:size], True, True)
        assert not opens(octets[:size], True, False)
    for size in range(8, len(octets)):
        assert opens(octets[:size], True, False)


@pytest.mark.parametrize(
    ("octets", "certain"),
    [(ASK, True), (TELL, True), (ACK, True), (DISCONNECT, True), (CLAIM, True), (CLAIMED, False), (RECEIPT, False)],
)
def test_elsewhere_it_has_to_be_certain(octets: bytes, certain: bool) -> None:
    assert opens(octets, False, True) == certain
    assert (judge_beginning(octets, 0, len(octets)) == YES) == certain


@pytest.mark.parametrize(
    "octets",
    [
        b"\x03\x00\x00\x16\x11\xe0\x00\x00\x00\x01\x00\xc0\x01\x0a",  # a TPKT
        b"JRMI\x00\x02\x4b\x00\x00\x00",  # what the port is registered for
        b"GET / HTTP/1.1\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        bytes(20),
        b"\xff" * 20,
        b"\xff\xfd\x18\xff\xfd\x20\xff\xfd\x23",  # telnet
        b"\x07\xff" + bytes(20),
        packet(b"\x14\x14\x02\x00\x05\xf1\x01", 0x82)[:2] + b"\x99" * 12,
        b"",
    ],
)
def test_other_protocols_are_left_alone(octets: bytes) -> None:
    assert not opens(octets, True, True)
    assert not opens(octets, False, True)


@pytest.mark.parametrize("whole", [ASK, TELL, CLAIM], ids=["short", "long", "claim"])
def test_it_takes_all_of_a_header_to_be_certain(whole: bytes) -> None:
    needed = {ASK: 13, TELL: 15, CLAIM: 14}[whole]
    for size in range(1, needed):
        assert judge_beginning(whole, 0, size) == UNDECIDED
    for size in range(needed, len(whole) + 1):
        assert judge_beginning(whole, 0, size) == YES


@pytest.mark.parametrize("behind", [RECEIPT, packet(b"", 0x97), CLAIMED])
def test_a_length_that_covers_the_next_packet_gives_way_to_that_of_the_mpi_header(behind: bytes) -> None:
    """The next one needs not be certain: it stands where the MPI header says that this one ends."""
    lying = ASK[:2] + bytes((ASK[2] + 3,)) + ASK[3:]
    assert fed(framer(), [lying + behind + TELL]) == [lying, behind, TELL]


def test_without_a_packet_behind_the_mpi_header_the_first_length_counts() -> None:
    lying = ASK[:2] + bytes((ASK[2] + 3,)) + ASK[3:]
    assert fed(framer(), [lying + b"\x55\x55\x55" + TELL]) == [lying + b"\x55\x55\x55", TELL]


def test_lengths_that_disagree_are_no_beginning() -> None:
    for at in (2, 12):
        octets = bytearray(ASK)
        octets[at] += 1
        assert judge_beginning(bytes(octets), 0, len(octets)) == NO
    assert judge_beginning(long(0xF1), 0, 17) == YES
