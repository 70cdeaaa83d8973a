"""The engines that are compared: how each is called, and its largest file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT: Final = Path(__file__).resolve().parent.parent

#: The facts that the engines must report, under tshark's names.
FACTS: Final = (
    "frame.time_epoch",
    "ip.src",
    "ip.dst",
    "s7comm.header.rosctr",
    "s7comm.header.pduref",
    "s7comm.param.func",
    "s7comm.param.itemcount",
    "s7comm.param.item.area",
    "s7comm.param.item.db",
    "s7comm.param.item.address",
    "s7comm.data.returncode",
)
#: Slow engines are measured on files up to this many packets; their rate per packet is taken from there.
SLOW: Final = 100_000

_PLAIN = """
import sys, zlib
check = 0
with open(sys.argv[1], "rb", buffering=0) as file:
    while octets := file.read(1 << 18):
        check = zlib.crc32(octets, check)
print(check)
"""
_SCAPY = """
import sys
from scapy.utils import PcapReader
import scapy.layers.inet
with PcapReader(sys.argv[1]) as packets:
    print(sum(1 for _ in packets))
"""
_DPKT = """
import sys
import dpkt
octets = 0
with open(sys.argv[1], "rb") as file:
    for _, frame in dpkt.pcap.Reader(file):
        ip = dpkt.ethernet.Ethernet(frame).data
        if isinstance(ip, dpkt.ip.IP) and isinstance(ip.data, dpkt.tcp.TCP):
            octets += len(ip.data.data)
print(octets)
"""


class Engine:
    """One way to read a capture. ``command`` takes the file; ``most`` is the largest file in packets (0: any)."""

    __slots__ = ("command", "environment", "label", "most", "name")

    def __init__(
        self,
        name: str,
        label: str,
        command: Callable[[Path], list[str]],
        most: int = 0,
        environment: dict[str, str] | None = None,
    ) -> None:
        self.name = name
        self.label = label
        self.command = command
        self.most = most
        self.environment = environment


class MissingError(Exception):
    """An engine cannot be measured here; the message says what is missing and what to do."""


def mode_of(call: list[str], environment: dict[str, str] | None, directory: Path) -> str:
    """Return ``compiled`` or ``interpreted``, according to the command's ``--version``.

    Raises MissingError if it does not run.
    """
    try:
        told = subprocess.run(
            [*call, "--version"], capture_output=True, text=True, env=environment, cwd=directory, check=True
        ).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        raise MissingError(f"{' '.join(call)} --version does not run: {error}") from error
    for mode in ("compiled", "interpreted"):
        if mode in told:
            return mode
    raise MissingError(f"{' '.join(call)} --version does not say how it is built: {told!r}")


def absolute(python: str) -> str:
    """Return a path to a python that is valid from every folder; links are kept, as virtual environments need them."""
    return str(Path(python).absolute()) if os.sep in python else python


def installed(python: str, directory: Path) -> list[str]:
    """Return the call of the command installed beside ``python``; MissingError unless that is compiled."""
    script = Path(python).parent / "s7dissect"
    call = [str(script)] if script.exists() else [python, "-m", "dissect"]
    mode = mode_of(call, None, directory)
    if mode != "compiled":
        raise MissingError(
            f"{' '.join(call)} is {mode}; install it where a C compiler is, and name that python by --compiled"
        )
    return call


def interpreted(python: str, directory: Path) -> tuple[list[str], dict[str, str]]:
    """Return call and environment of the source in this tree, copied to ``directory`` without compiled modules."""
    source = directory / "source"
    if not source.exists():
        shutil.copytree(
            ROOT / "dissect", source / "dissect", ignore=shutil.ignore_patterns("*.so", "*.pyd", "__pycache__")
        )
        subprocess.run([python, "-m", "compileall", "-q", str(source)], check=True)
    environment = {**os.environ, "PYTHONPATH": str(source)}
    call = [python, "-m", "dissect"]
    mode = mode_of(call, environment, directory)
    if mode != "interpreted":
        raise MissingError(f"the copy of the source says that it is {mode}")
    return call, environment


def _own(kind: str, call: list[str], environment: dict[str, str] | None) -> list[Engine]:
    def analyze(file: Path) -> list[str]:
        return [*call, "analyze", "-T", "json", str(file)]

    def transactions(file: Path) -> list[str]:
        return [*call, "transactions", "-T", "jsonl", str(file)]

    def values(file: Path) -> list[str]:
        return [*call, "values", "-T", "jsonl", str(file)]

    def summary(file: Path) -> list[str]:
        return [*call, "values", "--summary", str(file)]

    return [
        Engine(f"analyze-{kind}", f"s7dissect analyze, {kind}", analyze, 0, environment),
        Engine(f"transactions-{kind}", f"s7dissect transactions -T jsonl, {kind}", transactions, 0, environment),
        Engine(f"values-{kind}", f"s7dissect values -T jsonl, {kind}", values, 0, environment),
        Engine(f"summary-{kind}", f"s7dissect values --summary, {kind}", summary, 0, environment),
    ]


def _python(code: str) -> Callable[[Path], list[str]]:
    return lambda file: [sys.executable, "-c", code, str(file)]


def _tshark(*rest: str) -> Callable[[Path], list[str]]:
    return lambda file: ["tshark", "-r", str(file), "-Y", "s7comm", *rest]


def _others() -> list[Engine]:
    fields = [word for fact in FACTS for word in ("-e", fact)]
    return [
        Engine("plain", "plain pass (read and CRC-32, in C)", _python(_PLAIN)),
        Engine("tshark-fields", "tshark -Y s7comm -T fields", _tshark("-T", "fields", *fields)),
        Engine("tshark-ek", "tshark -Y s7comm -T ek", _tshark("-T", "ek", "-J", "s7comm cotp tpkt"), SLOW),
        Engine("dpkt", "dpkt, down to TCP", _python(_DPKT), SLOW),
        Engine("scapy", "Scapy PcapReader", _python(_SCAPY), SLOW),
    ]


#: The engine that all others are compared with.
YARDSTICK: Final = "tshark-fields"
NAMES: Final = (
    "plain",
    "analyze-compiled",
    "transactions-compiled",
    "values-compiled",
    "summary-compiled",
    "analyze-interpreted",
    "transactions-interpreted",
    "values-interpreted",
    "summary-interpreted",
    "tshark-fields",
    "tshark-ek",
    "dpkt",
    "scapy",
)


def engines(wanted: list[str], compiled: str, python: str, directory: Path) -> tuple[list[Engine], list[str]]:
    """Return the engines of ``wanted`` (names of `NAMES`) that can run here, and a sentence for each that cannot.

    ``compiled`` is the python of the environment where the compiled package is installed, ``python`` runs the source.
    """
    found = _others()
    lacking: list[str] = []
    try:
        if any(name.endswith("-compiled") for name in wanted):
            found += _own("compiled", installed(compiled, directory), None)
    except MissingError as error:
        lacking.append(f"compiled: {error}")
    try:
        if any(name.endswith("-interpreted") for name in wanted):
            found += _own("interpreted", *interpreted(python, directory))
    except MissingError as error:
        lacking.append(f"interpreted: {error}")
    for module in ("dpkt", "scapy"):
        if (
            module in wanted
            and subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True, check=False).returncode
        ):
            lacking.append(f"{module}: not installed; pip install {module}")
            wanted = [name for name in wanted if name != module]
    if shutil.which("tshark") is None:
        lacking.append("tshark: not installed; apt-get install tshark")
        wanted = [name for name in wanted if not name.startswith("tshark")]
    by_name = {engine.name: engine for engine in found}
    return [by_name[name] for name in NAMES if name in wanted and name in by_name], lacking
