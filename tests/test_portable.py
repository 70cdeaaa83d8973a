"""What does not exist on Windows, hidden: every module is importable without it, and what reads files works.

Only our own modules are kept from it: what others import is chosen by them, for the system they really run on.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
CAPTURE: Final = ROOT / "captures" / "item-errors.pcapng"
SCD: Final = ROOT / "captures" / "scd"

#: Run first in a process of its own.
HIDE: Final = """
import asyncio, builtins, io, os, signal, socket, subprocess, sys

HIDDEN = frozenset(("crypt", "curses", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource", "spwd", "syslog",
    "termios", "tty"))
real_import = builtins.__import__

def hiding_import(name, globals=None, locals=None, fromlist=(), level=0):
    asking = (globals or {}).get("__name__", "")
    if asking.split(".")[0] == "dissect" and name.split(".")[0] in HIDDEN:
        raise ModuleNotFoundError(f"No module named {name!r} (asked for by {asking})", name=name)
    return real_import(name, globals, locals, fromlist, level)

# What we build upon is imported before its own system loses anything.
import click, msgspec, rich.console, scapy.all, textual.app, textual.widgets, defusedxml.ElementTree, prometheus_client
import pyshark, pytest

ABSENT = {
    signal: ("SIGALRM", "SIGCHLD", "SIGCONT", "SIGHUP", "SIGIO", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGSTOP", "SIGTSTP",
        "SIGUSR1", "SIGUSR2", "SIGWINCH", "alarm", "pause", "pthread_kill", "pthread_sigmask", "setitimer", "sigwait"),
    os: ("O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "WNOHANG", "chown", "chroot", "fchmod", "fchown", "fork",
        "forkpty", "getegid", "geteuid", "getgid", "getgroups", "getloadavg", "getpgid", "getuid", "initgroups", "killpg",
        "mkfifo", "mknod", "nice", "openpty", "setegid", "seteuid", "setgid", "setgroups", "setpgid", "setsid", "setuid",
        "statvfs", "sysconf", "uname", "wait", "writev"),
    socket: ("AF_NETLINK", "AF_PACKET", "AF_UNIX", "CMSG_LEN", "MSG_DONTWAIT", "NETLINK_ROUTE", "SO_REUSEPORT"),
}
for module, names in ABSENT.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
builtins.__import__ = hiding_import
"""

IMPORT_ALL: Final = """
import importlib, pathlib, sys
import dissect

folder = pathlib.Path(dissect.__file__).parent
names = [path.relative_to(folder.parent).with_suffix("").parts for path in sorted(folder.rglob("*.py"))]
for parts in names:
    if parts[-1] not in ("__init__", "__main__"):
        importlib.import_module(".".join(parts))
print(len(names))
"""

#: Each command in a folder of its own; what it printed is written beside the folder.
RUN: Final = """
import contextlib, json, pathlib

from dissect.cli.main import main

for number, arguments in enumerate(json.loads(sys.argv[1])):
    folder = pathlib.Path(str(number))
    folder.mkdir()
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.chdir(folder), contextlib.redirect_stdout(out):
        try:
            main(arguments)
        except SystemExit as end:
            code = end.code
        out.flush()
    pathlib.Path(f"{number}.out").write_bytes(b"%d\\n" % code + out.buffer.getvalue())
"""

COMMANDS: Final[tuple[list[str | Path], ...]] = (
    ["analyze", CAPTURE],
    ["analyze", "-T", "json", CAPTURE],
    ["transactions", CAPTURE],
    ["transactions", "-T", "jsonl", CAPTURE],
    ["transactions", "-T", "csv", CAPTURE],
    ["operations", CAPTURE],
    ["show", "-V", CAPTURE],
    ["cut", CAPTURE, "-o", "part.pcapng", "--connection", "1"],
    ["anonymize", CAPTURE, "-o", "shared.pcapng", "--key", ROOT / "LICENSE"],
    ["golden", CAPTURE, "-o", "session.s7.txt"],
    ["diff", CAPTURE, ROOT / "captures" / "nodes7-poll-missing.pcapng"],
    ["baseline", CAPTURE, "-o", "plant.toml"],
    ["transactions", "--scd", SCD / "plant.toml", "--bind", SCD / "plant.bind.toml", SCD / "plant.pcapng"],
    ["scd", "compile", SCD / "plant.toml", "-o", "plant.scd"],
    ["analyze", "missing.pcapng"],
)


def python(program: str, *arguments: str | Path) -> subprocess.CompletedProcess[bytes]:
    """Run a program in which what Windows does not have is hidden from our modules."""
    return subprocess.run(
        [sys.executable, "-c", HIDE + program, *map(str, arguments)], capture_output=True, check=False, timeout=300
    )


def test_every_module_is_importable() -> None:
    ran = python(IMPORT_ALL)
    assert ran.returncode == 0, ran.stderr.decode()
    assert int(ran.stdout) > 200


def test_a_module_of_ours_would_fail() -> None:
    """What the other tests rest on."""
    statements = ["import fcntl", "from grp import getgrnam", "import signal; signal.SIGHUP", "import os; os.geteuid()"]
    program = f"""
for statement in {statements!r}:
    try:
        exec(statement, {{"__name__": "dissect.made"}})
    except (ModuleNotFoundError, AttributeError) as error:
        print(error)
"""
    ran = python(program)
    assert ran.stdout.decode().splitlines() == [
        "No module named 'fcntl' (asked for by dissect.made)",
        "No module named 'grp' (asked for by dissect.made)",
        "module 'signal' has no attribute 'SIGHUP'",
        "module 'os' has no attribute 'geteuid'",
    ]


def results(folder: Path) -> dict[str, bytes]:
    """Every file below a folder with what it holds."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_offline_commands_say_and_write_the_same(tmp_path: Path) -> None:
    """The output and the files of each are those of the same command on the whole system, byte for byte."""
    commands = json.dumps([[str(argument) for argument in command] for command in COMMANDS])
    seen = []
    for name, hide in (("hidden", HIDE), ("whole", "import io, sys\n")):
        folder = tmp_path / name
        folder.mkdir()
        ran = subprocess.run(
            [sys.executable, "-c", hide + RUN, commands], capture_output=True, check=False, cwd=folder, timeout=300
        )
        assert ran.returncode == 0, ran.stderr.decode()
        seen.append(results(folder))
    hidden, whole = seen
    for number, command in enumerate(COMMANDS):
        code, _, printed = hidden[f"{number}.out"].partition(b"\n")
        writes = "-o" in command
        assert code == (b"2" if "missing.pcapng" in command else b"1" if command[0] == "diff" else b"0"), command
        assert printed or writes or code == b"2", command
        assert any(name.startswith(f"{number}/") for name in hidden) == writes, command
    assert hidden.keys() == whole.keys()
    for name, held in whole.items():
        assert hidden[name] == held, f"{name}: {COMMANDS[int(name.split('/')[0].split('.')[0])]}"
