"""The remarks of reports on a PDU in a TPKT whose TPDU header is irregular (`dissect.protocols.iso.irregular`)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.irregular import holds_data, odd_place, odd_said
from dissect.wire.malformed import Malformed

_TPKT: Final = 4
_VERSION: Final = 3
#: The beginning of a regular DT header, as nearly all have it.
_PLAIN: Final = b"\x02\xf0"
_LEAST: Final = 7


class Header:
    """An irregular header: its faults (``said``, ``faults``), and whether the PDU is *behind* it."""

    __slots__ = ("behind", "faults", "said")

    def __init__(self, said: str, faults: list[Malformed], behind: bool) -> None:
        self.said = said
        self.faults = faults
        self.behind = behind

    @property
    def remark(self) -> str:
        """The text for the line of the PDU."""
        return f"  {'BEHIND A MALFORMED TPDU HEADER' if self.behind else 'MALFORMED'} {self.said}"


def irregular(packet: bytes, pdu: bytes, class_: i64) -> Header | None:
    """Return the header of the TPKT that carries only ``pdu`` if it is irregular; None for nearly all.

    ``packet`` is the latest TPKT, or a packet of another protocol. ``class_`` is the class of the connection, -1 if unknown.
    """
    if packet[_TPKT : _TPKT + 2] == _PLAIN or len(packet) < _LEAST or packet[0] != _VERSION or not packet.endswith(pdu):
        return None
    octets = packet[_TPKT:]
    tpdu = parse_tpdu(octets)
    place: i64 = odd_place(tpdu, octets, class_)
    if place < 0 or place + len(pdu) != len(octets):
        return None
    return Header(odd_said(tpdu, octets), tpdu.malformed, not holds_data(octets))
