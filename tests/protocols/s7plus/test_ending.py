"""The ends of PDUs in all forms, and what only looks like one: reading and passing over find the same."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import PlusObject, build_object
from dissect.protocols.s7plus.tables import CREATE_OBJECT, EXPLORE, GET_LINK, SET_VARIABLE
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value, build_value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import number, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told

_DIGEST: Final = b"\x20" + bytes(range(1, 33))
_OBJECT: Final = build_object(PlusObject(7, 9, 0, 0, 0, []))
BAD: Final = -2


def read(data: bytes, version: int) -> tuple[int, bytes, list[str]]:
    """Give integrity id (`BAD` for an end of no form), digest, and the layouts of what the end consists of."""
    octets = framed(data, version)
    found, said = parse_contents(parse_plus(octets)), check(octets)
    quiet = parse_contents(parse_plus(octets), False)
    assert (quiet.integrity_id, quiet.digest, quiet.whole) == (found.integrity_id, found.digest, found.whole)
    assert (said.sound, said.odd) == (found.whole, not found.whole)
    layouts = [part.layout.name for part in found.parts]
    if not found.whole:
        if not any(data[11:]):  # zeros only are contents that were made anonymous
            assert found.malformed == []
            return BAD, found.digest, layouts
        (fact,) = found.malformed
        assert (fact.reason, fact.field) == ("trailing_octets", "end")
        assert (fact.needed, fact.available) == (0, len(data) - fact.offset)
        return BAD, found.digest, layouts
    assert said.integrity_id == found.integrity_id
    assert found.parts[-1].end == len(data)
    return found.integrity_id, found.digest, layouts


@pytest.mark.parametrize(
    ("end", "ids"),
    [
        # What versions 1, 2 and 3 take the integrity id for; -1: there is none.
        (b"", (-1, -1, -1)),
        (bytes(1), (BAD, BAD, BAD)),
        (bytes(3), (BAD, BAD, BAD)),
        (bytes(4), (-1, -1, -1)),
        (bytes(5), (-1, -1, -1)),
        (bytes(6), (BAD, 0, 0)),
        (bytes(7), (BAD, BAD, BAD)),
        (b"\x09", (BAD, BAD, BAD)),
        (b"\x09" + bytes(3), (BAD, BAD, BAD)),
        (b"\x09" + bytes(4), (BAD, 9, 9)),
        (b"\x09" + bytes(5), (BAD, 9, 9)),
        (b"\x09" + bytes(6), (BAD, BAD, BAD)),
        (b"\x82\x2c" + bytes(4), (BAD, 300, 300)),
        (b"\xff\x7f" + bytes(5), (BAD, 0x3FFF, 0x3FFF)),
        (b"\x8f\xff\xff\xff\x7f" + bytes(4), (BAD, 0xFFFFFFFF, 0xFFFFFFFF)),
        (b"\x9f\xff\xff\xff\x7f" + bytes(4), (BAD, 0xFFFFFFFF, 0xFFFFFFFF)),  # bits beyond 32 are dropped
        (b"\x81\x80\x80\x80\x80\x00" + bytes(4), (BAD, BAD, BAD)),
        (b"\x89", (BAD, BAD, BAD)),
        (b"\x09\0\0\0\1", (BAD, BAD, BAD)),
        (b"\x09\1\0\0\0", (BAD, BAD, BAD)),
        (b"\0\0\0\1", (BAD, BAD, BAD)),
        (b"\1\0\0\0", (BAD, BAD, BAD)),
        (_DIGEST, (BAD, -1, BAD)),
        (_DIGEST[:-1], (BAD, BAD, BAD)),
        (_DIGEST + b"\1", (BAD, BAD, BAD)),
        (b"\x21" + _DIGEST[1:], (BAD, BAD, BAD)),
        (b"\x1f" + _DIGEST[1:], (BAD, BAD, BAD)),
        (b"\x09\x1f" + _DIGEST[1:], (BAD, BAD, BAD)),
        (b"\x09" + _DIGEST[:-1], (BAD, BAD, BAD)),
    ],
)
def test_the_end_of_a_request_or_response(end: bytes, ids: tuple[int, int, int]) -> None:
    for version, id_ in zip((1, 2, 3), ids, strict=True):
        for data in (told(7, GET_LINK, b"\0\1" + rid(7) + end), asked(7, GET_LINK, body=rid(7) + b"\x09\0\0" + end)):
            found, digest, layouts = read(data, version)
            assert found == id_, (version, data.hex())
            assert digest == (_DIGEST[1:] if end == _DIGEST and version == 2 else b"")
            if id_ != BAD:
                wanted = ["integrity id"] * (id_ >= 0) + ["fill"] * (b"\0\0\0" in end) + ["digest"] * bool(digest)
                assert layouts[len(layouts) - len(wanted) :] == wanted


def test_a_digest_may_follow_the_integrity_id() -> None:
    for id_ in (9, 300):
        found, digest, layouts = read(told(7, GET_LINK, b"\0\0" + number(id_) + _DIGEST), 2)
        assert (found, digest, layouts[-2:]) == (id_, _DIGEST[1:], ["integrity id", "digest"])


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    "data",
    [
        told(7, EXPLORE, b"\0" + rid(3) + number(9) + _OBJECT),
        asked(7, CREATE_OBJECT, body=rid(9) + build_value(Value(0, INT, 5)) + bytes(4) + number(9) + _OBJECT),
        asked(7, CREATE_OBJECT, body=rid(9) + build_value(Value(0, INT, 5)) + bytes(4) + number(9)),
    ],
    ids=["explored", "create", "create nothing"],
)
def test_an_id_within_the_body_is_not_followed_by_another(version: int, data: bytes) -> None:
    if version == 2 and data[0] == 0x32:
        return  # responses of version 2 have it at their end
    for end, id_ in (
        (b"", 9), (bytes(4), 9), (bytes(5), 9), (bytes(6), BAD), (b"\x07" + bytes(4), BAD), (bytes(3), BAD), (b"\x07", BAD),
    ):  # fmt: skip
        assert read(data + end, version)[0] == id_, end


@pytest.mark.parametrize(
    ("end", "good"),
    [
        (b"", True),
        (bytes(1), False),
        (bytes(2), False),
        (bytes(3), True),
        (bytes(4), True),
        (bytes(5), False),
        (b"\0\0\1", False),
        (b"\0\0\0\1", False),
    ],
)
def test_the_end_of_a_notification(end: bytes, good: bool) -> None:
    for data in (notified(), notified()[:-1] + b"\0" + b"\x70\0\0\1\0\0" + b"\0", notified(5, 0x6000)[:-2] + b"\0"):
        if len(data) < len(notified()) + 5 or end[:1] != b"\0":
            found, _, layouts = read(data + end, 3)
            assert found == (-1 if good else BAD)
            assert (layouts[-1] == "fill") == (good and bool(end))


def test_the_end_of_a_response_of_the_second_kind_has_no_id() -> None:
    for version in (1, 2, 3):
        found, _, layouts = read(told(7, SET_VARIABLE, b"\0" + bytes(11), opcode=2), version)
        assert (found, layouts[-1]) == (-1, "fill")
        for zeros in (4, 10, 12):
            assert read(told(7, SET_VARIABLE, b"\0" + bytes(zeros), opcode=2), version)[0] == BAD
    assert read(told(7, SET_VARIABLE, b"\0" + bytes(11)), 2)[0] == BAD


def test_a_request_without_a_body_is_too_short() -> None:
    for data in (asked(7, SET_VARIABLE), told(7, SET_VARIABLE, b"")):
        octets = framed(data, 3)
        found = parse_contents(parse_plus(octets))
        assert [(fact.reason, fact.offset) for fact in found.malformed] == [("too_short", len(data))]
        assert check(octets).odd
        shorter = parse_contents(parse_plus(framed(data[:-1], 3)))
        assert (shorter.malformed, shorter.parts) == ([], [])
    assert parse_contents(parse_plus(framed(asked(7, CREATE_OBJECT, body=bodies.rid(3)), 3))).object_id == 3
