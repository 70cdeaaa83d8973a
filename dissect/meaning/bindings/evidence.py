"""Finds evidence that a device has another dictionary (R18, profile 3.4): values that both know, and objects that it denies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from dissect.scd.layout import address_text
from dissect.scd.model import CLASSES, StructType
from dissect.scd.ranges import STRUCTURE_SUB, is_mapping
from dissect.scd.wording import value_text
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.layout import Key
    from dissect.scd.messages import Message
    from dissect.scd.model import Object
    from dissect.scd.types import Value

#: ConfId of "verify configuration" (reference 3.4), which identifies the dictionary of a device.
CONF_ID: Final = (0x1020, 3)
#: scd_err_t of "no such object" and "no such sub-index" (reference 3.5).
_NO_OBJECT: Final = -5
_NO_SUB: Final = -6


class Evidence:
    """Compares the statements of devices with one dictionary.

    ``constants`` are the addresses of values that never change (R75), including numbers of sub-indices, but not those of
    mapping objects, which are rewritten. ``keys`` are all addresses whose values are compared with anything.
    """

    def __init__(self, dictionary: Dictionary) -> None:
        self._dictionary = dictionary
        self._conf_id = int.from_bytes(dictionary.wire_id[:4], "little")
        self._expected: dict[Key, Value] = {}
        constants = set()
        structs = [dictionary[index] for index, kind in dictionary.types.items() if isinstance(kind, StructType)]
        for obj in (*dictionary, *structs):  # for structs: the parts that a device may return (R59)
            for variable in obj:
                if variable.access == "const":
                    constants.add(variable.address)
                    if variable.default is not None:
                        self._expected[variable.address] = variable.default
        self.constants: Final[frozenset[Key]] = frozenset(constants)
        self.keys: Final[frozenset[Key]] = frozenset((*constants, CONF_ID))

    def shown(self, key: tuple[int, int], value: Value) -> str:
        """Return how a value shows that the device's dictionary is different; empty if it does not."""
        if key == CONF_ID:
            if value in {0, self._conf_id} or not isinstance(value, int):
                return ""
            return f"its ConfId is {value:#010x}, that of {printable(repr(self._dictionary.name))} is {self._conf_id:#010x}"
        if key[1] == STRUCTURE_SUB:
            return self._structure(key[0], value)
        expected = self._expected.get(key)
        if expected is None or value == expected or (value != value and expected != expected):  # noqa: PLR0124 - NaN
            return ""
        what = "number of sub-indices" if key[1] == 0 and not self._dictionary[key[0]].single else "constant"
        return f"{what} {address_text(key)} = {value_text(value)}, the dictionary has {value_text(expected)}"

    def _structure(self, index: int, value: Value) -> str:
        obj = self._dictionary.objects.get(index)
        if obj is None or not isinstance(value, int):
            return ""
        object_class, code = value & 0xFF, value >> 8 & 0xFFFF
        same_type = not code or not _type_code(obj) or code == _type_code(obj)
        if object_class == obj.object_class and same_type:
            return ""
        theirs = f"{CLASSES.get(object_class, object_class)} of type 0x{code:04x}"
        return f"0x{index:04x} is {theirs} there, {CLASSES[obj.object_class]} of type 0x{_type_code(obj):04x} in the dictionary"

    def denied(self, message: Message) -> str:
        """Return the object that an error answer denies although it is mandatory in the dictionary (R76); empty for none."""
        if "index" not in message.numbers or message.err not in {_NO_OBJECT, _NO_SUB}:
            return ""
        obj = self._dictionary.objects.get(message.index)
        if obj is None or not obj.mandatory:
            return ""
        if message.err == _NO_OBJECT:
            return f"it has no object 0x{obj.index:04x} {printable(obj.name)}, which is mandatory"
        if message.sub in obj:
            return f"it has no sub-index {message.sub} of 0x{obj.index:04x} {printable(obj.name)}, which is mandatory"
        return ""


def _type_code(obj: Object) -> int:
    """Return the index of an object's type; 0 if it has its own fields."""
    return 0 if obj.type is None or is_mapping(obj.index) else obj.type.index
