from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.ibh.layouts import MPI_LONG, MPI_SHORT
from dissect.protocols.ibh.packet import parse_packet
from dissect.protocols.ibh.tables import KINDS
from dissect.wire.malformed import LIMITS, REASONS
from tests.engine.transactions.talk import dbw, read, words
from tests.protocols.ibh.packets import ACK, ASK, DISCONNECT, SEEN, TELL, long, packet, short


@pytest.mark.parametrize(("octets", "kind", "function", "name"), SEEN)
def test_what_is_known_to_be_sent(octets: str, kind: str, function: int, name: str) -> None:
    read = parse_packet(bytes.fromhex(octets))
    assert (KINDS[read.kind], read.function, read.name) == (kind, function, name)
    assert read.malformed == []
    assert read.data == b""


def test_data_in_both_forms_of_the_header() -> None:
    asked, told = parse_packet(ASK), parse_packet(TELL)
    assert (asked.mpi, asked.data_at, asked.data) == (MPI_SHORT, 15, read(1, dbw(1, 0)))
    assert (told.mpi, told.data_at, told.data) == (MPI_LONG, 17, words(1, 42))
    assert (asked.src_conn, asked.dst_conn, asked.station, asked.mpi_number, asked.number) == (20, 20, 2, 1, 4)
    assert (told.s_flags, told.r_flags, asked.r_flags) == (0, 0x02C2, 0x0082)


def test_a_fragment_says_that_more_comes() -> None:
    read = parse_packet(long(0xF0, b"\x32\x03"))
    assert (KINDS[read.kind], read.data, read.name) == ("mpi_fragment", b"\x32\x03", "MPI data, more to come")


def test_an_acknowledgement_names_a_packet_and_a_disconnect_has_no_number() -> None:
    assert parse_packet(ACK).acked == 7
    read = parse_packet(DISCONNECT)
    assert (read.function, read.mpi_number, read.acked) == (0x80, -1, -1)


@pytest.mark.parametrize("function", [0x00, 0x32, 0xF2])
def test_an_unknown_function_is_named_by_its_number(function: int) -> None:
    read = parse_packet(short(function, b"\x01"))
    assert (KINDS[read.kind], read.name, read.malformed) == ("mpi_other", f"MPI 0x{function:02x}", [])


@pytest.mark.parametrize(
    "whole", [ASK, TELL, ACK, short(0xF1), long(0xF1)], ids=["ask", "tell", "ack", "short", "long"]
)
def test_cut_at_every_octet(whole: bytes) -> None:
    full = parse_packet(whole)
    for size in range(len(whole)):
        cut = parse_packet(whole[:size])
        assert cut.malformed[0].reason == ("too_short" if size < 8 else "length_beyond")
        assert full.data.startswith(cut.data)
        assert cut.function in {full.function, -1}


def test_octets_behind_the_packet() -> None:
    read = parse_packet(ASK + b"\x00")
    assert [fact.reason for fact in read.malformed] == ["trailing_octets"]
    assert read.data == parse_packet(ASK).data


@pytest.mark.parametrize(("wrong", "reason"), [(1, "length_beyond"), (-1, "trailing_octets")])
def test_lengths_that_disagree(wrong: int, reason: str) -> None:
    octets = bytearray(ASK)
    octets[12] += wrong
    read = parse_packet(bytes(octets))
    assert [(fact.layer, fact.reason, fact.offset) for fact in read.malformed] == [("MPI", reason, 12)]
    assert read.data == parse_packet(ASK).data[: len(read.data)]
    assert len(read.data) == len(parse_packet(ASK).data) + min(wrong, 0)


def test_data_without_a_number() -> None:
    read = parse_packet(packet(b"\x14\x14\x02\x00\x01\xf1", 0x82))
    assert [fact.reason for fact in read.malformed] == ["length_below"]
    assert read.data == b""


def test_a_header_that_has_no_room() -> None:
    read = parse_packet(packet(b"\x14\x14\x02", 0x82))
    assert [(fact.layer, fact.reason) for fact in read.malformed] == [("MPI", "too_short")]


FLAGS = st.sampled_from([b"\x00\x00\x82\x00", b"\x00\x00\xc2\x02", b"\x82\x00\x00\x00", b"\x00\x00\x97\x00"])


@given(
    st.one_of(
        st.binary(max_size=300),
        st.builds(lambda a, f, b: a + f + b, st.binary(min_size=4, max_size=4), FLAGS, st.binary(max_size=280)),
    )
)
def test_never_raises(octets: bytes) -> None:
    read = parse_packet(octets)
    assert 0 <= read.kind < len(KINDS)
    assert read.name
    assert read.data == octets[read.data_at : read.data_at + len(read.data)]
    for fact in read.malformed:
        assert str(fact)
        assert fact.reason in REASONS
        assert fact.limit in LIMITS
