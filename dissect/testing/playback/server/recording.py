"""Builds scripts for the server from a recorded session (`dissect.testing.golden.model`)."""

from __future__ import annotations

import os
from typing import Final

from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU
from dissect.packets.source.packet import CaptureError
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.tables import CC
from dissect.testing.golden.exchange import PLUS, S7
from dissect.testing.golden.model import GoldenError, Link, Session, Transaction
from dissect.testing.golden.reading import read_session
from dissect.testing.playback.protocols import DIGESTS, link_has_digests, plus_hint
from dissect.testing.playback.server.answers import farewell
from dissect.testing.playback.server.arranging import Seen, arrange
from dissect.testing.playback.server.model import ENDS, Recording, Script

#: Maximum number of requests in a recording; a test is never longer.
MAX_STEPS: Final = 200_000

#: Ends that a TPDU announces.
_FAREWELLS: Final = frozenset((DISCONNECT, ERROR_TPDU))
_SERVED: Final = frozenset((S7, PLUS))
_OURS: Final = frozenset(("", "s7comm"))


class ServerError(CaptureError):
    """A server that cannot be built from this, or cannot begin; the message says in one line why and what to do."""


def load_recording(path: str | os.PathLike[str], *more: str | os.PathLike[str]) -> Recording:
    """Return what can be served of a capture (or of several, as `dissect.open` reads them) or of a golden.

    Raises `CaptureError` for a file that is no capture, and `ServerError` if it has nothing to serve, or too much.
    """
    try:
        return recording_of(read_session(path, *more, messages=True))
    except GoldenError as error:
        raise ServerError(str(error)) from None


def recording_of(session: Session) -> Recording:
    """Return what can be served of a session. Raises `ServerError` if there is nothing to serve, or too much."""
    recording = Recording(session.name)
    served = {link.number: [one for one in link.transactions if one.exchange.kind in _SERVED] for link in session.links}
    if sum([len(transactions) for transactions in served.values()]) > MAX_STEPS:
        raise ServerError(f"{session.name}: more than {MAX_STEPS} transactions; cut it first (s7dissect cut)")
    for link in session.as_begun:
        if link.carrier == "tcp" and link.protocol not in _OURS and link_has_digests(link):
            number = link.span.number if link.span is not None else link.number
            recording.unserved(number, link.protocol, "", f": {DIGESTS}")
            continue
        _add(recording, link, served[link.number])
    for text in session.damage:
        recording.note(text)
    if not recording.scripts:
        raise ServerError(
            f"{session.name}: no connection in it speaks S7comm over TCP, so there is nothing to serve{plus_hint(session)}"
        )
    return recording


def _add(recording: Recording, link: Link, transactions: list[Transaction]) -> None:
    """Add the script of a connection, or note why it has none."""
    script = Script(link.span.number if link.span is not None else link.number)
    if link.carrier != "tcp" or (link.protocol not in _OURS and not transactions):
        carrier = {"udp": "UDP", "ibh": "IBH-NetLink"}.get(link.carrier, "")
        recording.unserved(script.number, link.protocol, carrier)
        return
    script.plus = bool(transactions) and all([one.exchange.kind == PLUS for one in transactions])
    if not script.plus:
        transactions = [one for one in transactions if one.exchange.kind == S7]
    script.calling, script.called = link.calling, link.called
    script.end = link.ended if link.ended in ENDS and link.ended_by == "server" else ""
    tpdus = link.tpdus
    if tpdus is None:
        # A golden has the end and the refusal in words, and no counters.
        script.numbered = False
        script.farewell = farewell(script.end, link.farewell.rpartition(": ")[2])
        script.refused = link.begun and not link.tpdu_size and not link.transactions
        if script.refused:
            script.confirm = farewell(DISCONNECT, link.refused) if link.refused else script.farewell
        for transaction in transactions:
            granted = transaction.exchange.setup[1]
            if transaction.asked_by == "client" and granted is not None:
                script.pdu_length = granted.pdu_length
    else:
        script.farewell = tpdus.farewell if script.end in _FAREWELLS else b""
        script.confirm = tpdus.confirm
        script.refused = tpdus.requested and (not tpdus.confirm or parse_tpdu(tpdus.confirm).type != CC)
        if script.refused and transactions:
            script.refused = False  # it continues: only the confirmation was not captured
            script.confirm = b""
        script.pdu_length = tpdus.pdu_length
    arrange(script, [Seen(one, number) for number, one in enumerate(transactions, 1)], recording)
    if script.steps or script.refused or (tpdus is not None and tpdus.requested):
        recording.scripts.append(script)


__all__ = ["MAX_STEPS", "Recording", "ServerError", "load_recording", "recording_of"]
