"""The fake PLC without its sockets: answers requests from the recording.

A client's connection is assigned a recorded one (`Stage.script_for`) and has its own `FakePlc`, so that the answers to one
client do not depend on the requests of others. A request is looked up in the recorded connection first, then in all of them, by
similarity (`answer_index.LEVELS`). Reads and writes without a recorded match are answered from recorded items.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.protocols.s7.build import with_reference
from dissect.protocols.s7.layouts import PDU_REF
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import PUSH, RESPONSE, is_plc_push
from dissect.protocols.s7.tables import JOB, READ_VAR, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.testing.playback.bsend import answered_piece
from dissect.testing.playback.server.answer_index import LEVELS, AnswerIndex, ItemAnswer, item_key, keys_of
from dissect.testing.playback.server.answers import (
    WRONG_PDU_SIZE,
    answer_items,
    grant,
    missing_item,
    refuse,
)
from dissect.testing.playback.server.image import Image, holds
from dissect.testing.playback.server.model import RecordedStep, Recording, Script, ServerMessage
from dissect.testing.playback.server.nearest import nearest
from dissect.testing.playback.server.plus import PlusIndex
from dissect.testing.playback.server.plus_items import PlusItems
from dissect.wire.text import some

#: Which answer comes when the recorded ones are used up (`Stage`).
LAST: Final = "last"
CYCLE: Final = "cycle"

_INCONSISTENT: Final = b"\x07"  # return code "data type inconsistent": the data have a different size from the item
_MIN_SETUP: Final = 4
_UNSET_LENGTH: Final = 960  # PDU length for answers to a client without a setup


class Reply(NamedTuple):
    """The reply to a request.

    ``octets`` are the answer, empty for none. ``then`` are messages after it; ``end`` is how the connection ends afterwards,
    otherwise empty. ``how`` is the origin of the answer: a name of `LEVELS`, ``setup``, ``items``, ``memory``, or
    ``unmatched``. ``lacking`` names what was not recorded, empty if everything was found.
    """

    octets: bytes
    how: str
    latency_ns: int = 0
    then: tuple[ServerMessage, ...] = ()
    end: str = ""
    lacking: str = ""


class Stage:
    """A recording that is served to all clients: its indexes, its memory, and the connection assigned to each client."""

    def __init__(self, recording: Recording, repeat: str = LAST, memory: bool = False) -> None:
        self.recording = recording
        self.repeat = repeat
        self.image = Image(recording) if memory else None
        ours = [script for script in recording.scripts if not script.plus]
        plus = [script for script in recording.scripts if script.plus]
        self.all = AnswerIndex(ours)
        self.plus_all = PlusIndex(plus)
        self._books = {id(script): self.all if len(ours) == 1 else AnswerIndex([script]) for script in ours}
        self._plus_scripts = plus
        self._plus_items: PlusItems | None = None
        self._plus_books = {id(one): self.plus_all if len(plus) == 1 else PlusIndex([one]) for one in plus}
        self._given = {id(script): 0 for script in recording.scripts}

    @property
    def troubles(self) -> list[str]:
        """Return what had no room in memory, one line each."""
        troubles = []
        if self.image is not None and self.image.full:
            troubles.append("the recording has more memory than is kept: its last part is not served")
        if self.all.full:
            troubles.append("the recording has more items than are kept: answers use its first part")
        return troubles

    def book(self, script: Script) -> AnswerIndex:
        """Return the index of one recorded connection."""
        return self._books[id(script)]

    def plus_book(self, script: Script) -> PlusIndex:
        """Return the index of one recorded connection of S7comm-plus."""
        return self._plus_books[id(script)]

    @property
    def plus_items(self) -> PlusItems:
        """The items of recorded reads of S7comm-plus."""
        if self._plus_items is None:
            self._plus_items = PlusItems(self._plus_scripts)
        return self._plus_items

    def near(self, request: Pdu) -> str:
        """Return the names of the recorded requests that are nearest to an unrecorded one."""
        return nearest(
            request, [step.request for script in self.recording.scripts if not script.plus for step in script.steps]
        )

    def script_for(self, calling: bytes | None, called: bytes | None) -> Script:
        """Choose the recorded connection for a client: with its TSAPs, else with the TSAP it calls, else any.

        Of several, the one that was chosen least often; of these, the first in the recording.
        """
        scripts = self.recording.scripts
        alike = [script for script in scripts if script.called == called and script.calling == calling]
        alike = alike or [script for script in scripts if script.called == called] or scripts
        chosen = min(alike, key=lambda script: self._given[id(script)])
        self._given[id(chosen)] += 1
        return chosen


class FakePlc:
    """The fake PLC for one client."""

    def __init__(self, stage: Stage, script: Script) -> None:
        self.script = script
        self.pdu_length = 0  # granted to this client, 0 before the setup
        self.reference = b""  # of the recorded request that was played last, empty before
        self._stage = stage
        self._own = stage.book(script)
        self._books = (self._own,) if self._own is stage.all else (self._own, stage.all)
        self._turns: dict[tuple[int, int, bytes], int] = {}
        self._heard: set[int] = set()  # steps of the script that were played

    def reply(self, request: Pdu) -> Reply:
        """Return the reply to a request. Never raises, whatever the request contains."""
        keys = keys_of(request.octets, request)
        step, level, own = self._find(keys)
        # The references in a golden are all equal: a later answer does not belong to an unanswered request.
        counts = step is not None and (self.script.numbered or bool(step.answer))
        self.reference = step.request[PDU_REF] if step is not None and counts else b""
        items = request.rosctr == JOB and request.function in {READ_VAR, WRITE_VAR} and bool(request.parameters.items)
        whole = items and not request.malformed
        remembers = self._stage.image is not None and whole and not (step is not None and _refused_whole(step))
        if request.parameters.setup is not None and request.rosctr == JOB and level != 0:
            reply = self._set_up(request)
        elif step is not None and not remembers:
            answer = self._recorded_answer(step, request) if step.answer else b""
            reply = Reply(answer, LEVELS[level], step.latency_ns, tuple(step.then), self._end_after(step, own))
        elif whole:
            reply = self._items(request)
        else:
            reply = self._unmatched(request)
        if request.function == SETUP_COMMUNICATION:
            self._note_setup(reply.octets)
        return self._fitted(request, reply)

    # ---- recorded answers -------------------------------------------------------------------------------------------

    def _recorded_answer(self, step: RecordedStep, request: Pdu) -> bytes:
        answer = with_reference(step.answer, request.octets[PDU_REF])
        return answer if self.script.numbered else answered_piece(answer, request)

    def _find(self, keys: tuple[bytes, bytes, bytes]) -> tuple[RecordedStep | None, int, bool]:
        """Return the recorded request to play, its similarity (`LEVELS`), and whether it is from this connection."""
        for level, key in enumerate(keys):
            for number, book in enumerate(self._books):
                steps = book.steps(level, key) if key else []
                if steps:
                    return steps[self._turn((number, level, key), len(steps))], level, number == 0
        return None, -1, False

    def _turn(self, key: tuple[int, int, bytes], count: int) -> int:
        """Return the index of the recorded answer to use, of ``count``."""
        turn = self._turns.get(key, 0)
        self._turns[key] = turn + 1
        return turn % count if self._stage.repeat == CYCLE else min(turn, count - 1)

    def _end_after(self, step: RecordedStep, own: bool) -> str:
        """Return how the connection ends after a step: as the recorded one, once all of it was played."""
        if not self.script.end or not own:
            return ""
        self._heard.add(id(step))
        return self.script.end if len(self._heard) == len(self.script.steps) else ""

    def _set_up(self, request: Pdu) -> Reply:
        setup = self._own.setup or self._stage.all.setup
        return Reply(grant(request, setup.answer if setup is not None else b""), "setup")

    def _note_setup(self, answer: bytes) -> None:
        granted = parse_pdu(answer).parameters.setup if answer else None
        if granted is not None:
            self.pdu_length = max(granted.pdu_length, _MIN_SETUP)

    def _fitted(self, request: Pdu, reply: Reply) -> Reply:
        """Refuse an answer that exceeds this client's PDU length, if the recorded client negotiated a larger one."""
        usual = self.script.pdu_length or self._stage.all.pdu_length
        if reply.how in LEVELS and usual and self.pdu_length >= usual:
            return reply  # a device that exceeded the negotiated length is played as it was
        if not self.pdu_length or len(reply.octets) <= self.pdu_length:
            return reply
        lacking = f"the answer has {len(reply.octets)} bytes, the negotiated PDU length is {self.pdu_length}"
        return reply._replace(octets=refuse(request, WRONG_PDU_SIZE), how="unmatched", lacking=lacking)

    def _unmatched(self, request: Pdu) -> Reply:
        head = request.parameters.userdata
        # A push from a client is a request with a wrong type, unless it is one that programs send each other.
        is_push = head is not None and (
            head.type == RESPONSE or (head.type == PUSH and not is_plc_push(request.parameters))
        )
        wants = request.rosctr == JOB or (request.rosctr == USERDATA and not is_push)
        return Reply(
            refuse(request) if wants else b"",
            "unmatched",
            lacking="no similar request was recorded" + self._stage.near(request),
        )

    # ---- items ------------------------------------------------------------------------------------------------------

    def _items(self, request: Pdu) -> Reply:
        """Build the answer item by item: from memory if it is enabled, otherwise from the recording."""
        writes = request.function == WRITE_VAR
        parameters = request.parameters
        if not writes and parameters.answer_size > (self.pdu_length or _UNSET_LENGTH):
            return Reply(
                refuse(request, WRONG_PDU_SIZE),
                "unmatched",
                lacking=f"the answer has {parameters.answer_size} bytes or more",
            )
        contents = [content.data for content in request.data_items()] if writes else []
        answers: list[bytes] = []
        missing: list[str] = []
        latency_ns = 0
        for index, item in enumerate(parameters.items):
            recorded = self._recorded(item_key(request.function, item))
            answer = self._remembered(index, request, contents, recorded)
            if not answer and recorded is not None:
                answer = recorded.octets
                latency_ns = max(latency_ns, recorded.latency_ns)
            if not answer:
                missing.append(item.label)
            answers.append(answer or missing_item(writes))
        how = "memory" if self._stage.image is not None else "items"
        if not missing:
            return Reply(answer_items(request, answers), how, latency_ns)
        lacking = f"not recorded: {some(missing, 5)}{self._stage.near(request)}"
        return Reply(answer_items(request, answers), "unmatched", latency_ns, lacking=lacking)

    def _recorded(self, key: bytes) -> ItemAnswer | None:
        for number, book in enumerate(self._books):
            answers = book.items(key)
            if answers:
                return answers[self._turn((number, len(LEVELS), key), len(answers))]
        return None

    def _remembered(self, index: int, request: Pdu, contents: list[bytes], recorded: ItemAnswer | None) -> bytes:
        """Return the answer to an item from memory, empty if memory does not have it."""
        image = self._stage.image
        item = request.parameters.items[index]
        if image is None or not holds(item):
            return b""
        if request.function == READ_VAR:
            return image.read(item) or b""
        if recorded is not None and not recorded.good:
            return b""  # a recorded refusal is repeated, and nothing is written
        data = contents[index] if index < len(contents) else b""
        if len(data) != item.size:
            return _INCONSISTENT
        return b"\xff" if image.write(item, data) else b""


def _refused_whole(step: RecordedStep) -> bool:
    """Return whether a request was refused in the header of its answer, or not answered at all."""
    return len(step.answer) < 12 or step.answer[1] not in {2, 3} or step.answer[10:12] != b"\0\0"
