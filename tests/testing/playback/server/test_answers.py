"""Messages the fake PLC makes itself."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso.build import build_tpkt, build_tsdu
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, Assembler, parse_tpdu
from dissect.protocols.iso.tables import CC
from dissect.protocols.iso.tpkt import Framer
from dissect.protocols.s7.message import parse_pdu
from dissect.testing.playback.server.answers import confirm, grant, refuse
from dissect.testing.talk import error, setup

CR = "e00000000700"
TSAPS = "c1020100c2020102"


def cr(variable: str) -> bytes:
    octets = bytes.fromhex(CR + variable)
    return bytes((len(octets),)) + octets


@pytest.mark.parametrize(
    ("asked", "recorded", "says", "size"),
    [
        ("c0010a" + TSAPS, "11d00001000100c0010ac1020100c2020102", "11d00007000100c0010ac1020100c2020102", 1024),
        ("c00109" + TSAPS, "11d00001000100c0010ac1020100c2020102", "11d00007000100c00109c1020100c2020102", 512),
        ("c0010d" + TSAPS, "11d00001000100c0010ac1020100c2020102", "11d00007000100c0010ac1020100c2020102", 1024),
        (
            "c2020303c1021111c0010a",
            "11d00001002a00c1020100c2020102c0010a",
            "11d00007002a00c1021111c2020303c0010a",
            1024,
        ),
        ("c0010a", "11d00001000100c0010ac1020100c2020102", "09d00007000100c0010a", 1024),
        ("c10b" + "41" * 11, "0ed00001000100c0010ac1020100c2020102", "13d00007000100c0010ac10b" + "41" * 11, 1024),
        ("c0010a" + TSAPS, "", "11d00007000100c0010ac1020100c2020102", 1024),
        (TSAPS, "", "11d00007000100c0010ac1020100c2020102", 1024),
        ("f00108" + TSAPS, "0ad00001000100f00110", "09d00007000100f00108", 1024),
    ],
)
def test_a_connection_is_confirmed_as_recorded_for_who_asks(asked: str, recorded: str, says: str, size: int) -> None:
    told = confirm(parse_tpdu(cr(asked)), bytes.fromhex(recorded))
    if asked.startswith("c10b"):  # a recorded length that was wrong does not matter: what is there is read
        assert told.tpdu_size == size
        return
    assert told.tpdu.hex() == says
    assert told.tpdu_size == size


@pytest.mark.parametrize("recorded", ["", "11d00001000100c0010ac1020100c2020102"])
def test_a_request_whose_tsaps_fill_its_header_is_confirmed(recorded: str) -> None:
    asked = cr("c178" + "41" * 0x78 + "c27c" + "42" * 0x7C)
    assert len(asked) == 255
    told = parse_tpdu(confirm(parse_tpdu(asked), bytes.fromhex(recorded)).tpdu)
    assert (told.type, told.malformed, told.field("dst_ref")) == (CC, [], 7)


@given(st.binary(max_size=60), st.binary(max_size=60))
def test_any_request_can_be_confirmed(asked: bytes, recorded: bytes) -> None:
    told = confirm(parse_tpdu(bytes((6 + len(asked), 0xE0, 0, 0, 0, 7, 0)) + asked), recorded)
    found = parse_tpdu(told.tpdu)
    assert (found.type, found.malformed, found.field("dst_ref")) == (CC, [], 7)
    assert 128 <= told.tpdu_size <= 65_531 or told.tpdu_size % 128 == 0


@given(st.binary(min_size=1, max_size=5000), st.sampled_from([128, 256, 1024, 65_531]))
def test_a_message_goes_in_as_many_tpdus_as_it_takes(tsdu: bytes, size: int) -> None:
    framer, assembler = Framer(), Assembler()
    framer.synced = True
    framer.push(build_tsdu(tsdu, size), 0, True)
    assert all(len(packet) - 4 <= size for packet in framer.packets)
    joined = [assembler.push(packet[7:], packet[6] >= 0x80) for packet in framer.packets]
    assert joined[-1] == tsdu
    assert set(joined[:-1]) <= {None}


def test_refusals_are_what_devices_send() -> None:
    job = parse_pdu(bytes.fromhex("3201000009010001000029"))
    assert refuse(job).hex() == "320200000901000000008104"  # reference, worked example of an Ack
    userdata = parse_pdu(bytes.fromhex("32070000050000080008000112041144010 0ff09000400110000".replace(" ", "")))
    told = parse_pdu(refuse(userdata, 0xD402))
    assert told.malformed == []
    assert told.octets.hex() == "3207000005000" + "00c0004" + "000112081284010000" + "00d402" + "0a000000"


def test_a_setup_that_was_refused_is_refused() -> None:
    asked = parse_pdu(setup(960).octets)
    refusal = error(0x8001).build(asked)
    assert grant(asked, refusal) == refusal
    assert parse_pdu(grant(parse_pdu(asked.octets[:13]), b"")).error_class == 0x81


def test_tsap_parameters_are_those_of_the_request() -> None:
    asked = parse_tpdu(cr("c0010a" + TSAPS))
    told = parse_tpdu(confirm(asked, b"").tpdu)
    assert [told.parameter(code) for code in (CALLING_TSAP, CALLED_TSAP)] == [b"\x01\x00", b"\x01\x02"]
    assert build_tpkt(b"\x02\xf0\x80") == b"\x03\x00\x00\x07\x02\xf0\x80"
