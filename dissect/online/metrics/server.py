"""Serves the metrics over HTTP: only ``GET /metrics``, in a thread of its own.

Clients cannot delay the analysis: counting takes no lock, and the text is made at most `PER_SECOND` times a second, however
many requests come. At most `MAX_CLIENTS` are served at once; a further one replaces the oldest, so that slow clients cannot
keep Prometheus out. A client that is silent for `PATIENCE_S` is dropped.
"""

from __future__ import annotations

import ipaddress
import re
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer, ThreadingMixIn
from typing import TYPE_CHECKING, Any, Final

from dissect.online.metrics.counters import Metrics
from dissect.online.net.addresses import THIS_MACHINE, Address, AddressError, Place, is_loopback, parse_address

if TYPE_CHECKING:
    from dissect.online.metrics.exposition import Exposition

MAX_CLIENTS: Final = 8
PATIENCE_S: Final = 5.0
PER_SECOND: Final = 5
#: The thread checks every this many seconds whether it should end.
_POLL_S: Final = 0.2

_PATH: Final = "/metrics"
_PORT: Final = re.compile(r":[0-9]*$")
_PLAIN: Final = "text/plain; charset=utf-8"
_FAILED: Final = b"HTTP/1.0 500 Internal Server Error\r\nContent-Type: text/plain\r\n\r\nthe metrics cannot be told\n"


class MissingLibraryError(RuntimeError):
    """``prometheus_client`` is not installed."""

    def __init__(self) -> None:
        super().__init__("--metrics needs prometheus-client: pip install 's7dissect[metrics]'")


def _names_this_machine(host: str) -> bool:
    """Return whether a Host field is missing (HTTP/1.0), is localhost, or a numeric address."""
    name = host.rpartition(":")[0] if _PORT.search(host) else host
    if name.lower() in {"", "localhost"}:
        return True
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


class Text:
    """Caches the text of the metrics for ``1 / PER_SECOND`` seconds by ``clock``."""

    def __init__(self, exposition: Exposition, clock: Callable[[], float] = time.monotonic) -> None:
        self._exposition = exposition
        self._clock = clock
        self._lock = threading.Lock()
        self._made_at = float("-inf")
        self._octets = b""

    def octets(self) -> bytes:
        """Return the text, at most ``1 / PER_SECOND`` seconds old."""
        with self._lock:
            now = self._clock()
            if now - self._made_at >= 1 / PER_SECOND:
                self._octets = self._exposition.text()
                self._made_at = self._clock()
            return self._octets


class _Handler(BaseHTTPRequestHandler):
    """One request; the connection closes after it (HTTP/1.0)."""

    timeout = PATIENCE_S
    server: _Listener
    error_content_type = _PLAIN
    error_message_format = "%(code)d %(message)s\n"

    def do_GET(self) -> None:
        if self.path.partition("?")[0] != _PATH:
            self.send_error(404, f"there is only {_PATH}")
            return
        if self.server.local and not _names_this_machine(self.headers.get("Host", "")):
            self.send_error(403, "use a numeric address or localhost")
            return
        self._answer(self.server.text.octets())

    def _answer(self, octets: bytes) -> None:
        from dissect.online.metrics.exposition import CONTENT_TYPE

        self.send_response(200)
        self.send_header("Content-Type", CONTENT_TYPE)
        self.send_header("Content-Length", str(len(octets)))
        self.end_headers()
        self.wfile.write(octets)

    def version_string(self) -> str:
        return "s7dissect"

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - as the library has it
        """Write no log: the screens of the monitor may be on the terminal."""


class _Listener(ThreadingMixIn, TCPServer):
    """The listening socket, and the clients that are being served, the oldest first."""

    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, target: Place, text: Text) -> None:
        self.address_family = target.family
        #: Whether only this machine may connect. For a local address other host names are refused, too: a web page could use
        #: one (DNS rebinding).
        self.local = is_loopback(str(target.address[0]))
        self.text = text
        self._clients: dict[socket.socket, None] = {}
        self._lock = threading.Lock()
        super().__init__(target.address[:2], _Handler, bind_and_activate=False)
        try:
            self.server_bind_to(target)
            self.server_activate()
        except BaseException:
            self.server_close()
            raise

    def server_bind_to(self, target: Place) -> None:
        """Bind to the full address: that of IPv6 may have a scope."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if target.family == socket.AF_INET6:
            self.socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        self.socket.bind(target.address)
        self.server_address = self.socket.getsockname()

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            crowded = next(iter(self._clients)) if len(self._clients) >= MAX_CLIENTS else None
            if crowded is not None:
                del self._clients[crowded]
                _end(crowded)  # its thread wakes up at the end of the stream, and closes the socket
            self._clients[request] = None
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._clients.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore clients that are gone; any other exception is a bug of ours, and the client gets an error."""
        if not isinstance(sys.exc_info()[1], OSError):
            with suppress(OSError):
                request.sendall(_FAILED)

    def end_clients(self) -> None:
        with self._lock:
            for client in self._clients:
                _end(client)


def _end(client: socket.socket) -> None:
    with suppress(OSError):  # the client is gone already
        client.shutdown(socket.SHUT_RDWR)


class Server:
    """Listens from the moment it is made until `close`, and answers from `start` on.

    ``address`` is the address on which it listens, with the port that the system chose for port 0.
    """

    def __init__(self, listener: _Listener, host: str) -> None:
        self._listener = listener
        self.address = Address(host, int(listener.server_address[1]))
        self._thread = threading.Thread(target=self._serve, name="s7dissect-metrics", daemon=True)

    def start(self) -> None:
        """Begin to answer, in a thread; clients that connected before are answered, too. May be called twice."""
        if self._thread.ident is None:
            self._thread.start()

    def _serve(self) -> None:
        with suppress(OSError, ValueError):  # the socket is gone; the keeper notices the end
            self._listener.serve_forever(poll_interval=_POLL_S)

    @property
    def alive(self) -> bool:
        """False when it has ended, by itself or by `close`."""
        return self._thread.ident is None or self._thread.is_alive()

    @property
    def url(self) -> str:
        """The URL of the metrics."""
        return f"http://{self.address}{_PATH}"

    def close(self) -> None:
        """Stop listening, and disconnect clients. May be called twice."""
        if self._thread.is_alive():
            self._listener.shutdown()
            self._thread.join()
        self._listener.end_clients()
        self._listener.server_close()


class Door:
    """The place where metrics are served; it is opened again if necessary. ``target`` is the address as first resolved."""

    def __init__(self, metrics: Metrics, address: Address, target: Place) -> None:
        from dissect.online.metrics.exposition import Exposition

        self._address = address
        self._target = target
        self._text = Text(Exposition(metrics))

    def open(self) -> Server:
        """Listen; `Server.start` answers. Raises `AddressError`."""
        try:
            listener = _Listener(self._target, self._text)
        except OSError as why:
            raise AddressError(
                f"{self._address}: {why.strerror or why}: choose a different port or address with --metrics"
            ) from None
        return Server(listener, str(self._target.address[0]))


def resolve(address: Address, allow_remote: bool) -> Place:
    """Return the address to listen on. Raises `AddressError` if others can reach it, unless ``allow_remote``."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as why:
        reason = why.strerror if isinstance(why, OSError) else "not a host name"
        raise AddressError(f"{address}: {reason}: use a name or an address of this machine") from None
    family, _, _, _, where = found[0]
    host = str(where[0])
    if not allow_remote and not is_loopback(host):
        raise AddressError(
            f"{address} can be reached from other machines, and anyone who reaches it can read the metrics: "
            f"use {Address(THIS_MACHINE, address.port)}, or add --allow-remote if that is intended"
        )
    port = int(where[1])
    return Place(family, (host, port, int(where[2]), int(where[3])) if len(where) == 4 else (host, port))


def door_of(metrics: Metrics, address: Address | str, allow_remote: bool = False) -> Door:
    """Return where to serve ``metrics``, without listening there yet. Raises what `serve` raises for a wrong address."""
    try:
        import prometheus_client  # noqa: F401 - is it there?
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.partition(".")[0] != "prometheus_client":
            raise
        raise MissingLibraryError from None
    if isinstance(address, str):
        address = parse_address(address)
    return Door(metrics, address, resolve(address, allow_remote))


def serve(
    metrics: Metrics, address: Address | str = "127.0.0.1:9102", allow_remote: bool = False, *, start: bool = True
) -> Server:
    """Listen on ``address`` (``HOST:PORT``, ``[IPv6]:PORT``) and serve ``metrics`` there.

    Call it before the capture begins, so that a wrong address is reported at once. Raises `AddressError` for an address that
    cannot be used, or that others can reach without ``allow_remote``, and `MissingLibraryError`. Without ``start`` it only
    listens until `Server.start` is called.
    """
    server = door_of(metrics, address, allow_remote).open()
    if start:
        server.start()
    return server
