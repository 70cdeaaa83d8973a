"""The options of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.engine.exchange import PayloadDecoder
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.naming import Naming
from dissect.protocols.tls.key_log import KeyLog
from dissect.wire.copies import leaves

#: Octets that all connections together may keep of unfinished packets, PDUs and transactions.
MEMORY: Final = 128 * 1024 * 1024


class Options:
    """The settings of a user.

    ``slow_ns``: an answer that takes longer is slow (nanoseconds). With ``strict`` a bug of ours raises, instead of becoming
    the finding ``internal.bug``. ``decoder`` looks for another protocol in the payloads (SCD). ``overdue_ns``: a request that
    is open for longer is reported at once, before its end is known (nanoseconds; 0 for never, as for files, where the end is
    known). ``memory``: the octets that all connections together may keep of unfinished packets, PDUs and transactions. If they
    keep more (checked every `dissect.engine.pipeline.LOOK_OCTETS`), those that keep most are dropped and reported
    (``stream.evicted``). With ``checksums`` TCP segments and UDP datagrams with a wrong checksum are ignored, as their
    receivers ignore them. ``tls_keys`` decrypt TLS, in addition to the keys in the capture. ``only`` decides about each
    connection that was recognised and has its number: True to read it. Nothing is read or reported of the others, but they keep
    their numbers. ``naming`` knows names for addresses (tags).
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

    def __repr__(self) -> str:
        return (
            f"Options(slow_ns={self.slow_ns}, strict={self.strict}, overdue_ns={self.overdue_ns}, memory={self.memory}, "
            f"checksums={self.checksums})"
        )


leaves(Options)
