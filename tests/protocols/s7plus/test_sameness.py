"""PDUs that are taken for alike have the same contents, but for the integrity id."""

from __future__ import annotations

import struct

from hypothesis import example, given
from hypothesis import strategies as st

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.sameness import Seen
from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    INVOKE,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.values import build_value
from tests.cases import each
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, notified, told
from tests.protocols.s7plus.test_bodies import FIVE, INNER, LEVEL, LIST, LOST, WORD

#: What stands in front of the integrity id of a PDU and behind it: whether it is a request, its function, both.
What = tuple[bool, int, bytes, bytes]

IDS = st.one_of(
    st.sampled_from([0, 1, 127, 128, 255, 256, 0x21, 0xA1 << 7, 16384, 1 << 21, 1 << 28]), st.integers(0, 2**32 - 1)
)
#: Octets of the end that `bodies` give a request or an answer.
END = len(bodies.end(9))
#: What may be alike to others.
ALIKE: dict[str, What] = {
    "read": (True, GET_MULTI_VARIABLES, bodies.get_multi(LEVEL, WORD)[:-END], b""),
    "write": (True, SET_MULTI_VARIABLES, bodies.set_multi([(LEVEL, FIVE)])[:-END], b""),
    "set": (True, SET_VARIABLE, bodies.set_variable(0x386, [1053], FIVE)[:-END], b""),
    "delete": (True, DELETE_OBJECT, bodies.delete_object(0x386)[:-END], b""),
    "stream": (True, GET_VAR_SUBSTREAMED, bodies.get_stream(0x386, [2449]), b""),
    "link": (True, GET_LINK, bodies.rid(0x386) + b"\x85\x24\0\0", b""),
    "call": (True, INVOKE, bodies.rid(1) + bodies.rid(2) + LIST + b"\0", b""),
    "end of a sequence": (True, END_SEQUENCE, b"\0\0", b""),
    "read: told": (False, GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE)], [(2, LOST)])[:-END], b""),
    "read: nothing told": (False, GET_MULTI_VARIABLES, bodies.multi_got([], [])[:-END], b""),
    "write: told": (False, SET_MULTI_VARIABLES, b"\0" + bodies.number(2) + b"\x81\0\0", b""),
    "set: told": (False, SET_VARIABLE, b"\0", b""),
    "get: told": (False, GET_VARIABLE, b"\0" + build_value(FIVE), b""),
    "stream: told": (False, GET_VAR_SUBSTREAMED, b"\0\0" + build_value(FIVE), b""),
    "link: told": (False, GET_LINK, b"\0\1" + bodies.rid(0x307), b""),
    "call: told": (False, INVOKE, b"\0\0\0" + b"\1" + build_value(FIVE) + b"\0\0", b""),
    "create: told": (False, CREATE_OBJECT, b"\0\2" + bodies.number(0x386) + bodies.number(0x387), b""),
    "explore: told": (False, EXPLORE, b"\0" + bodies.rid(7), INNER),
    "explore: nothing told": (False, EXPLORE, b"\0" + bodies.rid(7), b""),
}
#: What may end in objects behind it.
OPEN: dict[str, What] = {
    "create": (True, CREATE_OBJECT, bodies.create_object(0x386, FIVE)[:-4], INNER),
    "beginning of a sequence": (True, BEGIN_SEQUENCE, b"\1\0\1\0\0", INNER),
    "delete: told": (False, DELETE_OBJECT, b"\0" + bodies.rid(0x386), b""),
}


def pdu(what: What, number: int, id_: int, fill: int, damage: tuple[int, int] | None = None, version: int = 3) -> bytes:
    """A PDU; one octet of what stands in front of its integrity id may be another."""
    request, function, body, behind = what
    if damage is not None and damage[0] < len(body):
        at, octet = damage
        body = body[:at] + bytes((octet,)) + body[at + 1 :]
    body += bodies.number(id_) + behind + bytes(fill)
    return framed(asked(number, function, body=body) if request else told(number, function, body), version)


def said(found: Contents) -> list[object]:
    """What contents say, the integrity id left out."""
    return [
        found.whole, len(found.malformed), found.items, found.refusals, found.addresses, found.object_id, found.ids,
        found.value, [(value.offset, value.end) for _, value in found.items], found.list, found.method, found.pieces,
        [(one.rid, one.class_id, one.offset) for one in found.objects],
    ]  # fmt: skip


def held_to(first: bytes, second: bytes) -> bool:
    """Compare the contents of two PDUs that are taken for alike, if they are and the first one is sound."""
    one, other = Seen(), Seen()
    if not (one.read(first) and other.read(second)) or (one.kind, one.body) != (other.kind, other.body):
        return False
    known = parse_contents(parse_plus(first), False)
    if not known.whole or known.malformed or (one.has_id and known.integrity_id != one.integrity_id):
        return False
    found = parse_contents(parse_plus(second), False)
    assert said(found) == said(known)
    assert found.integrity_id == (other.integrity_id if other.has_id else known.integrity_id)
    return True


@given(
    st.sampled_from(sorted((ALIKE | OPEN).values())),
    st.one_of(st.none(), st.tuples(st.integers(0, 40), st.integers(0, 255))),
    st.tuples(IDS, IDS),
    st.tuples(st.integers(3, 7), st.integers(3, 7)),
    st.sampled_from([2, 3]),
)
@example((False, SET_VARIABLE, b"\0\x80", b""), None, (5, 6), (4, 4), 3)
@example(OPEN["delete: told"], None, (5, 0xA1 << 7), (5, 5), 3)
def test_alike(
    what: What, damage: tuple[int, int] | None, ids: tuple[int, int], fills: tuple[int, int], version: int
) -> None:
    held_to(*[pdu(what, 5 + index, ids[index], fills[index], damage, version) for index in range(2)])


@given(
    st.sampled_from(sorted(ALIKE.values())),
    st.lists(st.tuples(st.integers(1, 24), st.integers(0, 255)), max_size=3),
    st.lists(st.tuples(st.integers(1, 24), st.integers(0, 255)), max_size=3),
)
def test_whatever_stands_at_the_end(what: What, ours: list[tuple[int, int]], theirs: list[tuple[int, int]]) -> None:
    """Octets of the id, of the zeros, and of what is in front of both are others in one of them."""

    def changed(octets: bytes, edits: list[tuple[int, int]]) -> bytes:
        found = bytearray(octets)
        for back, octet in edits:
            found[-4 - back] = octet
        return bytes(found)

    octets = pdu(what, 5, 300, 4)
    held_to(changed(octets, ours), changed(octets, theirs))


@each(("what", "fill"), [(what, fill) for what in ALIKE.values() for fill in (4, 5)])
def test_what_polling_repeats_is_alike(what: What, fill: int) -> None:
    """One that an id of the same length follows."""
    seen = Seen()
    for one, other in [(1, 127), (128, 16383), (0x2041, 300), (1 << 20, 99999), (1 << 27, (1 << 28) - 1)]:
        octets = pdu(what, 5, one, fill)
        assert seen.read(octets)
        assert seen.has_id
        assert seen.integrity_id == one == parse_contents(parse_plus(octets), False).integrity_id
        assert held_to(octets, pdu(what, 6, other, fill))


def test_an_octet_in_front_of_the_id_that_could_belong_to_it() -> None:
    """Then the id is not what the contents say: whoever reads them sees that, and compares the PDU with none."""
    seen = Seen()
    octets = pdu((False, GET_LINK, b"\0\1" + bodies.rid(0x386), b""), 5, 1, 4)
    assert seen.read(octets)
    assert seen.integrity_id != parse_contents(parse_plus(octets), False).integrity_id


@each("what", OPEN.values())
def test_what_may_end_in_objects_is_compared_with_none(what: What) -> None:
    assert not Seen().read(pdu(what, 5, 9, 4))


def test_what_is_in_version_2_has_its_id_in_the_body() -> None:
    one, other = Seen(), Seen()
    assert one.read(pdu(ALIKE["read"], 5, 9, 4, version=2))
    assert other.read(pdu(ALIKE["read"], 6, 10, 4, version=2))
    assert not one.has_id
    assert (one.kind, one.body) != (other.kind, other.body)


def test_notifications_are_alike_but_for_their_numbers() -> None:
    one, other, elsewhere = Seen(), Seen(), Seen()
    assert one.read(framed(notified(5)))
    assert other.read(framed(notified(6)))
    assert elsewhere.read(framed(notified(5, 0x70000E52)))
    assert (one.kind, one.body) == (other.kind, other.body)
    assert one.number == 5
    assert other.number == 6
    assert one.kind != elsewhere.kind


def test_a_subscription_of_an_old_cpu_counts_in_the_place_of_the_credit() -> None:
    seen = Seen()
    octets = struct.pack(">BIHHHB", 0x33, 0x386, 0x0400, 0, 0, 7) + b"\1\0"
    assert seen.read(framed(octets))
    assert (seen.number, seen.credit_tick) == (7, 7)


@given(st.binary(max_size=60))
def test_any_octets(octets: bytes) -> None:
    Seen().read(octets)
    Seen().read(framed(octets, 3))
    Seen().read(framed(bytes((0x32, 0, 0, 4, 0xBB)) + octets, 3))


def counted(number: int) -> bytes:
    """A notification with a number of any length."""
    return notified()[:-3] + bodies.number(number) + b"\1\0"


def seen(octets: bytes) -> Seen:
    one = Seen()
    assert one.read(octets), octets.hex()
    return one


def test_messages_with_another_head_or_another_length_are_not_alike() -> None:
    read, told_ = ALIKE["read"], ALIKE["read: told"]
    nothing = (True, END_SEQUENCE, b"\0\0", b"")
    these = [
        pdu(read, 5, 9, 4),
        pdu(read, 5, 9, 5),  # as long as one with an id of two octets
        pdu(read, 5, 9, 4, version=2),
        pdu(read, 5, 9, 4, version=1),
        pdu((True, GET_VARIABLE, read[2], b""), 5, 9, 4),
        pdu((False, *read[1:]), 5, 9, 4),
        pdu(told_, 5, 9, 4),
        pdu(nothing, 5, 9, 4),
        pdu((True, END_SEQUENCE, b"\0\1", b""), 5, 9, 4),
        pdu(ALIKE["explore: told"], 5, 9, 4),
        pdu(ALIKE["explore: told"], 5, 300, 4),
        framed(notified(5)),
        framed(counted(300)),
        framed(notified(5), 3),
        framed(notified(5, 0x386)),
    ]
    kinds = [(one.kind, one.body) for one in map(seen, these)]
    assert len(set(kinds)) == len(kinds)


def test_the_same_octets_of_another_function_or_subscription_are_not_alike() -> None:
    """However many there are."""
    functions = (GET_VARIABLE, SET_VARIABLE, GET_MULTI_VARIABLES, SET_MULTI_VARIABLES, GET_LINK, END_SEQUENCE)
    subscriptions = [0x70000000, *[0x70000000 | 1 << bit for bit in range(28)]]
    for size in range(2, 150):
        body = b"\1" * size
        for request in (True, False):
            found = [seen(pdu((request, function, body, b""), 5, 9, 4)) for function in functions]
            assert len({one.kind for one in found}) == len(functions)
            assert len({one.body for one in found}) == 1
        found = [seen(framed(notified(5, one) + body)) for one in subscriptions]
        assert len({one.kind for one in found}) == len(subscriptions)


def test_a_session_is_one_with_its_flags_and_its_version() -> None:
    found = [
        seen(framed(asked(5, session=session, flags=flags, body=ALIKE["read"][2] + bodies.end(9)), version)).session
        for session in (0, 1, 0x100, 0x386, 0x10000, 0xFFFFFFFF)
        for flags in (0, 0x34, 0x74, 0xFF)
        for version in (1, 2, 3)
    ]
    assert len(set(found)) == len(found)
    one = framed(asked(5, session=0x386, body=ALIKE["read"][2] + bodies.end(9)))
    other = framed(asked(6, session=0x386, body=ALIKE["set"][2] + bodies.end(9)))
    assert seen(one).session == seen(other).session


@each("version", [1, 2, 3])
def test_the_numbers_of_a_message_are_those_of_its_head(version: int) -> None:
    octets = pdu(ALIKE["read: told"], 5, 9, 4, version=version)
    one = seen(octets)
    assert (one.version, one.opcode, one.octets, one.alike) == (version, 0x32, octets, True)
    assert octets[one.at :].startswith(told(5))
    if version > 1:
        one = seen(framed(counted(300), version))
        assert (one.subscription_id, one.number, one.credit_tick, one.opcode) == (0x70000E51, 300, 1, 0x33)


def test_one_message_leaves_nothing_to_the_next() -> None:
    one = Seen()
    assert (one.alike, one.has_id, one.octets, one.body) == (False, False, b"", b"")
    assert (one.integrity_id, one.number, one.session, one.subscription_id, one.credit_tick) == (-1, -1, -1, -1, -1)
    assert one.read(pdu(ALIKE["read"], 5, 9, 4))
    assert (one.has_id, one.integrity_id) == (True, 9)
    assert one.read(pdu(ALIKE["read"], 5, 9, 4, version=2))
    assert (one.has_id, one.integrity_id) == (False, -1)
    assert not one.read(b"")
    assert not one.alike


def test_a_subscription_counts_in_its_credit_up_to_an_id() -> None:
    for subscription, number in ((0x6FFFFFFF, 1), (0x70000000, 5), (0xFFFFFFFF, 5)):
        assert seen(framed(notified(5, subscription))).number == number


@each(
    "octets",
    [
        b"",
        framed(notified(), 1),  # another form
        framed(notified()[:-3] + b"\x80"),  # its number is cut off
        framed(notified()[:11]),
        framed(asked(1)[:-1]),
        framed(asked(1)[:12]),
        framed(told(1, opcode=2)),
        framed(b"\x44" + bytes(20)),
        framed(asked(1), trailer=False),
        framed(asked(1), trailer=False) + framed(b"more"),
        framed(told(1, EXPLORE, b"\x80"), 3),
        framed(told(1, EXPLORE, b"\x80\x80\x80"), 3),
        framed(told(1, EXPLORE, b"\0" + bodies.rid(7)), 3),  # nothing behind the object
        framed(told(1, EXPLORE, b"\0" + bodies.rid(7) + b"\x80"), 3),
        framed(told(1, EXPLORE, b"\0" + bodies.rid(7)[:-1]), 3),
        framed(told(1, SET_VARIABLE, b""), 3),
        framed(asked(1, SET_VARIABLE, body=bytes(4)), 3),  # its flags are not its id
        framed(asked(1, SET_VARIABLE, body=bytes(5)), 3),
        framed(asked(1, SET_VARIABLE, body=bytes(6)), 3),
        framed(told(1, SET_VARIABLE, bytes(4)), 3),
        framed(told(1, SET_VARIABLE, bytes(5)), 3),
        framed(asked(1, SET_VARIABLE, body=b"\x05"), 3),
    ],
)
def test_a_message_of_another_form_is_compared_with_none(octets: bytes) -> None:
    assert not Seen().read(octets)


@each("fill", range(9))
@each("id_", [5, 128, 300, (1 << 28) - 1, 1 << 28])
def test_an_id_is_found_in_front_of_four_or_five_zeros(fill: int, id_: int) -> None:
    one = Seen()
    taken = one.read(pdu((True, SET_VARIABLE, b"\x01", b""), 5, id_, fill))
    assert taken == (fill in {4, 5} and id_ < 1 << 28)
    assert (one.has_id, one.integrity_id) == ((True, id_) if taken else (False, -1))


def test_an_id_may_be_all_that_there_is() -> None:
    for request in (True, False):
        one = seen(pdu((request, END_SEQUENCE, b"" if request else b"\0", b""), 5, 300, 4))
        assert (one.integrity_id, one.body) == (300, b"" if request else b"\x34\0")
    assert seen(pdu((True, END_SEQUENCE, b"", b""), 5, 9, 4)).integrity_id == 9


def test_an_id_with_an_octet_that_adds_nothing_is_not_found() -> None:
    for id_ in (b"\x80\5", b"\x80\x81\5", b"\x80\x80\x80\5"):
        assert not Seen().read(framed(asked(1, SET_VARIABLE, body=b"\1" + id_ + bytes(4)), 3))
    assert seen(framed(asked(1, SET_VARIABLE, body=b"\1\x81\x80\5" + bytes(4)), 3)).integrity_id == (1 << 14) + 5


def test_the_body_has_all_but_the_id_and_the_zeros() -> None:
    request = pdu((True, SET_VARIABLE, b"\1\2\3", b""), 5, 300, 5)
    assert seen(request).body == b"\1\2\3"
    answer = pdu((False, SET_VARIABLE, b"\1\2\3", b""), 5, 300, 5)
    assert seen(answer).body == b"\x34\1\2\3"  # with its flags
    explored = pdu((False, EXPLORE, b"\1" + bodies.rid(7), b"\xa2"), 5, 300, 5)
    assert seen(explored).body == b"\x34\1" + bodies.rid(7) + b"\xa2" + bytes(5)
    assert seen(explored).integrity_id == 300
    assert seen(framed(counted(300), 2)).body == b"\1\0"
    assert seen(framed(notified(5, 0x386), 2)).body == b"\5\1\0"
    assert seen(pdu((True, SET_VARIABLE, b"\1\2\3", b""), 5, 300, 5, version=2)).body == b"\1\2\3\x82\x2c" + bytes(5)


def test_messages_up_to_4096_octets_are_compared() -> None:
    for size, compared in ((4096, True), (4097, False)):
        data = told(5, SET_VARIABLE, b"\1" * (size - 10))
        assert len(data) == size
        assert Seen().read(framed(data)) == compared
    for size, compared in ((11, False), (12, True)):
        assert Seen().read(framed(told(5, SET_VARIABLE, b"\1" * (size - 10)))) == compared
