from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.items import DataItem
from dissect.protocols.s7.layouts import ACK_HEADER, HEADER
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import header_size, read_header
from dissect.protocols.s7.tables import ROSCTR
from dissect.wire.malformed import LIMITS, REASONS, Malformed
from tests.cases import each
from tests.engine.transactions.talk import (
    ack,
    ack_data,
    dbw,
    good,
    head,
    job,
    read,
    refused,
    userdata,
    words,
    write,
    written,
)
from tests.layers.examples import BY_NUMBER

#: The worked examples: number, ROSCTR, reference, octets of parameters and data, header error (-1: has none), function.
HEADERS = [
    (26, 1, 0x0100, 8, 0, -1, 0xF0),
    (27, 3, 0x0100, 8, 0, 0, 0xF0),
    (28, 1, 0x0200, 14, 0, -1, 0x04),
    (29, 3, 0x0200, 2, 10, 0, 0x04),
    (30, 1, 0x0300, 38, 0, -1, 0x04),
    (31, 3, 0x0300, 2, 22, 0, 0x04),
    (32, 1, 0x0400, 38, 0, -1, 0x04),
    (33, 3, 0x0400, 2, 18, 0, 0x04),
    (34, 1, 0x0480, 38, 0, -1, 0x04),
    (35, 3, 0x0480, 2, 22, 0, 0x04),
    (36, 1, 0x0500, 16, 0, -1, 0x04),
    (37, 3, 0x0500, 2, 9, 0, 0x04),
    (38, 1, 0x0600, 12, 0, -1, 0x04),
    (39, 1, 0x0700, 18, 0, -1, 0x04),
    (40, 1, 0x0800, 14, 5, -1, 0x05),
    (41, 3, 0x0800, 2, 1, 0, 0x05),
    (42, 1, 0x0900, 26, 14, -1, 0x05),
    (43, 3, 0x0900, 2, 2, 0, 0x05),
    (44, 2, 0x0901, 0, 0, 0x8104, -1),
    (45, 1, 0x0A00, 18, 0, -1, 0x1D),
    (46, 3, 0x0A00, 16, 0, 0, 0x1D),
    (47, 1, 0x0B00, 8, 0, -1, 0x1E),
    (48, 3, 0x0B00, 2, 12, 0, 0x1E),
    (49, 1, 0x0C00, 8, 0, -1, 0x1F),
    (50, 3, 0x0C00, 1, 0, 0, 0x1F),
    (51, 2, 0x0C01, 0, 0, 0xD209, -1),
    (52, 1, 0x0D00, 32, 0, -1, 0x1A),
    (53, 3, 0x0D00, 1, 0, 0, 0x1A),
    (54, 1, 0x0165, 18, 0, -1, 0x1B),
    (55, 3, 0x0165, 2, 10, 0, 0x1B),
    (56, 1, 0x0167, 18, 0, -1, 0x1C),
    (57, 3, 0x0167, 1, 0, 0, 0x1C),
    (58, 1, 0x0E00, 26, 0, -1, 0x28),
    (59, 3, 0x0E00, 1, 0, 0, 0x28),
    (60, 3, 0x0E01, 2, 0, 0xD2A9, 0x28),
    (61, 1, 0x0F00, 26, 0, -1, 0x28),
    (62, 1, 0x1000, 20, 0, -1, 0x28),
    (63, 1, 0x1100, 22, 0, -1, 0x28),
    (64, 1, 0x1200, 18, 0, -1, 0x28),
    (65, 1, 0x1300, 16, 0, -1, 0x28),
    (66, 1, 0x1400, 16, 0, -1, 0x29),
    (67, 3, 0x1400, 1, 0, 0, 0x29),
    (68, 7, 0x1500, 8, 8, -1, 0x00),
    (69, 7, 0x1500, 12, 32, -1, 0x00),
    (70, 7, 0x1600, 12, 18, -1, 0x00),
    (71, 7, 0x1700, 12, 4, -1, 0x00),
    (72, 7, 0x1700, 12, 10, -1, 0x00),
    (73, 7, 0x1800, 12, 4, -1, 0x00),
    (74, 7, 0x1900, 8, 4, -1, 0x00),
    (75, 7, 0x1900, 12, 12, -1, 0x00),
    (76, 7, 0x1A00, 8, 6, -1, 0x00),
    (77, 7, 0x1A00, 12, 12, -1, 0x00),
    (78, 7, 0x1B00, 8, 12, -1, 0x00),
    (79, 7, 0x1B00, 12, 82, -1, 0x00),
    (80, 7, 0x1C00, 8, 4, -1, 0x00),
    (81, 7, 0x1C00, 12, 14, -1, 0x00),
    (82, 7, 0x1D00, 8, 14, -1, 0x00),
    (83, 7, 0x1D00, 12, 4, -1, 0x00),
    (84, 7, 0x1E00, 8, 12, -1, 0x00),
    (85, 7, 0x1E00, 12, 4, -1, 0x00),
    (86, 7, 0x1E01, 12, 4, -1, 0x00),
    (87, 7, 0x1F00, 8, 14, -1, 0x00),
    (88, 7, 0x1F00, 12, 6, -1, 0x00),
    (89, 7, 0x0000, 8, 0, -1, 0x01),
    (90, 7, 0x0000, 8, 24, -1, 0x00),
    (91, 7, 0x0000, 8, 32, -1, 0x00),
    (92, 7, 0x2000, 8, 20, -1, 0x00),
    (93, 7, 0x2000, 12, 12, -1, 0x00),
    (94, 7, 0x0000, 12, 12, -1, 0x00),
    (95, 7, 0x2100, 8, 6, -1, 0x00),
    (96, 7, 0x2200, 12, 36, -1, 0x00),
    (97, 7, 0x2300, 12, 18, -1, 0x00),
    (98, 7, 0x2300, 12, 4, -1, 0x00),
    (102, 1, 0x2500, 14, 0, -1, 0x04),
]
#: Heads of the userdata examples: number, type, group, subfunction, sequence, and of the extended ones data unit reference,
#: last data unit (0 is yes) and error code.
USERDATA_HEADS = [
    (68, 1, 4, 1, 0, None),
    (69, 2, 4, 1, 2, (0, 0, 0)),
    (70, 2, 4, 1, 3, (213, 1, 0)),
    (71, 1, 4, 1, 3, (0, 0, 0)),
    (72, 2, 4, 1, 3, (213, 0, 0)),
    (73, 2, 4, 1, 0, (0, 0, 0xD402)),
    (74, 1, 3, 1, 0, None),
    (75, 2, 3, 1, 0, (0, 0, 0)),
    (76, 1, 3, 2, 0, None),
    (77, 2, 3, 2, 1, (0, 0, 0)),
    (78, 1, 3, 3, 0, None),
    (79, 2, 3, 3, 0, (0, 0, 0)),
    (80, 1, 7, 1, 0, None),
    (81, 2, 7, 1, 2, (0, 0, 0)),
    (82, 1, 7, 2, 0, None),
    (83, 2, 7, 2, 0, (0, 0, 0)),
    (84, 1, 5, 1, 0, None),
    (85, 2, 5, 1, 1, (0, 0, 0)),
    (86, 2, 5, 1, 1, (0, 0, 0xD602)),
    (87, 1, 4, 2, 0, None),
    (88, 2, 4, 2, 1, (0, 0, 0)),
    (90, 0, 4, 3, 0, None),
    (91, 0, 4, 5, 0, None),
    (92, 1, 2, 1, 0, None),
    (93, 2, 2, 1, 4, (0, 0, 0)),
    (94, 0, 2, 1, 4, (0, 0, 0)),
    (95, 1, 2, 4, 0, None),
    (96, 1, 1, 2, 0, (0, 0, 0)),
    (97, 1, 6, 1, 0, (0, 0, 0)),
    (98, 2, 6, 1, 0, (0, 0, 0)),
]
#: Items of the requests: number, and for each item address, area, DB, start bit, transport size, count, octets of the answer.
ITEMS = [
    (28, [("DB10.DBW4", 0x84, 10, 0x20, 0x04, 3, 6)]),
    (
        30,
        [
            ("M10.3", 0x83, 0, 0x53, 0x01, 1, 1),
            ("DB7.DBB0", 0x84, 7, 0, 0x02, 3, 3),
            ("DB7.DBD8", 0x84, 7, 0x40, 0x08, 1, 4),
        ],
    ),
    (
        32,
        [
            ("DB7.DBB0", 0x84, 7, 0, 0x02, 2, 2),
            ("DB999.DBB0", 0x84, 999, 0, 0x02, 1, 1),
            ("T5", 0x1D, 0, 5, 0x1D, 2, 4),
        ],
    ),
    (
        34,
        [
            ("DB1.DBD0", 0x84, 1, 0, 0x07, 1, 4),
            ("DB1.DBB10", 0x84, 1, 0x50, 0x03, 3, 3),
            ("C5", 0x1C, 0, 5, 0x1C, 1, 2),
        ],
    ),
    (36, [("DB68.DBB352 x2+DB72.DBB48", -1, -1, -1, -1, -1, -1)]),
    (38, [("NCK C1 module S column 1 line 1", -1, -1, -1, -1, -1, -1)]),
    (39, [("SYM DB1 LID 9", -1, -1, -1, -1, -1, -1)]),
    (40, [("M2.0", 0x83, 0, 0x10, 0x01, 1, 1)]),
    (42, [("DB3.DBB5", 0x84, 3, 0x28, 0x02, 1, 1), ("DB3.DBW10", 0x84, 3, 0x50, 0x04, 2, 4)]),
    (102, [("DB1.DBB0", 0x84, 1, 0, 0x02, 1, 1)]),
]
#: Data items: number, and for each item its offset in the PDU, return code, transport size, length field and octets.
DATA = [
    (29, [(14, 0xFF, 4, 48, "001102200333")]),
    (31, [(14, 0xFF, 3, 1, "01"), (20, 0xFF, 4, 24, "a1b2c3"), (28, 0xFF, 7, 4, "42f6e979")]),
    (33, [(14, 0xFF, 4, 16, "1234"), (20, 0x0A, 0, 0, ""), (24, 0xFF, 9, 4, "10051006")]),
    (35, [(14, 0xFF, 5, 32, "fffffffe"), (22, 0xFF, 9, 3, "616263"), (30, 0xFF, 9, 2, "0123")]),
    (37, [(14, 0xFF, 9, 5, "ff0001ff7a")]),
    (40, [(24, 0, 3, 1, "01")]),
    (42, [(36, 0, 4, 8, "5a"), (42, 0, 4, 32, "00640065")]),
]


def octets_of(number: int) -> bytes:
    """The S7 PDU of a worked example: what follows the TPKT and the DT."""
    return BY_NUMBER[number].octets[7:]


def fields(item: DataItem) -> tuple[int, int, int, int, str]:
    return item.offset, item.return_code, item.transport_size, item.length, item.data.hex()


@each(("number", "rosctr", "pdu_ref", "param_length", "data_length", "error", "function"), HEADERS)
def test_header(
    number: int, rosctr: int, pdu_ref: int, param_length: int, data_length: int, error: int, function: int
) -> None:
    pdu = parse_pdu(octets_of(number), 7, 8, 9, 1)
    assert (pdu.rosctr, pdu.pdu_ref, pdu.param_length, pdu.data_length) == (rosctr, pdu_ref, param_length, data_length)
    assert (pdu.error_class << 8 | pdu.error_code if pdu.error_class >= 0 else -1) == error
    assert pdu.function == function
    assert pdu.header_size + len(pdu.parameters.octets) + len(pdu.data) == len(pdu.octets)
    assert (pdu.redundancy_id, pdu.malformed, pdu.cut) == (0, [], False)
    assert (pdu.frame, pdu.time_ns, pdu.connection, pdu.side) == (7, 8, 9, 1)


def test_every_s7_example_is_held_here() -> None:
    s7 = {number for number, example in BY_NUMBER.items() if example.octets[4:8] == b"\x02\xf0\x80\x32"}
    assert {row[0] for row in HEADERS} == s7
    assert {row[0] for row in USERDATA_HEADS} == {row[0] for row in HEADERS if row[1] == 7} - {89}


@each(("number", "type_", "group", "subfunction", "sequence", "extension"), USERDATA_HEADS)
def test_userdata_head(
    number: int, type_: int, group: int, subfunction: int, sequence: int, extension: tuple[int, int, int] | None
) -> None:
    userdata_head = parse_pdu(octets_of(number)).parameters.userdata
    assert userdata_head is not None
    assert (userdata_head.type, userdata_head.group) == (type_, group)
    assert (userdata_head.subfunction, userdata_head.sequence) == (subfunction, sequence)
    assert userdata_head.extended is (extension is not None)
    told = (userdata_head.data_unit_ref, userdata_head.last_data_unit, userdata_head.error_code)
    assert told == (extension or (0, 0, 0))


def test_mode_transition_has_a_head_of_its_own() -> None:
    pdu = parse_pdu(octets_of(89))
    userdata_head = pdu.parameters.userdata
    assert userdata_head is not None
    assert (userdata_head.type, userdata_head.group, userdata_head.subfunction, userdata_head.extended) == (
        0,
        0,
        0,
        False,
    )
    assert pdu.function_name == "mode transition: STOP"


@pytest.mark.parametrize(("number", "items"), ITEMS)
def test_request_items(number: int, items: list[tuple[str, int, int, int, int, int, int]]) -> None:
    parameters = parse_pdu(octets_of(number)).parameters
    assert parameters.item_count == len(items)
    told = [
        (item.address, item.area, item.db, item.start_bit, item.transport_size, item.count, item.size)
        for item in parameters.items
    ]
    assert told == items


@pytest.mark.parametrize(("number", "items"), DATA)
def test_data_items(number: int, items: list[tuple[int, int, int, int, str]]) -> None:
    assert [fields(item) for item in parse_pdu(octets_of(number)).data_items()] == items


@pytest.mark.parametrize(
    ("number", "codes"),
    [(28, []), (29, [0xFF]), (33, [0xFF, 0x0A, 0xFF]), (40, []), (41, [0xFF]), (43, [0xFF, 0x05]), (44, [])],
)
def test_return_codes(number: int, codes: list[int]) -> None:
    pdu = parse_pdu(octets_of(number))
    assert pdu.return_codes() == codes
    assert pdu.refused is (number in {33, 43, 44})


@pytest.mark.parametrize(("number", "asked"), [(26, (1, 1, 480)), (27, (1, 1, 240))])
def test_setup(number: int, asked: tuple[int, int, int]) -> None:
    setup = parse_pdu(octets_of(number)).parameters.setup
    assert setup is not None
    assert (setup.max_amq_calling, setup.max_amq_called, setup.pdu_length) == asked
    assert setup.as_dict() == dict(zip(("max_amq_calling", "max_amq_called", "pdu_length"), asked, strict=True))


# ---- damage ---------------------------------------------------------------------------------------------------------


def assert_sound(octets: bytes, cut: bool = False) -> Pdu:
    """Read octets that may be anything: nothing raises, nothing comes from nowhere, every fault is told in full."""
    pdu = parse_pdu(octets, cut=cut)
    told: list[Malformed] = []
    items = pdu.data_items(told)
    for fault in pdu.malformed + told:
        assert fault.layer == "s7"
        assert fault.reason in REASONS
        assert fault.limit in LIMITS
        assert fault.field
        assert fault.offset >= 0
        assert fault.needed >= 0
        assert fault.available >= 0
        assert fault.reason not in {"too_short", "length_beyond"} or fault.needed > fault.available, str(fault)
        assert fault.reason != "count_mismatch" or fault.needed != fault.available, str(fault)
        assert fault.as_dict()["offset"] == fault.offset
    assert len(items) <= 255
    assert len(pdu.parameters.items) <= 255
    assert sum(len(item.octets) for item in pdu.parameters.items) <= len(octets)
    assert sum(4 + len(item.data) for item in items) <= len(octets)
    for item in items:
        assert octets[item.offset + 4 : item.offset + 4 + len(item.data)] == item.data
    assert len(pdu.return_codes()) <= len(octets)
    assert isinstance(pdu.refused, bool)
    assert isinstance(pdu.function_name + pdu.rosctr_name, str)
    assert pdu.octets == octets
    return pdu


@each("number", [row[0] for row in HEADERS])
def test_truncated_anywhere(number: int) -> None:
    whole = octets_of(number)
    for size in range(len(whole)):
        for cut in (False, True):
            pdu = assert_sound(whole[:size], cut)
            assert pdu.malformed, size
            assert pdu.malformed[0].limit == ("snaplen" if cut else "tsdu")
            assert pdu.malformed[0].available == size
            assert pdu.malformed[0].needed > size


@each("number", [row[0] for row in HEADERS])
def test_one_octet_changed_anywhere(number: int) -> None:
    whole = octets_of(number)
    for at in range(1, len(whole)):
        for value in {0, 1, 0x7F, 0x80, 0xFF, whole[at] ^ 1, whole[at] ^ 0x80, (whole[at] + 1) & 0xFF}:
            assert_sound(whole[:at] + bytes((value,)) + whole[at + 1 :])


@each("number", [row[0] for row in HEADERS])
@pytest.mark.parametrize("trailing", [b"\x00", b"\xff" * 7])
def test_trailing_octets(number: int, trailing: bytes) -> None:
    whole = octets_of(number)
    pdu = assert_sound(whole + trailing)
    fault = pdu.malformed[0]
    assert (fault.reason, fault.offset) == ("trailing_octets", len(whole))
    assert (fault.needed, fault.available) == (len(whole), len(whole) + len(trailing))
    assert [fields(item) for item in pdu.data_items()] == [fields(item) for item in parse_pdu(whole).data_items()]


@given(st.binary(max_size=80))
def test_any_octets(octets: bytes) -> None:
    assert_sound(b"\x32" + octets)


@given(
    st.sampled_from([1, 2, 3, 7]), st.sampled_from([0, 1, 4, 5, 0xF0]), st.binary(max_size=60), st.binary(max_size=60)
)
def test_any_octets_with_true_lengths(rosctr: int, function: int, parameters: bytes, data: bytes) -> None:
    lengths = struct.pack(">HH", len(parameters) + 1, len(data))
    error = b"\0\0" if rosctr in {2, 3} else b""
    pdu = assert_sound(bytes((0x32, rosctr, 0, 0, 0, 1)) + lengths + error + bytes((function,)) + parameters + data)
    assert pdu.parameters.octets[1:] == parameters
    assert pdu.data == data
    assert not any(fault.limit == "tsdu" for fault in pdu.malformed)


@given(st.binary(min_size=12, max_size=12))
def test_header_is_its_layout(octets: bytes) -> None:
    octets = b"\x32" + octets[1:]
    layout = ACK_HEADER if octets[1] in {2, 3} else HEADER
    values = {value.field.name: value.value for value in layout.read(octets)}
    rosctr, pdu_ref, param_length, data_length = read_header(octets, 0)
    assert (rosctr, pdu_ref) == (values["rosctr"], values["pdu_ref"])
    assert (param_length, data_length) == (values["param_length"], values["data_length"])
    assert read_header(b"\xaa" * 3 + octets, 3) == (rosctr, pdu_ref, param_length, data_length)
    assert header_size(rosctr) == layout.size
    pdu = parse_pdu(octets)
    assert (pdu.rosctr, pdu.redundancy_id, pdu.pdu_ref) == (rosctr, values["redundancy_id"], pdu_ref)
    assert (pdu.param_length, pdu.data_length) == (param_length, data_length)
    assert (pdu.error_class, pdu.error_code) == (values.get("error_class", -1), values.get("error_code", -1))


def faults(pdu: Pdu) -> list[tuple[str, str, int, int, int, str]]:
    return [
        (fault.reason, fault.field, fault.offset, fault.needed, fault.available, fault.limit) for fault in pdu.malformed
    ]


def test_lengths_that_lie() -> None:
    whole = words(1, 0x1234)
    assert faults(parse_pdu(whole[:8] + b"\x00\x63" + whole[10:])) == [
        ("length_beyond", "data_length", 8, 12 + 2 + 0x63, len(whole), "tsdu")
    ]
    assert faults(parse_pdu(whole[:6] + b"\xff\xff" + whole[8:])) == [
        ("length_beyond", "param_length", 6, 12 + 0xFFFF + 6, len(whole), "tsdu")
    ]
    assert faults(parse_pdu(whole[:9])) == [("too_short", "header", 0, 10, 9, "tsdu")]
    assert faults(parse_pdu(whole[:11])) == [("too_short", "header", 0, 12, 11, "tsdu")]
    assert faults(parse_pdu(whole[:11], cut=True)) == [("too_short", "header", 0, 12, 11, "snaplen")]


def test_a_pdu_of_an_unknown_kind_is_told_and_read() -> None:
    octets = bytes((0x32, 5)) + read(7, dbw(1, 0))[2:]
    pdu = parse_pdu(octets)
    assert faults(pdu) == [("unknown_type", "rosctr", 1, 0, 5, "tsdu")]
    assert (pdu.pdu_ref, pdu.function, pdu.rosctr_name) == (7, 4, "0x05")
    assert 5 not in ROSCTR


def test_offsets_of_the_parameters_are_those_of_the_pdu() -> None:
    octets = job(1, b"\x04\x02" + dbw(1, 0))
    assert faults(parse_pdu(octets)) == [("count_mismatch", "item_count", 11, 2, 1, "param")]


def test_a_refused_read_needs_no_items() -> None:
    pdu = parse_pdu(ack_data(1, b"\x04\x01", b"", 0x8500))
    assert (pdu.malformed, pdu.data_items(), pdu.return_codes(), pdu.refused) == ([], [], [], True)
    told = parse_pdu(ack_data(1, b"\x04\x01", b""))
    assert faults(told) == [("count_mismatch", "data items", 14, 1, 0, "data")]


def test_data_where_no_items_are_counted() -> None:
    told = parse_pdu(ack_data(1, b"\x04\x00", good(4, b"\x12\x34")))
    assert faults(told) == [("trailing_octets", "data items", 14, 0, 6, "data")]
    assert told.data_items() == []


def test_of_two_octets_the_kind_is_known() -> None:
    assert parse_pdu(b"\x32\x07").rosctr == 7
    assert parse_pdu(b"\x32").rosctr == -1


@pytest.mark.parametrize(("count", "codes"), [(2, b"\xff"), (1, b"\xff\xff"), (1, b"")])
def test_a_write_answer_has_one_octet_for_each_item(count: int, codes: bytes) -> None:
    told = parse_pdu(ack_data(1, bytes((5, count)), codes))
    assert faults(told) == [("count_mismatch", "return codes", 14, count, len(codes), "data")]
    assert told.return_codes() == list(codes)


def test_a_refused_write_needs_no_return_codes() -> None:
    assert parse_pdu(ack_data(1, b"\x05\x01", b"", 0x8500)).malformed == []
    assert parse_pdu(ack_data(1, b"\x05\x01", b"\x05", 0x8500)).malformed == []


def test_an_ack_may_name_the_function_it_refuses() -> None:
    for code in (b"", b"\x04", b"\x04\x01", b"\x1d"):
        pdu = parse_pdu(ack(1, 0x8104, code))
        assert (pdu.malformed, pdu.refused, pdu.function) == ([], True, code[0] if code else -1)


def test_data_items_belong_to_read_answers_and_write_requests_only() -> None:
    payload = good(4, b"\x12\x34")
    assert len(parse_pdu(ack_data(1, b"\x04\x01", payload)).data_items()) == 1
    assert len(parse_pdu(write(1, [dbw(1, 0)], written(4, b"\x12\x34"))).data_items()) == 1
    for octets in (
        job(1, b"\x04\x00", payload),
        ack_data(1, b"\x1e\x00", payload),
        userdata(1, head(2, 4, 1), payload),
    ):
        assert parse_pdu(octets).data_items() == []


@pytest.mark.parametrize(
    ("octets", "refusal"),
    [
        (words(1, 1), False),
        (ack(1, 0x8104), True),
        (ack(1, 0x0001), True),
        (ack_data(1, b"\x28\x02", b"", 0xD2A9), True),
        (ack_data(1, b"\x04\x01", refused(0x05)), True),
        (ack_data(1, b"\x05\x01", b"\x00"), True),
        (userdata(1, head(2, 7, 2, 1, 0)), False),
        (userdata(1, head(2, 4, 1, 1, 0)), True),
        (userdata(1, head(2, 4, 1, 1, 0xD402)), True),
        (read(1, dbw(1, 0)), False),
    ],
)
def test_refused(octets: bytes, refusal: bool) -> None:
    assert parse_pdu(octets).refused is refusal


def test_names() -> None:
    assert parse_pdu(octets_of(28)).rosctr_name == "Job"
    assert parse_pdu(octets_of(28)).function_name == "Read Var"
    assert parse_pdu(octets_of(69)).function_name == "CPU functions: read SZL"
    assert parse_pdu(octets_of(44)).function_name == ""
    assert parse_pdu(job(1, b"\x77")).function_name == "0x77"
    assert parse_pdu(userdata(1, b"")).function_name == "CPU services"
