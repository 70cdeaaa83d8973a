"""The memory of the fake PLC: the recorded contents of its areas, and what clients have written since.

Each bit is known or unknown: only data that were read or written in the recording can be read or written again.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.build import build_data_item
from dissect.protocols.s7.items import DATA_HEAD, Item
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.tables import (
    ANSWER_TRANSPORT_SIZE,
    BIT,
    DATA_BYTES,
    ELEMENT_OCTETS,
    JOB,
    NUMBERED_AREAS,
    READ_VAR,
    RECORD_AREA,
    SUCCESS,
    WRITE_VAR,
)
from dissect.testing.playback.server.answer_index import item_answers
from dissect.testing.playback.server.model import Recording

_PAGE: Final = 256
#: Maximum number of pages of 256 octets, over all areas.
MAX_PAGES: Final = 65_536
_ALL: Final = 0xFF

_Key = tuple[int, int, int]


class _Page:
    """256 octets of an area, and which bits of them are known."""

    __slots__ = ("known", "octets")

    def __init__(self) -> None:
        self.octets = bytearray(_PAGE)
        self.known = bytearray(_PAGE)


class Image:
    """The areas of a recording. ``full``: some data were dropped (`MAX_PAGES`)."""

    def __init__(self, recording: Recording) -> None:
        self.full = False
        self._pages: dict[_Key, _Page] = {}
        self._sizes: dict[int, int] = {}  # data transport sizes in this server's answers, by those of the items
        seen: set[tuple[bytes, bytes]] = set()
        for script in recording.scripts:
            for step in () if script.plus else script.steps:
                alike = (step.request[6:], step.answer[6:])
                if step.answer and alike not in seen:
                    seen.add(alike)
                    self._learn(step.request, step.answer)

    def _learn(self, request: bytes, answer: bytes) -> None:
        """Take the contents of a read or write for octets that are still unknown."""
        request_pdu = parse_pdu(request)
        if request_pdu.rosctr != JOB or request_pdu.function not in {READ_VAR, WRITE_VAR}:
            return
        writes = request_pdu.function == WRITE_VAR
        results = item_answers(request_pdu, answer)
        written = request_pdu.data_items() if writes else []
        for index, (item, octets) in enumerate(zip(request_pdu.parameters.items, results, strict=False)):
            if octets[0] != SUCCESS or not holds(item):
                continue
            if writes:
                data = written[index].data if index < len(written) else b""
            else:
                data = octets[DATA_HEAD:]
                self._sizes.setdefault(int(item.transport_size), octets[1])
            if len(data) == item.size:
                self._put(item, data, True)

    # ---- reading and writing ----------------------------------------------------------------------------------------

    def read(self, item: Item) -> bytes | None:
        """Return the data item for a read, None if some of it is unknown."""
        data = self.get(item)
        if data is None:
            return None
        requested = int(item.transport_size)
        size = self._sizes.get(requested, ANSWER_TRANSPORT_SIZE.get(requested, DATA_BYTES))
        return build_data_item(SUCCESS, size, data)

    def get(self, item: Item) -> bytes | None:
        """Return the octets of an item, None if some of them are unknown."""
        if not holds(item):
            return None
        if item.transport_size == BIT:
            octet, mask = int(item.start_bit) >> 3, 1 << (int(item.start_bit) & 7)
            page = self._pages.get(self._key(item, octet))
            if page is None or not page.known[octet % _PAGE] & mask:
                return None
            return b"\x01" if page.octets[octet % _PAGE] & mask else b"\x00"
        first = _first_octet(item)
        data = bytearray()
        while len(data) < item.size:
            at = first + len(data)
            page = self._pages.get(self._key(item, at))
            take = min(_PAGE - at % _PAGE, int(item.size) - len(data))
            inside = slice(at % _PAGE, at % _PAGE + take)
            if page is None or page.known[inside].count(_ALL) != take:
                return None
            data += page.octets[inside]
        return bytes(data)

    def write(self, item: Item, data: bytes) -> bool:
        """Write an item; return False, without writing, if it is unknown. ``data`` must have its size."""
        if self.get(item) is None:
            return False
        self._put(item, data, False)
        return True

    def _put(self, item: Item, data: bytes, fresh: bool) -> None:
        """Set octets, or with ``fresh`` only bits that are still unknown."""
        if item.transport_size == BIT:
            bit = 1 << (int(item.start_bit) & 7)
            self._set(item, int(item.start_bit) >> 3, bit if data[0] & 1 else 0, bit, fresh)
            return
        first = _first_octet(item)
        for index, value in enumerate(data):
            self._set(item, first + index, value, _ALL, fresh)

    def _set(self, item: Item, octet: int, value: int, mask: int, fresh: bool) -> None:
        key = self._key(item, octet)
        page = self._pages.get(key)
        if page is None:
            if len(self._pages) >= MAX_PAGES:
                self.full = True
                return
            page = self._pages[key] = _Page()
        at = octet % _PAGE
        if fresh:
            mask &= ~page.known[at]
        page.octets[at] = page.octets[at] & ~mask & _ALL | value & mask
        page.known[at] |= mask

    @staticmethod
    def _key(item: Item, octet: int) -> _Key:
        return int(item.area), int(item.db), octet // _PAGE


def holds(item: Item) -> bool:
    """Return whether an item consists of octets or one bit, so that it can be kept in memory."""
    if item.size <= 0 or item.area == RECORD_AREA or int(item.transport_size) not in ELEMENT_OCTETS:
        return False
    return item.transport_size == BIT or item.area in NUMBERED_AREAS or item.start_bit & 7 == 0


def _first_octet(item: Item) -> int:
    """Return the first octet of an item; timers and counters are numbered, two octets each."""
    return int(item.start_bit) * 2 if item.area in NUMBERED_AREAS else int(item.start_bit) >> 3
