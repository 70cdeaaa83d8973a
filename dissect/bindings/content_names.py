"""What ``holds`` names: messages, or a PDO, struct, variable or object of the dictionary."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from dissect.bindings.binding import Holds
from dissect.config.hints import close_to
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import E_INDEX, E_PDO_NUMBER, E_VALUE, Error, shown
from dissect.scd.model import NULL, Object, StructType, Variable

MESSAGES: Final = "messages"
#: PDOs that an error names.
_MOST_PDOS: Final = 16
_WAYS: Final = f'write "{MESSAGES}", a PDO ("T1"), a struct or object by its name or index, or "object.field"'
_PDO: Final = re.compile(r"[RTrt](?:PDO\s*)?[0-9]+")
_INDEX: Final = re.compile(r"0[xX][0-9a-fA-F]{1,4}")


class Content(NamedTuple):
    """What stands at a place; see `Binding` for the fields."""

    holds: Holds
    key: str = ""
    title: str = ""
    address: tuple[int, int] = (0, 0)
    size: int = 0


def find_content(dictionary: Dictionary, written: str) -> Content:
    """Return what ``written`` names; raises `Error` for what is not there, for two things of one name, and for no data."""
    if not written.strip():
        raise Error(E_VALUE, "", f"is empty; {_WAYS}")
    if written == MESSAGES:
        return Content("messages")
    found = [content for content in (_pdo(dictionary, written), _struct(dictionary, written)) if content is not None]
    named = found and found[0].holds == "pdo" and dictionary.pdo(written).name == written
    if not named:
        # A PDO has the name of its mapping object; whoever wants that one gives its index.
        thing = _object(dictionary, written)
        if thing is not None:
            found.append(thing)
    if not found:
        raise _unknown(dictionary, written)
    if len(found) > 1:
        kinds = " and ".join(f"a {content.holds}" for content in found)
        ways = " or ".join(_surely(content) for content in found)
        raise Error(E_VALUE, "", f"{shown(written)} is {kinds}: write {ways}")
    return found[0]


def _surely(content: Content) -> str:
    """Return how a content is written that nothing else can be meant by."""
    if content.holds == "pdo":
        return f'"{content.key[0]}PDO {content.key[1:]}"'
    return f'"{content.key}"' if content.holds == "value" else f'"0x{content.address[0]:04x}"'


def _pdo(dictionary: Dictionary, written: str) -> Content | None:
    try:
        pdo = dictionary.pdo(written)
    except Error:
        return None
    key = f"{pdo.direction}{pdo.number}"
    return Content("pdo", key, f"{key} {pdo.name}".rstrip(), (0, 0), pdo.size)


def _struct(dictionary: Dictionary, written: str) -> Content | None:
    by_index = _INDEX.fullmatch(written) and written not in dictionary.names
    index = int(written, 16) if by_index else dictionary.type_names.get(written, -1)
    struct = dictionary.types.get(index)
    if not isinstance(struct, StructType):
        return None
    return Content("struct", struct.name, struct.name, (index, 0), struct.size)


def _object(dictionary: Dictionary, written: str) -> Content | None:
    """Return a whole object or one of its values; raises `Error` for an object without data, and for no sub-index of one."""
    by_index = _INDEX.fullmatch(written) and written not in dictionary.names
    index = int(written, 16) if by_index else dictionary.names.get(written, -1)
    obj = dictionary.objects.get(index)
    if obj is not None:
        return _whole(obj)
    if by_index:
        return None  # the index of a type, or of nothing
    try:
        variable = dictionary.variable(written)
    except Error as error:
        if error.code == E_INDEX:
            return None
        raise
    if variable.index not in dictionary.objects:
        return None
    return _value(variable)


def _whole(obj: Object) -> Content:
    if obj.object_class == NULL:
        raise Error(E_VALUE, "", f"0x{obj.index:04x} {shown(obj.name)} is a NULL, which holds no data")
    if obj.single and obj.head is not None:
        return _value(obj.head)
    key = f"0x{obj.index:04x}"
    return Content("object", key, f"{key} {obj.name}".rstrip(), (obj.index, 0), obj.size)


def _value(variable: Variable) -> Content:
    key = f"0x{variable.index:04x}:{variable.sub}"
    return Content("value", key, f"{key} {variable.label}".rstrip(), variable.address, variable.size)


def _unknown(dictionary: Dictionary, written: str) -> Error:
    """Return the error that says what there is instead."""
    within = f"in the dictionary {shown(dictionary.name)}"
    if _PDO.fullmatch(written):
        there = [*(f"T{number}" for number in dictionary.tpdo), *(f"R{number}" for number in dictionary.rpdo)]
        some = f"; there are {', '.join(there[:_MOST_PDOS])}" if there else "; there are none"
        more = f" and {len(there) - _MOST_PDOS} more" if len(there) > _MOST_PDOS else ""
        return Error(
            E_PDO_NUMBER, "", f"no PDO {shown(written) if len(written) > _MOST_PDOS else written} {within}{some}{more}"
        )
    hint = close_to(written, _names(dictionary, written)) or f"; {_WAYS}"
    return Error(E_INDEX, "", f"no PDO, struct or object {shown(written)} {within}{hint}")


def _names(dictionary: Dictionary, written: str) -> Iterator[str]:
    yield MESSAGES
    for kind in dictionary.types.values():
        if isinstance(kind, StructType):
            yield kind.name
    for obj in dictionary:
        if obj.name:
            yield obj.name
        if "." in written:
            for variable in obj:
                yield variable.label
