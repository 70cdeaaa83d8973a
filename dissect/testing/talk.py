"""Write a conversation; get octets, a capture, a golden session, or a recording to serve.

    from dissect.testing.talk import Talk, read, values, words, write, done

    talk = Talk()
    talk >> read("DB10.DBW4") << words(1234)
    talk >> write("DB10.DBD8 REAL = 2.5") << done()
    talk.capture("pump.pcapng")

``>>`` is the client, ``<<`` the server. The conversation begins with the connection and the setup, and sets references. An
answer belongs to the oldest open request of the other side; a request without an answer stays open. The messages are those of
`dissect.testing.messages`, which can all be imported from here.
"""

from __future__ import annotations

import os
from collections import deque
from ipaddress import ip_address
from typing import Final, Self

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.online.proxy.packets import Conversation
from dissect.packets.source.pcapng_writer import interface_block, packet_block, section_block
from dissect.packets.tcp.link import ETHERNET
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.iso.build import build_connect, build_tpkt, build_tsdu, size_parameter
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP
from dissect.protocols.iso.tables import CC, CR
from dissect.protocols.s7.build import with_reference
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import PUSH
from dissect.testing.golden.model import Session
from dissect.testing.golden.reading import SessionReader
from dissect.testing.golden.writing import golden_text
from dissect.testing.messages import (
    Ask,
    Piece,
    Tell,
    answer,
    data,
    dints,
    done,
    done_item,
    dwords,
    error,
    granted,
    ints,
    items,
    job,
    octets,
    pdu,
    push,
    read,
    reals,
    refused,
    setup,
    szl,
    userdata,
    values,
    words,
    write,
)
from dissect.testing.playback.server.model import Recording
from dissect.testing.playback.server.recording import recording_of
from dissect.wire.config.saving import save

CLIENT: Final = 0
SERVER: Final = 1

#: Default beginning of a conversation: 2026-01-01 00:00 UTC.
START_NS: Final = 1_767_225_600_000_000_000
_MS: Final = 1_000_000
_TPDU_OCTETS: Final = 1024

_OPEN: Final = "open"
_SENT: Final = "sent"
_CLOSED: Final = "closed"
_RESET: Final = "reset"


class _Event:
    """An event on the connection, and its time."""

    __slots__ = ("kind", "octets", "side", "time_ns")

    def __init__(self, kind: str, side: int, time_ns: int, octets: bytes = b"") -> None:
        self.kind = kind
        self.side = side
        self.time_ns = time_ns
        self.octets = octets


class Talk:
    """A connection between a client and a server.

    ``calling`` and ``called`` are the TSAPs; ``pdu`` is the requested and negotiated PDU length, ``amq`` the number of parallel
    jobs in each direction. With ``begin=False`` the conversation begins without connection and setup. Each message takes 1 ms;
    `wait` delays the next one.
    """

    def __init__(
        self,
        calling: bytes = b"\x01\x00",
        called: bytes = b"\x01\x02",
        pdu: int = 480,
        amq: tuple[int, int] = (1, 1),
        client: tuple[str, int] = ("192.0.2.10", 49152),
        server: tuple[str, int] = ("192.0.2.20", 102),
        start_ns: int = START_NS,
        begin: bool = True,
    ) -> None:
        self._ends = tuple([Endpoint(ip_address(host).packed, port) for host, port in (client, server)])
        self._now_ns = start_ns
        self._events: list[_Event] = []
        self._references = [0, 0]
        self._open: tuple[deque[bytes], deque[bytes]] = (deque(), deque())
        self._over = False
        self._event(_OPEN, CLIENT)
        if begin:
            for type_, side, references in ((CR, CLIENT, (0, 1)), (CC, SERVER, (1, 1))):
                parameters = [size_parameter(_TPDU_OCTETS), (CALLING_TSAP, calling), (CALLED_TSAP, called)]
                self._event(_SENT, side, build_tpkt(build_connect(type_, *references, parameters)))
            self._say(CLIENT, setup(pdu, *amq))
            self._say(SERVER, granted(pdu, *amq))

    # ---- speaking ---------------------------------------------------------------------------------------------------

    def __rshift__(self, message: Ask | Tell) -> Self:
        """Let the client send a request or an answer."""
        self._say(CLIENT, message)
        return self

    def __lshift__(self, message: Ask | Tell) -> Self:
        """Let the server send an answer or a request."""
        self._say(SERVER, message)
        return self

    def _say(self, side: int, message: Ask | Tell) -> None:
        if isinstance(message, Ask):
            head = parse_pdu(message.octets).parameters.userdata
            reference = b"\0\0"
            if head is None or head.type != PUSH:
                self._references[side] = self._references[side] % 0xFFFF + 1
                reference = self._references[side].to_bytes(2, "big")
            pdu = with_reference(message.octets, reference)
            if head is None or head.type != PUSH:
                self._open[side].append(pdu)
        else:
            waiting = self._open[1 - side]
            if not waiting:
                who = "server" if side == SERVER else "client"
                raise ValueError(f"the {who} answers, but no request to it is pending")
            request = waiting[0]
            pdu = with_reference(message.build(parse_pdu(request)), request[4:6])
            waiting.popleft()
        self._event(_SENT, side, build_tsdu(pdu, _TPDU_OCTETS))

    def raw(self, side: int, octets: bytes) -> Self:
        """Send octets from ``side`` (`CLIENT` or `SERVER`) unchanged, with TPKT."""
        self._event(_SENT, side, octets)
        return self

    def wait(self, ms: float) -> Self:
        """Let time pass before the next message."""
        self._now_ns += int(ms * _MS)
        return self

    def unanswered(self) -> Self:
        """Leave the oldest open request of the client unanswered. Raises ValueError if none is open."""
        if not self._open[CLIENT]:
            raise ValueError("the client has no pending request")
        self._open[CLIENT].popleft()
        return self

    def close(self, side: int = CLIENT) -> Self:
        """Close the connection, ``side`` first; it ends the conversation."""
        self._event(_CLOSED, side)
        self._event(_CLOSED, 1 - side)
        self._over = True
        return self

    def reset(self, side: int = SERVER) -> Self:
        """Let ``side`` reset the connection; it ends the conversation."""
        self._event(_RESET, side)
        self._over = True
        return self

    def _event(self, kind: str, side: int, octets: bytes = b"") -> None:
        if self._over:
            raise ValueError("the connection is over")
        self._events.append(_Event(kind, side, self._now_ns, octets))
        self._now_ns += _MS

    # ---- results ----------------------------------------------------------------------------------------------------

    @property
    def octets(self) -> list[tuple[int, bytes]]:
        """The sent messages in order: the side and the octets of the stream (TPKTs)."""
        return [(event.side, event.octets) for event in self._events if event.kind == _SENT]

    def frames(self) -> list[tuple[int, bytes]]:
        """Return the conversation as Ethernet frames, each with its time in nanoseconds since 1970."""
        talk = Conversation(self._ends[CLIENT], self._ends[SERVER])
        timed: list[tuple[int, bytes]] = []
        for event in self._events:
            if event.kind == _OPEN:
                frames = talk.opened()
            elif event.kind == _SENT:
                frames = talk.sent(event.side, event.octets)
            else:
                frames = talk.closed(event.side) if event.kind == _CLOSED else talk.reset(event.side)
            timed += [(event.time_ns, frame) for frame in frames]
        return timed

    def capture(self, path: str | os.PathLike[str] | None = None) -> bytes:
        """Return the conversation as the octets of a pcapng file; with ``path``, also write it, replacing an existing file."""
        blocks = [section_block(application="s7dissect talk"), interface_block(ETHERNET, "talk")]
        blocks += [packet_block(0, time_ns, frame, len(frame)) for time_ns, frame in self.frames()]
        octets = b"".join(blocks)
        if path is not None:
            save(path, octets)
        return octets

    def session(self) -> Session:
        """Return the conversation as a session, which can be compared with a capture or a golden (`dissect.testing.golden`)."""
        reader = SessionReader("talk")
        self._feed(reader)
        return reader.finish()

    def golden(self) -> str:
        """Return the conversation as a golden."""
        return golden_text(self.session())

    def recording(self) -> Recording:
        """Return the conversation as a recording for `dissect.testing.playback.server.Server`."""
        reader = SessionReader("talk", messages=True)
        self._feed(reader)
        return recording_of(reader.finish())

    def _feed(self, observer: Observer) -> None:
        pipeline = Pipeline(observer, Options(strict=True))
        for time_ns, frame in self.frames():
            pipeline.frame(time_ns, frame, 0, len(frame), len(frame), ETHERNET)
        pipeline.finish()


__all__ = [
    "CLIENT",
    "SERVER",
    "START_NS",
    "Ask",
    "Piece",
    "Talk",
    "Tell",
    "answer",
    "data",
    "dints",
    "done",
    "done_item",
    "dwords",
    "error",
    "granted",
    "ints",
    "items",
    "job",
    "octets",
    "pdu",
    "push",
    "read",
    "reals",
    "refused",
    "setup",
    "szl",
    "userdata",
    "values",
    "words",
    "write",
]
