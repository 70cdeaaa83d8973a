"""Messages in words: subjects, values, and that nothing of a dictionary or the wire reaches a terminal as it is."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect import scd
from dissect.scd.messages import Message
from dissect.scd.wording import Row, json_value, physical_text, row_text, rows, subject, value_text, values_text
from tests.meaning.bindings import plant
from tests.meaning.report.support import UNSAFE


@pytest.mark.parametrize(
    ("octets", "said"),
    [
        (plant.pdo(), "PDO T1 Состояние 1"),
        (plant.ask("Насос 1.run"), "read 0x6000:1 Насос 1.run"),
        (plant.ask("Насос 1.run", value=True), "write 0x6000:1 Насос 1.run"),
        (plant.tell("Расход 1", 5), "read 0x6044:0 Расход 1"),
        (plant.ask("0x6fff"), "read 0x6fff:0"),
        (plant.ask("0x1a00:2"), "read 0x1a00:2 mapping of T1"),
        (plant.ask("0x6000:255"), "read 0x6000:255"),
        (b"\xdc\x10", "message"),
        (bytes.fromhex("DC3F") + bytes(8), "message"),
        (bytes.fromhex("DC10000000600000 0000"), "PDO"),
    ],
)
def test_subjects(octets: bytes, said: str) -> None:
    assert subject(plant.dictionary(), plant.codec().parse_message(octets)) == said


def told(octets: bytes) -> list[str]:
    return [row_text(row) for row in rows(plant.dictionary(), plant.codec().parse_message(octets))]


@pytest.mark.parametrize(
    ("octets", "said"),
    [
        (plant.tell("Давление 1", 2748), ["0x6001:0 Давление 1 = 1374 кПа"]),
        (plant.tell("Режим 1", 8), ["0x6061:0 Режим 1 = 8 (автомат)"]),
        (plant.tell("Режим 1", 5), ["0x6061:0 Режим 1 = 5"]),
        (plant.tell("Насос 1.run", False), ["0x6000:1 Насос 1.run = false"]),
        (plant.tell("Имя станции", "Насосная"), ['0x2002:0 Имя станции = "Насосная"']),
        (plant.tell("Журнал", b"\x01\x02"), ["0x2003:0 Журнал = 2 bytes 01 02"]),
        (plant.tell("Журнал", b""), ["0x2003:0 Журнал = 0 bytes"]),
        (
            plant.tell("Последняя авария.time", scd.NetTime(0, 1)),
            ["0x2000:1 Последняя авария.time = 1970-01-01T00:00:00.000000001Z"],
        ),
        (plant.ask("Давление 1", 2), ["0x6001:0 Давление 1 = 1 кПа [access]"]),
        (plant.tell("0x6000:255", 9), ["0x6000:255 = 9"]),
    ],
)
def test_values(octets: bytes, said: list[str]) -> None:
    assert told(octets) == said


def test_entries_of_a_mapping_say_what_they_point_at() -> None:
    number = plant.entry("Расход 1", 32, 8)
    assert [
        row.text for row in rows(plant.dictionary(), plant.codec().parse_message(plant.ask("0x1a00:2", number)))
    ] == ["0x6044:0, 32 bits from bit 8"]
    odd = plant.codec().parse_message(plant.ask("0x1a00:2", (1 << 64) - 1))
    (row,) = rows(plant.dictionary(), odd)
    assert row.value == (1 << 64) - 1


def test_fields_of_a_bare_struct_go_by_name() -> None:
    decoded = plant.codec().decode_type("pump_t", bytes.fromhex("01C805"))
    message = Message(content="pump_t", index=0x0040, values=decoded.values)
    assert [row_text(row) for row in rows(plant.dictionary(), message)] == [
        "pump_t.run run = true", "pump_t.fault fault = false", "pump_t.speed speed = 1480 об/мин",
    ]  # fmt: skip
    assert subject(plant.dictionary(), message) == "pump_t"


def row(value: Any, name: str = "n", unit: str = "", text: str = "") -> Row:
    return Row("0x6000:0", name, value, value, unit, text, ())


def test_a_line_names_eight_values_and_counts_the_rest() -> None:
    assert values_text([row(1, "a"), row(True, "b")]) == "a = 1, b = true"
    assert values_text([row(number, "") for number in range(11)]).endswith("0x6000:0 = 7 and 3 more")
    assert values_text([row(1, "a = b")]) == "a = b = 1"


@pytest.mark.parametrize(
    ("value", "text", "told_in_json"),
    [
        (True, "true", True),
        (-5, "-5", -5),
        (0.1, "0.1", 0.1),
        (1 / 3, "0.3333333", 1 / 3),
        (float("nan"), "nan", "nan"),
        (b"\x01\xff", "2 bytes 01 ff", "01ff"),
        ("ok", '"ok"', "ok"),
        (scd.MAC(bytes(6)), "00:00:00:00:00:00", "00:00:00:00:00:00"),
        (scd.Interval(-1, -5), "-PT1.000000005S", "-PT1.000000005S"),
    ],
)
def test_one_value(value: Any, text: str, told_in_json: object) -> None:
    assert value_text(value) == text
    assert json_value(value) == told_in_json


@given(st.one_of(st.text(), st.binary(), st.floats(), st.integers(), st.booleans()), st.text(), st.text(), st.text())
def test_whatever_it_is_a_line_stays_a_line(value: Any, name: str, unit: str, text: str) -> None:
    shown = row(value, name, unit, text)
    for line in (value_text(value), row_text(shown), physical_text(shown), values_text([shown])):
        assert not UNSAFE.search(line)
    json.dumps(json_value(value), allow_nan=False)


def test_long_values_are_shortened() -> None:
    assert len(value_text("x" * 1000)) < 90
    assert value_text(bytes(1000)).startswith("1000 bytes 00 00")
    assert len(value_text(bytes(1000))) < 110
