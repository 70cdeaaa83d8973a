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


def test_any_other_capture_is_found_by_its_path_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "pump.pcap").touch()
    monkeypatch.chdir(tmp_path)
    captures = CaptureFolder(tmp_path / "tests")
    assert captures("elsewhere/pump.pcap").path == Path("elsewhere/pump.pcap")
    with pytest.raises(FileNotFoundError):
        captures("elsewhere/other.pcap")
