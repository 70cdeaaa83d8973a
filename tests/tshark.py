"""What tshark shows of the captures here: asked once for each in a run of the tests, whichever tests and workers want it.

Most of what tshark takes for a small capture is its start, a third of a second. Those that were recorded have not one pair of
ends in common, so they are joined and read in one go. The answers stand in `FOLDER`, by everything they depend on: the
capture's content, what was asked, and which tshark it was.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import msgspec

from dissect.oracle.theirs import Frame
from dissect.oracle.tshark import preferences

ROOT: Final = Path(__file__).resolve().parent.parent

Tree = dict[str, Any]

#: Where answers are kept: for all workers of a run (tests/conftest.py makes it).
FOLDER: Final = "S7DISSECT_TSHARK_ANSWERS"
#: Every layer that a test here reads.
LAYERS: Final = "frame vlan ieee8021ad ip ipv6 tcp tpkt cotp s7comm"


class Answer(NamedTuple):
    """The layers of every packet, and how tshark ended: code 0, or another and what it said."""

    packets: list[Tree]
    code: int
    complaint: str


class _Packet(msgspec.Struct):
    source: _Source = msgspec.field(name="_source")


class _Source(msgspec.Struct):
    layers: Tree


def ask(path: Path, ports: Iterable[int] = (), reorder: bool = False) -> Answer:
    """Return what tshark shows of a capture; ``ports`` are taken for TPKT besides 102."""
    asked = ["-T", "json", "-x", "-J", LAYERS, "--no-duplicate-keys"]
    settings = preferences(ports, reorder)
    for name, value in settings.items():
        asked += ["-o", f"{name}:{value}"]
    kept = _kept(path, asked)
    if not kept and (alike := recorded(settings["tpkt.tcp.port"])).count(path) and not reorder:
        with _locked("joined") as file:
            if path.name not in file.read().decode().split():
                file.write(" ".join(["", *[each.name for each in alike]]).encode())
                for each, answer in zip(alike, _asked_at_once(alike, asked), strict=True):
                    _keep(each, asked, answer)
        kept = _kept(path, asked)
    if not kept:
        kept = _keep(path, asked, None)
    code, complaint, shown = msgspec.msgpack.decode(kept, type=tuple[int, str, bytes])
    return Answer(_packets(shown), code, complaint)


@cache
def recorded(ports: str) -> list[Path]:
    """Return the recorded captures for which just these ``ports`` are taken for TPKT."""
    return [
        path
        for path in sorted((ROOT / "captures").glob("*.pcapng"))
        for told in [tomllib.loads(path.with_suffix(".toml").read_text(encoding="utf-8"))]
        if preferences([told["port"]], reorder=False)["tpkt.tcp.port"] == ports
    ]


def _locked(name: str) -> IO[bytes]:
    """Open a file of `FOLDER` that no other worker has open like this meanwhile, at its beginning."""
    file = Path(os.environ[FOLDER], name).open("a+b")  # noqa: SIM115 - who asks for it closes it
    fcntl.flock(file, fcntl.LOCK_EX)
    file.seek(0)
    return file


def _place(path: Path, asked: list[str]) -> str:
    """Return the name under which an answer is kept."""
    program = shutil.which("tshark")
    assert program, "tshark is missing: install it (Debian: apt install tshark)"
    status = Path(program).stat()
    told = (program, status.st_size, status.st_mtime_ns, asked, path.suffix)
    return hashlib.sha256(repr(told).encode() + path.read_bytes()).hexdigest()


def _kept(path: Path, asked: list[str]) -> bytes:
    with _locked(_place(path, asked)) as file:
        return file.read()


def _keep(path: Path, asked: list[str], shown: bytes | None) -> bytes:
    """Keep and return what is shown of a capture; with None ask for it, unless another worker did meanwhile."""
    with _locked(_place(path, asked)) as file:
        kept = file.read()
        if not kept:
            code, complaint, shown = (0, "", shown) if shown is not None else _run("tshark", "-n", "-r", path, *asked)
            kept = msgspec.msgpack.encode((code, complaint, shown))
            file.write(kept)
    return kept


def _run(*command: str | Path) -> tuple[int, str, bytes]:
    ran = subprocess.run(command, check=False, capture_output=True)
    return ran.returncode, ran.stderr.decode("utf-8", "replace"), ran.stdout


def _packets(shown: bytes) -> list[Tree]:
    return [packet.source.layers for packet in msgspec.json.decode(shown, type=list[_Packet])]


def _asked_at_once(paths: list[Path], asked: list[str]) -> list[bytes]:
    """Return what tshark shows of each of the captures, joined into one and read in one go."""
    with tempfile.TemporaryDirectory() as folder:
        joined = Path(folder, "joined.pcapng")
        merged, complaint, _ = _run("mergecap", "-a", "-w", joined, *paths)
        assert merged == 0, complaint
        code, complaint, shown = _run("tshark", "-n", "-r", joined, *asked)
        counted, _, table = _run("capinfos", "-M", "-T", "-m", "-r", "-c", *paths)
    assert (code, counted) == (0, 0), complaint
    packets = _packets(shown)
    ends: dict[tuple[str, ...], int] = {}
    answers = []
    for number, line in enumerate(table.decode().splitlines()):
        count = int(line.rpartition(",")[2])
        own, packets = packets[:count], packets[count:]
        for at, layers in enumerate(own, 1):
            layers["frame"]["frame.number"] = str(at)
            if "tcp" in layers:
                ip, tcp = layers["ip"], layers["tcp"]
                pair = sorted((f"{ip['ip.src']}:{tcp['tcp.srcport']}", f"{ip['ip.dst']}:{tcp['tcp.dstport']}"))
                assert ends.setdefault(tuple(pair), number) == number, f"{pair} are in two captures"
        answers.append(msgspec.json.encode([{"_source": {"layers": layers}} for layers in own]))
    assert packets == []
    return answers


def read_shared(path: str, ports: Iterable[int], reorder: bool) -> Iterator[Frame]:
    """Read as `dissect.oracle.tshark.read_tshark` does a capture that tshark reads to its end."""
    answer = ask(Path(path), ports, reorder)
    assert answer.code == 0, answer.complaint
    for layers in answer.packets:
        if "tpkt" in layers:
            yield Frame(layers)
