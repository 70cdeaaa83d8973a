"""What becomes of a field of a message, by what its layout says it holds: a number stays, octets only where they are public.

A field whose content is not stated is set to zero, so that a structure that is described tomorrow gives nothing away today.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

from dissect.anonymize import account
from dissect.anonymize.account import KEEP, SCRAMBLE, Choices
from dissect.anonymize.addresses import AddressMap
from dissect.anonymize.key import Key
from dissect.anonymize.rewrite_plan import RewritePlan
from dissect.anonymize.scd import ScdRules
from dissect.anonymize.texts import replace_bit, replace_octets, replace_path, replace_text
from dissect.s7.data_parts import CONTENT
from dissect.s7.items import DATA_HEAD, DataItem
from dissect.s7.layouts import DATA_ITEM
from dissect.s7.services import PI_SERVICES
from dissect.s7.tables import DATA_BIT
from dissect.wire.layout import (
    HOLDS_ADDRESS,
    HOLDS_ARGUMENT,
    HOLDS_BLOCK_TEXT,
    HOLDS_CODE,
    HOLDS_FLAGS,
    HOLDS_MAC,
    HOLDS_NAME,
    HOLDS_NUMBER,
    HOLDS_PATH,
    HOLDS_PRODUCT,
    HOLDS_SECRET,
    HOLDS_SERIAL,
    HOLDS_SERVICE,
    HOLDS_TIME,
    HOLDS_VALUE,
    FieldValue,
    Layout,
    latin,
)
from dissect.wire.part import OCTETS, SURPLUS, Part

#: What says something of the protocol or the product, not of the plant, and stays where it is what its field says.
_PUBLIC: Final = frozenset((HOLDS_FLAGS, HOLDS_NUMBER, HOLDS_PRODUCT, HOLDS_TIME))
#: Texts that become others of the same length, and what the account calls them.
_REPLACED: Final = {
    HOLDS_BLOCK_TEXT: (replace_text, account.BLOCK_TEXTS),
    HOLDS_NAME: (replace_text, account.NAMES),
    HOLDS_PATH: (replace_path, account.FILE_NAMES),
    HOLDS_SERIAL: (replace_text, account.SERIALS),
}
#: Octets of a request that is remembered, and how many are.
_SMALL: Final = 256
_MOST: Final = 4096
_LETTERS: Final = frozenset(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789 -._/\0")


@cache
def numbers_size(layout: Layout) -> int:
    """Return the size of a part of which everything stays, -1 for one that holds anything but numbers of the protocol."""
    plain = [field.size > 0 and field.means is None and field.holds != HOLDS_VALUE for field in layout.fields]
    return layout.size if all(plain) else -1


class Rules:
    """Treats the parts of messages as ``choices`` say.

    ``known`` are small requests of reads and answers to writes, without their references, of which everything stays: polling
    repeats them. ``known_heads`` are the parameters of writes of which everything stays.
    """

    def __init__(self, key: Key, addresses: AddressMap, choices: Choices, scd: ScdRules | None = None) -> None:
        self.scd = scd
        self.known: set[bytes] = set()
        self.known_heads: set[bytes] = set()
        self._key = key
        self._addresses = addresses
        self._choices = choices
        self._codes: Sequence[int] = ()
        self._openings: tuple[bytes, bytes] = scd.openings if scd is not None else (b"", b"")
        self._inside = choices.values != KEEP or (scd is not None and scd.described)

    def know(self, known: set[bytes], octets: bytes) -> None:
        """Remember octets of which everything stays in ``known``, one of the two sets."""
        if len(octets) <= _SMALL:
            if len(known) >= _MOST:
                known.clear()
            known.add(octets)

    def contents(self, draft: RewritePlan, items: list[DataItem]) -> None:
        """Treat a PDU of which the contents of ``items`` become others, and everything else stays."""
        at = 0
        for item in items:
            begin = int(item.offset) + DATA_HEAD
            end = begin + len(item.data)
            draft.keep(at, begin)
            self._plain_value(draft, begin, end, item.transport_size == DATA_BIT)
            at = end
        draft.keep(at, len(draft.octets))

    def parts(self, draft: RewritePlan, parts: list[Part], codes: Sequence[int] = ()) -> None:
        """Treat the parts of a message, which stand in order; at ``codes`` are return codes inside values, which stay."""
        self._codes = codes
        transport_size = -1
        for part in parts:
            if part.layout is OCTETS or part.layout is SURPLUS:
                draft.zero(part.offset, part.end, account.UNKNOWN)
                continue
            if part.layout is CONTENT:
                self._value(draft, part.offset, part.end, transport_size == DATA_BIT)
                transport_size = -1
                continue
            at = part.offset
            if part.end - at == numbers_size(part.layout):
                draft.keep(at, part.end)
                at = part.end
            for value in part.values if at < part.end else ():
                if value.field.shares:
                    continue
                at = value.end
                if value.octets is not None:
                    self._octets(draft, value, transport_size)
                elif value.field.holds == HOLDS_VALUE:
                    self._value(draft, value.offset, value.end, False)
                else:
                    draft.keep(value.offset, value.end)
            draft.zero(at, part.end, account.UNKNOWN)
            transport_size = part.number("transport_size") if part.layout is DATA_ITEM else -1

    def _octets(self, draft: RewritePlan, value: FieldValue, transport_size: int) -> None:
        holds = value.field.holds
        octets = value.octets or b""
        if holds == HOLDS_VALUE:
            self._value(draft, value.offset, value.end, transport_size == DATA_BIT)
        elif holds in _PUBLIC and _readable(value, octets):
            draft.keep(value.offset, value.end)
        elif holds == HOLDS_CODE:
            self._content(draft, value)
        elif holds == HOLDS_ADDRESS:
            draft.put(value.offset, self._addresses.ip(octets), account.CONTENT_ADDRESSES)
        elif holds == HOLDS_MAC:
            draft.put(value.offset, self._addresses.mac(octets), account.CONTENT_ADDRESSES)
        elif holds in _REPLACED:
            replace, kind = _REPLACED[holds]
            draft.put(value.offset, replace(self._key, octets), kind)
        elif holds in {HOLDS_ARGUMENT, HOLDS_SERVICE}:
            self._argument(draft, value, octets)
        else:
            draft.zero(value.offset, value.end, account.PASSWORDS if holds == HOLDS_SECRET else account.UNKNOWN)

    def _argument(self, draft: RewritePlan, value: FieldValue, octets: bytes) -> None:
        """The name of a service stays where it is known, an argument where it is one letter."""
        service = value.field.holds == HOLDS_SERVICE
        known = octets.decode("latin-1") in PI_SERVICES if service else len(octets.strip(b" \0")) < 2
        if known:
            draft.keep(value.offset, value.end)
        else:
            draft.put(value.offset, replace_path(self._key, octets), account.ARGUMENTS)

    def _content(self, draft: RewritePlan, value: FieldValue) -> None:
        if self._choices.keep_code:
            draft.keep(value.offset, value.end)
            draft.account.keep(account.CODE)
        else:
            draft.zero(value.offset, value.end, account.CODE)

    def _value(self, draft: RewritePlan, begin: int, end: int, bit: bool) -> None:
        for at in self._codes:
            if begin <= at < end:
                self._plain_value(draft, begin, at, bit)
                draft.keep(at, at + 1)
                begin = at + 1
        self._plain_value(draft, begin, end, bit)

    def _plain_value(self, draft: RewritePlan, begin: int, end: int, bit: bool) -> None:
        if begin == end:
            return
        octets = draft.octets[begin:end]
        made = None
        if self.scd is not None and self._inside and octets.startswith(self._openings):
            made = self.scd.inside(octets)
        if made is not None:
            draft.lay(made, begin)
        elif self._choices.values == KEEP:
            draft.keep(begin, end)
            draft.account.keep(account.VALUES)
        elif self._choices.values == SCRAMBLE:
            new = replace_bit(self._key, octets) if bit else replace_octets(self._key, octets)
            draft.put(begin, new, account.VALUES)
        else:
            draft.zero(begin, end, account.VALUES)


def _readable(value: FieldValue, octets: bytes) -> bool:
    """Tell whether octets that tell nothing are what their field says, and not a text in its place."""
    holds, means = value.field.holds, value.field.means
    if holds == HOLDS_PRODUCT:
        return _LETTERS.issuperset(octets)
    if holds == HOLDS_FLAGS:
        return True
    return means is not None and means is not latin and means(octets) is not None  # any text is one to `latin`
