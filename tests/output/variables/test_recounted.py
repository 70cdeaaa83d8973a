"""`values --summary` has what a script finds in `values -T jsonl`, variable by variable."""

from __future__ import annotations

import json
from collections import defaultdict
from datetime import datetime
from typing import Any, Final

import pytest

from tests.cases import each
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]
CAPTURES: Final = ROOT / "captures"
NAMES: Final = (
    "nodes7-poll.pcapng", "item-errors.pcapng", "multi-items.pcapng", "write-areas.pcapng", "batched.pcapng", "transfer.pcapng",
    "two-clients.pcapng", "crafted/holes.pcapng", "crafted/pushes.pcapng", "crafted/plus-plant.pcapng",
)  # fmt: skip


def lines(capfdbinary: Capture, *words: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in run(capfdbinary, "values", *words, "-T", "jsonl").out.splitlines()]


def key(row: dict[str, Any]) -> tuple[object, ...]:
    return (row["plc"].rpartition(":")[0], row["address"], row["tag"], row["type"])


@each("name", NAMES)
def test_a_summary_is_that_of_its_rows(capfdbinary: Capture, name: str) -> None:
    of: dict[tuple[object, ...], list[dict[str, Any]]] = defaultdict(list)
    for row in lines(capfdbinary, str(CAPTURES / name)):
        of[key(row)].append(row)
    summaries = {key(row): row for row in lines(capfdbinary, "--summary", str(CAPTURES / name))}
    assert {what for what, row in summaries.items() if row["count"]} == of.keys()
    for what, rows in of.items():
        told = summaries[what]
        assert told["count"] == len(rows), what
        assert told["changes"] == sum(row["changed"] is True for row in rows), what
        octets = {row["octets"] if row["value"] is None else json.dumps(row["value"]) for row in rows}
        assert told["distinct"] == len(octets) or told["distinct_more"], what
        assert (told["first_time"], told["last_time"]) == (rows[0]["time"], rows[-1]["time"]), what
        assert (told["first"], told["last"]) == (rows[0]["value"], rows[-1]["value"]), what
        numbers = [row["value"] for row in rows if isinstance(row["value"], int | float)]
        if told["min"] is not None and len(numbers) == len(rows):
            assert (told["min"], told["max"]) == (min(numbers), max(numbers)), what
            assert told["mean"] == pytest.approx(sum(numbers) / len(numbers), rel=1e-6), what
        for how, writes in (("readers", False), ("writers", True)):  # who gets a value pushed reads it
            wanted: dict[str, int] = defaultdict(int)
            for row in rows:
                if (row["how"] in {"write", "modify", "force"}) is writes:
                    wanted[row["client"]] += 1
            found = {one["client"]: one["count"] for one in told[how]}
            assert found == wanted, (what, how)


def test_the_captures_have_all_of_it(capfdbinary: Capture) -> None:
    """Numbers that change, several clients, and reads that are paced."""
    rows = [row for name in NAMES for row in lines(capfdbinary, "--summary", str(CAPTURES / name))]
    assert any(row["changes"] for row in rows)
    assert any(row["min"] is not None and row["min"] < row["max"] for row in rows)
    assert any(row["writers"] and row["readers"] for row in rows)
    assert any(row["period_ns"] for row in rows)


@each("name", NAMES)
def test_the_period_is_the_mean_pause_of_a_reader(capfdbinary: Capture, name: str) -> None:
    of: dict[tuple[object, ...], list[int]] = defaultdict(list)
    for row in lines(capfdbinary, str(CAPTURES / name)):
        if row["how"] == "read":
            whole, _, rest = row["time"].rstrip("Z").partition(".")
            seconds = int(datetime.fromisoformat(f"{whole}+00:00").timestamp())
            of[(*key(row), row["client"])].append(seconds * 10**9 + int(rest.ljust(9, "0")))
    for row in lines(capfdbinary, "--summary", str(CAPTURES / name)):
        for reader in row["readers"]:
            times = sorted(set(of.get((*key(row), reader["client"]), ())))
            if len(times) > 2 and len(times) == reader["count"] and reader["period_ns"] is not None:
                assert reader["period_ns"] == pytest.approx((times[-1] - times[0]) / (len(times) - 1), abs=2)
