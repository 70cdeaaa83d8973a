"""The text of a TOML file and its tables."""

from __future__ import annotations

import pytest

from dissect.scd.errors import DictionaryError
from dissect.scd.toml_tables import parse_tables, source_text


@pytest.mark.parametrize(
    ("text", "line", "detail"),
    [
        ("a = 1\na = 2\n", 2, "Cannot overwrite a value"),
        ("\na = ", 2, "Invalid value"),
        ("\n" + ".".join("a" * 18) + " = 1", 2, "a key of more than 16 parts"),
        ("\n\na = " + "1" * 5000, 3, "a number of too many digits"),
        ("a = " + "[" * 5000, 0, "arrays are nested too deeply"),
    ],
)
def test_what_is_no_toml(text: str, line: int, detail: str) -> None:
    with pytest.raises(DictionaryError) as caught:
        parse_tables(text, "x.toml")
    assert (caught.value.path, caught.value.line) == ("x.toml", line)
    assert caught.value.detail.startswith(detail)


def test_what_is_no_text() -> None:
    assert source_text("Насос".encode(), "") == "Насос"
    with pytest.raises(DictionaryError, match=r"x\.toml:3: byte 3: invalid UTF-8"):
        source_text(b"a\n\n\xff", "x.toml")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "utf-32"])
def test_byte_order_marks_are_read(encoding: str) -> None:
    text = '[dictionary]\nname = "Насос"\n'
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    assert source_text((mark + text).encode(encoding), "x.toml") == text


def test_what_a_mark_says_and_is_not() -> None:
    with pytest.raises(DictionaryError, match=r"x\.toml:2: byte 6: invalid UTF-16-LE, which its byte order mark says it is"):
        source_text(b"\xff\xfe\x0a\x00\x61\x00"[:4] + b"\x0a\x00"[:0] + b"\x61\x00\x00", "x.toml")
    with pytest.raises(DictionaryError, match="save the file as UTF-8"):
        source_text("имя".encode("cp1251"), "x.toml")
