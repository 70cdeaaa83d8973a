"""A small disk for a test: a tmpfs in a mount namespace, in a child process."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import pytest

from tests.conftest import ROOT

_APART: Final = [shutil.which("unshare") or "unshare", "--user", "--map-root-user", "--mount", "sh", "-c"]

#: The beginning of every script: FOLDER is the small disk, `fill` leaves this many octets free, `free` gives all back.
_BEGIN: Final = """
import json, os, sys
sys.path.append(os.getcwd())  # for the tests; the package is that of the run
from pathlib import Path
from dissect.online.live.problems import Problems
from dissect.packets.source.files import open_capture
from dissect.packets.source.live.reader import Drops
from tests.packets.source.craft import drain
FOLDER = Path(sys.argv[1])
BALLAST = FOLDER / "ballast"
NONE = Drops(0, 0)
TIME = 1_700_000_000_000_000_000

class Clock:
    now = 1000.0
    def __call__(self):
        return self.now

CLOCK = Clock()

def fill(left=0):
    with BALLAST.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            pass
    os.truncate(BALLAST, max(BALLAST.stat().st_size - left, 0))

def free():
    BALLAST.unlink()

def numbers():
    got = []
    for path in sorted(FOLDER.glob("*.pcapng*")):
        got += [int.from_bytes(frame.octets[:4], "big") for frame in drain(open_capture(str(path))).frames]
    return got

def octets(number):
    return number.to_bytes(4, "big") + bytes(96)
"""


def on_a_small_disk(folder: Path, kib: int, script: str) -> Any:
    """Run a script in which ``folder`` is a tmpfs of this many KiB; return what it passes to ``print(json.dumps(…))``."""
    mount = f'mount -t tmpfs -o size={kib}k none "$1" && shift && exec "$@"'
    if subprocess.run([*_APART, mount, "sh", folder, "true"], check=False, capture_output=True).returncode:
        pytest.skip("no small disk: mounting is not allowed here")
    ran = subprocess.run(
        [*_APART, mount, "sh", folder, sys.executable, "-c", _BEGIN + script, folder],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)
