"""TSAPs of Siemens devices: connection type, rack and slot in two octets, or a text (reference section 2.6)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso.tables import CONNECTION_TYPES
from dissect.wire.copies import leaves

#: Protocols (`Connection.protocol`) whose TSAPs have connection types, racks and slots; empty means unknown.
SIEMENS: Final = frozenset(("", "s7comm", "s7comm_plus"))

#: Beginning of the text of a TSAP of a panel's runtime: "WINCCRT-SCS-ES", which TIA Portal uses to load it.
_PANEL: Final = "WINCCRT-"


class Tsap:
    """A transport service access point: its octets and what they mean on Siemens devices.

    ``rack`` and ``slot`` are -1 unless the TSAP has the two-octet form; they are meaningful only in the called TSAP.
    """

    __slots__ = ("connection_type", "octets", "rack", "slot")

    def __init__(self, octets: bytes) -> None:
        self.octets = octets
        self.connection_type = -1
        self.rack = -1
        self.slot = -1
        if len(octets) == 2 and not _is_text(octets):
            self.connection_type = octets[0]
            self.rack = octets[1] >> 5
            self.slot = octets[1] & 0x1F

    def __repr__(self) -> str:
        return f"Tsap({str(self)!r})"

    def __str__(self) -> str:
        if _is_text(self.octets):
            return self.octets.decode("ascii")
        if len(self.octets) == 2:
            return f"{self.octets[0]:02x}.{self.octets[1]:02x}"
        return self.octets.hex()

    @property
    def of_panel(self) -> bool:
        """Whether only the runtime of a panel uses this TSAP."""
        return _is_text(self.octets) and str(self).upper().startswith(_PANEL)

    def describe(self, called: bool = True) -> str:
        """Return the TSAP as text, for example ``01.02 (PG, rack 0 slot 2)``; a calling one without rack and slot."""
        if self.connection_type < 0:
            return f'"{self}"' if _is_text(self.octets) else str(self)
        if self.connection_type in CONNECTION_TYPES:
            kind = CONNECTION_TYPES.name(self.connection_type)
        else:
            kind = f"connection resource 0x{self.connection_type:02x}"
        return f"{self} ({kind}, rack {self.rack} slot {self.slot})" if called else f"{self} ({kind})"

    def means(self, protocol: str, called: bool = True) -> str:
        """Return the TSAP as text, with its meaning if ``protocol`` is one of `SIEMENS`.

        Only Siemens protocols have connection types, racks and slots; in others the octets are just a number.
        """
        if protocol in SIEMENS or self.connection_type < 0:
            return self.describe(called)
        return str(self)

    def as_dict(self) -> dict[str, object]:
        """Return the TSAP as JSON-ready values."""
        values: dict[str, object] = {"octets": self.octets.hex(), "text": str(self)}
        if self.connection_type >= 0:
            values["connection_type"] = self.connection_type
            values["rack"] = self.rack
            values["slot"] = self.slot
        return values


def _is_text(octets: bytes) -> bool:
    """Return whether ``octets`` are two or more printable ASCII characters."""
    size: i64 = len(octets)
    for at in range(size):
        if octets[at] < 0x20 or octets[at] >= 0x7F:
            return False
    return size >= 2


leaves(Tsap)
