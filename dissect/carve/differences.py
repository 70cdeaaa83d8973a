"""What changed in the code of a block, in its own words."""

from __future__ import annotations

from typing import Final

from dissect.mc7.block import parse_block
from dissect.mc7.changes import HEADER, TIME, Change, change_lines, compare_blocks
from dissect.program.compare import BlockChange
from dissect.wire.text import printable

#: Octets of blocks whose code is decoded in one run; an instruction takes some fifty times the memory of its octets.
MAX_CODE: Final = 4 * 1024 * 1024
#: Lines of one changed block that a person is shown; JSON has all of them.
MAX_LINES: Final = 200


def code_changes(change: BlockChange) -> list[Change]:
    """Return what changed in code, interface and values of a block that both sides have; headers are compared by themselves."""
    was, now = change.was, change.now
    if was is None or now is None or was.classic is None or now.classic is None:
        return []
    if len(was.octets) + len(now.octets) > MAX_CODE:
        return []
    found = compare_blocks(parse_block(was.octets), parse_block(now.octets))
    return [one for one in found if one.about not in {HEADER, TIME}]


def code_change_lines(change: BlockChange) -> list[str]:
    """Return what changed in a block as lines for a person, bounded."""
    found = code_changes(change)
    lines = change_lines(printable(change.block.label), found) if found else []
    if len(lines) > MAX_LINES:
        lines = [*lines[:MAX_LINES], f"{change.block.label}: and {len(lines) - MAX_LINES} more changes"]
    return lines
