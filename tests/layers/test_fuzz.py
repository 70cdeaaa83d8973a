"""What ``fuzz()`` makes of bodies: any value is drawn once a build, and the lengths are those of the octets that were built."""

from __future__ import annotations

import random
from typing import Any, Final

import pytest
from scapy.packet import Packet, Raw, fuzz

import dissect.layers
from dissect.layers import (
    COTP_DT,
    IBH,
    MPI,
    S7,
    TPKT,
    S7_Answer,
    S7_Any,
    S7_Body,
    S7_DataHead,
    S7_DataItem,
    S7_DBReadItem,
    S7_Function,
    S7_Item,
    S7_Job,
    S7_NCKItem,
    S7_Octets,
    S7_OtherItem,
    S7_Part,
    S7_PlainFileName,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_SymbolInDB,
    S7_Userdata,
    S7_UserdataExtended,
    S7_UserdataShort,
    S7_WriteDataItem,
    S7_WriteVarRequest,
    at,
)
from tests.cases import each
from tests.layers.support import survives

CLASSES: Final = [
    layer
    for name in dissect.layers.__all__
    if isinstance(layer := getattr(dissect.layers, name), type) and issubclass(layer, Packet)
]
BODIES: Final = [layer for layer in CLASSES if issubclass(layer, S7_Body)]
PIECES: Final = [layer for layer in CLASSES if issubclass(layer, S7_Part | S7_Item | S7_DataItem)]


def lengths_are_right(packet: Packet) -> bytes:
    """Build a packet once; its S7 header counts the octets of its two blocks, its TPKT all of them. Return the octets."""
    octets = bytes(packet)
    again = TPKT(octets)
    header = again[S7]
    size = 12 if header.rosctr in {2, 3} else 10
    assert again.length == len(octets)
    assert header.param_length + header.data_length == len(octets) - 7 - size
    return octets


def test_the_lengths_of_a_fuzzed_answer_are_those_of_its_octets() -> None:
    packet = TPKT() / COTP_DT() / S7(rosctr=3) / S7_ReadVarAnswer(data=[fuzz(S7_DataItem())])
    sizes = set()
    for _ in range(200):
        octets = lengths_are_right(packet)
        header = TPKT(octets)[S7]
        assert header.param_length == 2
        sizes.add(header.data_length)
    assert len(sizes) > 10  # drawn anew for each build


@pytest.mark.parametrize(
    "body",
    [
        S7_WriteVarRequest(items=[fuzz(S7_OtherItem())], data=[fuzz(S7_WriteDataItem())]),
        S7_Job(parameters=[Raw(b"\x1a"), fuzz(S7_PlainFileName())], data=[fuzz(S7_Octets())]),
        S7_Answer(parameters=[fuzz(S7_PlainFileName())]),
        S7_UserdataShort(data=[S7_DataHead(), fuzz(S7_Octets())]),
        fuzz(S7_WriteVarRequest(items=[at("MW0")], data=[S7_WriteDataItem()])),
    ],
    ids=lambda body: type(body).__name__,
)
def test_both_blocks_are_counted_as_they_were_built(body: Packet) -> None:
    for rosctr in (1, 3, 7):
        packet = TPKT() / COTP_DT() / S7(rosctr=rosctr) / body
        for _ in range(20):
            survives(TPKT, lengths_are_right(packet))


def test_the_data_head_counts_the_octets_just_built() -> None:
    for _ in range(50):
        body = S7(bytes(S7(rosctr=7) / S7_UserdataShort(data=[S7_DataHead(), fuzz(S7_Octets())])))[S7_UserdataShort]
        assert body.data[0].length == len(bytes(body)) - 8 - 4


def test_the_lengths_are_right_behind_a_gateway_and_in_a_chain() -> None:
    answer = S7(rosctr=3) / S7_ReadVarAnswer(data=[fuzz(S7_DataItem())])
    for _ in range(30):
        octets = bytes(TPKT() / COTP_DT() / answer / TPKT() / COTP_DT() / answer)
        first: Any = TPKT(octets)
        second: Any = first.getlayer(TPKT, 2)
        assert first.length + second.length == len(octets)
        assert first[S7].data_length == first.length - 7 - 12 - 2
        assert second[S7].data_length == second.length - 7 - 12 - 2
        behind = IBH(bytes(IBH() / MPI() / answer))
        assert behind[S7].data_length == len(bytes(behind[S7])) - 12 - 2


def test_a_body_that_was_dissected_and_changed_is_counted_anew() -> None:
    packet = S7(bytes(S7() / S7_ReadVarRequest(items=[at("MW0"), at("MW2")])))
    packet.items.pop()
    del packet.param_length, packet.item_count
    again = S7(bytes(packet))
    assert (again.param_length, again.data_length, again.item_count) == (14, 0, 1)
    header = S7(bytes(S7() / S7_ReadVarRequest(items=[at("MW0")])))
    del header.param_length, header.data_length  # the body is as it was
    assert S7(bytes(header)).param_length == 14


@each("layer", CLASSES)
def test_any_octets_are_read_by_any_layer(layer: type[Packet]) -> None:
    draw = random.Random(layer.__name__)
    for size in (1, 2, 3, 5, 9, 14, 24, 40):
        survives(layer, bytes(draw.choice((0, 1, 8, 0x12, 0xFF, draw.randrange(256))) for _ in range(size)))


@pytest.mark.parametrize("body", BODIES, ids=lambda layer: layer.__name__)
def test_any_body_is_fuzzed_with_any_pieces(body: type[S7_Body]) -> None:
    draw = random.Random(body.__name__)
    make: Any = body
    lists = [name for name in ("items", "parameters", "data") if name in body().default_fields]
    for _ in range(8):
        values = {
            name: [fuzz(piece()) for piece in draw.choices(PIECES, k=draw.randrange(3))]
            for name in lists
            if isinstance(body().getfieldval(name), list)
        }
        packet = TPKT() / COTP_DT() / S7(rosctr=draw.choice((1, 2, 3, 7))) / fuzz(make(**values))
        survives(TPKT, lengths_are_right(packet))
        packet.summary()
        packet.show(dump=True)


# ---- classes that others are made of --------------------------------------------------------------------------------


def test_a_base_called_itself_is_a_class_that_fits() -> None:
    assert type(S7_Part()) is type(S7_Part(b"abc")) is S7_Octets
    assert type(S7_Body()) is type(S7_Body(b"\x28\0")) is S7_Function
    assert type(S7_Userdata()) is S7_UserdataShort
    for userdata in (S7_UserdataShort, S7_UserdataExtended):
        assert type(S7_Userdata(bytes(userdata()))) is userdata
    cut: Packet = S7_Userdata(b"\0\1\x12")
    assert type(cut) is Raw
    assert type(S7_Item()) is S7_Any


@pytest.mark.parametrize("item", [S7_Any, S7_NCKItem, S7_DBReadItem, S7_SymbolInDB, S7_OtherItem])
def test_an_item_is_read_by_its_syntax(item: type[S7_Item]) -> None:
    read = S7_Item(bytes(item()))
    assert type(read) is item
    assert bytes(read) == bytes(item())
    assert isinstance((S7() / S7_ReadVarRequest(items=[read]))[S7_Item], S7_Item)


@pytest.mark.parametrize(
    "octets", [b"\0", b"\0\x08", b"\x12\x0a\x10", b"\x12\0\0", b"\x12\x01\x10\0", b"\x12\xff\xb0\1"]
)
def test_an_item_that_is_cut_or_lies_is_read_all_the_same(octets: bytes) -> None:
    survives(S7_Item, octets)
