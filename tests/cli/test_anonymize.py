"""`s7dissect anonymize`: what it writes, what it tells of it, what it refuses."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dissect.packets.source.files import open_capture
from tests.cli.support import run, simple
from tests.files.anonymize.support import told
from tests.meaning.report.support import ROOT, begun, read, saved
from tests.packets.source.craft import drain
from tests.properties.packets import Flow, Talk

Capfd = pytest.CaptureFixture[bytes]


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_bytes(b"sixteen octets..")
    return path


def test_writes_a_capture_and_tells_of_it(tmp_path: Path, capfdbinary: Capfd) -> None:
    source, out = simple(tmp_path / "in.pcapng"), tmp_path / "out.pcapng"
    ran = run(capfdbinary, "anonymize", source, "-o", out)
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    packets = len(drain(open_capture(str(source))).frames)
    assert lines[0] == f"{packets} of {packets} packets written"
    assert "       2  IP addresses (distinct)" in lines
    assert any(line.endswith("values (4 bytes)") for line in lines)
    assert "Left unchanged" in lines
    unchanged = [line.strip() for line in lines[lines.index("Left unchanged") + 1 :]]
    assert [line for line in unchanged if "order numbers" in line and not line.startswith("in S7comm: ")] == []
    assert [line for line in unchanged if line.startswith("in S7comm-plus: ") and line.endswith(" firmware versions")]
    assert told(out) == told(source)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.pcapng", "out.pcapng"]


def test_json(tmp_path: Path, capfdbinary: Capfd, key: Path) -> None:
    out = tmp_path / "out.pcapng"
    ran = run(capfdbinary, "anonymize", ROOT / "captures/szl.pcapng", "-o", out, "--key", key, "-T", "json")
    account = json.loads(ran.out)
    assert account["packets"] == account["written"] == 42
    assert account["replaced"] == {"names": 4, "serial_numbers": 2}
    assert account["dropped"] == {}
    assert account["left"]


def test_the_key_decides(tmp_path: Path, capfdbinary: Capfd, key: Path) -> None:
    source = simple(tmp_path / "in.pcapng")
    outs = [tmp_path / f"{number}.pcapng" for number in range(4)]
    keys: list[str | Path] = [key, key, "random", "random"]
    for out, value in zip(outs, keys, strict=True):
        assert run(capfdbinary, "anonymize", source, "-o", out, "--key", value).code == 0
    octets = [out.read_bytes() for out in outs]
    assert octets[0] == octets[1]
    assert len(set(octets)) == 3


def test_two_captures_map_alike(tmp_path: Path, capfdbinary: Capfd, key: Path) -> None:
    flow = Flow("192.168.1.10", "192.168.1.20")
    addresses = []
    for number in range(2):
        source = saved(tmp_path / f"in{number}.pcapng", read(begun(flow), number + 1).packets())
        out = tmp_path / f"out{number}.pcapng"
        run(capfdbinary, "anonymize", source, "-o", out, "--key", key)
        addresses.append(drain(open_capture(str(out))).frames[0].octets[:34])
    assert addresses[0][26:34] == addresses[1][26:34]
    assert addresses[0][26:28] == bytes((192, 168))


def test_standard_output(tmp_path: Path) -> None:
    source = simple(tmp_path / "in.pcapng")
    ran = subprocess.run(
        [sys.executable, "-m", "dissect", "anonymize", str(source), "-o", "-"], capture_output=True, check=True
    )
    assert ran.stdout.startswith(b"\x0a\x0d\x0d\x0a")
    assert b"packets written" in ran.stderr


def test_comments_and_names_of_interfaces_stay_behind(tmp_path: Path, capfdbinary: Capfd) -> None:
    source = saved(tmp_path / "in.pcapng", begun().packets(), {2: "the pump of Mr Miller"})
    out = tmp_path / "out.pcapng"
    ran = run(capfdbinary, "anonymize", source, "-o", out)
    assert "       1  comments" in ran.out
    assert b"Miller" not in out.read_bytes()


def test_a_damaged_file_gives_what_was_there(tmp_path: Path, capfdbinary: Capfd) -> None:
    source = simple(tmp_path / "in.pcapng")
    source.write_bytes(source.read_bytes()[:-30])
    ran = run(capfdbinary, "anonymize", source, "-o", tmp_path / "out.pcapng")
    assert ran.code == 3
    assert len(ran.err.splitlines()) == 1
    assert told(tmp_path / "out.pcapng")


def test_scd_by_its_dictionary(tmp_path: Path, capfdbinary: Capfd, key: Path) -> None:
    folder = ROOT / "captures/scd"
    source, out = folder / "plant.pcapng", tmp_path / "out.pcapng"
    known = ("--scd", folder / "plant.toml", "--bind", folder / "plant.bind.toml", "--key", key)
    ran = run(capfdbinary, "anonymize", source, "-o", out, *known)
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith("86 of 86 packets written\n")
    assert "values in SCD messages" in ran.out
    (told_of,) = re.findall(r'канал: tsap = "(....)"', ran.out)
    assert told_of != "SCD1"
    assert told_of.encode() in out.read_bytes()
    ran = run(capfdbinary, "anonymize", source, "-o", out, "-T", "json", "--force", *known)
    assert json.loads(ran.out)["bindings"] == [{"name": "канал", "tsap": told_of}]
    ran = run(capfdbinary, "anonymize", source, "-o", out, "--scd", folder / "plant.toml")
    assert ran.code == 2
    assert "belong together" in " ".join(ran.err.split())
    ran = run(capfdbinary, "anonymize", source, "-o", out, "--force")
    assert "28 of 86 packets written" in ran.out
    assert "(so packet numbers in OUT differ from those in FILE)" in ran.out


def test_refusals(tmp_path: Path, capfdbinary: Capfd, key: Path) -> None:
    source, out = simple(tmp_path / "in.pcapng"), tmp_path / "out.pcapng"
    short = tmp_path / "short"
    short.write_bytes(b"short")
    out.write_bytes(b"something")
    refused: list[tuple[tuple[str | Path, ...], str]] = [
        ((source, "-o", out), "--force overwrites it"),
        ((source, "-o", source, "--force"), "is both input and output; choose another OUT"),
        (("-", "-o", tmp_path / "x"), "read twice"),
        ((source, "-o", tmp_path / "x", "--key", short), "a key needs 16 or more"),
        ((source, "-o", tmp_path / "x", "--key", tmp_path / "none"), "No such file"),
        ((tmp_path / "none", "-o", tmp_path / "x"), "no such file"),
    ]
    for arguments, why in refused:
        ran = run(capfdbinary, "anonymize", *arguments)
        assert (ran.code, ran.out) == (2, ""), why
        assert why in " ".join(ran.err.split()), ran.err
    assert out.read_bytes() == b"something"
    assert run(capfdbinary, "anonymize", source, "-o", out, "--force", "--key", key).code == 0


def test_nothing_to_write(tmp_path: Path, capfdbinary: Capfd) -> None:
    packets = Talk(Flow(ports=(40000, 25))).handshake().send(0, b"HELO").packets()
    out = tmp_path / "out.pcapng"
    ran = run(capfdbinary, "anonymize", saved(tmp_path / "in.pcapng", packets), "-o", out)
    assert ran.code == 2
    assert "the capture contains no S7 packets" in ran.err
    assert not out.exists()
    assert len(list(tmp_path.iterdir())) == 1
