from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from dissect.files.anonymize.key import MAX_KEY, MIN_KEY, read_key


def test_all_octets_of_a_key_count(tmp_path: Path) -> None:
    path = tmp_path / "key"
    streams = set()
    for octets in (bytes(MIN_KEY), bytes(MIN_KEY + 1), bytes(MAX_KEY), bytes(MAX_KEY - 1) + b"\1"):
        path.write_bytes(octets)
        streams.add(read_key(str(path)).stream("x", b"", 16))
    assert len(streams) == 4


@pytest.mark.parametrize(
    ("size", "why"), [(0, "0 bytes, a key needs 16"), (15, "15 bytes"), (MAX_KEY + 1, "more than")]
)
def test_a_key_has_a_size(tmp_path: Path, size: int, why: str) -> None:
    path = tmp_path / "key"
    path.write_bytes(bytes(size))
    with pytest.raises(ValueError, match=why):
        read_key(str(path))


def test_a_key_that_never_ends_is_refused(tmp_path: Path) -> None:
    fifo = tmp_path / "key"
    os.mkfifo(fifo)

    def write() -> None:
        with fifo.open("wb", buffering=0) as stream:
            try:
                while True:
                    stream.write(bytes(65536))
            except BrokenPipeError:
                pass

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    with pytest.raises(ValueError, match="more than"):
        read_key(str(fifo))
    writer.join(30)
    assert not writer.is_alive()
