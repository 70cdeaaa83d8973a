"""Bits: variables one after another in a sequence of bits, and the octets that carry them (R20-R27, C9, C10).

A `Packing` is made once for each PDO, struct or single value and then used for every message. Where all variables stand on
whole octets it is one ``struct.Struct``. Where they do not, it is one format of the ``bitstruct`` package, which counts bits
from the top: over the octets in reverse order that is the order of SCD, so the fields are listed backwards and the octets are
turned round. What lies between variables is sent as zeros, or as the value the dictionary defines, and not looked at on
receipt (R26, R32, C8) unless somebody asks.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from ipaddress import IPv4Address
from math import isinf
from typing import Any, Final, NamedTuple

import bitstruct

from dissect.scd.errors import E_COUNT, E_LENGTH, E_LONG, E_MAP, E_SHORT, E_UTF8, Error
from dissect.scd.types import SIZED, Kind, SimpleType, Value
from dissect.scd.values import MAC, Interval, NetTime

Octets = bytes | bytearray | memoryview
#: What names a variable: index and sub-index, or the name of a field of a struct.
Key = tuple[int, int] | str
#: What was noticed while decoding → the variables concerned (none: the message as a whole).
Flags = dict[str, tuple[Key, ...]]

NONFINITE: Final = "nonfinite"
TIME_NS_RANGE: Final = "time_ns_range"
PAD: Final = "pad"
TRAILING: Final = "trailing"
ACCESS: Final = "access"
VERSION: Final = "version"

#: The one NaN that is sent (C17): Python's own is 7FC00000h and 7FF8000000000000h.
_NAN: Final = float("nan")
_SECOND: Final = 1_000_000_000
_CODES: Final = {
    (Kind.INT, 8): "b",
    (Kind.INT, 16): "h",
    (Kind.INT, 32): "i",
    (Kind.INT, 64): "q",
    (Kind.UINT, 8): "B",
    (Kind.UINT, 16): "H",
    (Kind.UINT, 32): "I",
    (Kind.UINT, 64): "Q",
    (Kind.REAL, 32): "f",
    (Kind.REAL, 64): "d",
    (Kind.NETTIME, 64): "ii",
    (Kind.INTERVAL, 64): "ii",
}
_OCTETS: Final = frozenset((Kind.STRING, Kind.BLOCK, Kind.MAC, Kind.IP))
_TIMES: Final = frozenset((Kind.NETTIME, Kind.INTERVAL))
_BIT_CODES: Final = {Kind.BOOL: "b", Kind.INT: "s", Kind.UINT: "u", Kind.REAL: "f"}


def bit_engine() -> Callable[[str], Any]:
    """Return what compiles bit formats: the C extension of bitstruct, or its Python form.

    The Python form serves where the extension was not built, and on big-endian machines, on which the extension has an open
    fault (eerimoq/bitstruct #21).
    """
    engine: Callable[[str], Any] = bitstruct.compile
    if sys.byteorder == "little":
        try:
            from bitstruct import c
        except ImportError:
            return engine
        engine = c.compile
    return engine


class Slot(NamedTuple):
    """Where a variable stands: ``offset`` and ``bits`` in the sequence of bits; ``where`` names it in errors.

    ``fixed`` is the defined value of reserved bits (R32), None for "any".
    """

    key: Key
    type: SimpleType
    bits: int
    offset: int
    where: str
    fixed: int | None = None


class Packing:
    """Values ↔ octets for variables at fixed places; ``size`` octets hold ``bits`` bits (R25).

    Raises `Error` E_MAP when variables overlap, descend or have no width, or when one ends after ``bits``.
    """

    def __init__(
        self, slots: Sequence[Slot], bits: int, where: str, compiler: Callable[[str], Any] | None = None
    ) -> None:
        _check_places(slots, bits, where)
        self.where = where
        self.bits = bits
        self.size = (bits + 7) // 8
        self.slots = [slot for slot in slots if slot.type.kind is not Kind.RESERVED and slot.bits]
        self.keys = tuple([slot.key for slot in self.slots])
        self.key_set = frozenset(self.keys)
        self._constant = sum((slot.fixed or 0) << slot.offset for slot in slots if slot.type.kind is Kind.RESERVED)
        valued = sum(((1 << slot.bits) - 1) << slot.offset for slot in self.slots)
        self._unvalued = ((1 << 8 * self.size) - 1) & ~valued
        self.aligned = _aligned(self.slots)
        self._unpack: Callable[[bytes], tuple[Any, ...]]
        self._pack: Callable[..., bytes]
        if self.aligned:
            packer = struct.Struct(_struct_format(self.slots, self.size))
            self._unpack, self._pack = packer.unpack, packer.pack
        else:
            bits_packer = (compiler or bit_engine())(_bit_format(self.slots, self.size))
            self._unpack, self._pack = bits_packer.unpack, bits_packer.pack
        kinds = [slot.type.kind for slot in self.slots]
        self._timed = not _TIMES.isdisjoint(kinds)
        self._reals = [at for at, kind in enumerate(kinds) if kind is Kind.REAL]
        finishers = [_finisher(slot, reverse=not self.aligned) for slot in self.slots]
        self._finish = [(at, finish) for at, finish in enumerate(finishers) if finish is not None]
        self._plain = self.aligned and not (self._timed or self._reals or self._finish)

    def unpack(self, octets: bytes, flags: Flags, strict_pad: bool = False) -> Sequence[Value]:
        """Return the values in the first ``size`` of ``octets``, which must be there; what is noticed goes into ``flags``.

        Raises `Error` E_UTF8 for a string that is none.
        """
        if len(octets) != self.size:
            octets = octets[: self.size]
        if self._plain and not strict_pad:
            return self._unpack(octets)
        raw: Sequence[Any] = self._unpack(octets) if self.aligned else self._unpack(octets[::-1])[::-1]
        if self._timed:
            raw = self._join_times(raw, flags)
        for at in self._reals:
            if isinf(raw[at]):
                flag(flags, NONFINITE, self.keys[at])
        if self._finish:
            raw = list(raw)
            for at, finish in self._finish:
                raw[at] = finish(raw[at])
        if strict_pad and int.from_bytes(octets, "little") & self._unvalued != self._constant:
            flag(flags, PAD)
        return raw

    def pack(self, values: Sequence[object]) -> bytes:
        """Return the octets that carry ``values``, one for each of ``slots``; raises `Error` for what does not fit."""
        if len(values) != len(self.slots):
            raise Error(E_COUNT, self.where, f"{len(values)} values for {len(self.slots)} variables")
        raw: list[Any] = []
        for slot, value in zip(self.slots, values, strict=True):
            checked = slot.type.check(value, slot.bits, slot.where)
            kind = slot.type.kind
            if kind in _TIMES:
                raw += checked  # type: ignore[arg-type]  # both times are pairs
            elif kind in _OCTETS:
                raw.append(_field_octets(checked, slot.bits // 8, reverse=not self.aligned))
            elif kind is Kind.REAL and checked != checked:  # noqa: PLR0124 - NaN, of which one form is sent (C17)
                raw.append(_NAN)
            else:
                raw.append(checked)
        octets = self._pack(*raw) if self.aligned else self._pack(*reversed(raw))[::-1]
        if self._constant:
            octets = (int.from_bytes(octets, "little") | self._constant).to_bytes(self.size, "little")
        return octets

    def _join_times(self, raw: Sequence[Any], flags: Flags) -> list[Any]:
        joined: list[Any] = []
        take = iter(raw)
        for slot in self.slots:
            kind = slot.type.kind
            if kind not in _TIMES:
                joined.append(next(take))
                continue
            seconds, nanoseconds = next(take), next(take)
            if kind is Kind.NETTIME:
                joined.append(NetTime(seconds, nanoseconds))
                fine = 0 <= nanoseconds < _SECOND
            else:
                joined.append(Interval(seconds, nanoseconds))
                fine = -_SECOND < nanoseconds < _SECOND
            if not fine:
                flag(flags, TIME_NS_RANGE, slot.key)
        return joined


def flag(flags: Flags, name: str, key: Key | None = None) -> None:
    """Note ``name`` for the variable ``key``, or for the whole message."""
    flags[name] = flags.get(name, ()) if key is None else (*flags.get(name, ()), key)


def decode_value(
    kind: SimpleType,
    octets: Octets,
    flags: Flags,
    *,
    bits: int = 0,
    key: Key = "",
    where: str = "",
    strict_pad: bool = False,
) -> Value:
    """Return the one value that ``octets`` are: what an SDO carries (C56).

    ``bits`` is the width of the variable where the type leaves it open; a text may be shorter than that, and of a type
    without any width the octets tell the length (C19). Raises `Error` E_SHORT, E_LONG, E_LENGTH or E_UTF8.
    """
    width = bits or kind.bits
    data = bytes(octets)
    if kind.kind in SIZED:
        most = width // 8
        if width and (len(data) > most or (kind.kind is Kind.BLOCK and len(data) != most)):
            raise Error(E_LENGTH, where or kind.name, f"{len(data)} octets, {most} are declared")
        return text_of(data, where or kind.name) if kind.kind is Kind.STRING else data
    packing = single(kind, width)
    if len(data) != packing.size:
        code = E_SHORT if len(data) < packing.size else E_LONG
        raise Error(code, where or kind.name, f"{len(data)} octets, the value has {packing.size}")
    found: Flags = {}
    values = packing.unpack(data, found, strict_pad=strict_pad)
    for name in found:
        flag(flags, name, key)
    if not values:
        raise Error(E_COUNT, where or kind.name, "a type without values")
    return values[0]


def encode_value(kind: SimpleType, value: object, *, bits: int = 0, where: str = "") -> bytes:
    """Return the octets of one value (R25, C56); a text or block of a type without width is as long as it is."""
    width = bits or kind.bits
    if kind.kind in SIZED:
        checked = kind.check(value, width, where)
        return _field_octets(checked, width // 8, reverse=False)
    packing = single(kind, width)
    return packing.pack([kind.check(value, width, where)])


@lru_cache(maxsize=256)
def single(kind: SimpleType, bits: int) -> Packing:
    """Return the packing of one value of a type with ``bits`` bits, at bit 0."""
    return Packing([Slot("", kind, bits, 0, kind.name)], bits, kind.name)


def text_of(octets: bytes, where: str) -> str:
    """Return a text without the U+0000 that fill its field up (C19); raises `Error` E_UTF8, the octets in its detail."""
    try:
        return octets.rstrip(b"\0").decode()
    except UnicodeDecodeError as error:
        raise Error(E_UTF8, where, f"{error.reason} at octet {error.start} of {octets.hex(' ')}") from None


def _check_places(slots: Sequence[Slot], bits: int, where: str) -> None:
    end = 0
    for slot in slots:
        if slot.bits <= 0 and slot.type.kind is not Kind.RESERVED:
            raise Error(
                E_MAP, slot.where, "a variable length needs a size: from the mapping, the struct or the message"
            )
        if slot.offset < end:
            raise Error(E_MAP, slot.where, f"it begins at bit {slot.offset}, the one before ends at {end}")
        end = slot.offset + slot.bits
    if end > bits:
        raise Error(E_MAP, where, f"the last variable ends at bit {end} of {bits}")


def _aligned(slots: Sequence[Slot]) -> bool:
    """Whether struct can do it: every variable on whole octets of its own, in a width that struct knows."""
    # When each begins with an octet, nothing else is in the octet of a Boolean.
    return all(
        slot.offset % 8 == 0
        and (slot.type.kind in _OCTETS or slot.type.kind is Kind.BOOL or (slot.type.kind, slot.bits) in _CODES)
        for slot in slots
    )


def _struct_format(slots: Sequence[Slot], size: int) -> str:
    codes, at = ["<"], 0
    for slot in slots:
        first = slot.offset // 8
        width = (slot.bits + 7) // 8
        if slot.type.kind is Kind.BOOL:
            code = "B"
        else:
            code = f"{width}s" if slot.type.kind in _OCTETS else _CODES[slot.type.kind, slot.bits]
        codes.append(f"{first - at}x" if first > at else "")
        codes.append(code)
        at = first + width
    codes.append(f"{size - at}x" if size > at else "")
    return "".join(codes)


def _bit_format(slots: Sequence[Slot], size: int) -> str:
    codes, end = [], 8 * size
    for slot in reversed(slots):
        after = slot.offset + slot.bits
        if after < end:
            codes.append(f"p{end - after}")
        if slot.type.kind in _TIMES:
            codes.append("s32s32")
        elif slot.type.kind in _OCTETS:
            codes.append(f"r{slot.bits}")
        else:
            codes.append(f"{_BIT_CODES[slot.type.kind]}{slot.bits}")
        end = slot.offset
    if end:
        codes.append(f"p{end}")
    return "".join(codes)


def _field_octets(value: object, size: int, *, reverse: bool) -> bytes:
    if isinstance(value, str):
        octets = value.encode().ljust(size, b"\0")
    elif isinstance(value, IPv4Address):
        octets = value.packed
    else:
        assert isinstance(value, bytes)
        octets = bytes(value)
    return octets[::-1] if reverse else octets


def _finisher(slot: Slot, *, reverse: bool) -> Callable[[Any], Value] | None:
    """Return what makes a value of what struct (or with ``reverse``: bitstruct) read, None where that is the value."""
    kind, where = slot.type.kind, slot.where
    if kind is Kind.STRING:
        return (lambda raw: text_of(raw[::-1], where)) if reverse else (lambda raw: text_of(raw, where))
    if kind is Kind.MAC:
        return (lambda raw: MAC(raw[::-1])) if reverse else MAC
    if kind is Kind.IP:
        return (lambda raw: IPv4Address(raw[::-1])) if reverse else IPv4Address
    if kind is Kind.BLOCK and reverse:
        return lambda raw: bytes(raw[::-1])
    if kind is Kind.BOOL and not reverse:
        return lambda raw: raw & 1 == 1
    return None
