"""Builds the script of a connection from its transactions: the client's messages, and the server's own messages after them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

from dissect.engine.transactions.transaction import BEHIND_MALFORMED, HOLE, OUTCOMES, PUSH, UNANSWERED
from dissect.meaning.report import words
from dissect.testing.golden.model import Transaction
from dissect.testing.playback.server.model import RecordedStep, Recording, Script, ServerMessage

#: The beginning of an S7comm-plus message.
_PLUS: Final = b"\x72"
_PUSH: Final = OUTCOMES[PUSH]
_UNANSWERED: Final = OUTCOMES[UNANSWERED]
_BEHIND: Final = OUTCOMES[BEHIND_MALFORMED]


class Seen:
    """A transaction of a session as octets; ``number`` is its position if the packets are unknown."""

    __slots__ = ("answer", "by_client", "latency_ns", "outcome", "over", "place", "reason", "request")

    def __init__(self, transaction: Transaction, number: int) -> None:
        self.request, self.answer = transaction.recorded or (transaction.request, transaction.response)
        self.outcome = transaction.outcome
        self.reason = transaction.reason
        self.latency_ns = max(transaction.latency_ns or 0, 0)
        self.by_client = transaction.asked_by == "client"
        self.place = transaction.place or number  # the packet that determines the order
        self.over = transaction.last_frame or number  # the packet that completed it

    @property
    def is_step(self) -> bool:
        """True for messages of the client: a request, or a message without an answer."""
        if self.outcome == _PUSH and self.request[:1] == _PLUS:
            return self.by_client  # a request without a response
        if self.outcome == _PUSH:
            return not self.by_client  # it has no request: its receiver is listed as the requester
        return self.by_client and bool(self.request)

    @property
    def is_said(self) -> bool:
        """True for unsolicited messages of the server, including an answer whose request is missing."""
        return not self.is_step and (self.by_client or bool(self.request))

    @property
    def is_answered_job(self) -> bool:
        """True for jobs of the server that the client answered."""
        return not self.by_client and bool(self.request) and bool(self.answer)


def arrange(script: Script, seen: Sequence[Seen], recording: Recording) -> None:
    """Make a step of each message of the client, in order; the server's own messages follow the step before them.

    An answer to a request that may be among missing octets is left out: it was requested, and is not unsolicited.
    """
    lost = early = unheard = 0
    over: list[tuple[int, int]] = []  # completion of each step
    others: list[Seen] = []
    for one in seen:
        if one.outcome == _BEHIND:
            continue  # without an answer, and not an answer itself
        if one.is_step:
            over.append((one.over, len(script.steps)))
            script.steps.append(_step(one))
            unheard += one.outcome == _UNANSWERED and one.reason == HOLE
        elif one.is_said and not one.request and one.reason == HOLE:
            lost += 1
        elif one.is_said:
            others.append(one)
    over.sort()
    messages: list[Seen] = []
    behind: list[RecordedStep] = []  # the step that each of these follows
    at, latest = 0, -1
    for one in others:
        while at < len(over) and over[at][0] <= one.place:
            latest = max(latest, over[at][1])
            at += 1
        if latest >= 0:
            messages.append(one)
            behind.append(script.steps[latest])
        elif one.outcome == _PUSH or one.request:
            early += 1
        else:
            lost += 1
    for one, step, waits in zip(messages, behind, _waits(messages), strict=True):
        octets = one.answer or one.request if one.by_client else one.request
        step.then.append(ServerMessage(octets, one.is_answered_job, waits))
    _note_losses(script, recording, lost, unheard, early)


def _waits(messages: Sequence[Seen]) -> list[int]:
    """Return, for each message of the server, how many answers of the client came before its next message."""
    answers = sorted([one.over for one in messages if one.is_answered_job])
    waits, given = [], 0
    for index in range(len(messages)):
        before = bisect_left(answers, messages[index + 1].place) if index + 1 < len(messages) else len(answers)
        waits.append(before - given)
        given = before
    return waits


def _note_losses(script: Script, recording: Recording, lost: int, unheard: int, early: int) -> None:
    who = f"connection {script.number}"
    if lost:
        count = words.count(lost, "answer is", "answers are")
        request = "its request is" if lost == 1 else "their requests are"
        recording.note(f"{who}: {count} not served: {request} not in the recording")
    if unheard:
        count = words.count(unheard, "request has no answer", "requests have no answers")
        recording.note(f"{who}: {count}: the recording lacks bytes of the server there")
    if early:
        count = words.count(early, "message of the server comes", "messages of the server come")
        recording.note(f"{who}: {count} before any request and {'is' if early == 1 else 'are'} ignored")


def _step(one: Seen) -> RecordedStep:
    pushed = one.outcome == _PUSH
    return RecordedStep(one.request or one.answer, b"" if pushed else one.answer, one.latency_ns)
