"""What a device description of CANopen or POWERLINK says, whatever file it stood in, and what is noted of it (profile 3.1).

Values and limits stay the texts they are written as; `translation` makes a dictionary of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import msgspec

from dissect.scd.dictionary import Dictionary

#: Places that a note names; of more it says how many.
_SHOWN: Final = 4


class Note(NamedTuple):
    """What an import could not keep, and where: "0x6000" or "0x6000:1"."""

    text: str
    places: tuple[str, ...]

    def __str__(self) -> str:
        more = len(self.places) - _SHOWN
        shown = ", ".join(self.places[:_SHOWN]) + (f" and {more} more" if more > 0 else "")
        return f"{shown}: {self.text}" if shown else self.text


class Imported(NamedTuple):
    """What an import gives: the dictionary, and what it does not keep of the file."""

    dictionary: Dictionary
    notes: tuple[Note, ...]


class ForeignSub(msgspec.Struct):
    """A variable as the file describes it, its numbers still as texts; ``code`` is its type, -1 where none is said."""

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
    """An object as the file describes it; ``subs`` by number, of a VAR or DOMAIN 0 alone."""

    index: int
    name: str
    object_class: int
    mandatory: bool
    subs: dict[int, ForeignSub]


class Notes:
    """Collects notes: the places of each text."""

    def __init__(self) -> None:
        self._places: dict[str, list[str]] = {}

    def add(self, text: str, index: int = -1, sub: int = -1) -> None:
        """Note ``text`` of an object or variable."""
        places = self._places.setdefault(text, [])
        if index >= 0:
            places.append(f"0x{index:04x}" + (f":{sub}" if sub >= 0 else ""))

    def told(self) -> tuple[Note, ...]:
        """Return the notes in the order in which they came up."""
        return tuple([Note(text, tuple(places)) for text, places in self._places.items()])


class Description(NamedTuple):
    """A device description: name, version, node id of a configured device (None: not said), objects by index."""

    name: str
    version: str
    node_id: int | None
    entries: Mapping[int, ForeignEntry]
