"""Messages as text, and their values as rows, for people and programs (see `dissect.wire.text` for escaping)."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import Error
from dissect.scd.layout import Key, address_text
from dissect.scd.mapping import entries_of
from dissect.scd.messages import Message
from dissect.scd.model import StructType, Variable
from dissect.scd.ranges import is_mapping, pdo_of_index
from dissect.scd.types import UINT64, Value
from dissect.wire.text import count, encodable, printable, shortened

#: Characters of a text, and octets of a block, that a line shows.
_TEXT: Final = 60
#: How many values a line names.
_SHOWN: Final = 8


class Row(NamedTuple):
    """A value: its address, its name, and its meaning in the dictionary.

    ``address`` is "0x6041:0", for a field of a bare struct "struct.field"; ``name`` is the label of the variable. ``value`` is
    the raw value, ``physical`` the one with scale and shift (the same if there are none) in ``unit``; ``text`` is the
    dictionary's text for the value. ``flags`` say what is odd. ``type`` is the name of its type, empty if it is unknown.
    """

    address: str
    name: str
    value: Value
    physical: Value
    unit: str
    text: str
    flags: tuple[str, ...]
    type: str = ""


class SharedTexts(NamedTuple):
    """The data that all rows of a variable share: see `Row`.

    ``plain``: values have no text, and the physical is the raw value.
    """

    address: str
    name: str
    unit: str
    plain: bool
    variable: Variable


def rows(dictionary: Dictionary, message: Message) -> list[Row]:
    """Return the values of a message in its order."""
    found = []
    known = dictionary.told
    for key, value in message.values.items():
        flags = tuple([flag for flag, keys in message.flags.items() if key in keys]) if message.flags else ()
        told = known.get(key)
        if told is None:
            variable = _variable(dictionary, message, key)
            if variable is None:
                address = address_text(key) if isinstance(key, tuple) else f"{message.content}.{key}"
                found.append(Row(address, "", value, value, "", "", flags))
                continue
            told = _told(variable, message, key)
            if isinstance(key, tuple):
                known[key] = told
        variable = told.variable
        if told.plain:
            found.append(Row(told.address, told.name, value, value, told.unit, "", flags, told.variable.type.name))
        else:
            text = variable.desc(value) or _mapped(variable, value)
            physical = variable.phys(value)
            found.append(Row(told.address, told.name, value, physical, told.unit, text, flags, variable.type.name))
    return found


def _told(variable: Variable, message: Message, key: Key) -> SharedTexts:
    traits = variable.traits
    plain = traits.scale == 1 and not traits.shift and not traits.texts and not is_mapping(variable.index)
    if isinstance(key, tuple):
        return SharedTexts(address_text(key), variable.label, variable.unit, plain, variable)
    return SharedTexts(f"{message.content}.{key}", variable.name, variable.unit, plain, variable)


def described(dictionary: Dictionary, address: tuple[int, int]) -> tuple[str, str, str]:
    """Return label, name of the type, and unit of a variable; empty texts if the dictionary has none there."""
    try:
        variable = dictionary.variable(address)
    except Error:
        return "", "", ""
    return variable.label, variable.type.name, variable.unit


def _mapped(variable: Variable, value: Value) -> str:
    """Return what an entry of a mapping object refers to, empty for everything else."""
    if not (is_mapping(variable.index) and variable.sub and isinstance(value, int) and value):
        return ""
    wide = variable.type is UINT64
    try:
        (entry,) = entries_of([value], wide, "")
    except Error:
        return "no entry of a mapping"
    if not entry.target:
        return f"a gap of {count(entry.bits, 'bit')}"
    at = f" from bit {entry.offset}" if wide else ""
    return f"{address_text((entry.target, entry.sub))}, {count(entry.bits, 'bit')}{at}"


def _variable(dictionary: Dictionary, message: Message, key: Key) -> Variable | None:
    """Return the variable of a value; None for sub-index 255, which is not a variable."""
    if isinstance(key, tuple):
        try:
            return dictionary.variable(key)
        except Error:
            return None
    struct = dictionary.types.get(dictionary.type_names.get(message.content, -1))
    if isinstance(struct, StructType):
        for field in struct.fields:
            if field.name == key:
                return field
    return None


def subject(dictionary: Dictionary, message: Message) -> str:
    """Return a short text that names the subject of a message, safe to show."""
    if message.service == "pdo":
        return _pdo(dictionary, message)
    if message.content:
        return printable(message.content)
    if not message.service:
        return "message"
    if "index" not in message.numbers:
        return message.service
    key = (message.index, message.sub)
    if is_mapping(message.index):
        direction, _, number = pdo_of_index(message.index)
        return f"{message.service} {address_text(key)} mapping of {direction}{number}"
    variable = _variable(dictionary, message, key)
    name = f" {printable(variable.label)}" if variable is not None and variable.label else ""
    return f"{message.service} {address_text(key)}{name}"


def _pdo(dictionary: Dictionary, message: Message) -> str:
    if not message.pdo:
        return "PDO"
    pdo = (dictionary.tpdo if message.pdo[0] == "T" else dictionary.rpdo).get(int(message.pdo[1:]))
    name = f" {printable(pdo.name)}" if pdo is not None and pdo.name else ""
    return f"PDO {message.pdo}{name}"


def value_text(value: Value) -> str:
    """Return a value for a person, safe to show and of bounded length."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, str):
        return f'"{shortened(value, _TEXT)}"'
    if type(value) is bytes:
        shown = value[: _TEXT // 2].hex(" ")
        return f"{count(len(value), 'byte')} {shown}{' …' if len(value) > _TEXT // 2 else ''}".rstrip()
    return printable(str(value))


def json_value(value: Value) -> object:
    """Return a value for JSON: blocks in hexadecimal; times, addresses and numbers that are not finite as texts."""
    if isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if type(value) is bytes:
        return value.hex()
    return str(value)


#: `encodable` for texts of a dictionary, which are always the same.
known_text: Final = lru_cache(maxsize=4096)(encodable)


def row_json(row: Row) -> dict[str, object]:
    """Return a row for JSON."""
    address, name, value, physical, unit, text, flags, _ = row
    shown = json_value(value)
    return {
        "address": known_text(address),
        "name": known_text(name),
        "value": shown,
        "physical": shown if physical is value else json_value(physical),
        "unit": known_text(unit) or None,
        "text": encodable(text) or None,
        "flags": list(flags),
    }


def row_text(row: Row) -> str:
    """Return "0x6001:0 Давление 1 = 1374 кПа" for a row."""
    address = printable(row.address)
    name = f"{address} {printable(row.name)}" if row.name and row.name != row.address else address
    return f"{name} = {physical_text(row)}"


def physical_text(row: Row) -> str:
    """Return "1374 кПа" for a row, with the text of the value and its flags."""
    unit = f" {printable(row.unit)}" if row.unit else ""
    text = f" ({printable(row.text)})" if row.text else ""
    odd = f" [{', '.join(row.flags)}]" if row.flags else ""
    return f"{value_text(row.physical)}{unit}{text}{odd}"


def values_text(found: list[Row]) -> str:
    """Return the values of a message on one line: by name, from the ninth on only counted."""
    shown = ", ".join([f"{printable(row.name or row.address)} = {physical_text(row)}" for row in found[:_SHOWN]])
    return shown + (f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else "")
