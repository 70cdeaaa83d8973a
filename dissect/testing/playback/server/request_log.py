"""The state that all clients share: the stage, the faults, the count of requests, and their results."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7plus.message import PlusPdu
from dissect.testing.playback.server.faults import Fault
from dissect.testing.playback.server.nearest import request_name
from dissect.testing.playback.server.player import FakePlc, Reply, Stage
from dissect.testing.playback.server.plus import plus_name
from dissect.testing.playback.server.plus_player import PlusPlayer
from dissect.wire.text import some

#: Maximum number of requests that are kept, and of unmatched ones among them; all are counted.
MAX_REQUESTS: Final = 10_000
MAX_UNMATCHED: Final = 1_000
MAX_PROBLEMS: Final = 1_000

#: Maximum number of octets and addresses that are kept of a request; a PDU of 960 octets has fewer.
MAX_KEPT: Final = 1_024
MAX_ADDRESSES: Final = 100


class Request(NamedTuple):
    """A received request.

    ``number`` counts from 1 over all connections, setups included; ``connection`` counts those. ``function`` is the name,
    ``addresses`` are those of a read or write (text from the wire, not escaped), ``octets`` the PDU; of long ones only the
    beginning (`MAX_ADDRESSES`, `MAX_KEPT`). ``how`` is the origin of the answer (`player.Reply`), ``lacking`` names what was
    not recorded, ``faults`` are those that were applied.
    """

    number: int
    connection: int
    time_ns: int
    function: str
    addresses: tuple[str, ...]
    octets: bytes
    how: str
    lacking: str = ""
    faults: tuple[str, ...] = ()

    @property
    def subject(self) -> str:
        """Function and up to five addresses; text from the wire, not escaped."""
        return f"{self.function} {some(list(self.addresses), 5)}".rstrip()

    def __str__(self) -> str:
        lacking = f": {self.lacking}" if self.lacking else ""
        return f"request {self.number} on connection {self.connection}, {self.subject}{lacking}"


class RequestLog:
    """Answers requests of all clients, in order of arrival. One thread runs it; others may read it."""

    def __init__(self, stage: Stage, faults: Sequence[Fault] = (), latency_ms: float | None = 0) -> None:
        """``latency_ms`` is the answer time, None for the recorded one."""
        self.stage = stage
        self.total = 0
        self.unmatched_total = 0
        self.problems: deque[str] = deque(maxlen=MAX_PROBLEMS)
        self._requests: deque[Request] = deque(maxlen=MAX_REQUESTS)
        self._unmatched: deque[Request] = deque(maxlen=MAX_UNMATCHED)
        self._lock = threading.Lock()
        self._faults = list(faults)
        self._latency_ms = latency_ms
        self._reported: set[str] = set()

    @property
    def requests(self) -> list[Request]:
        """The last requests (`MAX_REQUESTS`), in order of arrival."""
        with self._lock:
            return list(self._requests)

    @property
    def unmatched(self) -> list[Request]:
        """The last requests without a recorded match (`MAX_UNMATCHED`)."""
        with self._lock:
            return list(self._unmatched)

    def answer(self, connection: int, player: FakePlc, request: Pdu) -> tuple[Reply, list[Fault], float]:
        """Return the reply to a request, the faults to apply, and the delay in seconds."""
        self.total += 1
        reply = player.reply(request)
        hits = [fault for fault in self._faults if fault.hits(self.total, request)]
        addresses = tuple([item.label for item in request.parameters.items[:MAX_ADDRESSES]])
        name = request.function_name or "no function"
        if reply.how == "unmatched" and not addresses:
            name = request_name(request.octets) or name
        self._note(connection, name, addresses, request.octets, reply, hits)
        return reply, hits, self._delay_s(reply)

    def answer_plus(self, connection: int, player: PlusPlayer, request: PlusPdu) -> tuple[Reply, list[Fault], float]:
        """Return the same for a request of S7comm-plus."""
        self.total += 1
        reply = player.reply(request)
        hits = [fault for fault in self._faults if fault.named(self.total, [request.function_name])]
        self._note(connection, plus_name(request.octets) or request.kind, (), request.octets, reply, hits)
        return reply, hits, self._delay_s(reply)

    def _note(
        self, connection: int, name: str, addresses: tuple[str, ...], octets: bytes, reply: Reply, hits: list[Fault]
    ) -> None:
        kinds = tuple([fault.kind for fault in hits])
        kept = octets[:MAX_KEPT]
        self._keep(
            Request(self.total, connection, time.time_ns(), name, addresses, kept, reply.how, reply.lacking, kinds)
        )
        for trouble in self.stage.troubles:
            if trouble not in self._reported:
                self._reported.add(trouble)
                self.problems.append(trouble)

    def _delay_s(self, reply: Reply) -> float:
        latency_ms = reply.latency_ns / 1e6 if self._latency_ms is None else self._latency_ms
        return latency_ms / 1000

    def stranger(self, connection: int, octets: bytes, what: str) -> None:
        """Note a message of a client that is not a request of S7comm and gets no answer."""
        self.total += 1
        kept = octets[:MAX_KEPT]
        self._keep(Request(self.total, connection, time.time_ns(), what, (), kept, "unmatched", "ignored"))

    def _keep(self, request: Request) -> None:
        with self._lock:
            self._requests.append(request)
            if request.how != "unmatched":
                return
            self.unmatched_total += 1
            self._unmatched.append(request)
            self.problems.append(f"unmatched: {request}")
