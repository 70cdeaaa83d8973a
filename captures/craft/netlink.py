"""S7 through an IBH-NetLink gateway. No recording of one could be had: these packets are what docs/ibh.md says they are."""

from __future__ import annotations

from typing import Any

from scapy.packet import Packet as Layer

from captures.craft.case import Case, crafts
from captures.craft.pdus import READ, SETUP, WRITE, pattern, read_bytes, setup, values, write, written
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.layers import IBH, MPI, MPI_Long

PORT = 1099
WHY = "Wireshark has no dissector for IBH-NetLink, it shows data"
GO_AHEAD, DISCONNECT, ACK, CONFIRM, CONNECT, MORE, DATA = 0x05, 0x80, 0xB0, 0xD0, 0xE0, 0xF0, 0xF1
CONNECTION = 0x97
PARAMETERS = bytes.fromhex("00800002000201000100")


class NetLink:
    """One client, one gateway, one station: the counters of both headers, and all the packets an exchange of PDUs takes."""

    def __init__(self, case: Case, client_port: int = 49152, port: int = PORT, station: int = 2, own: int = 20) -> None:
        self.case = case
        self.talk = Talk(case, client_port=client_port, port=port)
        self.ids: dict[str, Any] = {"src_conn": own, "dst_conn": 0, "mpi": station}
        self.packet = 1
        self.numbers = [1, 1]

    def header(self, side: int, **fields: Any) -> Layer:
        """The first header: a client counts its packets, the gateway does not."""
        if side == SERVER:
            return IBH(channel1=0xFF, channel2=0x07, number=0, **fields)
        self.packet += 1
        return IBH(number=self.packet - 1, **fields)

    def mpi(self, side: int, function: int, octets: bytes = b"", number: int | None = None) -> bytes:
        """A packet with an MPI header, the short one to the gateway and the long one from it."""
        kind = MPI if side == CLIENT else MPI_Long
        return bytes(self.header(side) / kind(function=function, number=number, **self.ids) / octets)

    def receipt(self) -> bytes:
        """The gateway's receipt for a packet that it took."""
        ids = bytes((self.ids["src_conn"], 0, self.ids["mpi"], 1, 9))
        return bytes(IBH(channel1=0xFF, channel2=0x07, number=self.packet - 1, s_flags=0x82, r_flags=0) / ids)

    def data(self, side: int, pdu: bytes, function: int = DATA) -> bytes:
        """A data packet, numbered by its sender."""
        self.numbers[side] += 1
        return self.mpi(side, function, pdu, self.numbers[side] - 1)

    def ack(self, side: int) -> bytes:
        """The acknowledgement of the latest data packet of the other side."""
        return self.mpi(side, ACK, bytes((self.numbers[1 - side] - 1,)), 1)

    def connect(self) -> None:
        """Capture everything up to the exchange of data: the claim of a number, the connection, a go-ahead from each side."""
        talk = self.talk
        talk.open()
        claim = bytes((self.ids["src_conn"],)) + b"\xff\xf0\xf0\xf0\xf0"
        talk.send(CLIENT, bytes(self.header(CLIENT, r_flags=CONNECTION) / claim))
        talk.send(
            SERVER,
            bytes(
                IBH(channel1=0xFF, channel2=0x07, number=1, s_flags=CONNECTION, r_flags=0)
                / bytes((self.ids["src_conn"], 0))
            ),
        )
        talk.send(CLIENT, self.mpi(CLIENT, CONNECT, PARAMETERS, 4))
        self.ids["dst_conn"] = 20
        talk.send(SERVER, self.receipt() + self.mpi(SERVER, CONFIRM, PARAMETERS, 4))
        talk.send(CLIENT, self.mpi(CLIENT, GO_AHEAD, number=1))
        talk.send(SERVER, self.receipt() + self.mpi(SERVER, GO_AHEAD, number=1))

    def ask(self, request: bytes) -> None:
        """Capture a request and its receipt."""
        self.talk.send(CLIENT, self.data(CLIENT, request))
        self.talk.send(SERVER, self.receipt())
        self.talk.send(SERVER, self.ack(SERVER))

    def exchange(self, function: int, request: bytes, answer: bytes) -> None:
        """Capture a request, its answer, and the acknowledgements of both."""
        self.ask(request)
        self.talk.send(SERVER, self.data(SERVER, answer))
        self.talk.send(CLIENT, self.ack(CLIENT))
        self.case.pair(function)

    def setup(self) -> None:
        """Capture Setup communication."""
        self.exchange(SETUP, setup(1, 240, 1, 1), setup(1, 240, 1, 1, answer=True))

    def close(self) -> None:
        """Capture the end of the connection to the station, then that of TCP."""
        self.talk.send(CLIENT, self.mpi(CLIENT, DISCONNECT))
        self.talk.send(SERVER, self.receipt() + self.mpi(SERVER, DISCONNECT))
        self.talk.close()


@crafts(
    "S7 through an IBH-NetLink on port 1099: a number claimed, the station connected, Setup, reads, a write, each "
    "data packet acknowledged, a read whose answer never comes, the station disconnected."
)
def netlink(case: Case) -> None:
    case.find("security.write")
    case.ports = []
    link = NetLink(case)
    link.connect()
    link.setup()
    for number in (2, 3):
        link.exchange(READ, read_bytes(number, 10), values(number, pattern(10)))
    link.exchange(WRITE, write(4, pattern(6)), written(4))
    link.ask(read_bytes(5, 4))
    case.unanswered(READ, "connection_closed")
    case.find("transaction.unanswered")
    case.pause(900)
    link.close()
    case.table(
        "ibh",
        mpi_data=9,
        mpi_ack=9,
        mpi_connect=1,
        mpi_confirm=1,
        mpi_go_ahead=2,
        mpi_disconnect=2,
        receipt=8,
        service=2,
    )
    case.table("tsdus", s7comm=9)
    case.tshark_shows(0, WHY)


@crafts(
    "IBH-NetLink with all that goes wrong: packets cut by segments, several in one, answers in fragments, on a port "
    "of its own, begun in its midst, a lost segment, MPI lengths that lie, octets that are no packet; ordinary S7 on "
    "port 1099."
)
def netlink_faults(case: Case) -> None:
    case.ports = [PORT]
    in_pieces(case)
    on_another_port(case)
    in_its_midst(case)
    lying(case)
    talk = Talk(case, client_port=49156, port=PORT)
    talk.begin()
    talk.poll()
    talk.close()
    case.find("session.unusual_port", 2)
    case.tshark_shows(4, f"{WHY}; only the ordinary S7 on that port is shown")


def in_pieces(case: Case) -> None:
    # A request octet by octet together with the next write; an answer in two fragments with the go-ahead between them.
    link = NetLink(case, 49152)
    link.connect()
    link.setup()
    request = link.data(CLIENT, read_bytes(2, 20)) + link.ack(CLIENT)
    link.talk.send(CLIENT, request, *range(1, len(request)))
    answer = values(2, pattern(20))
    link.talk.send(SERVER, link.receipt() + link.ack(SERVER) + link.data(SERVER, answer[:30], MORE))
    link.talk.send(CLIENT, link.mpi(CLIENT, GO_AHEAD, number=1))
    link.talk.send(SERVER, link.receipt() + link.data(SERVER, answer[30:]))
    link.talk.send(CLIENT, link.ack(CLIENT))
    case.pair(READ)
    link.close()


def on_another_port(case: Case) -> None:
    # The claim of a connection number is sufficient.
    link = NetLink(case, 49153, 10099)
    link.connect()
    link.setup()
    link.close()


def in_its_midst(case: Case) -> None:
    # No handshake, no connect; then a lost answer, and the next one.
    link = NetLink(case, 49154, station=4)
    link.ids["dst_conn"] = 21
    case.count(connections=1)
    link.exchange(READ, read_bytes(1, 2), values(1, b"\x00\x01"))
    link.ask(read_bytes(2, 2))
    lost = link.data(SERVER, values(2, b"\x00\x02"))
    link.talk.make(SERVER, lost)
    case.lose(len(lost))
    case.find("stream.hole")
    link.talk.send(CLIENT, link.ack(CLIENT))
    case.unanswered(READ, "hole")
    case.pause(300)
    link.exchange(READ, read_bytes(3, 2), values(3, b"\x00\x03"))
    link.talk.close()


def lying(case: Case) -> None:
    # An MPI length that is one too large, and one that is one too small; octets that begin no packet, and then packets in step
    # again.
    link = NetLink(case, 49155)
    link.connect()
    link.setup()
    for number, wrong in ((2, 1), (3, -1)):
        packet = bytearray(link.data(CLIENT, read_bytes(number, 2)))
        packet[12] += wrong
        link.talk.send(CLIENT, bytes(packet))
        case.find("ibh.malformed")
        link.talk.send(SERVER, link.receipt() + link.data(SERVER, values(number, b"\x00\x01")))
        case.pair(READ)
    case.find("s7.malformed")
    junk = b"\x55" * 11
    link.talk.send(CLIENT, junk)
    case.skip(len(junk))
    case.find("ibh.malformed")
    link.exchange(READ, read_bytes(4, 2), values(4, b"\x00\x01"))
    link.talk.close()
