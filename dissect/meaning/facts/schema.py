"""JSON Schemas of records, from the tables of their facts.

A published schema (`dissect/meaning/schema`) has ``"$made": "connection"`` in an object that is such a record; `filled` inserts
the contents of the table after the keys that are there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from dissect.meaning.facts.connection import CONNECTION
from dissect.meaning.facts.counted import OCCURRENCES
from dissect.meaning.facts.device import DEVICE, STRETCH, TALK
from dissect.meaning.facts.fact import (
    BYTES,
    CODE,
    COUNT,
    COUNTS,
    DURATION,
    END,
    FLAG,
    FRAME,
    FRAMES,
    REAL,
    SERIAL,
    TEXT,
    TIME,
    TSAP,
    WORD,
    WORDS,
    Fact,
)
from dissect.meaning.facts.finding import FINDING
from dissect.meaning.facts.operation import OPERATION
from dissect.meaning.facts.pdu import PDU
from dissect.meaning.facts.transaction import TRANSACTION
from dissect.meaning.facts.value import VALUE, VARIABLE
from dissect.meaning.facts.written import files_of

MADE: Final = "$made"
#: The tables by the names of records.
TABLES: Final[Mapping[str, Mapping[str, Fact[Any]]]] = {
    "connection": CONNECTION,
    "finding": FINDING,
    "occurrences": OCCURRENCES,
    "operation": OPERATION,
    "device": DEVICE,
    "stretch": STRETCH,
    "talk": TALK,
    "transaction": TRANSACTION,
    "value": VALUE,
    "variable": VARIABLE,
    "pdu": PDU,
}

_TIME: Final = {"$ref": "urn:s7dissect:schema:transaction:1#/$defs/time"}
_END: Final = {"$ref": "urn:s7dissect:schema:transaction:1#/$defs/endpoint"}
_FRAME: Final = {"type": "integer", "minimum": 1}
_SHAPES: Final[Mapping[str, Mapping[str, Any]]] = {
    FLAG: {"type": "boolean"},
    TEXT: {"type": "string"},
    WORD: {"type": "string"},
    END: _END,
    TSAP: {"$ref": "#/$defs/tsap"},
    FRAME: _FRAME,
    FRAMES: {"type": "array", "items": _FRAME},
    TIME: _TIME,
    SERIAL: {"type": "integer", "minimum": 1},
    DURATION: {"type": "integer"},
    WORDS: {"type": "array", "items": {"type": "string"}},
    REAL: {"type": "number"},
    BYTES: {"type": "string", "pattern": "^([0-9a-f]{2})*$"},
}


def filled(part: Any) -> Any:
    """Return a schema, or a part of one, with the objects of records inserted."""
    if isinstance(part, dict):
        given = {key: filled(value) for key, value in part.items() if key != MADE}
        return {**given, **_joined(given, object_of(TABLES[part[MADE]]))} if MADE in part else given
    return [filled(one) for one in part] if isinstance(part, list) else part


def object_of(facts: Mapping[str, Fact[Any]]) -> dict[str, Any]:
    """Return the schema of an object of a record."""
    told = [fact for fact in facts.values() if fact.key]
    files = files_of(facts)
    properties: dict[str, Any] = {}
    for fact in told:
        properties[fact.key] = {**_shape(fact), "description": fact.about}
        if fact.kind in {FRAME, FRAMES}:
            properties[files.pop(0)] = _file(fact)
    made: dict[str, Any] = {
        "type": "object",
        "additionalProperties": True,
        "required": [fact.key for fact in told if not fact.rare],
        "properties": properties,
    }
    files = files_of(facts)
    if len(files) > 1:
        made["dependentRequired"] = {file: [other for other in files if other != file] for file in files}
    return made


def _joined(given: dict[str, Any], made: dict[str, Any]) -> dict[str, Any]:
    return {
        **made,
        "required": [*given.get("required", []), *made["required"]],
        "properties": {**given.get("properties", {}), **made["properties"]},
    }


def _file(fact: Fact[Any]) -> dict[str, Any]:
    several = fact.kind == FRAMES
    of = f"the file of each of `{fact.key}`" if several else f"the file of `{fact.key}`"
    shape = {"type": "array", "items": {"type": "string"}} if several else _or_null({"type": "string"}, fact.null)
    return {**shape, "description": f"Only with several files: {of}."}


def _shape(fact: Fact[Any]) -> dict[str, Any]:
    if fact.shape is not None:
        return dict(filled(fact.shape))
    if fact.records is not None:
        return {"type": "array", "items": object_of(fact.records)}
    if fact.kind == CODE:
        return {"enum": [*fact.codes, None] if fact.null else list(fact.codes)}
    number: dict[str, Any] = {"type": "integer", "minimum": fact.least}
    if fact.most is not None:
        number["maximum"] = fact.most
    numbers: dict[str, dict[str, Any]] = {COUNT: number, COUNTS: {"type": "array", "items": number}}
    shape = numbers.get(fact.kind) or dict(_SHAPES[fact.kind])
    return _or_null(shape, fact.null)


def _or_null(shape: dict[str, Any], null: bool) -> dict[str, Any]:
    if not null:
        return shape
    if "$ref" in shape:
        return {"oneOf": [shape, {"type": "null"}]}
    return {**shape, "type": [shape["type"], "null"]}
