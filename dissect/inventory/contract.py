"""The JSON contract of `devices -T json` (docs/json.md, dissect/schema/devices.schema.json)."""

from __future__ import annotations

from typing import Final

from dissect.inventory.code import code_as_dict
from dissect.inventory.collector import Inventory
from dissect.inventory.model import Area, Device, Names, Talk
from dissect.inventory.vendors import vendor
from dissect.report.words import Places
from dissect.stations import facts
from dissect.stations.facts import Stretch
from dissect.tcp.link import vlan_ids
from dissect.wire.text import Clock, encodable

DEVICES_SCHEMA: Final = "s7dissect.devices/1"
#: Facts that have their own keys in the JSON object.
_APART: Final = facts.CLOCKS | {facts.MAC}


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
    clock = Clock()
    talks = device.asked_by
    asked = device.asked
    return {
        "address": device.address,
        "vlan": vlan_ids(device.vlan),
        "role": device.role,
        "certainty": device.certainty or None,
        "evidence": [
            {
                "role": reason.role,
                "certainty": reason.certainty,
                "text": encodable(reason.text),
                "times": reason.count,
                **_packet("", reason.frame, places),
            }
            for reason in sorted(device.reasons.values(), key=lambda reason: reason.weight)
        ],
        "order_number": _text(device.get(facts.ORDER_NUMBER)),
        "hardware": _text(device.get(facts.HARDWARE)),
        "firmware": _text(device.get(facts.FIRMWARE)),
        "serial_number": _text(device.get(facts.SERIAL_NUMBER)),
        "station_name": _text(device.get(facts.STATION_NAME)),
        "module_name": _text(device.get(facts.MODULE_NAME)),
        "plant": _text(device.get(facts.PLANT)),
        "operating_mode": _text(device.get(facts.OPERATING_MODE)),
        "protection_level": _text(device.get(facts.PROTECTION)),
        "macs": [{**_stretch(one, places), "vendor": vendor(one.value) or None} for one in device.history(facts.MAC)],
        "modules": [
            {
                "module": module or None,
                "facts": {
                    key: [_stretch(one, places) for one in facts.timeline(key, stretches)]
                    for (own, key), stretches in sorted(device.station.facts.items())
                    if own == module and key not in _APART
                },
            }
            for module in device.modules
        ],
        "clock_offset_ns": device.clock_offset_ns,
        "clock_set_offset_ns": device.clock_set_offset_ns,
        "blocks": _blocks(device),
        "sessions": _names(device.sessions),
        "tsaps": _names(device.tsaps),
        "pdu_lengths": sorted([int(text) for text in device.pdu_lengths.texts]),
        "parallel_jobs": sorted([int(text) for text in device.parallel_jobs.texts]),
        "names_not_listed": sum(
            [len(n.more) for n in (device.sessions, device.tsaps, device.pdu_lengths, device.parallel_jobs)]
        ),
        "connections": sum(talk.connections for talk in talks),
        "transactions": sum(talk.transactions for talk in talks),
        "answered": asked.answered,
        **({"likely": asked.likely} if asked.likely else {}),
        "unanswered": asked.missed,
        "with_errors": asked.errors,
        "answer_time_ns": device.latencies.as_dict(),
        "asked_by": [talk.client for talk in talks],
        "asks": [talk.server for talk in device.asks],
        **_packet("first_", device.first_frame, places),
        "first_time": clock.iso(device.first_ns),
        **_packet("last_", device.last_frame, places),
        "last_time": clock.iso(device.last_ns),
    }


def talk_as_dict(talk: Talk, places: Places) -> dict[str, object]:
    """Return the talk of a client and a server."""
    clock = Clock()
    return {
        "client": talk.client,
        "server": talk.server,
        "vlan": vlan_ids(talk.vlan),
        "connections": talk.connections,
        "protocols": [text for text in talk.protocols.texts if text],
        "transactions": talk.transactions,
        "reads": talk.reads,
        "writes": talk.writes,
        "answered": talk.answered,
        "unanswered": talk.missed,
        "with_errors": talk.errors,
        "pushes": talk.pushes,
        "operations": dict(sorted(talk.operations.items())),
        "areas": [_area(talk.areas[name]) for name in sorted(talk.areas)],
        "areas_not_listed": len(talk.more_areas),
        **_packet("first_", talk.first_frame, places),
        "first_time": clock.iso(talk.first_ns) if talk.first_frame else None,
        **_packet("last_", talk.last_frame, places),
        "last_time": clock.iso(talk.last_ns) if talk.last_frame else None,
    }


def _area(area: Area) -> dict[str, object]:
    return {
        "name": encodable(area.name),
        "reads": area.reads,
        "writes": area.writes,
        "refused": area.refused,
        "first_byte": area.low if area.low >= 0 else None,
        "last_byte": area.high if area.high >= 0 else None,
        "tags": [encodable(tag) for tag in sorted(area.tags)],
        "tags_not_listed": len(area.more_tags),
    }


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


def _stretch(stretch: Stretch, places: Places) -> dict[str, object]:
    clock = Clock()
    return {
        "value": encodable(stretch.value),
        "source": stretch.source,
        "times": stretch.count,
        **_packet("first_", stretch.first_frame, places),
        "first_time": clock.iso(stretch.first_ns),
        **_packet("last_", stretch.last_frame, places),
        "last_time": clock.iso(stretch.last_ns),
    }


def _packet(prefix: str, frame: int, places: Places) -> dict[str, object]:
    """Return the number of a packet, null for none; with several files also its file."""
    if not places.several:
        return {f"{prefix}frame": frame or None}
    name, number = places.locate(frame) if frame else (None, None)
    return {f"{prefix}frame": number, f"{prefix}file": name}


def _text(value: str) -> str | None:
    return encodable(value) or None


def _names(names: Names) -> list[str]:
    return [encodable(text) for text in names.texts]
