from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7 import cyclic
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.message import parse_pdu
from dissect.wire.part import SURPLUS
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

ITEM = "120a10020002000784000000"
VALUE = "ff04001000aa"
DBREAD = "1207b0010400070000"
#: (kind, subfunction, payload, sequence, parts, notes)
EXAMPLES = [
    (REQUEST, 1, "00010101" + ITEM, 0, ["cyclic request", "S7ANY item"], ["every 1 s", "DB7.DBB0 x2"]),
    (RESPONSE, 1, "0001" + VALUE, 4, ["cyclic values", "data item", "content"], ["job 4"]),
    (PUSH, 1, "0001" + VALUE, 4, ["cyclic values", "data item", "content"], ["job 4"]),
    (REQUEST, 5, "00010005" + ITEM, 0, ["cyclic request", "S7ANY item"], ["on change, checked every 500 ms", "DB7.DBB0 x2"]),
    (PUSH, 5, "00020a000000" + VALUE, 9, ["cyclic values", "data item", "data item", "content"], ["job 9"]),
    (
        REQUEST, 7, "00010202" + ITEM, 6, ["cyclic request", "S7ANY item"],
        ["job 6, on change, checked every 20 s", "DB7.DBB0 x2"],
    ),
    (REQUEST, 4, "0504", 0, ["unsubscribe"], ["job 4"]),
    (REQUEST, 8, "0001120a10020064000501000100", 0, ["data record", "S7ANY item"], ["RECORD5@256 x100"]),
    (
        RESPONSE, 8, "0001ff0900000003010203", 0,
        [
            "data record", "return code", "data record transport size", "data record status", "fill",
            "data record length", "record",
        ],
        ["3 bytes"],
    ),
    (
        RESPONSE, 8, "00010a02c0a0", 0, ["data record", "return code", "data record status"],
        ["refused: Object does not exist", "STATUS c0a0"],
    ),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "subfunction", "payload", "sequence", "parts", "notes"), EXAMPLES)
def test_examples(kind: int, subfunction: int, payload: str, sequence: int, parts: list[str], notes: list[str]) -> None:
    octets = userdata(kind, 2, subfunction, payload, sequence)
    found = body(octets)
    assert found.malformed == []
    assert names(found) == parts
    assert found.notes == notes
    stands_cuts(octets)
    assert has_surplus(trailing(octets))


def test_a_request_tells_its_interval_and_items() -> None:
    found = body(userdata(REQUEST, 2, 1, "00010203" + ITEM))
    head, item = payload_parts(found)
    assert (head.number("item_count"), head.number("time_base"), head.number("factor")) == (1, 2, 3)
    assert head.text("time_base") == "10 s"
    assert (item.number("db"), item.number("count"), item.number("area")) == (7, 2, 0x84)


def test_an_odd_item_of_another_syntax_is_followed_by_a_fill_octet() -> None:
    found = body(userdata(REQUEST, 2, 1, "00020101" + DBREAD + "00" + ITEM))
    assert found.malformed == []
    assert names(found)[0] == "cyclic request"
    assert "fill" in names(found)
    assert found.notes[-1] == "DB7.DBB0 x2"


def test_an_item_that_is_missing_is_told_and_what_is_left_over_kept() -> None:
    found = body(userdata(REQUEST, 2, 1, "00020101" + ITEM))
    assert [fault.reason for fault in found.malformed] == ["count_mismatch"]
    assert found.malformed[0].limit == "item"
    cut = body(userdata(REQUEST, 2, 1, "00020101" + ITEM + "120a1002"))
    assert [fault.reason for fault in cut.malformed] == ["length_beyond"]
    assert names(cut) == ["cyclic request", "S7ANY item", "octets"]


def test_values_answer_one_by_one() -> None:
    found = body(userdata(PUSH, 2, 7, "0002ff09000161" + "00" + VALUE, 3))
    assert names(found) == ["cyclic values", "data item", "content", "fill", "data item", "content"]
    first, second = (part.octets("data") for part in payload_parts(found) if part.layout.name == "content")
    assert (first, second) == (b"a", b"\x00\xaa")


def test_the_status_of_a_record_is_cut_by_its_length() -> None:
    found = body(userdata(RESPONSE, 2, 8, "0001ff0904800a12340002aabb"))
    status = found.find(cyclic.RECORD_STATUS)
    record = found.find(cyclic.RECORD)
    assert status is not None
    assert record is not None
    assert status.octets("status") == bytes.fromhex("800a1234")
    assert record.octets("record") == b"\xaa\xbb"


@pytest.mark.parametrize(
    ("base", "factor", "text"),
    [
        (0, 1, "100 ms"),
        (0, 10, "1 s"),
        (0, 15, "1500 ms"),
        (1, 255, "255 s"),
        (2, 6, "60 s"),
        (9, 4, "4 x time base 9"),
    ],
)
def test_interval(base: int, factor: int, text: str) -> None:
    assert cyclic.interval(base, factor) == text


def test_a_later_part_is_not_taken_for_a_beginning() -> None:
    found = body(userdata(PUSH, 2, 1, "0102030405", 4, 9, 0))
    assert found.notes == ["continuation"]
    assert found.malformed == []


def test_an_answer_to_unsubscribe_has_no_payload() -> None:
    found = body(userdata(RESPONSE, 2, 4, "0504"))
    assert [part.layout for part in payload_parts(found)] == [SURPLUS]


@given(
    st.integers(0, 3), st.sampled_from([1, 4, 5, 7, 8]), st.binary(max_size=60), st.integers(0, 2), st.integers(0, 1)
)
def test_never_raises(kind: int, subfunction: int, payload: bytes, unit: int, last: int) -> None:
    body(userdata(kind, 2, subfunction, payload.hex(), 1, unit, last))


@given(st.binary(max_size=80))
def test_never_raises_on_any_octets(octets: bytes) -> None:
    parse_body(parse_pdu(b"\x32\x07" + octets))
