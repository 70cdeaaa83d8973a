"""The code of a device's blocks: which block reads or writes which address, and which block calls which."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dissect.engine.program.compare import versions
from dissect.meaning.inventory.model import Device
from dissect.protocols.mc7.block import Block, parse_block
from dissect.protocols.mc7.usage import BOTH, WRITE, cross_reference, cross_reference_values
from dissect.wire.text import shortened

#: Maximum number of uses and calls of one device that are listed as values.
MAX_REFERENCES: Final = 10_000
#: Maximum number of blocks on a card, and of addresses read or written by a block.
_BLOCKS: Final = 8
_ADDRESSES: Final = 6
_TEXT: Final = 100


def code_of(device: Device) -> list[Block]:
    """Return the latest version of each block of a device whose instructions were captured and can be read."""
    latest = [parse_block(row[-1].octets) for row in versions(device.code, by_plc=False).values()]
    return [block for block in latest if block.has_code]


def code_lines(device: Device) -> Iterator[str]:
    """Yield a line for each block: its calls, writes and reads. `blocks --references` lists the same by address."""
    blocks = code_of(device)
    if not blocks:
        return
    found, calls = cross_reference(blocks)
    # In the order of the addresses, each address once.
    called: dict[str, dict[str, None]] = {}
    written: dict[str, dict[str, None]] = {}
    read: dict[str, dict[str, None]] = {}
    for call in calls:
        called.setdefault(call.block, {})[call.callee] = None
    for use in found:
        if use.access in {WRITE, BOTH}:
            written.setdefault(use.block, {})[use.address] = None
        if use.access != WRITE:
            read.setdefault(use.block, {})[use.address] = None
    blocks.sort(key=lambda block: (block.kind != "OB", block.kind, block.number))
    for block in blocks[:_BLOCKS]:
        name = block.label
        said = [
            f"{verb} {_some(list(what[name]))}"
            for verb, what in (("calls", called), ("writes", written), ("reads", read))
            if name in what
        ]
        yield f"{name} {'; '.join(said) or 'uses nothing but its own data'}"
    if len(blocks) > _BLOCKS:
        yield f"and {len(blocks) - _BLOCKS} more blocks; s7dissect blocks --references lists them all by address"


def code_as_dict(device: Device) -> dict[str, object] | None:
    """Return the cross-reference of a device as values; None if no code was captured."""
    blocks = code_of(device)
    if not blocks:
        return None
    told = cross_reference_values(blocks)
    left_out = 0
    for name, rows in told.items():
        assert isinstance(rows, list)
        left_out += max(0, len(rows) - MAX_REFERENCES)
        told[name] = rows[:MAX_REFERENCES]
    return {**told, "not_listed": left_out, "blocks_not_read": device.more_code}


def _some(addresses: list[str]) -> str:
    shown = ", ".join([shortened(address, _TEXT) for address in addresses[:_ADDRESSES]])
    more = len(addresses) - _ADDRESSES
    return f"{shown} and {more} more" if more > 0 else shown
