"""A PDU is passed over only where reading finds no fault; and what is wrong is the same wherever it is reported."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.transactions.plus_operations import addresses_in
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.plus import plus_subject
from dissect.meaning.report.tree import plus_tree_lines
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.cursor import marks
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, Relation, build_object
from dissect.protocols.s7plus.pieces import addresses_of
from dissect.protocols.s7plus.program import TYPE_INFO, Program
from dissect.protocols.s7plus.reads import Reads, reads_again
from dissect.protocols.s7plus.session import Identity, PlusSession
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
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB, DINT, INT, STRUCT, UDINT, USINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Packed, Rows, Struct, Value, build_value
from tests.engine.transactions.talk import Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told
from tests.protocols.s7plus.strategies import OBJECTS, VALUES

_MARKS: Final = marks(frozenset((2533,)), frozenset((TYPE_INFO,)))
_WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
_TAG: Final = VariableAddress(0xABCDEF12, 0x8A0E0003, 2550, [14, 2])
_STATE: Final = VariableAddress(0, 52, 2237, [3486])
_INT: Final = Value(0, INT, 5)
_TREE: Final = PlusObject(
    0x8A0E0001, 2574, 0, 0, 0,
    [
        Attribute(233, Value(0, WSTRING, "tank")),
        Relation(7, 9),
        PlusObject(3, 7, 0, 5, 6, [Attribute(9, Value(0x10, USINT, [1, 2])), Attribute(8, Value(0x40, INT, [(3, 4)]))]),
        Attribute(306, Value(0, STRUCT, Struct(314, [(319, _INT)]))),
    ],
)  # fmt: skip
_ITEM: Final = b"\x92" + rid(7) + build_value(_INT)

#: Sound bodies of requests and responses, their end included.
REQUESTS: Final = {
    "read": (GET_MULTI_VARIABLES, bodies.get_multi(_WORD, _TAG)),
    "read of attributes": (GET_MULTI_VARIABLES, rid(52) + b"\2\2\7\x08" + bodies.QUALIFIER + end(9)),
    "write": (SET_MULTI_VARIABLES, bodies.set_multi([(_WORD, _INT), (_TAG, Value(0, DINT, -7))])),
    "write of one": (SET_VARIABLE, bodies.set_variable(0x70000001, [1053], _INT)),
    "read of one, old": (GET_VARIABLE, rid(5) + b"\2\7\x08" + bodies.QUALIFIER + end(9)),
    "read of a stream": (GET_VAR_SUBSTREAMED, bodies.get_stream(49, [3753]) + end(9)),
    "write of a stream": (SET_VAR_SUBSTREAMED, bodies.get_stream(7, [300]) + build_value(_INT) + end(9)),
    "explore": (EXPLORE, rid(3) + b"\0\1\1\0" + b"\1\2\x17\0\0\0\7\0\7\x08" + b"\0\1\7" + end(4) + b"\0"),
    "create": (CREATE_OBJECT, bodies.create_object(9, _INT, _TREE, integrity_id=7)),
    "delete": (DELETE_OBJECT, bodies.delete_object(0x70000001)),
    "link": (GET_LINK, rid(7) + b"\x09\0\0" + end(9)),
    "sequence": (BEGIN_SEQUENCE, b"\1\0\2" + rid(7) + end(9)),
    "sequence with an object": (BEGIN_SEQUENCE, b"\1\0\1\0" + build_object(_TREE) + end(9)),
    "end of a sequence": (END_SEQUENCE, b"\0\0" + end(9)),
    "call": (INVOKE, rid(7) + rid(9) + b"\1" + build_value(_INT) + b"\0\0" + end(9)),
}  # fmt: skip
RESPONSES: Final = {
    "read": (GET_MULTI_VARIABLES, bodies.multi_got([(1, _INT), (2, Value(0x10, UDINT, [1, 300]))], [(3, 0xFFF4)])),
    "write": (SET_MULTI_VARIABLES, b"\0\0" + end(9)),
    "write of one": (SET_VARIABLE, b"\0" + end(9)),
    "read of one, old": (GET_VARIABLE, b"\0" + build_value(_INT) + end(9)),
    "read of a stream": (GET_VAR_SUBSTREAMED, b"\0\0" + build_value(Value(0, BLOB, Blob(0, b"abc"))) + end(9)),
    "explored": (EXPLORE, b"\0" + rid(3) + number(9) + build_object(_TREE) * 2 + end()),
    "created": (CREATE_OBJECT, b"\0\2\x81\7\x08" + end(9)),
    "deleted": (DELETE_OBJECT, b"\0" + rid(7) + end()),
    "link": (GET_LINK, b"\0\1" + rid(7) + end(9)),
    "sequence": (BEGIN_SEQUENCE, b"\0\0\2" + rid(7) + end(9)),
    "called": (INVOKE, b"\0\0\0\1" + build_value(_INT) + b"\0\0" + end(9)),
    "a structure as the program holds it": (
        GET_VARIABLE,
        b"\0" + build_value(Value(0, STRUCT, Packed(0x92000007, 5, 0x402, b"abcd"))) + end(9),
    ),
    "an array of structures": (
        GET_VARIABLE,
        b"\0" + build_value(Value(0x10, STRUCT, Rows(7, [[(3, _INT)], [(3, _INT), (4, _INT)]]))) + end(9),
    ),
}  # fmt: skip
NOTIFICATIONS: Final = {
    "values": notified()[:-1] + _ITEM * 2 + b"\0" + bytes(4),
    "refusals": notified()[:-1] + b"\x13" + rid(7) + b"\x03" + rid(8) + _ITEM + b"\0" + bytes(4),
    "an alarm": notified()[:-1] + b"\0" + rid(0x70000009) + b"\0\0\x81" + build_object(_TREE) + b"\0" + bytes(3),
    "of old firmware": notified(5, 0x6000)[:-2] + _ITEM + b"\0" + bytes(4),
    "timed": notified()[:-2] + bytes(8) + b"\1\x9b\x81\7" + build_value(_INT) + b"\0" + bytes(4),
}  # fmt: skip


def sound() -> dict[str, bytes]:
    """Give the data of sound PDUs of every kind, by name."""
    found = {f"request: {name}": asked(7, function, body=body) for name, (function, body) in REQUESTS.items()}
    found |= {f"response: {name}": told(7, function, body) for name, (function, body) in RESPONSES.items()}
    return found | {f"notification: {name}": data for name, data in NOTIFICATIONS.items()}


def lies(data: bytes, begin: int) -> list[bytes]:
    """Give data whose contents, which begin at ``begin``, are cut off, go on too long, or lie in one octet."""
    changed = [data[:at] for at in range(begin, len(data))] + [data + b"\1"]
    for at in range(begin, len(data)):
        octets = (0x00, 0x7F, 0x81, 0xFF, data[at] ^ 1, data[at] + 1 & 0xFF)
        changed += [data[:at] + bytes((octet,)) + data[at + 1 :] for octet in octets]
    return changed


def faults(octets: bytes) -> list[str]:
    """Give what reading all of a PDU says against it, with places within the PDU."""
    pdu = parse_plus(octets)
    if not pdu.whole or pdu.malformed:
        return []
    found = parse_contents(pdu, False).malformed
    for fact in found:
        fact.offset = pdu.place(fact.offset)
    return [str(fact) for fact in found]


def verdict(octets: bytes) -> str:
    """What the check says of a PDU."""
    found = check(octets, _MARKS)
    assert not (found.sound and found.odd)
    return "sound" if found.sound else "odd" if found.odd else ""


def facts_of(one: Reads) -> tuple[bool, bool, bool, int, int]:
    return one.sound, one.odd, one.asks, int(one.item), int(one.place)


def test_sound_contents_are_passed_over() -> None:
    for name, data in sound().items():
        octets = framed(data, 3)
        assert faults(octets) == [], name
        assert verdict(octets) == "sound", name


def test_no_lie_is_passed_over() -> None:
    unsound = 0
    for name, data in sound().items():
        begin = 12 if name.startswith("notification") else 10
        for changed in lies(data, begin):
            octets = framed(changed, 3)
            if faults(octets):
                unsound += 1
                assert verdict(octets) == "odd", (name, changed.hex())
    assert unsound > 3000


def test_several_frames_are_passed_over_as_one() -> None:
    data = told(7, EXPLORE, b"\0" + rid(3) + number(9) + build_object(_TREE) * 9 + end())
    frames = framed(data[:50], 3, trailer=False) + framed(data[50:], 3)
    whole = check(framed(data, 3), _MARKS)
    assert verdict(frames) == verdict(framed(data, 3)) == "sound"
    assert (check(frames, _MARKS).code, whole.code) == (0, 0)
    assert check(frames, _MARKS).noted == [place - whole.begin for place in whole.noted or []]
    lying = data[:-9] + b"\xff" + data[-8:]
    assert faults(framed(lying[:50], 3, trailer=False) + framed(lying[50:], 3))
    assert verdict(framed(lying[:50], 3, trailer=False) + framed(lying[50:], 3)) == "odd"
    assert verdict(frames[:-5]) == ""  # no whole PDU: nobody judges its contents


@given(OBJECTS, st.lists(VALUES, max_size=3), st.data())
def test_any_contents_and_any_damage(one: PlusObject, values: list[Value], data: st.DataObject) -> None:
    explored = told(7, EXPLORE, b"\0" + rid(3) + number(9) + build_object(one) + end())
    octets = data.draw(st.sampled_from([
        explored, told(7, GET_MULTI_VARIABLES, bodies.multi_got(list(enumerate(values, 1)), []))
    ]))  # fmt: skip
    changed = bytearray(octets)
    for _ in range(data.draw(st.integers(0, 3))):
        changed[data.draw(st.integers(10, len(octets) - 1))] = data.draw(st.integers(0, 255))
    whole = framed(bytes(changed), 3)
    if verdict(whole) != "odd":
        assert faults(whole) == []


def test_what_it_says_of_objects() -> None:
    for one, seen in (
        (_TREE, False),
        (PlusObject(1, TYPE_INFO, 0, 0, 0, []), True),
        (
            PlusObject(1, 7, 0, 0, 0, [PlusObject(2, 8, 0, 0, 0, [Attribute(2533, Value(0, BLOB, Blob(0, b"x")))])]),
            True,
        ),
        (PlusObject(1, 7, 0, 0, 0, [Attribute(2544, Value(0, BLOB, Blob(0, b"x")))]), False),
    ):
        octets = framed(told(7, EXPLORE, b"\0" + rid(3) + number(9) + build_object(one) + end()), 3)
        found = check(octets, _MARKS)
        assert (found.sound, found.met, found.code) == (True, seen, 0)


@given(
    st.lists(
        st.sampled_from([_WORD, _TAG, _STATE, VariableAddress(0, 52, 3486, []), VariableAddress(0, 9, 2237, [3486])]),
        max_size=5,
    )
)
def test_what_it_says_of_a_read(wanted: list[VariableAddress]) -> None:
    """Whether it asks for the operating state, by which item, and where its addresses end."""
    states = [index for index, one in enumerate(wanted, 1) if one is _STATE]
    for version in (1, 2, 3):
        body = bodies.get_multi(*wanted, integrity_id=9 if version > 1 else -1)
        octets = framed(asked(7, GET_MULTI_VARIABLES, body=body), version)
        said = Reads(check(octets, _MARKS))
        assert (said.sound, said.asks) == (True, bool(states))
        assert said.item == (states[0] if len(states) == 1 else 0)
        assert octets[said.place :].startswith(bodies.QUALIFIER)
        assert addresses_in(octets, said.place) == addresses_in(octets) == body[: body.index(bodies.QUALIFIER)]
        for _ in range(2):  # the second time they are known
            assert addresses_of(addresses_in(octets)) == parse_contents(parse_plus(octets), False).addresses == wanted
    data = asked(7, GET_MULTI_VARIABLES, body=bodies.get_multi(*wanted))
    frames = framed(data[:20], 3, trailer=False) + framed(data[20:], 3)
    assert Reads(check(frames, _MARKS)).place == 0  # places within several frames say nothing
    assert check(frames, _MARKS).asks == bool(states)


def test_a_read_that_is_read_again() -> None:
    """Where it is taken for another read of the same, passing over it says what it said before; whatever its end is."""
    again = 0
    for version in (1, 2, 3):
        body = bodies.get_multi(_STATE, _TAG, integrity_id=9 if version > 1 else -1)
        octets = framed(asked(7, GET_MULTI_VARIABLES, body=body), version)
        said = Reads(check(octets, _MARKS))
        wanted = addresses_in(octets, said.place)
        data = asked(7, GET_MULTI_VARIABLES, body=body)
        others = [framed(asked(7, GET_MULTI_VARIABLES, body=changed), version) for changed in lies(body, 0)]
        assert reads_again(framed(asked(8, GET_MULTI_VARIABLES, 5, body=body), version), wanted, said)
        for other in others:
            if reads_again(other, wanted, said):
                again += 1
                assert facts_of(Reads(check(other, _MARKS))) == facts_of(said)
                assert addresses_in(other) == wanted
        assert not reads_again(framed(asked(7, body=body), 2 if version == 3 else 3), wanted, said)
        assert not reads_again(octets[:-5], wanted, said)
        assert not reads_again(octets, wanted[1:], said)
        assert not reads_again(framed(data[:40], version, False) + framed(data[40:], version), wanted, said)
    assert again > 5


def test_refusals_of_a_notification() -> None:
    """They are those that reading finds."""
    octets = framed(NOTIFICATIONS["refusals"], 3)
    assert check(octets).refusals == [(7, 0x13), (8, 0x03)]
    assert check(framed(NOTIFICATIONS["values"], 3)).refusals == []
    for name, data in sound().items():
        if not name.startswith("notification"):
            assert check(framed(data, 3)).refusals == []
            continue
        assert verdict(framed(data, 1)) == "odd"
        for changed in lies(data, 5):
            octets = framed(changed, 3)
            found = check(octets)
            if found.sound:
                assert found.refusals == parse_contents(parse_plus(octets), False).refusals


def test_what_it_says_of_a_read_of_one_attribute() -> None:
    for rid_, ids, asks in (
        (52, [2237, 3486], True), (52, [2237], True), (52, [300], False), (49, [3753], True), (49, [300], False),
        (7, [3753], False), (7, [300], False),
    ):  # fmt: skip
        octets = framed(asked(7, GET_VAR_SUBSTREAMED, body=bodies.get_stream(rid_, ids) + end(9)), 3)
        assert (check(octets).sound, check(octets).asks) == (True, asks)


def test_every_report_says_the_same_of_the_same_pdu() -> None:
    """Of a request, a response or a notification that lies: the finding, the line of its transaction, and the tree."""
    told_of = 0
    for name, data in sound().items():
        begin = 12 if name.startswith("notification") else 10
        for changed in lies(data, begin)[::19]:
            octets = framed(changed, 2)
            wrong = faults(octets)
            pdu = parse_plus(octets)
            if pdu.malformed:
                continue
            talk = Talk()
            talk.hello()
            talk.connect()
            (talk.ask if name.startswith("request") else talk.tell)(octets)
            talk.close()
            unknown = bool(wrong) and wrong[0].endswith("which is unknown")
            slug, word = ("s7plus.unknown_kind", "NOT KNOWN") if unknown else ("s7plus.malformed", "MALFORMED")
            kinds = {unknown} | {one.endswith("which is unknown") for one in wrong}
            told = [one for one in talk.findings if one.slug in ("s7plus.malformed", "s7plus.unknown_kind")]
            details = [one.detail for one in told if one.slug == slug]
            (transaction,) = talk.transactions
            line = plus_subject(transaction)
            tree = "\n".join(plus_tree_lines(pdu, b""))
            assert len(details) == bool(wrong), (name, changed.hex(), wrong, details)
            assert len(told) == (len(kinds) if wrong else 0), (name, changed.hex(), wrong, told)
            assert (f" {word} " in f" {line} ") == (f" {word} " in tree) == bool(wrong), (name, tree)
            if wrong:
                told_of += 1
                assert wrong[0] in details[0]
                assert wrong[0] in line
                assert wrong[0] in tree
    assert told_of > 100


def test_captures(corpus: Path) -> None:
    """Nearly all PDUs of the shared captures are passed over, and in all of these reading finds nothing wrong."""
    passed = 0
    whole = 0
    for path in sorted((corpus / "s7plus").glob("*.pcap*")):
        for one in dissect.open(path):
            if isinstance(one, Transaction) and one.is_plus:
                for octets in (one.request_octets, one.response_octets):
                    if octets:
                        whole += 1
                        passed += verdict(octets) != "odd"
    assert passed > whole * 0.99 > 2000, f"{passed} of {whole}"


def test_it_is_taken_where_nothing_else_matters() -> None:
    session = PlusSession(Program(), Identity())
    octets = framed(told(7, GET_LINK, RESPONSES["link"][1]), 3)
    assert take(session, GET_LINK, framed(asked(7, GET_LINK, body=REQUESTS["link"][1]), 3), octets) is None
    facts = take(session, GET_LINK, b"", framed(told(7, GET_LINK, b"\0\xff"), 3))
    assert facts is not None
    assert [fact.field for fact in facts.malformed] == ["object id"]
