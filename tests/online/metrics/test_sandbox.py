"""The probe under the system call filter of its unit, with the user, the capability and the command that the unit gives it."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from dissect.packets.source.files import open_capture
from dissect.packets.source.live import privileges
from tests.conftest import ROOT
from tests.online.metrics import sandbox
from tests.online.metrics.test_probe import UNIT, sections
from tests.packets.source.live_support import Sink, in_namespace, needs_ring, sender

_UID: Final = 64_999
_WAIT_S: Final = 60.0


def missing() -> str:
    """Return what the test lacks here, empty when nothing."""
    if not privileges.is_root():
        return "only root enters the sandbox of a unit"
    if shutil.which("systemd-analyze") is None or sandbox.library() is None:
        return "no systemd-analyze or no libseccomp (scripts/install-tools.sh)"
    return ""


pytestmark = [
    needs_ring,
    pytest.mark.skipif(bool(missing()) and not os.environ.get("CI"), reason=missing()),
]


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder of the unit's user, who may not enter those of pytest."""
    with tempfile.TemporaryDirectory(prefix="s7dissect-unit-") as name:
        path = Path(name)
        os.chown(path, _UID, _UID)
        yield path


def service() -> dict[str, list[str]]:
    return sections(UNIT.read_text(encoding="utf-8"))["Service"]


def command_of(unit: dict[str, list[str]], state: Path) -> list[str]:
    """Return the command of the unit for the interface ``vb``, run by this interpreter."""
    (line,) = unit["ExecStart"]
    values = dict(re.fullmatch(r'"?(\w+)=([^"]*)"?', one).groups() for one in unit["Environment"])  # type: ignore[union-attr,misc]
    values |= {"INTERFACE": "vb", "METRICS": "127.0.0.1:0", "STATE_DIRECTORY": str(state)}
    words = shlex.split(line)
    assert words[0].endswith("/s7dissect")
    filled = [re.sub(r"\$\{(\w+)\}", lambda match: values[match[1]], word) for word in words[1:]]
    return [sys.executable, "-m", "dissect", *filled]


def started(unit: dict[str, list[str]], state: Path) -> subprocess.Popen[str]:
    """Start the command of a unit as systemd would."""
    wanted = {
        "calls": sorted(sandbox.allowed(unit["SystemCallFilter"])),
        "errno": unit["SystemCallErrorNumber"][0],
        "families": unit["RestrictAddressFamilies"][0].split(),
        "no_new_code": unit["MemoryDenyWriteExecute"] == ["yes"],
        "uid": _UID,
    }
    kept = {name: value for name, value in os.environ.items() if name in {"PATH", "PYTHONPATH", "PYTHONSAFEPATH"}}
    return subprocess.Popen(
        [sys.executable, str(ROOT / "tests" / "online" / "metrics" / "sandbox.py"), json.dumps(wanted), *command_of(unit,
        state)],
        env={**kept, "STATE_DIRECTORY": str(state), "PYTHONDONTWRITEBYTECODE": "1"}, cwd=state,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def play(name: str) -> int:
    """Send the packets of a capture; return how many."""
    sink = Sink()
    reader = open_capture(str(ROOT / "captures" / f"{name}.pcapng"))
    while reader.step(sink):
        pass
    with sender("va") as out:
        for packet in sink.got:
            out.send(packet.octets)
    return len(sink.got)


def _until(process: subprocess.Popen[str], word: str) -> str:
    """Return what a process writes up to the line with a word; one that does not write it is killed."""
    assert process.stdout is not None
    patience = threading.Timer(_WAIT_S, process.kill)
    patience.start()
    try:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if word in line:
                break
        return "".join(lines)
    finally:
        patience.cancel()


def test_the_probe_runs_under_the_filter_of_its_unit(folder: Path) -> None:
    assert missing() == ""
    pytest.importorskip("prometheus_client")

    def task() -> None:
        with started(service(), folder) as process:
            end = time.monotonic() + _WAIT_S
            while not list(folder.glob("*.part")) and process.poll() is None and time.monotonic() < end:
                play("password")  # until it listens
                time.sleep(0.2)
            play("plc-control")
            out = _until(process, "security.plc_stop")
            process.send_signal(signal.SIGTERM)
            assert process.stdout is not None
            assert process.stderr is not None
            out += process.stdout.read()
            err = process.stderr.read()
            process.wait(_WAIT_S)
        assert process.returncode == 130, err
        events = [json.loads(line) for line in out.splitlines()]
        assert events[-1]["event"] == "summary"
        assert events[-1]["summary"]["transactions"] > 0
        assert "security.plc_stop" in out
        assert [path.suffix for path in folder.glob("s7dissect_*")] == [".pcapng"]

    in_namespace(task)


#: What a user may add to the command of the unit.
OPTIONS = {
    "export": ["--export", "parquet:STATE/tables"],
    "several interfaces and bounds": ["-i", "lo", "-b", "days:30", "-b", "total:100000", "--keep-free", "1K"],
    "all": ["--keep-around", "error", "1s", "--export", "parquet:STATE/tables", "--report", "STATE/pages", "--alerts",
            "STATE/rules.toml", "-i", "lo"],
}  # fmt: skip


@pytest.mark.parametrize("options", OPTIONS)
def test_what_may_be_added_runs_under_it_as_well(options: str, folder: Path) -> None:
    assert missing() == ""
    pytest.importorskip("prometheus_client")
    (folder / "rules.toml").write_text('[[rule]]\nname = "r"\nwhen = "problem"\n')
    words = " ".join([word.replace("STATE", str(folder)) for word in OPTIONS[options]])
    unit = service()
    unit["ExecStart"] = [f"{unit['ExecStart'][0]} {words} --duration 1"]

    def task() -> None:
        with started(unit, folder) as process:
            out, err = process.communicate(timeout=_WAIT_S)
        assert (process.returncode, "Traceback" in err) == (0, False), err
        assert json.loads(out.splitlines()[-1])["event"] == "summary"
        assert "PROBLEM" not in out
        assert "switched off" not in err

    in_namespace(task)


def test_the_filter_is_a_real_one(folder: Path) -> None:
    """Without the line that gives `capset` back the probe cannot give up its rights, which is how the unit was."""
    assert missing() == ""
    unit = service()
    unit["SystemCallFilter"] = [line for line in unit["SystemCallFilter"] if line != "capset"]
    assert len(unit["SystemCallFilter"]) == 2

    def task() -> None:
        with started(unit, folder) as process:
            _, err = process.communicate(timeout=_WAIT_S)
        assert process.returncode == 2, err
        assert "could not give up its rights: Operation not permitted" in err

    in_namespace(task)
