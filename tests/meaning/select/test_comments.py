"""A finding as the comment of a packet."""

from __future__ import annotations

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.meaning.select.comments import finding_comment, frames_in_words
from tests.meaning.report.support import UNSAFE


def test_a_comment_says_all_on_one_line() -> None:
    finding = Finding(CATALOGUE["transaction.slow"], 2, [7, 8], 0, "1.5 s\r\nfor \x1b[2J\u202e")
    assert finding_comment(finding) == (
        "s7dissect: warning transaction.slow: An answer took longer than the limit. "
        "1.5 s\\x0d\\x0afor \\x1b[2J\\u202e (connection 2)"
    )


def test_a_comment_about_the_capture_names_no_connection() -> None:
    for rule in CATALOGUE.values():
        said = finding_comment(Finding(rule, 0, [], 0, ""))
        assert said == f"s7dissect: {rule.severity} {rule.slug}: {rule.sentence}"
        assert UNSAFE.search(said) is None


def test_packets_in_words() -> None:
    assert frames_in_words([]) == "the capture"
    assert frames_in_words([8]) == "packet 8"
    assert frames_in_words([8, 9]) == "packets 8, 9"
    assert frames_in_words(list(range(1, 9))) == "packets 1, 2, 3, 4, 5, 6, 7, 8"
    assert frames_in_words(list(range(1, 10))) == "packets 1, 2, 3, 4, 5, 6, 7, 8 and 1 more"
    assert frames_in_words(list(range(1, 12))) == "packets 1, 2, 3, 4, 5, 6, 7, 8 and 3 more"
