"""Compares what all faces show for a capture, fact by fact."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Iterator
from typing import Any, Final, NamedTuple

from tests.faces.cells import Cell, Fact
from tests.faces.facts import FACTS
from tests.faces.kinds import TELLS, UNTOLD, read_as
from tests.faces.records import FACES, Face, Record, Records

#: By kind of record and name of face: its records.
Cut = dict[tuple[str, str], Records]


class Difference(NamedTuple):
    """A face whose value of a fact differs from that of the first face; ``fact`` is empty for a missing record."""

    record: str
    fact: str
    face: str
    key: Hashable
    first: Any
    told: Any


class Compared:
    """Counts for each cell (kind of record, fact, face): the comparisons, and the comparisons with a value."""

    def __init__(self) -> None:
        self.times: Counter[tuple[str, str, str]] = Counter()
        self.told: Counter[tuple[str, str, str]] = Counter()

    @property
    def facts(self) -> int:
        """How many facts were compared."""
        return len({(record, fact) for record, fact, _ in self.times})

    @property
    def faces(self) -> int:
        """How many faces were compared, each of one kind of record."""
        return len({(record, face) for record, _, face in self.times})

    def sentence(self) -> str:
        """Return a sentence about what was compared."""
        return (
            f"{self.facts} facts in {self.faces} faces of records: {len(self.times)} cells, "
            f"{sum(self.times.values())} values compared with the first that tells them"
        )


#: The result for a place that a record does not have.
_NOTHING: Final = None


def at(record: Record, path: str) -> Any:
    """Return the content of a place in a record; names may contain dots."""
    if path in record:
        return record[path]
    name, _, rest = path.partition(".")
    inner = record.get(name)
    if rest and isinstance(inner, dict):
        return at(inner, rest)
    return _NOTHING


def value(fact: Fact, face: Face, record: Record) -> Any:
    """Return the value of a fact as a face shows it."""
    cell = fact.cells[face.name]
    found = at(record, cell.path)
    if cell.read is not None:
        found = cell.read(found, record)
    if found is UNTOLD or (cell.read is not None and not isinstance(found, str)):
        return found
    return read_as(face.family, fact.kind, found)


def compare(cut: Cut, compared: Compared | None = None, facts: Iterable[Fact] = FACTS) -> Iterator[Difference]:
    """Yield every difference between the faces of a capture; ``compared`` counts the comparisons."""
    compared = compared if compared is not None else Compared()
    for kind, faces in FACES.items():
        yield from _missing(kind, faces, cut)
    for fact in facts:
        faces = tuple([face for face in FACES[fact.record] if face.name in fact.cells])
        first, *others = faces
        for key, record in cut[fact.record, first.name].items():
            wanted = value(fact, first, record)
            if wanted is UNTOLD:
                continue
            for face in others:
                theirs = cut[fact.record, face.name].get(key)
                if theirs is None:
                    continue
                told = value(fact, face, theirs)
                if told is UNTOLD:
                    continue
                compared.times[fact.record, fact.name, face.name] += 1
                compared.told[fact.record, fact.name, face.name] += wanted not in (None, 0, [], False)
                if not _agrees(fact.cells[face.name], face, fact.kind, wanted, told):
                    yield Difference(fact.record, fact.name, face.name, key, wanted, told)


def _agrees(cell: Cell, face: Face, kind: str, wanted: Any, told: Any) -> bool:
    tells = cell.tells or TELLS.get(face.family, {}).get(kind)
    return bool(tells(wanted, told)) if tells is not None else bool(wanted == told)


def _missing(kind: str, faces: tuple[Face, ...], cut: Cut) -> Iterator[Difference]:
    """Yield records that a face lacks, or that only it has."""
    whole = [face for face in faces if face.whole]
    keys = cut[kind, whole[0].name].keys()
    for face in faces:
        theirs = cut[kind, face.name].keys()
        for key in theirs - keys:
            yield Difference(kind, "", face.name, key, None, "a record that the first face lacks")
        if face.whole:
            for key in keys - theirs:
                yield Difference(kind, "", face.name, key, "a record", None)
