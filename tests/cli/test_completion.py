"""`s7dissect completion`: what it writes is what a shell needs, and works in one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.support import run

Capture = pytest.CaptureFixture[bytes]


def test_each_shell_has_its_script(capfdbinary: Capture) -> None:
    for shell in ("bash", "zsh", "fish"):
        ran = run(capfdbinary, "completion", shell)
        assert (ran.code, ran.err) == (0, "")
        assert f"_S7DISSECT_COMPLETE={shell}_complete" in ran.out
    ran = run(capfdbinary, "completion", "tcsh")
    assert (ran.code, ran.out) == (2, "")
    assert "'bash', 'zsh', 'fish'" in ran.err
    ran = run(capfdbinary, "completion")
    assert ran.err.endswith("Choose from:\n    bash,\n    zsh,\n    fish\n")


def test_bash_completes_by_it(capfdbinary: Capture, tmp_path: Path) -> None:
    script = tmp_path / "s7dissect.bash"
    script.write_text(run(capfdbinary, "completion", "bash").out, encoding="utf-8")
    bash = shutil.which("bash")
    assert bash is not None
    program = tmp_path / "s7dissect"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m dissect "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    asked = f"source {script}; COMP_WORDS=(s7dissect trans); COMP_CWORD=1; _s7dissect_completion s7dissect"
    environment = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    told = subprocess.run(
        [bash, "-c", f'{asked}; echo "${{COMPREPLY[@]}}"'],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert told.stdout.split() == ["transactions"]
