"""The field tree of one PDU or TPDU: every field with its octet range, its value and what it means, and a hex view."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dissect.iso import layouts as iso
from dissect.iso.cotp import Parameter, parse_tpdu
from dissect.report import words
from dissect.s7 import layouts as s7
from dissect.s7.errors import ERROR_CODES
from dissect.s7.items import Item
from dissect.s7.message import Pdu
from dissect.s7.parameters import UserdataHead
from dissect.s7.tables import CPU_SERVICES, JOB, READ_VAR, RETURN_CODES, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.wire.hexdump import hexdump
from dissect.wire.layout import Field, FieldValue, Layout
from dissect.wire.malformed import Malformed
from dissect.wire.text import printable

_TPKT_SIZE: Final = 4


def tree_lines(pdu: Pdu, packet: bytes) -> Iterator[str]:
    """Yield the tree of ``pdu`` and the hex view below it.

    ``packet`` is the TPKT that carried the PDU whole, so that offsets count from its first octet; empty when the PDU came
    in several COTP fragments or was cut, then offsets count from the first octet of the S7 PDU.
    """
    whole = packet or pdu.octets
    base = len(whole) - len(pdu.octets)
    if packet:
        yield from _packet(packet)
    else:
        why = "cut by the capture" if pdu.cut else "put together from several COTP fragments"
        yield f"    {why}; octets count from the beginning of the S7 PDU"
    yield from _layout(s7.ACK_HEADER if pdu.header_size == 12 else s7.HEADER, whole, base)
    if pdu.error_class > 0 or pdu.error_code > 0:
        code = (pdu.error_class << 8) | pdu.error_code
        yield _field("", "error", f"0x{code:04x} {ERROR_CODES.name(code)}. {ERROR_CODES.text(code)}".rstrip())
    yield from _parameters(pdu, whole, base)
    yield from _data(pdu, whole, base)
    yield from _malformed(pdu.malformed, base)
    yield from _octets(whole)


def tpdu_tree_lines(packet: bytes) -> Iterator[str]:
    """Yield the tree of a TPKT whose TPDU carries no S7 PDU, and the hex view below it."""
    yield from _packet(packet)
    data = parse_tpdu(packet[_TPKT_SIZE:]).data
    if data:
        yield _field(_range(len(packet) - len(data), len(packet)), "user data", words.octets(data))
    yield from _octets(packet)


def _malformed(facts: list[Malformed], base: int) -> Iterator[str]:
    """Yield what a parser found wrong, its offsets counted as the tree counts them."""
    for fact in facts:
        moved = Malformed(
            fact.layer, fact.reason, fact.field, fact.offset + base, fact.needed, fact.available, fact.limit
        )
        yield f"    MALFORMED  {moved}"


def _octets(whole: bytes) -> Iterator[str]:
    yield ""
    for line in hexdump(whole):
        yield f"    {line}"
    yield ""


def _packet(packet: bytes) -> Iterator[str]:
    yield from _layout(iso.TPKT, packet, 0)
    tpdu = parse_tpdu(packet[_TPKT_SIZE:])
    yield f"    COTP {tpdu.name}"
    for value in tpdu.fields:
        yield _line(value, _TPKT_SIZE)
    for parameter in tpdu.parameters:
        yield _parameter(parameter)
    yield from _malformed(tpdu.malformed, _TPKT_SIZE)


def _parameter(parameter: Parameter) -> str:
    start = _TPKT_SIZE + parameter.offset
    said = words.octets(parameter.value)
    if parameter.code in {0xC1, 0xC2} and parameter.value.isascii():
        said += f"  {printable(parameter.value.decode('ascii'))!r}" if len(parameter.value) > 2 else ""
    # The name of 0xC1 goes on to say what it is in an ER.
    return _field(_range(start, start + 2 + len(parameter.value)), parameter.name.partition(" (CR")[0], said)


def _layout(layout: Layout, octets: bytes, at: int, title: str = "") -> Iterator[str]:
    yield f"    {title or layout.name}"
    for value in layout.read(octets, at):
        yield _line(value, 0)


def _line(value: FieldValue, shift: int, name: str = "") -> str:
    field = value.field
    said = f"{_meaning(field, value.value)} {name}".rstrip()
    return _field(_range(value.offset + shift, value.end + shift), field.name.rstrip("_"), said)


def _field(where: str, name: str, said: str) -> str:
    return f"      {where:>9}  {name:<16} {said}"


def _range(start: int, end: int) -> str:
    return str(start) if end == start + 1 else f"{start}-{end - 1}"


def _meaning(field: Field, value: int) -> str:
    mask, shift = field.bits if field.bits is not None else ((1 << 8 * field.size) - 1, 0)
    number = f"0x{value:0{max(1, ((mask >> shift).bit_length() + 3) // 4)}x}"
    if field.codes is not None:
        row = field.codes.get(value)
        return f"{number} {row.name}" if row is not None else f"{number} (not in the tables)"
    return str(value) if field.name in _NUMBERS else number


#: Fields without a table that are numbers to a person; the others are shown in hexadecimal.
_NUMBERS: Final = frozenset(
    (
        "length",
        "li",
        "credit",
        "eot",
        "tpdu_nr",
        "next_nr",
        "credit_extended",
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
    head = pdu.parameters.userdata
    layout: Layout | None = None
    if head is not None:
        layout = s7.MODE_TRANSITION
        if octets[0] == CPU_SERVICES:
            layout = s7.USERDATA_EXTENDED if head.extended else s7.USERDATA_SHORT
    elif pdu.rosctr != USERDATA and octets[0] == SETUP_COMMUNICATION:
        layout = s7.SETUP
    elif pdu.rosctr != USERDATA and octets[0] in {READ_VAR, WRITE_VAR}:
        layout = s7.VARIABLES_HEAD
    if layout is None:
        yield f"    parameters of {pdu.function_name}"
        yield _rest(at, octets)
        return
    yield f"    {pdu.function_name} parameters" if layout is s7.VARIABLES_HEAD else f"    {layout.name}"
    end = at + len(octets)
    for value in layout.read(whole[:end], at):
        yield _line(value, 0, _subfunction(value.field, head))
    if layout is s7.VARIABLES_HEAD:
        for number, item in enumerate(pdu.parameters.items, 1):
            yield from _item(number, item, whole, at + item.offset)
    elif len(octets) > layout.size:
        yield _rest(at + layout.size, octets[layout.size :])


def _subfunction(field: Field, head: UserdataHead | None) -> str:
    """Return the name of a subfunction, which depends on its group, so that the field itself has none."""
    return head.subfunction_name if head is not None and field.name == "subfunction" else ""


def _rest(at: int, octets: bytes) -> str:
    return _field(_range(at, at + len(octets)), "octets", words.octets(octets))


def _item(number: int, item: Item, whole: bytes, at: int) -> Iterator[str]:
    layout = s7.S7ANY_ITEM if item.transport_size >= 0 else s7.ITEM_HEAD
    yield from _layout(layout, whole[: at + len(item.octets)], at, f"item {number}: {words.address(item)}")
    if len(item.octets) > layout.size:
        yield _rest(at + layout.size, item.octets[layout.size :])


def _data(pdu: Pdu, whole: bytes, base: int) -> Iterator[str]:
    items = pdu.data_items()
    data = pdu.data
    at = base + pdu.data_offset
    for number, item in enumerate(items, 1):
        start = base + item.offset
        yield from _layout(s7.DATA_ITEM, whole, start, f"data item {number}{_meant(pdu, number)}")
        if item.data:
            yield _field(_range(start + 4, start + 4 + len(item.data)), "data", words.octets(item.data))
    if items or not data:
        return
    if pdu.function == WRITE_VAR and pdu.rosctr != JOB:
        yield "    return codes"
        for number, code in enumerate(data):
            said = f"0x{code:02x} {RETURN_CODES.name(code)}" if code in RETURN_CODES else f"0x{code:02x}"
            yield _field(str(at + number), f"item {number + 1}", said)
        return
    yield "    data"
    if pdu.rosctr == USERDATA and len(data) >= s7.DATA_ITEM.size:  # the head of reference 4.2 is that of a data item
        for value in s7.DATA_ITEM.read(whole[: at + len(data)], at):
            yield _line(value, 0)
        at += s7.DATA_ITEM.size
        data = data[s7.DATA_ITEM.size :]
    if data:
        yield _rest(at, data)


def _meant(pdu: Pdu, number: int) -> str:
    """Return the address that a data item of a write request is meant for."""
    items = pdu.parameters.items
    return f": {words.address(items[number - 1])}" if number <= len(items) else ""
