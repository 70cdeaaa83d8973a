"""Connections that were opened and closed without an octet are counted, on ports that matter; others are not taken for them."""

from __future__ import annotations

from dissect.engine.bare import BY_CLIENT, BY_SERVER, MAX_ENDS, MAX_PORTS, BareConnections
from dissect.engine.transactions.table import ConnectionTable
from dissect.packets.tcp.stream import MASK
from tests.cases import each
from tests.engine.transactions.talk import ACK, CLIENT, FIN, RST, SERVER, Talk, dbw, read, words


def closed(talk: Talk) -> None:
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=FIN | ACK)
    talk.packet(CLIENT)


def found(talk: Talk) -> tuple[int, int]:
    talk.finish()
    return talk.pipeline.counters.bare.found()


@each("flags", [FIN | ACK, RST | ACK, RST])
def test_opened_and_closed(flags: int) -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, flags=flags)
    if flags & FIN:
        talk.packet(SERVER, flags=FIN | ACK)
    assert found(talk) == (1, 1)


def test_a_connection_that_carries_something_or_stays_open_is_none() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 5))
    closed(talk)
    other = Talk(50001, beside=talk)
    other.hello()
    assert found(talk) == (0, 0)


def test_data_that_the_capture_does_not_hold_is_data() -> None:
    talk = Talk()
    talk.hello()
    talk.seq[CLIENT] = (talk.seq[CLIENT] + 22) & MASK  # sent, acknowledged, and not captured
    closed(talk)
    assert found(talk) == (0, 0)


def test_a_port_matters_when_a_connection_to_it_was_followed() -> None:
    talk = Talk(50000, 1102)
    talk.hello()
    closed(talk)
    web = Talk(50001, 80, beside=talk)
    web.hello()
    closed(web)
    talk.wait(10**10)
    assert talk.pipeline.counters.bare.found() == (0, 0)
    plc = Talk(50002, 1102, beside=talk)
    plc.open()
    closed(plc)
    assert found(talk) == (1, 1)


def test_ports_are_bounded_and_port_102_always_counts() -> None:
    bare = BareConnections()
    table = ConnectionTable()
    for port in (*range(2000, 2000 + MAX_PORTS + 9), 102):
        key = bytes((10, 0, 0, 1, 10, 0, 0, 2)) + (50000).to_bytes(2, "big") + port.to_bytes(2, "big")
        table.note_syn(key, 5, 1, 1)
        side = table.open(key, -1, 1, 1)
        peer = side.peer
        assert peer is not None
        peer.stream.start(7)
        side.tcp.note_reset(0, 6, 2, 2)
        bare.take(side, peer)
    assert len(bare.counts) <= MAX_PORTS + 2
    assert bare.found() == (1, 1)


def test_files_are_added_up() -> None:
    bare = BareConnections()
    bare.first = {102: 5}
    bare.add_first({102: 1, 1102: 3}, 100)
    assert bare.first == {102: 5, 1102: 103}


@each("closes", [CLIENT, SERVER])
@each("answered", [False, True])
def test_a_connection_of_which_only_fins_were_captured(closes: int, answered: bool) -> None:
    talk = Talk()
    talk.packet(closes, flags=FIN | ACK)
    if answered:
        talk.packet(1 - closes)
        talk.packet(1 - closes, flags=FIN | ACK)
        talk.packet(closes, flags=FIN | ACK)  # once more
    talk.finish()
    bare = talk.pipeline.counters.bare
    assert (bare.ends, bare.first_end()) == ({BY_CLIENT if closes == CLIENT else BY_SERVER: 1}, 1)


def test_what_has_more_than_an_end_is_none_of_them() -> None:
    talk = Talk()
    talk.open()
    closed(talk)
    Talk(50001, 80, beside=talk).packet(CLIENT, flags=FIN | ACK)
    Talk(50002, beside=talk).packet(CLIENT, flags=RST | ACK)
    talk.finish()
    assert talk.pipeline.counters.bare.ends == {}


def test_connections_of_which_only_the_end_was_captured_are_bounded() -> None:
    bare = BareConnections()
    for number in range(1000, 1000 + MAX_ENDS + 9):
        bare.take_end(bytes((10, 0, 0, 1, 10, 0, 0, 2)) + number.to_bytes(2, "big") + (102).to_bytes(2, "big"), FIN, 7)
    assert (bare.ends, bare.first_end()) == ({BY_CLIENT: MAX_ENDS}, 7)


@each("size", [4, 16])
@each("tag", [b"", b"\0\0\0\x14"])
def test_both_fins_of_a_connection_are_one_end(size: int, tag: bytes) -> None:
    bare = BareConnections()
    one, other, mine, well_known = bytes(size), b"\1" * size, b"\xc3\x50", b"\0\x66"
    bare.take_end(other + one + well_known + mine + tag, FIN, 3)
    bare.take_end(one + other + mine + well_known + tag, FIN, 4)
    assert (bare.ends, bare.first_end()) == ({BY_SERVER: 1}, 3)
    bare.take_end(one + other + mine + well_known + tag + b"\1", FIN, 5)
    assert bare.ends == {BY_SERVER: 1, BY_CLIENT: 1}
