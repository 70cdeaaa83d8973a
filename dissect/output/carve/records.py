"""A block as JSON-ready values and as a CSV row, for list, manifest and comparison (docs/json.md)."""

from __future__ import annotations

import hashlib
from typing import Final

from dissect.engine.program.carved import CODE, INTERFACE, VALUES, CarvedBlock
from dissect.meaning.report.words import Places
from dissect.output.carve.contents import NamedValue
from dissect.wire.text import Clock, cell, encodable

BLOCKS_SCHEMA: Final = "s7dissect.blocks/1"

#: CSV columns, each with the name of a value of `record`.
COLUMNS: Final = (
    "type", "number", "name", "direction", "client", "plc", "protocol", "language", "octets", "announced", "complete",
    "missing", "activated", "author", "family", "version", "checksum", "code_time", "interface_time", "protected",
    "begin_time", "end_time", "connection", "first_frame", "last_frame", "activated_frame", "sha256", "file",
)  # fmt: skip


def digest(block: CarvedBlock) -> str:
    """Return the SHA-256 of a block's octets in hexadecimal."""
    return hashlib.sha256(block.octets).hexdigest()


def record(block: CarvedBlock, places: Places, clock: Clock) -> dict[str, object]:
    """Return the facts of a block; times of the capture are in UTC."""
    parts = block.parts()
    values: dict[str, object] = {
        "label": encodable(block.label),
        "type": block.kind,
        "number": block.number if block.number >= 0 else None,
        "title": encodable(block.title) or None,
        "name": encodable(block.name) or None,
        "protocol": block.protocol,
        "language": block.language or None,
        "octets": len(block.octets),
        "code_octets": len(parts.get(CODE, b"")) + len(parts.get(VALUES, b"")),
        "interface_octets": len(parts.get(INTERFACE, b"")),
        "complete": block.complete,
        "missing": block.missing or None,
        "octets_behind_gap": len(block.behind_gap),
        "author": encodable(block.author) or None,
        "family": encodable(block.family) or None,
        "version": block.version or None,
        "checksum": f"{block.checksum:04x}" if block.checksum >= 0 else None,
        "code_time": block.code_time or None,
        "interface_time": block.interface_time or None,
        "protected": block.protected,
        "sha256": digest(block),
    }
    operation = block.operation
    if operation is not None:
        ends = operation.connection.tcp.ends
        activated = block.activation.frame if block.activation is not None else 0
        values |= {
            "direction": operation.kind,
            "client": str(ends[operation.asked_by]),
            "plc": str(ends[1 - operation.asked_by]),
            "connection": int(operation.connection.number),
            "operation": operation.number,
            "first_frame": places.number(operation.first_frame),
            "last_frame": places.number(operation.last_frame),
            "begin_time": clock.iso(operation.begin_ns),
            "end_time": clock.iso(operation.end_ns),
            "announced": operation.announced if operation.announced >= 0 else None,
            "result": operation.result,
            "activated": block.activated,
            "activated_frame": places.number(activated) if activated else None,
        }
        if places.several:
            values["first_file"] = places.locate(operation.first_frame)[0]
    return values


def value_record(value: NamedValue) -> dict[str, object]:
    """Return a value of a data block."""
    shown = value.value
    return {
        "name": encodable(value.name) or None,
        "address": value.address,
        "type": value.type or None,
        "value": encodable(shown) if isinstance(shown, str) else shown,
        "unit": encodable(value.unit) or None,
        "octets": value.data.hex(),
        "remark": encodable(value.remark) or None,
    }


def row(values: dict[str, object]) -> list[str]:
    """Return a record as CSV cells that are safe for spreadsheets."""
    return [_cell(values.get(name)) for name in COLUMNS]


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return cell(str(value))
