"""Reads, writes and setups in the notation of a golden, and the PDUs that the notation represents.

It represents the PDUs that devices usually send (`dissect.protocols.s7.build`). The writer uses this notation only if it gives
exactly the captured PDU; all other PDUs are written as blocks of octets (`dissect.testing.golden.blocks`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from dissect.protocols.s7.build import build_data_item, build_items, build_variables
from dissect.protocols.s7.items import Item, parse_item
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.parameters import Setup
from dissect.protocols.s7.tables import (
    ACK_DATA,
    ANSWER_TRANSPORT_SIZE,
    DATA_BYTES,
    DATA_TRANSPORT_SIZES,
    JOB,
    READ_VAR,
    RETURN_CODES,
    SUCCESS,
    WRITE_VAR,
)
from dissect.testing.golden.addresses import item_octets, named_item
from dissect.testing.golden.values import hex_octets, hex_text, shown_value, value_octets
from dissect.wire.text import printable

#: Head of a refused item: transport size and length.
_REFUSED: Final = bytes(3)

_SIZES: Final = {code.number: code.name.replace(" ", "_") for code in DATA_TRANSPORT_SIZES}
_BY_SIZE: Final = {name: number for number, name in _SIZES.items()}

_ITEM: Final = re.compile(
    r"(?:item (?P<spec><[^>]*>)|(?P<address>\S+) (?P<type>\S+)(?: x(?P<count>[0-9]{1,5}))?(?: db (?P<db>[0-9]{1,5}))?)"
    r"(?: = (?P<value><[^>]*>|\[[^\]]*\]|\"[^\"]*\"|[^\s<\[\"]\S*))?"
    r"(?: as (?P<size>\S+))?"
    r"(?: refused 0x(?P<code>[0-9a-f]{2})(?: head (?P<head><[^>]*>))?)?"
)
_SETUP: Final = re.compile(r"PDU ([0-9]{1,5}), AmQ ([0-9]{1,5})/([0-9]{1,5})")


def parse_setup(text: str) -> Setup:
    """Parse the text of a `Setup`. Raises ValueError."""
    match = _SETUP.fullmatch(text)
    numbers = [int(number) for number in match.groups()] if match else [0x10000]
    if match is None or max(numbers) > 0xFFFF:
        raise ValueError(f"{text} is not of the form PDU 480, AmQ 1/1")
    return Setup(numbers[1], numbers[2], numbers[0])


class ItemLine:
    """An item of a read or write with its result.

    ``data`` is None if there is none, ``code`` -1 without an answer; ``size`` is the data transport size; ``head`` follows the
    code of a refused item of a read.
    """

    __slots__ = ("code", "data", "head", "octets", "size")

    def __init__(self, octets: bytes, data: bytes | None, code: int, size: int, head: bytes = _REFUSED) -> None:
        self.octets = octets
        self.data = data
        self.code = code
        self.size = size
        self.head = head

    def fields(self) -> tuple[bytes, bytes | None, int, int, bytes]:
        """Return the attributes, in the order of the arguments."""
        return self.octets, self.data, self.code, self.size, self.head


def usual_size(item: Item) -> int:
    """Return the usual data transport size for an item."""
    return ANSWER_TRANSPORT_SIZE.get(int(item.transport_size), DATA_BYTES)


def item_lines(request: Pdu, answer: Pdu | None) -> list[ItemLine]:
    """Return the items of a read or write; ``answer`` has their results."""
    writes = request.function == WRITE_VAR
    written = request.data_items() if writes else []
    contents = written if writes else answer.data_items() if answer is not None else []
    reads = answer is not None and not writes and answer.function == READ_VAR and answer.rosctr == ACK_DATA
    codes = [] if answer is None else [item.return_code for item in contents] if reads else answer.return_codes()
    lines = []
    for index, item in enumerate(request.parameters.items):
        code = int(codes[index]) if index < len(codes) else -1
        content = contents[index] if index < len(contents) else None
        if content is None:
            lines.append(ItemLine(item.octets, None, code, usual_size(item)))
        elif not writes and code != SUCCESS:
            head = bytes((content.transport_size,)) + (int(content.length) & 0xFFFF).to_bytes(2, "big")
            lines.append(ItemLine(item.octets, None, code, usual_size(item), head))
        else:
            lines.append(ItemLine(item.octets, content.data, code, int(content.transport_size)))
    return lines


def form_lines(request: Pdu, answer: Pdu | None, response: bytes) -> tuple[list[str], bool]:
    """Return a read or write as lines, and whether the lines also give exactly the answer ``response``."""
    lines = item_lines(request, answer)
    plain = bool(response) and build_answer(request.function, lines) == response
    if not plain:
        lines = item_lines(request, None)
    return [f"  {item_text(line)}" for line in lines] or ["  # no items"], plain


def item_text(line: ItemLine) -> str:
    """Return an item as a line; a comment explains a code or octets."""
    item, text = _named(line.octets)
    remark = item.address if text.startswith("item ") else ""
    data = line.data
    if data is not None:
        value, meaning = shown_value(int(item.transport_size), data, item.fits(len(data)))
        text += f" = {value}"
        remark = remark or meaning
        if line.size != usual_size(item):
            text += f" as {_SIZES.get(line.size, f'0x{line.size:02x}')}"
    if line.code not in {-1, SUCCESS}:
        text += f" refused 0x{line.code:02x}"
        remark = RETURN_CODES.name(line.code)
        if line.head != _REFUSED:
            text += f" head {hex_text(line.head)}"
    return f"{text}  # {printable(remark)}" if remark else text


@lru_cache(4096)
def _named(octets: bytes) -> tuple[Item, str]:
    """Return a request item (at most 257 octets) and its name."""
    item = parse_item(octets, 0)
    return item, named_item(item)


def parse_item_text(text: str) -> ItemLine:
    """Parse the output of `item_text` without its comment; ``code`` is -1 unless the item was refused. Raises ValueError."""
    match = _ITEM.fullmatch(text)
    if match is None:
        raise ValueError(f"{text} is not an item such as DB10.DBW4 INT = 1234")
    if match["spec"] is not None:
        octets = hex_octets(match["spec"])
        if len(octets) < 3 or len(octets) != octets[1] + 2:
            raise ValueError(f"{match['spec']} is not an item: its second byte must count the bytes after it")
    else:
        octets = item_octets(match["address"], match["type"], int(match["count"] or 1), int(match["db"] or 0))
    item = parse_item(octets, 0)
    data = value_octets(match["value"], int(item.transport_size)) if match["value"] is not None else None
    size = usual_size(item)
    if match["size"] is not None:
        size = _BY_SIZE[match["size"]] if match["size"] in _BY_SIZE else int(match["size"], 16)
    code = int(match["code"], 16) if match["code"] is not None else -1
    head = hex_octets(match["head"]) if match["head"] is not None else _REFUSED
    if len(head) != len(_REFUSED) or not 0 <= size <= 0xFF:
        raise ValueError(f"{text}: a head has three bytes, a transport size has one")
    return ItemLine(octets, data, code, size, head)


def build_request(function: int, lines: Sequence[ItemLine]) -> bytes:
    """Return the read or write that requests the items."""
    data = [] if function == READ_VAR else [build_data_item(0, line.size, line.data or b"") for line in lines]
    return build_variables(JOB, function, len(lines), build_items([line.octets for line in lines]), build_items(data))


def build_answer(function: int, lines: Sequence[ItemLine]) -> bytes:
    """Return the answer with the results of the items; an item without a code succeeded."""
    codes = [SUCCESS if line.code < 0 else line.code for line in lines]
    if function == WRITE_VAR:
        return build_variables(ACK_DATA, function, len(lines), b"", bytes(codes))
    items = [
        build_data_item(code, line.size, line.data or b"") if code == SUCCESS else bytes((code,)) + line.head
        for code, line in zip(codes, lines, strict=True)
    ]
    return build_variables(ACK_DATA, function, len(lines), b"", build_items(items))
