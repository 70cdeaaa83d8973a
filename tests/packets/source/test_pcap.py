from __future__ import annotations

import shutil
import struct
import subprocess
import tracemalloc
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mypy_extensions import i64

from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcap import CHUNK, MAX_ETHERNET_PACKET, MAX_PACKET, PCAP_MAGICS, PcapReader, u32le
from tests.cases import each
from tests.packets.source.craft import (
    EPOCH,
    ETHERNET,
    NS,
    SLL,
    Frame,
    MemorySource,
    Pcap,
    Recorder,
    drain,
    reader_of,
    step_to_the_end,
)


def _filled(sample: Pcap) -> Pcap:
    sample.packet(EPOCH * NS + 123_456_000, bytes(range(60)))
    sample.packet(EPOCH * NS + 999_999_000, b"", wire=1500)
    sample.packet(EPOCH * NS, b"\xa1\xb2\xc3\xd4" * 5, wire=70_000)
    sample.packet((2**32 - 1) * NS + 1000, b"in 2106")
    return sample


SAMPLES: Final = {
    "little": _filled(Pcap()),
    "big": _filled(Pcap(big=True)),
    "nanoseconds": _filled(Pcap(nanoseconds=True)),
    "big nanoseconds": _filled(Pcap(big=True, nanoseconds=True)),
    "modified": _filled(Pcap(modified=True)),
    "big modified": _filled(Pcap(big=True, modified=True)),
    "cooked": _filled(Pcap(link_type=SLL)),
    "with frame check sequence": _filled(Pcap(link_type=0x2400_0000 | ETHERNET)),
    "no packets": Pcap(),
}

each_sample = pytest.mark.parametrize("sample", SAMPLES.values(), ids=SAMPLES)


@each_sample
@each("piece", [1 << 20, 1, 2, 7, 24, 61])
def test_every_packet_in_pieces_of_any_size(sample: Pcap, piece: int) -> None:
    reader = reader_of(sample.octets, piece)
    recorder = drain(reader)
    assert recorder.frames == sample.frames
    assert reader.damage == ""
    assert reader.notes == []
    assert reader.rejected == 0
    assert reader.octets == len(sample.octets)


@each_sample
def test_headers_are_read_alike_by_either_way(sample: Pcap, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled, numbers are read octet by octet; interpreted, by struct. Where this is compiled both are the same way."""
    told: list[list[Frame]] = []
    for compiled in (True, False):
        monkeypatch.setattr("dissect.packets.source.pcap.COMPILED", compiled)
        told.append(drain(reader_of(sample.octets, 61)).frames)
    assert told == [sample.frames, sample.frames]


@each_sample
@pytest.mark.parametrize("piece", [1 << 20, 1])
def test_cut_anywhere_gives_the_whole_records_and_tells(sample: Pcap, piece: int) -> None:
    for size in range(4, len(sample.octets)):
        reader = reader_of(sample.octets[:size], piece)
        assert drain(reader).frames == sample.frames_before(size)
        assert (reader.damage == "") == (size in sample.boundaries), size
        if size < 24:
            assert reader.damage == f"cut off at byte {size}, inside the file header"
        elif reader.damage:
            assert reader.damage == f"cut off at byte {size}, inside the record of packet {reader.packets + 1}"


def test_a_microsecond_count_past_the_second_is_read_as_it_stands_and_told() -> None:
    sample = Pcap()
    sample.packet(EPOCH * NS, b"fine")
    for fraction in (1_000_000, 2**32 - 1):
        record = sample.record(EPOCH, fraction, 3, 3, b"odd")
        sample.add(record, Frame(EPOCH * NS + fraction * 1000, b"odd", 3, ETHERNET))
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert reader.damage == ""
    (note,) = reader.notes
    assert note.startswith("a time stamp holds 1000000 parts of a second, a whole second or more, and was read as it ")
    assert note.endswith("stands (at byte 44, the first of 2 like it)")


def test_nanoseconds_past_the_second_do_not_leave_64_bits() -> None:
    sample = Pcap(nanoseconds=True)
    record = sample.record(2**32 - 1, 2**32 - 1, 0, 0, b"")
    sample.add(record, Frame((2**32 - 1) * NS + 2**32 - 1, b"", 0, ETHERNET))
    assert drain(reader_of(sample.octets)).frames == sample.frames


def test_fewer_octets_on_the_wire_than_captured_is_told_and_no_cut() -> None:
    sample = Pcap()
    sample.add(sample.record(EPOCH, 0, 5, 2, b"abcde"), Frame(EPOCH * NS, b"abcde", 5, ETHERNET))
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert [note for note in reader.notes if "only 2 bytes on the wire" in note] == reader.notes != []


@pytest.mark.parametrize(("version", "swapped"), [((2, 2), True), ((2, 3), True), ((2, 4), False)])
def test_the_lengths_of_old_files_are_swapped_back(version: tuple[int, int], swapped: bool) -> None:
    sample = Pcap(version=version)
    sample.add(sample.record(EPOCH, 0, 300_000 if swapped else 4, 4 if swapped else 300_000, b"abcd"))
    # Some writers of 2.3 had them in today's order already.
    sample.add(sample.record(EPOCH, 0, 4, 1500, b"efgh"))
    reader = reader_of(sample.octets)
    lengths = [(frame.octets, frame.wire_length) for frame in drain(reader).frames]
    assert lengths == [(b"abcd", 300_000), (b"efgh", 1500)]
    assert reader.damage == ""
    assert reader.notes == []


def test_another_version_is_read_and_told() -> None:
    sample = Pcap(version=(543, 0))
    sample.packet(EPOCH * NS, b"x")
    reader = reader_of(sample.octets)
    assert drain(reader).frames == sample.frames
    assert [note for note in reader.notes if "version 543.0" in note] == reader.notes != []


@pytest.mark.parametrize("link_type", [ETHERNET, SLL])
@pytest.mark.parametrize("beyond", [0, 1])
def test_the_largest_packet_believed(link_type: int, beyond: int) -> None:
    limit = MAX_ETHERNET_PACKET if link_type == ETHERNET else MAX_PACKET
    sample = Pcap(link_type=link_type)
    sample.packet(EPOCH * NS, b"first")
    at = len(sample.octets)
    sample.packet(EPOCH * NS, bytes(limit + beyond))
    sample.packet(EPOCH * NS, b"last")
    reader = reader_of(sample.octets, 1 << 18)
    frames = drain(reader).frames
    if beyond:
        assert frames == sample.frames[:1]
        assert reader.damage == f"damaged at byte {at}, after 1 packet: a record claims a packet of {limit + 1} bytes"
    else:
        assert frames == sample.frames
        assert reader.damage == ""


def test_files_joined_by_cat_are_named_so() -> None:
    sample = Pcap()
    sample.packet(EPOCH * NS, b"first")
    reader = reader_of(sample.octets + sample.octets, 1 << 18)
    drain(reader)
    said = "another pcap file begins there; join files with mergecap, not with cat"
    assert reader.damage == f"damaged at byte {len(sample.octets)}, after 2 packets: {said}"


@pytest.mark.parametrize("captured", [2**32 - 1, 2**31, 2**30, MAX_PACKET + 1])
def test_an_absurd_length_allocates_nothing(captured: int) -> None:
    sample = Pcap(link_type=SLL)
    sample.packet(EPOCH * NS, b"first")
    endless = sample.octets + sample.record(EPOCH, 0, captured, captured, b"") + bytes(8_000_000)
    source = MemorySource(endless, 4096)
    reader = PcapReader(source, source.read(4096))
    tracemalloc.start()
    try:
        frames = drain(reader).frames
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert frames == sample.frames
    assert f"claims a packet of {captured} bytes" in reader.damage
    assert source.taken == 4096
    assert source.closed
    assert peak < 100_000


def test_a_legal_record_that_is_not_there_costs_what_is_there() -> None:
    sample = Pcap(link_type=SLL)
    sample.add(sample.record(EPOCH, 0, MAX_PACKET, MAX_PACKET, bytes(1000)))
    reader = reader_of(sample.octets, 100)
    tracemalloc.start()
    try:
        assert drain(reader).frames == []
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert reader.damage == f"cut off at byte {len(sample.octets)}, inside the record of packet 1"
    assert peak < 100_000


def test_one_step_delivers_about_one_chunk() -> None:
    sample = Pcap()
    body = bytes(984)
    octets = sample.octets + b"".join(sample.record(EPOCH, 0, 984, 984, body) for _ in range(2000))
    source = MemorySource(octets)
    reader = PcapReader(source, source.read(CHUNK))
    recorder = Recorder()
    before = 0
    while reader.step(recorder):
        assert len(recorder.frames) - before <= CHUNK // 1000 + 1
        before = len(recorder.frames)
    assert reader.packets == 2000
    assert reader.damage == ""


def test_a_packet_is_delivered_when_it_is_there_not_when_the_next_one_is() -> None:
    sample = Pcap()
    sample.packet(EPOCH * NS, b"now")
    source = MemorySource(sample.octets)
    reader = PcapReader(source, source.read(1000))
    recorder = Recorder()
    assert reader.step(recorder)
    assert recorder.frames == sample.frames


class _Failing(PacketSink):
    """Fails on its first packet, as a bug or an interrupt would."""

    def __init__(self) -> None:
        self.seen: list[bytes] = []

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        self.seen.append(buf[start:end])
        if len(self.seen) == 1:
            raise RuntimeError("a bug above")


@pytest.mark.parametrize("piece", [1 << 20, 30])
def test_a_sink_that_raises_gets_no_packet_twice_and_loses_none(piece: int) -> None:
    sample = SAMPLES["little"]
    reader = reader_of(sample.octets, piece)
    sink = _Failing()
    with pytest.raises(RuntimeError, match="a bug above"):
        step_to_the_end(reader, sink)
    step_to_the_end(reader, sink)
    assert sink.seen == [frame.octets for frame in sample.frames]
    assert reader.packets == len(sample.frames)
    assert reader.damage == ""


class _InterruptedSource(MemorySource):
    """A pipe on which somebody presses Ctrl-C once, while a record is half there."""

    interrupted = False

    def read(self, size: int) -> bytes:
        if self.taken > 60 and not self.interrupted:
            self.interrupted = True
            raise KeyboardInterrupt
        return super().read(size)


def test_an_interrupt_while_waiting_loses_nothing() -> None:
    sample = SAMPLES["little"]
    source = _InterruptedSource(sample.octets, 7)
    reader = PcapReader(source, source.read(7))
    recorder = Recorder()
    with pytest.raises(KeyboardInterrupt):
        step_to_the_end(reader, recorder)
    step_to_the_end(reader, recorder)
    assert recorder.frames == sample.frames
    assert reader.octets == len(sample.octets)
    assert reader.damage == ""


@given(st.sampled_from(sorted(PCAP_MAGICS)), st.binary(max_size=400), st.integers(1, 500))
def test_random_octets_never_raise(magic: bytes, octets: bytes, piece: int) -> None:
    drain(reader_of(magic + octets, piece))


WORDS: Final = st.integers(0, 2**32 - 1)


@given(
    st.booleans(),
    st.booleans(),
    st.lists(st.tuples(WORDS, WORDS, WORDS, st.binary(min_size=1, max_size=40)), min_size=1, max_size=5),
    st.integers(1, 500),
)
def test_whatever_a_record_says_its_packet_can_be(
    big: bool, nanoseconds: bool, records: list[tuple[int, int, int, bytes]], piece: int
) -> None:
    sample = Pcap(big, nanoseconds)
    for seconds, fraction, wire, octets in records:
        sample.add(sample.record(seconds, fraction, len(octets), wire, octets))
    frames = drain(reader_of(sample.octets, piece)).frames
    assert [frame.octets for frame in frames] == [octets for *_, octets in records]
    for frame in frames:
        assert 0 <= frame.time_ns < 2**63
        assert frame.wire_length >= len(frame.octets)


@given(
    st.sampled_from([name for name, sample in SAMPLES.items() if sample.frames]),
    st.lists(st.tuples(st.integers(4, 300), st.integers(0, 4), st.binary(max_size=5)), min_size=1, max_size=6),
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
    assert whole.damage == pieces.damage
    assert whole.notes == pieces.notes


@pytest.mark.parametrize("name", ["little", "big nanoseconds", "modified"])
def test_every_octet_changed_to_the_values_that_hurt(name: str) -> None:
    octets = SAMPLES[name].octets
    for at in range(4, len(octets)):
        old = octets[at]
        for new in {0, 1, 0x7F, 0x80, 0xFF, old ^ 1, old ^ 0x80, (old + 1) & 0xFF} - {old}:
            drain(reader_of(octets[:at] + bytes([new]) + octets[at + 1 :]))


@given(st.binary(min_size=4, max_size=40), st.data())
def test_the_index_reads_are_those_of_struct(octets: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(octets) - 4))
    assert u32le(octets, at) == struct.unpack_from("<I", octets, at)[0]


@pytest.mark.parametrize("kind", ["pcap", "nsecpcap", "modpcap"])
def test_files_written_by_editcap(kind: str, tmp_path: Path) -> None:
    editcap = shutil.which("editcap")
    if editcap is None:
        pytest.skip("editcap is not installed")
    sample = _filled(Pcap(big=True))
    (tmp_path / "in").write_bytes(sample.octets)
    subprocess.run([editcap, "-F", kind, tmp_path / "in", tmp_path / "out"], check=True, timeout=60)
    reader = reader_of((tmp_path / "out").read_bytes())
    assert drain(reader).frames == sample.frames
    assert reader.damage == ""
