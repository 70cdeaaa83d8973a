"""Install from a bundle without a network, and use the installed package: ``python -m scripts.try_bundle BUNDLE.zip``.

The command is that of its README.txt, in a new environment, with no index and no settings of pip. If the machine allows it, all
of this runs in a network namespace without an interface; otherwise every proxy is an address that does not answer, and the
script says so. A bundle for another system is installed into a folder by pip's rules for that system.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

from scripts.bundle import pip
from scripts.bundle_target import Target

ROOT = Path(__file__).resolve().parent.parent
CAPTURE = ROOT / "captures" / "nodes7-poll-missing.pcapng"
#: Requests a connection, as pip would; it must fail.
REACH = "import socket; socket.create_connection(('192.0.2.1', 443), 2)"
#: Commands for the installed package: the last two need extras.
USES = (
    ("--version",),
    ("analyze", CAPTURE),
    ("report", CAPTURE, "-o", "report.html"),
    ("export", CAPTURE, "-o", "tables.parquet"),
)


def offline() -> dict[str, str]:
    """Return an environment in which pip knows no index, no settings and no way out."""
    nobody = "http://127.0.0.1:9"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "PYTHON"))}
    proxies = dict.fromkeys(("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY"), nobody)
    return {**kept, **proxies, "PIP_CONFIG_FILE": os.devnull, "PIP_NO_CACHE_DIR": "1"}


def unshared() -> list[str]:
    """Return the words that run a command in a namespace without a network, empty if the kernel refuses it."""
    words = ["unshare", "--map-root-user", "--net"]
    try:
        ran = subprocess.run([*words, sys.executable, "-c", REACH], capture_output=True, text=True, check=False)
    except OSError:
        return []
    return words if "Network is unreachable" in ran.stderr else []


def run(folder: Path, *words: str | Path) -> str:
    """Run a command; a failure ends this script."""
    ran = subprocess.run(
        list(map(str, words)), cwd=folder, env=offline(), capture_output=True, text=True, check=False, timeout=900
    )
    if ran.returncode:
        sys.exit(f"FAILED  {' '.join(map(str, words))}\n{ran.stdout}{ran.stderr}")
    return ran.stdout


def try_here(folder: Path, work: Path) -> None:
    """Install it on this system, as its README says, and run commands."""
    without = unshared()
    print(f"ok      {'a namespace without a network' if without else 'NO namespace: proxies that nobody answers at'}")
    venv.create(work / "env", with_pip=True)
    scripts = work / "env" / ("Scripts" if sys.platform == "win32" else "bin")
    told = re.search(r"python (-m pip install .*)", (folder / "README.txt").read_text("ascii"))
    assert told is not None, "README.txt has no command"
    print(f"        python {told[1]}", flush=True)
    run(folder, *without, scripts / "python", *told[1].split())
    count = len(list((work / "env").rglob("*.dist-info")))
    print(f"ok      {run(folder, *without, scripts / 'python', '-m', 'pip', 'check').strip()} ({count} packages)")
    for words in USES:
        said = run(work, *without, scripts / "s7dissect", *words).splitlines()
        print(f"ok      s7dissect {words[0]}: {said[0] if said else 'no line on stdout'}")


def try_there(folder: Path, work: Path, target: Target) -> None:
    """Install it into a folder as on another system; nothing there can be run."""
    into = (
        "--target",
        work / "there",
        "--no-compile",
        "--no-index",
        "--find-links",
        folder / "wheels",
        "--require-hashes",
    )
    fault = pip(target, "install", *into, "-r", folder / "requirements.txt", environment=offline())
    if fault:
        sys.exit(f"FAILED  pip install for {target.name}: {fault}")
    count = len(list((work / "there").glob("*.dist-info")))
    wheels = len(list((folder / "wheels").iterdir()))
    if count != wheels:
        sys.exit(f"FAILED  of {wheels} wheels {count} were installed")
    print(f"ok      all {count} wheels install by the rules of {target.name}; nothing was run there")


def main() -> None:
    packed = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory(prefix="s7dissect-bundle-") as name:
        work = Path(name)
        with zipfile.ZipFile(packed) as archive:
            archive.extractall(work)
        folder = work / packed.stem
        told = re.fullmatch(r"s7dissect-[^-]+-(\w+)-cp3(\d+)", packed.stem)
        assert told is not None, packed.stem
        python = f"3.{told[2]}"
        here = Target("", "{}.{}".format(*sys.version_info))
        if packed.stem.endswith(f"-{here.name}"):
            try_here(folder, work)
        else:
            try_there(folder, work, Target(told[1], python))


if __name__ == "__main__":
    main()
