"""The parts of a dictionary in use: variables, structs, objects, PDOs (R58-R76, R102-R108)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import msgspec

from dissect.scd.errors import E_SUB, Error, shown
from dissect.scd.packing import check_limits, decode_value, encode_value
from dissect.scd.ranges import device_of_pdo
from dissect.scd.records import Access, Traits
from dissect.scd.types import Kind, SimpleType, Value
from dissect.wire.config.hints import close_to

#: How many fields an error names.
_NAMED: Final = 8
#: Object classes of R63.
NULL: Final = 0
DOMAIN: Final = 2
DEFTYPE: Final = 5
DEFSTRUCT: Final = 6
VAR: Final = 7
ARRAY: Final = 8
RECORD: Final = 9
CLASSES: Final = MappingProxyType(
    {
        NULL: "NULL",
        DOMAIN: "DOMAIN",
        DEFTYPE: "DEFTYPE",
        DEFSTRUCT: "DEFSTRUCT",
        VAR: "VAR",
        ARRAY: "ARRAY",
        RECORD: "RECORD",
    }
)
READABLE: Final = frozenset(("rw", "ro", "const"))
WRITABLE: Final = frozenset(("rw", "wo"))
PLAIN_TRAITS: Final = Traits()


class Variable(msgspec.Struct, frozen=True, eq=False):
    """One value with an address: a VAR or DOMAIN (sub 0), an element of an ARRAY, a field of a RECORD or DEFSTRUCT.

    ``bits`` is its width (0: any), ``offset`` its first bit in the data of the object, ``label`` its name after that of the
    object. A reserved field has no value; its bits are sent as ``fixed``, or as 0 if that is None.
    """

    index: int
    sub: int
    name: str
    label: str
    type: SimpleType
    bits: int
    offset: int
    access: Access
    mandatory: bool
    mappable: bool
    default: Value | None
    fixed: int | None = None
    traits: Traits = PLAIN_TRAITS

    @property
    def address(self) -> tuple[int, int]:
        """Index and sub-index."""
        return self.index, self.sub

    @property
    def size(self) -> int:
        """Octets of the value alone (R25); 0 for a value of any length."""
        return (self.bits + 7) // 8

    @property
    def reserved(self) -> bool:
        """Whether this is a Reserved N or Void field, which has no value."""
        return self.type.kind is Kind.RESERVED

    @property
    def readable(self) -> bool:
        """Whether the access attribute allows reading."""
        return self.access in READABLE

    @property
    def writable(self) -> bool:
        """Whether the access attribute allows writing."""
        return self.access in WRITABLE

    @property
    def unit(self) -> str:
        """Unit of the physical value."""
        return self.traits.unit

    def check(self, value: object) -> Value:
        """Return ``value`` in its Python form, or raise `Error` saying what is wrong with it."""
        return self.type.check(value, self.bits, self.label)

    def outside(self, value: object) -> bool:
        """Return whether a raw value is a number outside the limits of the dictionary."""
        low, high = self.traits.low, self.traits.high
        if not isinstance(value, (int, float)):
            return False
        return (low is not None and value < low) or (high is not None and value > high)

    def encode(self, value: object, *, limits: bool = True) -> bytes:
        """Return the octets of the value alone, as in an SDO (C56). Raises `Error`, with ``limits`` also outside of these."""
        if limits:
            check_limits(self.check(value), self.traits.low, self.traits.high, self.label)
        return encode_value(self.type, value, bits=self.bits, where=self.label)

    def decode(self, octets: bytes | bytearray | memoryview) -> Value:
        """Return the value in ``octets``, which contain nothing else; raises `Error` E_SHORT, E_LONG, E_LENGTH or E_UTF8."""
        return decode_value(self.type, octets, {}, bits=self.bits, key=self.address, where=self.label)

    def phys(self, value: Value) -> Value:
        """Return the physical value: raw · scale + shift for a number, the value itself for anything else."""
        traits = self.traits
        if (traits.scale == 1 and not traits.shift) or isinstance(value, bool) or not isinstance(value, (int, float)):
            return value
        return value * traits.scale + traits.shift

    def desc(self, value: Value) -> str:
        """Return the dictionary's text for the value, empty if it has none."""
        for number, text in self.traits.texts:
            if number == value:
                return text
        return ""

    def __repr__(self) -> str:
        return f"<Variable 0x{self.index:04x}:{self.sub} {self.label!r} {self.type.name}>"


class StructType(msgspec.Struct, frozen=True, eq=False):
    """A DEFSTRUCT (R67): fields one after another without implicit alignment (C10); ``sub`` of a field counts from 1."""

    index: int
    name: str
    fields: tuple[Variable, ...]
    bits: int

    @property
    def size(self) -> int:
        """Octets of a value."""
        return (self.bits + 7) // 8

    def readout(self) -> tuple[int, ...]:
        """Return what a device may return at the index of the type: number of fields, then their type codes (R59)."""
        return (len(self.fields), *(field.type.index for field in self.fields))

    def __repr__(self) -> str:
        return f"<StructType 0x{self.index:04x} {self.name!r}>"


class Object(msgspec.Struct, frozen=True, eq=False):
    """An entry (R58). ``obj[sub]`` is a variable: 0 of a VAR or DOMAIN; of ARRAY and RECORD, 0 is the number of sub-indices.

    ``fields`` are the data in order, with reserved fields, without sub-index 0 (R69, R70). ``type`` is None for NULL and for a
    RECORD with its own fields.
    """

    index: int
    object_class: int
    name: str
    type: SimpleType | StructType | None
    access: Access
    mandatory: bool
    head: Variable | None
    fields: tuple[Variable, ...]
    bits: int
    names: Mapping[str, int]

    @property
    def size(self) -> int:
        """Octets of the data of the whole object."""
        return (self.bits + 7) // 8

    @property
    def single(self) -> bool:
        """Whether the object is one variable, at sub-index 0."""
        return self.object_class in (VAR, DOMAIN)

    def __getitem__(self, key: int | str) -> Variable:
        sub = key if isinstance(key, int) else self.names.get(key, -1)
        if sub == 0 and self.head is not None:
            return self.head
        if 0 < sub <= len(self.fields):
            found = self.fields[sub - 1]
            if not found.reserved:
                return found
            raise Error(E_SUB, f"0x{self.index:04x}:{sub}", f"sub-index {sub} of {self.name!r} is reserved")
        where = f"0x{self.index:04x}:{key if isinstance(key, str) else shown(key)}"
        if isinstance(key, int):
            raise Error(E_SUB, where, f"{self.name!r} has no sub-index {shown(key)}")
        raise Error(E_SUB, where, f"{self.name!r} has no field {shown(key)}{self._fields_meant(key)}")

    def _fields_meant(self, key: str) -> str:
        """Return a hint for the error that there is no field ``key``: which fields there are."""
        if self.single:
            return ": it is one variable, without fields"
        meant = close_to(key, self.names)
        if meant or not self.fields:
            return meant
        names = [field.name for field in self.fields if field.name and not field.name.isdecimal()]
        named = ", ".join(repr(name) for name in names[:_NAMED])
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        return f"; it has {named}{more}" if named else f"; its sub-indices are 1 to {len(self.fields)}"

    def __contains__(self, key: object) -> bool:
        if not isinstance(key, (int, str)):
            return False
        try:
            self[key]
        except Error:
            return False
        return True

    def __iter__(self) -> Iterator[Variable]:
        """Every variable that can be addressed, sub-index 0 first."""
        if self.head is not None:
            yield self.head
        for field in self.fields:
            if not field.reserved:
                yield field

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        return True

    def __repr__(self) -> str:
        return f"<Object 0x{self.index:04x} {CLASSES[self.object_class]} {self.name!r}>"


class Mapped(NamedTuple):
    """A variable in a PDO: its first bit there and how many it has."""

    variable: Variable
    offset: int
    bits: int


class Pdo(msgspec.Struct, frozen=True, eq=False):
    """A process data object (R102-R108): direction "R" or "T" as seen by the owner of the dictionary (C50), number 1..512.

    ``map`` is empty for a PDO that is switched off. ``node`` and ``version`` are those of the communication parameter, 0 if it
    has none.
    """

    direction: str
    number: int
    name: str
    mapping: Object
    comm: Object | None
    map: tuple[Mapped, ...]
    bits: int
    node: int = 0
    version: int = 0

    @property
    def size(self) -> int:
        """Octets of the payload."""
        return (self.bits + 7) // 8

    @property
    def device(self) -> int:
        """The device 0..7 whose PDO this is (R95)."""
        return device_of_pdo(self.number)[0]

    @property
    def local_number(self) -> int:
        """The device's own number 1..64 for this PDO."""
        return device_of_pdo(self.number)[1]

    def __repr__(self) -> str:
        return f"<Pdo {self.direction}{self.number} {self.name!r} {self.bits} bits>"
