"""A capture as a server and as a client: its answers to its own client, and what a replay would send."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.side import Side
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.tpkt import Framer
from dissect.protocols.s7.tables import READ
from dissect.testing.golden.model import Session
from dissect.testing.golden.reading import SessionReader
from dissect.testing.playback.client.permissions import Permissions, kind_of
from dissect.testing.playback.client.plan import ASK, make_plan, plan_lines, playable
from dissect.testing.playback.server.model import Recording
from dissect.testing.playback.server.player import Stage
from dissect.testing.playback.server.request_log import RequestLog
from dissect.testing.playback.server.session import ClientSession
from tests.fuzz.checks import check_line, check_lines
from tests.properties.messages import connect, dt

#: Jobs that change nothing, and types of userdata that are requests: repeated here, so that a change there is noticed.
_READS: Final = frozenset((0xF0, 0x04, 0x1D, 0x1E, 0x1F))


_LONGEST: Final = 60_000


class ServedReader(SessionReader):
    """Also keeps what the clients sent: the TPKTs of each."""

    def __init__(self, name: str) -> None:
        super().__init__(name, messages=True)
        self.sent: dict[bytes, list[bytes]] = {}

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        super().tpdu(frame, time_ns, side, octets)
        self.sent.setdefault(side.key, []).append(octets)


def check_served(recording: Recording, streams: list[list[bytes]], garbage: bytes) -> None:
    """Send the recorded requests to a server made from the recording, then all messages of either end, and finally garbage."""
    asked = [
        [connect(), *[dt(step.request) for step in script.steps if 0 < len(step.request) < _LONGEST]]
        for script in recording.scripts
    ]
    for memory in (False, True):
        log = RequestLog(Stage(recording, memory=memory))
        for number, packets in enumerate([*asked, *streams], 1):
            peer = ClientSession(number, log)
            said = Framer()
            said.synced = True
            for octets in [*packets, garbage]:
                for deed in peer.feed(octets):
                    said.push(deed.octets, 0, True)
                if peer.over:
                    break
            assert not said.faults
            assert not said.buffered
            assert said.synced
        for request in log.requests:
            check_line(request.how)
            assert request.how


def check_replayed(session: Session) -> None:
    """A replay that may only read sends nothing else, and reports its actions."""
    plan = make_plan(session)
    for permissions in (Permissions(), Permissions(True, True)):
        check_lines(plan_lines(plan, permissions))
    for part in playable(plan):
        for octets in (part.connect_request(1), part.disconnect_request(1, 2)):
            tpdu = parse_tpdu(octets)
            assert not tpdu.malformed, str(tpdu.malformed[0])
            assert not tpdu.data
        for step in part.steps:
            if step.kind == ASK and not Permissions().refusal(step.transaction.request):
                check_harmless(step.transaction.request)


def check_harmless(pdu: bytes) -> None:
    """A PDU that counts as reading: whole, and a job or a request of userdata that changes nothing."""
    assert kind_of(pdu) == READ
    parameters, data = int.from_bytes(pdu[6:8], "big"), int.from_bytes(pdu[8:10], "big")
    assert len(pdu) == 10 + parameters + data
    assert (pdu[0], pdu[1]) in {(0x32, 1), (0x32, 7)}
    assert pdu[10] in _READS if pdu[1] == 1 else pdu[15] >> 4 == 4
