"""A record as JSON, from the table of its facts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from dissect.meaning.facts.fact import (
    BYTES,
    END,
    FILE,
    FRAME,
    FRAMES,
    OBJECT,
    RECORDS,
    TEXT,
    TIME,
    TSAP,
    Fact,
    Located,
    Record,
)
from dissect.wire.text import Clock, encodable


def _as_dict(value: Any) -> object:
    return value.as_dict()


#: The way of writing a value, by kind. A value of any other kind is JSON already.
_WRITTEN: Final[Mapping[str, Callable[[Any], object]]] = {
    END: str,
    TSAP: _as_dict,
    OBJECT: _as_dict,
    TEXT: encodable,
    BYTES: bytes.hex,
}


_NOTHING: Final[Mapping[str, Any]] = {}


def written(
    facts: Mapping[str, Fact[Record]],
    record: Record,
    places: Located,
    clock: Clock,
    owned: Mapping[str, Any] = _NOTHING,
) -> dict[str, object]:
    """Return a record as JSON values, its keys in the order of the table; ``owned`` has the objects from other writers."""
    told: dict[str, object] = {}
    for fact in facts.values():
        key = fact.key
        if not key:
            continue
        kind = fact.kind
        value = fact.get(record) if fact.get is not None else owned[key]
        if fact.rare and value is None:
            continue
        if kind == FRAME:
            _frame(told, key, int(value), places)
        elif kind == FRAMES:
            told[key] = [places.locate(frame)[1] for frame in value] if places.several else value
            if places.several:
                told[_file(key)] = [places.locate(frame)[0] for frame in value]
        elif value is None:
            told[key] = None
        elif kind == TIME:
            told[key] = clock.iso(value)
        elif kind == RECORDS:
            assert fact.records is not None
            told[key] = _records(fact.records, value, places, clock)
        else:
            write = _WRITTEN.get(kind)
            told[key] = write(value) if write is not None else value
    return told


def _records(facts: Mapping[str, Fact[Any]], found: Any, places: Located, clock: Clock) -> object:
    if isinstance(found, dict):
        return {name: _records(facts, some, places, clock) for name, some in found.items()}
    return [written(facts, one, places, clock) for one in found]


def files_of(facts: Mapping[str, Fact[Record]]) -> list[str]:
    """Return the keys that are there only when several files were read."""
    return [_file(fact.key) for fact in facts.values() if fact.key and fact.kind in {FRAME, FRAMES}]


def _frame(told: dict[str, object], key: str, frame: int, places: Located) -> None:
    if not places.several:
        told[key] = frame or None
        return
    name, number = places.locate(frame) if frame else (None, None)
    told[key] = number
    told[_file(key)] = name


def _file(key: str) -> str:
    """Return the key of the file of a packet: ``first_file`` for ``first_frame``."""
    return key.replace(FRAME, FILE)
