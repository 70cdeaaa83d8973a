"""What the code of a device's blocks uses, beside `blocks --references` on the same capture."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect.files.session import Run
from dissect.meaning.inventory import code, collector
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.inventory.contract import inventory_as_dict
from dissect.meaning.inventory.outcome import Devices
from dissect.output.carve.code import References
from dissect.wire.build import COMPILED
from tests.meaning.report.schemas import ROOT, complaints

PROGRAM: Final = ROOT / "captures" / "program-python.pcapng"


def inventory_of(path: Path) -> Inventory:
    inventory = Inventory()
    run = Run([path], inventory)
    while run.step():
        pass
    inventory.take(run.pipeline, run.files)
    return inventory


def references(inventory: Inventory) -> dict[str, object] | None:
    told = inventory_as_dict(inventory)
    assert complaints("devices", told, exact=True) == []
    devices = told["devices"]
    assert isinstance(devices, list)
    found: dict[str, object] | None = devices[0]["blocks"]["references"]
    return found


def card(inventory: Inventory) -> list[str]:
    lines = [line if isinstance(line, str) else line.text for line in Devices(inventory).text()]
    return [line for line in lines if line.startswith("  code")]


def test_a_device_has_the_cross_reference_of_its_blocks() -> None:
    found = references(inventory_of(PROGRAM))
    listed = References(dissect.blocks(PROGRAM)).as_dict()["plcs"]
    assert isinstance(listed, list)
    assert len(listed) == 1
    assert found == {
        "uses": listed[0]["uses"],
        "calls": listed[0]["calls"],
        "not_listed": 0,
        "blocks_not_read": 0,
    }


def test_a_card_says_what_each_block_calls_writes_and_reads() -> None:
    assert card(inventory_of(PROGRAM)) == [
        (
            "  code        OB1 calls FB7, FC5; writes Q 4.0, Q 5.1, QW 6, MW 22, M 40.0, MW 52 and 3 more; "
            "reads I 0.0, I 0.1, MW 20, MW 30, MW 50, T 4 and 3 more"
        ),
        "  code        FB7 uses nothing but its own data",
        "  code        FC5 uses nothing but its own data",
    ]


def test_a_device_of_which_no_code_passed_has_none() -> None:
    inventory = inventory_of(ROOT / "captures" / "szl.pcapng")
    assert references(inventory) is None
    assert card(inventory) == []


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_what_has_no_room_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(code, "MAX_REFERENCES", 2)
    found = references(inventory_of(PROGRAM))
    assert found is not None
    assert (len(found["uses"]), len(found["calls"])) == (2, 2)  # type: ignore[arg-type]
    whole = sum(len(block.octets) for block in dissect.blocks(PROGRAM))
    monkeypatch.setattr(collector, "MAX_CODE", whole - 1)
    inventory = inventory_of(PROGRAM)
    assert inventory.devices[0].more_code == 1
    assert card(inventory)[-1] == "  code        1 more block was not looked at: all code together is too large"


def test_blocks_of_a_transfer_that_carries_several_are_named_one_by_one(corpus: Path) -> None:
    inventory = inventory_of(corpus / "s7plus" / "yeni_onlineyapilmis_upload.pcapng")
    told = {device.address: device for device in inventory.devices}["192.168.41.10"]
    assert len(told.blocks) == 22
    assert [name for name in told.blocks if name.startswith("DB1 ")] == ["DB1 'Promo_db'"]
    (line,) = [
        line if isinstance(line, str) else line.text
        for line in Devices(inventory).text()
        if "'Promo_db'" in (line if isinstance(line, str) else line.text)
    ]
    assert line.startswith("  blocks      DB1 'Promo_db' read out, DB2 'Modbus_Config_C_Remote_SendP2' read out, DB3 ")
    assert line.endswith(" and 14 more")
