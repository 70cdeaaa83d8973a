"""The server: one path, this machine, and clients that cannot hold anything up."""

from __future__ import annotations

import http.client
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest
from prometheus_client.parser import text_string_to_metric_families

from dissect.online.metrics import server as module
from dissect.online.metrics.counters import Metrics
from dissect.online.metrics.exposition import CONTENT_TYPE, Exposition
from dissect.online.metrics.server import MAX_CLIENTS, PER_SECOND, MissingLibraryError, Server, Text, serve
from dissect.online.net.addresses import Address, AddressError


@pytest.fixture
def server() -> Iterator[Server]:
    """Listen on a port the system chooses."""
    running = serve(Metrics(), "127.0.0.1:0")
    yield running
    running.close()


def reach(address: Address) -> socket.socket:
    return socket.create_connection((address.host, address.port), timeout=10)


def ended(client: socket.socket) -> bool:
    """Tell whether the other side has ended the connection; waits for it."""
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


def ask(server: Server, method: str = "GET", path: str = "/metrics") -> tuple[int, str, bytes]:
    connection = http.client.HTTPConnection(server.address.host, server.address.port, timeout=10)
    try:
        connection.request(method, path)
        answer = connection.getresponse()
        return answer.status, answer.headers["Content-Type"], answer.read()
    finally:
        connection.close()


def test_metrics(server: Server) -> None:
    status, kind, octets = ask(server)
    assert (status, kind) == (200, CONTENT_TYPE)
    assert kind.startswith("text/plain; version=0.0.4")
    names = {family.name for family in text_string_to_metric_families(octets.decode())}
    assert {"s7dissect_build_info", "process_resident_memory_bytes"} <= names
    assert server.url == f"http://127.0.0.1:{server.address.port}/metrics"
    assert ask(server, path="/metrics?name=x")[0] == 200


@pytest.mark.parametrize("path", ["/", "/metrics/", "/metricsx", "/favicon.ico", "/../metrics", "http://x/metrics"])
def test_nothing_else(server: Server, path: str) -> None:
    status, kind, octets = ask(server, path=path)
    assert (status, octets) == (404, b"404 there is only /metrics\n")
    assert kind == "text/plain; charset=utf-8"


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:9102", 200),
        ("localhost:9102", 200),
        ("LocalHost", 200),
        ("[::1]:9102", 200),
        ("", 200),
        ("plant.example:9102", 403),
        ("localhost.plant.example", 403),
        ("127.0.0.1.plant.example:80", 403),
        ("\x1b[2J", 403),
    ],
)
def test_another_name_is_refused(server: Server, host: str, status: int) -> None:
    """A web page elsewhere whose name leads here (DNS rebinding)."""
    with reach(server.address) as client:
        client.sendall(b"GET /metrics HTTP/1.1\r\nHost: " + host.encode() + b"\r\n\r\n")
        assert client.makefile("rb").readline().split()[1] == str(status).encode()


def test_whom_others_may_ask_has_other_names() -> None:
    running = serve(Metrics(), "0.0.0.0:0", allow_remote=True)
    try:
        with socket.create_connection(("127.0.0.1", running.address.port), timeout=10) as client:
            client.sendall(b"GET /metrics HTTP/1.1\r\nHost: probe7.plant.example\r\n\r\n")
            assert client.makefile("rb").readline().split()[1] == b"200"
    finally:
        running.close()


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "<script>"])
def test_only_get(server: Server, method: str) -> None:
    assert ask(server, method)[0] == 501


@pytest.mark.parametrize(
    "octets", [b"\r\n", b"\0" * 100, b"GET\r\n\r\n", b"G" * 70_000, b"GET /metrics HTTP/9.9\r\n\r\n"]
)
def test_garbage_is_survived(server: Server, octets: bytes) -> None:
    with reach(server.address) as client:
        client.sendall(octets)
        client.shutdown(socket.SHUT_WR)
        try:
            while client.recv(65536):
                pass
        except ConnectionResetError:
            pass
    assert ask(server)[0] == 200


def test_ipv6() -> None:
    try:
        running = serve(Metrics(), "[::1]:0")
    except AddressError as why:
        pytest.skip(f"no IPv6 here: {why}")
    try:
        assert str(running.address).startswith("[::1]:")
        assert ask(running)[0] == 200
    finally:
        running.close()


def test_a_port_that_is_taken_is_told_at_once(server: Server) -> None:
    with pytest.raises(AddressError, match=r"in use: choose a different port or address with --metrics"):
        serve(Metrics(), server.address)


def test_loopback_unless_told() -> None:
    with pytest.raises(AddressError, match="--allow-remote"):
        serve(Metrics(), "0.0.0.0:0")
    running = serve(Metrics(), "0.0.0.0:0", allow_remote=True)
    running.close()


def test_closing_frees_the_port_and_ends_the_thread() -> None:
    running = serve(Metrics(), "127.0.0.1:0")
    address = running.address
    running.close()
    running.close()
    assert "s7dissect-metrics" not in {thread.name for thread in threading.enumerate()}
    with pytest.raises(ConnectionRefusedError):
        reach(address)
    serve(Metrics(), address).close()


def test_silent_clients_do_not_keep_prometheus_out(server: Server) -> None:
    silent = [reach(server.address) for _ in range(3 * MAX_CLIENTS)]
    try:
        for client in silent:
            client.sendall(b"GET /metr")  # and not another word
        assert ask(server)[0] == 200
        for client in silent[: 2 * MAX_CLIENTS]:  # those that came first had to go
            assert ended(client)
    finally:
        for client in silent:
            client.close()


def test_closing_drops_those_who_are_served() -> None:
    running = serve(Metrics(), "127.0.0.1:0")
    with reach(running.address) as client:
        client.sendall(b"GET /metrics HTTP/1.0\r\n")
        assert ask(running)[0] == 200  # so the one before it was accepted
        running.close()
        assert ended(client)


class Broken(Metrics):
    """Fails when it is asked."""

    @property
    def queue(self) -> tuple[int, int] | None:
        raise ZeroDivisionError


def test_a_failure_is_told_to_the_client_and_nobody_else(capfd: pytest.CaptureFixture[str]) -> None:
    running = serve(Broken(), "127.0.0.1:0")
    try:
        status, _, octets = ask(running)
    finally:
        running.close()
    assert (status, octets) == (500, b"the metrics cannot be told\n")
    assert capfd.readouterr() == ("", "")


class Counted(Exposition):
    """Counts how often it is asked."""

    asked = 0

    def text(self) -> bytes:
        self.asked += 1
        return b"%d" % self.asked


def test_the_text_is_made_a_few_times_a_second() -> None:
    now = [100.0]
    made = Counted(Metrics())
    text = Text(made, lambda: now[0])
    assert {text.octets() for _ in range(1000)} == {b"1"}
    now[0] += 1 / PER_SECOND
    assert {text.octets() for _ in range(1000)} == {b"2"}
    assert made.asked == 2


def test_without_the_library_there_is_a_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "dissect.online.metrics.exposition", raising=False)
    for name in list(sys.modules):
        if name.partition(".")[0] == "prometheus_client":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(MissingLibraryError, match=r"pip install 's7dissect\[metrics\]'"):
        serve(Metrics(), "127.0.0.1:0")


def test_importing_it_imports_no_library() -> None:
    heavy = ["prometheus_client", "dissect.online.metrics.exposition"]
    code = f"import {module.__name__}, sys; print(*[name in sys.modules for name in {heavy}])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "False False\n"
