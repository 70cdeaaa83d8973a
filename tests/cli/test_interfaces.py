"""`s7dissect interfaces`: with rights, without them, and without dumpcap."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from dissect.packets.source.live import ring
from tests.cli.support import run
from tests.conftest import ROOT

SCHEMA = json.loads((ROOT / "dissect" / "meaning" / "schema" / "interfaces.schema.json").read_text(encoding="utf-8"))


def without_rights(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command as somebody who may not open a packet socket."""
    if shutil.which("setpriv") is None:
        pytest.skip("no setpriv (util-linux) to give up the right to capture with")
    dropped = ["setpriv", "--no-new-privs"]  # nor does dumpcap get any
    if ring.trouble() is None:
        dropped += ["--bounding-set=-all", "--inh-caps=-all"]
    return subprocess.run(
        [*dropped, sys.executable, "-m", "dissect", "interfaces", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.skipif(ring.trouble() is not None, reason=f"no packet socket here: {ring.trouble()}")
def test_who_may_capture(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    ran = run(capfdbinary, "interfaces")
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert lines[0].split() == ["INTERFACE", "STATE", "LINK", "CAPTURE", "WITH", "ADDRESSES"]
    lo = next(line for line in lines if line.startswith("lo "))
    assert "ring" in lo
    assert "127.0.0.1/8" in lo


def test_json(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    ran = run(capfdbinary, "interfaces", "-T", "json")
    told = json.loads(ran.out)
    Draft202012Validator(SCHEMA).validate(told)
    assert [engine["name"] for engine in told["engines"]] == ["dumpcap", "ring"]
    assert {"lo"} <= {one["name"] for one in told["interfaces"]}


def test_advice_without_rights() -> None:
    ran = without_rights()
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "ring cannot capture: the ring: no permission to capture" in ran.stdout
    lo = next(line for line in ran.stdout.splitlines() if line.startswith("lo "))
    assert "-" in lo.split()  # the column CAPTURE WITH
    if os.geteuid() == 0:
        assert "--cap-add=NET_RAW" in ran.stdout


def test_json_without_rights() -> None:
    ran = without_rights("-T", "json")
    told = json.loads(ran.stdout)
    Draft202012Validator(SCHEMA).validate(told)
    assert not any(engine["usable"] for engine in told["engines"])
    assert all(engine["reason"] and engine["advice"] for engine in told["engines"])
    assert all(one["engines"] == [] for one in told["interfaces"])


def test_without_dumpcap(
    capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    ran = run(capfdbinary, "interfaces")
    assert (ran.code, ran.err) == (0, "")
    assert "dumpcap cannot capture: dumpcap (of Wireshark) is not installed\n    install it: sudo apt" in ran.out


def test_hostile_names_are_escaped(
    capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    program = tmp_path / "dumpcap"
    program.write_text("#!/bin/sh\nprintf '1. a\\033[2Jb\\t\\t\\t0\\t1.2.3.4\\tnetwork\\t\\n'\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delattr("socket.AF_NETLINK")
    ran = run(capfdbinary, "interfaces")
    assert ran.code == 0
    assert "a\\x1b[2Jb" in ran.out
    assert "\x1b" not in ran.out
