"""The check passes over all that reading finds whole, and says of it what reading says."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import Check, check
from dissect.protocols.s7plus.contents import Contents, VariableAddress
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, Relation, build_object
from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VARIABLE,
    INIT_SSL,
    INVOKE,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import (
    BLOB,
    BOOL,
    DINT,
    INT,
    LREAL,
    NULL,
    STRUCT,
    UDINT,
    VARIANT,
    WSTRING,
)
from dissect.protocols.s7plus.values import Blob, Packed, Rows, Struct, Value, build_members, build_value
from dissect.protocols.s7plus.walk import MAX_WORK
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import QUALIFIER, end, number, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told
from tests.protocols.s7plus.test_check import lies
from tests.protocols.s7plus.test_check import sound as usual
from tests.protocols.s7plus.test_objects import TYPE

_FIVE: Final = Value(0, INT, 5)
_TEXT: Final = Value(0, WSTRING, "pump")
_MEMBERS: Final = build_members([(7, _FIVE), (300, _TEXT)])
_NAMED: Final = PlusObject(7, 9, 0, 0, 0, [Attribute(233, _TEXT), Relation(300, 5)])
_WORDS: Final = [VariableAddress(0, 82, 3736, [3, 2 * at, 2]) for at in range(3)]
_ATTRIBUTES: Final = rid(50) + b"\2\2" + number(2237) + number(3451)


def nested(depth: int) -> Value:
    """A structure with ``depth`` levels."""
    value = _FIVE
    for _ in range(depth):
        value = Value(0, STRUCT, Struct(314, [(7, value), (8, _FIVE)]))
    return value


#: Values of one PDU each: all kinds of arrays, structures and texts that are passed over.
_VALUES: Final = {
    "texts": Value(0x10, WSTRING, ["", "pump", "x" * 200]),
    "blobs": Value(0x10, BLOB, [Blob(0, b"abc"), Blob(1, b"")]),
    "keyed texts": Value(0x40, WSTRING, [(1, "a"), (300, ""), (2**32 - 1, "b")]),
    "keyed variants": Value(0x40, VARIANT, [(1, 5), (2, 70_000)]),
    "keyed reals": Value(0x40, LREAL, [(1, 0.5), (128, 2.5)]),
    "nulls with keys": Value(0x40, NULL, [(1, None), (2, None)]),
    "numbers": Value(0x20, UDINT, [0, 127, 128, 16_383, 16_384, 2**32 - 1]),
    "negative numbers": Value(0x10, DINT, [-1, -64, -65, 63, 64, -(2**31)]),
    "nothing": Value(0x10, DINT, []),
    "flag 0x80": Value(0x80, BOOL, True),
    "structures": Value(0x20, STRUCT, Rows(7, [[], [(3, _FIVE), (300, nested(1))]])),
    "no structures": Value(0x10, STRUCT, Rows(7, [])),
    "eight levels": nested(8),
    "raw inside": Value(0, STRUCT, Struct(314, [(7, Value(0, STRUCT, Packed(0x92000007, 0x500, 2, b"ab")))])),
    "raw": Value(0, STRUCT, Packed(0x92000007, 5, 2, b"abcd")),
}
_REQUESTS: Final = {
    "explore": (
        EXPLORE,
        rid(3) + b"\x81\0\1\1\0" + b"\2\1" + (b"\x17" + rid(1247) + _MEMBERS) * 2 + b"\x87\x08" + b"\1\0\x17" + rid(5) + b"\0"
        + b"\0\3\7\x08\x09" + end(4),
    ),
    "write of attributes": (SET_MULTI_VARIABLES, _ATTRIBUTES + b"\2" + build_value(_FIVE) + b"\1" + build_value(_TEXT) + b"\0"
                            + QUALIFIER + end(9)),
    "write of several": (SET_MULTI_VARIABLES, bodies.set_multi([(one, _FIVE) for one in _WORDS], 2**31)),
    "write of nothing": (SET_MULTI_VARIABLES, bodies.set_multi([])),
    "read of nothing": (GET_MULTI_VARIABLES, bodies.get_multi()),
    "write of a member": (SET_VARIABLE, bodies.set_variable(0x70000001, [2237, 300, 7], _TEXT, 300)),
    "write without ids": (SET_VARIABLE, bodies.set_variable(9, [], _TEXT, 300)),
    "call without items": (INVOKE, rid(7) + rid(9) + b"\0\0" + end(9)),
    "call": (INVOKE, rid(7) + rid(9) + b"\1" + build_value(_TEXT) + b"\7" + build_value(_FIVE) + b"\0\0" + end(9)),
    "sequence": (BEGIN_SEQUENCE, b"\1\0\1" + build_object(_NAMED) + end(9)),
    "sequence, one octet": (BEGIN_SEQUENCE, b"\1\0\1\7" + build_object(_NAMED) + end(9)),
    "sequence, two octets": (BEGIN_SEQUENCE, b"\1\0\1\7\7" + build_object(_NAMED) * 2 + end(9)),
    "create several": (CREATE_OBJECT, rid(285) + build_value(_TEXT) + bytes(4) + b"\7" + build_object(_NAMED) * 2 + bytes(4)),
    "create a type": (CREATE_OBJECT, bodies.create_object(3, _FIVE, TYPE, integrity_id=7)),
    "link": (GET_LINK, rid(7) + b"\x81\x09\0\0" + end(9)),
}  # fmt: skip
_RESPONSES: Final = {
    "values": (GET_MULTI_VARIABLES, bodies.multi_got(list(enumerate([_FIVE, *_VALUES.values()], 1)), [(99, 2**64 - 12)])),
    "values, not in order": (GET_MULTI_VARIABLES, bodies.multi_got([(2, _FIVE), (1, _TEXT)], [])),
    "values, a structure first": (
        GET_MULTI_VARIABLES, bodies.multi_got([(1, nested(1)), (2, _FIVE), (3, nested(2))], [])
    ),
    "values, twice": (GET_MULTI_VARIABLES, bodies.multi_got([(1, _FIVE), (1, _TEXT)], [])),
    "no values": (GET_MULTI_VARIABLES, bodies.multi_got([], [])),
    "refusals": (SET_MULTI_VARIABLES, b"\x13\1" + build_varint(2**64 - 12, VLQ64) + b"\x81\0\5\0" + end(9)),
    "refused": (SET_VARIABLE, build_varint(0x8022C4000F6EFF95, VLQ64) + end(9)),
    "refused in part": (SET_VARIABLE, b"\x82\x13" + end(9)),
    "created": (CREATE_OBJECT, b"\0\3\7\x87\x08\x8f\xff\xff\xff\x7f" + end(9)),
    "created nothing": (CREATE_OBJECT, b"\0\0" + end(9)),
    "linked": (GET_LINK, b"\0\3" + rid(7) * 3 + end(9)),
    "linked to nothing": (GET_LINK, b"\0\0" + end(9)),
    "deleted, with details": (
        DELETE_OBJECT, bytes.fromhex("a080808080808080 11") + rid(0x386) + build_object(_NAMED) + end(4)
    ),
    "called": (INVOKE, b"\0\0\0\1" + build_value(_FIVE) + b"\2" + build_value(_TEXT) + b"\0\0" + end(9)),
    "called, a return value more": (INVOKE, b"\0\0\0\x87\7\1" + build_value(_FIVE) + b"\0\0" + end(9)),
    **{name: (GET_VARIABLE, b"\0" + build_value(value) + end(9)) for name, value in _VALUES.items()},
}  # fmt: skip
_ITEM: Final = b"\x92" + rid(7) + build_value(_FIVE)
_NOTIFICATIONS: Final = {
    "kinds": notified()[:-1] + b"\x9b\x87\x08" + build_value(_TEXT) + b"\x9c" + rid(5) + b"\x83" + build_value(_TEXT) + _ITEM
    + b"\x81" + build_object(_NAMED) * 2 + b"\0" + bytes(4),
    "two parts": notified()[:-1] + _ITEM + b"\0" + rid(0x70000009) + b"\0\0" + _ITEM + b"\x13" + rid(8) + b"\0" + bytes(3),
    "without an end": notified()[:-1] + _ITEM + b"\0",
    "a high number": notified()[:-3] + b"\x8f\xff\xff\xff\x7f\1" + _ITEM + b"\0" + bytes(4),
    "first of new firmware": notified(5, 0x70000000)[:-1] + _ITEM + b"\0" + bytes(4),
    "last of old firmware": notified(5, 0x6FFFFFFF)[:-2] + _ITEM + b"\0" + bytes(4),
}  # fmt: skip


def sound() -> dict[str, bytes]:
    """Give the data of sound PDUs of versions 2 and 3 by name; those of the older tests are among them."""
    found = {f"request, {name}": asked(7, function, body=body) for name, (function, body) in _REQUESTS.items()}
    found |= {f"response, {name}": told(7, function, body) for name, (function, body) in _RESPONSES.items()}
    return found | {f"notification, {name}": data for name, data in _NOTIFICATIONS.items()} | usual()


#: Two ends that only version 3 has: the id of objects that are shown is within the body.
_ONLY_V3: Final = frozenset(("response: explored",))


def versions(name: str) -> tuple[int, ...]:
    return (3,) if name in _ONLY_V3 else (2, 3)


def is_rare(value: Value, depth: int = 0) -> bool:
    """Say whether a value has, anywhere inside it, a form that is always read."""
    content = value.content
    each = [one[1] if isinstance(one, tuple) else one for one in content] if isinstance(content, list) else [content]
    if value.type == VARIANT:
        return not value.flags & 0x40
    if value.type == NULL:
        return value.flags & 0x70 in {0x10, 0x20, 0x30}
    if value.type == BLOB:
        return any(isinstance(one, Blob) and one.root > 1 for one in each)
    if value.type != STRUCT or any(isinstance(one, Packed) for one in each):
        return False
    rows = content.rows if isinstance(content, Rows) else [one.members for one in each if isinstance(one, Struct)]
    return bool(value.flags & 0x40) or depth > 7 or any(is_rare(one, depth + 1) for row in rows for _, one in row)


def has_rare(found: Contents) -> bool:
    """Say the same of the contents of a PDU."""
    values = [value for _, value in [*found.items, *found.list]] + ([found.value] if found.value is not None else [])
    values += [one.value for held in found.every for one in held.elements if isinstance(one, Attribute)]
    return any(is_rare(value) for value in values)


def contents_of(octets: bytes) -> Contents:
    return parse_contents(parse_plus(octets), False)


def test_what_is_whole_is_passed_over_and_nothing_else() -> None:
    """Whatever octet is another, or missing: reading and passing over agree, but for qualifiers of a kind never seen."""
    whole = 0
    for name, data in sound().items():
        begin = 12 if name.startswith("notification") else 14 if name.startswith("request") else 10
        for index, changed in enumerate([data, *lies(data, begin)[:: 5 if len(data) > 120 else 1]]):
            octets = framed(changed, 3 if index % 3 or name in _ONLY_V3 else 2)
            found = contents_of(octets)
            said = check(octets)
            if found.whole and not has_rare(found) and (QUALIFIER not in data or QUALIFIER in changed):
                assert (said.sound, said.odd) == (True, False), (name, changed.hex())
                whole += 1
            elif found.malformed:
                assert (said.sound, said.odd) == (False, True), (name, changed.hex())
    assert whole > 1000


def results(found: Check) -> tuple[object, ...]:
    return (
        found.code, found.integrity_id, found.made, found.refuses, found.refusals, found.numbered, found.expected,
        found.details, found.asks, found.item, found.object_id, found.spent, found.function, found.opcode,
        found.sequence, found.subscription_id,
    )  # fmt: skip


def test_what_the_check_says_is_what_reading_says() -> None:
    for name, data in sound().items():
        for version in versions(name):
            octets = framed(data, version)
            pdu, found, said = parse_plus(octets), contents_of(octets), check(octets)
            assert (said.sound, said.code) == (True, pdu.return_code), name
            assert (said.function, said.opcode, said.subscription_id) == (
                pdu.function, pdu.opcode, pdu.subscription_id if pdu.opcode == 0x33 else said.subscription_id
            )  # fmt: skip
            assert said.pdu().data == pdu.data
            if pdu.opcode != 0x33:
                assert said.sequence == pdu.sequence
            if pdu.opcode == 0x31:
                assert said.session_id == pdu.session_id
            assert said.integrity_id == found.integrity_id, name
            assert said.refuses == bool(found.refusals), name
            if pdu.opcode == 0x33:
                assert said.refusals == found.refusals
            if pdu.function == CREATE_OBJECT and pdu.opcode == 0x32:
                assert said.made == found.ids
            if pdu.function not in {
                EXPLORE,
                GET_LINK,
                INVOKE,
                GET_MULTI_VARIABLES,
                SET_MULTI_VARIABLES,
                BEGIN_SEQUENCE,
            }:
                assert said.object_id == found.object_id, name
            if pdu.function == SET_MULTI_VARIABLES and pdu.opcode == 0x31:
                assert (said.expected, len(found.items)) == (found.expected, found.expected)
            if pdu.function == GET_MULTI_VARIABLES and pdu.opcode == 0x32:
                in_order = [one for one, _ in found.items] == list(range(1, len(found.items) + 1))
                assert max(said.numbered, 0) == (len(found.items) if in_order else 0), name
            if found.value is not None and pdu.opcode != 0x33 and pdu.function != SET_VAR_SUBSTREAMED:
                assert said.valued == said.begin + found.value.offset, name
            half = len(data) // 2
            frames = framed(data[:half], version, trailer=False) + framed(data[half:], version)
            if pdu.function == SET_VAR_SUBSTREAMED and pdu.opcode == 0x31:
                assert (check(frames).sound, check(frames).odd) == (False, True)  # its frames are pieces of a stream
            else:
                assert results(check(frames)) == results(said), name


def test_the_places_of_items_are_those_of_their_values() -> None:
    """Looking for an item changes nothing that the check has found, and may be repeated."""
    several = 0
    for name, data in sound().items():
        for version in versions(name):
            octets = framed(data, version)
            said, found = check(octets), contents_of(octets)
            before = results(said)
            begin = said.begin
            wanted = [one for number, value in found.items for one in (number, begin + value.offset)]
            counts: dict[int, list[int]] = {}
            for number_, value in found.items:
                counts.setdefault(number_, []).append(begin + value.offset)
            for _ in range(2):
                assert said.places() == wanted, name
                for number_ in {*counts, 0, 1, 2, 98, 99, 2**32 - 1} if wanted else ():
                    places = counts.get(number_, [])
                    assert said.seek(number_) == (0 if not places else places[0] if len(places) == 1 else -1), name
                    several += len(places) > 1
                assert results(said)[:7] == before[:7]
    assert several


def test_objects_follow_a_deletion_only_if_its_return_value_says_so() -> None:
    for value, details in (
        (0, False),
        (1, False),
        (1 << 61, False),
        (1 << 62, True),
        (3 << 62, True),
        (1 << 63, False),
    ):
        body = build_varint(value, VLQ64) + rid(7)
        for held in (b"", build_object(_NAMED)):
            said = check(framed(told(7, DELETE_OBJECT, body + held + end(9)), 3))
            assert (said.sound, said.details) == (details or not held, details)
            assert contents_of(said.octets).whole == said.sound


def test_at_most_two_octets_come_before_the_object_of_a_sequence() -> None:
    for count in range(5):
        body = b"\1\0\1" + b"\7" * count + build_object(_NAMED) + end(9)
        octets = framed(asked(7, BEGIN_SEQUENCE, body=body), 3)
        assert contents_of(octets).whole == check(octets).sound == (count <= 2)


def test_what_follows_the_trailer_leaves_a_pdu_without_a_judgement() -> None:
    """The fault is that of its frames."""
    for data in (told(7, GET_LINK, b"\0\0" + end(9)), told(7, GET_LINK, b"\0\0" + end(9) + b"\1")):
        for octets in (framed(data, 3), framed(data[:12], 3, trailer=False) + framed(data[12:], 3)):
            assert check(octets).sound or check(octets).odd
            said = check(octets + b"\0")
            assert (said.sound, said.odd) == (False, False)


def test_an_address_has_at_least_one_id() -> None:
    for fields in (3, 4, 5):
        addresses = rid(0) + bytes((1, fields)) + b"\0\x52\0" + b"\7" * (fields - 3)
        octets = framed(asked(7, GET_MULTI_VARIABLES, body=addresses + QUALIFIER + end(9)), 3)
        assert [fact.reason for fact in contents_of(octets).malformed] == ["length_below"]
        assert check(octets).odd


@pytest.mark.parametrize("wide", [b"\x81\x80\x80\x80\x00", b"\x81\x80\x80\x80\x80\x00"], ids=["five", "six"])
def test_a_number_has_at_most_five_octets(wide: bytes) -> None:
    """Whatever it is the number of."""
    held = b"\xa1" + rid(7) + b"%s\0\0\xa3%s" + build_value(_FIVE) + b"\xa4%s" + rid(3) + b"\xa2"
    attribute = build_value(_FIVE)
    several = [
        told(7, GET_MULTI_VARIABLES, b"\0" + wide + attribute + b"\0\0" + end(9)),
        told(7, GET_MULTI_VARIABLES, b"\0\0" + wide + b"\5\0" + end(9)),
        told(7, CREATE_OBJECT, b"\0\1" + wide + end(9)),
        asked(7, SET_VARIABLE, body=rid(7) + b"\1" + wide + attribute + QUALIFIER + b"\0" + end(9)),
        asked(7, GET_MULTI_VARIABLES, body=rid(0) + b"\1\5" + wide + b"\x52\2\7\x08" + QUALIFIER + end(9)),
        asked(7, GET_MULTI_VARIABLES, body=rid(0) + b"\1\5\0" + wide + b"\2\7\x08" + QUALIFIER + end(9)),
        asked(7, GET_MULTI_VARIABLES, body=rid(0) + b"\1\5\0\x52\2" + wide + b"\x08" + QUALIFIER + end(9)),
        asked(7, GET_MULTI_VARIABLES, body=rid(0) + b"\1\5\0\x52\2\7" + wide + QUALIFIER + end(9)),
        asked(7, GET_MULTI_VARIABLES, body=rid(52) + b"\1\1" + wide + QUALIFIER + end(9)),
        notified()[:-3] + wide + b"\1" + _ITEM + b"\0" + bytes(4),
        notified()[:-1] + b"\x9b" + wide + attribute + b"\0" + bytes(4),
        told(7, EXPLORE, b"\0" + rid(3) + number(9) + held % (wide, b"\7", b"\7") + end()),
        told(7, EXPLORE, b"\0" + rid(3) + number(9) + held % (b"\7", wide, b"\7") + end()),
        told(7, EXPLORE, b"\0" + rid(3) + number(9) + held % (b"\7", b"\7", wide) + end()),
        told(7, GET_VARIABLE, b"\0\0\x17" + rid(7) + wide + attribute + b"\0" + end(9)),
        told(7, GET_VARIABLE, b"\0\x40\7" + wide + b"\0\5\0" + end(9)),
        told(7, GET_VARIABLE, b"\0\0\x04" + wide + end(9)),
        told(7, GET_VARIABLE, b"\0\x10\x04\2\7" + wide + end(9)),
    ]  # fmt: skip
    for data in several:
        octets = framed(data, 3)
        assert contents_of(octets).whole == (len(wide) == 5), data.hex()
        assert (check(octets).sound, check(octets).odd) == (len(wide) == 5, len(wide) == 6), data.hex()


def test_what_ends_anywhere_in_several_frames_is_odd() -> None:
    """Nothing follows its data in memory, not even a trailer."""
    for name, data in sound().items():
        begin = 12 if name.startswith("notification") else 14 if name.startswith("request") else 10
        for size in range(begin, len(data), 1 if len(data) < 120 else 7):
            octets = framed(data[: begin - 1], 3, trailer=False) + framed(data[begin - 1 : size], 3)
            found, said = contents_of(octets), check(octets)
            if name == "request: write of a stream":
                assert not said.sound  # its frames are pieces of the stream
            else:
                assert said.sound == found.whole, (name, size)
                assert said.odd or not found.malformed, (name, size)


@pytest.mark.parametrize("version", [2, 3])
def test_the_work_of_values_and_objects_is_what_reading_them_takes(version: int) -> None:
    """So a PDU that would take too much is known before it is read."""
    counted = 0
    for name, data in sound().items():
        if version not in versions(name):
            continue
        octets = framed(data, version)
        pdu, said = parse_plus(octets), check(octets)
        if said.refuses or QUALIFIER in data or name.startswith("request, explore") or name == "request: explore":
            continue  # addresses, filters and refusals are few, and not counted
        if pdu.opcode == 0x33 and name == "notification, kinds":
            continue
        work = int(said.spent)
        assert not parse_contents(pdu, False, max(work, 1)).exhausted, name
        if work > 1:
            counted += 1
            assert parse_contents(pdu, False, work - 1).exhausted, name
    assert counted > 20


def test_more_work_than_is_allowed_is_odd() -> None:
    for more in (0, 1):
        data = told(7, GET_VARIABLE, b"\0\x10\2" + number(MAX_WORK - 5 + more) + bytes(MAX_WORK - 5 + more) + end(9))
        frames = [framed(data[at : at + 60_000], 3, trailer=False) for at in range(0, len(data), 60_000)]
        said = check(b"".join(frames) + b"\x72\3\0\0")
        assert (said.sound, said.odd) == (not more, bool(more))


def test_a_structure_in_nine_levels_is_read() -> None:
    """So are blobs with a kind of their own, and variants; reading finds nothing wrong in them."""
    for value in (
        nested(9),
        Value(0, VARIANT, _FIVE),
        Value(0, BLOB, Blob(7, b"abc", bytes(8), 2)),
        Value(0x40, STRUCT, [(1, Struct(7, [(3, _FIVE)]))]),
    ):
        octets = framed(told(7, GET_VARIABLE, b"\0" + build_value(value) + end(9)), 3)
        assert contents_of(octets).whole
        assert (check(octets).sound, check(octets).odd) == (False, True)


# ---- version 1, and responses of the second kind --------------------------------------------------------------------

_V1: Final = {
    "create": asked(7, CREATE_OBJECT, body=bodies.create_object(285, _FIVE, _NAMED)),
    "created": told(7, CREATE_OBJECT, b"\0\2\x87\7\x05" + build_object(_NAMED) + bodies.FILL),
    "sequence": asked(7, BEGIN_SEQUENCE, body=b"\1" + bodies.FILL),
    "begun": told(7, BEGIN_SEQUENCE, b"\0" + bodies.FILL),
    "explored": told(7, EXPLORE, b"\0" + rid(3) + build_object(_NAMED) + bodies.FILL),
    "write": asked(7, SET_MULTI_VARIABLES, body=bodies.set_multi([(_WORDS[0], _FIVE)], -1)),
    "read": told(7, GET_MULTI_VARIABLES, bodies.multi_got([(1, _FIVE)], [(2, 5)], -1)),
}


def test_version_1_has_no_integrity_id_and_some_bodies_of_its_own() -> None:
    for name, data in _V1.items():
        for changed in [data, *lies(data, 14 if data[0] == 0x31 else 10)]:
            octets = framed(changed, 1)
            found, said = contents_of(octets), check(octets)
            if found.whole and not has_rare(found) and (QUALIFIER not in data or QUALIFIER in changed):
                assert (said.sound, said.integrity_id) == (True, -1), (name, changed.hex())
                assert said.code == parse_plus(octets).return_code
            elif found.malformed:
                assert said.odd, (name, changed.hex())
    assert check(framed(_V1["created"], 1)).made == [0x387, 5]
    assert check(framed(_V1["explored"], 1)).sound


def test_a_response_of_the_second_kind_ends_with_eleven_zeros() -> None:
    """Captures have it only after a SetVariable of version 2 that wants no answer; it contains a return value."""
    for version in (1, 2, 3):
        for zeros in range(14):
            octets = framed(told(7, SET_VARIABLE, b"\0" + bytes(zeros), opcode=0x02), version)
            found, said = contents_of(octets), check(octets)
            assert said.sound == found.whole == (zeros in {0, 11} or (zeros in {5, 6} and version > 1)), (
                version,
                zeros,
            )
            if zeros == 11:
                assert (said.integrity_id, found.integrity_id) == (-1, -1)


@pytest.mark.parametrize("function", [0x04BA, 0x05B4, 0x9999, INIT_SSL, 0x0001, 0xFFFF])
def test_a_function_without_a_known_body_is_not_judged(function: int) -> None:
    for data in (asked(7, function, body=b"any octets"), told(7, function, b"\0any octets")):
        said = check(framed(data, 3))
        assert (said.sound, said.odd, said.function) == (False, False, function)


@pytest.mark.parametrize("size", range(15))
def test_what_is_shorter_than_its_head_is_not_judged(size: int) -> None:
    for data, least in (
        (asked(7, SET_VARIABLE, body=b"\0" * 9), 14), (told(7, SET_VARIABLE, b"\0"), 10), (notified(), 12),
        (b"\x34" + bytes(20), 99), (b"\x02" + told(7, SET_VARIABLE, b"\0")[1:], 10),
    ):  # fmt: skip
        said = check(framed(data[:size], 3))
        assert (said.sound or said.odd) == (size >= least), (data.hex(), size)
        assert said.subscription_id == (-1 if size < 5 else int.from_bytes(data[1:5], "big"))
