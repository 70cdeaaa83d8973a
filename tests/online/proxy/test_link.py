"""What is read of a socket before it is said to be broken."""

from __future__ import annotations

import errno
import select
import socket

import pytest

from dissect.online.net.sockets import prepare
from dissect.online.proxy.relay import Link, ResetError, trouble
from tests.online.proxy.support import eventually, listening, port_of_nobody, received, reset


def ends() -> tuple[socket.socket, socket.socket]:
    with listening() as server:
        one = socket.create_connection(server.getsockname(), 20)
        other, _ = server.accept()
    prepare(other)
    return one, other


def test_octets_before_a_reset_are_read_before_it_is_told() -> None:
    mine, theirs = ends()
    with theirs:
        mine.sendall(b"last words")
        reset(mine)
        here = select.poll()
        here.register(theirs, 0)
        assert here.poll(20_000)  # the reset
        assert trouble(theirs) == 0
        link = Link(1, theirs, theirs)
        assert link.ends[0].read() == b"last words"
        with pytest.raises(ResetError):
            link.ends[0].read()


def test_nothing_is_wrong_with_silence_and_with_an_end() -> None:
    mine, theirs = ends()
    with theirs:
        assert trouble(theirs) == 0
        mine.close()
        assert received_end(theirs)
        assert trouble(theirs) == 0


def received_end(one: socket.socket) -> bool:
    one.settimeout(20)
    try:
        return received(one) == b""
    finally:
        one.setblocking(False)


def test_what_is_wrong_is_told_by_its_number() -> None:
    mine, theirs = ends()
    with theirs:
        reset(mine)
        eventually(lambda: trouble(theirs) == errno.ECONNRESET)
    with socket.socket() as one:
        one.setblocking(False)
        one.connect_ex(("127.0.0.1", port_of_nobody()))
        eventually(lambda: trouble(one) not in {0, errno.ENOTCONN})
    with socket.socket() as one:
        assert trouble(one) == errno.ENOTCONN
