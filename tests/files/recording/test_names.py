"""Names of evidence files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.files.recording.names import begin, file_word, finish, part_of, time_word, unused
from dissect.packets.source.files import open_capture
from dissect.wire.text import Clock
from tests.packets.source.craft import drain


@given(st.text(max_size=200))
def test_no_text_becomes_more_than_a_part_of_a_name(text: str) -> None:
    word = file_word(text)
    assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,79}", word)


def test_times_sort_as_they_passed() -> None:
    clock = Clock()
    assert time_word(1_454_943_097_916_123_000, clock) == "20160208T145137Z"
    assert time_word(1_454_943_097_916_123_000, clock, fraction=True) == "20160208T145137.916123000Z"
    assert time_word(0, clock, fraction=True) == "19700101T000000.000000000Z"


def test_a_file_has_its_name_when_it_is_whole(tmp_path: Path) -> None:
    path = unused(tmp_path, "x")
    writer = begin(path, ("", ""))
    assert [one.name for one in tmp_path.iterdir()] == ["x.pcapng.part"]
    assert writer.path == str(part_of(path))
    assert drain(open_capture(writer.path)).frames == []
    assert unused(tmp_path, "x").name == "x-2.pcapng"
    writer.close()
    finish(path)
    assert [one.name for one in tmp_path.iterdir()] == ["x.pcapng"]


def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="none"):
        begin(tmp_path / "none" / "x.pcapng", ("", ""))
