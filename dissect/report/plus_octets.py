"""What lines of JSON say of S7comm-plus transactions, as octets: the function, the notes, both heads and the items.

A panel asks for the same variables all the time, and an engineering tool for the same states; most answers are those of before
as well. PDUs that are alike but for numbers that each has for itself (digest, sequence number, session, integrity id) are read
and put into words once (`Known`), and so are the items of a request and an answer that met before.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.report.plus import (
    head_begin,
    head_json,
    malformed_note,
    notification_begin,
    plus_alarms,
    plus_function,
    plus_notes,
    subscription_note,
)
from dissect.report.plus_items import write_item
from dissect.s7plus.hiding import reads_secret, said_half
from dissect.s7plus.ids import HIDDEN
from dissect.s7plus.items import Half, join_items
from dissect.s7plus.message import DIGEST_SIZE, parse_plus
from dissect.s7plus.sameness import Seen
from dissect.s7plus.session import PlusSession
from dissect.s7plus.summary import summary
from dissect.s7plus.tables import NOTIFICATION, REQUEST, V3
from dissect.transactions.transaction import Transaction
from dissect.wire.digits import write_decimal, write_hexadecimal
from dissect.wire.text import json_text

_COMMA: Final = 0x2C
_QUOTE: Final = 0x22
_CLOSE: Final = 0x7D
#: What is remembered is forgotten together when it takes so much: of each PDU some times its own octets, and what any takes;
#: of items their octets, and what any take.
_MAX_KEPT: Final = 4 * 1024 * 1024
_COST: Final = 2048
_TIMES: Final = 8
_ITEMS_COST: Final = 256
#: Bits of the number of what is known, of which there is never more than that allows; and of a stamp of a session or a
#: program: items of those that need more are not remembered.
_NUMBER_BITS: Final = 12
_STAMP_BITS: Final = 24
_MAX_STAMP: Final = 1 << _STAMP_BITS
#: What is added to the stamp of a session, which stands where a request has its number: above every such number.
_FIRST_STAMP: Final = 1 << _NUMBER_BITS
#: Heads of requests that are remembered.
_MAX_HEADS: Final = 4096


class Known:
    """What lines say of PDUs that are alike.

    ``half`` is the first of them, ``notes`` are what it says beside its function, as elements of an array, ``head`` is how
    `head_json` begins. Of a request and a notification both are without what each has for itself. ``number`` is 0 for a PDU
    that is alike to none, whose ``head`` is whole. ``secret``: what answers the request is not shown.
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
    """What requests of one session have in common: the beginning of `head_json`, and notes."""

    __slots__ = ("head", "notes")

    def __init__(self, head: bytes, notes: bytes) -> None:
        self.head = head
        self.notes = notes


class PlusLines:
    """Writes what only lines of S7comm-plus have."""

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
        """Write what stands between the connection and the packets."""
        if transaction.function >= 0:
            write_decimal(out, transaction.pdu_ref)
        else:
            out.write(b"null")
        out.write(b',"rosctr":null,"function":')
        out.write(plus_function(transaction.parameters).encode("ascii"))
        out.write(b',"request_frame":')

    def write_body(self, out: BytesWriter, transaction: Transaction) -> None:
        """Write the keys that only these lines have, and the items without the bracket that ends them."""
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
        """Return what is known of a PDU, and leave in ``seen`` what it has for itself."""
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
        """Return what requests of the session have in common."""
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
        """Write the items; those of a request and an answer that met before, while the same was known, as they were then."""
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
    """Return a number that two transactions have in common only if their items are the same, -1 for none.

    What a request asks for, it says itself; what a notification is about is known of the session.
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
    """Return what a line says of a PDU that is compared with no other."""
    seen.alike = False
    pdu = half.pdu
    texts = plus_notes(pdu) + summary(pdu, half.contents) + malformed_note(half)
    return Known(half, _elements(texts), head_json(pdu, half.contents.integrity_id).encode("ascii"))


def _of_all(half: Half) -> Known:
    """Return what a line says of a PDU, and of all that are alike."""
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
    """Return texts as elements of an array of JSON."""
    return ",".join([json_text(text) for text in texts]).encode("ascii")
