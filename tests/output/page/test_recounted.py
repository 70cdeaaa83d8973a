"""Numbers of tables, plots and cards are counted again from the lines of `transactions -T jsonl` and `show -T jsonl`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final

import pytest

from tests.meaning.report.schemas import ROOT
from tests.output.page.support import session_of
from tests.recount.counted import host_of
from tests.recount.outputs import outputs_of
from tests.recount.recount import Capture, iso_ns

OWN: Final = ROOT / "captures"
NAMES: Final = (
    "item-errors", "many-open", "answer-lost", "answer-slow", "nodes7-poll-missing", "nodes7-write", "crafted/plus-plant",
    "crafted/reference-examples", "crafted/program",
)  # fmt: skip


@pytest.fixture(scope="module", params=NAMES)
def both(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Capture, dict[str, Any]]:
    """A capture as its lines tell it, and the data of its page."""
    path: Path = OWN / f"{request.param}.pcapng"
    outputs = outputs_of(path, tmp_path_factory.mktemp("outputs"))
    return Capture(outputs, path), session_of(outputs["page.html"])


def table(session: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a table by its name."""
    (found,) = [one for one in session["tables"] if one["name"] == name]
    assert isinstance(found, dict)
    return found


def column(session: dict[str, Any], name: str, title: str) -> list[Any]:
    """Return the cells of a column; empty if the table does without it."""
    found = table(session, name)
    titles = [one for one, _ in found["columns"]]
    return [row["cells"][titles.index(title)] for row in found["rows"]] if title in titles else []


def failed(capture: Capture) -> list[dict[str, Any]]:
    """Return what failed, by what the report says of that word: with errors, or without the answer that was due."""
    return [one for one in capture.transactions if one["errors"] or one["missed"]]


def when(one: dict[str, Any]) -> int:
    return iso_ns(one["request_time"] or one["response_time"])


def test_failed_and_slowest(both: tuple[Capture, dict[str, Any]]) -> None:
    capture, session = both
    assert sorted(column(session, "failed", "number")) == sorted([one["number"] for one in failed(capture)])
    times = {one["number"]: one["latency_ns"] for one in capture.transactions if one["latency_ns"] is not None}
    numbers, shown = column(session, "slowest", "number"), column(session, "slowest", "answer")
    assert (len(numbers), table(session, "slowest")["total"]) == (min(len(times), len(numbers)), len(times))
    assert shown == [times[number] for number in numbers]
    assert sorted(shown, reverse=True)[:50] == sorted(times.values(), reverse=True)[:50]


def test_what_is_drawn_over_the_time(both: tuple[Capture, dict[str, Any]]) -> None:
    """Each bin of each plot has as many as came in its time."""
    capture, session = both
    rates = session["rates"]
    start = round(session["start_ms"] * 1e6)
    width = round(rates["width"] * 1e9)
    bad: Counter[int] = Counter([when(one) // width for one in failed(capture)])
    every: Counter[int] = Counter([when(one) // width for one in capture.transactions])
    for seconds, *counts in rates["bins"]:
        number = round((start + seconds * 1e9) / width)
        assert (counts[1] + counts[2], sum(counts)) == (bad[number], every[number])
    assert sum([sum(row[1:]) for row in rates["bins"]]) == len(capture.transactions)
    timed = [one for one in capture.transactions if one["latency_ns"] is not None]
    assert sum([cell[2] for cell in session["times"]["cells"]]) == len(timed)


def test_cards(both: tuple[Capture, dict[str, Any]]) -> None:
    """Clients, slowest answers and answer times of each PLC."""
    capture, session = both
    assert session["plcs"]["rows"]
    for card in session["plcs"]["rows"]:
        answered = [one for one in capture.transactions if host_of(one["answered_by"] or "") == card["host"]]
        times = sorted([one["latency_ns"] for one in answered if one["latency_ns"] is not None], reverse=True)
        assert [row[0] for row in card["slowest"]] == times[:5]
        assert sum([cell[2] for cell in card["times"]["cells"]]) == len(times)
        by_number = {one["number"]: one for one in answered}
        for took, _, _, _, key in card["slowest"]:
            assert by_number[int(key[1:])]["latency_ns"] == took
        if card["host"] not in {host_of(one["asked_by"] or "") for one in capture.transactions}:
            assert sum([row[2] for row in card["clients"]]) == len(answered)
            assert sum([row[5] for row in card["clients"]]) == len([one for one in answered if one["errors"]])
            assert sum([row[6] for row in card["clients"]]) == len([one for one in answered if one["missed"]])


def test_connections(both: tuple[Capture, dict[str, Any]]) -> None:
    capture, session = both
    numbers = column(session, "connections", "number")
    assert len(numbers) == len(set(numbers)) == table(session, "connections")["total"]
    for name, count in (("with errors", "errors"), ("no answer", "missed")):
        for number, said in zip(numbers, column(session, "connections", name), strict=True):
            assert said == len([one for one in capture.by_connection.get(number, []) if one[count]])
    for number, said in zip(numbers, column(session, "connections", "PDUs"), strict=True):
        assert said == capture.pdus_of[number]
