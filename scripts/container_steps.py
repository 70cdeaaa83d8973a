"""Run the steps of a Containerfile in a temporary folder instead of a container, to check that they work.

    python scripts/container_steps.py            # docs/probe/Containerfile
    python scripts/container_steps.py analysis   # docs/container/Containerfile

Everything that .dockerignore does not exclude is copied. Every RUN line runs, with the paths of the image below the folder;
packages of the system are not installed or removed (setcap must be there), and the package is installed interpreted, because
`make environment` already shows, in minutes, that the sources compile. At the end the entry point runs as the image's user, if
this machine allows it (setpriv, root), and must succeed. The entry point of the probe only has CAP_NET_RAW, and listens with
its default command for a second on the loopback interface. That of the analysis has no capability and, if the kernel allows it,
no network: it analyzes a read-only capture, and writes a report and an export beside it.
"""

from __future__ import annotations

import fnmatch
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CONTAINERS = {
    "probe": ROOT / "docs" / "probe" / "Containerfile",
    "analysis": ROOT / "docs" / "container" / "Containerfile",
}
CAPTURE = ROOT / "captures" / "nodes7-poll-missing.pcapng"
BUILD = {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_NO_COMPILE": "1", "S7DISSECT_COMPILED": "0"}


def instructions(container: Path) -> list[tuple[str, str]]:
    lines = [
        line for line in container.read_text(encoding="utf-8").splitlines() if line.strip() and not line.startswith("#")
    ]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    return [(word, rest.strip()) for word, _, rest in (line.partition(" ") for line in joined.splitlines())]


def ignored(name: str) -> bool:
    """Return whether .dockerignore excludes a path; its patterns are simple enough to be read here as Docker reads them."""
    for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        parts = name.split("/")
        if line.startswith("**/"):
            if any(fnmatch.fnmatchcase(part, line[3:]) for part in parts):
                return True
        elif fnmatch.fnmatchcase(parts[0], line):
            return True
    return False


def copy_sources(target: Path) -> None:
    for path in sorted(ROOT.rglob("*")):
        name = path.relative_to(ROOT).as_posix()
        if path.is_file() and not ignored(name):
            place = target / name
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, place)
    assert (target / "pyproject.toml").is_file() and not (target / "tests").exists() and not (target / ".git").exists()
    needed = [path for path in (ROOT / "dissect").rglob("*") if path.is_file() and path.suffix != ".pyc"]
    needed += [ROOT / name for name in ("setup.py", "MANIFEST.in", "README.md", "LICENSE")]
    missing = [str(path) for path in needed if not (target / path.relative_to(ROOT)).is_file()]
    assert not missing, f".dockerignore leaves out what the build reads: {', '.join(missing)}"


def below(root: Path, text: str) -> str:
    """Return a line of the container file with its paths below ``root``."""
    for path in ("/opt/s7dissect", "/var/lib/s7dissect", "/usr/local/bin/python3.12", "/source"):
        text = text.replace(path, f"{root}{path}")
    return text


def run(root: Path, line: str) -> None:
    for command in [one.strip() for one in line.split("&&")]:
        if command.startswith(("apt-get", "rm -rf /var/lib/apt")):
            print(f"  left to the image: {command}")
            continue
        words = shlex.split(below(root, command))
        if words[0] == "python":
            words[0] = sys.executable
        print(f"  {shlex.join(words)}")
        subprocess.run(words, check=True, env={**os.environ, **BUILD})


def as_user(user: str, program: str, capabilities: str, namespace: tuple[str, ...] = ()) -> list[str]:
    """Return the words that run the program as the image does, empty if this machine does not allow it."""
    uid = user.partition(":")[0]
    words = [*namespace, "setpriv", f"--reuid={uid}", f"--regid={uid}", "--clear-groups", "--no-new-privs"]
    words += [f"--{kind}=-all{capabilities}" for kind in ("inh-caps", "ambient-caps", "bounding-set")]
    trial = subprocess.run([*words, program, "--version"], capture_output=True, check=False)
    if not trial.returncode:
        return words
    print(f"  not as {user}: {trial.stderr.decode().strip() or 'setpriv failed'}")
    return []


def probe(root: Path, found: dict[str, str]) -> None:
    words = [below(root, word) for word in (*json.loads(found["ENTRYPOINT"]), *json.loads(found["CMD"]))]
    words = ["lo" if word == "eth0" else "127.0.0.1:0" if word == "127.0.0.1:9102" else word for word in words]
    ran = subprocess.run(
        [*as_user(found["USER"], words[0], ",+net_raw"), *words, "--duration", "1"],
        cwd=root / "var" / "lib" / "s7dissect",
        env={**os.environ, "HOME": "/"},  # as for a user without an entry in the user database
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    print(ran.stderr, end="")
    if ran.returncode:
        sys.exit(f"the entry point ended with {ran.returncode}")
    assert json.loads(ran.stdout.splitlines()[-1])["event"] == "summary"


def analysis(root: Path, found: dict[str, str]) -> None:
    captures = root / "captures"
    captures.mkdir(mode=0o777)
    captures.chmod(0o777)
    shutil.copyfile(CAPTURE, captures / "trace.pcapng")
    (captures / "trace.pcapng").chmod(0o444)
    program = [below(root, word) for word in json.loads(found["ENTRYPOINT"])]
    without = ("unshare", "--net")
    user = as_user(found["USER"], program[0], "", without) or as_user(found["USER"], program[0], "")
    print(f"  {'without' if user[:1] == ['unshare'] else 'WITH'} a network")
    for arguments in (
        json.loads(found["CMD"]),
        ["analyze", "trace.pcapng"],
        ["report", "trace.pcapng", "-o", "report.html"],
        ["export", "trace.pcapng", "-o", "tables.parquet"],
    ):
        print(f"  s7dissect {shlex.join(arguments)}")
        words = [*user, *program, *arguments]
        environment = {**os.environ, "HOME": "/"}
        subprocess.run(words, cwd=captures, env=environment, check=True, timeout=120, stdout=subprocess.DEVNULL)
    assert (captures / "report.html").stat().st_size > 10_000
    assert list(captures.glob("tables*"))


def main() -> None:
    name = sys.argv[1] if sys.argv[1:] else "probe"
    steps = instructions(CONTAINERS[name])
    with tempfile.TemporaryDirectory(prefix="s7dissect-container-") as folder:
        root = Path(folder)
        root.chmod(0o755)
        (root / "usr" / "local" / "bin").mkdir(parents=True)
        shutil.copy2(Path(sys.executable).resolve(), root / "usr" / "local" / "bin" / "python3.12")
        for word, rest in steps:
            print(f"{word} {rest[:100]}")
            if word == "COPY" and rest.startswith(". "):
                copy_sources(root / "source")
            elif word == "RUN":
                run(root, rest)
        python = ["getcap", str(root / "usr" / "local" / "bin" / "python3.12")]
        capability = subprocess.run(python, capture_output=True, text=True, check=True)
        assert ("cap_net_raw=ep" in capability.stdout) == (name == "probe"), capability
        {"probe": probe, "analysis": analysis}[name](root, dict(steps))
    print("every step of the container file works")


if __name__ == "__main__":
    main()
