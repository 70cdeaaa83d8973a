"""The fixed headers of TPKT and COTP as layouts (RFC 1006 section 6, X.224 section 13; reference sections 1.1 and 2.2)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.iso.tables import DR_REASONS, ER_CAUSES, PARAMETERS, TPDU_TYPES
from dissect.wire.layout import Field, Layout

TPKT: Final = Layout(
    "TPKT",
    "RFC 1006 section 6",
    [
        Field("version", 1, "Always 3.", "tpkt.version"),
        Field("reserved", 1, "0 when sent, ignored on receipt.", "tpkt.reserved"),
        Field("length", 2, "Bytes of the whole packet, this header included.", "tpkt.length"),
    ],
)

_LI: Final = Field("li", 1, "Length indicator: header bytes after this one.", "cotp.li")
_TYPE: Final = Field("type", 1, "TPDU type.", "cotp.type", TPDU_TYPES, (0xF0, 4))
_CREDIT: Final = Field("credit", 1, "Credit, 0 in class 0.", "", None, (0x0F, 0), True)
_DST_REF: Final = Field("dst_ref", 2, "Reference of the receiver, 0 in a CR.", "cotp.destref")
_SRC_REF: Final = Field("src_ref", 2, "Reference of the sender.", "cotp.srcref")
_CLASS: Final = Field("class_", 1, "Protocol class, 0 to 4.", "cotp.class", None, (0xF0, 4))
_OPTIONS: Final = Field(
    "options", 1, "0x02 extended formats, 0x01 no explicit flow control.", "", None, (0x0F, 0), True
)
_EOT: Final = Field("eot", 1, "End of TSDU.", "cotp.eot", None, (0x80, 7))
_NUMBER: Final = Field("tpdu_nr", 1, "TPDU number, 0 in class 0.", "cotp.tpdu-number", None, (0x7F, 0), True)
_EOT_EXTENDED: Final = Field("eot", 4, "End of TSDU.", "cotp.eot", None, (0x80000000, 31))
_NUMBER_EXTENDED: Final = Field(
    "tpdu_nr", 4, "TPDU number of 31 bits.", "cotp.tpdu-number", None, (0x7FFFFFFF, 0), True
)
#: Always set in an ED; Wireshark does not show it there.
_EOT_ED: Final = Field("eot", 1, "End of TSDU, always 1.", "", None, (0x80, 7))
_EOT_ED_EXTENDED: Final = Field("eot", 4, "End of TSDU, always 1.", "", None, (0x80000000, 31))
_NEXT: Final = Field("next_nr", 1, "Number of the next TPDU expected.", "cotp.next-tpdu-number")
_NEXT_EXTENDED: Final = Field("next_nr", 4, "Number of the next TPDU expected.", "cotp.next-tpdu-number")
_CREDIT_EXTENDED: Final = Field("credit_extended", 2, "Credit of 16 bits.", "cotp.credit")

_HEAD: Final = [_LI, _TYPE, _CREDIT]
#: The beginning of AK and RJ in their normal form, in which the credit has a meaning.
_FLOW_HEAD: Final = [_LI, _TYPE, Field("credit", 1, "TPDUs the receiver takes.", "cotp.credit", None, (0x0F, 0), True)]
_X224: Final = "X.224 section 13"

CR: Final = Layout("CR", _X224, [*_HEAD, _DST_REF, _SRC_REF, _CLASS, _OPTIONS])
CC: Final = Layout("CC", _X224, [*_HEAD, _DST_REF, _SRC_REF, _CLASS, _OPTIONS])
DR: Final = Layout(
    "DR", _X224, [*_HEAD, _DST_REF, _SRC_REF, Field("reason", 1, "Why it ends.", "cotp.cause", DR_REASONS)]
)
DC: Final = Layout("DC", _X224, [*_HEAD, _DST_REF, _SRC_REF])
DT: Final = Layout("DT", _X224, [*_HEAD, _EOT, _NUMBER])
DT_NORMAL: Final = Layout("DT", _X224, [*_HEAD, _DST_REF, _EOT, _NUMBER])
DT_EXTENDED: Final = Layout("DT", _X224, [*_HEAD, _DST_REF, _EOT_EXTENDED, _NUMBER_EXTENDED])
ED: Final = Layout("ED", "RFC 1006 section 6", [*_HEAD, _EOT_ED, _NUMBER])
ED_NORMAL: Final = Layout("ED", _X224, [*_HEAD, _DST_REF, _EOT_ED, _NUMBER])
ED_EXTENDED: Final = Layout("ED", _X224, [*_HEAD, _DST_REF, _EOT_ED_EXTENDED, _NUMBER_EXTENDED])
AK: Final = Layout("AK", _X224, [*_FLOW_HEAD, _DST_REF, _NEXT])
AK_EXTENDED: Final = Layout("AK", _X224, [*_HEAD, _DST_REF, _NEXT_EXTENDED, _CREDIT_EXTENDED])
EA: Final = Layout("EA", _X224, [*_HEAD, _DST_REF, _NEXT])
EA_EXTENDED: Final = Layout("EA", _X224, [*_HEAD, _DST_REF, _NEXT_EXTENDED])
RJ: Final = Layout("RJ", _X224, [*_FLOW_HEAD, _DST_REF, _NEXT])
RJ_EXTENDED: Final = Layout("RJ", _X224, [*_HEAD, _DST_REF, _NEXT_EXTENDED, _CREDIT_EXTENDED])
ER: Final = Layout("ER", _X224, [*_HEAD, _DST_REF, Field("cause", 1, "Reject cause.", "cotp.reject_cause", ER_CAUSES)])
UNKNOWN: Final = Layout("unknown TPDU", _X224, [*_HEAD])
#: The head of a parameter in the variable part; its value follows.
PARAMETER: Final = Layout(
    "parameter",
    "X.224 section 13.2.3",
    [
        Field("code", 1, "What the value means.", "cotp.parameter_code", PARAMETERS),
        Field("length", 1, "Bytes of the value.", "cotp.parameter_length"),
    ],
)
