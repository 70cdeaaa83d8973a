"""The variable part of a COTP header as Scapy packets: a code, a length, a value (X.224 section 13.2.3)."""

from __future__ import annotations

import re
from typing import Any, Final

from scapy.packet import Packet, Raw

from dissect.layers.fields import OctetsField, Piece, WireLayer, consumed, fill_number, header_fields
from dissect.protocols.iso import layouts, tables
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, PREFERRED_SIZE, TPDU_SIZE
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.iso.upper import is_rdp_connect

_HEX_PAIR: Final = re.compile(r"([0-9A-Fa-f]{2})\.([0-9A-Fa-f]{2})")
#: TPDU sizes by exponent. RFC 1006 stacks use 16 for the limit of RFC 1006.
_SIZES: Final = {**{exponent: 1 << exponent for exponent in range(7, 16)}, 16: 65531}
#: Parameters whose value is a number, with its unit.
_UNITS: Final = {0x85: "ms", 0x8B: "s", 0xF2: "ms"}


class _ValueField(OctetsField):
    """The value of a parameter, shown by its code."""

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take octets, or a TSAP written as text (Scapy's interface)."""
        return tsap_octets(x) if isinstance(x, str) else super().any2i(pkt, x)

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return the text that ``show()`` prints (Scapy's interface)."""
        if isinstance(pkt, COTP_Parameter) and isinstance(x, bytes):
            return pkt.describe(x)
        return repr(x)


def tsap_octets(tsap: str | bytes) -> bytes:
    """Return the octets of a TSAP in the usual notation: ``01.02`` (two octets in hexadecimal) or ``SIMATIC-ROOT-HMI``.

    Octets are returned unchanged. Raises ValueError for a text that is not ASCII.
    """
    if isinstance(tsap, bytes):
        return tsap
    if not isinstance(tsap, str):
        raise TypeError(f"a TSAP is a text such as '01.02', or bytes, not {tsap!r}")
    pair = _HEX_PAIR.fullmatch(tsap)
    if pair:
        return bytes.fromhex(pair[1] + pair[2])
    if not tsap.isascii():
        message = f"TSAP {tsap!r} is not ASCII: write two bytes as '01.02', or give bytes"
        raise ValueError(message)
    return tsap.encode("ascii")


class COTP_Parameter(WireLayer):
    """A parameter of the variable part. ``length`` is filled in if left out; ``value`` is octets, or a TSAP as text.

    `tpdu_size`, `calling` and `called` make the three parameters that every S7 connection has.
    """

    name = "COTP parameter"
    least = layouts.PARAMETER.size
    fields_desc = [
        *header_fields(layouts.PARAMETER, {"code": TPDU_SIZE, "length": None}),
        _ValueField("value", lambda pkt, _: pkt.length),
    ]

    @classmethod
    def tpdu_size(cls, octets: int) -> COTP_Parameter:
        """Return the parameter that offers TPDUs of ``octets``: a power of two from 128 to 32768, or 65531.

        Raises ValueError for any other size.
        """
        for exponent, size in _SIZES.items():
            if size == octets:
                return cls(code=TPDU_SIZE, value=bytes([exponent]))
        message = f"a TPDU size of {octets} bytes cannot be encoded: give one of {', '.join(map(str, _SIZES.values()))}"
        raise ValueError(message)

    @classmethod
    def calling(cls, tsap: str | bytes) -> COTP_Parameter:
        """Return the calling TSAP, for example ``01.00``."""
        return cls(code=CALLING_TSAP, value=tsap_octets(tsap))

    @classmethod
    def called(cls, tsap: str | bytes) -> COTP_Parameter:
        """Return the called TSAP, for example ``01.02``: PG connection to rack 0 slot 2."""
        return cls(code=CALLED_TSAP, value=tsap_octets(tsap))

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the length (Scapy's interface)."""
        if self.getfieldval("length") is None:
            pkt = fill_number(pkt, 1, 1, len(pkt) - layouts.PARAMETER.size, "the length of the parameter")
        return pkt + pay

    def holder_type(self) -> int:
        """Return the type of the TPDU that holds this parameter, -1 when none does."""
        return int(getattr(self.parent, "type", -1))

    def describe(self, value: bytes) -> str:
        """Return ``value`` in words, according to this parameter's code."""
        code = self.getfieldval("code")
        if code == TPDU_SIZE and len(value) == 1 and value[0] in _SIZES:
            return f"{value.hex()} ({_SIZES[value[0]]} bytes)"
        if code in (CALLING_TSAP, CALLED_TSAP) and self.holder_type() != tables.ER:
            return Tsap(value).describe()
        if code == PREFERRED_SIZE and 1 <= len(value) <= 4:
            return f"{value.hex()} ({int.from_bytes(value, 'big') * 128} bytes)"
        if code in _UNITS and value:
            return f"{value.hex()} ({int.from_bytes(value, 'big')} {_UNITS[code]})"
        return value.hex()

    def line(self) -> str:
        """Return one line."""
        return f"{tables.PARAMETERS.name(self.code)} {self.describe(self.value)}"


def carve_parameters(pkt: Packet, s: bytes) -> list[Piece]:
    """Cut the variable part; from a parameter that does not fit on, the rest is one Raw, and so is the negotiation of RDP."""
    end = min(len(s), max(0, pkt.li + 1 - consumed(pkt, s)))
    pieces: list[Piece] = []
    if is_rdp_connect(s[:end]):
        return [(Raw, s[:end])]
    at = 0
    while at + 2 <= end and at + 2 + s[at + 1] <= end:
        size = 2 + s[at + 1]
        pieces.append((COTP_Parameter, s[at : at + size]))
        at += size
    if at < end:
        pieces.append((Raw, s[at:end]))
    return pieces
