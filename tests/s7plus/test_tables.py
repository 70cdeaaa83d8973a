from __future__ import annotations

import pytest

from dissect.s7plus.id_tables import IDS
from dissect.s7plus.program_tables import DATATYPES, MEANINGS
from dissect.s7plus.return_tables import GENERIC_CODES, ORIGINS
from dissect.s7plus.tables import ERRORS, FUNCTIONS, NOTIFIED, OPCODES, RETURN_CODES, TAGS, VERSIONS, refuses
from dissect.s7plus.value_tables import VALUE_FLAGS, VALUE_TYPES
from dissect.wire.codes import CodeTable


@pytest.mark.parametrize("table", [FUNCTIONS, OPCODES, RETURN_CODES, VERSIONS], ids=lambda table: str(table.title))
def test_rows(table: CodeTable) -> None:
    rows = list(table)
    assert len({row.name for row in rows}) == len(rows)
    assert all(row.name for row in rows)
    told = [row.text for row in rows if row.text or table is not RETURN_CODES]  # of most errors only the name is known
    assert all(text.endswith(".") for text in told)
    assert all(0 <= row.number < 1 << 4 * table.digits for row in rows)


@pytest.mark.parametrize(
    "table", [*MEANINGS.values(), IDS, DATATYPES, VALUE_TYPES, VALUE_FLAGS, TAGS, NOTIFIED, GENERIC_CODES, ORIGINS]
)
def test_every_row_has_a_name(table: CodeTable) -> None:
    assert len(table) > 1
    assert all(row.name and (not row.text or row.text.endswith(".")) for row in table)


def test_the_codes_of_the_reference() -> None:
    assert OPCODES.names() == {0x31: "Request", 0x32: "Response", 0x33: "Notification", 0x02: "Response2"}
    assert {1, 2, 3, 0xFE} <= VERSIONS.names().keys()
    assert FUNCTIONS.name(0x05B3) == "InitSSL"
    assert {FUNCTIONS.name(code) for code in ERRORS} == {"Error", "Error2"}


@pytest.mark.parametrize(
    ("code", "no"), [(0, False), (17, False), (19, True), (22, False), (0x7FFF, False), (0x8000, True), (0xFFF4, True)]
)
def test_which_return_values_say_no(code: int, no: bool) -> None:
    assert refuses(code) is no
