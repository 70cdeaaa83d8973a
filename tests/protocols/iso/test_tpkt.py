from __future__ import annotations

from itertools import pairwise
from typing import Final

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.protocols.iso import tpkt
from dissect.protocols.iso.tpkt import (
    BAD_LENGTH,
    BAD_VERSION,
    HIDING,
    NO,
    UNDECIDED,
    YES,
    Framer,
    judge_beginning,
    plausible,
)
from tests.cases import each
from tests.growth import assert_growth

CR: Final = bytes.fromhex("0300001611e00000004b00c0010ac1020100c2020103")
EMPTY_DT: Final = bytes.fromhex("0300000702f000")
READ: Final = bytes.fromhex("0300001f02f080320100002500000e00000401120a10020001000184000000")
PLUS: Final = bytes.fromhex("0300001102f08072010004310000007201")
#: Octets in which no TPKT can begin.
JUNK: Final = b"\x55"


def s7(size: int) -> bytes:
    """A TPKT with an S7 PDU of ``size`` octets, in which nothing looks like another TPKT."""
    pdu = (b"\x32\x01" + JUNK * size)[:size]
    return b"\x03\0" + (7 + size).to_bytes(2, "big") + b"\x02\xf0\x80" + pdu


def framer(synced: bool = True) -> Framer:
    made = Framer()
    made.synced = synced
    return made


def fed(made: Framer, segments: list[bytes]) -> list[bytes]:
    """Push segments; return the TPKTs that became whole. Every octet is accounted for after each."""
    packets: list[bytes] = []
    for segment in segments:
        pushed(made, segment)
        packets += made.packets
        made.packets = []
    return packets


def pushed(made: Framer, segment: bytes, start: int = 0, segment_start: bool = True) -> None:
    before = made.framed + made.skipped + made.buffered
    made.push(segment, start, segment_start)
    assert made.framed + made.skipped + made.buffered == before + len(segment) - start
    assert made.buffered < tpkt.MAX_LENGTH
    assert made.synced or made.buffered < tpkt.MAX_SOUGHT


def faults(made: Framer) -> list[tuple[str, int]]:
    return [(fault.kind, fault.value) for fault in made.faults]


def cut_at(octets: bytes, edges: list[int]) -> list[bytes]:
    places = sorted({0, len(octets), *(edge for edge in edges if edge < len(octets))})
    return [octets[start:end] for start, end in pairwise(places)]


# ---- segmentation ---------------------------------------------------------------------------------------------------

#: Any TPKT whose header is right, whatever is in it.
ANY_TPKT = st.binary(min_size=3, max_size=40).map(lambda tpdu: b"\x03\0" + (len(tpdu) + 4).to_bytes(2, "big") + tpdu)
CUTS = st.lists(st.integers(1, 400), max_size=40)


@pytest.mark.parametrize("before", [0, 1, 2])
def test_a_length_beyond_the_segment_hides_nothing_behind_it(before: int) -> None:
    """Wherever in its segment the lying TPKT stands."""
    lying = READ[:2] + b"\x04\x00" + READ[4:]
    made = framer()
    assert fed(made, [READ * before + lying + READ]) == [READ] * before + [lying, READ]
    assert faults(made) == [(HIDING, 0x400)]


@given(st.lists(ANY_TPKT, max_size=12), CUTS, st.integers(0, 3))
def test_any_segmentation_gives_the_same_tpkts(packets: list[bytes], cuts: list[int], tail: int) -> None:
    rest = b"\x03\x00\x00\x09\x02\xf0\x80\x32"[: tail * 2]
    octets = b"".join(packets) + rest
    for segments in ([octets], cut_at(octets, cuts), [bytes([octet]) for octet in octets]):
        made = framer()
        assert fed(made, segments) == packets
        assert (made.framed, made.skipped, made.buffered) == (len(octets) - len(rest), 0, len(rest))
        assert made.faults == []


@each("split", range(1, len(READ)))
def test_a_tpkt_split_anywhere(split: int) -> None:
    made = framer()
    assert fed(made, [READ[:split]]) == []
    assert fed(made, [READ[split:] + CR[:5]]) == [READ]
    assert fed(made, [CR[5:]]) == [CR]


@each("split", range(1, len(READ)))
@each("behind", [b"", CR, b"\x03"])
def test_the_caller_may_join_a_tpkt_itself(split: int, behind: bytes) -> None:
    made = framer()
    octets = b"??" + READ[split:] + behind
    assert made.joined(octets, 2, len(octets)) == b""  # none is begun
    pushed(made, READ[:split])
    assert made.joined(octets, 2, len(octets) - len(behind) - 1) == b""
    assert made.joined(b"", 0, 0) == b""
    joined = made.joined(octets, 2, len(octets))
    assert joined == (b"" if READ[split] == 3 else READ)  # where another might begin, `push` decides
    assert made.buffered == split
    made.end_pending()
    assert (made.buffered, made.synced) == (0, True)
    assert fed(made, [CR]) == [CR]


def test_the_caller_may_have_taken_the_first_tpkts_itself() -> None:
    made = framer()
    pushed(made, READ + CR, len(READ), False)
    assert made.packets == [CR]
    assert (made.framed, made.skipped) == (len(CR), 0)


@pytest.mark.parametrize("length", [7, 8, 255, 256, 65535])
def test_lengths_up_to_the_largest(length: int) -> None:
    packet = b"\x03\0" + length.to_bytes(2, "big") + b"\x02\xf0\x80" + bytes(length - 7)
    for segments in ([packet], [packet[:5], packet[5:]], cut_at(packet, list(range(0, length, 1448)))):
        assert fed(framer(), segments) == [packet]


def test_a_reserved_octet_that_is_not_0_is_no_fault() -> None:
    odd = b"\x03\x01" + READ[2:]
    assert fed(framer(), [odd + READ]) == [odd, READ]


def test_one_tpkt_over_3000_segments_takes_linear_work() -> None:
    def work(size: int) -> None:
        packet = b"\x03\0" + size.to_bytes(2, "big") + b"\x02\xf0\x80" + bytes(size - 7)
        segments = [packet[at : at + 5] for at in range(0, size, 5)]
        made = framer()
        for segment in segments:
            made.push(segment, 0, True)
        assert made.packets == [packet]

    assert_growth(lambda: work(4_000), lambda: work(16_000), 5)  # 4 when linear, 16 when quadratic


# ---- lengths that cannot be -----------------------------------------------------------------------------------------


@each("length", [4, 5, 6])
@each("split", range(7))
def test_a_length_of_4_to_6_is_stepped_over(length: int, split: int) -> None:
    short = (b"\x03\0\0" + bytes([length]) + b"\x02\xf0")[:length]
    octets = READ + short + CR
    made = framer()
    assert fed(made, cut_at(octets, [len(READ) + split])) == [READ, CR]
    assert faults(made) == [(BAD_LENGTH, length)]
    assert (made.framed, made.skipped) == (len(READ + CR), length)


@each("length", range(4))
@each("split", range(5))
def test_a_length_below_4_loses_the_place_until_the_next_tpkt(length: int, split: int) -> None:
    bad = b"\x03\0\0" + bytes([length])
    octets = READ + bad + JUNK * 9 + READ + CR
    made = framer()
    assert fed(made, cut_at(octets, [len(READ) + split])) == [READ, READ, CR]
    assert faults(made) == [(BAD_LENGTH, length)]
    assert made.skipped == 13


def test_lengths_of_0_without_end_are_gone_through_once() -> None:
    """A Modbus capture holds ``03 00 00 00``, and a loop that adds the length to its place never ends."""
    made = framer()
    assert fed(made, [b"\x03\0\0\0" * 5000] * 3) == []
    assert made.skipped + made.buffered == 60000
    assert faults(made) == [(BAD_LENGTH, 0)]
    assert fed(made, [READ]) == [READ]


# ---- garbage --------------------------------------------------------------------------------------------------------


@given(st.lists(st.sampled_from([READ, CR, EMPTY_DT, PLUS, s7(240)]), min_size=1, max_size=6), CUTS, st.integers(1, 60))
@example([READ], [], 1)
def test_garbage_costs_nothing_but_itself(packets: list[bytes], cuts: list[int], size: int) -> None:
    """What follows the garbage is found again, however the octets are cut into segments."""
    octets = READ + JUNK * size + b"".join(packets)
    for segments in ([octets], cut_at(octets, cuts), [bytes([octet]) for octet in octets]):
        made = framer()
        assert fed(made, segments) == [READ, *packets]
        assert faults(made) == [(BAD_VERSION, 0x55)]
        assert made.skipped == size


def test_a_stretch_of_garbage_is_one_fault() -> None:
    made = framer()
    assert fed(made, [READ, b"GET / HTTP/1.1\r\n", b"Host: plc\r\n\r\n", READ, b"\x00" + READ]) == [READ, READ, READ]
    assert faults(made) == [(BAD_VERSION, 0x47), (BAD_VERSION, 0)]


BITS = st.sampled_from(
    [
        b"\x03",
        b"\x03\0",
        b"\0",
        b"\x03\0\0",
        b"\x02\xf0\x80",
        b"\x02\xf0\0",
        b"\x32\x01",
        b"\x72\x01",
        READ,
        CR,
        EMPTY_DT,
        READ[:9],
    ]
)
TPKTISH = st.lists(st.one_of(BITS, st.binary(min_size=1, max_size=4)), max_size=30).map(b"".join)


@given(TPKTISH, CUTS, st.booleans())
def test_any_octets(octets: bytes, cuts: list[int], synced: bool) -> None:
    made = framer(synced)
    packets = fed(made, cut_at(octets, cuts))
    # Of one whose length lies, less may be told, or what is inside it as well.
    assert sum(map(len, packets)) >= made.framed
    for packet in packets:
        assert int.from_bytes(packet[2:4], "big") >= len(packet) >= 7
        assert packet in octets


# ---- searching ------------------------------------------------------------------------------------------------------

RANDOM_DT: Final = bytes.fromhex("0300000b02f080") + b"\x99\x98\x97\x96"


@each(
    ("octets", "judged"),
    [
        (b"\x03", UNDECIDED),
        (b"\x03\x00\x00", UNDECIDED),
        (b"\x03\x01", NO),
        (b"\x02", NO),
        (READ[:4], UNDECIDED),
        (READ[:-1], UNDECIDED),
        (READ, YES),
        (READ + b"\x03", YES),
        (READ + b"\x03\x00", YES),
        (READ + CR[:4], YES),
        (READ + CR, YES),
        (READ + b"\x55", YES),  # whatever follows: all its lengths agree
        (READ + b"\x03\x00\x00\x06", YES),
        (EMPTY_DT + b"\x55", NO),
        (EMPTY_DT + b"\x03\x55", NO),
        (EMPTY_DT + b"\x03\x00\x00\x06", NO),
        (EMPTY_DT + b"\x03\x00\x00\x10\x02\x99", NO),
        (CR, YES),
        (EMPTY_DT, YES),
        (RANDOM_DT, NO),  # a DT has to carry a known protocol
        (RANDOM_DT[:-1], UNDECIDED),
        (b"\x03\x00\x00\x07\x00\xf0\x80", NO),  # LI 0
        (b"\x03\x00\x00\x07\xff\xf0\x80", NO),  # LI 255
        (b"\x03\x00\x00\x07\x03\xf0\x80", NO),  # LI beyond the TPKT
        (b"\x03\x00\x00\x07\x02\x30\x80", NO),  # no TPDU code
        (b"\x03\x00\x00\x06\x02\xf0", NO),
        (b"\x03\x00\x10\x00\x02\xf0\x80", UNDECIDED),
        (b"\x03\x00\x10\x01\x02\xf0\x80", NO),  # too long to wait for
    ],
)
def test_judge_beginning(octets: bytes, judged: int) -> None:
    for before in (b"", b"\x03\x00\x03"):
        assert judge_beginning(before + octets, len(before), len(before + octets)) == judged
        assert judge_beginning(before + octets + b"\x55\x55", len(before), len(before + octets)) == judged


@pytest.mark.parametrize(
    "content", ["3201", "3207", "7201", "72fe", "0100010061", "0d00", "1603010200", "7f65", "7f66"]
)
def test_protocols_that_confirm_a_dt(content: str) -> None:
    data = bytes.fromhex(content)
    packet = b"\x03\0" + (7 + len(data)).to_bytes(2, "big") + b"\x02\xf0\x80" + data
    assert judge_beginning(packet, 0, len(packet)) == YES


@pytest.mark.parametrize("code", range(16))
def test_plausible_tpdu_codes(code: int) -> None:
    octets = bytes((3, 0, 0, 11, 6, code << 4 | 5, 0, 0, 0, 0, 0))
    assert plausible(octets, 0, 11) is (code in {1, 2, 5, 6, 7, 8, 12, 13, 14, 15})
    assert plausible(octets, 0, 5)  # not there yet


@pytest.mark.parametrize("size", range(4))
def test_plausible_wants_four_octets(size: int) -> None:
    assert not plausible(READ, 0, size)
    assert not plausible(b"\x03\0\0\x07", 1, 4)


def test_a_segment_start_comes_first() -> None:
    """Inside the segment stands what looks just as right; where a segment starts a TPKT starts, too."""
    inner = b"\x03\x00\x00\x12\x02\xf0\x80" + EMPTY_DT + b"\x99" * 4  # a DT of an unknown protocol, a TPKT in it
    made = framer(False)
    assert fed(made, [inner + READ]) == [inner, READ]
    made = framer(False)
    assert fed(made, [JUNK + inner + READ]) == [
        READ
    ]  # not at the start: the DT does not convince, nor does what is in it
    made = framer(False)
    pushed(made, inner + READ, 0, False)
    assert made.packets == [READ]


def test_a_segment_start_comes_before_what_was_kept() -> None:
    made = framer(False)
    false_start = b"\x03\x00\x08\x00\x02\xf0\x80"
    assert fed(made, [JUNK + false_start]) == []
    assert (made.synced, made.buffered) == (False, len(false_start))
    assert fed(made, [READ]) == [READ]
    assert made.skipped == len(JUNK + false_start)


def test_a_true_beginning_behind_a_false_one_is_found_as_soon_as_it_is_whole() -> None:
    made = framer(False)
    octets = JUNK + b"\x03\x00\x08\x00\x02\xf0\x80" + READ
    assert fed(made, [bytes([octet]) for octet in octets[:-1]]) == []
    assert fed(made, [octets[-1:]]) == [READ]


def test_many_false_beginnings_do_not_hide_the_true_one() -> None:
    made = framer(False)
    false = b"\x03\x00\x08\x00\x02\xf0\x80"
    assert fed(made, [JUNK + false * 100 + READ[:9]]) == []
    assert made.buffered == 31 * len(false) + 9  # so many places are remembered
    assert fed(made, [READ[9:] + CR]) == [READ, CR]


@pytest.mark.parametrize("pattern", ["03000fff02f000", "0300", "03", "03000007", "030003"])
@pytest.mark.parametrize("step", [1, 7, 500])
def test_searching_takes_linear_work_in_segments_of_any_size(step: int, pattern: str) -> None:
    """Octets full of beginnings that never come true."""
    octets = JUNK + bytes.fromhex(pattern) * (30000 // len(pattern))

    def work(size: int) -> None:
        made = framer(False)
        for at in range(0, size, step):
            made.push(octets[at : at + step], 0, False)

    assert_growth(lambda: work(1500), lambda: work(3000), 2.6)  # 2 when linear, 4 when quadratic


# ---- holes ----------------------------------------------------------------------------------------------------------


@each("arrived", range(4, len(READ)))
def test_a_hole_inside_a_tpkt_does_not_cost_the_place(arrived: int) -> None:
    for lost in range(1, len(READ) - arrived + 1):
        made = framer()
        assert fed(made, [READ, READ[:arrived]]) == [READ]
        assert made.hole(lost, False) is True
        # What follows does not look like a TPKT of a known protocol: it is known to be one.
        assert fed(made, [READ[arrived + lost :] + RANDOM_DT + JUNK]) == [RANDOM_DT]
        assert (made.framed, made.skipped) == (len(READ + RANDOM_DT), len(READ) - lost + 1)


@pytest.mark.parametrize("arrived", range(4))
def test_a_hole_inside_a_header_costs_the_place(arrived: int) -> None:
    made = framer()
    fed(made, [READ + READ[:arrived]])
    assert made.hole(2, False) is False
    assert not made.synced
    assert fed(made, [READ[arrived + 2 :] + READ]) == [READ]


@pytest.mark.parametrize("beyond", [1, 3, 20])
def test_a_hole_beyond_the_end_of_a_tpkt_costs_the_place(beyond: int) -> None:
    made = framer()
    fed(made, [READ[:10]])
    assert made.hole(len(READ) - 10 + beyond, False) is False
    assert fed(made, [(CR + READ)[beyond:]]) == [READ]


def test_holes_in_what_is_left_of_a_damaged_tpkt() -> None:
    packet = s7(100)
    made = framer()
    fed(made, [packet[:10]])
    assert made.hole(20, False) is True
    fed(made, [packet[30:50]])
    assert made.hole(30, False) is True
    fed(made, [packet[80:90]])
    assert made.skip == 17
    assert made.hole(17, False) is True  # up to its last octet
    assert fed(made, [RANDOM_DT]) == [RANDOM_DT]
    fed(made, [packet[:10]])
    assert made.hole(20, False) is True
    assert made.hole(78, False) is False


def test_a_hole_between_tpkts_of_unknown_extent() -> None:
    made = framer()
    assert fed(made, [READ]) == [READ]
    assert made.hole(7, False) is False
    assert fed(made, [RANDOM_DT]) == [RANDOM_DT]  # a segment starts with it
    assert made.hole(7, False) is False
    assert fed(made, [JUNK + RANDOM_DT, CR]) == [CR]


def test_a_hole_while_searching_forgets_what_was_kept() -> None:
    made = framer(False)
    fed(made, [JUNK + READ[:20]])
    assert made.buffered == 20
    assert made.hole(4, False) is False
    assert (made.buffered, made.skipped) == (0, 21)
    assert fed(made, [JUNK + READ[20:] + READ]) == [READ]


@each("arrived", range(1, len(READ)))
def test_a_tpkt_cut_by_the_capture_is_kept_as_far_as_it_goes(arrived: int) -> None:
    made = framer()
    fed(made, [READ + READ[:arrived]])
    known = made.hole(len(READ) - arrived, True)
    assert made.cut_packet == READ[:arrived]
    assert (made.framed, made.skipped, made.buffered) == (len(READ) + arrived, 0, 0)
    assert known is (arrived >= 4)
    assert fed(made, [READ]) == [READ]
    made.hole(1, True)
    assert made.cut_packet == b""  # nothing had begun


# A stream of S7 PDUs, what of it is lost, and how the rest is cut into segments.
SIZES = st.lists(st.integers(2, 60), min_size=1, max_size=12)
LOST = st.lists(st.tuples(st.integers(0, 400), st.integers(1, 40)), max_size=4)


@given(SIZES, LOST, CUTS, st.booleans())
@example([24], [(0, 1)], [], False)
@example([24, 24], [(31, 1)], list(range(70)), False)
def test_a_hole_costs_the_tpkts_it_touches_and_no_other(
    sizes: list[int], lost: list[tuple[int, int]], cuts: list[int], octet_by_octet: bool
) -> None:
    packets = [s7(size) for size in sizes]
    stream = b"".join(packets)
    gone = {place for at, size in lost for place in range(at, at + size) if place < len(stream)}
    edges = {0, len(stream), *(cut for cut in cuts if cut < len(stream))}
    edges |= set(range(len(stream))) if octet_by_octet else set()
    edges |= {place for place in range(len(stream)) if (place in gone) is not (place - 1 in gone)}
    made = framer()
    given_octets = 0
    found = []
    for start, end in pairwise(sorted(edges)):
        if start in gone:
            made.hole(end - start, False)
        else:
            found += fed(made, [stream[start:end]])
            given_octets += end - start
        assert made.framed + made.skipped + made.buffered == given_octets
    whole = []
    at = 0
    for packet in packets:
        if gone.isdisjoint(range(at, at + len(packet))):
            whole.append(packet)
        at += len(packet)
    assert found == whole


STEPS = st.lists(
    st.one_of(st.tuples(TPKTISH, st.booleans()), st.tuples(st.integers(1, 70000), st.booleans())),
    max_size=20,
)


@given(STEPS, st.booleans())
def test_any_octets_with_any_holes(steps: list[tuple[bytes | int, bool]], synced: bool) -> None:
    made = framer(synced)
    given_octets = 0
    for step, flag in steps:
        if isinstance(step, int):
            made.hole(step, flag)
        else:
            pushed(made, step, 0, flag)
            given_octets += len(step)
        assert made.framed + made.skipped + made.buffered == given_octets
