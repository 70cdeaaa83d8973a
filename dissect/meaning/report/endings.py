"""How connections ended, as text and as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU, EVICTED, FIN, OPEN, REPLACED, RESET, REUSED
from dissect.meaning.report import words
from dissect.wire.text import Clock

if TYPE_CHECKING:
    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.ending import Ending
    from dissect.meaning.report.words import Places
    from dissect.protocols.s7.parameters import Parameters

#: Why a connection ended that neither side closed.
_DROPPED: Final = {
    REUSED: "replaced by a new connection on the same addresses",
    EVICTED: "dropped, too many connections were open",
    REPLACED: "replaced by a new connection on the same addresses",
}


def short(connection: Connection) -> str:
    """Return who ended a connection, for example ``closed by the client``; empty while it is open."""
    ending = connection.ending
    if ending is None or ending.how == OPEN:
        return ""
    if ending.how in _DROPPED:
        return _DROPPED[ending.how]
    return f"{'reset' if ending.how == RESET else 'closed'} by the {connection.role(ending.side)}"


def phrase(connection: Connection, places: Places) -> str:
    """Return how a connection ended, the requests that were open then and the last message, as the end of a sentence."""
    ending = connection.ending
    begun = "already open at the start, " if connection.mid_stream and not connection.tcp.known_start else ""
    if connection.udp:
        begun = ""
    if connection.udp and (ending is None or ending.how == OPEN):
        said = f"last datagram at {places.phrase([int(connection.last_frame)])}"
    elif ending is None or ending.how == OPEN:
        said = "still open at the end of the capture"
    elif ending.how in _DROPPED:
        said = _DROPPED[ending.how]
    elif ending.how in {DISCONNECT, ERROR_TPDU}:
        tpdu = "disconnect request" if ending.how == DISCONNECT else "error TPDU"
        reason = connection.iso_ended.partition(": ")[2]
        said = f"closed by the {connection.role(ending.side)} (COTP {tpdu}, {reason})"
    else:
        role = connection.role(ending.side)
        said = f"{'closed' if ending.how == FIN else 'reset'} by the {role} at {places.phrase([int(ending.frame)])}"
    if ending is not None and ending.reset_frame:
        said += f", reset by the {connection.role(ending.reset_side)} at {places.phrase([int(ending.reset_frame)])}"
    return f"{begun}{said}{_before(ending, places) if ending is not None else ''}"


def _before(ending: Ending, places: Places) -> str:
    """Return the open requests and the last message; empty for a connection that was closed normally with nothing open."""
    if ending.connecting and ending.how != OPEN:
        return " before the connect request was answered"
    parts = ""
    oldest = ending.oldest
    if oldest is not None:
        at = places.phrase([int(ending.oldest_frame)])
        first = "" if ending.open_requests == 1 else "the oldest is "
        open_then = words.count(ending.open_requests, "request")
        parts = f" with {open_then} pending: {first}{oldest.subject} ({at}), {ending.age()}"
    elif ending.how in {FIN, DISCONNECT, OPEN}:
        return ""
    return parts + ending.last_heard(
        "answer, a refusal," if ending.last_error_ns == ending.last_answer_ns else "answer"
    )


def ending_as_dict(connection: Connection, places: Places) -> dict[str, object] | None:
    """Return the ``ending`` of a connection for JSON, None while it is not over."""
    ending = connection.ending
    if ending is None:
        return None
    ends = connection.tcp.ends
    frame = int(ending.frame)
    values: dict[str, object] = {
        "how": ending.how,
        "by": str(ends[ending.side]) if ending.side >= 0 else None,
        "role": connection.role(ending.side) if ending.side >= 0 else None,
        "frame": places.number(frame) if frame else None,
        "time": Clock().iso(ending.time_ns),
        "reset": _reset(connection, ending, places),
        "silence_ns": ending.silence_ns,
        "connecting": ending.connecting,
        "open_requests": ending.open_requests,
        "oldest_request": _event(ending.oldest, ending.oldest_ns, ending),
        "last_request": _event(ending.last_request, ending.last_request_ns, ending),
        "last_answer": _event(ending.last_answer, ending.last_answer_ns, ending),
        "last_error": _error(ending),
    }
    if places.several:
        values["file"] = places.locate(frame)[0] if frame else None
    return values


def _reset(connection: Connection, ending: Ending, places: Places) -> dict[str, object] | None:
    """Return the RST that came after the beginning of another end (FIN, for example), None if there is none."""
    if not ending.reset_frame:
        return None
    frame = int(ending.reset_frame)
    values: dict[str, object] = {
        "by": str(connection.tcp.ends[ending.reset_side]),
        "role": connection.role(ending.reset_side),
        "frame": places.number(frame),
        "time": Clock().iso(ending.reset_ns),
    }
    if places.several:
        values["file"] = places.locate(frame)[0]
    return values


def _event(asked: Parameters | None, time_ns: int, ending: Ending) -> dict[str, object] | None:
    return {"what": asked.subject, "before_ns": int(ending.time_ns - time_ns)} if asked is not None else None


def _error(ending: Ending) -> dict[str, object] | None:
    told = _event(ending.last_error, ending.last_error_ns, ending)
    if told is not None:
        told["code"] = ending.last_error_code or None
    return told
