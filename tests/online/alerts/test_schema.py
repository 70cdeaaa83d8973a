"""Alerts of every kind are as the published schema says, and hold no other keys."""

from __future__ import annotations

import json
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from referencing import Registry, Resource

from dissect.online.alerts.rules import WHENS
from dissect.output.baseline import Baseline
from tests.meaning.report.schemas import load, strict
from tests.online.alerts.rules_of import Kept
from tests.output.baseline.wire import Client

RULES = {
    "finding": 'finding = "note"',
    "new": "",
    "rate": "above = 0",
    "latency": 'above = "1ms"\nper = "connection"',
    "silence": 'longer = "2s"\nper = "all"',
    "outcome": "above = 0",
    "problem": "",
}


def validator() -> Draft202012Validator:
    registry: Registry[Any] = Registry()
    for name in ("analysis", "transaction"):
        schema = strict(load(name))
        registry = registry.with_resource(schema["$id"], Resource.from_contents(schema))
    return Draft202012Validator(strict(load("alert")), registry=registry)


@pytest.mark.parametrize("when", WHENS)
def test_an_alert_is_as_the_schema_says(when: str) -> None:
    engine = Kept(f'when = "{when}"\n{RULES[when]}', Baseline())
    client = Client(engine.wire)
    client.write(1.0)
    client.read(2.0, content=0x0A, answer=0.1)
    client.read(3.0, content=0x0A, answer=0.1)
    engine.problem("evidence", "the ring of files cannot be written", False)
    engine.ticks(4, 10)
    client.close(11.0)
    engine.over()
    assert engine.alerts != []
    schema = validator()
    for alert in engine.alerts:
        assert [error.message for error in schema.iter_errors(json.loads(alert.as_json()))] == []


def test_the_schema_refuses_what_is_wrong() -> None:
    engine = Kept('when = "new"', Baseline())
    Client(engine.wire)
    values = engine.alerts[0].as_dict()
    assert list(validator().iter_errors(values)) == []
    bare = {key: value for key, value in values.items() if key != "new"}
    for wrong in (
        bare,
        {**values, "when": "ever"},
        {**values, "surplus": 1},
        {**values, "new": {"kind": "db", "what": ""}},
    ):
        assert list(validator().iter_errors(wrong)) != []
