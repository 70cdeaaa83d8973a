"""A client that tries one TSAP after another: a scan for racks and slots (reference 7.1).

A limited number of pairs of client and server is remembered, each with a limited number of TSAPs. The TSAPs of a pair are
counted for `WINDOW_NS` at a time, so that a client that talks to every module of a rack over several days is not reported.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.reporter import Reporter
from dissect.engine.transactions.connection import Connection
from dissect.wire.text import duration_text

WINDOW_NS: Final = 60_000_000_000
#: Maximum number of pairs of client and server that are remembered, and of TSAPs for each pair.
MAX_PAIRS: Final = 1024
MAX_TSAPS: Final = 32
#: This many TSAPs of one server within the window are a scan; so are this many refused ones.
TSAPS: Final = 6
REFUSED: Final = 3
#: Maximum number of TSAPs and packets that a finding names.
_NAMED: Final = 8


class _Pair:
    """The connect requests of a client to a server within the window. ``asked`` has the packet for each called TSAP."""

    __slots__ = ("asked", "first_ns", "refused", "told")

    def __init__(self, first_ns: i64) -> None:
        self.first_ns: i64 = first_ns
        self.asked: dict[bytes, int] = {}
        self.refused: set[bytes] | None = None  # made with the first refusal: most requests are confirmed
        self.told: bool = False


class ScanWatch:
    """Looks at the connect requests of all connections.

    ``forgotten`` is the number of pairs that were dropped (`MAX_PAIRS`).
    """

    def __init__(self, reporter: Reporter) -> None:
        self._reporter: Reporter = reporter
        self._pairs: OrderedDict[bytes, _Pair] = OrderedDict()
        self.forgotten: i64 = 0

    def asked(self, connection: Connection, frame: i64, time_ns: i64) -> None:
        """A connect request was sent."""
        tsap = connection.tsap_called
        if tsap is None:
            return
        pair = self._pair(connection, time_ns)
        if tsap.octets not in pair.asked and len(pair.asked) < MAX_TSAPS:
            pair.asked[tsap.octets] = int(frame)
            self._look(pair, connection, time_ns)

    def refused(self, connection: Connection, time_ns: i64) -> None:
        """A connect request was refused, or its connection ended without an answer to it."""
        tsap = connection.tsap_called
        if tsap is None:
            return
        pair = self._pairs.get(_key(connection))
        if pair is not None and _lately(pair, time_ns) and tsap.octets in pair.asked:
            if pair.refused is None:
                pair.refused = set()
            pair.refused.add(tsap.octets)
            self._look(pair, connection, time_ns)

    def _pair(self, connection: Connection, time_ns: i64) -> _Pair:
        key = _key(connection)
        pair = self._pairs.get(key)
        if pair is None or not _lately(pair, time_ns):
            pair = _Pair(time_ns)
            self._pairs[key] = pair
            if len(self._pairs) > MAX_PAIRS:
                self._pairs.popitem(last=False)
                self.forgotten += 1
        return pair

    def _look(self, pair: _Pair, connection: Connection, time_ns: i64) -> None:
        refused = len(pair.refused) if pair.refused is not None else 0
        if pair.told or (len(pair.asked) < TSAPS and refused < REFUSED):
            return
        pair.told = True
        tsaps = [".".join([f"{octet:02x}" for octet in octets]) for octets in list(pair.asked)[:_NAMED]]
        age: int = time_ns - pair.first_ns
        detail = (
            f"{connection.client} tried {len(pair.asked)} TSAPs of {connection.server} within {duration_text(int(age))},"
            f" {refused} of them refused: {', '.join(tsaps)}"
        )
        frames = list(pair.asked.values())[-_NAMED:]
        self._reporter.note("security.tsap_scan", connection.number, frames, time_ns, detail)


def _key(connection: Connection) -> bytes:
    """Return the key of the pair of client and server."""
    return connection.client.address + connection.server.address


def _lately(pair: _Pair, time_ns: i64) -> bool:
    """Return whether the window of a pair is still open."""
    return 0 <= time_ns - pair.first_ns <= WINDOW_NS
