"""What the builders make is what the parsers read."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.build import (
    NO_PAYLOAD,
    build_data_item,
    build_item,
    build_items,
    build_payload,
    build_pdu,
    build_setup,
    build_userdata_head,
    build_variables,
    with_reference,
)
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import PUSH, REQUEST, RESPONSE, Setup
from dissect.protocols.s7.tables import ACK_DATA, JOB, READ_VAR, USERDATA, WRITE_VAR

WORD = st.integers(0, 0xFFFF)
ITEM = st.tuples(st.sampled_from((2, 4, 6, 8)), st.integers(1, 0xFFFF), WORD, st.integers(0, 0xFFFFFF))


@given(WORD, WORD, WORD, st.sampled_from((JOB, ACK_DATA)))
def test_a_setup_is_read_as_it_was_built(calling: int, called: int, length: int, rosctr: int) -> None:
    pdu = parse_pdu(build_setup(rosctr, Setup(calling, called, length)))
    setup = pdu.parameters.setup
    assert setup is not None
    assert (setup.max_amq_calling, setup.max_amq_called, setup.pdu_length) == (calling, called, length)
    assert not pdu.malformed


@given(st.lists(ITEM, min_size=1, max_size=5))
def test_a_read_is_read_as_it_was_built(items: list[tuple[int, int, int, int]]) -> None:
    built = [build_item(size, count, db, 0x84, address) for size, count, db, address in items]
    pdu = parse_pdu(build_variables(JOB, READ_VAR, len(built), build_items(built)))
    found = pdu.parameters.items
    assert [(one.transport_size, one.count, one.db, one.start_bit) for one in found] == items
    assert [one.octets for one in found] == built


@given(st.lists(st.tuples(st.sampled_from((4, 5, 7, 9)), st.binary(min_size=1, max_size=9)), min_size=1, max_size=5))
def test_data_items_are_read_as_they_were_built(values: list[tuple[int, bytes]]) -> None:
    data = build_items([build_data_item(0xFF, size, octets) for size, octets in values])
    pdu = parse_pdu(build_variables(ACK_DATA, READ_VAR, len(values), b"", data))
    assert [(one.transport_size, one.data) for one in pdu.data_items()] == values
    assert not pdu.malformed


def test_a_bit_is_one_bit() -> None:
    assert build_data_item(0, 3, b"\x01") == b"\0\x03\0\x01\x01"
    assert parse_pdu(build_variables(ACK_DATA, WRITE_VAR, 2, b"", b"\xff\x0a")).return_codes() == [0xFF, 0x0A]


@given(st.sampled_from((REQUEST, RESPONSE, PUSH)), st.integers(0, 15), st.integers(0, 255), st.integers(0, 255), WORD)
def test_a_userdata_head_is_read_as_it_was_built(
    type_: int, group: int, subfunction: int, sequence: int, error: int
) -> None:
    for extended in (True, False):
        octets = build_userdata_head(type_, group, subfunction, sequence, extended, error)
        head = parse_pdu(build_pdu(USERDATA, octets, NO_PAYLOAD)).parameters.userdata
        assert head is not None
        assert (head.type, head.group, head.subfunction, head.sequence) == (type_, group, subfunction, sequence)
        assert (head.extended, head.error_code) == (extended, error if extended else 0)


def test_a_payload_has_its_length_before_it() -> None:
    assert build_payload(b"") == NO_PAYLOAD == b"\x0a\0\0\0"
    assert build_payload(b"abc") == b"\xff\x09\0\x03abc"


def test_only_a_whole_header_has_a_reference() -> None:
    pdu = build_pdu(JOB, b"\x04\0")
    assert parse_pdu(with_reference(pdu, b"\x12\x34")).pdu_ref == 0x1234
    assert with_reference(pdu[:9], b"\x12\x34") == pdu[:9]


@pytest.mark.parametrize(("rosctr", "size"), [(1, 10), (2, 12), (3, 12), (7, 10)])
def test_the_error_is_in_answers_only(rosctr: int, size: int) -> None:
    pdu = build_pdu(rosctr, b"", b"", 0x8104)
    assert len(pdu) == size
    assert pdu[10:] == (b"\x81\x04" if size == 12 else b"")
