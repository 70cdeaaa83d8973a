from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import MASK, Endpoint
from tests.cases import each

CLIENT = Endpoint(bytes((10, 0, 0, 1)), 49152)
SERVER = Endpoint(bytes((10, 0, 0, 2)), 102)
FAR = 10**6


def opened(isn: int = 1000) -> TcpConnection:
    """A connection whose handshake was captured, with ten octets from each side."""
    tcp = TcpConnection(CLIENT, SERVER, 0, 1, 10)
    tcp.initiator = 0
    for stream, start in zip(tcp.streams, (isn, 5000), strict=True):
        stream.start(start + 1)
        stream.passed(b"0123456789", 10)
    return tcp


def ended(tcp: TcpConnection) -> tuple[str, int, int, int]:
    return tcp.ended, tcp.ended_by, tcp.ended_frame, tcp.ended_ns


@pytest.mark.parametrize(
    ("endpoint", "text"),
    [
        (CLIENT, "10.0.0.1:49152"),
        (Endpoint(bytes.fromhex("20010db8000000000000000000000001"), 102), "[2001:db8::1]:102"),
    ],
)
def test_endpoints_as_people_write_them(endpoint: Endpoint, text: str) -> None:
    assert str(endpoint) == text


def test_a_connection_without_handshake_is_open_and_its_start_unknown() -> None:
    tcp = TcpConnection(CLIENT, SERVER, 7, 3, 30)
    assert ended(tcp) == ("", -1, 0, 0)
    assert (tcp.known_start, tcp.closed, tcp.vlan) == (False, False, 7)
    assert (tcp.first_frame, tcp.first_ns, tcp.last_frame, tcp.last_ns) == (3, 30, 3, 30)
    assert opened().known_start


# ---- SYN ------------------------------------------------------------------------------------------------------------


@given(st.integers(0, MASK), st.integers(0, MASK))
def test_a_syn_with_another_sequence_number_is_another_connection(isn: int, other: int) -> None:
    tcp = opened(isn)
    assert tcp.is_new_connection(0, other) is (isn != other)
    tcp.note_fin(0, fin_seq(tcp, 0), 5, 50)
    assert tcp.is_new_connection(0, isn) is False  # the same SYN again, late


def test_a_syn_of_a_side_that_was_silent() -> None:
    tcp = TcpConnection(CLIENT, SERVER, 0, 1, 10)
    assert tcp.is_new_connection(1, 77) is False
    tcp.note_reset(0, 0, 5, 50)
    assert tcp.is_new_connection(1, 77) is True


def fin_seq(tcp: TcpConnection, side: int) -> int:
    """Return the sequence number at which a FIN of ``side`` is expected."""
    return max(int(tcp.streams[side].next_seq), 0)


# ---- FIN ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance", "believed"),
    [(0, True), (1_000_000, True), (-1_000_000, True), (5_000_000, False), (-5_000_000, False)],
)
def test_a_fin_far_from_what_is_expected_is_not_believed(distance: int, believed: bool) -> None:
    tcp = opened()
    assert tcp.note_fin(0, (fin_seq(tcp, 0) + distance) & MASK, 5, 50) is believed
    assert tcp.ended == ("fin" if believed else "")
    assert tcp._silent == believed
    assert tcp.note_fin(1, 77, 6, 60)  # nothing is known of that side
    assert tcp.closed is believed


@pytest.mark.parametrize("side", [0, 1])
def test_the_first_fin_says_who_closed(side: int) -> None:
    tcp = opened()
    tcp.note_fin(side, fin_seq(tcp, side), 5, 50)
    assert ended(tcp) == ("fin", side, 5, 50)
    assert not tcp.closed
    tcp.note_fin(side, fin_seq(tcp, side), 6, 60)  # sent again
    assert not tcp.closed
    tcp.note_fin(1 - side, fin_seq(tcp, 1 - side), 7, 70)
    assert ended(tcp) == ("fin", side, 5, 50)
    assert tcp.closed


# ---- RST ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [0, 1])
def test_a_reset_ends_both_directions(side: int) -> None:
    tcp = opened()
    assert tcp.note_reset(side, tcp.streams[side].next_seq, 5, 50)
    assert ended(tcp) == ("reset", side, 5, 50)
    assert tcp.closed
    assert tcp.note_reset(1 - side, tcp.streams[1 - side].next_seq, 6, 60)
    assert ended(tcp) == ("reset", side, 5, 50)


def test_a_reset_after_a_fin_is_told_beside_it() -> None:
    """Who sent the FIN did not send the RST."""
    tcp = opened()
    tcp.note_fin(1, fin_seq(tcp, 1), 5, 50)
    assert (tcp.reset_by, tcp.reset_frame, tcp.reset_ns) == (-1, 0, 0)
    assert tcp.note_reset(0, tcp.streams[0].next_seq, 6, 60)
    assert tcp.note_reset(1, tcp.streams[1].next_seq, 7, 70)
    assert ended(tcp) == ("fin", 1, 5, 50)
    assert (tcp.reset_by, tcp.reset_frame, tcp.reset_ns) == (0, 6, 60)
    assert tcp.closed


def test_a_reset_after_both_fins_changes_nothing() -> None:
    tcp = opened()
    tcp.note_fin(0, fin_seq(tcp, 0), 5, 50)
    tcp.note_fin(1, fin_seq(tcp, 1), 6, 60)
    assert tcp.note_reset(0, tcp.streams[0].next_seq, 7, 70)
    assert ended(tcp) == ("fin", 0, 5, 50)


@each(
    ("distance", "believed"),
    [
        (0, True),
        (-1, True),
        (1, True),
        (65536, True),
        (-65536, True),
        (65537, False),
        (-65537, False),
        (FAR, False),
        (-FAR, False),
        (2**31, False),
        (2**31 - 1, False),
    ],
)
@each("isn", [1000, MASK - 5, 2**31])
def test_a_reset_far_from_the_window_is_not_believed(distance: int, believed: bool, isn: int) -> None:
    tcp = opened(isn)
    assert tcp.note_reset(0, (tcp.streams[0].next_seq + distance) & MASK, 5, 50) is believed
    assert ended(tcp) == (("reset", 0, 5, 50) if believed else ("", -1, 0, 0))
    assert tcp.closed is believed


def test_a_reset_of_a_side_that_was_silent_is_believed() -> None:
    """A refused connection: the other side answers the SYN with a reset of sequence number 0."""
    tcp = TcpConnection(CLIENT, SERVER, 0, 1, 10)
    tcp.initiator = 0
    tcp.streams[0].start(1001)
    assert tcp.note_reset(1, 0, 2, 20)
    assert ended(tcp) == ("reset", 1, 2, 20)
