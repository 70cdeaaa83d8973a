from __future__ import annotations

import pytest

from dissect.protocols.iso import tables


@pytest.mark.parametrize("name", ["ED", "EA", "UD", "RJ", "AK", "ER", "DR", "DC", "CC", "CR", "DT"])
def test_constants_are_the_rows(name: str) -> None:
    assert tables.TPDU_TYPES.name(getattr(tables, name)) == name


def test_every_type_is_a_nibble_and_every_other_code_an_octet() -> None:
    assert len(tables.TPDU_TYPES) == 11
    assert all(0 < row.number < 16 for row in tables.TPDU_TYPES)
    for table in (tables.PARAMETERS, tables.DR_REASONS, tables.ER_CAUSES, tables.CONNECTION_TYPES):
        assert all(0 <= row.number < 256 for row in table)
        assert all(row.name and row.text.endswith(".") for row in table)


@pytest.mark.parametrize(
    ("reason", "name"),
    [(0x00, "reason not specified"), (0x03, "address unknown"), (0x8A, "header or parameter length invalid"), (0x50, "0x50")],
)
def test_disconnect_reasons(reason: int, name: str) -> None:
    assert tables.DR_REASONS.name(reason) == name


def test_reject_causes() -> None:
    assert [row.number for row in tables.ER_CAUSES] == [0, 1, 2, 3]
    assert tables.ER_CAUSES.name(1) == "invalid parameter code"


def test_connection_types() -> None:
    assert [tables.CONNECTION_TYPES.name(number) for number in (1, 2, 3, 0x10)] == ["PG", "OP", "S7 basic", "0x10"]
