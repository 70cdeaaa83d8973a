"""Metrics of a run for Prometheus: `counters` counts, `exposition` defines and writes the metrics, `server` serves them."""
