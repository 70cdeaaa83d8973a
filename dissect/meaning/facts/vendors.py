"""Vendors of network cards by MAC address, from Wireshark's list in Scapy, which is loaded with the first look-up."""

from __future__ import annotations

from functools import cache
from typing import Final

#: Bit of the first octet: the address was assigned locally, not by a vendor.
_LOCAL: Final = 2
LOCALLY_ADMINISTERED: Final = "locally administered"
#: Digits of the prefixes that are assigned to vendors, the longest first.
_DIGITS: Final = (9, 7, 6)
#: From this many look-ups on, a dictionary is cheaper than a search in the text of the list.
_MANY: Final = 100


def vendor(mac: str) -> str:
    """Return the vendor of a MAC address ("00:1b:1b:12:34:56"), or `LOCALLY_ADMINISTERED`; empty if it is unknown."""
    digits = mac.replace(":", "").upper()
    many = _name.cache_info().misses > _MANY
    for size in _DIGITS if many or _name(digits[:6], any_longer=True) else ():
        found = _names().get(digits[:size], "") if many else _name(digits[:size])
        if found:
            return found
    return LOCALLY_ADMINISTERED if int(digits[:2], 16) & _LOCAL else ""


@cache
def _name(prefix: str, any_longer: bool = False) -> str:
    """Return the vendor of a prefix of these digits, empty for none; ``any_longer``: or of one of its longer prefixes.

    A capture has few prefixes and the list some 50,000 lines: its text is searched, no dictionary is made. Each line has
    prefix, tab, short name, tab, name; a prefix longer than 6 digits is written in whole octets, with the number of its bits.
    """
    from scapy.libs.manuf import DATA

    whole = prefix + "0" * (len(prefix) % 2)
    written = ":".join([whole[at : at + 2] for at in range(0, len(whole), 2)])
    if not any_longer:
        written += f"/{len(prefix) * 4}" if len(prefix) > _DIGITS[-1] else " "
    at = 0 if DATA.startswith(written) else DATA.find(f"\n{written}") + 1
    if not at and not DATA.startswith(written):
        return ""
    _, _, rest = DATA[at : DATA.find("\n", at)].partition("\t")
    short, _, long = rest.partition("\t")
    return long.strip(" ,") or short.strip(" ,")


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


def listed() -> str:
    """Return the list in its own form, with one name for each prefix, for use without Scapy."""
    from scapy.libs.manuf import DATA

    rows = []
    for line in DATA.splitlines():
        prefix, _, rest = line.partition("\t")
        short, _, long = rest.partition("\t")
        rows.append(f"{prefix}\t\t{long.strip(' ,') or short.strip(' ,')}")
    return "\n".join(rows)
