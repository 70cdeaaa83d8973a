"""Vendors of network cards by MAC address, from Wireshark's list as Scapy ships it, read when the first one is asked for."""

from __future__ import annotations

from functools import cache
from typing import Final

#: In the first octet: given by who runs the network, not by a vendor.
_LOCAL: Final = 2
LOCALLY_ADMINISTERED: Final = "locally administered"
#: Digits of a prefix that vendors are given, the longest first.
_DIGITS: Final = (9, 7, 6)


def vendor(mac: str) -> str:
    """Return the vendor of a MAC address ("00:1b:1b:12:34:56"), `LOCALLY_ADMINISTERED`, or an empty text for an unknown one."""
    digits = mac.replace(":", "").upper()
    names = _names()
    for size in _DIGITS:
        found = names.get(digits[:size])
        if found is not None:
            return found
    return LOCALLY_ADMINISTERED if int(digits[:2], 16) & _LOCAL else ""


@cache
def _names() -> dict[str, str]:
    """Return vendors by the digits of their prefix; lines are prefix, tab, short name, tab, name."""
    from scapy.libs.manuf import DATA

    names: dict[str, str] = {}
    for line in DATA.splitlines():
        prefix, _, rest = line.partition("\t")
        short, _, long = rest.partition("\t")
        digits, _, bits = prefix.strip().partition("/")
        digits = digits.replace(":", "")
        name = long.strip(" ,") or short.strip(" ,")
        if name:
            names[digits[: int(bits) // 4] if bits else digits] = name
    return names
