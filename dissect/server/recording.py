"""What a capture says of a server: on each connection, what was asked, what was answered, what the server said by itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from dissect.conversation import Observer, Options
from dissect.golden.exchange import S7
from dissect.golden.model import GoldenError
from dissect.golden.model import Session as Golden
from dissect.golden.reading import is_golden, read_session
from dissect.iso.cotp import parse_tpdu
from dissect.iso.tables import CC, DR, ER
from dissect.iso.tpkt import HEADER
from dissect.s7.message import parse_pdu
from dissect.s7.tables import JOB
from dissect.session import Run
from dissect.source.packet import CaptureError
from dissect.transactions.connection import Connection
from dissect.transactions.ending import DISCONNECT, FIN, RESET
from dissect.transactions.transaction import PUSH, Transaction

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from dissect.transactions.table import Side

#: Requests of a recording, and octets of its distinct messages; what is longer is no test any more.
MAX_STEPS: Final = 200_000
MAX_OCTETS: Final = 256 * 1024 * 1024
MAX_NOTES: Final = 100

#: How a server ends a connection, as far as that can be done again.
ENDS: Final = frozenset((FIN, RESET, DISCONNECT))


class ServerError(CaptureError):
    """A server cannot be made of this, or cannot begin: one line that says why and what to do."""


class Said:
    """What the server said without being asked: a push, a job of its own, an answer out of turn.

    ``waits`` tells that the client answered it before the server went on.
    """

    __slots__ = ("octets", "waits")

    def __init__(self, octets: bytes, waits: bool) -> None:
        self.octets = octets
        self.waits = waits


class Step:
    """A request as recorded, its answer (empty when there was none) and how long that took; then what the server said."""

    __slots__ = ("answer", "latency_ns", "request", "then")

    def __init__(self, request: bytes, answer: bytes, latency_ns: int) -> None:
        self.request = request
        self.answer = answer
        self.latency_ns = latency_ns
        self.then: list[Said] = []


class Script:
    """A recorded connection: its steps in the order in which they were asked.

    TSAPs are None where not recorded. ``confirm`` is the TPDU that answered the connect request (CC, DR or ER), empty where
    there is none; ``refused`` tells that the connect request was seen and never confirmed. ``end`` is how the server ended
    it (`ENDS`), else empty. ``pdu_length`` was granted, 0 when nobody knows.
    """

    __slots__ = ("called", "calling", "confirm", "end", "number", "pdu_length", "refused", "steps")

    def __init__(self, number: int) -> None:
        self.number = number
        self.calling: bytes | None = None
        self.called: bytes | None = None
        self.confirm = b""
        self.refused = False
        self.end = ""
        self.pdu_length = 0
        self.steps: list[Step] = []


class Recording:
    """The connections of a capture on which S7comm over TCP was spoken. ``notes`` say what of it cannot be served."""

    __slots__ = ("name", "notes", "scripts")

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.scripts: list[Script] = []
        self.notes: list[str] = []

    @property
    def steps(self) -> int:
        """Requests of all connections."""
        return sum([len(script.steps) for script in self.scripts])

    def note(self, text: str) -> None:
        """Keep what a user should know; the first hundred."""
        if len(self.notes) < MAX_NOTES:
            self.notes.append(text)


class _Begun:
    """What is gathered of a connection while it goes on; which side is the client may become known later."""

    __slots__ = ("confirm", "script", "seen")

    def __init__(self, number: int) -> None:
        self.script = Script(number)
        self.confirm = b""
        self.seen: list[_Seen] = []


class _Seen:
    """A transaction as octets, before it is put in its order."""

    __slots__ = (
        "answer",
        "answer_frame",
        "asked_by",
        "latency_ns",
        "number",
        "request",
        "request_frame",
        "unsolicited",
    )

    def __init__(self, transaction: Transaction, request: bytes, answer: bytes) -> None:
        self.number = int(transaction.number)
        self.asked_by = int(transaction.asked_by)
        self.request = request
        self.answer = answer
        self.request_frame = int(transaction.request_frame)
        self.answer_frame = int(transaction.response_frame)
        self.latency_ns = max(transaction.latency_ns or 0, 0)
        self.unsolicited = transaction.outcome == PUSH

    @property
    def place(self) -> tuple[int, int]:
        """What puts it in order."""
        return self.request_frame or self.answer_frame, self.number


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
        """Keep what answers the connect request."""
        if octets[HEADER + 1] >> 4 not in {CC, DR, ER}:
            return
        begun = self._of(side.connection)
        if not begun.confirm and not begun.seen and side.connection.role(side.index) == "server":
            begun.confirm = octets[HEADER:]

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
        begun.seen.append(_Seen(transaction, request, answer))

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
        if connection.udp or (connection.protocol not in {"", "S7comm"} and not begun.seen):
            self._recording.note(f"connection {script.number} speaks {connection.protocol}, which is not served")
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
        client = int(connection.client_side)
        _arrange(script, begun.seen, client, self._recording)
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


def _arrange(script: Script, seen: Iterable[_Seen], client: int, recording: Recording) -> None:
    """Make steps of the client's requests; what the server said otherwise follows the step before it."""
    lost = 0
    steps: list[tuple[int, Step]] = []
    others: list[_Seen] = []
    for one in sorted(seen, key=lambda one: one.place):
        pushed = one.unsolicited and one.asked_by != client  # by the client: such a one goes to the side that asked
        if pushed or (one.asked_by == client and one.request and not one.unsolicited):
            octets = one.request or one.answer
            answer = b"" if pushed else one.answer
            steps.append((one.answer_frame or one.request_frame, Step(octets, answer, one.latency_ns)))
        elif one.asked_by == client or one.request:
            others.append(one)
    for one in others:
        asked = one.asked_by != client
        octets, waits = (one.request, bool(one.answer)) if asked else (one.answer or one.request, False)
        before = [step for frame, step in steps if frame <= one.place[0]]
        if before:
            before[-1].then.append(Said(octets, waits))
        else:
            lost += 1
    script.steps = [step for _, step in steps]
    if lost:
        recording.note(
            f"connection {script.number}: {lost} messages of the server come before any request and are left out"
        )


def load_recording(path: str | Path, *more: str | Path) -> Recording:
    """Return what can be served of a capture (or of several, as `dissect.open` reads them) or of a golden.

    Raises `CaptureError` for what is no capture and `ServerError` when nothing in it can be served, or too much.
    """
    name = str(path)
    if not more and name != "-" and is_golden(path):
        try:
            return _served(_of_golden(read_session(path)))
        except GoldenError as error:
            raise ServerError(str(error)) from None
    reader = RecordingReader(name)
    run = Run([name, *[str(other) for other in more]], reader, Options())
    while run.step() and not reader.excess:
        pass
    run.finish()
    return reader.finish([f"{file.name}: {file.damage}" for file in run.files if file.damage])


def _of_golden(session: Golden) -> Recording:
    recording = Recording(session.name)
    for link in session.links:
        script = Script(link.number)
        script.calling, script.called = link.calling, link.called
        script.end = link.ended if link.ended in ENDS and link.ended_by == "server" else ""
        script.refused = link.begun and not link.tpdu_size and not link.transactions
        for transaction in link.transactions:
            exchange = transaction.exchange
            if exchange.kind != S7 or link.carrier != "tcp":
                continue
            if transaction.asked_by == "client" and exchange.request:
                step = Step(exchange.request, exchange.response, transaction.latency_ns or 0)
                granted = exchange.setup[1]
                if granted is not None:
                    script.pdu_length = granted.pdu_length
                script.steps.append(step)
            elif script.steps:
                octets = exchange.request if transaction.asked_by == "server" else exchange.response
                waits = transaction.outcome == "answered" and parse_pdu(octets).rosctr == JOB
                if octets:
                    script.steps[-1].then.append(Said(octets, waits))
        if script.steps or script.refused:
            recording.scripts.append(script)
    return recording
