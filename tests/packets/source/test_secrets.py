"""Decryption Secrets Blocks: read at any place, written where others can read them, and those that contradict themselves."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from dissect.packets.source.files import open_capture
from dissect.packets.source.pcapng import MAX_BLOCK, TLS_KEY_LOG
from dissect.packets.source.pcapng_writer import PcapngWriter, secrets_block
from tests.packets.source.craft import ETHERNET, NS, Pcapng, Recorder, reader_of, step_to_the_end

DSB = 10


class Secrets(Recorder):
    def __init__(self) -> None:
        super().__init__()
        self.secrets_at: list[tuple[int, bytes]] = []

    def secrets(self, text: bytes) -> None:
        self.secrets_at.append((len(self.frames), text))


def body(sample: Pcapng, text: bytes, kind: int = TLS_KEY_LOG, size: int | None = None) -> bytes:
    return struct.pack(f"{sample.order}II", kind, len(text) if size is None else size) + text


def read(sample: Pcapng, piece: int = 1 << 20) -> tuple[list[tuple[int, bytes]], int, list[str], int]:
    sink = Secrets()
    reader = reader_of(sample.octets, piece)
    step_to_the_end(reader, sink)
    assert reader.damage == ""
    return sink.secrets_at, len(sink.frames), list(reader.notes), int(reader.rejected)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("piece", [1 << 20, 5])
def test_blocks_at_any_place(big: bool, piece: int) -> None:
    sample = Pcapng(big)
    sample.block(DSB, body(sample, b"first"))
    sample.interface()
    sample.packet(NS, NS * 1000, b"packet")
    options = b"\0\1\0\3abc\0\0\0\0\0" if big else b"\1\0\3\0abc\0\0\0\0\0"
    sample.block(DSB, body(sample, b"second42") + options)
    sample.packet(NS, NS * 1000, b"packet")
    sample.section(not big)
    sample.block(DSB, body(sample, b""))
    assert read(sample, piece) == ([(0, b"first"), (1, b"second42"), (2, b"")], 2, [], 0)


def test_secrets_of_other_protocols_are_left() -> None:
    sample = Pcapng()
    for kind in (0x5353484B, 0x57474B4C, 0):
        sample.block(DSB, body(sample, b"another", kind))
    assert read(sample) == ([], 0, [], 0)


def test_blocks_that_contradict_themselves_are_given_up_alone() -> None:
    sample = Pcapng()
    sample.interface()
    sample.block(DSB, b"")
    sample.block(DSB, struct.pack("<I", TLS_KEY_LOG))
    sample.block(DSB, body(sample, b"text", size=5))
    sample.block(DSB, body(sample, b"text", size=0xFFFFFFFF))
    sample.packet(NS, NS * 1000, b"packet")
    sample.block(DSB, body(sample, b"good"))
    found, packets, notes, rejected = read(sample)
    assert (found, packets, rejected) == ([(1, b"good")], 1, 4)
    assert len(notes) == 2


@pytest.mark.parametrize("text", [b"", b"a", b"line\n", bytes(4096)])
def test_what_is_written_is_read(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "file.pcapng"
    writer = PcapngWriter(str(path))
    writer.secrets(text)
    writer.packet(1, b"packet", 6, ETHERNET)
    writer.secrets(text + b"!")
    writer.close()
    sink = Secrets()
    reader = open_capture(str(path))
    step_to_the_end(reader, sink)
    reader.close()
    assert sink.secrets_at == [(0, text), (1, text + b"!")]
    octets = path.read_bytes()
    assert octets.index(struct.pack("<I", 1), 28) < octets.index(b"KSLT")  # behind the interface


def test_nothing_is_written_for_a_file_without_packets(tmp_path: Path) -> None:
    path = tmp_path / "file.pcapng"
    writer = PcapngWriter(str(path))
    writer.secrets(b"text")
    writer.close()
    assert b"text" not in path.read_bytes()


def test_a_key_log_that_no_block_holds() -> None:
    with pytest.raises(ValueError, match="larger than a pcapng block may be"):
        secrets_block(bytes(MAX_BLOCK))
    assert len(secrets_block(bytes(MAX_BLOCK - 20))) == MAX_BLOCK
