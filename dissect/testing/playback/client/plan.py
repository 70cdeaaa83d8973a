"""The plan of a replay: for each recorded connection its beginning, its requests, the messages to wait for, and its end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU, FIN, RESET
from dissect.engine.transactions.transaction import CAPTURE_ENDED, CONNECTION_CLOSED, HOLE, REFERENCE_REUSED
from dissect.protocols.iso.build import build_connect, build_dr, size_parameter
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP
from dissect.protocols.iso.tables import CR, DR_REASONS
from dissect.protocols.s7.build import build_setup
from dissect.protocols.s7.parameters import Setup
from dissect.protocols.s7.tables import JOB, SETUP_COMMUNICATION
from dissect.testing.golden.exchange import PLUS, S7
from dissect.testing.golden.keys import subject
from dissect.testing.golden.model import Link, Session, Transaction
from dissect.testing.playback.client.download import Download, find_downloads
from dissect.testing.playback.client.partner import sent_by_server
from dissect.testing.playback.client.permissions import NO_ANSWER, Permissions
from dissect.testing.playback.client.plus import plus_kinds
from dissect.testing.playback.client.recorded import ReplayError
from dissect.testing.playback.protocols import DIGESTS, link_has_digests, plus_hint

# What is done with a transaction.
ASK: Final = "ask"
HEAR: Final = "hear"
SERVE: Final = "serve"

#: Requested if the recording lacks the beginning of a connection.
USUAL_CALLING: Final = b"\x01\x00"
USUAL_CALLED: Final = b"\x01\x02"
USUAL_TPDU_SIZE: Final = 1024
USUAL_SETUP: Final = Setup(1, 1, 960)

#: Why a part of a recording is not played.
NOT_S7: Final = "only S7comm and S7comm-plus over TCP are replayed"
SERVER_ASKED: Final = "requests of a PLC are only answered in downloads and for its BSENDs"
NOT_WHOLE: Final = "the recording lacks data that the PLC would request"
NO_REQUEST: Final = "its request is not in the recording"
FOLLOWS_WITHHELD: Final = "it belongs to a request that is withheld"
CLIENT_PUSH: Final = "a client message that is not a request"
MALFORMED: Final = "it follows a malformed TPDU header and was not answered"

_NORMAL: Final = 0x80  # reason of a DR: ended by the user
#: How either side ends a connection, if the recording shows it.
_ENDS: Final = {
    "client": frozenset((FIN, RESET, DISCONNECT)),
    "server": frozenset((FIN, RESET, DISCONNECT, ERROR_TPDU)),
}


class Withheld(NamedTuple):
    """A transaction that is not sent, and why. ``subject`` is safe to show."""

    connection: int
    transaction: int
    subject: str
    reason: str

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON-ready values."""
        return dict(zip(self._fields, self, strict=True))


def withheld(transaction: Transaction, reason: str) -> Withheld:
    """Return the entry for a transaction that is not sent."""
    return Withheld(transaction.connection.number, transaction.number, subject(transaction.exchange), reason)


class Step(NamedTuple):
    """One step of a connection.

    Its kind is a request to send (`ASK`), an unsolicited message of the server to wait for (`HEAR`), or a job of the server to
    wait for and answer (`SERVE`). ``download`` is the download of a Request download or of such a job; a BSEND of the server
    has none. ``heard``: the recording has data of the server on this connection. ``gap_ns`` is the time until the client's next
    request, None if unknown. ``effect`` is the effect of an S7comm-plus request, otherwise empty.
    """

    kind: str
    transaction: Transaction
    download: Download | None = None
    heard: bool = True
    gap_ns: int | None = None
    effect: str = ""

    def refusal(self, permissions: Permissions) -> str:
        """Return why this request must not be sent, empty if it may."""
        return permissions.refusal_of(self.effect) if self.effect else permissions.refusal(self.transaction.request)

    @property
    def expected(self) -> bool:
        """True if the recording has an answer."""
        return self.transaction.outcome != "unanswered"

    @property
    def silent(self) -> bool:
        """True if the server is known to have left the request unanswered."""
        known = self.transaction.reason in {CONNECTION_CLOSED, REFERENCE_REUSED}
        return self.heard and known and not self.expected

    @property
    def unknown(self) -> bool:
        """True if the recording does not show whether and how the request was answered."""
        return not self.expected and not self.silent

    @property
    def lost(self) -> bool:
        """True if the answer may exist but is missing from the recording."""
        went_on = self.transaction.reason == CAPTURE_ENDED and self.gap_ns is not None
        return self.unknown and not (self.heard and went_on)


class Part:
    """A connection that is played.

    ``known``: its beginning was recorded. ``own_setup`` is a Setup communication to send if none was recorded, otherwise empty.
    ``end`` is how it ends and ``by_client`` who ends it; if the recording does not show the end (``end_known``), we end it.
    ``span`` is its position in the recording, None if unknown. ``plus``: it uses S7comm-plus, without digests.
    """

    def __init__(self, link: Link, called: bytes | tuple[int, int] | None = None) -> None:
        self.link = link
        self.span = link.span
        self.known = bool(link.tpdu_size_asked or link.calling is not None or link.called is not None)
        self.calling = link.calling if self.known else USUAL_CALLING
        self.called = link.called if self.known else USUAL_CALLED
        if isinstance(called, bytes):
            self.called = called
        elif called is not None:
            kind = self.called[0] if self.called is not None and len(self.called) == 2 else USUAL_CALLED[0]
            self.called = bytes((kind, called[0] << 5 | called[1]))
        self.tpdu_size = link.tpdu_size_asked if self.known else USUAL_TPDU_SIZE
        self.end_known = link.ended in _ENDS.get(link.ended_by, ())
        self.end = link.ended if self.end_known else FIN
        self.by_client = not self.end_known or link.ended_by == "client"
        self.steps: list[Step] = []
        self.withheld: list[Withheld] = []
        self.downloads: list[Download] = []
        kinds = [one.exchange.kind for one in link.transactions]
        self.plus = link.carrier == "tcp" and PLUS in kinds and S7 not in kinds
        if self.plus:
            self._take_plus()
        else:
            self._take()
        self._see_gaps()
        requests = [step for step in self.steps if step.kind == ASK and not self.plus]
        setups = [step for step in requests if step.transaction.function == SETUP_COMMUNICATION]
        self.own_setup = build_setup(JOB, USUAL_SETUP) if requests and not setups else b""

    def _take(self) -> None:
        self.downloads = find_downloads(self.link.transactions)
        begins = {id(download.request): download for download in self.downloads}
        serves = {id(job): download for download in self.downloads for job in download.jobs}
        for transaction in self.link.transactions:
            pushed = transaction.outcome == "unsolicited"
            download = begins.get(id(transaction)) or serves.get(id(transaction))
            if transaction.exchange.kind != S7 or self.link.carrier != "tcp":
                self.withheld.append(withheld(transaction, NOT_S7))
            elif transaction.outcome == "behind_malformed":
                self.withheld.append(withheld(transaction, MALFORMED))
            elif download is not None and not download.whole:
                begins_it = transaction is download.request
                self.withheld.append(withheld(transaction, NOT_WHOLE if begins_it else FOLLOWS_WITHHELD))
            elif download is not None and transaction.asked_by == "server":
                self.steps.append(Step(SERVE, transaction, download))
            elif sent_by_server(transaction):
                self.steps.append(Step(SERVE, transaction))
            elif transaction.asked_by != "client":
                self.withheld.append(withheld(transaction, CLIENT_PUSH if pushed else SERVER_ASKED))
            elif transaction.request and not pushed:
                self.steps.append(Step(ASK, transaction, download))
            elif self.steps and transaction.reason != HOLE:
                self.steps.append(Step(HEAR, transaction))
            else:
                self.withheld.append(withheld(transaction, NO_REQUEST))

    def _take_plus(self) -> None:
        """Take the requests and the unsolicited messages of a session without digests."""
        sealed = link_has_digests(self.link)
        kinds = plus_kinds(self.link.transactions)
        for transaction in self.link.transactions:
            ours = transaction.exchange.kind == PLUS
            if sealed or not ours:
                self.withheld.append(withheld(transaction, DIGESTS if ours else NOT_S7))
            elif transaction.asked_by == "client" and transaction.request:
                self.steps.append(Step(ASK, transaction, effect=kinds[id(transaction)]))
            elif transaction.asked_by == "client" and self.steps and transaction.reason != HOLE:
                self.steps.append(Step(HEAR, transaction))
            else:
                self.withheld.append(withheld(transaction, NO_REQUEST))

    def _see_gaps(self) -> None:
        """Set for each request how long the client waited, and whether the server was captured."""
        link = self.link
        heard = bool(link.tpdu_size or link.refused or link.ended_by == "server")
        heard = heard or any([each.response or each.asked_by == "server" for each in link.transactions])
        end_ns = self.span.last_ns if self.span is not None and link.ended else None
        for at in range(len(self.steps) - 1, -1, -1):
            step = self.steps[at]
            if step.kind == ASK:
                begin_ns = step.transaction.time_ns
                gap_ns = max(end_ns - begin_ns, 0) if end_ns is not None and begin_ns is not None else None
                self.steps[at] = step._replace(heard=heard, gap_ns=gap_ns)
                end_ns = begin_ns

    def connect_request(self, reference: int) -> bytes:
        """Return the CR. Raises `ReplayError` if it has no room for the TSAPs: those of a golden may have any length."""
        parameters = [size_parameter(self.tpdu_size)] if self.tpdu_size else []
        tsaps = ((CALLING_TSAP, self.calling), (CALLED_TSAP, self.called))
        parameters += [(code, value) for code, value in tsaps if value is not None]
        try:
            return build_connect(CR, 0, reference, parameters)
        except ValueError as error:
            raise ReplayError(
                f"connection {self.link.number}: its TSAPs and its TPDU size do not fit: {error}"
            ) from None

    def disconnect_request(self, reference: int, theirs: int) -> bytes:
        """Return the DR with which the client ended the connection, with the recorded reason."""
        reason = self.link.farewell.rpartition(": ")[2]
        reasons = [row.number for row in DR_REASONS if row.name == reason]
        return build_dr(theirs, reference, reasons[0] if reasons else _NORMAL)


def make_plan(
    session: Session, numbers: Sequence[int] = (), called: bytes | tuple[int, int] | None = None
) -> list[Part]:
    """Return the connections to play, all or those of ``numbers``, in the order in which they began.

    ``called`` is the TSAP to call instead of the recorded ones, or rack (0 to 7) and slot (0 to 31) to put into them. Raises
    `ReplayError` for an unknown number, and if nothing can be played.
    """
    for number in numbers:
        if not 1 <= number <= len(session.links):
            have = (
                f"it has {len(session.links)}, numbered as `s7dissect golden` numbers them"
                if session.links
                else "it has none"
            )
            raise ReplayError(f"{session.name}: there is no connection {number}: {have}")
    links = [link for link in session.as_begun if not numbers or link.number in numbers]
    parts = [Part(link, called) for link in links]
    if not any([_playable(part) for part in parts]):
        raise ReplayError(
            f"{session.name}: no connection in it speaks S7comm over TCP, so there is nothing to replay{plus_hint(session)}"
        )
    for part in playable(parts):
        part.connect_request(0)  # report an impossible connect request before anything is sent
    return parts


def _playable(part: Part) -> bool:
    """Return whether a connection can be played: it has requests, or was refused before it could send any."""
    link = part.link
    mute = part.known and not link.transactions and link.protocol in {"", "S7comm"}
    return link.carrier == "tcp" and (mute or any([step.kind == ASK for step in part.steps]))


def playable(plan: Sequence[Part]) -> list[Part]:
    """Return the connections that can be played."""
    return [part for part in plan if _playable(part)]


def _serve_line(step: Step, about: str, permissions: Permissions) -> str:
    """Return a line on whether requests of the PLC would be answered."""
    if step.download is None:
        return f"  answer {about}, which the PLC sends" if permissions.control else f"  withhold {about}: {NO_ANSWER}"
    kept = bool(permissions.refusal(step.download.request.request))
    return f"  withhold {about}: {FOLLOWS_WITHHELD}" if kept else f"  answer {about}, which the PLC requests"


def plan_lines(plan: Sequence[Part], permissions: Permissions) -> list[str]:
    """Describe what would be sent and what would not, as far as that is known before the server has answered anything."""
    from dissect.protocols.iso.tsap import Tsap

    lines = []
    for part in plan:
        calling, called = [str(Tsap(tsap)) if tsap is not None else "no TSAP" for tsap in (part.calling, part.called)]
        does = f"connect {calling} -> {called}, TPDU size {part.tpdu_size}" if _playable(part) else "not played"
        lines.append(f"connection {part.link.number}: {does}")
        if part.own_setup and _playable(part):
            lines.append("  send a default SETUP, none was recorded")
        reasons = {one.transaction: one.reason for one in part.withheld}
        steps = {step.transaction.number: step for step in part.steps}
        for transaction in part.link.transactions:
            about = f"transaction {transaction.number}, {subject(transaction.exchange)}"
            step = steps.get(transaction.number)
            if step is None:
                lines.append(f"  withhold {about}: {reasons[transaction.number]}")
            elif step.kind == HEAR:
                lines.append(f"  wait for {about}, which was not requested")
            elif step.kind == SERVE:
                lines.append(_serve_line(step, about, permissions))
            else:
                reason = step.refusal(permissions)
                lines.append(f"  withhold {about}: {reason}" if reason else f"  send {about}")
    return lines
