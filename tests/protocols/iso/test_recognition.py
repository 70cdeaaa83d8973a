from __future__ import annotations

from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso.recognition import (
    HERE,
    OTHER,
    PROBES,
    UNDECIDED,
    WITHIN,
    is_connect_request,
    raw_protocol,
    recognise,
)
from dissect.protocols.iso.upper import TLS, UNKNOWN
from tests.cases import each

CR: Final = bytes.fromhex("0300001611e00000004b00c0010ac1020100c2020103")
READ: Final = bytes.fromhex("0300001f02f080320100002500000e00000401120a10020001000184000000")
HTTP: Final = b"GET / HTTP/1.1\r\n"
HELLO: Final = bytes.fromhex("160301020001000001fc0303")


@each("at_start", [True, False])
@each("on_102", [True, False])
@each("octets", [CR, READ, READ[:9], READ[:4], CR + HTTP])
def test_a_tpkt_is_recognised_on_every_port(octets: bytes, at_start: bool, on_102: bool) -> None:
    assert recognise(octets, at_start, on_102, 0) == HERE


@pytest.mark.parametrize("octets", [b"\x03", b"\x03\x00", b"\x03\x00\x00"])
def test_less_than_a_header_is_believed_at_the_start_only(octets: bytes) -> None:
    for on_102 in (True, False):
        assert recognise(octets, True, on_102, 0) == HERE
        assert recognise(octets, False, on_102, 0) == UNDECIDED


@pytest.mark.parametrize(
    "octets",
    [
        b"\x02",
        b"\x03\x01",
        b"\x03\x00\x00\x06\x02\xf0",
        bytes.fromhex("030000000006010300000001"),  # Modbus, transaction 0x0300
        bytes.fromhex("0300001508020001"),  # Q.931 in a TPKT
        HTTP,
        HELLO,
    ],
)
def test_what_is_no_tpkt(octets: bytes) -> None:
    assert recognise(octets, True, False, 0) == OTHER  # its first octets: that settles it
    assert recognise(octets, False, False, 0) == UNDECIDED
    assert recognise(octets, False, False, PROBES - 2) == UNDECIDED
    assert recognise(octets, False, False, PROBES - 1) == OTHER


def test_port_102_is_given_more_time() -> None:
    for at_start in (True, False):
        verdicts = [recognise(HTTP, at_start, True, probed) for probed in range(64)]
        assert verdicts == [UNDECIDED] * 63 + [OTHER]


def test_a_tpkt_behind_other_octets_is_looked_for_on_port_102_only() -> None:
    for octets in (b"\x99" + READ, b"\x03\x00\x99" + READ + CR, HTTP + CR):
        assert recognise(octets, False, True, 0) == WITHIN
        assert recognise(octets, False, False, 0) == UNDECIDED
    assert recognise(b"\x99" + READ[:-1], False, True, 0) == UNDECIDED  # its end is not there


@pytest.mark.parametrize(
    ("octets", "is_one"),
    [
        (CR, True),
        (CR + READ, True),
        (CR[:7], True),
        (CR[:6], False),
        (READ, False),
        (CR[:5] + b"\xd0" + CR[6:], False),
        (b"\x02" + CR[1:], False),
        (b"\x99" + CR, False),
        (b"", False),
    ],
)
def test_connect_requests(octets: bytes, is_one: bool) -> None:
    assert is_connect_request(octets) is is_one


@pytest.mark.parametrize(("octets", "protocol"), [(HELLO, TLS), (HTTP, UNKNOWN), (b"", UNKNOWN), (READ[7:], UNKNOWN)])
def test_protocols_without_tpkt(octets: bytes, protocol: int) -> None:
    assert raw_protocol(octets) == protocol


@given(st.binary(max_size=40), st.booleans(), st.booleans(), st.integers(0, 100))
def test_any_octets(octets: bytes, at_start: bool, on_102: bool, probed: int) -> None:
    verdict = recognise(octets, at_start, on_102, probed)
    assert verdict in {UNDECIDED, HERE, OTHER} or (verdict == WITHIN and on_102)
    assert isinstance(is_connect_request(octets), bool)
