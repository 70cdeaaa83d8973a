"""What does not exist on Windows, hidden: every module is importable without it, and what reads files works.

Only our own modules are kept from it: what others import is chosen by them, for the system they really run on.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parent.parent
CAPTURE: Final = ROOT / "captures" / "item-errors.pcapng"
SCD: Final = ROOT / "captures" / "scd"

#: Run first in a process of its own.
HIDE: Final = """
import asyncio, builtins, io, mmap, os, select, signal, socket, subprocess, sys, types

HIDDEN = frozenset(("crypt", "curses", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource", "spwd", "syslog",
    "termios", "tty"))
real_import = builtins.__import__

class Seen:
    # a module as our modules see it there; what Python's own need of it stays

    def __init__(self, module, lacks=(), **has):
        self.__dict__.update(_module=module, _lacks=lacks, **has)

    def __getattr__(self, name):
        if name in self._lacks:
            raise AttributeError(f"module {self._module.__name__!r} has no attribute {name!r}")
        return getattr(self._module, name)

    def __setattr__(self, name, value):
        setattr(self._module, name, value)

msvcrt = types.ModuleType("msvcrt")
msvcrt.LK_NBLCK = 2
msvcrt.locking = lambda descriptor, mode, size: os.lockf(descriptor, os.F_TLOCK, size)

SEEN = {
    "sys": Seen(sys, platform="win32"),
    "signal": Seen(signal, ("SIGALRM", "SIGCHLD", "SIGCONT", "SIGHUP", "SIGIO", "SIGPIPE", "SIGQUIT", "SIGSTOP", "SIGTSTP",
        "SIGUSR1", "SIGUSR2", "SIGWINCH", "alarm", "pause", "pthread_kill", "pthread_sigmask", "setitimer", "sigwait")),
    "os": Seen(os, ("O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "WNOHANG", "chown", "chroot", "fchmod",
        "fchown", "fork", "forkpty", "getegid", "geteuid", "getgid", "getgroups", "getloadavg", "getpgid", "getuid",
        "initgroups", "killpg",
        "mkfifo", "mknod", "nice", "openpty", "setegid", "seteuid", "setgid", "setgroups", "setpgid", "setsid", "setuid",
        "sched_getaffinity", "statvfs", "sysconf", "uname", "wait", "writev")),
    "socket": Seen(socket, ("AF_NETLINK", "AF_PACKET", "AF_UNIX", "CMSG_LEN", "MSG_DONTWAIT", "NETLINK_ROUTE", "SO_REUSEPORT")),
    "select": Seen(select, ("POLLERR", "POLLHUP", "POLLIN", "epoll", "poll")),
    "mmap": Seen(mmap, ("MAP_SHARED", "PROT_READ")),
    "msvcrt": msvcrt,
}

def hiding_import(name, globals=None, locals=None, fromlist=(), level=0):
    asking = (globals or {}).get("__name__", "")
    if asking.split(".")[0] == "dissect":
        if name.split(".")[0] in HIDDEN:
            raise ModuleNotFoundError(f"No module named {name!r} (asked for by {asking})", name=name)
        if name in SEEN:
            return SEEN[name]
    return real_import(name, globals, locals, fromlist, level)

# What we build upon is imported before its own system loses anything.
import click, msgspec, rich.console, scapy.all, textual.app, textual.widgets, defusedxml.ElementTree, prometheus_client
import pyshark, pytest

subprocess.CREATE_NEW_PROCESS_GROUP = 0x200
signal.CTRL_BREAK_EVENT = 1
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
        if arguments[-1] == "-":
            os.dup2(os.open(sys.argv[2], os.O_RDONLY), 0)
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
    ["values", CAPTURE],
    ["devices", CAPTURE],
    ["report", CAPTURE, "-o", "report.html"],
    ["export", CAPTURE, "-o", "tables.csv"],
    ["monitor", "--plain", "-"],
    ["open", CAPTURE, "-o", "comments.pcapng"],
    ["schema"],
    ["fields"],
)

#: What only other systems can do, and what is said of it here.
REFUSED: Final = {
    "monitor -i lo --engine ring": "s7dissect: the ring needs Linux",
    "monitor -i lo --engine ring -Z nobody": "Error: -Z USER: only root can become another user.",
}


def python(program: str, *arguments: str | Path) -> subprocess.CompletedProcess[bytes]:
    """Run a program in which what Windows does not have is hidden from our modules."""
    return subprocess.run(
        [sys.executable, "-c", HIDE + program, *map(str, arguments)], capture_output=True, check=False, timeout=300
    )


def test_every_module_is_importable() -> None:
    ran = python(IMPORT_ALL)
    assert ran.returncode == 0, ran.stderr.decode()
    assert int(ran.stdout) > 200


@pytest.mark.parametrize("command", REFUSED)
def test_one_line_says_what_this_system_cannot_do(command: str) -> None:
    program = "from dissect.cli.main import main\nmain(sys.argv[1:])\n"
    ran = python(program, *command.split())
    assert ran.returncode == 2
    assert REFUSED[command] in ran.stderr.decode().splitlines(), ran.stderr.decode()


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
    for name, hide in (("hidden", HIDE), ("whole", "import io, os, sys\n")):
        folder = tmp_path / name
        folder.mkdir()
        ran = subprocess.run(
            [sys.executable, "-c", hide + RUN, commands, CAPTURE],
            capture_output=True,
            check=False,
            cwd=folder,
            timeout=300,
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
