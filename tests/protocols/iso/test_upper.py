from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso.upper import (
    EMPTY,
    MMS,
    RDP,
    S7COMM,
    S7COMM_PLUS,
    SCD,
    TLS,
    UNKNOWN,
    UPPER_NAMES,
    classify,
    is_rdp_connect,
)
from tests.cases import each

#: An initiate request: local detail, jobs calling and called, nesting, and version, parameters and services.
INITIATE = (
    "a826" + "8002001f" + "810103" + "820103" + "83020808" + "a416" + "800101" + "810305e800" + "820c03" + "ff" * 11
)

CASES = [
    ("", EMPTY),
    # S7comm: protocol id and ROSCTR.
    ("3201000025000000", S7COMM),
    ("3202", S7COMM),
    ("3203", S7COMM),
    ("3207", S7COMM),
    ("32", UNKNOWN),
    ("3200", UNKNOWN),
    ("3208", UNKNOWN),
    ("32ff", UNKNOWN),
    # S7comm-plus, whose opcodes look like S7comm's protocol id.
    ("7201002f32", S7COMM_PLUS),
    ("7202", S7COMM_PLUS),
    ("72030010203200", S7COMM_PLUS),
    ("72fe0000", S7COMM_PLUS),
    ("72ff0700", S7COMM_PLUS),  # the keep-alive has four octets, no more
    ("72ff070000", UNKNOWN),
    ("72", UNKNOWN),
    ("7204", UNKNOWN),
    ("7200", UNKNOWN),
    # TLS records: change cipher, alert, handshake, data.
    ("140303000101", TLS),
    ("1503030002", TLS),
    ("1603010200", TLS),
    ("1703030100", TLS),
    ("16", UNKNOWN),
    ("1604", UNKNOWN),
    ("1303", UNKNOWN),
    ("1803", UNKNOWN),
    # MMS and ICCP on ISO session.
    ("0100010061808080", MMS),
    ("0100010061", MMS),
    ("01000100", UNKNOWN),
    ("0100010060", UNKNOWN),  # session data, but no presentation user data
    ("0100020061", UNKNOWN),
    ("0d03050102", MMS),  # connect
    ("0dff0100" + "00" * 256, MMS),  # a long length
    ("0e020000", MMS),  # accept
    ("0c00", MMS),  # refuse
    ("1900", MMS),  # abort
    ("1800", UNKNOWN),
    ("1a00", UNKNOWN),
    ("0900", MMS),  # finish
    ("0a00", MMS),  # disconnect
    ("1903110101", MMS),  # abort
    ("0d05050102", UNKNOWN),  # longer than the TSDU
    ("0d", UNKNOWN),
    ("0b00", UNKNOWN),
    # MMS without a session: initiate, confirmed and unconfirmed PDUs whose lengths fit and that have what they must have.
    (INITIATE, MMS),
    (INITIATE.replace("a826", "a8820026", 1), MMS),  # a long length
    ("a90d810103820103a4058003050100", MMS),
    ("aa05a003840101", MMS),
    ("a005020101a405", UNKNOWN),  # an inner length reaches beyond it
    ("a017020101a412a110a00e300ca00a800824" + "4d534724312424", MMS),
    ("a007020101bf470100", MMS),  # a service of a high number
    ("a10a020100a405a103800100", MMS),
    ("a20880010aa203a00187", MMS),
    ("a305a003800100", MMS),
    (INITIATE[:-2], UNKNOWN),  # cut
    (INITIATE + "00", UNKNOWN),  # longer than it says
    ("a900", UNKNOWN),
    ("a903810103", UNKNOWN),  # lacks what is mandatory
    ("a003020101", UNKNOWN),  # no service
    ("a0060401010a0101", UNKNOWN),  # begins with no invoke id
    ("a0800201010000", UNKNOWN),  # without a definite length
    ("a3028000", UNKNOWN),
    ("a4050000000000", UNKNOWN),
    # RDP: T.125 connect-initial and connect-response.
    ("7f658201", RDP),
    ("7f668201", RDP),
    ("7f67", UNKNOWN),
    ("7f", UNKNOWN),
    # Q.931 of H.323, a Modbus header, FETCH/WRITE, text.
    ("080200010504", UNKNOWN),
    ("030000000006010300000001", UNKNOWN),
    ("533500010103060104", UNKNOWN),
    (b"SSH-2.0".hex(), UNKNOWN),
]


@each(("octets", "protocol"), CASES)
def test_first_octets_name_the_protocol(octets: str, protocol: int) -> None:
    tsdu = bytes.fromhex(octets)
    assert classify(tsdu, 0, len(tsdu)) == protocol
    # Only what lies within the bounds counts.
    for behind in (b"\x01\x00\x01\x00\x61", b"\x32\x01", b"\x03\x03"):
        assert classify(b"\x02\xf0\x80" + tsdu + behind, 3, 3 + len(tsdu)) == protocol


def test_names() -> None:
    assert [UPPER_NAMES[number] for number in (S7COMM, S7COMM_PLUS, MMS, TLS, RDP, UNKNOWN, EMPTY, SCD)] == UPPER_NAMES
    assert UPPER_NAMES == ["s7comm", "s7comm_plus", "mms", "tls", "rdp", "unknown", "empty", "scd"]


@given(st.binary(max_size=12), st.integers(0, 12))
def test_any_octets(octets: bytes, start: int) -> None:
    start = min(start, len(octets))
    named = classify(octets, start, len(octets))
    assert 0 <= named < len(UPPER_NAMES)
    assert (named == EMPTY) is (start == len(octets))


@pytest.mark.parametrize(
    ("variable", "rdp"),
    [
        (b"Cookie: mstshash=eltons\r\n", True),
        (b"Cookie: mstshash=eltons\r\n\x01\x00\x08\x00\x03\x00\x00\x00", True),
        (b"\x01\x00\x08\x00\x0b\x00\x00\x00", True),  # request
        (b"\x02\x1f\x08\x00\x02\x00\x00\x00", True),  # response
        (b"\x03\x00\x08\x00\x05\x00\x00\x00", True),  # failure
        (b"\x04\x00\x08\x00\x05\x00\x00\x00", False),
        (b"\x01\x00\x08\x00\x0b\x00\x00", False),
        (b"\x01\x00\x00\x08\x0b\x00\x00\x00", False),
        (b"cookie: ", False),
        (b"", False),
        (bytes.fromhex("c0010ac1020100c2020102"), False),
        (bytes.fromhex("c1020100c2020102c0010a"), False),
    ],
)
def test_rdp_connect(variable: bytes, rdp: bool) -> None:
    assert is_rdp_connect(variable) is rdp
