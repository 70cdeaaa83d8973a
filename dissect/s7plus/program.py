"""What passed of the program of a CPU: the names of the variables of its blocks.

By them addresses are shown as people write them. Explore answers and downloads carry, for each block, an object of class 511
with the list of its variables and of their names.
"""

from __future__ import annotations

from typing import Final

from dissect.s7plus.contents import Address
from dissect.s7plus.ids import AREAS, BLOCK_KINDS, DATA_BLOCK, TYPE_KINDS, block_name
from dissect.s7plus.objects import PlusObject, every_object
from dissect.s7plus.variables import Variable

#: Class of an object that describes a type.
TYPE_INFO: Final = 511
#: Variables that are remembered of one CPU; when there are more, those that came first are forgotten.
MAX_VARIABLES: Final = 200_000
#: First octet of the id of the type information of areas, and the areas by the octet behind it (one source only).
_AREA_TYPES: Final = 0x90
_AREA_ORDER: Final[dict[int, int]] = {1: 80, 2: 81, 3: 82, 4: 83, 5: 84}
#: Kinds of variables that have elements with an index, and kinds that have members.
_ARRAYS: Final = frozenset((3, 10))
_STRUCTS: Final = frozenset((5, 12))


class Program:
    """The variables of a CPU's blocks and areas, by the id of their type information."""

    __slots__ = ("_count", "_types")

    def __init__(self) -> None:
        self._types: dict[int, dict[int, tuple[str, Variable]]] = {}
        self._count = 0

    def learn(self, objects: list[PlusObject]) -> None:
        """Take the type information among objects; what was known of the same type before is replaced."""
        for one in every_object(objects):
            if one.class_id != TYPE_INFO:
                continue
            names, variables = one.names, one.variables
            if not names or len(names) != len(variables):
                continue  # no names, or lists that contradict each other
            self._forget(one.rid)
            pairs = zip(names, variables, strict=True)
            self._types[one.rid] = {variable.lid: (name, variable) for name, variable in pairs}
            self._count += len(self._types[one.rid])
            while self._count > MAX_VARIABLES and len(self._types) > 1:
                self._forget(next(iter(self._types)))

    def _forget(self, type_id: int) -> None:
        self._count -= len(self._types.pop(type_id, {}))

    def find(self, address: Address) -> Found | None:
        """Return what an address means, None when its type is not known, or the checksum of its symbol differs."""
        type_id = self._type_of(address.area)
        known = self._types.get(type_id)
        if known is None or not address.lids:
            return None
        return self._walk(address, known)

    def _type_of(self, area: int) -> int:
        """Return the id of the type information of a block or an area, as far as it passed; -1 for none."""
        if area in AREAS:
            return next((rid for rid in self._types if rid >> 24 == _AREA_TYPES and _area(rid) == area), -1)
        kind = BLOCK_KINDS.get(area >> 16)
        if area >> 16 != DATA_BLOCK or kind is None:
            return -1
        return next(
            (rid for rid in self._types if TYPE_KINDS.get(rid >> 24) == kind and rid & 0xFFFF == area & 0xFFFF), -1
        )

    def _walk(self, address: Address, known: dict[int, tuple[str, Variable]]) -> Found | None:
        lids = address.lids
        entry = known.get(lids[0])
        if entry is None:
            return None
        name, variable = entry
        if address.crc and len(lids) == 1 and variable.crc and address.crc != variable.crc:
            return None  # the program is not the one whose names these are
        path = f'"{name}"'
        at = 1
        while at < len(lids):
            if variable.kind in _ARRAYS and at == len(lids) - 1:
                path += f"[{lids[at] + variable.lower_bound}]"
                at += 1
                continue
            members = self._types.get(variable.type_id) if variable.kind in _STRUCTS else None
            below = members.get(lids[at]) if members is not None else None
            if below is None:
                return Found(f"{path} LID {'.'.join([str(lid) for lid in lids[at:]])}", None)
            name, variable = below
            path += f".{name}"
            at += 1
        return Found(path, variable)


class Found:
    """The meaning of an address: the path of names, and the variable; None where it goes on in what is not known."""

    __slots__ = ("path", "variable")

    def __init__(self, path: str, variable: Variable | None) -> None:
        self.path = path
        self.variable = variable


def symbol(address: Address, found: Found) -> str:
    """Return an address with the names of the program: ``DB3."tank".level``, ``M."lamp"``."""
    return f"{block_name(address.area) or AREAS.get(address.area, '')}.{found.path}"


def _area(type_id: int) -> int:
    return _AREA_ORDER.get(type_id >> 16 & 0xFF, -1)
