"""The entries of mapping objects: which variable is at which bits of a PDO (R103-R106, C49).

There are two forms, distinguished by the type of the array's elements: UNSIGNED64 of POWERLINK, with an offset in each entry,
and UNSIGNED32 of CANopen, where entries follow each other. In both, the index of a static type is a gap, as in CANopen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

from dissect.scd.errors import E_MAP, Error
from dissect.scd.model import Mapped, Variable
from dissect.scd.ranges import MAX_SUB, is_static_type
from dissect.wire.text import count

#: The most bits of a PDO: offset and length are UNSIGNED16.
MAX_PDO_BITS: Final = 0xFFFF

Find = Callable[[int, int], Variable]


class Entry(NamedTuple):
    """One entry: ``target`` is the index of an object, 0 for a gap; offset and length are in bits."""

    target: int
    sub: int
    offset: int
    bits: int


def pack_entry(entry: Entry, wide: bool) -> int:
    """Return the value of the entry: UNSIGNED64 if ``wide``, else UNSIGNED32, which has no offset."""
    if wide:
        return entry.target | entry.sub << 16 | entry.offset << 32 | entry.bits << 48
    return entry.target << 16 | entry.sub << 8 | entry.bits


def entries_of(values: Iterable[int], wide: bool, where: str) -> list[Entry]:
    """Return the entries for the values of a mapping object; raises `Error` E_MAP."""
    entries = []
    end = 0
    for number, value in enumerate(values, 1):
        if wide:
            entry = Entry(value & 0xFFFF, value >> 16 & 0xFF, value >> 32 & 0xFFFF, value >> 48)
            if value >> 24 & 0xFF:
                raise Error(E_MAP, f"{where} entry {number}", "byte 3 of an entry is 0")
        else:
            entry = Entry(value >> 16, value >> 8 & 0xFF, end, value & 0xFF)
        if is_static_type(entry.target):
            entry = entry._replace(target=0, sub=0)
        elif not entry.target:
            raise Error(E_MAP, f"{where} entry {number}", "the index is 0")
        end = entry.offset + entry.bits
        entries.append(entry)
    return entries


def place(entries: Iterable[Entry], direction: str, find: Find, where: str) -> tuple[tuple[Mapped, ...], int]:
    """Return the variables of a PDO with their positions, and its length in bits; raises `Error` E_MAP for a wrong entry.

    ``find`` returns the variable with an index and a sub-index, and raises `Error` if there is none.
    """
    mapped = []
    end = 0
    for number, entry in enumerate(entries, 1):
        spot = f"{where} entry {number} (0x{entry.target:04x}:{entry.sub})"
        if entry.offset < end:
            raise Error(E_MAP, spot, f"begins at bit {entry.offset}, the entry before it ends at bit {end}")
        end = entry.offset + entry.bits
        if end > MAX_PDO_BITS:
            raise Error(E_MAP, spot, f"ends at bit {end}, a PDO has at most {MAX_PDO_BITS}")
        if entry.target:
            mapped.append(Mapped(_variable(entry, direction, find, spot), entry.offset, entry.bits))
    return tuple(mapped), end


def _variable(entry: Entry, direction: str, find: Find, spot: str) -> Variable:
    if entry.sub > MAX_SUB:
        raise Error(E_MAP, spot, f"sub-indices of variables end at {MAX_SUB}")
    try:
        variable = find(entry.target, entry.sub)
    except Error as error:
        raise Error(E_MAP, spot, error.detail) from None
    if not variable.mappable:
        raise Error(E_MAP, spot, f"{variable.label} cannot be mapped")
    if direction == "T" and not variable.readable:
        raise Error(E_MAP, spot, f"{variable.label} is {variable.access} and cannot be read for a TPDO")
    if direction == "R" and not variable.writable:
        raise Error(E_MAP, spot, f"{variable.label} is {variable.access} and cannot be written by an RPDO")
    trouble = width_trouble(variable, entry.bits)
    if trouble:
        raise Error(E_MAP, spot, f"{variable.label} {trouble}")
    return variable


def width_trouble(variable: Variable, bits: int) -> str:
    """Return what is wrong with mapping ``bits`` of the variable, or an empty string."""
    if not variable.type.variable:
        return "" if bits == variable.bits else f"has {count(variable.bits, 'bit')}, not {bits}"
    if not bits or bits % 8:
        return f"is mapped with whole bytes, not {count(bits, 'bit')}"
    if variable.bits and bits > variable.bits:
        return f"has at most {count(variable.bits, 'bit')}, not {bits}"
    return ""
