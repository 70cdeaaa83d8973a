"""The field tree of one S7 PDU: every field with its octet range, its value and what the value means, and a hex view."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dissect.iso import layouts as iso
from dissect.iso.cotp import parse_tpdu
from dissect.report import words
from dissect.s7 import layouts as s7
from dissect.s7.errors import ERROR_CODES
from dissect.s7.items import Item
from dissect.s7.message import Pdu
from dissect.s7.tables import CPU_SERVICES, JOB, READ_VAR, RETURN_CODES, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.wire.hexdump import hexdump
from dissect.wire.layout import Field, FieldValue, Layout


def tree_lines(pdu: Pdu, packet: bytes) -> Iterator[str]:
    """Yield the tree of ``pdu`` and the hex view below it.

    ``packet`` is the TPKT that carried the PDU whole, so that offsets count from its first octet; empty when the PDU came
    in several COTP fragments, then offsets count from the first octet of the S7 PDU.
    """
    base = len(packet) - len(pdu.octets)
    whole = packet or pdu.octets
    if packet:
        yield from _packet(packet)
    else:
        base = 0
    yield from _layout(s7.ACK_HEADER if pdu.header_size == 12 else s7.HEADER, whole, base)
    if pdu.error_class > 0 or pdu.error_code > 0:
        code = (pdu.error_class << 8) | pdu.error_code
        yield f"      error 0x{code:04x}: {ERROR_CODES.name(code)}. {ERROR_CODES.text(code)}"
    yield from _parameters(pdu, whole, base)
    yield from _data(pdu, whole, base)
    for fact in pdu.malformed:
        yield f"    MALFORMED  {fact}"
    if pdu.cut:
        yield "    CUT  the capture did not keep the rest of this PDU"
    yield ""
    for line in hexdump(whole):
        yield f"    {line}"
    yield ""


def _packet(packet: bytes) -> Iterator[str]:
    yield from _layout(iso.TPKT, packet, 0)
    tpdu = parse_tpdu(packet[4:])
    yield f"    COTP {tpdu.name}"
    for value in tpdu.fields:
        yield _line(value, 4)


def _layout(layout: Layout, octets: bytes, at: int, title: str = "") -> Iterator[str]:
    yield f"    {title or layout.name}"
    for value in layout.read(octets, at):
        yield _line(value, 0)


def _line(value: FieldValue, shift: int) -> str:
    field = value.field
    return f"      {_range(value.offset + shift, value.end + shift)}  {field.name.rstrip('_'):<16} {_meaning(field, value.value)}"


def _range(start: int, end: int) -> str:
    text = str(start) if end == start + 1 else f"{start}-{end - 1}"
    return f"{text:>9}"


def _meaning(field: Field, value: int) -> str:
    mask, shift = field.bits if field.bits is not None else ((1 << 8 * field.size) - 1, 0)
    number = f"0x{value:0{max(1, ((mask >> shift).bit_length() + 3) // 4)}x}"
    if field.codes is not None:
        row = field.codes.get(value)
        return f"{number} {row.name}" if row is not None else f"{number} (not in the tables)"
    if field.name in _NUMBERS:
        return str(value)
    return number


#: Fields without a table that are numbers to a person; the others are shown in hexadecimal.
_NUMBERS: Final = frozenset(
    (
        "length",
        "li",
        "credit",
        "eot",
        "tpdu_nr",
        "param_length",
        "data_length",
        "item_count",
        "max_amq_calling",
        "max_amq_called",
        "pdu_length",
        "count",
        "db",
        "sequence",
        "data_unit_ref",
        "last_data_unit",
    )
)


def _parameters(pdu: Pdu, whole: bytes, base: int) -> Iterator[str]:
    at = base + pdu.header_size
    octets = pdu.parameters.octets
    if not octets:
        return
    if pdu.rosctr == USERDATA and octets[0] == CPU_SERVICES and len(octets) >= 8:
        yield from _layout(s7.USERDATA_EXTENDED if pdu.parameters.userdata_extended else s7.USERDATA_SHORT, whole, at)
        head = pdu.parameters.userdata
        if head is not None:
            yield f"      {'':>9}  {'is':<16} {head.name}"
    elif octets[0] == SETUP_COMMUNICATION:
        yield from _layout(s7.SETUP, whole, at)
    elif octets[0] in {READ_VAR, WRITE_VAR}:
        yield from _layout(s7.VARIABLES_HEAD, whole, at)
        for number, item in enumerate(pdu.parameters.items, 1):
            yield from _item(number, item, whole, at + item.offset)
    else:
        yield f"    parameters of {pdu.function_name}"
        yield f"      {_range(at, at + len(octets))}  {'octets':<16} {words.octets(octets)}"


def _item(number: int, item: Item, whole: bytes, at: int) -> Iterator[str]:
    title = f"item {number}: {item.address}" + (f" × {item.count}" if item.count > 1 else "")
    layout = s7.S7ANY_ITEM if item.transport_size >= 0 else s7.ITEM_HEAD
    yield from _layout(layout, whole, at, title)
    rest = len(item.octets) - layout.size
    if rest > 0:
        begin = at + layout.size
        yield f"      {_range(begin, begin + rest)}  {'octets':<16} {words.octets(item.octets[layout.size :])}"


def _data(pdu: Pdu, whole: bytes, base: int) -> Iterator[str]:
    items = pdu.data_items()
    at = base + pdu.data_offset
    for number, item in enumerate(items, 1):
        yield from _layout(s7.DATA_ITEM, whole, base + item.offset, f"data item {number}")
        if item.data:
            begin = base + item.offset + 4
            yield f"      {_range(begin, begin + len(item.data))}  {'data':<16} {words.octets(item.data)}"
    if items or not pdu.data:
        return
    if pdu.function == WRITE_VAR and pdu.rosctr != JOB:
        yield "    return codes"
        for number, code in enumerate(pdu.return_codes()):
            yield f"      {_range(at + number, at + number + 1)}  {f'item {number + 1}':<16} 0x{code:02x} {RETURN_CODES.name(code)}"
        return
    yield "    data"
    yield f"      {_range(at, at + len(pdu.data))}  {'octets':<16} {words.octets(pdu.data)}"
