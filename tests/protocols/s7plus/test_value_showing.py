"""Values as texts: the form of each type, and how much of a long one is shown."""

from __future__ import annotations

import pytest

from dissect.protocols.s7plus.ids import HIDDEN
from dissect.protocols.s7plus.value_showing import (
    as_json,
    in_line,
    iso_time,
    meant,
    members_said,
    octets_text,
    value_json,
    value_said,
    value_with_type,
)
from dissect.protocols.s7plus.value_tables import (
    AID,
    ARRAY,
    BLOB,
    BOOL,
    BYTE,
    DINT,
    DWORD,
    LREAL,
    LWORD,
    NULL,
    REAL,
    RID,
    SPARSE_ARRAY,
    STRUCT,
    TIMESPAN,
    TIMESTAMP,
    UDINT,
    UINT,
    USINT,
    VARIANT,
    WORD,
    WSTRING,
)
from dissect.protocols.s7plus.values import Blob, Member, Packed, Rows, Struct, Value
from tests.protocols.s7plus.test_session import RECORD

FIVE = Value(0, USINT, 5)
#: Ids of a structure and of members that no table names.
NAMELESS = 60001


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Value(0, BYTE, 5), "Byte 0x05"),
        (Value(0, BYTE, 255), "Byte 0xff"),
        (Value(0, WORD, 5), "Word 0x0005"),
        (Value(0, DWORD, 5), "DWord 0x00000005"),
        (Value(0, LWORD, 5), "LWord 0x0000000000000005"),
        (Value(0, BOOL, False), "Bool false"),
        (Value(0, BOOL, True), "Bool true"),
        (Value(0, BOOL, 2), "Bool 2"),
        (Value(0, RID, 0x8A0E0003), "RID DB3"),
        (Value(0, AID, 2550), "AID 2550 DB.ValueActual"),
        (Value(0, TIMESTAMP, 2**63), "Timestamp 9223372036854775808"),
        (Value(0, TIMESPAN, -5), "Timespan -5 ns"),
        (Value(0, REAL, 0.1), "Real 0.1"),
        (Value(0, LREAL, 0.1), "LReal 0.1"),
        (Value(0, LREAL, 1e300), "LReal 1e+300"),
        (Value(0, REAL, b"\x7f\x80\0\1"), "Real 7f 80 00 01"),
        (Value(0, WSTRING, b"caf\xe9"), "WString 'caf\ufffd'"),
        (Value(0, BLOB, Blob(0, b"\1\2")), "Blob 01 02"),
        (Value(0, BLOB, Blob(0, b"")), "Blob (empty)"),
        (Value(0, VARIANT, FIVE), "Variant USInt 5"),
        (Value(0, STRUCT, Struct(314, [])), "Struct 314 SessionVersion"),
        (Value(0, STRUCT, Packed(0x92000003, 0, 0, b"")), "Struct type of DB3 0x92000003"),
        (Value(ARRAY, STRUCT, Rows(314, [])), "Struct 314 SessionVersion"),
        (Value(ARRAY, USINT, []), "USInt[0]"),
        (Value(ARRAY, NULL, [None, None]), "Null[2] -, -"),
        (Value(SPARSE_ARRAY, USINT, [(3, 4)]), "USInt, sparse, 1 elements"),
        (Value(0, 0x77, 5), "0x77 5"),
        (Value(0, 0x100, 5), "0x100 5"),
    ],
)
def test_a_value_has_the_form_of_its_type(value: Value, text: str) -> None:
    assert value_with_type(value) == text


def test_long_values_are_shown_in_part() -> None:
    """Eight elements, 80 characters, 16 octets, eight members; one more is left out, and that is said."""
    eight = ", ".join(["7"] * 8)
    assert value_with_type(Value(ARRAY, USINT, [7] * 8)) == f"USInt[8] {eight}"
    assert value_with_type(Value(ARRAY, USINT, [7] * 9)) == f"USInt[9] {eight} …"
    assert value_with_type(Value(0, WSTRING, "x" * 80)) == f"WString '{'x' * 80}'"
    assert value_with_type(Value(0, WSTRING, "x" * 81)) == f"WString '{'x' * 80}'…"
    assert octets_text(b"") == "(empty)"
    assert octets_text(bytes(16)) == " ".join(["00"] * 16)
    assert octets_text(bytes(17)) == f"{' '.join(['00'] * 16)} … 17 bytes"
    members: list[Member] = [(NAMELESS + at, FIVE) for at in range(8)]
    said = ", ".join([f"{NAMELESS + at}: 5" for at in range(8)])
    assert in_line(Value(0, STRUCT, Struct(NAMELESS, members)), 0) == f"Struct {{{said}}}"
    members.append((1, FIVE))
    assert in_line(Value(0, STRUCT, Struct(NAMELESS, members)), 0) == f"Struct {{{said}, …}}"


def test_a_value_that_was_hidden_shows_nothing() -> None:
    hidden = Value(0, WSTRING, HIDDEN)
    assert value_with_type(hidden) == HIDDEN
    assert in_line(Value(0, STRUCT, Struct(NAMELESS, [(1, hidden)])), 0) == f"Struct {{1: {HIDDEN}}}"
    # The same text from the wire is a text like any.
    written = Value(0, WSTRING, HIDDEN, 0, 12)
    assert value_with_type(written) == f"WString '{HIDDEN}'"
    assert in_line(Value(0, STRUCT, Struct(NAMELESS, [(1, written)])), 0) == f"Struct {{1: '{HIDDEN}'}}"


def test_a_number_with_a_meaning_has_it_behind_it() -> None:
    assert value_said(Value(0, DINT, 8), 3486) == "DInt 8 RUN"
    assert value_said(Value(0, DINT, 8), 7) == "DInt 8"
    assert value_said(Value(0, DINT, 99), 3486) == "DInt 99"
    assert in_line(Value(0, DINT, 8), 3486) == "DInt 8 RUN"
    assert value_said(Value(0, WSTRING, "8"), 3486) == "WString '8'"
    assert (meant(8, 3486), meant(8, 7), meant("8", 3486), meant(None, 3486)) == ("RUN", "", "", "")
    inner = Value(0, STRUCT, Struct(NAMELESS, [(3486, Value(0, DINT, 8)), (3, Value(0, NULL, None))]))
    assert in_line(inner, 0) == "Struct {OperatingState: 8 RUN, 3: Null}"


@pytest.mark.parametrize(
    ("id_", "number", "meaning"),
    [
        (299, 1, "engineering"),
        (1247, 8, "InstanceOf"),
        (1842, 3, "HMI access"),
        (1843, 4, "no access"),
        (2167, 1, "STOP"),
        (2523, 4, "SCL"),
        (3486, 4, "STOP"),
    ],
)
def test_which_attributes_are_numbers_with_names(id_: int, number: int, meaning: str) -> None:
    """Those of sessions, filters, protection, orders, blocks and states; the ids beside them are none."""
    assert meant(number, id_) == meaning
    assert meant(number, id_ - 1 if id_ != 1843 else 1844) == ""


@pytest.mark.parametrize("id_", [3753, 4114])
def test_an_identification_record_is_read(id_: int) -> None:
    said = "6ES7 215-1AG40-0XB0, hardware 3, firmware V4.5.2, serial number S V-E6K87654321"
    assert value_said(Value(0, BLOB, Blob(0, RECORD)), id_) == f"I&M0 {said}"
    assert meant(Blob(0, RECORD), id_) == said
    assert meant(Blob(0, RECORD[:-1]), id_) == meant(RECORD, id_) == meant(5, id_) == ""
    assert meant(Blob(0, RECORD), 3754) == ""


def test_members_are_said_as_json_has_them() -> None:
    state = {"3486": 8, "7": None, "8": True, "9": 1.5, "10": [1, "a"], "11": {"id": 7, "members": {"3486": 4}}}
    assert members_said(state) == (
        '{OperatingState: 8 RUN, 7: null, 8: true, 9: 1.5, 10: [1, "a"], 11: {OperatingState: 4 STOP}}'
    )
    assert members_said({"level": 8, "valve": {"open": False}}) == "{level: 8, valve: {open: false}}"
    assert members_said({"²": 1, "0": 2}) == "{²: 1, 0: 2}"  # a digit that is no decimal number
    assert members_said({}) == "{}"


def test_times_without_a_clock_are_numbers() -> None:
    assert [iso_time(ns) for ns in (-1, 0, 2**63 - 1, 2**63)] == [
        "-1",
        "1970-01-01T00:00:00.000000000Z",
        "2262-04-11T23:47:16.854775807Z",
        "9223372036854775808",
    ]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Value(0, BLOB, Blob(1, b"\1\2")), '"0102"'),
        (Value(0, BLOB, Blob(5, b"\1\2", bytes(8), 2)), '"0102"'),
        (Value(0, BLOB, Blob(5, b"", bytes(8), 0, [(7, FIVE)])), '{"root":5,"members":{"7":5}}'),
        (Value(0, BLOB, Blob(2, b"", bytes(8), 0, [])), '{"root":2,"members":{}}'),
        (
            Value(0, STRUCT, Struct(9, [(7, FIVE), (8, FIVE), (7, Value(0, UINT, 6))])),
            '{"id":9,"members":{"7":6,"8":5}}',
        ),
        (Value(SPARSE_ARRAY, UDINT, [(7, 1), (8, 2), (7, 3)]), '{"7":3,"8":2}'),
        (Value(0, STRUCT, Packed(7, 8, 0, b"\1")), '{"id":7,"time":8,"octets":"01"}'),
        (Value(0, NULL, None), "null"),
        (Value(0, REAL, float("nan")), '"nan"'),
        (Value(0, LREAL, float("-inf")), '"-inf"'),
        (Value(0, LREAL, 1e300), "1e+300"),
    ],
)
def test_a_value_is_json_and_its_text(value: Value, text: str) -> None:
    assert value_json(value) == text
    assert str(as_json(value)).replace("'", '"').replace(" ", "").replace("None", "null") in {text, text.strip('"')}


def test_nothing_else_is_a_content() -> None:
    with pytest.raises(TypeError, match="no value holds set"):
        value_json(Value(0, USINT, {1}))
