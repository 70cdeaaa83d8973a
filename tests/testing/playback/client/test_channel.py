"""The client's end of a connection: octets in any pieces, any octets at all, and every way to end."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.online.net.addresses import Place
from dissect.testing.golden.model import Link
from dissect.testing.playback.client.channel import Channel, UnreachableError, connect
from dissect.testing.playback.client.record import Record
from tests.properties import messages
from tests.properties.messages import dt, tpkt
from tests.testing.playback.client.support import free_port

CR = messages.connect(0xE0)[4:]
CC = messages.connect(0xD0)
JOB = messages.setup(messages.JOB, 1)


def soon(seconds: float = 20) -> float:
    return time.monotonic() + seconds


@contextmanager
def connected() -> Iterator[tuple[Channel, socket.socket, Record]]:
    """Return a channel and the server's end of it."""
    record = Record("server")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        one = connect([Place(socket.AF_INET, listener.getsockname())], 20)
        theirs, _ = listener.accept()
        theirs.settimeout(20)
        with one, theirs:
            yield Channel(one, record), theirs, record


def drain(one: socket.socket) -> None:
    """Read up to the end."""
    while one.recv(4096):
        pass


def link_of(record: Record) -> Link:
    (one,) = record.finish().links
    return one


@pytest.mark.parametrize("size", [1, 2, 5, 22, 1000])
def test_messages_arrive_in_whatever_pieces(size: int) -> None:
    octets = CC + dt(JOB) + messages.fragments(JOB, [3, 4]) + dt(JOB)
    with connected() as (channel, theirs, _):
        for at in range(0, len(octets), size):
            theirs.sendall(octets[at : at + size])
            time.sleep(0)
        assert channel.open(CR, soon())
        assert [channel.receive(soon()) for _ in range(3)] == [JOB, JOB, JOB]
        theirs.sendall(b"\x03\0")
        assert channel.receive(soon(0.02)) is None
        assert not channel.ended
        channel.reset()


def test_what_is_sent_keeps_to_the_smaller_tpdu_size() -> None:
    with connected() as (channel, theirs, record):
        theirs.sendall(messages.connect(0xD0, size=7))
        assert channel.open(CR, soon())
        assert channel.send(JOB + bytes(300))
        theirs.recv(len(CR) + 4, socket.MSG_WAITALL)
        sizes = []
        data = b""
        while len(data) < len(JOB) + 300:
            head = theirs.recv(4, socket.MSG_WAITALL)
            body = theirs.recv(int.from_bytes(head[2:], "big") - 4, socket.MSG_WAITALL)
            sizes.append(len(body))
            data += body[3:]
        assert data == JOB + bytes(300)
        assert max(sizes) == 128
        channel.reset()
        assert link_of(record).tpdu_size == 128


def test_no_confirmation_and_a_refusal_are_no_connection() -> None:
    with connected() as (channel, _, _record):
        assert not channel.open(CR, soon(0.02))
        assert not channel.refused
        channel.reset()
    with connected() as (channel, theirs, record):
        theirs.sendall(messages.disconnect(1))
        assert not channel.open(CR, soon())
        assert channel.refused
        assert not channel.send(JOB)
        channel.close(soon(0.02))
        assert link_of(record).refused


@pytest.mark.parametrize(
    ("how", "ended", "told"),
    [
        ("close", "closed by the server", ("fin", "server")),
        ("reset", "reset by the server", ("reset", "server")),
        ("disconnect", "ended by the server (DR)", ("disconnect", "server")),
    ],
)
def test_the_end_is_told_as_the_server_makes_it(how: str, ended: str, told: tuple[str, str]) -> None:
    with connected() as (channel, theirs, record):
        theirs.sendall(CC)
        assert channel.open(CR, soon())
        theirs.recv(len(CR) + 4, socket.MSG_WAITALL)
        if how == "disconnect":
            theirs.sendall(messages.disconnect())
        if how == "reset":
            theirs.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        if how != "disconnect":
            theirs.close()
        assert channel.receive(soon()) is None
        assert channel.ended == ended
        assert not channel.send(JOB)
        channel.close(soon(0.02))
        one = link_of(record)
        assert (one.ended, one.ended_by) == told


@pytest.mark.parametrize("reset", [False, True])
def test_our_own_end_arrives_and_is_recorded(reset: bool) -> None:
    with connected() as (channel, theirs, record):
        theirs.sendall(CC)
        assert channel.open(CR, soon())
        if reset:
            channel.reset()
            with pytest.raises(ConnectionResetError):
                drain(theirs)
        else:
            channel.close(soon(0.02))
            assert theirs.recv(len(CR) + 5, socket.MSG_WAITALL) == tpkt(CR)
        one = link_of(record)
        assert (one.ended, one.ended_by) == ("reset" if reset else "fin", "client")


@settings(max_examples=40)
@given(st.binary(max_size=60), st.booleans())
def test_no_octets_of_a_server_raise(octets: bytes, framed: bool) -> None:
    with connected() as (channel, theirs, record):
        theirs.sendall(CC + (tpkt(octets) if framed else octets))
        theirs.shutdown(socket.SHUT_WR)
        channel.open(CR, soon())
        while channel.receive(soon()) is not None:
            pass
        assert channel.ended
        channel.close(soon())
        assert len(record.finish().links) == 1


def test_every_place_is_tried_and_the_last_reason_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        places = [Place(socket.AF_INET, ("127.0.0.1", free_port())), Place(socket.AF_INET, listener.getsockname())]
        with connect(places, 20) as one:
            assert one.getpeername() == listener.getsockname()
    with pytest.raises(UnreachableError, match="Connection refused"):
        connect(places[:1], 20)
    with pytest.raises(UnreachableError, match="nowhere to connect to"):
        connect([], 20)


def test_a_server_that_says_more_than_is_looked_at_has_to_wait_and_nothing_is_lost() -> None:
    """More than may be held here and in both systems: it arrives whole once it is looked at."""
    message = messages.userdata(0, 0, 4, 5, bytes(60_000))
    count = 400
    with connected() as (channel, theirs, _):
        theirs.sendall(CC)
        assert channel.open(CR, soon())
        sender = threading.Thread(target=theirs.sendall, args=(dt(message) * count,), daemon=True)
        sender.start()
        while not channel._paused:
            assert channel._read(soon())
        held = channel._held
        for _ in range(50):
            channel.poll()
        assert channel._held == held < (2 << 20)
        for _ in range(count):
            assert channel.receive(soon()) == message
        sender.join(20)


def test_messages_that_wait_do_not_keep_a_connection_from_its_end() -> None:
    message = messages.userdata(0, 0, 4, 5, bytes(60_000))
    with connected() as (channel, theirs, record):
        theirs.sendall(CC)
        assert channel.open(CR, soon())

        def flood() -> None:
            theirs.sendall(dt(message) * 100)
            theirs.shutdown(socket.SHUT_WR)

        sender = threading.Thread(target=flood, daemon=True)
        sender.start()
        while not channel._paused:
            assert channel._read(soon())
        channel.close(soon())
        sender.join(20)
        assert channel.ended == "closed by the server"
    assert len(link_of(record).transactions) == 100
