"""What is read of objects that were noted is what reading all of them tells; everything else is left to be read."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.cursor import marks
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import (
    Attribute,
    Element,
    PlusObject,
    Relation,
    build_elements,
    build_object,
    every_object,
)
from dissect.protocols.s7plus.read_objects import Outline, read_objects
from dissect.protocols.s7plus.tables import CREATE_OBJECT, EXPLORE, REQUEST, RESPONSE
from dissect.protocols.s7plus.value_tables import INT, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Struct, Value, build_value
from dissect.protocols.s7plus.variables import NameList, Variable, VariableList
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.s7plus.strategies import OBJECTS

#: What is noted in these tests.
_ASKED: Final = frozenset((233, 299, 306, 1048, 1049, 303, 7, 9))
_MARKS: Final = marks(frozenset(), frozenset(), _ASKED)


def read(octets: bytes, request: bool, function: int) -> Outline | None:
    """Hold the objects of a PDU to the reading of the same octets."""
    checked = check(octets, _MARKS)
    if not checked.sound or checked.noted is None:
        return None
    assert (checked.opcode, checked.function) == (REQUEST if request else RESPONSE, function)
    said = read_objects(checked)
    pdu = parse_plus(octets)
    all_ = parse_contents(pdu, False)
    assert pdu.whole
    assert all_.whole
    assert not all_.malformed
    assert checked.integrity_id == all_.integrity_id
    if function == CREATE_OBJECT:
        assert (said.object_id, said.ids) == (all_.object_id, all_.ids)
    assert (checked.sequence, checked.code) == (pdu.sequence, pdu.return_code)
    assert not request or checked.session_id == pdu.session_id
    ours, theirs = every_object(said.objects), all_.every
    assert said.every == ours
    assert len(ours) == len(theirs)
    for one, other in zip(ours, theirs, strict=True):
        assert (one.rid, one.class_id, one.class_flags, one.attribute, one.more) == (
            other.rid, other.class_id, other.class_flags, other.attribute, other.more
        )  # fmt: skip
        assert (one.end - one.offset, len(one.objects)) == (other.end - other.offset, len(other.objects))
        assert (one.names, len(one.variables)) == (other.names, len(other.variables))
        for id_ in _ASKED:
            assert one.holds(id_) == other.holds(id_) == one.holds_any(frozenset((id_, 1 << 20)))
            ask = (one, other)
            assert len({each.text(id_) for each in ask}) == len({each.number(id_) for each in ask}) == 1
            assert one.numbers(id_) == other.numbers(id_)
            assert one.member(id_, 319) == other.member(id_, 319)
            values = one.find(id_), other.find(id_)
            assert len({build_value(value) if value is not None else b"" for value in values}) == 1
            assert (one.text(id_), one.numbers(id_)) == (other.text(id_), other.numbers(id_))  # read by now
            assert one.member(id_, 319) == other.member(id_, 319)
    return said


def _struct(*members: tuple[int, Value]) -> Attribute:
    return Attribute(306, Value(0, STRUCT, Struct(314, list(members))))


_TEXT: Final = Value(0, WSTRING, "1;6ES7 215-1AG40-0XB0 ;V4.3")
_INNER: Final = Value(0, STRUCT, Struct(317, [(319, Value(0, WSTRING, "inner"))]))
_SESSION: Final = PlusObject(
    211, 287, 0, 0, 0,
    [
        Attribute(233, Value(0, WSTRING, "ServerSession")),
        Attribute(5, Value(0, INT, 5)),
        Attribute(299, Value(0, UDINT, 300)),
        Attribute(1049, Value(0, INT, -3)),
        _struct((315, Value(0, UDINT, 7)), (316, _INNER), (319, _TEXT)),
        PlusObject(3, 1001, 0, 5, 6, [Attribute(7, Value(0x10, UDINT, [1, 2])), _struct((319, Value(0, UDINT, 1)))]),
        PlusObject(4, 511, 0, 0, 0, [VariableList(0, []), NameList([])]),
    ],
)  # fmt: skip


def _requests(one: PlusObject) -> list[tuple[bytes, int]]:
    found = []
    for version, integrity_id in ((3, 9), (1, -1)):
        body = bodies.create_object(285, Value(0, UDINT, 0), one, integrity_id=integrity_id)
        found.append((framed(asked(7, CREATE_OBJECT, 288, body=body), version), CREATE_OBJECT))
    return found


def _responses(one: PlusObject) -> list[tuple[bytes, int]]:
    return [
        (framed(told(7, EXPLORE, b"\0" + rid(3) + number(9) + build_object(one) * 2 + end()), 3), EXPLORE),
        (framed(told(7, CREATE_OBJECT, b"\0\2\x81\7\x08" + build_object(one) + end()), 1), CREATE_OBJECT),
    ]


def test_a_session_is_read() -> None:
    for octets, function in _requests(_SESSION):
        found = read(octets, True, function)
        assert found is not None
        (one,) = found.objects
        assert (one.text(233), one.number(299), one.number(1049)) == ("ServerSession", 300, -3)
        assert one.member(306, 319) == "1;6ES7 215-1AG40-0XB0 ;V4.3"
        assert one.objects[0].member(306, 319) == ""
        assert not one.holds(5)  # which nobody asks for
    for octets, function in _responses(_SESSION):
        assert read(octets, False, function) is not None


def test_what_stands_beside_objects_is_none_of_theirs() -> None:
    """Attributes, relations and lists, before an object, between two and behind them."""
    variables = VariableList(
        7, [[Variable(9, 1, 5, 0x8000, 0, 2, 4, [])], [Variable(10, 2, 19, 0x9000, 0, 254, 6, [8, 6])]]
    )
    lists: list[Element] = [variables, NameList([[b"level"], [b"name"]])]
    beside: list[Element] = [Attribute(233, _TEXT), Relation(7, 9), *lists]
    one = PlusObject(0x92000003, 511, 0, 0, 0, [Attribute(233, _TEXT), *lists])
    other = PlusObject(3, 7, 1, 5, 6, [Attribute(299, Value(0, UDINT, 300)), PlusObject(4, 8, 0, 0, 0, [])])
    body = build_elements([*beside, one, *beside, other, *beside])
    found = read(framed(told(7, EXPLORE, b"\0" + rid(3) + number(9) + body + end()), 3), False, EXPLORE)
    assert found is not None
    assert [(each.rid, each.class_flags, each.attribute, each.more) for each in found.every] == [
        (0x92000003, 0, 0, 0), (3, 1, 5, 6), (4, 0, 0, 0),
    ]  # fmt: skip
    first, second = found.objects
    assert (first.names, [each.lid for each in first.variables], first.text(233)) == (
        ["level", "name"],
        [9, 10],
        _TEXT.content,
    )
    assert (second.names, second.number(299), [each.rid for each in second.objects]) == ([], 300, [4])
    assert [each.end - each.offset for each in found.objects] == [len(build_object(one)), len(build_object(other))]


def test_several_frames_are_read_as_one() -> None:
    data = asked(7, CREATE_OBJECT, 288, body=bodies.create_object(285, Value(0, UDINT, 0), _SESSION, integrity_id=9))
    assert read(framed(data[:50], 3, trailer=False) + framed(data[50:], 3), True, CREATE_OBJECT) is not None


def test_no_damage_is_read() -> None:
    """One octet of it is another, or it ends too soon."""
    left = 0
    for request, these in ((True, _requests(_SESSION)), (False, _responses(_SESSION))):
        for octets, function in these:
            for at in range(4, len(octets) - 4, 3):
                for octet in (0, 0x7F, 0xFF, octets[at] ^ 1):
                    left += read(octets[:at] + bytes((octet,)) + octets[at + 1 :], request, function) is None
    assert left > 200


@given(OBJECTS, st.data())
def test_any_object_and_any_damage(one: PlusObject, data: st.DataObject) -> None:
    request = data.draw(st.booleans())
    octets, function = data.draw(st.sampled_from(_requests(one) if request else _responses(one)))
    changed = bytearray(octets)
    for _ in range(data.draw(st.integers(0, 2))):
        changed[data.draw(st.integers(4, len(octets) - 5))] = data.draw(st.integers(0, 255))
    read(bytes(changed), request, function)


def test_captures(corpus: Path) -> None:
    """Nearly all that makes or shows objects in the shared captures is read so, and says what reading it says."""
    passed = whole = 0
    for path in sorted((corpus / "s7plus").glob("*.pcap*")):
        for one in dissect.open(path):
            if isinstance(one, Transaction) and one.is_plus and one.function & 0xFFFF in {CREATE_OBJECT, EXPLORE}:
                for octets, request in ((one.request_octets, True), (one.response_octets, False)):
                    if octets and (not request or one.function & 0xFFFF == CREATE_OBJECT):
                        whole += 1
                        passed += read(octets, request, one.function & 0xFFFF) is not None
    assert passed > whole * 0.9 > 100, f"{passed} of {whole}"
