"""`s7dissect open`: what Wireshark is started with, and what is left afterwards."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.cli import open as opening
from dissect.cli.main import main
from dissect.packets.source.files import open_capture
from tests.cli.support import run
from tests.meaning.report.support import WORD, begun, read, saved
from tests.packets.source.craft import Recorder, drain

Capture = pytest.CaptureFixture[bytes]
#: Takes the place of Wireshark: keeps its arguments and the file, and ends as told.
FAKE: Final = """#!/bin/sh
printf '%s\\n' "$@" > '{folder}/arguments'
cp "$2" '{folder}/seen.pcapng'
{then}
"""


class Fake:
    """A program called wireshark on the path, and nothing else there."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder / "path"
        self.folder.mkdir()
        monkeypatch.setenv("PATH", f"{self.folder}{os.pathsep}/bin{os.pathsep}/usr/bin")
        self.does("exit 0")

    def does(self, then: str) -> None:
        program = self.folder / "wireshark"
        program.write_text(FAKE.format(folder=self.folder, then=then), encoding="utf-8")
        program.chmod(0o755)

    def arguments(self) -> list[str]:
        return (self.folder / "arguments").read_text(encoding="utf-8").splitlines()

    def seen(self) -> Recorder:
        """Return the packets and comments of the file that it was given."""
        return drain(open_capture(str(self.folder / "seen.pcapng")))


@pytest.fixture
def wireshark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fake:
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    monkeypatch.setattr("dissect.packets.source.wireshark._USUAL", ())
    return Fake(tmp_path, monkeypatch)


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    """A capture with comments of its own, of which packets 10 and 11 are a refused read."""
    packets = read(read(read(begun(), 1), 2, WORD, 0x0A), 3).packets()
    return saved(tmp_path / "a.pcapng", packets, {4: "here before", 11: "here too"})


def test_it_goes_to_the_packet_that_matters_and_leaves_nothing(
    capfdbinary: Capture, tmp_path: Path, wireshark: Fake, capture: Path
) -> None:
    ran = run(capfdbinary, "open", capture)
    assert (ran.code, ran.out, ran.err) == (0, "", "")
    option, path, goes, number = wireshark.arguments()
    assert (option, goes, number) == ("-r", "-g", "10")
    assert Path(path).is_absolute()
    assert not list((tmp_path / "tmp").iterdir())
    seen = wireshark.seen()
    assert len(seen.frames) == 13
    mark = "s7dissect: warning transaction.item_error"
    assert [(number, text[: len(mark)]) for number, text in seen.comments] == [
        (4, "here before"),
        (10, mark),
        (11, "here too"),
        (11, mark),
    ]


def test_a_part_and_what_is_around_it(capfdbinary: Capture, wireshark: Fake, capture: Path) -> None:
    assert run(capfdbinary, "open", "-Y", "failed", capture).code == 0
    assert (wireshark.arguments()[3], len(wireshark.seen().frames)) == ("1", 2)
    assert run(capfdbinary, "open", "-Y", "failed", "--around", "2", capture).code == 0
    assert (wireshark.arguments()[3], len(wireshark.seen().frames)) == ("3", 6)
    # Nothing was found in these, so the first that was wanted is gone to, and not one that is near it.
    assert run(capfdbinary, "open", "-Y", "frame == 5", "--around", "2", capture).code == 0
    assert (wireshark.arguments()[3], len(wireshark.seen().frames)) == ("3", 5)


def test_a_packet_by_number(capfdbinary: Capture, wireshark: Fake, capture: Path) -> None:
    assert run(capfdbinary, "open", "--frame", "6", capture).code == 0
    assert wireshark.arguments()[3] == "6"
    assert run(capfdbinary, "open", "--frame", "11", "-Y", "failed", capture).code == 0
    assert wireshark.arguments()[3] == "2"
    for arguments, said in ((("99",), "there is no packet 99"), (("6", "-Y", "failed"), "-Y leaves out packet 6")):
        ran = run(capfdbinary, "open", capture, "--frame", *arguments)
        assert ran.code == 2
        assert said in ran.err
    ran = run(capfdbinary, "open", capture, "-Y", "host == 192.0.2.99")
    assert (ran.code, "no packet matches" in ran.err) == (2, True)


def test_the_file_is_kept_where_it_is_named(
    capfdbinary: Capture, tmp_path: Path, wireshark: Fake, capture: Path
) -> None:
    out = tmp_path / "out.pcapng"
    ran = run(capfdbinary, "open", capture, "-o", out)
    assert (ran.code, ran.out) == (0, "")
    assert ran.err == f"s7dissect: 13 of 13 packets written to {out}, 2 with findings as comments\n"
    assert wireshark.arguments() == ["-r", str(out), "-g", "10"]
    ran = run(capfdbinary, "open", capture, "-o", out)
    assert (ran.code, "--force overwrites it" in ran.err) == (2, True)
    assert run(capfdbinary, "open", capture, "-o", capture, "--force").code == 2
    assert run(capfdbinary, "open", capture, "-o", "-").code == 2
    ran = run(capfdbinary, "open", capture, "--around", "2")
    assert (ran.code, "--around needs -Y: all packets are shown" in ran.err) == (2, True)


def test_without_wireshark_it_says_how(
    capfdbinary: Capture, tmp_path: Path, wireshark: Fake, capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    ran = run(capfdbinary, "open", capture)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == (
        "Error: Wireshark was not found here; -o OUT writes the file to open it elsewhere, with wireshark -r OUT -g PACKET.\n"
    )
    out = tmp_path / "out.pcapng"
    ran = run(capfdbinary, "open", capture, "-o", out)
    assert (ran.code, ran.err.splitlines()[-1]) == (0, f"s7dissect: open it with: wireshark -r {out} -g 10")
    assert len(drain(open_capture(str(out))).frames) == 13


def test_a_wireshark_that_fails_is_told(capfdbinary: Capture, tmp_path: Path, wireshark: Fake, capture: Path) -> None:
    wireshark.does("echo no display >&2; exit 7")
    ran = run(capfdbinary, "open", capture)
    assert (ran.code, ran.out) == (2, "")
    assert "no display" in ran.err
    assert "Wireshark ended with code 7" in ran.err
    assert not list((tmp_path / "tmp").iterdir())


def test_a_full_disk_is_one_line_and_leaves_nothing(
    capfdbinary: Capture, tmp_path: Path, wireshark: Fake, capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("dissect.packets.source.pcapng_writer.os.write", full)
    with pytest.raises(SystemExit) as end:
        main(["open", str(capture)])
    monkeypatch.undo()
    told = capfdbinary.readouterr()
    assert end.value.code == 5
    assert told.err.decode().startswith("s7dissect: cannot write ")
    assert told.err.decode().endswith(": No space left on device\n")
    assert not list((tmp_path / "tmp").iterdir())


def test_a_damaged_capture_is_shown_as_far_as_it_goes(capfdbinary: Capture, wireshark: Fake, capture: Path) -> None:
    capture.write_bytes(capture.read_bytes()[:-5])
    ran = run(capfdbinary, "open", capture)
    assert (ran.code, "cut off" in ran.err) == (3, True)
    assert len(wireshark.seen().frames) == 12


def test_an_interruption_ends_wireshark_and_leaves_nothing(tmp_path: Path, wireshark: Fake, capture: Path) -> None:
    wireshark.does("exec sleep 60")
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp")}
    with subprocess.Popen([sys.executable, "-m", "dissect", "open", str(capture)], env=environment) as child:
        try:
            end = time.monotonic() + 60
            while not (wireshark.folder / "seen.pcapng").exists() and time.monotonic() < end:
                time.sleep(0.02)
            child.send_signal(signal.SIGTERM)
            assert child.wait(30) == 130
        finally:
            child.kill()
    assert not list((tmp_path / "tmp").iterdir())


@pytest.mark.skipif(os.name == "nt", reason="a process of Windows gets no SIGTERM")
def test_a_termination_while_wireshark_starts_ends_it_too(
    wireshark: Fake, capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wireshark.does("exec sleep 20")
    begin = subprocess.Popen
    stray: list[int] = []

    def interrupted(*arguments: Any, **about: Any) -> Any:
        child = begin(*arguments, **about)
        os.kill(os.getpid(), signal.SIGTERM)
        return child

    before = signal.signal(signal.SIGTERM, lambda number, _frame: stray.append(number))
    try:
        monkeypatch.setattr("dissect.cli.open.subprocess.Popen", interrupted)
        assert opening._show(str(wireshark.folder / "wireshark"), str(capture), 1) == 130
    finally:
        signal.signal(signal.SIGTERM, before)
    assert stray == []
