"""What several bodies have in common: addresses that are remembered, the qualifier, values that are left out, return values."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents, VariableAddress
from dissect.protocols.s7plus.cursor import table
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import PlusObject, build_object
from dissect.protocols.s7plus.pieces import (
    USUAL_QUALIFIER,
    addresses_of,
    is_asked_for,
    return_details,
    return_note,
    take_addresses,
    take_qualifier,
    take_read_addresses,
)
from dissect.protocols.s7plus.tables import EXPLORE, GET_MULTI_VARIABLES, SET_MULTI_VARIABLES
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value, build_value
from dissect.protocols.s7plus.walk import FormatError, Walk, Wanted
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import QUALIFIER, number, rid
from tests.protocols.s7plus.pdus import asked, framed, told

FIVE: Final = Value(0, INT, 5)
STATE: Final = VariableAddress(0, 52, 2237, [3486])
#: Wants the operating state, and no other attribute.
STATES: Final = table(frozenset((3486,)))


def told_of(fault: FormatError) -> tuple[str, str, int, int, int]:
    return fault.reason, fault.field, fault.at, fault.needed, fault.available


# ---- return values --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0xFFF4, "0xfff4 Object not found"),
        (0xFFFF, "0xffff Unknown error"),
        (0x1_0000, "0x10000 OK; from object management, line 1"),
        (0x1_FFF4, "0x1fff4 Object not found; from object management, line 1"),
        (0xFFFF_FFF4, "0xfffffff4 Object not found; from object management, line 65535"),
        (0x1A_0000_FFF4, "0x1a0000fff4 Object not found; from hardware configuration, line 0"),
        (0x5C_0002_FFF4, "0x5c0002fff4 Object not found; from IE configuration, line 2"),
        (0x80_1A_0000_FFF4, "0x801a0000fff4 Object not found; from hardware configuration, line 0"),
        (0x8000_001A_0000_FFF4, "0x8000001a0000fff4 Object not found; from hardware configuration, line 0"),
        (
            0x4000_001A_0000_FFF4,
            "0x4000001a0000fff4 Object not found; from hardware configuration, line 0; details follow",
        ),
        (0x2000_001A_0000_FFF4, "0x2000001a0000fff4 Object not found; from hardware configuration, line 0"),
    ],
)
def test_a_return_value_says_where_it_comes_from(value: int, text: str) -> None:
    assert return_details(value) == text


def test_a_short_return_value_is_its_name() -> None:
    assert (return_note(0), return_note(0xFFF4), return_note(0x1234_FFF4)) == (
        "0 OK",
        "0xfff4 Object not found",
        "0x1234fff4 Object not found",
    )
    assert return_details(0xFFF4) == return_note(0xFFF4)


# ---- addresses ------------------------------------------------------------------------------------------------------


def taken(octets: bytes, shown: bool = False) -> tuple[Contents, Walk]:
    walk, found = Walk(octets, 0, len(octets), shown), Contents(3, -1, {})
    take_read_addresses(walk, found)
    return found, walk


def of(lid: int, count: int = 1) -> bytes:
    """The addresses of a read that nobody else in these tests has."""
    return bodies.addresses(*[VariableAddress(7, 0x8A0E0003, 2550, [lid, at]) for at in range(count)])


def test_what_was_read_before_is_the_same_when_it_is_read_again() -> None:
    """In its contents, its end, and the work that it costs; also for one that asks for attributes of an object."""
    attributes = rid(52) + b"\2\2" + number(2237) + number(233)
    for octets in (of(700001), of(700002, 9), attributes):
        seen = []
        for shown in (True, False, False):
            found, walk = taken(octets + QUALIFIER, shown)
            seen.append((found.addresses, found.object_id, found.ids, walk.at, walk.budget))
            assert walk.at == len(octets)
        assert seen[0] == seen[1] == seen[2]
        assert seen[1][0] is seen[2][0]
        assert seen[1][0] is addresses_of(octets)
        assert seen[0][4] < 3 * len(octets + QUALIFIER) + 1024


def test_what_is_asked_first_is_found_by_a_read_as_well() -> None:
    octets = of(700003, 3)
    known = addresses_of(octets)
    found, walk = taken(octets + QUALIFIER)
    assert found.addresses is known
    assert [one.lids for one in known] == [[700003, 0], [700003, 1], [700003, 2]]
    assert walk.budget == taken(octets + QUALIFIER, True)[1].budget


def test_requests_are_remembered_up_to_64_kib() -> None:
    first = of(700010)
    big = [of(700020 + at, 1000) for at in range(5)]
    assert 65_536 / 5 < len(big[0]) < 65_536 / 4 - len(first)
    addresses_of(of(700009, 7000))  # more than there is room for: what was known is forgotten
    known = addresses_of(first)
    for one in big[:4]:
        addresses_of(one)
        assert addresses_of(first) is known
    addresses_of(big[4])
    again = addresses_of(first)
    assert again is not known
    assert again == known


def test_no_addresses_are_not_remembered() -> None:
    nothing = rid(0) + b"\0\0"
    assert addresses_of(nothing) == []
    found, walk = taken(nothing + QUALIFIER)
    assert (found.addresses, walk.at) == ([], len(nothing))
    found.addresses.append(STATE)
    assert taken(nothing + QUALIFIER)[0].addresses == []


def test_addresses_without_a_qualifier_are_read() -> None:
    octets = of(700030)
    for behind in (b"", b"\0\0\4", b"\0\0\4\xe9"):
        for _ in range(2):
            found, walk = taken(octets + behind)
            assert (len(found.addresses), walk.at) == (1, len(octets))
    # The octets of the qualifier may be those of an address.
    octets = bodies.addresses(VariableAddress(0, 82, 3736, [0, 0, 4, 0x68]))
    octets = octets[:-1] + b"\xe8\7"
    found, walk = taken(octets + QUALIFIER)
    assert (found.addresses[0].lids, walk.at) == ([0, 0, 4, 0x3407], len(octets))


@pytest.mark.parametrize(
    ("octets", "fault"),
    [
        (rid(0) + b"\1\4\0\x52\0\0", ("length_below", "id count", 8, 1, 0)),
        (rid(0) + b"\1\6\0\x52\2\7\x81\5", ("count_mismatch", "field count", 6, 6, 5)),
        (rid(0) + b"\1\4\0\x52\2\7\5", ("count_mismatch", "field count", 6, 4, 5)),
        (rid(0) + b"\2\4\0\x52\1\7", ("too_short", "CRC", 10, 1, 0)),
        (rid(0) + b"\1\4\0\x52\2\7", ("length_beyond", "id count", 8, 2, 1)),
        (rid(0) + b"\7\5\0\x52", ("length_beyond", "item count", 4, 7, 3)),
        (rid(0) + b"\1\7\0\x52", ("length_beyond", "field count", 5, 7, 2)),
        (rid(0)[:3], ("too_short", "link", 0, 4, 3)),
        (rid(5) + b"\2\2\7", ("length_beyond", "field count", 5, 2, 1)),
    ],
)
def test_addresses_that_do_not_fit_are_told_with_their_place(
    octets: bytes, fault: tuple[str, str, int, int, int]
) -> None:
    for shown in (True, False):
        walk = Walk(octets, 0, len(octets), shown)
        with pytest.raises(FormatError) as caught:
            take_addresses(walk, Contents(3, -1, {}))
        assert told_of(caught.value) == fault


def test_addresses_are_shown_in_their_parts() -> None:
    attributes = rid(52) + b"\2\2" + number(2237) + number(233)
    for octets, wanted in (
        (of(5, 2), [("", 6), ("DB3 LID 5.0 [CRC 0x00000007]", 17), ("DB3 LID 5.1 [CRC 0x00000007]", 28)]),
        (
            attributes,
            [("52 NativeObjects.theCPUexecUnit_Rid", 6), ("2237 HWObject.DIS", 8), ("233 ObjectVariableTypeName", 10)],
        ),
    ):
        _, walk = taken(octets + QUALIFIER, True)
        assert [(part.note, part.end) for part in walk.parts] == wanted


def test_the_number_of_items_is_returned() -> None:
    for octets, count in ((of(5, 3), 3), (rid(52) + b"\7\2\1\2" + bytes(5), 7)):
        found = Contents(3, -1, {})
        assert take_addresses(Walk(octets, 0, len(octets), True), found) == count


# ---- the qualifier --------------------------------------------------------------------------------------------------


def test_the_usual_qualifier_is_passed_over_as_if_it_was_read() -> None:
    assert USUAL_QUALIFIER == QUALIFIER
    for behind in (b"", b"\1"):
        walks = [Walk(QUALIFIER + behind, 0, len(QUALIFIER + behind), shown) for shown in (True, False)]
        for walk in walks:
            take_qualifier(walk)
            assert (walk.at, walk.depth) == (len(QUALIFIER), 0)
        assert walks[0].budget == walks[1].budget == 3 * len(QUALIFIER + behind) + 1024 - 15
    for shown in (True, False):
        other = QUALIFIER[:4] + number(1257) + build_value(FIVE) + b"\0"
        walk = Walk(other, 0, len(other), shown)
        take_qualifier(walk)
        assert walk.left == 0
        for end in range(len(QUALIFIER)):  # what is behind its end is none of it
            with pytest.raises(FormatError):
                take_qualifier(Walk(QUALIFIER, 0, end, shown))
        with pytest.raises(FormatError) as caught:
            take_qualifier(Walk(b"\7\0\0\4\xe9\0", 1, 6, shown))
        assert told_of(caught.value) == ("bad_value", "qualifier", 1, 1256, 1257)


# ---- values that nobody needs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "asked_for"),
    [
        (STATE, True),
        (VariableAddress(0, 52, 3486, []), True),
        (VariableAddress(0, 52, 3486, [2237]), False),
        (VariableAddress(0, 52, 2237, []), False),
        (VariableAddress(0, 52, 2237, [1, 3486]), True),
        (VariableAddress(0, 52, 2237, [3486, 1]), False),
        (VariableAddress(0, 82, 3736, [9]), True),
        (VariableAddress(0, 0x8A0E0003, 2550, [9]), True),
        (VariableAddress(0, 0x8B0E0003, 2550, [9]), False),
    ],
)
def test_variables_of_the_program_and_wanted_attributes_are_asked_for(
    address: VariableAddress, asked_for: bool
) -> None:
    assert is_asked_for(STATES, address) == asked_for


def test_written_values_that_nobody_needs_are_left_out() -> None:
    addresses = [VariableAddress(0, 50, 7, []), STATE, VariableAddress(0, 50, 8, [])]
    pdu = parse_plus(
        framed(asked(1, SET_MULTI_VARIABLES, body=bodies.set_multi([(one, FIVE) for one in addresses])), 3)
    )
    for wanted, numbers in (
        (None, [1, 2, 3]),
        (Wanted(STATES), [2]),
        (Wanted(STATES, None, True), [1, 2, 3]),
        (Wanted(STATES, frozenset()), [2]),  # this is about answers
    ):
        found = parse_contents(pdu, False, 0, wanted)
        assert [item for item, _ in found.items] == numbers
        assert found.whole


def test_a_written_value_of_no_item_is_kept() -> None:
    head = bodies.addresses(VariableAddress(0, 50, 7, []), VariableAddress(0, 50, 8, []))
    for numbers, kept in (((1, 2), []), ((0, 2), [0]), ((2, 3), [3])):
        body = (
            head + b"".join([number(item) + build_value(FIVE) for item in numbers]) + b"\0" + QUALIFIER + bodies.end(9)
        )
        pdu = parse_plus(framed(asked(1, SET_MULTI_VARIABLES, body=body), 3))
        assert [item for item, _ in parse_contents(pdu, False, 0, Wanted(STATES)).items] == kept


def test_answered_values_that_nobody_needs_are_left_out() -> None:
    body = bodies.multi_got([(number, Value(0, INT, number)) for number in (1, 2, 3)], [(4, 0xFFF4)])
    pdu = parse_plus(framed(told(1, GET_MULTI_VARIABLES, body), 3))
    for items, numbers in ((None, [1, 2, 3]), (frozenset((2, 7)), [2]), (frozenset((3,)), [3]), (frozenset(), [])):
        found = parse_contents(pdu, False, 0, Wanted(STATES, items))
        assert [(item, value.content) for item, value in found.items] == [(one, one) for one in numbers]
        assert (found.refusals, found.whole) == ([(4, 0xFFF4)], True)


def test_objects_before_a_fault_are_those_that_have_begun() -> None:
    one = build_object(PlusObject(9, 1001, 0, 0, 0, [PlusObject(8, 7, 0, 0, 0, [])]))
    for cut, rids in ((len(one) - 1, [9, 9]), (0, [])):
        body = b"\0" + rid(3) + number(9) + one + one[:cut]
        found = parse_contents(parse_plus(framed(told(1, EXPLORE, body + (b"" if cut else bodies.FILL)), 3)), False)
        assert [one.rid for one in found.begun] == rids
        assert [one.rid for one in found.objects] == ([] if cut else [9])
