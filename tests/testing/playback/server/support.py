"""Shared by the tests of the fake PLC: a client of plain octets, and recorded connections to be played again."""

from __future__ import annotations

import contextlib
import socket
import struct
from collections import Counter
from pathlib import Path
from typing import Final, Self

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.ending import RESET
from dissect.engine.transactions.side import Side
from dissect.files.session import Run
from dissect.protocols.iso.cotp import Assembler, parse_tpdu
from dissect.protocols.iso.tables import DT
from dissect.protocols.iso.tpkt import HEADER, Framer
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import RESPONSE
from dissect.protocols.s7.tables import ACK, ACK_DATA, USERDATA
from dissect.testing.playback.server import Recording, Server
from dissect.testing.talk import Ask, Talk, done, items, read, refused, setup, szl, words, write
from dissect.testing.talk import data as answered

PATIENCE_S: Final = 60.0
CONNECT: Final = bytes.fromhex("0300001611e00000000100c0010ac1020100c2020102")


def dt(pdu: bytes) -> bytes:
    return struct.pack(">BBHBBB", 3, 0, len(pdu) + 7, 2, 0xF0, 0x80) + pdu


def small() -> Recording:
    """A recording of a few requests: a value that counts, two items, a write, a list."""
    talk = Talk()
    for number in (1, 2, 3):
        talk >> read("DB10.DBW4") << words(number)
    talk >> read("DB10.DBW6", "MW2", "DB99.DBW0") << items(words(6), words(7), refused())
    talk >> write("DB10.DBW8 = 5") << done()
    talk >> szl(0x11) << answered(b"\x00\x11\x00\x00\x00\x00\x00\x00")
    talk.close()
    return talk.recording()


class Plain:
    """A client that sends what the test gives, and returns TPKTs as they come."""

    def __init__(self, server: Server, connect: bytes = CONNECT) -> None:
        self.socket = socket.create_connection((server.host, server.port), PATIENCE_S)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._held = b""
        self._reference = 0x0100
        if connect:
            self.socket.sendall(connect)
            self.confirm = self.tpkt()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def tpkt(self) -> bytes:
        """Return the next TPKT, or the remaining octets at the end of the connection."""
        while len(self._held) < 4 or len(self._held) < int.from_bytes(self._held[2:4], "big"):
            octets = self.socket.recv(65536)
            if not octets:
                held, self._held = self._held, b""
                return held
            self._held += octets
        size = int.from_bytes(self._held[2:4], "big")
        packet, self._held = self._held[:size], self._held[size:]
        return packet

    def pdu(self) -> Pdu:
        return parse_pdu(self.tpkt()[7:])

    def send(self, ask: Ask, reference: int | None = None) -> int:
        """Send a request; return its reference."""
        pdu = self._numbered(ask, reference)
        self.socket.sendall(dt(pdu))
        return self._reference if reference is None else reference

    def send_together(self, *asks: Ask) -> list[int]:
        """Send requests in one segment, so that all arrive together; return their references."""
        self.socket.sendall(b"".join([dt(self._numbered(ask)) for ask in asks]))
        return list(range(self._reference - len(asks) + 1, self._reference + 1))

    def _numbered(self, ask: Ask, reference: int | None = None) -> bytes:
        if reference is None:
            self._reference += 1
            reference = self._reference
        return ask.octets[:4] + reference.to_bytes(2, "big") + ask.octets[6:]

    def ask(self, ask: Ask) -> Pdu:
        """Send a request and return its answer, which has its reference."""
        reference = self.send(ask)
        answer = self.pdu()
        assert answer.pdu_ref == reference
        return answer

    def set_up(self, size: int = 480) -> Pdu:
        return self.ask(setup(size))

    def words(self, *addresses: str) -> list[int | str]:
        """Read words; a refused one is its return code as text."""
        told = self.ask(read(*addresses))
        return [
            int.from_bytes(item.data, "big") if item.return_code == 0xFF else f"0x{item.return_code:02x}"
            for item in told.data_items()
        ]

    def silent(self, for_s: float = 0.2) -> bool:
        """Return whether nothing comes for a while."""
        self.socket.settimeout(for_s)
        try:
            return not self.socket.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(PATIENCE_S)

    def ended(self) -> str:
        """Wait for the end of the connection: ``fin`` or ``reset``."""
        try:
            while self.socket.recv(65536):
                pass
        except ConnectionError:
            return "reset"
        return "fin"


class Tpkts(Observer):
    """Every TPKT of a capture by connection: whether the client sent it, and the octets."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.wants_tpdus = True
        self._seen: dict[int, list[tuple[Side, bytes]]] = {}
        run = Run([str(path)], self, Options())
        while run.step():
            pass

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self._seen.setdefault(int(side.connection.number), []).append((side, octets))

    @property
    def connections(self) -> list[list[tuple[bool, bytes]]]:
        return [
            [(side.connection.role(side.index) == "client", octets) for side, octets in seen]
            for _, seen in sorted(self._seen.items())
        ]


Packets = list[tuple[bool, bytes]]


def messages(octets: bytes) -> list[bytes]:
    """Return the TSDUs of a side, independent of the division into TPDUs."""
    framer, assembler = Framer(), Assembler()
    framer.synced = True
    framer.push(octets, 0, True)
    found = []
    for packet in framer.packets:
        tpdu = parse_tpdu(packet[HEADER:])
        if tpdu.type == DT and not tpdu.malformed:
            found.append(assembler.push(tpdu.data, tpdu.field("eot") == 1))
    return [tsdu for tsdu in found if tsdu]


def _about(octets: bytes) -> tuple[bytes, bool]:
    """Return the request to which a TPKT belongs, empty for none, and whether it answers it."""
    pdu = parse_pdu(octets[7:])
    if octets[5] >> 4 != DT or octets[7:8] != b"\x32" or len(pdu.octets) < 10:
        return b"", False
    head = pdu.parameters.userdata
    answers = pdu.rosctr in {ACK, ACK_DATA} or (head is not None and head.type == RESPONSE)
    return pdu.octets[4:6] + (pdu.function_name.encode() if pdu.rosctr == USERDATA else b""), answers


def play(server: Server, packets: Packets, whole: bool = False, lost: bool = False) -> tuple[bytes, bytes]:
    """Send the client's messages, each after the server's messages so far: return the recorded and the received ones.

    A request that the capture shows after its answer is sent before it. A recording that begins in the middle gets a connection
    first; its first answer, to an uncaptured request, is left out, and with ``lost`` all such answers are. With ``whole`` it
    waits for the messages, in whatever TPDUs they come. A reset that was not recorded is raised.
    """
    begun = packets[0][1][5] >> 4 == 0xE
    ahead = [octets for of_client, octets in packets if of_client]
    later = Counter([_about(octets)[0] for octets in ahead])
    asked: Counter[bytes] = Counter()
    told: Counter[bytes] = Counter()
    due = sent = 0
    wanted = got = b""
    with Plain(server, b"" if begun else CONNECT) as client:
        for of_client, octets in packets:
            about, answers = _about(octets)
            due += of_client
            told[about] += answers
            while sent < due or (answers and later[about] and asked[about] < told[about]):
                request = _about(ahead[sent])[0]
                asked[request] += 1
                later[request] -= 1
                client.socket.sendall(ahead[sent])
                sent += 1
            if of_client or not (begun or sent) or (lost and answers and not asked[about]):
                continue
            wanted += octets
            while len(messages(got)) < len(messages(wanted)) if whole else len(got) < len(wanted):
                piece = client.socket.recv(65536)
                if not piece:
                    return wanted, got
                got += piece
        with contextlib.suppress(OSError):
            client.socket.shutdown(socket.SHUT_WR)  # the server processes everything that was sent before its own end
        try:
            while client.socket.recv(65536):
                pass
        except ConnectionResetError:
            if not any(script.end == RESET for script in server.recording.scripts):
                raise
    return wanted, got
