"""What tshark shows of the captures here: asked once for each in a run of the tests, whichever tests and workers want it.

Most of what tshark takes for a small capture is its start, a third of a second. The answers stand in `FOLDER`, by everything
they depend on: the capture's content, what was asked, and which tshark it was.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from dissect.oracle.theirs import Frame
from dissect.oracle.tshark import preferences

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
    program = shutil.which("tshark")
    assert program, "tshark is missing: install it (Debian: apt install tshark)"
    asked = ["-T", "json", "-x", "-J", LAYERS, "--no-duplicate-keys"]
    for name, value in preferences(ports, reorder).items():
        asked += ["-o", f"{name}:{value}"]
    status = Path(program).stat()
    told = (program, status.st_size, status.st_mtime_ns, asked, path.suffix)
    key = hashlib.sha256(repr(told).encode() + path.read_bytes()).hexdigest()
    with Path(os.environ[FOLDER], key).open("a+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # so that no other worker asks the same meanwhile
        file.seek(0)
        kept = file.read()
        if not kept:
            ran = subprocess.run([program, "-n", "-r", str(path), *asked], check=False, capture_output=True)
            kept = msgspec.msgpack.encode((ran.returncode, ran.stderr.decode("utf-8", "replace"), ran.stdout))
            file.write(kept)
    code, complaint, shown = msgspec.msgpack.decode(kept, type=tuple[int, str, bytes])
    return Answer([packet.source.layers for packet in msgspec.json.decode(shown, type=list[_Packet])], code, complaint)


def read_shared(path: str, ports: Iterable[int], reorder: bool) -> Iterator[Frame]:
    """Read as `dissect.oracle.tshark.read_tshark` does a capture that tshark reads to its end."""
    answer = ask(Path(path), ports, reorder)
    assert answer.code == 0, answer.complaint
    for layers in answer.packets:
        if "tpkt" in layers:
            yield Frame(layers)
