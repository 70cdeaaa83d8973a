"""Windows neither replaces, renames nor deletes a file that is open: no command that writes files needs it to.

What our modules see is what Windows has (tests/test_portable.py), and the functions of `os` refuse what Windows refuses, as far
as this process is concerned: a file that it holds open or mapped, a folder in which it does, a name to rename to that is taken.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.wire.build import COMPILED
from tests.test_portable import HIDE

ROOT: Final = Path(__file__).resolve().parent.parent
CAPTURE: Final = ROOT / "captures" / "item-errors.pcapng"
BLOCKS: Final = ROOT / "captures" / "blocks.pcapng"
SCD: Final = ROOT / "captures" / "scd"

#: Run behind `HIDE`, before a command.
REFUSE: Final = """
import pathlib
SEEN["os"].__dict__["name"] = "nt"
real = {name: getattr(os, name) for name in ("replace", "rename", "unlink", "remove", "rmdir")}
refused = []

def held():
    # what this process holds open, or mapped, which is open there as well
    found = set()
    for number in os.listdir("/proc/self/fd"):
        try:
            found.add(os.readlink(f"/proc/self/fd/{number}"))
        except OSError:
            pass
    with open("/proc/self/maps") as file:
        found.update(line.split(None, 5)[5].rstrip("\\n") for line in file if len(line.split(None, 5)) == 6)
    return found

def whole(path, folder=None):
    path = os.fspath(path)
    if folder is not None:
        path = os.path.join(os.readlink(f"/proc/self/fd/{folder}"), path)
    head, tail = os.path.split(os.path.abspath(path))
    return os.path.join(os.path.realpath(head), tail)

def refuse(call, path):
    name = whole(path)
    for one in held():
        if one == name or (os.path.isdir(name) and one.startswith(name + "/")):
            refused.append(f"{call} {name}")
            raise PermissionError(13, "The process cannot access the file because it is being used", name)

def moving(call):
    def move(source, target, **options):
        refuse(call, source)
        refuse(call, target)
        if call == "rename" and os.path.lexists(target):
            refused.append(f"rename onto {target}")
            raise FileExistsError(17, "Cannot create a file when that file already exists", os.fspath(target))
        return real[call](source, target, **options)
    return move

def removing(call):
    def remove(path, *, dir_fd=None):
        refuse(call, whole(path, dir_fd))
        return real[call](path, dir_fd=dir_fd)
    return remove

real_fsync = os.fsync
def fsync(descriptor):
    import fcntl
    if fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
        refused.append(f"fsync of {os.readlink(f'/proc/self/fd/{descriptor}')}, which is open for reading only")
        raise OSError(9, "Bad file descriptor")
    real_fsync(descriptor)
os.fsync = fsync

import shutil
shutil._use_fd_functions = False  # as there, where folders are not opened
for call in ("replace", "rename"):
    setattr(os, call, moving(call))
for call in ("unlink", "remove"):
    setattr(os, call, removing(call))
"""

#: Run twice in the same folder: the second run replaces what the first one wrote.
COMMANDS: Final[tuple[list[str | Path], ...]] = (
    ["monitor", "--plain", "-w", "ring", "-b", "filesize:1", "-b", "files:2", "--manifest", "--report", "pages", "-"],
    ["evidence", "verify", "../0/ring"],
    ["evidence", "export", "../0/ring", "-o", "incident", "--time", "2026-11-21"],
    ["cut", CAPTURE, "-o", "part.pcapng", "--connection", "1", "--force"],
    ["anonymize", CAPTURE, "-o", "shared.pcapng", "--key", ROOT / "LICENSE", "--force"],
    ["golden", CAPTURE, "-o", "session.s7.txt", "--force"],
    ["baseline", CAPTURE, "-o", "plant.toml"],
    ["baseline", CAPTURE, "--update", "../6/plant.toml"],
    ["scd", "compile", SCD / "plant.toml", "-o", "plant.scd", "--force"],
    ["report", CAPTURE, "-o", "report.html", "--force"],
    ["blocks", BLOCKS, "-o", "blocks"],
    ["open", CAPTURE, "-o", "comments.pcapng", "--force"],
    ["index", SCD],
    ["export", CAPTURE, "-o", "tables.csv", "--force"],
    ["export", CAPTURE, "-o", "tables.parquet", "--force"],
    ["export", CAPTURE, "-o", "tables.duckdb", "--force"],
    ["export", CAPTURE, "-o", "tables.sqlite", "--force"],
    ["export", CAPTURE, "-o", "tables.arrow", "--force"],
    ["export", CAPTURE, "-o", "zeek-json:logs", "--force"],
    ["export", CAPTURE, "-o", "findings.stix", "--force"],
    ["export", CAPTURE, "-o", "ecs:elastic", "--force"],
    ["export", "--separate", "-j", "2", "-o", "days.parquet", "--force", CAPTURE, BLOCKS],
    ["transactions", "--separate", "-j", "2", "-T", "jsonl", CAPTURE, BLOCKS],
)
#: What may end otherwise than with 0, by its command and whether it is its second run: what is there is not always replaced,
#: and of a ring of two small files the manifest names more.
OTHERWISE: Final = {
    ("baseline", True): {0, 2},
    ("evidence", False): {0, 1},
    ("evidence", True): {0, 1, 2},
}

#: What is tried again later (tests/files/recording/test_ring_buffer.py): a thread reads a file of the ring to hash it.
RETRIED: Final = re.compile(r"unlink .*/0/ring/s7dissect_\d+_\w+\.pcapng$")

#: Each command twice in a folder of its own; what it ended with, and what the system refused it.
RUN: Final = """
import contextlib, json
from dissect.cli.main import main

told = []
for number, arguments in enumerate(json.loads(sys.argv[1])):
    os.makedirs(str(number))
    for again in (False, True):
        before, code = len(refused), None
        with contextlib.chdir(str(number)), open("said", "w", encoding="utf-8") as out:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
                if arguments[-1] == "-":
                    os.dup2(os.open(sys.argv[2], os.O_RDONLY), 0)
                try:
                    main(arguments)
                except SystemExit as end:
                    code = end.code
        with open(f"{number}/said", encoding="utf-8") as out:
            told.append([arguments, again, code, refused[before:], out.read()])
print(json.dumps(told))
"""


def python(program: str, *arguments: str | Path, folder: Path) -> Any:
    ran = subprocess.run(
        [sys.executable, "-c", HIDE + REFUSE + program, *map(str, arguments)],
        capture_output=True,
        check=False,
        cwd=folder,
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr.decode()
    return json.loads(ran.stdout)


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_no_command_replaces_or_deletes_what_it_holds_open(tmp_path: Path) -> None:
    commands = json.dumps([[str(word) for word in command] for command in COMMANDS])
    told = python(RUN, commands, CAPTURE, folder=tmp_path)
    assert len(told) == 2 * len(COMMANDS)
    wrong = [
        (call, again, code, refused, said)
        for call, again, code, refused, said in told
        if [one for one in refused if not RETRIED.match(one)] or code not in OTHERWISE.get((call[0], again), {0})
    ]
    assert wrong == []


def test_what_is_open_is_refused(tmp_path: Path) -> None:
    """What the test above rests on."""
    program = """
import json, mmap
def tried(call, *names):
    try:
        call(*names)
    except OSError as error:
        return type(error).__name__
    return "done"
for name in ("a", "b", "c"):
    pathlib.Path(name).write_text("content")
os.mkdir("folder")
pathlib.Path("folder/d").write_text("content")
with open("a") as one, open("folder/d") as other:
    mapped = mmap.mmap(os.open("b", os.O_RDONLY), 0, prot=mmap.PROT_READ)
    told = [
        tried(os.replace, "c", "a"),
        tried(os.replace, "a", "new"),
        tried(pathlib.Path("a").unlink),
        tried(pathlib.Path("b").unlink),
        tried(pathlib.Path("folder").rename, "moved"),
        tried(shutil.rmtree, "folder"),
        tried(os.rename, "c", "b"),
    ]
told += [tried(os.replace, "c", "a"), tried(shutil.rmtree, "folder"), tried(os.rename, "a", "z")]
print(json.dumps([told]))
"""
    assert python(program, folder=tmp_path) == [
        [*["PermissionError"] * 7, "done", "done", "done"],
    ]
