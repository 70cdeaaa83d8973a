"""Finds the changes between two versions of a block, and describes them with instructions (reference sheet mc7.md, section 11).

Networks are compared, not bytes: if a network was inserted, only the inserted one counts as changed. Before the comparison,
labels replace offsets, temporaries of the compiler are numbered by first use, calls are folded, and an address in an open data
block gets the number of that block.
"""

from __future__ import annotations

import re
from difflib import SequenceMatcher
from typing import Final, NamedTuple

from dissect.protocols.mc7.block import Block
from dissect.protocols.mc7.checks import calls
from dissect.protocols.mc7.interface import Declaration
from dissect.protocols.mc7.listing import Lister
from dissect.protocols.mc7.operands import JUMP, JUMP_LIST, MEMORY
from dissect.protocols.mc7.registers import OpenBlocks
from dissect.protocols.mc7.values import block_data
from dissect.wire.text import count, printable

# The subject of a change, in the order in which changes are reported.
HEADER: Final = "header"
TIME: Final = "time"
INTERFACE: Final = "interface"
NETWORK: Final = "network"
CALLS: Final = "calls"
VALUES: Final = "values"

#: Stretches whose alignment would need more comparisons are not aligned line by line, but reported as a whole.
MAX_ALIGNED: Final = 1_000_000
#: Networks with at least this share of equal instructions are versions of each other.
_SIMILAR: Final = 0.4

_LOCAL: Final = re.compile(r"\b(LB|LW|LD|L|P#L|P#V) (\d+)(?:\.(\d))?")
_LABEL: Final = "label"
_HEADER_FIELDS: Final = (
    ("language", "language"), ("security", "protection"), ("local_length", "local data"), ("linked", "linked"),
    ("standard", "standard block"), ("non_retain", "non-retain"),
)  # fmt: skip
_TEXT_FIELDS: Final = ("author", "family", "name", "version")


class Change(NamedTuple):
    """A change: ``about`` is one of the constants above; ``network`` is its number in the newer, else the older block, or 0.

    ``before`` is empty for something new, ``after`` for something removed. ``text`` is the sentence without the name of the
    block.
    """

    about: str
    network: int
    before: str
    after: str
    text: str


class _Step(NamedTuple):
    """An instruction to compare: name and operand without code addresses; ``target`` is the target of a jump, or -1."""

    name: str
    operand: str
    target: int
    offset: int

    @property
    def text(self) -> str:
        return f"{self.name} {self.operand}".strip()


class _Network(NamedTuple):
    number: int
    steps: list[_Step]

    @property
    def key(self) -> tuple[str, ...]:
        return tuple([step.text for step in self.steps])


def compare_blocks(before: Block, after: Block, lister: Lister | None = None) -> list[Change]:
    """Return the changes from one version of a block to another, empty if they are equal.

    ``lister`` defines the language and knows other blocks.
    """
    changes = _compare_headers(before, after)
    changes += _compare_interfaces(before, after)
    if before.has_code and after.has_code:
        changes += _compare_code(before, after, lister or Lister())
        changes += _compare_calls(before, after)
    elif before.code != after.code:
        changes += _compare_values(before, after)
    if before.octets != after.octets and not changes:
        text = "only bytes without meaning for the program changed (tables, encoding or rests of the compiler)"
        changes.append(Change(HEADER, 0, "", "", text))
    return changes


def only_stamps(changes: list[Change]) -> bool:
    """Return whether only time stamps and the checksum changed."""
    return bool(changes) and all(change.about == TIME for change in changes)


def change_lines(label: str, changes: list[Change]) -> list[str]:
    """Return the changes as lines of text: ``OB1 network 2: L S5T#35S → S5T#10S``. Texts from the wire are escaped."""
    if not changes:
        return [f"{label}: no change"]
    if only_stamps(changes):
        return [
            f"{label}: only time stamps or checksum changed, code and interface are the same",
            *_lines(label, changes),
        ]
    return _lines(label, changes)


def _lines(label: str, changes: list[Change]) -> list[str]:
    lines: list[str] = []
    for change in changes:
        where = f" network {change.network}" if change.network else f" {change.about}"
        separator = "" if change.text.startswith(" ") else ": "
        lines.append(printable(f"{label}{where}{separator}{change.text}"))
    return lines


def change_values(changes: list[Change]) -> list[dict[str, object]]:
    """Return the changes as JSON-ready values."""
    return [
        {
            "about": change.about,
            "network": change.network or None,
            "before": change.before or None,
            "after": change.after or None,
            "text": change.text,
        }
        for change in changes
    ]


def _changed(about: str, what: str, before: str, after: str) -> Change:
    front = f"{what} " if what else ""
    if not before:
        return Change(about, 0, before, after, f"{front}{after} added")
    if not after:
        return Change(about, 0, before, after, f"{front}{before} removed")
    return Change(about, 0, before, after, f"{front}{before} → {after}")


def _compare_headers(before: Block, after: Block) -> list[Change]:
    changes: list[Change] = []
    if before.header is None or after.header is None:
        return changes
    for name, word in _HEADER_FIELDS:
        old, new = before.field(name), after.field(name)
        if old != new:
            changes.append(_changed(HEADER, word, before.said(name) or str(old), after.said(name) or str(new)))
    if before.footer is not None and after.footer is not None:
        changes += [
            _changed(HEADER, name, before.said(name), after.said(name))
            for name in _TEXT_FIELDS
            if before.said(name) != after.said(name)
        ]
        old, new = before.field("checksum"), after.field("checksum")
        if old != new:
            changes.append(_changed(TIME, "checksum", f"0x{old:04x}", f"0x{new:04x}"))
    for name, word in (("code_time", "code"), ("interface_time", "interface")):
        if before.raw(name) != after.raw(name):
            changes.append(_changed(TIME, word, _stamp(before, name), _stamp(after, name)))
    return changes


def _stamp(block: Block, name: str) -> str:
    """Return a time stamp, or its bytes if it is not a valid time."""
    return block.said(name) or block.raw(name).hex()


def _compare_interfaces(before: Block, after: Block) -> list[Change]:
    """Compare declarations by section and position, as a block has no names; ignore addresses that move with them."""
    old, new = before.interface.declarations, after.interface.declarations
    changes: list[Change] = []
    for place in range(1, 7):
        ours, theirs = [each for each in old if each.place == place], [each for each in new if each.place == place]
        types, other = [_whole_type(each) for each in ours], [_whole_type(each) for each in theirs]
        for tag, a, b, c, d in SequenceMatcher(None, types, other, False).get_opcodes():
            if tag == "equal":
                changes += _compare_starts(ours[a:b], theirs[c:d])
                continue
            common = min(b - a, d - c)
            changes += [_changed(INTERFACE, ours[a + at].name, types[a + at], other[c + at]) for at in range(common)]
            changes += [_changed(INTERFACE, "", f"{each.name} : {each.type_text}", "") for each in ours[a + common : b]]
            changes += [
                _changed(INTERFACE, "", "", f"{each.name} : {each.type_text}") for each in theirs[c + common : d]
            ]
    return changes


def _whole_type(declaration: Declaration) -> str:
    """Return a type with all its members, so that a change within a structure is found."""
    members = ", ".join([_whole_type(member) for member in declaration.members])
    return f"{declaration.type_text} ({members})" if members else declaration.type_text


def _compare_starts(ours: list[Declaration], theirs: list[Declaration]) -> list[Change]:
    return [
        _changed(INTERFACE, f"{new.name} start value", old.initial.hex() or "0", new.initial.hex() or "0")
        for old, new in zip(ours, theirs, strict=True)
        if old.initial != new.initial
    ]


def _steps(block: Block, lister: Lister) -> list[_Network]:
    """Return the networks of a block in the form used for comparison."""
    threshold = block.interface.temp_bits
    opened = OpenBlocks()
    by_offset = {instruction.offset: instruction for instruction in block.instructions}
    # The BE that ends every block is part of its last network.
    final = block.instructions[-1] if block.instructions and block.instructions[-1].name == "BE" else None
    networks: list[_Network] = []
    for network in lister.networks(block):
        temporaries: dict[str, str] = {}
        steps: list[_Step] = []
        waiting = -1  # index of an OPN that no access has used yet, or -1
        for line in network.lines:
            if line.label:
                opened.forget()
                waiting = -1
            instruction = by_offset[line.offset]
            if line.call is not None:
                for inside in line.call.instructions:
                    opened.follow(inside)
                steps.append(_Step("CALL", _renamed(line.operand, threshold, temporaries), -1, line.offset))
                continue
            operand = instruction.operand
            opened.follow(instruction)
            if instruction.name in {"BLD", "NOP"} or instruction is final:
                continue
            text = _renamed(line.operand, threshold, temporaries)
            if operand.kind == MEMORY and operand.area == "DB" and not operand.via and opened.db >= 0:
                text = f"DB{opened.db}.{text}"
                if waiting >= 0:
                    del steps[waiting]
                    waiting = -1
            target = instruction.target if operand.kind in {JUMP, JUMP_LIST} else -1
            steps.append(_Step(line.name, _LABEL if target >= 0 else text, target, line.offset))
            if instruction.name == "OPN" and operand.area == "DB":
                waiting = len(steps) - 1 if opened.db >= 0 else -1
        networks.append(_Network(network.number, steps))
    return networks


def _renamed(text: str, threshold: int, temporaries: dict[str, str]) -> str:
    """Return an operand with the compiler's temporaries, which follow the declared ones, named t0, t1 … by first use."""
    if threshold < 0:
        return text

    def name(found: re.Match[str]) -> str:
        bit = int(found[2]) * 8 + int(found[3] or 0)
        if bit < threshold:
            return found[0]
        known = temporaries.setdefault(f"{bit}", f"t{len(temporaries)}")
        return f"P#{known}" if found[1].startswith("P#") else known

    return _LOCAL.sub(name, text)


def _compare_code(before: Block, after: Block, lister: Lister) -> list[Change]:
    if before.code == after.code and before.tables.networks == after.tables.networks:
        return []
    old, new = _steps(before, lister), _steps(after, lister)
    keys, others = [network.key for network in old], [network.key for network in new]
    pairs: list[tuple[_Network | None, _Network | None]] = []
    for tag, a, b, c, d in _opcodes(keys, others):
        if tag == "equal":
            pairs += list(zip(old[a:b], new[c:d], strict=True))
        else:
            pairs += _paired(old[a:b], new[c:d])
    places = _places(pairs)
    changes: list[Change] = []
    gone = {network.key: network for network, other in pairs if network is not None and other is None}
    moved: set[int] = set()
    for network, other in pairs:
        if network is None and other is not None and other.key and other.key in gone:
            moved.add(gone[other.key].number)
    for network, other in pairs:
        if network is not None and other is not None:
            changes += _compare_networks(network, other, places)
        elif other is not None:
            changes.append(_new_network(other, gone))
        elif network is not None and network.number not in moved:
            text = f" removed ({count(len(network.steps), 'instruction')})"
            changes.append(Change(NETWORK, network.number, f"network {network.number}", "", text))
    return changes


def _new_network(network: _Network, gone: dict[tuple[str, ...], _Network]) -> Change:
    found = gone.get(network.key) if network.key else None
    if found is not None:
        text = f": moved here, was network {found.number}"
        return Change(
            NETWORK, network.number, f"network {found.number}", f"network {network.number}", text.removeprefix(": ")
        )
    return Change(
        NETWORK, network.number, "", f"network {network.number}", f" added ({count(len(network.steps), 'instruction')})"
    )


def _opcodes(old: list[tuple[str, ...]], new: list[tuple[str, ...]]) -> list[tuple[str, int, int, int, int]]:
    """Return edit steps from the old list to the new one; equal ends cost little, long rests are replaced as a whole."""
    begin = 0
    while begin < min(len(old), len(new)) and old[begin] == new[begin]:
        begin += 1
    end = 0
    while end < min(len(old), len(new)) - begin and old[-1 - end] == new[-1 - end]:
        end += 1
    codes: list[tuple[str, int, int, int, int]] = [("equal", 0, begin, 0, begin)] if begin else []
    mine, theirs = old[begin : len(old) - end], new[begin : len(new) - end]
    if len(mine) * len(theirs) > MAX_ALIGNED:
        codes.append(("replace", begin, len(old) - end, begin, len(new) - end))
    else:
        codes += [
            (str(tag), a + begin, b + begin, c + begin, d + begin)
            for tag, a, b, c, d in SequenceMatcher(None, mine, theirs, False).get_opcodes()
        ]
    if end:
        codes.append(("equal", len(old) - end, len(old), len(new) - end, len(new)))
    return codes


def _paired(old: list[_Network], new: list[_Network]) -> list[tuple[_Network | None, _Network | None]]:
    """Pair networks that are versions of each other, in order; the others are gone or new."""
    if len(old) == len(new):
        return list(zip(old, new, strict=True))
    pairs: list[tuple[_Network | None, _Network | None]] = []
    at = 0
    for network in old:
        found = next((k for k in range(at, min(len(new), at + 50)) if _alike(network, new[k])), -1)
        if found < 0:
            pairs.append((network, None))
            continue
        pairs += [(None, each) for each in new[at:found]]
        pairs.append((network, new[found]))
        at = found + 1
    pairs += [(None, each) for each in new[at:]]
    return pairs


def _alike(old: _Network, new: _Network) -> bool:
    """Return whether two networks have enough in common to be versions of each other; for long ones in any order."""
    matcher = SequenceMatcher(None, old.key, new.key, False)
    if matcher.quick_ratio() < _SIMILAR or not old.key:
        return False
    return len(old.key) * len(new.key) > MAX_ALIGNED // 10 or matcher.ratio() >= _SIMILAR


def _places(pairs: list[tuple[_Network | None, _Network | None]]) -> dict[int, int]:
    """Return a map of offsets from the newer code to the older code, for equal instructions."""
    places: dict[int, int] = {}
    for network, other in pairs:
        if network is None or other is None:
            continue
        for tag, a, b, c, d in _opcodes(_single(network), _single(other)):
            if tag == "equal" or (tag == "replace" and b - a == d - c):
                for one, two in zip(network.steps[a:b], other.steps[c:d], strict=True):
                    places[one.offset] = two.offset
    return places


def _single(network: _Network) -> list[tuple[str, ...]]:
    return [(step.text,) for step in network.steps]


def _compare_networks(old: _Network, new: _Network, places: dict[int, int]) -> list[Change]:
    changes: list[Change] = []
    for tag, a, b, c, d in _opcodes(_single(old), _single(new)):
        mine, theirs = old.steps[a:b], new.steps[c:d]
        if tag == "equal":
            changes += _compare_targets(mine, theirs, new.number, places)
            continue
        if [step.name for step in mine] == [step.name for step in theirs]:
            both = zip(mine, theirs, strict=True)
            changes += [_operand_changed(one, two, new.number) for one, two in both if one.text != two.text]
            continue
        if len(mine) * len(theirs) > MAX_ALIGNED:
            text = f"{count(len(mine), 'instruction')} replaced by {len(theirs)}"
            changes.append(Change(NETWORK, new.number, "", "", text))
            continue
        changes += [Change(NETWORK, new.number, step.text, "", f"{step.text} removed") for step in mine]
        changes += [Change(NETWORK, new.number, "", step.text, f"{step.text} added") for step in theirs]
    return changes


def _operand_changed(old: _Step, new: _Step, number: int) -> Change:
    return Change(NETWORK, number, old.text, new.text, f"{old.name} {old.operand} → {new.operand}")


def _compare_targets(mine: list[_Step], theirs: list[_Step], number: int, places: dict[int, int]) -> list[Change]:
    """Report equal jumps whose targets are now different."""
    changes: list[Change] = []
    for one, two in zip(mine, theirs, strict=True):
        if one.target < 0:
            continue
        expected = places.get(one.target)
        if expected is not None and expected != two.target:
            text = f"{one.name} goes to a different place"
            changes.append(Change(NETWORK, number, one.text, two.text, text))
    return changes


def _compare_calls(before: Block, after: Block) -> list[Change]:
    """Report blocks that only one of the versions calls."""
    old = {f"{kind}{number}" for _, kind, number in calls(before)}
    new = {f"{kind}{number}" for _, kind, number in calls(after)}
    changes = [Change(CALLS, 0, "", label, f"{label} is called now") for label in sorted(new - old)]
    return changes + [Change(CALLS, 0, label, "", f"{label} is no longer called") for label in sorted(old - new)]


def _compare_values(before: Block, after: Block) -> list[Change]:
    """Compare actual values by declaration if both blocks have the same ones; else report how many bytes differ."""
    old, new = block_data(before), block_data(after)
    if [value[:3] for value in old] == [value[:3] for value in new] and old:
        return [
            _changed(VALUES, f"{one.name} ({one.bit // 8}.{one.bit % 8})", one.text, two.text)
            for one, two in zip(old, new, strict=True)
            if one.text != two.text
        ]
    size = max(len(before.code), len(after.code))
    differing = sum(one != two for one, two in zip(before.code, after.code, strict=False))
    differing += abs(len(before.code) - len(after.code))
    return [Change(VALUES, 0, "", "", f"{differing} of {size} bytes of values differ")]
