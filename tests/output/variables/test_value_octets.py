"""Values that are written from their octets are written as those that were decoded first."""

from __future__ import annotations

import random
from typing import Final

from librt.strings import BytesWriter

from dissect.meaning.report import words
from dissect.meaning.report.writers.csv import quoted
from dissect.output.variables.model import SharedValue, Variable
from dissect.output.variables.value_octets import write_cell, write_hex, write_json, write_shown
from dissect.output.variables.writers import any_text, value_cell
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7.values import decode_value
from tests.cases import each

#: Octets that values are seldom made of: numbers that are none, texts, times that no digit has.
_ODD: Final = (
    bytes.fromhex("7f800000"), bytes.fromhex("ffc00001"), bytes(4), bytes.fromhex("80000000"), b"=1+1", b"a\"',;",
    b"\x0a\x04text", bytes.fromhex("2aaa"), bytes.fromhex("0999"), bytes.fromhex("00000001"), bytes.fromhex("4b000000"), b"",
    b"abcdefghi" * 5, b"x" * 36, b"y" * 37,
)  # fmt: skip


def contents(seed: int) -> list[bytes]:
    """Return octets of values of many sizes."""
    chance = random.Random(seed)
    made = [chance.randbytes(chance.choice((1, 1, 2, 2, 4, 4, 3, 8, 16, 40))) for _ in range(40)]
    return [*made, *_ODD, *[octets * 3 for octets in _ODD], *[octets * 20 for octets in _ODD]]


@each("size", range(0x40))
def test_the_same_from_octets(size: int) -> None:
    variable = Variable(Endpoint(bytes((10, 0, 0, 1)), 102), 0, "DB1.DBB0", "", "", "")
    for data in contents(size):
        value = decode_value(size, data)
        for write, said in (
            (write_shown, "" if value is None else words.value(value, data)),
            (write_json, any_text(value)),
            (write_cell, quoted(value_cell(variable, value, data))),
        ):
            out = BytesWriter()
            out.write(b"before")
            written = write(out, SharedValue(data, size))
            assert out.getvalue().decode() == f"before{said if written else ''}", (write.__name__, data)
        out = BytesWriter()
        said = words.octets(data) if write_hex(out, data) else ""
        assert out.getvalue().decode() == said


def test_usual_values_are_written_from_their_octets() -> None:
    for size, data in (
        (0x01, b"\1"),
        (0x02, b"\7"),
        (0x04, b"\1\2" * 9),
        (0x08, bytes(8)),
        (0x0B, bytes(4)),
        (0x0C, b"\0\1"),
    ):
        for write in (write_shown, write_json, write_cell):
            assert write(BytesWriter(), SharedValue(data, size)), (write.__name__, size)


def test_a_value_is_decoded_once_and_only_when_it_is_asked_for() -> None:
    told = SharedValue(b"\0\5", 0x05)
    assert int(told.coded) == 0x05
    assert told.value == 5
    assert int(told.coded) == -1
    assert told.value == 5
