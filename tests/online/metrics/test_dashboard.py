"""The dashboard in docs/grafana: everything it asks for is exported, and everything exported is looked at."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, Final

import pytest

from dissect.online.live.problems import WriterState
from dissect.online.metrics.counters import Metrics
from dissect.online.metrics.exposition import PREFIX, Exposition
from dissect.packets.source.live.reader import Drops
from tests.cases import each
from tests.conftest import ROOT
from tests.online.metrics.test_counters import counted

DASHBOARD: Final[dict[str, Any]] = json.loads(
    (ROOT / "docs" / "grafana" / "s7dissect.json").read_text(encoding="utf-8")
)

#: What PromQL itself has, as far as the dashboard uses it.
FUNCTIONS: Final = frozenset(
    ("sum", "topk", "rate", "increase", "changes", "histogram_quantile", "time", "label_values", "by")
)
#: What Prometheus adds to every series it fetches.
TARGET_LABELS: Final = frozenset(("instance", "job"))
#: Exported, and on purpose not on the dashboard.
UNUSED: Final = frozenset(
    (
        "process_virtual_memory_bytes",  # says nothing about the memory that is used
        "process_open_fds",  # a probe holds a handful
        "process_max_fds",
        "s7dissect_evidence_head",  # a hash is compared, not drawn
    )
)

NAME: Final = re.compile(r"[a-zA-Z_][a-zA-Z0-9_]*")


def exported() -> dict[str, set[str]]:
    """Return every sample name that a run exports, with its labels."""
    with pytest.MonkeyPatch.context() as patched:  # this machine's clock may be without a time service
        patched.setattr("dissect.online.metrics.exposition.clock_offset", lambda: 0.001)
        return sampled()


def sampled() -> dict[str, set[str]]:
    metrics, _ = counted(ROOT / "captures" / "item-errors.pcapng")
    metrics.tick(0, Drops(1, 1))
    metrics.watch_queue(lambda: (0, 0))
    metrics.problems.writers.append(lambda: WriterState("ring", True, 1, 2, 3, 4, 5.0, 6))
    metrics.problems.heads["s7dissect"] = "9f2c"
    return {sample.name: set(sample.labels) for family in Exposition(metrics).collect() for sample in family.samples}


EXPORTED: Final = exported()


def panels() -> Iterator[dict[str, Any]]:
    for panel in DASHBOARD["panels"]:
        yield panel
        yield from panel.get("panels", [])


def queries() -> Iterator[tuple[str, str, str]]:
    """Give (where, expression, legend) for each query."""
    for panel in panels():
        for target in panel.get("targets", []):
            yield panel["title"], target["expr"], target["legendFormat"]
    for variable in DASHBOARD["templating"]["list"]:
        if variable["type"] == "query":
            yield variable["name"], variable["definition"], ""
    for annotation in DASHBOARD["annotations"]["list"]:
        yield annotation["name"], annotation["expr"], ""


def problems(expression: str, legend: str) -> list[str]:
    """Return what an expression asks for that is not exported, and what it says that is no PromQL of ours."""
    wrong: list[str] = []
    bare = re.sub(r'"[^"]*"', '""', expression)
    bare = re.sub(r"\[[^\]]*\]", "", bare)
    for opening, closing in ("()", "{}"):
        if bare.count(opening) != bare.count(closing):
            wrong.append(f"{opening} without {closing}")
    groups = [name for group in re.findall(r"\bby \(([^)]*)\)", bare) for name in NAME.findall(group)]
    bare = re.sub(r"\bby \([^)]*\)", "by", bare)
    metrics: list[str] = []
    for name, matchers in re.findall(r"([a-zA-Z_]\w*)(\{[^}]*\})?", bare):
        if name in FUNCTIONS or (not matchers and name in TARGET_LABELS):
            continue
        if name in EXPORTED:
            metrics.append(name)
            known = EXPORTED[name] | TARGET_LABELS
            wrong += [f"{name} has no label {label}" for label in NAME.findall(matchers) if label not in known]
        elif not (bare.startswith("label_values(") and metrics and name in EXPORTED[metrics[-1]]):
            wrong.append(f"{name} is not exported")
        bare = bare.replace(matchers, "", 1) if matchers else bare
    if not metrics:
        wrong.append("asks for nothing")
    told = set.union(*(EXPORTED[name] for name in metrics)) if metrics else set()
    wrong += [f"groups by {label}, which nothing has" for label in groups if label not in told | TARGET_LABELS]
    known = set(groups) if groups else told | TARGET_LABELS
    wrong += [f"the legend shows {label}" for label in re.findall(r"\{\{(\w+)\}\}", legend) if label not in known]
    return wrong


def test_there_are_queries() -> None:
    assert len(list(queries())) > 30


@each(("where", "expression", "legend"), list(queries()))
def test_a_query_asks_for_what_is_exported(where: str, expression: str, legend: str) -> None:
    assert problems(expression, legend) == []


@pytest.mark.parametrize(
    ("expression", "legend", "problem"),
    [
        ("rate(s7dissect_packets[5m])", "", "s7dissect_packets is not exported"),
        ("rate(s7dissect_packets_total{slug=~\"x\"}[5m])", "", "s7dissect_packets_total has no label slug"),
        ("sum by (slug) (s7dissect_packets_total)", "", "groups by slug, which nothing has"),
        ("sum by (category) (s7dissect_packets_total)", "{{slug}}", "the legend shows slug"),
        ("sum by (category) (s7dissect_packets_total", "", "( without )"),
        ("avg(s7dissect_packets_total)", "", "avg is not exported"),
        ("label_values(s7dissect_packets_total, slug)", "", "slug is not exported"),
        ("time()", "", "asks for nothing"),
    ],
)  # fmt: skip
def test_a_wrong_query_is_noticed(expression: str, legend: str, problem: str) -> None:
    assert problem in problems(expression, legend)


def test_what_is_exported_is_looked_at() -> None:
    text = "\n".join(expression for _, expression, _ in queries())
    used = {name for name in EXPORTED if re.search(rf"\b{name}\b", text)}
    assert set(EXPORTED) - used == UNUSED


def test_every_metric_of_the_table_is_among_those() -> None:
    missing = [
        family.name
        for family in Exposition(Metrics()).collect()
        if family.name.startswith(PREFIX) and not any(name.startswith(family.name) for name in EXPORTED)
    ]
    assert missing == []


def test_panels_stand_beside_each_other() -> None:
    taken: dict[tuple[int, int], str] = {}
    for panel in panels():
        place = panel["gridPos"]
        assert place["x"] >= 0
        assert place["x"] + place["w"] <= 24
        for x in range(place["x"], place["x"] + place["w"]):
            for y in range(place["y"], place["y"] + place["h"]):
                assert taken.setdefault((x, y), panel["title"]) == panel["title"]
    numbers = [panel["id"] for panel in panels()]
    assert len(numbers) == len(set(numbers))
    assert [panel["title"] for panel in panels() if panel["type"] == "row"] == [
        "Traffic",
        "Answer times",
        "Outcomes",
        "Findings",
        "Loss, and the probe itself",
    ]


def test_it_asks_the_data_source_that_is_chosen() -> None:
    names = {variable["name"] for variable in DASHBOARD["templating"]["list"]}
    text = json.dumps(DASHBOARD)
    asked = set(re.findall(r"\$\{?(\w+)", text)) - {"__all", "__rate_interval", "__range"}
    assert asked == names
    assert all(panel["datasource"]["uid"] == "${datasource}" for panel in panels() if panel["type"] != "row")
