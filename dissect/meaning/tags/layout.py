"""The layout of classic blocks: the place of each member of a declaration (sheet 4.1).

Places are counted in bits from the beginning of the block. If no address list of a real CPU confirms the rule for a member
(sheet 8), it gets a remark, and so do all members after it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from dissect.meaning.tags.declarations import Member, Shape
from dissect.meaning.tags.types import MAX_ARRAY, MAX_DIMENSIONS, DataType, TypeNameError, elementary, parse_bounds

#: Maximum number of members of a block, counting those of each element of an array of structures, and of levels of nested
#: types.
MAX_MEMBERS: Final = 200_000
MAX_DEPTH: Final = 32
#: Size of the pointer to a parameter that is passed by reference, in bits.
_POINTER: Final = 48
#: A string whose length is a constant.
_NAMED_LENGTH: Final = re.compile(r"(W?STRING)\[([^\]]*[^\]\d][^\]]*)\]", re.IGNORECASE)


class LayoutError(Exception):
    """A declaration cannot be laid out: the ``line`` of the member, and the reason."""

    def __init__(self, line: int, text: str) -> None:
        self.line = line
        super().__init__(text)


class Field(NamedTuple):
    """A member of a simple type, or an array of a simple type: its place, and the distance of its elements, in bits."""

    name: str
    start: int
    type: DataType
    dims: list[tuple[int, int]]
    prefix: str
    step: int
    comment: str
    line: int
    remark: str


#: Returns the shape of a type by its name (case does not matter), None if no file declares it.
Types = Callable[[str], "Shape | None"]
#: Returns the value of a constant by its name, None if it is unknown.
Constants = Callable[[str], "int | None"]


class Layout:
    """Lays out one block or type. ``fields`` are its members with their places, ``size`` its octets. Raises `LayoutError`."""

    def __init__(self, shape: Shape, types: Types, constants: Constants) -> None:
        self._types = types
        self._constants = constants
        self._chain: list[str] = []
        self.fields: list[Field] = []
        self._doubt = ""
        self.size = self._lay(shape, 0, "") // 8

    def _lay(self, shape: Shape, base: int, path: str) -> int:
        """Lay out members from bit ``base`` on; return the first bit after them, at an even byte."""
        at = base
        for section in shape.sections:
            at = _even(at)
            for member in section.members:
                if member.overlay:
                    continue
                name = f"{path}.{member.name}" if path else member.name
                at = self._member(member, name, at, section.by_reference)
        return _even(at)

    def _member(self, member: Member, name: str, at: int, by_reference: bool) -> int:
        if len(self.fields) >= MAX_MEMBERS:
            raise LayoutError(member.line, f"more than {MAX_MEMBERS} members with the elements of arrays")
        dims = [self._bounds(member, text) for text in member.bounds]
        if len(dims) > MAX_DIMENSIONS:
            raise LayoutError(member.line, f"{member.name} has {len(dims)} dimensions: at most {MAX_DIMENSIONS}")
        count = 1
        for low, high in dims:
            count *= high - low + 1
        if count > 8 * MAX_ARRAY:
            raise LayoutError(
                member.line, f"{member.name} has {count} elements: an array has at most {MAX_ARRAY} bytes"
            )
        try:
            type_ = elementary(self._sized(member)) if member.shape is None else None
        except TypeNameError as error:
            raise LayoutError(member.line, f"{member.name}: {error}") from None
        if member.type.upper() == "VARIANT":
            return at
        if by_reference and (dims or type_ is None or type_.bits > 32):
            self._doubt = f"behind {member.name}, an IN_OUT that sources disagree how to store: 6 bytes are assumed"
            return _even(at) + _POINTER
        if type_ is not None:
            return self._simple(member, name, at, type_, dims, count)
        shape = member.shape or self._named(member)
        if not dims:
            return self._nested(shape, member, name, _even(at))
        at = _even(at)
        if count * len(shape.sections) > MAX_MEMBERS:
            raise LayoutError(member.line, f"{member.name} has {count} elements: more than {MAX_MEMBERS}")
        for number in range(count):
            begin = at
            at = self._nested(shape, member, f"{name}[{_index(dims, number)}]", at)
            if (at - begin) * count > 8 * MAX_ARRAY:
                raise LayoutError(
                    member.line,
                    f"{member.name} has {(at - begin) * count // 8} bytes: an array has at most {MAX_ARRAY}",
                )
        return at

    def _nested(self, shape: Shape, member: Member, name: str, at: int) -> int:
        key = "" if member.shape is not None else member.type.lower()
        if key and key in self._chain:
            chain = " > ".join([*self._chain[self._chain.index(key) :], key])
            raise LayoutError(member.line, f"type {member.type!r} contains itself: {chain}")
        if len(self._chain) >= MAX_DEPTH:
            raise LayoutError(member.line, f"types within types more than {MAX_DEPTH} deep")
        self._chain.append(key)
        try:
            return self._lay(shape, at, name)
        finally:
            self._chain.pop()

    def _named(self, member: Member) -> Shape:
        found = self._types(member.type)
        if found is None:
            raise LayoutError(
                member.line,
                f"type {member.type!r} is not in this file or the others: export it too (.udt, .awl) and name both files",
            )
        return found

    def _bounds(self, member: Member, text: str) -> tuple[int, int]:
        low, dots, high = text.partition("..")
        texts = [self._number(member, part, "array bound") for part in (low, high)] if dots else [text]
        try:
            return parse_bounds("..".join(texts))
        except TypeNameError as error:
            raise LayoutError(member.line, f"{member.name}: {error}") from None

    def _sized(self, member: Member) -> str:
        """Return the type of a member; a constant as the length of a string is replaced by its value."""
        found = _NAMED_LENGTH.fullmatch(member.type)
        return f"{found[1]}[{self._number(member, found[2], 'length')}]" if found else member.type

    def _number(self, member: Member, text: str, what: str) -> str:
        """Return a bound or length in digits: as it is written, or the value of the constant that it names."""
        written = text.strip().lstrip("#").strip('"')
        if not written or written.lstrip("+-").isdigit():
            return written.lstrip("+")
        value = self._constants(written)
        if value is None:
            raise LayoutError(
                member.line,
                f"{member.name}: the {what} {written!r} is a constant that no file declares: "
                "name the tag table that has it too",
            )
        return str(value)

    def _simple(
        self, member: Member, name: str, at: int, type_: DataType, dims: list[tuple[int, int]], count: int
    ) -> int:
        """Lay out a member of a simple type, or an array of it; return the first bit after it."""
        if not dims:
            at = _aligned(at, type_)
            self._add(member, name, at, type_, [], "", type_.bits)
            return at + type_.bits
        at = _even(at)
        if type_.kind == "BOOL":
            return _even(self._bits(member, name, at, type_, dims))
        step = type_.bits if type_.octets == 1 else (type_.octets + 1) // 2 * 16
        if step != type_.bits and not self._doubt:
            self._doubt = f"{member.name} has strings of odd length, whose distance no real CPU settled"
        if count * step > 8 * MAX_ARRAY:
            raise LayoutError(member.line, f"{member.name} has {count * step // 8} bytes: at most {MAX_ARRAY}")
        self._add(member, name, at, type_, dims, "", step)
        return _even(at + count * step)

    def _bits(self, member: Member, name: str, at: int, type_: DataType, dims: list[tuple[int, int]]) -> int:
        """Lay out an array of bits: they are packed; with several dimensions, each row of the last one begins a new byte."""
        if len(dims) > 1 and not self._doubt:
            self._doubt = f"{member.name} has rows of bits, whose places no real CPU settled"
        rows, row = dims[:-1], dims[-1]
        length = row[1] - row[0] + 1
        total = 1
        for low, high in rows:
            total *= high - low + 1
        if total > MAX_MEMBERS:
            raise LayoutError(member.line, f"{member.name} has {total} rows: more than {MAX_MEMBERS}")
        for number in range(total):
            prefix = f"{_index(rows, number)}," if rows else ""
            self._add(member, name, at, type_, [row], prefix, 1)
            at = (at + length + 7) // 8 * 8 if rows else at + length
        return at

    def _add(
        self,
        member: Member,
        name: str,
        at: int,
        type_: DataType,
        dims: list[tuple[int, int]],
        prefix: str,
        step: int,
    ) -> None:
        field = Field(name, at, type_, dims, prefix, step, member.comment, member.line, self._doubt)
        self.fields.append(field)


def _index(dims: list[tuple[int, int]], number: int) -> str:
    texts: list[str] = []
    for low, high in reversed(dims):
        number, left = divmod(number, high - low + 1)
        texts.append(str(low + left))
    return ",".join(reversed(texts))


def _even(at: int) -> int:
    return (at + 15) // 16 * 16


def _aligned(at: int, type_: DataType) -> int:
    """Return the next place at which a member of a type may begin."""
    if type_.kind == "BOOL":
        return at
    return _even(at) if type_.even else (at + 7) // 8 * 8


def type_names(shape: Shape) -> Iterator[tuple[str, int]]:
    """Yield the name and line of every type in a shape that is not one of S7's own types."""
    for section in shape.sections:
        for member in section.members:
            if member.shape is not None:
                yield from type_names(member.shape)
                continue
            try:
                if _NAMED_LENGTH.fullmatch(member.type):
                    continue
                if elementary(member.type) is None and member.type.upper() != "VARIANT":
                    yield member.type, member.line
            except TypeNameError:
                continue
