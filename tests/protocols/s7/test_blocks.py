from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.blocks import BLOCK_COUNT, BLOCK_WANTED, HEADER, INFO, LISTED_BLOCK, TYPE_WANTED, block_time
from dissect.wire.part import SURPLUS
from tests.protocols.s7.userdata_pdus import (
    REQUEST,
    RESPONSE,
    body,
    has_surplus,
    payload_parts,
    stands_cuts,
    trailing,
    userdata,
)

INFO_ANSWER = (
    "0100 004a 2200 7070 01 01 05 0a 0001 000000d8 00000000 02395d992d70 03a1638321a7 0038 0000 0000 0058"
    "415554484f522020 46414d494c592020 4845414445522020 01 00 63cc 00000000 00000000"
)  # reference section 8.9

EXAMPLES = [
    (RESPONSE, 1, "30380002 30410011", [BLOCK_COUNT, BLOCK_COUNT], ["2 OB", "17 DB"]),
    (REQUEST, 2, "3041", [TYPE_WANTED], ["DB"]),
    (RESPONSE, 2, "00012205 00072205", [LISTED_BLOCK, LISTED_BLOCK], ["1 (DB)", "7 (DB)"]),
    (REQUEST, 3, "3041 3030303031 41", [BLOCK_WANTED], ["block DB 1, active"]),
    (
        RESPONSE,
        3,
        INFO_ANSWER,
        [INFO],
        ["block DB 1, version 0.1, changed 2015-11-06 10:21:53.945, 88 bytes MC7, author AUTHOR, name HEADER"],
    ),
]


@pytest.mark.parametrize(("kind", "subfunction", "payload", "layouts", "notes"), EXAMPLES)
def test_examples(kind: int, subfunction: int, payload: str, layouts: list[object], notes: list[str]) -> None:
    octets = userdata(kind, 3, subfunction, payload)
    found = body(octets)
    assert found.malformed == []
    assert [part.layout for part in payload_parts(found)] == layouts
    assert found.notes == notes
    stands_cuts(octets)
    more = trailing(octets)
    assert has_surplus(more) or more.malformed[0].reason == "too_short"


def test_a_protected_block_is_said_to_be_so() -> None:
    protected = INFO_ANSWER.replace("000000d8 00000000", "000000d8 00000003")
    (info,) = payload_parts(body(userdata(RESPONSE, 3, 3, protected)))
    assert info.note.startswith("block DB 1, know-how protection, version 0.1, ")
    (info,) = payload_parts(
        body(userdata(RESPONSE, 3, 3, INFO_ANSWER.replace("000000d8 00000000", "000000d8 00000007")))
    )
    assert info.note.startswith("block DB 1, protection 0x7, version 0.1, ")


def test_block_info() -> None:
    (info,) = payload_parts(body(userdata(RESPONSE, 3, 3, INFO_ANSWER)))
    assert info.end - info.offset == INFO.size == 78
    told = {value.field.name: value.meaning or value.value for value in info.values}
    assert told == {
        "constant": 0x0100,
        "info_length": 74,
        "unknown_info": 0x2200,
        "mark": "pp",
        "unknown_mark": 1,
        "flags_rest": 0,
        "non_retain": 0,
        "flags_middle": 0,
        "standard": 0,
        "linked": 1,
        "language": "DB",
        "block_kind": "DB",
        "block_number": 1,
        "load_length": 216,
        "security": "none",
        "code_time": "2015-11-06 10:21:53.945",
        "interface_time": "2007-08-03 16:55:08.419",
        "ssb_length": 56,
        "add_length": 0,
        "local_length": 0,
        "mc7_length": 88,
        "author": "AUTHOR",
        "family": "FAMILY",
        "name": "HEADER",
        "version": "0.1",
        "unknown_version": 0,
        "checksum": 0x63CC,
        "reserved_1": 0,
        "reserved_2": 0,
    }


@pytest.mark.parametrize(
    ("flags", "expected"), [(0x01, (0, 0, 1)), (0x02, (0, 1, 0)), (0x08, (1, 0, 0)), (0xF4, (0, 0, 0))]
)
def test_flags(flags: int, expected: tuple[int, int, int]) -> None:
    payload = bytearray(bytes.fromhex(INFO_ANSWER))
    payload[9] = flags
    found = body(userdata(RESPONSE, 3, 3, payload.hex()))
    assert tuple(found.number(name) for name in ("non_retain", "standard", "linked")) == expected


def test_a_protected_block() -> None:
    payload = bytearray(bytes.fromhex(INFO_ANSWER))
    payload[21] = 3
    assert body(userdata(RESPONSE, 3, 3, payload.hex())).text("security") == "know-how protection"


def test_the_last_of_several_parts_holds_whole_entries() -> None:
    found = body(userdata(RESPONSE, 3, 2, "00072205", 4, 213, 0))
    assert (found.malformed, found.notes) == ([], ["7 (DB)"])


def test_times() -> None:
    assert block_time(bytes(6)) == "1984-01-01 00:00:00.000"
    assert block_time(bytes.fromhex("05265bff 16d3")) == "1999-12-31 23:59:59.999"
    assert block_time(bytes.fromhex("05265c00 0000")) is None
    assert block_time(b"\0\0\0\0\xff\xff") == "2163-06-06 00:00:00.000"


def test_the_header_is_a_part_of_block_info() -> None:
    names = [field.name for field in INFO.fields]
    assert HEADER.size == 36
    assert names[3 : 3 + len(HEADER.fields)] == [field.name for field in HEADER.fields]


@given(st.integers(0, 3), st.integers(1, 3), st.binary(max_size=120), st.integers(0, 3), st.integers(0, 2))
def test_never_raises(kind: int, subfunction: int, payload: bytes, unit: int, last: int) -> None:
    found = body(userdata(kind, 3, subfunction, payload.hex(), 1, unit, last))
    assert found.malformed or SURPLUS not in [part.layout for part in found.parts]
