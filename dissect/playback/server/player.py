"""The fake PLC without its sockets: a request in, what the recording answers out.

A client's connection is given a recorded one (`Stage.script_for`) and has a `Player` of its own, so that what one client
hears does not depend on what others ask. A request is looked for in the recorded connection first, then in all of them, by
how much it is like it (`answer_index.LEVELS`); reads and writes that nothing is like are put together of recorded items.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.playback.bsend import answered_piece
from dissect.playback.server.answer_index import LEVELS, AnswerIndex, ItemAnswer, item_key, keys_of
from dissect.playback.server.answers import (
    WRONG_PDU_SIZE,
    answer_items,
    grant,
    missing_item,
    refuse,
)
from dissect.playback.server.image import Image, holds
from dissect.playback.server.model import Recording, Said, Script, Step
from dissect.playback.server.near import near
from dissect.playback.server.plus import PlusIndex
from dissect.playback.server.plus_items import PlusItems
from dissect.s7.build import with_reference
from dissect.s7.layouts import PDU_REF
from dissect.s7.message import Pdu, parse_pdu
from dissect.s7.parameters import PUSH, RESPONSE, is_plc_push
from dissect.s7.tables import JOB, READ_VAR, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.wire.text import some

#: What a request is answered with when its recorded answers are used up (`Stage`).
LAST: Final = "last"
CYCLE: Final = "cycle"

_INCONSISTENT: Final = b"\x07"  # return code "data type inconsistent": not as many octets as the item has
_MIN_SETUP: Final = 4
_UNSET_LENGTH: Final = 960  # of answers put together for a client that has set up nothing


class Reply(NamedTuple):
    """What is said to a request.

    ``octets`` are the answer, empty for none. ``then`` follows it; ``end`` is how the connection ends afterwards, else empty.
    ``how`` says where the answer is from: a name of `LEVELS`, ``setup``, ``items``, ``memory``, or ``unmatched``.
    ``lacking`` says what the recording has nothing for, empty when all was found.
    """

    octets: bytes
    how: str
    latency_ns: int = 0
    then: tuple[Said, ...] = ()
    end: str = ""
    lacking: str = ""


class Stage:
    """A recording as it is played to all clients: its books, its memory, and who is given which connection of it."""

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
        """What of the recording had no room, a line each."""
        found = []
        if self.image is not None and self.image.full:
            found.append("the recording has more memory than is kept: its last part is not served")
        if self.all.full:
            found.append("the recording has more items than are kept: answers use its first part")
        return found

    def book(self, script: Script) -> AnswerIndex:
        """Return what is said on one recorded connection."""
        return self._books[id(script)]

    def plus_book(self, script: Script) -> PlusIndex:
        """Return what is said on one recorded connection of S7comm-plus."""
        return self._plus_books[id(script)]

    @property
    def plus_items(self) -> PlusItems:
        """The items of recorded reads of S7comm-plus."""
        if self._plus_items is None:
            self._plus_items = PlusItems(self._plus_scripts)
        return self._plus_items

    def near(self, asked: Pdu) -> str:
        """Name the recorded requests that are nearest to one without a recording."""
        return near(
            asked, [step.request for script in self.recording.scripts if not script.plus for step in script.steps]
        )

    def script_for(self, calling: bytes | None, called: bytes | None) -> Script:
        """Choose the recorded connection for a client: with its TSAPs, else with the TSAP it calls, else any.

        Of several the one that was given least often, the first recorded of these.
        """
        scripts = self.recording.scripts
        alike = [script for script in scripts if script.called == called and script.calling == calling]
        alike = alike or [script for script in scripts if script.called == called] or scripts
        chosen = min(alike, key=lambda script: self._given[id(script)])
        self._given[id(chosen)] += 1
        return chosen


class Player:
    """What one client hears."""

    def __init__(self, stage: Stage, script: Script) -> None:
        self.script = script
        self.pdu_length = 0  # granted to this client, 0 before the setup
        self.reference = b""  # of the recorded request that was played last, empty when none was
        self._stage = stage
        self._own = stage.book(script)
        self._books = (self._own,) if self._own is stage.all else (self._own, stage.all)
        self._turns: dict[tuple[int, int, bytes], int] = {}
        self._heard: set[int] = set()  # steps of the script that were played

    def reply(self, asked: Pdu) -> Reply:
        """Return what is said to a request. Never raises, whatever the request is."""
        keys = keys_of(asked.octets, asked)
        found, level, own = self._find(keys)
        # Of a golden all recorded references are alike: one that is not answered is not what a later answer belongs to.
        counts = found is not None and (self.script.numbered or bool(found.answer))
        self.reference = found.request[PDU_REF] if found is not None and counts else b""
        items = asked.rosctr == JOB and asked.function in {READ_VAR, WRITE_VAR} and bool(asked.parameters.items)
        whole = items and not asked.malformed
        remembers = self._stage.image is not None and whole and not (found is not None and _refused_whole(found))
        if asked.parameters.setup is not None and asked.rosctr == JOB and level != 0:
            reply = self._set_up(asked)
        elif found is not None and not remembers:
            answer = self._recorded_answer(found, asked) if found.answer else b""
            reply = Reply(answer, LEVELS[level], found.latency_ns, tuple(found.then), self._end_after(found, own))
        elif whole:
            reply = self._items(asked)
        else:
            reply = self._unmatched(asked)
        if asked.function == SETUP_COMMUNICATION:
            self._note_setup(reply.octets)
        return self._fitted(asked, reply)

    # ---- recorded answers -------------------------------------------------------------------------------------------

    def _recorded_answer(self, found: Step, asked: Pdu) -> bytes:
        answer = with_reference(found.answer, asked.octets[PDU_REF])
        return answer if self.script.numbered else answered_piece(answer, asked)

    def _find(self, keys: tuple[bytes, bytes, bytes]) -> tuple[Step | None, int, bool]:
        """Return the recorded request that is played, how like it is (`LEVELS`) and whether it is of this connection."""
        for level, key in enumerate(keys):
            for number, book in enumerate(self._books):
                steps = book.steps(level, key) if key else []
                if steps:
                    return steps[self._turn((number, level, key), len(steps))], level, number == 0
        return None, -1, False

    def _turn(self, key: tuple[int, int, bytes], count: int) -> int:
        """Return which of ``count`` recorded answers it is this time."""
        turn = self._turns.get(key, 0)
        self._turns[key] = turn + 1
        return turn % count if self._stage.repeat == CYCLE else min(turn, count - 1)

    def _end_after(self, step: Step, own: bool) -> str:
        """Tell how the connection ends after a step: as the server ended the recorded one, once all of it was played."""
        if not self.script.end or not own:
            return ""
        self._heard.add(id(step))
        return self.script.end if len(self._heard) == len(self.script.steps) else ""

    def _set_up(self, asked: Pdu) -> Reply:
        setup = self._own.setup or self._stage.all.setup
        return Reply(grant(asked, setup.answer if setup is not None else b""), "setup")

    def _note_setup(self, answer: bytes) -> None:
        granted = parse_pdu(answer).parameters.setup if answer else None
        if granted is not None:
            self.pdu_length = max(granted.pdu_length, _MIN_SETUP)

    def _fitted(self, asked: Pdu, reply: Reply) -> Reply:
        """Refuse an answer that is larger than this client agreed to, where the recorded one agreed to more."""
        usual = self.script.pdu_length or self._stage.all.pdu_length
        if reply.how in LEVELS and usual and self.pdu_length >= usual:
            return reply  # a device that kept to nothing is not made better
        if not self.pdu_length or len(reply.octets) <= self.pdu_length:
            return reply
        lacking = f"the answer has {len(reply.octets)} bytes, the negotiated PDU length is {self.pdu_length}"
        return reply._replace(octets=refuse(asked, WRONG_PDU_SIZE), how="unmatched", lacking=lacking)

    def _unmatched(self, asked: Pdu) -> Reply:
        head = asked.parameters.userdata
        # A push from a client is a request that mistakes its type, unless it is what programs send each other.
        told = head is not None and (head.type == RESPONSE or (head.type == PUSH and not is_plc_push(asked.parameters)))
        wants = asked.rosctr == JOB or (asked.rosctr == USERDATA and not told)
        return Reply(
            refuse(asked) if wants else b"",
            "unmatched",
            lacking="no similar request was recorded" + self._stage.near(asked),
        )

    # ---- items ------------------------------------------------------------------------------------------------------

    def _items(self, asked: Pdu) -> Reply:
        """Put the answer together item by item: from memory where there is one, else as it was recorded."""
        writes = asked.function == WRITE_VAR
        parameters = asked.parameters
        if not writes and parameters.answer_size > (self.pdu_length or _UNSET_LENGTH):
            return Reply(
                refuse(asked, WRONG_PDU_SIZE),
                "unmatched",
                lacking=f"the answer has {parameters.answer_size} bytes or more",
            )
        contents = [content.data for content in asked.data_items()] if writes else []
        answers: list[bytes] = []
        missing: list[str] = []
        latency_ns = 0
        for index, item in enumerate(parameters.items):
            recorded = self._recorded(item_key(asked.function, item))
            answer = self._remembered(index, asked, contents, recorded)
            if not answer and recorded is not None:
                answer = recorded.octets
                latency_ns = max(latency_ns, recorded.latency_ns)
            if not answer:
                missing.append(item.label)
            answers.append(answer or missing_item(writes))
        how = "memory" if self._stage.image is not None else "items"
        if not missing:
            return Reply(answer_items(asked, answers), how, latency_ns)
        lacking = f"not recorded: {some(missing, 5)}{self._stage.near(asked)}"
        return Reply(answer_items(asked, answers), "unmatched", latency_ns, lacking=lacking)

    def _recorded(self, key: bytes) -> ItemAnswer | None:
        for number, book in enumerate(self._books):
            answers = book.items(key)
            if answers:
                return answers[self._turn((number, len(LEVELS), key), len(answers))]
        return None

    def _remembered(self, index: int, asked: Pdu, contents: list[bytes], recorded: ItemAnswer | None) -> bytes:
        """Return the answer to an item from memory, empty when memory has nothing to say."""
        image = self._stage.image
        item = asked.parameters.items[index]
        if image is None or not holds(item):
            return b""
        if asked.function == READ_VAR:
            return image.read(item) or b""
        if recorded is not None and not recorded.good:
            return b""  # what was refused is refused again, and not written
        data = contents[index] if index < len(contents) else b""
        if len(data) != item.size:
            return _INCONSISTENT
        return b"\xff" if image.write(item, data) else b""


def _refused_whole(step: Step) -> bool:
    """Tell whether a request was refused by the header of its answer, or not answered at all."""
    return len(step.answer) < 12 or step.answer[1] not in {2, 3} or step.answer[10:12] != b"\0\0"
