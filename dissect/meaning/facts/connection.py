"""The facts of a connection."""

from __future__ import annotations

from typing import Any, Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU, EVICTED, FIN, OPEN, REPLACED, RESET, REUSED
from dissect.meaning.facts.fact import (
    CODE,
    COUNT,
    COUNTS,
    END,
    FILE,
    FLAG,
    FRAME,
    JSON,
    OBJECT,
    TEXT,
    TIME,
    TSAP,
    Fact,
    by_name,
)
from dissect.packets.tcp.link import vlan_ids
from dissect.packets.tcp.stream import Endpoint

#: The VLAN ids of a packet.
_VLANS: Final = {"type": "array", "items": {"type": "integer", "minimum": 0, "maximum": 4095}}
_SETUP: Final = {"oneOf": [{"$ref": "urn:s7dissect:schema:transaction:1#/$defs/setup"}, {"type": "null"}]}
_ROLES: Final = ("client", "server")


def _start(connection: Connection) -> str:
    return "syn" if connection.tcp.known_start else ("cr" if connection.cr_seen else "mid_stream")


def _rack(connection: Connection) -> int | None:
    called = connection.tsap_called
    return called.rack if called is not None and called.rack >= 0 else None


def _slot(connection: Connection) -> int | None:
    called = connection.tsap_called
    return called.slot if called is not None and called.slot >= 0 else None


def _granted(connection: Connection, name: str) -> Any:
    return getattr(connection.granted, name) if connection.granted is not None else None


def _ended_by(connection: Connection) -> Endpoint | None:
    ending = connection.ending
    return connection.tcp.ends[ending.side] if ending is not None and ending.side >= 0 else None


def _ended_role(connection: Connection) -> str | None:
    ending = connection.ending
    return connection.role(ending.side) if ending is not None and ending.side >= 0 else None


def _octets(connection: Connection, role: int) -> int:
    side = connection.client_side if role == 0 else 1 - connection.client_side
    return int(connection.tcp.streams[side].octets)


def _uid(connection: Connection) -> str:
    from dissect.meaning.facts.keys import connection_uid  # late, with hashlib: only tables have it

    return connection_uid(connection)


def _community_id(connection: Connection) -> str:
    from dissect.meaning.facts.keys import connection_community_id

    return connection_community_id(connection)


def _missing(connection: Connection) -> int:
    return sum([max(0, int(stream.position) - int(stream.octets)) for stream in connection.tcp.streams])


_ROWS: Final[tuple[Fact[Connection], ...]] = (
    Fact("number", COUNT, "Number of the connection in the run, in order of first bytes.",
         lambda of: int(of.number), column="connection", least=1),
    Fact("client", END, "The end that opened the connection.", lambda of: of.client),
    Fact("server", END, "The other end, usually the PLC.", lambda of: of.server),
    Fact("client_known", FLAG, "False if the client is known only by the port number.", lambda of: bool(of.client_known)),
    Fact("transport", CODE, "`udp` only where a binding points at it.", lambda of: "udp" if of.udp else "tcp",
         codes=("tcp", "udp")),
    Fact("vlan", COUNTS, "VLAN ids of its first packet, the outer tag first; empty without tags.",
         lambda of: vlan_ids(int(of.tcp.vlan)), column="vlans", shape=_VLANS),
    Fact("also_vlans", JSON, "VLAN ids of other VLANs in which packets of it were captured: one direction has tags of its own,"
         " or packets were captured twice. Only where there are some.",
         lambda of: [vlan_ids(vlan) for vlan in of.tcp.also] or None, rare=True,
         shape={"type": "array", "minItems": 1, "items": _VLANS}),
    Fact("protocol", CODE, "The protocol of its messages, null if there are none; `ibh_netlink`: S7comm through such a gateway,"
         " in its packets instead of TPKTs; `scd` where a binding says so.", lambda of: of.protocol or None, null=True,
         codes=("s7comm", "s7comm_plus", "mms", "tls", "rdp", "unknown", "ibh_netlink", "scd")),
    Fact("identified_by", TEXT, "For a different protocol its identification, for a person: TLS record, version and server"
         " name, ISO session SPDU with application context and AP titles, RDP cookie and security, first bytes; for S7comm-plus"
         " that InitSSL was requested and what followed. Null elsewhere.", lambda of: of.identified_by or None, null=True),
    Fact("tls", JSON, "TLS in its COTP messages, as far as it was captured (docs/tls.md); null without it.",
         None, shape={"oneOf": [{"$ref": "#/$defs/tls"}, {"type": "null"}]}),
    Fact("start", CODE, "Its begin: the TCP handshake, the COTP connect request alone, or a point in the middle.",
         _start, codes=("syn", "cr", "mid_stream")),
    Fact("first_frame", FRAME, "Its first packet, within its file.", lambda of: int(of.tcp.first_frame)),
    Fact("first_time", TIME, "Time of `first_frame`.", lambda of: int(of.tcp.first_ns), column="ts"),
    Fact("last_frame", FRAME, "Its last packet, within its file.", lambda of: int(of.last_frame)),
    Fact("last_time", TIME, "Time of `last_frame`.", lambda of: int(of.last_ns), column="end"),
    Fact("calling_tsap", TSAP, "TSAP of the client, null when the connect request was not captured.",
         lambda of: of.tsap_calling, column="tsap_calling"),
    Fact("called_tsap", TSAP, "TSAP of the server; for a Siemens CPU it contains rack and slot.",
         lambda of: of.tsap_called, column="tsap_called"),
    Fact("tpdu_size", COUNT, "Bytes of the largest COTP TPDU, as confirmed; null when that was not captured.",
         lambda of: int(of.tpdu_size) or None, unit="bytes", null=True, least=128),
    Fact("setup_asked", OBJECT, "Setup communication: the client's last request, null when not captured.",
         lambda of: of.setup_asked, shape=_SETUP),
    Fact("setup_granted", OBJECT, "Setup communication: the last grant, null when not captured.", lambda of: of.granted,
         shape=_SETUP),
    Fact("pdus", COUNT, "S7 PDUs.", lambda of: int(of.pdus)),
    Fact("behind_malformed", COUNT, "Only where there are any: PDUs behind malformed TPDU headers, which `pdus` does"
         " not count.",
         lambda of: int(of.behind) or None, rare=True, least=1),
    Fact("answered", COUNT, "Requests with their answers.", lambda of: int(of.answered)),
    Fact("unanswered", COUNT, "Requests without answer, those included whose answer was not due yet when the capture ended.",
         lambda of: int(of.unanswered)),
    Fact("still_open", COUNT, "Part of `unanswered`: the answer was not due yet when the capture ended; these did not fail.",
         lambda of: int(of.still_open)),
    Fact("answers_not_captured", COUNT, "Only where there are any: those of `unanswered` whose answer may be what the capture"
         " lacks: it is in a gap, for sure or perhaps (reason `hole`), or only the other direction was captured (`one_sided`);"
         " they did not fail.", lambda of: int(of.not_captured) or None, rare=True, least=1),
    Fact("orphan_answers", COUNT, "Answers without request.", lambda of: int(of.orphans), column="orphans"),
    Fact("unsolicited", COUNT, "Messages that stand alone: pushes (indications), and requests that want no answer.",
         lambda of: int(of.unsolicited)),
    Fact("one_way", COUNT, "Those of `unsolicited` that are requests which want no answer (S7comm-plus); the others are"
         " pushes.",
         lambda of: int(of.one_way)),
    Fact("with_errors", COUNT, "Transactions whose answer reports an error.", lambda of: int(of.errors)),
    Fact("refused", TEXT, "Why the connect request was refused by a COTP DR, null when it was not.",
         lambda of: of.refused or None, null=True),
    Fact("disconnected", TEXT, "The COTP DR or ER that ended it, in words, null when there was none.",
         lambda of: of.iso_ended or None, null=True),
    Fact("ended", CODE, "How it ended, as `ending.how` says: still open at the end of the capture, TCP FIN, TCP RST (what came"
         " first: `ending.reset` has a RST that followed another end), COTP DR or ER, a new connection on the same addresses"
         " (`reused`: with a TCP handshake, `replaced`: with a COTP connect request), or dropped because too much was open"
         " at once.",
         lambda of: of.ended, codes=(OPEN, FIN, RESET, DISCONNECT, ERROR_TPDU, REUSED, EVICTED, REPLACED)),
    Fact("ended_by", END, "The side that ended it, null if neither did.", _ended_by, null=True),
    Fact("ended_frame", FRAME, "The packet of that, within its file.",
         lambda of: int(of.ending.frame) if of.ending is not None else 0, null=True),
    Fact("open_at_end", COUNT, "Requests without answer when it ended; 0 while it is open.", lambda of: int(of.open_at_end)),
    Fact("ending", JSON, "How it ended, by which side, what was pending and what came before; null only during"
         " reading.", None,
         shape={"oneOf": [{"$ref": "#/$defs/ending"}, {"type": "null"}]}),
    # ---- what JSON has inside of an object, or not at all
    Fact("ended_role", CODE, "Which of the two ended it.", _ended_role, key="", column="ended_by", null=True, codes=_ROLES),
    Fact("rack", COUNT, "Rack that the called TSAP names.", _rack, key="", null=True),
    Fact("slot", COUNT, "Slot that the called TSAP names.", _slot, key="", null=True),
    Fact("pdu_length", COUNT, "PDU length granted on the connection.", lambda of: int(of.pdu_length) or None, key="",
         unit="bytes", null=True),
    Fact("max_amq_calling", COUNT, "Parallel jobs granted to the caller.", lambda of: _granted(of, "max_amq_calling"), key="",
         null=True),
    Fact("max_amq_called", COUNT, "Parallel jobs granted to the called side.", lambda of: _granted(of, "max_amq_called"),
         key="", null=True),
    Fact("uid", TEXT, "Identifier in the form of Zeek, the same for the same traffic.", _uid, key=""),
    Fact("community_id", TEXT, "Community ID v1, joins with Zeek, Suricata, Elastic.", _community_id, key=""),
    Fact("file", FILE, "Capture file of the first packet.", lambda of: int(of.tcp.first_frame), key=""),
    Fact("packets", COUNT, "Packets both ways.", lambda of: int(of.tcp.packets), key=""),
    Fact("client_bytes", COUNT, "Payload that the client sent.", lambda of: _octets(of, 0), key="", unit="bytes"),
    Fact("server_bytes", COUNT, "Payload that the server sent.", lambda of: _octets(of, 1), key="", unit="bytes"),
    Fact("missing_bytes", COUNT, "Payload missing from the capture.", _missing, key="", unit="bytes"),
)  # fmt: skip

#: The facts of a connection by their names, in the order of their keys in JSON.
CONNECTION: Final[dict[str, Fact[Connection]]] = by_name(_ROWS)
