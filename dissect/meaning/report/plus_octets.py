"""The S7comm-plus part of JSON lines of transactions, as octets: the function, the notes, both heads and the items.

Panels and engineering tools poll: most requests and answers repeat earlier ones. PDUs that differ only in digest, sequence
number, session and integrity id are decoded and described once (`Known`). The items of a request and an answer that were paired
before are also written from memory.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.plus import (
    head_begin,
    head_json,
    malformed_note,
    notification_begin,
    plus_alarms,
    plus_function,
    plus_notes,
    subscription_note,
)
from dissect.meaning.report.plus_items import write_item
from dissect.protocols.s7plus.hiding import reads_secret, said_half
from dissect.protocols.s7plus.ids import HIDDEN
from dissect.protocols.s7plus.items import Half, join_items
from dissect.protocols.s7plus.message import DIGEST_SIZE, parse_plus
from dissect.protocols.s7plus.sameness import Seen
from dissect.protocols.s7plus.session import PlusSession
from dissect.protocols.s7plus.summary import summary
from dissect.protocols.s7plus.tables import NOTIFICATION, REQUEST, V3
from dissect.wire.digits import write_decimal, write_hexadecimal
from dissect.wire.text import json_text

_COMMA: Final = 0x2C
_QUOTE: Final = 0x22
_CLOSE: Final = 0x7D
#: All caches are emptied when they reach this estimated size: `_TIMES` the size of a PDU plus `_COST`; for items their size
#: plus `_ITEMS_COST`.
_MAX_KEPT: Final = 4 * 1024 * 1024
_COST: Final = 2048
_TIMES: Final = 8
_ITEMS_COST: Final = 256
#: Bits in `_key` for the number of a `Known` (`_MAX_KEPT` limits how many there are), and for the stamp of a session or a
#: program. Items are not remembered if a stamp needs more bits.
_NUMBER_BITS: Final = 12
_STAMP_BITS: Final = 24
_MAX_STAMP: Final = 1 << _STAMP_BITS
#: Added to the stamp of a session, which replaces a request's number in `_key`, so that the two are never equal.
_FIRST_STAMP: Final = 1 << _NUMBER_BITS
#: Maximum number of heads of requests that are remembered.
_MAX_HEADS: Final = 4096


class Known:
    """The texts for PDUs that are alike.

    ``half`` is the first of them, ``notes`` are its texts besides its function, as elements of an array, ``head`` is the
    beginning of its `head_json`. For a request or notification, both are without its individual parts. ``number`` is 0 for a
    PDU that is like no other, whose ``head`` is complete. ``secret``: the answer to the request is not shown.
    """

    __slots__ = ("alarms", "half", "head", "notes", "number", "secret")

    def __init__(self, half: Half, notes: bytes, head: bytes) -> None:
        self.half = half
        self.notes = notes
        self.head = head
        self.alarms = plus_alarms(half.contents).encode("ascii")
        self.number: i64 = 0
        self.secret = reads_secret(half)


class _Head:
    """The texts that the requests of one session have in common: the beginning of `head_json`, and notes."""

    __slots__ = ("head", "notes")

    def __init__(self, head: bytes, notes: bytes) -> None:
        self.head = head
        self.notes = notes


class PlusLines:
    """Writes the keys of a line that are different for S7comm-plus."""

    def __init__(self) -> None:
        self._request: Seen = Seen()
        self._answer: Seen = Seen()
        self._known: dict[int, dict[bytes, Known]] = {}
        self._count: i64 = 0
        self._kept: i64 = 0
        self._items: dict[int, bytes] = {}
        self._heads: dict[int, _Head] = {}
        self._part: BytesWriter = BytesWriter()

    def write_function(self, out: BytesWriter, transaction: Transaction) -> None:
        """Write the value of ``pdu_ref`` and the keys after it, up to the key ``request_frame``."""
        if transaction.function >= 0:
            write_decimal(out, transaction.pdu_ref)
        else:
            out.write(b"null")
        out.write(b',"rosctr":null,"function":')
        out.write(plus_function(transaction.parameters).encode("ascii"))
        out.write(b',"request_frame":')

    def write_body(self, out: BytesWriter, transaction: Transaction) -> None:
        """Write the keys ``asks``, ``tells`` and ``s7plus``, and the items without the closing bracket."""
        if self._kept > _MAX_KEPT:
            self._forget()
        asked: Known | None = None
        told: Known | None = None
        if transaction.request_size:
            asked = self._find(self._request, transaction.request_octets)
        if transaction.response_size:
            told = self._find(self._answer, transaction.response_octets)
        out.write(b',"asks":[')
        if asked is not None:
            self._write_notes(out, self._request, asked)
        out.write(b'],"tells":[')
        if told is not None and asked is not None and asked.secret:
            pdu = told.half.pdu
            out.write(_elements([*plus_notes(pdu), HIDDEN, *malformed_note(told.half)]))
        elif told is not None:
            self._write_notes(out, self._answer, told)
        out.write(b'],"s7plus":{"request":')
        self._write_head(out, self._request, asked)
        out.write(b',"response":')
        self._write_head(out, self._answer, told)
        if told is not None:
            out.write(told.alarms)
        out.write(b'},"items":[')
        self._write_items(out, asked, told, transaction.connection.plus)

    def _forget(self) -> None:
        self._known.clear()
        self._items.clear()
        self._count = 0
        self._kept = 0

    def _find(self, seen: Seen, octets: bytes) -> Known:
        """Return the texts for a PDU, and read its own numbers into ``seen``."""
        alike: dict[bytes, Known] | None = None
        if seen.read(octets):
            alike = self._known.get(int(seen.kind))
            known = alike.get(seen.body) if alike is not None else None
            if known is not None:
                if not seen.has_id:
                    seen.integrity_id = known.half.contents.integrity_id
                return known
        half = said_half(parse_plus(octets))
        contents = half.contents
        if not seen.alike or not contents.whole or contents.malformed:
            return _alone(seen, half)
        if not seen.has_id:
            seen.integrity_id = contents.integrity_id
        elif contents.integrity_id != seen.integrity_id:
            return _alone(seen, half)
        found = _of_all(half)
        self._count += 1
        found.number = self._count
        if alike is None:
            alike = {}
            self._known[int(seen.kind)] = alike
        alike[seen.body] = found
        self._kept += _COST + _TIMES * len(octets)
        return found

    def _write_notes(self, out: BytesWriter, seen: Seen, known: Known) -> None:
        begin = len(out)
        if seen.alike and seen.opcode == REQUEST:
            out.write(self._head(seen).notes)
        elif seen.alike and seen.opcode == NOTIFICATION:
            out.write(_subscription_note(seen.subscription_id))
            if seen.number >= 0:
                out.write(b',"number ')
                write_decimal(out, seen.number)
                out.append(_QUOTE)
        if known.notes:
            if len(out) > begin:
                out.append(_COMMA)
            out.write(known.notes)

    def _write_head(self, out: BytesWriter, seen: Seen, known: Known | None) -> None:
        if known is None:
            out.write(b"null")
            return
        if not seen.alike:
            out.write(known.head)
            return
        if seen.opcode == REQUEST:
            out.write(self._head(seen).head)
        else:
            out.write(known.head)
            if seen.opcode == NOTIFICATION:
                out.write(b',"number":')
                write_decimal(out, seen.number)
                out.write(b',"credit_tick":')
                write_decimal(out, seen.credit_tick)
        if seen.version == V3:
            out.write(b',"integrity":"')
            write_hexadecimal(out, seen.octets, seen.at - DIGEST_SIZE, seen.at)
            out.append(_QUOTE)
        if seen.integrity_id >= 0:
            out.write(b',"integrity_id":')
            write_decimal(out, seen.integrity_id)
        out.append(_CLOSE)

    def _head(self, seen: Seen) -> _Head:
        """Return the texts that the requests of the session have in common."""
        found = self._heads.get(int(seen.session))
        if found is None:
            pdu = parse_plus(seen.octets)
            found = _Head(head_begin(pdu).encode("ascii"), _elements(plus_notes(pdu)))
            if len(self._heads) >= _MAX_HEADS:
                self._heads.clear()
            self._heads[int(seen.session)] = found
        return found

    def _write_items(
        self, out: BytesWriter, asked: Known | None, told: Known | None, session: PlusSession | None
    ) -> None:
        """Write the items; from memory if this request and answer were paired before with the same knowledge of the program."""
        key = _key(asked, told, session)
        if key >= 0:
            found = self._items.get(int(key))
            if found is not None:
                out.write(found)
                return
        items = join_items(asked.half if asked is not None else None, told.half if told is not None else None, session)
        part = self._part
        part.truncate(0)
        first = True
        for item in items:
            if not first:
                part.append(_COMMA)
            first = False
            write_item(part, item)
        octets = part.getvalue()
        if key >= 0:
            self._items[int(key)] = octets
            self._kept += len(octets) + _ITEMS_COST
        out.write(octets)


def _key(asked: Known | None, told: Known | None, session: PlusSession | None) -> i64:
    """Return a number that two transactions share only if their items are equal; -1 if there is none.

    With a request, the items follow from it; those of a notification follow from the session, whose stamp is used instead.
    """
    program: i64 = 0
    other: i64 = _FIRST_STAMP
    number: i64 = 0
    if session is not None:
        program = session.program.stamp + 1
        other += session.stamp
    if asked is not None:
        other = asked.number
        if other == 0:
            return -1
    if told is not None:
        number = told.number
        if number == 0:
            return -1
    if program >= _MAX_STAMP or other >= _MAX_STAMP:
        return -1
    return (program << _STAMP_BITS | other) << _NUMBER_BITS | number


def _subscription_note(subscription: i64) -> bytes:
    return f'"{subscription_note(subscription)}"'.encode("ascii")


def _alone(seen: Seen, half: Half) -> Known:
    """Return the complete texts for a PDU that is not compared with others."""
    seen.alike = False
    pdu = half.pdu
    texts = plus_notes(pdu) + summary(pdu, half.contents) + malformed_note(half)
    return Known(half, _elements(texts), head_json(pdu, half.contents.integrity_id).encode("ascii"))


def _of_all(half: Half) -> Known:
    """Return the texts for a PDU and for all that are like it."""
    pdu = half.pdu
    texts = summary(pdu, half.contents)
    head = ""
    if pdu.opcode == NOTIFICATION:
        head = notification_begin(pdu)
    elif pdu.opcode != REQUEST:
        texts = plus_notes(pdu) + texts
        head = head_begin(pdu)
    return Known(half, _elements(texts), head.encode("ascii"))


def _elements(texts: list[str]) -> bytes:
    """Return texts as the elements of a JSON array, without its brackets."""
    return ",".join([json_text(text) for text in texts]).encode("ascii")
