"""docs/s7plus-coverage.md is what the tables and the public captures say."""

from __future__ import annotations

from pathlib import Path

from dissect.protocols.s7plus.blobs import COMPRESSED
from dissect.protocols.s7plus.grammar import KNOWN
from dissect.protocols.s7plus.id_tables import IDS
from dissect.protocols.s7plus.ids import SECRETS
from dissect.protocols.s7plus.session import OPERATING_STATE, REFERENCE_LIST, SUBSCRIPTION
from dissect.protocols.s7plus.tables import FUNCTIONS, NOTIFIED, TAGS
from dissect.protocols.s7plus.value_tables import VALUE_TYPES
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
    assert "| `0x0e` Real | - | - | - | - |" in page
    assert "| 2167 CPUexecUnit.OperatingStateREQ | - | - |" in page


def test_the_page_has_a_row_for_every_function_type_element_and_id() -> None:
    """Whatever a table of the decoder names, and whatever a reader of bodies takes, stands there."""
    rows = {line.split(" | ")[0].removeprefix("| ") for line in PAGE.read_text(encoding="utf-8").splitlines()}
    for table, digits in ((FUNCTIONS, 4), (VALUE_TYPES, 2), (TAGS, 2), (NOTIFIED, 2)):
        assert {f"`0x{row.number:0{digits}x}` {row.name}" for row in table} <= rows
    assert {f"{row.number} {row.name}" for row in IDS} <= rows
    assert {row.number for row in FUNCTIONS} >= KNOWN
    named = set(SECRETS) | COMPRESSED | {OPERATING_STATE, REFERENCE_LIST, SUBSCRIPTION}
    assert named <= {row.number for row in IDS}
