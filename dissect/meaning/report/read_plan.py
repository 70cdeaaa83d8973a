"""The items of a polled read as JSON, fast without compilation: one format string for all answers to the same request.

The compiled package writes lines into a buffer instead (`dissect.meaning.report.writers.jsonl`); a test compares the two.
"""

from __future__ import annotations

import struct
from typing import Final

from dissect.meaning.report.item_json import VALUE, item_text, value_json
from dissect.protocols.s7.items import DATA_HEAD, Item, item_fill
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import BYTE
from dissect.protocols.s7.values import LEAST_TEXT, NUMBER_LETTERS, number_size


class ReadPlan:
    """Writes the items of answers to one request, as long as their layout is that of its answers without errors.

    ``layout`` is the `Parameters.good_layout` for which the plan was made.
    """

    __slots__ = ("_numbers", "_octets", "_others", "_text", "layout")

    def __init__(self, parameters: Parameters) -> None:
        self.layout: Final = parameters.good_layout
        octets = numbers = ">"
        self._others: Final[list[tuple[Item, int, int]]] = []
        items = parameters.items
        forms = [_form(item) for item in items]
        # Numbers of the next fields in the format string: octets of all items come first, then numbers, then other values.
        number = len(items)
        other = number + sum(
            [item.size // number_size(item.transport_size) for item, form in zip(items, forms, strict=True) if form]
        )
        texts: list[str] = []
        at = 0
        for index, (item, form) in enumerate(zip(items, forms, strict=True)):
            size = item.size
            fill = item_fill(size, index + 1 == len(items))
            if form:
                count = size // number_size(item.transport_size)
                value = ",".join([f"{{{field}}}" for field in range(number, number + count)])
                value = f"[{value}]" if count > 1 else value
                number += count
            else:
                value = f"{{{other + len(self._others)}}}"
                self._others.append((item, at + DATA_HEAD, at + DATA_HEAD + size))
            octets += f"{DATA_HEAD}x{size}s{fill}x"
            numbers += f"{DATA_HEAD}x{form or f'{size}x'}{fill}x"
            head = item_text(item).replace("{", "{{").replace("}", "}}")
            texts.append(f"{head}{{{index}}}{VALUE}{value}}}}}")
            at += DATA_HEAD + size + fill
        self._octets: Final = struct.Struct(octets)
        self._numbers: Final = struct.Struct(numbers)
        self._text: Final = ",".join(texts)

    def text(self, buf: bytes, at: int) -> str:
        """Return the items of an answer whose data begin at ``at``."""
        return self._text.format(
            *[octets.hex() for octets in self._octets.unpack_from(buf, at)],
            *self._numbers.unpack_from(buf, at),
            *[value_json(item, buf[at + begin : at + end]) for item, begin, end in self._others],
        )


def _form(item: Item) -> str:
    """Return the `struct` format for the numbers of an item; empty if its value is not only numbers."""
    size = item.size
    letter = NUMBER_LETTERS.get(item.transport_size, "")
    if (
        not letter
        or not size
        or size % number_size(item.transport_size)
        or (item.transport_size == BYTE and size >= LEAST_TEXT)
    ):
        return ""
    return f"{size // number_size(item.transport_size)}{letter}"
