"""A refusal is one everywhere, and its words are the same in every output."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final, NamedTuple

import pytest
from scapy.utils import rdpcap

from dissect.layers import S7
from tests.cli.support import run
from tests.meaning.report.support import WORD, begun, saved
from tests.properties import messages
from tests.properties.messages import dt

Capture = pytest.CaptureFixture[bytes]

START_UPLOAD: Final = bytes.fromhex("1d 00 00 00 00 00 00 00 09") + b"_0A00001A"


class Case(NamedTuple):
    """A request and the answer that refuses it: the code and name that every output has to have, and one that none may."""

    asked: bytes
    told: bytes
    code: int
    name: str
    wrong: str = "(unknown code)"


def _empty(ref: int, kind: int, group: int, subfunction: int, code: int = 0x0A) -> bytes:
    """Userdata without payload and error code, with this return code."""
    whole = messages.userdata(ref, kind, group, subfunction)
    return whole[:-4] + bytes((code, 0, 0, 0))


PARALLEL: Final = "No further parallel upload"
CASES: Final = {
    "write": Case(
        messages.write_job(1, [WORD], [b"\0\1"]), messages.pdu(messages.ACK_DATA, 1, b"\x05\x01", b"", 0x8304),
        0x8304, "no resources (error class 0x83)", PARALLEL,
    ),
    "write, without parameters": Case(
        messages.write_job(1, [WORD], [b"\0\1"]), messages.pdu(messages.ACK, 1, b"", b"", 0x8304),
        0x8304, "no resources (error class 0x83)", PARALLEL,
    ),
    "read": Case(
        messages.read_job(1, [WORD]), messages.pdu(messages.ACK_DATA, 1, b"\x04\x01", b"", 0x8304),
        0x8304, "no resources (error class 0x83)", PARALLEL,
    ),
    "class": Case(
        messages.read_job(1, [WORD]), messages.pdu(messages.ACK_DATA, 1, b"\x04\x01", b"", 0x8181),
        0x8181, "application relationship (error class 0x81)",
    ),
    "upload": Case(
        messages.pdu(messages.JOB, 1, START_UPLOAD), messages.pdu(messages.ACK_DATA, 1, b"\x1d\x00", b"", 0x8304),
        0x8304, PARALLEL, "error class",
    ),
    "userdata": Case(
        messages.userdata(1, 1, 3, 1), messages.userdata(1, 2, 3, 1, b"", 0xD2FE),
        0xD2FE, "block functions (error class 0xd2)",
    ),
    "clock": Case(messages.userdata(1, 1, 7, 1), _empty(1, 2, 7, 1), 0x0A, "Object does not exist"),
    "block list": Case(messages.userdata(1, 1, 3, 1), _empty(1, 2, 3, 1, 0x05), 0x05, "Invalid address"),
}  # fmt: skip
NAMED: Final = pytest.mark.parametrize("case", CASES.values(), ids=CASES)


@pytest.fixture
def path(case: Case, tmp_path: Path) -> Path:
    return saved(tmp_path / "refused.pcapng", begun().send(0, dt(case.asked)).send(1, dt(case.told)).packets())


#: Commands whose output names the refusal.
FACES: Final = {
    "analyze": ("analyze",),
    "analyze JSON": ("analyze", "-T", "json"),
    "transactions": ("transactions", "--failed"),
    "JSON lines": ("transactions", "-T", "jsonl", "--failed"),
    "CSV": ("transactions", "-T", "csv"),
    "fields": ("transactions", "-T", "fields", "-e", "error"),
    "golden": ("golden",),
}


@NAMED
@pytest.mark.parametrize("command", FACES.values(), ids=FACES)
def test_every_output_has_the_same_words(
    case: Case, command: tuple[str, ...], path: Path, capfdbinary: Capture
) -> None:
    ran = run(capfdbinary, *command, path)
    assert (ran.code, ran.err) == (0, "")
    assert case.name in ran.out
    assert case.wrong not in ran.out


@NAMED
def test_json_has_code_and_place(case: Case, path: Path, capfdbinary: Capture) -> None:
    line = json.loads(run(capfdbinary, "transactions", "-T", "jsonl", "--failed", path).out)
    (error,) = line["errors"]
    assert (error["code"], error["name"]) == (case.code, case.name)
    assert error["where"] == ("data" if case.code < 0x100 else "parameter" if "userdata" in line else "header")
    assert error["text"]


@NAMED
def test_selected_by_name_and_code(case: Case, path: Path, capfdbinary: Capture) -> None:
    for wanted in (f"error == {case.code}", f'error == "{case.name}"', "failed"):
        assert run(capfdbinary, "transactions", "-Y", wanted, path).out.count("\n") == 1
    assert run(capfdbinary, "show", "-Y", f"error == {case.code}", path).out.count("\n") == 1


@NAMED
def test_exit_code(case: Case, path: Path, capfdbinary: Capture) -> None:
    assert run(capfdbinary, "analyze", "--fail-on", "transaction.refused", path).code == 1


@NAMED
def test_the_pdu_alone(case: Case, path: Path, capfdbinary: Capture) -> None:
    """Of an Ack without parameters nobody knows what it answers: it gets the words that fit whatever that was."""
    shown = run(capfdbinary, "show", path).out.splitlines()[-1]
    assert f"0x{case.code:0{2 if case.code < 0x100 else 4}x} {case.name}" in shown
    assert case.name in run(capfdbinary, "show", "-V", "-Y", "error", path).out
    layer = rdpcap(str(path))[-1][S7]
    assert case.name in layer.line()[0]
    assert case.wrong not in layer.line()[0]


@NAMED
def test_the_page(case: Case, path: Path, tmp_path: Path, capfdbinary: Capture) -> None:
    page = tmp_path / "page.html"
    assert run(capfdbinary, "report", path, "-o", page).code == 0
    text = page.read_text(encoding="utf-8")
    assert case.name in text
    assert case.wrong not in text
