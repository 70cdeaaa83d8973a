"""`Ending`: how a connection ended, which side ended it, what was open then, and what happened before. It only states facts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64, mypyc_attr

from dissect.wire.copies import leaves
from dissect.wire.text import distance_text, duration_text

if TYPE_CHECKING:
    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.transaction import Transaction
    from dissect.protocols.s7.parameters import Parameters

# The ways in which a connection ends (`Ending.how`).
FIN: Final = "fin"
RESET: Final = "reset"
DISCONNECT: Final = "disconnect"
ERROR_TPDU: Final = "error_tpdu"
REUSED: Final = "reused"
REPLACED: Final = "replaced"
EVICTED: Final = "evicted"
OPEN: Final = "open"


#: The action of a side that ended a connection, by `Ending.how`.
_DEEDS: Final[dict[str, str]] = {
    FIN: "closed the connection",
    RESET: "reset the connection",
    DISCONNECT: "ended the connection (COTP DR)",
    ERROR_TPDU: "ended the connection (COTP ER)",
}


@mypyc_attr(acyclic=True)  # many are kept, and each is smaller without the header of the garbage collector
class Ending:
    """The end of a connection, or of the capture if the connection was still open.

    ``how`` is one of the words above, ``side`` the side that ended it (-1: neither), ``frame`` the packet that shows it (0 for
    none) and ``time_ns`` its time. ``reset_side``, ``reset_frame`` and ``reset_ns`` are side, packet and time of a RST after an
    end of another kind, as S7-1200/1500 answer a FIN (-1, 0 and 0 for none).

    ``last_frame`` and ``last_ns`` are the latest packet until then and its time: the TCP connection may continue with a new
    conversation.

    ``open_requests`` is the number of open requests, without those whose answer may be in a gap or in a direction that was not
    captured. ``oldest`` is the first of them, with its packet and time. ``connecting``: the connect request had no answer of
    any kind.

    ``last_request``, ``last_answer`` and ``last_error`` (a refusal) are the parameters of these requests, each with its time
    (None and 0 for none); of the server's last message in TLS only the time is known. ``last_error_code`` is the error code of
    the whole answer, 0 when only an item was refused.
    """

    __slots__ = (
        "connecting",
        "frame",
        "how",
        "last_answer",
        "last_answer_ns",
        "last_encrypted_ns",
        "last_error",
        "last_error_code",
        "last_error_ns",
        "last_frame",
        "last_ns",
        "last_request",
        "last_request_ns",
        "oldest",
        "oldest_frame",
        "oldest_ns",
        "open_requests",
        "reset_frame",
        "reset_ns",
        "reset_side",
        "side",
        "time_ns",
    )

    def __init__(self, connection: Connection, asked: list[Transaction], frame: i64, now_ns: i64) -> None:
        """``asked`` are the open requests, ``frame`` and ``now_ns`` the current packet and its time."""
        tcp = connection.tcp
        self.how: str = tcp.ended or OPEN
        self.side: i64 = tcp.ended_by
        self.frame: i64 = tcp.ended_frame
        self.time_ns: i64 = tcp.ended_ns
        if connection.closed_reason == REPLACED:
            self._set(REPLACED, -1, frame, now_ns)
        elif connection.iso_ended_how and connection.iso_ended_ns >= max(
            connection.last_request_ns, connection.last_answer_ns
        ):
            self._set(
                connection.iso_ended_how, connection.iso_ended_by, connection.iso_ended_frame, connection.iso_ended_ns
            )
        elif self.how == OPEN:
            self.time_ns = now_ns
        elif self.how == EVICTED:
            self.time_ns = tcp.last_ns
        self.reset_side: i64 = -1
        self.reset_frame: i64 = 0
        self.reset_ns: i64 = 0
        if tcp.reset_frame > 0 and tcp.reset_frame != self.frame and self.how in _DEEDS:
            self.reset_side = tcp.reset_by
            self.reset_frame = tcp.reset_frame
            self.reset_ns = tcp.reset_ns
        self.connecting: bool = (
            connection.cr_seen
            and connection.tpdu_size == 0
            and connection.pdus == 0
            and tcp.streams[1 - connection.client_side].octets == 0
        )
        self.last_frame: i64 = tcp.last_frame
        self.last_ns: i64 = tcp.last_ns
        self.last_request: Parameters | None = connection.last_request
        self.last_request_ns: i64 = connection.last_request_ns
        self.last_answer: Parameters | None = connection.last_answer
        self.last_answer_ns: i64 = connection.last_answer_ns
        self.last_encrypted_ns: i64 = connection.last_encrypted_ns
        self.last_error: Parameters | None = connection.last_error
        self.last_error_ns: i64 = connection.last_error_ns
        self.last_error_code: i64 = connection.last_error_code
        self.open_requests: i64 = len(asked)
        self.oldest: Parameters | None = None
        self.oldest_frame: i64 = 0
        self.oldest_ns: i64 = 0
        if asked:
            first = asked[0]
            for found in asked:
                if found.number < first.number:
                    first = found
            self.oldest = first.parameters
            self.oldest_frame = first.request_frame
            self.oldest_ns = first.request_ns

    def __repr__(self) -> str:
        return f"Ending({self.how}{f', packet {self.frame}' if self.frame else ''})"

    def _set(self, how: str, side: i64, frame: i64, time_ns: i64) -> None:
        self.how = how
        self.side = side
        self.frame = frame
        self.time_ns = time_ns

    def last_heard(self, answer: str = "answer") -> str:
        """Return the last message of the server and its time, empty if there is none: ``; last answer 1.20 s earlier``."""
        if self.last_encrypted_ns > self.last_answer_ns:
            return f"; last encrypted message of the server {distance_text(self.time_ns - self.last_encrypted_ns)}"
        if self.last_answer is None:
            return ""
        return f"; last {answer} {distance_text(self.time_ns - self.last_answer_ns)}"

    def deed(self, connection: Connection) -> str:
        """Return which side ended the connection and how, empty if neither did: ``the server reset the connection``."""
        if self.how not in _DEEDS:
            return ""
        if self.reset_frame and self.reset_side != self.side:
            return f"{self._first_deed(connection)}, the {connection.role(self.reset_side)} reset it,"
        return f"{self._first_deed(connection)}{' and reset it' if self.reset_frame else ''}"

    def deed_after(self, connection: Connection, asked_frame: i64, asked_ns: i64) -> str:
        """Return `deed` with its time relative to a request: ``the server reset the connection 1.20 s later``.

        ``asked_frame`` and ``asked_ns`` are packet and time of the request. Empty when neither side ended the connection.
        """
        if self.how not in _DEEDS:
            return ""
        if asked_ns > self.time_ns:
            if asked_frame < self.frame:
                return self.deed(connection).removesuffix(",")  # the clock ran backwards between the two
            return f"sent {duration_text(asked_ns - self.time_ns)} after {self._first_deed(connection)}"
        return f"{self.deed(connection)} {duration_text(self.time_ns - asked_ns)} later"

    def age(self) -> str:
        """Return how old the oldest open request was at the end: ``1.20 s old``.

        It may even have been sent after the end began, because a side may still send requests after the other side's FIN.
        """
        asked_ns = self.oldest_ns
        if asked_ns > self.time_ns:
            if self.oldest_frame < self.frame or not self.frame:
                return "of unknown age, the clock ran backwards"
            return f"sent {duration_text(asked_ns - self.time_ns)} after the end had begun"
        return f"{duration_text(self.time_ns - asked_ns)} old"

    def _first_deed(self, connection: Connection) -> str:
        return f"the {connection.role(self.side)} {_DEEDS[self.how]}"

    @property
    def cut(self) -> bool:
        """True when a side ended the connection while a request or the connect request was unanswered."""
        return self.how in _DEEDS and (self.open_requests > 0 or self.connecting)

    @property
    def silence_ns(self) -> int | None:
        """Time from the last request, answer or encrypted message to the end, None if there was none."""
        last: int = max(self.last_request_ns, self.last_answer_ns, self.last_encrypted_ns)
        return self.time_ns - last if last else None


def _taken(_ending: Ending) -> tuple[Connection, list[Transaction], int, int]:
    """An empty connection: the real one has a reference back to its ending."""
    from dissect.engine.transactions.connection import Connection
    from dissect.packets.tcp.connection import TcpConnection
    from dissect.packets.tcp.stream import Endpoint

    nowhere = Endpoint(b"", 0)
    return Connection(0, TcpConnection(nowhere, nowhere, 0, 0, 0)), [], 0, 0


leaves(Ending, taken=_taken)
