"""Promises G17, T27, T28, T34: nothing said on the wire or in a file steers a terminal, table or document; no password shows.

File names and the texts of dictionaries are tried in tests/cli/test_drive.py and tests/cli/test_scd.py, the screens in
tests/online/monitor, JUnit XML alone in tests/cli/test_junit.py.
"""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import pytest

from dissect.engine.pipeline import Options
from dissect.online.live.session import Session
from dissect.packets.source.files import open_capture
from dissect.protocols.s7.security import encode_password
from dissect.testing.golden.parsing import parse_golden
from tests.cli.support import run, simple
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import UNSAFE, begun, saved
from tests.promises import hostile
from tests.properties import messages
from tests.properties.messages import dt

Capture = pytest.CaptureFixture[bytes]

FACES: Final = """
analyze HOSTILE
analyze HOSTILE -T json
transactions HOSTILE
transactions HOSTILE -T jsonl
transactions HOSTILE -T csv
operations HOSTILE
operations HOSTILE -T jsonl
devices HOSTILE
devices HOSTILE -T json
devices HOSTILE -T csv
show HOSTILE
show HOSTILE -V
show HOSTILE -T jsonl
monitor HOSTILE
monitor HOSTILE -T jsonl
golden HOSTILE
diff PLAIN HOSTILE --max 9999
diff PLAIN HOSTILE -T json
diff PLAIN HOSTILE -T junit
baseline HOSTILE
replay HOSTILE --dry-run
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("hostile")
    return {"HOSTILE": hostile.write(folder / "hostile.pcapng"), "PLAIN": simple(folder / "plain.pcapng")}


def calls(text: str) -> list[list[str]]:
    return [line.split() for line in text.strip().split("\n")]


def holds(call: list[str], output: str) -> None:
    """Hold an output to what its format allows, by a reader of that format."""
    lines = output.split("\n")
    assert lines.pop() == ""
    unsafe = [line for line in lines if UNSAFE.search(line)]
    assert unsafe == []
    output.encode("utf-8")
    form = call[call.index("-T") + 1] if "-T" in call else ""
    if form == "json":
        assert isinstance(json.loads(output), dict)
    elif form == "jsonl":
        assert all(isinstance(json.loads(line), dict) for line in lines)
    elif form == "junit":
        assert ElementTree.fromstring(output).tag == "testsuite"
    elif form == "csv":
        rows = list(csv.reader(io.StringIO(output)))
        assert len(rows) == len(lines)
        assert {len(row) for row in rows} == {len(rows[0])}
        for cell in [cell for row in rows for cell in row]:
            assert not cell.startswith(("=", "+", "@", "\t", "\r"))
            assert not cell.startswith("-") or re.fullmatch("-[0-9.e+-]+", cell) or cell == "-"
    elif call[0] == "golden":
        assert parse_golden(output, "hostile").transactions


@pytest.mark.parametrize("call", calls(FACES), ids=" ".join)
def test_nothing_said_steers_anything(capfdbinary: Capture, files: dict[str, Path], call: list[str]) -> None:
    ran = run(capfdbinary, *[files.get(word, word) for word in call])
    assert ran.code in {0, 1}
    assert len(ran.out) > 800
    holds(call, ran.out)
    assert [line for line in ran.err.split("\n") if UNSAFE.search(line)] == []


def test_every_string_is_there_in_every_field(capfdbinary: Capture, files: dict[str, Path]) -> None:
    """Otherwise the test above would try nothing."""
    assert len(hostile.strings()) >= 200
    told = run(capfdbinary, "show", files["HOSTILE"]).out
    for mark in ("red", "HYPERLINK", "passwd", "alert(1)"):
        for field in ("TSAP", "comment", "upload", "PI service", "SZL"):
            assert any(mark in line for line in told.split("\n") if field in line), (mark, field)


def test_what_prometheus_fetches_holds_nothing_of_it(files: dict[str, Path]) -> None:
    pytest.importorskip("prometheus_client")
    from dissect.online.metrics.counters import Metrics
    from dissect.online.metrics.exposition import Exposition

    metrics = Metrics()
    session = Session(lambda: open_capture(str(files["HOSTILE"])), Options(), companions=[metrics])
    session.start()
    while session.running or session.waiting:
        session.poll(0.2)
    session.close()
    text = Exposition(metrics).text().decode()
    assert "s7dissect_transactions_total" in text
    assert not UNSAFE.search(text.replace("\n", ""))
    assert not any(mark in text for mark in ("[31m", "HYPERLINK", "passwd", "alert(1)"))


# ---- passwords ------------------------------------------------------------------------------------------------------

PASSWORDS: Final = (b"geheim", b"12345678", b"s3cr3t-nc")
WITH_PASSWORD: Final = [line for line in calls(FACES) if line[0] != "diff"] + calls("""
operations HOSTILE --kind password
show HOSTILE --frame 12 -V
replay HOSTILE --dry-run --allow-control
replay HOSTILE --dry-run --allow-control -T json
diff PLAIN HOSTILE --max 9999
diff HOSTILE PLAIN -T json
""")


def forms(password: bytes) -> list[str]:
    """Return how a password could stand in a text: itself, and as octets of both kinds; a hex view may break its line."""
    kinds = [password, encode_password(password)] if len(password) <= 8 else [password]
    return [password.decode(), *[octets[:6].hex() for octets in kinds], *[octets[:3].hex(" ") for octets in kinds]]


@pytest.fixture(scope="module")
def secret(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session password cut short and one that is too long, and the login of a Sinumerik."""
    talk = begun()
    encoded = encode_password(PASSWORDS[0])
    for ref, octets in enumerate((encoded, encoded + b"\x01\x02", encoded[:7]), 1):
        talk.send(0, dt(messages.userdata(ref, 1, 5, 1, octets)))
    nc = PASSWORDS[2]
    arguments = bytes((1,)) + b"1" + bytes((len(nc),)) + nc
    block = b"\x28" + bytes(6) + b"\xfd" + len(arguments).to_bytes(2, "big") + arguments + b"\x09_N_LOGIN_"
    talk.send(0, dt(messages.pdu(messages.JOB, 9, block)))
    return saved(tmp_path_factory.mktemp("secret") / "secret.pcapng", talk.packets())


@pytest.mark.parametrize("call", WITH_PASSWORD, ids=" ".join)
def test_no_output_holds_a_password(
    capfdbinary: Capture, files: dict[str, Path], secret: Path, call: list[str]
) -> None:
    for capture in (ROOT / "captures" / "password.pcapng", secret):
        ran = run(capfdbinary, *[{**files, "HOSTILE": capture}.get(word, word) for word in call])
        assert ran.code in {0, 1, 2}
        for password in PASSWORDS:
            for form in forms(password):
                assert form not in ran.out.replace("\n", ""), form
                assert form not in ran.err


def test_the_captures_hold_them(secret: Path) -> None:
    """Otherwise the test above would try nothing."""
    recorded = (ROOT / "captures" / "password.pcapng").read_bytes()
    assert all(encode_password(password) in recorded for password in PASSWORDS[:2])
    assert encode_password(PASSWORDS[0]) in secret.read_bytes()
    assert PASSWORDS[2] in secret.read_bytes()
