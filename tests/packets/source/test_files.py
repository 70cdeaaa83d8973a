from __future__ import annotations

import csv
import errno
import gzip
import hashlib
import io
import os
import random
import shutil
import struct
import subprocess
import sys
import threading
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import dpkt
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.source import files
from dissect.packets.source.files import MAX_ZSTD_WINDOW, GzipSource, PlainSource, ZstdSource, open_capture
from dissect.packets.source.packet import CaptureError, Reader
from dissect.packets.source.pcap import CHUNK, OctetSource, PcapReader
from dissect.packets.source.pcapng import PcapngReader
from tests.packets.source.craft import EPOCH, NS, Frame, MemorySource, Pcap, Pcapng, Recorder, drain, step_to_the_end

#: As the corpus lists them, so that each file is a test of its own and is missed when it is gone.
CORPUS: Final = (
    "cotp_unknown_payload_rst.pcapng",
    "mms_header_in_own_segment.pcap",
    "mms_one_sided_read_request.pcap",
    "plc4x_manual_test_tpdu_nr.pcapng",
    "rdp-proprietary-encryption.pcap",
    "s7comm_and_s7commplus_sll.pcap",
    "s7comm_clean.pcap",
    "s7comm_downloading_block_db1.pcap",
    "s7comm_reading_plc_status.pcap",
    "s7comm_reading_setting_plc_time.pcap",
    "s7comm_varservice_libnodavedemo.pcap",
    "s7commplus_1511_opc_all_types.pcap",
    "s7ident_refused_upload.pcap",
    "scanner_two_connections.pcap",
    "step7_s300_AuthPassword.pcapng",
    "step7_s300_rwVarTab.pcapng",
    "step7_s300_stop.pcapng",
    "tia_s300_goOnline.pcapng",
    "water_pump_hmi.pcapng",
    "wincc_s300_setup-alarm-read-write.pcapng",
)


def _pcap() -> Pcap:
    sample = Pcap()
    noise = random.Random(7)
    for number in range(8):
        sample.packet(EPOCH * NS + number * 1000, noise.randbytes(number * 9))
    return sample


def _pcapng() -> Pcapng:
    sample = Pcapng(big=True)
    sample.interface()
    for number, frame in enumerate(_pcap().frames):
        comment = sample.option(1, b"comment") if number == 2 else b""
        sample.packet(frame.time_ns // 1000, frame.time_ns, frame.octets, options=comment)
    return sample


SAMPLES: Final = {"pcap": _pcap(), "pcapng": _pcapng()}


def _zstd(octets: bytes, write_checksum: bool = True) -> bytes:
    """Compress into one zstd frame of many blocks and without a content size, as a pipe does that is flushed now and then."""
    compressor = zstandard.ZstdCompressor(write_checksum=write_checksum).compressobj()
    blocks = [
        compressor.compress(octets[at : at + 100]) + compressor.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
        for at in range(0, len(octets), 100)
    ]
    return b"".join(blocks) + compressor.flush()


def _members(octets: bytes) -> bytes:
    """Compress with gzip, a member of its own for every 100 octets, an empty one among them, and padding at the end."""
    parts = [octets[at : at + 100] for at in range(0, len(octets), 100)]
    parts.insert(1, b"")
    return b"".join(gzip.compress(part, mtime=0) for part in parts) + bytes(512)


def _frames(octets: bytes) -> bytes:
    """Compress with zstd, a frame of its own for every 100 octets, with and without its size, and frames to skip."""
    skipped = struct.pack("<II", 0x184D2A5F, 30) + bytes(30)
    compressors = [zstandard.ZstdCompressor(write_checksum=True, write_content_size=size) for size in (True, False)]
    parts = [octets[at : at + 100] for at in range(0, len(octets), 100)]
    return skipped + b"".join(compressors[number % 2].compress(part) + skipped for number, part in enumerate(parts))


COMPRESSIONS: Final[dict[str, Callable[[bytes], bytes]]] = {
    "plain": lambda octets: octets,
    "gzip": lambda octets: gzip.compress(octets, mtime=0),
    "gzip members": _members,
    "zstd": _zstd,
    "zstd frames": _frames,
    "zstd without checksum": lambda octets: _zstd(octets, write_checksum=False),
}

each_sample = pytest.mark.parametrize("sample", SAMPLES.values(), ids=SAMPLES)
each_compression = pytest.mark.parametrize("compression", COMPRESSIONS)


def _opened(path: Path) -> Reader | None:
    """Open, or give None when it is refused in one line that names the file."""
    try:
        return open_capture(str(path))
    except CaptureError as error:
        line = str(error)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    return None


def _read_all(path: Path) -> tuple[Reader, Recorder]:
    reader = open_capture(str(path))
    return reader, drain(reader)


@contextmanager
def _piped(octets: bytes, piece: int) -> Iterator[int]:
    """Give a file descriptor on which ``octets`` arrive ``piece`` at a time."""
    out, into = os.pipe()

    def write() -> None:
        try:
            for at in range(0, len(octets), piece):
                os.write(into, octets[at : at + piece])
        except BrokenPipeError:
            pass
        finally:
            os.close(into)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        yield out
    finally:
        os.close(out)
        writer.join()


@each_sample
@each_compression
def test_what_a_file_holds_is_told_by_its_content(sample: Pcap | Pcapng, compression: str, tmp_path: Path) -> None:
    path = tmp_path / "capture.txt"
    path.write_bytes(COMPRESSIONS[compression](sample.octets))
    reader, recorder = _read_all(path)
    assert isinstance(reader, PcapReader if isinstance(sample, Pcap) else PcapngReader)
    assert recorder.frames == sample.frames
    assert recorder.comments == ([] if isinstance(sample, Pcap) else [(3, "comment")])
    assert reader.damage == ""
    assert reader.octets == len(sample.octets)


@each_sample
@each_compression
@pytest.mark.parametrize("piece", [1, 5, 1 << 16])
def test_standard_input_may_be_a_pipe(
    sample: Pcap | Pcapng, compression: str, piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with _piped(COMPRESSIONS[compression](sample.octets), piece) as out, os.fdopen(os.dup(out), "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        reader = open_capture("-")
        assert drain(reader).frames == sample.frames
        assert reader.damage == ""
        # It is not ours to close.
        assert os.fstat(stdin.fileno())


def test_standard_input_may_be_held_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = SAMPLES["pcap"]
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(sample.octets)))
    assert drain(open_capture("-")).frames == sample.frames


def test_a_pipe_that_does_not_wait_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = SAMPLES["pcap"]
    out, into = os.pipe()
    os.set_blocking(out, False)

    def write() -> None:
        os.write(into, sample.octets)
        os.close(into)

    late = threading.Timer(0.05, write)
    late.start()
    with os.fdopen(out, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert drain(open_capture("-")).frames == sample.frames
    late.join()


def test_a_named_pipe_delivers_what_was_written_so_far(tmp_path: Path) -> None:
    sample = SAMPLES["pcap"]
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    delivered = threading.Event()
    half = sample.ends[3]

    def write() -> None:
        with fifo.open("wb", buffering=0) as stream:
            stream.write(sample.octets[:half])
            assert delivered.wait(20)
            stream.write(sample.octets[half:])

    writer = threading.Thread(target=write)
    writer.start()
    reader = open_capture(str(fifo))
    recorder = Recorder()
    assert reader.step(recorder)
    assert recorder.frames == sample.frames[:4]
    delivered.set()
    step_to_the_end(reader, recorder)
    writer.join()
    assert recorder.frames == sample.frames
    assert reader.damage == ""


@each_sample
@each_compression
def test_cut_anywhere_gives_the_whole_records_and_tells(
    sample: Pcap | Pcapng, compression: str, tmp_path: Path
) -> None:
    whole = COMPRESSIONS[compression](sample.octets)
    path = tmp_path / "cut"
    seen = 0
    for size in range(1, len(whole)):
        path.write_bytes(whole[:size])
        reader = _opened(path)
        if reader is None:
            assert seen == 0, "refused is only what holds not even four bytes of capture"
            continue
        frames = drain(reader).frames
        assert frames == sample.frames_before(reader.octets)
        assert reader.octets >= seen, "less was read of more"
        seen = reader.octets
        if compression == "plain":
            assert (reader.damage == "") == (size in sample.boundaries)
        elif "members" in compression or "frames" in compression:
            assert reader.damage or reader.octets in sample.boundaries
        else:
            assert reader.damage.startswith(f"the {compression[:4]} data is cut off at byte {size}")
            inside = reader.octets not in sample.boundaries
            assert ("; the capture that could be read ends at byte" in reader.damage) == inside
    assert seen > len(sample.octets) - 100, "the last block, member or frame is all that may be lost"


@pytest.mark.parametrize("compression", ["gzip", "gzip members", "zstd", "zstd frames"])
def test_every_octet_of_compressed_data_changed(compression: str) -> None:
    sample = SAMPLES["pcapng"]
    whole = COMPRESSIONS[compression](sample.octets)
    outcomes = {"refused": 0, "damaged": 0, "unharmed": 0}
    for at in range(len(whole)):
        for new in {0, 0xFF, whole[at] ^ 1, whole[at] ^ 0x80} - {whole[at]}:
            try:
                reader = files.find_reader(MemorySource(whole[:at] + bytes([new]) + whole[at + 1 :]), "x")
            except CaptureError:
                outcomes["refused"] += 1
                continue
            frames = drain(reader).frames
            if reader.damage:
                outcomes["damaged"] += 1
            else:
                outcomes["unharmed"] += 1
                assert frames == sample.frames, "all of these have checksums: no change of the content goes unseen"
    assert all(outcomes.values())


def test_corrupt_gzip_gives_all_that_stands_before(tmp_path: Path) -> None:
    sample = Pcap()
    noise = random.Random(3)
    for _ in range(3000):
        sample.packet(EPOCH * NS, noise.randbytes(100))
    whole = bytearray(gzip.compress(sample.octets, mtime=0))
    path = tmp_path / "bad.gz"
    # A wrong checksum costs nothing.
    whole[-8] ^= 1
    path.write_bytes(whole)
    reader, recorder = _read_all(path)
    assert recorder.frames == sample.frames
    assert reader.damage.startswith("the gzip data is corrupt at byte ")
    assert "(incorrect data check)" in reader.damage
    # A block type that does not exist, in the middle: found by the decompressor alone.
    stored = zlib.compressobj(0, wbits=31)
    front = stored.compress(sample.octets[:200_000]) + stored.flush(zlib.Z_FULL_FLUSH)
    path.write_bytes(front + b"\x07" + bytes(1000))
    reader, recorder = _read_all(path)
    assert recorder.frames == sample.frames_before(200_000)
    assert reader.octets == 200_000
    assert reader.damage.startswith(
        f"the gzip data is corrupt at byte {len(front)} (invalid block type); the capture that could be read ends"
    )


def test_corrupt_zstd_gives_all_that_stands_before(tmp_path: Path) -> None:
    sample = Pcap()
    noise = random.Random(3)
    for _ in range(3000):
        sample.packet(EPOCH * NS, noise.randbytes(100))
    whole = bytearray(zstandard.ZstdCompressor(write_checksum=True).compress(sample.octets))
    path = tmp_path / "bad.zst"
    whole[-1] ^= 1
    path.write_bytes(whole)
    reader, recorder = _read_all(path)
    assert recorder.frames == sample.frames
    assert reader.damage.startswith("the zstd data is corrupt between bytes ")
    assert "checksum" in reader.damage
    # The second block claims the type that is reserved.
    header = zstandard.frame_header_size(bytes(whole))
    (word,) = struct.unpack_from("<I", whole, header)
    second = header + 3 + ((word & 0xFFFFFF) >> 3)
    whole[second] |= 6
    path.write_bytes(whole)
    reader, recorder = _read_all(path)
    assert recorder.frames == sample.frames_before(128 * 1024)
    assert reader.octets == 128 * 1024
    assert reader.damage.startswith(f"the zstd data is corrupt between bytes {second} and ")


@pytest.mark.parametrize("compression", ["gzip", "gzip members", "zstd", "zstd frames"])
def test_what_follows_compressed_data_is_left_out_and_told(compression: str, tmp_path: Path) -> None:
    sample = SAMPLES["pcap"]
    path = tmp_path / "capture"
    whole = COMPRESSIONS[compression](sample.octets)
    path.write_bytes(whole + b"trailing octets")
    reader, recorder = _read_all(path)
    assert recorder.frames == sample.frames
    assert (
        reader.damage
        == f"the {compression[:4]} data ends at byte {len(whole)}; the data after it is not compressed data and was ignored"
    )


@given(st.sampled_from(["gzip", "zstd"]), st.binary(max_size=300), st.integers(1, 400))
def test_random_compressed_octets_never_raise(compression: str, octets: bytes, piece: int) -> None:
    front = {"gzip": b"\x1f\x8b\x08\0\0\0\0\0\0\xff", "zstd": b"\x28\xb5\x2f\xfd"}[compression]
    source = MemorySource(front + octets, piece)
    inner: OctetSource = GzipSource(source, b"") if compression == "gzip" else ZstdSource(source, b"")
    while inner.read(CHUNK):
        pass
    assert not inner.read(CHUNK)


@given(
    st.sampled_from([name for name in COMPRESSIONS if name != "plain"]),
    st.lists(st.tuples(st.integers(4, 500), st.integers(0, 4), st.binary(max_size=5)), min_size=1, max_size=4),
    st.integers(1, 400),
)
def test_mutated_compressed_octets_never_raise_and_pieces_change_no_octet(
    compression: str, mutations: list[tuple[int, int, bytes]], piece: int
) -> None:
    octets = COMPRESSIONS[compression](SAMPLES["pcapng"].octets)
    for at, removed, inserted in mutations:
        octets = octets[:at] + inserted + octets[at + removed :]

    def decompressed(size: int) -> tuple[bytes, str]:
        kind = GzipSource if compression.startswith("gzip") else ZstdSource
        source = kind(MemorySource(octets, size), b"")
        return b"".join(iter(lambda: source.read(CHUNK), b"")), source.damage

    assert decompressed(1 << 20) == decompressed(piece)


def _peak_of_reading(source: OctetSource) -> tuple[int, int, int]:
    """Give (octets read, largest piece, peak of memory) of reading ``source`` to its end."""
    total = largest = 0
    tracemalloc.start()
    try:
        while piece := source.read(CHUNK):
            total += len(piece)
            largest = max(largest, len(piece))
            del piece
        return total, largest, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_gzip_bomb_is_read_a_piece_at_a_time() -> None:
    compressor = zlib.compressobj(9, wbits=31)
    bomb = b"".join(compressor.compress(bytes(1 << 20)) for _ in range(64)) + compressor.flush()
    assert len(bomb) < 70_000
    source = GzipSource(MemorySource(bomb), b"")
    total, largest, peak = _peak_of_reading(source)
    assert total == 64 << 20
    assert source.damage == ""
    assert largest <= CHUNK
    assert peak < 1 << 20


@pytest.mark.parametrize("size", [1, 100, 1000])
def test_what_gzip_holds_back_inside_is_given_before_the_cut_is_told(size: int) -> None:
    cut = gzip.compress(bytes(50_000), mtime=0)[:-8]
    source = GzipSource(MemorySource(cut), b"")
    assert b"".join(iter(lambda: source.read(size), b"")) == bytes(50_000)
    assert source.damage == f"the gzip data is cut off at byte {len(cut)}"


@pytest.mark.parametrize("size", [0, 4])
def test_a_zstd_file_may_end_with_a_frame_to_skip(size: int, tmp_path: Path) -> None:
    path = tmp_path / "sample"
    last = b"\x50\x2a\x4d\x18" + size.to_bytes(4, "little") + bytes(size)
    path.write_bytes(_zstd(SAMPLES["pcap"].octets) + last)
    reader, recorder = _read_all(path)
    assert (recorder.frames, reader.damage) == (SAMPLES["pcap"].frames, "")
    path.write_bytes(path.read_bytes()[:-1])
    assert "the zstd data is cut off" in _read_all(path)[0].damage


def test_a_zstd_bomb_is_read_a_piece_at_a_time() -> None:
    # A window of 128 KiB, then blocks of one octet repeated 131,072 times: four octets each.
    block = struct.pack("<I", (1 << 17 << 3 | 1 << 1) & 0xFFFFFF)
    last = struct.pack("<I", (1 << 17 << 3 | 1 << 1 | 1) & 0xFFFFFF)
    bomb = b"\x28\xb5\x2f\xfd\x00" + bytes([7 << 3]) + block * 1023 + last
    assert len(bomb) < 5000
    source = ZstdSource(MemorySource(bomb), b"")
    total, largest, peak = _peak_of_reading(source)
    assert total == 1024 << 17
    assert source.damage == ""
    assert largest <= 1 << 17
    assert peak < 1 << 20


def test_a_bomb_of_no_capture_ends_at_its_first_record(tmp_path: Path) -> None:
    path = tmp_path / "bomb"
    compressor = zlib.compressobj(9, wbits=31)
    front = SAMPLES["pcapng"].octets
    path.write_bytes(
        compressor.compress(front)
        + b"".join(compressor.compress(bytes(1 << 20)) for _ in range(16))
        + compressor.flush()
    )
    reader, recorder = _read_all(path)
    assert recorder.frames == SAMPLES["pcapng"].frames
    assert reader.damage == f"damaged at byte {len(front)}, after 8 packets: a block claims a length of 0 bytes"
    assert reader.octets <= 2 * CHUNK


@pytest.mark.parametrize("single", [False, True], ids=["window", "content size"])
def test_a_zstd_window_has_a_limit(single: bool, tmp_path: Path) -> None:
    size = MAX_ZSTD_WINDOW + (MAX_ZSTD_WINDOW >> 3)
    header = b"\xa0" + struct.pack("<I", size) if single else b"\0" + bytes([15 << 3 | 1])
    path = tmp_path / "wide.zst"
    path.write_bytes(b"\x28\xb5\x2f\xfd" + header + bytes(100))
    with pytest.raises(
        CaptureError, match=r"needs a window of 36 MiB, more than the 32 allowed; decompress it first: zstd -d"
    ):
        open_capture(str(path))
    path.write_bytes(_zstd(SAMPLES["pcap"].octets) + path.read_bytes())
    reader, recorder = _read_all(path)
    assert recorder.frames == SAMPLES["pcap"].frames
    assert "needs a window of 36 MiB" in reader.damage


def test_the_widest_zstd_window_allowed(tmp_path: Path) -> None:
    parameters = zstandard.ZstdCompressionParameters(window_log=25, write_content_size=False)
    compressor = zstandard.ZstdCompressor(compression_params=parameters).compressobj()
    path = tmp_path / "wide.zst"
    path.write_bytes(compressor.compress(SAMPLES["pcap"].octets) + compressor.flush())
    assert _read_all(path)[1].frames == SAMPLES["pcap"].frames


def test_zstd_without_its_package_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "capture"
    path.write_bytes(_zstd(SAMPLES["pcap"].octets))
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(CaptureError) as caught:
        open_capture(str(path))
    assert str(caught.value) == f"{path}: a zstd file, which needs one more package: pip install 's7dissect[zstd]'"


@pytest.mark.parametrize("outer", ["gzip", "zstd"])
@pytest.mark.parametrize("inner", ["gzip", "zstd", "zstd frames"])
def test_compressed_twice_is_not_followed(outer: str, inner: str, tmp_path: Path) -> None:
    path = tmp_path / "capture"
    path.write_bytes(COMPRESSIONS[outer](COMPRESSIONS[inner](SAMPLES["pcap"].octets)))
    with pytest.raises(CaptureError, match="compressed twice; decompress it once first"):
        open_capture(str(path))


@pytest.mark.parametrize(
    ("octets", "reason"),
    [
        (b"", "empty"),
        (b"\xd4\xc3\xb2", "only 3 bytes, not a capture"),
        (b"Hello, I am no capture at all", "not a capture file (pcap or pcapng, plain or in gzip or zstd)"),
        (bytes(1000), "not a capture file (pcap or pcapng, plain or in gzip or zstd)"),
        (b"\n\r\r\n" + bytes(100), "not a capture file (pcap or pcapng, plain or in gzip or zstd)"),
        (gzip.compress(b"", mtime=0), "empty"),
        (gzip.compress(b"text", mtime=0), "not a capture file (pcap or pcapng, plain or in gzip or zstd)"),
        (gzip.compress(b"text", mtime=0)[:11], "the gzip data is cut off at byte 11"),
        (_zstd(b""), "empty"),
        (_zstd(b"some text")[:12], "the zstd data is cut off at byte 12"),
        (b"BZh91AY&SY", "a bzip2 file; decompress it first"),
        (b"snoop\0\0\0\0\0\0\2", "a snoop file; convert it first: editcap -F pcapng OLD NEW"),
    ],
)
def test_what_is_no_capture_is_said_in_one_line(octets: bytes, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "capture.pcap"
    path.write_bytes(octets)
    with pytest.raises(CaptureError) as caught:
        open_capture(str(path))
    assert str(caught.value) == f"{path}: {reason}"


def test_paths_that_cannot_be_opened_are_said_in_one_line(tmp_path: Path) -> None:
    for path, reason in {
        str(tmp_path / "missing"): "no such file",
        str(tmp_path): "a directory, not a capture file",
        "nul\0character": "not a file name: embedded null byte",
        str(tmp_path / ("x" * 300)): "cannot be opened: File name too long",
    }.items():
        with pytest.raises(CaptureError) as caught:
            open_capture(path)
        assert str(caught.value) == f"{path}: {reason}"


def test_a_file_without_permission_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "secret"
    path.write_bytes(b"x")
    path.chmod(0)
    if os.access(path, os.R_OK):
        # Root may read everything: let the system say what it says to others.
        def refuse(*_arguments: object, **_options: object) -> None:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

        monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(CaptureError) as caught:
        open_capture(str(path))
    assert str(caught.value) == f"{path}: no permission to read it"


@pytest.mark.parametrize("octets", [b"", b"no capture"])
def test_standard_input_is_named_when_it_holds_nothing(octets: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(octets)))
    with pytest.raises(CaptureError, match=r"^standard input: (empty|not a capture file .*)$"):
        open_capture("-")


def test_standard_input_that_is_closed_or_a_terminal_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(CaptureError, match=r"^standard input: closed$"):
        open_capture("-")
    primary, secondary = os.openpty()
    with os.fdopen(primary, "rb"), os.fdopen(secondary, "r") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        with pytest.raises(CaptureError, match=r"^standard input: a terminal; pipe a capture into it$"):
            open_capture("-")


class _FailingStream:
    """A disk that fails after some octets."""

    def __init__(self, octets: bytes) -> None:
        self.closed = 0
        self._octets = octets

    def read(self, size: int, /) -> bytes:
        if not self._octets:
            raise OSError(errno.EIO, "Input/output error")
        octets, self._octets = self._octets[:size], self._octets[size:]
        return octets

    def fileno(self) -> int:
        raise OSError

    def close(self) -> None:
        self.closed += 1


@pytest.mark.parametrize("compression", ["plain", "gzip", "zstd"])
def test_a_failing_disk_is_told_and_costs_only_what_was_not_read(compression: str) -> None:
    sample = SAMPLES["pcap"]
    whole = COMPRESSIONS[compression](sample.octets)
    stream = _FailingStream(whole[:-1])
    reader = files.find_reader(PlainSource(stream, owned=True), "x")
    frames = drain(reader).frames
    assert frames == sample.frames_before(reader.octets)
    assert reader.damage.startswith(f"reading failed after byte {len(whole) - 1}: Input/output error")
    assert stream.closed


def test_a_disk_that_fails_at_once_is_no_capture() -> None:
    with pytest.raises(CaptureError, match=r"^x: reading failed after byte 0: Input/output error$"):
        files.find_reader(PlainSource(_FailingStream(b""), owned=True), "x")


@each_compression
def test_files_are_closed_at_the_end_when_told_and_when_refused(compression: str, tmp_path: Path) -> None:
    descriptors = Path("/proc/self/fd")
    if not descriptors.is_dir():
        pytest.skip("open files cannot be counted here")
    path = tmp_path / "capture"
    before = len(list(descriptors.iterdir()))
    path.write_bytes(COMPRESSIONS[compression](SAMPLES["pcap"].octets))
    reader = open_capture(str(path))
    assert len(list(descriptors.iterdir())) == before + 1
    step_to_the_end(reader, Recorder())
    assert len(list(descriptors.iterdir())) == before
    reader = open_capture(str(path))
    reader.close()
    assert not reader.step(Recorder())
    path.write_bytes(COMPRESSIONS[compression](b"no capture"))
    with pytest.raises(CaptureError):
        open_capture(str(path))
    assert len(list(descriptors.iterdir())) == before


def test_a_large_file_is_never_held_whole(tmp_path: Path) -> None:
    sample = Pcap()
    record = sample.record(EPOCH, 0, 1500, 1500, bytes(1500))
    path = tmp_path / "large"
    path.write_bytes(sample.octets + record * 10_000)

    class Counter(Recorder):
        count = 0

        def frame(self, *_packet: object) -> None:
            self.count += 1

    reader = open_capture(str(path))
    sink = Counter()
    tracemalloc.start()
    try:
        step_to_the_end(reader, sink)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert sink.count == reader.packets == 10_000
    assert peak < 1 << 20


def _listed(corpus: Path) -> dict[str, dict[str, str]]:
    with (corpus / "SOURCES.tsv").open(encoding="utf-8", newline="") as stream:
        return {row["file"]: row for row in csv.DictReader(stream, delimiter="\t")}


def test_every_shared_capture_is_tested(corpus: Path) -> None:
    assert set(_listed(corpus)) == set(CORPUS)


@pytest.mark.parametrize("name", CORPUS)
def test_a_shared_capture_is_read_as_dpkt_reads_it(name: str, corpus: Path) -> None:
    path = corpus / name
    row = _listed(corpus)[name]
    assert hashlib.sha256(path.read_bytes()).hexdigest() == row["sha256"]
    reader, recorder = _read_all(path)
    assert reader.packets == int(row["packets"])
    assert reader.octets == int(row["bytes"])
    assert (reader.damage, reader.notes, reader.rejected) == ("", [], 0)
    with path.open("rb") as stream:
        theirs = dpkt.pcap.UniversalReader(stream)
        expected = [(time, octets) for time, octets in theirs]
        link_type = theirs.datalink()
    assert [octets for _, octets in expected] == [frame.octets for frame in recorder.frames]
    # dpkt's times are floating-point seconds: as large as these, they are exact to the microsecond.
    for (time, _), frame in zip(expected, recorder.frames, strict=True):
        assert abs(time * NS - frame.time_ns) < 1000
    assert {frame.link_type for frame in recorder.frames} == {link_type}


def test_the_comments_and_nanoseconds_of_a_shared_capture(corpus: Path) -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("tshark is not installed")
    path = corpus / "water_pump_hmi.pcapng"
    recorder = _read_all(path)[1]
    fields = [
        part for field in ("frame.number", "frame.time_epoch", "frame.len", "frame.comment") for part in ("-e", field)
    ]
    command = [tshark, "-n", "-r", str(path), "-T", "fields", *fields]
    output = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout
    rows = [line.split("\t") for line in output.splitlines()]
    assert recorder.comments == [(int(number), text) for number, _, _, text in rows if text] != []
    assert [(frame.time_ns, frame.wire_length) for frame in recorder.frames] == [
        (int(time.replace(".", "")), int(wire)) for _, time, wire, _ in rows
    ]


def _written(editcap: str, kind: str, source: Path, target: Path) -> list[Frame]:
    subprocess.run([editcap, "-F", kind, source, target], check=True, timeout=60)
    reader, recorder = _read_all(target)
    assert reader.damage == ""
    return recorder.frames


@pytest.mark.parametrize("name", ["s7comm_and_s7commplus_sll.pcap", "plc4x_manual_test_tpdu_nr.pcapng"])
def test_a_shared_capture_in_every_form(name: str, corpus: Path, tmp_path: Path) -> None:
    frames = _read_all(corpus / name)[1].frames
    for compression, compress in COMPRESSIONS.items():
        path = tmp_path / compression
        path.write_bytes(compress((corpus / name).read_bytes()))
        reader, recorder = _read_all(path)
        assert recorder.frames == frames
        assert reader.damage == ""
    editcap = shutil.which("editcap")
    if editcap is None:
        pytest.skip("editcap is not installed")
    for kind in ("pcap", "nsecpcap", "modpcap", "pcapng"):
        assert _written(editcap, kind, corpus / name, tmp_path / kind) == frames
