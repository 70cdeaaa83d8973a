"""A block as STL or AWL: header, interface, networks with labels and folded calls; as text lines and JSON values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from dissect.protocols.mc7.assembler import instruction_text
from dissect.protocols.mc7.block import Block, Network
from dissect.protocols.mc7.checks import all_facts
from dissect.protocols.mc7.code import Instruction, unknown_octets
from dissect.protocols.mc7.folding import Call, Callee, fold, no_block
from dissect.protocols.mc7.interface import ARRAY, SECTIONS, STRUCT, TEMP, Declaration
from dissect.protocols.mc7.labels import jump_labels, parameter_names
from dissect.protocols.mc7.notation import Names, mnemonic
from dissect.protocols.mc7.operands import MEMORY, NUMBERED, Operand
from dissect.protocols.mc7.registers import OpenBlocks
from dissect.protocols.s7.tables import LETTER_AREAS
from dissect.wire.text import count, printable

#: Returns the name of an address (S7comm area code, number of the data block or 0, first bit, bits); empty for none.
Naming = Callable[[int, int, int, int], str]

STL: Final = "STL"
AWL: Final = "AWL"
_KEYWORDS: Final[dict[str, str]] = {
    "OB": "ORGANIZATION_BLOCK",
    "FB": "FUNCTION_BLOCK",
    "FC": "FUNCTION",
    "DB": "DATA_BLOCK",
    "SDB": "SYSTEM_DATA_BLOCK",
    "SFC": "SYSTEM_FUNCTION",
    "SFB": "SYSTEM_FUNCTION_BLOCK",
}
_AREA_CODES: Final[dict[str, int]] = {
    **{letters: LETTER_AREAS[letters] for letters in ("I", "Q", "M", "T", "C")},
    "DB": 0x84,
    "DI": 0x84,
    "PI": 0x80,
    "PQ": 0x80,
}
#: Size of a timer or counter in bits, as tags count it.
_NUMBERED_BITS: Final = 16


class Line(NamedTuple):
    """A line of code: ``label`` is empty for none, ``comment`` is the name of its operand; ``call`` is a folded call."""

    offset: int
    label: str
    name: str
    operand: str
    comment: str
    octets: bytes
    call: Call | None

    @property
    def text(self) -> str:
        """The line as text, without its comment."""
        return f"{self.label + ':' if self.label else '':<6} {self.name:<5} {self.operand}".rstrip()


class ListedNetwork(NamedTuple):
    """A network and its lines."""

    number: int
    lines: list[Line]


def no_names(_area: int, _db: int, _bit: int, _bits: int) -> str:
    """Return an empty name: without tags."""
    return ""


class Lister:
    """Writes blocks as code in one language, with the known names and the other known blocks."""

    def __init__(
        self, language: str = STL, naming: Naming = no_names, callee: Callee = no_block, folded: bool = True
    ) -> None:
        self._german = language == AWL
        self._naming = naming
        self._callee = callee
        self._folded = folded

    def networks(self, block: Block) -> list[ListedNetwork]:
        """Return the code of a block, network by network."""
        labels, names = jump_labels(block), parameter_names(block)
        return [ListedNetwork(network.number, self._lines(block, network, labels, names)) for network in block.networks]

    def _lines(self, block: Block, network: Network, labels: dict[int, str], names: Names) -> list[Line]:
        instructions: list[Instruction | Call] = list(network.instructions)
        if self._folded:
            instructions = fold(network.instructions, set(labels), self._callee, block, self._german)
        opened = OpenBlocks()
        lines: list[Line] = []
        for each in instructions:
            label = labels.get(each.offset, "")
            if label:
                opened.forget()
            if isinstance(each, Call):
                for inside in each.instructions:
                    opened.follow(inside)
                octets = b"".join([inside.octets for inside in each.instructions])
                lines.append(Line(each.offset, label, "CALL", each.operand_text(), "", octets, each))
                continue
            comment = self._comment(block, each.operand, opened)
            opened.follow(each)
            text = self._operand(each, labels, names)
            lines.append(Line(each.offset, label, mnemonic(each.name, self._german), text, comment, each.octets, None))
        return lines

    def _operand(self, instruction: Instruction, labels: dict[int, str], names: Names) -> str:
        name = mnemonic(instruction.name, self._german)
        return instruction_text(instruction, labels, self._german, names)[len(name) :].strip()

    def _comment(self, block: Block, operand: Operand, opened: OpenBlocks) -> str:
        """Return the name of an operand: a tag, or a declaration of the block itself."""
        if operand.kind == NUMBERED and not operand.via and operand.area in {"T", "C"}:
            return self._naming(_AREA_CODES[operand.area], 0, operand.number * _NUMBERED_BITS, _NUMBERED_BITS)
        if operand.kind != MEMORY or operand.via not in {"", "AR2"}:
            return ""
        if operand.area == "L" and not operand.via:
            return block.interface.name_at(True, operand.number)
        if operand.area == "DI" and block.kind == "FB" and (operand.via or opened.di < 0):
            return block.interface.name_at(False, operand.number)
        code = _AREA_CODES.get(operand.area)
        if code is None or operand.via:
            return ""
        db = opened.block_of(operand) if operand.area in {"DB", "DI"} else 0
        return self._naming(code, db, operand.number, 8 * operand.width or 1) if db >= 0 else ""


def header_lines(block: Block) -> list[str]:
    """Return the lines about the header of a block. Texts from the wire are escaped."""
    name = printable(block.said("name"))
    title = f"{_KEYWORDS.get(block.kind, 'BLOCK')} {block.label}" + (f' "{name}"' if name else "")
    said = [block.language_text] if block.language >= 0 else []
    if block.footer is not None:
        said.append(f"version {block.said('version')}")
    said += [f"{word} {printable(block.said(word))}" for word in ("author", "family") if block.said(word)]
    lines = [f"{title} ({', '.join(said)})" if said else title]
    times = [
        f"{word} changed {block.said(f'{word}_time')}" for word in ("code", "interface") if block.said(f"{word}_time")
    ]
    if times:
        lines.append("  " + ", ".join(times))
    sizes = [f"{len(block.code)} bytes of code" if block.has_code else f"{len(block.code)} bytes of values"]
    if block.tables.networks:
        sizes.append(count(len(block.tables.networks), "network"))
    if block.field("local_length") >= 0:
        sizes.append(f"{block.field('local_length')} bytes of local data")
    if block.field("checksum") >= 0:
        sizes.append(f"checksum 0x{block.field('checksum'):04x} (a fingerprint: its algorithm is not public)")
    lines.append("  " + ", ".join(sizes))
    if block.protected:
        lines.append("  know-how protected: programming tools hide the code, the block itself does not")
    if block.encrypted:
        lines.append("  encrypted (block privacy): the code cannot be read")
    unknown = unknown_octets(block.instructions)
    if unknown:
        lines.append(f"  {unknown} of {len(block.code)} bytes of code are no known instruction (DW)")
    return lines


def interface_lines(block: Block) -> list[str]:
    """Return the declarations with types and addresses; they are numbered, because a block has no names."""
    interface = block.interface
    if not interface.declarations:
        return []
    lines = ["  interface (names do not travel with a block: numbered by section)"]
    for declaration in interface.declarations:
        lines += _declaration_lines(declaration, 4)
    return lines


def _declaration_lines(declaration: Declaration, indent: int) -> list[str]:
    place = ""
    if declaration.start >= 0:
        at, bit = divmod(declaration.start, 8)
        place = f"{'L' if declaration.place == TEMP else '+'} {at}.{bit}"
    initial = f" := {_initial_text(declaration)}" if declaration.initial else ""
    text = f"{' ' * indent}{declaration.name:<12} : {declaration.type_text}{initial}"
    lines = [f"{text:<52} {place}".rstrip()]
    members = declaration.members
    if declaration.type == ARRAY:
        members = members[0].members if members and members[0].type == STRUCT else []
    for member in members:
        lines += _declaration_lines(member, indent + 2)
    return lines


def _initial_text(declaration: Declaration) -> str:
    value = int.from_bytes(declaration.initial, "little")
    if declaration.type == 1:
        return "TRUE" if value else "FALSE"
    return f"16#{value:0{2 * len(declaration.initial)}X}"


def block_lines(block: Block, lister: Lister) -> list[str]:
    """Return a whole block as text: header, interface, networks, and its inconsistencies."""
    lines = header_lines(block) + interface_lines(block)
    for network in lister.networks(block):
        lines += ["", f"NETWORK {network.number}"]
        for line in network.lines:
            comment = f"// {printable(line.comment)}" if line.comment else ""
            lines.append(f"{line.text:<40} {comment}".rstrip())
    lines += [f"! {printable(fact.text)}" for fact in all_facts(block)]
    return lines


def block_values(block: Block, lister: Lister) -> dict[str, object]:
    """Return a block as JSON-ready values (schema blocks-code)."""
    return {
        "block": block.label,
        "type": block.kind or None,
        "number": block.number if block.kind else None,
        "language": block.language_text or None,
        "name": block.said("name") or None,
        "author": block.said("author") or None,
        "family": block.said("family") or None,
        "version": block.said("version") or None,
        "code_time": block.said("code_time") or None,
        "interface_time": block.said("interface_time") or None,
        "checksum": block.field("checksum") if block.field("checksum") >= 0 else None,
        "protected": block.protected,
        "encrypted": block.encrypted,
        "local_bytes": block.field("local_length") if block.field("local_length") >= 0 else None,
        "code_bytes": len(block.code),
        "unknown_bytes": unknown_octets(block.instructions),
        "interface": [_declaration_values(declaration) for declaration in block.interface.declarations],
        "networks": [
            {"network": network.number, "instructions": [_line_values(line) for line in network.lines]}
            for network in lister.networks(block)
        ],
        "facts": [
            {"slug": fact.slug, "offset": fact.offset if fact.offset >= 0 else None, "text": fact.text}
            for fact in all_facts(block)
        ],
    }


def _declaration_values(declaration: Declaration) -> dict[str, object]:
    return {
        "name": declaration.name,
        "section": SECTIONS.name(declaration.place),
        "type": declaration.type_text,
        "bit": declaration.start if declaration.start >= 0 else None,
        "bits": declaration.bits if declaration.bits >= 0 else None,
        "start_value": declaration.initial.hex() or None,
        "members": [_declaration_values(member) for member in declaration.members],
    }


def _line_values(line: Line) -> dict[str, object]:
    values: dict[str, object] = {
        "offset": line.offset,
        "label": line.label or None,
        "name": line.name,
        "operand": line.operand or None,
        "tag": line.comment or None,
        "octets": line.octets.hex(),
    }
    if line.call is not None:
        call = line.call
        values["call"] = {
            "block": f"{call.kind}{call.number}",
            "instance": call.instance or None,
            "arguments": [
                {"name": argument.name, "given": argument.given or None, "taken": argument.taken or None}
                for argument in call.arguments
            ],
        }
    return values
