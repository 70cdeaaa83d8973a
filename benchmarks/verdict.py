"""The results for a part of a capture, compared with the results for all of it.

`Truth` has the results for the complete capture, `Verdict` those with packets left out: right and wrong pairs, and statements
that blame and are not true (`benchmarks.blame`). Connections are identified by their ends and by the packets that they span,
never by their numbers.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from benchmarks.blame import (
    BLAMES,
    CONFLICT,
    NOT_ANSWERED,
    OF_A_CAPTURE,
    OF_A_PAIR,
    OF_A_REQUEST,
    OF_HOSTS,
    REASONS,
    names_loss,
)
from benchmarks.told import Statement, Told
from dissect.engine.transactions.transaction import CAPTURE_ENDED, HOLE, LIKELY, SURE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from benchmarks.told import Capture, Key, Pair, Unanswered

RIGHT: Final = "right"
WRONG: Final = "wrong"
#: The complete capture itself is not sure.
OPEN: Final = "open"
#: Number of octets by which PDUs with one reference are considered equal: header, parameters and some data of nearly all of
#: them.
_BEGIN: Final = 64


class Truth:
    """The results for a complete capture, for look-ups."""

    def __init__(self, told: Told) -> None:
        self.pairs = [pair for pair in told.pairs if pair.certainty == SURE]
        self._requests: dict[Key, list[Pair]] = {}
        self._answers: dict[Key, list[Pair]] = {}
        self._named: dict[tuple[str, str, int], list[Pair]] = {}
        self._unanswered: dict[Key, list[Unanswered]] = {}
        self._silent: set[tuple[str, str, int, bytes]] = set()
        self._statements: dict[tuple[str, ...], list[Statement]] = {}
        self._packets = {(pair.request.packet, pair.answer) for pair in told.pairs}
        for pair in told.pairs:
            self._requests.setdefault(pair.request, []).append(pair)
            self._answers.setdefault(pair.answered, []).append(pair)
            self._named.setdefault(pair.request[:3], []).append(pair)
        for one in told.unanswered:
            self._unanswered.setdefault(one.request, []).append(one)
            self._silent.add((*one.request[:3], one.octets[:_BEGIN]))
        for statement in told.statements:
            self._statements.setdefault(_where(statement), []).append(statement)

    def judge(self, pair: Pair) -> str:
        """Return whether a pair from fewer packets is `RIGHT` or `WRONG`, or `OPEN`."""
        asked = self._requests.get(pair.request, [])
        told = self._answers.get(pair.answered, [])
        if any(other.certainty == LIKELY for other in (*asked, *told)):
            return OPEN
        if asked and told:
            same = [other for other in asked if other.answer == pair.answer]
            right = len(asked) == 1 or any(other.octets == pair.octets for other in same)
            return RIGHT if same and right else WRONG
        # One packet is not the last of a PDU there: TCP sent it again, or the last fragments of the PDU were left out.
        candidates = asked or told or self._named.get(pair.request[:3], [])
        return RIGHT if any(_begin_alike(pair, other) for other in candidates) else WRONG

    def has_reason(self, one: Unanswered) -> bool:
        """Return whether it is true that a request had no answer for this reason."""
        if self._conflict(one.request.asking, one.request.answering):
            return True
        found = self._unanswered.get(one.request)
        if found is None:
            return one.request not in self._requests and (*one.request[:3], one.octets[:_BEGIN]) in self._silent
        # It is not untrue if an ending of the connection was left out.
        return one.reason == CAPTURE_ENDED or any(other.reason == one.reason for other in found)

    def excuses(self, one: Unanswered) -> bool:
        """Return whether a request is surely reported as answered, although its answer was due and never came."""
        if one.certainty != SURE:
            return False
        return any(other.missed and other.reason != HOLE for other in self._unanswered.get(one.request, []))

    def says(self, statement: Statement) -> bool:
        """Return whether the complete capture makes the same statement."""
        found = self._statements.get(_where(statement), [])
        if statement.slug in OF_A_CAPTURE:
            return any(other.detail == statement.detail for other in found)
        if statement.slug in OF_HOSTS:
            return bool(found)
        if statement.slug in OF_A_PAIR and statement.packets in self._packets:
            return True
        if self._conflict(*statement.ends):
            return True
        found = [other for other in found if other.first <= statement.last and statement.first <= other.last]
        if statement.slug in OF_A_REQUEST:
            packets = set(statement.packets)
            return any(packets & set(other.packets) or other.detail == statement.detail for other in found)
        return bool(found)

    def _conflict(self, *ends: str) -> bool:
        """Return whether octets came in two versions: the truth about a connection then depends on which was captured."""
        return (CONFLICT, *sorted(ends)) in self._statements

    def was_answered(self, statement: Statement) -> bool:
        """Return whether all requests in a packet of a statement were answered."""
        answered = {asked for asked, _ in self._packets} - {key.packet for key in self._unanswered}
        return not answered.isdisjoint(statement.packets)


def _where(statement: Statement) -> tuple[str, ...]:
    """Return the slug of a statement, and its subject."""
    if statement.slug in OF_A_CAPTURE:
        return (statement.slug,)
    if statement.slug in OF_HOSTS:
        return (statement.slug, *[end.rpartition(":")[0] for end in statement.ends])
    return (statement.slug, *statement.ends)


def _begin_alike(one: Pair, other: Pair) -> bool:
    """Return whether the PDUs of two pairs begin with the same octets, as a partly captured one does."""
    return all(mine[:_BEGIN] == theirs[:_BEGIN] for mine, theirs in zip(one.octets, other.octets, strict=True))


class Verdict:
    """The results for captures with missing packets: how much of them is true.

    ``of_kept`` counts the pairs of the complete capture whose packets were both kept: of these ``stay`` are reported as sure,
    ``missed`` are not reported. ``excused`` counts requests that were never answered but are reported as answered without a
    captured answer. ``details`` has a line for each sure pair that is wrong and each untrue statement, ``blaming`` the slugs of
    these, ``where`` the captures.
    """

    def __init__(self) -> None:
        self.kept = 0
        self.counts: Counter[tuple[str, str]] = Counter()
        self.of_kept = 0
        self.stay = 0
        self.missed = 0
        self.excused = 0
        self.blaming: Counter[str] = Counter()
        self.where: Counter[str] = Counter()
        self.details: list[str] = []

    def add(self, other: Verdict) -> None:
        """Add the results for another capture, or another run."""
        self.kept += other.kept
        self.counts += other.counts
        self.of_kept += other.of_kept
        self.stay += other.stay
        self.missed += other.missed
        self.excused += other.excused
        self.blaming += other.blaming
        self.where += other.where
        self.details += other.details

    @property
    def told(self) -> int:
        """The number of reported pairs."""
        return self.counts.total()

    @property
    def sure_wrong(self) -> float:
        """The share of wrong pairs among the sure ones."""
        right, wrong = self.counts[SURE, RIGHT], self.counts[SURE, WRONG]
        return wrong / max(1, right + wrong)

    @property
    def stays(self) -> float:
        """The share of pairs that are reported as sure, among those whose packets were kept."""
        return self.stay / max(1, self.of_kept)

    def cells(self) -> tuple[str, ...]:
        """Return the texts of the line."""
        counts = self.counts
        numbers = (
            self.kept, self.told, counts[SURE, RIGHT], counts[SURE, WRONG], counts[LIKELY, RIGHT], counts[LIKELY, WRONG],
            self.missed,
        )  # fmt: skip
        return (
            *[f"{number:,}" for number in numbers],
            f"{self.stays:.2%}",
            f"{self.blaming.total():,}",
            f"{self.excused:,}",
        )


def compare(capture: Capture, truth: Truth, told: Told, numbers: Sequence[int]) -> Verdict:
    """Compare the results ``told`` for the packets ``numbers`` of a capture with the ``truth`` about all of them."""
    name = capture.name
    verdict = Verdict()
    verdict.kept = len(numbers)
    stay: set[Key] = set()
    for pair in told.pairs:
        judged = truth.judge(pair)
        verdict.counts[pair.certainty, judged] += 1
        if pair.certainty == SURE and judged == RIGHT:
            stay.add(pair.request)
        elif pair.certainty == SURE and judged == WRONG:
            key = pair.request
            what = f"reference 0x{key.reference:04x}, request {key.packet + 1}, answer {pair.answer + 1}"
            verdict.details.append(f"{name}: WRONG PAIR: {key.asking} to {key.answering}: {what}")
    there, found = set(numbers), {pair.request for pair in told.pairs}
    for pair in truth.pairs:
        if pair.request.packet in there and pair.answer in there:
            verdict.of_kept += 1
            verdict.stay += pair.request in stay
            verdict.missed += pair.request not in found
    verdict.excused = sum(truth.excuses(one) for one in told.unanswered)
    for statement in blaming(capture, truth, told, numbers):
        verdict.blaming[statement.slug] += 1
        verdict.where[name] += 1
        packets = ", ".join([str(packet + 1) for packet in statement.packets])
        ends = " and ".join(statement.ends)
        verdict.details.append(f"{name}: {statement.slug}: {ends}: packets {packets}: {statement.detail}")
    return verdict


def blaming(capture: Capture, truth: Truth, told: Told, numbers: Sequence[int]) -> list[Statement]:
    """Return each statement that blames and is not true; for a request without answer, with its reason as the slug.

    It is not true if the complete capture does not make it, and would not even if it ended with the last of ``numbers``:
    nothing after that can be missed.
    """
    found = list(_blaming(truth, told))
    if found and numbers and numbers[-1] + 1 < len(capture.packets):
        begun = list(_blaming(Truth(Told(capture, range(numbers[-1] + 1))), told))
        found = [statement for statement in found if statement in begun]
    return found


def _blaming(truth: Truth, told: Told) -> Iterator[Statement]:
    for statement in told.statements:
        if statement.slug not in BLAMES or names_loss(statement.detail):
            continue
        if not truth.says(statement):
            yield statement
        elif statement.detail.endswith(NOT_ANSWERED) and truth.was_answered(statement):
            yield statement._replace(slug=statement.slug + NOT_ANSWERED)
    for one in told.unanswered:
        if one.missed and one.reason in REASONS and not truth.has_reason(one):
            key = one.request
            ends, packets = (key.asking, key.answering), (key.packet,)
            yield Statement(f"reason {one.reason}", ends, key.packet, key.packet, packets, one.function)
