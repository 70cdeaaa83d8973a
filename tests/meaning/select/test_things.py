"""The context of fields: connections by their numbers, the start of the capture, numbers of packets."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.meaning.select.things import Context, Message
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from tests.engine.transactions.talk import CLIENT, SERVER, START_NS, Talk, dbw, read

ENDS: Final = [Endpoint(bytes((10, 0, 0, last)), port) for last, port in ((1, 50000), (2, 102))]


def connection(number: int) -> Connection:
    return Connection(number, TcpConnection(ENDS[0], ENDS[1], 0, 1, 0))


def test_a_connection_is_known_while_it_is_open_and_long_after() -> None:
    context = Context()
    first = connection(1)
    assert context.connection(1) is None
    context.opened(first)
    assert context.connection(1) is first
    context.closed(first)
    assert context.connection(1) is first
    stays = connection(2)
    context.opened(stays)
    for number in range(10_000, 10_000 + 4095):
        context.closed(connection(number))
    assert context.connection(1) is first
    context.closed(connection(20_000))  # 4,096 others are finished since
    assert context.connection(1) is None
    assert context.connection(2) is stays
    assert context.connection(10_000) is not None
    assert context.connection(0) is None


def test_a_run_that_begins_gives_the_start_and_the_numbers_of_packets() -> None:
    context, talk = Context(), Talk()
    assert (context.start(), context.number(7), context.local) == (0, 7, False)
    assert Context(True).local
    context.begin(talk.pipeline)
    talk.hello()
    assert (context.start(), context.number(7)) == (START_NS + 1_000_000, 7)
    context.begin(talk.pipeline, lambda frame: frame - 5)
    assert context.number(7) == 2


def test_a_message_is_decoded_by_its_own_protocol() -> None:
    octets = read(7, dbw(1, 0))
    for protocol, s7, plus in (("s7comm", True, False), ("s7comm_plus", False, True), ("cotp", False, False)):
        for side, ends in ((CLIENT, tuple(ENDS)), (SERVER, tuple(reversed(ENDS)))):
            message = Message(protocol, 5, 9, connection(3), side, octets)
            assert (message.pdu is not None, message.plus is not None) == (s7, plus)
            assert message.ends == ends
            assert (message.cut, message.is_behind, message.scd) == (False, False, None)
            if message.pdu is not None:
                assert message.pdu is message.pdu
                assert (message.pdu.frame, message.pdu.time_ns, message.pdu.connection, message.pdu.side) == (
                    5,
                    9,
                    3,
                    side,
                )
            if message.plus is not None:
                assert (message.plus.frame, message.plus.time_ns) == (5, 9)
                assert (message.plus.connection, message.plus.side) == (3, side)
