from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.assembly import MAX_FRAMES, MAX_PDU, PlusAssembler, is_notification
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.value_tables import DINT
from dissect.protocols.s7plus.values import Value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import KEEP_ALIVE, SET_VARIABLE, asked, event, framed, notified, told


def test_a_frame_with_a_trailer_is_a_pdu() -> None:
    assembler = PlusAssembler()
    assert assembler.push(framed(asked(1))) == framed(asked(1))
    assert assembler.parts is None


def test_frames_until_the_trailer_are_one_pdu() -> None:
    assembler = PlusAssembler()
    frames = [framed(told(1, body=bytes(50)), trailer=False), framed(b"abc", trailer=False), framed(b"def")]
    assert [assembler.push(frame) for frame in frames] == [None, None, b"".join(frames)]
    assert assembler.push(framed(asked(2))) == framed(asked(2))


def test_events_and_keep_alives_stand_between_frames() -> None:
    assembler = PlusAssembler()
    first, last = framed(told(1), trailer=False), framed(b"rest")
    assert assembler.push(first) is None
    assert assembler.push(KEEP_ALIVE) == KEEP_ALIVE
    assert assembler.push(event(5)) == event(5)
    assert assembler.push(last) == first + last


@pytest.mark.parametrize(
    ("frame", "another"),
    [
        (framed(asked(2), trailer=False), True),
        (framed(told(2), trailer=False), True),
        (framed(notified()), True),
        (framed(b"the rest", 3), True),  # another version
        (framed(b"the rest"), False),
        (framed(asked(2, 0x9999)), False),  # no function that is known
        (framed(b"\x31\x00\x01" + asked(2)[3:]), False),  # both words beside the function are 0 where a PDU begins
        (framed(asked(2)[:5] + b"\x01\x00" + asked(2)[7:]), False),
        (framed(notified(subscription=0x70000000)), False),
        (framed(notified(subscription=0x70000001)), True),
        (framed(b"", trailer=False), False),
        (KEEP_ALIVE, False),
        (event(5), False),
    ],
)
def test_what_begins_another_pdu_interrupts_the_one_at_hand(frame: bytes, another: bool) -> None:
    assembler = PlusAssembler()
    assert not assembler.interrupted(frame)
    assembler.push(framed(told(1), trailer=False))
    assert assembler.interrupted(frame) == another


def whole_request() -> bytes:
    return asked(1, SET_VARIABLE, body=bodies.set_variable(52, [2167], Value(0, DINT, 1), -1))


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_trailer_may_come_alone(version: int) -> None:
    assembler = PlusAssembler()
    frame, trailer = framed(whole_request(), version, trailer=False), bytes((0x72, version, 0, 0))
    assert assembler.push(frame) is None
    assert assembler.push(trailer) == frame + trailer
    assert assembler.parts is None


@pytest.mark.parametrize("version", [1, 2])
def test_an_empty_frame_within_a_pdu_is_not_its_trailer(version: int) -> None:
    data, empty = whole_request(), bytes((0x72, version, 0, 0))
    for place in range(1, len(data) - 4):
        assembler = PlusAssembler()
        first, last = framed(data[:place], version, trailer=False), framed(data[place:], version)
        assert [assembler.push(one) for one in (first, empty, empty)] == [None] * 3
        assert assembler.passed
        assert not assembler.interrupted(last)
        assert assembler.push(last) == first + last
        assert not assembler.passed


def test_empty_frames_without_end_are_bounded() -> None:
    assembler = PlusAssembler()
    frame, empty = framed(whole_request()[:20], trailer=False), b"\x72\2\0\0"
    assert assembler.push(frame) is None
    told_of = [assembler.push(empty) for _ in range(65)]
    assert told_of == [None] * 64 + [frame + empty]


def test_a_pdu_may_begin_with_empty_frames() -> None:
    for version in (1, 2, 3):
        assembler = PlusAssembler()
        empty, whole = framed(b"", version, trailer=False), framed(whole_request(), version)
        assert assembler.push(empty) is None
        assert not assembler.interrupted(whole)
        joined = assembler.push(whole)
        assert joined == empty + whole
        assert parse_plus(joined).data == whole_request()


def test_what_is_damaged_ends_what_is_open() -> None:
    assembler = PlusAssembler()
    assembler.push(framed(told(1), trailer=False))
    assert assembler.push(b"\x72\x02\x00\x20short") == framed(told(1), trailer=False) + b"\x72\x02\x00\x20short"


def test_a_long_pdu_is_kept_in_part_and_the_rest_counted() -> None:
    assembler = PlusAssembler(65536)
    first, more, last = framed(told(1), trailer=False), framed(bytes(30_000), trailer=False), framed(b"end")
    assert assembler.push(first) is None
    for _ in range(9):
        assert assembler.push(more) is None
        assert assembler.parts is not None
        assert len(assembler.parts) <= 65536
    whole = assembler.push(last)
    assert whole == first + more + more
    assert assembler.left_out == 7 * len(more) + len(last)
    assert parse_plus(whole, cut=True).sequence == 1
    assert assembler.push(framed(asked(2))) == framed(asked(2))
    assert assembler.left_out == 0


def test_a_pdu_of_very_many_frames_takes_bounded_memory() -> None:
    """A frame costs some hundred octets when the PDU is read, and needs to carry only one: 8 MiB hold 1.6 million of them."""
    assembler = PlusAssembler()
    first, more, last = framed(told(1), trailer=False), framed(b"x", trailer=False), framed(b"end")
    assembler.push(first)
    for _ in range(MAX_FRAMES + 9):
        assembler.push(more)
    whole = assembler.push(last)
    assert whole is not None
    assert whole == first + more * (MAX_FRAMES - 1)
    assert assembler.left_out == 10 * len(more) + len(last)
    pdu = parse_plus(whole, cut=True)
    assert (pdu.frames, pdu.sequence, pdu.place(len(pdu.data) - 1)) == (MAX_FRAMES, 1, len(whole) - 1)
    # The next one begins to count anew.
    for frame in (first, more, last):
        whole = assembler.push(frame)
    assert (whole, assembler.left_out) == (first + more + last, 0)


def test_finish_gives_what_there_is() -> None:
    assembler = PlusAssembler()
    assert assembler.finish() == b""
    first = framed(told(1), trailer=False)
    assembler.push(first)
    assert assembler.finish() == first
    assert assembler.push(framed(asked(2))) == framed(asked(2))


@given(st.lists(st.binary(max_size=20)))
def test_never_raises(tsdus: list[bytes]) -> None:
    assembler = PlusAssembler()
    for tsdu in tsdus:
        whole = assembler.push(b"\x72" + tsdu)
        assert whole is None or whole[:1] == b"\x72"


def test_a_frame_that_goes_on_is_not_taken_for_a_notification() -> None:
    """Compressed blocks hold any octets: one frame in some hundred begins with 0x33 and the id of a subscription."""
    assembler = PlusAssembler()
    assembler.push(framed(told(1, body=bytes(50)), trailer=False))
    assert not assembler.interrupted(framed(b"\x33\x71" + bytes(range(1, 60))))
    assert assembler.interrupted(framed(notified()))


@pytest.mark.parametrize(
    ("octets", "is_one"),
    [
        (framed(notified(), 2), True),
        (framed(notified(), 3), True),
        (framed(notified(subscription=5), 3), True),  # of old firmware
        (framed(notified()[:11], 3), True),
        (framed(notified()[:10], 3), False),
        (framed(b"\x33" + bytes(20), 3), False),
        (framed(b"\x33" + bytes(20), 1), True),  # version 1 has nothing that could be checked
        (b"\x72\2\0", True),
        (framed(notified(), 3, trailer=False), True),
    ],
)
def test_a_notification_is_known_by_what_follows_its_subscription(octets: bytes, is_one: bool) -> None:
    assert is_notification(octets) == is_one


def test_each_octet_behind_the_subscription_counts() -> None:
    data = notified()
    for version in (2, 3):
        for at in range(1, len(data)):
            changed = data[:at] + bytes((data[at] ^ 1,)) + data[at + 1 :]
            frames = framed(changed[:7], version, trailer=False) + framed(changed[7:], version)
            assert is_notification(framed(changed, version)) == is_notification(frames) == (not 5 <= at < 11)


@pytest.mark.parametrize("behind", [b"", bytes(1), bytes(2), b"\x72", b"\x72\2\0"])
def test_a_tsdu_without_a_header_is_given_on(behind: bytes) -> None:
    assembler = PlusAssembler()
    assembler.push(framed(told(1), trailer=False))
    assert assembler.push(behind) == behind
    assert assembler.parts is not None
    assert bytes(assembler.parts) == framed(told(1), trailer=False)
    assert not assembler.interrupted(behind)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(
    ("data", "whole"),
    [
        (asked(1, 0x05B3, body=b"InitSSL" + bytes(3)), True),  # nobody knows its body: three zeros end it
        (asked(1, 0x05B3, body=b"InitSSL" + bytes(2)), False),
        (b"any octets" + bytes(4), False),
        (whole_request()[:-5], False),
    ],
)
def test_contents_decide_whether_a_frame_without_data_is_the_trailer(version: int, data: bytes, whole: bool) -> None:
    assembler = PlusAssembler()
    frame, empty = framed(data, version, trailer=False), bytes((0x72, version, 0, 0))
    assert assembler.push(frame) is None
    assert assembler.push(empty) == (frame + empty if whole else None)
    assert assembler.passed != whole


def test_a_digest_ends_contents_as_zeros_do() -> None:
    for end, whole in ((b"\7\x20" + bytes(range(32)), True), (b"\7\x20" + bytes(range(31)), False)):
        assembler = PlusAssembler()
        frame = framed(whole_request()[:-4] + end, trailer=False)
        assert assembler.push(frame) is None
        assert (assembler.push(b"\x72\2\0\0") is not None) == whole


def test_a_large_pdu_is_not_examined_for_empty_frames() -> None:
    """It is over with the first one, whatever it contains."""
    for size, whole in ((1 << 16, False), ((1 << 16) + 1, True)):
        assembler = PlusAssembler()
        frames = [framed(whole_request()[:20] + bytes(30_000), trailer=False)]
        frames.append(framed(b"\1" * (size - len(frames[0]) - 8), trailer=False))
        assert [assembler.push(frame) for frame in frames] == [None, None]
        assert (assembler.push(b"\x72\2\0\0") is not None) == whole, size


def test_a_pdu_of_just_the_allowed_size_is_kept() -> None:
    first, last = framed(told(1), trailer=False), framed(b"the end")
    for most, kept in ((len(first) + len(last), True), (len(first) + len(last) - 1, False)):
        assembler = PlusAssembler(most)
        assembler.push(first)
        assert assembler.push(last) == (first + last if kept else first)
        assert assembler.left_out == (0 if kept else len(last))


def test_an_empty_frame_of_version_3_has_a_digest() -> None:
    """Frames without data before the first one that has some do not end what they begin; one octet of data does."""
    for data, interrupts in ((b"", False), (b"\x31", True)):
        assembler = PlusAssembler()
        assembler.push(framed(data, 3, trailer=False))
        assert assembler.interrupted(framed(asked(2), 3)) == interrupts
        assembler.push(framed(b"", 3, trailer=False))
        assert assembler.interrupted(framed(asked(2), 3)) == interrupts
        assembler.push(framed(b"more", 3, trailer=False))
        assert assembler.interrupted(framed(asked(2), 3))


def test_after_a_pdu_nothing_of_it_is_left() -> None:
    assembler = PlusAssembler(200)
    assert (assembler.asked, assembler.notified, assembler.left_out, assembler.holed) == (-1, -1, 0, False)
    first, more, last = framed(told(1), trailer=False), framed(bytes(150), trailer=False), framed(b"end")
    for _ in range(2):
        assert [assembler.push(one) for one in (first, more)] == [None, None]
        assert assembler.push(framed(bytes(99), trailer=False)) is None
        assert assembler.left_out == 103
        assert assembler.push(last) == first + more  # what follows a frame that is left out is left out, too
        assert assembler.left_out == 103 + len(last)
        assert assembler.parts is None
    # Neither are frames without data that were passed.
    for _ in range(40):
        half, empty = whole_request()[:20], b"\x72\2\0\0"
        assert [assembler.push(one) for one in (framed(half, trailer=False), empty, empty)] == [None] * 3
        assert assembler.push(framed(whole_request()[20:])) is not None


def test_eight_mebibytes_of_a_pdu_are_kept() -> None:
    """In as many frames as the smallest TPDUs, of 128 octets, need for that."""
    assert MAX_FRAMES * 128 == MAX_PDU == 8 << 20
    frame = framed(told(1, body=bytes((1 << 15) - 14)), trailer=False)
    assert len(frame) == 1 << 15
    for last, left_out in ((frame, 0), (framed(told(1, body=bytes((1 << 15) - 13)), trailer=False), (1 << 15) + 1)):
        assembler = PlusAssembler()
        for _ in range((8 << 20 >> 15) - 1):
            assert assembler.push(frame) is None
        assert assembler.push(last) is None
        assert assembler.left_out == left_out
        assert len(assembler.finish()) == (8 << 20) - (1 << 15 if left_out else 0)
