"""Ordinary reads and writes, well formed and answered as devices answer: masked and written in few steps.

`dissect.testing.golden.masking` masks every message and `dissect.testing.golden.forms` writes every transaction; the functions
here give the same results for ordinary ones, and nothing for others. Compiled: each slice ends after its beginning and within
the message.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7.items import DATA_HEAD, Item, data_size_within
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE, PROTOCOL_ID
from dissect.protocols.s7.tables import (
    ACK_DATA,
    ANSWER_TRANSPORT_SIZE,
    BIT,
    BYTE,
    CHAR,
    DATA_BIT,
    DATA_BYTES,
    DATA_TRANSPORT_SIZES,
    JOB,
    LENGTH_IN_BITS,
    READ_VAR,
    REAL,
    RETURN_CODES,
    SUCCESS,
    WRITE_VAR,
)
from dissect.protocols.s7.values import decode_value, number_texts
from dissect.testing.golden.addresses import named_item
from dissect.testing.golden.values import shown_value
from dissect.wire.octets import u16
from dissect.wire.text import hex_number, printable

#: Maximum number of cached item names; when it is exceeded, the cache is emptied.
_MOST: Final = 4096
#: Octets of an answer before its items: header, function, count.
_HEAD: Final = ACK_HEADER_SIZE + 2
_LEAST: Final = 12
_PARAM_LENGTH: Final = 6
_DATA_LENGTH: Final = 8
_ERROR: Final = 10
#: Types whose values are written as numbers if that is exact; values of all others are written as octets, with a remark.
_EXACT: Final = frozenset((BIT, BYTE, CHAR, 0x04, 0x05, 0x06, 0x07, REAL, 0x30))
_SIZES: Final = {code.number: code.name.replace(" ", "_") for code in DATA_TRANSPORT_SIZES}
#: Characters that need no escape in quotes.
_PRINTS: Final = bytes([octet for octet in range(0x20, 0x7F) if octet not in b'"#\\'])


class ItemName:
    """The notation of an item of a request: its text and remark, and the usual data transport size of its answer."""

    __slots__ = ("item", "remark", "text", "usual_size")

    def __init__(self, item: Item) -> None:
        self.item = item
        self.text = named_item(item)
        self.remark = item.address if self.text.startswith("item ") else ""
        self.usual_size: i64 = ANSWER_TRANSPORT_SIZE.get(int(item.transport_size), DATA_BYTES)


_names: Final[dict[bytes, ItemName]] = {}


def item_name(item: Item) -> ItemName:
    """Return the notation of an item of a request; cached, because polling requests the same items repeatedly."""
    known = _names.get(item.octets)
    if known is None:
        known = ItemName(item)
        if len(_names) >= _MOST:
            _names.clear()
        _names[item.octets] = known
    return known


# ---- masking --------------------------------------------------------------------------------------------------------


def masked(octets: bytes) -> bytes | None:
    """Return a read, a write, or an answer to one, without its reference; None for others, or if more must be masked."""
    size: i64 = len(octets)
    if size < _LEAST or octets[0] != PROTOCOL_ID:
        return None
    answers = octets[1] == ACK_DATA
    if not answers and octets[1] != JOB:
        return None
    head: i64 = ACK_HEADER_SIZE if answers else HEADER_SIZE
    function: i64 = octets[head] if size > head else -1
    if function not in (READ_VAR, WRITE_VAR):
        return None
    if (function == READ_VAR) == answers and size > head + 1 and octets[head + 1] > 1:
        at: i64 = head + u16(octets, _PARAM_LENGTH)
        if not _fills_clear(octets, at, octets[head + 1], answers):
            return None
    return b"".join((octets[:4], b"\0\0", octets[6:]))


def _fills_clear(octets: bytes, at: i64, count: i64, answers: bool) -> bool:
    """Return whether the fill octets between items are all zero; False if that is uncertain."""
    size: i64 = len(octets)
    for _ in range(count - 1):
        if at + DATA_HEAD > size:
            return False
        if not answers or octets[at] == SUCCESS:
            content = data_size_within(octets[at + 1], u16(octets, at + 2), size - at - DATA_HEAD)
        else:
            content = 0
        at += DATA_HEAD + content
        if content & 1:
            if at >= size or octets[at]:
                return False
            at += 1
    return True


# ---- lines ----------------------------------------------------------------------------------------------------------


def read_lines(items: list[Item], answer: bytes) -> list[str] | None:
    """Return a read as lines; None if these lines would not give exactly the masked ``answer``."""
    size: i64 = len(answer)
    count: i64 = len(items)
    if count == 0 or size < _HEAD or not _plain_head(answer, READ_VAR, count):
        return None
    at: i64 = _HEAD
    lines: list[str] = []
    for item in items:
        if at + DATA_HEAD > size:
            return None
        name = item_name(item)
        code: i64 = answer[at]
        kind: i64 = answer[at + 1]
        length: i64 = u16(answer, at + 2)
        at += DATA_HEAD
        if code != SUCCESS:
            head = "" if kind == 0 and length == 0 else f" head <{answer[at - 3 : at].hex(' ')}>"
            lines.append(f"  {name.text} refused {hex_number(code, 2)}{head}{_remark(RETURN_CODES.name(code))}")
            continue
        content = data_size_within(kind, length, size - at)
        counted: i64 = content * 8 if kind in LENGTH_IN_BITS and kind != DATA_BIT else content
        if counted != length:
            return None
        end: i64 = at + content
        if end > size or content == 0:
            return None
        lines.append(_line(name, answer[at:end], kind))
        at = end
        if content & 1 and len(lines) < count:
            if at >= size or answer[at]:
                return None
            at += 1
    return lines if at == size else None


def write_lines(items: list[Item], contents: list[bytes], kinds: list[int], answer: bytes) -> list[str] | None:
    """Return a write as lines, from the ``contents`` and data transport sizes of its items; None as for `read_lines`."""
    size: i64 = len(answer)
    count: i64 = len(items)
    if size != _HEAD + count or count == 0 or len(contents) != count or not _plain_head(answer, WRITE_VAR, count):
        return None
    lines: list[str] = []
    at: i64 = _HEAD
    for index, item in enumerate(items):
        if answer[at] != SUCCESS:
            return None
        lines.append(_line(item_name(item), contents[index], kinds[index]))
        at += 1
    return lines


def _plain_head(answer: bytes, function: i64, count: i64) -> bool:
    """Return whether a masked answer of at least 14 octets begins as usual and does not refuse the whole request."""
    return (
        answer[0] == PROTOCOL_ID
        and answer[1] == ACK_DATA
        and u16(answer, 2) == 0
        and u16(answer, 4) == 0
        and u16(answer, _PARAM_LENGTH) == 2
        and u16(answer, _DATA_LENGTH) == len(answer) - _HEAD
        and u16(answer, _ERROR) == 0
        and answer[ACK_HEADER_SIZE] == function
        and answer[ACK_HEADER_SIZE + 1] == count
    )


def _line(name: ItemName, data: bytes, kind: i64) -> str:
    """Return an item with its value, like `dissect.testing.golden.forms.item_text`."""
    item = name.item
    value, meaning = fast_shown_value(item.transport_size, data, item.fits(len(data)))
    size = "" if kind == name.usual_size else f" as {_SIZES.get(kind) or hex_number(kind, 2)}"
    return f"  {name.text} = {value}{size}{_remark(name.remark or meaning)}"


def _remark(text: str) -> str:
    return f"  # {printable(text)}" if text else ""


def fast_shown_value(transport_size: i64, data: bytes, fits: bool) -> tuple[str, str]:
    """Return the same as `shown_value`: the text of ``data``, and a remark with its value if the text does not show it."""
    size: i64 = len(data)
    if not fits:
        return f"<{data.hex(' ')}>", ""
    if size == 0:
        return shown_value(int(transport_size), data, fits)
    if transport_size == BIT and size == 1 and data[0] < 2:
        return "true" if data[0] else "false", ""
    if transport_size == BYTE and size > 1:
        return f"<{data.hex(' ')}>", ""
    if transport_size == CHAR and not data.translate(None, _PRINTS):
        return f'"{data.decode("ascii")}"', ""
    if transport_size not in _EXACT:
        value = decode_value(transport_size, data)
        return f"<{data.hex(' ')}>", str(value) if isinstance(value, (str, float)) else ""
    if transport_size != REAL or _finite(data):
        texts = number_texts(transport_size, data, size)
        if texts:
            return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]", ""
    return shown_value(int(transport_size), data, fits)


def _finite(data: bytes) -> bool:
    """Return whether all singles are numbers: NaN has several encodings, which the text does not distinguish."""
    at: i64 = 0
    while at + 1 < len(data):
        if data[at] & 0x7F == 0x7F and data[at + 1] & 0x80:
            return False
        at += 4
    return True
