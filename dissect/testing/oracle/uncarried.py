"""Fields that Wireshark shows in the parameters and data of S7 PDUs but that no layout of ours has, with reasons.

`scripts/oracle_doc.py` writes them to docs/oracle.md from tshark's output for the captures; a test compares the page.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from typing import Final

#: Reasons why we have no field of that name, by a pattern for the whole name; the first match counts.
REASONS: Final = (
    (
        r"s7comm\.param\.userdata\.(head|length|reqres1)",
        "old names (Wireshark up to 4.0) of the first bytes of a userdata head, which are compared under the present names",
    ),
    (
        r"s7comm\.param\.pi\.n_x\.\w+",
        "arguments of Sinumerik services: we show each as a text; Wireshark names it by service and position",
    ),
    (
        r"s7comm\.readrec\.(id|index|mlen)",
        "names of their own for address, DB number and count of an item in the area of data records",
    ),
    (
        r"s7comm\.szl\.009[24]\.xxxx\.status_\w+",
        "a field of bits for racks or stations: we have it as one field, whose meaning lists the bits that are set",
    ),
    (
        r"s7comm\.szl\.0132\.0004\.ken_ver[12]_(hw|awp)",
        "checksums that Wireshark reads with the low byte first; we read the same bytes high byte first, as elsewhere",
    ),
    (
        r"s7comm\.varstat\.unknown",
        "bytes of programmer commands with unknown meaning, which we keep without a name",
    ),
)

AGAIN: Final = (
    "bytes of a field that is compared, shown once more in pieces (bits, digits, the parts of an address or a time)"
)


def reason(name: str) -> str:
    """Return the reason why no layout has a field of this name, empty if there is none."""
    return next((why for pattern, why in REASONS if re.fullmatch(pattern, name)), "")


def without_reason(other: Counter[str], again: Counter[str]) -> list[str]:
    """Return names without a reason whose octets are not always in a compared field."""
    return sorted(name for name, count in other.items() if again[name] < count and not reason(name))


def as_markdown(other: Counter[str], again: Counter[str]) -> str:
    """Return the names as docs/oracle.md lists them; ``other`` and ``again`` are those of `dissect.testing.oracle.compare`."""
    groups: dict[str, list[str]] = {}
    for name in sorted(other):
        why = AGAIN if again[name] == other[name] else reason(name)
        groups.setdefault(why, []).append(name)
    rows = [f"| {why} | {_shortened(names)} |" for why, names in sorted(groups.items())]
    return "\n".join(["| why | fields, below `s7comm.` |", "|---|---|", *rows]) + "\n"


def _shortened(names: Iterable[str]) -> str:
    return ", ".join(f"`{name.removeprefix('s7comm.')}`" for name in names)
