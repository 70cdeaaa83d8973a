"""Connections that were opened and closed without an octet are counted, on ports that matter; others are not taken for them."""

from __future__ import annotations

from dissect.engine.bare import BY_CLIENT, BY_SERVER, MAX_ENDS, MAX_PORTS, BareConnections
from dissect.engine.transactions.table import ConnectionTable
from dissect.packets.tcp.stream import MASK
from tests.cases import each
from tests.engine.transactions.talk import ACK, CLIENT, FIN, RST, SERVER, SYN, Talk, dbw, read, words


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


def test_the_first_of_all_ports_that_matter_is_named() -> None:
    """102, and another one on which S7 is spoken later; a third does not matter."""
    talk = Talk(50000, 80)
    talk.hello()
    closed(talk)
    first = int(talk.pipeline.frames) + 1
    for at, port in enumerate((1102, 102, 1102, 102)):
        one = Talk(50001 + at, port, beside=talk)
        one.hello()
        closed(one)
    plc = Talk(50009, 1102, beside=talk)
    plc.open()
    closed(plc)
    assert found(talk) == (4, first)
    assert talk.pipeline.counters.bare.counts == {80: 1, 102: 2, 1102: 2}
    assert talk.pipeline.counters.bare.spoken == {1102: 1}


def test_none_that_matter_have_no_first_packet() -> None:
    talk = Talk(50000, 80)
    talk.hello()
    closed(talk)
    assert found(talk) == (0, 0)


def test_both_syns_are_needed_and_show_who_is_the_server() -> None:
    """The SYN may be captured behind its answer; without it nothing is known of one side."""
    for late, count in ((True, 1), (False, 0)):
        talk = Talk()
        at = talk.seq[CLIENT]
        talk.seq[CLIENT] += 1
        talk.packet(SERVER, flags=SYN | ACK)
        if late:
            talk.packet(CLIENT, flags=SYN, seq=at)
        closed(talk)
        assert found(talk) == (count, count)


def test_a_connection_met_in_its_midst_is_none() -> None:
    talk = Talk()
    talk.packet(CLIENT)
    talk.packet(SERVER)
    closed(talk)
    assert found(talk) == (0, 0)


@each("side", [CLIENT, SERVER])
@each(("octets", "bare"), [(0, True), (1, True), (2, False)])
def test_what_a_side_acknowledges_beyond_the_syn_is_data_unless_it_may_be_a_fin(
    side: int, octets: int, bare: bool
) -> None:
    talk = Talk()
    talk.hello()
    talk.acked[side] = talk.seq[1 - side] + octets
    talk.packet(side)
    talk.packet(side, flags=RST | ACK)
    assert found(talk) == ((1, 1) if bare else (0, 0))


@each("spoken", [False, True])
def test_as_many_ports_are_counted_as_there_is_room_for(spoken: bool) -> None:
    """What has no room leaves no trace; ports that are known count on."""
    bare = BareConnections()
    table = ConnectionTable()
    ports = [*range(2000, 2000 + MAX_PORTS + 9), 2000, 2000]
    for number, port in enumerate(ports):
        if spoken:
            bare.speaks(port)
            continue
        key = bytes((10, 0, 0, 1, 10, 0, 0, 2)) + (50000).to_bytes(2, "big") + port.to_bytes(2, "big")
        table.note_syn(key, 5, number, 1)
        side = table.open(key, -1, number, 1)
        assert side.peer is not None
        side.peer.stream.start(7)
        side.tcp.note_reset(0, 6, 2, 2)
        bare.take(side, side.peer)
    counts = bare.spoken if spoken else bare.counts
    assert counts[2000] == 3
    assert MAX_PORTS <= len(counts) <= MAX_PORTS + 1
    if not spoken:
        assert bare.first == {port: port - 2000 for port in counts}
    assert set(counts.values()) == {1, 3}


def test_port_102_is_spoken_by_definition() -> None:
    bare = BareConnections()
    bare.speaks(102)
    bare.speaks(103)
    assert bare.spoken == {103: 1}


@each("size", [4, 16])
def test_ends_of_other_ports_and_resets_are_no_ends(size: int) -> None:
    bare = BareConnections()
    hosts = bytes(size) + b"\1" * size
    for ports, flags in (((102, 102), RST), ((50000, 103), FIN), ((103, 50000), FIN), ((50000, 102), ACK)):
        bare.take_end(hosts + b"".join([port.to_bytes(2, "big") for port in ports]), flags, 1)
    assert (bare.ends, bare.first_end()) == ({}, 0)
    bare.take_end(hosts + b"\xc3\x50\0\x66", FIN | ACK, 5)
    bare.take_end(hosts + b"\xc3\x51\0\x66", FIN, 6)
    bare.take_end(hosts + b"\0\x66\xc3\x52", FIN | RST, 7)
    assert (bare.ends, bare.first_end()) == ({BY_CLIENT: 2, BY_SERVER: 1}, 5)
