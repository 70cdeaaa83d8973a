"""DTs with irregular headers (reference 2.2): whether they contain a whole PDU, and where it begins.

There are two kinds. Case one: the length indicator (LI) leaves room for the header of a class 0 DT, but counts more octets;
such a DT is read. Case two: it leaves no room (0, 1, the reserved 255), or reaches beyond the TPKT. Then the content is *behind
a malformed header*: a receiver that reads the header must drop it.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso.cotp import Tpdu
from dissect.protocols.iso.tables import DT
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, classify, is_sound, stated_size

#: Octets of the header of a class 0 DT, and the value of its length indicator.
DT_HEADER: Final = 3
DT_LI: Final = 2
_RESERVED_LI: Final = 255
#: The known types of S7comm PDUs (reference 3.1): Job, Ack, Ack_Data, Userdata.
_ROSCTRS: Final = frozenset((1, 2, 3, 7))


def holds_data(tpdu: bytes) -> bool:
    """Return whether the length indicator of a TPDU ends within it and leaves room for the header of a class 0 DT."""
    li: i64 = tpdu[0]
    return DT_LI <= li < _RESERVED_LI and li < len(tpdu)


def is_class_0(class_: i64, octets: bytes) -> bool:
    """Return whether a DT has class 0: the confirm chose ``class_``; if that was not captured (-1), the content decides."""
    if class_ >= 0:
        return class_ == 0
    return len(octets) > DT_HEADER and octets[2] >= 0x80 and is_sound(octets, DT_HEADER, len(octets))


def is_odd(tpdu: Tpdu, octets: bytes, class_: i64) -> bool:
    """Return whether a DT contradicts itself, or has a length indicator other than that of class 0."""
    return tpdu.type == DT and (len(tpdu.malformed) > 0 or (octets[0] != DT_LI and is_class_0(class_, octets)))


def odd_place(tpdu: Tpdu, octets: bytes, class_: i64) -> i64:
    """Return where a whole PDU begins in a TPDU with an irregular header; -1 for none, and for a regular TPDU.

    The position of class 0 is tried first, then the position given by the length indicator. After a malformed header the type
    and the end mark (EOT) are meaningless, and octets may follow the PDU.
    """
    size: i64 = len(octets)
    if not holds_data(octets):
        if size > DT_HEADER and _begins(octets, DT_HEADER, size):
            return DT_HEADER
        behind: i64 = octets[0] + 1
        return behind if behind < DT_HEADER and _begins(octets, behind, size) else -1
    if not is_odd(tpdu, octets, class_):
        return -1
    if size > DT_HEADER and octets[2] >= 0x80 and is_sound(octets, DT_HEADER, size):
        return DT_HEADER
    behind = size - len(tpdu.data)
    return behind if is_sound(octets, behind, size) else -1


def _begins(octets: bytes, at: i64, end: i64) -> bool:
    """Return whether a complete S7comm PDU or S7comm-plus frame begins at ``at``, whatever follows it before ``end``."""
    if is_sound(octets, at, end):
        return True
    upper: i64 = classify(octets, at, end)
    if upper == S7COMM and octets[at + 1] not in _ROSCTRS:
        return False
    return (upper == S7COMM or upper == S7COMM_PLUS) and 0 < stated_size(octets, at, end) <= end - at


def odd_said(tpdu: Tpdu, octets: bytes) -> str:
    """Return what is irregular about the header of a TPDU."""
    if tpdu.malformed:
        return str(tpdu.malformed[0])
    return f"length indicator {octets[0]}, class 0 has {DT_LI}"
