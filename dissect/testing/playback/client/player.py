"""Plays one recorded connection: sends each request after its recorded predecessors, and waits for each answer."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Final

from dissect.engine.transactions.ending import DISCONNECT, FIN, RESET
from dissect.online.net.addresses import Place
from dissect.protocols.s7.build import with_reference
from dissect.protocols.s7.layouts import PDU_REF
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import HEADER_SIZE, PROTOCOL_ID, REQUEST, RESPONSE
from dissect.protocols.s7.tables import ACK, ACK_DATA, CONTROL, JOB, SETUP_COMMUNICATION, USERDATA
from dissect.protocols.s7plus.assembly import PlusAssembler
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.tables import RESPONSE as PLUS_RESPONSE
from dissect.testing.golden.model import Transaction
from dissect.testing.playback.client.channel import Channel, UnreachableError, connect
from dissect.testing.playback.client.download import Downloads
from dissect.testing.playback.client.partner import Sends
from dissect.testing.playback.client.permissions import NO_ANSWER, kind_of
from dissect.testing.playback.client.plan import ASK, FOLLOWS_WITHHELD, HEAR, SERVE, Part, Step, Withheld, withheld
from dissect.testing.playback.client.plus import PlusRenewal, plus_kind
from dissect.testing.playback.client.renewal import Renewal
from dissect.testing.playback.client.settings import PendingRequest, Shared
from dissect.testing.playback.plus_octets import frames_of

#: How long to wait for the server's end after ours, in seconds.
_END_S: Final = 1.0
#: Maximum number of consecutive missing answers; then the server is given up.
MAX_TIMEOUTS: Final = 3
_FIRST_REFERENCE: Final = 1
NOT_GRANTED: Final = "the Setup communication was not granted"
HALF_LOADED: Final = "an earlier download did not proceed as recorded"
NOT_LOADED: Final = "the download did not proceed as recorded"
INTERRUPTED: Final = "interrupted"


class PartPlayer:
    """Plays ``part`` to a server: `begin`, `step` for each of its steps, `end`; other connections may run in between.

    Results: ``sent`` maps our references to the requests sent with them, in order. ``withheld`` are requests left out on
    purpose, ``not_sent`` those that could no longer be sent; ``unheard`` are (by ``id``) messages of the server that were not
    awaited, because they belong to a withheld request. ``requests`` and ``answered`` are counts; ``served`` counts jobs of the
    server that were answered, ``server_jobs`` those that were not. ``problem`` says why the connection ended early;
    ``unreachable``: it could not be made; ``over``: it has ended. ``first_frame`` is its first packet in the record.
    """

    def __init__(self, part: Part, shared: Shared) -> None:
        self.part = part
        self.withheld: list[Withheld] = list(part.withheld)
        self.not_sent: list[Transaction] = []
        self.sent: dict[int, Transaction] = {}
        self.unheard: set[int] = set()
        self.first_frame = 0
        self.setup_reference = 0
        self.requests = 0
        self.answered = 0
        self.served = 0
        self.server_jobs = 0
        self.problem = ""
        self.unreachable = False
        self.over = False
        self._channel: Channel | None = None
        self._left = False  # nothing more is sent
        self._shared = shared
        self._permissions = shared.permissions
        self._settings = shared.settings
        self._patience = shared.patience
        self._renewal = Renewal()
        self._plus = PlusRenewal() if part.plus else None
        self._joined = PlusAssembler()
        self._downloads = Downloads(part.downloads)
        sent = [step.transaction for step in part.steps if step.kind == SERVE and step.download is None]
        self._sends = Sends(sent)
        self._kept: set[int] = set()  # ids of requests withheld here
        self._open: dict[int, PendingRequest] = {}  # by reference, the oldest first
        self._late: dict[int, PendingRequest] = {}  # no longer awaited, but may still arrive
        self._cut_short: set[int] = set()
        self._timeouts = 0
        self._heard = 0  # messages that are not answers
        self._awaited = 0
        self._deaf = False
        self._silenced: Transaction | None = None  # the previous request, if it was withheld
        self._at_once = 1

    @property
    def waits(self) -> bool:
        """True while a request is open."""
        return bool(self._open)

    def given_up(self, reference: int) -> str:
        """Return in words why we no longer wait for the recorded answer to our request; empty if we still do."""
        if reference in self._cut_short:
            return "the replay was interrupted before an answer came"
        pending = self._late.get(reference)
        if pending is None or pending.step is None or not pending.step.expected:
            return ""
        return f"no answer within {self._settings.timeout_s:g} s"

    @property
    def broken(self) -> bool:
        """True if the connection cannot continue."""
        return self.over or (self._channel is not None and bool(self._channel.ended))

    # ---- begin and end ----------------------------------------------------------------------------------------------

    def begin(self, places: Sequence[Place]) -> None:
        """Connect, and send a Setup if none was recorded."""
        channel = self._connect(places)
        if channel is None:
            self._leave(self.part.steps)
            self.over = True
            return
        self._channel = channel
        self.first_frame = channel.first_frame
        confirmed = channel.open(self.part.connect_request(_FIRST_REFERENCE), self._until())
        if not confirmed:
            expected = bool(self.part.link.refused) or not self.part.link.transactions
            if not expected:
                self.problem = f"the connect request was {'refused' if channel.refused else 'not confirmed'}"
            self._leave(self.part.steps)
        elif self.part.own_setup and not self._set_up(channel):
            self._leave(self.part.steps)
        if self.problem:
            self.end()

    def _connect(self, places: Sequence[Place]) -> Channel | None:
        for attempt in range(self._settings.retries + 1):
            if attempt:
                self._shared.watch.sleep(time.monotonic() + min(attempt, 5) * 0.2, lambda: False)
            if self._shared.watch.halted:
                break
            try:
                one = connect(places, self._settings.timeout_s)
                return Channel(one, self._shared.record, self._shared.watch)
            except UnreachableError as why:
                self.problem = f"no connection: {why}"
        self.unreachable = True
        return None

    def end(self) -> None:
        """End the connection as recorded."""
        channel, part = self._channel, self.part
        if channel is None or self.over:
            return
        self.settle()
        if channel.ended and self.not_sent and not self.problem:
            self.problem = f"the connection was {channel.ended}"
        self.over = True
        if not part.by_client:
            channel.await_end(self._until(), tcp=part.end in {FIN, RESET})
        if part.by_client and part.end == RESET:
            channel.reset()
        else:
            if part.by_client and part.end == DISCONNECT:
                channel.send_tpdu(part.disconnect_request(_FIRST_REFERENCE, channel.their_reference))
            channel.close(time.monotonic() + _END_S)
        self._channel = None

    def interrupt(self, at: int) -> None:
        """End the connection early, and send nothing from step ``at`` on."""
        steps = self.part.steps[max(at, 0) :]
        if steps and not self._left:
            self.problem = INTERRUPTED
            self._leave(steps)
        self.end()
        self.over = True

    def drop(self) -> None:
        """Reset the connection if it has not ended."""
        if self._channel is not None and not self.over:
            self._channel.reset()
        self.over = True

    def _until(self) -> float:
        return time.monotonic() + self._settings.timeout_s

    def _leave(self, steps: Sequence[Step]) -> None:
        """Sort out the requests that can no longer be sent; those to be withheld anyway count as withheld."""
        self._left = True
        for step in steps:
            if step.kind == ASK:
                reason = step.refusal(self._permissions)
                if reason:
                    self._keep(step.transaction, reason)
                else:
                    self.not_sent.append(step.transaction)
            elif self._follows_kept(step):
                self._keep(step.transaction, FOLLOWS_WITHHELD)
            elif step.kind == SERVE and step.download is None and not self._permissions.control:
                self._keep(step.transaction, NO_ANSWER)

    def _keep(self, transaction: Transaction, reason: str) -> None:
        self._kept.add(id(transaction))
        self.withheld.append(withheld(transaction, reason))
        if reason in {FOLLOWS_WITHHELD, NO_ANSWER}:
            self.unheard.add(id(transaction))

    def _follows_kept(self, step: Step) -> bool:
        """Return whether this is a job of the server in a withheld download."""
        return step.kind == SERVE and step.download is not None and id(step.download.request) in self._kept

    # ---- the conversation -------------------------------------------------------------------------------------------

    def step(self, at: int) -> None:
        """Take the next step. If nothing more can be sent, end the connection."""
        if self._left or self._channel is None:
            return
        self._prepare(at)
        steps = self.part.steps
        if self._gives_up(at):
            return
        left = self._take_step(self._channel, at)
        if left < len(steps):
            self._leave(steps[left:])
            self.end()
        else:
            self._gives_up(at + 1)

    def _prepare(self, at: int) -> None:
        """Wait for the answers that were recorded before this step, and until one more request is allowed."""
        step = self.part.steps[at]
        if step.kind == ASK and self._settings.pipelined:
            self.settle(step.transaction.time_ns)
            self._settle(list(self._open)[: max(len(self._open) - self._at_once + 1, 0)])
        else:
            self.settle()

    def _gives_up(self, at: int) -> bool:
        if self._timeouts < MAX_TIMEOUTS:
            return False
        self.problem = f"{MAX_TIMEOUTS} requests in a row were not answered in time"
        self._leave(self.part.steps[at:])
        self.end()
        return True

    def _take_step(self, channel: Channel, at: int) -> int:
        """Return the index of the first step that cannot be taken; the number of steps if all can."""
        steps = self.part.steps
        step = steps[at]
        if step.kind == HEAR:
            self._hear(channel, step.transaction)
        elif step.kind == SERVE and step.download is None:
            self._take_send(channel, step.transaction)
        elif step.kind == SERVE:
            if not self._serve(channel, step):
                self._shared.half_loaded = True
                self.problem = "" if channel.ended else NOT_LOADED
                return at + 1
        elif not self._ask(channel, steps, at):
            return at
        elif self._setup_failed(step.transaction):
            self.problem = NOT_GRANTED
            return at + 1
        return len(steps)

    def _set_up(self, channel: Channel) -> bool:
        """Negotiate a PDU length if the recording has no Setup."""
        number, octets = self._renewal.renewed(self.part.own_setup)
        self.setup_reference = number
        self._send(channel, number, octets, None)
        self.settle()
        if not self._renewal.pdu_length:
            self.problem = NOT_GRANTED
        return bool(self._renewal.pdu_length)

    def _ask(self, channel: Channel, steps: Sequence[Step], at: int) -> bool:
        """Send a request, or withhold it; return False if nothing can be sent any longer."""
        step = steps[at]
        transaction = step.transaction
        reason = step.refusal(self._permissions) or self._renewal.refusal(transaction)
        if not reason and step.download is not None:
            reason = step.download.refusal(self._renewal.pdu_length)
        if not reason and self._shared.half_loaded and (step.effect or kind_of(transaction.request)) == CONTROL:
            reason = HALF_LOADED
        self._silenced = transaction if reason else None
        if reason:
            self._keep(transaction, reason)
            return True
        number, octets = self._renewed(transaction.request)
        if channel.ended or self._refusal(octets):  # send exactly what was checked
            return False
        self._send(channel, number, octets, step)
        self.sent[number] = transaction
        follows = at + 1 < len(steps) and steps[at + 1].kind != ASK
        if follows and not step.expected and not step.lost:
            del self._open[number]  # its answer is late, and is awaited next
        elif not self._settings.pipelined or transaction.function == SETUP_COMMUNICATION:
            self.settle()
        return True

    def _renewed(self, request: bytes) -> tuple[int, bytes]:
        return (self._plus or self._renewal).renewed(request)

    def _refusal(self, octets: bytes) -> str:
        """Return why a PDU must not be sent, empty if it may."""
        if self._plus is None:
            return self._permissions.refusal(octets)
        return self._permissions.refusal_of(plus_kind(octets, self._plus.own))

    def _setup_failed(self, transaction: Transaction) -> bool:
        """Return whether a Setup communication failed that was granted in the recording."""
        if transaction.function != SETUP_COMMUNICATION or self._renewal.pdu_length:
            return False
        return transaction.exchange.setup[1] is not None

    def _send(self, channel: Channel, number: int, octets: bytes, step: Step | None) -> None:
        self._late.pop(number, None)
        self._open[number] = PendingRequest(step, time.monotonic() + self._patience.seconds(step))
        self.requests += 1
        for message in frames_of(octets) if self._plus is not None else [octets]:
            channel.send(message)

    def settle(self, time_ns: int | None = None) -> None:
        """Wait for the answers to all open requests; with ``time_ns``, to those that were answered by then in the recording."""
        self._settle([number for number, pending in self._open.items() if pending.due(time_ns)])

    def _settle(self, due: Sequence[int]) -> None:
        """Wait until none of these requests is open, for each at most its own time limit."""
        channel = self._channel
        if channel is None or not due:
            return
        channel.poll()
        for number in due:
            while number in self._open:
                pending = self._open[number]
                tsdu = channel.receive(pending.until)
                if tsdu is not None:
                    self._take(channel, tsdu)
                elif channel.ended or self._shared.watch.halted:
                    self._cut_short.update(self._open if not channel.ended else ())
                    self._open.clear()
                elif time.monotonic() >= pending.until:
                    self._late[number] = self._open.pop(number)
                    self._patience.missed(pending.step)
                    self._timeouts += pending.step is None or pending.step.expected

    def _hear(self, channel: Channel, transaction: Transaction) -> None:
        """Wait for an unsolicited message; after the first missing one, no more are awaited."""
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
        """Wait for a job of the server in a recorded download; return False if it does not come.

        The rest must not be sent then: it could activate a half-loaded block.
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

    def _take_send(self, channel: Channel, transaction: Transaction) -> None:
        """Wait for a recorded BSEND of the server; after the first missing one, no more are awaited."""
        if not self._permissions.control:
            self._keep(transaction, NO_ANSWER)
            return
        until = time.monotonic() if self._deaf else self._until()
        while not self._sends.came(transaction) and not channel.ended:
            tsdu = channel.receive(until)
            if tsdu is None:
                self._deaf = True
                return
            self._take(channel, tsdu)

    def _answered_job(self, channel: Channel, job: bytes) -> bool:
        """Answer a job of the server as recorded, if allowed."""
        if not self._permissions.answers(job):
            return False
        recorded = self._downloads.next(job)
        answer = recorded.response if recorded is not None else self._sends.answer(job)
        if not answer:
            return False
        channel.send(with_reference(answer, job[PDU_REF]))
        self.served += 1
        return True

    def _take(self, channel: Channel, tsdu: bytes) -> None:
        """Process a message of the server. Its requests are only answered if `Permissions.answers` allows it."""
        if self._plus is not None:
            self._take_plus(self._plus, tsdu)
            return
        pdu = parse_pdu(tsdu)
        head = pdu.parameters.userdata
        answers = pdu.rosctr in {ACK, ACK_DATA} or (
            pdu.rosctr == USERDATA and head is not None and head.type == RESPONSE
        )
        whole = len(tsdu) >= HEADER_SIZE and tsdu[0] == PROTOCOL_ID
        pending = self._open.pop(pdu.pdu_ref, None) or self._late.pop(pdu.pdu_ref, None) if whole and answers else None
        if pending is not None:
            self._answered(pending, pdu)
            return
        if whole and self._answered_job(channel, tsdu):
            return
        self.server_jobs += whole and (pdu.rosctr == JOB or (head is not None and head.type == REQUEST))
        self._heard += 1

    def _take_plus(self, renewal: PlusRenewal, tsdu: bytes) -> None:
        """Process a frame of S7comm-plus."""
        octets = self._joined.push(tsdu)
        if not octets:
            return
        pdu = parse_plus(octets)
        number = int(pdu.sequence) if pdu.opcode == PLUS_RESPONSE else -1
        pending = self._open.pop(number, None) or self._late.pop(number, None)
        if pending is None:
            self._heard += 1
            return
        self._came(pending)
        if pending.step is not None:
            renewal.answered(pending.step.transaction, octets)

    def _came(self, pending: PendingRequest) -> None:
        """Count an answer, in time or late."""
        self.answered += 1
        self._timeouts = 0
        self._patience.came(pending.step)

    def _answered(self, pending: PendingRequest, pdu: Pdu) -> None:
        """Process an answer."""
        self._came(pending)
        setup = pdu.parameters.setup
        if setup is not None:
            self._renewal.pdu_length = setup.pdu_length
            self._at_once = max(setup.max_amq_called, 1)
        if pending.step is not None:
            self._renewal.answered(pending.step.transaction, pdu.octets)
            self._downloads.answered(pending.step.transaction, pdu.octets)


def _belongs(message: Transaction, request: Transaction) -> bool:
    """Return whether a message of the server was caused by a request: an answer, or one of the same function group."""
    if message.outcome != "unsolicited":
        return True
    heads = [
        pdu.parameters.userdata
        for pdu in (message.exchange.response_pdu, request.exchange.request_pdu)
        if pdu is not None
    ]
    return len({head.group if head is not None else -1 for head in heads}) == 1
