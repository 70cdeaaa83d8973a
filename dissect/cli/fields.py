"""`s7dissect fields`: the fields that expressions of ``-Y`` and columns of ``-T fields`` name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import click

from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_OK
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import Outcome
from dissect.meaning.report.styled import DIM, PLAIN, Line
from dissect.meaning.select.fields import FIELDS, NAMES, Field
from dissect.meaning.select.literals import Code
from dissect.wire.config.hints import close_names
from dissect.wire.text import some

FIELDS_SCHEMA: Final = "s7dissect.fields/1"
#: Maximum number of value names listed for a field.
_MOST_NAMES: Final = 24


@click.command("fields", epilog="Exit code: 0 success, 2 wrong use, 5 the output could not be written.")
@click.argument("names", nargs=-1, metavar="[FIELD]...")
@format_option(OUTCOME)
def command(names: tuple[str, ...], format_: Format) -> int:
    """List the fields of -Y expressions and of -T fields: name, type, meaning, an example.

    With FIELD, only these, with the names their values can have; part of a name lists all fields that contain it.
    """
    write_outcome(format_, OUTCOME, FieldListing(_matching(names), bool(names)))
    return EXIT_OK


def _matching(names: Iterable[str]) -> list[Field]:
    matching: dict[str, Field] = {}
    for name in names:
        exact = NAMES.get(name.lower())
        some = [exact] if exact is not None else [field for field in FIELDS.values() if name.lower() in field.name]
        if not some:
            near = close_names(name, NAMES)
            hint = f" Did you mean {' or '.join(near)}?" if near else ""
            raise click.UsageError(f"no field {name!r}.{hint}")
        matching.update({field.name: field for field in some})
    return list(matching.values()) if matching else list(FIELDS.values())


class FieldListing(Outcome):
    """The fields; ``whole``: with the names of their values."""

    def __init__(self, fields: list[Field], whole: bool) -> None:
        self.fields = fields
        self.whole = whole

    def text(self) -> Iterable[Line]:
        """Return a line for each field."""
        names = max([len(field.name) for field in self.fields])
        kinds = max([len(field.kind.name) for field in self.fields])
        hang = names + kinds + 4
        for field in self.fields:
            yield Line(f"{field.name.ljust(names)}  {field.kind.name.ljust(kinds)}  {field.about}", PLAIN, hang)
            if not self.whole:
                continue
            for title, texts in (
                ("example", field.example),
                ("of", ", ".join([f"{thing}s" for thing in field.things])),
                ("also", ", ".join(field.also)),
                ("names", _names(field)),
            ):
                if texts:
                    yield Line(f"    {title + ':':9}{texts}", DIM, 13)

    def as_dict(self) -> Mapping[str, object]:
        """Return the object of the JSON contract."""
        return {"schema": FIELDS_SCHEMA, "fields": [_as_dict(field) for field in self.fields]}


def _choices(field: Field) -> list[str]:
    return field.kind.choices if isinstance(field.kind, Code) else []


def _names(field: Field) -> str:
    choices = _choices(field)
    return some(choices, _MOST_NAMES)


def _as_dict(field: Field) -> dict[str, Any]:
    return {
        "name": field.name,
        "also": list(field.also),
        "type": field.kind.name,
        "operators": list(field.kind.operators),
        "of": list(field.things),
        "item": field.of_item is not None,
        "about": field.about,
        "example": field.example,
        "names": _choices(field),
    }
