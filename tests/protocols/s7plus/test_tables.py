from __future__ import annotations

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.id_tables import IDS, MEMBERS, MEMORY
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.program_tables import DATATYPES, MEANINGS
from dissect.protocols.s7plus.return_tables import GENERIC_CODES, ORIGINS
from dissect.protocols.s7plus.tables import (
    ERRORS,
    FUNCTIONS,
    NOTIFIED,
    OPCODES,
    RETURN_CODES,
    SET_VARIABLE,
    TAGS,
    VERSIONS,
    refuses,
)
from dissect.protocols.s7plus.value_tables import DINT, RID, STRUCT, VALUE_FLAGS, VALUE_TYPES
from dissect.protocols.s7plus.values import Struct, Value
from dissect.wire.codes import CodeTable
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.numbers import NUMBERS, every_table, lines
from tests.protocols.s7plus.pdus import asked, framed


@pytest.mark.parametrize("table", [FUNCTIONS, OPCODES, RETURN_CODES, VERSIONS], ids=lambda table: str(table.title))
def test_rows(table: CodeTable) -> None:
    rows = list(table)
    assert len({row.name for row in rows}) == len(rows)
    assert all(row.name for row in rows)
    told = [row.text for row in rows if row.text or table is not RETURN_CODES]  # of most errors only the name is known
    assert all(text.endswith(".") for text in told)
    assert all(0 <= row.number < 1 << 4 * table.digits for row in rows)


@pytest.mark.parametrize(
    "table", [*MEANINGS.values(), IDS, MEMBERS, DATATYPES, VALUE_TYPES, VALUE_FLAGS, TAGS, NOTIFIED, GENERIC_CODES, ORIGINS]
)
def test_every_row_has_a_name(table: CodeTable) -> None:
    assert len(table) > 1
    assert all(row.name and (not row.text or row.text.endswith(".")) for row in table)


def test_numbers_stay_as_they_are_written_down() -> None:
    """Each number, name and size of a field once more, beside the tables: none changes by mistake."""
    assert lines() == NUMBERS.read_text(encoding="utf-8").splitlines()
    assert len(list(every_table())) > 15


def test_members_of_memory_are_no_objects() -> None:
    """Their numbers are also those of objects (appendix G of the reference); those of all other members are ids like any."""
    assert MEMBERS.name(3) == "LID_OMS_STB_ClassicBlob"
    assert IDS.name(3) == "NativeObjects.thePLCProgram_Rid"
    differ = [row.number for row in MEMBERS if row.name != IDS.name(row.number)]
    assert differ == [number for number, _, _ in MEMORY] == [1, 2, 3, 4, 5]
    assert len(MEMBERS) == len(IDS)
    memory = Struct(1533, [(1, Value(0, RID, 0x90010000)), (3486, Value(0, DINT, 8))])
    body = bodies.set_variable(52, [2550], Value(0, STRUCT, memory))
    found = parse_contents(parse_plus(framed(asked(1, SET_VARIABLE, body=body), 2)))
    members = [part for part in found.parts if part.layout.name == "member"][:2]
    assert [part.note for part in members] == [
        "1 LID_OMS_STB_DescriptionRID = RID 0x90010000",
        "3486 AS_DIS.OperatingState = DInt 8 RUN",
    ]
    first = members[0].find("id")
    assert first is not None
    assert first.meaning == "LID_OMS_STB_DescriptionRID"


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


def test_names_of_errors_are_words() -> None:
    """An abbreviation of the object model or a slip of its authors tells nobody why a request was refused."""
    named = {0xFFE0: "Invalid attribute ID", 0xFFE2: "Invalid object ID", 35: "Message BLOB reallocated"}
    assert {code: RETURN_CODES.name(code) for code in named} == named
    words = {word for table in (RETURN_CODES, GENERIC_CODES) for row in table for word in row.name.split()}
    assert ORIGINS.name(26) == "hardware configuration"
    assert ORIGINS.name(92) == "IE configuration"
    assert words.isdisjoint({"AID", "RID", "BLO", "changable", "notfound", "exced", "En"})
