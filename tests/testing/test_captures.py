"""What `s7_capture` finds by a name."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.testing.captures import CaptureFolder


@pytest.mark.parametrize(
    "suffix", [".pcapng", ".pcap", ".pcapng.gz", ".pcap.gz", ".pcapng.zst", ".pcap.zst", ".s7.txt"]
)
def test_a_capture_of_each_kind_is_found_without_its_suffix(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"pump{suffix}"
    path.touch()
    captures = CaptureFolder(tmp_path)
    assert captures("pump").path == captures(path.name).path == path
