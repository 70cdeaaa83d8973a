"""What is served: recorded connections, on each what was asked, what was answered, what the server said by itself."""

from __future__ import annotations

from typing import Final

from dissect.report.words import PROTOCOLS
from dissect.transactions.ending import DISCONNECT, ERROR_TPDU, FIN, RESET

MAX_NOTES: Final = 100

#: How a server ends a connection, as far as that can be done again.
ENDS: Final = frozenset((FIN, RESET, DISCONNECT, ERROR_TPDU))


class Said:
    """What the server said without being asked: a push, a job of its own, an answer out of turn.

    ``answered`` tells that the client answered it. ``waits`` is how many answers of the client, to this and to what was said
    before, came before the server went on.
    """

    __slots__ = ("answered", "octets", "waits")

    def __init__(self, octets: bytes, answered: bool = False, waits: int = 0) -> None:
        self.octets = octets
        self.answered = answered
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
    it (`ENDS`), else empty; ``farewell`` the DR or ER with which it did. ``pdu_length`` was granted, 0 when nobody knows.
    ``plus``: it speaks S7comm-plus. ``numbered`` tells that references are those of the recording: a golden has none.
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
        self.steps: list[Step] = []


class Recording:
    """The connections of a capture on which S7comm or S7comm-plus was spoken over TCP; ``notes`` say what is not served."""

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
        """Note a connection that speaks something else, or over something else than TCP."""
        said = " over ".join(dict.fromkeys([part for part in (PROTOCOLS.get(protocol, protocol), carrier) if part]))
        self.note(f"connection {number} speaks {said}, which is not served{reason}")

    def note(self, text: str) -> None:
        """Keep what a user should know; the first hundred."""
        if len(self.notes) < MAX_NOTES:
            self.notes.append(text)
