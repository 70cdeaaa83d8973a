"""The enumerations of the schemas are the tables they come from, and docs/json.md has every word of them."""

from __future__ import annotations

from typing import Any, get_args

import pytest

from dissect.engine.findings.catalogue import KINDS as FINDINGS
from dissect.engine.findings.catalogue import SEVERITIES
from dissect.engine.transactions import ending, operation
from dissect.files.anonymize import account
from dissect.online.alerts import states
from dissect.online.alerts.rules import WHENS
from dissect.online.live import events
from dissect.output.baseline.watch import KINDS as NEW
from dissect.packets.source.live.opening import ENGINES
from dissect.scd.difference import Level
from dissect.scd.records import Role
from dissect.testing.golden.difference import KINDS as DIFFERENCES
from dissect.testing.oracle import facts, known
from tests.cases import each
from tests.meaning.report.schemas import ROOT, load

EVENTS = {events.OPENED, events.CLOSED, events.FINDING, events.DEVICE, events.PROBLEM}
ENDINGS = {
    ending.FIN,
    ending.RESET,
    ending.DISCONNECT,
    ending.ERROR_TPDU,
    ending.REUSED,
    ending.REPLACED,
    ending.EVICTED,
}
MEASURED = (
    states.TRANSACTIONS, states.MESSAGES, states.PACKETS, states.MEDIAN, states.MAX, states.ERRORS, states.NO_ANSWER,
    states.FAILED,
)  # fmt: skip
PLACES: list[tuple[str, str, set[str]]] = [
    ("analysis", "$defs/ending/properties/how/enum", {*ENDINGS, ending.OPEN}),
    ("analysis", "properties/connections/items/properties/ended/enum", {*ENDINGS, ending.OPEN}),
    ("analysis", "properties/finding_details/items/properties/severity/enum", set(SEVERITIES)),
    ("analysis", "properties/finding_details/items/properties/kind/enum", set(FINDINGS)),
    ("operation", "properties/kind/enum", set(operation.KINDS)),
    ("operation", "properties/result/enum", set(operation.RESULTS)),
    (
        "operation",
        "$defs/oddity/properties/name/enum",
        {operation.WRONG_ID, operation.BEYOND_END, operation.WRONG_SIZE, operation.CUT_SHORT},
    ),
    ("event", "properties/event/enum", {*EVENTS, "events_lost", "summary"}),
    ("event", "properties/counts/propertyNames/enum", {*EVENTS, events.TRANSACTION, events.OPERATION, events.SCD}),
    ("alert", "properties/when/enum", set(WHENS)),
    ("alert", "properties/severity/enum", set(SEVERITIES)),
    ("alert", "properties/new/properties/kind/enum", set(NEW)),
    (
        "alert",
        "properties/measured/properties/of/enum",
        set(MEASURED),
    ),
    ("diff", "$defs/difference/properties/kind/enum", set(DIFFERENCES)),
    ("anonymization", "properties/replaced/propertyNames/enum", set(account.KINDS)),
    ("anonymization", "properties/masked/propertyNames/enum", set(account.KINDS)),
    ("anonymization", "properties/kept/propertyNames/enum", set(account.KINDS)),
    ("anonymization", "properties/dropped/propertyNames/enum", set(account.REASONS)),
    ("anonymization", "properties/caveats/propertyNames/enum", set(account.CAVEATS)),
    ("verification", "properties/files/items/properties/differences/items/properties/kind/enum", {facts.TPDU, facts.PDU}),
    ("verification", "properties/known/additionalProperties/properties/right/enum", {known.OURS, known.SCOPE, known.FORM}),
    ("interfaces", "properties/interfaces/items/properties/engines/items/enum", set(ENGINES)),
    ("interfaces", "properties/engines/items/properties/name/enum", set(ENGINES)),
    ("scd-diff", "properties/level/enum", set(get_args(Level))),
    ("scd-decode", "properties/envelope/propertyNames/enum", set(get_args(Role))),
]  # fmt: skip


def found(name: str, path: str) -> list[str]:
    part: Any = load(name)
    for step in path.split("/"):
        part = part[step]
    assert len(part) == len(set(part))
    return [word for word in part if word is not None]


@each(("name", "path", "words"), PLACES)
def test_an_enumeration_is_its_table(name: str, path: str, words: set[str]) -> None:
    assert set(found(name, path)) == words


@pytest.mark.parametrize("name", ["anonymization", "scd-diff", "interfaces", "operation", "event"])
def test_every_word_is_in_the_documentation(name: str) -> None:
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    words = {word for each, path, _ in PLACES if each == name for word in found(each, path)}
    assert sorted(word for word in words if f"`{word}`" not in text) == []


def test_every_difference_is_in_the_documentation() -> None:
    text = (ROOT / "docs" / "golden.md").read_text(encoding="utf-8")
    assert [kind for kind in DIFFERENCES if f"| `{kind}` | {DIFFERENCES[kind]} |" not in text] == []


def test_every_kind_of_an_account_has_its_own_words() -> None:
    for names in (account.KINDS, account.REASONS, account.CAVEATS):
        assert len(set(names.values())) == len(names)
