from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.packet import Packet, Raw

from dissect.layers import (
    COTP_DT,
    S7,
    SCD,
    COTP_Parameter,
    S7_DataItem,
    S7_FileName,
    S7_Job,
    S7_PIName,
    S7_ReadVarRequest,
    S7_UserdataShort,
    at,
    fields,
)
from dissect.layers.fields import WireLayer, fill_number, header_fields
from dissect.layers.part_classes import S7Plus_Address, S7Plus_ItemValue
from dissect.layers.plus_messages import plus_parts
from dissect.layers.s7plus import S7Plus_Request
from dissect.protocols.iso import layouts as iso_layouts
from dissect.protocols.s7 import layouts as s7_layouts
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value
from dissect.wire.layout import Layout
from tests.cases import each
from tests.layers.support import shown

LAYOUTS = [
    value for module in (iso_layouts, s7_layouts) for value in vars(module).values() if isinstance(value, Layout)
]


@cache
def layer_of(layout: Layout) -> type[Packet]:
    return type(
        "Layer", (WireLayer,), {"name": layout.name, "fields_desc": header_fields(layout), "least": layout.size}
    )


@each("layout", LAYOUTS)
@given(octets=st.binary(min_size=16, max_size=16))
def test_the_fields_read_what_the_layout_reads(layout: Layout, octets: bytes) -> None:
    packet = layer_of(layout)(octets)
    for value in layout.read(octets):
        assert packet.getfieldval(value.field.name) == value.value
    packet.clear_cache()
    assert bytes(packet) == octets


@each("layout", LAYOUTS)
def test_the_fields_take_as_many_octets_as_the_layout(layout: Layout) -> None:
    assert len(bytes(layer_of(layout)())) == layout.size


def test_codes_show_their_names() -> None:
    assert "Ack_Data" in shown(layer_of(s7_layouts.HEADER)(rosctr=3))


def test_a_default_or_replacement_of_no_field_is_refused() -> None:
    with pytest.raises(ValueError, match="TPKT has no field lenght; it has"):
        header_fields(iso_layouts.TPKT, {"lenght": 1})
    with pytest.raises(ValueError, match="has no field size"):
        header_fields(iso_layouts.TPKT, replace={"size": fields.FillField()})


def test_octets_shorter_than_the_fixed_part_are_raw() -> None:
    layer = layer_of(iso_layouts.TPKT)
    assert isinstance(layer(b"\x03\x00\x00"), Raw)
    assert isinstance(layer(b"\x03\x00\x00\x07"), layer)


def test_a_number_too_large_for_its_field_is_refused() -> None:
    assert fill_number(b"abcd", 1, 2, 0x3132, "x") == b"a12d"
    with pytest.raises(ValueError, match=r"the TPKT length would be 65536, more than its 2 byte"):
        fill_number(b"abcd", 2, 2, 65536, "the TPKT length")


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: S7Plus_ItemValue(type="Intt"), "type: no value is called 'Intt': do you mean Int? Else give Null, Bool"),
        (lambda: S7Plus_Request(function="Read"), "function: no value is called 'Read': give Error, Explore, CreateObject"),
        (lambda: S7Plus_Address(area="M"), "area is a number, not 'M': The object or area: 80 I, 81 Q, 82 M"),
        (lambda: S7Plus_Address(sub_area="pump"), "sub_area: no value is called 'pump': give its number"),
        (lambda: S7Plus_Address(lids=["M"]), "lids is a number, not 'M'"),
        (lambda: plus_parts(Value(0, 0x99, 5)), "0x99 does not take int"),
        (lambda: S7(pdu_ref="a"), "pdu_ref is a number, not 'a'"),
        (lambda: COTP_DT(credit="a"), "credit is a number, not 'a'"),
        (lambda: S7_UserdataShort(subfunction="read SZL"), "subfunction is a number, not 'read SZL'"),
        (lambda: S7_FileName(block_number=1), "block_number takes bytes or a text, not the number 1"),
        (lambda: S7_DataItem(octets=5), "octets takes bytes or a text, not the number 5"),
        (lambda: S7_PIName(service="П"), "service: 'П' is not in Latin-1: give the bytes"),
        (lambda: S7_Job(parameters=["x"]), "parameters takes packets, or bytes, not 'x'"),
        (lambda: S7_ReadVarRequest(items=["MB0"]), "items takes packets, or bytes, not 'MB0': at('MB0') makes an item"),
        (lambda: S7_ReadVarRequest(items=5), "items takes packets, or bytes, not 5"),
        (lambda: S7_ReadVarRequest(items=[None]), "items takes packets, or bytes, not None"),
        (lambda: S7_ReadVarRequest(items=[[at("MB0")]]), "items takes packets, or bytes, not [<S7_Any"),
        (lambda: bytes(S7_ReadVarRequest(items=[at("MB0")] * 300)), "item_count would be 300, more than its byte can"),
        (lambda: COTP_Parameter.called(cast("str", 0x0102)), "a TSAP is a text such as '01.02', or bytes, not 258"),
        (lambda: SCD(kind="reed"), "kind: no value is called 'reed': do you mean read? Else give write, read, pdo"),
        (lambda: SCD(kind="read").refuse("nope"), "err: no value is called 'nope': give "),
        (lambda: plus_parts(Value(0, INT, 1 << 15)), "32768 does not fit into Int"),
    ],
)  # fmt: skip
def test_what_has_no_such_name_is_one_line_that_says_which_there_are(made: Callable[[], object], said: str) -> None:
    with pytest.raises((ValueError, TypeError)) as error:
        made()
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)


def test_the_most_items_that_can_be_counted_and_a_count_of_ones_own() -> None:
    assert bytes(S7_ReadVarRequest(items=[at("MB0")] * 255))[1] == 255
    assert bytes(S7_ReadVarRequest(items=[at("MB0")] * 300, item_count=2))[1] == 2
    assert bytes(S7_ReadVarRequest(items=None)) == b"\x04\0"


def test_packets_in_anything_that_gives_them_one_by_one() -> None:
    items = [at("MB0"), at("MB1")]
    wanted = bytes(S7_ReadVarRequest(items=items))
    assert bytes(S7_ReadVarRequest(items=tuple(items))) == wanted
    assert bytes(S7_ReadVarRequest(items=(item for item in items))) == wanted
    assert bytes(S7_ReadVarRequest(items=items[0])) == bytes(S7_ReadVarRequest(items=items[:1]))
    assert bytes(S7_ReadVarRequest(items=b"ab")) == b"\x04\x01ab"


def test_a_name_of_several_numbers_is_the_lowest() -> None:
    assert bytes(S7Plus_ItemValue(number=1, type="Int", flags="array", content=[5]))[1:3] == b"\x10\x07"
