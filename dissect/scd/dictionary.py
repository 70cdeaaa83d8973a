"""The dictionary (R56-R96): objects by index or name, types, PDOs, identity.

>>> od[0x6000][1], od["Pump 1"]["run"], od["Pump 1.run"], od.variable("0x6000:1")  # doctest: +SKIP
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from hashlib import sha256
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, overload

from dissect.scd import ranges
from dissect.scd.assembly import assemble_object, assemble_struct, assemble_types, readout_object
from dissect.scd.binary import build_file, wire_id
from dissect.scd.check import check_body
from dissect.scd.errors import (
    E_INDEX,
    E_MAP,
    E_PDO_NUMBER,
    E_TYPE,
    ERROR_TEXTS,
    DictionaryError,
    Error,
    Troubles,
    shown,
)
from dissect.scd.mapping import entries_of, place
from dissect.scd.model import DEFTYPE, NULL, Object, Pdo, StructType, Variable
from dissect.scd.records import Body, EnvelopeRecord
from dissect.scd.types import STANDARD_NAMES, UINT64, SimpleType
from dissect.wire.config.hints import close_to
from dissect.wire.config.saving import save
from dissect.wire.text import some

if TYPE_CHECKING:
    from dissect.scd.layout import Key
    from dissect.scd.wording import SharedTexts

_ADDRESS: Final = re.compile(r"(0[xX][0-9a-fA-F]{1,4})(?:[:.]([0-9]{1,3}|0[xX][0-9a-fA-F]{1,2}))?")
_PDO: Final = re.compile(r"([RTrt])(?:PDO\s*)?([0-9]{1,4})")
#: How many PDOs an error names.
_MOST_PDOS: Final = 16


class Dictionary:
    """A checked dictionary; made by `loading.load` and `loading.compile_source`, or from records.

    Raises `DictionaryError` for records that break a rule. ``objects``, ``types`` (SimpleType and StructType by index, with the
    standard ones), ``rpdo`` and ``tpdo`` are read-only mappings in ascending order.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return Dictionary, (self.body,)

    def __init__(self, body: Body) -> None:
        check_body(body)
        self.body: Final = body
        self.name: Final = body.name
        self.version: Final = body.version
        self.time_scale: Final = body.time_scale
        self.encoding: Final = body.encoding
        self.envelope: Final[EnvelopeRecord | None] = body.envelope
        simple = assemble_types(body.types, body.time_scale, body.encoding)
        structs = {record.index: assemble_struct(record, simple) for record in body.structs}
        types: dict[int, SimpleType | StructType] = {**simple, **structs}
        self.types: Final[Mapping[int, SimpleType | StructType]] = MappingProxyType(dict(sorted(types.items())))
        self.type_names: Final[Mapping[str, int]] = MappingProxyType(
            {
                **STANDARD_NAMES,
                **{row.name: row.index for row in body.types},
                **{row.name: row.index for row in body.structs},
            }
        )
        self.objects: Final[Mapping[int, Object]] = MappingProxyType(
            {record.index: assemble_object(record, simple, structs) for record in body.objects}
        )
        self.names: Final[Mapping[str, int]] = MappingProxyType(
            {row.name: row.index for row in body.objects if row.name}
        )
        self.errors: Final[Mapping[int, str]] = MappingProxyType(
            {**(dict(body.errors) if body.errors else ERROR_TEXTS), 0: ERROR_TEXTS[0]}
        )
        self.rpdo: Final[Mapping[int, Pdo]] = MappingProxyType(self._pdos("R"))
        self.tpdo: Final[Mapping[int, Pdo]] = MappingProxyType(self._pdos("T"))
        #: Data shared by all rows of a variable, made when it is first needed (`dissect.scd.wording`).
        self.told: Final[dict[Key, SharedTexts]] = {}

    def _pdos(self, direction: str) -> dict[int, Pdo]:
        first = ranges.PDO_BASES[direction, "map"]
        pdos = {}
        troubles = Troubles()
        for index, obj in self.objects.items():
            if first <= index < first + ranges.MAX_PDO and obj.object_class != NULL:
                used = obj[0].default
                count = used if isinstance(used, int) else 0
                with troubles:
                    pdo = self._mapped(index, [_whole(field.default) for field in obj.fields[:count]])
                    pdos[pdo.number] = pdo
        troubles.done()
        return pdos

    def _mapped(self, index: int, entries: Sequence[int]) -> Pdo:
        try:
            return self.with_mapping(index, entries)
        except Error as error:
            raise DictionaryError(error.where, error.detail, rule="R103", code=E_MAP, index=index) from None

    def with_mapping(self, index: int, entries: Sequence[int]) -> Pdo:
        """Return the PDO of the mapping object at ``index`` as it would be with other ``entries`` (values of its elements).

        This is for a mapping that is rewritten in traffic; the dictionary does not change. Raises `Error`: E_INDEX if ``index``
        is not a mapping object, E_MAP for a wrong entry.
        """
        obj = self.objects.get(index)
        if obj is None or obj.object_class == NULL or not ranges.is_mapping(index):
            raise Error(E_INDEX, f"0x{index:04x}", "no mapping object of a PDO")
        direction, _, number = ranges.pdo_of_index(index)
        where = f"0x{index:04x} {obj.name!r}"
        if len(entries) > len(obj.fields):
            raise Error(E_MAP, where, f"{len(entries)} entries, the object has {len(obj.fields)}")
        wide = obj.type is UINT64
        mapped, bits = place(entries_of(entries, wide, where), direction, self._find, where)
        comm = self.objects.get(ranges.pdo_index(direction, "comm", number))
        node, version = _communication(comm)
        return Pdo(direction, number, obj.name, obj, comm, mapped, bits, node, version)

    def _find(self, index: int, sub: int) -> Variable:
        obj = self.objects.get(index)
        if obj is None:
            raise Error(E_INDEX, f"0x{index:04x}", f"no object 0x{index:04x}")
        return obj[sub]

    @overload
    def __getitem__(self, key: int) -> Object: ...
    @overload
    def __getitem__(
        self, key: str
    ) -> Any: ...  # of either kind, as the name says: od["Pump 1"]["run"], od["Pump 1.run"].bits

    def __getitem__(self, key: int | str) -> Object | Variable:
        """Return an object by index or name, or a variable by "object.field".

        The index of a type gives an object too: for a DEFSTRUCT with the codes of its fields (R59), for a simple type without
        any variable (R87).
        """
        if isinstance(key, str):
            return self._named(key)
        obj = self.objects.get(key)
        if obj is not None:
            return obj
        found = self.types.get(key)
        if isinstance(found, StructType):
            return readout_object(found)
        if found is not None:
            return Object(key, DEFTYPE, found.name, found, "", False, None, (), 0, {})
        raise Error(E_INDEX, f"0x{key:04x}", f"no object 0x{key:04x}")

    def _named(self, name: str) -> Object | Variable:
        index = self.names.get(name)
        if index is not None:
            return self.objects[index]
        whole, point, field = name.rpartition(".")
        index = self.names.get(whole)
        if not point or index is None:
            meant = close_to(name, self.names) or (close_to(whole, self.names) if point else "")
            raise Error(E_INDEX, name, f"no object is called {shown(name)}{meant}")
        return self.objects[index][field]

    def __contains__(self, key: object) -> bool:
        if isinstance(key, (int, str)):
            try:
                self[key]
            except Error:
                return False
            return True
        return False

    def __iter__(self) -> Iterator[Object]:
        return iter(self.objects.values())

    def __len__(self) -> int:
        return len(self.objects)

    def variable(self, key: str | tuple[int, int]) -> Variable:
        """Return a variable by (index, sub), "0x6000:1", "0x6000.1", "0x6001", a name or "object.field"."""
        if isinstance(key, tuple):
            return self[key[0]][key[1]]
        address = None if key in self.names else _ADDRESS.fullmatch(key)
        if address is not None:
            sub = address[2] or "0"
            return self[int(address[1], 16)][int(sub, 16 if "x" in sub.lower() else 10)]
        found = self._named(key)
        return found if isinstance(found, Variable) else found[0]

    def type(self, key: str | int) -> SimpleType | StructType:
        """Return a type by index or name; raises `Error` E_TYPE."""
        index = self.type_names.get(key, -1) if isinstance(key, str) else key
        if index not in self.types:
            meant = close_to(key, self.type_names) if isinstance(key, str) else ""
            raise Error(E_TYPE, str(key), f"no type {shown(key)}{meant}")
        return self.types[index]

    def pdo(self, key: str) -> Pdo:
        """Return a PDO by "T1", "R65", "TPDO 1" or its name, in this order; raises `Error` E_PDO_NUMBER."""
        match = _PDO.fullmatch(key)
        if match is not None:
            pdos = self.tpdo if match[1] in "Tt" else self.rpdo
            if int(match[2]) in pdos:
                return pdos[int(match[2])]
        for pdo in (*self.tpdo.values(), *self.rpdo.values()):
            if pdo.name == key:
                return pdo
        raise Error(E_PDO_NUMBER, key, self._no_pdo(key))

    def _no_pdo(self, key: str) -> str:
        """Return the sentence for a PDO that does not exist: it names the existing ones."""
        pdos = (*self.tpdo.values(), *self.rpdo.values())
        numbered = _PDO.fullmatch(key) is not None
        meant = "" if numbered else close_to(key, [pdo.name for pdo in pdos if pdo.name])
        there = [f"{pdo.direction}{pdo.number}" for pdo in pdos]
        if not meant:
            meant = f"; there are {some(there, _MOST_PDOS)}" if there else "; there are none"
        return f"no PDO {key if numbered else shown(key)} in the dictionary {shown(self.name)}{meant}"

    def pdo_at(self, index: int) -> Pdo | None:
        """Return the PDO whose mapping object is at ``index``, None if there is none."""
        if not ranges.is_mapping(index):
            return None
        direction, _, number = ranges.pdo_of_index(index)
        return (self.tpdo if direction == "T" else self.rpdo).get(number)

    def error_text(self, number: int) -> str:
        """Return the meaning of an ``scd_err_t`` (R52): the dictionary's text, or else one chosen by its sign."""
        return self.errors.get(number) or ("status of the application" if number > 0 else "unknown error")

    @cached_property
    def octets(self) -> bytes:
        """The compiled file."""
        return build_file(self.body)

    @cached_property
    def wire_id(self) -> bytes:
        """SHA-256 of everything that decoding depends on; names, texts, units and limits are not included."""
        return wire_id(self.body)

    @cached_property
    def file_id(self) -> bytes:
        """SHA-256 of the compiled file (R18)."""
        return sha256(self.octets).digest()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the compiled file, completely or not at all. Raises `OSError`."""
        save(path, self.octets)

    def __repr__(self) -> str:
        return f"<Dictionary {self.name!r} {self.version} {len(self.objects)} objects>"


def _whole(value: object) -> int:
    return value if isinstance(value, int) else 0


def _communication(comm: Object | None) -> tuple[int, int]:
    """Return node and mapping version of a communication parameter (C49); CANopen's first field is a COB-ID of 32 bits."""
    if comm is None or not comm.fields or comm.fields[0].bits != 8:
        return 0, 0
    node, version = ([_whole(field.default) for field in comm.fields] + [0, 0])[:2]
    return node, version
