"""`--fail-on`: a finding becomes an exit code."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.engine.findings.catalogue import CATALOGUE, ERROR, SEVERITIES
from dissect.meaning.report.slugs import slugs_of
from tests.cli.support import run, simple
from tests.meaning.report.support import begun, read, saved
from tests.properties.packets import MS

Capture = pytest.CaptureFixture[bytes]

COMMANDS = ("analyze", "transactions", "show")


def test_a_severity_is_that_or_worse() -> None:
    for place, severity in enumerate(SEVERITIES):
        found = slugs_of(severity)
        assert {CATALOGUE[slug].severity for slug in found} == set(SEVERITIES[: place + 1])
    assert slugs_of("note") == set(CATALOGUE)


def test_a_slug_is_itself_and_a_prefix_is_all_that_begin_so() -> None:
    assert slugs_of("transaction.slow") == {"transaction.slow"}
    assert slugs_of("tpkt.*") == {slug for slug in CATALOGUE if slug.startswith("tpkt.")}
    assert slugs_of("*") == set(CATALOGUE)


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ("transaction.slwo", "transaction.slow"),
        ("slow", "transaction.slow"),
        ("transaction", "transaction.refused"),
        ("sesion.*", "session.*"),
        ("warnings", "warning"),
        ("zzz", "s7dissect help findings"),
        ("", "s7dissect help findings"),
    ],
)
def test_what_means_nothing_names_what_is_near(text: str, near: str) -> None:
    with pytest.raises(ValueError, match="is neither a severity nor a finding") as told:
        slugs_of(text)
    assert near in str(told.value)


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    """A capture with a refused item (a warning) and nothing heavier."""
    return simple(tmp_path / "odd.pcapng")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("wanted", "code"),
    [
        (["warning"], 1),
        (["note"], 1),
        (["error"], 0),
        (["transaction.item_error"], 1),
        (["transaction.*"], 1),
        (["tpkt.*"], 0),
        (["tpkt.*", "transaction.item_error"], 1),
    ],
)
def test_1_when_there_is_such_a_finding(
    capfdbinary: Capture, odd: Path, command: str, wanted: list[str], code: int
) -> None:
    plain = run(capfdbinary, command, odd)
    assert (plain.code, plain.err) == (0, "")
    ran = run(capfdbinary, command, *[word for what in wanted for word in ("--fail-on", what)], odd)
    assert (ran.code, ran.out) == (code, plain.out)
    assert ran.err == ("s7dissect: --fail-on: transaction.item_error (1)\n" if code else "")


@pytest.mark.parametrize("command", COMMANDS)
def test_2_for_what_is_no_finding(capfdbinary: Capture, odd: Path, command: str) -> None:
    ran = run(capfdbinary, command, "--fail-on", "transaction.slwo", odd)
    assert (ran.code, ran.out) == (2, "")
    assert "did you mean transaction.slow" in ran.err
    assert ran.err.endswith("?\n"), "a question has no full stop"


def test_the_heaviest_is_named_first(capfdbinary: Capture, tmp_path: Path) -> None:
    flow = begun()
    flow.send(0, b"\x03\x00\x00\x05\x00")
    path = saved(tmp_path / "a.pcapng", read(flow, 1).packets())
    ran = run(capfdbinary, "analyze", "--fail-on", "note", path)
    assert CATALOGUE["tpkt.bad_length"].severity == ERROR
    assert ran.err.startswith("s7dissect: --fail-on: tpkt.bad_length (1)")


def test_a_damaged_file_with_such_a_finding_gives_1(capfdbinary: Capture, tmp_path: Path, odd: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes(odd.read_bytes()[:-30])
    assert run(capfdbinary, "analyze", "--fail-on", "error", cut).code == 3
    ran = run(capfdbinary, "analyze", "--fail-on", "capture.damaged", cut)
    assert ran.code == 1
    assert ran.err.splitlines()[-1] == "s7dissect: --fail-on: capture.damaged (1)"


@pytest.mark.parametrize("command", ["analyze", "transactions"])
def test_what_is_slow_is_what_the_command_was_told(capfdbinary: Capture, tmp_path: Path, command: str) -> None:
    packets = read(begun(), 1).packets()
    packets[-1] = packets[-1]._replace(time_ns=packets[-1].time_ns + 29 * MS)
    path = saved(tmp_path / "slow.pcapng", packets)
    assert run(capfdbinary, command, "--fail-on", "transaction.slow", path).code == 0
    assert run(capfdbinary, command, "--slow", "20", "--fail-on", "transaction.slow", path).code == 1
