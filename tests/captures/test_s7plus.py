"""captures/s7plus: what we make of the recorded S7comm-plus session is what its description says."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Final

import dissect
from dissect.transactions.transaction import Transaction

FOLDER: Final = Path(__file__).resolve().parents[2] / "captures" / "s7plus"
CAPTURE: Final = FOLDER / "s7commplus.pcapng"


def description() -> dict[str, Any]:
    return tomllib.loads((FOLDER / "s7commplus.toml").read_text(encoding="utf-8"))


def test_the_counts_are_those_of_the_description() -> None:
    expected = description()["expected"]
    told = dissect.analyze(str(CAPTURE)).as_dict()
    plus: Any = told["s7plus"]
    transactions: Any = told["transactions"]
    packets: Any = told["packets"]
    assert packets["read"] == expected["packets"]
    assert plus["pdus"] == expected["s7plus_pdus"]
    assert plus["functions"] == expected["functions"]
    assert transactions["answered"] == transactions["total"] == expected["answered"]
    assert told["findings"] == expected["findings"]


def test_values_are_those_that_the_script_wrote() -> None:
    """21.5 as a Real, written and read back; a block that is not there is refused."""
    found = [event for event in dissect.open(str(CAPTURE), pdus=False) if isinstance(event, Transaction)]
    items = [(item.label, item.data, item.return_code) for one in found for item in one.plus_items()]
    tank = [(data or b"")[-4:] for label, data, _ in items if label == "DB1.DBD0"]
    assert tank == [bytes.fromhex("41ac0000")] * 5  # one write, one read of two items, three polls
    assert [code for label, _, code in items if label == "DB7.DBD0"] == [0x8104]
    assert sum(len(one.errors) for one in found) == description()["expected"]["item_errors"]


def test_its_deviations_are_named_in_the_readme() -> None:
    readme = (FOLDER.parent / "README.md").read_text(encoding="utf-8")
    assert "`s7plus/s7commplus.pcapng`" in readme
    assert len(description()["deviations"]) >= 5
