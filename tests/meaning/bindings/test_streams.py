"""A stream cut into messages; whole connections are in test_engine.py."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import Backlog
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.meaning.bindings.binding import Binding
from dissect.meaning.bindings.streams import MAX_PENDING, cut_stream, skip_hole
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from tests.meaning.bindings import plant

MESSAGES = Binding("x", "tcp", "messages", port=5601)
ASK = plant.ask("Расход 1")
#: The begin of a message of 61440 octets.
ENDLESS = bytes.fromhex("DC0207004160000000F0")


def a_side(*, synced: bool = False) -> Side:
    tcp = TcpConnection(Endpoint(b"\x0a\0\0\1", 1), Endpoint(b"\x0a\0\0\2", 2), 0, 1, 1)
    side = Side(0, b"", tcp, Connection(1, tcp), Protocol())
    side.kept = Backlog()
    side.framer.synced = synced
    return side


def cut(side: Side, *pieces: bytes, binding: Binding = MESSAGES) -> tuple[list[bytes], int]:
    units: list[bytes] = []
    skipped = 0
    for piece in pieces:
        found, stepped = cut_stream(side, plant.codec().envelope, binding, piece)
        units += found
        skipped += stepped
    backlog = side.kept
    assert isinstance(backlog, Backlog)
    assert (backlog.skipped, backlog.framed) == (skipped, sum(len(unit) for unit in units))
    assert backlog.framed + backlog.skipped + len(backlog.octets) == sum(len(piece) for piece in pieces)
    return units, skipped


@pytest.mark.parametrize("synced", [True, False])
def test_octet_by_octet(synced: bool) -> None:
    pieces = [bytes((octet,)) for octet in ASK * 3]
    assert cut(a_side(synced=synced), *pieces) == ([ASK] * 3, 0)


def test_in_step_a_wrong_checksum_is_a_message_out_of_step_it_is_none() -> None:
    broken = ASK[:-1] + bytes((ASK[-1] ^ 1,))
    assert cut(a_side(synced=True), broken + ASK) == ([broken, ASK], 0)
    assert cut(a_side(), broken + ASK) == ([ASK], len(broken))


def test_out_of_step_after_something_else() -> None:
    assert cut(a_side(synced=True), ASK + b"GET /" + ASK) == ([ASK, ASK], 5)


@given(st.lists(st.sampled_from([ENDLESS, ENDLESS[:1], b"\xdc\xdc", ASK[:5], b"no"]), max_size=8), st.data())
def test_what_never_ends_hides_nothing_however_it_is_cut(junk: list[bytes], data: st.DataObject) -> None:
    octets = b"".join(junk) + ASK + ASK
    places = data.draw(st.lists(st.integers(0, len(octets)), max_size=6))
    pieces = [octets[begin:end] for begin, end in pairwise(sorted({0, *places, len(octets)}))]
    assert cut(a_side(), *pieces) == ([ASK, ASK], len(octets) - 2 * len(ASK))


def test_places_that_are_waited_for_are_bounded() -> None:
    side = a_side()
    assert cut(side, ENDLESS * (MAX_PENDING + 50) + ASK) == ([], 0)
    backlog = side.kept
    assert isinstance(backlog, Backlog)
    assert len(backlog.pending) == MAX_PENDING
    units, skipped = cut_stream(side, plant.codec().envelope, MESSAGES, bytes(0xF000 + 12 + 10 * MAX_PENDING))
    assert (units, skipped) == ([ASK], 10 * (MAX_PENDING + 50) + 0xF000 + 12 + 10 * MAX_PENDING)


@given(st.integers(0, 20), st.integers(1, 50), st.lists(st.integers(1, 9), max_size=5))
def test_equal_contents_step_over_holes(first: int, hole: int, more: list[int]) -> None:
    """Where the stream begins with a content, each one behind a hole that is whole is found at its place."""
    bound = Binding("x", "tcp", "struct", "pump_t", "pump_t", (0x0040, 0), 3, port=5601)
    side = a_side()
    envelope = plant.codec().envelope
    octets = bytes(range(250))
    units, _ = cut_stream(side, envelope, bound, octets[:first])
    skip_hole(side, bound, hole)
    at = first + hole
    for size in [*more, 60]:
        found, _ = cut_stream(side, envelope, bound, octets[at : at + size])
        units += found
        at += size
    holed = set(range(first, first + hole))
    assert units == [octets[n : n + 3] for n in range(0, at - 2, 3) if not holed & {n, n + 1, n + 2}]


def test_a_hole_inside_a_hole() -> None:
    bound = Binding("x", "tcp", "struct", "pump_t", "pump_t", (0x0040, 0), 3, port=5601)
    side = a_side()
    assert skip_hole(side, bound, 1) == 0
    assert skip_hole(side, bound, 3) == 0
    assert cut_stream(side, plant.codec().envelope, bound, b"abXYZ") == ([b"XYZ"], 2)
