"""`s7dissect schema`: the JSON Schemas of the machine-readable outputs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import click

from dissect.cli.main import EXIT_OK
from dissect.cli.options.completing import from_table
from dissect.cli.run import write
from dissect.wire.config.hints import close_names

#: The folder of the schemas in the package: `NAME.schema.json`.
FOLDER: Final = Path(__file__).resolve().parent.parent / "meaning" / "schema"
_SUFFIX: Final = ".schema.json"
_URN: Final = "urn:s7dissect:schema:"

_Schema = dict[str, Any]


def _names() -> list[str]:
    return sorted([path.name.removesuffix(_SUFFIX) for path in FOLDER.glob(f"*{_SUFFIX}")])


def _titles() -> dict[str, str]:
    return {name: _load(name)["title"] for name in _names()}


@click.command("schema", epilog="Exit code: 0 success, 2 wrong use, 5 the output could not be written.")
@click.argument("name", required=False, metavar="[NAME]", shell_complete=from_table(_titles))
def command(name: str | None) -> int:
    """List the JSON Schemas of the machine-readable outputs, or write the one called NAME.

    NAME is a name from the list, or the value of "schema" in an output (s7dissect.analysis/1). The schema is self-contained.
    """
    names = _names()
    if name is None:
        width = max(map(len, names))
        write([f"{each.ljust(width)}  {title}" for each, title in _titles().items()])
        return EXIT_OK
    matching = [each for each in names if name in {each, _id(each)}]
    if not matching:
        near = close_names(name, names)
        hint = f" Did you mean {' or '.join(near)}?" if near else ""
        raise click.UsageError(f"no schema {name!r}; available: {', '.join(names)}.{hint}")
    write([json.dumps(bundled(matching[0]), indent=1)])
    return EXIT_OK


def bundled(name: str) -> _Schema:
    """Return a schema with the schemas that it refers to in ``$defs``, where a validator finds them by their ``$id``."""
    schema = _load(name)
    wanted = _referred(schema)
    schemas: dict[str, _Schema] = {}
    while wanted:
        other = wanted.pop()
        if other not in schemas and other != name:
            schemas[other] = _load(other)
            wanted |= _referred(schemas[other])
    if schemas:
        schema["$defs"] = {
            **schema.get("$defs", {}),
            **{f"schema-{other}": schemas[other] for other in sorted(schemas)},
        }
    return schema


def _load(name: str) -> _Schema:
    from dissect.meaning.facts.schema import filled

    schema: _Schema = filled(json.loads((FOLDER / f"{name}{_SUFFIX}").read_text(encoding="utf-8")))
    return schema


def _id(name: str) -> str:
    return f"s7dissect.{name}/{_load(name)['$id'].rpartition(':')[2]}"


def _referred(value: object) -> set[str]:
    """Return the names of the other schemas that a part of one refers to."""
    if isinstance(value, list):
        return set().union(*[_referred(inner) for inner in value])
    if not isinstance(value, dict):
        return set()
    referred = set().union(*[_referred(inner) for inner in value.values()])
    reference = value.get("$ref")
    if isinstance(reference, str) and reference.startswith(_URN):
        referred.add(reference.removeprefix(_URN).partition(":")[0])
    return referred
