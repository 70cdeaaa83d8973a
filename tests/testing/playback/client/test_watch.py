"""All sockets of a replay are looked at together."""

from __future__ import annotations

import socket
import threading
import time
from functools import partial

from dissect.testing.playback.client.watch import Watch


def test_what_comes_anywhere_is_taken_and_nothing_is_waited_for_that_is_there() -> None:
    watch = Watch()
    ends = [socket.socketpair() for _ in range(3)]
    taken: list[int] = []
    for number, (one, _) in enumerate(ends):
        watch.add(one, partial(taken.append, number))
    assert not watch.read(0)
    ends[2][1].sendall(b"x")
    ends[0][1].sendall(b"x")
    assert watch.read(time.monotonic() + 20)
    assert sorted(taken) == [0, 2]
    watch.remove(ends[2][0])
    taken.clear()
    assert watch.read(0)
    assert taken == [0]
    for one, other in ends:
        one.close()
        other.close()
    watch.close()


def test_what_is_looked_at_no_more_may_be_removed_again() -> None:
    watch = Watch()
    one, other = socket.socketpair()
    watch.add(one, lambda: None)
    watch.remove(one)
    watch.remove(one)
    one.close()
    watch.remove(one)
    other.close()
    watch.close()


def test_a_pause_takes_what_comes_and_ends_when_it_is_to() -> None:
    watch = Watch()
    one, other = socket.socketpair()
    taken: list[bytes] = []
    watch.add(one, lambda: taken.append(one.recv(100)))
    other.sendall(b"x")
    watch.sleep(time.monotonic() + 3600, lambda: bool(taken))
    assert taken == [b"x"]
    began = time.monotonic()
    watch.sleep(began + 0.02, lambda: False)
    assert time.monotonic() >= began + 0.02
    one.close()
    other.close()
    watch.close()


def test_once_halted_nothing_is_waited_for() -> None:
    watch = Watch()
    one, other = socket.socketpair()
    watch.add(one, lambda: None)
    begun = time.monotonic()
    threading.Timer(0.05, watch.halt).start()
    assert not watch.read(begun + 60)
    watch.sleep(begun + 60, lambda: False)
    assert time.monotonic() < begun + 30
    one.close()
    other.close()
    watch.close()
