"""Simulated clients and servers with several open requests, event by event, and the truth about each answer.

A `Conversation` has a client of one or several threads, which share a TCP connection, a server that answers in order, and a
place between them where packets are captured: an end acknowledges what it had received by then. `shaken` joins segments, cuts
them and sends them again. Independent of the package.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from heapq import heappop, heappush
from itertools import count
from random import Random
from typing import Final, NamedTuple

from tests.properties.messages import (
    ACK,
    ACK_DATA,
    EMPTY_DT,
    JOB,
    Item,
    connect,
    dt,
    pdu,
    random_items,
    read_answer,
    read_job,
    setup,
    userdata,
    write_answer,
    write_job,
)
from tests.properties.packets import ACK as ACKED
from tests.properties.packets import EPOCH_NS, FIN, MASK, MS, RST, SYN, Flow, Segment

CLIENT: Final = 0
SERVER: Final = 1
SECOND: Final = 1000 * MS
#: A time that never comes.
NEVER: Final = 1 << 60


class Deal:
    """A request and its treatment by the server: it takes ``service_ns``, or never answers if that is `NEVER`.

    ``again`` is the request that this one repeats, octet by octet: they cannot be told apart, so an answer to one is as good as
    one to the other.
    """

    def __init__(
        self, ref: int, request: bytes, answer: bytes, service_ns: int = 2 * MS, again: Deal | None = None
    ) -> None:
        self.ref = ref
        self.request = request
        self.answer = answer
        self.service_ns = service_ns
        self.first: Deal = self if again is None else again.first


class Mark(NamedTuple):
    """A message in a packet, or a part of it: the request or the answer of a deal."""

    deal: Deal
    answers: bool


class Captured(NamedTuple):
    """A packet at the place of capture, and the messages in it."""

    time_ns: int
    segment: Segment
    marks: tuple[Mark, ...]


class Manners(NamedTuple):
    """The behaviour of the ends of a conversation.

    ``threads`` wait for an answer each; ``timeout_ns`` is how long, ``pause_ns`` how long they rest before the next request.
    ``retries``: a request without an answer in time is sent once more. ``naive``: the client takes any answer as that of the
    request that waits longest, and the sockets keep late ones for the next request. ``early``: ends acknowledge by empty DTs.
    ``delays_ns`` are those from the client to the place of the capture and from there to the server, ``ack_ns`` how long an end
    waits for something to send with an acknowledgement.
    """

    threads: int = 1
    amq: int = 1
    handshake: bool = True
    timeout_ns: int = NEVER
    pause_ns: int = 0
    retries: bool = False
    naive: bool = False
    early: bool = False
    delays_ns: tuple[int, int] = (MS // 10, MS // 10)
    ack_ns: int = 40 * MS
    pushes: float = 0.0
    ending: str = "fin"


class Conversation:
    """The captured packets of ``deals``, requested in their order by a client with those ``manners``."""

    def __init__(self, rng: Random, deals: Sequence[Deal], manners: Manners) -> None:
        self.packets: list[Captured] = []
        self._rng = rng
        self._manners = manners
        self._flow = Flow()
        self._now = 0
        self._events: list[tuple[int, int, Callable[[], object]]] = []
        self._numbers = count()
        start = [rng.randrange(MASK), rng.randrange(MASK)]
        self._seq = list(start)
        self._got = list(start)  # the octets that the other end has from each end
        self._acked = list(start)  # the octets of these that the other end acknowledged
        self._next = list(reversed(deals))
        self._waiting: list[Deal] = []  # the oldest first
        self._kept = 0  # unexpected answers in the socket
        self._busy_ns = 0
        self._under_way = 0
        self._ended = False
        self._hung_up = False
        self._begin()
        while self._events:
            self._now, _, happens = heappop(self._events)
            happens()
        self.packets.sort(key=lambda packet: packet.time_ns)

    # ---- the line ----------------------------------------------------------------------------------------------------

    def _after(self, duration_ns: int, happens: Callable[[], object]) -> None:
        heappush(self._events, (self._now + duration_ns, next(self._numbers), happens))

    @property
    def _way_ns(self) -> int:
        return sum(self._manners.delays_ns)

    def _send(self, side: int, payload: bytes, flags: int = ACKED, marks: tuple[Mark, ...] = ()) -> None:
        """Send a segment, with an acknowledgement of everything that its sender has received by now."""
        seq = self._seq[side]
        end = self._seq[side] = seq + len(payload) + bool(flags & SYN) + bool(flags & FIN)
        acked = self._got[1 - side] if flags & ACKED else 0
        if flags & ACKED:
            self._acked[1 - side] = acked
        segment = Segment(self._flow, side, seq & MASK, acked & MASK, flags, payload)
        here = EPOCH_NS + self._now + self._manners.delays_ns[side]
        self.packets.append(Captured(here, segment, marks))
        if end != seq:
            self._after(self._way_ns, partial(self._arrives, side, end))

    def _arrives(self, side: int, end: int) -> None:
        """The other end receives what ``side`` sent; it acknowledges it after a while."""
        self._got[side] = end
        self._after(self._manners.ack_ns, partial(self._acknowledges, side, end))

    def _acknowledges(self, side: int, end: int) -> None:
        if self._acked[side] < end:
            self._send(1 - side, b"")

    # ---- the ends ----------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        manners = self._manners
        start = 0
        if manners.handshake:
            agreed = Deal(0xFFFF, setup(JOB, 0xFFFF, manners.amq), setup(ACK_DATA, 0xFFFF, manners.amq))
            steps: list[tuple[int, bytes, int, tuple[Mark, ...]]] = [
                (CLIENT, b"", SYN, ()),
                (SERVER, b"", SYN | ACKED, ()),
                (CLIENT, b"", ACKED, ()),
                (CLIENT, connect(0xE0), ACKED, ()),
                (SERVER, connect(0xD0), ACKED, ()),
                (CLIENT, dt(agreed.request), ACKED, (Mark(agreed, False),)),
                (SERVER, dt(agreed.answer), ACKED, (Mark(agreed, True),)),
            ]
            for step in steps:
                self._after(start, partial(self._send, *step))
                start += self._way_ns + MS
        for number in range(manners.threads):
            self._after(start + number * MS // 5, self._asks_next)

    def _asks_next(self) -> None:
        """A thread of the client sends the next request; if there is none, it ends, and the last one closes the connection."""
        if self._next:
            self._under_way += 1
            self._ask(self._next.pop())
        elif not self._under_way and not self._ended:
            self._ended = True
            self._after(100 * MS, self._ends)

    def _ask(self, deal: Deal) -> None:
        self._send(CLIENT, dt(deal.request), marks=(Mark(deal, False),))
        self._waiting.append(deal)
        self._after(self._way_ns, partial(self._serves, deal))
        if self._manners.timeout_ns < NEVER:
            self._after(self._manners.timeout_ns, partial(self._gives_up, deal))
        if self._kept:
            self._kept -= 1
            self._after(MS // 10, self._takes_any)

    def _gives_up(self, deal: Deal) -> None:
        """An answer did not come in time."""
        if deal not in self._waiting:
            return
        self._waiting.remove(deal)
        if self._manners.retries and deal.first is deal:
            self._ask(Deal(deal.ref, deal.request, deal.answer, 2 * MS, again=deal))
        else:
            self._rests()

    def _rests(self) -> None:
        self._under_way -= 1
        self._after(self._manners.pause_ns, self._asks_next)

    def _serves(self, deal: Deal) -> None:
        """The server has a request. It handles one after the other."""
        if self._rng.random() < self._manners.pushes:
            self._send(SERVER, dt(userdata(0, 0, 4, 3, self._rng.randbytes(20))))
        if deal.service_ns >= NEVER:
            return
        if self._manners.early:
            self._send(SERVER, EMPTY_DT)
        self._busy_ns = max(self._busy_ns, self._now) + deal.service_ns
        self._after(self._busy_ns - self._now, partial(self._answers, deal))

    def _answers(self, deal: Deal) -> None:
        if self._hung_up:
            return
        self._send(SERVER, dt(deal.answer), marks=(Mark(deal, True),))
        self._after(self._way_ns, partial(self._takes, deal))

    def _takes(self, deal: Deal) -> None:
        """The client has an answer."""
        if self._manners.early:
            self._send(CLIENT, EMPTY_DT)
        if not self._manners.naive:
            if deal in self._waiting:
                self._waiting.remove(deal)
                self._rests()
        elif self._waiting:
            self._takes_any()
        else:
            self._kept += 1

    def _takes_any(self) -> None:
        """The request that waits longest takes the available answer."""
        if self._waiting:
            del self._waiting[0]
            self._rests()

    def _ends(self) -> None:
        ending = self._manners.ending
        if ending:
            self._send(CLIENT, b"", (FIN if ending == "fin" else RST) | ACKED)
            self._after(self._way_ns, partial(self._hangs_up, ending))

    def _hangs_up(self, ending: str) -> None:
        """The server notices that the client is gone, and answers nothing more."""
        self._hung_up = True
        if ending == "fin":
            self._send(SERVER, b"", FIN | ACKED)


# ---- what happens on the way -----------------------------------------------------------------------------------------


def shaken(rng: Random, packets: Sequence[Captured], joined: float, cut: float, copied: float) -> list[Captured]:
    """Join neighbouring segments of a side, cut some in two, and send some again 200 ms later; each argument is a share."""
    together: list[Captured] = []
    for packet in packets:
        last = together[-1].segment if together else None
        segment = packet.segment
        if (
            last is not None
            and last.payload
            and segment.payload
            and last.side == segment.side
            and last.flags == segment.flags
            and (last.seq + len(last.payload)) & MASK == segment.seq
            and rng.random() < joined
        ):
            one = segment._replace(seq=last.seq, payload=last.payload + segment.payload)
            together[-1] = Captured(packet.time_ns, one, together[-1].marks + packet.marks)
        else:
            together.append(packet)
    sent: list[Captured] = []
    for packet in together:
        sent += _pieces(rng, packet) if rng.random() < cut else [packet]
    copies = [packet for packet in sent if packet.segment.payload and rng.random() < copied]
    return sorted([*sent, *[_again(packet, sent) for packet in copies]], key=lambda packet: packet.time_ns)


def _again(packet: Captured, sent: Sequence[Captured]) -> Captured:
    """Return a packet that is sent once more after 200 ms, with the acknowledgement of its side at that time."""
    time_ns = packet.time_ns + 200 * MS
    before = [other.segment for other in sent if other.time_ns <= time_ns and other.segment.side == packet.segment.side]
    return Captured(time_ns, packet.segment._replace(ack=before[-1].ack), packet.marks)


def _pieces(rng: Random, packet: Captured) -> list[Captured]:
    """Cut a segment in two, after the header of its TPKT; either of the two may come last and complete its message."""
    segment = packet.segment
    if len(segment.payload) < 20 or len(packet.marks) > 1:
        return [packet]
    at = rng.randrange(12, len(segment.payload))
    first = segment._replace(payload=segment.payload[:at])
    second = segment._replace(seq=(segment.seq + at) & MASK, payload=segment.payload[at:])
    return [packet._replace(segment=first), Captured(packet.time_ns + 1000, second, packet.marks)]


# ---- what is asked ---------------------------------------------------------------------------------------------------


def references(rng: Random) -> Iterator[int]:
    """Count references as clients do: up by one, with the octets swapped, at random; all wrap, and none occurs twice."""
    start = rng.choice((0, 1, 0xFFF0, rng.randrange(0x10000)))
    manner = rng.choice(("up", "swapped", "random"))
    if manner == "random":
        yield from rng.sample(range(0x10000), 200)
        return
    for number in range(start, start + 200):
        ref = number & 0xFFFF
        yield ref if manner == "up" else (ref & 0xFF) << 8 | ref >> 8


def word(number: int, address: int, count: int = 1) -> tuple[list[Item], list[bytes]]:
    """Return a variable of words in DB1 and its content, whose first word is the number of its request."""
    return [Item(4, count, 1, 0x84, address * 16)], [number.to_bytes(2, "big") + bytes(2 * count - 2)]


def reads(ref: int, items: Sequence[Item], contents: Sequence[bytes | int]) -> tuple[bytes, bytes]:
    """Return the request and the answer of a read."""
    return read_job(ref, items), read_answer(ref, items, contents)


def anything(rng: Random, ref: int, number: int) -> tuple[bytes, bytes]:
    """Return a request of any kind and its answer: reads and writes, refused ones, a system status list."""
    choice = rng.randrange(10)
    if choice < 4:  # one shape
        return reads(ref, *word(number, rng.choice((0, number))))
    if choice == 4:
        return read_job(ref, word(number, number)[0]), pdu(ACK_DATA, ref, b"\x04\x00", b"", 0x8104)
    if choice == 5:
        return userdata(ref, 1, 4, 1, b"\x00\x11\x00\x00"), userdata(ref, 2, 4, 1, rng.randbytes(28))
    if choice == 6:
        return pdu(JOB, ref, b"\x28" + bytes(6) + b"\xfd\x00\x00\x05_GARB"), pdu(ACK, ref, b"", b"", 0x8104)
    items = random_items(rng)
    contents = [rng.randbytes(item.octets) for item in items]
    if choice == 7:
        return write_job(ref, items, contents), write_answer(ref, [rng.choice((0xFF, 0xFF, 5)) for _ in items])
    return reads(ref, items, [content if rng.random() < 0.9 else 0x0A for content in contents])


def at_once(rng: Random) -> tuple[int, int]:
    """Return the threads of a client and the agreed number of jobs, which is mostly sufficient."""
    threads = rng.choice((1, 1, 2, 3, 8))
    return threads, rng.choice((1, 3, 8)) if rng.random() < 0.1 else max(threads, rng.choice((1, 3, 8)))
