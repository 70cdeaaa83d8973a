"""Builds TPKTs and TPDUs (RFC 1006 section 6, X.224 section 13).

The readers for the same structures are `dissect.protocols.iso.tpkt` and `dissect.protocols.iso.cotp`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Final

from dissect.protocols.iso.cotp import PREFERRED_SIZE, TPDU_SIZE
from dissect.protocols.iso.tables import DC, DR, DT, ER
from dissect.protocols.iso.tpkt import HEADER

#: The largest TPDU of RFC 1006; unlike coded sizes it is not a power of two.
LARGEST_TPDU: Final = 65_531
#: The largest code of the parameter TPDU size (X.224 section 13.3.4): 2 to the power of 13 is 8192 octets.
MAX_CODED_SIZE: Final = 13
#: Code that some stacks use for `LARGEST_TPDU`.
_CODED_LARGEST: Final = 16
#: Maximum number of octets of a TPDU header after its length indicator (X.224 section 13.2.1).
MAX_HEADER: Final = 254
_VERSION: Final = 3
_EOT: Final = 0x80
_DT_HEADER: Final = 3
#: The size of the fixed part of a CR or CC after its length indicator.
_CONNECT: Final = 6


def build_tpkt(tpdu: bytes) -> bytes:
    """Return a TPDU in its TPKT. Raises struct.error for more than `LARGEST_TPDU` octets."""
    return struct.pack(">BBH", _VERSION, 0, HEADER + len(tpdu)) + tpdu


def build_parameters(parameters: Iterable[tuple[int, bytes]]) -> bytes:
    """Return the variable part: each parameter as its code, length and value."""
    return b"".join([bytes((code, len(value))) + value for code, value in parameters])


def connect_size(parameters: Iterable[tuple[int, bytes]]) -> int:
    """Return the size in octets of a CR or CC with these parameters, without its length indicator."""
    return _CONNECT + sum([2 + len(value) for _, value in parameters])


def build_connect(
    type_: int, dst_ref: int, src_ref: int, parameters: Iterable[tuple[int, bytes]], options: int = 0
) -> bytes:
    """Return a CR or CC (``type_``). Raises ValueError if it is larger than a header may be."""
    given = list(parameters)
    size = connect_size(given)
    if size > MAX_HEADER:
        raise ValueError(f"its parameters take {size} bytes of a TPDU header, which has room for {MAX_HEADER}")
    return struct.pack(">BBHHB", size, type_ << 4, dst_ref, src_ref, options) + build_parameters(given)


def build_dr(dst_ref: int, src_ref: int, reason: int) -> bytes:
    """Return a disconnect request."""
    return struct.pack(">BBHHB", 6, DR << 4, dst_ref, src_ref, reason)


def build_dc(dst_ref: int, src_ref: int) -> bytes:
    """Return a disconnect confirm."""
    return struct.pack(">BBHH", 5, DC << 4, dst_ref, src_ref)


def build_er(dst_ref: int, cause: int) -> bytes:
    """Return a TPDU error."""
    return struct.pack(">BBHB", 4, ER << 4, dst_ref, cause)


def build_dt(data: bytes, eot: bool = True) -> bytes:
    """Return a DT of class 0."""
    return bytes((2, DT << 4, _EOT if eot else 0)) + data


def build_tsdu(tsdu: bytes, tpdu_size: int) -> bytes:
    """Return a TSDU as TPKTs with DTs, each TPDU no larger than ``tpdu_size``."""
    room = max(tpdu_size - _DT_HEADER, 1)
    return b"".join(
        [build_tpkt(build_dt(tsdu[at : at + room], at + room >= len(tsdu))) for at in range(0, len(tsdu), room)]
    )


def coded_size(size: int) -> bytes:
    """Return the value of the parameter TPDU size: the largest power of two up to ``size``, at least 128."""
    return bytes((min(max(size.bit_length() - 1, 7), MAX_CODED_SIZE),))


def size_parameter(size: int) -> tuple[int, bytes]:
    """Return code and value of the parameter that requests TPDUs of ``size`` octets."""
    if 128 <= size <= 1 << MAX_CODED_SIZE and not size & (size - 1):
        return TPDU_SIZE, coded_size(size)
    if size == LARGEST_TPDU:
        return TPDU_SIZE, bytes((_CODED_LARGEST,))
    units = size // 128
    return PREFERRED_SIZE, units.to_bytes(max((units.bit_length() + 7) // 8, 1), "big")


def with_dst_ref(tpdu: bytes, reference: int) -> bytes:
    """Return a CC, DR or ER with its destination reference replaced."""
    return tpdu[:2] + reference.to_bytes(2, "big") + tpdu[4:]
