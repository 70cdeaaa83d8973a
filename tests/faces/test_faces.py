"""Every fact that two faces share is told alike, in all captures.

A face is an output: lines for a person, JSON, JSON lines, CSV, `-T fields` and `-Y`, tables, logs of Zeek, documents of ECS, a
STIX bundle. `tests.faces.facts` says how each tells each fact, `tests.faces.known` what is known to differ, and why.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from tests.faces.facts import FACTS
from tests.faces.gathering import Gathered, Shown, captures_in, gather
from tests.faces.known import KNOWN, is_known
from tests.faces.records import FACES


def said(shown: Iterable[Shown]) -> str:
    """Return differences for a person: a line for each kind, with the first of them."""
    kinds: dict[tuple[str, str, str], list[Shown]] = defaultdict(list)
    for name, one in shown:
        kinds[one.record, one.fact, one.face].append((name, one))
    lines = []
    for (record, fact, face), some in kinds.items():
        name, one = some[0]
        first = next(of.name for of in FACES[record] if not fact or of.name in _cells(record, fact))
        lines.append(
            f"{record} {fact or 'missing'}: {face} says {one.told!r}, {first} says {one.first!r}; "
            f"{len(some)} times, first in {name}, {one.key}"
        )
    return "\n".join(lines)


def _cells(record: str, fact: str) -> set[str]:
    return {face for one in FACTS if (one.record, one.name) == (record, fact) for face in one.cells}


def mended(found: Gathered, shared: bool) -> list[tuple[str, str, str]]:
    """Return the known differences that no capture shows; ``shared``: also those that only the shared captures can show."""
    there = {(one.record, one.fact, one.face) for _, one in found.differences}
    return [key for key, known in KNOWN.items() if key not in there and known.shared == shared]


def test_every_fact_is_told_alike_by_all_faces(project: Gathered) -> None:
    unknown = [(name, one) for name, one in project.differences if not is_known(one)]
    assert not unknown, f"faces tell different things:\n{said(unknown)}"
    assert mended(project, shared=False) == [], "these differences are mended: take their rows out of KNOWN"


def test_how_much_was_compared(project: Gathered, record_property: Callable[[str, object], None]) -> None:
    compared = project.compared
    print(compared.sentence())
    record_property("compared", compared.sentence())
    assert compared.facts >= 370
    assert compared.faces >= 45
    assert len(compared.times) >= 700
    assert sum(compared.times.values()) >= 800_000


def test_no_cell_is_without_anything_to_compare(project: Gathered) -> None:
    """A cell that no capture fills, or that only ever has nothing, would hide a difference."""
    cells = {(fact.record, fact.name, face) for fact in FACTS for face in fact.cells}
    first = {
        (fact.record, fact.name, next(face.name for face in FACES[fact.record] if face.name in fact.cells))
        for fact in FACTS
    }
    assert {cell for cell in cells - first if not project.compared.told[cell]} == UNSEEN


#: Cells that no capture fills: nobody names hosts here, and values of pairs that are only likely are left out.
UNSEEN: Final = frozenset(
    (
        ("device", "host_name", "tables"),
        ("operation", "likely", "tables"),
        ("value", "doubt", "csv"),
        ("value", "doubt", "text"),
    )
)


def test_every_place_of_a_record_is_a_fact_or_known_to_be_alone(project: Gathered) -> None:
    """Something new in an output is either told by others too, and needs a row, or by none, and is listed with the others."""
    assert project.unread == []


def test_every_cell_is_of_a_face_that_there_is() -> None:
    for fact in FACTS:
        assert set(fact.cells) <= {face.name for face in FACES[fact.record]}, fact
        assert len(fact.cells) > 1, fact
    names = [(fact.record, fact.name) for fact in FACTS]
    assert sorted({name for name in names if names.count(name) > 1}) == []
    assert [key for key in KNOWN if key[2] not in _cells(key[0], key[1])] == []


def test_every_fact_is_told_alike_in_the_shared_captures(corpus: Path, project: Gathered) -> None:
    found = gather(captures_in(corpus), before=project)
    print(found.compared.sentence())
    unknown = [(name, one) for name, one in found.differences if not is_known(one)]
    assert not unknown, f"faces tell different things:\n{said(unknown)}"
    assert mended(found, shared=True) == [], "these differences are mended: take their rows out of KNOWN"
    assert found.unread == []
    assert sum(found.compared.times.values()) > 1_000_000
