"""Packs variables into a sequence of bits, and into octets (R20-R27, C9, C10).

A `Packing` is made once for each PDO, struct or single value, and then used for every message. If all variables are at whole
octets, it uses ``struct.Struct``. If not, it uses a format of the ``bitstruct`` package, which counts bits from the top: in
reversed octets that is the order of SCD, so that fields are listed backwards and octets are reversed. Bits between variables
are sent as zeros, or with the value that the dictionary defines, and not checked on receipt (R26, R32, C8) unless
``strict_pad``.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from ipaddress import IPv4Address
from math import inf, isinf
from operator import itemgetter
from typing import Any, Final, NamedTuple

import bitstruct

from dissect.scd.errors import E_COUNT, E_LENGTH, E_LONG, E_RANGE, E_SHORT, E_UTF8, Error, shown
from dissect.scd.layout import OCTETS, TIMES, Key, Slot, aligned, bit_format, check_places, struct_format
from dissect.scd.types import NUMERIC, SIZED, Kind, SimpleType, Value
from dissect.scd.values import MAC, Interval, NetTime, TaiTime
from dissect.wire.text import count

Octets = bytes | bytearray | memoryview
#: Observations made while decoding → the variables concerned (none: the message as a whole).
Flags = dict[str, tuple[Key, ...]]

NONFINITE: Final = "nonfinite"
TIME_NS_RANGE: Final = "time_ns_range"
PAD: Final = "pad"
TRAILING: Final = "trailing"
ACCESS: Final = "access"
VERSION: Final = "version"
#: Octets are not a text in the dictionary's encoding; the value is the octets themselves.
ENCODING: Final = "encoding"
#: A value outside the limits in the dictionary.
LIMITS: Final = "limits"

#: The only NaN that is sent (C17): Python's own is 7FC00000h and 7FF8000000000000h.
_NAN: Final = float("nan")
_SECOND: Final = 1_000_000_000
#: The largest number that a float32 holds.
_FLOAT32_MAX: Final = float.fromhex("0x1.fffffep127")
_FLOAT64_MAX: Final = float.fromhex("0x1.fffffffffffffp1023")
#: Python types of numbers, by kind; int for other kinds.
_FORMS: Final[dict[Kind, type]] = {Kind.BOOL: bool, Kind.REAL: float}


def bit_engine() -> Callable[[str], Any]:
    """Return the compiler of bit formats: the C extension of bitstruct, or its Python form.

    The Python form is used if the extension was not built, and on big-endian machines, where the extension has an open bug
    (eerimoq/bitstruct #21).
    """
    engine: Callable[[str], Any] = bitstruct.compile
    if sys.byteorder == "little":
        try:
            from bitstruct import c
        except ImportError:
            return engine
        engine = c.compile
    return engine


class _Plan(NamedTuple):
    """A way to pack numbers without checking each one: ``take`` returns them in the order of the packer.

    They must have exactly the Python types ``forms``. The packer itself refuses an integer that does not fit. ``spans`` has the
    bounds that the packer does not check: position, lowest and highest value of reals, which may not be infinite, and of
    variables with limits.
    """

    take: Callable[[Mapping[Any, Any]], tuple[Any, ...]]
    forms: tuple[type, ...]
    spans: list[tuple[int, float | int, float | int]]


class Packing:
    """Converts values to octets and back, for variables at fixed positions; ``size`` octets hold ``bits`` bits (R25).

    ``enforce``: a value outside the limits of its slot is not packed (E_RANGE). Raises `Error` E_MAP if variables overlap,
    descend or have no width, or if one ends after ``bits``.
    """

    def __init__(
        self,
        slots: Sequence[Slot],
        bits: int,
        where: str,
        compiler: Callable[[str], Any] | None = None,
        *,
        enforce: bool = True,
    ) -> None:
        check_places(slots, bits, where)
        self.where = where
        self.bits = bits
        self.size = (bits + 7) // 8
        self.slots = [slot for slot in slots if slot.type.kind is not Kind.RESERVED and slot.bits]
        self.keys = tuple([slot.key for slot in self.slots])
        self.key_set = frozenset(self.keys)
        self._constant = sum((slot.fixed or 0) << slot.offset for slot in slots if slot.type.kind is Kind.RESERVED)
        valued = sum(((1 << slot.bits) - 1) << slot.offset for slot in self.slots)
        self._unvalued = ((1 << 8 * self.size) - 1) & ~valued
        self.aligned = aligned(self.slots)
        self._unpack: Callable[[bytes], tuple[Any, ...]]
        self._pack: Callable[..., bytes]
        if self.aligned:
            packer = struct.Struct(struct_format(self.slots, self.size))
            self._unpack, self._pack = packer.unpack, packer.pack
        else:
            bits_packer = (compiler or bit_engine())(bit_format(self.slots, self.size))
            self._unpack, self._pack = bits_packer.unpack, bits_packer.pack
        kinds = [slot.type.kind for slot in self.slots]
        self._timed = not TIMES.isdisjoint(kinds)
        self._reals = [at for at, kind in enumerate(kinds) if kind is Kind.REAL]
        finishers = [_finisher(slot, reverse=not self.aligned) for slot in self.slots]
        self._finish = [(at, finish) for at, finish in enumerate(finishers) if finish is not None]
        # Texts, which become octets if they cannot be decoded: position, encoding, whether the octets are reversed.
        self._texts = [
            (at, slot.type.form or "utf-8", not self.aligned)
            for at, slot in enumerate(self.slots)
            if slot.type.kind is Kind.STRING
        ]
        self._limits = [
            (at, -inf if slot.low is None else slot.low, inf if slot.high is None else slot.high)
            for at, slot in enumerate(self.slots)
            if slot.low is not None or slot.high is not None
        ]
        self._enforce = enforce
        self._plan = self._planned()
        #: Whether `unpack` never notices anything, apart from ``strict_pad``.
        self.quiet: Final = not (self._timed or self._reals or self._texts or self._limits)
        self._plain = self.aligned and self.quiet and not self._finish

    def unpack(self, octets: bytes, flags: Flags, strict_pad: bool = False) -> Sequence[Value]:
        """Return the values in the first ``size`` of ``octets``, which must be there; add observations to ``flags``.

        Octets that are not a text in their encoding are returned as octets, so that the other values are not lost.
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
        for at, low, high in self._limits:
            if raw[at] < low or raw[at] > high:
                flag(flags, LIMITS, self.keys[at])
        if self._finish or self._texts:
            raw = list(raw)
            for at, finish in self._finish:
                raw[at] = finish(raw[at])
            for at, encoding, reverse in self._texts:
                text = bytes(raw[at][::-1]) if reverse else raw[at]
                try:
                    raw[at] = text.rstrip(b"\0").decode(encoding)
                except UnicodeDecodeError:
                    raw[at] = text
                    flag(flags, ENCODING, self.keys[at])
        if strict_pad and int.from_bytes(octets, "little") & self._unvalued != self._constant:
            flag(flags, PAD)
        return raw

    def odd(self, octets: bytes, strict_pad: bool = False) -> bool:
        """Return whether `unpack` would notice anything in ``octets``, without returning values."""
        if strict_pad or self._timed or self._texts:
            flags: Flags = {}
            self.unpack(octets, flags, strict_pad)
            return bool(flags)
        if self.quiet:
            return False
        if len(octets) != self.size:
            octets = octets[: self.size]
        raw: Sequence[Any] = self._unpack(octets) if self.aligned else self._unpack(octets[::-1])[::-1]
        odd = False
        for at in self._reals:
            odd = odd or isinf(raw[at])
        for at, low, high in self._limits:
            odd = odd or raw[at] < low or raw[at] > high
        return odd

    def pack_known(self, given: Mapping[Any, Any]) -> bytes | None:
        """Return the octets of numbers that fit, by their keys; None if `pack` is needed.

        There may be more values than the packer needs.
        """
        plan = self._plan
        if plan is None:
            return None
        try:
            values = plan.take(given)
            if tuple(map(type, values)) != plan.forms:
                return None
            for at, low, high in plan.spans:
                if not low <= values[at] <= high:
                    return None
            octets = self._pack(*values)
        except (KeyError, OverflowError, struct.error, bitstruct.Error):
            return None
        if not self.aligned:
            octets = octets[::-1]
        return self._with_constant(octets) if self._constant else octets

    def _planned(self) -> _Plan | None:
        """Return the plan of `pack_known`; None if not all slots are numbers."""
        if not self.slots or any(slot.type.kind not in NUMERIC for slot in self.slots):
            return None
        slots = self.slots if self.aligned else self.slots[::-1]
        keys = [slot.key for slot in slots]
        take = itemgetter(*keys) if len(keys) > 1 else _one(keys[0])
        spans = [(at, *span) for at, slot in enumerate(slots) if (span := _span(slot, self._enforce)) is not None]
        return _Plan(take, tuple([_FORMS.get(slot.type.kind, int) for slot in slots]), spans)

    def pack(self, values: Sequence[object]) -> bytes:
        """Return the octets that carry ``values``, one for each of ``slots``; raises `Error` for what does not fit."""
        if len(values) != len(self.slots):
            raise Error(E_COUNT, self.where, f"{len(values)} values for {len(self.slots)} variables")
        raw: list[Any] = []
        for slot, value in zip(self.slots, values, strict=True):
            checked = slot.type.check(value, slot.bits, slot.where)
            if self._enforce and (slot.low is not None or slot.high is not None):
                check_limits(checked, slot.low, slot.high, slot.where)
            kind = slot.type.kind
            if kind in TIMES:
                raw += checked  # type: ignore[arg-type]  # both times are pairs
            elif kind in OCTETS:
                raw.append(_field_octets(checked, slot.bits // 8, slot.type.form, reverse=not self.aligned))
            elif kind is Kind.REAL and checked != checked:  # noqa: PLR0124 - one form of NaN is sent (C17)
                raw.append(_NAN)
            else:
                raw.append(checked)
        octets = self._pack(*raw) if self.aligned else self._pack(*reversed(raw))[::-1]
        return self._with_constant(octets) if self._constant else octets

    def _with_constant(self, octets: bytes) -> bytes:
        """Return the octets with the reserved bits that have a defined value (R32)."""
        return (int.from_bytes(octets, "little") | self._constant).to_bytes(self.size, "little")

    def _join_times(self, raw: Sequence[Any], flags: Flags) -> list[Any]:
        joined: list[Any] = []
        take = iter(raw)
        for slot in self.slots:
            kind = slot.type.kind
            if kind not in TIMES:
                joined.append(next(take))
                continue
            seconds, nanoseconds = next(take), next(take)
            if kind is Kind.NETTIME:
                joined.append((TaiTime if slot.type.form else NetTime)(seconds, nanoseconds))
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
    """Return the value in ``octets``, which contain nothing else, as in an SDO (C56).

    ``bits`` is the width of the variable if the type leaves it open; a text may be shorter. If there is no width, the octets
    give the length (C19). Raises `Error` E_SHORT, E_LONG, E_LENGTH or E_UTF8.
    """
    width = bits or kind.bits
    data = bytes(octets)
    if kind.kind in SIZED:
        most = width // 8
        if width and (len(data) > most or (kind.kind is Kind.BLOCK and len(data) != most)):
            raise Error(E_LENGTH, where or kind.name, f"{count(len(data), 'byte')}, {most} are declared")
        return text_of(data, where or kind.name, kind.form or "utf-8") if kind.kind is Kind.STRING else data
    packing = single(kind, width)
    if len(data) != packing.size:
        code = E_SHORT if len(data) < packing.size else E_LONG
        raise Error(code, where or kind.name, f"{count(len(data), 'byte')}, the value has {packing.size}")
    found: Flags = {}
    values = packing.unpack(data, found, strict_pad=strict_pad)
    for name in found:
        flag(flags, name, key)
    if not values:
        raise Error(E_COUNT, where or kind.name, "a type without values")
    return values[0]


def encode_value(kind: SimpleType, value: object, *, bits: int = 0, where: str = "") -> bytes:
    """Return the octets of one value (R25, C56); a text or block of a type without width has its own length."""
    width = bits or kind.bits
    if kind.kind in SIZED:
        checked = kind.check(value, width, where)
        return _field_octets(checked, width // 8, kind.form, reverse=False)
    packing = single(kind, width)
    return packing.pack([kind.check(value, width, where)])


@lru_cache(maxsize=256)
def single(kind: SimpleType, bits: int) -> Packing:
    """Return the packing of one value of a type with ``bits`` bits, at bit 0."""
    return Packing([Slot("", kind, bits, 0, kind.name)], bits, kind.name)


def check_limits(value: object, low: float | None, high: float | None, where: str) -> None:
    """Raise `Error` E_RANGE for a number outside the limits in the dictionary; NaN is never outside."""
    if isinstance(value, (int, float)) and ((low is not None and value < low) or (high is not None and value > high)):
        raise Error(E_RANGE, where, f"{shown(value)} is outside the limits of its raw value, {limits_text(low, high)}")


def limits_text(low: float | None, high: float | None) -> str:
    """Return limits for a person: "-3000..3000", "at least 0", "at most 100"."""
    if low is None:
        return f"at most {high}"
    return f"at least {low}" if high is None else f"{low}..{high}"


def text_of(octets: bytes, where: str, encoding: str = "utf-8") -> str:
    """Return a text without its padding of U+0000 (C19); raises `Error` E_UTF8, with the octets in its detail."""
    try:
        return octets.rstrip(b"\0").decode(encoding)
    except UnicodeDecodeError as error:
        detail = f"no {encoding.upper()}: {error.reason} at byte {error.start} of {octets.hex(' ')}"
        raise Error(E_UTF8, where, detail) from None


def _span(slot: Slot, enforce: bool) -> tuple[float | int, float | int] | None:
    """Return the lowest and highest number of a slot if the packer does not check them, else None."""
    low, high = (slot.low, slot.high) if enforce else (None, None)
    if slot.type.kind is Kind.REAL:
        most = _FLOAT32_MAX if slot.bits == 32 else _FLOAT64_MAX
        return -most if low is None else max(low, -most), most if high is None else min(high, most)
    return None if low is None and high is None else (-inf if low is None else low, inf if high is None else high)


def _one(key: Key) -> Callable[[Mapping[Any, Any]], tuple[Any, ...]]:
    return lambda given: (given[key],)


def _field_octets(value: object, size: int, encoding: str, *, reverse: bool) -> bytes:
    if isinstance(value, str):
        octets = value.encode(encoding or "utf-8").ljust(size, b"\0")
    elif isinstance(value, IPv4Address):
        octets = value.packed
    else:
        assert isinstance(value, bytes)
        octets = bytes(value)
    return octets[::-1] if reverse else octets


def _finisher(slot: Slot, *, reverse: bool) -> Callable[[Any], Value] | None:
    """Return a function that makes a value from the result of struct (``reverse``: of bitstruct); None if none is needed."""
    kind = slot.type.kind
    if kind is Kind.MAC:
        return (lambda raw: MAC(raw[::-1])) if reverse else MAC
    if kind is Kind.IP:
        return (lambda raw: IPv4Address(raw[::-1])) if reverse else IPv4Address
    if kind is Kind.BLOCK and reverse:
        return lambda raw: bytes(raw[::-1])
    if kind is Kind.BOOL and not reverse:
        return lambda raw: raw & 1 == 1
    return None
