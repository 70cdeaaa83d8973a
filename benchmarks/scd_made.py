"""Made-up SCD dictionaries and values for them: anything that the rules allow, chosen at random.

Every kind of type, struct, object, PDO mapping (unaligned, with gaps, in both forms) and envelope; `Dictionary` takes all of
them. Used by `benchmarks.scd_fuzz` and by the tests.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from ipaddress import IPv4Address
from typing import Any

import msgspec

from dissect.scd.check import raw_span
from dissect.scd.dictionary import Dictionary
from dissect.scd.layout import Key
from dissect.scd.mapping import Entry, pack_entry
from dissect.scd.model import Variable
from dissect.scd.plain import as_plain
from dissect.scd.ranges import PDO_BASES
from dissect.scd.records import (
    Access,
    Body,
    CrcRecord,
    EnvelopeField,
    EnvelopeRecord,
    FieldRecord,
    ObjectClass,
    ObjectRecord,
    Plain,
    StructRecord,
    Traits,
    TypeRecord,
)
from dissect.scd.types import NUMERIC, SIZED, STANDARD, Kind, SimpleType, Value
from dissect.scd.values import MAC, Interval, NetTime

LETTERS = "aZ09_-. «Ждюй»№µ漢😀"
ACCESS: tuple[Access, ...] = ("rw", "rw", "rw", "wo", "ro", "const")
UINT8, UINT32, UINT64 = 5, 7, 27

#: Possible envelopes around the values; None is envelope "1".
ENVELOPES = (
    None,
    None,
    EnvelopeRecord(
        [
            EnvelopeField("src", 8), EnvelopeField("dst", 8),
            EnvelopeField("kind", 6), EnvelopeField("response", 1), EnvelopeField("abort", 1),
            EnvelopeField("size", 16, counts="rest"), EnvelopeField("index", 16, big=True), EnvelopeField("sub", 8),
            EnvelopeField("err", 8, signed=True), EnvelopeField("data"), EnvelopeField("crc", 16),
        ],
        [(1, "write"), (2, "read"), (16, "pdo")],
        CrcRecord(init=0xFFFF),
    ),
    EnvelopeRecord([EnvelopeField("seq", 32), EnvelopeField("pdo", 16, big=True), EnvelopeField("data")], []),
    EnvelopeRecord(
        [
            EnvelopeField("const", 16, value=0xABCD), EnvelopeField("tid", 5), EnvelopeField("reserved", 3, value=5),
            EnvelopeField("size", 32, big=True, counts="total"), EnvelopeField("kind", 3),
            EnvelopeField("index", 29), EnvelopeField("sub", 8), EnvelopeField("crc", 16, big=True),
            EnvelopeField("data"), EnvelopeField("reserved", 4), EnvelopeField("err", 12, signed=True),
        ],
        [(3, "write"), (5, "pdo")],
        CrcRecord(covers="data"),
    ),
)  # fmt: skip


def made_value(dice: random.Random, kind: SimpleType, bits: int) -> Value:
    """Return a random value of the type; ``bits`` is the width of its place, 0 for any length."""
    edge = dice.random() < 0.3
    size = bits // 8 if bits else dice.randrange(20)
    makers: dict[Kind, Callable[[], Value]] = {
        Kind.BOOL: lambda: dice.random() < 0.5,
        Kind.UINT: lambda: dice.choice((0, 1, (1 << bits) - 1)) if edge else dice.getrandbits(bits),
        Kind.INT: lambda: (
            dice.choice((-1, 0, (1 << bits - 1) - 1, -(1 << bits - 1))) if edge else dice.getrandbits(bits) - (1 << bits - 1)
        ),
        Kind.REAL: lambda: made_real(dice, bits),
        Kind.STRING: lambda: made_text(dice, size),
        Kind.BLOCK: lambda: dice.randbytes(size),
        Kind.NETTIME: lambda: NetTime(dice.getrandbits(32) - (1 << 31), dice.randrange(1_000_000_000)),
        Kind.INTERVAL: lambda: Interval(dice.getrandbits(32) - (1 << 31), dice.randrange(-999_999_999, 1_000_000_000)),
        Kind.MAC: lambda: MAC(dice.randbytes(6)),
        Kind.IP: lambda: IPv4Address(dice.getrandbits(32)),
    }  # fmt: skip
    return makers[kind.kind]()


def made_real(dice: random.Random, bits: int) -> float:
    """Return a number that has such a width exactly, now and then NaN."""
    code = "<f" if bits == 32 else "<d"
    while True:
        number: float = struct.unpack(code, dice.randbytes(bits // 8))[0]
        if math.isnan(number):
            return math.nan
        if math.isfinite(number):
            return number


def made_text(dice: random.Random, size: int) -> str:
    """Return a text of at most ``size`` octets that does not end in U+0000."""
    octets = "".join(dice.choices(LETTERS + "\0\n", k=dice.randrange(size + 1))).encode()[:size]
    return octets.decode(errors="ignore").rstrip("\0")


def same(one: object, other: object) -> bool:
    """Whether two values are the same to the bit; NaN is the same as NaN."""
    if isinstance(one, float) and isinstance(other, float):
        return struct.pack("<d", one) == struct.pack("<d", other) or (one != one and other != other)  # noqa: PLR0124
    if isinstance(one, NetTime) and isinstance(other, NetTime):  # the scale is defined by the dictionary
        return one == other
    return type(one) is type(other) and one == other


def same_values(one: dict[Key, Value], other: dict[Key, Value]) -> bool:
    """Whether two collections of values are the same to the bit."""
    return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())


@dataclass
class _Maker:
    """One dictionary in the making."""

    dice: random.Random
    types: list[TypeRecord] = field(default_factory=list)
    structs: list[StructRecord] = field(default_factory=list)
    objects: dict[int, ObjectRecord] = field(default_factory=dict)
    simple: dict[int, SimpleType] = field(default_factory=lambda: dict(STANDARD))
    names: int = 0

    def name(self) -> str:
        self.names += 1
        return f"{''.join(self.dice.choices(LETTERS, k=self.dice.randrange(6)))}{self.names}".strip()

    def field_name(self) -> str:
        return self.name().replace(".", "").strip()

    def flip(self, chance: float = 0.5) -> bool:
        return self.dice.random() < chance

    def add_types(self) -> None:
        dice = self.dice
        for _ in range(dice.randrange(6)):
            index = dice.choice((0x60, 0x60, 0xA0, 0x220)) + dice.randrange(0x20)
            kind = dice.choice((Kind.INT, Kind.UINT, Kind.UINT, Kind.STRING, Kind.BLOCK, Kind.REAL, Kind.MAC))
            bits = {Kind.REAL: dice.choice((32, 64)), Kind.MAC: 48}.get(kind, dice.randint(1, 64))
            if kind in SIZED:
                bits = 8 * dice.randrange(12)
            if index not in self.simple:
                self.types.append(TypeRecord(index, self.name(), kind, bits))
                self.simple[index] = SimpleType(index, self.types[-1].name, kind, bits)

    def add_structs(self) -> None:
        for index in {self.dice.choice((0x20, 0x40, 0x80, 0xC0, 0x240)) + self.dice.randrange(0x20) for _ in range(3)}:
            self.structs.append(StructRecord(index, self.name(), self.fields()))

    def fields(self) -> list[FieldRecord]:
        return [self.field() for _ in range(self.dice.randint(1, 7))]

    def field(self) -> FieldRecord:
        dice = self.dice
        if self.flip(0.2):
            bits = dice.choice((0, 1, 3, 7, 8, 70))
            return FieldRecord("", 0, bits, dice.getrandbits(min(bits, 64)) if bits and self.flip() else None)
        kind, bits = self.kind(closed=True)
        width = kind.bits or bits
        access: Access = dice.choice(("", "", *ACCESS))
        default = as_plain(made_value(dice, kind, width)) if self.flip(0.3) else None
        mappable = dice.choice((None, None, True, False))
        return FieldRecord(self.field_name(), kind.index, bits, None, access, mappable, default, self.traits(kind))

    def kind(self, *, closed: bool) -> tuple[SimpleType, int]:
        """Return a type, and the number of bits that a variable of it states itself."""
        kind = self.dice.choice(list(self.simple.values()))
        return kind, 8 * self.dice.randint(1 if closed else 0, 9) if kind.variable else 0

    def traits(self, kind: SimpleType) -> Traits | None:
        dice = self.dice
        if kind.kind not in NUMERIC or self.flip(0.7):
            return None
        least, most = raw_span(kind) or (-(1 << 63), (1 << 63) - 1)
        numbers = sorted({dice.choice((dice.randint(least, most), least, most)) for _ in range(dice.randrange(4))})
        limits = sorted(dice.choice((dice.randint(least, most), dice.uniform(least, most))) for _ in range(2))
        low, high = (limit if self.flip() else None for limit in limits)
        texts = [(number, self.name()) for number in numbers]
        return Traits("°C\t", dice.choice((1.0, -0.5, 1e300)), dice.choice((0.0, -0.5, 7.25)), low, high, texts)

    def add_objects(self) -> None:
        dice = self.dice
        for _ in range(dice.randint(1, 12)):
            index = dice.choice((0x1000, 0x1C00, 0x2000, 0x2000, 0x6000, 0x6800, 0x9F00, 0xA000)) + dice.randrange(
                0x100
            )
            makers: tuple[tuple[ObjectClass, Callable[[int], ObjectRecord]], ...] = (
                (0, self.null), (2, self.domain), (7, self.var), (7, self.var), (8, self.array), (9, self.record),
            )  # fmt: skip
            self.objects[index] = dice.choice(makers)[1](index)

    def head(self, index: int, object_class: ObjectClass) -> Callable[..., ObjectRecord]:
        """Return an object's record without the parts that depend on its class."""
        access, mandatory = self.dice.choice(ACCESS), self.flip()
        made = ObjectRecord(index, object_class, self.name(), 0, 0, access, mandatory, self.flip(0.9))
        return partial(_with, made)

    def null(self, index: int) -> ObjectRecord:
        return ObjectRecord(index, 0, self.name(), 0, 0, "", self.flip(), False)

    def domain(self, index: int) -> ObjectRecord:
        return self.head(index, 2)(type=self.dice.choice((10, 15)), mappable=False)

    def var(self, index: int) -> ObjectRecord:
        kind, bits = self.kind(closed=False)
        values = [as_plain(made_value(self.dice, kind, kind.bits or bits))] if self.flip(0.4) else []
        return self.head(index, 7)(type=kind.index, bits=bits, values=values, traits=self.traits(kind))

    def array(self, index: int) -> ObjectRecord:
        kind, bits = self.kind(closed=True)
        count = self.dice.randint(1, 9)
        values = self.values([(kind, kind.bits or bits)] * count)
        traits = self.traits(kind)
        return self.head(index, 8)(type=kind.index, bits=bits, count=count, used=count, values=values, traits=traits)

    def record(self, index: int) -> ObjectRecord:
        own = self.flip()
        chosen = None if own or not self.structs else self.dice.choice(self.structs)
        fields = self.fields() if chosen is None else chosen.fields
        widths = [
            (self.simple[row.type], self.simple[row.type].bits or row.bits) if row.type else None for row in fields
        ]
        values = self.values(widths)
        if chosen is None:
            return self.head(index, 9)(fields=fields, values=values)
        return self.head(index, 9)(type=chosen.index, values=values)

    def values(self, widths: Sequence[tuple[SimpleType, int] | None]) -> list[Plain]:
        """Return default values for some of the variables, and nothing after the last of them."""
        values: list[Plain] = []
        for at, place in enumerate(widths):
            if place is not None and self.flip(0.4):
                values += [None] * (at - len(values))
                values.append(as_plain(made_value(self.dice, *place)))
        return values

    def add_pdos(self) -> None:
        od = Dictionary(self.body())
        variables = [row for obj in od for row in obj if row.mappable]
        for _ in range(self.dice.randrange(5)):
            direction = self.dice.choice("RT")
            number = self.dice.choice((1, 2, 64, 65, 511, 512))
            fit = [row for row in variables if (row.readable if direction == "T" else row.writable)]
            self.objects[PDO_BASES[direction, "map"] + number - 1] = self.mapping(direction, number, fit)
            if self.flip():
                fields = [FieldRecord("node", UINT8, 0), FieldRecord("version", UINT8, 0)]
                index = PDO_BASES[direction, "comm"] + number - 1
                values: list[Plain] = [self.dice.randrange(256), self.dice.randrange(256)]
                self.objects[index] = self.head(index, 9)(fields=fields, values=values)

    def mapping(self, direction: str, number: int, variables: Sequence[Variable]) -> ObjectRecord:
        dice = self.dice
        wide = self.flip(0.7)
        entries: list[Entry] = []
        at = 0
        for row in dice.choices(variables, k=dice.randrange(9)) if variables else ():
            if self.flip(0.3):
                gap = dice.choice((1, 3, 7, 8, 20))
                entries += [] if wide else [Entry(UINT8, 0, at, gap)]
                at += gap
            bits = row.bits if not row.type.variable else 8 * dice.randint(1, max(row.bits // 8, 1))
            if wide or bits <= 0xFF:
                entries.append(Entry(row.index, row.sub, at, bits))
                at += bits
        values: list[Plain] = [pack_entry(entry, wide) for entry in entries]
        used = dice.randint(0, len(values)) if self.flip(0.2) else len(values)
        return self.head(PDO_BASES[direction, "map"] + number - 1, 8)(
            type=UINT64 if wide else UINT32, count=max(len(values), 1), used=used, values=values
        )

    def body(self) -> Body:
        dice = self.dice
        errors = sorted({dice.randint(-128, -1) for _ in range(dice.randrange(3))})
        return Body(
            made_text(dice, 9), made_text(dice, 5), dice.choice(("utc", "tai")),
            _ascending(self.types), _ascending(self.structs), _ascending(self.objects.values()),
            dice.choice(ENVELOPES), [(number, self.name()) for number in errors],
        )  # fmt: skip


def _ascending(rows: Iterable[Any]) -> list[Any]:
    return sorted(rows, key=lambda row: int(row.index))


def _with(record: ObjectRecord, **changes: Any) -> ObjectRecord:
    return msgspec.structs.replace(record, **changes)


def made_body(dice: random.Random) -> Body:
    """Return the records of a dictionary that keeps all rules."""
    maker = _Maker(dice)
    maker.add_types()
    maker.add_structs()
    maker.add_objects()
    maker.add_pdos()
    return maker.body()
