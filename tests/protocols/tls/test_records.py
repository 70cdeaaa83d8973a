"""Records out of octets, however these are cut."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.tls.records import MAX_BODY, RecordReader, begins_record


def record(kind: int, body: bytes, minor: int = 3) -> bytes:
    return bytes((kind, 3, minor)) + len(body).to_bytes(2, "big") + body


RECORDS = [record(0x16, b"hello", 1), record(0x14, b"\x01"), record(0x17, bytes(300)), record(0x15, b"\x01\x00")]


def test_whole_and_octet_by_octet_and_with_trailing_octets() -> None:
    stream = b"".join(RECORDS)
    assert RecordReader().push(stream) == RECORDS
    reader = RecordReader()
    assert [found for octet in stream for found in reader.push(bytes((octet,)))] == RECORDS
    assert (reader.held, reader.skipped) == (0, 0)
    reader = RecordReader()
    assert reader.push(stream + b"\x17\x03\x03") == RECORDS
    assert reader.held == 3


@given(st.lists(st.integers(0, 400), max_size=8))
def test_any_cut_gives_the_same_records(cuts: list[int]) -> None:
    stream = b"".join(RECORDS)
    places = [0, *sorted(cut for cut in cuts if cut <= len(stream)), len(stream)]
    reader = RecordReader()
    found = [one for begin, end in itertools.pairwise(places) for one in reader.push(stream[begin:end])]
    assert found == RECORDS


def test_what_is_no_record_is_skipped_to_the_end_of_its_message() -> None:
    reader = RecordReader()
    assert reader.push(RECORDS[0] + b"\x00nonsense" + RECORDS[1]) == [RECORDS[0]]
    assert reader.skipped == 9 + len(RECORDS[1])
    assert reader.push(RECORDS[1]) == [RECORDS[1]]


def test_a_gap_ends_an_unfinished_record() -> None:
    reader = RecordReader()
    reader.push(RECORDS[2][:100])
    reader.lose()
    assert (reader.held, reader.skipped) == (0, 100)
    assert reader.push(RECORDS[3]) == [RECORDS[3]]


def test_no_record_is_longer_than_the_standard_allows() -> None:
    head = b"\x17\x03\x03"
    assert begins_record(head + MAX_BODY.to_bytes(2, "big"), 0, 5)
    assert not begins_record(head + (MAX_BODY + 1).to_bytes(2, "big"), 0, 5)
    assert not begins_record(head + b"\x00\x00", 0, 5)
    assert not begins_record(b"\x13\x03", 0, 2)
    assert not begins_record(b"\x19\x03", 0, 2)
    assert not begins_record(b"\x17\x04", 0, 2)
    assert not begins_record(b"\x17\x03\x05", 0, 3)


@given(st.lists(st.binary(max_size=60), max_size=30))
def test_every_octet_is_accounted_for(pieces: list[bytes]) -> None:
    reader = RecordReader()
    found = [one for piece in pieces for one in reader.push(piece)]
    assert sum(map(len, found)) + reader.held + reader.skipped == sum(map(len, pieces))
    assert reader.held <= 5 + MAX_BODY
