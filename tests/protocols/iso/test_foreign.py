from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.iso.foreign import MAX_TEXT, identify, identify_connect
from dissect.protocols.iso.upper import EMPTY, MMS, RDP, S7COMM, TLS, UNKNOWN, classify
from tests.cases import each


def extension(kind: int, value: bytes) -> bytes:
    return kind.to_bytes(2, "big") + len(value).to_bytes(2, "big") + value


def server_name(name: bytes) -> bytes:
    entry = b"\x00" + len(name).to_bytes(2, "big") + name
    return extension(0, len(entry).to_bytes(2, "big") + entry)


def hello(kind: int, *extensions: bytes, version: int = 0x0303, session: bytes = b"") -> bytes:
    """A handshake record with a ClientHello (1) or ServerHello (2)."""
    body = version.to_bytes(2, "big") + bytes(32) + bytes((len(session),)) + session
    body += b"\x00\x04\x13\x01\x13\x02\x01\x00" if kind == 1 else b"\x13\x01\x00"
    every = b"".join(extensions)
    body += len(every).to_bytes(2, "big") + every
    message = bytes((kind,)) + len(body).to_bytes(3, "big") + body
    return b"\x16\x03\x01" + len(message).to_bytes(2, "big") + message


#: An association request with application context 1.0.9506.2.3 and both AP titles.
AARQ = bytes.fromhex("60 1b 80 02 07 80 a1 07 06 05 28 ca 22 02 03 a2 04 06 02 29 02 a6 06 06 04 29 01 87 67")
USER_DATA = b"\x05\x06\x13\x01\x00\x16\x01\x02\xc1" + bytes((len(AARQ),)) + AARQ
CONNECT = b"\x0d" + bytes((len(USER_DATA),)) + USER_DATA


def said(octets: bytes) -> str:
    return identify(classify(octets, 0, len(octets)), octets, 0, len(octets))


@each(
    ("octets", "text"),
    [
        (hello(1), "TLS 1.2 ClientHello"),
        (hello(1, server_name(b"plc-1.plant")), "TLS 1.2 ClientHello, server name plc-1.plant"),
        (
            hello(1, extension(10, b"\x00\x02\x00\x1d"), server_name(b"plc"), extension(43, b"\x04\x9a\x9a\x03\x04")),
            "TLS 1.3 ClientHello, server name plc",
        ),
        (hello(2, extension(43, b"\x03\x04"), session=bytes(32)), "TLS 1.3 ServerHello"),
        (hello(2, server_name(b"plc")), "TLS 1.2 ServerHello"),
        (hello(1, server_name(b"\x1b[2J\xe9")), "TLS 1.2 ClientHello, server name \\x1b[2Jé"),
        (b"\x16\x03\x03\x00\x10\x0b" + bytes(15), "TLS 1.2 Certificate"),
        (b"\x16\x03\x03\x00\x10\xaa" + bytes(15), "TLS 1.2 handshake"),
        (b"\x17\x03\x03\x00\x02ab", "TLS 1.2 or 1.3 application data"),
        (b"\x15\x03\x01\x00\x02\x02\x28", "TLS 1.0 alert"),
        (b"\x14\x03\x09\x00\x01\x01", "version 0x0309 change cipher spec"),
        (b"\x16\x03\x01", ""),
        (CONNECT, "CONNECT, application context 1.0.9506.2.3, called AP title 1.1.2, calling AP title 1.1.1.999"),
        (b"\x0e\x02\x00\x00", "ACCEPT"),
        (b"\x19\x00", "ABORT"),
        (b"\x01\x00\x01\x00\x61\x03\x30\x01\x00", "DATA TRANSFER"),
        (b"\x0d\x04\x60\x7f\x60\x82", "CONNECT"),
        (b"\x7f\x65\x82", "T.125 connect-initial"),
        (b"\x7f\x66\x82", "T.125 connect-response"),
        (b"what is this", "begins with 77 68 61 74 20 69 73 20"),
        (b"", ""),
        (b"\x32\x01\x00", ""),
    ],
)
def test_what_tells_a_protocol(octets: bytes, text: str) -> None:
    assert said(octets) == text


@pytest.mark.parametrize(
    ("variable", "text"),
    [
        (b"Cookie: mstshash=op\r\n\x01\x00\x08\x00\x03\x00\x00\x00", "cookie mstshash=op, asks for TLS or CredSSP"),
        (b"Cookie: mstshash=op\r\n", "cookie mstshash=op"),
        (b"Cookie: \x1b]0;x\x07", "cookie \\x1b]0;x\\x07"),
        (b"\x01\x00\x08\x00\x00\x00\x00\x00", "asks for standard RDP security"),
        (b"\x02\x00\x08\x00\x02\x00\x00\x00", "chooses CredSSP"),
        (b"\x03\x00\x08\x00\x05\x00\x00\x00", "refuses, failure code 5"),
        (b"\xc1\x02\x01\x00", ""),
    ],
)
def test_what_an_rdp_connect_says(variable: bytes, text: str) -> None:
    assert identify_connect(variable) == text


def test_mms_without_a_session() -> None:
    for octets, text in (
        ("a90d810103820103a4058003050100", "initiate response without a session"),
        ("a10a020100a405a103800100", "confirmed response without a session"),
    ):
        tsdu = bytes.fromhex(octets)
        assert identify(classify(tsdu, 0, len(tsdu)), tsdu, 0, len(tsdu)) == text


def test_texts_are_bounded() -> None:
    assert len(said(hello(1, server_name(b"a" * 5000)))) < MAX_TEXT + 100
    assert len(identify_connect(b"Cookie: " + b"\x00" * 5000)) < 5 * MAX_TEXT


@pytest.mark.parametrize("octets", [hello(1, server_name(b"plc"), extension(43, b"\x02\x03\x04")), CONNECT])
def test_cut_at_every_octet(octets: bytes) -> None:
    upper = classify(octets, 0, len(octets))
    for size in range(1, len(octets)):
        assert isinstance(identify(upper, octets, 0, size), str)
        assert isinstance(identify(upper, octets[:size] + b"\xff" * 8, 0, size + 8), str)


@given(st.sampled_from([S7COMM, MMS, TLS, RDP, UNKNOWN, EMPTY]), st.binary(max_size=120))
def test_never_raises(upper: int, octets: bytes) -> None:
    text = identify(upper, b"\x16" + octets, 0, 1 + len(octets)) + identify_connect(octets)
    assert text.isprintable()


@given(st.integers(0, 120), st.binary(max_size=6), st.sampled_from([hello(1, server_name(b"plc")), CONNECT]))
def test_damaged(at: int, octets: bytes, whole: bytes) -> None:
    damaged = whole[:at] + octets + whole[at + len(octets) :]
    assert identify(TLS if whole[0] == 0x16 else MMS, damaged, 0, len(damaged)).isprintable()
