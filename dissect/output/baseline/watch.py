"""`BaselineWatch`: compares traffic with a baseline, and finds everything that was never seen before."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.output.baseline.norms import Baseline, PairNorm
from dissect.output.baseline.subjects import NOT_CAPTURED_CALLED, NOT_CAPTURED_CALLING, Pair, Subject, Subjects, tsaps
from dissect.wire.text import printable

# The things that can be new (`Deviation.kind`).
CLIENT: Final = "client"
PAIR: Final = "pair"
PORT: Final = "port"
TSAP: Final = "tsap"
FUNCTION: Final = "function"
READ: Final = "read"
WRITE: Final = "write"
ACT: Final = "act"

KINDS: Final = (CLIENT, PAIR, PORT, TSAP, FUNCTION, READ, WRITE, ACT)

_MAX_CACHED: Final = 16384


class Deviation:
    """Something that is not in the baseline: ``kind`` is one of `KINDS`, ``what`` names it, ``text`` is a sentence.

    ``what`` and ``text`` may hold text from the wire (TSAPs), not escaped.
    """

    __slots__ = ("kind", "pair", "text", "what")

    def __init__(self, kind: str, pair: Pair, what: str, text: str) -> None:
        self.kind = kind
        self.pair = pair
        self.what = what
        self.text = text

    def __repr__(self) -> str:
        return f"Deviation({self.kind!r}, {self.pair!r}, {self.what!r})"

    def __str__(self) -> str:
        return printable(self.text)


class BaselineWatch:
    """Compares transactions and connections with a baseline; every deviation is returned, each time."""

    def __init__(self, baseline: Baseline) -> None:
        self._pairs = baseline.pairs
        self._clients = frozenset([client for client, _ in baseline.pairs])
        self._subjects = Subjects()
        self._judged: dict[tuple[Pair, Subject], tuple[Deviation, ...]] = {}

    def transaction(self, pair: Pair, transaction: Transaction) -> tuple[Deviation, ...]:
        """Return deviations in the function and the areas of a transaction of ``pair``."""
        subject = self._subjects.of(transaction)
        found = self._judged.get((pair, subject))
        if found is None:
            if len(self._judged) >= _MAX_CACHED:
                self._judged.clear()
            found = tuple(self._about(pair, subject))
            self._judged[pair, subject] = found
        return found

    def act(self, pair: Pair, act: Act) -> list[Deviation]:
        """Return the deviation of an act of ``pair``; empty if the baseline allows the act."""
        client, server = pair
        allowed = self._pairs.get(pair, _NOTHING).acts
        if allowed is None or act.kind in allowed:
            return []
        said = act.kind.replace("_", " ")
        return [Deviation(ACT, pair, act.kind, f"{said} on {server} by {client} ({act.outcome.replace('_', ' ')})")]

    def connection(self, pair: Pair, connection: Connection) -> list[Deviation]:
        """Return deviations in the pair, the port and the TSAPs of a connection."""
        client, server = pair
        norm = self._pairs.get(pair)
        found = []
        if norm is None:
            if client not in self._clients:
                found.append(Deviation(CLIENT, pair, client, f"new client {client}; it talks to {server}"))
            else:
                found.append(
                    Deviation(PAIR, pair, f"{client} > {server}", f"first connection from {client} to {server}")
                )
        port = int(connection.server.port)
        if norm is not None and norm.server_ports is not None and port not in norm.server_ports:
            found.append(Deviation(PORT, pair, str(port), f"first use of port {port} on {server} by {client}"))
        named = tsaps(connection)
        if norm is not None and norm.tsaps is not None and named and not _is_known(named, norm.tsaps):
            found.append(Deviation(TSAP, pair, named, f"first connection with TSAP {named} to {server} by {client}"))
        return found

    def _about(self, pair: Pair, subject: Subject) -> list[Deviation]:
        client, server = pair
        norm = self._pairs.get(pair, _NOTHING)
        found = []
        if norm.functions is not None and subject.function not in norm.functions:
            if subject.is_push:  # unsolicited: sent by the server without a request
                text = f"first {subject.function} from {server} to {client}"
            else:
                text = f"first {subject.function} request to {server} by {client}"
            found.append(Deviation(FUNCTION, pair, subject.function, text))
        found += [
            Deviation(READ, pair, area, f"first read of {area} on {server} by {client}")
            for area in subject.reads
            if norm.reads is not None and area not in norm.reads
        ]
        found += [
            Deviation(WRITE, pair, area, f"first write of {area} on {server} by {client}")
            for area in subject.writes
            if norm.writes is not None and area not in norm.writes
        ]
        return found


#: The norm of a pair that is not in the baseline: nothing is allowed.
_NOTHING: Final = PairNorm("", "", functions=frozenset(), reads=frozenset(), writes=frozenset(), acts=frozenset())


def _is_known(named: str, known: Collection[str]) -> bool:
    """Return whether TSAPs are among the known ones; one that was not captured (``?``) matches any."""
    if named in known:
        return True
    if named.endswith(NOT_CAPTURED_CALLED):
        return any(one.startswith(named[:-1]) for one in known)
    return named.startswith(NOT_CAPTURED_CALLING) and any(one.endswith(named[1:]) for one in known)
