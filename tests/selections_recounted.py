"""Counts events again, from the output of `transactions -T jsonl`, for comparison with the counts of findings.

It imports nothing of the package: `s7dissect transactions -T jsonl FILE… | python tests/selections_recounted.py` prints the
numbers.
"""

from __future__ import annotations

import datetime
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

Line = dict[str, Any]
SUCCESS = 0xFF
WRITE = 5


def refused_items(line: Line) -> int:
    """Return how many items of a request were refused."""
    return sum([1 for item in line["items"] if item.get("return_code") not in {None, SUCCESS}])


def nanoseconds(text: str) -> int:
    """Return a time of the output, ``2026-11-28T21:00:00.123456789Z``, as nanoseconds since 1970."""
    seconds, _, rest = text.removesuffix("Z").partition(".")
    moment = datetime.datetime.fromisoformat(seconds).replace(tzinfo=datetime.UTC)
    return int(moment.timestamp()) * 10**9 + int(rest.ljust(9, "0"))


def answered_ns(line: Line) -> int:
    """Return the time of the answer."""
    return nanoseconds(line["request_time"]) + int(line["latency_ns"])


def events(line: Line) -> Counter[str]:
    """Return the events of a transaction, by the finding about them."""
    found: Counter[str] = Counter()
    if line["outcome"] != "answered":
        return found
    found["transaction.item_error"] += refused_items(line)
    if line["function"]["code"] == WRITE:
        codes = [item["return_code"] for item in line["items"]]
        found["security.write"] += SUCCESS in codes
        found["security.write_refused"] += any([code != SUCCESS for code in codes])
    return +found


def recount(lines: Iterable[Line], wanted: Callable[[Line], bool] = bool) -> dict[str, dict[str, Any]]:
    """Return for each finding its events, their connections, and the time of the first and last of them."""
    told: dict[str, dict[str, Any]] = {}
    for line in lines:
        if not wanted(line):
            continue
        for slug, count in events(line).items():
            facts = told.setdefault(slug, {"events": 0, "connections": set(), "times": []})
            facts["events"] += count
            facts["connections"].add(line["connection"])
            facts["times"].append(answered_ns(line))
    return {
        slug: {
            "events": facts["events"],
            "connections": len(facts["connections"]),
            "first_ns": min(facts["times"]),
            "last_ns": max(facts["times"]),
        }
        for slug, facts in sorted(told.items())
    }


if __name__ == "__main__":
    json.dump(recount([json.loads(line) for line in sys.stdin]), sys.stdout, indent=1)
