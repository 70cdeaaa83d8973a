"""The programs in docs/examples run as a user runs them, and print what stands at their end."""

from __future__ import annotations

import os
import re
import runpy
import select
import socket
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from dissect.layers import COTP_CR, COTP_DT, S7, TPKT, COTP_Parameter, S7_ReadVarRequest, S7_Setup, at
from dissect.online.live import iterating
from dissect.testing.playback.server import Server
from tests.extras import hiding
from tests.test_sources import Line
from tests.testing.projects import PLUGIN

ROOT: Final = Path(__file__).resolve().parents[1]
FOLDER: Final = ROOT / "docs" / "examples"
PAGE: Final = ROOT / "docs" / "examples.md"
PROGRAMS: Final = {path.name: path.read_text(encoding="utf-8") for path in sorted(FOLDER.glob("*.py"))}
#: Programs that need something beside them: an interface, a PLC, pytest.
BESIDE: Final = {"live.py", "live_async.py", "proxy.py", "test_plant.py"}
#: A program that starts processes has to be a file.
SPAWNING: Final = {"pool.py", "spawned.py"}
#: The programs that end with another code than 0.
CODES: Final = {"findings.py": 1}
MOST_LINES: Final = 45


def output_of(text: str) -> list[str]:
    """Return the lines that a program says it prints."""
    _, _, shown = text.partition("\n# Output:\n")
    return [line.removeprefix("# ").removeprefix("#") for line in shown.splitlines()]


def test_the_page_lists_every_program_and_each_is_short() -> None:
    listed = re.findall(r"\(examples/(\w+\.py)\)", PAGE.read_text(encoding="utf-8"))
    assert sorted(listed) == list(PROGRAMS)
    assert len(listed) >= 25
    for name, text in PROGRAMS.items():
        code, _, _ = text.partition("\n# Output:\n")
        assert len(code.splitlines()) <= MOST_LINES, name
        assert (name in BESIDE) != ("\n# Output:\n" in text), name


def test_no_program_takes_the_name_of_a_module() -> None:
    """`python docs/examples/NAME.py` looks for modules in that folder first."""
    taken = {name.removesuffix(".py") for name in PROGRAMS}
    assert not taken & (sys.stdlib_module_names | {"dissect", "pandas", "pytest", "scapy"})


@pytest.mark.parametrize("name", [name for name in PROGRAMS if name not in BESIDE])
def test_a_program_prints_what_it_says(name: str) -> None:
    (row,) = re.findall(rf".*\(examples/{name}\).*", PAGE.read_text(encoding="utf-8"))
    run = f"runpy.run_path({str(FOLDER / name)!r}, run_name='__main__')"
    program = f"{hiding(row)}\nimport runpy, sys\nsys.path.insert(0, {str(FOLDER)!r})\n{run}\n"
    command = [sys.executable, str(FOLDER / name)] if name in SPAWNING else [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == CODES.get(name, 0), done.stderr
    printed, shown = [line.rstrip() for line in done.stdout.splitlines()], output_of(PROGRAMS[name])
    if shown[-1] == "…":
        assert len(printed) > len(shown) - 1
        printed, shown = printed[: len(shown) - 1], shown[:-1]
    assert printed == shown


@pytest.mark.parametrize("name", ["live.py", "live_async.py"])
def test_a_program_watches_an_interface(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = Line()
    monkeypatch.setattr(iterating, "open_live", lambda *_: line)
    monkeypatch.setattr(sys, "argv", [name, "eth0"])
    runpy.run_path(str(FOLDER / name), run_name="__main__")
    printed = capsys.readouterr().out
    assert "Read Var DB99.DBB0 x4" in printed
    assert ("26 packets, 3 lost" in printed) == (name == "live.py")
    assert line.closed


def test_a_program_relays_and_reports() -> None:
    with Server(ROOT / "captures" / "read-areas.pcapng") as plc:
        program = subprocess.Popen(
            [sys.executable, "-u", str(FOLDER / "proxy.py"), "127.0.0.1", str(plc.port)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert program.stdout is not None
            port = int(program.stdout.readline().rsplit(maxsplit=1)[1])
            _panel(port)
            assert program.stdout.readline().startswith("Setup communication")
            assert program.stdout.readline() == "Read Var DB1.DBB0 x3: answered, Object does not exist [None]\n"
            assert re.match(r"Connection\(1, .* 4 PDUs\)", program.stdout.readline())
        finally:
            program.kill()
            program.wait()
            if program.stdout is not None:
                program.stdout.close()


def _panel(port: int) -> None:
    """Connect, set up and read, as a panel does."""
    dt = TPKT() / COTP_DT()
    requests = (
        TPKT() / COTP_CR(parameters=[COTP_Parameter.calling("01.00"), COTP_Parameter.called("01.01")]),
        dt / S7(pdu_ref=1) / S7_Setup(pdu_length=480),
        dt / S7(pdu_ref=2) / S7_ReadVarRequest(items=[at("DB1.DBB0", 3)]),
    )
    with socket.create_connection(("127.0.0.1", port), timeout=30) as connection:
        for request in requests:
            connection.sendall(bytes(request))
            assert select.select([connection], [], [], 30)[0]
            assert connection.recv(1024)


def test_a_program_is_a_test(tmp_path: Path) -> None:
    (tmp_path / "captures").symlink_to(ROOT / "captures")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_plant.py").write_text(PROGRAMS["test_plant.py"], encoding="utf-8")
    bare = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    bare["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # what else is installed here
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *PLUGIN]
    for options, code, told in ([], 1, "4 passed"), (["--s7-update", "new"], 0, "5 passed"), ([], 0, "5 passed"):
        done = subprocess.run(
            [*command, *options], cwd=tmp_path, env=bare, capture_output=True, text=True, check=False, timeout=120
        )
        assert done.returncode == code, done.stdout
        assert told in done.stdout
