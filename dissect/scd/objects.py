"""The collection of information objects that a codec reads from and writes to (R11-R15)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, MutableMapping
from typing import Any, Final

from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import E_INDEX, Error
from dissect.scd.layout import Key
from dissect.scd.model import StructType, Variable
from dissect.scd.types import Value

_NOTHING: Final = object()


class Objects(MutableMapping[Any, Value]):
    """Values of a dictionary's variables, by (index, sub), "0x6000:1", name or "object.field"; checked when they are set.

    A field of a bare struct is "struct.field". ``message`` says how `encode` and `decode` of this package interpret the octets:
    the name of a PDO, a struct, an object or a variable; empty for a message in its envelope. ``changed`` are the keys whose
    values the last decoding changed. Iteration yields (index, sub), or the text for fields of structs, in the order in which
    they were set.
    """

    def __init__(self, dictionary: Dictionary, message: str = "") -> None:
        self.dictionary = dictionary
        self.message = message
        self.changed: tuple[Key, ...] = ()
        self._values: dict[Key, Value] = {}

    def __getitem__(self, key: Key) -> Value:
        if key in self._values:
            return self._values[key]
        return self._values[self._resolve(key)[0]]

    def __setitem__(self, key: Key, value: object) -> None:
        known, variable = self._resolve(key)
        self._values[known] = variable.check(value)

    def __delitem__(self, key: Key) -> None:
        del self._values[self._resolve(key)[0]]

    def __contains__(self, key: object) -> bool:
        if not isinstance(key, (tuple, str)):
            return False
        try:
            return key in self._values or self._resolve(key)[0] in self._values
        except Error:
            return False

    def __iter__(self) -> Iterator[Key]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def known(self) -> Mapping[Key, Value]:
        """The values by the keys that `__iter__` yields, without other spellings."""
        return self._values

    def named(self) -> dict[str, Value]:
        """Return the values by the full names of their variables."""
        return {self._resolve(key)[1].label: value for key, value in self._values.items()}

    def merge(self, values: Mapping[Key, Value]) -> None:
        """Take decoded values, which need no check, and note which of them changed."""
        own = self._values
        # A missing value differs from everything; NaN differs from itself, which is not a change.
        self.changed = tuple(
            [
                key
                for key, value in values.items()
                if (old := own.get(key, _NOTHING)) is not value and old != value and (old == old or value == value)  # noqa: PLR0124
            ]
        )
        own.update(values)

    def take(self, keys: Iterable[Key]) -> dict[Key, Value]:
        """Return the values of those ``keys``, in the form that `__iter__` yields, which exist."""
        return {key: self._values[key] for key in keys if key in self._values}

    def _resolve(self, key: Key) -> tuple[Key, Variable]:
        """Return the key that this collection uses, and the variable. Raises `Error` E_INDEX or E_SUB."""
        if isinstance(key, str):
            name, point, field = key.rpartition(".")
            found = self.dictionary.types.get(self.dictionary.type_names.get(name, -1)) if point else None
            if isinstance(found, StructType):
                for variable in found.fields:
                    if variable.name == field and not variable.reserved:
                        return key, variable
        elif len(key) != 2:
            raise Error(E_INDEX, repr(key), "an address is (index, sub-index)")
        variable = self.dictionary.variable(key)
        return variable.address, variable

    def __repr__(self) -> str:
        return f"<Objects of {self.dictionary.name!r}: {len(self._values)} values>"
