"""The served data: recorded connections with requests, answers, and unsolicited messages of the server."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU, FIN, RESET
from dissect.meaning.report.words import PROTOCOLS

MAX_NOTES: Final = 100

#: Ends by the server that can be repeated.
ENDS: Final = frozenset((FIN, RESET, DISCONNECT, ERROR_TPDU))


class ServerMessage:
    """An unsolicited message of the server: a push, a job, an answer out of turn.

    ``answered``: the client answered it. ``waits`` is the number of the client's answers, to this and to earlier messages,
    before the server's next message.
    """

    __slots__ = ("answered", "octets", "waits")

    def __init__(self, octets: bytes, answered: bool = False, waits: int = 0) -> None:
        self.octets = octets
        self.answered = answered
        self.waits = waits


class RecordedStep:
    """A recorded request, its answer (empty if there was none) and answer time, and the server's messages after it."""

    __slots__ = ("answer", "latency_ns", "request", "then")

    def __init__(self, request: bytes, answer: bytes, latency_ns: int) -> None:
        self.request = request
        self.answer = answer
        self.latency_ns = latency_ns
        self.then: list[ServerMessage] = []


class Script:
    """A recorded connection: its steps in order.

    TSAPs are None if not recorded. ``confirm`` is the TPDU that answered the connect request (CC, DR or ER), empty if there is
    none. ``refused``: the connect request was captured and never confirmed. ``end`` is how the server ended the connection
    (`ENDS`), otherwise empty; ``farewell`` the DR or ER with which it did. ``pdu_length`` was negotiated, 0 if unknown.
    ``plus``: it uses S7comm-plus. ``numbered``: references are those of the recording; a golden has none.
    """

    __slots__ = (
        "called",
        "calling",
        "confirm",
        "end",
        "farewell",
        "number",
        "numbered",
        "pdu_length",
        "plus",
        "refused",
        "steps",
    )

    def __init__(self, number: int) -> None:
        self.number = number
        self.calling: bytes | None = None
        self.called: bytes | None = None
        self.confirm = b""
        self.refused = False
        self.end = ""
        self.farewell = b""
        self.pdu_length = 0
        self.plus = False
        self.numbered = True
        self.steps: list[RecordedStep] = []


class Recording:
    """The connections of a capture with S7comm or S7comm-plus over TCP; ``notes`` describe the parts that are not served."""

    __slots__ = ("name", "notes", "scripts")

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.scripts: list[Script] = []
        self.notes: list[str] = []

    @property
    def steps(self) -> int:
        """Requests of all connections."""
        return sum([len(script.steps) for script in self.scripts])

    def unserved(self, number: int, protocol: str, carrier: str, reason: str = "") -> None:
        """Note a connection with a different protocol or without TCP."""
        protocol_name = " over ".join(
            dict.fromkeys([part for part in (PROTOCOLS.get(protocol, protocol), carrier) if part])
        )
        self.note(f"connection {number} speaks {protocol_name}, which is not served{reason}")

    def note(self, text: str) -> None:
        """Keep a note for the user; only the first hundred are kept."""
        if len(self.notes) < MAX_NOTES:
            self.notes.append(text)
