"""Decides by its layout how a field of a message is rewritten: numbers stay, octets only if they are public.

A field without a stated content is set to zero, so that a structure that is described in future reveals nothing today.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

from dissect.files.anonymize import account
from dissect.files.anonymize.account import KEEP, SCRAMBLE, Choices
from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.rewrite_plan import RewritePlan
from dissect.files.anonymize.scd import ScdRules
from dissect.files.anonymize.texts import replace_bit, replace_octets, replace_path, replace_text
from dissect.protocols.s7.data_parts import CONTENT
from dissect.protocols.s7.items import DATA_HEAD, DataItem
from dissect.protocols.s7.layouts import DATA_ITEM
from dissect.protocols.s7.services import PI_SERVICES
from dissect.protocols.s7.tables import DATA_BIT
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

#: Contents that describe the protocol or the product, not the plant, and stay if they match the definition of their field.
_PUBLIC: Final = frozenset((HOLDS_FLAGS, HOLDS_NUMBER, HOLDS_PRODUCT, HOLDS_TIME))
#: Texts that are replaced by others of the same length, and their kinds in the account.
_REPLACED: Final = {
    HOLDS_BLOCK_TEXT: (replace_text, account.BLOCK_TEXTS),
    HOLDS_NAME: (replace_text, account.NAMES),
    HOLDS_PATH: (replace_path, account.FILE_NAMES),
    HOLDS_SERIAL: (replace_text, account.SERIALS),
}
#: Maximum size of a remembered request, and how many are remembered.
_SMALL: Final = 256
_MOST: Final = 4096
_LETTERS: Final = frozenset(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789 -._/\0")


@cache
def numbers_size(layout: Layout) -> int:
    """Return the size of a part that stays completely, -1 for one with anything but protocol numbers."""
    plain = [field.size > 0 and field.means is None and field.holds != HOLDS_VALUE for field in layout.fields]
    return layout.size if all(plain) else -1


class Rules:
    """Rewrites the parts of messages according to ``choices``.

    ``known`` are small read requests and answers to writes, without their references, that stay completely: polling repeats
    them. ``known_heads`` are parameters of writes that stay completely.
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
        """Remember octets that stay completely in ``known``, one of the two sets."""
        if len(octets) <= _SMALL:
            if len(known) >= _MOST:
                known.clear()
            known.add(octets)

    def contents(self, plan: RewritePlan, items: list[DataItem]) -> None:
        """Rewrite a PDU in which only the contents of ``items`` change."""
        at = 0
        for item in items:
            begin = int(item.offset) + DATA_HEAD
            end = begin + len(item.data)
            plan.keep(at, begin)
            self._plain_value(plan, begin, end, item.transport_size == DATA_BIT)
            at = end
        plan.keep(at, len(plan.octets))

    def parts(self, plan: RewritePlan, parts: list[Part], codes: Sequence[int] = ()) -> None:
        """Rewrite the parts of a message, in order; ``codes`` are positions of return codes inside values, which stay."""
        self._codes = codes
        transport_size = -1
        for part in parts:
            if part.layout is OCTETS or part.layout is SURPLUS:
                plan.zero(part.offset, part.end, account.UNKNOWN)
                continue
            if part.layout is CONTENT:
                self._value(plan, part.offset, part.end, transport_size == DATA_BIT)
                transport_size = -1
                continue
            at = part.offset
            if part.end - at == numbers_size(part.layout):
                plan.keep(at, part.end)
                at = part.end
            for value in part.values if at < part.end else ():
                if value.field.shares:
                    continue
                at = value.end
                if value.octets is not None:
                    self._octets(plan, value, transport_size)
                elif value.field.holds == HOLDS_VALUE:
                    self._value(plan, value.offset, value.end, False)
                else:
                    plan.keep(value.offset, value.end)
            plan.zero(at, part.end, account.UNKNOWN)
            transport_size = part.number("transport_size") if part.layout is DATA_ITEM else -1

    def _octets(self, plan: RewritePlan, value: FieldValue, transport_size: int) -> None:
        holds = value.field.holds
        octets = value.octets or b""
        if holds == HOLDS_VALUE:
            self._value(plan, value.offset, value.end, transport_size == DATA_BIT)
        elif holds in _PUBLIC and _readable(value, octets):
            plan.keep(value.offset, value.end)
        elif holds == HOLDS_CODE:
            self._content(plan, value)
        elif holds == HOLDS_ADDRESS:
            plan.put(value.offset, self._addresses.ip(octets), account.CONTENT_ADDRESSES)
        elif holds == HOLDS_MAC:
            plan.put(value.offset, self._addresses.mac(octets), account.CONTENT_ADDRESSES)
        elif holds in _REPLACED:
            replace, kind = _REPLACED[holds]
            plan.put(value.offset, replace(self._key, octets), kind)
        elif holds in {HOLDS_ARGUMENT, HOLDS_SERVICE}:
            self._argument(plan, value, octets)
        else:
            plan.zero(value.offset, value.end, account.PASSWORDS if holds == HOLDS_SECRET else account.UNKNOWN)

    def _argument(self, plan: RewritePlan, value: FieldValue, octets: bytes) -> None:
        """Keep the name of a known service, and an argument of one letter."""
        service = value.field.holds == HOLDS_SERVICE
        known = octets.decode("latin-1") in PI_SERVICES if service else len(octets.strip(b" \0")) < 2
        if known:
            plan.keep(value.offset, value.end)
        else:
            plan.put(value.offset, replace_path(self._key, octets), account.ARGUMENTS)

    def _content(self, plan: RewritePlan, value: FieldValue) -> None:
        if self._choices.keep_code:
            plan.keep(value.offset, value.end)
            plan.account.keep(account.CODE)
        else:
            plan.zero(value.offset, value.end, account.CODE)

    def _value(self, plan: RewritePlan, begin: int, end: int, bit: bool) -> None:
        for at in self._codes:
            if begin <= at < end:
                self._plain_value(plan, begin, at, bit)
                plan.keep(at, at + 1)
                begin = at + 1
        self._plain_value(plan, begin, end, bit)

    def _plain_value(self, plan: RewritePlan, begin: int, end: int, bit: bool) -> None:
        if begin == end:
            return
        if self.scd is not None and self._inside:
            described = plan.octets[begin:end]
            rewritten = self.scd.inside(described) if described.startswith(self._openings) else None
            if rewritten is not None:
                plan.write(rewritten, begin)
                return
        if self._choices.values == KEEP:
            plan.keep(begin, end)
            plan.account.keep(account.VALUES)
        elif self._choices.values == SCRAMBLE:
            octets = plan.octets[begin:end]
            new = replace_bit(self._key, octets) if bit else replace_octets(self._key, octets)
            plan.put(begin, new, account.VALUES)
        else:
            plan.zero(begin, end, account.VALUES)


def _readable(value: FieldValue, octets: bytes) -> bool:
    """Return whether harmless octets match the definition of their field, and are not a text in its place."""
    holds, means = value.field.holds, value.field.means
    if holds == HOLDS_PRODUCT:
        return _LETTERS.issuperset(octets)
    if holds == HOLDS_FLAGS:
        return True
    return (
        means is not None and means is not latin and means(octets) is not None
    )  # every octet string is a `latin` text
