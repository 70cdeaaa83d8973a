"""What the tables say of each other; tests/test_reference.py holds them to the protocol reference."""

from __future__ import annotations

import pytest

from dissect.protocols.s7 import errors, layouts, tables
from dissect.wire.codes import CodeTable
from dissect.wire.layout import Layout
from tests.cases import each

TABLES = [table for module in (tables, errors) for table in vars(module).values() if isinstance(table, CodeTable)]
LAYOUTS = [layout for layout in vars(layouts).values() if isinstance(layout, Layout)]


@each("table", [*TABLES, *tables.USERDATA_SUBFUNCTIONS.values()])
def test_rows(table: CodeTable) -> None:
    assert len(table)
    for row in table:
        assert 0 <= row.number < 16**table.digits
        assert row.name == row.name.strip() != ""
        assert table.name(row.number) == row.name
        assert row.text == row.text.strip()


def test_functions_and_errors_are_explained() -> None:
    for table in (tables.FUNCTIONS, tables.RETURN_CODES, tables.SYNTAX_IDS, tables.AREAS, errors.ERROR_CODES):
        assert [row.name for row in table if not row.text] == []


def test_of_every_function_it_is_said_what_it_does() -> None:
    assert [row.number for row in tables.FUNCTIONS if not row.effect] == [tables.CPU_SERVICES], "its group says it"
    assert [row.name for table in tables.USERDATA_SUBFUNCTIONS.values() for row in table if not row.effect] == []
    assert tables.FUNCTIONS.effect(0x99) == ""


def test_every_group_of_userdata_has_subfunctions() -> None:
    assert set(tables.USERDATA_SUBFUNCTIONS) == set(tables.USERDATA_GROUPS.names())


def test_answer_sizes_are_sizes_of_data_items() -> None:
    for asked, answered in tables.ANSWER_TRANSPORT_SIZE.items():
        assert asked in tables.TRANSPORT_SIZES
        assert answered in tables.DATA_TRANSPORT_SIZES


def test_item_errors_are_header_errors_too() -> None:
    """Class 0x81 repeats the return codes of items: 0x8105 is what 0x05 is (reference 3.2)."""
    for code in (0x05, 0x06, 0x07, 0x0A):
        assert errors.ERROR_CODES.name(0x8100 | code) == tables.RETURN_CODES.name(code)


def test_every_error_class_has_errors() -> None:
    classes = {row.number >> 8 for row in errors.ERROR_CODES}
    assert set(errors.ERROR_CLASSES.names()) <= classes


@pytest.mark.parametrize(
    ("layout", "size"),
    [
        (layouts.HEADER, 10),
        (layouts.ACK_HEADER, 12),
        (layouts.SETUP, 8),
        (layouts.VARIABLES_HEAD, 2),
        (layouts.ITEM_HEAD, 3),
        (layouts.S7ANY_ITEM, 12),
        (layouts.DATA_ITEM, 4),
        (layouts.USERDATA_SHORT, 8),
        (layouts.USERDATA_EXTENDED, 12),
        (layouts.MODE_TRANSITION, 8),
    ],
    ids=lambda value: value.name if isinstance(value, Layout) else str(value),
)
def test_layouts_have_the_size_the_reference_gives(layout: Layout, size: int) -> None:
    assert layout in LAYOUTS
    assert layout.size == size
    assert layout.source.startswith("reference section ")
    assert len({field.name for field in layout.fields}) == len(layout.fields)
