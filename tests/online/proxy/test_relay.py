"""The relay with plain sockets at both ends: octets, back-pressure, half-closes, resets, servers that are not there."""

from __future__ import annotations

import contextlib
import random
import resource
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from dissect.online.net import listener as door
from dissect.online.net.addresses import Address, Place, ProxyError, places_to_listen
from dissect.online.proxy import relay as module
from dissect.online.proxy.relay import PIECE, Relay
from dissect.online.proxy.tap import CLOSED, GONE, OPENED, REFUSED, RESET, SENT, UNANSWERED, Passed, Tap
from tests.online.proxy.support import (
    LOOPBACK,
    at,
    connected,
    eventually,
    has_ipv6,
    listening,
    pair,
    port_of,
    port_of_nobody,
    received,
    relaying,
    reset,
    running,
)

BOTH = pytest.mark.parametrize("client_does_it", [True, False], ids=["client", "server"])


def drained(tap: Tap) -> list[Passed]:
    told = []
    while (passed := tap.take(0)) is not None:
        told.append(passed)
    return told


def kinds(tap: Tap) -> list[tuple[str, int]]:
    return [(passed.kind, passed.side) for passed in drained(tap)]


def test_octets_pass_as_they_are_in_both_directions_at_once() -> None:
    tap = Tap()
    contents = [random.Random(side).randbytes(3_000_000 + side) for side in (0, 1)]
    with pair(tap) as (relay, client, server):
        ends = (client, server)
        seen = [b"", b""]

        def send(side: int) -> None:
            ends[side].sendall(contents[side])
            ends[side].shutdown(socket.SHUT_WR)

        def receive(side: int) -> None:
            seen[side] = received(ends[1 - side])

        threads = [threading.Thread(target=work, args=(side,)) for work in (send, receive) for side in (0, 1)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        eventually(lambda: relay.active == 0)
        assert relay.octets == [3_000_000, 3_000_001]
    assert seen == contents
    told = drained(tap)
    for side in (0, 1):
        assert b"".join([one.octets for one in told if one.kind == SENT and one.side == side]) == contents[side]
    assert max(len(one.octets) for one in told) <= PIECE
    assert [one.kind for one in told if one.kind != SENT] == [OPENED, CLOSED, CLOSED, GONE]


@BOTH
def test_a_half_close_is_passed_on_and_the_other_half_stays_open(client_does_it: bool) -> None:
    tap = Tap()
    with pair(tap) as (relay, client, server):
        first, second = (client, server) if client_does_it else (server, client)
        first.sendall(b"last words")
        first.shutdown(socket.SHUT_WR)
        assert received(second) == b"last words"
        for _ in range(3):  # it lasts
            second.sendall(b"still here")
            assert first.recv(100) == b"still here"
        assert relay.active == 1
        second.close()
        assert received(first) == b""
        eventually(lambda: relay.active == 0)
    side = 0 if client_does_it else 1
    assert [told for told in kinds(tap) if told[0] != SENT] == [
        (OPENED, 0),
        (CLOSED, side),
        (CLOSED, 1 - side),
        (GONE, 0),
    ]


@BOTH
def test_a_reset_is_passed_on(client_does_it: bool) -> None:
    tap = Tap()
    with pair(tap) as (relay, client, server):
        first, second = (client, server) if client_does_it else (server, client)
        second.sendall(b"hello")
        assert first.recv(100) == b"hello"
        reset(first)
        with pytest.raises(ConnectionResetError):
            second.recv(100)
        eventually(lambda: relay.active == 0)
    assert kinds(tap)[2:] == [(RESET, 0 if client_does_it else 1), (GONE, 0)]


@BOTH
def test_octets_before_a_reset_arrive(client_does_it: bool) -> None:
    with pair() as (relay, client, server):
        first, second = (client, server) if client_does_it else (server, client)
        first.sendall(b"last words")
        reset(first)
        assert second.recv(100) == b"last words"
        with pytest.raises(ConnectionResetError):
            second.recv(100)
        eventually(lambda: relay.active == 0)


@BOTH
def test_a_reset_after_a_half_close_is_passed_on(client_does_it: bool) -> None:
    """Nothing is read from who has finished, so no event tells of it."""
    tap = Tap()
    with pair(tap) as (relay, client, server):
        first, second = (client, server) if client_does_it else (server, client)
        first.shutdown(socket.SHUT_WR)
        assert received(second) == b""
        reset(first)
        eventually(lambda: relay.active == 0)
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            second.sendall(bytes(1000))
    side = 0 if client_does_it else 1
    assert kinds(tap) == [(OPENED, 0), (CLOSED, side), (RESET, side), (GONE, 0)]


def stall(sender: socket.socket) -> int:
    """Send until nothing more is taken, also when what was taken has had time to move on; return how much it was."""
    sender.setblocking(False)
    sent, idle = 0, 0
    while idle < 10:
        before = sent
        with contextlib.suppress(BlockingIOError):
            while True:
                sent += sender.send(bytes(65536))
        idle = idle + 1 if sent == before else 0
        time.sleep(0.01)
    return sent


@BOTH
def test_who_reads_slowly_holds_up_who_sends(client_does_it: bool) -> None:
    """64 MiB would be taken at once if the relay kept what is not taken; the buffers of the system take some megabytes."""
    tap = Tap()
    tap.shut()
    with pair(tap) as (relay, client, server):
        sender, reader = (client, server) if client_does_it else (server, client)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        sent = stall(sender)
        (link,) = relay._links
        assert [len(end.waiting) for end in link.ends if end.waiting] != []
        assert all(len(end.waiting) <= PIECE for end in link.ends)
        assert sent < 64 * 1024 * 1024
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 32 * 1024
        sender.setblocking(True)
        sender.shutdown(socket.SHUT_WR)
        assert len(received(reader)) == sent


@BOTH
def test_a_stalled_direction_does_not_hold_up_the_other_one(client_does_it: bool) -> None:
    with pair() as (_, client, server):
        sender, reader = (client, server) if client_does_it else (server, client)
        stall(sender)
        reader.sendall(b"busy")
        sender.setblocking(True)
        sender.settimeout(20)
        assert sender.recv(100) == b"busy"


@BOTH
def test_a_reset_of_a_sender_that_is_held_up_is_passed_on(client_does_it: bool) -> None:
    with pair() as (relay, client, server):
        sender, reader = (client, server) if client_does_it else (server, client)
        stall(sender)
        reset(sender)
        eventually(lambda: relay.active == 0)
        with pytest.raises(ConnectionResetError):
            received(reader)


@BOTH
def test_a_reset_of_a_reader_that_holds_up_is_passed_on(client_does_it: bool) -> None:
    with pair() as (relay, client, server):
        sender, reader = (client, server) if client_does_it else (server, client)
        stall(sender)
        reset(reader)
        eventually(lambda: relay.active == 0)
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            stall(sender)


def test_urgent_octets_stay_in_their_place() -> None:
    with pair() as (_, client, server):
        client.sendall(b"ab")
        client.send(b"c", socket.MSG_OOB)
        client.sendall(b"de")
        client.shutdown(socket.SHUT_WR)
        assert received(server) == b"abcde"


def turned_away(relay: Relay) -> None:
    """Connect and read; the reset may come before the one or the other returns."""
    with connected(relay) as client:
        client.recv(100)


def test_a_server_that_is_not_there() -> None:
    tap = Tap()
    with relaying(at(port_of_nobody()), tap) as relay:
        for _ in (1, 2):
            with pytest.raises(ConnectionResetError):
                turned_away(relay)
        eventually(lambda: len(relay.problems) == 2 and relay.active == 0)
        assert (relay.connections, relay.failed) == (0, 2)
        texts = [problem.text for problem in relay.problems]
    assert len(texts) == 2
    assert "cannot be reached: Connection refused; client 127.0.0.1:" in texts[0]
    assert [told.kind for told in drained(tap)] == [REFUSED, REFUSED]


def test_the_next_address_of_a_server_is_tried() -> None:
    with listening() as server, relaying(at(port_of_nobody()) + at(port_of(server))) as relay:
        with connected(relay) as client:
            accepted, _ = server.accept()
            with accepted:
                client.sendall(b"here")
                assert accepted.recv(10) == b"here"
        assert (relay.connections, relay.failed) == (1, 0)


@contextlib.contextmanager
def deaf() -> Iterator[Place]:
    """A server that takes no connection and refuses none: its queue is full."""
    with listening(backlog=0) as server, contextlib.ExitStack() as held:
        for _ in range(3):
            one = held.enter_context(socket.socket())
            one.setblocking(False)
            one.connect_ex(server.getsockname())
        yield Place(socket.AF_INET, server.getsockname())


def test_a_server_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CONNECT_S", 0.1)
    tap = Tap()
    with deaf() as place, relaying([place], tap) as relay:
        with pytest.raises(ConnectionResetError):
            turned_away(relay)
        eventually(lambda: len(relay.problems) == 1)
        assert relay.failed == 1
        assert "cannot be reached: Connection timed out" in relay.problems[0].text
    assert [told.kind for told in drained(tap)] == [UNANSWERED]


def test_a_client_that_does_not_wait_for_a_server_that_does_not_answer() -> None:
    tap = Tap()
    with deaf() as place, relaying([place], tap) as relay:
        client = connected(relay)
        eventually(lambda: relay.active == 1)
        reset(client)
        eventually(lambda: relay.active == 0)
        assert relay.failed == 0


def test_many_clients_at_once() -> None:
    with listening() as server, relaying(at(port_of(server))) as relay, contextlib.ExitStack() as held:
        clients = [held.enter_context(connected(relay)) for _ in range(100)]
        servers = {}
        for client in clients:
            client.sendall(client.getsockname()[1].to_bytes(2, "big"))
        for _ in clients:
            accepted = held.enter_context(server.accept()[0])
            servers[int.from_bytes(accepted.recv(2), "big")] = accepted
        for client in clients:
            servers[client.getsockname()[1]].sendall(b"for " + client.getsockname()[1].to_bytes(2, "big"))
        for client in clients:
            assert client.recv(100) == b"for " + client.getsockname()[1].to_bytes(2, "big")
        assert (relay.connections, relay.active) == (100, 100)


def test_more_clients_than_there_is_room_for_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_LINKS", 3)
    with listening() as server, relaying(at(port_of(server))) as relay, contextlib.ExitStack() as held:
        clients = [held.enter_context(connected(relay)) for _ in range(3)]
        accepted = [held.enter_context(server.accept()[0]) for _ in clients]
        late = held.enter_context(connected(relay))  # in the queue of the system
        late.sendall(b"patient")
        eventually(lambda: len(relay.problems) == 1)
        assert "3 clients are connected; more must wait until one disconnects" in relay.problems[0].text
        eventually(lambda: relay.connections == 3)
        clients[0].close()
        accepted[0].close()
        last = held.enter_context(server.accept()[0])
        assert last.recv(100) == b"patient"


def test_no_more_sockets_is_told_and_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "PAUSE_S", 0.05)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with listening() as server, relaying(at(port_of(server))) as relay, contextlib.ExitStack() as held:
        client = held.enter_context(socket.socket())
        client.settimeout(20)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (client.fileno() + 1, hard))
            while True:  # holes below
                try:
                    held.enter_context(socket.socket())
                except OSError:
                    break
            client.connect(relay.listening[0].address)
            eventually(lambda: len(relay.problems) > 0)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        assert "accepting no clients for a moment: Too many open files" in relay.problems[0].text
        accepted = held.enter_context(server.accept()[0])
        client.sendall(b"there")
        assert accepted.recv(100) == b"there"


@pytest.mark.skipif(not has_ipv6(), reason="no IPv6 on this machine")
@pytest.mark.parametrize(("host", "target"), [("::1", "127.0.0.1"), ("127.0.0.1", "::1"), ("::1", "::1")])
def test_ipv6_on_either_side(host: str, target: str) -> None:
    tap = Tap()
    with (
        listening(target) as server,
        relaying(at(port_of(server), target), tap, host) as relay,
        connected(relay) as client,
    ):
        ports = (client.getsockname()[1], port_of(server))
        with server.accept()[0] as accepted:
            client.sendall(b"six")
            assert accepted.recv(10) == b"six"
    opened = drained(tap)[0]
    assert opened.ends is not None
    assert [(end.host, end.port) for end in opened.ends] == list(zip((host, target), ports, strict=True))


def test_stopping_closes_what_is_even_and_resets_what_is_not() -> None:
    with listening() as server, contextlib.ExitStack() as held:
        with relaying(at(port_of(server))) as relay:
            even = held.enter_context(connected(relay))
            even_server = held.enter_context(server.accept()[0])
            odd = held.enter_context(connected(relay))
            odd_server = held.enter_context(server.accept()[0])
            even.sendall(b"x")
            assert even_server.recv(10) == b"x"
            stall(odd)
        assert even.recv(10) == even_server.recv(10) == b""
        with pytest.raises(ConnectionResetError):
            received(odd_server)
        assert relay.active == 0
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(even.getpeername())


def test_a_bug_costs_one_connection_only(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(Tap):
        def sent(self, link: int, side: int, octets: bytes, time_ns: int) -> None:
            if octets == b"trap":
                raise RuntimeError("a bug")

    with listening() as server, relaying(at(port_of(server)), Broken()) as relay:
        with connected(relay) as good, server.accept()[0] as good_server:
            with connected(relay) as bad, server.accept()[0]:
                bad.sendall(b"trap")
                with pytest.raises(ConnectionResetError):
                    bad.recv(10)
            good.sendall(b"fine")
            assert good_server.recv(10) == b"fine"
        assert [problem.text for problem in relay.problems] == ["connection 2 is aborted: RuntimeError: a bug"]


def test_a_relay_to_itself_is_refused_and_leaves_nothing_open() -> None:
    port = port_of_nobody()
    with pytest.raises(ProxyError, match="itself"):
        Relay(places_to_listen(Address(LOOPBACK, port), allow_remote=False), at(port), Tap())
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((LOOPBACK, port))


def test_a_relay_that_was_stopped_before_it_ran_ends_at_once() -> None:
    made = Relay(places_to_listen(Address(LOOPBACK, 0), allow_remote=False), at(102), Tap())
    made.stop()
    with running(made):
        pass
    made.stop()
