"""Secrets are hidden wherever they are, also in answers that do not say so; all that is beside them is shown."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.hiding import (
    reads_secret,
    said_half,
    shown_answer,
    shown_contents,
    shown_half,
    without_secrets,
)
from dissect.protocols.s7plus.ids import HIDDEN, SECRETS
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB, INT, STRUCT, UDINT, VARIANT, WSTRING
from dissect.protocols.s7plus.values import Blob, Rows, Struct, Value, build_value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told

FIVE: Final = Value(0, INT, 0x1234)
SECRET: Final = Value(0, BLOB, Blob(0, b"SECRET-SECRET"))
WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
PASSWORD: Final = VariableAddress(0, 50, 7918, [])


def request(function: int, body: bytes) -> PlusPdu:
    return parse_plus(framed(asked(1, function, body=body), 3))


def response(function: int, body: bytes) -> PlusPdu:
    return parse_plus(framed(told(1, function, body), 3))


def read_of(object_id: int, ids: list[int], function: int = GET_VARIABLE) -> PlusPdu:
    if function == GET_VARIABLE:
        body = rid(object_id) + number(len(ids)) + b"".join([number(id_) for id_ in ids]) + bodies.QUALIFIER + end(4)
    else:
        body = bodies.get_stream(object_id, ids) + end(4)
    return request(function, body)


def clean(pdu: PlusPdu, spans: list[tuple[int, int]]) -> bytes:
    """What is left of the octets, as long as they were."""
    octets = without_secrets(pdu, spans)
    assert len(octets) == len(pdu.octets)
    changed = {at for begin, stop in spans for at in range(begin, stop)}
    assert all(octets[at] == (0 if at in changed else pdu.octets[at]) for at in range(len(octets)))
    return octets


# ---- reads of secrets -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id_", [*sorted(SECRETS), 303, 305, 3451, 7917, 7922])
@pytest.mark.parametrize("function", [GET_VARIABLE, GET_VAR_SUBSTREAMED])
def test_the_answer_to_a_read_of_a_secret_is_one(id_: int, function: int) -> None:
    secret = id_ in SECRETS
    for ids in ([id_], [2237, id_]):
        half = shown_half(read_of(50, ids, function))
        assert reads_secret(half) == secret
        lead = b"\0" if function == GET_VAR_SUBSTREAMED else b""
        told_ = response(function, b"\0" + lead + build_value(SECRET) + end(4))
        found, spans = shown_answer(told_, half.pdu)
        assert found.value is not None
        assert (found.value.content == HIDDEN) == secret
        assert (b"SECRET" in clean(told_, spans)) != secret
        assert any("53 45 43" in note or "SECRET" in note for note in found.notes) != secret
    assert not reads_secret(shown_half(read_of(50, [id_, 2237], function)))


def test_one_secret_among_the_items_of_a_read_hides_all_values_of_its_answer() -> None:
    """Nobody can say for sure which value belongs to which item."""
    told_ = response(GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE), (2, SECRET)], []))
    for wanted, secret in (
        ((WORD, PASSWORD), True),
        ((PASSWORD, WORD), True),
        ((WORD, VariableAddress(0, 50, 2237, [7918])), True),
        ((WORD, VariableAddress(0, 50, 2237, [5, 7918])), True),
        ((WORD, VariableAddress(0, 50, 2237, [7918, 5])), False),
        ((WORD, VariableAddress(0, 50, 7918, [2237])), False),
        ((WORD, WORD), False),
    ):
        pdu = request(GET_MULTI_VARIABLES, bodies.get_multi(*wanted))
        found, spans = shown_answer(told_, pdu)
        assert [number for number, _ in found.items] == [1, 2]
        assert [value.content == HIDDEN for _, value in found.items] == [secret] * 2
        assert (b"SECRET" in clean(told_, spans)) != secret
        assert (build_value(FIVE) in clean(told_, spans)) != secret
        assert found.integrity_id == 9


def test_an_answer_without_a_request_or_to_another_function_is_shown() -> None:
    told_ = response(GET_VARIABLE, b"\0" + build_value(SECRET) + end(4))
    for pdu in (None, request(SET_VARIABLE, bodies.set_variable(50, [7918], FIVE)), told_):
        found, spans = shown_answer(told_, pdu)
        assert spans == []
        assert found.value == SECRET
    assert not reads_secret(shown_half(told_))
    assert not reads_secret(shown_half(request(SET_VARIABLE, bodies.set_variable(50, [7918], FIVE))))
    refused = response(GET_VARIABLE, b"\x13")
    found, spans = shown_answer(refused, read_of(50, [7918]))
    assert (found.value, spans) == (None, [])


# ---- secrets inside values ------------------------------------------------------------------------------------------

_IN_MEMBERS: Final = [(7, FIVE), (7919, SECRET), (8, FIVE)]


@pytest.mark.parametrize(
    "value",
    [
        Value(0, STRUCT, Struct(9, _IN_MEMBERS)),
        Value(0, STRUCT, Struct(9, [(7, Value(0, STRUCT, Struct(8, _IN_MEMBERS)))])),
        Value(0x10, STRUCT, Rows(9, [[(7, FIVE)], _IN_MEMBERS])),
        Value(0x40, STRUCT, [(1, Struct(9, [(7, FIVE)])), (2, Struct(9, _IN_MEMBERS))]),
        Value(0, VARIANT, Value(0, STRUCT, Struct(9, _IN_MEMBERS))),
        Value(0, BLOB, Blob(7, b"", bytes(8), 0, _IN_MEMBERS)),
    ],
    ids=["structure", "nested", "rows", "keyed", "variant", "blob"],
)
@pytest.mark.parametrize("function", [GET_MULTI_VARIABLES, GET_VARIABLE, EXPLORE])
def test_a_secret_inside_a_value_hides_the_value_and_its_own_octets(value: Value, function: int) -> None:
    for held, secret in ((value, True), (_renamed(value), False)):
        pdu = {
            GET_MULTI_VARIABLES: response(GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE), (2, held)], [])),
            GET_VARIABLE: response(GET_VARIABLE, b"\0" + build_value(held) + end(4)),
            EXPLORE: parse_plus(framed(notified()[:-1] + b"\x92" + rid(3) + build_value(held) + b"\0" + bytes(4), 3)),
        }[function]
        found, spans = shown_contents(pdu)
        assert found.malformed == []
        shown = found.value if function == GET_VARIABLE else found.items[-1][1]
        assert shown is not None
        assert (shown.content == HIDDEN) == secret
        if function == GET_MULTI_VARIABLES:
            assert found.items[0] == (1, FIVE)
        if value.type == STRUCT:
            octets = clean(pdu, spans)
            assert (b"SECRET" in octets) != secret
            assert octets.count(build_value(FIVE)) == pdu.octets.count(build_value(FIVE))
            assert (HIDDEN in "; ".join(found.notes)) == secret


def _renamed(value: Value) -> Value:
    """The same value with an id that is no secret."""
    octets = build_value(value).replace(number(7919), number(7917))
    return parse_of(octets)


def parse_of(octets: bytes) -> Value:
    found = shown_contents(response(GET_VARIABLE, b"\0" + octets + end(4)), False)[0].value
    assert found is not None
    return found


@pytest.mark.parametrize(
    "address", [PASSWORD, VariableAddress(0, 50, 2237, [7918]), VariableAddress(0, 50, 2237, [5, 7918])]
)
def test_a_secret_that_is_written_hides_its_item_only(address: VariableAddress) -> None:
    pdu = request(SET_MULTI_VARIABLES, bodies.set_multi([(WORD, FIVE), (address, SECRET), (WORD, FIVE)]))
    found, spans = shown_contents(pdu)
    assert [value.content for _, value in found.items] == [0x1234, HIDDEN, 0x1234]
    octets = clean(pdu, spans)
    assert b"SECRET" not in octets
    assert octets.count(build_value(FIVE)) == 2
    half = shown_half(pdu)
    assert [value.content for _, value in half.contents.items] == [0x1234, HIDDEN, 0x1234]
    assert half.contents.parts == said_half(pdu).contents.parts == []
    assert said_half(pdu).contents.items == half.contents.items


def test_a_secret_attribute_hides_itself_and_what_it_contains() -> None:
    """The name stays, the attributes beside it are shown."""
    key = Value(0, STRUCT, Struct(1800, [(1805, SECRET), (1806, FIVE)]))
    attributes = [
        Attribute(233, Value(0, WSTRING, "before")),
        Attribute(3449, key),
        Attribute(1049, Value(0, UDINT, 77)),
    ]
    pdu = request(
        CREATE_OBJECT, bodies.create_object(3, FIVE, PlusObject(7, 9, 0, 0, 0, list(attributes)), integrity_id=5)
    )
    found, spans = shown_contents(pdu)
    octets = clean(pdu, spans)
    assert b"SECRET" not in octets
    assert b"before" in octets
    assert build_value(Value(0, UDINT, 77)) in octets
    notes = found.notes
    assert f"3449 AS_KnowhowProtection.Password = {HIDDEN}" in notes
    assert "233 ObjectVariableTypeName = WString 'before'" in notes
    assert any(note.startswith("1049") and note.endswith("77") for note in notes)
    assert len([note for note in notes if HIDDEN in note]) >= 3  # with the two members


def test_an_empty_secret_is_hidden_and_has_no_octets() -> None:
    attributes = [Attribute(3449, Value(0, WSTRING, "")), Attribute(233, Value(0, WSTRING, "beside"))]
    pdu = request(
        CREATE_OBJECT, bodies.create_object(3, FIVE, PlusObject(7, 9, 0, 0, 0, list(attributes)), integrity_id=5)
    )
    found, spans = shown_contents(pdu)
    assert f"3449 AS_KnowhowProtection.Password = {HIDDEN}" in found.notes
    assert all(begin < stop for begin, stop in spans)
    assert b"beside" in clean(pdu, spans)


def test_a_secret_of_one_attribute_is_the_last_of_its_ids() -> None:
    for ids, secret in (([7918], True), ([2237, 7918], True), ([7918, 2237], False)):
        pdu = request(SET_VARIABLE, bodies.set_variable(50, ids, SECRET))
        found, spans = shown_contents(pdu)
        assert (b"SECRET" in clean(pdu, spans)) != secret
        assert found.value is not None
        assert (found.value.content == HIDDEN) == secret
        assert (shown_contents(pdu, False)[0].value != SECRET) == secret
    lone = response(SET_VARIABLE, b"\0" + end(4))
    assert shown_contents(lone)[1] == []


def test_a_line_needs_alarms_names_and_lists_only() -> None:
    """Of objects nothing else is kept; the secrets among what is kept are hidden, and the faults in the rest are found."""
    going = Value(0, STRUCT, Struct(3473, [(3474, Value(0, UDINT, 7))]))
    alarm = {
        2670: FIVE,
        2671: FIVE,
        2672: FIVE,
        4079: FIVE,
        2673: going,
        2677: going,
        2715: Value(0x10, WSTRING, ["hot"]),
    }
    listed = Value(0x20, UDINT, [0x80000000, 0, 1, 0x80040002, 7, 0, 82, 0, 3736, 9])
    kept = {**alarm, 233: Value(0, WSTRING, "name"), 1048: listed}
    left_out = {7: FIVE, 299: FIVE, 2521: FIVE, 2523: FIVE, 3449: SECRET}
    compressed = {2544: Value(0, BLOB, Blob(0, b"\x78\x9c broken"))}
    attributes = [Attribute(id_, value) for id_, value in {**left_out, **kept, **compressed}.items()]
    held = PlusObject(7, 9, 0, 0, 0, list(attributes))
    pdu = request(CREATE_OBJECT, bodies.create_object(3, FIVE, held, integrity_id=5))
    (whole,), (said,) = shown_half(pdu).contents.objects, said_half(pdu).contents.objects
    assert {id_ for id_ in [*kept, *left_out] if said.holds(id_)} == set(kept)
    for id_, value in kept.items():
        assert said.find(id_) == whole.find(id_) == value
    faults = [[str(fact) for fact in half.contents.malformed] for half in (shown_half(pdu), said_half(pdu))]
    assert faults[0] == faults[1]
    assert len(faults[0]) == 1
