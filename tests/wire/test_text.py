from __future__ import annotations

import csv
import io
import tracemalloc
import unicodedata

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.wire.text import (
    JsonTexts,
    cell,
    duration_text,
    encodable,
    hex_number,
    json_text,
    printable,
    shortened,
    titled,
)

ANY = st.text(st.characters())  # surrogates included


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("DB10.DBW4 = 1234", "DB10.DBW4 = 1234"),
        ("Förderband Nº 1 → 主泵", "Förderband Nº 1 → 主泵"),
        ("", ""),
        ("\x1b[31mred\x1b[0m", "\\x1b[31mred\\x1b[0m"),
        ("a\tb\r\nc\x00\x7f", "a\\x09b\\x0d\\x0ac\\x00\\x7f"),
        ("\x9b31m", "\\x9b31m"),  # the C1 form of the escape sequence
        ("abc\u202edcba", "abc\\u202edcba"),
        ("\u2066x\u2069\u200b\ufeff", "\\u2066x\\u2069\\u200b\\ufeff"),
        ("\u2028\u2029", "\\u2028\\u2029"),
        ("\udcff\udc80", "\\xff\\x80"),  # octets of a file name that is no UTF-8
        ("\ud800", "\\ud800"),
        ("\U000e0041\U0010ffff", "\\U000e0041\\U0010ffff"),
    ],
)
def test_what_does_not_simply_print_is_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown


@given(ANY)
def test_printable_text_has_nothing_that_steers(text: str) -> None:
    shown = printable(text)
    assert not {unicodedata.category(character) for character in shown} & {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
    assert printable(shown) == shown
    shown.encode()


@given(ANY)
@example("ok\udcff\x1b")
def test_encodable_text_changes_only_what_utf8_cannot_hold(text: str) -> None:
    shown = encodable(text)
    shown.encode()
    if not any("\ud800" <= character <= "\udfff" for character in text):
        assert shown == text


def test_an_octet_that_is_no_utf8_shows_as_the_octet() -> None:
    assert encodable("caf\udce9\x1b.pcap") == "caf\\xe9\x1b.pcap"


def test_long_text_is_cut_with_its_length() -> None:
    assert shortened("abcdef", 6) == "abcdef"
    assert shortened("abcdefg", 6) == "abcdef… (7 characters)"
    assert shortened("\x1b" * 3, 2) == "\\x1b\\x1b… (3 characters)"  # never cut within an escape


@pytest.mark.parametrize(
    ("text", "safe"),
    [
        ("=1+1", "'=1+1"),
        ("+cmd|' /C calc'!A0", "'+cmd|' /C calc'!A0"),
        ("-2+3", "'-2+3"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("\uff1d1+1", "'\uff1d1+1"),
        ("\t=1", "\\x09=1"),
        ("\r=1", "\\x0d=1"),
        ("DB1.DBB0 = 'x;=1+1'", "DB1.DBB0 = 'x;'=1+1'"),
        ("a; -b", "a; '-b"),
        ("a = [-1, -2]; b = -3", "a = [-1, -2]; b = -3"),
        ("-12", "-12"),
        ("+1.5", "+1.5"),
        ("-1e5", "-1e5"),
        ("-nan", "'-nan"),
        ("-1_0", "'-1_0"),
        ("-\u0661", "'-\u0661"),
        ("10.0.0.1:102", "10.0.0.1:102"),
        ("", ""),
    ],
)
def test_no_cell_is_taken_for_a_formula(text: str, safe: str) -> None:
    assert cell(text) == safe


@given(ANY)
@example(" =1+1")
@example("\xa0@x")
def test_a_cell_is_safe_in_any_row(text: str) -> None:
    safe = cell(text)
    row = io.StringIO()
    csv.writer(row, lineterminator="\n").writerow(["1", safe, "2"])
    assert row.getvalue().count("\n") == 1
    assert next(csv.reader([row.getvalue()])) == ["1", safe, "2"]
    for piece in safe.split(";"):
        first = piece.lstrip()[:1]
        assert first not in {"=", "@", "\uff1d", "\uff20"}


@pytest.mark.parametrize(
    ("name", "about", "text"),
    [
        ("CPU functions: read SZL", "SZL 0x0011 module identification", "CPU functions: read SZL 0x0011 module identification"),
        ("read SZL", "SZLs", "read SZL SZLs"),  # only a whole word is the same
        ("Read Var", "DB1.DBW0", "Read Var DB1.DBW0"),
        ("Read Var", "", "Read Var"),
        ("", "SZL 0x0011", "SZL 0x0011"),
    ],
)  # fmt: skip
def test_a_word_that_ends_the_name_and_begins_what_it_is_about_stands_once(name: str, about: str, text: str) -> None:
    assert titled(name, about) == text


@given(st.integers(0, 2_000_000_000))
@example(9_999)
@example(10_000)
@example(999_499)
@example(999_500)
@example(99_994_999)
@example(99_995_000)
@example(2_500)  # ties, which format() rounds to even where they are exact
@example(12_500)
@example(13_500)
@example(1_005_000)
@example(1_015_000)
def test_durations_are_rounded_as_format_does(ns: int) -> None:
    if ns < 10_000:
        expected = f"{ns / 1e3:.1f} µs" if ns else "0 µs"
    elif ns < 999_500:
        expected = f"{ns / 1e3:.0f} µs"
    elif ns < 999_500_000:
        expected = f"{ns / 1e6:.{2 if ns < 99_995_000 else 0}f} ms"
    else:
        expected = f"{ns / 1e9:.2f} s"
    assert duration_text(ns) == expected


def test_a_number_in_hexadecimal_has_at_least_so_many_digits() -> None:
    for digits in range(1, 9):
        for number in (0, 1, 9, 10, 15, 16, 255, 256, 4095, 4096, 65535, 65536, 0xFFFFFFFF):
            assert hex_number(number, digits) == f"0x{number:0{digits}x}"


@given(st.lists(st.text(max_size=250), max_size=30))
def test_texts_that_are_kept_are_escaped_as_any(texts: list[str]) -> None:
    kept = JsonTexts()
    assert [kept.of(text) for text in texts * 2] == [json_text(text) for text in texts * 2]


@pytest.mark.parametrize(("digits", "most"), [(8, 1_500_000), (250, 100_000)], ids=["many", "long"])
def test_kept_texts_are_bounded(digits: int, most: int) -> None:
    kept = JsonTexts()
    tracemalloc.start()
    for number in range(20_000):
        assert kept.of(f"{number:0{digits}}\x7f").endswith('\\u007f"')
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert size < most
