"""Folds calls into one line again: STEP 7 expands a CALL to instructions between two BLDs (reference sheet mc7.md, section 6).

There is no guessing: if the instructions between the BLDs do anything that such an expansion does not do, they are not folded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from dissect.protocols.mc7.block import Block
from dissect.protocols.mc7.code import Instruction
from dissect.protocols.mc7.constants import constant_text
from dissect.protocols.mc7.interface import TYPES, Declaration
from dissect.protocols.mc7.labels import parameter_names
from dissect.protocols.mc7.notation import Names, operand_text, pointer_text
from dissect.protocols.mc7.operands import CONSTANT, COUNT, FIXED, MEMORY, NUMBERED, POINTER, Operand

#: Returns a called block by type and number, None if it was not captured.
Callee = Callable[[str, int], "Block | None"]

#: The number of a BLD that begins a call; the next number ends it. 14 and 16 are for multi-instances.
_BEGINS: Final = frozenset((1, 3, 7, 9, 14, 16))
#: The number of the BLD that only states that the RLO is kept.
_KEPT: Final = 103
#: Maximum length of a call that is folded, in instructions.
_MOST: Final = 2000
_SECTION_IN: Final = frozenset((1, 3))
_SECTION_OUT: Final = frozenset((2, 3, 6))
#: The number of the open instance.
_OWN: Final = Operand(FIXED, "DINO")
#: How a parameter of a type is addressed: as a bit (0), or in bytes (1, 2, 4).
_WIDTHS: Final[dict[str, int]] = {
    "BOOL": 0,
    **dict.fromkeys(("BYTE", "CHAR"), 1),
    **dict.fromkeys(("WORD", "INT", "DATE", "S5TIME"), 2),
    **dict.fromkeys(("DWORD", "DINT", "REAL", "TIME_OF_DAY", "TIME"), 4),
}

#: The prefix of constants of a type, and their size in bytes.
_FORMS: Final[dict[str, tuple[str, int]]] = {
    "WORD": ("W#16#", 2),
    "INT": ("", 2),
    "DATE": ("D#", 2),
    "S5TIME": ("S5T#", 2),
    "DWORD": ("DW#16#", 4),
    "DINT": ("L#", 4),
    "REAL": ("REAL", 4),
    "TIME": ("T#", 4),
    "TIME_OF_DAY": ("TOD#", 4),
}


def no_block(_kind: str, _number: int) -> Block | None:
    """Return None; used when no blocks are known."""
    return None


class Argument(NamedTuple):
    """A parameter of a call: its name, its input and its output; empty if there is none."""

    name: str
    given: str
    taken: str

    @property
    def text(self) -> str:
        """``IN0 := MW 10``, ``OUT0 => M 4.0``."""
        given = f" := {self.given}" if self.given else ""
        return f"{self.name}{given}{f' => {self.taken}' if self.taken else ''}"


class Call(NamedTuple):
    """A folded call: the block, its instance (``DB 7``, or the place of a multi-instance), and the parameters."""

    kind: str
    number: int
    instance: str
    arguments: list[Argument]
    instructions: list[Instruction]

    @property
    def offset(self) -> int:
        """Its offset in the code."""
        return self.instructions[0].offset

    def operand_text(self) -> str:
        """Return the text after CALL."""
        instance = f", {self.instance}" if self.instance else ""
        return f"{self.kind} {self.number}{instance} ({', '.join([argument.text for argument in self.arguments])})"


def fold(
    instructions: list[Instruction], targets: set[int], callee: Callee, block: Block, german: bool = False
) -> list[Instruction | Call]:
    """Return the instructions of a network, in which each call that can be folded replaces its instructions."""
    names = parameter_names(block)
    folded: list[Instruction | Call] = []
    at = 0
    while at < len(instructions):
        call = None
        if instructions[at].name == "BLD" and instructions[at].word & 0xFF in _BEGINS:
            end = _end_of_call(instructions, at)
            if end > 0:
                call = _fold_one(instructions[at : end + 1], targets, callee, names, german)
        if call is None:
            folded.append(instructions[at])
            at += 1
        else:
            folded.append(call)
            at += len(call.instructions)
    return folded


def _end_of_call(instructions: list[Instruction], at: int) -> int:
    """Return the index of the BLD that ends a call, 0 if another call begins first or there is none."""
    wanted = (instructions[at].word & 0xFF) + 1
    for index in range(at + 1, min(at + _MOST, len(instructions))):
        if instructions[index].name == "BLD":
            number = instructions[index].word & 0xFF
            if number == wanted:
                return index
            if number in _BEGINS:
                return 0
    return 0


class _Expansion:
    """The effect of the instructions of one call: the values that they move in and out, and the frame around them."""

    def __init__(self, names: Names, german: bool) -> None:
        self._names = names
        self._german = german
        self.db = ""
        self.di = ""
        self.instance = ""
        self.call: Instruction | None = None
        self.given: dict[Operand, str] = {}
        self.raw: dict[Operand, Operand] = {}
        self.taken: dict[Operand, str] = {}
        self._loaded: Operand | None = None
        self._said = ""

    def text(self, operand: Operand) -> str:
        """Return the text of an operand; in an open data block with the number of that block."""
        if operand.kind == MEMORY and operand.area == "DB" and self.db:
            return f"{self.db}.{operand_text(operand, self._german)}"
        if operand.kind == MEMORY and operand.area == "DI" and self.di not in {"", self.instance}:
            return f"{self.di}.{operand_text(operand._replace(area='DB'), self._german)}"
        return operand_text(operand, self._german, self._names)

    def take(self, instruction: Instruction) -> bool:
        """Follow one instruction; return False if it cannot be part of a call."""
        name, operand = instruction.name, instruction.operand
        if name == "OPN":
            return self._open(operand)
        if self._loaded is not None or self._said:
            return self._move(name, operand)
        if name in {"L", "A"}:
            self._loaded = operand
            self._said = self.text(operand)
            return True
        if name in {"SET", "CLR"}:
            self._said = "TRUE" if name == "SET" else "FALSE"
            return True
        if name in {"UC", "CC"} and operand.kind == NUMBERED and not operand.via:
            if self.call is not None:
                return False
            self.call = instruction
            self.db = ""
            return True
        if name == "BLD":
            return operand.kind == COUNT and operand.number == _KEPT
        if name == "+AR2" and self.call is None and not self.instance and operand.kind == POINTER:
            self.instance = operand_text(operand)  # the place of the multi-instance in the caller's instance
            return True
        return name in {"TAR2", "LAR2", "CDB"}

    def _open(self, operand: Operand) -> bool:
        if operand.kind != NUMBERED:
            return False
        if operand.via:
            # After a multi-instance, the caller's instance is opened again; its number was stored.
            kept = Operand(MEMORY, operand.via[:-1], 2, 8 * operand.number)
            return operand.area == "DI" and self.raw.pop(kept, None) == _OWN and self.given.pop(kept, "") != ""
        if operand.area == "DI":
            self.di = f"DB{operand.number}"
            self.instance = self.instance or self.di
        else:
            self.db = f"DB{operand.number}"
        return True

    def _move(self, name: str, operand: Operand) -> bool:
        """Follow the use of a loaded value, which is stored in one place."""
        source, said = self._loaded, self._said
        self._loaded, self._said = None, ""
        if name not in {"T", "="} or (name == "=" and source is not None and source.width):
            return False
        if self.call is None:
            self.given[operand] = said
            if source is not None:
                self.raw[operand] = source
        elif source is not None:
            self.taken[source] = self.text(operand)
        return self.call is None or source is not None

    @property
    def open(self) -> bool:
        """True if a value was loaded but not used."""
        return self._loaded is not None or self._said != ""


def _fold_one(
    instructions: list[Instruction], targets: set[int], callee: Callee, names: Names, german: bool
) -> Call | None:
    """Return the call whose expansion is these instructions from BLD to BLD; None if they are anything else."""
    if any(instruction.offset in targets for instruction in instructions[1:]):
        return None
    expansion = _Expansion(names, german)
    inside = instructions[1:-1]
    # First, the RLO is kept.
    if inside and inside[0].name == "=":
        inside = inside[1:]
    for instruction in inside:
        if not expansion.take(instruction):
            return None
    call = expansion.call
    if call is None or expansion.open:
        return None
    operand = call.operand
    called = callee(operand.area, operand.number)
    listed = call.list is not None
    arguments = _of_list(call, expansion, called) if listed else _of_instance(expansion, called)
    if arguments is None:
        return None
    return Call(operand.area, operand.number, expansion.instance, arguments, instructions)


def _of_list(call: Instruction, expansion: _Expansion, called: Block | None) -> list[Argument] | None:
    """Return the parameters of an FC or SFC; None if values were moved that belong to no parameter."""
    declared = called.interface.parameters if called is not None else []
    pointers = call.pointers
    if len(declared) != len(pointers):
        declared = []
    given, taken = dict(expansion.given), dict(expansion.taken)
    arguments: list[Argument] = []
    for position, address in enumerate(pointers, 1):
        declaration = declared[position - 1] if declared else None
        name = declaration.name if declaration is not None else f"P{position}"
        arguments.append(_argument(name, address, declaration, expansion, given, taken))
    return None if given or taken else arguments


def _argument(
    name: str,
    address: Operand,
    declaration: Declaration | None,
    expansion: _Expansion,
    given: dict[Operand, str],
    taken: dict[Operand, str],
) -> Argument:
    """Return the parameter of a pointer; remove the values that were moved for it from ``given`` and ``taken``."""
    if address.area == "V":
        moved_in = _at(given, address.number)
        moved_out = _at(taken, address.number)
        any_pointer = _any_text(given, address.number, expansion)
        if any_pointer:
            return Argument(name, any_pointer, "")
        goes_in = given.pop(moved_in) if moved_in is not None else ""
        if moved_in is not None and declaration is not None:
            goes_in = _typed(expansion.raw.get(moved_in), declaration) or goes_in
        comes_out = taken.pop(moved_out) if moved_out is not None else ""
        if goes_in or comes_out:
            return Argument(name, goes_in, comes_out)
        address = address._replace(area="L")
    text = _place_text(address, declaration, expansion)
    if declaration is not None and declaration.place in _SECTION_OUT and declaration.place not in _SECTION_IN:
        return Argument(name, "", text)
    return Argument(name, text, "")


def _typed(value: Operand | None, declaration: Declaration) -> str:
    """Return a constant in the declared type of its parameter, empty if it is not one; calls load all constants as integers."""
    form = _FORMS.get(TYPES.name(declaration.type))
    if value is None or form is None or value.kind != CONSTANT or value.width != form[1]:
        return ""
    return constant_text(value._replace(area=form[0]))


def _at(moved: dict[Operand, str], bit: int) -> Operand | None:
    """Return the place in local data to or from which a value was moved."""
    for operand in moved:
        if operand.kind == MEMORY and operand.area == "L" and not operand.via and operand.number == bit:
            return operand
    return None


def _any_text(given: dict[Operand, str], bit: int, expansion: _Expansion) -> str:
    """Return a POINTER or ANY that was built in local data, by block and address; empty if there is none."""
    for size, first in ((2, "POINTER"), (4, "ANY")):
        places = [Operand(MEMORY, "L", 2, bit + 16 * at) for at in range(size - 1)]
        places.append(Operand(MEMORY, "L", 4, bit + 16 * (size - 1)))
        parts = [expansion.raw[place] for place in places if place in given and place in expansion.raw]
        if len(parts) < size or parts[-1].kind != POINTER or any(part.kind != CONSTANT for part in parts[:-1]):
            continue
        what = ""
        if first == "ANY":
            kind = parts[0].number
            if kind >> 8 != 0x10:
                continue
            what = f" {TYPES.name(kind & 0xFF)} {parts[1].number}"
        for place in places:
            del given[place]
        block = parts[-2].number
        return f"P#{f'DB{block}.' if block else ''}{pointer_text(parts[-1]).removeprefix('P#')}{what}"
    return ""


def _place_text(address: Operand, declaration: Declaration | None, expansion: _Expansion) -> str:
    """Return the target of a pointer as text; its width is that of the parameter, if the callee was captured."""
    width = _WIDTHS.get(TYPES.name(declaration.type)) if declaration is not None else None
    area = address.area.removesuffix("X")
    if width is None or area not in {"I", "Q", "M", "DB", "DI", "L"} or (width and address.number & 7):
        return pointer_text(address)
    return expansion.text(Operand(MEMORY, area, width, address.number))


def _of_instance(expansion: _Expansion, called: Block | None) -> list[Argument] | None:
    """Return the parameters of an FB or SFB, which are the values moved into the instance and out of it."""
    arguments: list[Argument] = []
    for moved in (expansion.given, expansion.taken):
        for operand, text in moved.items():
            if operand.kind != MEMORY or operand.area != "DI" or operand.via not in {"", "AR2"}:
                # Multi-instances keep the address register in local data.
                return None
            direct = called is not None and not operand.via
            known = called.interface.name_at(False, operand.number) if direct and called is not None else ""
            name = known or operand_text(operand)
            given = moved is expansion.given
            arguments.append(Argument(name, text if given else "", "" if given else text))
    return arguments
