"""The field tree of an SCD message: every field of its envelope and every value with its octets, and a hex view."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from dissect.engine.transactions.payloads import ScdMessage
from dissect.meaning.report import words
from dissect.scd.dictionary import Dictionary
from dissect.scd.envelope import DEFAULT, Envelope
from dissect.wire.hexdump import hexdump
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.scd.layout import Key
    from dissect.scd.records import EnvelopeField

#: Fields that are shown in decimal; the others are hexadecimal.
_DECIMAL: Final = frozenset(("abort", "response", "tid", "err", "sub", "seq", "size", "port", "pdo"))


def scd_tree_lines(found: ScdMessage) -> Iterator[str]:
    """Yield the tree of a message, then its hex view; octets are counted from the first one of the message."""
    at = f", from byte {found.offset} of {found.place or 'its datagram or TSDU'} on" if found.offset else ""
    message = found.message
    if message.numbers:
        yield f"    SCD message, binding {printable(found.binding)}{at}"
        envelope = Envelope(found.dictionary.envelope or DEFAULT)
        whole = found.octets if message.size else found.octets[: envelope.head_size]
        for field, first, number in envelope.fields(whole):
            if field.role == "data":
                yield from _data(found, envelope.head_size)
            else:
                yield _line(first, field.bits, field.role, _number(found, field, number))
        if not message.size:
            yield from _data(found, envelope.head_size)
    else:
        what = f"bare {printable(message.pdo or message.content)}" if message.pdo or message.content else "message"
        yield f"    SCD {what}, binding {printable(found.binding)}{at}"
        yield from _data(found, 0)
    for flag in message.flags:
        yield f"    odd        {flag}"
    if message.error is not None:
        yield f"    MALFORMED  {message.error.code} {printable(message.error.where)}: {printable(message.error.detail)}"
    yield ""
    for line in hexdump(found.octets):
        yield f"    {line}"
    yield ""


def _number(found: ScdMessage, field: EnvelopeField, number: int) -> str:
    message = found.message
    if field.role == "kind":
        return f"0x{number:02x} {message.service}".rstrip()
    if field.role == "err":
        return f"{number} {printable(found.dictionary.error_text(number))}"
    return str(number) if field.role in _DECIMAL else f"0x{number:0{(field.bits + 3) // 4}x}"


def _data(found: ScdMessage, at: int) -> Iterator[str]:
    """Yield the values, or the octets if none was decoded; ``at`` is the place of the first octet in the message."""
    from dissect.scd.wording import physical_text, value_text

    data = found.message.data or (b"" if found.message.numbers else found.octets)
    rows = found.values
    places = _bits(found)
    for key, row in zip(found.message.values, rows, strict=True):
        first, bits = places.get(key, (0, 8 * len(data)))
        said = f"{printable(row.name)} = {physical_text(row)}".removeprefix(" ")
        raw = f", raw {value_text(row.value)}" if row.physical != row.value else ""
        stands = f"bits {first} to {first + bits - 1}" if bits > 1 else f"bit {first}"
        where = f", {stands}" if len(rows) > 1 else ""
        yield _line(8 * at + first, bits, printable(row.address), f"{said}{raw}{where}")
    if data and not rows:
        yield _line(8 * at, 8 * len(data), "data", words.octets(data))


def _bits(found: ScdMessage) -> dict[Key, tuple[int, int]]:
    """Return (first bit, number of bits) of each value; empty for a value that fills all of the data."""
    message = found.message
    if found.mapping is not None:
        return {row.variable.address: (row.offset, row.bits) for row in found.mapping.map}
    if not message.content:
        return {}
    return _fields(found.dictionary, message.index, message.sub)


def _fields(dictionary: Dictionary, index: int, sub: int) -> dict[Key, tuple[int, int]]:
    """Return (first bit, number of bits) of each field in a bare struct or a whole object; empty for a single value."""
    from dissect.scd.model import StructType

    struct = dictionary.types.get(index)
    if isinstance(struct, StructType):
        return {field.name: (field.offset, field.bits) for field in struct.fields}
    obj = dictionary.objects.get(index)
    if obj is None or obj.single or sub:
        return {}
    return {field.address: (field.offset, field.bits) for field in obj.fields}


def _line(first: int, bits: int, name: str, said: str) -> str:
    """Return the line of a field: octets, name, ``said``; in the form of `dissect.meaning.report.tree`."""
    begin, last = first // 8, max(first + bits - 1, first) // 8
    where = str(begin) if begin == last else f"{begin}-{last}"
    return f"      {where:>9}  {name:<16} {said}"
