"""What Prometheus gets: well formed, in step with the run, and the same metrics whatever passed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from prometheus_client import Metric
from prometheus_client.parser import text_string_to_metric_families

from dissect import __version__
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.accounts import CATEGORIES
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.online.metrics.counters import Metrics
from dissect.online.metrics.exposition import COUNTER, FAMILIES, HISTOGRAM, PREFIX, Exposition
from dissect.online.metrics.functions import BOUNDS_NS
from dissect.packets.source.live.reader import Drops
from tests.cases import each
from tests.conftest import ROOT
from tests.online.metrics.test_counters import CAPTURES, counted

LABELS: Final = {PREFIX + family.name: family.labels for family in FAMILIES}


def parsed(metrics: Metrics) -> dict[str, Metric]:
    """Return what the library's own reader makes of the text, ours only."""
    text = Exposition(metrics).text().decode()
    assert text.endswith("\n")
    return {family.name: family for family in text_string_to_metric_families(text) if family.name.startswith(PREFIX)}


def series(family: Metric, label: str, suffix: str = "") -> dict[str, float]:
    """Return the values of a family by one of its labels."""
    values: dict[str, float] = {}
    for sample in family.samples:
        if sample.name.endswith(suffix):
            key = sample.labels[label]
            values[key] = values.get(key, 0) + sample.value
    return values


def plain(family: Metric) -> float:
    (sample,) = family.samples
    assert not sample.labels
    return float(sample.value)


def test_every_metric_is_there_before_anything_happened() -> None:
    families = parsed(Metrics())
    assert list(families) == list(LABELS)
    assert {name: family.type for name, family in families.items()} == {
        PREFIX + family.name: family.type for family in FAMILIES
    }
    assert all(family.documentation for family in families.values())


def test_names_follow_the_rules_of_prometheus() -> None:
    for family in FAMILIES:
        assert re.fullmatch(r"[a-z][a-z0-9_]*[a-z0-9]", family.name)
        assert not family.name.endswith(("_total", "_count", "_sum", "_bucket"))
        assert all(re.fullmatch(r"[a-z]+", label) and label not in {"le", "quantile"} for label in family.labels)
        assert family.sentence.endswith(".")
    assert len(LABELS) == len(FAMILIES)


@each("path", CAPTURES)
def test_the_text_agrees_with_the_analysis(path: Path) -> None:
    metrics, analysis = counted(path)
    families = parsed(metrics)
    for name, family in families.items():
        for sample in family.samples:
            assert set(sample.labels) - {"le"} == set(LABELS[name]), sample
            assert sample.value >= 0
        distinct = {(sample.name, *sorted(sample.labels.items())) for sample in family.samples}
        assert len(distinct) == len(family.samples), f"{name} has one series twice"
    check_totals(families, analysis)


def check_totals(families: dict[str, Metric], analysis: Analysis) -> None:
    pipeline = analysis.pipeline
    assert pipeline is not None
    told = analysis_as_dict(analysis)
    packets = series(families["s7dissect_packets"], "category")
    waiting = plain(families["s7dissect_fragments_waiting"])
    assert {**packets, "fragment_waiting": waiting} == pipeline.counters.packet_counts()
    assert set(packets) == set(CATEGORIES) - {"fragment_waiting"}
    assert sum(packets.values()) + waiting == pipeline.frames
    outcomes = series(families["s7dissect_transactions"], "outcome")
    assert sum(outcomes.values()) == analysis.total
    assert outcomes.get("answered", 0) == analysis.answered
    counts = series(families["s7dissect_latency_seconds"], "function", "_count")
    assert sum(counts.values()) == analysis.latencies.count
    findings = series(families["s7dissect_findings"], "slug")
    assert {slug: count for slug, count in findings.items() if count} == told["findings"]
    assert set(findings) == set(CATALOGUE)
    tpdus = series(families["s7dissect_tpdus"], "type")
    assert sum(tpdus.values()) == sum(pipeline.iso.tpdus.counts())
    assert sum(series(families["s7dissect_s7_pdus"], "rosctr").values()) == sum(pipeline.s7.rosctrs.counts())
    assert plain(families["s7dissect_stream_holes"]) == pipeline.counters.octets.holes
    assert plain(families["s7dissect_stream_missing_octets"]) == pipeline.counters.octets.missing
    assert plain(families["s7dissect_connections_open"]) == 0
    assert plain(families["s7dissect_connections_opened"]) == len(analysis.connections)
    assert plain(families["s7dissect_open_requests"]) == 0


def test_a_histogram_adds_up() -> None:
    metrics, _ = counted(ROOT / "captures" / "answer-slow.pcapng")
    family = parsed(metrics)["s7dissect_latency_seconds"]
    functions = {sample.labels["function"] for sample in family.samples}
    assert len(functions) > 1
    for function in functions:
        mine = [sample for sample in family.samples if sample.labels["function"] == function]
        buckets = [sample for sample in mine if sample.name.endswith("_bucket")]
        bounds = [float(sample.labels["le"]) for sample in buckets]
        assert bounds == [*(bound / 1e9 for bound in BOUNDS_NS), float("inf")]
        values = [sample.value for sample in buckets]
        assert values == sorted(values)
        (count,) = [sample.value for sample in mine if sample.name.endswith("_count")]
        assert values[-1] == count > 0


def test_what_a_live_source_told() -> None:
    metrics = Metrics(clock=lambda: 1_750_000_000)
    families = parsed(metrics)
    for name in ("drops", "queue_events", "events_lost", "capture_lag_seconds", "last_packet_timestamp_seconds"):
        assert families[PREFIX + name].samples == [], name  # not known is not none
    metrics.tick(1_000_000_000, Drops(12, None))
    metrics.watch_queue(lambda: (3, 9))
    families = parsed(metrics)
    assert series(families["s7dissect_drops"], "where") == {"kernel": 12}
    assert plain(families["s7dissect_queue_events"]) == 3
    assert plain(families["s7dissect_events_lost"]) == 9
    assert plain(families["s7dissect_capture_lag_seconds"]) == 0.75


def test_which_build_it_is() -> None:
    (sample,) = parsed(Metrics())["s7dissect_build_info"].samples
    assert sample.labels["version"] == __version__
    assert sample.labels["build"] in {"compiled", "interpreted"}


def test_no_label_holds_an_address() -> None:
    for path in CAPTURES:
        metrics, analysis = counted(path)
        text = Exposition(metrics).text().decode()
        for connection in analysis.connections:
            for end in connection.tcp.ends:
                assert str(end).rpartition(":")[0] not in text


def test_counters_never_go_back_while_a_capture_is_read() -> None:
    from dissect.files.session import Run

    for path in CAPTURES:
        metrics = Metrics()
        run = Run([str(path)], metrics)
        metrics.begin(run.pipeline)
        before: dict[tuple[object, ...], float] = {}
        more = True
        while more:
            more = run.step()
            now: dict[tuple[object, ...], float] = {
                (sample.name, *sorted(sample.labels.items())): sample.value
                for family in parsed(metrics).values()
                if family.type in {COUNTER, HISTOGRAM}
                for sample in family.samples
            }
            assert all(now[key] >= value for key, value in before.items())
            before = now


def test_the_page_lists_every_metric() -> None:
    rows = [
        f"| `{PREFIX}{family.name}{'_total' if family.type == COUNTER else ''}` | {family.type} "
        f"| {', '.join(f'`{label}`' for label in family.labels)} | {family.sentence} |".replace("|  |", "| |")
        for family in FAMILIES
    ]
    page = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8").splitlines()
    assert [line for line in page if line.startswith(f"| `{PREFIX}")] == rows


def test_there_are_as_many_series_as_the_page_tells() -> None:
    def count(metrics: Metrics, name: str = "") -> int:
        return sum(len(family.samples) for family in parsed(metrics).values() if name in family.name)

    fresh = Metrics()
    fresh.begin(Pipeline(fresh))
    assert 310 < count(fresh) < 410
    metrics, _ = counted(ROOT / "captures" / "item-errors.pcapng")
    each = count(metrics, "transactions") + count(metrics, "latency")
    assert each == 21 * len(metrics.functions.rows)
