"""S7comm-plus frames out of octets that only their own lengths separate."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.stream import FrameStream
from tests import build
from tests.protocols.s7plus.pdus import KEEP_ALIVE, asked, event, framed, notified, told

WHOLE = [framed(asked(1)), KEEP_ALIVE, framed(told(1), 3), event(7), framed(notified(), 1)]
PARTS = [framed(b"x" * 50, trailer=False), framed(b"y" * 50, trailer=False), framed(b"z")]


def test_a_record_each_all_in_one_and_octet_by_octet() -> None:
    for said in (WHOLE, PARTS, WHOLE + PARTS + WHOLE):
        stream = FrameStream()
        assert [found for frame in said for found in stream.push(frame)] == said
        assert FrameStream().push(b"".join(said)) == said
        stream = FrameStream()
        assert [found for octet in b"".join(said) for found in stream.push(bytes((octet,)))] == said
        assert stream.held == 0


def test_a_trailer_of_its_own_belongs_to_the_frame_before() -> None:
    stream = FrameStream()
    frame = framed(asked(1))
    assert stream.push(frame[:-4]) == []
    assert stream.push(frame[-4:]) == [frame]


def test_what_is_none_is_given_as_it_came() -> None:
    stream = FrameStream()
    assert stream.push(b"\x32\x01hello") == [b"\x32\x01hello"]
    assert stream.push(framed(asked(1)) + b"other") == [framed(asked(1)), b"other"]
    assert stream.push(framed(asked(2))) == [framed(asked(2))]


def test_what_is_none_hides_no_frame_behind_it() -> None:
    """In the same record; what only looks like the beginning of a frame is not taken for one."""
    question, answer = framed(asked(1)), framed(told(1), 3)
    for lie in (b"\xde\xad", b"\x00\x72\x02\x00\x04ab", b"\x00\x72\x02\x00\x00", b"\x00" + b"\x72" * 70):
        assert FrameStream().push(lie + question + answer) == [lie, question, answer], lie
    assert FrameStream().push(b"\x00" + question[:-1]) == [b"\x00" + question[:-1]]
    s7comm = build.pdu(build.JOB, 1, question)
    assert FrameStream().push(s7comm) == [s7comm]


def test_a_length_that_lies_hides_no_frame() -> None:
    stream = FrameStream()
    liar = b"\x72\x02\xff\xff" + bytes(30)
    assert stream.push(liar) == []
    assert stream.push(framed(asked(1))) == [liar, framed(asked(1))]


def test_what_is_left_at_the_end() -> None:
    stream = FrameStream()
    assert stream.push(framed(asked(1))[:9]) == []
    assert stream.finish() == framed(asked(1))[:9]
    assert stream.finish() == b""


@given(st.lists(st.binary(min_size=1, max_size=40), max_size=20))
def test_nothing_is_lost_and_nothing_raises(pieces: list[bytes]) -> None:
    stream = FrameStream()
    found = [frame for piece in pieces for frame in stream.push(piece)]
    assert b"".join(found) + stream.finish() == b"".join(pieces)


@given(st.lists(st.integers(0, 600), max_size=10))
def test_any_cut_gives_the_same_frames(cuts: list[int]) -> None:
    octets = b"".join(WHOLE + PARTS)
    places = [0, *sorted({cut for cut in cuts if 0 < cut < len(octets)}), len(octets)]
    stream = FrameStream()
    found = []
    for begin, end in itertools.pairwise(places):
        found += stream.push(octets[begin:end])
    assert found == WHOLE + PARTS
