"""Every option of `monitor` that writes or sends, as root and as a user with CAP_NET_RAW: none needs what is given up."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from dissect.packets.source.live import privileges
from tests.conftest import ROOT
from tests.packets.source.live_support import in_namespace, needs_ring

needs_root = pytest.mark.skipif(not privileges.is_root(), reason="only root can give itself fewer rights")

#: Becomes nobody with CAP_NET_RAW, as a unit with AmbientCapabilities runs it, and runs the command.
AMBIENT = """
import ctypes, os, sys
library = ctypes.CDLL(None)
library.prctl(8, 1, 0, 0, 0)
os.setgroups([])
os.setresgid(65534, 65534, 65534)
os.setresuid(65534, 65534, 65534)
library.capset((ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)(1 << 13, 1 << 13, 1 << 13))
library.prctl(47, 2, 13, 0, 0)
os.execv(sys.executable, [sys.executable, "-m", "dissect", *sys.argv[1:]])
"""
#: Becomes nobody without any right, and runs the command by a Python whose file has the capability.
NOBODY = """
import os, sys
os.setgroups([])
os.setresgid(65534, 65534, 65534)
os.setresuid(65534, 65534, 65534)
os.execv(sys.argv[1], [sys.argv[1], "-m", "dissect", *sys.argv[2:]])
"""
#: Shows a Python in a folder that only root may enter to everybody, in a mount namespace of its own.
SHOWN = """
home=$1; top=/$(echo "$home" | cut -d/ -f2); spare=$2; shift 2
mount --bind "$home" "$spare" && mount -t tmpfs none "$top" && mkdir -p "$home" && mount --move "$spare" "$home" || exit 77
exec "$@"
"""
RULES = '[[rule]]\nname = "r"\nwhen = "problem"\n'

OPTIONS = {
    "plain": [],
    "ring": ["-w", "OUT", "-b", "filesize:10", "-b", "files:3", "--keep-free", "1K"],
    "manifest": ["-w", "OUT", "-b", "filesize:10", "--manifest"],
    "keep-around": ["-w", "OUT", "--keep-around", "error", "1s"],
    "export": ["--export", "parquet:OUT"],
    "report": ["--report", "OUT"],
    "alerts": ["--alerts", "RULES"],
    "metrics": ["--metrics", "127.0.0.1:0"],
    "baseline": ["--alerts", "RULES", "--baseline", "PLANT"],
    "several interfaces": ["-i", "lo"],
    "one file": ["-w", "OUT/one.pcapng"],
    "days": ["-w", "OUT", "-b", "filesize:10", "-b", "days:1", "-b", "total:100"],
    "all": ["-w", "OUT", "-b", "filesize:10", "--manifest", "--export", "parquet:OUT/t", "--report", "OUT/r", "--alerts",
            "RULES", "--metrics", "127.0.0.1:0"],
}  # fmt: skip


#: What is tried by a Python with a capability: the rest of its rights is that of a user with an ambient one.
WITH_FILE = ("plain", "export", "several interfaces", "all")


@pytest.fixture
def folder() -> Iterator[Path]:
    made = Path(tempfile.mkdtemp(prefix="s7dissect-rights-"))
    made.chmod(0o777)
    yield made
    shutil.rmtree(made)


def _shown(folder: Path) -> list[str]:
    """Return what precedes a command so that nobody may read this Python; nothing where he may."""
    home = Path(sys.base_prefix).resolve()
    if all([parent.stat().st_mode & 0o001 for parent in (home, *home.parents)]):
        return []
    (folder / "spare").mkdir()
    return ["unshare", "--mount", "sh", "-c", SHOWN, "sh", str(home), str(folder / "spare")]


def _capable(folder: Path) -> Path:
    """Return a copy of this Python whose file has CAP_NET_RAW."""
    setcap = shutil.which("setcap", path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
    if setcap is None:
        pytest.skip("setcap (libcap2-bin) is not installed")
    home = folder / "python"
    (home / "bin").mkdir(parents=True)
    python = home / "bin" / "python"
    shutil.copyfile(Path(sys.executable).resolve(), python)
    python.chmod(0o755)
    # As in a virtual environment: the library of the one that it was copied from.
    where = Path(sys.base_prefix).resolve() / "bin"
    (home / "pyvenv.cfg").write_text(f"home = {where}\ninclude-system-site-packages = false\n")
    made = subprocess.run([setcap, "cap_net_raw+ep", str(python)], capture_output=True, text=True, check=False)
    if made.returncode:
        pytest.skip(f"no file capabilities here: {made.stderr.strip()}")
    return python


@needs_ring
@needs_root
@pytest.mark.parametrize(
    ("options", "who"),
    [
        *[(options, who) for options in OPTIONS for who in ("root", "ambient")],
        *[(options, "file") for options in WITH_FILE],
    ],
)
def test_an_option_works_with_these_rights(options: str, who: str, folder: Path) -> None:
    (folder / "rules.toml").write_text(RULES, encoding="utf-8")
    out = folder / "out"
    out.mkdir()
    out.chmod(0o777)
    plant = folder / "plant.toml"
    if "PLANT" in OPTIONS[options]:
        from dissect.cli.main import main

        with pytest.raises(SystemExit) as made:
            main(["baseline", str(ROOT / "captures" / "nodes7-poll.pcapng"), "-o", str(plant)])
        assert made.value.code == 0
        plant.chmod(0o644)
    places = {"OUT": str(out), "RULES": str(folder / "rules.toml"), "PLANT": str(plant)}
    words = list(OPTIONS[options])
    for name, place in places.items():
        words = [word.replace(name, place) for word in words]
    arguments = ["monitor", "--plain", "-i", "vb", "--engine", "ring", "--duration", "0.5", *words]
    begin = [sys.executable, "-m", "dissect"]
    library = [str(ROOT)]
    if who == "ambient":
        begin = [*_shown(folder), sys.executable, "-c", AMBIENT]
    elif who == "file":
        begin = [*_shown(folder), sys.executable, "-c", NOBODY, str(_capable(folder))]
        library += [path for path in sys.path if path.endswith("site-packages")]

    def task() -> None:
        ran = subprocess.run(
            [*begin, *arguments],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(library),
                "HOME": str(folder),
                "XDG_STATE_HOME": str(folder),
            },
        )
        if ran.returncode == 77:
            pytest.skip("nobody may not read this Python, and it cannot be shown: mounting is not allowed here")
        assert (ran.returncode, "Traceback" in ran.stderr) == (0, False), ran.stderr
        assert "remain" not in ran.stderr

    in_namespace(task)
