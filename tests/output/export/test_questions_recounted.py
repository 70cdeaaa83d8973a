"""The rest of the questions of `sql`: what each answers is what a script finds in `transactions -T jsonl`."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

import pytest

from tests.cases import each
from tests.meaning.report.support import begun, saved
from tests.output.export.test_questions import (
    CAPTURES,
    NAMES,
    Capture,
    Row,
    ask,
    asked,
    host,
    is_refused,
    nanoseconds,
    told,
)
from tests.properties import messages
from tests.properties.messages import Item, dt

pytest.importorskip("duckdb")

#: Function codes of jobs that are acts by themselves, and what `interventions` calls them.
ACTS: Final = {0x1A: "download", 0x1D: "upload", 0x28: "service", 0x29: "stop"}
ACTING: Final = ("transfer.pcapng", "crafted/program.pcapng", "crafted/coverage-functions.pcapng", "blocks.pcapng")
#: Beside the ten captures: those in which there are several clients, and S7comm-plus.
MORE: Final = (*NAMES, "two-clients.pcapng", "crafted/plus-plant.pcapng")


@each("name", MORE)
def test_talkers(capfdbinary: Capture, name: str) -> None:
    answered: Counter[tuple[str, str]] = Counter()
    errors: Counter[tuple[str, str]] = Counter()
    for one in told(capfdbinary, name):
        pair = host(one["asked_by"]), host(one["answered_by"])
        answered[pair] += one["outcome"] == "answered"
        errors[pair] += bool(one["errors"])
    rows = ask(capfdbinary, "talkers", CAPTURES / name)
    found = {(row["client_host"], row["server_host"]): row for row in rows}
    assert {pair: row["answered"] for pair, row in found.items() if row["answered"]} == +answered
    assert {pair: row["with_errors"] for pair, row in found.items() if row["with_errors"]} == +errors
    sizes = [row["bytes"] for row in rows]
    assert sizes == sorted(sizes, reverse=True)


@each("name", MORE)
@each(
    "shift",
    [("", "UTC", 6, 22), (" Europe/Berlin 22 6", "Europe/Berlin", 22, 6), (" Asia/Tokyo 9 10", "Asia/Tokyo", 9, 10)],
)
def test_off_shift(capfdbinary: Capture, name: str, shift: tuple[str, str, int, int]) -> None:
    words, zone, begins, ends = shift
    wanted = []
    for one, item in asked(told(capfdbinary, name), 5):
        if is_refused(one, item):
            continue
        hour = datetime.fromisoformat(one["request_time"][:19] + "+00:00").astimezone(ZoneInfo(zone)).hour
        inside = begins <= hour < ends if begins < ends else hour >= begins or hour < ends
        if not inside:
            wanted.append((host(one["asked_by"]), item["address"]))
    rows = ask(capfdbinary, f"off-shift{words}", CAPTURES / name)
    assert sorted((row["client_host"], row["written"]) for row in rows if _plain(row["written"])) == sorted(
        [row for row in wanted if _plain(row[1])]
    )


def _plain(address: str) -> bool:
    """Whether an address is one of S7comm: names of S7comm-plus have rows of another form."""
    return re.fullmatch(r"(DB|DI|[MIQTCP][BWDX]?)[0-9][A-Z0-9.]*", address) is not None


def overlapping(transactions: list[Row]) -> dict[str, int]:
    """Return how many polls began before the same poll before them was answered, by what they ask for."""
    polls: dict[tuple[int, str], list[Row]] = defaultdict(list)
    for one in transactions:
        if one["function"]["code"] == 4 and one.get("protocol") is None and one["request_frame"] is not None:
            what = ", ".join([f"{item['address']} x{item['count'] or 1}" for item in one["items"]])
            polls[one["connection"], what].append(one)
    found: Counter[str] = Counter()
    for (_, what), several in polls.items():
        several.sort(key=lambda one: nanoseconds(one["request_time"]))
        for one, later in pairwise(several):
            if one["latency_ns"] is None or one.get("certainty", "sure") != "sure":
                continue
            ends = nanoseconds(one["request_time"]) + one["latency_ns"]
            found[what] += nanoseconds(later["request_time"]) < ends
    return +found


def test_overlaps(capfdbinary: Capture, tmp_path: Path) -> None:
    """Two polls of which one waits for no answer, and one that does."""
    hasty, patient = [Item(db=10)], [Item(db=20)]
    talk = begun()
    for number in range(10, 30, 3):
        talk.send(0, dt(messages.read_job(number, hasty)))
        talk.send(0, dt(messages.read_job(number + 1, hasty)))
        for reference in (number, number + 1):
            talk.send(1, dt(messages.read_answer(reference, hasty, [b"\x01"])))
        talk.send(0, dt(messages.read_job(number + 2, patient)))
        talk.send(1, dt(messages.read_answer(number + 2, patient, [b"\x01"])))
    path = saved(tmp_path / "hasty.pcapng", talk.close().packets())
    (row,) = ask(capfdbinary, "overlaps", path)
    assert (row["what"], row["polls"], row["overlapping"]) == ("DB10.DBB0 x1", 14, 7)
    assert overlapping(told(capfdbinary, str(path))) == {"DB10.DBB0 x1": 7}


@each("name", MORE)
def test_overlaps_of_captures(capfdbinary: Capture, name: str) -> None:
    found = {row["what"]: row["overlapping"] for row in ask(capfdbinary, "overlaps", CAPTURES / name)}
    assert found == overlapping(told(capfdbinary, name))


@each("name", ACTING)
def test_interventions_and_indicators(capfdbinary: Capture, name: str) -> None:
    """Jobs that load, read out, stop or call a service, each once, by who asked; `ioc` has the same, by address."""
    wanted: Counter[tuple[str, str]] = Counter()
    for one in told(capfdbinary, name):
        if one["rosctr"] == 1 and one["request_frame"] is not None and one["function"]["code"] in ACTS:
            wanted[host(one["asked_by"]), ACTS[one["function"]["code"]]] += 1
    rows = ask(capfdbinary, "interventions", CAPTURES / name)
    assert [row["ts"] for row in rows] == sorted(row["ts"] for row in rows)
    for kind in ("download", "upload", "stop"):
        found = Counter((row["client_host"], kind) for row in rows if row["kind"] == kind)
        assert found == Counter({key: count for key, count in wanted.items() if key[1] == kind}), kind
    indicated: Counter[tuple[str, str, str]] = Counter()
    for row in ask(capfdbinary, "ioc", CAPTURES / name):
        if row["outcome"] is not None:  # else it is a finding
            indicated[row["address"], row["act"], row["outcome"]] += row["times"]
            assert row["first_time"] <= row["last_time"]
    assert indicated == Counter((row["client_host"], row["kind"], row["outcome"]) for row in rows)


def test_findings_of_security_that_are_no_acts_are_indicators(capfdbinary: Capture) -> None:
    rows = ask(capfdbinary, "ioc", CAPTURES / "crafted" / "plus-plant.pcapng")
    assert [(row["address"], row["times"]) for row in rows if row["act"] == "security.write"] == [("192.0.2.30", 1)]
