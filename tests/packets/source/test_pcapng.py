from __future__ import annotations

import shutil
import struct
import subprocess
import tracemalloc
from fractions import Fraction
from math import floor
from pathlib import Path
from typing import Final

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mypy_extensions import i64

from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcap import MAX_ETHERNET_PACKET
from dissect.packets.source.pcapng import MAX_BLOCK, MAX_INTERFACES, PCAPNG_MAGIC, PcapngReader
from tests.cases import each
from tests.packets.source.craft import (
    EPOCH,
    ETHERNET,
    NS,
    SLL,
    Frame,
    MemorySource,
    Pcap,
    Pcapng,
    Recorder,
    drain,
    reader_of,
    step_to_the_end,
)

#: Ticks of the default resolution.
US: Final = EPOCH * 1_000_000


def _simplest(big: bool) -> Pcapng:
    sample = Pcapng(big)
    sample.interface()
    sample.packet(US + 7, EPOCH * NS + 7000, b"one")
    sample.packet(US - 7, EPOCH * NS - 7000, b"", wire=1500)
    return sample


def _interfaces(big: bool) -> Pcapng:
    sample = Pcapng(big)
    sample.interface(ETHERNET, 65535, sample.option(2, b"eth0") + sample.resolution(9))
    sample.interface(SLL, 0, sample.option(14, struct.pack(f"{sample.order}q", EPOCH)) + sample.resolution(3))
    sample.packet(EPOCH * NS + 1, EPOCH * NS + 1, b"nano", 0)
    sample.packet(2500, EPOCH * NS + 2_500_000_000, b"milli", 1)
    sample.interface(101, 0, sample.resolution(0x80 | 10))
    sample.packet(EPOCH * 1024 + 1, EPOCH * NS + 976_562, b"binary", 2, wire=40)
    sample.packet(EPOCH * NS + 2, EPOCH * NS + 2, b"old", 0, old=True)
    return sample


def _sections() -> Pcapng:
    sample = _simplest(big=False)
    sample.section(big=True)
    sample.interface(SLL)
    sample.packet(US, EPOCH * NS, b"other order, other link")
    sample.section(big=False)
    sample.section(big=False)
    sample.interface(ETHERNET, 4)
    sample.simple(EPOCH * NS, b"simp", wire=5000)
    sample.simple(EPOCH * NS, b"le")
    return sample


def _furniture(big: bool) -> Pcapng:
    """Blocks that say something about packets, or nothing anybody knows."""
    sample = Pcapng(begin=False)
    sample.section(big, options=Pcapng(big).option(1, b"a comment of the section") + bytes(4))
    sample.block(4, sample.option(1, b"\x7f\0\0\1host\0") + bytes(4))
    sample.interface(options=sample.option(2, b"eth0"))
    sample.block(5, struct.pack(f"{sample.order}III", 0, US >> 32, US & 0xFFFFFFFF))
    sample.block(10, struct.pack(f"{sample.order}II", 0x544C534B, 5) + b"# key")
    sample.block(0x7FFF_FFFF, b"")
    sample.packet(US, EPOCH * NS, b"packet", options=sample.option(2, bytes(4)) + sample.option(0, b""))
    return sample


def _no_packets() -> Pcapng:
    """Blocks that tshark counts as records, and that hold no packet."""
    sample = Pcapng()
    sample.block(0x0BAD, struct.pack("<I", 32473) + b"custom, before any interface")
    sample.interface()
    sample.block(9, b"__REALTIME_TIMESTAMP=1\nMESSAGE=journal\n")
    sample.packet(US, EPOCH * NS, b"packet")
    return sample


SAMPLES: Final = {
    "little": _simplest(big=False),
    "big": _simplest(big=True),
    "interfaces": _interfaces(big=False),
    "big interfaces": _interfaces(big=True),
    "sections": _sections(),
    "furniture": _furniture(big=False),
    "big furniture": _furniture(big=True),
    "records of other kinds": _no_packets(),
    "no packets": Pcapng(),
}

each_sample = pytest.mark.parametrize("sample", SAMPLES.values(), ids=SAMPLES)
both_orders = pytest.mark.parametrize("big", [False, True], ids=["little", "big"])


@each_sample
@each("piece", [1 << 20, 1, 2, 7, 12, 61])
def test_every_packet_in_pieces_of_any_size(sample: Pcapng, piece: int) -> None:
    reader = reader_of(sample.octets, piece)
    assert drain(reader).frames == sample.frames
    assert reader.damage == ""
    assert reader.rejected == 0
    assert reader.octets == len(sample.octets)
    assert [note for note in reader.notes if "Simple Packet Block" not in note] == []


@each_sample
@pytest.mark.parametrize("piece", [1 << 20, 1])
def test_cut_anywhere_gives_the_whole_blocks_and_tells(sample: Pcapng, piece: int) -> None:
    for size in range(4, len(sample.octets)):
        reader = reader_of(sample.octets[:size], piece)
        assert drain(reader).frames == sample.frames_before(size)
        assert (reader.damage == "") == (size in sample.boundaries), size
        if reader.damage:
            begin = max((end for end in sample.boundaries if end < size), default=0)
            after = f", after packet {reader.packets}" if reader.packets else ""
            assert reader.damage == f"cut off at byte {size}, inside the block at byte {begin}{after}"


@both_orders
def test_the_comments_of_packets_come_before_their_packets(big: bool) -> None:
    sample = Pcapng(big)
    sample.interface()
    options = (
        sample.option(1, b"first")
        + sample.option(2, bytes(4))
        + sample.option(1, b"")
        + sample.option(1, "zweitü".encode())
    )
    sample.packet(US, EPOCH * NS, b"abc", options=options + sample.option(0, b""))
    sample.packet(US, EPOCH * NS, b"without")
    # No end of options: the end of the block is one as well.
    sample.packet(US, EPOCH * NS, b"old", options=sample.option(1, b"not \xff utf-8"), old=True)
    sample.packet(US, EPOCH * NS, b"", options=sample.option(0, b"") + sample.option(1, b"after the end"))
    reader = reader_of(sample.octets)
    recorder = drain(reader)
    assert recorder.frames == sample.frames
    assert recorder.comments == [(1, "first"), (1, "zweitü"), (3, "not \\xff utf-8")]
    assert reader.notes == []


@both_orders
def test_the_length_of_a_simple_packet_is_bound_by_the_snap_length(big: bool) -> None:
    sample = Pcapng(big)
    sample.interface(SLL, 6)
    sample.simple(0, b"no time", wire=7)
    sample.frames[-1] = Frame(0, b"no tim", 7, SLL)
    sample.packet(US, EPOCH * NS, b"timed")
    sample.simple(EPOCH * NS, b"cut at", wire=9000)
    sample.simple(EPOCH * NS, b"brief")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    at = len(Pcapng(big).octets) + 20
    (note,) = reader.notes
    assert note.startswith("a Simple Packet Block has no time, and was given that of the packet before it (")
    assert note.endswith(f"(at byte {at}, the first of 3 like it)")


@given(
    st.booleans(),
    st.integers(0, 255),
    st.integers(0, 2**64 - 1) | st.integers(0, 2**40),
    st.none() | st.integers(-(2**63), 2**63 - 1) | st.integers(-(2**31), 2**31),
)
def test_times_are_exact_whatever_the_clock_of_the_interface(
    big: bool, value: int, ticks: int, offset: int | None
) -> None:
    sample = Pcapng(big)
    shift = b"" if offset is None else sample.option(14, struct.pack(f"{sample.order}q", offset))
    sample.interface(options=shift + sample.resolution(value))
    base, exponent, finest = (2, value & 0x7F, 63) if value & 0x80 else (10, value, 19)
    exact = floor(Fraction(ticks, base ** min(exponent, finest)) * NS) + (offset or 0) * NS
    sample.packet(ticks, min(max(exact, 0), 2**63 - 1), b"x")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    told = [exponent > finest, not 0 <= exact < 2**63]
    assert ["resolution" in note or "1970" in note for note in reader.notes] == [True] * sum(told)


@both_orders
@pytest.mark.parametrize("digits", [0, 3, 6, 9])
def test_times_are_exact_up_to_the_latest_and_clamped_there(big: bool, digits: int) -> None:
    latest = (2**63 - 1) // 10 ** (9 - digits)
    sample = Pcapng(big)
    sample.interface(options=sample.resolution(digits))
    for ticks in (latest, latest + 1, latest + 2**33, 2**64 - 1):
        sample.packet(ticks, min(ticks * 10 ** (9 - digits), 2**63 - 1), b"x")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    (note,) = reader.notes
    assert "1970" in note
    assert "the first of 3 like it" in note


def test_an_absurd_resolution_is_told_with_its_number() -> None:
    sample = Pcapng()
    sample.interface(options=sample.resolution(0xFF))
    reader = reader_of(sample.octets)
    drain(reader)
    assert reader.notes == [
        "an interface claims a time resolution of 10 or 2 to the minus 127, and was given the finest one supported (at byte 44)"
    ]


@both_orders
def test_clock_options_of_the_wrong_size_are_left_out_and_told(big: bool) -> None:
    sample = Pcapng(big)
    sample.interface(options=sample.option(9, b"\x09\x09") + sample.option(14, bytes(4)) + sample.option(9, b""))
    sample.packet(US, EPOCH * NS, b"default clock")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    (note,) = reader.notes
    assert "holds 2 bytes" in note
    option = len(Pcapng(big).octets) + 16  # behind the head of the block and its fixed fields
    assert note.endswith(f"(at byte {option}, the first of 3 like it)")


@both_orders
def test_options_that_run_past_their_block_are_left_out_and_told(big: bool) -> None:
    sample = Pcapng(big)
    lying = struct.pack(f"{sample.order}HH", 1, 5) + b"four"
    sample.interface(options=sample.option(9, b"\x09") + lying)
    sample.packet(EPOCH * NS + 1, EPOCH * NS + 1, b"x", options=sample.option(1, b"kept") + lying)
    # Three octets of padding are no option, and neither are the last four of the block.
    sample.packet(EPOCH * NS + 2, EPOCH * NS + 2, b"y", options=lying[:4])
    reader = reader_of(sample.octets)
    recorder = drain(reader)
    assert recorder.frames == sample.frames
    assert recorder.comments == [(1, "kept")]
    assert [note for note in reader.notes if "claims 5 bytes" in note and "first of 3" in note] == reader.notes != []
    assert reader.rejected == 0


def _rejected_blocks(sample: Pcapng) -> dict[str, tuple[bytes, str]]:
    """Give blocks that contradict themselves, each with words of the note it must cause; the sample has one interface."""
    order = sample.order
    packet = sample.enhanced(US, b"abcdefgh")

    def captured(size: int) -> bytes:
        return packet[:12] + struct.pack(f"{order}II", size, size) + packet[20:]

    return {
        "interface 1 of 1": (sample.framed(6, sample.enhanced(US, b"x", 1)), "names interface 1"),
        "interface 2**32 - 1": (sample.framed(6, sample.enhanced(US, b"x", 2**32 - 1)), "names interface 4294967295"),
        "old interface 65535": (
            sample.framed(2, struct.pack(f"{order}HH", 65535, 0) + packet[4:]),
            "names interface 65535",
        ),
        "captured one too many": (sample.framed(6, captured(9)), "claims 9 captured bytes"),
        "captured 2**31": (sample.framed(6, captured(2**31)), "claims 2147483648 captured bytes"),
        "captured 2**32 - 1": (sample.framed(6, captured(2**32 - 1)), "claims 4294967295 captured bytes"),
        "too large for Ethernet": (
            sample.framed(6, sample.enhanced(US, bytes(MAX_ETHERNET_PACKET + 4))),
            f"claims {MAX_ETHERNET_PACKET + 4} captured bytes",
        ),
        "simple one too many": (sample.framed(3, struct.pack(f"{order}I", 5) + b"four"), "claims 5 captured bytes"),
        "enhanced without fields": (sample.framed(6, b""), "of 12 bytes is shorter"),
        "enhanced short of its fields": (sample.framed(6, bytes(16)), "of 28 bytes is shorter"),
        "old short of its fields": (sample.framed(2, bytes(16)), "of 28 bytes is shorter"),
        "simple without fields": (sample.framed(3, b""), "of 12 bytes is shorter"),
        "trailer": (sample.framed(6, packet, back=44), "repeats its length as 44"),
        "trailer 0": (sample.framed(6, packet, back=0), "repeats its length as 0 "),
        "trailer of an unknown block": (sample.framed(77, packet, back=2**32 - 1), "repeats its length as 4294967295"),
    }


@both_orders
@each("name", _rejected_blocks(_simplest(big=False)))
def test_a_block_that_contradicts_itself_is_given_up_and_reading_goes_on(name: str, big: bool) -> None:
    sample = _simplest(big)
    block, words = _rejected_blocks(sample)[name]
    at = len(sample.octets)
    sample.add(block)
    sample.packet(US, EPOCH * NS, b"after")
    sample.add(block)
    sample.packet(US, EPOCH * NS, b"and after")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.damage == ""
    assert reader.rejected == 2
    assert len(reader.notes) == 1
    assert words in reader.notes[0]
    assert reader.notes[0].endswith(f"(at byte {at}, the first of 2 like it)")


def test_packets_before_any_interface_are_given_up() -> None:
    sample = Pcapng()
    sample.link_types = [ETHERNET]
    sample.packet(US, 0, b"x")
    sample.packet(US, 0, b"x", old=True)
    sample.simple(0, b"x")
    sample.interface()
    sample.frames = []
    sample.packet(US, EPOCH * NS, b"at last")
    # The interfaces of a section are over with it.
    sample.section()
    sample.link_types = [ETHERNET]
    sample.packet(US, 0, b"x")
    sample.frames.pop()
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.rejected == 4
    assert (
        [note for note in reader.notes if "names interface 0," in note and "first of 4" in note] == reader.notes != []
    )


@both_orders
def test_an_interface_that_cannot_be_read_keeps_its_number(big: bool) -> None:
    sample = Pcapng(big)
    sample.block(1, bytes(4))
    sample.link_types = [-1]
    sample.interface(SLL)
    sample.packet(US, EPOCH * NS, b"right", 1)
    sample.packet(US, 0, b"of the broken one", 0)
    sample.simple(0, b"of the broken one too")
    sample.frames = sample.frames[:1]
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.rejected == 3
    assert ["of 16 bytes is shorter" in note for note in reader.notes] == [True, False]


def test_the_lengths_of_sections_and_interfaces_may_differ_once() -> None:
    sample = Pcapng(begin=False)
    sample.order = "<"
    sample.add(sample.framed(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1), back=99))
    sample.block(77, b"a good one between")
    sample.add(sample.framed(1, struct.pack("<HxxI", SLL, 0), back=98))
    sample.link_types = [SLL]
    sample.packet(US, EPOCH * NS, b"x")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.damage == ""
    assert reader.rejected == 0
    assert [note for note in reader.notes if "length as 99" in note and "first of 2" in note] == reader.notes != []


def test_two_wrong_trailers_running_end_the_reading() -> None:
    sample = _simplest(big=False)
    bad = sample.framed(6, sample.enhanced(US, b"x"), back=7)
    at = len(sample.octets) + len(bad)
    sample.add(bad + bad)
    kept = list(sample.frames)
    sample.packet(US, EPOCH * NS, b"never reached")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == kept
    assert reader.damage.startswith(f"damaged at byte {at}, after 2 packets: two blocks one after the other")
    assert reader.rejected == 1


@both_orders
@each("kind", [1, 6, 77, 0x0A0D0D0A])
@each("length", [0, 4, 7, 8, 11, 13, 30, MAX_BLOCK + 4, 2**31, 2**32 - 4, 2**32 - 1])
def test_a_block_length_that_cannot_be_ends_the_reading(length: int, kind: int, big: bool) -> None:
    sample = _simplest(big)
    at = len(sample.octets)
    body = struct.pack(f"{sample.order}IHHq", 0x1A2B3C4D, 1, 0, -1)
    endless = sample.octets + sample.framed(kind, body, front=length) + bytes(1_000_000)
    source = MemorySource(endless, 4096)
    reader = PcapngReader(source, source.read(4096))
    assert drain(reader).frames == sample.frames
    assert reader.damage == f"damaged at byte {at}, after 2 packets: a block claims a length of {length} bytes"
    assert source.taken == 4096
    assert source.closed


def test_a_section_too_short_for_its_fields_ends_the_reading() -> None:
    sample = _simplest(big=False)
    at = len(sample.octets)
    sample.add(sample.framed(0x0A0D0D0A, struct.pack("<IHH", 0x1A2B3C4D, 1, 0)))
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.damage == f"damaged at byte {at}, after 2 packets: a section header claims a length of 20 bytes"


@both_orders
def test_a_section_of_an_unknown_version_ends_the_reading(big: bool) -> None:
    sample = _simplest(big)
    at = len(sample.octets)
    sample.section(big, version=2)
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.damage.startswith(f"damaged at byte {at}, after 2 packets: a section is of version 2 ")


def test_a_section_without_byte_order_ends_the_reading() -> None:
    sample = _simplest(big=False)
    at = len(sample.octets)
    sample.add(sample.framed(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4E, 1, 0, -1)))
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.damage.startswith(f"damaged at byte {at}, after 2 packets: a section header has no byte-order magic")
    assert "4e 3c 2b 1a" in reader.damage


def test_the_largest_block_believed() -> None:
    sample = Pcapng()
    sample.interface()
    sample.block(0x0BAD, bytes(MAX_BLOCK - 12))
    sample.packet(US, EPOCH * NS, b"after")
    reader = reader_of(sample.octets, 1 << 18)
    assert drain(reader).frames == sample.frames
    assert reader.damage == ""


def test_a_legal_block_that_is_not_there_costs_what_is_there() -> None:
    sample = Pcapng()
    octets = sample.octets + sample.framed(0x0BAD, bytes(1000), front=MAX_BLOCK)
    reader = reader_of(octets, 100)
    tracemalloc.start()
    try:
        drain(reader)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert reader.damage == f"cut off at byte {len(octets)}, inside the block at byte 28"
    assert peak < 100_000


def test_interfaces_are_bounded() -> None:
    sample = Pcapng()
    one = sample.framed(1, struct.pack("<HxxI", SLL, 0))
    sample.octets += one * (MAX_INTERFACES + 2)
    sample.link_types = [SLL] * (MAX_INTERFACES + 1)
    sample.packet(US, EPOCH * NS, b"the last", MAX_INTERFACES - 1)
    sample.packet(US, EPOCH * NS, b"beyond", MAX_INTERFACES)
    sample.frames.pop()
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.rejected == 3
    assert ["interfaces" in note and "first of 2" in note for note in reader.notes] == [True, False]


def test_notes_stay_few_however_many_blocks_are_bad() -> None:
    sample = _simplest(big=False)
    bad = [block for name, (block, _) in _rejected_blocks(sample).items() if "Ethernet" not in name]
    good = sample.framed(77, b"")
    reader = reader_of(sample.octets + good.join(bad * 300))
    drain(reader)
    assert reader.damage == ""
    assert reader.rejected == 300 * len(bad)
    assert len(reader.notes) == 4
    assert sum(int(note.rpartition("first of ")[2].split()[0]) for note in reader.notes) == reader.rejected


@both_orders
def test_fewer_octets_on_the_wire_than_captured_is_told_and_no_cut(big: bool) -> None:
    sample = Pcapng(big)
    sample.interface()
    sample.packet(US, EPOCH * NS, b"abcde", wire=2)
    sample.frames[-1] = Frame(EPOCH * NS, b"abcde", 5, ETHERNET)
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert [note for note in reader.notes if "only 2 bytes on the wire" in note] == reader.notes != []


class _Failing(PacketSink):
    """Fails on its second packet, as a bug or an interrupt would."""

    def __init__(self) -> None:
        self.seen: list[bytes] = []

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        self.seen.append(buf[start:end])
        if len(self.seen) == 2:
            raise RuntimeError("a bug above")


@pytest.mark.parametrize("piece", [1 << 20, 30])
def test_a_sink_that_raises_gets_no_packet_twice_and_loses_none(piece: int) -> None:
    sample = SAMPLES["sections"]
    reader = reader_of(sample.octets, piece)
    sink = _Failing()
    with pytest.raises(RuntimeError, match="a bug above"):
        step_to_the_end(reader, sink)
    step_to_the_end(reader, sink)
    assert sink.seen == [frame.octets for frame in sample.frames]
    assert reader.packets == len(sample.frames)
    assert reader.damage == ""


def test_a_packet_is_delivered_when_it_is_there_not_when_the_next_one_is() -> None:
    sample = _simplest(big=False)
    source = MemorySource(sample.octets)
    reader = PcapngReader(source, source.read(1000))
    recorder = Recorder()
    assert reader.step(recorder)
    assert recorder.frames == sample.frames


@given(
    st.lists(st.tuples(st.integers(0, 2**32 - 1), st.integers(0, 999_999), st.binary(max_size=40), st.integers(0, 9)))
)
def test_the_same_packets_in_pcap_and_pcapng(packets: list[tuple[int, int, bytes, int]]) -> None:
    classic, modern = Pcap(), Pcapng()
    modern.interface()
    for seconds, micros, octets, cut in packets:
        time_ns = seconds * NS + micros * 1000
        classic.packet(time_ns, octets, len(octets) + cut)
        modern.packet(time_ns // 1000, time_ns, octets, wire=len(octets) + cut)
    assert drain(reader_of(classic.octets)).frames == drain(reader_of(modern.octets)).frames == classic.frames


@given(st.sampled_from(["", "<", ">"]), st.binary(max_size=400), st.integers(1, 500))
def test_random_octets_never_raise(order: str, octets: bytes, piece: int) -> None:
    front = (
        PCAPNG_MAGIC + struct.pack(f"{order}IIHHq", 28, 0x1A2B3C4D, 1, 0, -1) + struct.pack(f"{order}I", 28)
        if order
        else PCAPNG_MAGIC
    )
    drain(reader_of(front + octets, piece))


def packet_body(high: int, low: int, wire: int, octets: bytes) -> bytes:
    """What follows the number of the interface in a packet block of a little-endian file."""
    return struct.pack("<IIII", high, low, len(octets), wire) + octets + bytes(-len(octets) % 4)


words = st.integers(0, 2**32 - 1)
packet_bodies = st.builds(packet_body, words, words, words, st.binary(max_size=40))
blocks = st.lists(
    st.tuples(st.just(6), packet_bodies, st.just(0))
    | st.tuples(
        st.sampled_from([0, 1, 2, 3, 4, 5, 6, 10, 0x0A0D0D0A, 2**32 - 1]),
        st.binary(max_size=60),
        st.sampled_from([0, 0, 0, 0, 0, 0, 4]),
    ),
    max_size=12,
)


@given(st.booleans(), blocks, st.integers(1, 500))
@example(False, [(6, packet_body(2**32 - 1, 2**32 - 1, 0, b"octets"), 0)], 7)
def test_random_blocks_never_raise(big: bool, bodies: list[tuple[int, bytes, int]], piece: int) -> None:
    sample = Pcapng(big)
    sample.interface()
    sample.interface(SLL, options=sample.resolution(0x80 | 40))
    for kind, body, lie in bodies:
        # An interface that exists, so that what comes after the number is reached.
        sample.add(
            sample.framed(kind, (bytes(4) if kind == 6 else b"") + body, back=12 + len(body) + lie if lie else None)
        )
    whole, pieces = reader_of(sample.octets), reader_of(sample.octets, piece)
    frames = drain(whole).frames
    assert frames == drain(pieces).frames
    assert (whole.damage, whole.notes, whole.rejected) == (pieces.damage, pieces.notes, pieces.rejected)
    for frame in frames:
        assert 0 <= frame.time_ns < 2**63
        assert frame.wire_length >= len(frame.octets)


@given(
    st.sampled_from([name for name, sample in SAMPLES.items() if sample.frames]),
    st.lists(st.tuples(st.integers(4, 400), st.integers(0, 4), st.binary(max_size=5)), min_size=1, max_size=6),
    st.integers(1, 400),
)
def test_mutated_captures_never_raise_and_pieces_change_nothing(
    name: str, mutations: list[tuple[int, int, bytes]], piece: int
) -> None:
    octets = SAMPLES[name].octets
    for at, removed, inserted in mutations:
        octets = octets[:at] + inserted + octets[at + removed :]
    whole, pieces = reader_of(octets), reader_of(octets, piece)
    assert drain(whole).frames == drain(pieces).frames
    assert (whole.damage, whole.notes, whole.rejected) == (pieces.damage, pieces.notes, pieces.rejected)


@pytest.mark.parametrize("name", ["interfaces", "big interfaces", "sections", "furniture"])
def test_every_octet_changed_to_the_values_that_hurt(name: str) -> None:
    octets = SAMPLES[name].octets
    for at in range(4, len(octets)):
        old = octets[at]
        for new in {0, 1, 0x7F, 0x80, 0xFF, old ^ 1, old ^ 0x80, (old + 1) & 0xFF} - {old}:
            drain(reader_of(octets[:at] + bytes([new]) + octets[at + 1 :]))


@pytest.mark.parametrize(
    "name", ["little", "big", "interfaces", "big interfaces", "sections", "furniture", "big furniture"]
)
def test_tshark_reads_the_samples_the_same(name: str, tmp_path: Path) -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("tshark is not installed")
    sample = SAMPLES[name]
    path = tmp_path / "sample"
    path.write_bytes(sample.octets)
    fields = [part for field in ("frame.time_epoch", "frame.cap_len", "frame.len") for part in ("-e", field)]
    command = [tshark, "-n", "-r", str(path), "-T", "fields", *fields]
    shown = []
    for line in subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout.splitlines():
        time, captured, wire = line.split("\t")
        seconds, _, fraction = time.partition(".")
        shown.append((int(seconds) * NS + int(fraction) if time else None, int(captured), int(wire)))
    simple = [b"simp", b"le"]  # tshark gives no time to a Simple Packet Block
    assert shown == [
        (None if frame.octets in simple else frame.time_ns, len(frame.octets), frame.wire_length)
        for frame in drain(reader_of(sample.octets)).frames
    ]
