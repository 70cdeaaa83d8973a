"""-j: what several processes write is what one writes, byte by byte."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from dissect.cli import together
from dissect.jobs.parts import Piece
from dissect.report.styled import Line
from tests.cases import each
from tests.cli.support import Ran, run
from tests.jobs.support import HereTeam, lossy, work_here
from tests.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]

CAPTURES: Final = sorted([path for path in (ROOT / "captures").rglob("*.pcap*") if path.stat().st_size < 500_000])
#: What cannot be known of a connection without reading all of it.
_APART: Final = frozenset(("endings.pcapng",))
SZL: Final = str(ROOT / "captures" / "szl.pcapng")
WRITES: Final = str(ROOT / "captures" / "write-areas.pcapng")
CLIENTS: Final = str(ROOT / "captures" / "two-clients.pcapng")


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    work_here(monkeypatch)


def both(capfdbinary: Capture, *arguments: str, jobs: int = 2) -> tuple[Ran, Ran]:
    return run(capfdbinary, *arguments), run(capfdbinary, *arguments, "-j", str(jobs))


def same(capfdbinary: Capture, *arguments: str, jobs: int = 2) -> str:
    """Compare one process with several; return what these said of having to do with one."""
    one, several = both(capfdbinary, *arguments, jobs=jobs)
    told = [line for line in several.err.splitlines() if " -j: " in line]
    rest = [line for line in several.err.splitlines() if " -j: " not in line]
    assert (several.code, several.out, rest) == (one.code, one.out, one.err.splitlines())
    return "\n".join(told)


@each("command", ["transactions", "values"])
def test_every_capture_gives_the_same(capfdbinary: Capture, command: str) -> None:
    apart = set()
    for path in CAPTURES:
        if same(capfdbinary, command, "-T", "jsonl", str(path)):
            apart.add(path.name)
    assert apart <= _APART | {"other-ports.pcapng"}


@each("arguments", [
    ("transactions",), ("transactions", "-T", "csv"), ("transactions", "-T", "jsonl"),
    ("transactions", "-T", "fields", "-e", "number", "-e", "connection", "-e", "function"),
    ("transactions", "--failed", "--slow", "100"), ("transactions", "-Y", "function == write", "--checksums"),
    ("transactions", "--connection", "2", "--connection", "3"), ("values", "-T", "jsonl"), ("values", "--changes"),
])  # fmt: skip
def test_many_connections_with_gaps_give_the_same(
    capfdbinary: Capture, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    """Segments out of order, sent twice and missing: what waits for others ends at the same packet, with the same number."""
    capture = tmp_path / "lossy.pcap"
    if not capture.exists():
        lossy(capture, 1500, 9, 0.15, 3)
    assert not same(capfdbinary, *arguments, str(capture), jobs=3)


def test_files_that_follow_each_other_and_others(capfdbinary: Capture, tmp_path: Path) -> None:
    later = str(lossy(tmp_path / "later.pcap", 400, 3, 0.0, 5))
    assert not same(capfdbinary, "transactions", "-T", "csv", CLIENTS, later, SZL, CLIENTS)
    assert not same(capfdbinary, "values", WRITES, later, CLIENTS, "-T", "csv")


def test_what_is_asked_for_and_missing_is_said_once(capfdbinary: Capture) -> None:
    one, several = both(capfdbinary, "values", WRITES, "DB9.DBD4", "M0.0")
    assert one.err == several.err
    assert "no value of DB9.DBD4" in several.err


def test_a_damaged_file_is_read_as_far_as_it_goes(capfdbinary: Capture, tmp_path: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes(Path(CLIENTS).read_bytes()[:-7])
    one, several = both(capfdbinary, "transactions", str(cut))
    assert several == one
    assert (several.code, several.err.count("cut.pcapng")) == (3, 1)


def test_an_unreadable_file_is_the_same_line(capfdbinary: Capture, tmp_path: Path) -> None:
    other = tmp_path / "other.pcap"
    other.write_bytes(b"no capture at all, but text")
    one, several = both(capfdbinary, "transactions", str(other))
    assert (several, several.code) == (one, 2)


@each(("arguments", "why"), [
    (("transactions", SZL, "-c", "3"), "-c ends the reading early"),
    (("transactions", SZL, "-Y", "number > 3"), "the field number"),
    (("transactions", SZL, "--fail-on", "note"), "--fail-on counts findings"),
    (("values", WRITES, "--summary"), "--summary adds up all values"),
])  # fmt: skip
def test_what_one_process_has_to_do_it_does_and_says_so(
    capfdbinary: Capture, arguments: tuple[str, ...], why: str
) -> None:
    assert same(capfdbinary, *arguments).startswith(f"s7dissect: -j: done by one process: {why}")


def test_nothing_is_written_twice_when_one_process_begins_anew(
    capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The second stretch of packets does not agree: what follows comes from one process, and what stood before stays."""
    from dissect.jobs import merging

    capture = str(lossy(tmp_path / "long.pcap", 4000, 5, 0.0, 1))
    merge = merging.Merger.merge
    calls = []

    def disagree(self: merging.Merger, pieces: list[Piece]) -> tuple[list[str | Line], list[int]]:
        calls.append(len(pieces))
        if len(calls) == 2:
            raise merging.DiffersError("of this test")
        return merge(self, pieces)

    monkeypatch.setattr(merging.Merger, "merge", disagree)
    assert "of this test" in same(capfdbinary, "transactions", "-T", "jsonl", capture)
    assert len(calls) == 2


def test_captures_without_s7_are_described_alike(capfdbinary: Capture) -> None:
    path = ROOT / "captures" / "refused-port.pcapng"
    one, several = both(capfdbinary, "transactions", str(path))
    assert several == one
    assert "no S7 transaction" in several.err


@each(("jobs", "why"), [
    ("0", "0 processes can do nothing"), ("-3", "-3 processes"), ("65", "65 is too many, there are 64 processors here"),
    ("many", "expected a number of processes or auto, got 'many'"), ("1.5", "got '1.5'"),
])  # fmt: skip
def test_a_wrong_number_is_one_line(capfdbinary: Capture, jobs: str, why: str) -> None:
    ran = run(capfdbinary, "transactions", SZL, "-j", jobs)
    assert (ran.code, ran.out) == (2, "")
    assert why in ran.err.splitlines()[-1]


def test_a_pipe_is_read_by_one(capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with subprocess.Popen([sys.executable, "-c", f"open({str(fifo)!r}, 'wb').write(open({SZL!r}, 'rb').read())"]):
        ran = run(capfdbinary, "transactions", str(fifo), "-j", "2")
    assert "no regular file can be read only once" in ran.err
    assert ran.out == run(capfdbinary, "transactions", SZL).out


# ---- real processes -------------------------------------------------------------------------------------------------


def test_with_processes(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 2)
    assert not same(capfdbinary, "transactions", "-T", "jsonl", CLIENTS)


class DyingTeam(HereTeam):
    """A team whose second worker is lost after the first stretch."""

    def rounds(self, stop: Callable[[], bool]):  # type: ignore[no-untyped-def]  # as above
        """Yield one round."""
        from dissect.jobs.team import WorkerError

        yield next(super().rounds(stop))
        raise WorkerError(2, 2, "a.pcap", f"killed by {signal.SIGKILL.name}")


def test_a_lost_worker_names_its_file(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("dissect.jobs.team.Team", DyingTeam)
    ran = run(capfdbinary, "transactions", CLIENTS, "-j", "2")
    assert ran.code == 2
    assert ran.err.splitlines()[-1] == (
        "Error: worker 2 of 2 ended at a.pcap: killed by SIGKILL; the results stop there"
    )


def test_an_interruption_writes_what_was_read(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupted(HereTeam):
        def rounds(self, stop: Callable[[], bool]):  # type: ignore[no-untyped-def]
            """Yield one round, then be interrupted."""
            yield next(super().rounds(stop))
            os.kill(os.getpid(), signal.SIGTERM)
            assert stop()

    monkeypatch.setattr("dissect.jobs.team.Team", Interrupted)
    ran = run(capfdbinary, "transactions", CLIENTS, "-j", "2")
    assert ran.code == 130
    assert ran.err == "s7dissect: interrupted; the results cover what was read so far\n"
    assert run(capfdbinary, "transactions", CLIENTS).out.startswith(ran.out)
    assert ran.out


def test_a_worker_sends_its_trouble(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a worker raises is a message: its own stderr is nobody's."""

    class Channel:
        def __init__(self) -> None:
            self.said: list[object] = []

        def send(self, message: object) -> None:
            self.said.append(message)

        def close(self) -> None:
            self.said.append("closed")

    channel = Channel()
    monkeypatch.setattr(sys, "stdout", sys.stdout)
    monkeypatch.setattr(sys, "stderr", sys.stderr)
    monkeypatch.setattr(together, "_worker", None)
    together.work(channel, ["transactions", "/no/such.pcap"], ["/no/such.pcap"], 0, 2)
    refused, end = channel.said
    assert isinstance(refused, together.Refused)
    assert "/no/such.pcap" in refused.text
    assert end == "closed"
