"""Assembles STL: turns the lines of a listing into the bytes of MC7 code.

A line is ``label: NAME operand``. After a call of an FC or SFC the addresses of its parameters follow in brackets; empty
brackets if it has none. If the assembler would choose other bytes, the actual ones follow as well: ``L W#16#1 {30000001}``.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final, NamedTuple

from dissect.protocols.mc7.code import LEFT_OVER, UNKNOWN, Instruction, decode, jumps
from dissect.protocols.mc7.instruction_tables import INSTRUCTIONS, Row
from dissect.protocols.mc7.notation import NO_NAMES, Names, english, mnemonic, operand_text, parse_operand, pointer_text
from dissect.protocols.mc7.operands import CONSTANT, JUMP, JUMP_LIST, Operand, pointer_value

_BY_NAME: Final[dict[str, list[Row]]] = {}
for _row in (*INSTRUCTIONS, UNKNOWN, LEFT_OVER):
    _BY_NAME.setdefault(_row.name, []).append(_row)

_LABEL: Final = re.compile(r"([A-Za-z_]\w{0,20}):(?!\S)\s*(.*)")
_EXACT: Final = re.compile(r"(.*?)\s*\{([0-9A-Fa-f]{2,})\}")
_LIST: Final = re.compile(r"(.*?)\s*\(([^()]*)\)")
_NAME: Final = re.compile(r"[A-Za-z_]\w*")
#: Instructions that may have a list of parameters.
_CALLS: Final = frozenset(("UC", "CC"))
#: The longest line, and the longest code of a block.
MAX_LINE: Final = 4096
MAX_CODE: Final = 0x10000


class AssemblyError(ValueError):
    """A line that is not an instruction; ``line`` counts from 1."""

    def __init__(self, line: int, text: str) -> None:
        self.line = line
        super().__init__(f"line {line}: {text}")


class Encoded(NamedTuple):
    """An encoded instruction: its bytes, and for a jump the label of its target and the form of the jump."""

    octets: bytes
    label: str
    row: Row | None


class Assembled(NamedTuple):
    """Assembled code, and the offsets for the tables of a block: beginnings of networks, and all jumps."""

    code: bytes
    networks: list[int]
    jumps: list[int]


def encode_line(text: str, line: int = 0, german: bool = False, names: Names = NO_NAMES) -> Encoded:
    """Return the instruction of a line without its label. Raises `AssemblyError`."""
    text = _uncommented(text)
    exact = _EXACT.fullmatch(text)
    if exact is not None and not len(exact[2]) % 2:
        return Encoded(bytes.fromhex(exact[2]), "", None)
    name, _, rest = text.partition(" ")
    name = english(name) if german else name
    rest = rest.strip()
    rows = _BY_NAME.get(name)
    if rows is None:
        raise AssemblyError(line, f"{name[:20]!r} is not an instruction")
    listed = None
    if name in _CALLS:
        match = _LIST.fullmatch(rest)
        if match is not None:
            rest, listed = match[1], _pointers(match[2], line, german)
    # Only names of parameters depend on the block; all other lines give the same bytes in every block.
    octets = _encoded(name, rest, german, names if "#" in rest else NO_NAMES)
    if octets is not None:
        return Encoded(octets + (_list_octets(listed) if listed is not None else b""), "", None)
    if _NAME.fullmatch(rest):
        for row in rows:
            for kind in (JUMP, JUMP_LIST):
                open_jump = _encode(row, Operand(kind, "", 0, 0))
                if open_jump is not None:
                    return Encoded(open_jump, rest, row)
    raise AssemblyError(line, f"{name} does not take {rest[:40]!r}" if rest else f"{name} needs an operand")


@lru_cache(maxsize=8192)
def _encoded(name: str, operand: str, german: bool, names: Names) -> bytes | None:
    """Return an instruction without list and label, in the first form that can encode it; None if there is none."""
    rows = _BY_NAME[name]
    for meaning in parse_operand(operand, german, names):
        for row in rows:
            octets = _encode(row, meaning)
            if octets is not None:
                return octets
    return None


def _uncommented(text: str) -> str:
    at = text.find("'")
    behind = text.find("'", at + 1) if at >= 0 else 0
    cut = text.find("//", max(behind, 0))
    return (text[:cut] if cut >= 0 else text).strip()


def _encode(row: Row, operand: Operand) -> bytes | None:
    """Return an instruction of a row; None if the row cannot encode the operand."""
    if operand.number < 0 and operand.kind not in {JUMP, JUMP_LIST}:
        return None
    encoded = row.shape.encode(operand, row.firsts)
    if encoded is None:
        return None
    word, value = encoded
    behind = row.size - 2
    if word >> 8 not in row.firsts or word & 0xFF not in row.seconds:
        return None
    if operand.kind in {JUMP, JUMP_LIST} and not -0x8000 <= operand.number < 0x10000:
        return None
    if row is LEFT_OVER:
        return bytes((word,)) if word < 0x100 else None
    if not 0 <= value < 1 << 8 * behind:
        return None
    return word.to_bytes(2, "big") + (value.to_bytes(behind, "big") if behind else b"")


def _pointers(text: str, line: int, german: bool) -> list[int]:
    found: list[int] = []
    for part in text.split(",") if text.strip() else []:
        written = part.strip()
        operand = next((each for each in parse_operand(written, german) if each.width == 4), None)
        if operand is None:
            raise AssemblyError(line, f"{written[:40]!r} is not an address of a parameter, for example P#M 0.0")
        found.append(operand.number if operand.kind == CONSTANT else pointer_value(operand))
    return found


def _list_octets(pointers: list[int]) -> bytes:
    words = 2 + 2 * len(pointers)
    return b"\x70\x0b" + words.to_bytes(2, "big") + b"".join([number.to_bytes(4, "big") for number in pointers])


def assemble(text: str, german: bool = False, names: Names = NO_NAMES) -> Assembled:
    """Return the code of a listing. Raises `AssemblyError` with the number of the wrong line.

    ``NETWORK``, with any text after it, begins a network. Empty lines and lines that begin with ``//`` are ignored.
    """
    code = bytearray()
    networks: list[int] = []
    labels: dict[str, int] = {}
    open_jumps: list[tuple[int, str, Row, int]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        stripped = raw.strip()
        if not stripped or stripped.startswith("//"):
            continue
        if len(stripped) > MAX_LINE:
            raise AssemblyError(number, f"longer than {MAX_LINE} characters")
        if stripped.split(" ", 1)[0] == "NETWORK":
            networks.append(len(code))
            continue
        found = _LABEL.fullmatch(stripped)
        if found is not None:
            if found[1] in labels:
                raise AssemblyError(number, f"label {found[1]} occurs twice")
            labels[found[1]] = len(code)
            stripped = _uncommented(found[2])
            if not stripped:
                continue
        encoded = encode_line(stripped, number, german, names)
        if encoded.row is not None:
            open_jumps.append((len(code), encoded.label, encoded.row, number))
        code += encoded.octets
        if len(code) > MAX_CODE:
            raise AssemblyError(number, f"the code is longer than {MAX_CODE} bytes")
    for at, label, row, number in open_jumps:
        code[at + 2 : at + 4] = _distance(at, label, labels, row, number)
    return Assembled(bytes(code), networks, [jump.offset for jump in jumps(decode(bytes(code)))])


def _distance(at: int, label: str, labels: dict[str, int], row: Row, line: int) -> bytes:
    target = labels.get(label)
    if target is None:
        raise AssemblyError(line, f"label {label} is not defined")
    kind = row.shape.decode(row.firsts[0] << 8, 0).kind
    distance, rest = divmod(target - at - 4, 4) if kind == JUMP_LIST else divmod(target - at, 2)
    if rest or not (0 if kind == JUMP_LIST else -0x8000) <= distance < 0x8000:
        raise AssemblyError(line, f"label {label} is out of reach")
    return (distance & 0xFFFF).to_bytes(2, "big")


def instruction_text(
    instruction: Instruction, labels: dict[int, str], german: bool = False, names: Names = NO_NAMES
) -> str:
    """Return an instruction as one line without its own label, in the form that `encode_line` reads."""
    operand = instruction.operand
    text = labels.get(instruction.target, "") if operand.kind in {JUMP, JUMP_LIST} else ""
    text = text or operand_text(operand, german, names)
    if instruction.list is not None:
        text += f" ({', '.join([pointer_text(pointer, german) for pointer in instruction.pointers])})"
    name = mnemonic(instruction.name, german)
    return f"{name:<5} {text}".rstrip()


def source_lines(
    instructions: list[Instruction], labels: dict[int, str], german: bool = False, names: Names = NO_NAMES
) -> list[str]:
    """Return instructions as lines that `assemble` turns into the same bytes."""
    lines: list[str] = []
    for instruction in instructions:
        text = instruction_text(instruction, labels, german, names)
        label = labels.get(instruction.offset, "")
        if not _is_canonical(instruction, text, german, names):
            text += f" {{{instruction.octets.hex().upper()}}}"
        lines.append(f"{label + ':' if label else '':<6} {text}")
    return lines


def _is_canonical(instruction: Instruction, text: str, german: bool, names: Names) -> bool:
    """Return whether the assembler turns the text of an instruction into the same bytes."""
    try:
        encoded = encode_line(text, 0, german, names)
    except AssemblyError:
        return False
    octets = instruction.octets
    if encoded.row is not None:
        return encoded.octets[:2] == octets[:2]
    return encoded.octets == octets
