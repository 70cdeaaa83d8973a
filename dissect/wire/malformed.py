"""`Malformed`: what a parser reports when octets contradict themselves. Octets from the wire never raise an error."""

from __future__ import annotations

from typing import Final

from dissect.wire.copies import leaves

#: Every reason a parser may give; the set is closed so that reports and gates can rely on it.
REASONS: Final = (
    "too_short",        # a fixed header or field needs more octets than there are
    "length_beyond",    # a length field claims more than its container holds
    "length_below",     # a length field is smaller than what must follow it
    "bad_value",        # a field holds a value the standard forbids
    "trailing_octets",  # octets are left over where nothing may follow
    "count_mismatch",   # a count field and the number of elements differ
    "unknown_type",     # a type octet that is in no table, so what follows cannot be read
    "bad_compression",  # compressed octets that do not inflate, or end before or after the end of what they hold
    "too_large",        # compressed octets whose content exceeds a limit
)  # fmt: skip

#: The length fields that may set the limit that was broken (`Malformed.limit`).
LIMITS: Final = ("snaplen", "ip", "tpkt", "li", "tsdu", "param", "data", "item", "packet", "pdu")
#: The part whose length each of these fields gives, in words.
_CONTAINERS: Final = {
    "snaplen": "the capture",
    "ip": "the IP packet",
    "tpkt": "the TPKT",
    "li": "the TPDU header",
    "tsdu": "the TSDU",
    "param": "the parameter part",
    "data": "the data part",
    "item": "the item",
    "packet": "the packet",
    "pdu": "the rest of the PDU",
}
#: The end of the names of fields that are counts; others are lengths in bytes.
_COUNTS: Final = "count"
#: Names in words of fields with short names, and the values that fields may have.
_SPOKEN: Final = {"li": "length indicator"}
_EXPECTED: Final = {"li": "1 to 254"}
#: The beginning of the names of fields that are a depth of nesting.
_DEPTH: Final = "depth of "


class Malformed:
    """One fault: something does not fit in ``layer`` at ``offset`` (from the beginning of the TPDU or TSDU).

    ``needed`` and ``available`` are sizes in octets, for ``count_mismatch`` counts; for a count that is ``length_beyond`` only
    ``needed`` is a count. ``limit`` names the length field that set the bound (one of `LIMITS`). The parser that reports the
    fault keeps what it read before.
    """

    __slots__ = ("available", "field", "layer", "limit", "needed", "offset", "reason")

    def __init__(
        self, layer: str, reason: str, field: str, offset: int, needed: int, available: int, limit: str
    ) -> None:
        self.layer = layer
        self.reason = reason
        self.field = field
        self.offset = offset
        self.needed = needed
        self.available = available
        self.limit = limit

    @property
    def is_unknown(self) -> bool:
        """True for content of S7comm-plus of a kind that no table here has: the protocol has no specification to contradict."""
        return self.layer == "s7plus" and self.reason == "unknown_type"

    @property
    def word(self) -> str:
        """The word that a report for people puts before it."""
        return "NOT KNOWN" if self.is_unknown else "MALFORMED"

    def at(self, offset: int) -> Malformed:
        """Return the same fault with another offset, for callers that count from another place."""
        return Malformed(self.layer, self.reason, self.field, offset, self.needed, self.available, self.limit)

    def __str__(self) -> str:
        return f"{self.layer}: {self._said()}"

    def _said(self) -> str:
        where = f"{_SPOKEN.get(self.field, self.field)} at byte {self.offset}"
        container = _CONTAINERS.get(self.limit, self.limit)
        if self.reason == "too_short":
            return f"{where} needs {_octets(self.needed)}, {container} has {self.available}"
        if self.reason == "length_beyond" and self.field.endswith(_COUNTS):
            return f"{where} announces {self.needed}, {container} has {_octets(self.available)}"
        if self.reason == "length_beyond":
            return f"{where} claims {_octets(self.needed)}, {container} has {self.available}"
        if self.reason == "length_below":
            return f"{where} is {self.available}, less than {self.needed}"
        if self.reason == "trailing_octets":
            behind = f" behind {self.field}" if self.field != "end" else ""
            surplus = _octets(self.available - self.needed)
            return f"{surplus} too many{behind} at byte {self.offset}, in {container.replace('rest of the ', '')}"
        if self.reason == "count_mismatch":
            return f"{where}: {self.needed} announced, {self.available} there"
        if self.reason == "bad_compression":
            return f"{where}: its {_octets(self.available)} cannot be decompressed to the end"
        if self.reason == "too_large":
            return f"{where}: its {_octets(self.available)} decompress to {self.needed} or more"
        if self.reason == "unknown_type":
            return f"{where} is {self.available}, which is unknown"
        if self.field.startswith(_DEPTH):
            return f"{where} is {self.available}, more than the {self.needed} that are read"
        expected = _EXPECTED.get(self.field) or str(self.needed)
        return f"{where} is {self.available}, expected {expected}"

    def as_dict(self) -> dict[str, object]:
        """Return the fault as JSON-ready values, keys in a fixed order."""
        return {
            "layer": self.layer,
            "reason": self.reason,
            "field": self.field,
            "offset": self.offset,
            "needed": self.needed,
            "available": self.available,
            "limit": self.limit,
        }


def _octets(count: int) -> str:
    return f"{count} byte{'s' if count != 1 else ''}"


leaves(Malformed)
