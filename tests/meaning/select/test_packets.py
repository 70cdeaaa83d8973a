"""Packets by an expression: those of selected transactions and findings, others by their own fields."""

from __future__ import annotations

from typing import Final

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.meaning.select import Where
from dissect.meaning.select.packets import KINDS, PacketSelection
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from tests.cases import each
from tests.engine.program.transfers import carry, download
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import ACK, CLIENT, FIN, MS, SECOND, SERVER, Talk, dbw, read, words
from tests.meaning.select.test_selection import Tape, taped, two_connections
from tests.packets.tcp.craft import v6
from tests.packets.tcp.test_segment import ethernet
from tests.properties.packets import ETHERNET
from tests.protocols.ibh import packets as ibh
from tests.protocols.s7plus.pdus import asked, framed, told


def taken(tape: Tape, expression: str) -> list[int]:
    """Return the packets of a tape that an expression selects."""
    where = Where(expression, kinds=KINDS)
    selection = PacketSelection(where)
    pipeline = Pipeline(selection, Options(strict=True))
    where.context.begin(pipeline)
    for time_ns, octets in tape.packets:
        pipeline.frame(time_ns, octets, 0, len(octets), len(octets), ETHERNET)
    pipeline.finish()
    test = selection.test()
    return [
        number
        for number, (time_ns, octets) in enumerate(tape.packets, 1)
        if test(number, time_ns, b"xx" + octets, 2, 2 + len(octets), ETHERNET)
    ]


#: Packets of the first of two connections, and of the second.
FIRST: Final = [1, 2, 3, 7, 8, 9, 10, 15, 16, 19, 20, 23, 24, 25]
OTHER: Final = [number for number in range(1, 29) if number not in FIRST]
TWO: Final = two_connections()


@each(
    ("expression", "packets"),
    [
        ("host == 10.0.0.1", [*range(1, 29)]), ("host == 10.0.0.9", []), ("connection == 1", FIRST), ("connection == 2", OTHER),
        ("connection > 2", []), ("port == 50001", OTHER), ("src == 10.0.0.2:102 and connection == 1", [2, 8, 10, 16, 20, 24]),
        ("dst == 10.0.0.2:102 and port == 50001 and frame < 14", [4, 6, 11, 13]), ("frame in {3..5}", [3, 4, 5]),
        ("client == 10.0.0.1:50000", FIRST), ("server == 10.0.0.1", []), ("pdu_length == 240 and connection == 2", OTHER),
        ("called_tsap == '01.02' and calling_tsap == '01.00' and slot == 2 and frame > 27", [28]), ("vlan", []),
    ],
)  # fmt: skip
def test_by_fields_of_packets_each_is_tested_by_itself(expression: str, packets: list[int]) -> None:
    assert taken(TWO, expression) == packets


@each(
    ("expression", "packets"),
    [
        ("function == read", [15, 16, 17, 18, 19, 20, 21, 22]), ("pdu_ref == 1 and connection == 2", [17, 18]),
        ("number == 3", [15, 16]),
        ("value == 2 and port == 50000", [19, 20]), ("function == read and frame == 15", [15, 16]), ("failed", []),
        # Fields that transactions do not have: packets that carry one that is not selected are none of these.
        ("pdu_ref == 1 or src == 10.0.0.2", [2, 5, 8, 12, 15, 16, 17, 18, 24, 27]),
        ("not failed and not src == 10.0.0.2", [1, 3, 4, 6, 7, 9, 10, 11, *range(13, 24), 25, 26, 28]),
    ],
)  # fmt: skip
def test_packets_of_selected_transactions_and_others_by_themselves(expression: str, packets: list[int]) -> None:
    """A packet of a transaction is taken with it, and never by itself; one that carries none is tested by its own fields."""
    assert taken(TWO, expression) == packets


@each(("later", "again"), [(10 * SECOND, True), (10 * SECOND + 1, False)])
def test_every_segment_of_request_and_answer_and_retransmissions_for_ten_seconds(later: int, again: bool) -> None:
    """Those of the first octets of a request may come so long before it, those of an answer so long after it."""
    talk, tape = taped()
    talk.open()  # 1 to 7
    request = line.dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, request[:9])
    talk.packet(CLIENT, request[9:], after_ns=later)
    first = talk.seq[SERVER]
    talk.tell(words(1, 7), after_ns=5 * SECOND)  # 10
    talk.packet(SERVER, line.dt(words(1, 7)), seq=first, after_ns=later)
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 8))
    assert taken(tape, "value == 7") == ([8, 9, 10, 11] if again else [9, 10])


@each("asks", [CLIENT, SERVER])
def test_a_transaction_has_its_packets_whoever_asks(asks: int) -> None:
    talk, tape = taped()
    talk.open()  # 1 to 7
    said = download(bytes(range(30)), "_0800001P", 20, asks=asks)
    carry(talk, said, 9)
    for number in range(len(said) // 2):
        assert taken(tape, f"number == {2 + number} and pdu_ref") == [8 + 4 * number + at for at in range(4)]


def test_findings_are_not_asked_where_transactions_have_every_field() -> None:
    """A finding about stray octets names two packets, of which one is selected by itself."""
    talk, tape = taped()
    talk.open()
    talk.packet(CLIENT, b"garbage!!")  # 8
    talk.packet(CLIENT, b"more")
    talk.packet(CLIENT, line.CONNECT)
    assert taken(tape, "failed or frame == 8") == [8]
    assert taken(tape, "slug and frame == 8") == [8, 9]


def test_by_fields_of_findings_their_packets_are_taken() -> None:
    talk, tape = taped()
    talk.open()
    for ref in (1, 2):
        talk.ask(read(ref, dbw(ref, 0)))
        talk.tell(line.ack_data(ref, b"\x04\x01", line.refused(0x0A)))  # 9, 11
    talk.ask(line.job(3, b"\x29" + bytes(5) + b"\x09P_PROGRAM"))  # 12
    talk.tell(line.ack_data(3, b"\x29"))
    talk.close()
    assert taken(tape, "slug == security.plc_stop") == [12, 13]
    assert taken(tape, "slug == transaction.item_error and frame == 9") == [8, 9]
    assert taken(tape, "severity >= warning and connection == 2") == []
    # Packets of other findings and of transactions are none by themselves.
    assert taken(tape, "slug == security.plc_stop or src == 10.0.0.2") == [2, 5, 12, 13, 15]


def reused(count: int) -> tuple[Tape, list[list[int]]]:
    """Connections on the same ports, one after the other; the packets of each."""
    talk, tape = taped()
    spans = []
    for _ in range(count):
        begin = len(tape.packets)
        talk.open()
        talk.ask(read(1, dbw(1, 0)))
        talk.tell(words(1, 1))
        talk.packet(CLIENT, flags=FIN | ACK)
        talk.packet(SERVER, flags=FIN | ACK)
        talk.packet(CLIENT)
        talk.seq = [talk.seq[0] + 100_000, talk.seq[1] + 100_000]
        spans.append(list(range(begin + 1, len(tape.packets) + 1)))
    return tape, spans


def test_connections_that_follow_one_another_on_the_same_ports_are_told_apart() -> None:
    tape, spans = reused(4)
    for number, packets in enumerate(spans, 1):
        assert taken(tape, f"connection == {number}") == packets
    assert taken(tape, "connection") == [number for packets in spans for number in packets]


def test_a_late_packet_belongs_to_the_connection_before() -> None:
    """Where connections on the same ports overlap in the capture, the earlier one has the packets up to its last."""
    tape = two_connections()
    ends = [Endpoint(bytes((10, 0, 0, host)), port) for host, port in ((1, 50000), (2, 102))]
    lines = []
    for number, first, last in ((1, 1, 10), (3, 15, 20), (2, 8, 18)):  # in the order in which they ended
        tcp = TcpConnection(ends[0], ends[1], 0, first, 0)
        tcp.last_frame = last
        lines.append(Connection(number, tcp))
    for number, (_, octets) in enumerate(tape.packets[:3], 1):
        found = {}
        for wanted in (1, 2, 3):
            selection = PacketSelection(Where(f"connection == {wanted}", kinds=KINDS))
            for connection in lines:
                selection.connection_closed(connection)
            test = selection.test()
            found[wanted] = [frame for frame in range(25) if test(frame, 0, octets, 0, len(octets), ETHERNET)]
        assert found == {1: list(range(1, 11)), 2: list(range(11, 19)), 3: [19, 20]}, number


def test_packets_beside_every_connection() -> None:
    """An ICMP packet has hosts, but no ports; an ARP frame has neither; a connection that nobody reads has no number."""
    talk, tape = taped()
    icmp6 = ethernet(v6(b"\x80" + bytes(7), next_header=58))
    talk.packet(CLIENT, b"x")
    icmp = tape.packets[0][1][:14] + bytes.fromhex("4500001c 00000000 4001 0000 0a000001 0a000002 0800000000000000")
    tape.packets = []
    for octets in (icmp, icmp6, bytes(12) + b"\x08\x06" + bytes(46), b"", b"\xff" * 9):
        talk.raw(octets)
    talk.ports = [2000, 80]
    talk.packet(CLIENT, b"GET / HTTP/1.1\r\n\r\n")  # 6
    for expression, packets in (
        ("src == 10.0.0.1", [1, 6]), ("dst == 10.0.0.2", [1, 6]), ("src == 2001:db8::1", [2]), ("dst == 2001:db8::2", [2]),
        ("dst == 10.0.0.1", []), ("host", [1, 2, 6]), ("port", [6]), ("port == 80 and dst == 10.0.0.2:80", [6]),
        ("connection", []),
        ("not connection", [1, 2, 3, 4, 5, 6]), ("not host == 10.0.0.1", [2, 3, 4, 5]), ("port == 65535", []),
        ("src == 10.0.0.1:0", []),
        ("frame > 4 or src == 2001:db8::/32", [2, 5, 6]), ("time >= 3ms and time < 5ms", [4, 5]),
    ):  # fmt: skip
        assert taken(tape, expression) == packets, expression


def test_times_are_counted_from_the_start_that_the_context_knows() -> None:
    where = Where("time < 2ms", kinds=KINDS)
    where.context.start = lambda: line.START_NS + MS
    test = PacketSelection(where).test()
    assert [at for at in range(5) if test(1, line.START_NS + at * MS, b"", 0, 0, ETHERNET)] == [0, 1, 2]


def test_packets_of_s7comm_plus() -> None:
    talk, tape = taped()
    talk.hello()
    talk.connect()
    request = line.dt(framed(asked(1)))
    talk.packet(CLIENT, request[:12])  # 6
    talk.packet(CLIENT, request[12:])
    talk.tell(framed(told(1)))
    talk.ask(framed(asked(2)))
    talk.tell(framed(told(2)))
    assert taken(tape, "pdu_ref == 1") == [6, 7, 8]
    assert taken(tape, "pdu_ref == 2") == [9, 10]


def test_packets_of_a_vlan() -> None:
    talk, tape = taped()
    other = Talk(50001, beside=talk)
    talk.vlan = 7
    for one in (talk, other):
        one.hello()
        one.connect()
        one.ask(line.setup(0))
    assert taken(tape, "vlan == 7") == [1, 2, 3, 4, 5, 6]
    assert taken(tape, "vlan == 7 and pdu_ref == 0") == [6]


def test_packets_of_ibh_netlink() -> None:
    talk, tape = taped(server_port=1099)
    talk.hello()
    talk.packet(CLIENT, ibh.CLAIM)
    for side, octets in (
        (CLIENT, ibh.short(0xF1, line.setup(0, 4, 4))),
        (SERVER, ibh.long(0xF1, line.granted(0, 4, 4))),
    ):
        talk.packet(side, octets)
    asked_, answer = ibh.short(0xF1, read(1, dbw(1, 0))), ibh.long(0xF1, words(1, 7))
    talk.packet(CLIENT, asked_[:9])  # 7
    talk.packet(CLIENT, asked_[9:])
    talk.packet(SERVER, answer[:20])
    talk.packet(SERVER, answer[20:])
    talk.packet(CLIENT)
    assert taken(tape, "function == read") == [7, 8, 9, 10]
