"""The JSON contract of `devices -T json` (docs/json.md, dissect/meaning/schema/devices.schema.json)."""

from __future__ import annotations

from typing import Final

from dissect.meaning.facts.device import DEVICE, TALK
from dissect.meaning.facts.written import written
from dissect.meaning.inventory.code import code_as_dict
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.inventory.model import Device, Talk
from dissect.meaning.report.words import Places
from dissect.wire.text import Clock, encodable

DEVICES_SCHEMA: Final = "s7dissect.devices/1"


def inventory_as_dict(inventory: Inventory, interrupted: bool = False) -> dict[str, object]:
    """Return an inventory as the object that `devices -T json` writes. Raises ValueError if it was not filled by a run."""
    pipeline = inventory.pipeline
    if pipeline is None:
        raise ValueError("this Inventory is empty: call take() first, or use dissect.devices()")
    clock = Clock()
    places = Places(inventory.files, len(inventory.files) > 1)
    return {
        "schema": DEVICES_SCHEMA,
        "interrupted": interrupted,
        "files": [encodable(file.name) for file in inventory.files],
        "selection": inventory.part.as_dict() if inventory.part is not None else None,
        "first_time": clock.iso(pipeline.first_ns) if pipeline.frames else None,
        "last_time": clock.iso(pipeline.now_ns) if pipeline.frames else None,
        "devices": [device_as_dict(device, places) for device in inventory.devices],
        "talks": [talk_as_dict(talk, places) for talk in inventory.talks],
        "not_kept": {
            "devices": inventory.devices_not_listed,
            "talks": inventory.talks_not_listed,
            "requests": inventory.requests_not_looked_at,
            "facts": inventory.facts_not_kept,
        },
    }


def device_as_dict(device: Device, places: Places) -> dict[str, object]:
    """Return one device."""
    return written(DEVICE, device, places, Clock(), {"blocks": _blocks(device)})


def talk_as_dict(talk: Talk, places: Places) -> dict[str, object]:
    """Return the talk of a client and a server."""
    return written(TALK, talk, places, Clock())


def _blocks(device: Device) -> dict[str, object]:
    listed = device.station.blocks
    names = sorted({*listed, *device.blocks})
    return {
        "counts": device.block_counts,
        "seen": [
            {
                "name": encodable(name),
                "how": [
                    *(["listed"] if name in listed else []),
                    *(device.blocks[name].texts if name in device.blocks else []),
                ],
            }
            for name in names
        ],
        "not_listed": len(device.more_blocks),
        "references": code_as_dict(device),
    }
