"""`-Y` selects what `-T fields -e` shows: for each field of each kind of thing, the things that have a value, and no others."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.select import SelectError, Where
from dissect.meaning.select.fields import FIELDS, Field
from dissect.meaning.select.literals import AnyValue, Code, Duration, Host, Number, Octets, S7Address, Text, Time, Truth
from dissect.meaning.select.things import CONNECTION, FINDING, OPERATION, TRANSACTION, Context, Found
from tests.faces.reading import CAPTURES, names_of_fields, options_of

#: Captures that together have something in nearly every field.
NAMES: Final = (
    "item-errors.pcapng", "transfer.pcapng", "szl.pcapng", "crafted/causes.pcapng", "crafted/certainty.pcapng",
    "crafted/plus-plant.pcapng", "crafted/vlan.pcapng", "crafted/endings.pcapng", "scd/plant.pcapng",
)  # fmt: skip
KINDS: Final = (TRANSACTION, OPERATION, FINDING, CONNECTION)
#: So many values of a field of a capture are asked for.
_MOST: Final = 40


class _Things(Observer):
    """Keeps what can be selected."""

    def __init__(self) -> None:
        super().__init__()
        self.context = Context()
        self.found: dict[str, list[Any]] = {kind: [] for kind in KINDS}

    def connection_opened(self, connection: Connection) -> None:
        self.context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        self.context.closed(connection)
        self.found[CONNECTION].append(connection)

    def transaction(self, transaction: Transaction) -> None:
        self.found[TRANSACTION].append(transaction)

    def operation(self, operation: Operation) -> None:
        self.found[OPERATION].append(operation)

    def finding(self, finding: Finding) -> None:
        self.found[FINDING].append(finding)


@cache
def things(name: str) -> _Things:
    kept = _Things()
    Run([Path(CAPTURES / name)], kept, options_of(CAPTURES / name)).read()
    return kept


def values(field: Field, kind: str, thing: Any, context: Context) -> list[Any]:
    """Return the values of a field of a thing."""
    if kind == FINDING:
        thing = Found(thing, context.connection(int(thing.connection)))
    found: Any = field.getters[kind](thing, context)
    return list(found) if type(found) in {list, tuple} else [] if found is None else [found]


def literal(field: Field, value: Any) -> str | None:
    """Return a value as it is typed behind ``==``; None for one that cannot be, or that other values fit by design.

    A 0 or 1 fits bits as well, and an address without a count any count.
    """
    shown = field.kind.shown(value)
    kind = field.kind
    if (isinstance(kind, AnyValue) and value in {0, 1}) or (isinstance(kind, S7Address) and value.text == shown):
        return None
    if isinstance(kind, Duration):
        return shown if field.name.endswith("_ns") else f"{shown}ns"
    if isinstance(kind, Truth | Number | Time | Host | Octets):
        return shown or None
    if isinstance(kind, AnyValue) and not isinstance(value, str):
        return shown
    assert isinstance(kind, Text | Code | S7Address | AnyValue), kind
    quoted = shown.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{quoted}"' if shown.isprintable() else None


def asked(kind: str, field: Field) -> Iterator[tuple[_Things, str, set[int]]]:
    """Yield expressions, and the places of the things that have the value they ask for."""
    for name in NAMES:
        kept = things(name)
        having: dict[str, set[int]] = defaultdict(set)
        for place, thing in enumerate(kept.found[kind]):
            for value in values(field, kind, thing, kept.context):
                typed = literal(field, value)
                if typed is not None:
                    having[typed].add(place)
        for typed in [*having][:_MOST]:
            yield kept, typed, having[typed]


def selects(where: Where, kind: str, thing: Any) -> bool:
    return bool(getattr(where, kind)(thing))


@pytest.mark.parametrize("kind", KINDS)
def test_a_value_that_a_field_shows_selects_the_things_that_have_it(kind: str) -> None:
    compared = 0
    wrong: list[tuple[str, list[int]]] = []
    for name in names_of_fields(kind):
        for kept, typed, having in asked(kind, FIELDS[name]):
            try:
                where = Where(f"{name} == {typed}", kinds=(kind,), context=kept.context)
            except SelectError as error:
                wrong.append((str(error), []))
                continue
            selected = {place for place, thing in enumerate(kept.found[kind]) if selects(where, kind, thing)}
            compared += len(kept.found[kind])
            if selected != having:
                wrong.append((where.text, sorted(having ^ selected)[:5]))
    assert wrong == []
    assert compared > 300


@pytest.mark.parametrize("kind", KINDS)
def test_a_field_alone_selects_the_things_that_have_it(kind: str) -> None:
    wrong = []
    for name in names_of_fields(kind):
        field = FIELDS[name]
        for kept in map(things, NAMES):
            where = Where(name, kinds=(kind,), context=kept.context)
            for thing in kept.found[kind]:
                found = values(field, kind, thing, kept.context)
                has = found == [True] if isinstance(field.kind, Truth) else bool(found)
                if selects(where, kind, thing) != has:
                    wrong.append((name, thing))
    assert wrong == []
