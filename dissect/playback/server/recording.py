"""What a capture or a golden says of a server."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.golden.exchange import S7
from dissect.golden.model import GoldenError
from dissect.golden.model import Session as Golden
from dissect.golden.order import settle_places
from dissect.golden.reading import is_golden, read_session
from dissect.ibh.tables import IBH_NETLINK
from dissect.iso.cotp import parse_tpdu
from dissect.iso.tables import CC, DR, ER
from dissect.iso.tpkt import HEADER
from dissect.playback.server.answers import farewell
from dissect.playback.server.arranging import Seen, arrange
from dissect.playback.server.model import ENDS, Recording, Script
from dissect.session import Run
from dissect.source.packet import CaptureError
from dissect.transactions.connection import Connection
from dissect.transactions.ending import DISCONNECT, ERROR_TPDU
from dissect.transactions.transaction import OUTCOMES, Transaction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dissect.transactions.table import Side

#: Requests of a recording, and octets of its distinct messages; what is longer is no test any more.
MAX_STEPS: Final = 200_000
MAX_OCTETS: Final = 256 * 1024 * 1024

#: Ends that a TPDU tells.
_TOLD: Final = frozenset((DISCONNECT, ERROR_TPDU))
_OURS: Final = frozenset(("", "s7comm"))


class ServerError(CaptureError):
    """A server cannot be made of this, or cannot begin: one line that says why and what to do."""


class _Begun:
    """What is gathered of a connection while it goes on; which side is the client may become known later."""

    __slots__ = ("confirm", "farewells", "script", "seen")

    def __init__(self, number: int) -> None:
        self.script = Script(number)
        self.confirm = b""
        self.farewells = [b"", b""]  # the last DR or ER of each side
        self.seen: list[Seen] = []


class RecordingReader(Observer):
    """Gathers scripts from a pipeline; `finish` gives the recording."""

    def __init__(self, name: str = "") -> None:
        super().__init__()
        self.wants_tpdus = True
        self.excess = ""  # what there is too much of; an observer that raises would be taken for a bug of the engine
        self._recording = Recording(name)
        self._begun: dict[int, _Begun] = {}
        self._known: dict[bytes, bytes] = {}
        self._octets = 0
        self._count = 0

    def _of(self, connection: Connection) -> _Begun:
        number = int(connection.number)
        begun = self._begun.get(number)
        if begun is None:
            begun = self._begun[number] = _Begun(number)
        return begun

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Keep what answers the connect request, and what ends the connection."""
        if octets[HEADER + 1] >> 4 not in {CC, DR, ER}:
            return
        begun = self._of(side.connection)
        if not begun.confirm and not begun.seen and side.connection.role(side.index) == "server":
            begun.confirm = octets[HEADER:]
        if octets[HEADER + 1] >> 4 != CC:
            begun.farewells[side.index] = octets[HEADER:]

    def transaction(self, transaction: Transaction) -> None:
        """Keep both PDUs."""
        begun = self._of(transaction.connection)
        if transaction.is_plus or transaction.is_scd:
            return
        self._count += 1
        if self._count > MAX_STEPS:
            self.excess = f"more than {MAX_STEPS} transactions"
        if self.excess:
            return
        request, answer = self._kept(transaction.request_octets), self._kept(transaction.response_octets)
        outcome, reason = OUTCOMES[transaction.outcome], transaction.reason
        seen = Seen(request, answer, outcome, reason, transaction.latency_ns)
        seen.asked_by = int(transaction.asked_by)
        asked_at, told_at = int(transaction.request_frame), int(transaction.response_frame)
        seen.place = (asked_at or told_at, int(transaction.number))
        seen.has_request = asked_at > 0
        seen.answered_at = told_at or asked_at
        begun.seen.append(seen)

    def _kept(self, octets: bytes) -> bytes:
        """Return the octets, those that were there before as the same object."""
        known = self._known.setdefault(octets, octets)
        if known is octets:
            self._octets += len(octets)
            if self._octets > MAX_OCTETS:
                self.excess = f"more than {MAX_OCTETS >> 20} MiB of messages"
        return known

    def connection_closed(self, connection: Connection) -> None:
        """Make the script, now that all is known of the connection."""
        begun = self._begun.pop(int(connection.number), _Begun(int(connection.number)))
        script = begun.script
        netlink = connection.protocol == IBH_NETLINK
        if connection.udp or netlink or (connection.protocol not in _OURS and not begun.seen):
            carrier = "UDP" if connection.udp else "IBH-NetLink" if netlink else ""
            self._recording.unserved(script.number, connection.protocol, carrier)
            return
        script.calling = connection.tsap_calling.octets if connection.tsap_calling is not None else None
        script.called = connection.tsap_called.octets if connection.tsap_called is not None else None
        script.confirm = begun.confirm
        script.pdu_length = int(connection.pdu_length)
        script.refused = connection.cr_seen and (not begun.confirm or parse_tpdu(begun.confirm).type != CC)
        if script.refused and begun.seen:
            script.refused = False  # it goes on: only the confirmation was not captured
            script.confirm = b""
        ending = connection.ending
        if ending is not None and ending.how in ENDS and connection.role(ending.side) == "server":
            script.end = ending.how
            script.farewell = begun.farewells[int(ending.side)] if ending.how in _TOLD else b""
        client = int(connection.client_side)
        for one in begun.seen:
            one.by_client = one.asked_by == client
        settle_places(begun.seen)
        begun.seen.sort(key=lambda one: one.place)
        arrange(script, begun.seen, self._recording)
        if script.steps or connection.cr_seen:
            self._recording.scripts.append(script)

    def finish(self, damage: Sequence[str] = ()) -> Recording:
        """Return what can be served. Raises `ServerError` when nothing can."""
        recording = self._recording
        if self.excess:
            raise ServerError(f"{recording.name}: {self.excess}; cut it first (s7dissect cut)")
        for text in damage:
            recording.note(text)
        recording.scripts.sort(key=lambda script: script.number)
        return _served(recording)


def _served(recording: Recording) -> Recording:
    if not recording.scripts:
        raise ServerError(f"{recording.name}: no connection in it speaks S7comm over TCP, so there is nothing to serve")
    return recording


def load_recording(path: str | os.PathLike[str], *more: str | os.PathLike[str]) -> Recording:
    """Return what can be served of a capture (or of several, as `dissect.open` reads them) or of a golden.

    Raises `CaptureError` for what is no capture and `ServerError` when nothing in it can be served, or too much.
    """
    name = os.fspath(path)
    if not more and name != "-" and is_golden(path):
        try:
            return _served(_of_golden(read_session(path)))
        except GoldenError as error:
            raise ServerError(str(error)) from None
    reader = RecordingReader(name)
    run = Run([name, *[os.fspath(other) for other in more]], reader, Options())
    while run.step() and not reader.excess:
        pass
    run.finish()
    return reader.finish([f"{file.name}: {file.loss}" for file in run.files if file.loss])


def _of_golden(session: Golden) -> Recording:
    recording = Recording(session.name)
    for link in session.links:
        script = Script(link.number)
        asked = [transaction for transaction in link.transactions if transaction.exchange.kind == S7]
        if link.carrier != "tcp" or (link.protocol not in _OURS and not asked):
            carrier = {"udp": "UDP", "ibh": "IBH-NetLink"}.get(link.carrier, "")
            recording.unserved(link.number, link.protocol, carrier)
            continue
        script.calling, script.called = link.calling, link.called
        script.end = link.ended if link.ended in ENDS and link.ended_by == "server" else ""
        script.farewell = farewell(script.end, link.farewell.rpartition(": ")[2])
        script.refused = link.begun and not link.tpdu_size and not link.transactions
        if script.refused:
            script.confirm = farewell(DISCONNECT, link.refused) if link.refused else script.farewell
        seen = []
        for number, transaction in enumerate(asked, 1):
            exchange = transaction.exchange
            one = Seen(
                exchange.request, exchange.response, transaction.outcome, transaction.reason, transaction.latency_ns
            )
            one.by_client = transaction.asked_by == "client"
            one.place, one.answered_at = (number, 0), number
            granted = exchange.setup[1]
            if one.by_client and granted is not None:
                script.pdu_length = granted.pdu_length
            seen.append(one)
        arrange(script, seen, recording)
        if script.steps or script.refused:
            recording.scripts.append(script)
    return recording


__all__ = ["MAX_OCTETS", "MAX_STEPS", "Recording", "RecordingReader", "ServerError", "load_recording"]
