"""The numbers in the text form that Prometheus fetches (exposition format 0.0.4), written by ``prometheus_client``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.exposition import generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.process_collector import ProcessCollector
from prometheus_client.registry import Collector

from dissect import __version__
from dissect.metrics.counters import Metrics
from dissect.metrics.families import COUNTER, HISTOGRAM, PREFIX, Reading, readings
from dissect.metrics.functions import BOUNDS_NS
from dissect.wire.build import COMPILED

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

#: Upper bounds of the buckets as they are written.
BOUNDS: Final[list[str]] = [*[str(bound / 1e9) for bound in BOUNDS_NS], "+Inf"]


class Exposition(Collector):
    """Reads a `Metrics` whenever it is asked, and what the system says of this process: memory, CPU time, open files."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._process = ProcessCollector(registry=None)

    def collect(self) -> Iterator[Metric]:
        """Yield every metric with what it is now."""
        build = "compiled" if COMPILED else "interpreted"
        for reading in readings(self._metrics, __version__, build):
            yield _as_metric(reading)
        process: Iterable[Metric] = self._process.collect()
        yield from process

    def text(self) -> bytes:
        """Return all of it as text."""
        octets: bytes = generate_latest(self)
        return octets


def _as_metric(reading: Reading) -> Metric:
    family = reading.family
    name = PREFIX + family.name
    labels = list(family.labels)
    if family.type == HISTOGRAM:
        times = HistogramMetricFamily(name, family.sentence, labels=labels)
        for series in reading.histograms:
            upto = 0
            buckets: list[tuple[str, float]] = []
            for bound, count in zip(BOUNDS, series.buckets, strict=True):
                upto += count
                buckets.append((bound, upto))
            times.add_metric(list(series.labels), buckets, series.total)
        return times
    kind = CounterMetricFamily if family.type == COUNTER else GaugeMetricFamily
    numbers = kind(name, family.sentence, labels=labels)
    for sample in reading.samples:
        numbers.add_metric(list(sample.labels), sample.value)
    return numbers
