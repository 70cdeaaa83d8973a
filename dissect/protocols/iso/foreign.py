"""Describes messages of protocols other than S7 for reports: TLS, MMS and ICCP, RDP (reference section 1.4).

Only what identifies the message and its peers is decoded. Texts from the wire are escaped and cut to `MAX_TEXT` characters. No
octets raise an error.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso.upper import (
    CONFIRMED_ERROR,
    CONFIRMED_REQUEST,
    CONFIRMED_RESPONSE,
    INITIATE_ERROR,
    INITIATE_REQUEST,
    INITIATE_RESPONSE,
    MMS,
    RDP,
    TLS,
    UNCONFIRMED,
    UNKNOWN,
)
from dissect.protocols.tls.handshake import record_words
from dissect.wire.text import shortened

#: Maximum number of characters of a text that are shown.
MAX_TEXT: Final = 200
#: This many of the first octets of an unknown message are shown.
_FIRST: Final = 8

#: ISO session SPDUs (X.225) by their first octet.
_SPDUS: Final = {0x0D: "CONNECT", 0x0E: "ACCEPT", 0x0C: "REFUSE", 0x09: "FINISH", 0x0A: "DISCONNECT", 0x19: "ABORT"}
#: MMS PDUs in a TSDU without a session, by their tag.
_PDUS: Final = {
    CONFIRMED_REQUEST: "confirmed request",
    CONFIRMED_RESPONSE: "confirmed response",
    CONFIRMED_ERROR: "confirmed error",
    UNCONFIRMED: "unconfirmed PDU",
    INITIATE_REQUEST: "initiate request",
    INITIATE_RESPONSE: "initiate response",
    INITIATE_ERROR: "initiate error",
}
_CONNECT: Final = 0x0D
_AARQ: Final = 0x60
_CONTEXT: Final = 0xA1
_CALLED_TITLE: Final = 0xA2
_CALLING_TITLE: Final = 0xA6
_OID: Final = 0x06

_RDP_SECURITY: Final = {1: "TLS", 2: "CredSSP", 4: "RDSTLS", 8: "CredSSP with early authorisation", 16: "RDS AAD"}
_COOKIE: Final = b"Cookie: "


def identify(upper: i64, octets: bytes, start: i64, end: i64) -> str:
    """Return what identifies the TSDU ``octets[start:end]`` of protocol ``upper``; empty if nothing does."""
    tsdu = octets[start:end]
    if upper == TLS:
        return record_words(tsdu)
    if upper == MMS:
        return _mms(tsdu)
    if upper == RDP:
        return "T.125 connect-initial" if tsdu[1:2] == b"\x65" else "T.125 connect-response"
    if upper == UNKNOWN and tsdu:
        return f"begins with {tsdu[:_FIRST].hex(' ')}"
    return ""


def identify_connect(variable: bytes) -> str:
    """Return the content of the variable part of an RDP CR or CC: its cookie, and the requested or chosen security."""
    said: list[str] = []
    at: i64 = 0
    if variable.startswith(_COOKIE):
        end: i64 = variable.find(b"\r\n")
        cookie = variable[len(_COOKIE) : end if end >= 0 else len(variable)]
        said.append(f"cookie {_text(cookie)}")
        at = end + 2 if end >= 0 else len(variable)
    if len(variable) >= at + 8:
        kind: i64 = variable[at]
        number: i64 = int.from_bytes(variable[at + 4 : at + 8], "little")
        if kind == 1:
            said.append(f"asks for {_security(number)}")
        elif kind == 2:
            said.append(f"chooses {_security(number)}")
        elif kind == 3:
            said.append(f"refuses, failure code {number}")
    return ", ".join(said)


def _security(protocols: int) -> str:
    names = [name for bit, name in _RDP_SECURITY.items() if protocols & bit]
    return " or ".join(names) if names else "standard RDP security"


def _text(octets: bytes) -> str:
    return shortened(octets[: MAX_TEXT + 1].decode("latin-1"), MAX_TEXT)


# ---- MMS and ICCP ---------------------------------------------------------------------------------------------------


def _mms(octets: bytes) -> str:
    """Return the name of the SPDU; for a CONNECT also application context and AP titles, which differ between MMS and ICCP."""
    if octets[0] == 1:
        return "DATA TRANSFER"
    if octets[0] in _PDUS:
        return f"{_PDUS[octets[0]]} without a session"
    name = _SPDUS.get(octets[0], f"SPDU 0x{octets[0]:02x}")
    said = _association(octets) if octets[0] == _CONNECT else ""
    return f"{name}, {said}" if said else name


def _association(octets: bytes) -> str:
    """Return application context and AP titles of the AARQ in a CONNECT, empty if there is no AARQ."""
    at: i64 = octets.find(bytes((_AARQ,)))
    while at >= 0:
        body = _value(octets, at)
        if body and body[0] in (0x80, _CONTEXT):
            said = _titles(body)
            if said:
                return said
        at = octets.find(bytes((_AARQ,)), at + 1)
    return ""


def _titles(body: bytes) -> str:
    said: list[str] = []
    at: i64 = 0
    size: i64 = len(body)
    while at + 2 <= size and len(said) < 3:
        tag: i64 = body[at]
        value = _value(body, at)
        oid = _oid(_value(value, 0)) if value and value[0] == _OID else ""
        if tag == _CONTEXT:
            if not oid:
                return ""  # not an AARQ
            said.append(f"application context {oid}")
        elif (tag == _CALLED_TITLE or tag == _CALLING_TITLE) and value:
            who = "called" if tag == _CALLED_TITLE else "calling"
            said.append(f"{who} AP title {oid or value[:16].hex()}")
        at += _size(body, at)
    return ", ".join(said)


def _size(octets: bytes, at: i64) -> i64:
    """Return the size of the BER element at ``at``, tag and length included."""
    first: i64 = octets[at + 1]
    if first < 0x80:
        return 2 + first
    count: i64 = first & 0x7F
    if count == 0 or count > 2 or at + 2 + count > len(octets):
        return len(octets) - at
    return 2 + count + int.from_bytes(octets[at + 2 : at + 2 + count], "big")


def _value(octets: bytes, at: i64) -> bytes:
    """Return the value of the BER element at ``at``, as far as it is present."""
    if at + 2 > len(octets):
        return b""
    first: i64 = octets[at + 1]
    head: i64 = 2 if first < 0x80 else 2 + (first & 0x7F)
    return octets[at + head : at + _size(octets, at)]


def _oid(octets: bytes) -> str:
    """Return an object identifier in dotted notation."""
    numbers: list[int] = []
    value = 0
    for octet in octets[:32]:
        value = value << 7 | octet & 0x7F
        if octet < 0x80:
            numbers.append(value)
            value = 0
    if not numbers:
        return ""
    first = min(numbers[0] // 40, 2)
    return ".".join([str(number) for number in (first, numbers[0] - 40 * first, *numbers[1:])])
