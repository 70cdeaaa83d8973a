"""tshark's view of the captures here: computed once per capture in a run of the tests, for all tests and workers.

Most of tshark's time for a small capture is its start, a third of a second. So those of the repository are joined and read in
one go, each with different hosts, whose addresses are changed back in the answer. The answers are in `FOLDER`, under everything
they depend on: the capture's content, the question, and the tshark version.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import ipaddress
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

import dissect
from captures.craft.files import unpacked
from dissect.testing.oracle.theirs import Frame
from dissect.testing.oracle.tshark import preferences

ROOT: Final = Path(__file__).resolve().parent.parent

Tree = dict[str, Any]
Address = ipaddress.IPv4Address | ipaddress.IPv6Address

#: Where answers are kept: for all workers of a run (tests/conftest.py makes it).
FOLDER: Final = "S7DISSECT_TSHARK_ANSWERS"
#: Every layer that a test here reads.
LAYERS: Final = "frame vlan ieee8021ad ip ipv6 tcp tpkt cotp s7comm"
#: The beginnings of the names of captures that are not joined: mergecap accepts no file that is cut off, and leaves out the
#: blocks that Wireshark numbers as if they were packets.
ALONE: Final = ("cut-", "sections")
#: Public captures of fewer octets are joined with the others.
SMALL: Final = 150_000


class Answer(NamedTuple):
    """The layers of every packet, and tshark's exit code: 0, or another one with its message."""

    packets: list[Tree]
    code: int
    complaint: str


class _Packet(msgspec.Struct):
    source: _Source = msgspec.field(name="_source")


class _Source(msgspec.Struct):
    layers: Tree


def ask(path: Path, ports: Iterable[int] = (), reorder: bool = False) -> Answer:
    """Return tshark's view of a capture; ``ports`` are treated as TPKT besides 102."""
    asked = ["-T", "json", "-x", "-J", LAYERS, "--no-duplicate-keys"]
    settings = preferences(ports, reorder)
    for name, value in settings.items():
        asked += ["-o", f"{name}:{value}"]
    kept = _kept(path, asked)
    if not kept and not reorder and (alike := joinable(settings["tpkt.tcp.port"])).count(path):
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
def joinable(ports: str) -> list[Path]:
    """Return the captures that may be joined and that treat exactly these ``ports`` as TPKT; small public ones too."""
    folder = ROOT / "captures"
    shared = Path(os.environ.get("S7DISSECT_CORPUS") or ROOT.parent / "shared" / "captures")
    found = [path for path in sorted(shared.glob("*.pcap*")) if ports == "102" and path.stat().st_size < SMALL]
    for path in sorted([*folder.glob("*.pcapng"), *(folder / "crafted").glob("*.pcap*")]):
        table = path.with_name(f"{path.name.partition('.')[0]}.toml")
        told = tomllib.loads(table.read_text(encoding="utf-8"))
        alone = path.stem.startswith(ALONE)
        if not alone and preferences(told.get("ports", [told.get("port")]), reorder=False)["tpkt.tcp.port"] == ports:
            found.append(path)
    return found


def _locked(name: str) -> IO[bytes]:
    """Open a file of `FOLDER` at its beginning; no other worker has it open in this way at the same time."""
    file = Path(os.environ[FOLDER], name).open("a+b")  # noqa: SIM115 - who asks for it closes it
    fcntl.flock(file, fcntl.LOCK_EX)
    file.seek(0)
    return file


def _place(path: Path, asked: list[str]) -> str:
    """Return the name under which an answer is kept."""
    program = shutil.which("tshark")
    if program is None:
        raise FileNotFoundError(errno.ENOENT, "not installed (Debian: apt install tshark)", "tshark")
    status = Path(program).stat()
    told = (program, status.st_size, status.st_mtime_ns, asked, path.suffix)
    return hashlib.sha256(repr(told).encode() + path.read_bytes()).hexdigest()


def _kept(path: Path, asked: list[str]) -> bytes:
    with _locked(_place(path, asked)) as file:
        return file.read()


def _keep(path: Path, asked: list[str], shown: bytes | None) -> bytes:
    """Keep and return the view of a capture; with None run tshark, unless another worker did so meanwhile."""
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
    """Return tshark's view of each of the captures, as JSON, joined into one and read in one go."""
    with tempfile.TemporaryDirectory() as folder:
        moved = [_Moved(path, number, Path(folder)) for number, path in enumerate(paths)]
        joined, counts = join([each.path for each in moved], Path(folder))
        code, complaint, shown = _run("tshark", "-n", "-r", joined, *asked)
    assert code == 0, complaint
    packets = _packets(shown)
    streams: dict[str, int] = {}
    answers = []
    for number, (count, each) in enumerate(zip(counts, moved, strict=True)):
        own, packets = packets[:count], packets[count:]
        for at, layers in enumerate(own, 1):
            layers["frame"]["frame.number"] = str(at)
            stream = tcp.get("tcp.stream") if isinstance(tcp := layers.get("tcp"), dict) else None
            if stream is not None:
                assert streams.setdefault(stream, number) == number, f"{paths[number]}: not between hosts of its own"
        # Packets that are named in others (`ip.fragment`) keep their number in the joined file: no test needs them.
        answers.append(each.back(msgspec.json.encode([{"_source": {"layers": layers}} for layers in own])))
    assert packets == []
    return answers


def ask_together(paths: list[Path], asked: list[str]) -> dict[Path, list[Tree]]:
    """Return the layers of every packet of captures, from JSON in another form than for `ask`, in one go."""
    return {path: _packets(shown) for path, shown in zip(paths, _asked_at_once(paths, asked), strict=True)}


def join(paths: list[Path], folder: Path) -> tuple[Path, list[int]]:
    """Join captures one after the other; return the joined capture and the number of packets of each."""
    joined = folder / "joined.pcapng"
    merged, complaint, _ = _run("mergecap", "-a", "-w", joined, *paths)
    assert merged == 0, complaint
    counted, complaint, table = _run("capinfos", "-M", "-T", "-m", "-r", "-c", *paths)
    assert counted == 0, complaint
    return joined, [int(line.rpartition(",")[2]) for line in table.decode().splitlines()]


class _Moved:
    """A copy of a capture, number ``number`` of those to join, with different hosts."""

    def __init__(self, path: Path, number: int, folder: Path) -> None:
        content = unpacked(path)
        pairs = {
            tuple(ipaddress.ip_address(end.address) for end in connection.tcp.ends)
            for connection in dissect.analyze(str(path)).connections
        }
        old = sorted({address for pair in pairs for address in pair}, key=lambda one: (one.version, one.packed))
        new = {address: _other(address, number, at) for at, address in enumerate(old)}
        for one, other in pairs | {(other, one) for one, other in pairs}:
            content = content.replace(one.packed + other.packed, new[one].packed + new[other].packed)
        self.path = folder / f"{number}{path.suffixes[0]}"
        self.path.write_bytes(content)
        self._back = [
            (str(form(there)).encode(), str(form(here)).encode())
            for here, there in new.items()
            for form in (str, lambda address: address.packed.hex())
        ]

    def back(self, shown: bytes) -> bytes:
        """Return tshark's view, with the addresses of the capture itself."""
        for there, here in self._back:
            shown = shown.replace(there, here)
        return shown


def _other(address: Address, number: int, at: int) -> Address:
    """Return the address that replaces another, number ``at`` of a capture; no address text is the beginning of another."""
    if address.version == 6:
        return ipaddress.IPv6Address(b"\xfd" + bytes((number, at)) + address.packed[3:])
    return ipaddress.IPv4Address(bytes((11, 100 + number, 100 + at // 100, 100 + at % 100)))


def read_shared(path: str, ports: Iterable[int], reorder: bool) -> Iterator[Frame]:
    """Read a capture that tshark reads to its end, as `dissect.testing.oracle.tshark.read_tshark` does."""
    answer = ask(Path(path), ports, reorder)
    assert answer.code == 0, answer.complaint
    for layers in answer.packets:
        if "tpkt" in layers:
            yield Frame(layers)
