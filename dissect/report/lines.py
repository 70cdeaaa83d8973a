"""Transactions and PDUs for a person, one a line; transactions as CSV cells."""

from __future__ import annotations

from dissect.iso.cotp import Tpdu
from dissect.iso.tables import CC, CR, DR, ER
from dissect.report import words
from dissect.s7.message import Pdu
from dissect.s7.tables import JOB, RETURN_CODES, SUCCESS
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock
from dissect.wire.text import cell, printable

#: The columns of `transactions -T csv`.
CSV_COLUMNS = [
    "number",
    "connection",
    "asked_by",
    "answered_by",
    "pdu_ref",
    "rosctr",
    "function",
    "function_name",
    "request_frame",
    "response_frame",
    "request_time",
    "latency_ns",
    "outcome",
    "reason",
    "items",
    "errors",
]


def time_of_day(clock: Clock, time_ns: int) -> str:
    """Return hours to microseconds, UTC."""
    return clock.iso(time_ns)[11:26]


def transaction_line(transaction: Transaction, clock: Clock) -> str:
    """Return one transaction on one line: when, who asked whom, what, how long, what came of it."""
    ends = transaction.connection.tcp.ends
    begun = transaction.request_ns if transaction.request_frame else transaction.response_ns
    asked, answered = ends[transaction.asked_by], ends[1 - transaction.asked_by]
    frames = "→".join(
        [str(frame) if frame else "?" for frame in (transaction.request_frame, transaction.response_frame)]
    )
    parts = [part for part in (words.outcome(transaction), words.subject(transaction)) if part]
    said = f"  {'  '.join(parts)}" if parts else ""
    return (
        f"{time_of_day(clock, begun)}  #{transaction.number:<5} {frames:<12} {asked} → {answered}"
        f"  {words.duration(transaction.latency_ns):>8}  {transaction.function_name}{said}"
    )


def transaction_cells(transaction: Transaction, clock: Clock) -> list[str]:
    """Return one transaction as cells in the order of `CSV_COLUMNS`, safe for spreadsheets."""
    ends = transaction.connection.tcp.ends
    latency = transaction.latency_ns
    values: list[str] = [
        str(transaction.number),
        str(transaction.connection.number),
        str(ends[transaction.asked_by]),
        str(ends[1 - transaction.asked_by]),
        str(transaction.pdu_ref),
        str(transaction.rosctr),
        str(transaction.function) if transaction.function >= 0 else "",
        transaction.function_name,
        str(transaction.request_frame or ""),
        str(transaction.response_frame or ""),
        clock.iso(transaction.request_ns) if transaction.request_frame else "",
        str(latency) if latency is not None else "",
        transaction.outcome_name,
        transaction.reason,
        "; ".join([words.item(result) for result in transaction.results()]),
        "; ".join([f"{error.where}: 0x{error.code:02x} {error.name}" for error in transaction.errors]),
    ]
    return [cell(text) for text in values]


def pdu_line(pdu: Pdu, connection: Connection, clock: Clock) -> str:
    """Return one S7 PDU on one line."""
    ends = connection.tcp.ends
    said = f"  {body}" if (body := _body(pdu)) else ""
    function = f"  {pdu.function_name}" if pdu.function_name else ""
    if pdu.cut:
        said += "  CUT by the capture"
    for fact in pdu.malformed[:1]:
        said += f"  MALFORMED {fact}"
    return (
        f"{pdu.frame:>6}  {time_of_day(clock, pdu.time_ns)}  {ends[pdu.side]} → {ends[1 - pdu.side]}"
        f"  {pdu.rosctr_name:<8}  ref 0x{max(pdu.pdu_ref, 0):04x}{function}{said}"
    )


def _body(pdu: Pdu) -> str:
    parameters = pdu.parameters
    if pdu.error_class > 0 or pdu.error_code > 0:
        from dissect.s7.errors import ERROR_CODES

        code = (pdu.error_class << 8) | pdu.error_code
        return f"error 0x{code:04x} {ERROR_CODES.name(code)}"
    if parameters.setup is not None:
        setup = parameters.setup
        return f"PDU {setup.pdu_length}, AmQ {setup.max_amq_calling}/{setup.max_amq_called}"
    if parameters.items and pdu.rosctr == JOB:
        return ", ".join(
            [f"{item.address}[{item.count}]" if item.count > 1 else item.address for item in parameters.items]
        )
    codes = pdu.return_codes()
    if codes:
        refused = [
            f"item {number}: {RETURN_CODES.name(code)}" for number, code in enumerate(codes, 1) if code != SUCCESS
        ]
        return ", ".join(refused) or f"{words.count(len(codes), 'item')}, all good"
    head = parameters.userdata
    if head is not None:
        kind = ("push", "request", "response", "type 3")[head.type]
        error = f", error 0x{head.error_code:04x}" if head.error_code else ""
        return f"{kind}, sequence {head.sequence}{error}"
    return ""


def tpdu_line(tpdu: Tpdu, frame: int, time_ns: int, connection: Connection, side: int, clock: Clock) -> str:
    """Return a TPDU other than a plain DT on one line."""
    ends = connection.tcp.ends
    said = ""
    if tpdu.type in {CR, CC}:
        calling, called = tpdu.tsap(0xC1), tpdu.tsap(0xC2)
        one = printable(calling.describe(False)) if calling is not None else "?"
        other = printable(called.describe()) if called is not None else "?"
        said = f"  TSAP {one} → {other}" + (f", TPDU size {tpdu.tpdu_size}" if tpdu.tpdu_size else "")
    elif tpdu.type in {DR, ER}:
        value = tpdu.fields[-1]
        codes = value.field.codes
        said = f"  {codes.name(value.value) if codes is not None else value.value}"
    for fact in tpdu.malformed[:1]:
        said += f"  MALFORMED {fact}"
    return f"{frame:>6}  {time_of_day(clock, time_ns)}  {ends[side]} → {ends[1 - side]}  COTP {tpdu.name}{said}"
