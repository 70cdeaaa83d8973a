"""Values, objects and bodies of S7comm-plus as Scapy packets: built from nothing, dissected, and built again the same."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.packet import Packet, Raw, fuzz

from dissect import layers as s7
from dissect.layers import S7Plus, S7Plus_Request, plus_frames, plus_message, plus_parts, plus_reply
from dissect.layers.fields import Overlong
from dissect.layers.parts import CLASSES
from dissect.layers.plus_tables import PLUS_SECTIONS
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, Relation, build_elements, read_elements
from dissect.protocols.s7plus.value_tables import ARRAY, BLOB, INT, NULL, REAL, SPARSE_ARRAY, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Packed, Struct, Value, build_value
from dissect.protocols.s7plus.variables import TagDescription
from dissect.protocols.s7plus.walk import Walk
from dissect.wire.part import OCTETS, SURPLUS
from tests.cases import each
from tests.layers.support import forget, shown, survives
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.s7plus.strategies import OBJECTS, VALUES
from tests.protocols.s7plus.test_shared_captures import pdus

EXPLORE: Final = 0x04BB


def octets_of(parts: Sequence[Packet]) -> bytes:
    return bytes(S7Plus_Request(body=list(parts)))[14:]


def body_of(frame: Packet) -> list[Packet]:
    assert isinstance(frame, S7Plus)
    assert frame.body is not None
    parts: list[Packet] = frame.body.body
    return parts


def blank(parts: list[Packet]) -> list[Packet]:
    """The same without the numbers that building fills in."""
    found: list[Packet] = forget(S7Plus_Request(body=parts)).body
    return found


@each("name", [row.name for rows in PLUS_SECTIONS.values() for row in rows])
def test_a_new_part_and_a_fuzzed_one(name: str) -> None:
    cls = getattr(s7, name)
    packet = cls()
    assert bytes(pickle.loads(pickle.dumps(packet))) == bytes(copy.deepcopy(packet)) == bytes(packet)
    shown(packet)
    fuzzed = fuzz(cls())
    survives(cls, bytes(fuzzed))
    shown(fuzzed)


# ---- values and objects ---------------------------------------------------------------------------------------------


@given(VALUES)
def test_any_value_is_built_the_same_from_its_parts(value: Value) -> None:
    parts = plus_parts(value)
    assert octets_of(parts) == build_value(value)
    assert octets_of(blank(parts)) == build_value(value)


@given(OBJECTS)
def test_any_object_is_built_the_same_from_its_parts(one: PlusObject) -> None:
    parts = plus_parts(one)
    assert octets_of(parts) == build_elements([one])
    assert octets_of(blank(parts)) == build_elements([one])
    shown(parts[0])


@given(VALUES, st.integers(0, 40), st.integers(0, 255))
def test_a_damaged_value_is_kept_as_it_is(value: Value, at: int, octet: int) -> None:
    octets = bytearray(build_value(value))
    octets[at % len(octets)] = octet
    survives(s7.S7Plus_Value, bytes(octets))


@pytest.mark.parametrize(
    ("fields", "octets", "said"),
    [
        ({"type": "Int", "content": -2}, "0007fffe", "Int -2"),
        ({"type": "UDInt", "content": 300}, "0004822c", "UDInt 300"),
        ({"type": "Real", "content": 1.5}, "000e3fc00000", "Real 1.5"),
        ({"type": "Bool", "content": True}, "000101", "Bool true"),
        ({"type": "WString", "content": "ab"}, "0015026162", "WString 'ab'"),
        ({"type": "USInt", "flags": 0x10, "content": [1, 2]}, "1002020102", "USInt[2] 1, 2"),
        ({"type": "Int", "flags": 0x40, "content": [(7, -1)]}, "400707ffff00", "Int, sparse, 1 elements"),
        ({"type": "Struct", "content": 314}, "00170000013a", "314"),
        ({"type": "Struct", "flags": 0x10, "content": [314, 2]}, "10170000013a02", "[314, 2]"),
        ({"type": "Blob", "content": Blob(0, b"\x07")}, "0014000107", "Blob 07"),
        ({"type": "Int", "content": b"\x01"}, "000701", "01"),
        ({}, "0000", ""),
    ],
)
def test_a_value_by_hand(fields: dict[str, Any], octets: str, said: str) -> None:
    packet = s7.S7Plus_Value(**fields)
    assert bytes(packet).hex() == octets
    again = survives(s7.S7Plus_Value, bytes.fromhex(octets))
    assert said in shown(again)
    if not isinstance(fields.get("content", b""), (bytes, Blob)):
        assert again.content == fields["content"]


@pytest.mark.parametrize(
    ("type_", "content"), [("Int", 40000), ("UDInt", -1), ("WString", 7), ("Bool", "yes"), ("Int", [1]), ("Blob", 1)]
)
def test_a_content_of_another_type_is_the_users_error(type_: str, content: object) -> None:
    with pytest.raises(ValueError, match=f"content of a {type_}"):
        bytes(s7.S7Plus_Value(type=type_, content=content))


def test_numbers_of_variable_size() -> None:
    assert bytes(s7.S7Plus_AttributeId(id="ObjectVariableTypeName")).hex() == "8169"
    with pytest.raises(ValueError, match="no value is called 'pump': give its number"):
        s7.S7Plus_AttributeId(id="pump")
    with pytest.raises(ValueError, match="id: 4294967296 does not fit"):
        bytes(s7.S7Plus_AttributeId(id=1 << 32))
    overlong = survives(s7.S7Plus_AttributeId, b"\x80\x80\x05")
    assert overlong.id == 5
    assert isinstance(copy.copy(overlong).id, Overlong)
    assert copy.deepcopy(overlong.id).octets == b"\x80\x80\x05"
    assert "233 ObjectVariableTypeName" in shown(s7.S7Plus_AttributeId(id=233))


def test_an_object_by_hand() -> None:
    parts = [
        s7.S7Plus_Object(rid=0x8A0E0003, class_=2574),
        s7.S7Plus_Attribute(id=233, type="WString", content="tank"),
        s7.S7Plus_VariableList(),
        s7.S7Plus_Block(),
        s7.S7Plus_ListId(),
        s7.S7Plus_Variable(lid=9, crc=7, kind=8, datatype=5, numbers=[]),
        s7.S7Plus_Block(),
        s7.S7Plus_NameList(),
        s7.S7Plus_Block(),
        s7.S7Plus_Name(name_="Füllstand"),
        s7.S7Plus_Block(),
        s7.S7Plus_ObjectEnd(),
    ]
    request = S7Plus(content=[S7Plus_Request(function="CreateObject", body=[
        s7.S7Plus_ObjectId(rid=3), s7.S7Plus_Value(type="UDInt", content=0), s7.S7Plus_Reserved(octets=bytes(4)),
        *parts, s7.S7Plus_Fill()])])  # fmt: skip
    found = parse_contents(parse_plus(bytes(request)))
    assert (found.whole, found.malformed, found.object_id) == (True, [], 3)
    (one,) = found.objects
    assert (one.text(233), one.names, [(v.lid, v.crc, v.kind) for v in one.variables]) == (
        "tank",
        ["Füllstand"],
        [(9, 7, 8)],
    )
    again = survives(S7Plus, bytes(request))
    assert again.body.body[8].numbers == []
    assert again.body.body[12].name_ == "Füllstand"


def test_a_description_of_firmware_2_and_a_structure_of_the_program() -> None:
    parts = [
        s7.S7Plus_TagDescription(kind=1, name_="level"),
        s7.S7Plus_Tag(type="Int", datatype=5, lid=9, length=0, numbers=[1, 2, 3, 4]),
        s7.S7Plus_TagDescriptionEnd(),
    ]
    octets = octets_of(parts)
    (found,) = read_elements(Walk(octets, 0, len(octets), False))
    assert isinstance(found, TagDescription)
    assert (found.name, found.lid) == ("level", 9)
    assert octets_of(blank(plus_parts(found))) == octets
    for flags in (0, 0x400):
        value = Value(0, STRUCT, Packed(0x9200_0007, 5, flags, b"octets"))
        packed = plus_parts(value)
        assert octets_of(blank(packed)) == build_value(value)


def test_too_many_levels_are_the_users_error() -> None:
    value = Value(0, NULL, None)
    for _ in range(45):
        value = Value(0, STRUCT, Struct(1, [(5, value)]))
    with pytest.raises(ValueError, match="give fewer levels"):
        plus_parts(value)


# ---- bodies ---------------------------------------------------------------------------------------------------------


def test_counts_of_addresses_ids_and_groups() -> None:
    addresses = [VariableAddress(7, 0x8A0E0003, 2550, [14]), VariableAddress(0, 82, 3736, [3, 100, 2])]
    body = [
        s7.S7Plus_ItemCounts(),
        s7.S7Plus_Address(crc=7, area=0x8A0E0003, sub_area=2550, lids=[14]),
        s7.S7Plus_Address(area=82, sub_area=3736, lids=[3, 100, 2]),
    ]
    assert octets_of(body) == bodies.addresses(*addresses)
    linked = [s7.S7Plus_ItemCounts(link=52), s7.S7Plus_AttributeId(id=2167), s7.S7Plus_AttributeId(id=3486)]
    assert octets_of(linked).hex() == "00000034" + "0202" + "9077" + "9b1e"
    assert octets_of([s7.S7Plus_Count(), s7.S7Plus_AttributeId(id=7), s7.S7Plus_Fill()]).hex() == "010700000000"
    groups = [
        s7.S7Plus_ExploreGroup(), s7.S7Plus_ExploreFilter(structure=8), s7.S7Plus_ListEnd(), s7.S7Plus_AttributeId(id=1),
        s7.S7Plus_ExploreGroup(), s7.S7Plus_AttributeId(id=2), s7.S7Plus_AttributeId(id=3),
    ]  # fmt: skip
    assert octets_of(groups).hex() == "0101" + "1700000008" + "00" + "01" + "0002" + "0203"


@given(st.lists(st.tuples(st.integers(1, 9), VALUES), max_size=4), st.integers(1, 2**32 - 1))
def test_a_whole_answer(items: list[tuple[int, Value]], integrity_id: int) -> None:
    octets = framed(told(5, body=bodies.multi_got(items, [(9, 0x8000_0000_0000_FF95)], integrity_id)), 3)
    frame = survives(S7Plus, octets)
    again = forget(frame)
    again.clear_cache()
    assert bytes(again) == octets
    ids = [part.integrity_id for part in body_of(frame) if isinstance(part, s7.S7Plus_IntegrityId)]
    assert ids == [integrity_id]


def test_what_does_not_stand_in_one_frame_is_octets_until_it_is_joined() -> None:
    body = bodies.set_variable(0x34, [2167], Value(0, WSTRING, "x" * 2000))
    message = S7Plus_Request(function="SetVariable", sequence=9, body=[Raw(body)])
    frames = plus_frames(message, most=700)
    assert [len(bytes(frame)) for frame in frames[:-1]] == [704, 704]
    assert [type(part) for part in body_of(S7Plus(bytes(frames[0])))] == [s7.S7_Octets]
    joined = plus_message(*frames)
    assert joined.sequence == 9
    assert next(part for part in joined.body if isinstance(part, s7.S7Plus_Value)).content == "x" * 2000
    assert bytes(joined) == bytes(message)
    assert [bytes(one) for one in plus_frames(joined, most=700)] == [bytes(one) for one in frames]
    with pytest.raises(ValueError, match="give all its frames"):
        plus_message(*frames[:-1])
    with pytest.raises(ValueError, match="is none"):
        plus_message(b"\x72\xff\x07\x00")


def test_a_stream_has_a_frame_for_each_piece() -> None:
    head = bodies.get_stream(0x34, [7]) + build_value(Value(0, UDINT, 1))
    message = S7Plus_Request(function="SetVarSubStreamed", body=[
        Raw(head), s7.S7Plus_Piece(octets=b"first"), s7.S7Plus_Piece(octets=b"second" * 200),
        s7.S7Plus_IntegrityId(integrity_id=7), s7.S7Plus_Fill()])  # fmt: skip
    frames = plus_frames(message, version=3)
    assert len(frames) == 3
    pdu = parse_plus(b"".join([bytes(frame) for frame in frames]))
    found = parse_contents(pdu)
    assert (pdu.malformed, found.malformed, found.whole, found.integrity_id) == ([], [], True, 7)
    assert [pdu.data[begin:end] for begin, end in found.pieces] == [b"first", b"second" * 200]
    again = plus_frames(plus_message(*frames), version=3)
    assert [bytes(one) for one in again] == [bytes(one) for one in frames]


def test_a_reply_follows_from_its_request() -> None:
    for version in (1, 2, 3):
        integrity_id = -1 if version == 1 else 0xFFFFFFFE
        request = S7Plus(
            framed(
                asked(5, body=bodies.get_multi(VariableAddress(0, 82, 3736, [3, 0, 1]), integrity_id=integrity_id)),
                version,
            )
        )
        values = [s7.S7Plus_ItemValue(number=1, type="Byte", content=7), s7.S7Plus_ListEnd(), s7.S7Plus_ListEnd()]
        answer = plus_reply(request, *values)
        assert answer.answers(request)
        pdu = parse_plus(bytes(answer))
        found = parse_contents(pdu)
        assert (pdu.malformed, found.malformed, found.whole, pdu.version) == ([], [], True, version)
        assert found.integrity_id == (-1 if version == 1 else 3)
        assert [value.content for _, value in found.items] == [7]
        with pytest.raises(TypeError, match="only a request is answered"):
            plus_reply(answer)


def test_a_reply_to_explore_has_its_id_behind_the_object() -> None:
    body = b"\0\0\0\3\0\0\1\0" + b"\0\0" + bodies.end(7)
    request = S7Plus(framed(asked(5, EXPLORE, body=body + b"\0"), 3))
    assert any(isinstance(part, s7.S7Plus_IntegrityId) for part in body_of(request))
    answer = plus_reply(request, s7.S7Plus_ObjectId(rid=3), *plus_parts(PlusObject(3, 2520, 0, 0, 0, [Relation(4, 5)])))
    found = parse_contents(parse_plus(bytes(answer)))
    assert (found.malformed, found.whole, found.integrity_id, len(found.objects)) == ([], True, 12, 1)


def test_sparse_structures_and_rows() -> None:
    rows = Struct(7, [(1, Value(0, INT, 5))])
    for value in (
        Value(SPARSE_ARRAY, STRUCT, [(3, rows)]),
        Value(ARRAY, REAL, [0.5]),
        Value(SPARSE_ARRAY, BLOB, [(1, Blob(0, b"x"))]),
    ):
        parts = plus_parts(Attribute(9, value), value)
        assert octets_of(blank(parts)) == build_elements([Attribute(9, value)]) + build_value(value)


# ---- captures -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", range(4))
def test_every_pdu_of_the_shared_captures_is_built_again(corpus: Path, part: int) -> None:
    """Dissected into parts, the numbers that building fills in forgotten, and built: the same octets."""
    paths = [*sorted((corpus / "s7plus").glob("*.pcap*")), *sorted(corpus.glob("s7comm*plus*.pcap"))]
    total = several = 0
    for path in paths[part::4]:
        for octets, frames in {pdu.octets: pdu.frames for pdu, found in pdus(path) if found.parts}.items():
            packet = S7Plus(octets) if frames == 1 else plus_message(octets)
            message = packet.body if frames == 1 else packet
            assert message is not None
            kinds = {type(piece) for piece in message.fields.get("body", [])}
            assert not kinds & {Raw, CLASSES[OCTETS], CLASSES[SURPLUS]}, f"{path.name} {octets[:40].hex()}"
            bare = forget(packet)
            bare.clear_cache()
            assert bytes(bare) == (octets if frames == 1 else parse_plus(octets).data), (
                f"{path.name} {octets[:40].hex()}"
            )
            total += 1
            several += frames > 1
    assert total > 200
    assert several > 0
