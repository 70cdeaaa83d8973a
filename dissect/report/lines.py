"""Transactions, PDUs and TPDUs for a person, one a line."""

from __future__ import annotations

from typing import Final

from dissect.ibh.packet import IbhPacket
from dissect.ibh.tables import IBH_NETLINK
from dissect.iso.cotp import Tpdu
from dissect.iso.foreign import identify, identify_connect
from dissect.iso.tables import CC, CR, DR, DT, ED, ER
from dissect.iso.upper import EMPTY, S7COMM, S7COMM_PLUS, UPPER_NAMES, classify, is_rdp_connect
from dissect.report import words
from dissect.report.facets import facet_of
from dissect.report.places import Places
from dissect.report.plus import plus_notes, plus_summary
from dissect.report.scd import scd_summary
from dissect.report.styled import FAILED, HANG, PLAIN, Line
from dissect.s7.errors import ERROR_CODES
from dissect.s7.items import Item
from dissect.s7.message import Pdu
from dissect.s7.tables import JOB, RETURN_CODES, SUCCESS
from dissect.s7plus.hiding import shown_contents
from dissect.s7plus.message import PlusPdu
from dissect.transactions.connection import Connection
from dissect.transactions.naming import Naming
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.results import ItemResult
from dissect.transactions.transaction import PUSH, Transaction
from dissect.wire.clock import Clock
from dissect.wire.text import printable, shortened

#: What people call the protocols that TSDUs speak; the names of `UPPER_NAMES` are for programs.
PROTOCOLS: Final = {
    "s7comm": "S7comm",
    "s7comm_plus": "S7comm-plus",
    "mms": "MMS",
    "tls": "TLS",
    "rdp": "RDP",
    "scd": "SCD",
    "unknown": "unknown protocol",
    IBH_NETLINK: "IBH-NetLink",
}

#: Characters of a packet comment that are shown.
_COMMENT: Final = 1000
_KINDS: Final = ("push", "request", "response", "type 3")


def transaction_line(transaction: Transaction, clock: Clock, places: Places) -> str:
    """Return one transaction on one line: when, who asked whom, how long, what, what came of it."""
    ends = transaction.connection.tcp.ends
    begun = transaction.request_ns if transaction.request_frame else transaction.response_ns
    asked, answered = ends[transaction.asked_by], ends[1 - transaction.asked_by]
    facet = facet_of(transaction)
    if facet.pushes_both_ways() and transaction.outcome == PUSH:
        asked, answered = answered, asked  # shown as it went
    frames = places.pair(int(transaction.request_frame), int(transaction.response_frame))
    parts = [part for part in (words.outcome(transaction), facet.subject(transaction)) if part]
    said = f"  {'  '.join(parts)}" if parts else ""
    return (
        f"{clock.moment(begun)}  #{transaction.number:<5} {frames:<12} {places.end(asked)} → {places.end(answered)}"
        f"  {words.duration(transaction.latency_ns):>8}  {transaction.function_name}{said}"
    )


def styled_transaction(transaction: Transaction, clock: Clock, places: Places) -> Line:
    """Return `transaction_line` with its style: what failed stands out."""
    style = FAILED if transaction.failed else PLAIN
    return Line(transaction_line(transaction, clock, places), style, HANG)


def pdu_line(pdu: Pdu, connection: Connection, clock: Clock, places: Places) -> str:
    """Return one S7 PDU on one line."""
    said = f"  {body}" if (body := _body(pdu, connection.naming)) else ""
    function = f"  {pdu.function_name}" if pdu.function_name else ""
    if pdu.cut:
        said += "  TRUNCATED by the capture"
    if pdu.malformed:
        said += f"  MALFORMED {pdu.malformed[0]}"
    kind = pdu.rosctr_name if pdu.rosctr >= 0 else "?"
    reference = f"0x{pdu.pdu_ref:04x}" if pdu.pdu_ref >= 0 else "?"
    head = _head(pdu.frame, pdu.time_ns, connection, pdu.side, clock, places)
    return f"{head}  {kind:<8}  ref {reference}{function}{said}"


def scd_line(found: ScdMessage, connection: Connection, clock: Clock, places: Places) -> str:
    """Return one SCD message on one line."""
    head = _head(int(found.frame), int(found.time_ns), connection, int(found.side), clock, places)
    return f"{head}  {scd_summary(found)}"


def plus_line(pdu: PlusPdu, connection: Connection, clock: Clock, places: Places) -> str:
    """Return one S7comm-plus PDU on one line."""
    parts = [f"S7comm-plus {pdu.kind:<12}"]
    if pdu.readable:
        parts.append(f"seq {pdu.sequence}")
    found = shown_contents(pdu, shown=False)[0]
    said = [", ".join(plus_notes(pdu)), ", ".join(plus_summary(pdu, found))]
    parts += [text for text in (pdu.function_name, *said) if text]
    if pdu.frames > 1:
        parts.append(f"in {pdu.frames} frames")
    if pdu.cut:
        parts.append("CUT, the end is missing")
    if pdu.malformed:
        parts.append(f"MALFORMED {pdu.malformed[0]}")
    elif found.malformed and not pdu.cut:
        found.malformed[0].offset = pdu.place(found.malformed[0].offset)
        parts.append(f"MALFORMED {found.malformed[0]}")
    return f"{_head(pdu.frame, pdu.time_ns, connection, pdu.side, clock, places)}  {'  '.join(parts)}"


def _head(frame: int, time_ns: int, connection: Connection, side: int, clock: Clock, places: Places) -> str:
    ends = connection.tcp.ends
    return f"{places.mark(frame):>6}  {clock.moment(time_ns)}  {places.end(ends[side])} → {places.end(ends[1 - side])}"


def _body(pdu: Pdu, naming: Naming | None) -> str:
    parameters = pdu.parameters
    if pdu.error_class > 0 or pdu.error_code > 0:
        code = (pdu.error_class << 8) | pdu.error_code
        return f"error 0x{code:04x} {ERROR_CODES.name(code)}"
    if parameters.setup is not None:
        setup = parameters.setup
        return f"PDU {setup.pdu_length}, AmQ {setup.max_amq_calling}/{setup.max_amq_called}"
    if parameters.items and pdu.rosctr == JOB:
        return _requested(pdu, parameters.items, naming)
    codes = pdu.return_codes()
    if codes:
        refused = [
            f"item {number}: {RETURN_CODES.name(code)}" for number, code in enumerate(codes, 1) if code != SUCCESS
        ]
        good = words.count(len(codes), "item")
        if not refused:
            return f"{good}, all good" if len(codes) > 1 else f"{good}, good"
        return f"{len(refused)} of {good} refused: {', '.join(refused)}"
    head = parameters.userdata
    said = words.body_notes(pdu)
    if head is None:
        return said
    error = f", error 0x{head.error_code:04x} {ERROR_CODES.name(head.error_code)}" if head.error_code else ""
    more = ", more to come" if head.extended and head.last_data_unit else ""
    return f"{_KINDS[head.type]}, sequence {head.sequence}{more}{error}{f'  {said}' if said else ''}"


def _requested(pdu: Pdu, items: list[Item], naming: Naming | None) -> str:
    """Return the items a job asks for, with the values it writes."""
    data = pdu.data_items()
    said = []
    for index, item in enumerate(items):
        written = data[index].data if index < len(data) else None
        said.append(words.item(ItemResult(item, -1, written, None), index + 1, naming))
    return ", ".join(said)


def tpdu_line(
    tpdu: Tpdu, frame: int, time_ns: int, connection: Connection, side: int, clock: Clock, places: Places
) -> str:
    """Return a TPDU that carries no S7 PDU on one line."""
    said = ""
    if tpdu.type in {CR, CC} and is_rdp_connect(tpdu.variable):
        said = identify_connect(tpdu.variable)
        return f"{_head(frame, time_ns, connection, side, clock, places)}  COTP {tpdu.name}  RDP, {said}"
    if tpdu.type in {CR, CC}:
        siemens = connection.protocol in {"", "s7comm", "s7comm_plus"}
        said = f"  {words.tsaps(tpdu.tsap(0xC1), tpdu.tsap(0xC2), siemens)}"
        if tpdu.tpdu_size:
            said += f", TPDU size {tpdu.tpdu_size}"
    elif tpdu.type in {DR, ER}:
        said = "".join(
            [
                f"  {value.field.codes.name(value.value)}"
                for value in tpdu.fields
                if value.field.codes and value.offset > 1
            ]
        )
    elif tpdu.type in {DT, ED}:
        said = f"  {carried(tpdu)}, {words.count(len(tpdu.data), 'byte')}"
        identity = identify(classify(tpdu.data, 0, len(tpdu.data)), tpdu.data, 0, len(tpdu.data))
        said += f": {identity}" if identity else ""
    if tpdu.malformed:
        said += f"  MALFORMED {tpdu.malformed[0]}"
    return f"{_head(frame, time_ns, connection, side, clock, places)}  COTP {tpdu.name}{said}"


def netlink_line(
    packet: IbhPacket, frame: int, time_ns: int, connection: Connection, side: int, clock: Clock, places: Places
) -> str:
    """Return an IBH-NetLink packet that carries no S7 PDU on one line."""
    parts = [packet.name]
    if packet.station >= 0:
        parts.append(f"station {packet.station}, connection {packet.src_conn}/{packet.dst_conn}")
    if packet.acked >= 0:
        parts.append(f"of packet {packet.acked}")
    if packet.data:
        parts.append(f"{message_name(packet.data)}, {words.count(len(packet.data), 'byte')}")
    said = "  ".join(parts)
    if packet.malformed:
        said += f"  MALFORMED {packet.malformed[0]}"
    return f"{_head(frame, time_ns, connection, side, clock, places)}  IBH {said}"


def carried(tpdu: Tpdu) -> str:
    """Return what people call the protocol of the user data of a DT or ED; empty when there is no data, or S7comm."""
    return message_name(tpdu.data)


def message_name(octets: bytes) -> str:
    """Return what people call the protocol of a message; empty when there is none, or one whose PDUs have own lines."""
    upper = classify(octets, 0, len(octets))
    return "" if upper in {S7COMM, S7COMM_PLUS, EMPTY} else PROTOCOLS[UPPER_NAMES[upper]]


def comment_line(frame: int, text: str, places: Places) -> str:
    """Return a comment the capture holds about a packet."""
    return f"{places.mark(frame):>6}  comment: {shortened(text, _COMMENT)}"


def named(connection: Connection) -> str:
    """Return what people call the protocol of a connection and what identifies it, empty when nothing was said on it."""
    name = PROTOCOLS.get(connection.protocol, printable(connection.protocol))
    return f"{name} ({connection.identified_by})" if connection.identified_by else name
