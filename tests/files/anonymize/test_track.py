"""One direction of a connection: ranges, replacements, sequence numbers, bounds; what is not known becomes zeros."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.files.anonymize import track as tracks
from dissect.files.anonymize.track import Room, Track
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint

START = 0xFFFFFFF0  # wraps within the first octets


def made(room: Room | None = None, start: int = START) -> Track:
    tcp = TcpConnection(Endpoint(bytes(4), 1), Endpoint(bytes(4), 2), 0, 1, 0)
    tcp.streams[0].start(start)
    return Track(tcp, tcp.streams[0], room or Room())


def rendered(track: Track, at: int, octets: bytes) -> bytes:
    return track.render((START + at) & 0xFFFFFFFF, octets)[0]


@given(st.lists(st.integers(1, 12), min_size=1, max_size=12))
def test_any_segmentation_gives_the_same(sizes: list[int]) -> None:
    track = made()
    track.keep(0, 10)
    track.put(10, b"NEW")
    track.keep(20, 22)
    track.keep(22, 30)
    track.settle()
    original = bytes(range(65, 105))
    wanted = original[:10] + b"NEW" + bytes(7) + original[20:30] + bytes(10)
    got, at = b"", 0
    for size in [*sizes, 40]:
        got += rendered(track, at, original[at : at + size])
        at = min(at + size, 40)
    assert got == wanted
    assert rendered(track, 5, original[5:25]) == wanted[5:25]


def test_before_the_beginning_nothing_is_known() -> None:
    track = made()
    track.keep(0, 4)
    track.settle()
    assert rendered(track, -4, b"oldsnews") == bytes(4) + b"news"


def test_what_contradicts_itself_is_not_believed() -> None:
    track = made()
    track.keep(4, 8)
    track.keep(0, 2)
    track.put(10, b"AB")
    track.put(11, b"C")
    track.put(-1, b"D")
    track.settle()
    assert rendered(track, 0, b"abcdefghijkl") == bytes(4) + b"efgh" + bytes(2) + b"AB"


def test_a_copy_shows_only_what_the_first_one_had() -> None:
    track = made()
    track.keep(0, 8)
    track.settle()
    assert rendered(track, 0, b"abcdefgh") == b"abcdefgh"
    assert rendered(track, 2, b"cdXfgh") == b"cd\0fgh"


def test_a_copy_of_what_is_forgotten_shows_nothing() -> None:
    room = Room(4)
    one, other = made(room), made(room)
    for track in (one, other):
        track.keep(0, 8)
        track.settle()
    rendered(one, 0, b"abcd")
    rendered(other, 0, b"abcd")
    assert rendered(one, 2, b"cdefgh") == bytes(2) + b"efgh"


def test_many_segments_are_not_all_remembered() -> None:
    track = made()
    track.keep(0, 1000)
    track.settle()
    for at in range(tracks.MAX_RECENT + 1):
        assert rendered(track, at, b"x") == b"x"
    assert rendered(track, 0, b"xx") == b"\0x"


def test_without_room_nothing_is_kept_and_that_is_known() -> None:
    room = Room()
    room.ranges = 1
    track = made(room)
    track.keep(0, 2)
    assert not track.full
    track.keep(4, 6)
    assert track.full
    track.settle()
    assert rendered(track, 0, b"abcdef") == b"ab" + bytes(4)
    room.ranges, room.octets = 5, 10
    other = made(room)
    other.put(0, b"12345")
    assert other.full
