from __future__ import annotations

from dissect.wire.hexdump import hexdump
from tests.cases import each


def test_sixteen_octets_a_line_with_what_they_print_as() -> None:
    octets = bytes(range(0x38, 0x48)) + b"\x00\x7f\xff"
    assert hexdump(octets) == [
        "    0  38 39 3a 3b 3c 3d 3e 3f  40 41 42 43 44 45 46 47  89:;<=>?@ABCDEFG",
        "   16  00 7f ff                                          ...",
    ]


def test_counting_may_begin_anywhere() -> None:
    assert hexdump(b"AB", 1000) == [" 1000  41 42                                             AB"]


def test_lines_may_be_indented() -> None:
    assert hexdump(bytes(range(20)), 5, [(1, 2)], "  ") == [
        "  " + line for line in hexdump(bytes(range(20)), 5, [(1, 2)])
    ]


def test_nothing_gives_no_line() -> None:
    assert hexdump(b"") == []


@each("size", range(1, 34))
def test_the_octets_and_the_columns_are_right_for_every_size(size: int) -> None:
    octets = bytes((7 * index) & 0xFF for index in range(size))
    lines = hexdump(octets)
    assert bytes.fromhex("".join([line[7:55] for line in lines])) == octets
    assert [int(line[:5]) for line in lines] == list(range(0, size, 16))
    assert "".join([line[57:] for line in lines]) == "".join(
        [chr(octet) if 0x20 <= octet < 0x7F else "." for octet in octets]
    )


def test_hidden_octets_are_stars() -> None:
    octets = bytes(range(0x41, 0x41 + 34))
    assert hexdump(octets, 0, [(15, 33)]) == [
        "    0  41 42 43 44 45 46 47 48  49 4a 4b 4c 4d 4e 4f **  ABCDEFGHIJKLMNO*",
        "   16  ** ** ** ** ** ** ** **  ** ** ** ** ** ** ** **  ****************",
        "   32  ** 62                                             *b",
    ]
    assert hexdump(octets, 0, [(40, 50)]) == hexdump(octets)
