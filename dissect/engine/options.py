"""What a run may be told, beside the packets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.engine.exchange import PayloadDecoder
from dissect.tls.key_log import KeyLog
from dissect.transactions.connection import Connection
from dissect.transactions.naming import Naming

#: Octets that all connections together may keep of what is unfinished.
MEMORY: Final = 128 * 1024 * 1024


class Options:
    """What a user can set. ``slow_ns``: an answer later than this is slow. ``strict``: a bug of ours raises.

    ``decoder`` looks for another protocol in what passes. ``overdue_ns``: a request still open after this is reported at once,
    before it is known what becomes of it; 0 for never, as in a file what becomes of it is known.

    ``memory`` bounds the octets that all connections together keep of unfinished packets, PDUs and transactions, within
    `dissect.engine.pipeline.LOOK_OCTETS`: when they keep more, those that hold most are given up and reported
    (`stream.evicted`).
    ``checksums``: TCP segments and UDP datagrams with a wrong checksum are left out, as their receiver did.
    ``tls_keys`` open TLS, beside those that a capture itself holds. ``naming`` knows names for addresses.
    ``only`` tells of a connection, once it is recognised and has its number, whether it is to be read: of others nothing is
    read and nothing reported, but they keep their numbers.
    """

    def __init__(
        self,
        slow_ns: int = 1_000_000_000,
        strict: bool = False,
        decoder: PayloadDecoder | None = None,
        overdue_ns: int = 0,
        memory: int = MEMORY,
        checksums: bool = False,
        tls_keys: KeyLog | None = None,
        only: Callable[[Connection], bool] | None = None,
        naming: Naming | None = None,
    ) -> None:
        self.slow_ns: i64 = slow_ns
        self.overdue_ns: i64 = overdue_ns
        self.memory: i64 = memory
        self.checksums: bool = checksums
        self.strict: bool = strict
        self.decoder: PayloadDecoder | None = decoder
        self.tls_keys: KeyLog | None = tls_keys
        self.only: Callable[[Connection], bool] | None = only
        self.naming: Naming | None = naming
