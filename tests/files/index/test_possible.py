"""What rules a file out, and that nothing that could be selected is ever ruled out."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.files.index.facts import FileFacts, filled, watched
from dissect.files.index.possible import Possible
from dissect.files.session import Run
from dissect.meaning.select import SelectError, Where
from tests.cases import each

CAPTURES: Final = Path(__file__).resolve().parents[3] / "captures"
FILES: Final = (
    "item-errors",
    "answer-lost",
    "crafted/refusals",
    "crafted/link-types",
    "two-clients",
    "crafted/timing",
)


@cache
def facts_of(path: str) -> FileFacts:
    """Return the facts of a capture."""
    run, seen = watched(path)
    while run.step():
        pass
    return filled(FileFacts(Path(path).name, 1, 1), run, seen)


def kept(first_ns: int = 0, last_ns: int = 0, **values: object) -> FileFacts:
    """Return facts of a file from 1 to 2 minutes after midnight, 2 January 1970, with one connection."""
    day = 86_400 * 10**9
    facts = FileFacts("x.pcap", 1, 1, 10, first_ns or day + 60 * 10**9, last_ns or day + 120 * 10**9)
    facts.pairs = frozenset({(bytes((10, 0, 0, 1)), 49152, bytes((10, 0, 0, 2)), 102)})
    facts.findings = {"security.plc_stop": 1, "transaction.slow": 3}
    for name, value in values.items():
        setattr(facts, name, value)
    return facts


@each(
    ("expression", "wanted"),
    [
        ("host == 10.0.0.1", True),
        ("host == 10.0.0.3", False),
        ("host == 10.0.0.0/24", True),
        ("host == 10.0.1.0/24", False),
        ("not host == 10.0.0.3", True),
        ("port == 102", True),
        ("port in {103, 104}", False),
        ("port == 102 and host == 10.0.0.9", False),
        ("port == 9 or host == 10.0.0.2", True),
        ("host == 10.0.0.2:49152", False),
        ("client == 10.0.0.3", False),
        ("client == 10.0.0.2", True),  # which end is the client is not known here
        ("asked_by in {10.0.0.8, 10.0.0.9}", False),
        ("client != 10.0.0.1", True),
        ("slug == security.plc_stop", True),
        ("slug == security.force", False),
        ('slug matches "^security"', True),
        ("severity >= error", True),
        ("slug == security.force or failed", True),
        ("not slug == security.force", True),
        ("function == read_var and slug == security.force", False),
        ("time > 1970-01-02T00:01:30", True),
        ("time > 1970-01-02T00:02:01", False),
        ("time < 1970-01-02T00:00:59", False),
        ("time >= 30s", True),
        ("time > 61s", False),
        ("time == 1970-01-02T00:01:30", True),
        ("time == 1970-01-02T00:00:30", False),
        ("time in {1970-01-02T00:00:00..1970-01-02T00:01:00}", True),
        ("time in {1970-01-02T00:02:01..1970-01-03T00:00:00}", False),
        ("time in {1970-01-02T00:01:10..1970-01-02T00:01:20}", True),
        ("not time in {1970-01-02T00:00:00..1970-01-02T23:00:00}", True),
        ("latency > 1s", True),
        ("connection == 7", True),
        ("tag", True),
    ],
)
def test_what_rules_a_file_out(expression: str, wanted: bool) -> None:
    assert Possible(expression)(kept()) is wanted


def test_what_is_not_known_rules_nothing_out() -> None:
    assert Possible("host == 10.0.0.3")(kept(all_pairs=False))
    backwards = kept(findings={"capture.time_backwards": 1})
    assert Possible("time > 1970-01-02T00:02:01")(backwards)
    assert not Possible("time > 1970-01-02T00:02:01")(kept(findings={}))
    assert not Possible("slug == security.force")(kept(findings={"a.slug_of_a_later_version": 1}))


def test_an_expression_that_cannot_be_is_refused() -> None:
    with pytest.raises(SelectError, match="no field 'hots'; did you mean host"):
        Possible("hots == 10.0.0.1")


class _Any(Observer):
    """Tells whether anything was selected."""

    def __init__(self, where: Where) -> None:
        super().__init__()
        self.where = where
        self.found = False

    def connection_opened(self, connection: Connection) -> None:
        self.where.context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        self.where.context.closed(connection)
        self.found |= self.where.connection(connection)

    def transaction(self, transaction: Transaction) -> None:
        self.found |= self.where.transaction(transaction)

    def operation(self, operation: Operation) -> None:
        self.found |= self.where.operation(operation)

    def finding(self, finding: Finding) -> None:
        self.found |= self.where.finding(finding)


CONDITIONS: Final = st.sampled_from(
    (
        "host == 127.0.0.1", "host == 192.0.2.0/25", "host != 192.0.2.10", "port == 102", "port > 49200",
        "server == 127.0.0.1", "asked_by == 192.0.2.20", "slug == transaction.slow", 'slug contains "security"',
        "severity >= warning", "severity == error", "time > 0.5s", "time < 20ms", "time in {1s..2s}",
        "failed", "latency > 1ms", "function == read_var", "connection == 2",
        "client == 192.0.2.10", "time > 2024-01-01T00:00:00",
    )
)  # fmt: skip
EXPRESSIONS: Final = st.recursive(
    CONDITIONS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(("and", "or")), inner).map(lambda parts: f"({' '.join(parts)})"),
        inner.map(lambda part: f"not ({part})"),
    ),
    max_leaves=5,
)


@settings(max_examples=60, deadline=None)
@given(expression=EXPRESSIONS, name=st.sampled_from(FILES))
def test_a_file_that_is_ruled_out_has_nothing_that_is_selected(expression: str, name: str) -> None:
    path = str(CAPTURES / f"{name}.pcapng")
    where = Where(expression)
    seen = _Any(where)
    run = Run([path], seen)
    where.context.start = lambda: int(run.pipeline.first_ns)
    while run.step():
        pass
    if seen.found:
        assert Possible(expression)(facts_of(path))
