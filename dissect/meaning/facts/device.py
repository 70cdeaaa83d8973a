"""The facts of a device and of the talk of a client and a server, and of the records that these contain.

See `dissect.meaning.inventory.model`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from dissect.engine.stations import facts
from dissect.meaning.facts.fact import (
    CODE,
    COUNT,
    COUNTS,
    DURATION,
    FILE,
    FRAME,
    JSON,
    OBJECT,
    RECORDS,
    TEXT,
    TIME,
    VLANS,
    WORD,
    WORDS,
    Fact,
    by_name,
)
from dissect.meaning.facts.vendors import vendor
from dissect.packets.tcp.link import vlan_ids, vlan_text
from dissect.wire.text import encodable

_SURE: Final = ("stated", "behaviour", "tsap")
_ROLES: Final = ("CPU", "engineering", "OPC", "panel", "S7 server")


def _said(key: str, about: str, *, told: bool = True) -> Fact[Any]:
    """Return the fact that a device stated under a key; with `told`, JSON has it among its own keys.

    See `dissect.engine.stations.facts`.
    """
    return Fact(key, WORD, about, lambda of: encodable(of.get(key)) or None, key=None if told else "", null=True)


def _list(names: list[str]) -> list[str]:
    return [encodable(name) for name in names]


def _joined(name: str, about: str, get: Callable[[Any], list[str]], separator: str = " ") -> Fact[Any]:
    """Return a list as a fact of tables and CSV, where it is one text."""
    return Fact(f"{name}_said", WORD, about, lambda of: encodable(separator.join(get(of))) or None, key="", column=name)


def _vendor(of: Any) -> str | None:
    mac = of.get(facts.MAC)
    return vendor(mac) or None if mac else None


def _block_counts(of: Any) -> list[str]:
    return [f"{count} {kind}" for kind, count in of.block_counts.items()]


def _modules(of: Any) -> list[tuple[str, dict[str, Any]]]:
    """Return rack and slot of each module, and the stretches of each kind of fact that it stated."""
    apart = facts.CLOCKS | {facts.MAC}  # these have their own keys
    said = sorted(of.station.facts.items())
    return [
        (module, {key: facts.timeline(key, told) for (own, key), told in said if own == module and key not in apart})
        for module in of.modules
    ]


_STRETCH: Final[tuple[Fact[Any], ...]] = (
    Fact("value", TEXT, "The value, a text from the wire.", lambda of: of.value),
    Fact("source", TEXT, "Source of the statement: `SZL 0x0011`, `S7comm-plus session`, `I&M0 record`, `Ethernet` and so on.",
         lambda of: of.source),
    Fact("times", COUNT, "Number of statements of this value without a different one between them.", lambda of: of.count),
    Fact("first_frame", FRAME, "Number of the packet with the first statement; null for none.", lambda of: of.first_frame,
         null=True),
    Fact("first_time", TIME, "Time of the first statement.", lambda of: of.first_ns),
    Fact("last_frame", FRAME, "Number of the packet with the last statement; null for none.", lambda of: of.last_frame,
         null=True),
    Fact("last_time", TIME, "Time of the last statement.", lambda of: of.last_ns),
)  # fmt: skip
#: Statements with first and last packet (`Stretch`); for a network card with its vendor.
STRETCH: Final = by_name(_STRETCH)
MAC: Final = by_name((*_STRETCH, Fact("vendor", TEXT, "Vendor of the network card, `locally administered`, or null for an"
                                      " unknown one.", lambda of: vendor(of.value) or None, null=True)))  # fmt: skip

_REASON: Final[tuple[Fact[Any], ...]] = (
    Fact("role", CODE, "The role that it suggests.", lambda of: of.role, codes=_ROLES),
    Fact("certainty", CODE, "Certainty of that role.", lambda of: of.certainty, codes=_SURE),
    Fact("text", TEXT, "The observation, in a few words for a person.", lambda of: of.text),
    Fact("times", COUNT, "Number of connections with this evidence.", lambda of: of.count),
    Fact("frame", FRAME, "Number of a packet that shows it; null for none.", lambda of: of.frame, null=True),
)
#: A reason for the role of a device.
REASON: Final = by_name(_REASON)

_MODULE: Final[tuple[Fact[Any], ...]] = (
    Fact("module", TEXT, "Rack and slot that were asked, such as `rack 0 slot 2`; null for statements without them.",
         lambda of: of[0] or None, null=True),
    Fact("facts", RECORDS, "Values by kind (docs/devices.md), each kind one value after another: a new entry wherever it"
         " changed.", lambda of: of[1], records=STRETCH,
         shape={"type": "object", "additionalProperties": {"type": "array", "description": "Values of a kind in the order of"
                " time.", "items": {"$made": "stretch"}}}),
)  # fmt: skip
#: The statements of a device about a module.
MODULE: Final = by_name(_MODULE)

_DEVICE: Final[tuple[Fact[Any], ...]] = (
    Fact("address", WORD, "IP address.", lambda of: of.address),
    Fact("vlan", COUNTS, "VLAN ids of its network, the outer tag first; the same address in another VLAN is another station.",
         lambda of: vlan_ids(of.vlan), column="vlans", shape=VLANS),
    Fact("role", CODE, "Role of the device, by the heaviest evidence.", lambda of: of.role, codes=(*_ROLES, "unknown")),
    Fact("certainty", CODE, "How sure that is: `stated` it says so itself, `behaviour` it does what only such devices do,"
         " `tsap` its TSAP is one of such a device, null for an unknown role.", lambda of: of.certainty or None, null=True,
         codes=_SURE),
    Fact("evidence", RECORDS, "Evidence for the role, the heaviest first.",
         lambda of: sorted(of.reasons.values(), key=lambda reason: reason.weight), records=REASON),
    _said(facts.ORDER_NUMBER, "Order number (MLFB), the latest that was stated; null where none was."),
    _said(facts.HARDWARE, "Hardware version."),
    _said(facts.FIRMWARE, "Firmware version, such as `V3.2.6`."),
    _said(facts.SERIAL_NUMBER, "Serial number of the module."),
    _said(facts.STATION_NAME, "Name of the station."),
    _said(facts.MODULE_NAME, "Name of the module."),
    _said(facts.PLANT, "Plant designation."),
    _said(facts.OPERATING_MODE, "The latest operating mode, such as `RUN`."),
    _said(facts.PROTECTION, "Protection level in force, such as `1 (none)`."),
    Fact("macs", RECORDS, "MAC addresses one after another; that of a router where the device is behind one.",
         lambda of: of.history(facts.MAC), records=MAC),
    Fact("modules", RECORDS, "Statements of the device, by module.", _modules, records=MODULE),
    Fact("clock_offset_ns", DURATION, "How far its clock, as it was last read, is ahead of the capture's, which is in UTC, in"
         " nanoseconds; its time zone is part of that. Null where its clock was not read.", lambda of: of.clock_offset_ns,
         null=True),
    Fact("clock_set_offset_ns", DURATION, "The same of the time that its clock was last set to. Null where nobody set it.",
         lambda of: of.clock_set_offset_ns, null=True),
    Fact("blocks", JSON, "Blocks of its program.", None, shape={"$ref": "#/$defs/blocks"}),
    Fact("sessions", WORDS, "Its statements about itself as a client of S7comm-plus: application, computer, user.",
         lambda of: _list(of.sessions.texts)),
    Fact("tsaps", WORDS, "TSAPs with which it calls and is called, for a person.", lambda of: _list(of.tsaps.texts)),
    Fact("pdu_lengths", COUNTS, "PDU lengths that it granted.", lambda of: sorted(map(int, of.pdu_lengths.texts))),
    Fact("parallel_jobs", COUNTS, "Parallel jobs that it granted (AmQ).", lambda of: sorted(map(int, of.parallel_jobs.texts))),
    Fact("names_not_listed", COUNT, "Sessions, TSAPs, PDU lengths and numbers of parallel jobs that had no room: 16 of each are"
         " kept.", lambda of: sum([len(n.more) for n in (of.sessions, of.tsaps, of.pdu_lengths, of.parallel_jobs)])),
    Fact("connections", COUNT, "Connections to it.", lambda of: sum([talk.connections for talk in of.asked_by])),
    Fact("transactions", COUNT, "Transactions on these.", lambda of: sum([talk.transactions for talk in of.asked_by])),
    Fact("answered", COUNT, "Requests that it answered: those of its clients, and those that a server sent on a connection that"
         " it opened.", lambda of: of.asked.answered),
    Fact("likely", COUNT, "Only where there are any: those of `answered` that are only likely (`certainty` of a transaction);"
         " the answer times leave them out.", lambda of: of.asked.likely or None, rare=True, least=1),
    Fact("unanswered", COUNT, "Requests to it without an answer, although the answer was due.", lambda of: of.asked.missed),
    Fact("with_errors", COUNT, "Transactions of these with an answer that reports an error.", lambda of: of.asked.errors),
    Fact("answer_time_ns", OBJECT, "Its answer times.", lambda of: of.latencies,
         shape={"$ref": "urn:s7dissect:schema:analysis:1#/$defs/latency"}),
    Fact("asked_by", WORDS, "Addresses of its clients.", lambda of: [talk.client for talk in of.asked_by]),
    Fact("asks", WORDS, "Addresses of its servers.", lambda of: [talk.server for talk in of.asks]),
    Fact("first_frame", FRAME, "Number of the first packet of its connections; null for none.", lambda of: of.first_frame,
         null=True),
    Fact("first_time", TIME, "Time of the first packet.", lambda of: of.first_ns, column="ts"),
    Fact("last_frame", FRAME, "Number of the last packet of its connections; null for none.", lambda of: of.last_frame,
         null=True),
    Fact("last_time", TIME, "Time of the last packet.", lambda of: of.last_ns, column="end"),
    # ---- what JSON has inside of an object, or not at all
    Fact("host_name", WORD, "Name of the host, from the settings.", None, key=""),
    _said(facts.MODULE_TYPE, "Type of the module.", told=False),
    _said(facts.LOCATION, "Location designation.", told=False),
    _said(facts.MAX_CONNECTIONS, "Connections that it can have.", told=False),
    _said(facts.MAX_PDU, "Greatest PDU length that it can have.", told=False),
    _said(facts.MAC, "Address of its network card.", told=False),
    Fact("vendor", WORD, "Vendor of the network card.", _vendor, key="", null=True),
    _joined("vlan", "VLAN ids of its network.", lambda of: [vlan_text(of.vlan)]),
    _joined("pdu_lengths", "PDU lengths granted.", lambda of: of.pdu_lengths.texts),
    _joined("parallel_jobs", "Parallel jobs granted.", lambda of: of.parallel_jobs.texts),
    _joined("modules", "Racks and slots that were asked.", lambda of: [one for one in of.modules if one], ", "),
    _joined("blocks", "Blocks of its program, by type.", _block_counts, ", "),
    _joined("asked_by", "Addresses that asked it.", lambda of: [talk.client for talk in of.asked_by]),
    _joined("asks", "Addresses that it asked.", lambda of: [talk.server for talk in of.asks]),
    Fact("likely_count", COUNT, "Requests whose answer is only likely theirs; left out of the times.",
         lambda of: of.asked.likely, key="", column="likely"),
    Fact("median_ns", DURATION, "Median of its response times.", lambda of: of.latencies.as_dict()["median"], key="",
         unit="ns"),
    Fact("p95_ns", DURATION, "95th percentile of its response times.", lambda of: of.latencies.as_dict()["p95"], key="",
         unit="ns"),
    Fact("file", FILE, "Capture file of the first packet.", lambda of: of.first_frame, key=""),
)  # fmt: skip
#: The facts of a device by their names, in the order of their keys in JSON.
DEVICE: Final = by_name(_DEVICE)

_AREA: Final[tuple[Fact[Any], ...]] = (
    Fact("name", TEXT, "Data block (`DB10`) or area (`M`, `I`, `Q`, `T`, `C`).", lambda of: of.name),
    Fact("reads", COUNT, "Requests that read from it.", lambda of: of.reads),
    Fact("writes", COUNT, "Requests that wrote to it.", lambda of: of.writes),
    Fact("refused", COUNT, "Requests that were refused at least in part, counted in neither.", lambda of: of.refused),
    Fact("first_byte", COUNT, "First byte, or number of the timer or counter; null where it is not known.",
         lambda of: of.low if of.low >= 0 else None, null=True),
    Fact("last_byte", COUNT, "Last byte, or number of the timer or counter; null where it is not known.",
         lambda of: of.high if of.high >= 0 else None, null=True),
    Fact("tags", WORDS, "Tags that were read or written there, with `--tags` or by the program of an S7-1200/1500.",
         lambda of: _list(sorted(of.tags))),
    Fact("tags_not_listed", COUNT, "Tags that had no room.", lambda of: len(of.more_tags)),
)  # fmt: skip
#: The reads and writes in an area of a server.
AREA: Final = by_name(_AREA)

_TALK: Final[tuple[Fact[Any], ...]] = (
    Fact("client", TEXT, "Address of the client.", lambda of: of.client),
    Fact("server", TEXT, "Address of the server.", lambda of: of.server),
    Fact("vlan", COUNTS, "The VLAN ids of their network, the outer tag first.", lambda of: vlan_ids(of.vlan), shape=VLANS),
    Fact("connections", COUNT, "Connections between them; 0 where the server of others asks on their connection.",
         lambda of: of.connections),
    Fact("protocols", WORDS, "Protocols of these connections, as `protocol` of a connection in the analysis.",
         lambda of: [text for text in of.protocols.texts if text]),
    Fact("transactions", COUNT, "Transactions.", lambda of: of.transactions),
    Fact("reads", COUNT, "Requests that read variables.", lambda of: of.reads),
    Fact("writes", COUNT, "Requests that write variables.", lambda of: of.writes),
    Fact("answered", COUNT, "Transactions with an answer.", lambda of: of.answered),
    Fact("unanswered", COUNT, "Requests without an answer, although the answer was due.", lambda of: of.missed),
    Fact("with_errors", COUNT, "Transactions with an answer that reports an error.", lambda of: of.errors),
    Fact("pushes", COUNT, "Messages that were sent without a request.", lambda of: of.pushes),
    Fact("operations", JSON, "Operations by kind, as in `operations`.", lambda of: dict(sorted(of.operations.items())),
         shape={"type": "object", "additionalProperties": {"type": "integer", "minimum": 1}}),
    Fact("areas", RECORDS, "Areas of the server that are read and written.",
         lambda of: [of.areas[name] for name in sorted(of.areas)], records=AREA),
    Fact("areas_not_listed", COUNT, "Areas that had no room.", lambda of: len(of.more_areas)),
    Fact("first_frame", FRAME, "Number of the first packet between them; null for none.", lambda of: of.first_frame, null=True),
    Fact("first_time", TIME, "Time of it.", lambda of: of.first_ns if of.first_frame else None, null=True),
    Fact("last_frame", FRAME, "Number of the last packet between them; null for none.", lambda of: of.last_frame, null=True),
    Fact("last_time", TIME, "Time of it.", lambda of: of.last_ns if of.last_frame else None, null=True),
)  # fmt: skip
#: The talk of a client and a server.
TALK: Final = by_name(_TALK)
