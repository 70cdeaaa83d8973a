"""What holds for every command: where results and complaints go, what the exit codes are, how an output ends."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

import pytest

from tests.cases import each
from tests.cli.support import run, simple
from tests.cli.test_outputs import commands, lines_of, object_of
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]
TRANSFER: Final = str(ROOT / "captures" / "transfer.pcapng")
SZL: Final = str(ROOT / "captures" / "szl.pcapng")
PLANT: Final = str(ROOT / "captures" / "scd" / "plant.toml")
#: A call of every command that writes something to standard output.
WRITING: Final = """
completion fish
help live
analyze TRANSFER
analyze TRANSFER -T json
transactions TRANSFER
transactions TRANSFER -T csv
values WRITES
values WRITES --summary -T csv
operations TRANSFER -T jsonl
report TRANSFER -o -
blocks TRANSFER
blocks TRANSFER -T csv
blocks --code TRANSFER
devices TRANSFER
devices TRANSFER -T csv
show TRANSFER -V
show TRANSFER -T jsonl
cut TRANSFER -o -
extcap --extcap-interfaces
anonymize TRANSFER -o -
baseline TRANSFER
sql interventions TRANSFER
sql talkers TRANSFER -T csv
golden TRANSFER
diff TRANSFER SZL
diff TRANSFER SZL -T json
diff TRANSFER SZL -T junit
monitor TRANSFER
monitor TRANSFER -T jsonl
index FOLDER
index FOLDER -T json
interfaces
interfaces -T json
replay TRANSFER --dry-run
schema
schema analysis
fields
tags check TAGS
tags list TAGS -T json
tags convert TAGS -o -
scd dump PLANT
scd check PLANT
scd compile PLANT -o -
scd diff PLANT PLANT
scd decode -d PLANT --pdo T2 C1AB24FA
scd encode -d PLANT --value 0x6001 raw:5
"""
#: Calls that cannot be carried out.
WRONG: Final = """
analyze MISSING -T json
transactions MISSING -T jsonl
values MISSING -T jsonl
operations MISSING -T jsonl
report MISSING -o -
devices MISSING -T json
show MISSING -T jsonl
monitor MISSING -T jsonl
diff TRANSFER MISSING -T json
diff MISSING TRANSFER -T junit
replay MISSING --to 127.0.0.1:9 -T json
replay TRANSFER --dry-run -T json
verify MISSING -T json
anonymize MISSING -o - -T json
sql talkers MISSING
export MISSING -o csv:OUT
golden MISSING
cut MISSING -o -
open MISSING -o OUT.pcapng
baseline MISSING
serve MISSING
scd check MISSING -T json
scd diff MISSING PLANT -T json
scd dump MISSING
scd decode -d MISSING --pdo T1 00
"""
_FOLDER: Final = tempfile.TemporaryDirectory()
shutil.copy(SZL, _FOLDER.name)
FILES: Final = {
    "TAGS": str(ROOT / "captures" / "tags" / "valve.csv"),
    "WRITES": str(ROOT / "captures" / "nodes7-write.pcapng"),
    "FOLDER": _FOLDER.name,
    "TRANSFER": TRANSFER,
    "SZL": SZL,
    "PLANT": PLANT,
}


def calls(text: str) -> list[list[str]]:
    """Return calls written one a line, with the files put in."""
    return [[FILES.get(word, word) for word in line.split()] for line in text.split("\n") if line]


#: Runs calls one after the other, each in a process of its own made of this one, and writes [exit code, stderr] of each.
#: What they import is imported once.
RUNNER: Final = """
import json, os, sys, tempfile
import dissect.online.alerts, dissect.files.anonymize.rewriter, dissect.files.anonymize.survey, dissect.output.baseline
import dissect.testing.golden.reading
import dissect.online.live.lines, dissect.online.live.session, dissect.files.recording.cutter, dissect.testing.playback.client
import dissect.meaning.report.tree
import dissect.scd.codec, dissect.scd.loading, dissect.packets.source.live.opening
from dissect.cli.main import COMMANDS, group, main
for name in COMMANDS:
    group.get_command(None, name)
calls, outputs = json.loads(sys.argv[1]), json.loads(sys.argv[2])
told = [[] for output in outputs]
for call, output, of in [(call, output, of) for output, of in zip(outputs, told) for call in calls]:
    with tempfile.TemporaryFile() as err:
        child = os.fork()
        if not child:
            os.dup2(output, 1)
            os.dup2(err.fileno(), 2)
            try:
                main(call)
            except SystemExit as end:
                sys.stderr.flush()
                os._exit(int(end.code or 0))
            os._exit(99)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        err.seek(0)
        of.append([code, err.read().decode()])
print(json.dumps(told))
"""
FULL: Final = Path("/dev/full")


@pytest.fixture(scope="module")
def told() -> list[list[tuple[int, str]]]:
    """Exit code and standard error of each call: into a pipe that nobody reads and, where there is one, onto a full disk."""
    reader, writer = os.pipe()
    os.close(reader)
    outputs = [writer, *([os.open(FULL, os.O_WRONLY)] if FULL.exists() else [])]
    try:
        ran = subprocess.run(
            [sys.executable, "-c", RUNNER, json.dumps(calls(WRITING)), json.dumps(outputs)],
            pass_fds=outputs, capture_output=True, check=True, timeout=240,
        )  # fmt: skip
    finally:
        for output in outputs:
            os.close(output)
    return [[(code, err) for code, err in of] for of in json.loads(ran.stdout)]


def test_a_closed_pipe_is_quiet_for_every_command(told: list[list[tuple[int, str]]]) -> None:
    for call, (code, err) in zip(calls(WRITING), told[0], strict=True):
        assert (code, err) == (0, ""), call


@pytest.mark.skipif(not FULL.exists(), reason="needs a device that is always full")
def test_a_full_disk_is_told_by_every_command(told: list[list[tuple[int, str]]]) -> None:
    for call, (code, err) in zip(calls(WRITING), told[1], strict=True):
        assert (code, err) == (5, "s7dissect: cannot write the results: No space left on device\n"), call


def test_every_command_says_its_exit_codes() -> None:
    table = (
        (ROOT / "docs" / "commands.md").read_text(encoding="utf-8").split("## Exit codes", 1)[1].split("\n## ", 1)[0]
    )
    known = set(re.findall(r"^\| (\d+) \|", table, re.MULTILINE))
    assert known == {"0", "1", "2", "3", "5", "130"}
    for name, command in commands().items():
        (told,) = [text for text in (command.epilog or "").split("\n\n") if text.startswith("Exit code: 0 ")]
        codes = re.findall(r"(?:^|[,;:] )(?:and )?(\d+) (?=[a-z])", told)
        assert set(codes) <= known, name
        assert {"0", "2"} <= set(codes), name
        assert codes == sorted(codes, key=int), name


@each("call", calls(WRONG))
def test_what_cannot_be_read_is_code_2_and_nothing_on_stdout(
    capfdbinary: Capture, tmp_path: Path, call: list[str]
) -> None:
    ran = run(capfdbinary, *[str(tmp_path / "missing.pcapng") if word == "MISSING" else word for word in call])
    assert (ran.code, ran.out) == (2, "")
    assert ran.err
    if "MISSING" in call:
        assert "missing.pcapng" in ran.err


# ---- with warnings --------------------------------------------------------------------------------------------------


@pytest.fixture
def cut(tmp_path: Path) -> Path:
    """A capture that ends within a packet."""
    path = simple(tmp_path / "cut.pcapng")
    path.write_bytes(path.read_bytes()[:-5])
    return path


@pytest.mark.parametrize("command", ["transactions", "operations", "show", "monitor"])
def test_lines_stay_whole_beside_a_warning(capfdbinary: Capture, cut: Path, command: str) -> None:
    ran = run(capfdbinary, command, cut, "-T", "jsonl")
    assert lines_of(ran, (3,)) != []
    assert "cut.pcapng: cut off" in ran.err


def test_an_object_stays_whole_beside_a_warning(capfdbinary: Capture, cut: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.pcapng"
    ran = run(capfdbinary, "analyze", cut, "-T", "json")
    assert "cut off" in object_of(ran, (3,))["files"][0]["damage"]
    assert "cut.pcapng: cut off" in ran.err
    ran = run(capfdbinary, "anonymize", cut, "-o", out, "-T", "json")
    assert object_of(ran, (3,))["written"] > 0
    assert "cut.pcapng: cut off" in ran.err
    for pair in ((cut, TRANSFER), (TRANSFER, cut)):
        ran = run(capfdbinary, "diff", *pair, "-T", "json")
        assert "cut off" in object_of(ran, (2,))["damage"][0]
        assert "cut.pcapng: cut off" in ran.err


def test_a_failed_gate_leaves_the_output_alone(capfdbinary: Capture, tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    for command in ("transactions", "operations", "show", "monitor"):
        ran = run(capfdbinary, command, path, "-T", "jsonl", "--fail-on", "note")
        assert lines_of(ran, (1,)) != []
        assert "--fail-on: transaction.item_error (1)" in ran.err
    ran = run(capfdbinary, "analyze", path, "-T", "json", "--fail-on", "note")
    assert object_of(ran, (1,))["findings"] == {"transaction.item_error": 1}


def test_the_account_of_an_anonymization_never_mixes_with_the_capture(capfdbinary: Capture, tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "dissect", "anonymize", simple(tmp_path / "a.pcapng"), "-o", "-", "-T", "json"],
        capture_output=True, check=True, timeout=60,
    )  # fmt: skip
    assert ended.stdout.startswith(b"\x0a\x0d\x0d\x0a")
    assert json.loads(ended.stderr)["written"] > 0
