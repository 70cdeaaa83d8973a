"""Items at the edges: codes between good and refused, arrays of the program, secrets, values that contradict their types."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.check_response import check_response, count_mismatch, notifies_refusal
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.hiding import shown_half
from dissect.protocols.s7plus.ids import HIDDEN
from dissect.protocols.s7plus.items import PlusItem, join_items
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    NOTIFIED,
    RETURN_CODES,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, BLOB, DINT, INT, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Packed, Struct, Value, build_value
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told
from tests.protocols.s7plus.test_program import type_of, variable

FIVE: Final = Value(0, INT, 5)
SIX: Final = Value(0, INT, 6)
WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
BYTE: Final = VariableAddress(0, 82, 3736, [3, 100, 1])
DB3: Final = 0x8A0E0003
LOST: Final = 2**64 - 12


def joined(
    function: int, body: bytes, answer: bytes = b"", session: PlusSession | None = None, answers: int = -1
) -> list[PlusItem]:
    request = shown_half(parse_plus(framed(asked(1, function, body=body), 3)))
    code = answers if answers >= 0 else function
    response = shown_half(parse_plus(framed(told(1, code, answer), 3))) if answer else None
    return join_items(request, response, session)


def program(*types: PlusObject) -> PlusSession:
    session = PlusSession(Program(), Identity())
    session.program.learn(list(types))
    return session


def said(items: list[PlusItem]) -> list[tuple[int, str, str, int]]:
    return [(item.number, item.label, item.text, item.return_code) for item in items]


@pytest.mark.parametrize(
    ("code", "is_"),
    [(0, 0), (1, 0), (0x13, 0), (0x7FFF, 0), (0x8000, 0x8000), (0xFF95, 0xFF95), (0x8022C4000F6EFF95, 0xFF95)],
)
def test_a_code_below_0x8000_is_no_refusal_of_all_items(code: int, is_: int) -> None:
    result = build_varint(code, VLQ64)
    held = b"\1" + build_value(FIVE) + b"\0\0"
    (item,) = joined(GET_MULTI_VARIABLES, bodies.get_multi(WORD), result + held + end(9))
    assert said([item]) == [(1, "MW100", "" if is_ else "Int 5", is_)]
    assert (item.data, item.json_value, item.note) == ((None, None, "") if is_ else (b"\0\5", 5, ""))
    (item,) = joined(SET_MULTI_VARIABLES, bodies.set_multi([(WORD, FIVE)]), result + b"\0" + end(9))
    assert (said([item]), item.data) == ([(1, "MW100", "Int 5", is_)], b"\0\5")
    (item,) = joined(SET_VARIABLE, bodies.set_variable(82, [3736], FIVE), result + end(9))
    assert (item.text, item.return_code, item.data) == ("Int 5", is_, b"\0\5")
    (item,) = joined(GET_VARIABLE, rid(82) + b"\1\5" + bodies.QUALIFIER + end(9), result + build_value(FIVE) + end(9))
    assert (item.text, item.return_code) == ("" if is_ else "Int 5", is_)
    listed = Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 1, 0x80040002, 7, 0, 82, 0, 3736, 9])
    made = PlusObject(211, 1001, 0, 0, 0, [Attribute(1048, listed)])
    body = bodies.create_object(285, FIVE, PlusObject(211, 7, 0, 0, 0, [made]), integrity_id=3)
    (item,) = joined(CREATE_OBJECT, body, result + b"\0" + end(9))
    assert (item.number, item.label, item.text, item.return_code, item.value) == (7, "M LID 9", "", is_, None)
    assert item.codes is RETURN_CODES
    (item,) = joined(CREATE_OBJECT, body)
    assert item.return_code == -1
    (item,) = joined(CREATE_OBJECT, body, b"\0\0" + end(9), None, GET_LINK)
    assert item.return_code == -1


def test_only_subscriptions_have_items_among_objects() -> None:
    made = PlusObject(211, 7, 0, 0, 0, [Attribute(1048, Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 0]))])
    assert joined(CREATE_OBJECT, bodies.create_object(285, FIVE, made, integrity_id=3)) == []


def test_items_are_numbered_as_in_the_answer() -> None:
    """Whatever their order is; a refusal stands in the place of its value."""
    body = bodies.get_multi(WORD, BYTE, WORD)
    answer = bodies.multi_got([(3, FIVE), (1, SIX)], [(2, LOST)])
    assert said(joined(GET_MULTI_VARIABLES, body, answer)) == [
        (1, "MW100", "Int 6", 0), (2, "MB100", "", 0xFFF4), (3, "MW100", "Int 5", 0)
    ]  # fmt: skip
    answer = bodies.multi_got([(1, SIX), (2, FIVE), (3, FIVE)], [(4, LOST)])
    assert said(joined(GET_MULTI_VARIABLES, body, answer))[3:] == [(4, "item 4", "", 0xFFF4)]
    answer = bodies.multi_got([(1, SIX), (2, FIVE), (3, FIVE), (4, FIVE)], [])
    items = joined(GET_MULTI_VARIABLES, body, answer)
    assert said(items)[3:] == [(4, "item 4", "Int 5", 0)]
    assert (items[3].note, items[3].data) == ("the request has no such item", b"\0\5")
    assert said(joined(GET_MULTI_VARIABLES, bodies.get_multi(), bodies.multi_got([], []))) == []
    both = joined(GET_MULTI_VARIABLES, bodies.get_multi(WORD), bodies.multi_got([(1, FIVE)], [(1, LOST)]))
    assert said(both) == [(1, "MW100", "Int 5", 0xFFF4)]


def test_a_write_shows_its_values_whatever_the_answer_says() -> None:
    body = bodies.set_multi([(WORD, FIVE), (BYTE, SIX)])
    for answer, codes in (
        (b"", [-1, -1]),
        (b"\0\0" + end(9), [0, 0]),
        (build_varint(LOST, VLQ64) + b"\0" + end(9), [0xFFF4, 0xFFF4]),
        (b"\x13\2" + build_varint(LOST, VLQ64) + b"\0" + end(9), [0, 0xFFF4]),
    ):
        items = joined(SET_MULTI_VARIABLES, body, answer)
        assert said(items) == [(1, "MW100", "Int 5", codes[0]), (2, "MB100", "Int 6", codes[1])]
        assert [(item.note, item.data) for item in items] == [("", b"\0\5"), ("", b"\0\6")]
    other = joined(SET_MULTI_VARIABLES, body, b"\0" + rid(7) + end(9), None, DELETE_OBJECT)
    assert [item.return_code for item in other] == [-1, -1]


# ---- values of the program ------------------------------------------------------------------------------------------

_ADDRESS: Final = VariableAddress(0, DB3, 2550, [14])


def item_of(value: Value, declared: PlusObject) -> PlusItem:
    body, answer = bodies.get_multi(_ADDRESS), bodies.multi_got([(1, value)], [])
    (item,) = joined(GET_MULTI_VARIABLES, body, answer, program(declared))
    return item


@pytest.mark.parametrize("count", [1, 7, 8, 9, 20])
def test_eight_elements_of_an_array_are_shown(count: int) -> None:
    """Characters are declared so, and sent as numbers."""
    declared = type_of(0x92000003, ("name", variable(14, 3, 10, numbers=(0, 0, 0, count))))
    item = item_of(Value(0x10, 2, [0x41 + at for at in range(count)]), declared)
    letters = [chr(0x41 + at) for at in range(count)]
    more = " …" if count > 8 else ""
    assert item.text == f"Char[{count}] {', '.join(letters[:8])}{more}"
    assert item.json_value == letters
    assert (item.label, item.meaning, item.is_plain, item.fits) == ('DB3."name"', "", False, True)


def test_a_value_that_contradicts_its_declaration_is_octets() -> None:
    declared = type_of(0x92000003, ("name", variable(14, 11)))
    item = item_of(Value(0, WSTRING, "ab"), declared)
    assert (item.fits, item.text, item.json_value, item.label) == (False, "02 61 62", None, "DB3 LID 14")
    item.data = None
    assert item.text == ""
    good = item_of(Value(0, DINT, 1500), declared)
    assert (good.fits, good.text, good.json_value, good.note) == (True, "Time 'T#1s500ms'", "T#1s500ms", "")


def test_a_structure_of_the_program_has_its_members() -> None:
    tank = type_of(0x91000007, ("level", variable(1, 5)), ("open", variable(2, 1)))
    held = Value(0, STRUCT, Packed(0x91000007, 5, 0, b"\0\5"))
    declared = type_of(0x92000003, ("tank", variable(14, 17, 12, numbers=(0, 0, 0x91000007, 0, 0, 0, 0))))
    body, answer = bodies.get_multi(_ADDRESS), bodies.multi_got([(1, held)], [])
    (unknown,) = joined(GET_MULTI_VARIABLES, body, answer)
    assert (unknown.is_plain, unknown.meaning) == (False, "")
    assert isinstance(unknown.json_value, dict)
    assert "members" not in unknown.json_value
    (known,) = joined(GET_MULTI_VARIABLES, body, answer, program(declared, tank))
    assert known.label == 'DB3."tank"'
    assert isinstance(known.json_value, dict)
    assert (known.json_value["id"], known.json_value["time"], known.json_value["octets"]) == (0x91000007, 5, "0005")
    assert isinstance(known.json_value["members"], dict)
    assert known.json_value["members"]["level"] == 5
    assert known.text.startswith("Struct {level: 5")


def test_an_item_without_a_value_has_no_text_and_no_meaning() -> None:
    item = PlusItem(7, None, None, 0xFF95)
    assert (item.label, item.text, item.meaning, item.json_value, item.is_plain) == ("item 7", "", "", None, False)
    assert (item.codes, item.fits, item.note, item.data) == (RETURN_CODES, True, "", None)
    item.understand(Program())
    assert item.program is None
    session = program(type_of(0x92000003, ("name", variable(14, 11))))
    (known,) = joined(GET_MULTI_VARIABLES, bodies.get_multi(_ADDRESS), b"", session)
    assert (known.label, known.text, known.json_value, known.return_code) == ('DB3."name"', "", None, -1)


def test_the_checksum_of_a_symbol_is_compared() -> None:
    """Another one says that the program has changed: the name is not used."""
    session = program(type_of(0x92000003, ("name", variable(14, crc=0xAABBCCDD))))
    for crc, label, doubted in ((0xAABBCCDD, 'DB3."name"', False), (0xAABBCCDE, "DB3 LID 14 [CRC 0xaabbccde]", True)):
        address = VariableAddress(crc, DB3, 2550, [14])
        (item,) = joined(GET_MULTI_VARIABLES, bodies.get_multi(address), bodies.multi_got([(1, FIVE)], []), session)
        assert (item.label, bool(item.note)) == (label, doubted)


# ---- secrets --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("address", "secret"), [
    (VariableAddress(0, 50, 7918, []), True), (VariableAddress(0, 50, 2237, [5, 7918]), True),
    (VariableAddress(0, 50, 2237, [7918, 5]), False),
    (VariableAddress(0, 50, 2237, [7918]), True),
    (VariableAddress(0, 50, 7918, [2237]), False), (VariableAddress(0, 50, 7917, []), False),
])  # fmt: skip
def test_the_answer_to_a_read_of_a_secret_is_hidden_item_by_item(address: VariableAddress, secret: bool) -> None:
    word = Value(0, BLOB, Blob(0, b"word"))
    answer = bodies.multi_got([(1, FIVE), (2, word)], [])
    for session in (None, program()):
        first, second = joined(GET_MULTI_VARIABLES, bodies.get_multi(WORD, address), answer, session)
        assert (first.text, first.data) == ("Int 5", b"\0\5")
        assert (second.text == HIDDEN, second.json_value == HIDDEN, second.data is None) == (secret,) * 3
        assert (second.note, second.fits) == ("", True)
    (lost,) = joined(GET_MULTI_VARIABLES, bodies.get_multi(address), bodies.multi_got([], [(1, LOST)]))
    assert (lost.text, lost.value, lost.return_code) == ("", None, 0xFFF4)


# ---- notifications --------------------------------------------------------------------------------------------------


def test_refusals_of_a_notification_follow_its_values() -> None:
    items = b"\x13" + rid(3) + b"\x92" + rid(7) + build_value(FIVE) + b"\x03" + rid(4) + b"\0" + bytes(4)
    half = shown_half(parse_plus(framed(notified()[:-1] + items, 3)))
    found = join_items(None, half, None)
    assert said(found) == [(7, "item 7", "Int 5", 0), (3, "item 3", "", 0x13), (4, "item 4", "", 0x03)]
    assert [item.codes for item in found] == [RETURN_CODES, NOTIFIED, NOTIFIED]
    assert [item.data for item in found] == [b"\0\5", None, None]
    assert join_items(half, half, None) == []


@pytest.mark.parametrize(
    ("items", "refuses"), [(b"\x13" + rid(3), True), (b"\x03" + rid(3), True), (b"\x9c" + rid(3), False)]
)
@pytest.mark.parametrize("damage", [b"", b"\1"])
def test_a_notification_refuses_items_even_if_it_is_damaged(items: bytes, refuses: bool, damage: bytes) -> None:
    octets = framed(notified()[:-1] + items + b"\0" + bytes(4) + damage, 3)
    assert check(octets).odd == bool(damage)
    assert notifies_refusal(check(octets)) == refuses
    response = framed(told(1, GET_MULTI_VARIABLES, b"\0\0\1\5\0" + end(9) + damage), 3)
    if damage:
        assert not notifies_refusal(check(response))


def test_a_reference_that_is_not_known_hides_no_name_behind_it() -> None:
    session = program(type_of(0x92000003, ("name", variable(14, 11))))
    session.subscriptions[0x70000E51] = {7: _ADDRESS}
    held = b"".join([b"\x92" + rid(reference) + build_value(Value(0, DINT, 1500)) for reference in (6, 7)])
    half = shown_half(parse_plus(framed(notified()[:-1] + held + b"\0" + bytes(4), 3)))
    assert said(join_items(None, half, session)) == [
        (6, "item 6", "DInt 1500", 0), (7, 'DB3."name"', "Time 'T#1s500ms'", 0)
    ]  # fmt: skip


# ---- responses ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damage", [b"", b"\1"])
@pytest.mark.parametrize(
    ("code", "refused"), [(0, False), (0x11, False), (0x13, True), (0x7FFF, False), (0x8000, True), (0xFF95, True)]
)
def test_a_response_refuses_by_its_code_or_by_an_item(code: int, refused: bool, damage: bytes) -> None:
    result = build_varint(code, VLQ64)
    for function, body in ((GET_LINK, b"\0"), (GET_MULTI_VARIABLES, b"\0\0"), (SET_MULTI_VARIABLES, b"\0")):
        octets = framed(told(1, function, result + body + end(9) + damage), 3)
        assert check_response(check(octets)) == (code, refused)
    for function, body in ((GET_MULTI_VARIABLES, b"\0\1\5\0"), (SET_MULTI_VARIABLES, b"\1\5\0")):
        octets = framed(told(1, function, result + body + end(9) + damage), 3)
        assert check_response(check(octets)) == (code, True)
    cut = framed(told(1, SET_MULTI_VARIABLES, result), 3)
    assert check_response(check(cut)) == (code, refused)


def test_an_answer_that_refuses_in_part_is_compared_and_one_that_refuses_all_is_not() -> None:
    request = framed(asked(1, GET_MULTI_VARIABLES, body=bodies.get_multi(WORD, BYTE)), 3)
    for code, compared in ((b"\0", True), (b"\x13", True), (b"\x80\x13", True), (build_varint(LOST, VLQ64), False)):
        answer = code + bodies.multi_got([(1, FIVE)], [(3, LOST)])[1:]
        response = framed(told(1, GET_MULTI_VARIABLES, answer), 3)
        said_ = "requested 2 items, the answer has item 3, which was not requested, no item 2"
        assert count_mismatch(GET_MULTI_VARIABLES, request, check(response)) == (said_ if compared else "")
    other = framed(told(1, GET_LINK, b"\0\0" + end(9)), 3)
    assert count_mismatch(GET_MULTI_VARIABLES, request, check(other)) == ""
    fewer = framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE)], [])), 3)
    assert count_mismatch(GET_MULTI_VARIABLES, request, check(fewer)) == "requested 2 items, the answer has no item 2"
    stray = framed(told(1, SET_MULTI_VARIABLES, b"\0\0" + end(9)), 3)
    assert count_mismatch(GET_MULTI_VARIABLES, request, check(stray)) == ""
    write = framed(asked(1, SET_MULTI_VARIABLES, body=bodies.set_multi([(WORD, FIVE)])), 3)
    assert count_mismatch(SET_MULTI_VARIABLES, write, check(stray)) == ""
    unsound = framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE)], []) + b"\1"), 3)
    assert count_mismatch(GET_MULTI_VARIABLES, request, check(unsound)) == ""
    assert (
        count_mismatch(GET_MULTI_VARIABLES, framed(asked(1, GET_MULTI_VARIABLES, body=b"lies"), 3), check(fewer)) == ""
    )
    struct_ = Value(0, STRUCT, Struct(9, [(7, FIVE)]))
    twice = framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([(1, struct_), (2, FIVE), (2, FIVE)], [])), 3)
    assert (
        count_mismatch(GET_MULTI_VARIABLES, request, check(twice))
        == "requested 2 items, the answer has item 2 (2 times)"
    )


def test_reads_and_writes_of_one_have_one_item() -> None:
    body = bodies.get_stream(49, [3753]) + end(4)
    (item,) = joined(GET_VAR_SUBSTREAMED, body, b"\0\0" + build_value(FIVE) + end(4))
    assert (said([item]), item.data) == ([(1, "CPUproxy.3753", "Int 5", 0)], b"\0\5")
    (item,) = joined(GET_VAR_SUBSTREAMED, body)
    assert (said([item]), item.data, item.value) == ([(1, "CPUproxy.3753", "", -1)], None, None)
    (item,) = joined(SET_VARIABLE, bodies.set_variable(0x70000001, [1053], SIX))
    assert said([item]) == [(1, "0x70000001.SubscriptionCreditLimit", "Int 6", -1)]
