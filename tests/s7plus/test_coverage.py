"""docs/s7plus-coverage.md is what the tables and the public captures say."""

from __future__ import annotations

from pathlib import Path

from scripts.s7plus_coverage_doc import PAGE, Census, census, document


def test_the_page_is_what_the_captures_say(corpus: Path) -> None:
    found = census(corpus)
    assert found.whole == found.pdus > 2000
    assert not found.broken
    assert document(found) == PAGE.read_text(encoding="utf-8"), (
        "run `python scripts/s7plus_coverage_doc.py FOLDER > docs/s7plus-coverage.md` with the folder of the public captures"
    )


def test_without_captures_nothing_was_seen() -> None:
    page = document(Census())
    assert "| `0x04ca` CreateObject | Request |  | - |  |" in page
    assert "| `0x0e` Real | - | - | - |" in page
    assert "| 2167 CPUexecUnit.OperatingStateREQ | - |" in page
