"""Every question of `sql` has the answer that a script finds by itself in `transactions -T jsonl`, which imports nothing."""

from __future__ import annotations

import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from statistics import median, pstdev
from typing import Any

import pytest

from dissect.output.export.questions import QUESTIONS, named
from tests.cli.support import run
from tests.meaning.report.support import ROOT, begun, saved

pytest.importorskip("duckdb")

Capture = pytest.CaptureFixture[bytes]
Row = dict[str, Any]
CAPTURES = ROOT / "captures"
NAMES = (
    "nodes7-poll.pcapng", "item-errors.pcapng", "multi-items.pcapng", "write-areas.pcapng", "batched.pcapng", "transfer.pcapng",
    "crafted/holes.pcapng", "crafted/causes.pcapng", "crafted/refusals.pcapng", "crafted/certainty.pcapng",
)  # fmt: skip


def ask(capfdbinary: Capture, question: str, *files: Path) -> list[Row]:
    ran = run(capfdbinary, "sql", "-T", "jsonl", question, *files)
    assert ran.code in {0, 3}, ran.err
    return [json.loads(line) for line in ran.out.splitlines()]


# ---- the script ------------------------------------------------------------------------------------------------------


def told(capfdbinary: Capture, name: str) -> list[Row]:
    return [
        json.loads(line) for line in run(capfdbinary, "transactions", "-T", "jsonl", CAPTURES / name).out.splitlines()
    ]


def host(end: str) -> str:
    return end.rsplit(":", 1)[0]


def label(item: Row) -> str:
    return str(item["address"])


def nanoseconds(time: str) -> int:
    day, clock = time.rstrip("Z").split("T")
    hours, minutes, seconds = clock.split(":")
    year, month, date = (int(part) for part in day.split("-"))
    days = 372 * year + 31 * month + date  # only differences within a capture count
    return (
        ((days * 24 + int(hours)) * 60 + int(minutes)) * 60 * 10**9 + int(float(seconds[:2])) * 10**9 + int(seconds[3:])
    )


def asked(transactions: list[Row], code: int) -> Iterator[tuple[Row, Row]]:
    """Yield each item of reads (4) or writes (5) with its transaction."""
    for one in transactions:
        if one["function"]["code"] == code and one.get("protocol") is None and one["request_frame"] is not None:
            for item in one["items"]:
                if item["address"] is not None:
                    yield one, item


def is_refused(one: Row, item: Row) -> bool:
    code = item["return_code"]
    whole = any(error["where"] in {"header", "parameter"} for error in one["errors"])
    return (code is not None and code != 255) or (code is None and whole and one["outcome"] == "answered")


# ---- each question ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_periods(capfdbinary: Capture, name: str) -> None:
    times: dict[tuple[int, str, int], set[int]] = defaultdict(set)
    ends: dict[int, tuple[str, str]] = {}
    for one, item in asked(told(capfdbinary, name), 4):
        times[one["connection"], label(item), item["count"] or 1].add(nanoseconds(one["request_time"]))
        ends[one["connection"]] = host(one["asked_by"]), host(one["answered_by"])
    wanted: dict[tuple[str, str, str, int], list[int]] = defaultdict(list)
    for (connection, what, length), seen in times.items():
        wanted[(*ends[connection], what, length)] += [later - before for before, later in pairwise(sorted(seen))]
    found = {
        (row["client_host"], row["server_host"], row["what"], row["length"]): row
        for row in ask(capfdbinary, "periods", CAPTURES / name)
        if row["how"] != "on change"
    }
    for key, pauses in wanted.items():
        if len(pauses) < 2:
            assert key not in found
            continue
        assert found[key]["period_ms"] == pytest.approx(median(pauses) / 1e6, abs=0.001)
        assert found[key]["how"] == ("irregular" if pstdev(pauses) > sum(pauses) / len(pauses) else "steady")
    assert None not in {what for _, _, what, _ in found}


def test_some_capture_has_periods_of_either_kind(capfdbinary: Capture) -> None:
    rows = ask(capfdbinary, "periods", *[CAPTURES / name for name in (*NAMES, "crafted/plus-plant.pcapng")])
    assert {row["how"] for row in rows} == {"steady", "irregular", "on change"}


@pytest.mark.parametrize("name", NAMES)
def test_writers_and_who(capfdbinary: Capture, name: str) -> None:
    writes: dict[str, list[str]] = defaultdict(list)
    for one, item in asked(told(capfdbinary, name), 5):
        if not is_refused(one, item):
            writes[label(item)].append(host(one["asked_by"]))
    wanted = {what: sorted(set(hosts)) for what, hosts in writes.items() if len(set(hosts)) > 1}
    assert {row["address"]: row["hosts"] for row in ask(capfdbinary, "writers", CAPTURES / name)} == wanted
    for what, hosts in list(writes.items())[:2]:
        rows = [row for row in ask(capfdbinary, f"who {what}", CAPTURES / name) if row["address"] == what]
        assert [row["client_host"] for row in rows if not row["refused"]] == hosts


@pytest.mark.parametrize("name", NAMES)
def test_refused(capfdbinary: Capture, name: str) -> None:
    wanted: Counter[str] = Counter()
    transactions = told(capfdbinary, name)
    for code in (4, 5):
        for one, item in asked(transactions, code):
            if one.get("certainty") != "likely" and is_refused(one, item):
                wanted[label(item)] += 1
    found: Counter[str] = Counter()
    for row in ask(capfdbinary, "refused", CAPTURES / name):
        if "." in (row["address"] or "") or (row["address"] or " ")[0] in "MIQTC":
            found[row["address"]] += row["times"]
    assert found == Counter({what: count for what, count in wanted.items() if "." in what or what[0] in "MIQTC"})


@pytest.mark.parametrize("name", NAMES)
def test_unanswered_and_gaps(capfdbinary: Capture, name: str) -> None:
    transactions = told(capfdbinary, name)
    due = {"connection_closed", "reference_reused", "table_full", "connection_evicted"}
    wanted = Counter(
        one["connection"] for one in transactions if one["outcome"] == "unanswered" and one["reason"] in due
    )
    assert {row["connection"]: row["unanswered"] for row in ask(capfdbinary, "unanswered", CAPTURES / name)} == wanted
    lost = refused = 0
    for one, item in asked(transactions, 4):
        lost += one["reason"] == "hole"
        refused += one["reason"] != "hole" and one["outcome"] == "answered" and is_refused(one, item)
    rows = ask(capfdbinary, "gaps", CAPTURES / name)
    assert sum(row["how"] == "lost" for row in rows) == lost
    assert sum(row["how"] == "refused" for row in rows if row["what"] is not None) == refused
    for row in rows:
        if row["how"] == "late":
            assert row["pause_ms"] > 2 * row["period_ms"] - 0.002


@pytest.mark.parametrize("name", NAMES)
def test_slowest(capfdbinary: Capture, name: str) -> None:
    worst: dict[str, int] = {}
    for one in told(capfdbinary, name):
        if one["latency_ns"] is not None and one.get("certainty") != "likely" and one["items"]:
            server = host(one["answered_by"])
            worst[server] = max(worst.get(server, 0), one["latency_ns"])
    found: dict[str, float] = {}
    rows = ask(capfdbinary, "slowest", CAPTURES / name)
    for row in rows:
        found.setdefault(row["server_host"], row["worst_ms"])
        assert row["median_ms"] <= row["worst_ms"] <= found[row["server_host"]]
    assert found.keys() == worst.keys()
    for server, slowest in found.items():
        assert slowest == pytest.approx(worst[server] / 1e6, abs=0.001)


@pytest.mark.parametrize("name", NAMES)
def test_changes(capfdbinary: Capture, name: str) -> None:
    values = run(capfdbinary, "values", "-T", "jsonl", CAPTURES / name).out.splitlines()
    wanted: Counter[str] = Counter()
    for row in map(json.loads, values):
        wanted[row["tag"] or row["address"]] += row["changed"] is True
    found = {row["what"]: row["changes"] for row in ask(capfdbinary, "changes", CAPTURES / name)}
    assert found == {what: count for what, count in wanted.items() if count}


def test_items_that_stand_in_slow_requests(capfdbinary: Capture, tmp_path: Path) -> None:
    """Requests with DB10.DBW4 take 20 ms, all others 1 ms; DB10.DBW6 is in 4 of them, as chance has it."""
    from tests.properties import messages
    from tests.properties.messages import Item, dt

    talk = begun()
    slow, other, plain = (Item(0x04, 1, 10, 0x84, 8 * at) for at in (4, 6, 8))
    for number in range(200):
        items = [plain]
        if number % 10 == 0:
            items.append(slow)
        if number % 5 == 1 or number % 50 == 0:
            items.append(other)
        talk.send(0, dt(messages.read_job(number + 2, items)))
        for _ in range(20 if slow in items else 1):
            talk.ack(0)
        talk.send(1, dt(messages.read_answer(number + 2, items, [b"\0\1"] * len(items))))
    path = saved(tmp_path / "slow.pcapng", talk.close().packets())
    found = ask(capfdbinary, "slow-items", path)
    assert [(row["what"], row["times"], row["slow"]) for row in found] == [("DB10.DBW4", 20, 20)]


# ---- words behind a name ---------------------------------------------------------------------------------------------


def test_words_behind_a_name(capfdbinary: Capture) -> None:
    path = CAPTURES / "item-errors.pcapng"  # its writes are of half past one
    assert ask(capfdbinary, "off-shift", path) != []
    assert ask(capfdbinary, "off-shift UTC 1 2", path) == []
    assert ask(capfdbinary, "off-shift Asia/Tokyo 9 11", path) == []
    assert ask(capfdbinary, "off-shift UTC 22 2", path) == []
    assert len(ask(capfdbinary, "off-shift UTC 2 22", path)) == len(ask(capfdbinary, "off-shift", path))
    assert ask(capfdbinary, "who DB2.DBD16 '2026-11-21 01:31'", path) != []
    assert ask(capfdbinary, "who DB2.DBD16 '2026-11-21 01:35'", path) == []
    assert ask(capfdbinary, "who DB2.DBD16 2026-11-21T10:31+09:00", path) != []
    assert ask(capfdbinary, "who DB2.DBD16 2026-11-21T01:31+09:00", path) == []
    for part in ("db2.dbb18", "DB2.DBX19.7", "DB2.DBW14 x3", "DB2.DBD16", "DB2"):  # that REAL is 16 to 19
        assert "DB2.DBD16" in [row["address"] for row in ask(capfdbinary, f"who '{part}'", path)], part
    for other in ("DB2.DBB20", "DB2.DBX15.7", "DB3.DBD16", "MD16", "DB2.DBW14"):
        assert "DB2.DBD16" not in [row["address"] for row in ask(capfdbinary, f"who {other}", path)], other
    refused = {row["what"] for row in ask(capfdbinary, "gaps db99.dbx1.0", path)}
    assert refused == {"DB99.DBB0"}
    assert ask(capfdbinary, "gaps DB98.DBX1.0", path) == []
    assert named("select 1") is None


def test_a_time_behind_a_name_is_local_where_times_are(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        path = CAPTURES / "item-errors.pcapng"
        for moment, options, found in (
            ("10:31", ["--local-time"], True),
            ("01:31", ["--local-time"], False),
            ("01:31", [], True),
        ):
            ran = run(capfdbinary, "sql", "-T", "jsonl", f"who DB2.DBD16 '2026-11-21 {moment}'", path, *options)
            assert (ran.code, bool(ran.out)) == (0, found), (moment, options)
    finally:
        monkeypatch.undo()
        time.tzset()


@pytest.mark.parametrize(
    ("question", "said"),
    [
        ("talkers now", "The question talkers takes nothing more"),
        ("off-shift Mars", "takes time zone by its name"),
        ("off-shift UTC 25", "takes hour"),
        ("who", "takes an address or tag"),
        ("who DB1.DBB0 yesterday", "takes a time, such as"),
        ("who DB1.DBB0 0001-01-01T00:00+05:00", "No calendar has the time"),
        ("who DB1.DBB0 9999-12-31T23:59-05:00", "No calendar has the time"),
        ("who 'DB1", "No closing quotation"),
    ],
)
def test_wrong_words_are_refused_in_one_sentence(capfdbinary: Capture, question: str, said: str) -> None:
    ran = run(capfdbinary, "sql", question, CAPTURES / "item-errors.pcapng")
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err


def test_an_empty_answer_says_so(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "sql", "writers", CAPTURES / "szl.pcapng")
    assert ran.out == "No address has more than one writer.\n"
    for question in QUESTIONS.values():
        assert question.none.endswith(".")
