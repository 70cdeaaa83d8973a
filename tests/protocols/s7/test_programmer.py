from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7 import programmer_layouts as layouts
from dissect.protocols.s7.body import Body
from dissect.wire.part import OCTETS, Part
from tests.cases import each
from tests.protocols.s7.userdata_pdus import (
    PUSH,
    REQUEST,
    RESPONSE,
    body,
    has_surplus,
    names,
    payload_parts,
    stands_cuts,
    trailing,
    userdata,
)

TRIGGER = "0000 0000 0001 0012 0001 0001 0001 0001 0001 0000"
BLOCK = "000a 0005 0010"
ANSWER = "00000000"
ACCUS = "00000001 00000002 00000003 00000004"
TIME = "2311142215306213"
INTERRUPTED = "0008 0001 0022"
DBS = "0a0a 0005 0006"


def payload(parameters: str, data: str) -> str:
    """Return the payload of a programmer command with its two sizes."""
    first, second = bytes.fromhex(parameters), bytes.fromhex(data)
    return len(first).to_bytes(2, "big").hex() + len(second).to_bytes(2, "big").hex() + first.hex() + second.hex()


#: (kind, subfunction, parameter block, data block, parts behind the head, notes)
EXAMPLES = [
    (REQUEST, 0x02, TRIGGER, "0001 0201 0000 0006", ["trigger", "variables", "variable"], ["MW6"]),
    (
        REQUEST, 0x02, TRIGGER, "0002 0106 0000 0000 1101 0000 0008",
        ["trigger", "variables", "variable", "variable"], ["MB0 x6", "IB8"],
    ),
    (PUSH, 0x02, ANSWER, "0001 ff04 0010 002a", ["answer parameters", "variables", "data item", "content"], ["job 2"]),
    (
        PUSH, 0x02, ANSWER, "0002 ff09 0006 4133851fdead ff09 0001 02 00",
        ["answer parameters", "variables", "data item", "content", "data item", "content", "fill"], ["job 2"],
    ),
    (PUSH, 0x02, ANSWER, "0001 0a00 0000", ["answer parameters", "variables", "data item"], ["job 2"]),
    (
        REQUEST, 0x08, TRIGGER, "0002 0301 0000 0000 1001 0000 0008 0009 0004 4133851f 0009 0001 01 00",
        ["trigger", "variables", "variable", "variable", "data item", "content", "data item", "content", "fill"],
        ["MD0", "I8.1"],
    ),
    (
        PUSH, 0x08, ANSWER, "0003 ff ff 05 00",
        ["answer parameters", "variables", "return code", "return code", "return code", "fill"], ["job 2"],
    ),
    (
        REQUEST, 0x09, TRIGGER, "0001 7205 000a 0004 0004 0010 1234",
        ["trigger", "variables", "variable", "data item", "content"], ["DB10.DBW4 x5"],
    ),
    (PUSH, 0x09, ANSWER, "0002 ff 03", ["answer parameters", "variables", "return code", "return code"], ["job 2"]),
    (REQUEST, 0x0D, TRIGGER, "0202", ["trigger", "job"], ["job 2 of variable status"]),
    (REQUEST, 0x0E, TRIGGER, "0802", ["trigger", "job"], ["job 2 of modify variable"]),
    (REQUEST, 0x0F, TRIGGER, "0000 0903", ["trigger", "reserved", "job"], ["job 3 of force"]),
    (REQUEST, 0x11, TRIGGER, "1304", ["trigger", "job"], ["job 4 of block status v2"]),
    (REQUEST, 0x10, TRIGGER, "00000000", ["trigger", "reserved"], []),
    (
        RESPONSE, 0x10, "01000001", "0202 0100 1003 0000", ["answer parameters", "job", "job"],
        ["job 2 of variable status", "job 3 of read job list"],
    ),
    (
        RESPONSE, 0x11, ANSWER, "0014 0008" + TRIGGER + "0001 0201 0000 0006",
        ["answer parameters", "job", "trigger", "data of the job"], [],
    ),
    (
        REQUEST, 0x12, TRIGGER, "0000 0202 0014 0008" + TRIGGER + "0001 7005 0003 0007",
        ["trigger", "reserved", "job", "job", "trigger", "variables", "variable"],
        ["job 2 of variable status", "DB3.DBX7.5"],
    ),
    (
        REQUEST, 0x01, TRIGGER + BLOCK, "00 07 00 01 00 02", ["trigger", "block", "block status", "line", "line"],
        ["DB 5", "2 lines"],
    ),
    (
        REQUEST, 0x13, TRIGGER + BLOCK + "0003", "01 01 00 7f 0010 00 07",
        ["trigger", "block", "step address counter", "block status", "line"], ["DB 5", "1 line"],
    ),
    (
        PUSH, 0x13, ANSWER, "0010 0001 00000002 0012 0001",
        ["answer parameters", "block status values", "registers"], ["job 2", "from address 0x0010"],
    ),
    (REQUEST, 0x03, TRIGGER, "0000", ["trigger", "ISTACK"], []),
    (
        PUSH, 0x03, ANSWER,
        "000c 0002 0004" + DBS + "00000000" + ACCUS + "00000010 00000020 0000 00ff" + INTERRUPTED + "0000 00000000"
        + "11 01 01 01 00 00 0001 0002 0003" + TIME,
        ["answer parameters", "ISTACK", "start information"], ["job 2", "interrupted in OB 1", "OB 1"],
    ),
    (REQUEST, 0x04, TRIGGER, "0000", ["trigger", "BSTACK"], []),
    (
        RESPONSE, 0x04, ANSWER, "000c 0002 0004" + DBS + "00000000" + INTERRUPTED + DBS + "00000000" + "01 00 0000" + TIME,
        ["answer parameters", "BSTACK entry", "BSTACK entry", "priority class", "start time"], ["FC 2", "OB 1"],
    ),
    (
        RESPONSE, 0x04, ANSWER, INTERRUPTED + DBS + "00000000" + "01 00 0000" + TIME[:8],
        ["answer parameters", "BSTACK entry", "priority class", "start time, cut"], ["OB 1"],
    ),
    (REQUEST, 0x05, TRIGGER, "0101", ["trigger", "LSTACK"], []),
    (
        RESPONSE, 0x05, ANSWER, INTERRUPTED + "0004 01020304" + "01 00 0000" + TIME,
        ["answer parameters", "LSTACK", "local data", "priority class"], ["of OB 1"],
    ),
    (REQUEST, 0x0A, TRIGGER + BLOCK, "0000", ["trigger", "block", "breakpoint"], ["DB 5"]),
    (
        PUSH, 0x0A, ANSWER, INTERRUPTED + "000c 0002 0004 0000 00ff" + ACCUS + DBS,
        ["answer parameters", "breakpoint"], ["job 2", "OB 1"],
    ),
    (REQUEST, 0x0B, TRIGGER, "01 00", ["trigger", "exit HOLD"], ["until next statement"]),
    (REQUEST, 0x16, TRIGGER, "0001", ["trigger", "octets"], []),
]  # fmt: skip


@each(("kind", "subfunction", "parameters", "data", "parts", "notes"), EXAMPLES)
def test_examples(kind: int, subfunction: int, parameters: str, data: str, parts: list[str], notes: list[str]) -> None:
    octets = userdata(kind, 1, subfunction, payload(parameters, data), 2)
    found = body(octets)
    assert found.malformed == []
    assert names(found) == ["programmer command", *parts]
    assert found.notes == notes
    stands_cuts(octets)
    assert has_surplus(trailing(octets))


def parts_of(found: Body, name: str) -> list[Part]:
    return [part for part in payload_parts(found) if part.layout.name == name]


def test_a_request_tells_its_trigger() -> None:
    trigger = "0000 0001 0000 0006 0001 0001 0001 0001 0001 0200"
    found = body(userdata(REQUEST, 1, 8, payload(trigger, "0000")))
    (part,) = parts_of(found, "trigger")
    assert part.text("trigger_type") == "monitor or modify variables"
    assert part.text("frequency") == "every cycle"
    assert part.text("trigger_event") == "start of the main cycle"
    assert part.number("answer_size") == 6


@pytest.mark.parametrize(
    ("more", "parts"),
    [
        ("", []),
        (BLOCK, ["block"]),
        (BLOCK + "0001", ["block", "step address counter"]),
        (BLOCK + "0001 0002 0a00 0005 0006", ["block", "step address counter", "call environment", "open data blocks"]),
        (BLOCK + "0001 0000 0001 0008 0001", ["block", "step address counter", "call environment", "calling block"]),
        (
            BLOCK + "0001 0000 0101 0008 0001 0004",
            ["block", "step address counter", "call environment", "calling block", "calling address"],
        ),
    ],
)
def test_each_longer_form_of_the_parameters_adds_at_the_end(more: str, parts: list[str]) -> None:
    found = body(userdata(REQUEST, 1, 0x0B, payload(TRIGGER + more, "0000")))
    assert names(found) == ["programmer command", "trigger", *parts, "exit HOLD"]
    assert found.malformed == []


@pytest.mark.parametrize(
    ("octets", "text"),
    [
        ("0003 0000 0001", "M1.3"),
        ("1301 0000 0004", "ID4"),
        ("2200 0000 0002", "QW2"),
        ("3201 0000 0100", "PIW256"),
        ("7102 0001 0000", "DB1.DBB0 x2"),
        ("7301 0001 0008", "DB1.DBD8"),
        ("5401 0000 0005", "T5"),
        ("6403 0000 0005", "C5 x3"),
        ("4101 0000 0005", "area 0x41, byte 5"),
        ("0501 0000 0005", "area 0x05, byte 5"),
    ],
)
def test_addresses(octets: str, text: str) -> None:
    found = body(userdata(REQUEST, 1, 2, payload(TRIGGER, "0001" + octets)))
    assert found.notes == [text]
    assert found.malformed == []


def test_registers_of_a_line() -> None:
    found = body(userdata(REQUEST, 1, 0x13, payload(TRIGGER + BLOCK + "0003", "01 01 00 7f 0010 00 45")))
    line = found.find(layouts.BLOCK_STATUS_LINE_2)
    assert line is not None
    asked = [name for name in ("stw", "accu1", "accu2", "ar1", "ar2", "db1", "db2") if line.number(name)]
    assert asked == ["stw", "accu2", "db2"]
    assert line.number("address") == 0x10


def test_sizes_that_do_not_fit_are_told() -> None:
    found = body(userdata(REQUEST, 1, 2, "0014 0008" + TRIGGER + "0001 0201"))
    assert [(fault.reason, fault.field) for fault in found.malformed] == [
        ("length_beyond", "data size"),
        ("too_short", "variable"),
    ]
    beyond = body(userdata(REQUEST, 1, 2, "0016 0000" + TRIGGER))
    assert [(fault.reason, fault.field) for fault in beyond.malformed] == [("length_beyond", "parameter size")]


def test_return_codes_that_are_missing_are_told() -> None:
    found = body(userdata(PUSH, 1, 8, payload(ANSWER, "0005 ff")))
    assert [fault.reason for fault in found.malformed] == ["count_mismatch"]


def test_a_job_is_not_replaced_with_a_command_about_jobs() -> None:
    within = "0000 1202" + "0000 ffff" * 400
    found = body(userdata(REQUEST, 1, 0x12, payload(TRIGGER, within)))
    assert parts_of(found, "octets")
    assert found.malformed == []


def test_parameters_of_an_unknown_size_stay_octets() -> None:
    found = body(userdata(REQUEST, 1, 0x0E, payload("0000 0000", "0202")))
    assert names(found) == ["programmer command", "octets", "job"]
    assert payload_parts(found)[1].layout is OCTETS


def test_parts_of_a_long_push() -> None:
    first = body(userdata(PUSH, 1, 2, "0004 0100" + ANSWER + "0010ff09", 2, 7, 1))
    assert first.malformed == []
    assert first.notes == ["job 2", "continues in the next part"]
    last = body(userdata(PUSH, 1, 2, "00000000", 2, 7, 0))
    assert last.notes == ["continuation"]


@given(st.integers(0, 3), st.integers(0, 0x17), st.binary(max_size=80), st.integers(0, 1), st.integers(0, 1))
def test_never_raises(kind: int, subfunction: int, octets: bytes, unit: int, last: int) -> None:
    body(userdata(kind, 1, subfunction, octets.hex(), 1, unit, last))


@given(st.integers(0, 2), st.integers(0, 0x17), st.binary(max_size=60))
def test_never_raises_on_data(kind: int, subfunction: int, data: bytes) -> None:
    body(userdata(kind, 1, subfunction, payload(TRIGGER if kind == REQUEST else ANSWER, data.hex())))
