"""The endless streams: sound frames, the same each time, and each really what it is named for."""

from __future__ import annotations

import io
import tracemalloc
from itertools import islice, pairwise
from pathlib import Path

import pytest

from benchmarks.profiles import Extent, main, parse_extent, write_profile
from benchmarks.readers import read_capture
from benchmarks.streams import ENDLESS, MTU, NAMES, SMALL, flood_packets, stream, why
from tests.benchmarks.independent import checksums_right

SYN, ACK, FIN, RST = 2, 16, 1, 4


def first(name: str, count: int, size: int = SMALL) -> list[bytes]:
    return [frame for _, frame in islice(stream(name, size), count)]


def flags(frame: bytes) -> int:
    return frame[47]


def ends(frame: bytes) -> bytes:
    return frame[26:38]


def payload(frame: bytes) -> bytes:
    return frame[34 + (frame[46] >> 4) * 4 :]


@pytest.mark.parametrize("name", NAMES)
def test_frames_are_sound_and_repeatable(name: str) -> None:
    packets = list(islice(stream(name), 3_000))
    assert packets == list(islice(stream(name), 3_000))
    assert [time_ns for time_ns, _ in packets] == sorted(time_ns for time_ns, _ in packets)
    for _, frame in packets:
        assert frame[12:14] == b"\x08\x00"
        assert 14 + int.from_bytes(frame[16:18], "big") == len(frame)
        whole = not int.from_bytes(frame[20:22], "big") & 0x3FFF
        assert checksums_right(frame) or not whole


@pytest.mark.parametrize("name", NAMES)
def test_streams_hold_nothing(name: str) -> None:
    frames = stream(name)
    for _ in islice(frames, 20_000):
        pass
    tracemalloc.start()
    for _ in islice(frames, 5_000):
        pass
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 25_000


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("synflood", "neverclose")])
def test_large_frames_fill_the_mtu(name: str) -> None:
    sizes = sorted(len(frame) for frame in first(name, 4_000, MTU))
    assert sizes[-1] <= 1514
    assert sizes[len(sizes) // 2] > 1000 or name in ("normal", "halftpkt")
    assert sizes[-1] > 1300


def test_normal_opens_and_ends_connections() -> None:
    frames = first("normal", 3_400)
    opened = sum(1 for frame in frames if flags(frame) == SYN)
    ended = sum(1 for frame in frames if flags(frame) & RST) + sum(1 for frame in frames if flags(frame) & FIN) // 2
    assert opened > 90
    assert opened - 1 <= ended <= opened
    assert len({ends(frame) for frame in frames if flags(frame) == SYN}) == opened


def test_synflood_is_nothing_but_first_packets_of_strangers() -> None:
    frames = first("synflood", 5_000)
    assert {flags(frame) for frame in frames} == {SYN}
    assert len({ends(frame) for frame in frames}) > 4_990


def test_neverclose_never_closes() -> None:
    frames = first("neverclose", 5_000)
    assert not any(flags(frame) & (FIN | RST) for frame in frames)
    assert sum(1 for frame in frames if flags(frame) == SYN) > 300


def test_unanswered_has_requests_alone() -> None:
    frames = first("unanswered", 5_000)[16 * 7 :]
    assert {payload(frame)[7:9] for frame in frames} == {b"\x32\x01"}
    assert all(frame[36:38] == b"\x00\x66" for frame in frames)


def test_half_tpkts_are_never_finished() -> None:
    frames = [frame for frame in first("halftpkt", 3_000) if payload(frame)]
    assert len({ends(frame) for frame in frames}) == len(frames) == 1_000
    assert all(int.from_bytes(payload(frame)[2:4], "big") > len(payload(frame)) for frame in frames)


def test_never_ended_tsdus_have_no_end() -> None:
    frames = first("eotnever", 1_000)[7:]
    assert all(payload(frame)[4:7] == b"\x02\xf0\x00" and len(payload(frame)) > 7 for frame in frames)


def test_holes_are_between_all_segments_and_nobody_acknowledges_them() -> None:
    frames = first("holes", 2_000)[8 * 7 :]
    by_sender: dict[bytes, list[bytes]] = {}
    for frame in frames:
        by_sender.setdefault(ends(frame), []).append(frame)
    assert len(by_sender) == 8
    for sent in by_sender.values():
        for before, after in pairwise(sent):
            expected = int.from_bytes(before[38:42], "big") + len(payload(before))
            assert int.from_bytes(after[38:42], "big") != expected & 0xFFFFFFFF


def test_fragments_never_end_their_datagram() -> None:
    fields = [int.from_bytes(frame[20:22], "big") for frame in first("ipfrag", 3_000)]
    assert all(field & 0x2000 for field in fields)
    offsets = [field & 0x1FFF for field in fields]
    assert offsets.count(0) == 1_500
    assert len(set(offsets)) == 1_501


def test_a_flood_is_made_of_whole_rounds() -> None:
    frames = first("badpdu", flood_packets(3) + 1)
    assert payload(frames[-1]) == payload(frames[4 * 7])
    assert [payload(frame) for frame in frames[flood_packets(1) : flood_packets(2)]] == [
        payload(frame) for frame in frames[flood_packets(2) : flood_packets(3)]
    ]


def test_bad_pdus_are_bad_in_many_ways() -> None:
    pdus = {payload(frame)[7:] for frame in first("badpdu", 500)[4 * 7 :]}
    assert len(pdus) == 12
    wrong = 0
    for pdu in pdus:
        head = 12 if pdu[1] in (2, 3) else 10
        claimed = head + int.from_bytes(pdu[6:8], "big") + int.from_bytes(pdu[8:10], "big") if len(pdu) >= 10 else -1
        wrong += claimed != len(pdu)
    # The others tell the PDU's size rightly and lie within it, but for an unknown ROSCTR.
    assert wrong == 4


def test_a_profile_is_written_by_packets_and_by_size() -> None:
    file = io.BytesIO()
    assert write_profile(file, "eotnever", Extent(packets=100)) == 100
    by_size = io.BytesIO()
    write_profile(by_size, "eotnever", Extent(octets=100_000))
    assert 100_000 <= len(by_size.getvalue()) < 100_300


def test_the_command_writes_a_capture(tmp_path: Path) -> None:
    path = tmp_path / "holes.pcap"
    assert main(["holes", "2k", str(path)]) == 0
    link_type, packets = read_capture(path)
    assert (link_type, len(packets)) == (1, 2_000)
    assert [frame for _, frame, _ in packets] == first("holes", 2_000)


def test_extents_as_people_write_them() -> None:
    assert parse_extent("0.5GiB").octets == 1 << 29
    assert parse_extent("20k").packets == 20_000
    for text in ("GiB", "-1GiB", "1MB", "0GiB"):
        with pytest.raises(Exception, match=r"no size|no number"):
            parse_extent(text)


def test_every_stream_says_what_it_hurts() -> None:
    assert len(ENDLESS) == 8
    assert all("Hurts" in why(name) for name in NAMES)


def test_an_unknown_stream_is_refused() -> None:
    with pytest.raises(ValueError, match="no profile"):
        stream("nothing")
