"""The content of a CANopen or POWERLINK device description, in any file format, and notes about it (profile 3.1).

Values and limits remain texts as written; `translation` makes a dictionary from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import msgspec

from dissect.scd.dictionary import Dictionary

#: How many places a note names; the others are counted.
_SHOWN: Final = 4


class Note(NamedTuple):
    """A part that an import could not keep, and its place: "0x6000" or "0x6000:1"."""

    text: str
    places: tuple[str, ...]

    def __str__(self) -> str:
        more = len(self.places) - _SHOWN
        shown = ", ".join(self.places[:_SHOWN]) + (f" and {more} more" if more > 0 else "")
        return f"{shown}: {self.text}" if shown else self.text


class Imported(NamedTuple):
    """The result of an import: the dictionary, and notes on the parts of the file that it does not keep."""

    dictionary: Dictionary
    notes: tuple[Note, ...]


class ForeignSub(msgspec.Struct):
    """A variable as the file describes it, with numbers still as texts; ``code`` is its type, -1 if there is none."""

    sub: int
    name: str
    code: int
    access: str
    mappable: bool = False
    value: str | None = None
    low: str | None = None
    high: str | None = None
    unit: str = ""
    scale: float = 1.0


class ForeignEntry(msgspec.Struct):
    """An object as the file describes it; ``subs`` by number, for a VAR or DOMAIN only 0."""

    index: int
    name: str
    object_class: int
    mandatory: bool
    subs: dict[int, ForeignSub]


class Notes:
    """Collects notes: the places for each text."""

    def __init__(self) -> None:
        self._places: dict[str, list[str]] = {}

    def add(self, text: str, index: int = -1, sub: int = -1) -> None:
        """Note ``text`` about an object or variable."""
        places = self._places.setdefault(text, [])
        if index >= 0:
            places.append(f"0x{index:04x}" + (f":{sub}" if sub >= 0 else ""))

    def told(self) -> tuple[Note, ...]:
        """Return the notes in the order in which they were made."""
        return tuple([Note(text, tuple(places)) for text, places in self._places.items()])


class Description(NamedTuple):
    """A device description: name, version, node id of a configured device (None: missing), objects by index."""

    name: str
    version: str
    node_id: int | None
    entries: Mapping[int, ForeignEntry]
