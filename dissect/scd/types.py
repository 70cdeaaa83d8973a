"""The types of SCD (R19-R55): content, number of bits and valid values of each.

A value is a sequence of bits, b0 first (R20, R23, R27); the type says how many. This module only checks values and brings them
into their Python form; the codec handles octets.
"""

from __future__ import annotations

import enum
import math
import struct
from ipaddress import AddressValueError, IPv4Address
from types import MappingProxyType
from typing import Final

import msgspec

from dissect.scd.errors import E_LENGTH, E_RANGE, E_UTF8, E_VALUE, Error, shown
from dissect.scd.values import MAC, Interval, NetTime, TaiTime
from dissect.wire.text import count

#: A decoded value. Void and Reserved have none.
Value = bool | int | float | str | bytes | MAC | IPv4Address | NetTime | Interval

#: The widest Integer N and Unsigned N (C15).
MAX_INTEGER_BITS: Final = 64
#: Octets of the largest value in one message (C27).
MAX_OCTETS: Final = 0xFFFF

_INT32: Final = 1 << 31
_SECOND: Final = 1_000_000_000
_FLOAT: Final = struct.Struct("<f")


class Kind(enum.IntEnum):
    """What a type is made of; the numbers are used in compiled dictionaries. RESERVED of 0 bits is Void (R28, C11)."""

    RESERVED = 0
    BOOL = 1
    INT = 2
    UINT = 3
    REAL = 4
    STRING = 5
    BLOCK = 6
    NETTIME = 7
    INTERVAL = 8
    MAC = 9
    IP = 10


#: Kinds whose types may have no fixed length.
SIZED: Final = frozenset((Kind.STRING, Kind.BLOCK))
#: Kinds whose bits are one number.
NUMERIC: Final = frozenset((Kind.BOOL, Kind.INT, Kind.UINT, Kind.REAL))

#: Kind → widths that its types may have; a range for open ones, None for multiples of eight.
_WIDTHS: Final = MappingProxyType(
    {
        Kind.BOOL: range(1, 2),
        Kind.INT: range(1, MAX_INTEGER_BITS + 1),
        Kind.UINT: range(1, MAX_INTEGER_BITS + 1),
        Kind.REAL: (32, 64),
        Kind.NETTIME: (64,),
        Kind.INTERVAL: (64,),
        Kind.MAC: (48,),
        Kind.IP: (32,),
    }
)


class SimpleType(msgspec.Struct, frozen=True):
    """A simple type (C35): index (0: none), name, kind, bits (0 for a string or block whose length is given elsewhere).

    ``form`` is the encoding of a string that is not UTF-8, or "tai" for a network time that is not UTC: the dictionary chooses
    both, for all of its types.
    """

    index: int
    name: str
    kind: Kind
    bits: int
    form: str = ""

    @property
    def variable(self) -> bool:
        """Whether the length of a value is given by the variable or by the message."""
        return self.kind in SIZED and not self.bits

    def check(self, value: object, bits: int = 0, where: str = "") -> Value:
        """Return ``value`` in the Python form of this type. Raises `Error` with what is wrong.

        ``bits`` is the width of the variable if the type leaves it open (0: any). Texts are accepted for times (ISO 8601), MAC
        and IP addresses, pairs of integers for times.
        """
        if self.form:
            return _FORMED[self.kind](value, bits or self.bits, where or self.name, self.form)
        return _CHECKS[self.kind](value, bits or self.bits, where or self.name)


def width_trouble(kind: Kind, bits: int) -> str:
    """Return what is wrong with a type of ``kind`` and ``bits``, or an empty string."""
    widths = _WIDTHS.get(kind)
    if widths is None:
        if kind is Kind.RESERVED:
            return "" if 0 <= bits <= 8 * MAX_OCTETS else f"reserved bits number 0 to {8 * MAX_OCTETS}, not {bits}"
        if bits % 8 or not 0 <= bits <= 8 * MAX_OCTETS:
            return f"a {kind.name.lower()} has whole bytes, at most {MAX_OCTETS}, not {bits} bits"
        return ""
    if bits in widths:
        return ""
    allowed = f"{widths[0]} to {widths[-1]}" if isinstance(widths, range) else " or ".join(map(str, widths))
    return f"a type of kind {kind.name.lower()} has {allowed} bits, not {bits}"


def _native(value: object) -> object:
    """Return the Python value of a numpy scalar; anything else unchanged."""
    item = getattr(value, "item", None)
    return item() if callable(item) and getattr(value, "shape", None) == () else value


def _bool(value: object, _bits: int, where: str) -> Value:
    if value is True or value is False:
        return value
    native = _native(value)
    if isinstance(native, bool):
        return native
    raise Error(E_VALUE, where, f"{shown(value)} is neither true nor false")


def _number(value: object, where: str) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return int(value)
    native = _native(value)
    if isinstance(native, int) and not isinstance(native, bool):
        return native
    raise Error(E_RANGE, where, f"{shown(value)} is not a whole number")


def _int(value: object, bits: int, where: str) -> Value:
    number = _number(value, where)
    half = 1 << (bits - 1)
    if -half <= number < half:
        return number
    raise Error(E_RANGE, where, f"{shown(number)} is outside {-half}..{half - 1}")


def _uint(value: object, bits: int, where: str) -> Value:
    number = _number(value, where)
    if 0 <= number < 1 << bits:
        return number
    raise Error(E_RANGE, where, f"{shown(number)} is outside 0..{(1 << bits) - 1}")


def _real(value: object, bits: int, where: str) -> Value:
    if not isinstance(value, (int, float)):
        value = _native(value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise Error(E_RANGE, where, f"{shown(value)} is not a number")
    try:
        number = float(value)
        if bits == 32:
            _FLOAT.pack(number)
    except OverflowError:
        raise Error(E_RANGE, where, f"{shown(value)} is too large for {bits} bits") from None
    if math.isinf(number):
        raise Error(E_RANGE, where, "infinity is not a value of this type, only finite numbers and NaN are (R41)")
    return number


def _string(value: object, bits: int, where: str, encoding: str = "utf-8") -> Value:
    if not isinstance(value, str):
        raise Error(E_VALUE, where, f"{shown(value)} is not a string")
    try:
        size = len(value.encode(encoding))
    except UnicodeEncodeError:
        raise Error(E_UTF8, where, f"{shown(value)} has no {encoding.upper()} form") from None
    if value.endswith("\0"):
        raise Error(E_VALUE, where, "a text cannot end in U+0000, which fills strings up")
    most = bits // 8 or MAX_OCTETS
    if size > most:
        raise Error(E_LENGTH, where, f"{count(size, 'byte')} of text, there is room for {most}")
    return value


def _block(value: object, bits: int, where: str) -> Value:
    if not isinstance(value, (bytes, bytearray, memoryview)):
        raise Error(E_VALUE, where, f"{shown(value)} is not a block of bytes")
    octets = bytes(value)
    if (bits and len(octets) * 8 != bits) or len(octets) > MAX_OCTETS:
        raise Error(
            E_LENGTH, where, f"{count(len(octets), 'byte')}, the block has {bits // 8 or f'at most {MAX_OCTETS}'}"
        )
    return octets


def _two_fields(value: object, where: str, form: str) -> tuple[int, int]:
    if not isinstance(value, (tuple, list)):
        value = _native(value)
    if isinstance(value, (tuple, list)) and len(value) == 2:
        seconds, nanoseconds = _number(value[0], where), _number(value[1], where)
        if -_INT32 <= seconds < _INT32:
            return seconds, nanoseconds
        raise Error(E_RANGE, where, f"{shown(seconds)} seconds do not fit 32 bits")
    raise Error(E_VALUE, where, f"{shown(value)} is no {form}")


def _nettime(value: object, _bits: int, where: str, scale: str = "") -> Value:
    time = TaiTime if scale else NetTime
    if isinstance(value, Interval):
        raise Error(E_VALUE, where, "an interval is not a moment")
    if isinstance(value, str):
        try:
            value = time.from_isoformat(value)
        except (ValueError, OverflowError) as error:
            raise Error(E_VALUE, where, str(error)) from None
    seconds, nanoseconds = _two_fields(value, where, "time: seconds and nanoseconds, or ISO 8601")
    if 0 <= nanoseconds < _SECOND:
        return time(seconds, nanoseconds)
    raise Error(E_RANGE, where, f"{shown(nanoseconds)} ns are outside 0..999999999")


def _interval(value: object, _bits: int, where: str) -> Value:
    if isinstance(value, NetTime):
        raise Error(E_VALUE, where, "a moment is not an interval")
    if isinstance(value, str):
        try:
            value = Interval.from_isoformat(value)
        except ValueError as error:
            raise Error(E_VALUE, where, str(error)) from None
    seconds, nanoseconds = _two_fields(value, where, "interval: seconds and nanoseconds")
    if -_SECOND < nanoseconds < _SECOND:
        return Interval(seconds, nanoseconds)
    raise Error(E_RANGE, where, f"{shown(nanoseconds)} ns are outside -999999999..999999999")


def _mac(value: object, _bits: int, where: str) -> Value:
    if isinstance(value, (bytes, str)):
        try:
            return MAC(value)
        except ValueError as error:
            raise Error(E_VALUE, where, str(error)) from None
    raise Error(E_VALUE, where, f"{shown(value)} is not a MAC address")


def _ip(value: object, _bits: int, where: str) -> Value:
    if isinstance(value, (bytes, str, IPv4Address)):
        try:
            return IPv4Address(value)
        except AddressValueError:
            pass
    raise Error(E_VALUE, where, f"{shown(value)} is not an IP address such as 192.168.100.1")


def _reserved(_value: object, _bits: int, where: str) -> Value:
    raise Error(E_VALUE, where, "reserved bits have no value (R31)")


_CHECKS: Final = MappingProxyType(
    {
        Kind.RESERVED: _reserved,
        Kind.BOOL: _bool,
        Kind.INT: _int,
        Kind.UINT: _uint,
        Kind.REAL: _real,
        Kind.STRING: _string,
        Kind.BLOCK: _block,
        Kind.NETTIME: _nettime,
        Kind.INTERVAL: _interval,
        Kind.MAC: _mac,
        Kind.IP: _ip,
    }
)
#: The same for kinds that a dictionary may have in another form.
_FORMED: Final = MappingProxyType({Kind.STRING: _string, Kind.NETTIME: _nettime})
#: `SimpleType.form` of a network time that counts leap seconds.
TAI: Final = "tai"
#: Encodings of strings that a dictionary may choose; UTF-8 is that of the text (R42).
ENCODINGS: Final = ("utf-8", "cp1251", "cp866", "koi8-r", "latin-1")

#: The base types of 3.1.19 (R55); the numbers in the text are decimal (C29).
STANDARD: Final = MappingProxyType(
    {
        row.index: row
        for row in (
            SimpleType(1, "bool", Kind.BOOL, 1),
            SimpleType(2, "int8", Kind.INT, 8),
            SimpleType(3, "int16", Kind.INT, 16),
            SimpleType(4, "int32", Kind.INT, 32),
            SimpleType(5, "uint8", Kind.UINT, 8),
            SimpleType(6, "uint16", Kind.UINT, 16),
            SimpleType(7, "uint32", Kind.UINT, 32),
            SimpleType(8, "float32", Kind.REAL, 32),
            SimpleType(10, "string", Kind.STRING, 0),
            SimpleType(13, "interval", Kind.INTERVAL, 64),
            SimpleType(15, "block", Kind.BLOCK, 0),
            SimpleType(17, "float64", Kind.REAL, 64),
            SimpleType(21, "int64", Kind.INT, 64),
            SimpleType(27, "uint64", Kind.UINT, 64),
            SimpleType(1025, "mac", Kind.MAC, 48),
            SimpleType(1026, "ip", Kind.IP, 32),
            SimpleType(1027, "nettime", Kind.NETTIME, 64),
        )
    }
)
BOOL: Final = STANDARD[1]
UINT8: Final = STANDARD[5]
UINT16: Final = STANDARD[6]
UINT32: Final = STANDARD[7]
BLOCK: Final = STANDARD[15]
UINT64: Final = STANDARD[27]
VOID: Final = SimpleType(0, "void", Kind.RESERVED, 0)

#: Other names of standard types: those of the text, and aliases that have no index (1.2 of the reference).
ALIASES: Final = MappingProxyType(
    {
        "sca": 5,
        "port": 5,
        "protocol": 5,
        "crc": 6,
        "size": 6,
        "err": 2,
        "boolean": 1,
        "real32": 8,
        "real64": 17,
        **{f"scd_int{bits}_t": index for bits, index in ((8, 2), (16, 3), (32, 4), (64, 21))},
        **{f"scd_uint{bits}_t": index for bits, index in ((8, 5), (16, 6), (32, 7), (64, 27))},
        "scd_float_t": 8,
        "scd_double_t": 17,
        "scd_mac_t": 1025,
        "scd_ip_t": 1026,
        "scd_sca_t": 5,
        "scd_port_t": 5,
        "scd_crc_t": 6,
        "scd_size_t": 6,
        "scd_protocol_t": 5,
        "scd_err_t": 2,
    }
)
#: Every name of a standard type → its index.
STANDARD_NAMES: Final = MappingProxyType({**{row.name: row.index for row in STANDARD.values()}, **ALIASES})


def formed(kind: SimpleType, time_scale: str, encoding: str) -> SimpleType:
    """Return a type in the form that it has with this time scale and encoding of strings."""
    if kind.kind is Kind.STRING and encoding != ENCODINGS[0]:
        return msgspec.structs.replace(kind, form=encoding)
    return msgspec.structs.replace(kind, form=TAI) if kind.kind is Kind.NETTIME and time_scale == TAI else kind


def reserved(bits: int) -> SimpleType:
    """Return Reserved N (R31); Void for 0 bits (R28)."""
    return SimpleType(0, "reserved", Kind.RESERVED, bits) if bits else VOID


def integer(bits: int, *, signed: bool) -> SimpleType:
    """Return the Integer N or Unsigned N of 1..64 bits (R34, R37); one of 3.1.19 where the text has it.

    Raises `Error` for another width.
    """
    kind = Kind.INT if signed else Kind.UINT
    for row in STANDARD.values():
        if row.kind is kind and row.bits == bits:
            return row
    trouble = width_trouble(kind, bits)
    if trouble:
        raise Error(E_RANGE, "integer type", trouble)
    return SimpleType(0, f"{kind.name.lower()}{bits}", kind, bits)
