"""Which connections are whose: every run over the same packets comes to the same answer by itself.

Connections that one rule or column looks at together have to be in one share, which `by_pair` and `by_service` are for. Shares
are given out in turn, in the order in which their keys first appear, so that few connections are divided evenly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final
from zlib import crc32

from dissect.transactions.connection import ISO_TSAP_PORT, Connection

#: Keys that have their turn; of further ones a checksum decides.
MAX_KEYS: Final = 65_536

#: What decides whose a connection is.
Key = Callable[[Connection], bytes]


def by_pair(connection: Connection) -> bytes:
    """Return a key of both ends of a connection: whatever is said of a transaction comes from its connection alone."""
    first, second = connection.tcp.ends
    return first.address + first.port.to_bytes(2, "big") + second.address + second.port.to_bytes(2, "big")


def by_service(connection: Connection) -> bytes:
    """Return a key of the end that is asked: on port 102, or else on the lower port."""
    end = min(connection.tcp.ends, key=lambda end: (end.port != ISO_TSAP_PORT, end.port))
    return end.address + end.port.to_bytes(2, "big")


class Share:
    """Tells of a connection whether it belongs to the run ``index`` of ``count``, and whether ``only`` wants it as well.

    ``opened`` has the first packet of each connection, in the order of their numbers, until `take`; ``unwanted`` counts
    those that ``only`` does not want.
    """

    def __init__(self, index: int, count: int, key: Key, only: Callable[[Connection], bool] | None = None) -> None:
        self.unwanted = 0
        self._index = index
        self._count = count
        self._key = key
        self._only = only
        self._turns: dict[bytes, int] = {}
        self._opened: list[int] = []
        self._latest = 0

    def __call__(self, connection: Connection) -> bool:
        """Return whether a connection is to be read. Called for each, in the order of their numbers."""
        self.note(connection)
        key = self._key(connection)
        turn = self._turns.get(key)
        if turn is None:
            if len(self._turns) < MAX_KEYS:
                turn = self._turns[key] = len(self._turns) % self._count
            else:
                turn = crc32(key) % self._count
        if turn != self._index:
            return False
        if self._only is not None and not self._only(connection):
            self.unwanted += 1
            return False
        return True

    def note(self, connection: Connection) -> None:
        """Remember a connection that has its number now; one that was remembered before is not again."""
        if connection.number > self._latest:
            self._latest = int(connection.number)
            self._opened.append(int(connection.tcp.first_frame))

    def take(self) -> list[int]:
        """Return the first packets of the connections since the last call."""
        opened, self._opened = self._opened, []
        return opened
