"""Wanted places: what an item of another form, place or size says of them, compared with a plain memory of bits."""

from __future__ import annotations

import random
from pathlib import Path

from dissect.engine.pipeline import Options, Pipeline
from dissect.meaning.tags.loading import load_tags
from dissect.output.variables.choosing import Known, choose
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow
from dissect.output.variables.writers import line_end
from tests.cases import each
from tests.engine.transactions import talk as line
from tests.meaning.report.support import begun
from tests.output.variables.support import BIT, BYTE, INT, REAL, WORD, collected, db, reads, rows_of, writes
from tests.properties.messages import Item
from tests.properties.packets import Talk

_CHAR, _DWORD, _DINT, _COUNTER, _TIMER = 0x03, 0x06, 0x07, 0x1C, 0x1D
_FLAGS = "DB1.DBX0.3 Array[0..9] of BOOL = [false, true, true, false, false, true, false, true, … 10 in all]"
_TAGS = """address,type,name,unit,scale
DB1.DBX0.3,"Array[0..9] of BOOL",Flags,,
DB1.DBW4,"Array[1..3] of INT",Levels,mm,
DB1.DBB10,STRING[4],Name,,
DB1.DBX20.6,BOOL,Pump,,
T5,TIMER,Delay,,
DB1.DBW30,INT,Temp,°C,0.1
"""


def lines(rows: list[ValueRow]) -> list[str]:
    """What a line says of each row: address, type, value."""
    return [line_end(row, f"{row.address} {row.type}") for row in rows]


def seen(item: Item, content: bytes, *names: str) -> list[str]:
    return lines(rows_of(reads(begun(), 1, (item, content)), *names))


@each(
    ("name", "expected"),
    [
        ("DB1.DBX1.4", "DB1.DBX1.4 BOOL = true"),  # 0x11
        ("DB1.DBX1.1", "DB1.DBX1.1 BOOL = false"),
        ("DB1.DBB1", "DB1.DBB1 BYTE = 17"),
        ("DB1.DBW1", "DB1.DBW1 WORD = 4370"),
        ("DB1.DBD1", "DB1.DBD1 DWORD = 286397204"),
        ("DB1.DBL1", "DB1.DBL1 LWORD = 1230066625199609624"),
        ("DB1.DBB1 x2", "DB1.DBW1 WORD = 4370"),
        ("DB1.DBB1 x3", "DB1.DBB1 3 x BYTE = 11 12 13"),
        ("DB1.DBB0 x16", "DB1.DBB0 16 x BYTE = 10 11 12 13 14 15 16 17 18 19 1a 1b 1c 1d 1e 1f"),
        ("DB1.DBX1.3 x3", "DB1.DBX1.3 Array[0..2] of BOOL = [false, true, false]"),
        ("DB1.DBX1.4 x6", "DB1.DBX1.4 Array[0..5] of BOOL = [true, false, false, false, false, true]"),
        ("DB1.DBX1.4 x4", "DB1.DBX1.4 Array[0..3] of BOOL = [true, false, false, false]"),
        ("DB1.DBX1.0 x7", "DB1.DBX1.0 Array[0..6] of BOOL = [true, false, false, false, true, false, false]"),
        ("DB1.DBX1.0 x8", "DB1.DBB1 BYTE = 17"),
    ],
)
def test_the_form_of_a_place_inside_an_item_of_bytes(name: str, expected: str) -> None:
    """A place without a type is a number by its width; other octets are shown as such, several bits as truth values."""
    (line,) = seen(db(BYTE, 0, 16), bytes(range(0x10, 0x20)), name)
    assert line == expected


@each(
    ("item", "expected"),
    [
        (db(WORD, 0, 2), "DB1.DBD0 2 x WORD = [16706, 17220]"),
        (db(INT, 0, 2), "DB1.DBD0 2 x INT = [16706, 17220]"),
        (db(REAL, 0), "DB1.DBD0 REAL = 12.141422"),
        (db(_DWORD, 0), "DB1.DBD0 DWORD = 1094861636"),
        (db(_DINT, 0), "DB1.DBD0 DINT = 1094861636"),
        (db(_CHAR, 0, 4), "DB1.DBD0 4 x CHAR = 'ABCD'"),
        (db(BYTE, 0, 4), "DB1.DBB0 4 x BYTE = 41 42 43 44 'ABCD'"),
    ],
)
def test_a_place_that_is_exactly_an_item_has_its_form(item: Item, expected: str) -> None:
    for name in ("DB1.DBD0", "DB1.DBB0 x4", "DB1.DBW0 x2"):
        assert seen(item, b"ABCD", name) == [expected]


@each(
    ("item", "content", "name", "expected"),
    [
        (db(REAL, 0, 3), b"\x3f\x80\0\0" * 3, "DB1.DBD0 x3", "DB1.DBB0 3 x REAL = [1.0, 1.0, 1.0]"),
        (db(INT, 2, 5), b"\xff\xfe" * 5, "DB1.DBW2 x5", "DB1.DBB2 5 x INT = [-2, -2, -2, -2, -2]"),
        (db(BYTE, 2, 5), bytes(5), "DB1.DBB2 x5", "DB1.DBB2 5 x BYTE = 00 00 00 00 00"),
        (db(BYTE, 2, 2), bytes(2), "DB1.DBB2 x2", "DB1.DBB2 2 x BYTE = 00 00"),
        (db(BYTE, 2), b"\x10", "DB1.DBB2", "DB1.DBB2 BYTE = 16"),
        (
            Item(_TIMER, 3, 0, _TIMER, 5), b"\0\5\x12\x50\0\7", "T5 x3",
            "T5 3 x TIMER = ['S5T#50ms', 'S5T#25s', 'S5T#70ms']",
        ),
        (Item(_TIMER, 3, 0, _TIMER, 4), b"\0\5\x12\x50\0\7", "T5", "T5 TIMER = 'S5T#25s'"),
        (Item(_TIMER, 3, 0, _TIMER, 4), b"\0\5\x12\x50\0\7", "T6", "T6 TIMER = 'S5T#70ms'"),
        (Item(_COUNTER, 2, 0, _COUNTER, 4), b"\0\5\1\x50", "C5", "C5 COUNTER = 150"),
        (Item(WORD, 2, 0, _COUNTER, 4), b"\0\5\1\x50", "C5", "C5 COUNTER = 150"),  # whatever the item is read as
        (Item(_COUNTER, 4, 0, _COUNTER, 4), bytes(8), "C5 x2", "C5 DWORD = 0"),
    ],
)  # fmt: skip
def test_values_in_a_row_and_timers(item: Item, content: bytes, name: str, expected: str) -> None:
    """Values in a row are shown as values where an item says what they are."""
    assert seen(item, content, name) == [expected]


def named(folder: Path, talk: Talk, *names: str) -> list[tuple[str, str]]:
    path = folder / "tags.csv"
    path.write_text(_TAGS, encoding="utf-8")
    rows = rows_of(talk, *names, naming=load_tags([path]).naming())
    return [(row.name, line) for row, line in zip(rows, lines(rows), strict=True)]


@each(
    ("name", "expected"),
    [
        ("Flags", ("Flags", _FLAGS)),
        ("DB1.DBX0.3 x10", ("Flags", _FLAGS)),
        ("DB1.DBX0.4 x3", ("Flags[1..3]", "DB1.DBX0.4 3 x BOOL = [true, true, false]")),
        ("Flags[2]", ("Flags[2]", "DB1.DBX0.5 BOOL = true")),
        ("DB1.DBX0.5", ("Flags[2]", "DB1.DBX0.5 BOOL = true")),
        ("DB1.DBX0.2 x2", ("DB1.DBX0.2", "DB1.DBX0.2 Array[0..1] of BOOL = [true, false]")),
        ("Levels", ("Levels", "DB1.DBW4 Array[1..3] of INT = [-1, 2, -3] mm")),
        ("DB1.DBW4 x3", ("Levels", "DB1.DBW4 Array[1..3] of INT = [-1, 2, -3] mm")),
        ("DB1.DBW6 x2", ("Levels[2..3]", "DB1.DBW6 2 x INT = [2, -3] mm")),
        ("Levels[3]", ("Levels[3]", "DB1.DBW8 INT = -3 mm")),
        ("DB1.DBW5", ("DB1.DBW5", "DB1.DBW5 WORD = 65280")),
        ("Name", ("Name", "DB1.DBB10 STRING[4] = 'ab'")),
        ("DB1.DBB10 x6", ("Name", "DB1.DBB10 STRING[4] = 'ab'")),
        ("Pump", ("Pump", "DB1.DBX20.6 BOOL = true")),
        ("DB1.DBB20", ("DB1.DBB20", "DB1.DBB20 BYTE = 64")),
        ("Temp", ("Temp", "DB1.DBW30 INT = 21.5 °C")),
        ("DB1.DBW30", ("Temp", "DB1.DBW30 INT = 21.5 °C")),
        ("DB1.DBW30:WORD", ("DB1.DBW30", "DB1.DBW30 WORD = 215")),  # of the type that is asked for
    ],
)  # fmt: skip
def test_a_place_that_is_a_tag_or_some_of_its_elements(tmp_path: Path, name: str, expected: tuple[str, str]) -> None:
    content = bytearray(32)
    content[0:2] = bytes((0b00110100, 0b00000101))
    content[4:10] = b"\xff\xff\0\2\xff\xfd"
    content[10:14] = b"\4\2ab"
    content[20] = 0x40
    content[30:32] = b"\0\xd7"
    assert named(tmp_path, reads(begun(), 1, (db(BYTE, 0, 32), bytes(content))), name) == [expected]


def test_timers_by_their_tag(tmp_path: Path) -> None:
    talk = reads(begun(), 1, (Item(_TIMER, 3, 0, _TIMER, 4), b"\0\5\x12\x50\0\7"))
    for name in ("Delay", "T5"):
        assert named(tmp_path, talk, name) == [("Delay", "T5 TIMER = 'S5T#25s'")]


# ---- beside a memory of bits ----------------------------------------------------------------------------------------

_SIZE = 6
#: Places by their names: first bit, bits, and the form of the value. Items have other types.
_PLACES = {
    "DB1.DBX1.3 x11": ("DB1.DBX1.3", 11, 11, "bits"),
    "DB1.DBX2.2 x2": ("DB1.DBX2.2", 18, 2, "bits"),
    "DB1.DBX0.5 x3": ("DB1.DBX0.5", 5, 3, "bits"),
    "DB1.DBX1.0 x6": ("DB1.DBX1.0", 8, 6, "bits"),
    "DB1.DBX4.3 x5": ("DB1.DBX4.3", 35, 5, "bits"),
    "DB1.DBW2:INT": ("DB1.DBW2", 16, 16, "number"),
    "DB1.DBB3:SINT": ("DB1.DBB3", 24, 8, "number"),
}


class Memory:
    """Bits of a block, None where none was transferred yet."""

    def __init__(self) -> None:
        self.bits: list[bool | None] = [None] * (8 * _SIZE)

    def value(self, start: int, bits: int, form: str) -> object:
        found = self.bits[start : start + bits]
        if form == "bits":
            return found
        octets = [sum(bool(found[at + bit]) << bit for bit in range(8)) for at in range(0, bits, 8)]
        return int.from_bytes(bytes(octets), "big", signed=True)


@each("seed", range(4))
def test_places_of_bits_and_octets_say_what_a_memory_says(seed: int) -> None:
    """Each place that an item touches has a row once all of its bits are known; the item itself, if one is not."""
    roll = random.Random(seed)
    talk, memory = begun(), Memory()
    expected: list[tuple[str, object, bool]] = []
    for ref in range(1, 100):
        if roll.random() < 0.5:
            start = roll.randrange(8 * _SIZE)
            values = [roll.random() < 0.5]
            item, content = db(BIT, start // 8, bit=start % 8), bytes(values)
            own = f"DB1.DBX{start // 8}.{start % 8}"
        else:
            octets = roll.randrange(1, 4)
            start = 8 * roll.randrange(_SIZE - octets + 1)
            content = roll.randbytes(octets)
            values = [bool(octet >> bit & 1) for octet in content for bit in range(8)]
            item, own = db(BYTE, start // 8, octets), f"DB1.DBB{start // 8}"
        if roll.random() < 0.3:
            writes(talk, ref, (item, content, 0xFF))
        else:
            reads(talk, ref, (item, content))
        end = start + len(values)
        memory.bits[start:end] = values
        alone = False
        for address, begin, bits, form in sorted(_PLACES.values(), key=lambda place: place[1]):
            if begin >= end or start >= begin + bits:
                continue
            if None in memory.bits[begin : begin + bits]:
                alone = True
            else:
                whole = start <= begin and begin + bits <= end
                expected.append((address, memory.value(begin, bits, form), not whole))
        if alone:
            expected.append((own, "itself", False))
    rows = collected(ValueCollector(choose(list(_PLACES), Known(None))), talk.packets()).take()
    told = [
        (row.address, row.value if row.type in {"INT", "SINT"} or "Array" in row.type else "itself", row.pieced)
        for row in rows
    ]
    assert told == expected
    assert all(row.writes == (row.how == "write") for row in rows)
    assert len(expected) > 80
    assert any(value == "itself" for _, value, _ in expected)


@each(
    ("item", "content", "expected"),
    [
        (db(BYTE, 2), b"\x10", "DB1.DBB2 BYTE = 16"),
        (db(BYTE, 2, 2), b"\x10\x11", "DB1.DBB2 2 x BYTE = 10 11"),
        (db(BIT, 2, bit=3), b"\1", "DB1.DBX2.3 BOOL = true"),
        (db(WORD, 2), b"\x10\x11", "DB1.DBW2 WORD = 4113"),
        (db(WORD, 2, 2), b"\x10\x11\0\1", "DB1.DBW2 2 x WORD = [4113, 1]"),
        (db(_CHAR, 2, 3), b"abc", "DB1.DBB2 3 x CHAR = 'abc'"),
        (db(_CHAR, 2), b"a", "DB1.DBB2 CHAR = 'a'"),
        (db(REAL, 2), bytes(4), "DB1.DBD2 REAL = 0.0"),
        (Item(_TIMER, 1, 0, _TIMER, 5), b"\0\5", "T5 TIMER = 'S5T#50ms'"),
    ],
)
def test_an_item_of_which_no_place_is_wanted(item: Item, content: bytes, expected: str) -> None:
    assert seen(item, content) == [expected]


def test_an_item_whose_size_or_place_is_not_known_is_no_place() -> None:
    """Several bits may share bytes; bytes that begin inside a byte are none of any address. Their own address finds them."""
    talk = line.Talk()
    for item, octets, own, inside in (
        (line.item(0x84, 1, 32, BIT, 3), b"\1\0\1", "DB1.DBX4.0", "DB1.DBX4.1"),
        (line.item(0x84, 1, 35, BYTE, 2), b"\1\2", "DB1.DBB4.3", "DB1.DBB5"),
    ):
        for names, expected in (([own], [own]), ([inside], []), ([], [own])):
            collector = ValueCollector(choose(names, Known(None, [own])) if names else None)
            talk = line.Talk()
            talk.pipeline = Pipeline(collector, Options(strict=True))
            talk.open()
            talk.ask(line.read(1, item))
            talk.tell(line.ack_data(1, b"\x04\x01", line.good(9, octets)))
            assert [row.address for row in collector.take()] == expected
            assert collector.found == set(expected[: len(names)])


def test_the_areas_of_a_cpu_are_apart() -> None:
    """Blocks have numbers, other areas none, whatever the item says there."""
    areas = {0x81: "IW4", 0x82: "QW4", 0x83: "MW4", 0x84: "DB7.DBW4", 0x80: "PW4"}
    for wanted, name in areas.items():
        talk = begun()
        for ref, area in enumerate(areas, 1):
            reads(talk, ref, (Item(WORD, 1, 7, area, 32), bytes((0, area))))
        reads(talk, 9, (Item(WORD, 1, 8, 0x84, 32), b"\0\1"), (Item(WORD, 1, 0, 0x1C, 32), b"\0\1"))
        reads(talk, 10, (Item(WORD, 1, 0, 0x00, 32), b"\0\2"), (Item(WORD, 1, 0, 0x85, 32), b"\0\3"))
        assert [(row.address, row.value) for row in rows_of(talk, name)] == [(name, wanted)]
        assert [row.value for row in rows_of(talk, "area0x00:W4")] == [2]
        assert rows_of(talk, "DB32768.DBW4") == []


def test_items_of_unknown_types_are_their_bytes() -> None:
    """A transport size without a name is its number; another syntax has no type."""
    collector = ValueCollector()
    talk = line.Talk()
    talk.pipeline = Pipeline(collector, Options(strict=True))
    talk.open()
    talk.ask(line.read(1, line.item(0x84, 1, 32, 0), line.item(0x84, 1, 32, 0x31, 2), b"\x12\x04\xb1\1\2\3"))
    talk.tell(line.ack_data(1, b"\x04\x03", b"".join([line.good(4, b"\1\2")] * 3)))
    rows = collector.take()
    assert [(row.type, row.value, row.data) for row in rows] == [
        ("0x00", None, b"\1\2"), ("2 x 0x31", None, b"\1\2"), ("", None, b"\1\2"),
    ]  # fmt: skip
    assert {line_end(row, "=").partition(" = ")[2] for row in rows} == {"01 02"}


@each("seed", range(2))
def test_a_long_place_is_put_together_from_items_in_any_order(seed: int) -> None:
    roll = random.Random(seed)
    memory = roll.randbytes(40)
    pieces = [(at, min(3, 40 - at)) for at in range(0, 40, 3)]
    roll.shuffle(pieces)
    talk = begun()
    for ref, (at, size) in enumerate(pieces, 1):
        reads(talk, ref, (db(BYTE, at, size), memory[at : at + size]))
    reads(talk, 90, (db(BYTE, 30, 5), b"abcde"), (db(BYTE, 0, 40), bytes(40)))
    *_, whole, newer, zeros = [row for row in rows_of(talk, "DB1.DBB5 x31") if row.type == "31 x BYTE"]
    assert (whole.address, whole.data, whole.pieced) == ("DB1.DBB5", memory[5:36], True)
    expected = memory[5:30] + b"abcde" + memory[35:36]
    assert (newer.data, newer.value, newer.pieced) == (expected, list(expected), True)
    assert (zeros.data, zeros.pieced) == (bytes(31), False)
