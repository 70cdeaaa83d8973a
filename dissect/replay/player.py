"""One recorded connection played: each request after what came before it in the recording, each answer waited for."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Final

from dissect.golden.model import Transaction
from dissect.proxy.addresses import Place
from dissect.replay.channel import Channel, UnreachableError, connect
from dissect.replay.download import Downloads
from dissect.replay.kinds import Permissions
from dissect.replay.plan import ASK, FOLLOWS_WITHHELD, HEAR, SERVE, Part, Step, Withheld, withheld
from dissect.replay.record import Record
from dissect.replay.renewal import Renewal
from dissect.s7.message import HEADER_SIZE, PROTOCOL_ID, parse_pdu
from dissect.s7.parameters import REQUEST, RESPONSE
from dissect.s7.tables import ACK, ACK_DATA, JOB, SETUP_COMMUNICATION, USERDATA
from dissect.server.answers import with_reference
from dissect.transactions.ending import DISCONNECT, FIN, RESET

#: How long to wait for an answer that the recording says does not come, and for the other side's end after ours, in seconds.
_SILENCE_S: Final = 0.25
_END_S: Final = 1.0
#: Answers in a row that do not come until a server is given up.
MAX_TIMEOUTS: Final = 3
_FIRST_REFERENCE: Final = 1
_REFERENCE: Final = slice(4, 6)
NOT_GRANTED: Final = "the Setup communication was not granted"
NOT_LOADED: Final = "the download did not go on as it was recorded"


class Settings:
    """How it is played.

    ``pace`` multiplies the recorded pauses, None asks as soon as possible. ``timeout_s`` is for each answer. ``pipelined``
    sends requests before earlier ones are answered where the recording does, as many at once as the server grants.
    ``retries`` are attempts to connect after the first; no request is ever sent twice.
    """

    def __init__(
        self, pace: float | None = None, timeout_s: float = 5.0, pipelined: bool = False, retries: int = 0
    ) -> None:
        self.pace = pace
        self.timeout_s = timeout_s
        self.pipelined = pipelined
        self.retries = retries


class Player:
    """Plays ``part`` to a server.

    Afterwards: ``sent`` maps our references to what was asked with them, in that order; ``withheld`` is what was left out,
    ``not_sent`` what could not be sent any more; ``unheard`` are (by ``id``) messages of the server that were not waited for,
    as they belong to something withheld. ``requests`` and ``answered`` are counted, ``served`` the jobs of the server that
    were answered, ``server_jobs`` those that nobody answered. ``problem`` says why it ended early; ``unreachable`` that it did
    not begin.
    """

    def __init__(self, part: Part, permissions: Permissions, settings: Settings, record: Record) -> None:
        self.part = part
        self.withheld: list[Withheld] = list(part.withheld)
        self.not_sent: list[Transaction] = []
        self.sent: dict[int, Transaction] = {}
        self.unheard: set[int] = set()
        self.name = ""
        self.setup_reference = 0
        self.requests = 0
        self.answered = 0
        self.served = 0
        self.server_jobs = 0
        self.problem = ""
        self.unreachable = False
        self._permissions = permissions
        self._settings = settings
        self._record = record
        self._renewal = Renewal()
        self._downloads = Downloads(part.downloads)
        self._kept: set[int] = set()  # ids of what was withheld here
        self._open: dict[
            int, tuple[Transaction | None, float]
        ] = {}  # reference: what was asked, and by when it is late
        self._timeouts = 0
        self._heard = 0  # messages that are no answers
        self._awaited = 0
        self._deaf = False
        self._silenced: Transaction | None = None  # the request before, where it was withheld
        self._at_once = 1
        self._began = 0.0

    def play(self, places: Sequence[Place]) -> None:
        """Connect, ask, end."""
        channel = self._connect(places)
        if channel is None:
            self._leave(self.part.steps)
            return
        self.name = channel.name
        try:
            confirmed = channel.open(self.part.connect_request(_FIRST_REFERENCE), self._until())
            if confirmed:
                self._converse(channel)
            else:
                expected = bool(self.part.link.refused) or not self.part.link.transactions
                if not expected:
                    self.problem = f"the connect request was {'refused' if channel.refused else 'not confirmed'}"
                self._leave(self.part.steps)
            self._end(channel)
        except BaseException:
            channel.reset()
            raise

    def _connect(self, places: Sequence[Place]) -> Channel | None:
        for attempt in range(self._settings.retries + 1):
            if attempt:
                time.sleep(min(attempt, 5) * 0.2)
            try:
                return Channel(connect(places, self._settings.timeout_s), self._record)
            except UnreachableError as why:
                self.problem = f"no connection: {why}"
        self.unreachable = True
        return None

    def _until(self) -> float:
        return time.monotonic() + self._settings.timeout_s

    def _leave(self, steps: Sequence[Step]) -> None:
        """Sort out what is not sent any more: what was not to be sent anyhow stays withheld."""
        for step in steps:
            if step.kind == ASK:
                reason = self._permissions.refusal(step.transaction.request)
                if reason:
                    self._keep(step.transaction, reason)
                else:
                    self.not_sent.append(step.transaction)
            elif self._follows_kept(step):
                self._keep(step.transaction, FOLLOWS_WITHHELD)

    def _keep(self, transaction: Transaction, reason: str) -> None:
        self._kept.add(id(transaction))
        self.withheld.append(withheld(transaction, reason))
        if reason == FOLLOWS_WITHHELD:
            self.unheard.add(id(transaction))

    def _follows_kept(self, step: Step) -> bool:
        """Tell whether this is a job of the server in a download that is withheld."""
        return step.kind == SERVE and step.download is not None and id(step.download.request) in self._kept

    # ---- the conversation -------------------------------------------------------------------------------------------

    def _converse(self, channel: Channel) -> None:
        steps = self.part.steps
        if self.part.own_setup and not self._set_up(channel):
            self._leave(steps)
            return
        self._began = time.monotonic()
        for at, step in enumerate(steps):
            self._pause(channel, step)
            if step.kind == HEAR:
                self._hear(channel, step.transaction)
            elif step.kind == SERVE:
                if not self._serve(channel, step):
                    self.problem = "" if channel.ended else NOT_LOADED
                    self._leave(steps[at + 1 :])
                    break
            elif not self._ask(channel, steps, at):
                self._leave(steps[at:])
                break
            elif self._setup_failed(step.transaction):
                self.problem = NOT_GRANTED
                self._leave(steps[at + 1 :])
                break
            if self._timeouts >= MAX_TIMEOUTS:
                self.problem = f"{MAX_TIMEOUTS} requests in a row were not answered in time"
                self._leave(steps[at + 1 :])
                break
        self._settle(channel, 0)
        if channel.ended and self.not_sent and not self.problem:
            self.problem = f"the connection was {channel.ended}"

    def _set_up(self, channel: Channel) -> bool:
        """Agree on a PDU length where the recording does not have that."""
        number, octets = self._renewal.renewed(self.part.own_setup)
        self.setup_reference = number
        self._send(channel, number, octets, None)
        self._settle(channel, 0)
        if not self._renewal.pdu_length:
            self.problem = NOT_GRANTED
        return bool(self._renewal.pdu_length)

    def _ask(self, channel: Channel, steps: Sequence[Step], at: int) -> bool:
        """Send a request, or withhold it; False when nothing can be sent any more."""
        step = steps[at]
        transaction = step.transaction
        reason = self._permissions.refusal(transaction.request) or self._renewal.refusal(transaction)
        if not reason and step.download is not None:
            reason = step.download.refusal(self._renewal.pdu_length)
        self._silenced = transaction if reason else None
        if reason:
            self._keep(transaction, reason)
            return True
        number, octets = self._renewal.renewed(transaction.request)
        if channel.ended or self._permissions.refusal(octets):  # what is sent is what was allowed
            return False
        self._send(channel, number, octets, transaction)
        self.sent[number] = transaction
        if step.silent:
            follows = at + 1 < len(steps) and steps[at + 1].kind != ASK
            self._open[number] = (transaction, time.monotonic() + (0 if follows else _SILENCE_S))
            self._settle(channel, 0, counted=False)
        else:
            self._settle(channel, self._in_flight(steps, at))
        return True

    def _setup_failed(self, transaction: Transaction) -> bool:
        """Tell whether this is a Setup communication that was granted when it was recorded, and now is not."""
        if transaction.function != SETUP_COMMUNICATION or self._renewal.pdu_length:
            return False
        return transaction.exchange.setup[1] is not None

    def _send(self, channel: Channel, number: int, octets: bytes, transaction: Transaction | None) -> None:
        self._open[number] = (transaction, self._until())
        self.requests += 1
        channel.send(octets)

    def _in_flight(self, steps: Sequence[Step], at: int) -> int:
        """Return how many requests may stay open while the next one is sent."""
        if not self._settings.pipelined or at + 1 >= len(steps) or steps[at + 1].kind != ASK:
            return 0
        begins = steps[at + 1].transaction.time_ns
        count = 0
        for transaction, _ in self._open.values():
            if transaction is None or begins is None or transaction.time_ns is None or transaction.latency_ns is None:
                return 0
            count += transaction.time_ns + transaction.latency_ns > begins
        return min(count, self._at_once - 1)

    def _pause(self, channel: Channel, step: Step) -> None:
        """Wait until a request has its turn; what comes meanwhile is taken."""
        pace, first = self._settings.pace, self.part.steps[0].transaction.time_ns
        if pace is None or first is None or step.transaction.time_ns is None or step.kind != ASK:
            return
        turn = self._began + (step.transaction.time_ns - first) / 1e9 * pace
        while not channel.ended and time.monotonic() < turn:
            tsdu = channel.receive(turn)
            if tsdu is not None:
                self._take(channel, tsdu)
        left = turn - time.monotonic()
        if left > 0 and not channel.ended:
            time.sleep(left)

    def _settle(self, channel: Channel, most: int, counted: bool = True) -> None:
        """Wait until no more than ``most`` requests are open, each as long as it may take."""
        while len(self._open) > most:
            oldest = next(iter(self._open))
            tsdu = channel.receive(self._open[oldest][1])
            if tsdu is not None:
                self._take(channel, tsdu)
            elif channel.ended:
                self._open.clear()
            elif time.monotonic() >= self._open[oldest][1]:
                del self._open[oldest]
                self._timeouts += counted

    def _hear(self, channel: Channel, transaction: Transaction) -> None:
        """Wait for a message that is no answer; once one did not come, no further ones are waited for."""
        if self._silenced is not None and _belongs(transaction, self._silenced):
            self._keep(transaction, FOLLOWS_WITHHELD)
            return
        self._awaited += 1
        until = time.monotonic() if self._deaf else self._until()
        while self._heard < self._awaited and not channel.ended:
            tsdu = channel.receive(until)
            if tsdu is None:
                self._deaf = True
                return
            self._take(channel, tsdu)

    def _serve(self, channel: Channel, step: Step) -> bool:
        """Wait until the server has asked what it asked in a recorded download; False when it does not go on like that.

        What follows is not to be sent then: it may put into force what is only half there.
        """
        download = step.download
        if download is None or self._follows_kept(step):
            self._keep(step.transaction, FOLLOWS_WITHHELD)
            return True
        until = self._until()
        while not self._downloads.was_asked(step.transaction):
            tsdu = channel.receive(until) if self._downloads.goes_on(download) else None
            if tsdu is None:
                return False
            self._take(channel, tsdu)
        return True

    def _answered_job(self, channel: Channel, job: bytes) -> bool:
        """Answer what the server asks as it was recorded, if it may be and was."""
        recorded = self._downloads.next(job) if self._permissions.answers(job) else None
        if recorded is None:
            return False
        channel.send(with_reference(recorded.response, job[_REFERENCE]))
        self.served += 1
        return True

    def _take(self, channel: Channel, tsdu: bytes) -> None:
        """Look at a message of the server. What it asks is answered in a download only."""
        pdu = parse_pdu(tsdu)
        head = pdu.parameters.userdata
        answers = pdu.rosctr in {ACK, ACK_DATA} or (
            pdu.rosctr == USERDATA and head is not None and head.type == RESPONSE
        )
        whole = len(tsdu) >= HEADER_SIZE and tsdu[0] == PROTOCOL_ID
        if whole and answers and pdu.pdu_ref in self._open:
            transaction, _ = self._open.pop(pdu.pdu_ref)
            self.answered += 1
            self._timeouts = 0
            setup = pdu.parameters.setup
            if setup is not None:
                self._renewal.pdu_length = setup.pdu_length
                self._at_once = max(setup.max_amq_called, 1)
            if transaction is not None:
                self._renewal.answered(transaction, tsdu)
                self._downloads.answered(transaction, tsdu)
            return
        if whole and pdu.rosctr == JOB and self._answered_job(channel, tsdu):
            return
        self.server_jobs += whole and (pdu.rosctr == JOB or (head is not None and head.type == REQUEST))
        self._heard += 1

    # ---- the end ----------------------------------------------------------------------------------------------------

    def _end(self, channel: Channel) -> None:
        part = self.part
        if not part.by_client:
            channel.await_end(self._until(), tcp=part.end in {FIN, RESET})
        if part.by_client and part.end == RESET:
            channel.reset()
            return
        if part.by_client and part.end == DISCONNECT:
            channel.send_tpdu(part.disconnect_request(_FIRST_REFERENCE, channel.their_reference))
        channel.close(time.monotonic() + _END_S)


def _belongs(said: Transaction, request: Transaction) -> bool:
    """Tell whether something that the server said is there only because of a request: an answer, or of its function group."""
    if said.outcome != "unsolicited":
        return True
    heads = [pdu.parameters.userdata for pdu in (said.exchange.told, request.exchange.asked) if pdu is not None]
    return len({head.group if head is not None else -1 for head in heads}) == 1
