"""JUnit XML as its readers want it: the structure of Jenkins' junit-10.xsd, its counts right, whatever stands in it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import pytest

from dissect.cli.diff import SessionDifferences
from dissect.meaning.report.writers.junit import junit_outcome
from dissect.testing.golden.difference import KINDS, Difference
from dissect.testing.golden.model import Session
from dissect.testing.playback.server.service import Server
from tests.cases import each
from tests.cli.support import run, simple
from tests.meaning.report.support import OWN
from tests.testing.golden.support import WRITTEN
from tests.testing.playback.client.support import changed, free_port

Capture = pytest.CaptureFixture[bytes]

#: Element → attributes it must have, attributes it may have, elements in it.
ELEMENTS: Final = {
    "testsuite": ({"name", "tests", "failures", "errors"}, {"skipped", "time", "timestamp", "hostname"}, {"testcase"}),
    "testcase": ({"name", "classname"}, {"time"}, {"failure", "error", "skipped", "system-out", "system-err"}),
    "failure": ({"type", "message"}, set(), set()),
    "error": ({"type", "message"}, set(), set()),
}
#: XML 1.0, 2.2: what may stand in a document at all.
INVALID: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
#: Whatever a device, a file name or a hand may put there.
HOSTILE: Final = "\x00\x08\x0b\x1b[2J\x7f\x85\u202e\u2028\ufffe\uffff\ud800\udcff]]><![CDATA[<&\"'\n\t\r𝄞"


def suite_of(text: str) -> ElementTree.Element:
    """Return the test suite of a document, held to the structure and to its own counts."""
    assert text.startswith('<?xml version="1.0" encoding="utf-8"?>\n')
    assert INVALID.search(text) is None
    text.encode("utf-8")
    suite = ElementTree.fromstring(text)
    assert suite.tag == "testsuite"
    for element in suite.iter():
        required, optional, inner = ELEMENTS[element.tag]
        assert required <= set(element.keys()) <= required | optional
        assert {each.tag for each in element} <= inner
    cases = list(suite)
    assert int(suite.get("tests", "")) == len(cases)
    assert int(suite.get("failures", "")) == len(suite.findall("testcase/failure"))
    assert int(suite.get("errors", "")) == len(suite.findall("testcase/error"))
    assert suite.get("skipped") == "0"
    assert all(len(case) <= 1 for case in cases)
    names = [(case.get("classname"), case.get("name")) for case in cases]
    assert len(set(names)) == len(names)
    for failure in suite.findall("testcase/failure"):
        assert set(str(failure.get("type")).split(",")) <= {*KINDS, "more"}
        assert failure.get("message")
    return suite


def made(*differences: Difference, rest: int = 0, name: str = "a", damage: str = "") -> ElementTree.Element:
    """Return the suite of differences between two sessions."""
    a, b = Session(name), Session(name)
    a.damage = [damage] if damage else []
    return suite_of("\n".join([str(line) for line in junit_outcome(SessionDifferences(a, b, list(differences), rest))]))


def test_diffs_of_captures(capfdbinary: Capture) -> None:
    whole = [path for path in OWN if not path.name.startswith("cut-")]
    failures = 0
    for first, second in zip(whole[::4], whole[1::4], strict=False):
        ran = run(capfdbinary, "diff", first, second, "-T", "junit", "--max", "30")
        suite = suite_of(ran.out)
        assert (suite.get("failures") != "0") == (ran.code == 1)
        failures += int(str(suite.get("failures")))
    assert failures > 20


def test_what_cannot_stand_in_xml_is_escaped() -> None:
    difference = Difference("values", HOSTILE, (1, 1), (1, 1), HOSTILE, HOSTILE, (HOSTILE, HOSTILE))
    suite = made(difference, Difference("codes", "<>", (1, 1)), name=HOSTILE)
    (failure,) = suite.iter("failure")
    shown = "\\x00\\x08\\x0b\\x1b[2J\\x7f\\x85\\u202e\\u2028\\ufffe\\uffff\\ud800\\xff]]><![CDATA[<&\"'\\x0a\\x09\\x0d𝄞"
    assert failure.get("message") == f"{shown} (and 1 more)"
    assert failure.text == f"{shown}\n<>"
    assert failure.get("type") == "codes,values"
    assert suite.get("name") == f"s7dissect diff {shown} {shown}"


@each("code", [*range(0x20), 0x7F, 0x85, 0xD800, 0xDFFF, 0xFFFE, 0xFFFF, 0x1FFFE, 0x10FFFF])
def test_every_character_that_xml_refuses(code: int) -> None:
    suite = made(Difference("values", f"was {chr(code)}", (1, 1)))
    assert re.fullmatch(r"was \\[xuU][0-9a-f]{2,8}", str(suite[0][0].get("message")))


def test_nothing_to_compare_is_a_suite() -> None:
    assert list(made()) == []


def test_what_is_not_shown_is_a_case() -> None:
    suite = made(rest=3)
    assert [case.get("name") for case in suite] == ["further differences"]
    assert suite[0][0].get("message") == "3 further differences not shown"


def test_damage_is_a_case_with_an_error() -> None:
    suite = made(damage="a.pcap: cut \x1b off")
    (error,) = suite.iter("error")
    assert (error.get("type"), error.get("message")) == ("damaged", "a.pcap: cut \\x1b off")


def test_a_damaged_capture(capfdbinary: Capture, tmp_path: Path) -> None:
    whole, cut = simple(tmp_path / "a.pcapng"), simple(tmp_path / "b.pcapng")
    cut.write_bytes(cut.read_bytes()[:-5])
    ran = run(capfdbinary, "diff", whole, cut, "-T", "junit")
    suite = suite_of(ran.out)
    assert (ran.code, suite.get("failures"), suite.get("errors")) == (2, "1", "1")


def test_text_of_the_wire(capfdbinary: Capture, tmp_path: Path) -> None:
    """A protocol name of a golden is free text, and comes out in the failure."""
    a, b = tmp_path / "a\x1b<.s7.txt", tmp_path / "b&\udcff.s7.txt"
    a.write_text(WRITTEN, encoding="utf-8")
    b.write_text(WRITTEN.replace("protocol s7comm", "protocol <\x0c&\ufffe]]>"), encoding="utf-8")
    ran = run(capfdbinary, "diff", a, b, "-T", "junit")
    suite = suite_of(ran.out)
    assert (ran.code, ran.err) == (1, "")
    assert "is <\\x0c&\\ufffe]]>" in str(suite[0][0].text)
    assert "a\\x1b<.s7.txt" in str(suite.get("name"))
    assert "b&\\xff.s7.txt" in str(suite.get("name"))


def test_a_replay(capfdbinary: Capture, tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    with Server(changed(path, 0, 1, b"\x04\xd2", b"\x04\xd3")) as server:
        told = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}", "-T", "junit")
    gone = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{free_port()}", "-T", "junit")
    assert (told.code, suite_of(told.out).get("failures"), suite_of(told.out).get("errors")) == (1, "1", "0")
    assert (gone.code, suite_of(gone.out).get("errors")) == (2, "1")
    assert suite_of(gone.out).findall("testcase/error")[0].get("type") == "unreachable"
