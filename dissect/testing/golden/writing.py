"""Writes a session as text: the format ``s7dissect golden 1`` (docs/golden.md).

Each connection and each transaction is a block of lines; indentation shows the structure. A number sign begins a remark, which
explains and is never parsed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final

from dissect.engine.transactions.naming import Naming
from dissect.engine.transactions.transaction import BEHIND_MALFORMED, DOUBT_TEXTS, LIKELY, OUTCOMES
from dissect.meaning.report import facets, words
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.s7.build import build_setup
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.message import NOT_REFUSED, Pdu
from dissect.protocols.s7.tables import ACK_DATA, JOB, READ_VAR, RETURN_CODES, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.testing.golden import forms, usual
from dissect.testing.golden.blocks import cut_blocks
from dissect.testing.golden.exchange import PARSED, PLUS, S7, SCD, SMALL, Exchange
from dissect.testing.golden.forms import ItemLine, build_request, form_lines
from dissect.testing.golden.model import Link, Session, Transaction
from dissect.testing.golden.plus import plus_notes
from dissect.testing.golden.values import hex_text, quoted
from dissect.wire.text import Clock, printable

FORMAT: Final = "s7dissect golden 1"
#: Properties of one recording that a golden contains only on request.
EXTRAS: Final = ("time", "addresses", "refs", "latency")
#: Heads of transactions whose lines are items or sizes.
FORMS: Final = {READ_VAR: "READ", WRITE_VAR: "WRITE", SETUP_COMMUNICATION: "SETUP"}

#: Follows the reason `hole` if it is uncertain that the request was answered.
PERHAPS: Final = ", perhaps"
#: The sender of unsolicited messages, by the role that is named as the requester.
OTHER_ROLE: Final = {"client": "server", "server": "client"}
#: The beginning of a line of an unsolicited message, which is written in the place of an answer.
_PUSHED: Final = re.compile(r'^(  (?:scd ")?)answer ', re.MULTILINE)

_WIDTH: Final = 116
_CONTINUED: Final = " " * 8
#: Below a pair if one half came after a malformed TPDU header; and the outcome of a message after one that is in no pair.
BEHIND_HEADER: Final = "behind a malformed header"
ALONE: Final = OUTCOMES[BEHIND_MALFORMED]
#: Maximum number of notes that a remark repeats.
_NOTES: Final = 12
#: A job number that is in the masked sequence number.
_MASKED_JOB: Final = "job 0"


def golden_text(session: Session, extras: Iterable[str] = ()) -> str:
    """Return a session as text; ``extras`` are names of `EXTRAS`."""
    return "".join([f"{line}\n" for line in golden_lines(session, extras)])


def golden_lines(session: Session, extras: Iterable[str] = (), naming: Naming | None = None) -> Iterator[str]:
    """Yield `golden_text` in pieces of one or more lines; with ``naming``, remarks name the tags of items."""
    wanted = frozenset(extras)
    clock = Clock()
    plain = not wanted and naming is None
    yield FORMAT
    for link in session.links:
        jobs: dict[bytes, int] = {}
        yield ""
        yield f"connection {link.number}"
        yield from _link_lines(link, "addresses" in wanted)
        for transaction in link.transactions:
            if plain and transaction.outcome == "answered" and not (transaction.doubt or transaction.reason):
                exchange = transaction.exchange
                form = _form(exchange)
                if form and not exchange.subscribed:
                    lines = exchange.fragment or _fragment(exchange)
                    yield f"\n{transaction.number} {transaction.asked_by} {form}\n{lines}"
                    continue
            yield ""
            yield f"{transaction.number} {_head(transaction)}"
            if transaction.outcome != "answered" or transaction.doubt or transaction.reason:
                yield from _outcome(transaction)
            if transaction.exchange.subscribed or not transaction.exchange.form:
                yield from _job(transaction, transaction.number, jobs)
            if wanted:
                yield from _extra_lines(transaction, wanted, clock)
            if lines := _cached_lines(transaction):
                yield lines
            if naming is not None:
                yield from _named(transaction, naming)


def _named(transaction: Transaction, naming: Naming) -> Iterator[str]:
    """Yield the tags of the items as remarks, which the parser skips."""
    for item in transaction.items:
        yield from [f"    # {facets.named_value(value)}" for value in naming.named(item.result) if value.name]


def link_lines(link: Link) -> Iterator[str]:
    """Yield the text of a connection except for its number; connections are sorted by it."""
    yield from _link_lines(link, False)
    jobs: dict[bytes, int] = {}
    for place, transaction in enumerate(link.transactions, 1):
        yield _head(transaction)
        yield from _outcome(transaction)
        yield from _job(transaction, place, jobs)
        if lines := _cached_lines(transaction):
            yield from lines.split("\n")


def _head(transaction: Transaction) -> str:
    """Return the head of a transaction: the side, and its request or unsolicited message."""
    exchange = transaction.exchange
    who = OTHER_ROLE.get(transaction.asked_by, "") if pushed(transaction) else transaction.asked_by
    return f"{who} {_form(exchange) or printable(exchange.function_name)}"


def _cached_lines(transaction: Transaction) -> str:
    """Return the lines of request and answer, cached for all transactions that share the exchange."""
    exchange = transaction.exchange
    fragment = exchange.fragment or _fragment(exchange)
    return _PUSHED.sub(r"\1says ", fragment) if pushed(transaction) else fragment


def _fragment(exchange: Exchange) -> str:
    """Return the lines of request and answer of an exchange."""
    lines = _usual_lines(exchange) or list(_exchange_lines(exchange))
    if _are_wide(lines):
        wrapped: list[str] = []
        for line in lines:
            if len(line) <= _WIDTH:
                wrapped.append(line)
            else:
                wrapped += _wrapped(line)
        lines = wrapped
    exchange.fragment = "\n".join(lines)
    return exchange.fragment


def _are_wide(lines: list[str]) -> bool:
    """Return whether a line is wider than a line of a golden is."""
    for line in lines:  # noqa: SIM110 - compiled, any() would be slower
        if len(line) > _WIDTH:
            return True
    return False


def _usual_lines(exchange: Exchange) -> list[str] | None:
    """Return a read or write and its answer as lines if both are ordinary, otherwise None."""
    request = exchange.parse_request() if _form(exchange) else None
    if request is None or exchange.scd:
        return None
    if request.function == READ_VAR:
        return usual.read_lines(request.parameters.items, exchange.response)
    if request.function != WRITE_VAR:
        return None
    written = request.data_items()
    data, kinds = [item.data for item in written], [int(item.transport_size) for item in written]
    return usual.write_lines(request.parameters.items, data, kinds, exchange.response)


def pushed(transaction: Transaction) -> bool:
    """Return whether a transaction is an unsolicited message: it has only an answering half."""
    exchange = transaction.exchange
    return transaction.outcome == "unsolicited" and exchange.response_seen and not exchange.request_seen


# ---- connections ----------------------------------------------------------------------------------------------------


def _link_lines(link: Link, addresses: bool) -> Iterator[str]:
    if link.protocol:
        yield f"  protocol {printable(link.protocol)}"
    if link.carrier != "tcp":
        yield f"  carrier {printable(link.carrier)}"
    for role, octets, address in zip(("client", "server"), (link.calling, link.called), link.addresses, strict=True):
        if octets is not None:
            meaning = printable(Tsap(octets).means(link.protocol, role == "server"))
            yield f"  {role} TSAP {hex_text(octets)}  # {meaning}"
        if addresses and address:
            yield f"  {role} address {address}"
    if link.tpdu_size or link.tpdu_size_asked:
        yield f"  TPDU size {link.tpdu_size}, asked {link.tpdu_size_asked}"
    if not link.begun and link.carrier != "udp":
        yield "  begins before the capture"
    if link.refused:
        yield f"  refused {quoted(link.refused)}"
    if link.ended:
        by = f" by {link.ended_by}" if link.ended_by else ""
        yield f"  ends {link.ended}{by}{f' {quoted(link.farewell)}' if link.farewell else ''}"


# ---- transactions ---------------------------------------------------------------------------------------------------


def _outcome(transaction: Transaction) -> Iterator[str]:
    if transaction.doubt:
        yield f"  likely: {transaction.doubt}  # {DOUBT_TEXTS[transaction.doubt]}"
    if transaction.outcome == "answered":
        if transaction.reason:
            yield f"  {BEHIND_HEADER}"
    elif transaction.outcome == "unanswered" or (transaction.outcome == ALONE and transaction.exchange.request_seen):
        yield f"  no answer: {transaction.reason}{PERHAPS if transaction.certainty == LIKELY else ''}"
    elif transaction.outcome in {"orphan_answer", ALONE}:
        yield f"  answer without request{f': {transaction.reason}' if transaction.reason else ''}"
    elif transaction.outcome == "unsolicited":
        yield "  wants no answer"


def _job(transaction: Transaction, number: int, jobs: dict[bytes, int]) -> Iterator[str]:
    """Yield the transaction that requested a push; ``jobs`` maps requests to the latest transactions and is updated here."""
    exchange = transaction.exchange
    if exchange.subscribed:
        job = jobs.get(exchange.subscribed)
        if job is not None:
            yield f"  job of {job}"
    elif exchange.kind == S7:
        request = exchange.request_pdu
        if request is not None and request.rosctr == USERDATA and exchange.items:
            jobs[exchange.request] = number


def _extra_lines(transaction: Transaction, wanted: frozenset[str], clock: Clock) -> Iterator[str]:
    if "time" in wanted and transaction.time_ns is not None:
        yield f"  at {clock.iso(transaction.time_ns)}"
    if "latency" in wanted and transaction.latency_ns is not None:
        yield f"  latency {transaction.latency_ns} ns  # {words.duration(transaction.latency_ns)}"
    if "refs" in wanted and transaction.pdu_ref is not None:
        yield f"  reference 0x{transaction.pdu_ref & 0xFFFF:04x}"


def _exchange_lines(exchange: Exchange) -> Iterator[str]:
    form = _form(exchange)
    if form == "SETUP":
        requested, granted = exchange.setup
        if requested is not None:
            yield f"  asks {requested}"
        if granted is not None and _plain_setup(exchange):
            yield f"  gets {granted}"
        elif exchange.response:
            yield from _half("answer", exchange)
    elif form and exchange.request_pdu is not None:
        lines, plain = form_lines(exchange.request_pdu, exchange.response_pdu, exchange.response)
        yield from lines
        if exchange.response and not plain:
            yield from _half("answer", exchange)
    else:
        if exchange.request_seen:
            yield from _half("request", exchange)
        if exchange.response_seen:
            yield from _half("answer", exchange)
    for text in exchange.scd:
        yield f"  scd {_readable(text)}"


def _readable(text: str) -> str:
    """Return a line of SCD in quotes; letters of all alphabets stay."""
    return f'"{text.replace(chr(92), chr(92) * 2).replace(chr(34), f"{chr(92)}u0022").replace("#", f"{chr(92)}u0023")}"'


def _half(name: str, exchange: Exchange) -> Iterator[str]:
    octets = exchange.request if name == "request" else exchange.response
    if exchange.kind != S7:
        yield f"  {name} {exchange.kind}" + (f" {hex_text(octets)}" if exchange.kind == PLUS else "")
        request = exchange.request if name != "request" else b""
        for note in plus_notes(octets, request)[:_NOTES] if exchange.kind == PLUS and octets else []:
            yield f"    # {note}"
        return
    blocks = cut_blocks(octets)
    if blocks is None:
        yield f"  {name} octets {hex_text(octets)}"
    else:
        yield f"  {name} {blocks.kind}"
        if blocks.error:
            yield f"    refused 0x{blocks.error:04x}  # {errors_of(exchange.function).name(blocks.error)}"
        if blocks.parameters:
            yield f"    parameters {hex_text(blocks.parameters)}"
        if blocks.data:
            yield f"    data {hex_text(blocks.data)}"
        if name != "request" and exchange.refusing_code != NOT_REFUSED:
            yield f"    # refused: {RETURN_CODES.coded(exchange.refusing_code)}"
    remarks = _item_remarks(name, exchange)
    items = {item.label for item in exchange.items} if remarks and name == "request" else set()
    for note in _notes(exchange.request_pdu if name == "request" else exchange.response_pdu):
        if note not in items:
            yield f"    # {note}"
    for remark in remarks[:_NOTES]:
        yield f"    # {remark}"
    if len(remarks) > _NOTES:
        yield f"    # and {len(remarks) - _NOTES} more"


def _item_remarks(name: str, exchange: Exchange) -> list[str]:
    """Return the items of userdata with their values: written values in a request, read values in an answer or push."""
    pdu = exchange.request_pdu if name == "request" else exchange.response_pdu
    if pdu is None or pdu.rosctr != USERDATA:
        return []
    items = exchange.items
    answered = any([item.return_code >= 0 for item in items])
    if answered == (name == "request") or not any([answered or item.data is not None for item in items]):
        return []
    return [facets.item(item.result, number) for number, item in enumerate(items, 1)]


def _notes(pdu: Pdu | None) -> list[str]:
    """Return notes on the subject of a PDU, and on lengths and counts that do not fit; the capture may have cut the PDU."""
    if pdu is None:
        return []
    body = pdu.body
    by_form = pdu.function in FORMS and pdu.rosctr in {JOB, ACK_DATA}
    notes = [text for note in body.notes if (text := _note(note))] if not by_form else []
    shown = [printable(note) for note in notes[:_NOTES]]
    if len(notes) > _NOTES:
        shown.append(f"and {len(notes) - _NOTES} more")
    return [*shown, *[f"does not fit: {fact}" for fact in [*pdu.malformed, *body.malformed][:_NOTES]]]


def _note(note: str) -> str:
    """Return a remark without the number of a job, which is masked."""
    return "" if note == _MASKED_JOB else note.removeprefix(f"{_MASKED_JOB}, ")


# ---- forms ----------------------------------------------------------------------------------------------------------


def _form(exchange: Exchange) -> str:
    """Return the head for a transaction whose request has an exact notation, empty for all others."""
    if exchange.form is None:
        request = exchange.parse_request()
        if request is None:
            exchange.form = ""
        else:
            exchange.form = _small_form(request) if len(request.octets) <= SMALL else _form_of(request)
    return exchange.form


@lru_cache(PARSED)
def _small_form(request: Pdu) -> str:
    """Return `_form_of` a request, cached for all exchanges that begin with it."""
    return _form_of(request)


def _form_of(request: Pdu) -> str:
    if request.rosctr != JOB or request.function not in FORMS:
        return ""
    if request.function == SETUP_COMMUNICATION:
        setup = request.parameters.setup
        good = setup is not None and build_setup(JOB, setup) == request.octets
    else:
        good = build_request(request.function, forms.item_lines(request, None)) == request.octets
    return FORMS[request.function] if good else ""


def _plain_setup(exchange: Exchange) -> bool:
    granted = exchange.setup[1]
    return granted is not None and build_setup(ACK_DATA, granted) == exchange.response


def item_lines(exchange: Exchange, answered: bool) -> list[ItemLine]:
    """Return the items of a read or write, with their results if they are ``answered``."""
    request = exchange.request_pdu
    return forms.item_lines(request, exchange.response_pdu if answered else None) if request is not None else []


# ---- width ----------------------------------------------------------------------------------------------------------


def _wrapped(line: str) -> list[str]:
    """Return a line in pieces of bounded width; continuations are indented deeper than everything else."""
    text, mark, remark = line.partition("  # ")
    if len(text) <= _WIDTH or not (text.endswith((">", "]")) or "> " in text or "] " in text):
        return [line]
    pieces: list[str] = []
    room = _WIDTH
    while len(text) > room:
        at = text.rfind(" ", 4, room)
        if at <= 4 or not text[:at].strip():
            break
        pieces.append(text[:at])
        text = _CONTINUED + text[at + 1 :]
    pieces.append(text)
    pieces[-1] += mark + remark
    return pieces


__all__ = ["EXTRAS", "FORMAT", "FORMS", "SCD", "golden_lines", "golden_text", "item_lines", "link_lines"]
