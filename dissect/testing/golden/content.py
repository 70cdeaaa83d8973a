"""Differences between two paired transactions: requests, codes, values, sizes, and contents down to the field."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from dissect.engine.transactions.naming import NamedValue, Naming
from dissect.meaning.report import facets, words
from dissect.protocols.s7.blocks import BLOCK_COUNT, LISTED_BLOCK
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.parameters import Setup
from dissect.protocols.s7.tables import DATA_TRANSPORT_SIZES, READ_VAR, SETUP_COMMUNICATION, WRITE_VAR
from dissect.testing.golden.addresses import named_item
from dissect.testing.golden.exchange import PLUS, S7, SCD, Exchange, ItemRecord
from dissect.testing.golden.keys import subject
from dissect.testing.golden.model import Transaction
from dissect.testing.golden.phrases import Change, code_text, item_state, octets_change, outcome, short, value_change
from dissect.testing.golden.plus import plus_differences, plus_subject
from dissect.testing.golden.plus_objects import NamedPair
from dissect.wire.layout import HOLDS_TIME, FieldValue
from dissect.wire.part import Part
from dissect.wire.text import some

#: Types of items whose values are times.
_TIMES: Final = frozenset((0x09, 0x0A, 0x0F))
#: The same for types of tags.
_TIME_TYPES: Final = frozenset(("DATE", "TIME_OF_DAY", "LTIME_OF_DAY", "DATE_AND_TIME", "LDT", "DTL"))
#: Maximum number of fields of one PDU that are reported one by one; the rest are only counted.
_FIELDS: Final = 16


def request_changes(a: Transaction, b: Transaction, naming: Naming | None = None) -> tuple[list[Change], bool]:
    """Return the differences in the requests, and whether the requests differ so much that answers need no comparison."""
    one, other = a.exchange, b.exchange
    if one.request == other.request and one.kind != SCD:
        return [], False
    if one.kind == SCD:
        return [], False
    if one.kind == other.kind == PLUS and one.function_name == other.function_name and one.request and other.request:
        elsewhere = plus_subject(one.request) != plus_subject(other.request)
        return list(_plus("request", one, one.request, other.request)), elsewhere
    request, other_request = one.request_pdu, other.request_pdu
    if one.kind != S7 or request is None or other_request is None or not _same_form(one, other):
        if (
            request is not None
            and other_request is not None
            and request.function == other_request.function in {READ_VAR, WRITE_VAR}
        ):
            return [item_changes(one, other)], True
        what = _request_words(one), _request_words(other)
        kind = "requests" if request is None or request.function in {READ_VAR, WRITE_VAR} else "contents"
        return [
            Change(kind, f"different request: was {what[0]}, is {what[1]}", *what, targets=(one.function_name,))
        ], True
    if one.function == SETUP_COMMUNICATION:
        return list(_setup("asks", one.setup[0], other.setup[0])), False
    if one.function == WRITE_VAR:
        written = list(_written(one, other, naming))
        return written or _octets("requests", "request", request, other_request), False
    changes = list(_fields("request", request, other_request, one))
    return changes or _octets("contents", "request", request, other_request), False


def _same_form(one: Exchange, other: Exchange) -> bool:
    """Return whether two requests differ only in their data."""
    request, other_request = one.request_pdu, other.request_pdu
    if request is None or other_request is None or one.function != other.function:
        return False
    if one.function in {READ_VAR, WRITE_VAR}:
        return request.parameters.octets == other_request.parameters.octets
    return True


def _request_words(exchange: Exchange) -> str:
    notes = (
        [short(note) for note in exchange.request_notes[:3]]
        if exchange.request_pdu is not None and not exchange.items
        else []
    )
    return ", ".join(notes) or subject(exchange)


def answer_changes(
    a: Transaction, b: Transaction, naming: Naming | None = None, named: NamedPair | None = None
) -> Iterator[Change]:
    """Yield the differences in the answers. If the requests differ, only success or failure is compared.

    ``named`` knows the names for references in S7comm-plus notifications.
    """
    one, other = a.exchange, b.exchange
    if a.outcome != b.outcome or a.reason != b.reason:
        was, is_ = outcome(a), outcome(b)
        yield Change("answers", f"was {was}, is {is_}", was, is_)
        return
    if one.scd != other.scd:
        yield from _scd(one, other)
    if one.response == other.response:
        return
    if (one.error_code, one.refusing_code) != (other.error_code, other.refusing_code):
        was, is_ = outcome(a), outcome(b)
        code = Change("codes", f"was {was}, is {is_}", was, is_, targets=(one.function_name,))
        yield code
        return
    if one.kind == other.kind == PLUS:
        yield from _plus("answer", one, one.response, other.response, named)
        return
    response, other_response = one.response_pdu, other.response_pdu
    if one.request != other.request and one.function not in {READ_VAR, WRITE_VAR, SETUP_COMMUNICATION}:
        return
    if response is None or other_response is None:
        was, is_ = octets_change(one.response, other.response)
        yield Change("contents", f"was {was}, is {is_}", was, is_, targets=(one.function_name,))
    elif one.function == SETUP_COMMUNICATION and one.setup[1] is not None and other.setup[1] is not None:
        changes = list(_setup("granted", one.setup[1], other.setup[1]))
        yield from changes or _octets("negotiation", "answer", response, other_response)
    elif one.items and [item.label for item in one.items] == [item.label for item in other.items]:
        changes = list(_items(one, other, naming))
        kind = "transport" if one.function in {READ_VAR, WRITE_VAR} else "contents"
        yield from changes or _octets(kind, "answer", response, other_response)
    elif one.items and one.function in {READ_VAR, WRITE_VAR}:
        changes = list(_items(one, other, naming))
        yield from changes or _octets("transport", "answer", response, other_response)
    else:
        changes = list(_fields("answer", response, other_response, one))
        half = (
            "answer"
            if not response.body.find(LISTED_BLOCK)
            else f"answer, {', '.join([short(note) for note in one.request_notes])}"
        )
        yield from changes or _octets("contents", half, response, other_response)


# ---- reads, writes, setups ------------------------------------------------------------------------------------------


def _setup(verb: str, was: Setup | None, is_: Setup | None) -> Iterator[Change]:
    if was is not None and is_ is not None and was.as_dict() != is_.as_dict():
        old, new = str(was), str(is_)
        yield Change(
            "negotiation", f"{'requested' if verb == 'asks' else verb}: was {old}, is {new}", old, new, address=verb
        )


def _written(one: Exchange, other: Exchange, naming: Naming | None) -> Iterator[Change]:
    for was, is_ in zip(one.items, other.items, strict=True):
        if was.data != is_.data:
            yield from _values(was, is_, naming)


def _items(one: Exchange, other: Exchange, naming: Naming | None) -> Iterator[Change]:
    if len(one.items) != len(other.items):
        before, after = (words.count(len(each.items), "item") for each in (one, other))
        yield Change("contents", f"was {before}, is {after}", before, after, targets=(one.function_name,))
        return
    for was, is_ in zip(one.items, other.items, strict=True):
        label = short(was.label)
        if was.return_code != is_.return_code:
            old, new = item_state(was), item_state(is_)
            targets = (was.address, was.label)
            yield Change("codes", f"was {old}, is {new}", old, new, label, was.address, targets)
        elif one.function != WRITE_VAR and was.data != is_.data:
            yield from _values(was, is_, naming)
        elif one.function == READ_VAR and _head(was) != _head(is_):
            old, new = _head(was), _head(is_)
            yield Change(
                "transport", f"data header was {old}; is {new}", old, new, label, was.address, (was.address, was.label)
            )


def _values(was: ItemRecord, is_: ItemRecord, naming: Naming | None) -> Iterator[Change]:
    """Yield the differences in the value of an item: tag by tag if it has tags, otherwise as a whole."""
    old = naming.named(was.result) if naming is not None else []
    new = naming.named(is_.result) if naming is not None else []
    changes = []
    if [(each.name, each.address) for each in old if each.name] == [
        (each.name, each.address) for each in new if each.name
    ]:
        fresh = {(each.name, each.address): each for each in new}
        for before in old:
            after = fresh.get((before.name, before.address))
            if after is not None and before.name and before.data != after.data:
                changes.append(_tag(before, after, was))
            elif not before.name and (after is None or before.data != after.data):
                changes.append(_octets_between(before, after, was))
    if changes:
        yield from changes
    else:
        yield _value(was, is_)


def _tag(before: NamedValue, after: NamedValue, item: ItemRecord) -> Change:
    old, new = (facets.named_value(each).partition(" = ")[2] for each in (before, after))
    label = f"{short(before.name)} ({before.address})"
    kind = "time" if before.type in _TIME_TYPES else "values"
    return Change(
        kind, f"was {old}, is {new}", old, new, label, before.address, (before.name, item.address, item.label)
    )


def _octets_between(before: NamedValue, after: NamedValue | None, item: ItemRecord) -> Change:
    old, new = octets_change(before.data, after.data if after is not None else b"")
    return Change(
        "values",
        f"was {old}, is {new}",
        old,
        new,
        before.address,
        before.address,
        (before.address, item.address, item.label),
    )


def _value(was: ItemRecord, is_: ItemRecord) -> Change:
    text, old, new = value_change(was, is_)
    kind = "time" if was.transport_size in _TIMES else "values"
    return Change(kind, text, old, new, short(was.label), was.address, (was.address, was.label))


def _head(item: ItemRecord) -> str:
    answer = item.answer
    if answer is None:
        return "nothing"
    return f"{DATA_TRANSPORT_SIZES.name(int(answer.transport_size))}, length {answer.length}"


# ---- other functions ------------------------------------------------------------------------------------------------


def _fields(half: str, was: Pdu, is_: Pdu, exchange: Exchange) -> Iterator[Change]:
    """Yield the fields that differ, if both PDUs have the same structure."""
    old, new = was.body.parts, is_.body.parts
    if [(part.layout.name, part.offset, part.end) for part in old] != [
        (part.layout.name, part.offset, part.end) for part in new
    ]:
        return
    changes = [
        _field(half, part, first, second, exchange)
        for part, other in zip(old, new, strict=True)
        for first, second in zip(part.values, other.values, strict=False)
        if (first.value, first.octets) != (second.value, second.octets)
    ]
    yield from changes[:_FIELDS]
    if len(changes) > _FIELDS:
        rest = len(changes) - _FIELDS
        yield Change("contents", f"{half}: {rest} more fields differ", targets=(exchange.function_name,))


def _field(half: str, part: Part, was: FieldValue, is_: FieldValue, exchange: Exchange) -> Change:
    name = f"{part.layout.name}.{was.field.name.rstrip('_')}"
    of = _block_type(part, exchange)
    old, new = _meaning(was), _meaning(is_)
    if old == new or (was.octets is not None and is_.octets is not None and not was.meaning):
        old, new = octets_change(was.octets or b"", is_.octets or b"")
    kind = "time" if was.field.holds == HOLDS_TIME else "contents"
    targets = (name, exchange.function_name)
    return Change(
        kind,
        f"{half}, {part.layout.name}{of}, {was.field.name.rstrip('_')}: was {old}, is {new}",
        old,
        new,
        "",
        name,
        targets,
    )


def _block_type(part: Part, exchange: Exchange) -> str:
    """Return the block type in an entry of a list of blocks, as `` DB``; empty for other parts."""
    if part.layout is BLOCK_COUNT:
        return f" {short(part.text('block_type'))}"
    return f" {short(exchange.request_notes[0])}" if part.layout is LISTED_BLOCK and exchange.request_notes else ""


def _meaning(value: FieldValue) -> str:
    if value.octets is not None:
        return short(value.meaning) if value.meaning else words.octets(value.octets)
    if value.field.says is not None and value.meaning:
        return value.meaning
    if value.field.codes is not None:
        digits = 2 * value.field.size
        return code_text(value.value, value.meaning or f"0x{value.value:0{digits}x}", digits)
    return str(value.value) if value.field.decimal else f"0x{value.value:x}"


def _octets(kind: str, half: str, was: Pdu, is_: Pdu) -> list[Change]:
    """Return one change for PDUs that differ outside any known structure."""
    name = was.function_name
    notes = [", ".join([short(note) for note in pdu.body.notes[:3]]) for pdu in (was, is_)]
    if notes[0] != notes[1] and all(notes):
        return [Change(kind, f"{half}: was {notes[0]}, is {notes[1]}", notes[0], notes[1], targets=(name,))]
    old, new = octets_change(was.octets, is_.octets)
    return [Change(kind, f"{half}: was {old}, is {new}", old, new, targets=(name,))]


# ---- S7comm-plus ----------------------------------------------------------------------------------------------------


def _plus(half: str, exchange: Exchange, was: bytes, is_: bytes, named: NamedPair | None = None) -> Iterator[Change]:
    """Yield the differences of S7comm-plus PDUs; numbers that count on from one recording to the next are ignored."""
    changes = plus_differences(was, is_, *(named.both() if named is not None and not exchange.request else ()))
    name = exchange.function_name
    for old, new in changes[:_FIELDS]:
        yield Change("contents", f"{half}: was {old}, is {new}", old, new, targets=(name,))
    if len(changes) > _FIELDS:
        yield Change("contents", f"{half}: {len(changes) - _FIELDS} more parts differ", targets=(name,))


# ---- SCD ------------------------------------------------------------------------------------------------------------


def _scd(one: Exchange, other: Exchange) -> Iterator[Change]:
    if len(one.scd) != len(other.scd):
        was, is_ = (short("; ".join(each.scd)) or "nothing" for each in (one, other))
        yield Change("scd", f"SCD was {was}, is {is_}", was, is_)
        return
    for was, is_ in zip(one.scd, other.scd, strict=True):
        if was != is_:
            half, _, old = was.partition(" ")
            new = is_.partition(" ")[2].strip()
            address = old.strip().split(" ", 1)[0].rstrip(":")
            yield Change("scd", f"{half}: was {short(old.strip())}, is {short(new)}", old, new, "", address, (address,))


#: Maximum number of items that are named.
_NAMED: Final = 5


def item_changes(one: Exchange, other: Exchange) -> Change:
    """Describe how the items of two requests differ; both are reads or both are writes."""
    before, after = _names(one), _names(other)
    gone, new = _without(before, after), _without(after, before)
    verb = "writes" if one.function == WRITE_VAR else "requests"
    if len(before) == len(after) == 1:
        was, is_ = subject(one), subject(other)
        if was == is_:  # the items have the same names: their types differ
            was, is_ = before[0], after[0]
        text = f"{verb} {_without_verb(is_)} instead of {_without_verb(was)}"
    elif gone and new:
        was, is_ = some(list(gone), _NAMED), some(list(new), _NAMED)
        text = f"{verb} {is_} instead of {was}"
    elif new:
        was, is_ = "", some(list(new), _NAMED)
        text = f"{verb} {is_} as well"
    elif gone:
        was, is_ = some(list(gone), _NAMED), ""
        text = f"no longer {verb} {was}"
    else:
        was, is_ = some(list(before), _NAMED), some(list(after), _NAMED)
        text = f"{verb} the same items in a different order"
    return Change("requests", text, was, is_, targets=(one.function_name,))


def _without_verb(what: str) -> str:
    """Return the items of a subject without its verb: ``DB10.DBW2`` for ``READ DB10.DBW2``."""
    return what.removeprefix("READ ").removeprefix("WRITE ")


def _names(exchange: Exchange) -> list[str]:
    request = exchange.request_pdu
    return [short(named_item(item)) for item in request.parameters.items] if request is not None else []


def _without(names: Sequence[str], others: Sequence[str]) -> list[str]:
    """Return the names, in order, that ``others`` does not have or has less often."""
    left = Counter(others)
    rest = []
    for name in names:
        left[name] -= 1
        if left[name] < 0:
            rest.append(name)
    return rest
