"""Compressed blobs: opened, checked without their dictionary, and those that lie or would become endless."""

from __future__ import annotations

import zlib
from bisect import bisect_left
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus import blobs
from dissect.protocols.s7plus.blobs import (
    BAD,
    MAX_INFLATED,
    MAX_KEPT,
    NO_DICTIONARY,
    TOO_LARGE,
    SoundBlobs,
    check_blob,
    is_compressed,
    may_swell,
    open_blob,
)
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, Relation
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import CREATE_OBJECT
from dissect.protocols.s7plus.value_tables import BLOB, SPARSE_ARRAY, UDINT
from dissect.protocols.s7plus.values import Blob, Value
from tests.protocols.s7plus.bodies import create_object
from tests.protocols.s7plus.pdus import asked, framed

VERSION: Final = b"\x98\0\0\2"
DICTIONARY: Final = b'<Comment RefID=""><DictEntry Language="en-US"></DictEntry></Comment>'
TEXT: Final = b'<Comment RefID="26"><DictEntry Language="en-US">the pump runs too long</DictEntry></Comment>'
INTERFACE: Final = 2544
COMMENTS: Final = 2546


def compressed(text: bytes, dictionary: bytes = b"") -> bytes:
    stream = zlib.compressobj(zdict=dictionary) if dictionary else zlib.compressobj()
    return stream.compress(text) + stream.flush()


def bomb(size: int) -> bytes:
    return VERSION + compressed(bytes(size))


def known(dictionary: bytes) -> dict[int, bytes]:
    return {zlib.adler32(dictionary): dictionary}


@pytest.mark.parametrize("version", [b"", VERSION])
def test_without_dictionary(version: bytes) -> None:
    opened = open_blob(version + compressed(TEXT), {})
    assert (opened.octets, opened.size, opened.dictionary, opened.fault) == (TEXT, len(TEXT), -1, "")


def test_with_dictionary() -> None:
    blob = VERSION + compressed(TEXT, DICTIONARY)
    assert is_compressed(blob)
    opened = open_blob(blob, known(DICTIONARY))
    assert (opened.octets, opened.fault, opened.dictionary) == (TEXT, "", zlib.adler32(DICTIONARY))


def test_without_the_dictionary_that_it_needs_only_its_size_is_known() -> None:
    opened = open_blob(VERSION + compressed(TEXT, DICTIONARY), known(b"another one"))
    assert (opened.octets, opened.size, opened.fault) == (b"", len(TEXT), NO_DICTIONARY)


@given(st.binary(max_size=2000), st.binary(min_size=1, max_size=300))
def test_the_size_does_not_depend_on_the_dictionary(text: bytes, dictionary: bytes) -> None:
    blob = VERSION + compressed(text + dictionary, dictionary)
    checked, opened = check_blob(blob), open_blob(blob, known(dictionary))
    assert (checked.size, checked.fault) == (opened.size, opened.fault) == (len(text + dictionary), "")


@pytest.mark.parametrize("octets", [b"", b"\x98\0\0\2", b"plain text", bytes(20), b"\xef\xbe\xad\xde" * 4])
def test_what_is_not_compressed(octets: bytes) -> None:
    assert not is_compressed(octets)
    assert check_blob(octets).fault == BAD


def test_a_stream_that_is_cut_goes_on_or_was_changed() -> None:
    for blob in (VERSION + compressed(TEXT), VERSION + compressed(TEXT, DICTIONARY)):
        for size in range(len(VERSION) + 2, len(blob)):
            assert open_blob(blob[:size], known(DICTIONARY)).fault == BAD, size
            assert check_blob(blob[:size]).fault == BAD, size
        assert check_blob(blob + b"\0").fault == BAD
        assert open_blob(blob + b"\0", known(DICTIONARY)).fault == BAD
    wrong = bytearray(VERSION + compressed(TEXT, DICTIONARY))
    wrong[-1] ^= 1  # its checksum
    assert open_blob(bytes(wrong), known(DICTIONARY)).fault == BAD


def test_a_bomb_is_stopped_at_a_thousand_times_its_size() -> None:
    blob = bomb(MAX_INFLATED)
    assert len(blob) < 40_000
    opened = open_blob(blob, {})
    assert opened.fault == TOO_LARGE
    assert opened.size <= 1000 * len(blob) + (1 << 18)
    assert check_blob(bomb(1_000_000), allowed=100_000).fault == TOO_LARGE
    assert open_blob(bomb(4000), {}).fault == ""


def test_only_as_much_as_is_wanted_is_kept() -> None:
    opened = open_blob(VERSION + compressed(TEXT * 9), {}, kept=10)
    assert (opened.octets, opened.size) == (TEXT[:10], 9 * len(TEXT))


@given(st.binary(max_size=200))
def test_any_octets_raise_nothing(octets: bytes) -> None:
    for blob in (octets, VERSION + b"\x78\x7d" + octets, VERSION + b"\x78\xda" + octets, b"\x78\xda" + octets):
        assert check_blob(blob).size <= MAX_INFLATED
        open_blob(blob, known(octets))


# ---- within a PDU ---------------------------------------------------------------------------------------------------


def download(*values: tuple[int, Value]) -> bytes:
    attributes = [Attribute(id_, value) for id_, value in values]
    block = PlusObject(0x8A0E0003, 2574, 0, 0, 0, [*attributes, Relation(7, 9)])
    return framed(asked(1, CREATE_OBJECT, body=create_object(3, Value(0, UDINT, 0), block)))


def one(blob: bytes) -> Value:
    return Value(0, BLOB, Blob(0, blob))


def test_sound_blobs_are_noted_where_they_stand() -> None:
    blob = VERSION + compressed(TEXT, DICTIONARY)
    rows = [(1, Blob(0, blob)), (0x80000001, Blob(0, blob)), (2, Blob(0, b"plain"))]
    for order in (rows, rows[::-1], rows[1:] + rows[:1]):  # what is none hides none behind it
        comments = Value(SPARSE_ARRAY, BLOB, order)
        pdu = parse_plus(
            download((INTERFACE, one(blob)), (COMMENTS, comments), (233, one(blob)), (INTERFACE, one(b"")))
        )
        found = parse_contents(pdu)
        assert [pdu.data[begin:end] for begin, end in found.blobs] == [blob, blob]
        assert found.malformed == []


@pytest.mark.parametrize(
    ("blob", "reason", "said"),
    [
        (bomb(2_000_000), TOO_LARGE, "decompress to 2000000 or more"),
        (VERSION + compressed(TEXT)[:-3], BAD, "cannot be decompressed to the end"),
        (VERSION + compressed(TEXT, DICTIONARY) + b"more", BAD, "cannot be decompressed to the end"),
    ],
)
def test_a_lying_blob_is_told_with_its_place_and_hides_nothing(blob: bytes, reason: str, said: str) -> None:
    octets = download((INTERFACE, one(blob)), (2521, Value(0, UDINT, 7)))
    pdu = parse_plus(octets)
    found = parse_contents(pdu)
    (fact,) = found.malformed
    assert fact.reason == reason
    assert said in str(fact)
    assert pdu.data[fact.offset :].startswith(blob)
    assert found.objects[0].number(2521) == 7
    assert found.whole
    facts = take(PlusSession(Program(), Identity()), CREATE_OBJECT, octets, b"")
    assert facts is not None
    swells = [(reason, blob[:4])] if reason == TOO_LARGE else []  # on the way only these are inflated
    assert [(one.reason, octets[one.offset : one.offset + 4]) for one in facts.malformed] == swells
    assert facts.events


def test_the_shared_bound_holds_for_a_large_pdu() -> None:
    """As many bombs as go into a PDU, each within its ratio: what is inflated of them all is bounded."""
    blob = VERSION + compressed(bytes(blobs.MAX_INFLATED // 4))
    found = parse_contents(parse_plus(download((COMMENTS, Value(SPARSE_ARRAY, BLOB, [(1, Blob(0, blob))] * 2)))))
    assert len(blob) * blobs.MAX_RATIO < blobs.MAX_INFLATED // 4
    assert [fact.reason for fact in found.malformed] == [TOO_LARGE] * 2


def test_what_is_remembered_as_sound_is_bounded_and_exact() -> None:
    sound = SoundBlobs()
    for number in range(3000):
        sound.add(number.to_bytes(1000, "big"), number)
    known = [number for number in range(3000) if sound.size(number.to_bytes(1000, "big")) >= 0]
    assert known == list(range(3000 - len(known), 3000))
    assert 0 < len(known) * 1000 <= MAX_KEPT
    sound.add(bytes(MAX_KEPT), 5)
    assert sound.size(bytes(MAX_KEPT)) == -1


def test_a_blob_that_was_sound_once_keeps_to_what_is_allowed_now() -> None:
    blob = zlib.compress(bytes(5000) + b"once")
    first = check_blob(blob)
    again = check_blob(blob)
    assert (first.size, first.fault, first.dictionary) == (again.size, again.fault, again.dictionary) == (5004, "", -1)
    assert check_blob(blob, 5003).fault == TOO_LARGE
    assert check_blob(blob[:-1]).fault == BAD


# ---- what is judged on the way --------------------------------------------------------------------------------------


def test_a_blob_that_cannot_swell_is_not_inflated_on_the_way() -> None:
    """Its ratio is bounded by its octets; that it ends too early is seen by whoever looks into it."""
    blob = VERSION + compressed(b"".join([zlib.crc32(bytes((one,))).to_bytes(4, "big") for one in range(200)]))[:-3]
    octets = download((INTERFACE, one(blob)))
    assert [fact.reason for fact in parse_contents(parse_plus(octets)).malformed] == [BAD]
    facts = take(PlusSession(Program(), Identity()), CREATE_OBJECT, octets, b"")
    assert facts is not None
    assert facts.malformed == []


@given(
    st.lists(st.tuples(st.binary(min_size=1, max_size=40), st.integers(1, 40_000)), min_size=1, max_size=8),
    st.sampled_from([zlib.Z_DEFAULT_STRATEGY, zlib.Z_HUFFMAN_ONLY, zlib.Z_RLE, zlib.Z_FIXED]),
    st.integers(1, 9),
)
def test_what_swells_is_always_looked_into(runs: list[tuple[bytes, int]], strategy: int, level: int) -> None:
    stream = zlib.compressobj(level, zlib.DEFLATED, 15, 9, strategy)
    text = b"".join([pattern * (1 + size // len(pattern)) for pattern, size in runs])
    blob = stream.compress(text) + stream.flush()
    assert may_swell(blob) or len(text) <= blobs.MAX_RATIO * len(blob)


@given(st.lists(st.tuples(st.binary(min_size=1, max_size=9), st.integers(1, 300)), max_size=6))
def test_what_may_swell_has_less_than_half_of_its_octets_without_a_run_of_every_other_bit(
    runs: list[tuple[bytes, int]],
) -> None:
    blob = b"".join([pattern * count for pattern, count in runs])
    otherwise = [octet for octet in blob if {octet & 0x55, octet & 0xAA}.isdisjoint({0, 0x55, 0xAA})]
    assert may_swell(blob) == (2 * len(otherwise) < len(blob))


def test_bombs_may_swell() -> None:
    for pattern in (b"\0", b"ab", b"pump"):
        text = pattern * (3_000_000 // len(pattern))
        blob = VERSION + compressed(text)
        assert may_swell(blob) or len(text) < 1000 * len(blob)
    assert may_swell(bomb(3_000_000))


def test_large_blobs_are_always_looked_into() -> None:
    """What is longer than 32 KiB may become more than is allowed by a smaller ratio as well."""
    noise = b"".join([zlib.crc32(number.to_bytes(4, "big")).to_bytes(4, "big") for number in range(10_000)])
    assert may_swell(noise)
    assert not may_swell(noise[:30_000])


def test_an_octet_may_be_of_a_run_if_every_other_bit_of_it_is_the_same() -> None:
    """In either half of its bits: a run has one bit that changes and one that does not, or none that changes."""
    for octet in range(256):
        bits = f"{octet:08b}"
        of_a_run = len(set(bits[::2])) == 1 or len(set(bits[1::2])) == 1
        for size in (1, 7, 8, 9, 20):
            assert may_swell(bytes((octet,)) * size) == of_a_run, (octet, size)
        rest = bytes((0, octet, 0xAA, octet, 0x55, octet, 0xFF, octet, 0x00, octet, 0xAB))
        assert may_swell(rest) == (of_a_run or len(rest) > 2 * 5)


@pytest.mark.parametrize("size", [*range(1, 25), 447, 448, 449, 450, 455, 456, 457, 900, 2000, 20_000])
@pytest.mark.parametrize("first", [True, False])
def test_half_of_the_octets_decide_wherever_they_are(size: int, first: bool) -> None:
    """They are counted seven at a time, 64 times, before the counts are added up."""
    for others in {0, 1, (size - 1) // 2, size // 2, (size + 1) // 2, size}:
        parts = [b"\x1b" * others, b"\0" * (size - others)]
        blob = b"".join(parts if first else parts[::-1])
        assert may_swell(blob) == (2 * others < size), (others, size)


def test_from_one_in_1032_of_all_that_may_be_inflated_a_blob_is_looked_into() -> None:
    most = MAX_INFLATED / 1032
    assert not may_swell(b"\x1b" * (int(most) - 1))
    assert may_swell(b"\x1b" * (int(most) + 1))


@pytest.mark.parametrize(
    ("head", "known"),
    [
        (b"\x78\x9c", True),
        (b"\x78\x9d", False),  # no multiple of 31
        (b"\x78\x7d", True),  # with a dictionary
        (b"\x08\x1d", True),  # the smallest window
        (b"\x88\x1c", False),  # a window that is too large
        (b"\x79\x9a", False),  # not deflate
        (b"\x77\x9e", False),
        (b"\x78", False),
        (b"", False),
    ],
)
def test_a_stream_is_known_by_its_first_two_octets(head: bytes, known: bool) -> None:
    for octets in (head, VERSION + head, VERSION + head + b"more"):
        assert is_compressed(octets) == known
    assert is_compressed(head + b"more") == (known and len(head) == 2)
    assert not is_compressed(b"\0" + head)
    assert not is_compressed(VERSION + b"\0" + head)


def test_a_dictionary_is_named_by_the_four_octets_behind_the_head() -> None:
    blob = VERSION + compressed(TEXT, DICTIONARY)
    for _ in range(2):  # the second time it is known to be sound
        assert check_blob(blob).dictionary == zlib.adler32(DICTIONARY)
    assert check_blob(blob[:10]).dictionary == zlib.adler32(DICTIONARY)
    assert check_blob(blob[:9]).dictionary == -1
    assert check_blob(VERSION + compressed(TEXT)).dictionary == -1
    assert check_blob(VERSION).dictionary == -1


@pytest.mark.parametrize("name", [0, 1, 2**32 - 1])
def test_a_dictionary_of_any_name_may_be_missing(name: int) -> None:
    blob = compressed(TEXT, DICTIONARY)
    blob = blob[:2] + name.to_bytes(4, "big") + blob[6:]
    opened = open_blob(blob, known(DICTIONARY))
    assert (opened.dictionary, opened.fault, opened.size) == (name, NO_DICTIONARY, len(TEXT))
    assert open_blob(blob, {name: DICTIONARY}).fault == BAD  # it is not the one that was used


def test_content_of_several_pieces_is_kept_as_far_as_it_is_wanted() -> None:
    text = b"".join([zlib.crc32(number.to_bytes(4, "big")).to_bytes(4, "big") for number in range(200_000)])
    blob = VERSION + compressed(text)
    for kept in (0, 1, 300_000, 600_000, 800_000, 900_000):
        opened = open_blob(blob, {}, kept)
        assert (opened.fault, opened.size, opened.octets) == ("", len(text), text[:kept])


def test_a_thousand_times_its_size_is_the_most_that_a_blob_may_become() -> None:
    """Zeros become a 1032nd, and some octets more: at some size, in thousands, they are just what is allowed."""
    packed = bisect_left(range(2000), 1, 500, key=lambda size: size >= len(zlib.compress(bytes(1000 * size), 9)))
    faults = set()
    for size in (1000 * packed - 1000, 1000 * packed, 1000 * packed + 1, 1000 * packed + 1000, 1000 * packed + 9000):
        blob = zlib.compress(bytes(size), 9)
        fault = TOO_LARGE if size > 1000 * len(blob) else ""
        assert (check_blob(blob).fault, open_blob(blob, {}).fault) == (fault, fault)
        faults.add(fault)
    assert faults == {"", TOO_LARGE}


def test_what_is_allowed_is_a_bound_of_its_own() -> None:
    blob = zlib.compress(bytes(5_000))
    assert [check_blob(blob, allowed).fault for allowed in (4_999, 5_000, 5_001)] == [TOO_LARGE, "", ""]


def test_a_blob_of_a_quarter_of_what_is_remembered_is_remembered() -> None:
    sound = SoundBlobs()
    quarter = bytes(MAX_KEPT // 4)
    sound.add(quarter, 5)
    sound.add(quarter + b"\0", 6)
    assert (sound.size(quarter), sound.size(quarter + b"\0"), sound.size(b"")) == (5, -1, -1)
    sound.add(quarter, 7)
    assert sound.size(quarter) == 5  # what is known stays as it is
    for number in range(3):
        sound.add(bytes((number + 1,)) + quarter[1:], number)
    assert [sound.size(bytes((number,)) + quarter[1:]) for number in range(4)] == [-1, 0, 1, 2]


@pytest.mark.parametrize(
    ("key", "compressed_"), [(1, True), (0x7FFFFFFF, True), (0x80000000, False), (0xFFFFFFFF, False)]
)
def test_elements_with_high_keys_are_not_compressed(key: int, compressed_: bool) -> None:
    broken = VERSION + compressed(TEXT)[:-3]
    found = parse_contents(parse_plus(download((COMMENTS, Value(SPARSE_ARRAY, BLOB, [(key, Blob(0, broken))])))))
    assert [fact.reason for fact in found.malformed] == [BAD] * compressed_
    sound = VERSION + compressed(TEXT)
    found = parse_contents(parse_plus(download((COMMENTS, Value(SPARSE_ARRAY, BLOB, [(key, Blob(0, sound))])))))
    assert (len(found.blobs), found.malformed) == (compressed_, [])


def test_a_stream_may_refer_back_by_thirty_two_kilobytes() -> None:
    """Within itself, and into its dictionary: what is there does not matter for its size."""
    noise = b"".join([zlib.crc32(number.to_bytes(4, "big")).to_bytes(4, "big") for number in range(8_000)])
    for dictionary, text in (
        (DICTIONARY, noise + noise[:2000]),
        (noise, noise[:2000] + TEXT),
        (noise[:9000], noise[:50]),
    ):
        blob = VERSION + compressed(text, dictionary)
        assert len(blob) < len(noise) + 2000
        assert (check_blob(blob).fault, check_blob(blob).size) == ("", len(text))
        assert open_blob(blob, known(dictionary)).octets == text
