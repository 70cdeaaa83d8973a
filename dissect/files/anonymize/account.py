"""Counts what was replaced, kept and dropped while a capture is rewritten, and summarises it at the end."""

from __future__ import annotations

from typing import Final

from dissect.files.anonymize.masked import Masked
from dissect.wire.text import printable

#: Treatments of values (`Choices.values`).
KEEP: Final = "keep"
MASK: Final = "mask"
SCRAMBLE: Final = "scramble"

ACCOUNT_SCHEMA: Final = "s7dissect.anonymization/1"

# Kinds of fields that are replaced, set to zero or kept.
IP_ADDRESSES: Final = "ip_addresses"
MAC_ADDRESSES: Final = "mac_addresses"
TSAPS: Final = "tsap_texts"
NAMES: Final = "names"
SERIALS: Final = "serial_numbers"
BLOCK_TEXTS: Final = "block_texts"
FILE_NAMES: Final = "file_names"
ARGUMENTS: Final = "service_arguments"
PASSWORDS: Final = "passwords"
CONTENT_ADDRESSES: Final = "content_addresses"
VALUES: Final = "values"
CODE: Final = "block_contents"
UNKNOWN: Final = "unknown_octets"
FOREIGN: Final = "other_contents"
PLUS: Final = "s7comm_plus"
TLS: Final = "tls"
SCD_VALUES: Final = "scd_values"
SCD_TEXTS: Final = "scd_texts"
SCD_UNKNOWN: Final = "scd_unbound"
BLANK: Final = "blank_packets"
OPTIONS: Final = "ip_tcp_options"
PADDING: Final = "octets_behind_ip"

#: The names of these kinds in the summary.
KINDS: Final = {
    IP_ADDRESSES: "IP addresses (distinct)",
    MAC_ADDRESSES: "MAC addresses (distinct)",
    TSAPS: "TSAP texts",
    NAMES: "names: stations, modules, plants; in S7comm-plus all texts",
    SERIALS: "serial numbers",
    BLOCK_TEXTS: "block names, families and authors",
    FILE_NAMES: "file names and paths",
    ARGUMENTS: "service names and arguments",
    PASSWORDS: "passwords",
    CONTENT_ADDRESSES: "addresses in contents",
    VALUES: "values",
    CODE: "block contents",
    UNKNOWN: "fields without a known meaning",
    FOREIGN: "contents of other protocols",
    PLUS: "contents of S7comm-plus",
    TLS: "TLS: handshakes, certificates, encrypted contents",
    SCD_VALUES: "values in SCD messages",
    SCD_TEXTS: "texts in SCD messages",
    SCD_UNKNOWN: "data of SCD messages without a binding",
    BLANK: "packets with only a readable link header",
    OPTIONS: "IP and TCP options",
    PADDING: "padding and trailers after the IP packet",
}

# Reasons why a packet is not written.
OTHER: Final = "other_protocol"
DAMAGED: Final = "damaged_header"
FRAGMENT: Final = "ip_fragment"
LINK: Final = "unknown_link"

REASONS: Final = {
    OTHER: "other protocols (--keep-others writes them with new addresses and zeroed contents)",
    DAMAGED: "damaged or truncated IP or TCP headers",
    FRAGMENT: "incomplete IP fragments, or fragments of other protocols",
    LINK: "unknown link types",
}

# Limits that were exceeded.
FULL: Final = "no_memory"
MANY: Final = "many_connections"
UNCERTAIN: Final = "uncertain_place"

CAVEATS: Final = {
    FULL: "messages of one direction set to zero from some point on: out of memory for more",
    MANY: "connections beyond the first 32,768: their contents are set to zero",
    UNCERTAIN: "messages set to zero because neighbouring bytes were lost and their position is uncertain",
}

#: Properties that are never changed, for the summary.
LEFT: Final = (
    "times of packets (with --shift-time only those between them), sizes, order",
    "TCP ports, sequence numbers and timestamps of TCP, TTLs, VLAN ids",
    "loopback, multicast and broadcast addresses; whether an address is private, and shared prefixes",
    "TSAPs of two bytes (connection type, rack, slot), references, negotiated sizes",
    "what is requested: functions, areas, DB and block numbers, addresses, block types, sizes and versions",
    "in S7comm: order numbers of modules, SZL ids and numbers in their records, diagnostic events, states, error codes",
    "in S7comm-plus: ids of sessions, objects, attributes and variables, roles, states, return values, firmware versions",
    "times in contents: of blocks, events, clocks",
    "of SCD messages the header (kind, number, object, error), mappings of PDOs, constants that the dictionary says",
)


class Choices:
    """The user's choices. ``values`` is `KEEP`, `MASK` or `SCRAMBLE`; the others are options, off by default."""

    def __init__(
        self, values: str = MASK, keep_code: bool = False, keep_others: bool = False, shift_time: bool = False
    ) -> None:
        self.values = values
        self.keep_code = keep_code
        self.keep_others = keep_others
        self.shift_time = shift_time


class Account:
    """Counts by kind. A field counts once for each message that contains it, even if packets of the message were sent again.

    ``replaced``: fields with a replacement. ``masked``: (fields, octets) set to zero; ``hidden`` counts them. ``kept``: fields
    with plant data that the user chose to keep. ``dropped``: packets that were not written, by reason. ``caveats``: exceeded
    limits, with counts. All are named as in `KINDS`, `REASONS` and `CAVEATS`. ``bindings``: settings that bindings of SCD need
    for the written capture.
    """

    def __init__(self) -> None:
        self.replaced: dict[str, int] = {}
        self.hidden = Masked()
        self.masked = self.hidden.counts
        self.kept: dict[str, int] = {}
        self.dropped: dict[str, int] = {}
        self.caveats: dict[str, int] = {}
        self.packets = 0
        self.written = 0
        self.comments = 0
        self.secrets = 0
        self.zeroed = 0
        self.bindings: list[dict[str, str]] = []

    def replace(self, kind: str) -> None:
        """Count a field that was replaced."""
        self.replaced[kind] = self.replaced.get(kind, 0) + 1

    def mask(self, kind: str, octets: bytes) -> None:
        """Count octets that are set to zero, unless they already were."""
        self.hidden.add(kind, octets)

    def keep(self, kind: str) -> None:
        """Count a field that is kept by the user's choice."""
        self.kept[kind] = self.kept.get(kind, 0) + 1

    def drop(self, reason: str) -> None:
        """Count a packet that is not written."""
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def warn(self, caveat: str) -> None:
        """Count an exceeded limit."""
        self.caveats[caveat] = self.caveats.get(caveat, 0) + 1

    def as_dict(self) -> dict[str, object]:
        """Return the account as JSON-ready values."""
        return {
            "schema": ACCOUNT_SCHEMA,
            "packets": self.packets,
            "written": self.written,
            "replaced": dict(sorted(self.replaced.items())),
            "masked": {kind: {"fields": count, "octets": size} for kind, (count, size) in sorted(self.masked.items())},
            "payload_octets_zero": self.zeroed,
            "kept": dict(sorted(self.kept.items())),
            "left": list(LEFT),
            "dropped": dict(sorted(self.dropped.items())),
            "comments_dropped": self.comments,
            "secrets_dropped": self.secrets,
            "caveats": dict(sorted(self.caveats.items())),
            "bindings": self.bindings,
        }

    def lines(self) -> list[str]:
        """Return the account as lines for people."""
        lines = [f"{self.written} of {self.packets} packets written"]
        lines += _section("Changed", _counts(self.replaced, KINDS))
        masked = sorted([(KINDS[kind], *counts) for kind, counts in self.masked.items()])
        lines += _section("Set to zero", [f"{count:>8}  {text} ({size} bytes)" for text, count, size in masked])
        lines += _section("Kept because you asked for it", _counts(self.kept, KINDS))
        dropped = _counts(self.dropped, {reason: f"packets: {text}" for reason, text in REASONS.items()})
        if dropped:
            dropped.append("          (so packet numbers in OUT differ from those in FILE)")
        if self.comments:
            dropped.append(f"{self.comments:>8}  comments")
        if self.secrets:
            dropped.append(f"{self.secrets:>8}  blocks of TLS session keys")
        dropped.append(
            "          other content of the file: names of interfaces, hosts and programs, secrets, statistics"
        )
        lines += _section("Dropped", dropped)
        lines += _section("Bindings of SCD, for what was written", [_binding(entry) for entry in self.bindings])
        lines += _section("Left unchanged", [f"          {sentence}" for sentence in LEFT])
        return lines + _section("Mind", _counts(self.caveats, CAVEATS))


def _counts(counts: dict[str, int], texts: dict[str, str]) -> list[str]:
    return [f"{count:>8}  {text}" for text, count in sorted([(texts[name], count) for name, count in counts.items()])]


def _binding(entry: dict[str, str]) -> str:
    settings = [f'{key} = "{printable(value)}"' for key, value in entry.items() if key != "name"]
    return f"          {printable(entry['name'])}: {', '.join(settings)}"


def _section(title: str, lines: list[str]) -> list[str]:
    return ["", title, *lines] if lines else []
