"""A line with clients and servers whose packets pass at times set by a test, in seconds from the beginning."""

from __future__ import annotations

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.output.baseline import Learner
from tests.meaning.report.support import WORD
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import EPOCH_NS, Flow, Talk


def at_ns(seconds: float) -> int:
    """Return the time of a packet."""
    return EPOCH_NS + round(seconds * 1e9)


class Wire:
    """The packets are passed to an observer."""

    def __init__(self, observer: Observer) -> None:
        self.pipeline = Pipeline(observer, Options(strict=True))

    def packet(self, at: float, octets: bytes) -> None:
        self.pipeline.frame(at_ns(at), octets, 0, len(octets), len(octets), 1)

    def finish(self) -> None:
        self.pipeline.finish()


class Client:
    """A client with one connection to a server, set up at a given time."""

    def __init__(
        self,
        wire: Wire,
        at: float = 0.0,
        client: str = "10.0.0.1",
        server: str = "10.0.0.2",
        ports: tuple[int, int] = (49152, 102),
        called: bytes = b"\x01\x02",
    ) -> None:
        self.wire = wire
        self.talk = Talk(Flow(client, server, ports))
        self._sent = 0
        self._ref = 0
        self.talk.handshake()
        self.talk.send(0, messages.connect(0xE0, called=called)).send(1, messages.connect(0xD0, called=called))
        self.talk.send(0, dt(messages.setup(messages.JOB, 0))).send(1, dt(messages.setup(messages.ACK_DATA, 0)))
        self.pass_on(at)

    def pass_on(self, at: float) -> None:
        """Let what was written down pass."""
        for segment in self.talk.segments[self._sent :]:
            self.wire.packet(at, segment.frame())
        self._sent = len(self.talk.segments)

    def read(
        self, at: float, item: Item = WORD, content: bytes | int = b"\x04\xd2", answer: float | None = 0.001
    ) -> None:
        """Ask at a time and answer this many seconds later, or never."""
        self._ref += 1
        self.talk.send(0, dt(messages.read_job(self._ref, [item])))
        self.pass_on(at)
        if answer is not None:
            self.talk.send(1, dt(messages.read_answer(self._ref, [item], [content])))
            self.pass_on(at + answer)

    def write(self, at: float, item: Item = WORD, code: int = 0xFF) -> None:
        """Write at a time."""
        self._ref += 1
        self.talk.send(0, dt(messages.write_job(self._ref, [item], [b"\x00\x01"])))
        self.talk.send(1, dt(messages.write_answer(self._ref, [code])))
        self.pass_on(at)

    def keep_alive(self, at: float) -> None:
        """Send a segment without octets."""
        self.talk.ack(0)
        self.pass_on(at)

    def close(self, at: float) -> None:
        self.talk.close()
        self.pass_on(at)


MARKER = Item(0x02, 1, 0, 0x83, 0)
BLOCK = Item(0x04, 1, 12, 0x84, 0)


def learned(*clients: str) -> Learner:
    learner = Learner()
    wire = Wire(learner)
    for number, address in enumerate(clients):
        client = Client(wire, 0.0, address, ports=(5000 + number, 102))
        for second in range(5):
            client.read(second + 0.5, answer=0.002)
        client.read(9.0, MARKER, b"\x01", answer=0.2)
        client.write(9.5, BLOCK)
    wire.finish()
    return learner
