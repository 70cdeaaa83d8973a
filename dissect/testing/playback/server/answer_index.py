"""Finds recorded answers: recorded requests are indexed by their similarity to a request."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.protocols.s7.clock import SETTING
from dissect.protocols.s7.items import DATA_HEAD, Item
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import HEADER_SIZE, REQUEST
from dissect.protocols.s7.tables import ACK_DATA, GROUP_TIME, JOB, READ_VAR, SUCCESS, USERDATA, WRITE_VAR
from dissect.testing.golden.masking import mask_s7
from dissect.testing.playback.server.model import RecordedStep, Script

#: Levels of similarity, the best first: equal except for the reference; except for all counters (sequence numbers, upload ids:
#: `dissect.testing.golden.masking`); except for the written data, or the time that a clock is set to.
LEVELS: Final = ("same", "counted", "valued")
#: Maximum number of answers to single items that an index keeps.
MAX_ITEMS: Final = 1_000_000


class ItemAnswer:
    """The result of an item: ``octets`` are its data item, for a write its return code; ``latency_ns`` is the answer's."""

    __slots__ = ("latency_ns", "octets")

    def __init__(self, octets: bytes, latency_ns: int) -> None:
        self.octets = octets
        self.latency_ns = latency_ns

    @property
    def good(self) -> bool:
        """True if the item was not refused."""
        return self.octets[0] == SUCCESS


def keys_of(octets: bytes, pdu: Pdu) -> tuple[bytes, bytes, bytes]:
    """Return the keys of a request, in the order of `LEVELS`; empty for a level that does not apply."""
    if len(octets) < HEADER_SIZE:
        return octets, b"", b""
    masked = mask_s7(octets)
    return octets[:4] + octets[6:], masked, _without_values(masked, pdu)


def _without_values(masked: bytes, pdu: Pdu) -> bytes:
    parameters = masked[pdu.header_size : pdu.data_offset]
    if pdu.rosctr == JOB and pdu.function == WRITE_VAR:
        return b"w" + parameters
    head = pdu.parameters.userdata
    if pdu.rosctr == USERDATA and head is not None and head.group == GROUP_TIME and head.type == REQUEST:
        if head.subfunction in SETTING:
            return b"c" + parameters
    return b""


def item_key(function: int, item: Item) -> bytes:
    """Return the key of an item."""
    return bytes((function,)) + item.octets


def item_answers(request: Pdu, answer: bytes) -> list[bytes]:
    """Return the data items of a read answer, or the return codes of a write answer, one for each requested item.

    Empty if the answer has a different form.
    """
    response = parse_pdu(answer)
    count = len(request.parameters.items)
    if response.rosctr != ACK_DATA or response.function != request.function or response.parameters.item_count != count:
        return []
    if request.function == WRITE_VAR:
        codes = response.data
        return [bytes((code,)) for code in codes] if len(codes) == count else []
    items = [answer[item.offset : item.offset + DATA_HEAD + len(item.data)] for item in response.data_items()]
    return items if len(items) == count else []


class AnswerIndex:
    """The steps of scripts by their keys, in recorded order; items of reads and writes are indexed on demand."""

    def __init__(self, scripts: Sequence[Script]) -> None:
        self._steps: list[dict[bytes, list[RecordedStep]]] = [{}, {}, {}]
        self._items: dict[bytes, list[ItemAnswer]] | None = None
        self._scripts = list(scripts)
        self.setup: RecordedStep | None = None
        self.pdu_length = max([script.pdu_length for script in scripts], default=0)
        self.full = False
        for script in scripts:
            for step in script.steps:
                self._enter(step)

    def _enter(self, step: RecordedStep) -> None:
        pdu = parse_pdu(step.request)
        for level, key in enumerate(keys_of(step.request, pdu)):
            if key:
                self._steps[level].setdefault(key, []).append(step)
        if self.setup is None and pdu.parameters.setup is not None and pdu.rosctr == JOB and step.answer:
            self.setup = step

    def steps(self, level: int, key: bytes) -> list[RecordedStep]:
        """Return the recorded requests that are equal at a level."""
        return self._steps[level].get(key, [])

    def items(self, key: bytes) -> list[ItemAnswer]:
        """Return the recorded results of an item."""
        if self._items is None:
            self._items = self._gather()
        return self._items.get(key, [])

    def _gather(self) -> dict[bytes, list[ItemAnswer]]:
        answers: dict[bytes, list[ItemAnswer]] = {}
        known: dict[tuple[bytes, bytes], list[tuple[bytes, bytes]]] = {}
        count = 0
        for script in self._scripts:
            for step in script.steps:
                alike = (step.request[HEADER_SIZE:], step.answer[HEADER_SIZE:])
                pairs = known.get(alike)
                if pairs is None:
                    pairs = known[alike] = _pairs(step)
                count += len(pairs)
                if count > MAX_ITEMS:
                    self.full = True
                    return answers
                for key, octets in pairs:
                    answers.setdefault(key, []).append(ItemAnswer(octets, step.latency_ns))
        return answers


def _pairs(step: RecordedStep) -> list[tuple[bytes, bytes]]:
    request = parse_pdu(step.request)
    if request.rosctr != JOB or request.function not in {READ_VAR, WRITE_VAR} or not step.answer:
        return []
    answers = item_answers(request, step.answer)
    items = request.parameters.items if answers else []
    return [
        (item_key(request.function, item), octets) for item, octets in zip(items, answers, strict=True) if item.octets
    ]
