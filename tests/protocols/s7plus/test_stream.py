"""S7comm-plus frames out of octets that only their own lengths separate."""

from __future__ import annotations

import itertools

import pytest
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


def given_at(octets: bytes, behind: bytes = b"") -> list[int]:
    """Push octet by octet; give after how many octets each piece came."""
    stream = FrameStream()
    found = []
    for at, octet in enumerate(octets + behind, 1):
        found += [at] * len(stream.push(bytes((octet,))))
    return found


def test_a_frame_is_given_as_soon_as_it_is_whole() -> None:
    """Where it has no trailer, only what follows shows that: an octet that begins none, or four that may be one."""
    for frame in WHOLE:
        assert given_at(frame) == [len(frame)], frame
        stream = FrameStream()
        assert (stream.push(frame), stream.held) == ([frame], 0)
    for frame in PARTS[:2]:
        assert given_at(frame) == []
        assert given_at(frame, b"\x32") == [len(frame) + 1, len(frame) + 1]
        for follows in (b"\x72\2\0\1", b"\x72\1\0\0", b"\x72\2\1\0"):
            assert given_at(frame, follows) == [len(frame) + 4]
        assert given_at(frame, b"\x72\2\0\0") == [len(frame) + 4]
        stream = FrameStream()
        assert (stream.push(frame), stream.held) == ([], len(frame))
        assert (stream.push(b"\x72\2"), stream.held) == ([], len(frame) + 2)
        assert stream.push(b"\0\1") == [frame]
        assert stream.held == 4


def test_frames_cut_anywhere_are_the_same() -> None:
    octets = b"".join(WHOLE + PARTS)
    for cut in range(1, len(octets)):
        stream = FrameStream()
        assert [*stream.push(octets[:cut]), *stream.push(octets[cut:])] == WHOLE + PARTS, cut


def test_events_and_keep_alives_have_no_trailer() -> None:
    follows = framed(asked(1))
    for frame in (KEEP_ALIVE, event(7), event(7, b"LOGOUT"), b"\x72\4\0\1x"):
        assert FrameStream().push(frame + b"\x72\2\0\0") == [frame]
        assert FrameStream().push(frame + follows) == [frame, follows]
    assert FrameStream().push(b"\x72\xff\7\xff" + follows) == [b"\x72\xff\7\xff", follows]


@pytest.mark.parametrize(
    "junk", [b"\0", b"\0\0\0", b"\0\x72", b"\0\x72\2", b"\0\x72\2\0\1", b"\0\x72\5\0\1x\x72\5\0\0"]
)
def test_behind_anything_the_next_whole_frame_is_found(junk: bytes) -> None:
    """Also the shortest one; a frame without its trailer is not certain enough."""
    for frame in (framed(b"\x31"), framed(asked(1)), framed(told(1), 3), framed(notified(), 1)):
        assert FrameStream().push(junk + frame) == [junk, frame], (junk, frame)
        assert FrameStream().push(junk + frame + framed(asked(2))) == [junk, frame, framed(asked(2))]
        assert FrameStream().push(junk + frame[:-1]) == [junk + frame[:-1]]
        assert FrameStream().push(junk + frame[:-4] + b"behind it") == [junk + frame[:-4] + b"behind it"]


def test_a_frame_that_does_not_end_gives_way_to_a_whole_one() -> None:
    """Only to a whole one, and only if it lacks something by its own length."""
    whole = framed(asked(1))
    for begun in (b"\x72", b"\x72\2\0", b"\x72\2\0\x20abc"):
        stream = FrameStream()
        assert stream.push(begun) == []
        assert (stream.push(whole), stream.held) == ([begun, whole], 0)
    stream = FrameStream()
    assert stream.push(b"\x72\2\0\x20abc") == []
    assert stream.push(whole[:-1]) == []  # its first octets may belong to the other
    stream = FrameStream()
    assert stream.push(b"\x72\2\0\3abc") == []
    assert stream.push(whole) == [b"\x72\2\0\3abc", whole]


def test_of_two_frames_without_data_the_second_is_the_trailer() -> None:
    empty = b"\x72\2\0\0"
    for cut in range(1, 8):
        stream = FrameStream()
        assert [*stream.push((empty * 2)[:cut]), *stream.push((empty * 2)[cut:])] == [empty * 2], cut


def test_octets_of_a_frame_may_look_like_a_frame() -> None:
    """It lacks them by its own length, and they do not fill exactly what they would be."""
    frame = framed(b"x" * 10 + KEEP_ALIVE[:3] + b"\x72\2" + b"y" * 10)
    for cut in range(1, len(frame)):
        stream = FrameStream()
        assert [*stream.push(frame[:cut]), *stream.push(frame[cut:])] == [frame], cut
