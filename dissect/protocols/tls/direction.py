"""One direction of a TLS session: its records, its handshake messages, and its current key."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.protocols.tls.aead import Opener
from dissect.protocols.tls.certificate import Certificate
from dissect.protocols.tls.handshake import HandshakeReader
from dissect.protocols.tls.records import RecordReader
from dissect.wire.copies import leaves

# Stages of a direction in TLS 1.3, in their order; each has its own secret.
EARLY: Final = 0
HANDSHAKING: Final = 1
TRAFFIC: Final = 2

#: Number of record numbers that are tried after a gap: as many as records may fit into the gap, within these limits.
MAX_TRIED: Final = 4096
_LEAST_TRIED: Final = 64
#: Octets of the smallest encrypted record.
_LEAST_RECORD: Final = 22
#: Maximum number of wrong record numbers that are tried in one direction; number of failures in a row after which decryption
#: stops.
_MAX_TRIES: Final = 65_536
MAX_MISSES: Final = 32

#: Returns the key of a stage, None if its secret is unknown.
Openers = Callable[[int], Opener | None]


class Direction:
    """The data that one side sent.

    ``records`` and ``octets`` count all records; ``opened`` counts decrypted records, ``shut`` records that stayed encrypted.
    ``first_ns`` and ``last_ns`` are the times of the first and the last record, 0 if there is none. ``changed``: a
    ChangeCipherSpec of TLS 1.2 was seen. ``window``: the number of records that may be lost in a gap. ``given_up``: no key fits
    any more. ``alert`` is the latest alert as text.
    """

    def __init__(self) -> None:
        self.reader = RecordReader()
        self.messages = HandshakeReader()
        self.records = 0
        self.octets = 0
        self.opened = 0
        self.content = 0
        self.shut = 0
        self.first_ns = 0
        self.last_ns = 0
        self.certificates: list[Certificate] = []
        self.alert = ""
        self.changed = False
        self.stage = HANDSHAKING
        self.updates = 0
        self.window = 0
        self.given_up = False
        self._opener: Opener | None = None
        self._number = 0
        self._misses = 0
        self._tries = 0

    def count(self, record: bytes, time_ns: int) -> None:
        """Count a record."""
        self.records += 1
        self.octets += len(record)
        self.first_ns = self.first_ns or time_ns
        self.last_ns = time_ns

    def lose(self, size: int) -> None:
        """``size`` octets are missing, with an unknown number of records."""
        self.reader.lose()
        self.messages.drop()
        self.window = min(MAX_TRIED, self.window + max(_LEAST_TRIED, size // _LEAST_RECORD))
        self.given_up = False
        self._misses = 0

    def renew(self, stage: int) -> None:
        """The next record has the key of ``stage``, and number 0."""
        self.stage = stage
        self._opener = None
        self._number = 0
        self.window = 0

    # ---- decryption -------------------------------------------------------------------------------------------------

    def open_1_2(self, record: bytes, opener: Callable[[], Opener | None]) -> bytes | None:
        """Return the content of a TLS 1.2 record, None if it cannot be decrypted; ``opener`` returns the session's key."""
        if self.given_up:
            return None
        if self._opener is None:
            self._opener = opener()
        current = self._opener
        if current is None:
            return None
        found = self._search(current.open_1_2, record, self._number)
        if found is None:
            self._miss()
        return found

    def open_1_3(self, record: bytes, openers: Openers) -> bytes | None:
        """Return content and type of a TLS 1.3 record; None if no known key decrypts it.

        The key of the next stage is tried as well: the message that ends the current stage may be missing, or its secret.
        """
        if self.given_up:
            return None
        tried = False
        current = self._opener
        if current is None:
            current = openers(self.stage)
        if current is not None:
            tried = True
            found = self._search(current.open_1_3, record, self._number)
            if found is not None:
                self._opener = current
                return found
        for stage in range(self.stage + 1, TRAFFIC + 1):
            opener = openers(stage)
            if opener is not None:
                found = self._search(opener.open_1_3, record, 0)
                if found is not None:
                    self.stage = stage
                    self._opener = opener
                    return found
        if self.stage == TRAFFIC and self.window:
            found = self._after_update(record, openers)
            if found is not None:
                return found
        if tried:
            self._miss()
        return None

    def _after_update(self, record: bytes, openers: Openers) -> bytes | None:
        """Try the key after a KeyUpdate, which may be among the missing octets."""
        self.updates += 1
        opener = openers(TRAFFIC)
        found = self._search(opener.open_1_3, record, 0) if opener is not None else None
        if found is None:
            self.updates -= 1
        else:
            self._opener = opener
        return found

    def _search(self, opening: Callable[[bytes, int], bytes | None], record: bytes, first: int) -> bytes | None:
        """Decrypt a record with the next number, or, after a gap, with one of the numbers after it."""
        found = opening(record, first)
        number = first
        while found is None and number - first < self.window and self._tries < _MAX_TRIES:
            number += 1
            self._tries += 1
            found = opening(record, number)
        if found is not None:
            self._number = number + 1
            self.window = 0
            self._misses = 0
        return found

    def _miss(self) -> None:
        self._misses += 1
        if self._misses >= MAX_MISSES:
            self.given_up = True


leaves(Direction, without=("_opener", "messages"))
