"""captures/s7plus: what we make of the recorded S7comm-plus session is what its description says."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.engine.transactions.transaction import Transaction

FOLDER: Final = Path(__file__).resolve().parents[2] / "captures" / "s7plus"
NAMES: Final = ("s7commplus", "s7commplus-tls")
each_name: Final = pytest.mark.parametrize("name", NAMES)


def description(name: str) -> dict[str, Any]:
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def capture(name: str) -> str:
    return str(FOLDER / f"{name}.pcapng")


def test_every_recording_is_looked_at() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.pcapng")) == sorted(NAMES)


@each_name
def test_the_counts_are_those_of_the_description(name: str) -> None:
    expected = description(name)["expected"]
    told = dissect.analyze(capture(name)).as_dict()
    plus: Any = told["s7plus"]
    transactions: Any = told["transactions"]
    packets: Any = told["packets"]
    assert packets["read"] == expected["packets"]
    assert plus["pdus"] == expected["s7plus_pdus"]
    assert plus["functions"] == expected["functions"]
    assert transactions["answered"] == transactions["total"] == expected["answered"]
    assert told["findings"] == expected["findings"]


@each_name
def test_values_are_those_that_the_script_wrote(name: str) -> None:
    """21.5 as a Real, written and read back; a block that is not there is refused."""
    found = [event for event in dissect.open(capture(name), pdus=False) if isinstance(event, Transaction)]
    items = [(item.label, item.data, item.return_code) for one in found for item in one.plus_results]
    tank = [(data or b"")[-4:] for label, data, _ in items if label == "DB1.DBD0"]
    assert tank == [bytes.fromhex("41ac0000")] * 5  # one write, one read of two items, three polls
    assert [code for label, _, code in items if label == "DB7.DBD0"] == [0x8104]
    assert sum(len(one.errors) for one in found) == description(name)["expected"]["item_errors"]


@each_name
def test_its_deviations_are_named_in_the_readme(name: str) -> None:
    readme = (FOLDER.parent / "README.md").read_text(encoding="utf-8")
    assert f"`s7plus/{name}.pcapng`" in readme
    assert len(description(name)["deviations"]) >= 5


def test_the_keys_in_the_capture_open_all_of_it_and_are_needed(tmp_path: Path) -> None:
    told: Any = dissect.analyze(capture("s7commplus-tls")).as_dict()
    assert (told["tls"]["records_opened"], told["tls"]["records_closed"]) == (31, 0)
    closed = tmp_path / "closed.pcapng"
    octets = Path(capture("s7commplus-tls")).read_bytes()
    begin = octets.index(b"KSLT") + 8
    size = int.from_bytes(octets[begin - 4 : begin], "little")
    closed.write_bytes(octets[:begin] + b"#" * size + octets[begin + size :])  # a comment in the place of the keys
    told = dissect.analyze(str(closed)).as_dict()
    assert (told["tls"]["records_opened"], told["tls"]["records_closed"]) == (0, 31)
    assert told["s7plus"]["functions"] == {"0x05b3": 2}
