"""[[instance]]: a device described once, put into a dictionary for several of the eight devices (R93-R95).

Types, objects and PDOs with ``device = "pump"`` are a template for device 0. An instance adds 40h to its types, 800h to
its objects at 6000h-67FFh and 64 to its PDO numbers for each device, and puts numbers into its texts: ``{device}`` 0..7,
``{segment}`` 1..8.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from dissect.scd import ranges
from dissect.scd.errors import Error, shown
from dissect.scd.reading import Table

_DEVICE_OBJECT: Final = re.compile(r"0[xX]6([0-7][0-9a-fA-F]{2})(?=[:.]|$)")


def expand(lists: Mapping[str, list[Table]]) -> dict[str, list[Table]]:
    """Return the tables of types, objects and PDOs with every template put in place."""
    kept: dict[str, list[Table]] = {"type": [], "object": [], "pdo": []}
    templates: dict[str, dict[str, list[Table]]] = {}
    for kind, rows in kept.items():
        for table in lists[kind]:
            if table.has("device"):
                template = templates.setdefault(table.text("device"), {"type": [], "object": [], "pdo": []})
                template[kind].append(table)
            else:
                rows.append(table)
    used: set[str] = set()
    placed: set[tuple[str, int]] = set()
    for order in lists["instance"]:
        name = order.text("of")
        devices = order.items("devices")
        order.done()
        if name not in templates:
            raise order.fail("of", f"no type, object or pdo has device = {shown(name)}", "R93")
        used.add(name)
        for device in devices:
            if not isinstance(device, int) or isinstance(device, bool) or not 0 <= device < ranges.DEVICES:
                raise order.fail("devices", f"{shown(device)} is not a device 0 to 7", "R93")
            if (name, device) in placed:
                raise order.fail("devices", f"{shown(name)} is device {device} already", "R93")
            placed.add((name, device))
            for kind, tables in templates[name].items():
                kept[kind].extend(_shifted(kind, table, device) for table in tables)
    for name, template in templates.items():
        if name not in used:
            first = next(table for tables in template.values() for table in tables)
            raise first.fail("device", f"no [[instance]] is of {shown(name)}", "R93")
    return kept


def _shifted(kind: str, table: Table, device: int) -> Table:
    content = {key: _filled(value, device) for key, value in table.content.items() if key != "device"}
    moved = Table(content, f"{table.where} for device {device}", table.line, table.place)
    try:
        if kind == "type":
            content["index"] = ranges.type_of_device(moved.number("index"), device)
        elif kind == "object":
            content["index"] = ranges.object_of_device(moved.number("index"), device)
        else:
            content["number"] = ranges.pdo_of_device(device, moved.number("number"))
            content["map"] = [_target(item, device) for item in moved.items("map")]
    except Error as error:
        raise moved.fail("index" if kind != "pdo" else "number", error.detail, "R93, R94, R95") from None
    return moved


def _filled(value: Any, device: int) -> Any:
    """Return a value with the numbers of the device in its texts, those of the tables and arrays in it too."""
    if isinstance(value, str):
        return value.replace("{device}", str(device)).replace("{segment}", str(device + 1))
    if isinstance(value, list):
        return [_filled(item, device) for item in value]
    if isinstance(value, dict):
        return {key: _filled(item, device) for key, item in value.items()}
    return value


def _target(item: Any, device: int) -> Any:
    """Return an entry of a map with an index 6000h-67FFh moved to the device."""
    if isinstance(item, dict):
        return {**item, "var": _target(item["var"], device)} if "var" in item else item
    if not isinstance(item, str):
        return item
    return (
        _DEVICE_OBJECT.sub(
            lambda match: f"0x{ranges.object_of_device(0x6000 + int(match[1], 16), device):04x}", item, count=1
        )
        if _DEVICE_OBJECT.match(item)
        else item
    )
