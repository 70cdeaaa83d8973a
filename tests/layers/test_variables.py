from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.packet import Packet

from dissect.layers import (
    COTP_DT,
    S7,
    TPKT,
    S7_Any,
    S7_DataItem,
    S7_DBArea,
    S7_DBReadItem,
    S7_NCKItem,
    S7_OtherItem,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_SymbolInDB,
    S7_SymbolStep,
    S7_WriteDataItem,
    S7_WriteVarAnswer,
    S7_WriteVarRequest,
    at,
)
from tests.layers.examples import BY_NUMBER
from tests.layers.support import forget, shown, survives


def body(number: int) -> Packet:
    """The body of a worked example."""
    payload = TPKT(BY_NUMBER[number].octets)[S7].payload
    assert isinstance(payload, Packet)
    return payload


#: Number of the worked example and its items: transport size, count, DB, area, address.
ITEMS = [
    (28, [(4, 3, 10, 0x84, 0x20)]),
    (30, [(1, 1, 0, 0x83, 0x53), (2, 3, 7, 0x84, 0), (8, 1, 7, 0x84, 0x40)]),
    (32, [(2, 2, 7, 0x84, 0), (2, 1, 999, 0x84, 0), (0x1D, 2, 0, 0x1D, 5)]),
    (34, [(7, 1, 1, 0x84, 0), (3, 3, 1, 0x84, 0x50), (0x1C, 1, 0, 0x1C, 5)]),
    (40, [(1, 1, 0, 0x83, 0x10)]),
    (42, [(2, 1, 3, 0x84, 0x28), (4, 2, 3, 0x84, 0x50)]),
    (102, [(2, 1, 1, 0x84, 0)]),
]
#: Number of the worked example and its data items: return code, transport size, length, octets, fill.
DATA = [
    (29, [(0xFF, 4, 48, "001102200333", "")]),
    (31, [(0xFF, 3, 1, "01", "00"), (0xFF, 4, 24, "a1b2c3", "00"), (0xFF, 7, 4, "42f6e979", "")]),
    (33, [(0xFF, 4, 16, "1234", ""), (0x0A, 0, 0, "", ""), (0xFF, 9, 4, "10051006", "")]),
    (35, [(0xFF, 5, 32, "fffffffe", ""), (0xFF, 9, 3, "616263", "00"), (0xFF, 9, 2, "0123", "")]),
    (37, [(0xFF, 9, 5, "ff0001ff7a", "")]),
    (40, [(0, 3, 1, "01", "")]),
    (42, [(0, 4, 8, "5a", "00"), (0, 4, 32, "00640065", "")]),
]


@pytest.mark.parametrize(("number", "items"), ITEMS)
def test_request_items(number: int, items: list[tuple[int, ...]]) -> None:
    request = body(number)
    assert request.item_count == len(items)
    for item, values in zip(request.items, items, strict=True):
        assert isinstance(item, S7_Any)
        assert (item.specification, item.length, item.syntax_id) == (0x12, 10, 0x10)
        assert (item.transport_size, item.count, item.db, item.area, item.address) == values
        assert item.fill == b""


@pytest.mark.parametrize(("number", "items"), DATA)
def test_data_items(number: int, items: list[tuple[int, int, int, str, str]]) -> None:
    for item, values in zip(body(number).data, items, strict=True):
        assert isinstance(item, S7_DataItem)
        assert (item.return_code, item.transport_size, item.length, item.octets.hex(), item.fill.hex()) == values


def request_items(number: int) -> list[S7_Any]:
    names = ("transport_size", "count", "db", "area", "address")
    items: list[dict[str, Any]] = [dict(zip(names, values, strict=True)) for values in dict(ITEMS)[number]]
    return [S7_Any(**values) for values in items]


@pytest.mark.parametrize(("number", "pdu_ref"), [(28, 0x200), (30, 0x300), (32, 0x400), (34, 0x480), (102, 0x2500)])
def test_read_requests_are_built_from_their_items(number: int, pdu_ref: int) -> None:
    built = TPKT() / COTP_DT() / S7(pdu_ref=pdu_ref) / S7_ReadVarRequest(items=request_items(number))
    assert bytes(built) == BY_NUMBER[number].octets


@pytest.mark.parametrize(("number", "pdu_ref"), [(29, 0x200), (31, 0x300), (33, 0x400), (35, 0x480), (37, 0x500)])
def test_read_answers_are_built_from_their_items(number: int, pdu_ref: int) -> None:
    items = [
        S7_DataItem(return_code=return_code, transport_size=transport_size, octets=bytes.fromhex(octets))
        for return_code, transport_size, _, octets, _ in dict(DATA)[number]
    ]
    built = TPKT() / COTP_DT() / S7(pdu_ref=pdu_ref) / S7_ReadVarAnswer(data=items)
    assert bytes(built) == BY_NUMBER[number].octets


@pytest.mark.parametrize(("number", "pdu_ref"), [(40, 0x800), (42, 0x900)])
def test_write_requests_are_built_from_their_items(number: int, pdu_ref: int) -> None:
    items: list[Any] = [
        S7_WriteDataItem(transport_size=transport_size, octets=bytes.fromhex(octets))
        for _, transport_size, _, octets, _ in dict(DATA)[number]
    ]
    built = TPKT() / COTP_DT() / S7(pdu_ref=pdu_ref) / S7_WriteVarRequest(items=request_items(number), data=items)
    assert bytes(built) == BY_NUMBER[number].octets


@pytest.mark.parametrize(("number", "pdu_ref", "codes"), [(41, 0x800, [0xFF]), (43, 0x900, [0xFF, 5])])
def test_write_answers_are_built_from_their_codes(number: int, pdu_ref: int, codes: list[int]) -> None:
    answer = body(number)
    assert isinstance(answer, S7_WriteVarAnswer)
    assert (answer.item_count, answer.return_codes) == (len(codes), codes)
    built = TPKT() / COTP_DT() / S7(pdu_ref=pdu_ref) / S7_WriteVarAnswer(return_codes=codes)
    assert bytes(built) == BY_NUMBER[number].octets


def test_return_codes_show_their_names() -> None:
    assert "return_codes= [Success, Invalid address]" in shown(body(43))


def only_item(number: int) -> Packet:
    """The only item of a worked example's request."""
    (item,) = body(number).items
    assert isinstance(item, Packet)
    return item


def test_several_areas_of_data_blocks_in_one_item() -> None:
    item = only_item(36)
    assert isinstance(item, S7_DBReadItem)
    assert (item.length, item.area_count) == (12, 2)
    assert [(area.area_size, area.db, area.start) for area in item.areas] == [(2, 68, 352), (1, 72, 48)]
    again = S7_DBReadItem(areas=[S7_DBArea(area_size=one.area_size, db=one.db, start=one.start) for one in item.areas])
    request = S7(pdu_ref=0x500) / S7_ReadVarRequest(items=[again])
    assert bytes(TPKT() / COTP_DT() / request) == BY_NUMBER[36].octets


def test_a_variable_of_an_nc() -> None:
    item = only_item(38)
    assert isinstance(item, S7_NCKItem)
    values: dict[str, Any] = {"nck_area": 2, "nck_unit": 1, "column": 1, "line_": 1, "module": 0x7F, "line_count": 1}
    assert {name: item.getfieldval(name) for name in values} == values
    request = S7(pdu_ref=0x600) / S7_ReadVarRequest(items=[S7_NCKItem(**values)])
    assert bytes(TPKT() / COTP_DT() / request) == BY_NUMBER[38].octets


def test_a_symbol() -> None:
    item = only_item(39)
    assert isinstance(item, S7_SymbolInDB)
    assert (item.root, item.db, item.crc) == (0x8A0E, 1, 0x11223344)
    assert [(step.flags, step.value) for step in item.steps] == [(4, 9)]
    again = S7_SymbolInDB(db=1, crc=0x11223344, steps=[S7_SymbolStep(flags=4, value=9)])
    assert bytes(TPKT() / COTP_DT() / S7(pdu_ref=0x700) / S7_ReadVarRequest(items=[again])) == BY_NUMBER[39].octets


def test_a_syntax_that_nobody_knows_keeps_its_octets() -> None:
    request = survives(S7, bytes.fromhex("320100000001000a0000 0401 1206aa0102030405"))
    (item,) = request.items
    assert isinstance(item, S7_OtherItem)
    assert (item.syntax_id, item.length, item.octets.hex()) == (0xAA, 6, "0102030405")
    assert bytes(S7(pdu_ref=1) / S7_ReadVarRequest(items=[S7_OtherItem(syntax_id=0xAA, octets=item.octets)])) == bytes(
        request
    )


def test_an_s7any_item_of_another_length_keeps_its_octets() -> None:
    request = survives(S7, bytes.fromhex("320100000001000f0000 0401 120b10 02000100018400000000"))
    (item,) = request.items
    assert isinstance(item, S7_OtherItem)
    assert item.octets.hex() == "02000100018400000000"


def test_an_odd_item_is_filled_unless_it_is_the_last() -> None:
    dbread = S7_OtherItem(syntax_id=0xB0, octets=bytes.fromhex("010200440160"))  # nine octets
    request = S7(pdu_ref=1) / S7_ReadVarRequest(items=[dbread, at("MB0"), dbread])
    octets = bytes(request)
    assert octets[12:22].hex() == "1207b001020044016000"
    assert len(octets) == 10 + 2 + 10 + 12 + 9
    again = survives(S7, octets)
    assert [item.fill for item in again.items] == [b"\x00", b"", b""]
    assert [item.length for item in again.items] == [7, 10, 7]


def test_a_fill_octet_that_is_not_zero_is_kept() -> None:
    octets = BY_NUMBER[31].octets.replace(bytes.fromhex("a1b2c300"), bytes.fromhex("a1b2c37f"))
    packet = survives(TPKT, octets)
    assert packet[S7_ReadVarAnswer].data[1].fill == b"\x7f"
    assert bytes(forget(packet)) == BY_NUMBER[31].octets


def test_a_fill_of_ones_own_is_taken_as_it_is() -> None:
    item = S7_DataItem(octets=b"\x01")
    padded = S7_DataItem(octets=b"\x01", fill=b"\x00")
    bare = S7_DataItem(octets=b"\x01", fill=b"")
    assert bytes(S7_ReadVarAnswer(data=[item, item]))[2:].hex() == "ff0400080100ff04000801"
    assert bytes(S7_ReadVarAnswer(data=[bare, padded]))[2:].hex() == "ff04000801ff0400080100"


def test_a_client_that_pads_the_last_item_too() -> None:
    octets = bytearray(BY_NUMBER[40].octets + b"\x00")
    octets[3] += 1
    octets[16] += 1
    packet = survives(TPKT, bytes(octets))
    (item,) = packet[S7_WriteVarRequest].data
    assert (item.octets, item.fill) == (b"\x01", b"")
    assert packet.data_rest == b"\x00"


@pytest.mark.parametrize("head", ["0a000000", "0a000004", "05000004", "06040010"])
def test_a_refused_item_of_an_answer_is_its_head(head: str) -> None:
    octets = bytes.fromhex("3203000000010002000a0000 0402" + head + "ff0400105a5a")
    first, second = survives(S7, octets).data
    assert (first.return_code, first.octets) == (int(head[:2], 16), b"")
    assert second.octets == b"ZZ"


def test_a_data_item_that_is_cut_keeps_its_length() -> None:
    packet = survives(S7, bytes.fromhex("320300000001000200080000 0401 ff040040 01020304"))
    (item,) = packet.data
    assert (item.length, item.octets.hex()) == (64, "01020304")


@pytest.mark.parametrize(
    ("octets", "items", "rest"),
    [
        ("320100000001000e0000 0402 120a10020001000084000000", 1, ""),  # two counted, one there
        ("320100000001001a0000 0401 120a10020001000084000000 120a10020001000084000000", 1, "120a10020001000084000000"),
        ("32010000000100060000 0401 12001002", 0, "12001002"),  # an item without a syntax id
        ("32010000000100080000 0401 120a10020001", 0, "120a10020001"),  # an item longer than the block
    ],
)
def test_counts_and_lengths_that_lie(octets: str, items: int, rest: str) -> None:
    packet = survives(S7, bytes.fromhex(octets))
    assert len(packet.items) == items
    assert packet.parameter_rest.hex() == rest


def test_more_return_codes_than_items_are_left_over() -> None:
    packet = survives(S7, bytes.fromhex("320300000001000200030000 0501 ff0505"))
    assert (packet.return_codes, packet.data_rest) == ([0xFF], b"\x05\x05")


@pytest.mark.parametrize(
    ("transport_size", "octets", "length"),
    [
        (3, "01", 1),
        (3, "0101", 16),
        (4, "0102", 16),
        (5, "01020304", 32),
        (7, "01020304", 4),
        (9, "616263", 3),
        (0, "", 0),
    ],
)
def test_the_length_of_a_data_item_counts_what_its_transport_size_says(
    transport_size: int, octets: str, length: int
) -> None:
    item = S7_DataItem(transport_size=transport_size, octets=bytes.fromhex(octets))
    assert bytes(item)[2:4] == length.to_bytes(2, "big")


def test_lengths_that_no_field_can_say_are_refused() -> None:
    with pytest.raises(ValueError, match="the length of the data item would be 65536"):
        bytes(S7_DataItem(transport_size=4, octets=bytes(8192)))
    with pytest.raises(ValueError, match="the length of the item would be 256"):
        bytes(S7_OtherItem(octets=bytes(255)))
    with pytest.raises(ValueError, match="the S7 data length would be 80008"):
        bytes(S7() / S7_WriteVarRequest(data=[S7_WriteDataItem(transport_size=9, octets=bytes(40000))] * 2))


def test_long_lists_are_summed_up() -> None:
    request = S7(pdu_ref=1) / S7_ReadVarRequest(items=[at(f"MB{number}") for number in range(7)])
    assert request.summary() == "S7 Job Read Var ref=0x0001 MB0, MB1, MB2, MB3, +3 more"
    answer = S7(pdu_ref=1) / S7_WriteVarAnswer(return_codes=[5, 0xFF, 0x2F])
    assert answer.summary() == "S7 Ack_Data Write Var ref=0x0001 1 ok, Invalid address, 0x2f"


@given(
    count=st.integers(0, 3),
    items=st.lists(st.tuples(st.sampled_from((0, 5, 0x0A, 0xFF)), st.integers(0, 9), st.integers(0, 40)), max_size=3),
    octets=st.binary(max_size=30),
    rosctr=st.sampled_from((1, 3)),
)
def test_any_data_block_survives(count: int, items: list[tuple[int, int, int]], octets: bytes, rosctr: int) -> None:
    block = b"".join(bytes((code, size, 0, length)) + octets[: length & 7] for code, size, length in items) + octets
    function = 4 if rosctr == 3 else 5
    header = bytes((0x32, rosctr, 0, 0, 0, 1, 0, 2)) + len(block).to_bytes(2, "big") + bytes(rosctr - 1)
    survives(S7, header + bytes((function, count)) + block)
