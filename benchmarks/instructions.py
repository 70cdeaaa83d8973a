"""Did a change make the engine slower? ``python -m benchmarks.instructions`` counts the instructions of the processor.

They are counted by valgrind, with fixed hashes: a busy machine counts the same as an idle one, every time. Compilers translate
the source differently, so numbers are recorded (``--record``) for each combination of Python, compiler of the engine, and
build. A count of an idle Python shows whether Python itself is the recorded one.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

from benchmarks.generate import generate
from benchmarks.links import KINDS, twin
from benchmarks.multiply import multiply
from benchmarks.tables import columns

if TYPE_CHECKING:
    from collections.abc import Sequence

RECORDED: Final = Path(__file__).with_name("instructions.json")
#: A ratio to the recorded number above this is too high: for a packet, and for a start, which other packages influence.
MOST: Final = {"analyze": 1.05, "transactions": 1.05, "s7plus": 1.05, "plain": 1.05, "start": 1.10}
#: A packet of ``analyze`` over another link (of `benchmarks.links`) may cost this many times a packet of ``plain``.
MOST_OF_LINKS: Final = {
    "vlan": 1.15,
    "qinq": 1.18,
    "ipv6": 1.32,
    "cooked": 1.05,
    "cooked_2": 1.05,
    "raw": 1.05,
    "pcapng": 1.12,
}
#: Python itself may differ by this share from the recorded one.
SAME: Final = 0.02
#: Number of packets of the capture that is read, and of its copies in the longer one.
PACKETS: Final = 3000
COPIES: Final = 3
COMMANDS: Final = {"analyze": ["analyze"], "transactions": ["transactions", "-T", "jsonl"]}
#: The capture with S7comm-plus for ``analyze``, and the number of its copies in the shorter one: sessions of a panel and of an
#: engineering tool, with subscriptions, polling, a download and a stop.
PLUS: Final = Path(__file__).parents[1] / "captures/crafted/plus-plant.pcapng"
PLUS_COPIES: Final = 25

_COUNTING: Final = ("--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null")
_COUNTED: Final = re.compile(rb"I\s+refs:\s+([\d,]+)")
_COMPILER: Final = re.compile(rb"GCC: \([^)]*\) (\d+)")


#: One process that imports and reads once, and copies of it, each of which reads one capture: most instructions of a command
#: are those of its start, and valgrind is slow with code that runs once. A copy is counted from the beginning of its original
#: process. Prints "NAME PROCESS" for each copy that ended well; its argument has the calls of the copies by name.
_MOTHER: Final = """
import json, os, sys
said, calls = os.fdopen(os.dup(1), "w", buffering=1), json.loads(sys.argv[1])
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
def run(call):
    from dissect.__main__ import main
    sys.argv[1:] = call
    try:
        main()
    except SystemExit as end:
        sys.stdout.flush()
        return end.code
def copy(name, call):
    process = os.fork()
    if not process:
        os._exit(run(call) if call else 0)
    if os.waitpid(process, 0)[1] == 0:
        print(name, process, file=said)
copy("python", [])
run(calls["analyze once"])
copy("start", [])
run(calls["transactions once"])
for name, call in calls.items():
    copy(name, call)
"""


def instructions(arguments: Sequence[str | Path]) -> int:
    """Return the instructions of a process of this Python. Raises RuntimeError if it fails or cannot be counted."""
    command = ["valgrind", *_COUNTING, sys.executable, *map(str, arguments)]
    done = _ran(command)
    found = _COUNTED.search(done.stderr)
    if done.returncode or found is None:
        message = f"{arguments[0]} … ended with code {done.returncode}: {done.stderr[-500:].decode(errors='replace')}"
        raise RuntimeError(message)
    return _number(found)


def copies(calls: dict[str, list[str]], folder: Path) -> dict[str, int]:
    """Return the instructions of each copy of `_MOTHER`. Raises RuntimeError if one fails or cannot be counted."""
    command = [
        "valgrind",
        *_COUNTING,
        f"--log-file={folder}/counted.%p",
        sys.executable,
        "-c",
        _MOTHER,
        json.dumps(calls),
    ]
    done = _ran(command)
    processes = dict(line.rsplit(" ", 1) for line in done.stdout.decode().splitlines())
    counted = {}
    for name in ("python", "start", *calls):
        process = processes.get(name)
        found = _COUNTED.search((folder / f"counted.{process}").read_bytes()) if process else None
        if found is None:
            message = f"{name}: not counted: {done.stderr[-500:].decode(errors='replace')}"
            raise RuntimeError(message)
        counted[name] = _number(found)
    return counted


def _number(found: re.Match[bytes]) -> int:
    return int(found[1].replace(b",", b""))


def _ran(command: Sequence[str]) -> subprocess.CompletedProcess[bytes]:
    """Run the installed package, not the tree that may be the current folder."""
    environment = {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C.UTF-8"}
    return subprocess.run(command, env=environment, capture_output=True, check=False)


def combination() -> str:
    """Return the combination under which numbers are recorded; empty if the engine is not compiled by gcc."""
    told = _ran([sys.executable, "-c", "import dissect; print(dissect.__file__)"]).stdout.decode().strip()
    library = next(Path(told).parents[1].glob("s7dissect__mypyc.*"), None) if told else None
    found = _COMPILER.search(library.read_bytes()) if library is not None else None
    if found is None:
        return ""
    build = "release" if os.environ.get("S7DISSECT_RELEASE") == "1" else "checkout"
    python = f"{platform.python_implementation()} {sys.version_info[0]}.{sys.version_info[1]}"
    return f"{python}, gcc {found[1].decode()}, {sysconfig.get_platform()}, {build}"


def interpreter() -> int:
    """Return the number of instructions of a Python that does nothing."""
    return instructions(["-I", "-S", "-c", "pass"])


def measure(folder: Path) -> dict[str, int]:
    """Return the instructions per packet for each command, and for a start without Python's; captures go to ``folder``.

    The cost of the first packets (modules imported on demand, requests parsed for the first time) belongs to the start: the
    start is the cost of the capture itself, and a packet the cost of its copies, which are between other hosts. ``s7plus`` is
    ``analyze`` per packet of S7comm-plus; under the name of a link, it is ``analyze`` for the same packets there.
    """
    made, once, often, less, more = (str(folder / f"{name}.pcap") for name in ("made", "once", "often", "less", "more"))
    generate(Path(made), PACKETS)
    multiply(Path(made), 1, Path(once))
    multiply(Path(made), COPIES, Path(often))
    plus = [multiply(PLUS, count, Path(path)) for count, path in ((PLUS_COPIES, less), (COPIES * PLUS_COPIES, more))]
    packets = {**dict.fromkeys(COMMANDS, (COPIES - 1) * PACKETS), "s7plus": plus[1] - plus[0]}
    calls: dict[str, list[str]] = {}
    for name, arguments in COMMANDS.items():
        calls |= {f"{name} once": [*arguments, once], f"{name} often": [*arguments, often]}
        _ran([sys.executable, "-m", "dissect", *arguments, once])  # so that the bytecode of all modules exists
    calls |= {"s7plus once": ["analyze", less], "s7plus often": ["analyze", more]}
    for kind in KINDS:
        few, many = folder / f"{kind}.once", folder / f"{kind}.often"
        packets[kind] = -twin(Path(once), kind, few) + twin(Path(often), kind, many)
        calls |= {f"{kind} once": ["analyze", str(few)], f"{kind} often": ["analyze", str(many)]}
    counted = copies(calls, folder)
    told = {name: (counted[f"{name} often"] - counted[f"{name} once"]) // count for name, count in packets.items()}
    return {**told, "start": counted["start"] - counted["python"]}


def recorded() -> dict[str, int]:
    """Return the numbers for this combination, ``interpreter`` among them; empty if none are recorded."""
    found: dict[str, dict[str, int]] = json.loads(RECORDED.read_text(encoding="ascii"))
    return found.get(combination(), {})


def too_many(now: dict[str, int], before: dict[str, int]) -> list[str]:
    """Return the counts that exceed their limits, as sentences."""
    return [
        f"{name}: {now[name]} instructions, recorded are {before[name]}, at most {most:.2f} times that is allowed"
        for name, most in MOST.items()
        if now[name] > before[name] * most
    ] + [
        f"{name}: {now[name]} instructions, {now['plain']} over plain Ethernet, at most {most:.2f} times that is allowed"
        for name, most in MOST_OF_LINKS.items()
        if now[name] > now["plain"] * most
    ]


def _times(now: dict[str, int], name: str) -> str:
    return f"{now[name] / now['plain']:.2f}" if name in MOST_OF_LINKS else ""


def _record(now: dict[str, int]) -> None:
    known = json.loads(RECORDED.read_text(encoding="ascii")) if RECORDED.exists() else {}
    known[combination()] = {name: now[name] for name in (*MOST, "interpreter")}
    RECORDED.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="ascii")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.instructions", description=__doc__)
    parser.add_argument("--record", action="store_true", help="keep the numbers as those to compare with")
    options = parser.parse_args(arguments)
    if shutil.which("valgrind") is None:
        print("valgrind is not installed (scripts/install-tools.sh)", file=sys.stderr)
        return 2
    if not combination():
        print("the engine is not compiled by gcc here, its instructions are not recorded", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        now = {**measure(Path(folder)), "interpreter": interpreter()}
    before = recorded()
    rows = [(name, str(now[name]), str(before.get(name, "-")), _times(now, name)) for name in now]
    print(combination())
    print(columns(["", "instructions", "recorded", "of plain"], rows))
    if options.record:
        _record(now)
        return 0
    complaints = too_many(now, before) if before else []
    print("\n".join(complaints))
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
