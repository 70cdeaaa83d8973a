"""Regular expressions that would never end are refused; those that people write are not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dissect.meaning.select.errors import SelectError
from dissect.meaning.select.grammar import Literal
from dissect.meaning.select.patterns import searching, takes_too_long
from tests.cli.support import run, simple


@pytest.mark.parametrize(
    "pattern",
    [
        "(a+)+$",
        "(a*)*",
        "(a|a)*b",
        "(.*)*x",
        "([a-z]+)*=",
        "(?:a+){50}",
        "(a?){100}",
        "(\\w+\\s?)*$",
        "((a+)b?)+$",
        ".*a.*b.*c.*d",
        "(?=(a+)+$)",
        "(x)?(?(1)(a+)+|b)$",
        "(?>(a+)+)$",
    ],
)
def test_refused(pattern: str) -> None:
    re.compile(pattern)
    assert takes_too_long(pattern)


@pytest.mark.parametrize(
    "pattern",
    [
        "^security",
        "DB[0-9]+",
        "stop|start",
        "(foo|bar)+",
        "(\\d{1,3}\\.){3}\\d{1,3}",
        ".*",
        ".*tank.*level",
        "^(DB|M)\\d+\\.?",
        "[a-z]+_\\d*$",
        "(ab)+c",
        "",
        "(?i:read) .{0,20}var",
    ],
)
def test_taken(pattern: str) -> None:
    re.compile(pattern)
    assert not takes_too_long(pattern)


#: A thousand ways each; a pattern may have a thousand million.
K, KK = ".{0,999}", ".{0,999}.{0,999}"


@pytest.mark.parametrize(
    ("pattern", "refused"),
    [
        (KK + K, False),
        (KK + ".{1,1000}", False),
        (KK + ".{0,1000}", True),
        (KK + K + "x?", True),
        (KK + K + "xyz{3}", False),
        (K + ".{0,998}.*", False),  # a text is taken to have 1,000 characters: 1,001 ways
        (".{0,998}.*.*", True),
        (K + ".{0,990}.{0,5000}", False),
        (KK + K + ".{2000}", False),
        (KK + K + ".{999,5000}", True),
        ("(.{0,9}){9}", False),
        ("(.{0,9}){9}x?", True),
        ("(.{0,9}){10}", True),
        ("(.{0,9}){9,10}", True),
        (KK + ".{0,999}?", False),
        (KK + ".{0,999}+", False),
        (KK + ".{0,1000}?", True),
        (KK + ".{0,1000}+", True),
        (KK + "(.{0,1000})", True),
        (KK + f"(?={K})", False),
        (KK + "(?=.{0,1000})", True),
        (KK + "(?!.{0,1000})", True),
        (KK + f"(?>{K})", False),
        (KK + "(?>.{0,1000})", True),
        # Alternatives with beginnings of their own are tried one at a time; the one with most ways counts.
        (KK + f"(a{K}|b{K})", False),
        (KK + f"(a{K}|b)", False),
        (KK + f"(a{K}|b)x?", True),
        (KK + f"(b|a{K})x?", True),
        (KK + f"(a{K}|{K})", True),
        (KK + f"({K}|a)", True),
        (KK + f"(|a{K})", True),
        (KK + f"(a{K}|b|ac)", True),
        (KK + "(a.{0,499}|.)", False),
        (KK + "(a.{0,400}|.|b|c)", True),
        # Of a condition on a group, either part may be tried.
        (f"(x)?(?(1){K}|.{{0,9}}){K}.{{0,400}}", False),
        (f"(x)?(?(1){K}|.{{0,9}}){K}.{{0,600}}", True),
        (f"(x)?(?(1).{{0,9}}|{K}){K}.{{0,600}}", True),
        (f"(x)?(?(1){K}){K}.{{0,400}}", False),
        (f"(x)?(?(1){K}){K}.{{0,600}}", True),
    ],
)
def test_the_ways_of_parts_are_multiplied(pattern: str, refused: bool) -> None:
    re.compile(pattern)
    assert takes_too_long(pattern) is refused


def literal(text: str) -> Literal:
    return Literal(text, True, 7, 7 + len(text))


def test_a_pattern_finds_whatever_the_case_anywhere_in_a_text() -> None:
    found = searching(literal("b+c"))
    assert [text for text in ("abbC", "BC", "b", "", "cb") if found(text)] == ["abbC", "BC"]
    assert searching(literal(""))("")


def test_a_pattern_has_at_most_200_characters() -> None:
    assert searching(literal("a" * 200))("A" * 300)
    with pytest.raises(SelectError) as told:
        searching(literal("a" * 201))
    assert told.value.reason == "a pattern has at most 200 characters; this one has 201"
    assert (told.value.start, told.value.end) == (7, 208)


@pytest.mark.parametrize(
    ("pattern", "reason"),
    [
        ("(a", "invalid regular expression: missing ), unterminated subpattern at position 0"),
        ("a{99999999999}", "invalid regular expression: "),
        ("(a+)+", "this regular expression may take forever: a repetition within a repetition, or too many of them"),
    ],
)
def test_a_pattern_that_cannot_be_taken_is_marked(pattern: str, reason: str) -> None:
    with pytest.raises(SelectError) as told:
        searching(literal(pattern))
    assert told.value.reason.startswith(reason)
    assert (told.value.start, told.value.end) == (7, 7 + len(pattern))


def test_it_is_told_where(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    ran = run(capfdbinary, "transactions", path, "-Y", 'calling_tsap matches "(a+)+$"')
    assert ran.code == 2
    assert "this regular expression may take forever" in ran.err
