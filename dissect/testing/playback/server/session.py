"""A client of the fake PLC, without its socket: takes octets, returns what to send and when."""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

from dissect.engine.transactions.ending import RESET
from dissect.protocols.iso.build import build_dc, build_tpkt, build_tsdu, with_dst_ref
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, Assembler, Tpdu, parse_tpdu
from dissect.protocols.iso.tables import CC, CR, DR, DT
from dissect.protocols.iso.tpkt import HEADER, Framer
from dissect.protocols.s7.build import with_reference
from dissect.protocols.s7.layouts import PDU_REF
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import HEADER_SIZE, PROTOCOL_ID, RESPONSE
from dissect.protocols.s7.tables import ACK, ACK_DATA, JOB, USERDATA
from dissect.protocols.s7plus.assembly import PlusAssembler
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.testing.golden.masking import SEQUENCE
from dissect.testing.playback.bsend import is_bsend, next_piece
from dissect.testing.playback.plus_octets import PROTOCOL_ID as PLUS_ID
from dissect.testing.playback.plus_octets import frames_of, with_sequence
from dissect.testing.playback.server.answers import confirm, farewell, refuse
from dissect.testing.playback.server.faults import CUT, DELAY, DROP, REFUSE, SPLIT, WRONG_REF, Fault
from dissect.testing.playback.server.model import ServerMessage
from dissect.testing.playback.server.player import FakePlc, Reply
from dissect.testing.playback.server.plus import refuse_plus
from dissect.testing.playback.server.plus_player import PlusPlayer
from dissect.testing.playback.server.request_log import RequestLog

#: Maximum number of server messages that wait for their turn; references of the client that stand for recorded ones.
_MAX_WAITING: Final = 1_000
_MAX_REFERENCES: Final = 256
#: Size of a segment if the answer is split into several.
SPLIT_SIZE: Final = 7

# Actions for a client.
SEND: Final = "send"
CLOSE: Final = "close"
ABORT: Final = "abort"


class Action(NamedTuple):
    """An action for a client, ``delay_s`` from now: send octets (in pieces of ``pieces``, 0 for whole), or end the connection.

    ``last``: after everything that is planned for the client, however late that is.
    """

    kind: str
    octets: bytes = b""
    delay_s: float = 0
    pieces: int = 0
    last: bool = False


class ClientSession:
    """One client. ``connected``: it has requested a connection. ``over``: nothing more is accepted from it."""

    def __init__(self, number: int, log: RequestLog) -> None:
        self.number = number
        self.connected = False
        self.over = False
        self._log = log
        self._framer = Framer()
        self._framer.synced = True
        self._assembler = Assembler()
        self._player: FakePlc | None = None
        self._plus: PlusPlayer | None = None
        self._joined = PlusAssembler()
        self._reference = 0  # the client's reference of the transport connection
        self._tpdu_size = 65_531
        self._waiting: deque[ServerMessage] = deque()
        self._asked = 0  # answers that the client has to give before the server continues
        self._jobs: dict[
            bytes, bool
        ] = {}  # references of the server's jobs: whether they were answered in the recording
        self._end_how = ""  # how the server ends the connection after its last message, empty while it does not
        self._references: dict[bytes, bytes] = {}  # those of this client by recorded ones
        self._piece = 0  # the sequence number that this client gave our BSEND
        self._actions: list[Action] = []

    def feed(self, octets: bytes) -> list[Action]:
        """Take octets of the client; return the actions."""
        self._actions = []
        framer = self._framer
        framer.push(octets, 0, True)
        packets, framer.packets = framer.packets, []
        for packet in packets:
            if self.over:
                break
            self._tpdu(packet[HEADER:])
        if (framer.faults or not framer.synced) and not self.over:
            self._log.problems.append(f"connection {self.number} is ended: the client sends data that is not TPKT")
            self._end(ABORT)
        return self._actions

    def _end(self, kind: str, last: bool = False) -> None:
        self.over = True
        self._actions.append(Action(kind, last=last))

    # ---- the connection ---------------------------------------------------------------------------------------------

    def _tpdu(self, octets: bytes) -> None:
        tpdu = parse_tpdu(octets)
        if tpdu.type == CR and self._player is None and self._plus is None:
            self._connect(tpdu)
        elif tpdu.type == DR:
            self._actions.append(Action(SEND, build_tpkt(build_dc(max(tpdu.field("src_ref"), 0), 1))))
            self._end(CLOSE)
        elif tpdu.type == DT and (self._player or self._plus) is not None and not tpdu.malformed:
            tsdu = self._assembler.push(tpdu.data, tpdu.field("eot") == 1)
            if self._assembler.overflows:
                self._log.problems.append(f"connection {self.number} is ended: an endless message")
                self._end(ABORT)
            elif tsdu and self._player is not None:
                self._tsdu(self._player, tsdu)
            elif tsdu and self._plus is not None:
                self._plus_tsdu(self._plus, tsdu)
        else:
            self._log.problems.append(f"connection {self.number} is ended: {tpdu.name} is unexpected")
            self._end(ABORT)

    def _connect(self, request: Tpdu) -> None:
        self.connected = True
        self._reference = max(request.field("src_ref"), 0)
        calling, called = request.parameter(CALLING_TSAP), request.parameter(CALLED_TSAP)
        script = self._log.stage.script_for(calling, called)
        if script.refused:
            if script.confirm:
                self._actions.append(Action(SEND, build_tpkt(with_dst_ref(script.confirm, self._reference))))
            self._end(ABORT if script.end == RESET else CLOSE)
            return
        if script.plus:
            self._plus = PlusPlayer(self._log.stage, script)
        else:
            self._player = FakePlc(self._log.stage, script)
        confirmed = confirm(
            request, script.confirm if script.confirm and parse_tpdu(script.confirm).type == CC else b""
        )
        self._tpdu_size = confirmed.tpdu_size
        self._actions.append(Action(SEND, build_tpkt(confirmed.tpdu)))

    # ---- messages ---------------------------------------------------------------------------------------------------

    def _tsdu(self, player: FakePlc, tsdu: bytes) -> None:
        pdu = parse_pdu(tsdu)
        if len(tsdu) < HEADER_SIZE or tsdu[0] != PROTOCOL_ID or pdu.rosctr not in {JOB, ACK, ACK_DATA, USERDATA}:
            self._log.stranger(self.number, tsdu, "no S7comm")
        elif _answers(pdu) and (tsdu[PDU_REF] in self._jobs or (self._asked > 0 and self._jobs)):
            # Some clients answer with a reference of their own.
            reference = tsdu[PDU_REF] if tsdu[PDU_REF] in self._jobs else next(iter(self._jobs))
            self._piece = tsdu[SEQUENCE] if is_bsend(pdu, RESPONSE) else self._piece
            self._asked -= self._jobs.pop(reference)
            self._follow(0)
        elif pdu.rosctr in {ACK, ACK_DATA}:
            self._log.stranger(self.number, tsdu, f"{pdu.rosctr_name} without a request")
        else:
            self._request(player, pdu)

    def _plus_tsdu(self, player: PlusPlayer, tsdu: bytes) -> None:
        """Take a frame of S7comm-plus; anything else, including TLS, ends the connection."""
        if tsdu[0] != PLUS_ID:
            self._log.stranger(self.number, tsdu, "no S7comm-plus (TLS is not served)")
            self._end(CLOSE, last=True)
            return
        octets = self._joined.push(tsdu)
        if not octets:
            return
        request = parse_plus(octets)
        if not request.readable:
            self._log.stranger(self.number, octets, f"S7comm-plus {request.kind}")
            return
        reply, faults, delay_s = self._log.answer_plus(self.number, player, request)
        by_kind = {fault.kind: fault for fault in faults}
        answer = _spoilt_plus(request, reply, by_kind)
        if not self._say(frames_of(answer) if answer else [], by_kind, delay_s):
            return
        for message in reply.then:
            for frame in frames_of(message.octets):
                self._actions.append(Action(SEND, build_tsdu(frame, self._tpdu_size), delay_s))
        if reply.end:
            self._end_how = reply.end
            self._follow(delay_s)

    def _say(self, messages: list[bytes], by_kind: dict[str, Fault], delay_s: float) -> bool:
        """Send an answer with its faults; return False if the connection is cut instead."""
        if CUT in by_kind:
            self._end(ABORT)
            return False
        if DELAY in by_kind:
            delay_s += by_kind[DELAY].value / 1000
        for message in [] if DROP in by_kind else messages:
            octets = build_tsdu(message, self._tpdu_size)
            self._actions.append(Action(SEND, octets, delay_s, SPLIT_SIZE if SPLIT in by_kind else 0))
        return True

    def _request(self, player: FakePlc, request: Pdu) -> None:
        reply, faults, delay_s = self._log.answer(self.number, player, request)
        by_kind = {fault.kind: fault for fault in faults}
        answer = _spoilt(request, reply, by_kind)
        if not self._say([answer] if answer else [], by_kind, delay_s):
            return
        delay_s += by_kind[DELAY].value / 1000 if DELAY in by_kind else 0
        if reply.then and len(self._waiting) < _MAX_WAITING:
            self._waiting.extend(reply.then)
        self._end_how = reply.end or self._end_how
        self._know(request, player)
        self._follow(delay_s)

    def _know(self, request: Pdu, player: FakePlc) -> None:
        """Store which reference of this client stands for the recorded one, for answers out of turn."""
        recorded = player.reference
        if recorded:
            self._references.pop(recorded, None)
            self._references[recorded] = request.octets[PDU_REF]
            if len(self._references) > _MAX_REFERENCES:
                del self._references[next(iter(self._references))]

    def _follow(self, delay_s: float) -> None:
        """Send the server's own messages until it must wait for the client; after all of them, end the connection."""
        while self._waiting and self._asked <= 0:
            message = self._waiting.popleft()
            self._asked += message.waits
            octets = next_piece(message.octets, self._piece)
            reference = self._references.get(octets[PDU_REF])
            if not _answers(parse_pdu(octets)):
                self._jobs.pop(octets[PDU_REF], None)
                self._jobs[octets[PDU_REF]] = message.answered
                if len(self._jobs) > _MAX_WAITING:
                    del self._jobs[next(iter(self._jobs))]
            elif reference is not None:
                octets = with_reference(octets, reference)
            self._actions.append(Action(SEND, build_tsdu(octets, self._tpdu_size), delay_s))
        if self._end_how and self._asked <= 0 and not self.over:
            player = self._player or self._plus
            said_last = player.script.farewell if player is not None else b""
            said_last = said_last or farewell(self._end_how)
            if said_last:
                self._actions.append(Action(SEND, build_tpkt(with_dst_ref(said_last, self._reference)), last=True))
            self._end(ABORT if self._end_how == RESET else CLOSE, last=True)


def _answers(pdu: Pdu) -> bool:
    """Return whether a message is an answer, which has the reference of its request."""
    head = pdu.parameters.userdata
    return pdu.rosctr in {ACK, ACK_DATA} or (head is not None and head.type == RESPONSE)


def _spoilt(request: Pdu, reply: Reply, faults: dict[str, Fault]) -> bytes:
    """Return the answer with its faults."""
    answer = reply.octets
    if REFUSE in faults:
        answer = refuse(request, int(faults[REFUSE].value))
    if WRONG_REF in faults and answer:
        wrong = (int.from_bytes(answer[PDU_REF], "big") + 1) & 0xFFFF
        answer = with_reference(answer, wrong.to_bytes(2, "big"))
    return answer


def _spoilt_plus(request: PlusPdu, reply: Reply, faults: dict[str, Fault]) -> bytes:
    """Return the answer of S7comm-plus with its faults."""
    answer = refuse_plus(request, int(faults[REFUSE].value)) if REFUSE in faults else reply.octets
    return with_sequence(answer, request.sequence + 1 & 0xFFFF) if WRONG_REF in faults and answer else answer
