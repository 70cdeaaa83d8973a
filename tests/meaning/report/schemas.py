"""The published schemas: loaded, made strict, and as the rows of docs/json.md."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import jsonschema_rs
from jsonschema import Draft202012Validator
from referencing import Registry, Resource

from dissect.files.anonymize import account
from dissect.meaning.facts.schema import filled

ROOT: Final = Path(__file__).resolve().parents[3]
SCHEMAS: Final = ROOT / "dissect" / "meaning" / "schema"
NAMES: Final = (
    "analysis",
    "blocks",
    "block-changes",
    "blocks-code",
    "blocks-references",
    "transaction",
    "operation",
    "devices",
    "pdu",
    "event",
    "alert",
    "interfaces",
    "fields",
    "diff",
    "replay",
    "anonymization",
    "verification",
    "scd-check",
    "scd-diff",
    "scd-decode",
    "tags-check",
    "tags-list",
    "index",
    "cluster-check",
    "value",
    "variable",
)

Schema = dict[str, Any]


@cache
def load(name: str) -> Schema:
    """Return the published schema ``name``."""
    loaded: Schema = filled(json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8")))
    return loaded


def strict(schema: Schema) -> Schema:
    """Return the schema without its tolerance for keys that it does not name."""
    made = copy.deepcopy(schema)
    for part in _parts(made):
        if "properties" in part:
            # `additionalProperties` does not see properties behind a `$ref`.
            part.pop("additionalProperties", None)
            part["unevaluatedProperties"] = False
    # Its uses add properties; otherwise the reference itself is made strict.
    for name in ("latency", "facts"):
        made.get("$defs", {}).get(name, {}).pop("unevaluatedProperties", None)
        for part in _parts(made):
            if part.get("$ref") == f"#/$defs/{name}":
                part["unevaluatedProperties"] = False
    return made


def _parts(value: object) -> Iterator[Schema]:
    if isinstance(value, dict):
        yield value
        for key, inner in value.items():
            if key != "if":  # a condition only names the keys that it tests
                yield from _parts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _parts(inner)


@cache
def _schemas(*, exact: bool) -> dict[str, Schema]:
    return {each: strict(load(each)) if exact else load(each) for each in NAMES}


@cache
def validator(name: str, *, exact: bool) -> Draft202012Validator:
    """Return a validator of output against a schema; an ``exact`` one accepts no keys that are not named."""
    schemas = _schemas(exact=exact)
    registry: Registry[Any] = Registry()
    for schema in schemas.values():
        registry = registry.with_resource(schema["$id"], Resource.from_contents(schema))
    return Draft202012Validator(schemas[name], registry=registry)


@cache
def quick_validator(name: str, *, exact: bool) -> jsonschema_rs.Draft202012Validator:
    """Return a validator of another library, a hundred times faster: tests validate whole captures."""
    schemas = _schemas(exact=exact)
    registry = jsonschema_rs.Registry([(schema["$id"], schema) for schema in schemas.values()])
    return jsonschema_rs.Draft202012Validator(schemas[name], registry=registry)


def complaints(name: str, told: Any, *, exact: bool) -> list[str]:
    """Return the faults of an output, by the schema."""
    quick = quick_validator(name, exact=exact)
    if quick.is_valid(told):
        return []
    said = [f"{error.json_path}: {error.message}" for error in validator(name, exact=exact).iter_errors(told)]
    return said or [f"only jsonschema-rs objects: {error.message}" for error in quick.iter_errors(told)]


# ---- the schema as a table ------------------------------------------------------------------------------------------


def table(name: str) -> list[str]:
    """Return the table of docs/json.md for a schema: a row for each key."""
    schema = load(name)
    lines = ["| key | type | meaning |", "|---|---|---|"]
    for path, part, base, required in _keys(schema, schema, ""):
        kind = _type(part, base) + ("" if required else ", not always there")
        lines.append(f"| `{path}` | {kind} | {part.get('description', '')} |")
    return lines


def _keys(part: Schema, home: Schema, prefix: str) -> Iterator[tuple[str, Schema, Schema, bool]]:
    required = part.get("required", [])
    for key, told in part.get("properties", {}).items():
        here, base = _resolved(told, home)
        yield f"{prefix}{key}", here, base, key in required
        inner, base, suffix = _object(here, base)
        if inner is not None:
            yield from _keys(inner, base, f"{prefix}{key}{suffix}.")


def _resolved(part: Schema, home: Schema) -> tuple[Schema, Schema]:
    """Return a part with its references resolved, and the schema that contains it."""
    reference = part.get("$ref")
    if reference is None:
        return part, home
    identity, _, pointer = reference.partition("#")
    base = home if not identity else next(load(name) for name in NAMES if load(name)["$id"] == identity)
    target: Schema = base
    for step in pointer.strip("/").split("/") if pointer else []:
        target = target[step]
    merged = {**target, **{key: value for key, value in part.items() if key != "$ref"}}
    for key in ("properties", "required"):
        if key in target and key in part:
            both = {**target[key], **part[key]} if key == "properties" else [*target[key], *part[key]]
            merged[key] = both
    merged["$name"] = pointer.rpartition("/")[2] or "whole"
    return merged, base


def _object(part: Schema, home: Schema) -> tuple[Schema | None, Schema, str]:
    """Return the object whose keys are below a part, and the continuation of its path; None if there is none."""
    if part.get("type") == "array":
        inner, base = _resolved(part["items"], home)
        if inner.get("$name") == "whole":
            return None, base, ""  # documented in a separate table
        return (inner, base, "[]") if "properties" in inner else (None, base, "")
    for choice in part.get("oneOf", []):
        inner, base = _resolved(choice, home)
        if "properties" in inner:
            return inner, base, ""
    if isinstance(part.get("additionalProperties"), dict):
        inner, base = _resolved(part["additionalProperties"], home)
        if "properties" in inner:
            return inner, base, ".*"
    return (part, home, "") if "properties" in part else (None, home, "")


def _type(part: Schema, home: Schema) -> str:
    named = {"time": "time", "endpoint": "endpoint", "value": "value", "counts": "object of counts"}
    name = part.get("$name", "")
    if name in named:
        return named[name]
    if "oneOf" in part:
        return _type_of_choices(part, home)
    if "const" in part:
        return "text"
    if "enum" in part:
        kinds = ["integer" if isinstance(value, int) else "text" for value in part["enum"] if value is not None]
        return kinds[0] + (" or null" if None in part["enum"] else "")
    told = part.get("type", "object")
    if isinstance(part.get("additionalProperties"), dict) and part["additionalProperties"].get("type") == "integer":
        return "object of counts" + (" or null" if "null" in told else "")
    if told == "array":
        inner, base = _resolved(part["items"], home)
        return f"array of {_plural(inner, base)}"
    kinds = [told] if isinstance(told, str) else told
    return " or ".join(["text" if kind == "string" else kind for kind in kinds])


def _type_of_choices(part: Schema, home: Schema) -> str:
    resolved = [_resolved(choice, home) for choice in part["oneOf"]]
    told = sorted((_type(choice, base) for choice, base in resolved), key=lambda kind: kind == "null")
    return " or ".join(told)


def _plural(part: Schema, home: Schema) -> str:
    if part.get("$name") == "whole":
        return "transactions"
    kind = _type(part, home)
    return kind.replace("array of", "arrays of", 1) if kind.startswith("array of") else f"{kind}s"


def names_of_anonymization() -> list[str]:
    """Return the table of the names in the counts of an anonymization."""
    lines = ["| in | name | is |", "|---|---|---|"]
    for keys, names in (
        ("`replaced`, `masked`, `kept`", account.KINDS),
        ("`dropped`", account.REASONS),
        ("`caveats`", account.CAVEATS),
    ):
        lines += [f"| {keys} | `{name}` | {text} |" for name, text in names.items()]
    return lines


def parts() -> Iterator[tuple[str, str, list[str]]]:
    """Yield the generated parts of docs/json.md: the text before, the text after, the lines."""
    for name in NAMES:
        yield f"<!-- keys of {name} -->\n", "<!-- end -->", table(name)
    yield "<!-- names of anonymization -->\n", "<!-- end of names -->", names_of_anonymization()


def rewrite() -> None:
    """Put the tables of the schemas into docs/json.md (``python -m tests.meaning.report.schemas``)."""
    page = ROOT / "docs" / "json.md"
    text = page.read_text(encoding="utf-8")
    for before, behind, lines in parts():
        begin = text.index(before) + len(before)
        end = text.index(behind, begin)
        text = text[:begin] + "\n".join(lines) + "\n" + text[end:]
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    rewrite()
