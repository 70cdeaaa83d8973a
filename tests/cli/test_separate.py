"""--separate: each file a capture of its own; what several processes find is what one finds, byte by byte."""

from __future__ import annotations

import json
import shutil
import signal
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.cli import separate
from tests.cases import each
from tests.cli.support import Ran, run
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]

CAPTURES: Final = ROOT / "captures"
#: Two of them go on where the one before ends.
FILES: Final = [
    str(CAPTURES / name)
    for name in (
        "szl.pcapng",
        "transfer.pcapng",
        "s7plus/s7commplus-tls.pcapng",
        "crafted/holes.pcapng",
        "clock.pcapng",
    )
]
SZL: Final = FILES[0]
CUT: Final = str(CAPTURES / "crafted" / "cut-pcapng.pcapng")


def both(capfdbinary: Capture, *arguments: str) -> Ran:
    """Run a command with one process and with two, compare, and return what they did."""
    one = run(capfdbinary, *arguments)
    two = run(capfdbinary, *arguments, "-j", "2")
    assert (two.code, two.out, two.err) == (one.code, one.out, one.err)
    return one


@pytest.fixture(autouse=True)
def _two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 2)


def test_two_processes_find_what_one_finds(capfdbinary: Capture, tmp_path: Path) -> None:
    """With a file that is no capture, one that is cut and one that is not there: named, the rest is done."""
    text = tmp_path / "text.pcap"
    text.write_text("this is no capture, but long enough to be looked at")
    gone = str(tmp_path / "gone.pcap")
    ran = both(capfdbinary, "analyze", "--separate", "-T", "json", *FILES, str(text), CUT, gone)
    assert ran.code == 3
    said = ran.err.splitlines()
    assert sum(["text.pcap: " in line for line in said]) == 1
    assert sum(["gone.pcap: no such file" in line for line in said]) == 1
    assert sum(["cut-pcapng.pcapng: " in line for line in said]) == 1
    assert len(said) == 4
    assert "1 file goes on where the file before ends" in said[-1]
    found = json.loads(ran.out)
    assert [Path(file["name"]).name for file in found["files"]] == [
        Path(file).name for file in (*FILES, str(text), CUT, gone)
    ]
    assert [file["packets"] for file in found["files"]][-1] == 0
    numbers = [connection["number"] for connection in found["connections"]]
    assert numbers == list(range(1, len(numbers) + 1))


def test_a_selection_and_tags_and_the_gate(capfdbinary: Capture) -> None:
    csv = str(CAPTURES / "tags" / "valve.csv")
    ran = run(
        capfdbinary, "analyze", "--separate", "-Y", "failed", "--tags", csv, "--fail-on", "warning", "--brief", *FILES
    )
    whole = run(capfdbinary, "analyze", "-Y", "failed", "--tags", csv, "--fail-on", "warning", "--brief", *FILES)
    assert (ran.code, ran.out) == (whole.code, whole.out)
    assert ran.code == 1
    assert "--fail-on: " in ran.err


def test_two_hundred_files(capfdbinary: Capture, tmp_path: Path) -> None:
    for number in range(200):
        (tmp_path / f"{number:03}.pcapng").symlink_to(SZL)
    (tmp_path / "100.pcapng").unlink()
    shutil.copy(CUT, tmp_path / "100.pcapng")
    ran = run(capfdbinary, "analyze", "--separate", "-T", "json", str(tmp_path / "*.pcapng"))
    assert ran.code == 3
    found = json.loads(ran.out)
    assert len(found["files"]) == 200
    alone = json.loads(run(capfdbinary, "analyze", "-T", "json", SZL).out)
    cut = json.loads(run(capfdbinary, "analyze", "-T", "json", CUT).out)
    total = 199 * alone["transactions"]["total"] + cut["transactions"]["total"]
    assert found["transactions"]["total"] == total
    assert found["packets"]["read"] == 199 * alone["packets"]["read"] + cut["packets"]["read"]


@each(("options", "why"), [
    (["-j", "2"], "needs --separate"),
    (["--separate", "-j", "0"], "0 processes can do nothing"),
    (["--separate", "-j", "3"], "3 is too many, there are 2 processors here"),
    (["--separate", "-j", "many"], "expected a number of processes or auto"),
    (["--separate", "-Y", "connection == 2"], "--separate: the field connection counts over all files"),
    (["--separate", "--connection", "2"], "--separate: the field connection counts over all files"),
])  # fmt: skip
def test_wrong_use_is_one_line(capfdbinary: Capture, options: list[str], why: str) -> None:
    ran = run(capfdbinary, "analyze", SZL, *options)
    assert (ran.code, ran.out) == (2, "")
    assert why in ran.err
    assert "Traceback" not in ran.err


def test_standard_input_is_for_one(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "analyze", "--separate", "-j", "2", "-", SZL)
    assert ran.code == 2
    assert "standard input can be read by one process only" in ran.err


def test_the_only_file_cannot_be_read(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "analyze", "--separate", "/nowhere.pcap")
    assert (ran.code, ran.out, ran.err) == (2, "", "s7dissect: /nowhere.pcap: no such file\n")


class Dying(separate.Here):
    """An executor whose processes die at some files: at one once, at another each time."""

    def __init__(self, _count: int, *_: object) -> None:
        self._begun: list[str] = []

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Do a task, or die of it."""
        file = Path(args[-1]).name
        self._begun.append(file)
        if (file == "transfer.pcapng" and self._begun.count(file) == 1) or file == "clock.pcapng":
            future: Future[Any] = Future()
            future.set_exception(BrokenExecutor("ended"))
            return future
        return super().submit(fn, *args, **kwargs)


def test_a_process_that_dies_names_its_file(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is read once more; where that is in vain the rest is done all the same."""
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Dying)
    ran = run(capfdbinary, "analyze", "--separate", "-T", "json", "-j", "2", *FILES)
    found = json.loads(ran.out)
    assert ran.code == 3
    assert [file["packets"] > 0 for file in found["files"]] == [True] * 4 + [False]
    said = ran.err.splitlines()
    ended = "the process that read it ended: it was killed, or there was no memory left"
    assert [line for line in said if "transfer.pcapng" in line] == [
        f"s7dissect: {FILES[1]}: {ended}; it is read once more"
    ]
    assert [line for line in said if "clock.pcapng" in line] == [
        f"s7dissect: {FILES[4]}: {ended}; it is read once more",
        f"s7dissect: {FILES[4]}: {ended}; so did the one that read it again",
    ]


def test_who_interrupts_has_what_was_read(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    read = separate.read_file
    seen: list[str] = []

    def interrupting(of: Any, *each: Any) -> None:
        read(of, *each)
        seen.append("file")
        if len(seen) == 2:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(separate, "read_file", interrupting)
    ran = run(capfdbinary, "analyze", "--separate", "-T", "json", *FILES)
    found = json.loads(ran.out)
    assert (ran.code, found["interrupted"], len(found["files"])) == (130, True, 2)
    assert ran.err.splitlines()[0] == "s7dissect: interrupted; the results cover what was read so far"


def test_devices_of_all_files_are_one_inventory(capfdbinary: Capture, tmp_path: Path) -> None:
    """As one run finds them, by any number of processes; with a file that is no capture and one that is cut."""
    tags = ["--tags", str(CAPTURES / "tags" / "valve.csv"), "-Y", "not failed"]
    ran = both(capfdbinary, "devices", "--separate", *tags, *FILES)
    whole = run(capfdbinary, "devices", *tags, *FILES)
    assert (ran.code, ran.out) == (whole.code, whole.out) == (0, whole.out)
    assert ran.err.startswith("s7dissect: 1 file goes on where the file before ends")
    text = tmp_path / "text.pcap"
    text.write_text("this is no capture, but long enough to be looked at")
    cut = both(capfdbinary, "devices", "--separate", "-T", "json", *FILES, str(text), CUT)
    assert cut.code == 3
    assert [sum([f"{name}: " in line for line in cut.err.splitlines()]) for name in ("text.pcap", CUT)] == [1, 1]
    found, sound = (json.loads(out) for out in (cut.out, run(capfdbinary, "devices", "-T", "json", *FILES, CUT).out))
    assert [Path(name).name for name in found.pop("files")][-2:] == ["text.pcap", "cut-pcapng.pcapng"]
    assert sound.pop("files") == [*FILES, CUT]
    assert found == sound


def test_devices_after_a_process_died(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file is read once more; one that cannot be read at all leaves the others as they are."""
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Dying)
    ran = run(capfdbinary, "devices", "--separate", "-T", "json", "-j", "2", *FILES)
    without = run(capfdbinary, "devices", "-T", "json", *FILES[:4])
    assert ran.code == 3
    assert (
        "transfer.pcapng: the process that read it ended: it was killed, or there was no memory left; it is" in ran.err
    )
    assert "clock.pcapng: the process that read it ended: it was killed, or there was no memory left; so did" in ran.err
    assert json.loads(ran.out)["devices"] == json.loads(without.out)["devices"]


@each(("options", "why"), [
    (["-j", "2"], "needs --separate"),
    (["--separate", "--connection", "2"], "--separate: the field connection counts over all files"),
])  # fmt: skip
def test_what_devices_do_not_take(capfdbinary: Capture, options: list[str], why: str) -> None:
    ran = run(capfdbinary, "devices", SZL, *options)
    assert (ran.code, ran.out) == (2, "")
    assert why in ran.err
    assert "Traceback" not in ran.err


def test_the_gate_of_devices(capfdbinary: Capture) -> None:
    """Of files by themselves as of one run: with and without a selection."""
    for selection in ([], ["-Y", "slug == security.write"]):
        options = ["--fail-on", "warning", *selection]
        ran = run(capfdbinary, "devices", "--separate", *options, *FILES)
        assert ran.code == run(capfdbinary, "devices", *options, *FILES).code == 1
        assert "--fail-on: " in ran.err
