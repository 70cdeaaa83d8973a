"""Recognises the protocol of a TSDU by its first octets (reference section 1.4)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.octets import u16

S7COMM: Final = 0
S7COMM_PLUS: Final = 1
MMS: Final = 2
TLS: Final = 3
RDP: Final = 4
UNKNOWN: Final = 5
EMPTY: Final = 6
SCD: Final = 7  # found only by a binding, because the octets do not show it

#: Names for reports, by the numbers above.
UPPER_NAMES: Final[list[str]] = ["s7comm", "s7comm_plus", "mms", "tls", "rdp", "unknown", "empty", "scd"]

#: ISO session SPDUs (X.225): connect, accept, refuse, finish, disconnect, abort.
_SESSION: Final = frozenset((0x0D, 0x0E, 0x0C, 0x09, 0x0A, 0x19))

# MMS PDUs (ISO 9506-2) by their BER tag, as they come in a TSDU without a session.
CONFIRMED_REQUEST: Final = 0xA0
CONFIRMED_RESPONSE: Final = 0xA1
CONFIRMED_ERROR: Final = 0xA2
UNCONFIRMED: Final = 0xA3
INITIATE_REQUEST: Final = 0xA8
INITIATE_RESPONSE: Final = 0xA9
INITIATE_ERROR: Final = 0xAA

_INTEGER: Final = 0x02
#: Elements of an initiate: local detail [0], jobs calling [1] and called [2], nesting [3], detail [4]; [0], [3] are optional.
_INITIATE_TAGS: Final = frozenset(
    ((0x81, 0x82, 0xA4), (0x80, 0x81, 0x82, 0xA4), (0x81, 0x82, 0x83, 0xA4), (0x80, 0x81, 0x82, 0x83, 0xA4))
)
#: No PDU that is recognised has more elements.
_MOST_ELEMENTS: Final = 5


def classify(octets: bytes, start: i64, end: i64) -> i64:
    """Return the protocol number of the TSDU ``octets[start:end]``."""
    size: i64 = end - start
    if size == 0:
        return EMPTY
    first: i64 = octets[start]
    second: i64 = octets[start + 1] if size > 1 else -1
    if first == 0x32:
        return S7COMM if 1 <= second <= 7 else UNKNOWN
    if first == 0x72:
        if second == 0xFF:
            return S7COMM_PLUS if size == 4 else UNKNOWN  # the keep-alive is just a header
        return S7COMM_PLUS if second in (0x01, 0x02, 0x03, 0xFE) else UNKNOWN
    if 0x14 <= first <= 0x17 and second == 0x03:
        return TLS
    if first == 0x7F and (second == 0x65 or second == 0x66):
        return RDP  # T.125 connect-initial and connect-response
    if size >= 5 and first == 1 and second == 0 and octets[start + 2] == 1 and octets[start + 3] == 0:
        # Give tokens, data transfer, then the presentation PDU: user data, always fully encoded.
        return MMS if octets[start + 4] == 0x61 else UNKNOWN
    if first in _SESSION and (second == 0xFF or 0 <= second <= size - 2):
        return MMS
    if CONFIRMED_REQUEST <= first <= INITIATE_ERROR and _is_mms_pdu(octets, start, end):
        return MMS
    return UNKNOWN


def _element(octets: bytes, at: i64, end: i64) -> i64:
    """Return the end of the BER element at ``at``, -1 if there is no element of definite length before ``end``."""
    if at >= end:
        return -1
    tag: i64 = octets[at]
    at += 1
    if tag & 0x1F == 0x1F:  # a number of several octets
        while at < end and octets[at] & 0x80:
            at += 1
        at += 1
    if at >= end:
        return -1
    size: i64 = octets[at]
    at += 1
    if size & 0x80:
        count: i64 = size & 0x7F
        if count == 0 or count > 4 or at + count > end:
            return -1
        size = 0
        for _ in range(count):
            size = size << 8 | octets[at]
            at += 1
    return at + size if at + size <= end else -1


def _content(octets: bytes, at: i64) -> i64:
    """Return where the content of the element at ``at`` begins.

    Its tag must be one octet, and `_element` must have accepted it.
    """
    size: i64 = octets[at + 1]
    return at + 2 + (size & 0x7F if size & 0x80 else 0)


def _tags(octets: bytes, at: i64, end: i64) -> list[int]:
    """Return the first octet of each element in ``octets[at:end]``; empty if they do not fill it, or are too many."""
    found: list[int] = []
    while at < end:
        after: i64 = _element(octets, at, end)
        if after < 0 or len(found) >= _MOST_ELEMENTS:
            return []
        found.append(octets[at])
        at = after
    return found


def _is_mms_pdu(octets: bytes, start: i64, end: i64) -> bool:
    """Return whether ``octets[start:end]`` is one MMS PDU: its lengths fit exactly, and it has all mandatory elements."""
    if _element(octets, start, end) != end:
        return False
    first: i64 = octets[start]
    at: i64 = _content(octets, start)
    tags = _tags(octets, at, end)
    if not tags:
        return False
    if first == INITIATE_REQUEST or first == INITIATE_RESPONSE:
        return tuple(tags) in _INITIATE_TAGS
    if first == INITIATE_ERROR:
        return tags[0] == 0xA0
    if first == CONFIRMED_REQUEST or first == CONFIRMED_RESPONSE:  # an invoke id, perhaps modifiers, a service
        return tags[0] == _INTEGER and octets[at + 1] in (1, 2, 3, 4, 5) and len(tags) > 1 and tags[-1] >> 6 == 2
    if first == CONFIRMED_ERROR:
        return tags[0] == 0x80 and tags[-1] == 0xA2
    if first == UNCONFIRMED:
        return len(tags) == 1 and tags[0] in (0xA0, 0xA1, 0xA2) and bool(_tags(octets, _content(octets, at), end))
    return False


def stated_size(octets: bytes, start: i64, end: i64) -> i64:
    """Return the size that the S7comm PDU or S7comm-plus frame at ``start`` states, 0 if its header is incomplete.

    For S7comm-plus this is the size without the trailer, which only the last frame of a PDU has.
    """
    size: i64 = end - start
    if size < 4:
        return 0
    if octets[start] == 0x72:
        return 4 + u16(octets, start + 2)
    if octets[start] != 0x32 or size < 10:
        return 0
    rosctr: i64 = octets[start + 1]
    head: i64 = 12 if rosctr == 2 or rosctr == 3 else 10
    return head + u16(octets, start + 6) + u16(octets, start + 8)


def is_sound(octets: bytes, start: i64, end: i64) -> bool:
    """Return whether ``octets[start:end]`` is one S7comm PDU or S7comm-plus frame that its own lengths fill exactly."""
    upper: i64 = classify(octets, start, end)
    if upper == S7COMM:
        return stated_size(octets, start, end) == end - start
    if upper != S7COMM_PLUS:
        return False
    stated: i64 = stated_size(octets, start, end)
    if octets[start + 1] == 0xFF or stated == end - start:
        return True
    trailer: i64 = start + stated
    return trailer + 4 == end and octets[trailer] == 0x72 and u16(octets, trailer + 2) == 0


def is_rdp_connect(variable: bytes) -> bool:
    """Return whether the variable part of a CR or CC is RDP: a cookie text or a negotiation structure, no parameters."""
    if variable.startswith(b"Cookie: ") or variable == b"\r\n":  # a text without its end, or only its end
        return True
    return len(variable) >= 8 and variable[0] in (1, 2, 3) and variable[2] == 8 and variable[3] == 0
