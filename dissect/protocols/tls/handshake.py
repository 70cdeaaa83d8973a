"""Handshake messages: joins them from records, and reads the peers and their choices (RFC 5246 section 7.4, RFC 8446 4).

Incomplete messages are read up to their end; nothing raises.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.tls.tables import CLIENT_HELLO, HANDSHAKE, HANDSHAKE_TYPES, TLS_1_2, TLS_1_3, TLS_VERSIONS
from dissect.wire.octets import u16, u24
from dissect.wire.text import shortened

#: Size of the largest message that is kept; chains of certificates have a few thousand octets.
MAX_MESSAGE: Final = 128 * 1024
#: Maximum number of certificates of a chain, and of cipher suites of an offer, that are kept.
MAX_CERTIFICATES: Final = 8
MAX_OFFERED: Final = 256
#: Maximum number of characters of a server name that are shown.
MAX_NAME: Final = 200

_HEAD: Final = 4
_RANDOM: Final = slice(2, 34)
_SERVER_NAME: Final = 0
_EARLY_DATA: Final = 42
_SUPPORTED_VERSIONS: Final = 43
#: The random of a HelloRetryRequest, which has the form of a ServerHello: SHA-256 of its name (RFC 8446 section 4.1.3).
RETRY_RANDOM: Final = bytes.fromhex("cf21ad74e59a6111be1d8c021e65b891c2a211167abb8c5e079e09e2c8a8339c")


class HandshakeReader:
    """Joins the handshake messages of one direction, which may share records and span several.

    ``passed`` counts messages that were too long to be kept.
    """

    __slots__ = ("_rest", "_skip", "passed")

    def __init__(self) -> None:
        self._rest = b""
        self._skip = 0
        self.passed = 0

    @property
    def held(self) -> int:
        """Octets of an unfinished message."""
        return len(self._rest)

    def push(self, body: bytes) -> list[tuple[int, bytes]]:
        """Take the content of a handshake record; return (type, body) of the messages that it completes."""
        if self._skip:
            left = min(self._skip, len(body))
            self._skip -= left
            body = body[left:]
        octets = self._rest + body
        found: list[tuple[int, bytes]] = []
        at = 0
        while len(octets) - at >= _HEAD:
            size = u24(octets, at + 1)
            end = at + _HEAD + size
            if end > len(octets):
                if size > MAX_MESSAGE:
                    self.passed += 1
                    self._skip = end - len(octets)
                    at = len(octets)
                break
            found.append((octets[at], octets[at + _HEAD : end]))
            at = end
        self._rest = octets[at:]
        return found

    def drop(self) -> None:
        """Forget an unfinished message: the rest of it will not come, or cannot be decrypted."""
        self._rest = b""
        self._skip = 0


class Hello:
    """A ClientHello or ServerHello, as far as it is present.

    ``version`` is the highest offered or the chosen version, 0 if unknown. ``suites`` are the offered ones, or the chosen one.
    ``server_name`` is printable. ``retry``: this is a HelloRetryRequest.
    """

    __slots__ = ("early_data", "random", "retry", "server_name", "suites", "version")

    def __init__(self) -> None:
        self.version = 0
        self.random = b""
        self.suites: list[int] = []
        self.server_name = ""
        self.early_data = False
        self.retry = False


def parse_hello(body: bytes, from_client: bool) -> Hello:
    """Read the body of a ClientHello (``from_client``) or ServerHello."""
    hello = Hello()
    size = len(body)
    if size < 35:
        return hello
    hello.version = u16(body, 0)
    hello.random = body[_RANDOM]
    hello.retry = not from_client and hello.random == RETRY_RANDOM
    at = 35 + body[34]  # after version, random and session id
    if at + 2 > size:
        return hello
    if from_client:
        count = u16(body, at)
        offered = body[at + 2 : at + 2 + count]
        hello.suites = [u16(offered, here) for here in range(0, min(len(offered) - 1, 2 * MAX_OFFERED), 2)]
        at += 2 + count
        if at >= size:
            return hello
        at += 1 + body[at]  # compression methods
    else:
        hello.suites = [u16(body, at)]
        at += 3
    _extensions(hello, body, at + 2, from_client)
    return hello


def _extensions(hello: Hello, body: bytes, at: int, from_client: bool) -> None:
    while at + 4 <= len(body):
        kind = u16(body, at)
        value = body[at + 4 : at + 4 + u16(body, at + 2)]
        if kind == _SERVER_NAME and from_client and len(value) > 5:
            name = value[5 : min(5 + u16(value, 3), 5 + MAX_NAME + 1)]
            hello.server_name = shortened(name.decode("latin-1"), MAX_NAME)
        elif kind == _SUPPORTED_VERSIONS:
            hello.version = max(hello.version, _highest(value[1:] if from_client else value))
        elif kind == _EARLY_DATA:
            hello.early_data = True
        at += 4 + u16(body, at + 2)


def _highest(versions: bytes) -> int:
    """Return the highest known version in a list of versions; clients also put meaningless numbers in it."""
    listed = [u16(versions, at) for at in range(0, len(versions) - 1, 2)]
    return max([version for version in listed if version in TLS_VERSIONS], default=0)


def certificates_of(body: bytes, version: int) -> list[bytes]:
    """Return the certificates (DER) in the body of a Certificate message that are complete, the sender's own one first."""
    at = 0
    if version == TLS_1_3 and body:
        at = 1 + body[0]  # after the context
    found: list[bytes] = []
    at += 3
    while at + 3 <= len(body) and len(found) < MAX_CERTIFICATES:
        size = u24(body, at)
        if size == 0 or at + 3 + size > len(body):
            break
        found.append(body[at + 3 : at + 3 + size])
        at += 3 + size
        if version == TLS_1_3:
            if at + 2 > len(body):
                break
            at += 2 + u16(body, at)
    return found


# ---- one record, in words -------------------------------------------------------------------------------------------


def record_words(octets: bytes) -> str:
    """Return a text for the record at the beginning of ``octets``: version, type, and the server name of a ClientHello."""
    from dissect.protocols.tls.tables import CONTENT_TYPES

    if len(octets) < 5:
        return ""
    version = u16(octets, 1)
    kind = CONTENT_TYPES.name(octets[0]) if octets[0] in CONTENT_TYPES else "record"
    name = ""
    if octets[0] == HANDSHAKE and len(octets) > 5 and octets[5] in HANDSHAKE_TYPES:
        kind = HANDSHAKE_TYPES.name(octets[5])
        hello = _hello_in(octets)
        if hello is not None:
            version = hello.version or version
            name = hello.server_name
    server = f", server name {name}" if name else ""
    said = TLS_VERSIONS.name(version) if version in TLS_VERSIONS else f"version 0x{version:04x}"
    if version == TLS_1_2 and octets[0] != HANDSHAKE:
        said = "TLS 1.2 or 1.3"  # records of both have version 1.2 (RFC 8446 section 5.1)
    return f"{said} {kind}{server}"


def _hello_in(octets: bytes) -> Hello | None:
    """Return the hello at the beginning of a handshake record; None if there is another message."""
    if octets[5] not in {1, 2} or len(octets) < 9:
        return None
    return parse_hello(octets[9 : 9 + u24(octets, 6)], octets[5] == CLIENT_HELLO)


def chosen_version(octets: bytes, start: int, end: int) -> str:
    """Return the version that the ServerHello at ``start`` chooses; empty if there is none.

    In TLS 1.3 it is only in the extension supported_versions (RFC 8446 section 4.2.1).
    """
    if end - start < 44 or octets[start] != HANDSHAKE or octets[start + 1] != 3 or octets[start + 5] != 2:
        return ""
    hello = _hello_in(octets[start:end])
    return TLS_VERSIONS.name(hello.version) if hello is not None and hello.version in TLS_VERSIONS else ""
