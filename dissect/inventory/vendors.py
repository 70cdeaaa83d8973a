"""Vendors of network cards by MAC address, from Wireshark's list in Scapy, which is loaded with the first look-up."""

from __future__ import annotations

from functools import cache
from typing import Final

#: Bit of the first octet: the address was assigned locally, not by a vendor.
_LOCAL: Final = 2
LOCALLY_ADMINISTERED: Final = "locally administered"
#: Digits of the prefixes that are assigned to vendors, the longest first.
_DIGITS: Final = (9, 7, 6)


def vendor(mac: str) -> str:
    """Return the vendor of a MAC address ("00:1b:1b:12:34:56"), or `LOCALLY_ADMINISTERED`; empty if it is unknown."""
    digits = mac.replace(":", "").upper()
    names = _names()
    for size in _DIGITS:
        found = names.get(digits[:size])
        if found is not None:
            return found
    return LOCALLY_ADMINISTERED if int(digits[:2], 16) & _LOCAL else ""


@cache
def _names() -> dict[str, str]:
    """Return vendors by the digits of their prefix; each line has prefix, tab, short name, tab, name."""
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
