"""PDUs of captures sent again, cut into frames, TSDUs and segments anywhere, and all the results for them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.plus import plus_subject
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import KEEP_ALIVE, REQUEST, SET_VAR_SUBSTREAMED, SYSTEM_EVENT, V3
from tests import build
from tests.engine.transactions.talk import ACK, CLIENT, FIN, MS, SERVER, Talk

#: Findings about how bytes are framed, not about what they say.
ABOUT_FRAMING: Final = frozenset(("cotp.empty_dt", "cotp.size_exceeded"))
#: Bytes of data in the longest frame, and of the longest segment.
_MOST: Final = 16_000
_LARGEST: Final = 60_000
_DIGEST: Final = b"\x20" + b"\xa5" * 32


class Sent(NamedTuple):
    """A whole PDU: its connection, the side that sent it, and its frames with trailer, joined."""

    connection: int
    side: int
    octets: bytes


class _Pdus(Observer):
    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.found: list[Sent] = []
        self.clients: dict[int, int] = {}

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        if not cut:
            self.found.append(Sent(side.connection.number, side.index, octets))

    def transaction(self, transaction: Transaction) -> None:
        connection = transaction.connection
        self.clients[connection.number] = connection.client_side


def sent_in(path: Path) -> list[Sent]:
    """Return the whole PDUs of a capture, those of the client with side 0."""
    observer = _Pdus()
    run = Run([str(path)], observer)
    while run.step():
        pass
    run.finish()
    servers = {number for number, side in observer.clients.items() if side == SERVER}
    return [one._replace(side=1 - one.side) if one.connection in servers else one for one in observer.found]


def may_be_cut(octets: bytes) -> bool:
    """Return whether a PDU may go into several frames: one with an opcode, unless each of its frames is a piece of a stream."""
    pdu = parse_plus(octets)
    if pdu.version in {SYSTEM_EVENT, KEEP_ALIVE} or not pdu.whole or pdu.malformed:
        return False
    return not (pdu.opcode == REQUEST and pdu.function == SET_VAR_SUBSTREAMED)


def frames_of(octets: bytes, *places: int, empty: bool = False) -> list[bytes]:
    """Return a PDU in frames, cut at places within its data; the last one has the trailer.

    ``empty``: there are frames without data between them.
    """
    pdu = parse_plus(octets)
    size = len(pdu.data)
    ends = [*sorted({place for place in (*places, *range(_MOST, size, _MOST)) if place <= size}), size]
    begins = [0, *ends[:-1]]
    parts = [pdu.data[begin:end] for begin, end in zip(begins, ends, strict=True)]
    if empty:
        parts = [one for part in parts for one in (b"", part)][1:]
    frames = [_frame(pdu, part) for part in parts]
    frames[-1] += bytes((0x72, pdu.version, 0, 0))
    return frames


def _frame(pdu: PlusPdu, data: bytes) -> bytes:
    content = _DIGEST + data if pdu.version == V3 else data
    return bytes((0x72, pdu.version)) + len(content).to_bytes(2, "big") + content


def tpkts(frames: list[bytes]) -> bytes:
    """Return frames as TPKTs, a TSDU each."""
    return b"".join([build.dt(frame) for frame in frames])


#: Returns the segments of a PDU.
Cutter = Callable[[bytes], list[bytes]]


def uncut(octets: bytes) -> list[bytes]:
    """Return a PDU as it was sent, in one segment."""
    return [tpkts(_as_sent(octets))]


def _as_sent(octets: bytes) -> list[bytes]:
    """Return the frames of a PDU as TSDUs."""
    pdu = parse_plus(octets)
    if pdu.version in {SYSTEM_EVENT, KEEP_ALIVE} or pdu.frames <= 1:
        return [octets]
    begins = [0, *[place - 4 - (33 if pdu.version == V3 else 0) for place in pdu.frame_starts.values()], len(octets)]
    return [octets[begin:end] for begin, end in pairwise(begins)]


def in_frames(place: int, empty: bool = False) -> Cutter:
    """Cut the data of each PDU after ``place`` bytes, or after the remainder of that number in a shorter one."""

    def cut(octets: bytes) -> list[bytes]:
        if not may_be_cut(octets):
            return uncut(octets)
        pdu = parse_plus(octets)
        at = place % (len(pdu.data) + 1)
        return [tpkts(frames_of(octets, at, empty=empty and not _ambiguous(pdu, at)))]

    return cut


def _ambiguous(pdu: PlusPdu, place: int) -> bool:
    """Return whether an empty frame there would be the trailer: before version 3 it looks like one, and this may be an end."""
    rest = pdu.data[place:]
    return pdu.version != V3 and not any(rest) and (not rest or pdu.data[:place].endswith(bytes(3)))


def in_small_frames(size: int) -> Cutter:
    """Cut each PDU into frames of ``size`` bytes of data."""

    def cut(octets: bytes) -> list[bytes]:
        return [tpkts(frames_of(octets, *range(size, len(octets), size)))] if may_be_cut(octets) else uncut(octets)

    return cut


def in_tpdus(place: int, empty: bool = False) -> Cutter:
    """Cut each TSDU into two DTs after ``place`` bytes; ``empty``: with one without data between them."""

    def cut(octets: bytes) -> list[bytes]:
        found = b""
        for tsdu in _as_sent(octets):
            at = place % len(tsdu)
            found += build.dt(tsdu[:at], eot=False) + (build.dt(b"", eot=False) if empty else b"") + build.dt(tsdu[at:])
        return [found]

    return cut


def in_segments(place: int) -> Cutter:
    """Cut the carrier of each PDU into two segments after ``place`` bytes."""

    def cut(octets: bytes) -> list[bytes]:
        whole = b"".join(uncut(octets))
        at = place % len(whole)
        return [whole[:at], whole[at:]] if at else [whole]

    return cut


class Told(Talk):
    """The results for PDUs, without the numbers of packets if a PDU takes several."""

    def __init__(self, port: int, beside: Told | None = None, packets: bool = True) -> None:
        super().__init__(port, beside=beside)
        self.packets = packets
        self.told: list[str] = []

    def transaction(self, transaction: Transaction) -> None:
        one = transaction
        said = [one.function_name, one.outcome, one.error_code, one.has_errors, one._flags, one.pdu_ref]
        frames = one.frames if self.packets else []
        items = [(item.label, item.text, item.return_code, item.note, item.number) for item in one.plus_results]
        errors = [str(error) for error in one.errors]
        self.told.append(f"{said} {frames} {plus_subject(one)} {items} {errors}")

    def finding(self, finding: Finding) -> None:
        if finding.slug not in ABOUT_FRAMING:
            self.told.append(f"{finding.slug} {finding.detail} {finding.frames if self.packets else ''}")

    def operation(self, operation: Operation) -> None:
        one = operation
        frames = (one.first_frame, one.last_frame) if self.packets else ()
        self.told.append(f"{one.kind} {one.subject} {one.result} {one.parts} {one.transactions} {frames}")


def told_of(messages: list[Sent], cut: Cutter, packets: bool = True) -> list[str]:
    """Send PDUs again, each cut, and return the results; ``packets``: each must be one segment."""
    talks: dict[int, Told] = {}
    first: Told | None = None
    for one in messages:
        talk = talks.get(one.connection)
        if talk is None:
            talk = talks[one.connection] = Told(50000 + one.connection, first, packets)
            first = first or talk
            talk.hello()
            talk.connect()
        after_ns = MS
        for segment in cut(one.octets):
            for at in range(0, len(segment), _LARGEST):
                talk.packet(one.side, segment[at : at + _LARGEST], after_ns=after_ns)
                after_ns = 0
    if first is None:
        return []
    for talk in talks.values():
        talk.packet(CLIENT, flags=FIN | ACK)
        talk.packet(SERVER, flags=FIN | ACK)
        talk.packet(CLIENT)
    first.finish()
    plus = next(one for one in first.pipeline.protocols if type(one).__name__ == "S7Plus")
    described = plus.describe()
    return [*first.told, str(described)]
