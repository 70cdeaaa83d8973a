"""`s7dissect verify`: what it says, what it writes for programs, its exit codes, and what it needs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from random import Random

import pytest
from jsonschema import Draft202012Validator

from dissect.testing.oracle import compare as comparison_module
from dissect.testing.oracle import tshark
from dissect.testing.oracle.facts import LocatedValue
from dissect.testing.oracle.theirs import Frame
from dissect.testing.oracle.tshark import read_tshark, version
from tests.build import dt, pdu
from tests.cli.support import Ran, run
from tests.testing.oracle.traffic import PUSH_ACK, Connection, conversation, write_capture

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    return write_capture(tmp_path / "made.pcap", conversation(Random(3), 1))


@pytest.fixture
def differing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A capture of one answer, whose PDU reference Wireshark is made to show otherwise."""

    def read(path: str, ports: Iterable[int], reorder: bool) -> Iterator[Frame]:
        for frame in read_tshark(path, ports, reorder):
            for record in frame.pdus:
                for place, fact in record.facts.items():
                    if place.name == "s7comm.header.pduref" and isinstance(fact.value, int):
                        record.facts[place] = LocatedValue(fact.value + 1, fact.offset)
            yield frame

    monkeypatch.setattr(tshark, "read_tshark", read)
    connection = Connection(Random(1), 1)
    connection.open()
    connection.put(1, PUSH_ACK, dt(pdu(3, 0x0102, b"\x04\x01", b"\xff\x04\x00\x10\x12\x34")))
    return write_capture(tmp_path / "differing.pcap", connection.packets)


def held_to_the_schema(ran: Ran) -> dict[str, object]:
    told: dict[str, object] = json.loads(ran.out)
    schema = json.loads((ROOT / "dissect/meaning/schema/verification.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    assert list(Draft202012Validator(schema).iter_errors(told)) == []
    assert ran.out.isascii()
    return told


def test_all_is_explained(capfdbinary: pytest.CaptureFixture[bytes], capture: Path) -> None:
    ran = run(capfdbinary, "verify", capture, capture)
    assert (ran.code, ran.err) == (0, "")
    first, second, total, *known = ran.out.splitlines()
    assert first == second
    assert first.startswith(f"{capture}: ")
    assert "0 unexplained differences, " in first
    assert total.startswith(f"2 files, tshark {version()}: ")
    assert known
    assert all(int(line.split()[0]) % 2 == 0 and " is right: " in line for line in known)


def test_each_known_difference_has_a_line_when_asked_for(
    capfdbinary: pytest.CaptureFixture[bytes], capture: Path
) -> None:
    ran = run(capfdbinary, "verify", "--known", capture)
    lines = [line for line in ran.out.splitlines() if line.startswith("  frame ")]
    counted = int(ran.out.splitlines()[0].rsplit(", ", 1)[1].split()[0])
    assert ran.code == 0
    assert len(lines) == counted > 0
    assert any(line.endswith("(length-in-octets)") for line in lines)


def test_what_is_not_explained_is_told(capfdbinary: pytest.CaptureFixture[bytes], differing: Path) -> None:
    ran = run(capfdbinary, "verify", differing)
    assert ran.code == 1
    first, line, total, *_ = ran.out.splitlines()
    assert "1 unexplained difference, 1 known" in first
    assert line == "  frame 4 PDU s7comm.header.pduref: ours 258 (0x102), theirs 259 (0x103) (unexplained)"
    assert total.startswith("1 file, ")


def test_for_programs(capfdbinary: pytest.CaptureFixture[bytes], differing: Path) -> None:
    ran = run(capfdbinary, "verify", "-T", "json", differing)
    assert ran.code == 1
    told = held_to_the_schema(ran)
    assert (told["tshark"], told["unexplained"]) == (version(), 1)
    (file,) = told["files"] if isinstance(told["files"], list) else []
    assert (file["name"], file["tpdus"], file["pdus"]) == (str(differing), 1, 1)
    assert file["differences"] == [
        {
            "frame": 4,
            "kind": "PDU",
            "field": "s7comm.data.length of data item 1",
            "ours": 16,
            "wireshark": 2,
            "known": "length-in-octets",
        },
        {
            "frame": 4,
            "kind": "PDU",
            "field": "s7comm.header.pduref",
            "ours": 258,
            "wireshark": 259,
            "known": None,
        },
    ]
    known = told["known"]
    assert isinstance(known, dict)
    assert known["length-in-octets"]["count"] == 1
    assert known["length-in-octets"]["right"] == "Ours is right"


def test_through_pyshark(capfdbinary: pytest.CaptureFixture[bytes], capture: Path) -> None:
    direct = run(capfdbinary, "verify", "-T", "json", capture)
    other = run(capfdbinary, "verify", "-T", "json", "--pyshark", capture)
    assert (direct.code, other.code) == (0, 0), other.err
    assert held_to_the_schema(direct) == held_to_the_schema(other)


def test_in_order_first(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """A capture of which tshark shows more when it puts segments in order."""
    path = ROOT / "captures" / "crafted" / "disorder.pcapng"
    counted = []
    for options in ([], ["--reorder"]):
        ran = run(capfdbinary, "verify", "-T", "json", *options, path)
        told = held_to_the_schema(ran)
        assert (ran.code, isinstance(told["files"], list)) == (0, True)
        counted.append(json.loads(ran.out)["files"][0]["pdus"])
    assert counted[0] < counted[1]


@pytest.mark.parametrize("name", ["nothing.pcap", "text.pcap"])
def test_an_unreadable_file(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, name: str) -> None:
    (tmp_path / "text.pcap").write_text("this is not a capture")
    ran = run(capfdbinary, "verify", tmp_path / name)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"s7dissect: {tmp_path / name}: ")
    assert ran.err.count("\n") == 1


def test_a_file_tshark_gives_up_on(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    ran = run(capfdbinary, "verify", ROOT / "captures" / "crafted" / "cut-pcap.pcap")
    assert ran.code == 3
    assert "cut off" in ran.err


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("-", "-: a regular file is needed, because it is read several times."),
        (".", ".: a folder without a capture (.pcap, .pcapng, .cap)."),
    ],
)
def test_what_cannot_be_read_twice(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = run(capfdbinary, "verify", name)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err


def test_without_tshark(
    capfdbinary: pytest.CaptureFixture[bytes], capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tshark, "PROGRAM", "no-such-tshark")
    ran = run(capfdbinary, "verify", capture)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.count("\n") == 1
    assert "apt install tshark" in ran.err


def test_without_pyshark(
    capfdbinary: pytest.CaptureFixture[bytes], capture: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = tmp_path / "first"
    folder.mkdir()
    (folder / "pyshark.py").write_text("raise ImportError")
    monkeypatch.setenv("PYTHONPATH", f"{folder}:{Path(comparison_module.__file__).parents[3]}")
    ran = run(capfdbinary, "verify", "--pyshark", capture)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.count("\n") == 1
    assert "pyshark is not installed: pip install 's7dissect[tshark]'" in ran.err


def test_files_apart_are_the_same_for_every_number_of_processes(
    capfdbinary: pytest.CaptureFixture[bytes], capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a file that is no capture and one that is cut: named, the rest is compared."""
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 2)
    text = tmp_path / "text.pcap"
    text.write_text("this is no capture, but long enough to be looked at")
    cut = tmp_path / "cut.pcap"
    cut.write_bytes(capture.read_bytes()[:-3])
    for format_ in ("text", "json"):
        arguments = ("verify", "--separate", "-T", format_, capture, text, cut)
        one = run(capfdbinary, *arguments)
        assert run(capfdbinary, *arguments, "-j", "2") == one
        assert one.code == 3
        assert [sum([name in line for line in one.err.splitlines()]) for name in ("text.pcap: ", "cut.pcap: ")] == [
            1,
            1,
        ]
        assert one.out == run(capfdbinary, "verify", "-T", format_, capture, cut).out


def test_a_tshark_that_fails_ends_it_whoever_asks(
    capfdbinary: pytest.CaptureFixture[bytes], capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise tshark.OracleError("tshark has gone")

    monkeypatch.setattr(comparison_module, "compare", failing)
    for options in ((), ("--separate",)):
        ran = run(capfdbinary, "verify", *options, capture, capture)
        assert (ran.code, ran.out, ran.err) == (2, "", "s7dissect: tshark has gone\n")
