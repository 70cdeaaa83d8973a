"""The interface of a block (SSB): its declarations, with types and offsets, but without names, because a block has none.

A declaration is named by its section and its number in that section: ``IN0``, ``TEMP3``; a member of a structure also by its
own number: ``STAT1.m0``. Source: reference sheet mc7.md, section 3; numbers are little-endian.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dissect.wire.codes import CodeTable

KINDS: Final = CodeTable(
    "kind of interface",
    2,
    [(0x01, "code block", ""), (0x05, "global DB", ""), (0x0A, "instance DB", "The number is that of its FB.")],
)
SECTIONS: Final = CodeTable(
    "section of a declaration",
    1,
    [(1, "IN", ""), (2, "OUT", ""), (3, "IN_OUT", ""), (4, "STAT", ""), (5, "TEMP", ""), (6, "RET_VAL", "")],
)
#: Sections of parameters, which a caller passes.
PARAMETERS: Final = (1, 2, 3, 6)
TEMP: Final = 5

TYPES: Final = CodeTable(
    "type of a declaration",
    2,
    [
        (0x01, "BOOL", ""),
        (0x02, "BYTE", ""),
        (0x03, "CHAR", ""),
        (0x04, "WORD", ""),
        (0x05, "INT", ""),
        (0x06, "DWORD", ""),
        (0x07, "DINT", ""),
        (0x08, "REAL", ""),
        (0x09, "DATE", ""),
        (0x0A, "TIME_OF_DAY", ""),
        (0x0B, "TIME", ""),
        (0x0C, "S5TIME", ""),
        (0x0E, "DATE_AND_TIME", ""),
        (0x10, "ARRAY", ""),
        (0x11, "STRUCT", "A user-defined type looks the same."),
        (0x13, "STRING", ""),
        (0x14, "POINTER", ""),
        (0x15, "FB", "Multi-instance."),
        (0x16, "ANY", ""),
        (0x17, "BLOCK_FB", ""),
        (0x18, "BLOCK_FC", ""),
        (0x19, "BLOCK_DB", ""),
        (0x1A, "BLOCK_SDB", ""),
        (0x1B, "SFB", "Multi-instance."),
        (0x1C, "COUNTER", ""),
        (0x1D, "TIMER", ""),
    ],
)
BOOL: Final = 0x01
ARRAY: Final = 0x10
STRUCT: Final = 0x11
STRING: Final = 0x13
INSTANCES: Final = frozenset((0x15, 0x1B))
#: Types with whole bytes that need no even address; below, the size in bytes of each type of fixed size.
_BYTES: Final = frozenset((0x02, 0x03))
_SIZES: Final[dict[int, int]] = {
    **dict.fromkeys((0x02, 0x03), 1),
    **dict.fromkeys((0x04, 0x05, 0x09, 0x0C, 0x17, 0x18, 0x19, 0x1A, 0x1C, 0x1D), 2),
    **dict.fromkeys((0x06, 0x07, 0x08, 0x0A, 0x0B), 4),
    0x0E: 8,
    0x14: 6,
    0x16: 10,
}

HEAD: Final = 7
_HAS_START: Final = 0x08
_HAS_ATTRIBUTE: Final = 0x10

#: Maximum number of declarations and levels of an interface: it has at most 65535 bytes, two for each declaration.
MAX_DECLARATIONS: Final = 32768
MAX_DEPTH: Final = 16


class Declaration:
    """One declaration.

    ``section`` is its section byte, -1 if it has none (multi-instances); ``attribute`` is the byte after that, -1 for none.
    ``bounds`` are the dimensions of an array; ``members`` are the element of an array, or the members of a structure. ``extra``
    is the length of a STRING or the number of an FB. ``wide``: the number of members has 16 bits. ``start`` is its first bit in
    the memory of its section and ``bits`` its size, both -1 if unknown.
    """

    __slots__ = (
        "attribute",
        "bits",
        "bounds",
        "extra",
        "initial",
        "members",
        "name",
        "section",
        "start",
        "type",
        "wide",
    )

    def __init__(self, type_: int) -> None:
        self.type = type_
        self.section = -1
        self.attribute = -1
        self.bounds: list[tuple[int, int]] = []
        self.members: list[Declaration] = []
        self.extra = 0
        self.wide = False
        self.name = ""
        self.start = -1
        self.bits = -1
        self.initial = b""

    @property
    def place(self) -> int:
        """The number of its section, STAT for multi-instances."""
        return self.section & 7 if self.section >= 0 else 4

    @property
    def has_start(self) -> bool:
        """True if its start value is given after the declarations."""
        return self.section >= 0 and self.section & _HAS_START != 0

    @property
    def type_text(self) -> str:
        """The type as STL text: ``ARRAY [0..9] OF INT``, ``STRING[20]``, ``FB 5``."""
        if self.type == ARRAY:
            bounds = ",".join([f"{low}..{high}" for low, high in self.bounds])
            return f"ARRAY [{bounds}] OF {self.members[0].type_text if self.members else '?'}"
        if self.type == STRING:
            return f"STRING[{self.extra}]"
        if self.type in INSTANCES:
            return f"{TYPES.name(self.type)} {self.extra}"
        return TYPES.name(self.type)


class Interface:
    """The interface of a block, as far as it is readable.

    ``used`` is the number of bytes of the declarations that were read; ``fault`` is why reading stopped before the stated end,
    empty if it did not. ``starts`` are the start values, ``rest`` the bytes after them.
    """

    def __init__(self) -> None:
        self.kind = 0
        self.number = 0
        self.declared = 0
        self.start_length = 0
        self.used = 0
        self.declarations: list[Declaration] = []
        self.starts = b""
        self.rest = b""
        self.fault = ""

    def of(self, section: int) -> list[Declaration]:
        """Return the declarations of a section."""
        return [declaration for declaration in self.declarations if declaration.place == section]

    @property
    def parameters(self) -> list[Declaration]:
        """The parameters that a caller passes, in this order: IN, OUT, IN_OUT, RET_VAL."""
        return [declaration for section in PARAMETERS for declaration in self.of(section)]

    def name_at(self, temporary: bool, bit: int) -> str:
        """Return the name of the declaration that begins at a bit of the temporary data or of the instance, empty for none."""
        for declaration in self.declarations:
            if (declaration.place == TEMP) == temporary and declaration.start >= 0:
                name = _name_at(declaration, bit - declaration.start)
                if name:
                    return name
        return ""

    @property
    def temp_bits(self) -> int:
        """Bits of the declared temporary data, -1 if unknown."""
        return _end(self.of(TEMP))


def _name_at(declaration: Declaration, bit: int) -> str:
    """Return the name of the part of a declaration that begins ``bit`` bits after the declaration."""
    if bit < 0 or (declaration.bits >= 0 and bit >= max(declaration.bits, 1)):
        return ""
    if declaration.type == STRUCT:
        return next((name for each in declaration.members if (name := _name_at(each, bit - each.start))), "")
    if declaration.type == ARRAY and declaration.members and declaration.members[0].bits > 0:
        element = declaration.members[0]
        step = element_step(element)
        if len(declaration.bounds) != 1:
            return f"{declaration.name}[]" if bit % step == 0 else ""
        inner = _name_at(element, bit % step)
        index = declaration.bounds[0][0] + bit // step
        return f"{declaration.name}[{index}]{inner.removeprefix(element.name)}" if inner else ""
    return declaration.name if bit == 0 else ""


def _end(declarations: list[Declaration]) -> int:
    end = 0
    for declaration in declarations:
        if declaration.start < 0 or declaration.bits < 0:
            return -1
        end = declaration.start + declaration.bits
    return end


class _Reader:
    """Reads declarations one after another; ``fault`` says why it stopped."""

    def __init__(self, octets: bytes) -> None:
        self._octets = octets
        self.at = 0
        self.count = 0
        self.fault = ""

    def take(self, size: int, what: str) -> int:
        """Return the next number; if its bytes are missing, return -1 and set ``fault``."""
        if self.at + size > len(self._octets):
            self.fault = self.fault or f"{what} at byte {HEAD + self.at} is cut off"
            return -1
        value = int.from_bytes(self._octets[self.at : self.at + size], "little")
        self.at += size
        return value

    def read(self, depth: int) -> Declaration | None:
        """Return the next declaration; None if it cannot be read."""
        begin = self.at
        type_ = self.take(1, "a declaration")
        if type_ not in TYPES:
            self.fault = self.fault or f"type {type_:#04x} at byte {HEAD + begin} is unknown"
            return None
        self.count += 1
        if depth > MAX_DEPTH or self.count > MAX_DECLARATIONS:
            self.fault = f"more than {MAX_DEPTH} levels or {MAX_DECLARATIONS} declarations at byte {HEAD + begin}"
            return None
        declaration = Declaration(type_)
        if type_ in INSTANCES:
            declaration.extra = self.take(2, "the number of a block")
            return declaration if not self.fault else None
        declaration.section = self.take(1, "a section")
        if declaration.section >= 0 and declaration.section & _HAS_ATTRIBUTE:
            declaration.attribute = self.take(1, "an attribute")
        if type_ == ARRAY:
            self._array(declaration, depth)
        elif type_ == STRUCT:
            self._members(declaration, depth)
        elif type_ == STRING:
            declaration.extra = self.take(1, "the length of a STRING")
        return declaration if not self.fault else None

    def _array(self, declaration: Declaration, depth: int) -> None:
        dimensions = self.take(1, "the number of dimensions")
        for _ in range(dimensions):
            low, high = self.take(2, "a bound"), self.take(2, "a bound")
            if self.fault:
                return
            declaration.bounds.append((_signed(low), _signed(high)))
        element = self.read(depth + 1)
        if element is not None:
            declaration.members.append(element)

    def _members(self, declaration: Declaration, depth: int) -> None:
        count = self.take(1, "the number of members")
        if count == 0xFF:
            count = self.take(2, "the number of members")
            declaration.wide = True
        for _ in range(count):
            member = self.read(depth + 1)
            if member is None:
                return
            declaration.members.append(member)


def _signed(value: int) -> int:
    return value - 0x10000 if value & 0x8000 else value


def parse_interface(octets: bytes) -> Interface:
    """Return the interface in an SSB, read as far as possible. Never raises."""
    interface = Interface()
    if len(octets) < HEAD:
        interface.fault = f"the interface has {len(octets)} bytes, its head needs {HEAD}" if octets else ""
        interface.rest = octets
        return interface
    interface.kind = octets[0]
    interface.number = int.from_bytes(octets[1:3], "little")
    interface.declared = int.from_bytes(octets[3:5], "little")
    interface.start_length = int.from_bytes(octets[5:7], "little")
    behind = HEAD + interface.declared
    reader = _Reader(octets[HEAD:behind])
    while reader.at < len(octets[HEAD:behind]):
        begin = reader.at
        declaration = reader.read(0)
        if declaration is None:
            reader.at = begin
            break
        interface.declarations.append(declaration)
    interface.used = reader.at
    interface.fault = reader.fault
    if behind > len(octets):
        interface.fault = (
            interface.fault or f"{interface.declared} bytes of declarations, {len(octets) - HEAD} are there"
        )
    elif interface.start_length > len(octets) - behind:
        there = f"{len(octets) - behind} are there"
        interface.fault = interface.fault or f"{interface.start_length} bytes of start values, {there}"
    interface.starts = octets[behind : behind + interface.start_length]
    interface.rest = octets[behind + interface.start_length :]
    name_declarations(interface.declarations)
    _lay_out(interface)
    _take_starts(interface)
    return interface


def name_declarations(declarations: list[Declaration]) -> None:
    """Name the declarations by section and number, and members by their number."""
    counts: dict[int, int] = {}
    for declaration in declarations:
        place = declaration.place
        number = counts.get(place, 0)
        counts[place] = number + 1
        declaration.name = SECTIONS.name(place) + ("" if place == 6 else str(number))
        _name_members(declaration)


def _name_members(declaration: Declaration) -> None:
    for number, member in enumerate(declaration.members):
        member.name = f"{declaration.name}[]" if declaration.type == ARRAY else f"{declaration.name}.m{number}"
        _name_members(member)


def _lay_out(interface: Interface) -> None:
    """Set the offset of each declaration: TEMP counts from 0, the other sections together form one instance."""
    temporary = [declaration for declaration in interface.declarations if declaration.place == TEMP]
    kept = [declaration for section in (1, 2, 3, 4, 6) for declaration in interface.of(section)]
    for declarations in (temporary, kept):
        at = 0
        place = -1
        for declaration in declarations:
            if declaration.place != place and at >= 0:
                at = _even(at)  # each section begins at an even address
                place = declaration.place
            at = _lay(declaration, at)


def _even(bit: int) -> int:
    return (bit + 15) // 16 * 16


def _lay(declaration: Declaration, at: int) -> int:
    """Set the offset of a declaration to bit ``at`` or later; return the first bit after it, -1 if unknown."""
    if at < 0:
        return -1
    size, begin = _size(declaration, at)
    declaration.start = begin
    declaration.bits = size
    return begin + size if size >= 0 else -1


def _size(declaration: Declaration, at: int) -> tuple[int, int]:
    """Return the size of a declaration in bits (-1 if unknown), and its first bit."""
    type_ = declaration.type
    if type_ == BOOL:
        return 1, at
    if type_ in _BYTES:
        return 8, (at + 7) // 8 * 8
    begin = _even(at)
    if type_ == STRUCT:
        end = 0
        for member in declaration.members:
            end = _lay(member, end)
            if end < 0:
                return -1, begin
        return _even(end), begin
    if type_ == ARRAY:
        return _array_bits(declaration), begin
    if type_ == STRING:
        return _even(8 * (declaration.extra + 2)), begin
    if type_ in INSTANCES:
        return -1, begin
    return 8 * _SIZES[type_], begin


def _array_bits(declaration: Declaration) -> int:
    if not declaration.members:
        return -1
    element = declaration.members[0]
    size, _ = _size(element, 0)
    element.start, element.bits = 0, size
    count = 1
    for low, high in declaration.bounds:
        count *= max(high - low + 1, 0)
    if size < 0:
        return -1
    if element.type == BOOL and len(declaration.bounds) > 1:
        low, high = declaration.bounds[-1]
        row = max(high - low + 1, 1)
        return _even(count // row * ((row + 7) // 8 * 8))
    return _even(count * element_step(element))


def element_step(element: Declaration) -> int:
    """Return the distance of an array's elements in bits: bits and bytes are packed, others begin at even addresses."""
    return element.bits if element.type in _BYTES or element.type == BOOL else _even(element.bits)


def _take_starts(interface: Interface) -> None:
    """Set the start values of declarations with a single value; it is unknown how arrays repeat theirs."""
    at = 0
    for declaration in _starting(interface.declarations):
        size = start_size(declaration)
        if size < 0 or at + size > len(interface.starts):
            return
        declaration.initial = interface.starts[at : at + size]
        at += size


def _starting(declarations: list[Declaration]) -> Iterator[Declaration]:
    for declaration in declarations:
        if declaration.has_start:
            yield declaration
        elif declaration.type == STRUCT:
            yield from _starting(declaration.members)


def start_size(declaration: Declaration) -> int:
    """Return the bytes of a start value, -1 if unknown."""
    if declaration.type == BOOL:
        return 1
    return _SIZES.get(declaration.type, -1)


def stated_start_length(interface: Interface) -> int:
    """Return the number of bytes of all start values of the declarations, -1 if one of them is unknown."""
    total = 0
    for declaration in _starting(interface.declarations):
        size = start_size(declaration)
        if size < 0:
            return -1
        total += size
    return total


def interface_octets(interface: Interface) -> bytes:
    """Return the octets of an SSB that `parse_interface` reads as ``interface``."""
    declared = b"".join([_declaration_octets(declaration) for declaration in interface.declarations])
    head = bytes((interface.kind,)) + interface.number.to_bytes(2, "little")
    lengths = len(declared).to_bytes(2, "little") + len(interface.starts).to_bytes(2, "little")
    return head + lengths + declared + interface.starts + interface.rest


def _declaration_octets(declaration: Declaration) -> bytes:
    octets = bytes((declaration.type,))
    if declaration.type in INSTANCES:
        return octets + declaration.extra.to_bytes(2, "little")
    octets += bytes((declaration.section,))
    if declaration.attribute >= 0:
        octets += bytes((declaration.attribute,))
    if declaration.type == ARRAY:
        octets += bytes((len(declaration.bounds),))
        for low, high in declaration.bounds:
            octets += (low & 0xFFFF).to_bytes(2, "little") + (high & 0xFFFF).to_bytes(2, "little")
    elif declaration.type == STRUCT:
        count = len(declaration.members)
        octets += b"\xff" + count.to_bytes(2, "little") if declaration.wide else bytes((count,))
    elif declaration.type == STRING:
        octets += bytes((declaration.extra,))
    return octets + b"".join([_declaration_octets(member) for member in declaration.members])
