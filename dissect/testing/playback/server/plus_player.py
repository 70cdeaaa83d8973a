"""The fake PLC for one client of S7comm-plus (`dissect.testing.playback.server.plus`)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.message import PlusPdu
from dissect.testing.playback.server.answer_index import LEVELS
from dissect.testing.playback.server.model import RecordedStep, Script
from dissect.testing.playback.server.nearest import nearest_plus
from dissect.testing.playback.server.player import CYCLE, Reply, Stage
from dissect.testing.playback.server.plus import plus_keys, refuse_plus, renewed, wants_answer
from dissect.testing.playback.server.plus_items import Key, PlusItemAnswer, put_together
from dissect.wire.text import some

#: The number of items for which turns are counted.
_ITEM: Final = -1


class PlusPlayer:
    """Answers requests of one client; requests of its recorded connection first, then of all."""

    def __init__(self, stage: Stage, script: Script) -> None:
        self.script = script
        self._cycles = stage.repeat == CYCLE
        self._books = (stage.plus_book(script), stage.plus_all)
        self._turns: dict[tuple[int, int, bytes], int] = {}
        self._heard: set[int] = set()
        self._items = stage.plus_items

    def reply(self, request: PlusPdu) -> Reply:
        """Return the reply to a request. Never raises, whatever the request contains."""
        for level, key in enumerate(plus_keys(request.octets, request)):
            for number, book in enumerate(self._books):
                steps = book.steps(level, key) if key else []
                if steps:
                    step = steps[self._turn((number, level, key), len(steps))]
                    answer = renewed(step.answer, request) if step.answer else b""
                    end = self._end_after(step) if number == 0 else ""
                    return Reply(answer, LEVELS[level + 1], step.latency_ns, tuple(step.then), end)
        together = put_together(request, self._item)
        if together is not None:
            missing = together.missing
            lacking = f"not recorded: {some(missing, 5)}" if missing else ""
            how = "unmatched" if missing else "items"
            return Reply(together.octets, how, together.latency_ns, lacking=lacking)
        lacking = "no similar request was recorded" + nearest_plus(request, self._books[1].requests)
        return Reply(refuse_plus(request) if wants_answer(request) else b"", "unmatched", lacking=lacking)

    def _item(self, key: Key) -> PlusItemAnswer | None:
        """Return the result of a variable for this read, None if it was never recorded."""
        answers = self._items.of(key)
        return answers[self._turn((_ITEM, 0, repr(key).encode()), len(answers))] if answers else None

    def _turn(self, key: tuple[int, int, bytes], count: int) -> int:
        turn = self._turns.get(key, 0)
        self._turns[key] = turn + 1
        return turn % count if self._cycles else min(turn, count - 1)

    def _end_after(self, step: RecordedStep) -> str:
        self._heard.add(id(step))
        return self.script.end if self.script.end and len(self._heard) == len(self.script.steps) else ""
