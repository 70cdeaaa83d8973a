from __future__ import annotations

import pytest

from dissect.protocols.s7.start_information import OTHER_START, START_INFORMATION
from dissect.wire.layout import Layout
from tests.cases import each

SIZE = 20


@each("layout", [*START_INFORMATION.values(), OTHER_START])
def test_each_is_twenty_octets_with_the_time_at_the_end(layout: Layout) -> None:
    assert layout.size == SIZE
    assert not layout.open
    values = {value.field.name: value for value in layout.read(bytes(range(12)) + bytes.fromhex("2311142215306213"))}
    assert len(values) == len(layout.fields), "names are different"
    assert [values[name].value for name in ("event_class", "event", "priority", "ob")] == [0, 1, 2, 3]
    assert values["time"].meaning == "DT#2023-11-14-22:15:30.621"
    assert values["time"].end == SIZE


@pytest.mark.parametrize(
    ("ob", "octets", "name", "number"),
    [
        (1, "1101010100000001000200ff", "longest_cycle", 255),
        (20, "1121032000000005000003e8", "delay", 1000),
        (35, "113603230000000000000064", "interval", 0x64),
        (82, "39421a520054010000000000", "module_address", 0x100),
        (85, "39a31a550000000011010b21", "cause_ob", 0x21),
        (100, "138101640000430200000000", "stop", 0x4302),
        (121, "252201798800000600050010", "block_number", 5),
        (122, "29420f7a8181010000080012", "memory_address", 0x100),
    ],
)
def test_what_an_ob_tells(ob: int, octets: str, name: str, number: int) -> None:
    values = START_INFORMATION[ob].read(bytes.fromhex(octets) + bytes(8))
    assert {value.field.name: value.value for value in values}[name] == number
