"""What the builders make is what the parsers read."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso.build import (
    LARGEST_TPDU,
    build_connect,
    build_dc,
    build_dr,
    build_dt,
    build_er,
    build_tpkt,
    build_tsdu,
    size_parameter,
    with_dst_ref,
)
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, Assembler, parse_tpdu
from dissect.protocols.iso.tables import CC, CR, DC, DR, DT, ER
from dissect.protocols.iso.tpkt import Framer

REFERENCES = st.integers(0, 0xFFFF)


@given(st.sampled_from((CR, CC)), REFERENCES, REFERENCES, st.binary(max_size=16), st.binary(max_size=16))
def test_a_connect_is_read_as_it_was_built(type_: int, theirs: int, ours: int, calling: bytes, called: bytes) -> None:
    parameters = [size_parameter(1024), (CALLING_TSAP, calling), (CALLED_TSAP, called)]
    tpdu = parse_tpdu(build_connect(type_, theirs, ours, parameters))
    assert (tpdu.type, tpdu.field("dst_ref"), tpdu.field("src_ref"), tpdu.tpdu_size) == (type_, theirs, ours, 1024)
    assert [(one.code, one.value) for one in tpdu.parameters] == parameters
    assert not tpdu.malformed


def test_a_connect_has_no_more_room_than_a_header() -> None:
    assert parse_tpdu(build_connect(CR, 0, 1, [(CALLED_TSAP, bytes(246))])).malformed == []
    for size in (247, 300):
        with pytest.raises(ValueError, match="which has room for 254"):
            build_connect(CR, 0, 1, [(CALLED_TSAP, bytes(size))])


@given(REFERENCES, REFERENCES, st.integers(0, 255))
def test_the_other_tpdus_are_read_as_they_were_built(theirs: int, ours: int, why: int) -> None:
    dr, dc, er = (
        parse_tpdu(one) for one in (build_dr(theirs, ours, why), build_dc(theirs, ours), build_er(theirs, why))
    )
    assert (dr.type, dr.field("dst_ref"), dr.field("src_ref"), dr.field("reason")) == (DR, theirs, ours, why)
    assert (dc.type, dc.field("dst_ref"), dc.field("src_ref")) == (DC, theirs, ours)
    assert (er.type, er.field("dst_ref"), er.field("cause")) == (ER, theirs, why)
    assert parse_tpdu(with_dst_ref(build_er(theirs, why), ours)).field("dst_ref") == ours
    for eot in (True, False):
        dt = parse_tpdu(build_dt(b"abc", eot))
        assert (dt.type, dt.field("eot"), dt.data) == (DT, eot, b"abc")


@given(st.binary(min_size=1, max_size=400), st.integers(0, 200))
def test_a_tsdu_is_put_together_again(tsdu: bytes, tpdu_size: int) -> None:
    framer, assembler = Framer(), Assembler()
    framer.synced = True
    framer.push(build_tsdu(tsdu, tpdu_size), 0, True)
    found = []
    for packet in framer.packets:
        tpdu = parse_tpdu(packet[4:])
        assert len(packet) - 4 <= max(tpdu_size, 4)
        found.append(assembler.push(tpdu.data, tpdu.field("eot") == 1))
    assert found[-1] == tsdu
    assert not any(found[:-1])


@pytest.mark.parametrize(
    ("size", "value"),
    [
        (128, b"\x07"),
        (1024, b"\x0a"),
        (8192, b"\x0d"),
        (LARGEST_TPDU, b"\x10"),
        (384, b"\x03"),
        (16384, b"\x80"),
        (64, b"\0"),
    ],
)
def test_a_tpdu_size_is_said_by_code_or_by_number(size: int, value: bytes) -> None:
    assert size_parameter(size)[1] == value
    if size >= 128:
        assert parse_tpdu(build_connect(CR, 0, 1, [size_parameter(size)])).tpdu_size == size


def test_a_tpkt_counts_itself() -> None:
    assert build_tpkt(b"\x02\xf0\x80") == b"\x03\0\0\x07\x02\xf0\x80"
