"""Counts of findings are those of the selection, exact: 10,000 events are counted again by a script of their own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

from tests.cli.support import run
from tests.meaning.report.support import WORD, begun, saved
from tests.properties.messages import Item, dt, read_answer, read_job, write_answer, write_job
from tests.properties.packets import EPOCH_NS, Flow, Packet
from tests.selections_recounted import Line, answered_ns, nanoseconds, recount

MS: Final = 1_000_000
#: Requests of each connection: of ten, nine are refused reads of two items, and one is a write.
REQUESTS: Final = 1900
OTHER: Final = Item(0x04, 1, 10, 0x84, 10 * 8)
FILES: Final = 3
#: The findings that are counted again; a new writer is told by who wrote before.
COUNTED: Final = frozenset(("transaction.item_error", "security.write", "security.write_refused"))


def conversation(host: str, port: int, begin_ns: int) -> list[Packet]:
    talk = begun(Flow(host, ports=(port, 102)))
    for number in range(1, REQUESTS + 1):
        if number % 10:
            item = WORD if number % 3 else OTHER
            talk.send(0, dt(read_job(number, [item, WORD])))
            talk.send(1, dt(read_answer(number, [item, WORD], [0x0A, 0x05])))
        else:
            talk.send(0, dt(write_job(number, [WORD], [b"\x00\x07"])))
            talk.send(1, dt(write_answer(number, [0xFF if number % 20 else 0x0A])))
    return talk.close().packets(start_ns=begin_ns)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three connections at once, two of them between the same hosts, in three files that continue each other."""
    packets = [
        packet
        for number, host in enumerate(("10.0.2.1", "10.0.2.1", "10.0.2.9"))
        for packet in conversation(host, 50_000 + number, EPOCH_NS + number * 100)
    ]
    packets.sort(key=lambda packet: packet.time_ns)
    folder = tmp_path_factory.mktemp("recount")
    size = len(packets) // FILES
    # Files are cut between a request and its answer, too.
    cuts = [0, size + 1, 2 * size, len(packets)]
    return [
        saved(folder / f"ring-{number}.pcapng", packets[cuts[number] : cuts[number + 1]]) for number in range(FILES)
    ]


@pytest.fixture(scope="module")
def lines(files: list[Path]) -> list[Line]:
    """What is told of every transaction, without a selection."""
    ran = subprocess.run(
        [sys.executable, "-m", "dissect", "transactions", "-T", "jsonl", *map(str, files)],
        capture_output=True,
        check=True,
    )
    return [json.loads(line) for line in ran.stdout.splitlines()]


def since(seconds: float) -> str:
    return json.dumps(seconds)


def _reads_other(line: Line) -> bool:
    return any([item["address"].startswith("DB10.DBW10") for item in line["items"]])


SELECTIONS: Final[list[tuple[list[str], Callable[[Line], bool]]]] = [
    ([], bool),
    (["--connection", "1"], lambda line: line["connection"] == 1),
    (["--connection", "2", "--connection", "3"], lambda line: line["connection"] in {2, 3}),
    (["-Y", "client == 10.0.2.9"], lambda line: line["connection"] == 3),
    (["-Y", "address == DB10.DBW10"], _reads_other),
    (["-Y", "function == write"], lambda line: line["function"]["code"] == 5),
    (
        ["-Y", "function == write and connection == 2"],
        lambda line: line["function"]["code"] == 5 and line["connection"] == 2,
    ),
]


def facts_of(told: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {
        slug: {
            "events": facts["events"],
            "connections": facts["connections"],
            "first_ns": nanoseconds(facts["first_time"]),
            "last_ns": nanoseconds(facts["last_time"]),
        }
        for slug, facts in told["finding_facts"].items()
        if slug in COUNTED
    }


@pytest.mark.parametrize(("words", "wanted"), SELECTIONS, ids=[" ".join(words) for words, _ in SELECTIONS])
def test_a_selection_counts_its_own_events(
    capfdbinary: pytest.CaptureFixture[bytes],
    files: list[Path],
    lines: list[Line],
    words: list[str],
    wanted: Callable[[Line], bool],
) -> None:
    told = json.loads(run(capfdbinary, "analyze", "-T", "json", *words, *files).out)
    counted = recount(lines, wanted)
    assert counted
    assert facts_of(told) == counted
    assert told["findings"]["transaction.item_error" if "write" not in str(words) else "security.write"] > 0
    if told["selection"] is not None:
        assert told["selection"]["findings_not_judged"] == 0


def test_there_are_ten_thousand(lines: list[Line]) -> None:
    assert sum([facts["events"] for facts in recount(lines).values()]) > 10_000


@pytest.mark.parametrize(("begin", "end"), [(1, 2.5), (0, 0.7504), (3, 9)])
def test_a_time_counts_its_own_events(
    capfdbinary: pytest.CaptureFixture[bytes], files: list[Path], lines: list[Line], begin: float, end: float
) -> None:
    """A finding is of the time when it was seen: that of the answer."""
    ran = run(capfdbinary, "analyze", "-T", "json", "--time", f"{since(begin)}..{since(end)}", *files)
    told = json.loads(ran.out)

    def inside(line: Line) -> bool:
        return EPOCH_NS + begin * 10**9 <= answered_ns(line) <= EPOCH_NS + end * 10**9

    assert facts_of(told) == recount(lines, inside)


def test_each_file_counts_its_own_events(
    capfdbinary: pytest.CaptureFixture[bytes], files: list[Path], lines: list[Line]
) -> None:
    """A finding counts for the file of its first packet, which is that of the request."""
    rows = run(capfdbinary, "analyze", "--per-file", *files).out.splitlines()[1 : FILES + 1]
    for path, row in zip(files, rows, strict=True):
        counted = recount(lines, lambda line, name=str(path): line["request_file"] == name)  # type: ignore[misc]
        reported = counted["transaction.item_error"]["events"]
        warnings = int(row.split()[7])
        # What is reported once a connection is one more warning each in the file where it happened first.
        assert 0 <= warnings - reported <= 6, (row, reported)


def test_a_planted_wrong_number_is_found(lines: list[Line]) -> None:
    wrong = [json.loads(json.dumps(line)) for line in lines]
    next(line for line in wrong if line["function"]["code"] == 4)["items"][0]["return_code"] = 0xFF
    assert recount(wrong) != recount(lines)
