from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.layouts import DATA_ITEM
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.pbc import BSEND_DATA, BSEND_LENGTH, USEND_DATA, USEND_HEAD
from dissect.protocols.s7.syntaxes import PBC_ID
from tests.protocols.s7.job_pdus import job
from tests.protocols.s7.userdata_pdus import PUSH, REQUEST, RESPONSE, body, payload_parts, stands_cuts, userdata

ID = "12 06 13 00 00000001"
ALONE = ID + "0004 cafe0001"  # reference section 8.12


def usend(data: str, head: str = "00 01 12 06 13 00 00000001") -> bytes:
    return job(head, data, 7)


@pytest.mark.parametrize(
    ("payload", "sequence", "unit", "last", "layouts", "notes"),
    [
        (ALONE, 0, 0, 0, [PBC_ID, BSEND_LENGTH, BSEND_DATA], ["R_ID 0x00000001", "4 bytes"]),
        (ALONE, 2, 0, 0, [PBC_ID, BSEND_LENGTH, BSEND_DATA], ["R_ID 0x00000001", "4 bytes"]),
        (ID + "0008 cafe0001", 0, 7, 1, [PBC_ID, BSEND_LENGTH, BSEND_DATA], ["R_ID 0x00000001", "8 bytes"]),
        (ID + "0008 cafe0001", 2, 7, 1, [PBC_ID, BSEND_DATA], ["R_ID 0x00000001", "continuation"]),
        (ID + "00080001", 2, 7, 0, [PBC_ID, BSEND_DATA], ["R_ID 0x00000001", "continuation"]),
        (ID, 0, 0, 0, [PBC_ID], ["R_ID 0x00000001"]),
        (ID, 2, 7, 0, [PBC_ID], ["R_ID 0x00000001"]),
    ],
)
def test_bsend(payload: str, sequence: int, unit: int, last: int, layouts: list[object], notes: list[str]) -> None:
    octets = userdata(REQUEST, 6, 1, payload, sequence, unit, last)
    found = body(octets)
    assert [part.layout for part in payload_parts(found)] == layouts
    assert found.notes == notes
    assert found.number("r_id") == 1
    assert bool(found.malformed) is (payload == ID and not sequence)  # the length is missing
    stands_cuts(octets)


def test_a_bsend_alone_that_is_shorter_than_it_says() -> None:
    found = body(userdata(REQUEST, 6, 1, ID + "0009 cafe"))
    assert [(fault.reason, fault.field, fault.needed, fault.available) for fault in found.malformed] == [
        ("length_beyond", "total_length", 9, 2)
    ]


def test_the_partner_answers_with_nothing() -> None:
    assert payload_parts(body(userdata(RESPONSE, 6, 1, ""))) == []


def test_usend() -> None:
    octets = usend("ff 00 0002 00 04 0008 aa 00 00 09 0002 0102")
    pdu = parse_pdu(octets)
    head = pdu.parameters.userdata
    assert head is not None
    assert (head.type, head.group, head.usend, head.extended) == (PUSH, 6, True, False)
    assert pdu.function_name == "PBC (programmable block communication): USEND"
    found = body(octets)
    assert (pdu.malformed, found.malformed) == ([], [])
    assert [part.layout.name for part in found.parts] == [
        USEND_HEAD.name,
        USEND_DATA.name,
        DATA_ITEM.name,
        "content",
        "fill",
        DATA_ITEM.name,
        "content",
    ]
    assert found.notes == ["USEND R_ID 0x00000001"]
    for size in range(len(octets)):
        body(octets[:size])


def test_octets_behind_a_usend_are_told() -> None:
    found = body(usend("ff 00 0001 00 09 0002 0102 0304"))
    assert [fault.reason for fault in found.malformed] == ["trailing_octets"]
    assert [fault.reason for fault in parse_pdu(usend("", "00 01 12 06 13 00 00000001 00")).malformed] == [
        "trailing_octets"
    ]
    assert [fault.reason for fault in parse_pdu(usend("", "00 01 12 06 13 00 000000")).malformed] == ["too_short"]


def test_an_r_id_is_no_error_code() -> None:
    pdu = parse_pdu(usend("", "00 01 12 08 13 46 02 00 0000d209"))
    head = pdu.parameters.userdata
    assert head is not None
    assert (head.extended, head.usend, head.error_code, pdu.refused) == (False, False, 0, False)
    assert [(fault.reason, fault.field) for fault in pdu.malformed] == [("bad_value", "userdata head.syntax_id")]


@given(st.integers(0, 3), st.binary(max_size=40), st.integers(0, 2), st.integers(0, 3), st.integers(0, 2))
def test_never_raises(kind: int, payload: bytes, sequence: int, unit: int, last: int) -> None:
    body(userdata(kind, 6, 1, payload.hex(), sequence, unit, last))
    body(userdata(kind, 6, 1, ID + payload.hex(), sequence, unit, last))


@given(st.binary(max_size=12), st.binary(max_size=40))
def test_usend_never_raises(head: bytes, data: bytes) -> None:
    parse_body(parse_pdu(usend(data.hex(), "00011206130000000001" + head.hex())))
    body(usend(data.hex()))
