"""What was changed, what was left, what was dropped: counted while it happens, told at the end."""

from __future__ import annotations

from typing import Final

#: How values are treated (`Choices.values`).
KEEP: Final = "keep"
MASK: Final = "mask"
SCRAMBLE: Final = "scramble"

# Kinds of what is replaced.
TSAPS: Final = "TSAP texts"
NAMES: Final = "names of stations, modules and plants"
SERIALS: Final = "serial numbers"
BLOCK_TEXTS: Final = "block names, families and authors"
FILE_NAMES: Final = "file names and paths"
ARGUMENTS: Final = "service names and arguments"
PASSWORDS: Final = "passwords"
CONTENT_ADDRESSES: Final = "addresses in contents"
VALUES: Final = "values"
CODE: Final = "block contents"
UNKNOWN: Final = "octets without a known meaning"
FOREIGN: Final = "contents of other protocols"
PLUS: Final = "contents of S7comm-plus"
OPTIONS: Final = "IP and TCP options"
PADDING: Final = "octets behind the IP packet"

#: What is never changed, in sentences.
LEFT: Final = (
    "times of packets, sizes, order, TCP ports, sequence numbers, TTLs, VLAN ids",
    "loopback, multicast and broadcast addresses; which addresses are private, and how much of their front they share",
    "TSAPs of two octets (connection type, rack, slot), references, negotiated sizes",
    "what is asked for: functions, areas, DB and block numbers, addresses, block types, sizes and versions",
    "order numbers of modules, SZL ids and numbers in their records, diagnostic events, states, error codes",
    "times in contents: of blocks, events, clocks",
)


class Choices:
    """What a person chose. ``values``: `KEEP`, `MASK` or `SCRAMBLE`; the rest are false unless asked for."""

    def __init__(
        self, values: str = MASK, keep_code: bool = False, keep_others: bool = False, shift_time: bool = False
    ) -> None:
        self.values = values
        self.keep_code = keep_code
        self.keep_others = keep_others
        self.shift_time = shift_time


class Account:
    """Counts by kind. A field counts once for each message that brings it, however often its packets were sent.

    ``replaced``: fields that got something else; ``masked``: (fields, octets) set to zero; ``kept``: fields that hold something
    of the plant and were left because they were chosen to be; ``dropped``: packets that were not written, by reason;
    ``caveats``: sentences about what went beyond a bound, with how often.
    """

    def __init__(self) -> None:
        self.replaced: dict[str, int] = {}
        self.masked: dict[str, tuple[int, int]] = {}
        self.kept: dict[str, int] = {}
        self.dropped: dict[str, int] = {}
        self.caveats: dict[str, int] = {}
        self.packets = 0
        self.written = 0
        self.comments = 0
        self.zeroed = 0

    def replace(self, kind: str) -> None:
        """A field got something else."""
        self.replaced[kind] = self.replaced.get(kind, 0) + 1

    def mask(self, kind: str, octets: bytes) -> None:
        """Octets are set to zero; those that were zero need no word."""
        if any(octets):
            fields, size = self.masked.get(kind, (0, 0))
            self.masked[kind] = (fields + 1, size + len(octets))

    def keep(self, kind: str) -> None:
        """A field is left because that was asked for."""
        self.kept[kind] = self.kept.get(kind, 0) + 1

    def drop(self, reason: str) -> None:
        """A packet is not written."""
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def warn(self, sentence: str) -> None:
        """Something went beyond a bound."""
        self.caveats[sentence] = self.caveats.get(sentence, 0) + 1

    def as_dict(self) -> dict[str, object]:
        """Return the account as JSON-ready values."""
        return {
            "packets": self.packets,
            "written": self.written,
            "replaced": dict(sorted(self.replaced.items())),
            "masked": {kind: {"fields": count, "octets": size} for kind, (count, size) in sorted(self.masked.items())},
            "payload_octets_zero": self.zeroed,
            "kept": dict(sorted(self.kept.items())),
            "left": list(LEFT),
            "dropped": dict(sorted(self.dropped.items())),
            "comments_dropped": self.comments,
            "caveats": dict(sorted(self.caveats.items())),
        }

    def lines(self) -> list[str]:
        """Return the account for a person."""
        lines = [f"{self.written} of {self.packets} packets written"]
        lines += _section("Changed", [f"{count:>8}  {kind}" for kind, count in sorted(self.replaced.items())])
        masked = [f"{count:>8}  {kind}, {size} octets" for kind, (count, size) in sorted(self.masked.items())]
        lines += _section("Set to zero", masked)
        lines += _section("Kept because you asked for it", [f"{n:>8}  {kind}" for kind, n in sorted(self.kept.items())])
        dropped = [f"{count:>8}  packets: {reason}" for reason, count in sorted(self.dropped.items())]
        if self.comments:
            dropped.append(f"{self.comments:>8}  comments")
        dropped.append("          names of interfaces and hosts, secrets, statistics: every other block and option")
        lines += _section("Dropped", dropped)
        lines += _section("Left as it was", [f"          {sentence}" for sentence in LEFT])
        return lines + _section("Mind", [f"{count:>8}  {sentence}" for sentence, count in sorted(self.caveats.items())])


def _section(title: str, lines: list[str]) -> list[str]:
    return ["", title, *lines] if lines else []
