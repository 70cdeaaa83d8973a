"""COTP as Scapy layers: one class for each TPDU and form of X.224 (reference section 2).

``COTP(octets)`` returns the class for the octets; each class is a `COTP`, so ``packet[COTP]`` finds them all.
"""

from __future__ import annotations

from typing import Any, Final

from scapy.packet import NoPayload, Packet, Raw

from dissect.layers.fields import (
    Joining,
    OctetsField,
    PiecesField,
    ScapyField,
    WireLayer,
    consumed,
    fill_number,
    header_fields,
)
from dissect.layers.parameters import COTP_Parameter, carve_parameters
from dissect.layers.s7 import S7, is_s7
from dissect.layers.s7plus import S7Plus, is_s7plus
from dissect.protocols.iso import layouts, tables
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, parse_tpdu
from dissect.protocols.iso.tsap import Tsap
from dissect.wire.layout import Layout


class COTP(WireLayer):
    """A TPDU. ``COTP(octets)`` chooses the class by type and LI; ``COTP()`` is a `COTP_DT`. ``li`` is filled in when left out.

    A TPDU of unknown type, or whose header does not fit, is a `COTP_Unknown`.
    """

    name = "COTP"
    match_subclass = True
    least = layouts.UNKNOWN.size

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> Any:
        """Choose the class the octets call for."""
        if not _pkt:
            return COTP_DT
        if len(_pkt) < cls.least:
            return Raw
        layout = parse_tpdu(bytes(_pkt)).layout
        fits = layout.size <= _pkt[0] + 1 <= len(_pkt)
        return _CLASSES.get(layout, COTP_Unknown) if fits else COTP_Unknown

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in LI (Scapy's interface)."""
        if self.getfieldval("li") is None:
            pkt = fill_number(pkt, 0, 1, len(pkt) - 1, "LI, the size of the COTP header,")
        return pkt + pay

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Return Raw: user data of a TPDU other than DT are not dissected (Scapy's interface)."""
        return Raw

    def hashret(self) -> bytes:
        """Return the bytes that request and answer have in common (Scapy's interface)."""
        return b""

    def answers(self, other: Packet) -> int:
        """Return whether this TPDU answers ``other`` (Scapy's interface)."""
        return 0

    def line(self) -> str:
        """Return one line."""
        return f"COTP {tables.TPDU_TYPES.name(self.type)}"

    def parameter(self, code: int) -> bytes | None:
        """Return the value of the parameter ``code``, the last one if it is repeated; None if it is missing."""
        values = [p.value for p in self.parameters if isinstance(p, COTP_Parameter) and p.code == code]
        return values[-1] if values else None

    def _tsaps(self) -> str:
        calling, called = self.parameter(CALLING_TSAP), self.parameter(CALLED_TSAP)
        if called is None and calling is None:
            return ""
        names = ["?" if tsap is None else str(Tsap(tsap)) for tsap in (calling, called)]
        place = Tsap(called) if called is not None else Tsap(b"")
        where = f" rack {place.rack} slot {place.slot}" if place.rack >= 0 else ""
        return f" {names[0]} -> {names[1]}{where}"


def _tpdu_fields(layout: Layout, type_: int, **defaults: int) -> list[ScapyField]:
    head = header_fields(layout, {"li": None, "type": type_, **defaults})
    return [*head, PiecesField("parameters", carve_parameters)]


class COTP_CR(COTP):
    """Connect request."""

    name = "COTP CR"
    least = layouts.CR.size
    fields_desc = _tpdu_fields(layouts.CR, tables.CR)

    def hashret(self) -> bytes:
        """Return the reference that the answer repeats (Scapy's interface)."""
        return int(self.src_ref).to_bytes(2, "big")

    def line(self) -> str:
        """Return one line with both TSAPs."""
        return f"COTP CR{self._tsaps()}"


class COTP_CC(COTP):
    """Connect confirm; answers a CR."""

    name = "COTP CC"
    least = layouts.CC.size
    fields_desc = _tpdu_fields(layouts.CC, tables.CC)

    def hashret(self) -> bytes:
        """Return the reference of the CR (Scapy's interface)."""
        return int(self.dst_ref).to_bytes(2, "big")

    def answers(self, other: Packet) -> int:
        """Return whether ``other`` is the CR that this confirms (Scapy's interface)."""
        return int(isinstance(other, COTP_CR) and self.dst_ref == other.src_ref)

    def line(self) -> str:
        """Return one line with both TSAPs."""
        return f"COTP CC{self._tsaps()}"


class COTP_DR(COTP):
    """Disconnect request; answers a CR that it refuses."""

    name = "COTP DR"
    least = layouts.DR.size
    fields_desc = _tpdu_fields(layouts.DR, tables.DR)

    def hashret(self) -> bytes:
        """Return the reference of the CR (Scapy's interface)."""
        return int(self.dst_ref).to_bytes(2, "big")

    def answers(self, other: Packet) -> int:
        """Return whether ``other`` is the CR that this refuses (Scapy's interface)."""
        return int(isinstance(other, COTP_CR) and self.dst_ref == other.src_ref)

    def line(self) -> str:
        """Return one line with the reason."""
        return f"COTP DR {tables.DR_REASONS.name(self.reason)}"


class COTP_DC(COTP):
    """Disconnect confirm; answers a DR."""

    name = "COTP DC"
    least = layouts.DC.size
    fields_desc = _tpdu_fields(layouts.DC, tables.DC)

    def hashret(self) -> bytes:
        """Return the reference that the DR named as its receiver's (Scapy's interface)."""
        return int(self.src_ref).to_bytes(2, "big")

    def answers(self, other: Packet) -> int:
        """Return whether ``other`` is the DR that this confirms (Scapy's interface)."""
        return int(isinstance(other, COTP_DR) and self.dst_ref == other.src_ref and self.src_ref == other.dst_ref)


class COTP_DT(Joining, COTP):
    """Data, in the form of class 0 and 1, which carries S7.

    The payload is `S7` or `S7Plus` if ``eot`` is set and the octets begin like one of them. A DT without EOT is a fragment, or
    the empty DT that Siemens stacks send as an acknowledgement; fragments stay `Raw`, and `S7Session` and a `StreamSocket` on
    `TPKT` join them: the whole PDU is the layer of the last DT.
    """

    name = "COTP DT"
    __slots__ = ["piece"]
    least = layouts.DT.size
    fields_desc = _tpdu_fields(layouts.DT, tables.DT, eot=1)

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Return S7 or S7Plus for a PDU of these protocols, else Raw (Scapy's interface)."""
        if self.eot and is_s7(payload):
            return S7
        return S7Plus if self.eot and is_s7plus(payload) else Raw

    def hashret(self) -> bytes:
        """Return a key that the PDU inside shares with its answer (Scapy's interface)."""
        return self.payload.hashret()

    def answers(self, other: Packet) -> int:
        """Return whether the PDU inside answers the one in ``other`` (Scapy's interface)."""
        if not isinstance(other, COTP_DT) or isinstance(self.payload, S7) != isinstance(other.payload, S7):
            return 0
        return self.payload.answers(other.payload)

    def line(self) -> str:
        """Return one line."""
        end = " EOT" if self.eot else ""
        empty = " empty" if isinstance(self.payload, NoPayload) else ""
        return f"COTP DT{end}{empty}"


class COTP_DT_Normal(COTP_DT):
    """Data, normal form of classes 2 to 4."""

    name = "COTP DT normal"
    least = layouts.DT_NORMAL.size
    fields_desc = _tpdu_fields(layouts.DT_NORMAL, tables.DT, eot=1)


class COTP_DT_Extended(COTP_DT):
    """Data, extended form of classes 2 to 4."""

    name = "COTP DT extended"
    least = layouts.DT_EXTENDED.size
    fields_desc = _tpdu_fields(layouts.DT_EXTENDED, tables.DT, eot=1)


class COTP_ED(COTP):
    """Expedited data, in the form of RFC 1006."""

    name = "COTP ED"
    least = layouts.ED.size
    fields_desc = _tpdu_fields(layouts.ED, tables.ED, eot=1)


class COTP_ED_Normal(COTP_ED):
    """Expedited data, normal form of X.224."""

    name = "COTP ED normal"
    least = layouts.ED_NORMAL.size
    fields_desc = _tpdu_fields(layouts.ED_NORMAL, tables.ED, eot=1)


class COTP_ED_Extended(COTP_ED):
    """Expedited data, extended form of X.224."""

    name = "COTP ED extended"
    least = layouts.ED_EXTENDED.size
    fields_desc = _tpdu_fields(layouts.ED_EXTENDED, tables.ED, eot=1)


class COTP_AK(COTP):
    """Data acknowledgement."""

    name = "COTP AK"
    least = layouts.AK.size
    fields_desc = _tpdu_fields(layouts.AK, tables.AK)


class COTP_AK_Extended(COTP_AK):
    """Data acknowledgement, extended form."""

    name = "COTP AK extended"
    least = layouts.AK_EXTENDED.size
    fields_desc = _tpdu_fields(layouts.AK_EXTENDED, tables.AK)


class COTP_EA(COTP):
    """Expedited data acknowledgement."""

    name = "COTP EA"
    least = layouts.EA.size
    fields_desc = _tpdu_fields(layouts.EA, tables.EA)


class COTP_EA_Extended(COTP_EA):
    """Expedited data acknowledgement, extended form."""

    name = "COTP EA extended"
    least = layouts.EA_EXTENDED.size
    fields_desc = _tpdu_fields(layouts.EA_EXTENDED, tables.EA)


class COTP_RJ(COTP):
    """Reject."""

    name = "COTP RJ"
    least = layouts.RJ.size
    fields_desc = _tpdu_fields(layouts.RJ, tables.RJ)


class COTP_RJ_Extended(COTP_RJ):
    """Reject, extended form."""

    name = "COTP RJ extended"
    least = layouts.RJ_EXTENDED.size
    fields_desc = _tpdu_fields(layouts.RJ_EXTENDED, tables.RJ)


class COTP_ER(COTP):
    """TPDU error; answers a CR. Its parameter 0xC1 is the rejected header, no TSAP."""

    name = "COTP ER"
    least = layouts.ER.size
    fields_desc = _tpdu_fields(layouts.ER, tables.ER)

    def hashret(self) -> bytes:
        """Return the reference of the CR (Scapy's interface)."""
        return int(self.dst_ref).to_bytes(2, "big")

    def answers(self, other: Packet) -> int:
        """Return whether ``other`` is the CR that this rejects (Scapy's interface)."""
        return int(isinstance(other, COTP_CR) and self.dst_ref == other.src_ref)

    def line(self) -> str:
        """Return one line with the cause."""
        return f"COTP ER {tables.ER_CAUSES.name(self.cause)}"


class COTP_Unknown(COTP):
    """A TPDU of unknown type, or whose header does not fit: the rest of the header is kept in ``octets``."""

    name = "COTP unknown TPDU"
    fields_desc = [
        *header_fields(layouts.UNKNOWN, {"li": None}),
        OctetsField("octets", lambda pkt, s: pkt.li + 1 - consumed(pkt, s)),
    ]

    def parameter(self, code: int) -> bytes | None:
        """Return None: the header could not be read."""
        return None


_CLASSES: Final[dict[Layout, type[COTP]]] = {
    layouts.CR: COTP_CR,
    layouts.CC: COTP_CC,
    layouts.DR: COTP_DR,
    layouts.DC: COTP_DC,
    layouts.DT: COTP_DT,
    layouts.DT_NORMAL: COTP_DT_Normal,
    layouts.DT_EXTENDED: COTP_DT_Extended,
    layouts.ED: COTP_ED,
    layouts.ED_NORMAL: COTP_ED_Normal,
    layouts.ED_EXTENDED: COTP_ED_Extended,
    layouts.AK: COTP_AK,
    layouts.AK_EXTENDED: COTP_AK_Extended,
    layouts.EA: COTP_EA,
    layouts.EA_EXTENDED: COTP_EA_Extended,
    layouts.RJ: COTP_RJ,
    layouts.RJ_EXTENDED: COTP_RJ_Extended,
    layouts.ER: COTP_ER,
}
