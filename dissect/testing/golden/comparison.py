"""The differences between two sessions, in words."""

from __future__ import annotations

from collections.abc import Iterator

from dissect.meaning.report import words
from dissect.meaning.report.certainty import doubt_mark
from dissect.protocols.iso.tsap import Tsap
from dissect.testing.golden.content import answer_changes, request_changes
from dissect.testing.golden.difference import Difference, DiffOptions
from dissect.testing.golden.exchange import PLUS
from dissect.testing.golden.keys import Keys, subject
from dissect.testing.golden.model import Link, Session, Transaction
from dissect.testing.golden.pairing import Match, pair_links, pair_transactions
from dissect.testing.golden.phrases import Change, outcome
from dissect.testing.golden.plus_objects import NamedPair, Objects, same_objects, with_objects
from dissect.wire.text import printable


def diff_sessions(a: Session, b: Session, options: DiffOptions | None = None) -> list[Difference]:
    """Return all differences from ``a`` to ``b``, in the order of ``a``; empty if there are none."""
    return list(differences(a, b, options))


def differences(a: Session, b: Session, options: DiffOptions | None = None) -> Iterator[Difference]:
    """Yield the result of `diff_sessions` piece by piece, so that a caller can count differences without keeping them."""
    chosen = options if options is not None else DiffOptions()
    keys = Keys(chosen)
    for one, other in pair_links(a, b, keys):
        if one is not None and other is not None:
            yield from _link(one, other, chosen)
            matches = pair_transactions(one.transactions, other.transactions, keys)
            numbers = same_objects([(match.a, match.b) for match in matches if match.a and match.b])
            for match in matches:
                yield from _match(match, one, other, chosen, keys.objects, numbers)
        else:
            yield from _alone(one, other, chosen)


# ---- connections ----------------------------------------------------------------------------------------------------


def _alone(one: Link | None, other: Link | None, options: DiffOptions) -> Iterator[Difference]:
    link = one or other
    if link is None or options.ignores("connections", ""):
        return
    what = f"{_who(link)}, {words.count(len(link.transactions), 'transaction')}"
    if one is not None:
        yield Difference(
            "connections", f"connection {one.number} is missing: {what}", (one.number, 0), values=(what, "")
        )
    else:
        text = f"connection {link.number} of the second is added: {what}"
        yield Difference("connections", text, (0, link.number), values=("", what))


def _who(link: Link, protocol: str = "") -> str:
    """Return the TSAPs of a connection in the notation of its ``protocol``, or in that of the other connection's protocol."""
    calling = Tsap(link.calling) if link.calling is not None else None
    called = Tsap(link.called) if link.called is not None else None
    return (
        words.tsaps(calling, called, protocol or link.protocol)
        if calling or called
        else (words.PROTOCOLS.get(link.protocol) or printable(link.protocol or "no TSAPs"))
    )


def _link(one: Link, other: Link, options: DiffOptions) -> Iterator[Difference]:
    facts = (
        ("tsaps", "protocol", one.protocol, other.protocol),
        ("tsaps", "carrier", one.carrier, other.carrier),
        ("tsaps", "TSAPs", _who(one, one.protocol), _who(other, one.protocol)),
        ("negotiation", "TPDU size", _size(one), _size(other)),
        ("endings", "beginning", _begun(one), _begun(other)),
        ("endings", "refusal", one.refused, other.refused),
        ("endings", "end", _ended(one), _ended(other)),
    )
    for kind, name, was, is_ in facts:
        if was != is_ and not options.ignores(kind, name):
            text = f"connection {one.number}, {name}: was {printable(was) or 'none'}, is {printable(is_) or 'none'}"
            yield Difference(kind, text, (one.number, other.number), (0, 0), "connection", name, (was, is_))


def _size(link: Link) -> str:
    if not link.tpdu_size and not link.tpdu_size_asked:
        return "not captured"
    return f"{link.tpdu_size or 'not granted'} (requested {link.tpdu_size_asked or 'none'})"


def _begun(link: Link) -> str:
    return "in the capture" if link.begun else "before the capture"


def _ended(link: Link) -> str:
    if not link.ended:
        return "open"
    farewell = f" ({link.farewell})" if link.farewell else ""
    return f"{link.ended}{f' by the {link.ended_by}' if link.ended_by else ''}{farewell}"


# ---- transactions ---------------------------------------------------------------------------------------------------


def _match(
    match: Match, one: Link, other: Link, options: DiffOptions, objects: Objects, numbers: dict[int, int]
) -> Iterator[Difference]:
    """Yield the differences within a pair; ``numbers`` maps object numbers of the second recording to those of the first."""
    a, b = match.a, match.b
    connections = (one.number, other.number)
    if a is None or b is None:
        yield from _single(a, b, connections, options)
        return
    if match.moved and not options.ignores("order", subject(a.exchange)):
        where = (f"transaction {a.number}", f"transaction {b.number} of the second")
        text = f"{where[0]}, {subject(a.exchange)}: moved, now {where[1]}"
        yield Difference("order", text, connections, (a.number, b.number), subject(a.exchange), "", where)
    named = NamedPair(objects, a, b) if a.exchange.kind == PLUS else None
    for change in _changes(a, with_objects(b, numbers), options, named):
        about = change.subject or subject(a.exchange, change.item)
        if options.ignores(change.kind, *change.targets, about):
            continue
        doubt = f" {doubt_mark(a.doubt or b.doubt)}" if a.doubt or b.doubt else ""
        text = f"transaction {a.number}, {about}: {change.text}{doubt}"
        values = (change.was, change.is_)
        yield Difference(change.kind, text, connections, (a.number, b.number), about, change.address, values)


def _single(
    a: Transaction | None, b: Transaction | None, connections: tuple[int, int], options: DiffOptions
) -> Iterator[Difference]:
    transaction = a or b
    if transaction is None:
        return
    kind = "missing" if a is not None else "added"
    about = subject(transaction.exchange)
    if options.ignores(kind, about):
        return
    result = outcome(transaction)
    if a is not None:
        text = f"transaction {a.number}, {about}: missing (was {result})"
        yield Difference(kind, text, connections, (a.number, 0), about, "", (result, ""))
    else:
        text = f"transaction {transaction.number} of the second, {about}: added ({result})"
        yield Difference(kind, text, connections, (0, transaction.number), about, "", ("", result))


def _changes(a: Transaction, b: Transaction, options: DiffOptions, named: NamedPair | None) -> Iterator[Change]:
    same = a.exchange is b.exchange or (
        a.exchange.request == b.exchange.request
        and a.exchange.response == b.exchange.response
        and a.exchange.scd == b.exchange.scd
    )
    if not same or a.outcome != b.outcome or a.reason != b.reason:
        changes, stop = request_changes(a, b, options.naming)
        yield from changes
        if not stop:
            yield from answer_changes(a, b, options.naming, named)
    if options.shifted(a.latency_ns, b.latency_ns):
        was, is_ = words.duration(a.latency_ns), words.duration(b.latency_ns)
        yield Change("latency", f"answer time was {was}, is {is_}", was, is_)
