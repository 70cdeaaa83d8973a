"""The keys, columns and fields of a face that the table of facts reads: others are not shared facts, or were forgotten."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Any

from tests.faces.comparing import Cut, compare
from tests.faces.records import Record

#: A place that was read: kind of record, face, and place in the record.
Place = tuple[str, str, str]


class Watched(dict[str, Any]):
    """A record that notes which parts are read; reading a list, or all of an object at once, counts for all its contents."""

    def __init__(self, record: Record, seen: set[str], before: str = "") -> None:
        super().__init__({
            name: Watched(value, seen, f"{before}{name}.") if type(value) is dict else value for name, value in record.items()
        })  # fmt: skip
        self._seen = seen
        self._before = before

    def __getitem__(self, name: str) -> Any:
        self._note(name)
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:
        self._note(name)
        return super().get(name, default)

    def values(self) -> Any:
        for name in self:
            self._seen.add(f"{self._before}{name}")
        return super().values()

    def _note(self, name: str) -> None:
        if not isinstance(super().get(name), Watched):
            self._seen.add(f"{self._before}{name}")


def places(record: Record, before: str = "") -> Iterator[str]:
    """Yield each place of a record that contains something other than an object."""
    for name, value in record.items():
        if isinstance(value, dict):
            yield from places(value, f"{before}{name}.")
        else:
            yield f"{before}{name}"


class Coverage:
    """The places of records that occurred, and those of them that were read."""

    def __init__(self) -> None:
        self.there: set[Place] = set()
        self._read: set[Place] = set()

    @property
    def unread(self) -> set[Place]:
        """The places that no cell of the table read."""
        return self.there - self._read

    def add(self, cut: Cut) -> None:
        """Compare the records of a capture that have a new place, and note which parts are read."""
        keys = self._new(cut)
        seen: dict[tuple[str, str], set[str]] = {face: set() for face in cut}
        watched: Cut = {
            face: {key: Watched(record, seen[face]) for key, record in records.items() if key in keys[face[0]]}
            for face, records in cut.items()
        }
        for _ in compare(watched):
            pass
        # The object `ending` of a connection is a separate view of the same record.
        seen["connection", "json"] |= seen["connection", "ending"]
        self._read |= {(*face, place) for face, found in seen.items() for place in found}

    def _new(self, cut: Cut) -> dict[str, set[Hashable]]:
        """Return the keys of records with new places, by kind of record."""
        keys: dict[str, set[Hashable]] = {kind: set() for kind, _ in cut}
        for (kind, face), records in cut.items():
            for key, record in records.items():
                found = {(kind, face, place) for place in places(record)}
                if not found <= self.there:
                    self.there |= found
                    keys[kind].add(key)
        return keys
