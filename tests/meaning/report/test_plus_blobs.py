"""Compressed blobs as `show -V` shows them."""

from __future__ import annotations

import sys
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from dissect.meaning.report.plus_blobs import blob_lines, dictionaries
from dissect.meaning.report.tree import plus_tree_lines
from dissect.protocols.s7plus.message import parse_plus
from tests.protocols.s7plus.test_blobs import COMMENTS, DICTIONARY, TEXT, VERSION, compressed, download, one
from tests.protocols.s7plus.test_shared_captures import pdus


@pytest.fixture
def nothing_installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    dictionaries.cache_clear()
    monkeypatch.setitem(sys.modules, "s7commplus.zlib_dicts", None)
    yield
    dictionaries.cache_clear()


def test_xml_is_indented_and_escaped() -> None:
    text = b"\xef\xbb\xbf<?xml version='1.0'?><Block> <Title>pump \x1b[31m</Title>\r\n<Empty/><Part><!-- x --></Part></Block>"
    size = len(text)
    blob = VERSION + compressed(text)
    assert list(blob_lines(blob)) == [
        f"{len(blob)} bytes compressed, {size} bytes in all",
        "<?xml version='1.0'?>",
        "<Block>",
        "  <Title>pump \\x1b[31m</Title>",
        "  <Empty/>",
        "  <Part>",
        "    <!-- x -->",
        "  </Part>",
        "</Block>",
    ]


def test_no_more_lines_than_a_person_reads() -> None:
    lines = list(blob_lines(compressed(b"".join([b"<a>%d</a>" % number for number in range(1000)]))))
    assert len(lines) == 402
    assert lines[-1] == "… only the first 400 lines shown"
    deep = list(blob_lines(compressed(b"<a>" * 100)))
    assert deep[-1] == "  " * 20 + "<a>"


def test_octets_that_are_no_text_are_shown_all_the_same() -> None:
    lines = list(blob_lines(compressed(b"\xff\xfe\0\1 what")))
    assert lines[1] == "\ufffd\ufffd\\x00\\x01 what"


@pytest.mark.usefixtures("nothing_installed")
def test_without_the_extra_the_line_says_what_to_install() -> None:
    blob = VERSION + compressed(TEXT, DICTIONARY)
    (line,) = blob_lines(blob)
    assert line == (
        f"{len(blob)} bytes compressed, {len(TEXT)} bytes in all, not shown: they need dictionary "
        f"0x{zlib.adler32(DICTIONARY):08x}: pip install 's7dissect[s7plus]'"
    )
    assert list(blob_lines(VERSION + compressed(TEXT)))[1].startswith("<Comment")


def test_what_stays_closed_is_said() -> None:
    pytest.importorskip("s7commplus")
    (line,) = blob_lines(VERSION + compressed(TEXT, DICTIONARY))
    assert line.endswith("which s7commplus does not have")
    (line,) = blob_lines(VERSION + compressed(TEXT)[:-2])
    assert line.endswith("bytes compressed, which cannot be decompressed to the end")
    (line,) = list(blob_lines(compressed(bytes(20_000_000))))[:1]
    assert line.endswith("or more, which is too much: they stay closed")


def test_in_the_tree() -> None:
    octets = download((COMMENTS, one(VERSION + compressed(TEXT))))
    lines = list(plus_tree_lines(parse_plus(octets), b""))
    at = next(number for number, line in enumerate(lines) if "bytes compressed" in line)
    assert lines[at + 1].strip() == '<Comment RefID="26">'
    assert "the pump runs too long" in lines[at + 2]
    assert "relation" in lines[at + 4]


def test_every_blob_of_the_shared_captures_opens(corpus: Path) -> None:
    pytest.importorskip("s7commplus")
    found = empty = 0
    for path in sorted((corpus / "s7plus").glob("*.pcap*")):
        for pdu, contents in pdus(path):
            for begin, end in contents.blobs:
                first, *text = blob_lines(pdu.data[begin:end])
                assert first.endswith("in all"), (path.name, pdu.frame, first)
                assert not text or text[0].startswith("<"), (path.name, pdu.frame, text[0])
                found += bool(text)
                empty += not text
    assert (found, empty) == (119, 10)
