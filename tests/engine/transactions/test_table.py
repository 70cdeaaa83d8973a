from __future__ import annotations

import pytest

from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import (
    DOUBT_NS,
    LINGER_NS,
    LOOK_AT_ONCE,
    MAX_ALSO,
    MAX_CONNECTIONS,
    MAX_FORGOTTEN,
    MAX_HALF_OPEN,
    MAX_LINGERING,
    MAX_TAGS,
    RESERVE,
    Attempt,
    ConnectionTable,
    base_and_tag,
    endpoints,
    keys_of,
    reverse_key,
)
from dissect.packets.tcp.connection import TcpConnection
from tests.engine.transactions.talk import ACK, CLIENT, CONFIRM, CONNECT, SERVER, SYN, Talk, dbw, read, words

V4 = bytes((10, 0, 0, 1, 10, 0, 0, 2)) + (50000).to_bytes(2, "big") + (102).to_bytes(2, "big")
V6 = bytes(15) + b"\1" + bytes(15) + b"\2" + (50000).to_bytes(2, "big") + (102).to_bytes(2, "big")
TAG = (7).to_bytes(8, "big")


def key(number: int) -> bytes:
    return V4[:1] + number.to_bytes(3, "big") + V4[4:]


@pytest.mark.parametrize("one", [V4, V6, V4 + TAG, V6 + TAG])
def test_keys_of_both_directions(one: bytes) -> None:
    other = reverse_key(one)
    assert other != one
    assert reverse_key(other) == one
    sender, receiver = endpoints(one)
    assert (sender.port, receiver.port) == (50000, 102)
    assert [str(end) for end in endpoints(other)] == [str(receiver), str(sender)]
    assert other[-8:] == TAG or not one.endswith(TAG)


def test_an_address_of_every_kind() -> None:
    assert [str(end) for end in endpoints(V4)] == ["10.0.0.1:50000", "10.0.0.2:102"]
    assert [str(end) for end in endpoints(V6)] == ["[::1]:50000", "[::2]:102"]


def test_a_connection_has_two_sides() -> None:
    table = ConnectionTable()
    side = table.open(V4, 0, 3, 99)
    assert side.peer is not None
    assert (side.index, side.peer.index, side.peer.peer) == (0, 1, side)
    assert side.connection is side.peer.connection
    assert (table.sides[V4], table.sides[reverse_key(V4)]) == (side, side.peer)
    assert (side.tcp.first_frame, side.tcp.first_ns, side.tcp.known_start) == (3, 99, False)
    assert (side.captured, side.peer.captured) == (False, False)
    assert table.all_open() == [side]
    table.remove(side.peer)
    assert (table.sides, table.all_open()) == ({}, [])


def test_a_side_is_found_as_long_as_its_connection_is_open() -> None:
    table = ConnectionTable()
    keys = [key(number) for number in range(3000)]
    for turn in range(2):
        for number, one in enumerate(keys):
            assert table.find(b"??" + one + b"?", 2, 0) is None
            side = table.open(one, 0, number, turn)
            for _ in range(2):
                assert table.find(b"??" + one + b"?", 2, 0) is side
                assert table.find(reverse_key(one), 0, 0) is side.peer
            if number % 2:
                table.remove(side)
                assert table.find(one, 0, 0) is None
        for one in keys:
            assert table.find(one, 0, 0) is table.sides.get(one)
        for side in table.all_open():
            table.remove(side)


@pytest.mark.parametrize("vlan", [0, 5, 7 << 12 | 5, 1 << 24 | 5, 5 << 36])
@pytest.mark.parametrize("base", [V4, V6])
def test_a_side_is_found_in_its_vlan_only(base: bytes, vlan: int) -> None:
    table = ConnectionTable()
    tag = vlan.to_bytes(8, "big") if vlan else b""
    others = [other for other in (0, 5, 6, 7 << 12 | 5, 1 << 24 | 5, 2 << 24 | 5, 5 << 36) if other != vlan]
    find = table.find if base is V4 else table.find6
    side = table.open(base + tag, vlan, 1, 1)
    for _ in range(2):
        assert find(b"?" + base, 1, vlan) is side
        assert find(reverse_key(base), 0, vlan) is side.peer
        assert [find(base, 0, other) for other in others] == [None] * len(others)
    beside = [table.open(base + (other.to_bytes(8, "big") if other else b""), other, 2, 2) for other in others]
    for _ in range(2):
        assert [find(base, 0, other) for other in others] == beside
        assert find(base, 0, vlan) is side
    table.remove(side)
    assert find(base, 0, vlan) is None
    assert [find(base, 0, other) for other in others] == beside


def test_who_takes_the_addresses_of_another_is_found_in_its_place() -> None:
    table = ConnectionTable()
    first = table.open(V4, 0, 1, 1)
    assert table.find(V4, 0, 0) is first
    second = table.open(V4, 0, 2, 2)
    assert table.find(V4, 0, 0) is second
    table.remove(first)
    assert table.find(V4, 0, 0) is second


def test_a_connection_of_an_address_with_itself_can_be_told_and_leave() -> None:
    table = ConnectionTable()
    one = V4[:4] * 2 + V4[8:10] * 2
    side = table.open(one, 0, 1, 0)
    assert table.all_open() == [side]
    for number in range(2 * MAX_CONNECTIONS):
        assert table.overflow() == []
        host = (number + 1).to_bytes(4, "big")
        table.open(host * 2 + V4[8:10] * 2, 0, 1, number + 1)
    assert table.overflow() == [side]
    table.remove(side)
    assert one not in table.sides


def test_a_connection_that_took_another_s_place_stays() -> None:
    table = ConnectionTable()
    old = table.open(V4, 0, 1, 0)
    new = table.open(V4, 0, 2, 0)
    table.remove(old)
    assert table.sides[V4] is new


def test_a_vlan_is_another_connection() -> None:
    table = ConnectionTable()
    assert table.open(V4, 0, 1, 0).tcp is not table.open(V4 + TAG, 7, 2, 0).tcp
    assert len(table.all_open()) == 2


@pytest.mark.parametrize("answering", [False, True])
def test_a_syn_says_who_began(answering: bool) -> None:
    table = ConnectionTable()
    table.note_syn(V4, 1000, 1, 5)
    side = table.open(reverse_key(V4) if answering else V4, 0, 2, 6)
    assert side.index == (1 if answering else 0)
    assert side.tcp.initiator == 0
    assert [str(end) for end in side.tcp.ends] == ["10.0.0.1:50000", "10.0.0.2:102"]
    assert (side.tcp.first_frame, side.tcp.first_ns, side.tcp.streams[0].next_seq) == (1, 5, 1001)


def test_a_syn_sent_again_counts_from_the_first() -> None:
    table = ConnectionTable()
    table.note_syn(V4, 1000, 1, 5)
    table.note_syn(V4, 1000, 2, 6)
    assert table.open(V4, 0, 3, 7).tcp.first_frame == 1


def test_a_new_attempt_from_the_same_port_counts_from_its_own_number() -> None:
    table = ConnectionTable()
    table.note_syn(V4, 1000, 1, 5)
    table.note_syn(V4, 777_000, 9, 50)
    side = table.open(reverse_key(V4), 0, 10, 51)
    assert side.tcp.streams[0].next_seq == 777_001
    assert side.tcp.first_frame == 9


def test_a_new_attempt_from_the_same_port_loses_nothing() -> None:
    talk = Talk()
    talk.packet(CLIENT, flags=SYN)
    talk.seq = [500_000, 90_000]
    talk.hello()
    talk.connect()
    asked = talk.ask(read(1, dbw(1, 0)))
    answered = talk.tell(words(1, 1))
    talk.close()
    assert talk.pairs() == [(asked, answered)]
    assert "stream.hole" not in talk.slugs()


def test_both_ends_may_begin() -> None:
    """A simultaneous open leaves no half-open attempt behind."""
    table = ConnectionTable()
    table.note_syn(V4, 1000, 1, 0)
    table.note_syn(reverse_key(V4), 2000, 2, 0)
    side = table.open(V4, 0, 3, 0)
    assert (side.index, side.tcp.initiator, side.tcp.streams[0].next_seq) == (0, 0, 1001)
    table.remove(side)
    assert table.open(reverse_key(V4), 0, 4, 0).tcp.initiator == -1


def test_attempts_are_bounded_and_counted() -> None:
    table = ConnectionTable()
    for number in range(MAX_HALF_OPEN + 5):
        table.note_syn(key(number), 1, number + 1, 0)
    assert table.half_open_evicted == 5
    assert not table.open(key(4), 0, 9, 0).tcp.known_start
    assert table.open(key(5), 0, 9, 0).tcp.known_start
    assert table.open(key(MAX_HALF_OPEN + 4), 0, 9, 0).tcp.known_start


def test_the_longest_idle_leave_when_the_table_is_full() -> None:
    table = ConnectionTable()
    sides: list[Side] = []
    for number in range(MAX_CONNECTIONS):
        assert table.overflow() == []
        side = table.open(key(number), 0, number + 1, number)
        side.tcp.last_ns = (number * 7919) % MAX_CONNECTIONS
        sides.append(side)
    sides[5].tcp.last_ns = 1 << 40  # busy again
    known = sorted([int(side.tcp.last_ns) for side in sides[: MAX_CONNECTIONS - RESERVE + 1]])
    left: list[int] = []
    for number in range(2000):
        looks = table._idle.looks
        gone = table.overflow()
        assert table._idle.looks - looks <= LOOK_AT_ONCE
        for side in gone:
            left.append(int(side.tcp.last_ns))
            table.remove(side)
        table.open(key(MAX_CONNECTIONS + number), 0, 1, 1 << 41)
    assert len(table.all_open()) == MAX_CONNECTIONS + 1
    assert table.evicted == len(left) == 1999
    assert left[:256] == known[:256]  # the first round
    assert max(left) < 1 << 40


def test_where_all_are_busy_the_table_is_bounded_all_the_same() -> None:
    table = ConnectionTable()
    for number in range(MAX_CONNECTIONS + 4000):
        for side in table.overflow():
            table.remove(side)
        table.open(key(number), 0, number + 1, number)
        if number >= MAX_CONNECTIONS - RESERVE and number % 64 == 0:
            for side in table.all_open():
                side.tcp.last_ns += 1
    assert len(table.all_open()) <= MAX_CONNECTIONS + RESERVE + 1


def test_closed_connections_linger_for_a_moment() -> None:
    table = ConnectionTable()
    first, second = table.open(key(1), 0, 1, 0), table.open(key(2), 0, 1, 0)
    assert not table.lingering
    second.tcp.last_ns = 500
    table.linger(first)
    table.linger(second)
    assert table.lingering
    assert table.closed(LINGER_NS) == []
    assert table.closed(LINGER_NS + 1) == [first]
    assert table.closed(LINGER_NS + 500) == []
    assert table.closed(0, everything=True) == [second]
    assert not table.lingering


def test_lingering_connections_are_bounded() -> None:
    table = ConnectionTable()
    sides = [table.open(key(number), 0, 1, 0) for number in range(MAX_LINGERING + 3)]
    for side in sides:
        table.linger(side)
    assert table.closed(0) == sides[:3]


@pytest.mark.parametrize(
    ("packets", "captured"),
    [
        ([(CLIENT, SYN, b""), (SERVER, SYN | ACK, b"")], (True, True)),
        ([(CLIENT, SYN, b""), (CLIENT, ACK, CONNECT)], (True, False)),
        ([(CLIENT, ACK, CONNECT), (SERVER, ACK, b"")], (True, True)),
        ([(SERVER, ACK, CONFIRM), (SERVER, ACK, b"")], (False, True)),
    ],
)
def test_which_sides_were_captured(packets: list[tuple[int, int, bytes]], captured: tuple[bool, bool]) -> None:
    talk = Talk()
    for side, flags, payload in packets:
        talk.packet(side, payload, flags)
    found = talk.pipeline.table.all_open()[0]
    assert found.peer is not None
    ports = {end.tcp.ends[end.index].port: end.captured for end in (found, found.peer)}
    assert (ports[50000], ports[102]) == captured


# ---- what find must not confuse -------------------------------------------------------------------------------------


def test_addresses_that_differ_in_a_few_bits_are_kept_apart() -> None:
    """Such that differ in the second half of an IPv6 address, or in both addresses, so that a sum of them would be the same."""
    sources = [bytes(8) + word.to_bytes(8, "big") for word in (1, 3)]
    targets = [upper.to_bytes(8, "big") + lower.to_bytes(8, "big") for upper in (1, 9) for lower in (1, 5)]
    keys = [source + target + V6[32:] for source in sources for target in targets]
    table = ConnectionTable()
    sides = [table.open(one, 0, 1, 1) for one in keys]
    for one, side in [*zip(keys, sides, strict=True), *zip(keys[::-1], sides[::-1], strict=True)]:
        for other, beside in zip(keys, sides, strict=True):
            assert table.find6(one, 0, 0) is side
            assert table.find6(b"?" + other + b"?", 1, 0) is beside
            assert table.find6(reverse_key(other), 0, 0) is beside.peer


@pytest.mark.parametrize("base", [V4, V6])
def test_addresses_and_ports_that_differ_in_one_bit_are_kept_apart(base: bytes) -> None:
    table = ConnectionTable()
    find = table.find if base is V4 else table.find6
    sides = [(base, table.open(base, 0, 1, 1))]
    for at in range(len(base)):
        for bit in (1, 0x80):
            other = base[:at] + bytes((base[at] ^ bit,)) + base[at + 1 :]
            sides.append((other, table.open(other, 0, 1, 1)))
    for one, side in sides:
        assert find(base, 0, 0) is sides[0][1]
        assert find(b"?" + one + b"?", 1, 0) is side
        assert find(one, 0, 0) is side
        assert find(b"?" + reverse_key(one), 1, 0) is side.peer


def test_a_connection_that_is_over_is_not_found_wherever_it_was() -> None:
    table = ConnectionTable()
    for number in range(12_000):
        one = key(number)
        side = table.open(one, 0, 1, 1)
        assert table.find(one, 0, 0) is side
        table.remove(side)
        assert table.find(one, 0, 0) is None


def test_a_connection_is_found_after_many_more_have_opened() -> None:
    table = ConnectionTable()
    first = [table.open(key(number), 0, 1, 1) for number in range(50)]
    assert [table.find(key(number), 0, 0) for number in range(50)] == first
    for number in range(50, 2200):
        table.open(key(number), 0, 1, 1)
    for side in first[::2]:
        table.remove(side)
    for number, side in enumerate(first):
        assert table.find(key(number), 0, 0) is (side if number % 2 else None)


def test_the_vlan_of_a_key() -> None:
    table = ConnectionTable()
    for vlan in (0, 7, 7, 5 << 36, 0, 7):
        assert table.tag_of(vlan) == (vlan.to_bytes(8, "big") if vlan else b"")
    for base in (V4, V6):
        assert base_and_tag(base) == (base, b"")
        assert base_and_tag(base + TAG) == (base, TAG)


def test_the_keys_of_a_connection_in_all_its_vlans() -> None:
    tcp = TcpConnection(*endpoints(V4), 7, 1, 0)
    assert keys_of(tcp) == [V4 + TAG]
    tcp.note_vlan(0)
    tcp.note_vlan(9)
    assert keys_of(tcp) == [V4 + TAG, V4, V4 + (9).to_bytes(8, "big")]


def test_the_vlans_of_a_capture_are_remembered_up_to_a_bound() -> None:
    """The one seen first is forgotten; that packets had none is remembered."""
    table = ConnectionTable()
    tags = [number.to_bytes(8, "big") for number in range(1, MAX_TAGS + 3)]
    for tag in tags[:MAX_TAGS]:
        table.note_tag(tag)
        table.note_tag(tag)
    table.note_tag(b"")
    assert list(table.tags) == [b"", *tags[:MAX_TAGS]]
    table.note_tag(tags[MAX_TAGS])
    assert list(table.tags) == [b"", *tags[1 : MAX_TAGS + 1]]
    table.note_tag(tags[MAX_TAGS + 1])
    assert list(table.tags) == [b"", *tags[2:]]


# ---- the keys of a connection in other VLANs ------------------------------------------------------------------------


def tagged(number: int) -> bytes:
    return number.to_bytes(8, "big")


def test_a_connection_is_found_in_a_few_further_vlans() -> None:
    table = ConnectionTable()
    side = table.open(V4, 0, 1, 0)
    for number in range(1, MAX_ALSO + 2):
        table.add(side, V4 + tagged(number))
    for _ in range(2):
        assert [table.find(V4, 0, number) for number in range(MAX_ALSO + 2)] == [side] * (MAX_ALSO + 1) + [None]
    assert side.tcp.also == tuple(range(1, MAX_ALSO + 1))
    assert table.all_open() == [side]
    assert side.peer is not None
    table.add(side.peer, reverse_key(V4) + tagged(1))
    assert table.find(reverse_key(V4), 0, 1) is side.peer
    table.remove(side)
    assert table.sides == {}
    assert [table.find(V4, 0, number) for number in range(MAX_ALSO + 1)] == [None] * (MAX_ALSO + 1)


def test_a_further_key_that_another_connection_took_stays_with_it() -> None:
    table = ConnectionTable()
    old = table.open(V4, 0, 1, 0)
    table.add(old, V4 + tagged(1))
    assert table.find(V4, 0, 1) is old
    new = table.open(V4 + tagged(1), 1, 2, 0)
    assert table.find(V4, 0, 1) is new
    table.remove(old)
    assert table.find(V4, 0, 1) is new
    assert table.all_open() == [new]


@pytest.mark.parametrize("by_peer", [False, True])
@pytest.mark.parametrize("other", [0, 1])
def test_the_syn_of_a_connection_in_another_vlan_is_no_attempt(other: int, by_peer: bool) -> None:
    """Unless its sequence number is different: then it is one."""
    table = ConnectionTable()
    table.note_syn(V4, 0xFFFFFFFF, 1, 5)
    side = table.open(V4, 0, 2, 6)
    table.note_syn(V4 + TAG, (0xFFFFFFFF + other) & 0xFFFFFFFF, 3, 7)
    packets = int(side.tcp.packets)
    if by_peer:
        assert side.peer is not None
        table.add(side.peer, reverse_key(V4) + TAG)
    else:
        table.add(side, V4 + TAG)
    assert (table.attempt(V4 + TAG) is None) is (other == 0)
    assert side.tcp.packets - packets == 1 - other


# ---- connections that were dropped ----------------------------------------------------------------------------------


def test_the_rest_of_a_dropped_connection_is_known() -> None:
    table = ConnectionTable()
    assert not table.may_be_forgotten(table.open(key(1), 0, 1, 0))
    table.forget(table.open(key(1), 0, 1, 0))
    for side in (table.open(key(1), 0, 2, 0), table.open(reverse_key(key(1)), 0, 2, 0)):
        assert table.may_be_forgotten(side)
    assert not table.may_be_forgotten(table.open(key(2), 0, 1, 0))


def test_where_not_all_can_be_remembered_any_may_be_a_dropped_one() -> None:
    table = ConnectionTable()
    other = table.open(key(1 << 20), 0, 1, 0)
    for number in range(MAX_FORGOTTEN // 2):
        assert not table.may_be_forgotten(other)
        side = table.open(key(number), 0, 1, 0)
        table.forget(side)
        table.remove(side)
    assert table.may_be_forgotten(other)


def test_a_new_table_continues_the_counts() -> None:
    table = ConnectionTable()
    table.open(V4, 0, 1, 0)
    table.evicted, table.half_open_evicted = 3, 4
    new = table.anew()
    assert (new.evicted, new.half_open_evicted, new.sides, new.all_open()) == (3, 4, {}, [])
    assert new.open(V4, 0, 1, 0).protocol is table.open(V4, 0, 1, 0).protocol


# ---- attempts -------------------------------------------------------------------------------------------------------


def asked_again(table: ConnectionTable, times: list[int], seq: int = 1000) -> list[Attempt | None]:
    """Note a SYN at each of these times, in ms; packets are numbered by time."""
    return [table.note_syn(V4, seq, time_ms, time_ms * 1_000_000) for time_ms in times]


def test_a_syn_that_is_repeated_twice_is_unanswered_and_told_once() -> None:
    table = ConnectionTable()
    told = asked_again(table, [10, 1010, 3010, 7010])
    attempt = table.attempt(V4)
    assert told == [None, None, attempt, None]
    assert attempt is not None
    assert (attempt.seq, attempt.frame, attempt.time_ns) == (1000, 10, 10_000_000)
    assert (attempt.repeats, attempt.last_frame, attempt.last_ns) == (3, 7010, 7_010_000_000)
    assert table.unanswered() == []


def test_a_syn_that_was_captured_twice_is_not_repeated() -> None:
    table = ConnectionTable()
    assert asked_again(table, [0, 0, 1, 899, 900, 1799]) == [None] * 6
    attempt = table.attempt(V4)
    assert attempt is not None
    assert (attempt.repeats, attempt.last_frame) == (1, 900)
    assert asked_again(table, [1800]) == [attempt]


def test_at_the_end_one_repetition_is_enough() -> None:
    table = ConnectionTable()
    table.note_syn(key(1), 5, 1, 0)
    table.note_syn(key(2), 5, 2, 0)
    table.note_syn(key(2), 5, 3, LINGER_NS)
    assert [(one, attempt.repeats) for one, attempt in table.unanswered()] == [(key(2), 1)]
    assert table.unanswered() == []


@pytest.mark.parametrize(
    ("times", "told"), [([0], False), ([0, 500], False), ([0, 1000], True), ([0, 1000, 3000], False)]
)
def test_another_attempt_from_the_same_port_ends_the_one_before(times: list[int], told: bool) -> None:
    """It was unanswered if it was repeated; it is told once."""
    table = ConnectionTable()
    asked_again(table, times)
    before = table.attempt(V4)
    assert asked_again(table, [9000], seq=2000) == [before if told else None]
    now = table.attempt(V4)
    assert now is not None
    assert (now.seq, now.frame, now.repeats) == (2000, 9000, 0)


def test_a_reset_answers_an_attempt() -> None:
    table = ConnectionTable()
    table.note_syn(V4, 1000, 1, 5)
    assert not table.refused(V4)  # that is the direction of the attempt itself
    assert table.attempt(V4) is not None
    assert table.refused(reverse_key(V4))
    assert not table.refused(reverse_key(V4))
    assert table.attempt(V4) is None


def test_an_attempt_is_forgotten_where_the_connection_goes_on() -> None:
    table = ConnectionTable()
    table.note_syn(V4, 1000, 1, 5)
    table.note_syn(key(3), 1000, 2, 5)
    table.forget_syn(V4)
    table.forget_syn(V4)
    assert not table.open(V4, 0, 9, 9).tcp.known_start
    assert table.attempt(key(3)) is not None


def test_the_syn_counts_as_a_packet_and_names_the_network_cards() -> None:
    table = ConnectionTable()
    table.note_syn(V4, 1000, 1, 5, b"RECEIVSENDER")
    tcp = table.open(reverse_key(V4), 0, 2, 6).tcp
    assert (tcp.packets, tcp.mac(0), tcp.heard) == (1, b"SENDER"[:6] if not b"S"[0] & 1 else b"", 1)
    assert table.open(key(5), 0, 3, 7).tcp.packets == 0


# ---- connections whose end is in doubt ------------------------------------------------------------------------------


def doubted(table: ConnectionTable, number: int, time_ns: int) -> Side:
    """A connection that was closed by a RST with an unexpected sequence number."""
    side = table.open(key(number), 0, 1, 0)
    side.begin(1000)
    assert side.tcp.note_reset(side.index, 1005, 2, time_ns)
    side.tcp.last_ns = time_ns
    assert side.tcp.doubt is not None
    table.linger(side)
    return side


def test_a_connection_whose_end_is_in_doubt_is_kept_longer() -> None:
    table = ConnectionTable()
    side = doubted(table, 1, 500)
    assert table.lingering
    assert table.closed(DOUBT_NS + 500) == []
    assert table.closed(DOUBT_NS + 501) == [side]
    assert (table.lingering, table.closed(DOUBT_NS * 2)) == (False, [])


def test_a_connection_that_is_open_again_lingers_no_longer() -> None:
    table = ConnectionTable()
    first, second, third = (doubted(table, number, 0) for number in (1, 2, 3))
    for side in (first, third):
        side.tcp.withdraw()
    assert table.closed(5) == []
    assert table.lingering
    assert table.closed(5, everything=True) == [second]
    assert not table.lingering
