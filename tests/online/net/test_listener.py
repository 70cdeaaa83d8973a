"""The door by itself: who is let in, who waits, how it is woken and shut."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from dissect.online.net.addresses import Address, ProxyError, places_to_listen
from dissect.online.net.listener import Accepted, Listener
from tests.online.proxy.support import eventually

LOOPBACK = "127.0.0.1"
WAIT_S = 20


@contextlib.contextmanager
def made(most: int = 10) -> Iterator[tuple[Listener, list[str]]]:
    told: list[str] = []
    door = Listener(places_to_listen(Address(LOOPBACK, 0), allow_remote=False), most, told.append)
    try:
        yield door, told
    finally:
        door.close()
        door.close()


def connected(door: Listener) -> socket.socket:
    return socket.create_connection(door.listening[0].address[:2], WAIT_S)


def happened(door: Listener, patience: float = WAIT_S) -> list[tuple[Any, int]]:
    return list(door.wait(patience))


def test_who_comes_is_let_in_and_told_with_its_end() -> None:
    with made() as (door, told), connected(door) as client:
        ((visitor, events),) = happened(door)
        assert isinstance(visitor, Accepted)
        with visitor.socket as accepted:
            assert (visitor.name, events) == (client.getsockname(), 0)
            assert accepted.getblocking() is False
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
        assert told == []


def test_sockets_of_the_owner_are_told_by_what_they_were_registered_with() -> None:
    one, other = socket.socketpair()
    read, write = selectors.EVENT_READ, selectors.EVENT_WRITE
    with made() as (door, _), one, other:
        door.watch(one, 0, read, "one")
        assert happened(door, 0) == []
        other.send(b"x")
        assert happened(door) == [("one", read)]
        door.watch(one, read, write, "as writer")
        assert happened(door) == [("as writer", write)]
        door.watch(one, write, 0, "nothing")
        assert happened(door, 0) == []
        door.unwatch(one)  # it is not watched


def test_more_than_there_is_room_for_wait_until_somebody_is_gone() -> None:
    with made(most=2) as (door, told), contextlib.ExitStack() as held:
        for inside in (1, 2):
            held.enter_context(connected(door))
            ((visitor, _),) = happened(door)
            held.enter_context(visitor.socket)
            door.count(inside)
        assert (door.is_open, told) == (False, ["2 clients are connected; more must wait until one disconnects"])
        held.enter_context(connected(door))
        assert happened(door, 0.05) == []
        door.count(2)
        assert not door.is_open
        door.count(1)
        ((visitor, _),) = happened(door)
        held.enter_context(visitor.socket)
        assert len(told) == 1


def test_who_is_woken_finds_that_it_is_to_stop() -> None:
    with made() as (door, _):
        seen: list[Any] = []
        waiting = threading.Thread(target=lambda: seen.extend(door.wait(None)))
        waiting.start()
        assert not door.stopping
        door.stop()
        waiting.join(WAIT_S)
        assert not waiting.is_alive()
        assert (door.stopping, seen) == (True, [])
    door.stop()


def test_where_it_cannot_listen_nothing_stays_open() -> None:
    with made() as (door, _):
        taken = places_to_listen(Address(LOOPBACK, 0), allow_remote=False) + door.listening
        with pytest.raises(ProxyError, match="cannot listen on"):
            Listener(taken, 1, print)
    for place in door.listening:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(place.address[:2], WAIT_S)


def test_a_client_that_is_gone_again_is_nobody() -> None:
    with made() as (door, told):
        connected(door).close()
        with connected(door):
            seen: list[Any] = []

            def both() -> bool:
                seen.extend(happened(door, 0.05))
                return len(seen) == 2

            eventually(both)
        for visitor, _ in seen:
            visitor.socket.close()
        assert told == []
