from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from dissect.testing.golden.difference import KINDS
from tests.cli.support import run, simple
from tests.meaning.report.support import saved
from tests.testing.golden.support import WRITTEN, reads

Capture = pytest.CaptureFixture[bytes]


def pair(folder: Path, *edits: tuple[str, str]) -> tuple[Path, Path]:
    """Write a golden, and the same with edits."""
    text = WRITTEN
    for old, new in edits:
        assert text.count(old) == 1
        text = text.replace(old, new)
    paths = folder / "a.s7.txt", folder / "b.s7.txt"
    for path, content in zip(paths, (WRITTEN, text), strict=True):
        path.write_text(content, encoding="utf-8")
    return paths


REFUSED = ("INT = 1234", "INT refused 0x0a")
OTHER = ("INT = 5", "INT = 6")


def test_the_same_says_nothing(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "diff", *pair(tmp_path))
    assert (ran.code, ran.out, ran.err) == (0, "", "")


def test_differences_in_words(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "diff", *pair(tmp_path, REFUSED, OTHER))
    assert (ran.code, ran.err) == (1, "")
    assert ran.out.splitlines() == [
        "transaction 2, READ DB10.DBW4: was 1234, is refused: Object does not exist (0x0a)",
        "transaction 3, WRITE DB10.DBW4: was 5, is 6",
    ]


def test_a_capture_beside_a_golden(capfdbinary: Capture, tmp_path: Path) -> None:
    capture, golden = simple(tmp_path / "a.pcapng"), tmp_path / "a.s7.txt"
    run(capfdbinary, "golden", capture, "-o", golden)
    assert run(capfdbinary, "diff", capture, golden).code == 0
    assert run(capfdbinary, "diff", golden, capture).code == 0
    shorter = simple(tmp_path / "b.pcapng", 2)
    ran = run(capfdbinary, "diff", golden, shorter)
    assert (ran.code, ran.out) == (1, "transaction 4, READ DB10.DBW4: missing (was 1234)\n")


@pytest.mark.parametrize(
    ("arguments", "left"),
    [
        (["--ignore", "codes"], 1),
        (["--ignore", "codes,values"], 0),
        (["--ignore", "codes", "--ignore", "values:DB10.*"], 0),
        (["--ignore", "values:DB10.DBW4"], 1),
        (["--ignore", "values:DB1.DBW4,codes:DB10.DBD*"], 2),
    ],
)
def test_what_is_ignored_is_not_told(capfdbinary: Capture, tmp_path: Path, arguments: list[str], left: int) -> None:
    ran = run(capfdbinary, "diff", *pair(tmp_path, REFUSED, OTHER), *arguments)
    assert (len(ran.out.splitlines()), ran.code) == (left, 1 if left else 0)


def test_output_is_bounded_and_the_rest_counted(capfdbinary: Capture, tmp_path: Path) -> None:
    a = saved(tmp_path / "a.pcapng", reads(*range(0, 40, 2)).packets())
    b = saved(tmp_path / "b.pcapng", reads().packets())
    ran = run(capfdbinary, "diff", a, b, "--max", "3")
    assert ran.code == 1
    assert ran.out.splitlines()[3:] == ["and 17 further differences"]
    told = json.loads(run(capfdbinary, "diff", a, b, "--max", "3", "-T", "json").out)
    assert (told["count"], told["not_shown"], len(told["differences"])) == (20, 17, 3)
    nothing = run(capfdbinary, "diff", a, b, "--max", "0")
    assert (nothing.code, nothing.out) == (1, "and 20 further differences\n")


def test_json(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "diff", *pair(tmp_path, REFUSED), "-T", "json")
    assert ran.code == 1
    told = json.loads(ran.out)
    assert (told["schema"], told["same"], told["count"]) == ("s7dissect.diff/1", False, 1)
    assert told["differences"] == [
        {
            "kind": "codes",
            "connection": 1,
            "connection_b": 1,
            "transaction": 2,
            "transaction_b": 2,
            "subject": "READ DB10.DBW4",
            "address": "DB10.DBW4",
            "was": "1234",
            "is": "refused: Object does not exist (0x0a)",
            "text": "transaction 2, READ DB10.DBW4: was 1234, is refused: Object does not exist (0x0a)",
        }
    ]
    same = json.loads(run(capfdbinary, "diff", *pair(tmp_path), "-T", "json").out)
    assert (same["same"], same["differences"]) == (True, [])


def test_junit_is_xml_whatever_stands_in_it(capfdbinary: Capture, tmp_path: Path) -> None:
    edits = (("protocol s7comm", "protocol <&\x08]]>"), REFUSED)
    ran = run(capfdbinary, "diff", *pair(tmp_path, *edits), "-T", "junit")
    assert ran.code == 1
    suite = ElementTree.fromstring(ran.out)
    assert (suite.tag, suite.get("tests"), suite.get("failures")) == ("testsuite", "1", "1")
    (case,) = suite
    (failure,) = case
    assert (case.get("name"), failure.get("type")) == ("connection 1", "codes,tsaps")
    assert "is <&\\x08]]>" in (failure.text or "")
    assert "Object does not exist (0x0a)" in (failure.text or "")
    same = ElementTree.fromstring(run(capfdbinary, "diff", *pair(tmp_path), "-T", "junit").out)
    assert (same.get("tests"), same.get("failures"), [list(case) for case in same]) == ("1", "0", [[]])


def test_junit_counts_what_is_not_shown(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "diff", *pair(tmp_path, REFUSED, OTHER), "-T", "junit", "--max", "1")
    suite = ElementTree.fromstring(ran.out)
    assert [case.get("name") for case in suite] == ["connection 1", "further differences"]
    assert suite.get("failures") == "2"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--ignore", "everything"], "'everything' is not a kind of difference; known kinds: connections"),
        (["--latency", "fast"], "'fast' is not a tolerance such as 20% or 5ms"),
        (["--max", "-1"], "-1 is not in the range"),
        (["-T", "html"], "'html' is not one of"),
    ],
)
def test_wrong_use(capfdbinary: Capture, tmp_path: Path, arguments: list[str], said: str) -> None:
    ran = run(capfdbinary, "diff", *pair(tmp_path), *arguments)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err


def test_what_cannot_be_read_is_an_error_and_no_difference(capfdbinary: Capture, tmp_path: Path) -> None:
    a, b = pair(tmp_path, ("INT = 1234", "INT = x"))
    ran = run(capfdbinary, "diff", a, b)
    assert (ran.code, ran.out) == (2, "")
    assert "b.s7.txt: line 15" in ran.err
    assert run(capfdbinary, "diff", a, tmp_path / "missing").code == 2
    assert "only one of A and B" in run(capfdbinary, "diff", "-", "-").err


def test_a_damaged_capture_is_compared_but_the_code_says_error(capfdbinary: Capture, tmp_path: Path) -> None:
    whole, cut = simple(tmp_path / "a.pcapng"), simple(tmp_path / "b.pcapng")
    cut.write_bytes(cut.read_bytes()[:-5])
    ran = run(capfdbinary, "diff", whole, cut)
    assert ran.code == 2
    assert "transaction 4, READ DB10.DBW4: was 1234, is unanswered" in ran.out
    assert "b.pcapng" in ran.err


def test_help_lists_what_can_be_ignored(capfdbinary: Capture) -> None:
    lines = run(capfdbinary, "diff", "--help").out.splitlines()
    at = lines.index("  Kinds of differences for --ignore:")
    said = " ".join(" ".join(lines[at + 1 :]).split())
    assert said == " ".join([f"{kind} {text}" for kind, text in KINDS.items()])
