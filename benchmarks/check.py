"""Compare the results of an engine with the truth about a synthetic capture."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path


def check_analysis(told: dict[str, Any], truth: dict[str, Any]) -> list[str]:
    """Return a sentence for each number of ``analyze -T json`` that is not true."""
    wrong: list[str] = []

    def same(name: str, is_told: object, is_true: object) -> None:
        if is_told != is_true:
            wrong.append(f"{name}: told {is_told}, true {is_true}")

    same("packets.read", told["packets"]["read"], truth["packets"])
    same("s7.pdus", told["s7"]["pdus"], truth["s7"]["pdus"])
    same("s7.rosctr", told["s7"]["rosctr"], truth["s7"]["rosctr"])
    same("s7.functions", told["s7"]["functions"], truth["s7"]["functions"])
    for name, count in truth["tpdus"].items():
        same(f"tpdus.{name}", told["tpdus"].get(name, 0), count)
    for name, count in truth["transactions"].items():
        same(f"transactions.{name}", told["transactions"][name], count)
    # Percentiles may come from a histogram, so they may differ by two per cent.
    for name in ("median", "p95", "max"):
        value, true = told["latency_ns"][name], truth["latency_ns"][name]
        if abs(value - true) > 0.02 * abs(true):
            wrong.append(f"latency_ns.{name}: told {value}, true {true}")
    return wrong


def check_transactions(path: Path, truth: dict[str, Any]) -> list[str]:
    """Return a sentence for each count in the lines of ``transactions -T jsonl`` at ``path`` that is not true."""
    outcomes: dict[str, int] = {}
    items = failed = 0
    with path.open("rb") as file:
        for line in file:
            told = json.loads(line)
            outcome = told["outcome"]
            outcomes[outcome] = outcomes.get(outcome, 0) + 1
            failed += bool(told["errors"])
            if told["request_frame"] is not None:
                items += len(told["items"])
    true = truth["transactions"]
    pairs = [
        ("lines answered", outcomes.get("answered", 0), true["answered"]),
        ("items", items, truth["items"]),
        ("lines with errors", failed, true["with_errors"]),
    ]
    return [f"{name}: told {is_told}, true {is_true}" for name, is_told, is_true in pairs if is_told != is_true]


def count_tshark(path: Path) -> int:
    """Return the number of S7 PDUs in the lines of ``tshark -T fields`` at ``path`` (commas join several of a frame)."""
    column = 3
    with path.open("rb") as file:
        return sum(line.split(b"\t")[column].count(b",") + 1 for line in file)
