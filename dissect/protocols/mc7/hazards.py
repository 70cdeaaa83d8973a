"""Finds code that deserves a finding: calls that stop, delete or copy, new writes to outputs, skipped calls.

Pure functions over blocks; the catalogue of findings explains them (reference sheet mc7.md, section 10).
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.protocols.mc7.block import Block
from dissect.protocols.mc7.changes import HEADER, TIME, Change, change_lines
from dissect.protocols.mc7.checks import calls
from dissect.protocols.mc7.code import Instruction
from dissect.protocols.mc7.operands import JUMP, JUMP_LIST
from dissect.protocols.mc7.usage import BOTH, GIVEN, WRITE, Use, uses
from dissect.wire.octets import u16, u32

# The effect of a system function on the CPU or its program.
STOPS: Final = "stops"
DELETES: Final = "deletes"
COPIES: Final = "copies"
CHANGES: Final = "changes"

#: Maximum number of lines that `summary` returns.
MOST_LINES: Final = 3

#: System functions whose calls are reported, by number: name, effect, and text.
SYSTEM_CALLS: Final[dict[int, tuple[str, str, str]]] = {
    0: ("SET_CLK", CHANGES, "sets the clock"),
    12: ("D_ACT_DP", CHANGES, "activates or deactivates a DP slave or IO device"),
    20: ("BLKMOV", COPIES, "copies memory to an address it is given"),
    21: ("FILL", COPIES, "fills memory at an address it is given"),
    22: ("CREAT_DB", CHANGES, "creates a data block"),
    23: ("DEL_DB", DELETES, "deletes a data block"),
    25: ("COMPRESS", CHANGES, "compresses the memory"),
    36: ("MSK_FLT", CHANGES, "masks programming and access errors"),
    39: ("DIS_IRT", CHANGES, "disables interrupts and error events"),
    41: ("DIS_AIRT", CHANGES, "delays interrupts and error events"),
    43: ("RE_TRIGR", CHANGES, "restarts the watchdog of the cycle"),
    46: ("STP", STOPS, "stops the CPU"),
    55: ("WR_PARM", CHANGES, "writes parameters of a module"),
    58: ("WR_REC", CHANGES, "writes a data record of a module"),
    81: ("UBLKMOV", COPIES, "copies memory to an address it is given, uninterrupted"),
    82: ("CREA_DBL", CHANGES, "creates a data block in load memory"),
    84: ("WRIT_DBL", CHANGES, "writes a data block in load memory"),
    85: ("CREA_DB", CHANGES, "creates a data block"),
    109: ("PROTECT", CHANGES, "changes the protection level"),
}

#: The attribute of a block that belongs to a safety program.
_SAFETY: Final = 0x40
_OUTPUTS: Final = frozenset(("Q", "PQ"))


class SystemCall(NamedTuple):
    """A call of a system function of `SYSTEM_CALLS`."""

    block: str
    network: int
    offset: int
    number: int
    name: str
    effect: str
    text: str


class SkippedCall(NamedTuple):
    """A call that a jump skips: the jump, the callee, and whether the callee is a safety block."""

    block: str
    network: int
    jump: str
    callee: str
    safety: bool


def system_calls(block: Block) -> list[SystemCall]:
    """Return the calls of system functions that stop, delete, copy or change something."""
    found: list[SystemCall] = []
    for instruction, kind, number in calls(block):
        row = SYSTEM_CALLS.get(number) if kind == "SFC" else None
        if row is not None:
            name, effect, does = row
            network = block.network_of(instruction.offset)
            text = f"{block.label} network {network} calls SFC{number} {name}, which {does}"
            found.append(SystemCall(block.label, network, instruction.offset, number, name, effect, text))
    return found


def new_system_calls(before: Block, after: Block) -> list[SystemCall]:
    """Return calls of system functions that are more frequent in the newer version than in the older one."""
    left: dict[int, int] = {}
    for call in system_calls(before):
        left[call.number] = left.get(call.number, 0) + 1
    found: list[SystemCall] = []
    for call in system_calls(after):
        if left.get(call.number, 0) > 0:
            left[call.number] -= 1
        else:
            found.append(call)
    return found


def output_writes(block: Block) -> list[Use]:
    """Return the writes to outputs and to the periphery."""
    return [use for use in uses(block) if use.access in {WRITE, BOTH, GIVEN} and use.area in _OUTPUTS]


def new_output_writes(before: Block, after: Block) -> list[Use]:
    """Return writes to outputs that only the newer version has, one for each address; an indirect write counts by its text."""
    known = {use.address for use in output_writes(before)}
    found: dict[str, Use] = {}
    for use in output_writes(after):
        if use.address not in known:
            found.setdefault(use.address, use)
    return list(found.values())


def is_safety(block: Block) -> bool:
    """Return whether a block belongs to a safety program (attribute 0x40; one source)."""
    return block.header is not None and len(block.octets) > 3 and block.octets[3] & _SAFETY != 0


def skipped_calls(block: Block, safety: frozenset[str] = frozenset()) -> list[SkippedCall]:
    """Return the calls that a forward jump skips, once per callee and network; ``safety`` has the labels of safety blocks."""
    called = calls(block)
    found: dict[tuple[int, str], SkippedCall] = {}
    for jump in _forward_jumps(block):
        for instruction, kind, number in called:
            if jump.offset < instruction.offset < jump.target:
                label = f"{kind}{number}"
                network = block.network_of(instruction.offset)
                found.setdefault((network, label), SkippedCall(block.label, network, jump.name, label, label in safety))
    return list(found.values())


def _forward_jumps(block: Block) -> list[Instruction]:
    kinds = (JUMP, JUMP_LIST)
    return [
        instruction
        for instruction in block.instructions
        if instruction.word >> 8 in {0x70, 0xFF}
        and instruction.operand.kind in kinds
        and instruction.target > instruction.offset
    ]


def newly_skipped_calls(before: Block, after: Block, safety: frozenset[str] = frozenset()) -> list[SkippedCall]:
    """Return calls of the older version that are skipped only in the newer version."""
    there = {f"{kind}{number}" for _, kind, number in calls(before)}
    old = {skipped.callee for skipped in skipped_calls(before, safety)}
    found = skipped_calls(after, safety)
    return [skipped for skipped in found if skipped.callee in there and skipped.callee not in old]


def code_stamp(block: Block) -> int:
    """Return the time stamp of the code in milliseconds since 1984-01-01, -1 if there is none."""
    raw = block.raw("code_time")
    if len(raw) < 6:
        return -1
    return int(u16(raw, 4)) * 86_400_000 + int(u32(raw, 0))


def older_than(before: Block, after: Block) -> str:
    """Return a sentence if the newer block's code has an earlier time stamp than the code of the replaced block; else empty."""
    old, new = code_stamp(before), code_stamp(after)
    if old < 0 or new < 0 or new >= old:
        return ""
    return f"code of {after.said('code_time')} replaces code of {before.said('code_time')}"


def logic_changes(changes: list[Change]) -> list[Change]:
    """Return the changes that can affect the behaviour of a program: all but header, time stamps and checksum."""
    return [change for change in changes if change.about not in {HEADER, TIME}]


def summary(label: str, changes: list[Change]) -> list[str]:
    """Return the changes in at most `MOST_LINES` lines; the last line counts the rest."""
    logic = logic_changes(changes)
    lines = change_lines(label, logic) if logic else []
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 1], f"{label}: and {len(lines) - MOST_LINES + 1} more changes"]
    return lines
