"""Items of all protocols in one form: their place in bits, area, type, count, value, return code, name and unit."""

from __future__ import annotations

from typing import Any, Final

import pytest

from dissect.engine.transactions.naming import NamedValue, Naming
from dissect.meaning.select import items as of_items
from dissect.meaning.select.items import ItemFacts, ItemReader, area_code, plus_facts, scd_facts
from dissect.meaning.select.literals import ItemPlace
from dissect.protocols.s7.items import ItemResult, parse_item
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.items import PlusItem
from dissect.protocols.s7plus.value_tables import DINT, INT
from dissect.protocols.s7plus.values import Value
from dissect.scd.wording import Row
from tests.build import any_item
from tests.cases import each
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import Talk, dbw, read

DB: Final = 0x84


# ---- S7comm ---------------------------------------------------------------------------------------------------------


@each(
    ("octets", "place", "db", "type_", "count"),
    [
        (any_item(4, 1, 10, DB, 32), ItemPlace("DB10.DBW4", "DB10.DBW4", DB, 10, 32, 16), 10, "WORD", 1),
        (any_item(4, 3, 10, DB, 32), ItemPlace("DB10.DBW4", "DB10.DBW4 x3", DB, 10, 32, 48), 10, "WORD", 3),
        (any_item(1, 1, 10, DB, 33), ItemPlace("DB10.DBX4.1", "DB10.DBX4.1", DB, 10, 33, 1), 10, "BIT", 1),
        (any_item(1, 9, 10, DB, 33), ItemPlace("DB10.DBX4.1", "DB10.DBX4.1 x9", DB, 10, 33, 9), 10, "BIT", 9),
        (any_item(0x30, 2, 10, DB, 32), ItemPlace("DB10.DBL4", "DB10.DBL4 x2", DB, 10, 32, 128), 10, "", 2),
        (any_item(2, 5, 7, 0x85, 8), ItemPlace("DI7.DIB1", "DI7.DIB1 x5", 0x85, 7, 8, 40), 7, "BYTE", 5),
        (any_item(6, 1, 9, 0x83, 160), ItemPlace("MD20", "MD20", 0x83, 0, 160, 32), None, "DWORD", 1),
        (any_item(0x1D, 2, 0, 0x1D, 5), ItemPlace("T5", "T5 x2", 0x1D, 0, 5, 2), None, "TIMER", 2),
        (any_item(0x1C, 1, 0, 0x1C, 5), ItemPlace("C5", "C5", 0x1C, 0, 5, 1), None, "COUNTER", 1),
        (any_item(2, 4, 5, 0x01, 7), ItemPlace("RECORD5@7", "RECORD5@7 x4", 0x01, 5, 7, 32), None, "BYTE", 4),
        (any_item(4, 3, 5, 0x01, 7), ItemPlace("RECORD5@7", "RECORD5@7 x3", 0x01, 5, 7, 48), None, "WORD", 3),
        (any_item(1, 3, 5, 0x01, 7), ItemPlace("RECORD5@7", "RECORD5@7 x3", 0x01, 5, 7, 3), None, "BIT", 3),
    ],
)
def test_an_item_of_s7comm(octets: bytes, place: ItemPlace, db: int | None, type_: str, count: int) -> None:
    item = parse_item(octets, 0)
    facts = ItemReader().asked(item)
    assert facts.place is not None
    assert facts.place[2:] == place[2:]
    assert facts.place[:2] == (item.address, item.label)
    if place.area != 1:
        assert facts.place[:2] == place[:2]
    assert facts.area is not None
    assert facts.area.number == place.area
    assert facts.type is not None
    assert facts.type.number == octets[3]
    assert type_ in facts.type.names[0].upper()
    assert (facts.db, facts.count) == (db, count)
    assert (facts.return_code, facts.data, facts.values) == (None, None, [])


def test_an_item_whose_type_is_unknown_has_octets() -> None:
    facts = ItemReader().asked(parse_item(any_item(0x77, 3, 1, DB, 8), 0))
    assert facts.place is not None
    assert (facts.place.start, facts.place.size, facts.count) == (8, 24, 3)


def test_area_0_and_type_0_are_an_area_and_a_type() -> None:
    facts = ItemReader().asked(parse_item(any_item(0, 3, 0, 0, 8), 0))
    assert facts.place is not None
    assert (facts.place.area, facts.place.start, facts.place.size, facts.count) == (0, 8, 24, 3)
    assert facts.area is not None
    assert facts.type is not None
    assert (facts.area.number, facts.type.number, facts.db) == (0, 0, None)


def test_an_item_of_another_syntax_has_only_a_text() -> None:
    item = parse_item(bytes.fromhex("1208824101000100010101"), 0)
    facts = ItemReader().asked(item)
    assert facts.place == ItemPlace(item.address, item.label)
    assert (facts.area, facts.db, facts.type, facts.count) == (None, None, None, None)


def test_an_area_has_its_letter_and_its_name() -> None:
    assert area_code(0x83).names[0] == "M"
    assert len(area_code(0x83).names) == 2
    assert len(area_code(0x55).names) == 1
    assert area_code(0x55).number == 0x55


def test_a_result_has_what_was_asked_and_what_came() -> None:
    item = parse_item(any_item(4, 2, 1, DB, 0), 0)
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0, 2), dbw(2, 0)))
    talk.tell(line.ack_data(1, b"\x04\x02", line.good(4, b"\0\5\0\6") + line.refused(0x0A)))
    reader = ItemReader()
    first, second = reader.items(talk.transactions[0])
    assert first.place == reader.asked(item).place
    assert (first.values, first.data) == ([5, 6], b"\0\5\0\6")
    assert first.return_code is not None
    assert (first.return_code.number, first.return_code.names) == (0xFF, ("Success",))
    assert second.return_code is not None
    assert (second.return_code.number, second.values, second.data) == (0x0A, [], None)
    zero = reader.s7(ItemResult(item, 0, None, None))
    assert zero.return_code is not None
    assert zero.return_code.number == 0
    lost = reader.s7(ItemResult(None, -1, b"abc", None))
    assert (lost.place, lost.area, lost.return_code, lost.data) == (None, None, None, b"abc")


def test_the_facts_of_the_same_item_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of_items, "_MOST_KNOWN", 3)
    reader = ItemReader()
    several = [parse_item(any_item(4, 1, db, DB, 0), 0) for db in range(5)]
    first = [reader.asked(item) for item in several[:3]]
    assert [reader.asked(item) for item in several[:3]] == first
    assert all(reader.asked(item) is facts for item, facts in zip(several, first, strict=False))
    reader.asked(several[3])  # there is no room: all are forgotten
    assert [facts.db for facts in [reader.asked(item) for item in several]] == [0, 1, 2, 3, 4]
    assert reader.asked(several[0]) is not first[0]


def test_an_unfinished_transaction_is_read_again() -> None:
    """It has no outcome yet, so its answer may still come."""
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(line.words(1, 5))
    done: Any = talk.transactions[0]
    reader = ItemReader()
    assert reader.items(done) is reader.items(done)

    class Going:
        """A transaction that goes on."""

        is_plus = is_scd = False
        _carried = None
        _outcome = 0
        connection = done.connection
        s7_results: Final[list[ItemResult]] = []

    going: Any = Going()
    assert reader.items(going) == []
    going.s7_results.append(ItemResult(None, 0x0A, None, None))
    assert len(reader.items(going)) == 1
    assert reader.items(done)[0].values == [5]


def test_the_items_of_a_request_have_the_tags_of_their_connection() -> None:
    asked = [parse_item(any_item(4, 1, 1, DB, 0), 0)]
    reader = ItemReader()
    (plain,) = reader.requested(asked, None)
    assert plain is reader.asked(asked[0])
    assert (plain.tags, plain.of_tag("Level")) == ([], None)
    (named,) = reader.requested(asked, Tags([tag("Level", "INT"), tag("", "INT")]))
    assert [one.name for one in named.tags] == ["Level"]
    assert (named.return_code, named.place) == (None, plain.place)


# ---- tags -----------------------------------------------------------------------------------------------------------


def tag(name: str, type_: str, value: Any = None, address: str = "DB1.DBW0", unit: str = "") -> NamedValue:
    made = NamedValue(name, address, type_)
    made.value, made.unit = value, unit
    return made


class Tags(Naming):
    """The same tags for every item."""

    def __init__(self, tags: list[NamedValue]) -> None:
        super().__init__()
        self._tags = tags

    def named(self, result: ItemResult) -> list[NamedValue]:
        return self._tags


def with_tags(*tags: NamedValue) -> ItemFacts:
    return ItemReader().s7(ItemResult(parse_item(any_item(4, 1, 1, DB, 0), 0), 0xFF, None, None), Tags([*tags]))


def test_a_tag_is_an_item_of_its_own() -> None:
    level = tag("Tank.Level", "REAL", 3.5, "DB1.DBD4", "m")
    level.data = b"\x40\x60\0\0"
    facts = with_tags(tag("Tank", "INT", 7), level, tag("", "INT", 8)).of_tag("Tank.Level")
    assert facts is not None
    assert (facts.values, facts.name, facts.unit, facts.data, facts.count) == (
        [3.5],
        "Tank.Level",
        "m",
        b"\x40\x60\0\0",
        None,
    )
    assert facts.type is not None
    assert facts.type.names == ("REAL",)
    assert facts.place == ItemPlace("DB1.DBD4", "DB1.DBD4", DB, 1, 32, 32)
    assert (facts.db, facts.area, facts.return_code) == (1, area_code(DB), facts.return_code)
    assert facts.return_code is not None
    assert facts.return_code.number == 0xFF
    other = with_tags(tag("Tank", "", 7, "elsewhere")).of_tag("Tank")
    assert other is not None
    assert (other.type, other.unit, other.data) == (None, None, None)
    assert other.place == ItemPlace("DB1.DBW0", "DB1.DBW0", DB, 1, 0, 16)
    assert with_tags(tag("Tank", "INT")).of_tag("Level") is None


@each(
    ("name", "value"),
    [
        ("Curve[0]", None), ("Curve[1]", 10), ("Curve[3]", 30), ("Curve[4]", None), ("Curve[-1]", None), ("Curve[x]", None),
        ("Curve[]", None), ("Curv[1]", None), ("Low[-2]", 1), ("Low[0]", 3), ("Low[1]", None), ("Part[5]", 50), ("Part[6]", 60),
        ("Part[4]", None), ("Part[7]", None), ("Grid[1][2]", 7), ("One[1]", None), ("Part[5..6]", [50, 60]),
        ("Curve[1000000000]", None),
    ],
)  # fmt: skip
def test_an_element_of_an_array_is_found_by_its_index(name: str, value: Any) -> None:
    """An array that is covered wholly has its bounds in its type, a part of one in its name."""
    found = with_tags(
        tag("Curve", "Array[1..3] of INT", [10, 20, 30], unit="V"),
        tag("Low", "Array[-2..0] of SINT", [1, 2, 3]),
        tag("Part[5..6]", "Array[5..6] of INT", [50, 60]),
        tag("Grid[1][2..3]", "Array[2..3] of INT", [7, 8]),
        tag("One", "INT", 5),
        tag("Lost", "Array[1..3] of INT", None),
    ).of_tag(name)
    if value is None:
        assert found is None
        return
    assert found is not None
    assert found.values == (value if isinstance(value, list) else [value])
    assert found.name == name
    if name.startswith("Curve"):
        assert found.unit == "V"
        assert found.type is not None
        assert found.type.names == ("INT",)


# ---- values ---------------------------------------------------------------------------------------------------------


@each(
    ("value", "elements"),
    [
        (None, []), (5, [5]), (0, [0]), (False, [False]), ("", [""]), ([1, [2, None], 3], [1, 2, 3]),
        ([], []),
    ],
)  # fmt: skip
def test_values_in_values_are_one_list(value: Any, elements: list[object]) -> None:
    assert ItemFacts(tag("x", "INT", value)).values == elements


# ---- S7comm-plus and SCD --------------------------------------------------------------------------------------------


@each(
    ("area", "lids", "expected"),
    [
        ((0x8A0E << 16) | 7, [3, 4, 2], (DB, 7, 32, 16, 7)),
        ((0x8A0E << 16) | 7, [3, 0, 2], (DB, 7, 0, 16, 7)),
        ((0x8A0E << 16) | 7, [3, 4, 1, 5], (DB, 7, 37, 16, 7)),
        (82, [3, 20, 2], (0x83, 0, 160, 16, None)),
        (80, [3, 1, 1], (0x81, 0, 8, 16, None)),
        ((0x8A0E << 16) | 7, [14], (-1, 0, 0, 0, 7)),
        (82, [14], (-1, 0, 0, 0, None)),
        (50, [1], (-1, 0, 0, 0, None)),
    ],
)
def test_an_item_of_s7comm_plus(area: int, lids: list[int], expected: tuple[int, int, int, int, int | None]) -> None:
    item = PlusItem(1, VariableAddress(0, area, 0, lids), Value(0, INT, 5), 0)
    item.data = b"\0\5"
    facts = plus_facts(item)
    assert facts.place is not None
    place = facts.place
    assert ((place.area, place.db, place.start, place.size), facts.db) == (expected[:4], expected[4])
    assert place.text == place.label == item.label
    assert (facts.area.number if facts.area is not None else None) == (
        DB if area > 0xFFFF else {82: 0x83, 80: 0x81}.get(area)
    )
    assert (facts.values, facts.data) == ([5], b"\0\5")
    assert facts.type is not None
    assert facts.type.names == ("Int",)
    assert facts.return_code is not None
    assert (facts.return_code.number, facts.return_code.names) == (0xFF, ("Success",))
    item.data = None
    if place.area >= 0:
        assert plus_facts(item).place == place._replace(size=1)


def test_an_item_of_s7comm_plus_that_has_nothing_but_its_number() -> None:
    facts = plus_facts(PlusItem(3, None, None, -1))
    assert (facts.place, facts.area, facts.db, facts.type, facts.return_code) == (None,) * 5
    assert facts.values == []
    assert (facts.tags, facts.of_tag("x")) == ([], None)
    lowest = plus_facts(PlusItem(3, None, None, 1)).return_code
    assert lowest is not None
    assert lowest.number == 1
    refused = plus_facts(PlusItem(3, None, Value(0, DINT, 1), 0x13))
    assert refused.return_code is not None
    assert (refused.return_code.number, refused.place) == (0x13, None)
    assert refused.return_code.names == (PlusItem(3, None, None, 0x13).codes.name(0x13),)


@each(("name", "unit"), [("Pump", "kPa"), ("", "")])
def test_a_value_of_scd(name: str, unit: str) -> None:
    facts = scd_facts(Row("0x6001:2", name, 7, 0.7, unit, "", ()))
    assert facts.place == ItemPlace("0x6001:2", "0x6001:2")
    assert (facts.name, facts.unit) == (name or None, unit or None)
    assert facts.values == [0.7]
    assert (facts.area, facts.db, facts.return_code, facts.tags) == (None, None, None, [])
