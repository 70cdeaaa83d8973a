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
