"""Synthetic S7 conversations and the truth about them, independent of the package.

A `Conversation` has the messages of two ends in order of time, together with its `Deal`s: the requests, the answers, and their
positions in the octets of each side. `segments` turns it into TCP segments; `reordered` and `merged` produce the captured form.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from random import Random
from typing import Final, NamedTuple

from tests.properties import messages
from tests.properties.messages import ACK, ACK_DATA, EMPTY_DT, JOB, connect, dt, fragments, pdu, setup, userdata
from tests.properties.packets import Flow, Segment, Talk

#: How ends number their requests (reference 5.2).
NUMBERINGS: Final = ("big", "little", "smallest", "constant")

Span = tuple[int, int]
_NOWHERE: Final = (0, 0)


class Deal:
    """A transaction as it truly is. ``asked_by`` is a side; an empty ``request`` or ``response`` was never sent."""

    def __init__(self, asked_by: int, ref: int, request: bytes = b"", response: bytes = b"") -> None:
        self.asked_by = asked_by
        self.ref = ref
        self.request = request
        self.response = response
        self.request_span: Span = _NOWHERE
        self.response_span: Span = _NOWHERE

    @property
    def outcome(self) -> str:
        """Return the outcome that a report must state."""
        if self.request:
            return "answered" if self.response else "unanswered"
        pushed = self.response[1] == messages.USERDATA and self.response[15] >> 6 == 0
        return "unsolicited" if pushed else "orphan_answer"

    def touched(self, side: int, span: Span) -> bool:
        """Return whether octets ``span`` that ``side`` sent belong to it."""
        start, end = self.request_span if side == self.asked_by else self.response_span
        return start < span[1] and span[0] < end


class Message(NamedTuple):
    """Data that one side gives to its TCP at once."""

    side: int
    octets: bytes


class Conversation:
    """One connection: messages in order of time, and the deals made with them."""

    def __init__(self, flow: Flow, *, handshake: bool = True, ending: str = "") -> None:
        self.flow = flow
        self.handshake = handshake
        self.ending = ending  # "fin" or "reset" by side 0, or nothing
        self.messages: list[Message] = []
        self.deals: list[Deal] = []
        self._said = [0, 0]

    def say(self, side: int, *pieces: bytes) -> Span:
        """Let ``side`` send octets in one message; return their position in its stream."""
        octets = b"".join(pieces)
        start = self._said[side]
        self._said[side] += len(octets)
        self.messages.append(Message(side, octets))
        return start, self._said[side]

    def ask(self, deal: Deal, octets: bytes) -> None:
        """Send the request of a deal; ``octets`` is the request in its TPKTs."""
        deal.request_span = self.say(deal.asked_by, octets)
        self.deals.append(deal)

    def answer(self, deal: Deal, octets: bytes) -> None:
        """Send the answer of a deal, in its TPKTs."""
        deal.response_span = self.say(1 - deal.asked_by, octets)

    def together(self, start: int) -> None:
        """Join the messages from the number ``start`` on, all of one side, into one."""
        joined = self.messages[start:]
        if len(joined) > 1:
            self.messages[start:] = [Message(joined[0].side, b"".join([message.octets for message in joined]))]

    def exchange(self, asked_by: int, request: bytes, response: bytes) -> Deal:
        """Ask and answer, a DT each."""
        deal = Deal(asked_by, int.from_bytes(request[4:6], "big"), request, response)
        self.ask(deal, dt(request))
        if response:
            self.answer(deal, dt(response))
        return deal

    def begin(self, amq: int = 1, length: int = 480, ref: int = 0) -> Conversation:
        """Connect and set communication up."""
        self.say(0, connect(0xE0))
        self.say(1, connect(0xD0))
        self.exchange(0, setup(JOB, ref, amq, length), setup(ACK_DATA, ref, amq, length))
        return self


class _End:
    """The way in which one end numbers its requests.

    If several may be open, an unanswered one stays open to the end of the conversation: its reference is not reused, because it
    would be unclear to which of the two an answer belongs.
    """

    def __init__(self, rng: Random) -> None:
        self._numbering = rng.choice(NUMBERINGS)
        self._next = rng.choice((0, 1, 0xFFFE, rng.randrange(0x10000)))
        self._open: set[int] = set()

    def stays_open(self, ref: int) -> None:
        """Do not use a reference again."""
        self._open.add(ref)

    def references(self, count: int) -> list[int]:
        """Return the references of ``count`` requests that will be open together."""
        if self._numbering == "smallest":
            return [ref for ref in range(1, count + len(self._open) + 1) if ref not in self._open][:count]
        if self._numbering == "constant" and count == 1 and 0x0500 not in self._open:
            return [0x0500]
        numbers = [(self._next + step) & 0xFFFF for step in range(count)]
        self._next = (self._next + count) & 0xFFFF
        if self._numbering == "little":
            return [(number & 0xFF) << 8 | number >> 8 for number in numbers]
        return numbers


def _variables(rng: Random, ref: int) -> tuple[bytes, bytes]:
    items = messages.random_items(rng)
    contents = [rng.randbytes(item.octets) for item in items]
    if rng.random() < 0.6:
        answers = [rng.choice((0x05, 0x0A)) if rng.random() < 0.1 else content for content in contents]
        return messages.read_job(ref, items), messages.read_answer(ref, items, answers)
    codes = [0x05 if rng.random() < 0.1 else 0xFF for _ in items]
    return messages.write_job(ref, items, contents), messages.write_answer(ref, codes)


def _service(rng: Random, ref: int) -> tuple[bytes, bytes]:
    choice = rng.randrange(4)
    if choice == 0:  # compress memory, sometimes refused
        refused = pdu(ACK, ref, b"", b"", 0x8104)
        job = pdu(JOB, ref, b"\x28" + bytes(6) + b"\xfd\x00\x00\x05_GARB")
        return job, refused if rng.random() < 0.3 else pdu(ACK_DATA, ref, b"\x28")
    if choice == 1:  # a piece of an upload
        piece = rng.randbytes(rng.randrange(1, 200))
        answer = pdu(ACK_DATA, ref, b"\x1e\x00", len(piece).to_bytes(2, "big") + b"\x00\xfb" + piece)
        return pdu(JOB, ref, b"\x1e\x00\x00\x00\x00\x00\x00\x07"), answer
    if choice == 2:  # a system status list, sometimes refused
        error = 0xD401 if rng.random() < 0.2 else 0
        answer = userdata(ref, 2, 4, 1, b"" if error else rng.randbytes(rng.randrange(8, 100)), error)
        return userdata(ref, 1, 4, 1, b"\x00\x11\x00\x00"), answer
    return userdata(ref, 1, 7, 1), userdata(ref, 2, 7, 1, bytes.fromhex("00202311142215306213"))


def _tpkts(rng: Random, octets: bytes, fragmented: float) -> bytes:
    """Return a PDU in one DT, or in several that are not empty."""
    if rng.random() >= fragmented:
        return dt(octets)
    cuts = sorted({rng.randrange(1, len(octets)) for _ in range(rng.randint(1, 3))})
    return fragments(octets, cuts)


def _round(rng: Random, conversation: Conversation, ends: Sequence[_End], most: int, silent: float) -> None:
    """One or several requests of one side, then their answers."""
    side = int(rng.random() < 0.2)
    deals = []
    for ref in ends[side].references(rng.randint(1, most)):
        request, response = (_variables if rng.random() < 0.7 else _service)(rng, ref)
        deal = Deal(side, ref, request, b"" if rng.random() < silent else response)
        deals.append(deal)
        if most > 1 and not deal.response:
            ends[side].stays_open(ref)
    start = len(conversation.messages)
    for deal in deals:
        conversation.ask(deal, _tpkts(rng, deal.request, 0.1))
    if rng.random() < 0.4:
        conversation.together(start)
    if rng.random() < 0.1:
        push = Deal(0, 0, b"", userdata(0, 0, 4, 3, rng.randbytes(20)))
        conversation.deals.append(push)
        conversation.answer(push, dt(push.response))
    answered = [deal for deal in deals if deal.response]
    if rng.random() < 0.15:
        rng.shuffle(answered)
    start = len(conversation.messages)
    for deal in answered:
        conversation.answer(deal, _tpkts(rng, deal.response, 0.1))
    if rng.random() < 0.3:
        conversation.together(start)
    if rng.random() < 0.3:
        conversation.say(side, EMPTY_DT)


def conversation(
    rng: Random, flow: Flow, rounds: int, *, midstream: bool = False, silent: float = 0.03
) -> Conversation:
    """Return a conversation of many kinds. ``silent`` is the share of unanswered requests."""
    made = Conversation(flow, handshake=not midstream, ending=rng.choice(("", "fin", "reset")))
    most = rng.choice((1, 1, 2, 3))
    if midstream:
        made.exchange(0, *_variables(rng, 0x7001))
        late = Deal(0, 0x7000, b"", messages.write_answer(0x7000, [0xFF]))  # to a request before the capture
        made.deals.append(late)
        made.answer(late, dt(late.response))
    else:
        made.begin(amq=max(1, most))
    ends = (_End(rng), _End(rng))
    for _ in range(rounds):
        _round(rng, made, ends, most, silent)
    return made


def conversations(rng: Random, count: int, rounds: int, *, silent: float = 0.03) -> list[Conversation]:
    """Return several conversations, each with its own client; one in five is captured from the middle on."""
    return [
        conversation(rng, Flow(f"10.0.1.{number + 1}"), rounds, midstream=rng.random() < 0.2, silent=silent)
        for number in range(count)
    ]


def segments(
    made: Conversation,
    rng: Random | None = None,
    *,
    cut: float = 0.0,
    join: float = 0.0,
    acks: float = 0.3,
    isns: tuple[int, int] = (1000, 500_000),
) -> list[Segment]:
    """Return a conversation as TCP segments in order of time.

    ``cut`` is the share of messages sent in several segments, ``join`` that of messages of one side which travel with the next,
    ``acks`` that of messages acknowledged by an empty segment. Without ``rng`` each message is a segment. The first message of
    a side in a conversation captured from the middle on is never cut: it could not be recognised from the middle of a TPKT.
    """
    rng = rng if rng is not None else Random(0)
    talk = Talk(made.flow, isns)
    if made.handshake:
        talk.handshake()
    waiting = b""
    known = {0, 1} if made.handshake else set()  # sides whose beginning the capture shows
    for at, (side, octets) in enumerate(made.messages):
        waiting += octets
        followed = at + 1 < len(made.messages) and made.messages[at + 1].side == side
        if followed and rng.random() < join:
            continue
        talk.send(side, *_cut(rng, waiting, cut if side in known else 0.0))
        waiting = b""
        known.add(side)
        if rng.random() < acks:
            talk.ack(1 - side)
    if made.ending == "fin":
        talk.close(0)
    elif made.ending == "reset":
        talk.reset(0)
    return talk.segments


def _cut(rng: Random, octets: bytes, share: float) -> list[bytes]:
    if rng.random() >= share or len(octets) < 2:
        return [octets]
    places = {rng.randrange(1, len(octets)) for _ in range(rng.choice((1, 1, 2, 5)))}
    # After a loss, every reader takes a segment that begins with these two octets for the beginning of a TPKT.
    cuts = [place for place in sorted(places) if octets[place : place + 2] != b"\x03\x00"]
    edges = [0, *cuts, len(octets)]
    return [octets[start:end] for start, end in pairwise(edges)]


def merged(rng: Random, streams: Sequence[Sequence[Segment]]) -> list[Segment]:
    """Return segments of several connections in one order that keeps the order of each connection."""
    order = [number for number, stream in enumerate(streams) for _ in stream]
    rng.shuffle(order)
    sources = [iter(stream) for stream in streams]
    return [next(sources[number]) for number in order]


def _fixed(sent: Sequence[Segment]) -> int:
    """Return how many segments must keep their place, so that the capture shows where each direction begins."""
    if sent and not sent[0].payload:
        return 3  # the handshake
    begun: set[int] = set()
    for at, segment in enumerate(sent):
        if segment.payload:
            begun.add(segment.side)
        if len(begun) == 2:
            return at + 1
    return len(sent)


def reordered(rng: Random, sent: Sequence[Segment], reach: float, copies: float = 0.0) -> list[Segment]:
    """Return the segments of one connection as in a capture that moves packets by up to ``reach`` places.

    A share ``copies`` of the packets occurs a second time, after the first.
    """
    still = _fixed(sent)
    placed: list[tuple[float, int, Segment]] = []
    for at, segment in enumerate(sent):
        place = at + (rng.uniform(0, reach) if at >= still and rng.random() < 0.4 else 0)
        placed.append((place, at, segment))
        if rng.random() < copies:
            placed.append((place + rng.uniform(0, reach), at, segment))
    placed.sort(key=lambda row: row[:2])
    return [segment for _, _, segment in placed]
