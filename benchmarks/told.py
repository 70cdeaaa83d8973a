"""The results for the packets of a capture, in numbers of the whole capture: pairs, requests without answer, statements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from benchmarks.blame import CONFLICT, PREFIXES
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.transaction import ANSWERED, UNANSWERED
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from dissect.engine.findings.reporter import Finding
    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.transaction import Transaction

#: This many packets pass between two resets of the limits of findings: fewer than a limit allows for one slug and connection.
_RENEWED: Final = 16


class Packet(NamedTuple):
    """A packet as a reader gives it."""

    time_ns: int
    octets: bytes
    wire_length: int
    link_type: int


class Capture(PacketSink):
    """The packets of a capture, and its TLS keys, each before the packet whose number it has."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name
        self.packets: list[Packet] = []
        self.keys: list[tuple[int, bytes]] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.packets.append(Packet(time_ns, buf[start:end], wire_length, link_type))

    def secrets(self, text: bytes) -> None:
        self.keys.append((len(self.packets), text))


def read(path: Path, name: str) -> Capture:
    """Read a capture file of any kind. Raises `CaptureError` if it is not a capture."""
    capture = Capture(name)
    reader = open_capture(path)
    try:
        while reader.step(capture):
            pass
    finally:
        reader.close()
    return capture


class Key(NamedTuple):
    """Identifies a request: client and server, reference, packet."""

    asking: str
    answering: str
    reference: int
    packet: int


class Pair(NamedTuple):
    """A request and the packet of its answer. ``octets`` are those of both PDUs."""

    request: Key
    answer: int
    certainty: str
    octets: tuple[bytes, bytes]

    @property
    def answered(self) -> Key:
        """The key of the answer: that of the request, with the packet of the answer."""
        return self.request._replace(packet=self.answer)


class Unanswered(NamedTuple):
    """A request without answer. ``missed``: an answer was due. ``certainty`` is that of an answer that was not captured."""

    request: Key
    octets: bytes
    reason: str
    certainty: str
    missed: bool
    function: str


class Statement(NamedTuple):
    """A finding of a connection: of its ends, in any order, and of the packets from ``first`` to ``last``."""

    slug: str
    ends: tuple[str, ...]
    first: int
    last: int
    packets: tuple[int, ...]
    detail: str


class Told(Observer):
    """The results for the packets ``numbers`` of a capture, which are counted from 0 in the whole of it."""

    def __init__(self, capture: Capture, numbers: Sequence[int]) -> None:
        super().__init__()
        self.pairs: list[Pair] = []
        self.unanswered: list[Unanswered] = []
        self._numbers = numbers
        self._findings: list[Finding] = []
        self._connections: dict[int, Connection] = {}
        pipeline = Pipeline(self)
        keys = list(capture.keys)
        for count, number in enumerate(numbers):
            while keys and keys[0][0] <= number:
                pipeline.secrets(keys.pop(0)[1])
            if count % _RENEWED == 0:
                pipeline.exchange.reporter.renew()
            packet = capture.packets[number]
            pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
        pipeline.exchange.reporter.renew()
        pipeline.finish()

    def connection_opened(self, connection: Connection) -> None:
        self._connections[int(connection.number)] = connection

    def finding(self, finding: Finding) -> None:
        if finding.slug.startswith(PREFIXES) or finding.slug == CONFLICT:
            self._findings.append(finding)

    def transaction(self, transaction: Transaction) -> None:
        if transaction._outcome not in {ANSWERED, UNANSWERED}:
            return
        ends = transaction.connection.tcp.ends
        asked_by = transaction.asked_by
        asked = self._number(transaction.request_frame)
        key = Key(str(ends[asked_by]), str(ends[1 - asked_by]), int(transaction.pdu_ref), asked)
        if transaction._outcome == ANSWERED:
            octets = (transaction.request_octets, transaction.response_octets)
            self.pairs.append(Pair(key, self._number(transaction.response_frame), transaction.certainty, octets))
        else:
            missed = transaction.missed and not transaction.unseen
            request, reason, function = transaction.request_octets, transaction.reason, transaction.function_name
            self.unanswered.append(Unanswered(key, request, reason, transaction.certainty, missed, function))

    @property
    def statements(self) -> list[Statement]:
        """The findings of the kinds that may blame, including those that do not, and conflicts."""
        return [self._statement(finding) for finding in self._findings]

    def _number(self, frame: int) -> int:
        return self._numbers[int(frame) - 1]

    def _statement(self, finding: Finding) -> Statement:
        packets = tuple([self._number(frame) for frame in finding.frames])
        connection = self._connections.get(int(finding.connection))
        if connection is None:  # of the capture as a whole
            return Statement(finding.slug, (), 0, self._numbers[-1], packets, finding.detail)
        tcp = connection.tcp
        ends = tuple(sorted([str(end) for end in tcp.ends]))
        first, last = self._number(tcp.first_frame), self._number(tcp.last_frame)
        return Statement(finding.slug, ends, first, last, packets, finding.detail)
