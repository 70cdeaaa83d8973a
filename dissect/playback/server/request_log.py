"""What all clients share: the stage, the faults, the count of requests, and what became of each."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from dissect.playback.server.faults import Fault
from dissect.playback.server.near import request_name
from dissect.playback.server.player import Player, Reply, Stage
from dissect.playback.server.plus import plus_name
from dissect.playback.server.plus_player import PlusPlayer
from dissect.s7.message import Pdu
from dissect.s7plus.message import PlusPdu
from dissect.wire.text import some

#: Requests that are remembered, and of them those that nothing like was recorded of; all are counted.
MAX_REQUESTS: Final = 10_000
MAX_UNMATCHED: Final = 1_000
MAX_PROBLEMS: Final = 1_000

#: Octets and addresses of a request that are remembered; more than a PDU of 960 octets has.
MAX_KEPT: Final = 1_024
MAX_ADDRESSES: Final = 100


class Request(NamedTuple):
    """A request that came.

    ``number`` counts from 1 over all connections, setups included; ``connection`` counts those. ``function`` is the name,
    ``addresses`` are those of a read or write (text from the wire, not escaped), ``octets`` the PDU; of long ones the beginning
    (`MAX_ADDRESSES`, `MAX_KEPT`). ``how`` says where the answer is from (`player.Reply`), ``lacking`` what the
    recording has nothing for, ``faults`` what was made wrong.
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
    """Answers requests of all clients, in the order in which they come. One thread works it; others may look."""

    def __init__(self, stage: Stage, faults: Sequence[Fault] = (), latency_ms: float | None = 0) -> None:
        """``latency_ms`` is how long an answer takes, None for as long as it was recorded."""
        self.stage = stage
        self.total = 0
        self.unmatched_total = 0
        self.problems: deque[str] = deque(maxlen=MAX_PROBLEMS)
        self._requests: deque[Request] = deque(maxlen=MAX_REQUESTS)
        self._unmatched: deque[Request] = deque(maxlen=MAX_UNMATCHED)
        self._lock = threading.Lock()
        self._faults = list(faults)
        self._latency_ms = latency_ms
        self._told: set[str] = set()

    @property
    def requests(self) -> list[Request]:
        """The last requests (`MAX_REQUESTS`), in the order in which they came."""
        with self._lock:
            return list(self._requests)

    @property
    def unmatched(self) -> list[Request]:
        """The last of those that nothing like was recorded of (`MAX_UNMATCHED`)."""
        with self._lock:
            return list(self._unmatched)

    def answer(self, connection: int, player: Player, asked: Pdu) -> tuple[Reply, list[Fault], float]:
        """Return what is said to a request, what is to go wrong with it, and after how many seconds it is said."""
        self.total += 1
        reply = player.reply(asked)
        hits = [fault for fault in self._faults if fault.hits(self.total, asked)]
        addresses = tuple([item.label for item in asked.parameters.items[:MAX_ADDRESSES]])
        name = asked.function_name or "no function"
        if reply.how == "unmatched" and not addresses:
            name = request_name(asked.octets) or name
        self._note(connection, name, addresses, asked.octets, reply, hits)
        return reply, hits, self._delay_s(reply)

    def answer_plus(self, connection: int, player: PlusPlayer, asked: PlusPdu) -> tuple[Reply, list[Fault], float]:
        """Return the same for a request of S7comm-plus."""
        self.total += 1
        reply = player.reply(asked)
        hits = [fault for fault in self._faults if fault.named(self.total, [asked.function_name])]
        self._note(connection, plus_name(asked.octets) or asked.kind, (), asked.octets, reply, hits)
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
            if trouble not in self._told:
                self._told.add(trouble)
                self.problems.append(trouble)

    def _delay_s(self, reply: Reply) -> float:
        latency_ms = reply.latency_ns / 1e6 if self._latency_ms is None else self._latency_ms
        return latency_ms / 1000

    def stranger(self, connection: int, octets: bytes, what: str) -> None:
        """Take note of what a client sent that is no request of S7comm, and that nothing is said to."""
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
