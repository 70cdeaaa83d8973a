"""Two ends that talk to each other, packet by packet, into the pipeline: the messages of a test are what was captured.

    talk = Talk()
    talk.open()
    talk.ask(read(1, item(0x84, 10, 4 * 8, 4)))
    talk.tell(ack_data(1, b"\\x04\\x01", good(4, b"\\x00\\x2a")))
    talk.close()

The client is side 0 and sends requests by `ask`, the server is side 1 and answers by `tell`; either may do both.
"""

from __future__ import annotations

import struct
from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.exchange import PayloadDecoder
from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Observer, Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.tls.key_log import KeyLog
from tests import build

CLIENT: Final = 0
SERVER: Final = 1

FIN: Final = 1
SYN: Final = 2
RST: Final = 4
ACK: Final = 16

MS: Final = 1_000_000
SECOND: Final = 1_000_000_000
START_NS: Final = 1_600_000_000 * SECOND

MASK: Final = 0xFFFFFFFF


# ---- octets ---------------------------------------------------------------------------------------------------------


def job(pdu_ref: int, parameters: bytes, data: bytes = b"") -> bytes:
    return build.pdu(build.JOB, pdu_ref, parameters, data)


def ack(pdu_ref: int, code: int, parameters: bytes = b"") -> bytes:
    return build.pdu(build.ACK, pdu_ref, parameters, error=code)


def ack_data(pdu_ref: int, parameters: bytes, data: bytes = b"", code: int = 0) -> bytes:
    return build.pdu(build.ACK_DATA, pdu_ref, parameters, data, code)


def userdata(pdu_ref: int, parameters: bytes, data: bytes = build.payload(b"")) -> bytes:
    return build.pdu(build.USERDATA, pdu_ref, parameters, data)


def head(type_: int, group: int, subfunction: int, sequence: int = 0, code: int | None = None) -> bytes:
    """A userdata parameter head: short, or extended when an error code is given."""
    unit = None if code is None else 0
    return build.userdata_head(type_, group, subfunction, sequence, unit, error=code or 0)


def item(area: int, db: int, address: int, size: int, count: int = 1) -> bytes:
    return build.any_item(size, count, db, area, address)


def dbw(db: int, octet: int, count: int = 1) -> bytes:
    """An item of words in a data block."""
    return item(0x84, db, octet * 8, 4, count)


def read(pdu_ref: int, *items: bytes) -> bytes:
    return job(pdu_ref, bytes((4, len(items))) + b"".join(items))


def write(pdu_ref: int, items: list[bytes], data: bytes) -> bytes:
    return job(pdu_ref, bytes((5, len(items))) + b"".join(items), data)


def good(size: int, octets: bytes) -> bytes:
    """A data item of a read answer: success."""
    return build.data_item(0xFF, size, octets)


def written(size: int, octets: bytes) -> bytes:
    """A data item of a write request."""
    return build.data_item(0, size, octets)


refused = build.refused_item


def words(pdu_ref: int, *values: int) -> bytes:
    """A read answer of one item of words."""
    return ack_data(pdu_ref, b"\x04\x01", good(4, struct.pack(f">{len(values)}H", *values)))


def setup(pdu_ref: int, calling: int = 1, called: int = 1, size: int = 480) -> bytes:
    return job(pdu_ref, build.setup_block(calling, called, size))


def granted(pdu_ref: int, calling: int = 1, called: int = 1, size: int = 240) -> bytes:
    return ack_data(pdu_ref, build.setup_block(calling, called, size))


def dt(*pdus: bytes) -> bytes:
    """TPKTs, each with a data TPDU around one PDU."""
    return b"".join([build.dt(pdu) for pdu in pdus])


tpkt = build.tpkt

CONNECT: Final = tpkt(bytes.fromhex("11e00000000100c1020100c2020102c0010a"))
CONFIRM: Final = tpkt(bytes.fromhex("11d00001000200c1020100c2020102c0010a"))


# ---- packets --------------------------------------------------------------------------------------------------------


class Talk(Observer):
    """Two ends; all results of the pipeline are collected."""

    def __init__(
        self,
        client_port: int = 50000,
        server_port: int = 102,
        beside: Talk | None = None,
        slow_ns: int = SECOND,
        strict: bool = True,
    ) -> None:
        super().__init__()
        self.transactions: list[Transaction] = []
        self.findings: list[Finding] = []
        self.connections: list[Connection] = []
        self.operations: list[Operation] = []
        self.acts: list[Act] = []
        self.messages: list[ScdMessage] = []
        self.now_ns = START_NS
        #: The observer and the clock to use: another talk may be captured in the same run.
        self.first = self if beside is None else beside
        self.pipeline: Pipeline = Pipeline(self, Options(slow_ns, strict)) if beside is None else beside.pipeline
        self.ports = [client_port, server_port]
        self.hosts = [1, 2]
        self.macs = [bytes(6), bytes(6)]
        self.vlan = 0
        self.seq = [1000, 90000]
        #: The acknowledgement of each end; None is the normal case: everything that the other end sent.
        self.acked: list[int | None] = [None, None]
        self.sums = False

    def carry(self, carrier: PayloadDecoder) -> None:
        """Begin again, with a carrier that looks for another protocol in the payloads."""
        self.pipeline = Pipeline(self, Options(strict=True, decoder=carrier))

    def unlock(self, key_log: bytes) -> KeyLog:
        """Begin again, with the TLS keys of a key log, which may be extended."""
        keys = KeyLog()
        keys.add(key_log)
        self.pipeline = Pipeline(self, Options(strict=True, tls_keys=keys))
        return keys

    def watch(self, overdue_ns: int = 2 * SECOND) -> None:
        """Begin again, in live mode: requests that wait longer than this are reported."""
        self.pipeline = Pipeline(self, Options(strict=True, overdue_ns=overdue_ns))

    def verify(self) -> None:
        """Begin again, and leave out packets with a wrong checksum; those of `packet` are right from here on."""
        self.pipeline = Pipeline(self, Options(strict=True, checksums=True))
        self.sums = True

    # The results of the pipeline.

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        self.messages.append(found)

    def transaction(self, transaction: Transaction) -> None:
        self.transactions.append(transaction)

    def finding(self, finding: Finding) -> None:
        self.findings.append(finding)

    def operation(self, operation: Operation) -> None:
        self.operations.append(operation)

    def act(self, act: Act) -> None:
        self.acts.append(act)

    def connection_closed(self, connection: Connection) -> None:
        self.connections.append(connection)

    # The actions of the ends.

    def packet(
        self,
        side: int,
        payload: bytes = b"",
        flags: int = ACK,
        seq: int | None = None,
        after_ns: int = MS,
        cut: int = 0,
    ) -> int:
        """Capture one packet of ``side`` and return its number; a ``seq`` makes it come out of order."""
        self.first.now_ns += after_ns
        acked = self.acked[side]
        acknowledged = self.seq[1 - side] if acked is None else acked
        if not flags & ACK:
            acknowledged = 0
        tcp = struct.pack(
            ">HHIIBBHHH",
            self.ports[side],
            self.ports[1 - side],
            (self.seq[side] if seq is None else seq) & MASK,
            acknowledged & MASK,
            0x50,
            flags,
            8192,
            0,
            0,
        )
        addresses = bytes((10, 0, 0, self.hosts[side], 10, 0, 0, self.hosts[1 - side]))
        if self.sums:
            words = addresses + struct.pack(">HH", 6, len(tcp) + len(payload)) + tcp + payload + bytes(len(payload) % 2)
            right = -sum([word for (word,) in struct.iter_unpack(">H", words)]) % 0xFFFF
            tcp = tcp[:16] + right.to_bytes(2, "big") + tcp[18:]
        ip = struct.pack(">BBHHHBBH", 0x45, 0, 40 + len(payload), 0, 0, 64, 6, 0) + addresses
        tag = struct.pack(">HH", 0x8100, self.vlan) if self.vlan else b""
        frame = self.macs[1 - side] + self.macs[side] + tag + b"\x08\x00" + ip + tcp + payload
        self.pipeline.frame(self.first.now_ns, frame, 0, len(frame) - cut, len(frame), 1)
        if seq is None:
            self.seq[side] += len(payload) + (1 if flags & (SYN | FIN) else 0)
        return int(self.pipeline.frames)

    def raw(self, frame: bytes, after_ns: int = MS) -> int:
        """Capture an Ethernet frame as it is, and return its number."""
        self.first.now_ns += after_ns
        self.pipeline.frame(self.first.now_ns, frame, 0, len(frame), len(frame), 1)
        return int(self.pipeline.frames)

    def datagram(self, side: int, payload: bytes, ports: tuple[int, int] = (49200, 5600), cut: int = 0) -> int:
        """Capture a UDP datagram of ``side`` and return its number; ``ports`` are those of client and server."""
        udp = struct.pack(">HHHH", ports[side], ports[1 - side], 8 + len(payload), 0) + payload
        addresses = bytes((10, 0, 0, self.hosts[side], 10, 0, 0, self.hosts[1 - side]))
        ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + addresses
        frame = bytes(12) + b"\x08\x00" + ip + udp
        self.first.now_ns += MS
        self.pipeline.frame(self.first.now_ns, frame, 0, len(frame) - cut, len(frame), 1)
        return int(self.pipeline.frames)

    def hello(self) -> None:
        """The TCP handshake."""
        self.packet(CLIENT, flags=SYN)
        self.packet(SERVER, flags=SYN | ACK)
        self.packet(CLIENT)

    def connect(self) -> None:
        """The COTP handshake."""
        self.packet(CLIENT, CONNECT)
        self.packet(SERVER, CONFIRM)

    def open(self, calling: int = 1, called: int = 1, size: int = 480) -> None:
        """Everything up to the setup, which is granted as requested; forgets the results so far."""
        self.hello()
        self.connect()
        self.ask(setup(0, calling, called, size))
        self.tell(granted(0, calling, called, size))
        self.first.transactions.clear()

    def ask(self, *pdus: bytes, after_ns: int = MS) -> int:
        """The client sends PDUs in one segment."""
        return self.packet(CLIENT, dt(*pdus), after_ns=after_ns)

    def flood(self, count: int) -> None:
        """The client sends ``count`` requests without waiting for an answer, each with the next reference."""
        for number in range(0, count, 200):
            self.ask(*(read(more & 0xFFFF, dbw(1, more & 0xFF)) for more in range(number, min(count, number + 200))))

    def tell(self, *pdus: bytes, after_ns: int = MS) -> int:
        """The server sends PDUs in one segment."""
        return self.packet(SERVER, dt(*pdus), after_ns=after_ns)

    def lose(self, side: int, *pdus: bytes) -> None:
        """PDUs that were sent but not captured."""
        self.seq[side] += len(dt(*pdus))

    def wait(self, duration_ns: int) -> None:
        """Let time pass."""
        self.first.now_ns += duration_ns

    def silence(self, duration_ns: int) -> None:
        """Let time pass on a silent line, and tell the pipeline."""
        self.wait(duration_ns)
        self.pipeline.tick(self.first.now_ns)

    def close(self) -> None:
        """Both ends close the TCP connection, and the capture ends."""
        self.packet(CLIENT, flags=FIN | ACK)
        self.packet(SERVER, flags=FIN | ACK)
        self.packet(CLIENT)
        self.pipeline.finish()

    def finish(self) -> None:
        """The capture ends."""
        self.pipeline.finish()

    # Results.

    def slugs(self) -> list[str]:
        return [finding.slug for finding in self.findings]

    def outcomes(self) -> list[str]:
        return [transaction.outcome for transaction in self.transactions]

    def pairs(self) -> list[tuple[int, int]]:
        """(frame of the request, frame of the answer) of every transaction, 0 for a missing half, in order of emission."""
        return [(transaction.request_frame, transaction.response_frame) for transaction in self.transactions]
