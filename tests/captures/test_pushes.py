"""Every push of a WinCC session walks to its last octet, each area with its address (issue of DBREAD areas and pushes)."""

from __future__ import annotations

from pathlib import Path

import pytest

import dissect
from dissect.engine.transactions.results import UNCHANGED
from dissect.protocols.s7.tables import SUCCESS


def test_every_push_has_its_items(corpus: Path) -> None:
    path = corpus / "faults" / "wincc_s400_first_part.pcapng"
    if not path.is_file():
        pytest.skip("no capture of WinCC there")
    found = [event for event in dissect.open(str(path)) if isinstance(event, dissect.Transaction)]
    pushes = [one for one in found if one.parameters.userdata is not None and one.parameters.userdata.group == 2]
    pushes = [one for one in pushes if one.outcome == "unsolicited"]
    assert len(pushes) > 300
    for push in pushes:
        results = push.s7_results
        assert results, push.response_frame
        assert push.errors == []
        for result in results:
            assert result.item is not None, push.response_frame
            assert result.return_code in {SUCCESS, UNCHANGED}, push.response_frame
            assert (result.data is None) == result.unchanged
            assert result.data is None or len(result.data) == result.item.size
    reads = [result for one in found if one.function == 4 for result in one.s7_results]
    assert all(result.decodable and result.item is not None and result.item.syntax_id == 0xB0 for result in reads)
