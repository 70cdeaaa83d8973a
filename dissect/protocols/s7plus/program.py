"""`Program`: the captured part of the program of a CPU, which has the names of the variables of its blocks.

With these names, addresses are shown as people write them. Explore responses and downloads have an object of class 511 for each
block, with a list of its variables and a list of their names.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.ids import AREAS, BLOCK_KINDS, DATA_BLOCK, TYPE_KINDS, block_name
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.stamps import next_stamp
from dissect.protocols.s7plus.variables import NameList, Variable, VariableList
from dissect.wire.copies import leaves

#: Class of an object that describes a type.
TYPE_INFO: Final = 511
#: Attributes with the code of a block.
CODE: Final = frozenset((2533, 2580))
#: Maximum number of variables that are remembered per CPU; beyond that, those seen first are forgotten.
MAX_VARIABLES: Final = 200_000
#: The members of nested structures are listed up to this depth.
_LEVELS: Final = 8
#: First octet of the id of an area's type information, and the areas by the second octet (one source only).
_AREA_TYPES: Final = 0x90
_AREA_ORDER: Final[dict[int, int]] = {1: 80, 2: 81, 3: 82, 4: 83, 5: 84}
#: The number between element index and member in the address of a member of an array of structures (one source).
_ELEMENT: Final = 1
#: Datatypes whose characters may be addressed by first character and count.
_STRINGS: Final = frozenset((19, 62))


class TypeInformation:
    """The variables of a type; they stay octets until one of them is needed."""

    __slots__ = ("_known", "_names", "_variables", "count")

    def __init__(self, names: list[NameList], variables: list[VariableList]) -> None:
        self._names = names
        self._variables = variables
        self._known: dict[int, tuple[str, Variable]] | None = None
        self.count = sum([one.count for one in names])

    @property
    def known(self) -> dict[int, tuple[str, Variable]]:
        """Names and variables by LID."""
        known = self._known
        if known is None:
            names = [name for one in self._names for name in one.names]
            variables = [variable for one in self._variables for variable in one.variables]
            known = {variable.lid: (name, variable) for name, variable in zip(names, variables, strict=True)}
            self._known = known
            self._names = []
            self._variables = []
        return known


#: Maximum number of blocks and areas whose type is remembered.
_MAX_AREAS: Final = 4096


class Program:
    """The variables of a CPU's blocks and areas, by the id of their type information.

    ``stamp`` is 0 until a type was captured. Each change sets a number that no other program has.
    """

    __slots__ = ("_count", "_of_areas", "_types", "stamp")

    def __init__(self) -> None:
        self._types: OrderedDict[int, TypeInformation] = OrderedDict()
        self._of_areas: dict[int, int] = {}  # results of `_type_of`
        self._count = 0
        self.stamp: i64 = 0

    def learn(self, objects: list[PlusObject]) -> None:
        """Take the type information among ``objects`` (not inside them); it replaces what was known about the same type."""
        for one in objects:
            if one.class_id != TYPE_INFO:
                continue
            names, variables = one.lists
            told = TypeInformation(names, variables)
            if told.count == 0 or told.count != sum([listed.count for listed in variables]):
                continue  # no names, or lists that contradict each other
            self._forget(one.rid)
            self._types[one.rid] = told
            self._changed()
            self._count += told.count
            while self._count > MAX_VARIABLES and len(self._types) > 1:
                self._forget(next(iter(self._types)))

    @property
    def count(self) -> int:
        """Number of remembered variables, including those of types."""
        return self._count

    def adopt(self, other: Program) -> None:
        """Add the types that ``other`` knows and this program does not."""
        for rid, told in other._types.items():
            if rid not in self._types:
                self._types[rid] = told
                self._changed()
                self._count += told.count

    def symbols(self) -> list[Symbol]:
        """Return the variables of blocks and areas, with the members of structures, at most `MAX_VARIABLES`."""
        found: list[Symbol] = []
        for rid in sorted(self._types):
            kind = TYPE_KINDS.get(rid >> 24)
            place = (
                f"{kind}{rid & 0xFFFF}"
                if kind == "DB"
                else AREAS.get(_area(rid), "")
                if rid >> 24 == _AREA_TYPES
                else ""
            )
            if place:
                self._list(found, rid, place, "", "", 0)
        return found

    def _list(self, found: list[Symbol], type_id: int, place: str, path: str, lids: str, depth: int) -> None:
        known = self._known(type_id)
        if known is None or depth > _LEVELS:
            return
        for lid, (name, variable) in known.items():
            if len(found) >= MAX_VARIABLES:
                return
            inner = f"{path}.{name}" if path else f'"{name}"'
            where = f"{lids}.{lid}" if lids else str(lid)
            found.append(Symbol(f"{place}.{inner}", f"{place} LID {where}", variable))
            if variable.type_id and not variable.is_array:
                self._list(found, variable.type_id, place, inner, where, depth + 1)

    def _forget(self, type_id: int) -> None:
        told = self._types.pop(type_id, None)
        if told is not None:
            self._changed()
            self._count -= told.count

    def _changed(self) -> None:
        """Note that the types have changed."""
        self._of_areas.clear()
        self.stamp = next_stamp()

    def _known(self, type_id: int) -> dict[int, tuple[str, Variable]] | None:
        told = self._types.get(type_id)
        return told.known if told is not None else None

    def find(self, address: VariableAddress) -> AddressMeaning | None:
        """Return the meaning of an address; None if its type is unknown, or the checksum of its symbol differs."""
        if not self._types or not address.lids:
            return None
        known = self._known(self._type_of(address.area))
        if known is None:
            return None
        return self._walk(address, known)

    def _type_of(self, area: int) -> int:
        """Return the id of the type information of a block or area, -1 if it was not captured."""
        found = self._of_areas.get(area)
        if found is None:
            if len(self._of_areas) >= _MAX_AREAS:
                self._of_areas.clear()
            found = self._seek_type(area)
            self._of_areas[area] = found
        return found

    def _seek_type(self, area: int) -> int:
        if area in AREAS:
            for rid in self._types:
                if rid >> 24 == _AREA_TYPES and _area(rid) == area:
                    return rid
        elif area >> 16 == DATA_BLOCK:
            kind = BLOCK_KINDS[DATA_BLOCK]
            for rid in self._types:
                if rid & 0xFFFF == area & 0xFFFF and TYPE_KINDS.get(rid >> 24) == kind:
                    return rid
        return -1

    def _walk(self, address: VariableAddress, known: dict[int, tuple[str, Variable]]) -> AddressMeaning | None:
        lids = address.lids
        entry = known.get(lids[0])
        if entry is None:
            return None
        name, variable = entry
        if _is_other(address, variable):
            return None  # these names belong to another program
        path = f'"{name}"'
        at = 1
        element = False
        while at < len(lids):
            if variable.is_array and not element:
                index = variable.index_text(lids[at])
                if not index:
                    break
                path += index
                element = True
                at += 1
                if variable.type_id and at + 1 < len(lids) and lids[at] == _ELEMENT:
                    at += 1
                continue
            if variable.datatype in _STRINGS and lids[at] == 0 and at == len(lids) - 2:
                at = len(lids)  # all characters from the first one on: the string itself
                break
            members = self._known(variable.type_id)
            below = members.get(lids[at]) if members is not None else None
            if below is None:
                break
            name, variable = below
            element = False
            path += f".{name}"
            at += 1
        if at < len(lids):
            return AddressMeaning(f"{path} LID {'.'.join([str(lid) for lid in lids[at:]])}", None, False)
        return AddressMeaning(path, variable, variable.is_array and not element)

    def doubt(self, address: VariableAddress) -> str:
        """Return why an address has no name although its type was captured; empty if there is no such reason."""
        if not self._types:
            return ""
        known = self._known(self._type_of(address.area))
        entry = known.get(address.lids[0]) if known is not None and address.lids else None
        if entry is None or not _is_other(address, entry[1]):
            return ""
        return f"CRC 0x{entry[1].crc:08x} in the program that passed, which differs: no name"

    def members(self, type_id: int) -> list[tuple[str, Variable]] | None:
        """Return the names and variables of a type; None if it was not captured."""
        known = self._known(type_id)
        return list(known.values()) if known is not None else None


def _is_other(address: VariableAddress, variable: Variable) -> bool:
    """Return whether the checksum of an address differs from that of the declaration. For members the rule is not known."""
    return address.crc != 0 and len(address.lids) == 1 and variable.crc != 0 and address.crc != variable.crc


class Symbol:
    """A variable by ``name`` and ``address``, written as in transactions."""

    __slots__ = ("address", "name", "variable")

    def __init__(self, name: str, address: str, variable: Variable) -> None:
        self.name = name
        self.address = address
        self.variable = variable

    @property
    def declared(self) -> str:
        """The declared type: ``Real``, ``Array[0..9] of Int``."""
        variable = self.variable
        bounds = ",".join([f"{low}..{low + count - 1}" for low, count in reversed(variable.dimensions)])
        return f"Array[{bounds}] of {variable.datatype_name}" if bounds else variable.datatype_name


class AddressMeaning:
    """The meaning of an address: the path of names, and the variable; None if the address continues in an unknown structure.

    ``whole_array``: the variable is an array, and the address is not that of an element.
    """

    __slots__ = ("path", "variable", "whole_array")

    def __init__(self, path: str, variable: Variable | None, whole_array: bool) -> None:
        self.path = path
        self.variable = variable
        self.whole_array = whole_array


def symbol(address: VariableAddress, found: AddressMeaning) -> str:
    """Return an address with the names of the program: ``DB3."tank".level``, ``M."lamp"``."""
    return f"{block_name(address.area) or AREAS.get(address.area, '')}.{found.path}"


def _area(type_id: int) -> int:
    return _AREA_ORDER.get(type_id >> 16 & 0xFF, -1)


leaves(Program, TypeInformation)
