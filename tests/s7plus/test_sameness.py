"""PDUs that are taken for alike have the same contents, but for the integrity id."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st

from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.contents import Contents
from dissect.s7plus.message import parse_plus
from dissect.s7plus.sameness import Seen
from dissect.s7plus.tables import DELETE_OBJECT, EXPLORE, GET_MULTI_VARIABLES, SET_VARIABLE
from tests.s7plus import bodies
from tests.s7plus.pdus import asked, framed, notified, told
from tests.s7plus.test_bodies import FIVE, LEVEL, LOST, WORD

IDS = st.one_of(
    st.sampled_from([0, 1, 127, 128, 255, 256, 0x21, 0xA1 << 7, 16384, 1 << 21, 1 << 28]), st.integers(0, 2**32 - 1)
)
#: Octets of the end that `bodies` give a request or an answer.
END = len(bodies.end(9))
BODY = st.sampled_from(
    [
        (True, GET_MULTI_VARIABLES, bodies.get_multi(LEVEL, WORD)[:-END]),
        (True, SET_VARIABLE, bodies.set_variable(0x386, [1053], FIVE)[:-END]),
        (True, DELETE_OBJECT, bodies.delete_object(0x386)[:-END]),
        (False, GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE)], [(2, LOST)])[:-END]),
        (False, GET_MULTI_VARIABLES, bodies.multi_got([], [])[:-END]),
        (False, SET_VARIABLE, b"\0"),
        (False, DELETE_OBJECT, b"\0\0\0\3\x86"),
        (False, EXPLORE, b"\0\0\0\0\7\5"),
    ]
)


def pdu(what: tuple[bool, int, bytes], number: int, id_: int, fill: int, damage: tuple[int, int]) -> bytes:
    """A PDU of version 3; one octet of its body may be another."""
    request, function, body = what
    at, octet = damage
    if at < len(body):
        body = body[:at] + bytes((octet,)) + body[at + 1 :]
    body += bodies.number(id_) + bytes(fill)
    return framed(asked(number, function, body=body) if request else told(number, function, body), 3)


def said(found: Contents) -> list[object]:
    """What contents say, the integrity id left out."""
    return [
        found.whole, len(found.malformed), found.items, found.refusals, found.addresses, found.object_id, found.ids,
        found.value, [(value.offset, value.end) for _, value in found.items],
    ]  # fmt: skip


@given(
    BODY,
    st.tuples(st.integers(0, 40), st.integers(0, 255)),
    st.tuples(IDS, IDS),
    st.tuples(st.integers(3, 7), st.integers(3, 7)),
)
@example((False, SET_VARIABLE, b"\0\x80"), (99, 0), (5, 6), (4, 4))
@example((False, DELETE_OBJECT, b"\0\0\0\3\x86"), (99, 0), (5, 0xA1 << 7), (5, 5))
def test_alike(
    what: tuple[bool, int, bytes], damage: tuple[int, int], ids: tuple[int, int], fills: tuple[int, int]
) -> None:
    first, second = [pdu(what, 5 + index, ids[index], fills[index], damage) for index in range(2)]
    one, other = Seen(), Seen()
    if not (one.read(first) and other.read(second)) or (one.kind, one.body) != (other.kind, other.body):
        return
    known = parse_contents(parse_plus(first), False)
    if not known.whole or known.malformed or (one.has_id and known.integrity_id != one.integrity_id):
        return
    found = parse_contents(parse_plus(second), False)
    assert said(found) == said(known)
    assert found.integrity_id == (other.integrity_id if other.has_id else known.integrity_id)


@given(BODY, st.integers(1, 2**28 - 1), st.integers(4, 5))
def test_what_polling_repeats_is_alike(what: tuple[bool, int, bytes], id_: int, fill: int) -> None:
    """One that an id of the same length follows; an answer to a deletion may end in objects, so that it is none."""
    seen = Seen()
    octets = pdu(what, 5, id_, fill, (99, 0))
    if what[1] == EXPLORE or (not what[0] and what[1] == DELETE_OBJECT):
        return
    assert seen.read(octets)
    assert seen.has_id
    assert seen.integrity_id == id_
    assert seen.integrity_id == parse_contents(parse_plus(octets), False).integrity_id


def test_notifications_are_alike_but_for_their_numbers() -> None:
    one, other, elsewhere = Seen(), Seen(), Seen()
    assert one.read(framed(notified(5)))
    assert other.read(framed(notified(6)))
    assert elsewhere.read(framed(notified(5, 0x70000E52)))
    assert (one.kind, one.body) == (other.kind, other.body)
    assert one.number == 5
    assert other.number == 6
    assert one.kind != elsewhere.kind


@given(st.binary(max_size=60))
def test_any_octets(octets: bytes) -> None:
    Seen().read(octets)
    Seen().read(framed(octets, 3))
    Seen().read(framed(bytes((0x32, 0, 0, 4, 0xBB)) + octets, 3))
