"""Promise G13: the same input gives the same octets, whatever hash seed, time zone, language and folder, and however it comes.

The analysing commands are held to that in tests/cli/test_drive.py and tests/properties/test_captures.py; here are all others,
each run twice.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.meaning.report.schemas import ROOT

CAPTURES: Final = ROOT / "captures"
#: One with operations and blocks, one with many connections, one with holes and one with a password, in this order.
ONE: Final = CAPTURES / "transfer.pcapng"
TWO: Final = CAPTURES / "two-clients.pcapng"
PLANT: Final = ("--scd", str(CAPTURES / "scd" / "plant.toml"), "--bind", str(CAPTURES / "scd" / "plant.bind.toml"))
CALLS: Final = [
    ["analyze", "-T", "json", str(ONE), str(TWO)],
    ["transactions", str(TWO)],
    ["operations", "-T", "jsonl", str(ONE)],
    ["values", "-T", "jsonl", str(TWO)],
    ["values", "--summary", str(TWO)],
    ["devices", str(ONE), str(TWO)],
    ["devices", "-T", "csv", str(TWO)],
    ["show", "-V", str(ONE)],
    ["golden", str(ONE), str(TWO)],
    ["golden", "--with", "time,addresses,refs,latency", str(TWO)],
    ["golden", *PLANT, str(CAPTURES / "scd" / "plant.pcapng")],
    ["golden", str(TWO), "-o", "OUT", "--force"],
    ["diff", str(ONE), str(TWO), "--max", "9999"],
    ["diff", str(ONE), str(TWO), "-T", "json"],
    ["diff", str(ONE), str(TWO), "-T", "junit"],
    ["baseline", str(ONE), str(TWO)],
    ["anonymize", str(ONE), "-o", "OUT", "--key", "KEY", "--force"],
    [
        "anonymize",
        str(TWO),
        "-o",
        "OUT",
        "--key",
        "KEY",
        "--force",
        "--values",
        "scramble",
        "--shift-time",
        "-T",
        "json",
    ],
    ["cut", str(TWO), "-o", "OUT", "--force", "--connection", "2"],
    ["monitor", "-T", "jsonl", "--only", "transactions,operations,findings,connections", str(TWO)],
    ["replay", str(TWO), "--dry-run"],
    ["scd", "compile", PLANT[1], "-o", "OUT", "--force"],
    ["scd", "dump", PLANT[1]],
    ["schema", "analysis"],
]

#: Runs each call twice in one process, and writes a digest of what it told and wrote.
_PROGRAM: Final = """
import contextlib, hashlib, io, json, os, sys
from dissect.cli.main import main
digests = []
for call in json.loads(sys.argv[1]):
    for _ in range(2):
        if os.path.lexists("OUT"):
            os.unlink("OUT")
        told = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
        sys.stdout = told
        try:
            main(call)
        except SystemExit as end:
            code = end.code
        sys.stdout = sys.__stdout__
        written = open("OUT", "rb").read() if os.path.exists("OUT") else b""
        digests.append([code, len(told.buffer.getvalue()), hashlib.sha256(told.buffer.getvalue()).hexdigest(),
                        len(written), hashlib.sha256(written).hexdigest()])
print(json.dumps(digests))
"""
ENVIRONMENTS: Final = (
    {"PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C.UTF-8"},
    {"PYTHONHASHSEED": "1", "TZ": "Asia/Kathmandu", "LC_ALL": "C", "LANG": "C"},
    {"PYTHONHASHSEED": "random", "TZ": "America/St_Johns", "LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"},
)


def test_the_same_octets_everywhere(tmp_path: Path) -> None:
    running = []
    for number, environment in enumerate(ENVIRONMENTS):
        folder = tmp_path / str(number) / ("x" * number)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "KEY").write_bytes(b"the same key for all of them")
        (folder / "KEY").chmod(0o600)
        running.append(
            subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, json.dumps(CALLS)],
                cwd=folder,
                env={**os.environ, **environment},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
    told = []
    for process in running:
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0, err
        told.append(json.loads(out))
    for at, call in enumerate(CALLS):
        found = {json.dumps(each[2 * at + again]) for each in told for again in (0, 1)}
        assert len(found) == 1, call
        code, size, _, written, _ = json.loads(found.pop())
        assert code in {0, 1}, call
        assert size + written > 0, call
        assert (written > 0) == ("OUT" in call), call


@pytest.mark.parametrize("call", [["golden"], ["operations"]], ids=" ".join)
def test_a_file_a_pipe_and_a_compressed_file(tmp_path: Path, call: list[str]) -> None:
    octets = TWO.read_bytes()
    (tmp_path / "b.gz").write_bytes(gzip.compress(octets))
    digests = set()
    for name, given in ((str(TWO), b""), ("b.gz", b""), ("-", octets), ("-", gzip.compress(octets))):
        ran = subprocess.run(
            [sys.executable, "-m", "dissect", *call, name], cwd=tmp_path, input=given, capture_output=True, check=True
        )
        assert len(ran.stdout) > 200
        digests.add(hashlib.sha256(ran.stdout).hexdigest())
    assert len(digests) == 1
