"""What becomes of a field of a message: a number stays; octets stay only where this table says that they tell nothing.

A field that the table does not have is set to zero, so that a structure that is described tomorrow gives nothing away today.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.anonymize import account
from dissect.anonymize.account import KEEP, SCRAMBLE, Choices
from dissect.anonymize.addresses import AddressMap
from dissect.anonymize.key import Key
from dissect.anonymize.rewrite_plan import RewritePlan
from dissect.anonymize.scd import ScdRules
from dissect.anonymize.texts import replace_bit, replace_octets, replace_path, replace_text
from dissect.s7.layouts import DATA_ITEM
from dissect.s7.services import PI_SERVICES
from dissect.s7.szl_records import COMPONENT_RECORDS
from dissect.s7.tables import DATA_BIT
from dissect.wire.layout import FieldValue
from dissect.wire.part import OCTETS, SURPLUS, Part

#: Octets that say something of the protocol or the product, not of the plant; those that can be read have to be.
_TELLS_NOTHING: Final = frozenset((
    "archive_length", "block_number", "block_type", "code_time", "dcp_time", "file_length", "file_system", "identifier",
    "interface_time", "length", "load_length", "mark", "mc7_length", "order_number", "ports", "state", "stations",
    "subnet_mask", "time", "total", "unknown_digit", "version",
))  # fmt: skip
#: Those of them that hold a text of any kind.
_TEXTS: Final = frozenset(("mark", "order_number", "unknown_digit"))
#: Octets that hold what the process or its program does.
_VALUES: Final = frozenset((
    "archive_data", "bsend_data", "data", "details", "job_data", "local_data", "record", "registers", "start_information",
))  # fmt: skip
#: Numbers that do.
_VALUE_NUMBERS: Final = frozenset(("accu1", "accu2", "accu3", "accu4"))
_BLOCK_TEXTS: Final = frozenset(("author", "family", "name", "user"))
_PATHS: Final = frozenset(("file_name", "path"))
_ADDRESSES: Final = frozenset(("ip_address", "router"))
_SERIAL_NUMBERS: Final = frozenset((0x05, 0x08))
_SERIALS: Final = frozenset(id(layout) for number, layout in COMPONENT_RECORDS.items() if number in _SERIAL_NUMBERS)
_COMPONENTS: Final = frozenset(id(layout) for layout in COMPONENT_RECORDS.values())
_LETTERS: Final = frozenset(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789 -._/\0")


class Rules:
    """Treats the parts of messages as ``choices`` say."""

    def __init__(self, key: Key, addresses: AddressMap, choices: Choices, scd: ScdRules | None = None) -> None:
        self.scd = scd
        self._key = key
        self._addresses = addresses
        self._choices = choices
        self._codes: Sequence[int] = ()
        self._inside = choices.values != KEEP or (scd is not None and scd.described)

    def parts(self, draft: RewritePlan, parts: list[Part], codes: Sequence[int] = ()) -> None:
        """Treat the parts of a message, which stand in order; at ``codes`` are return codes inside values, which stay."""
        self._codes = codes
        transport_size = -1
        for part in parts:
            if part.layout is OCTETS or part.layout is SURPLUS:
                draft.zero(part.offset, part.end, account.UNKNOWN)
                continue
            at = part.offset
            for value in part.values:
                if value.field.shares:
                    continue
                at = value.end
                if value.octets is not None:
                    self._octets(draft, part, value, transport_size)
                elif value.field.name in _VALUE_NUMBERS:
                    self._value(draft, value.offset, value.end, False)
                else:
                    draft.keep(value.offset, value.end)
            draft.zero(at, part.end, account.UNKNOWN)
            transport_size = part.number("transport_size") if part.layout is DATA_ITEM else -1

    def _octets(self, draft: RewritePlan, part: Part, value: FieldValue, transport_size: int) -> None:
        name = value.field.name
        octets = value.octets or b""
        key = self._key
        if name in _VALUES:
            self._value(draft, value.offset, value.end, transport_size == DATA_BIT)
        elif name in _TELLS_NOTHING:
            if _readable(value, octets):
                draft.keep(value.offset, value.end)
            else:
                draft.zero(value.offset, value.end, account.UNKNOWN)
        elif name in {"content", "file_data"}:
            self._content(draft, value)
        elif name in _ADDRESSES:
            draft.put(value.offset, self._addresses.ip(octets), account.CONTENT_ADDRESSES)
        elif name == "mac_address":
            draft.put(value.offset, self._addresses.mac(octets), account.CONTENT_ADDRESSES)
        elif name in _BLOCK_TEXTS:
            draft.put(value.offset, replace_text(key, octets), account.BLOCK_TEXTS)
        elif name in _PATHS:
            draft.put(value.offset, replace_path(key, octets), account.FILE_NAMES)
        elif name == "text" and id(part.layout) in _COMPONENTS:
            kind = account.SERIALS if id(part.layout) in _SERIALS else account.NAMES
            draft.put(value.offset, replace_text(key, octets), kind)
        elif name in {"text", "argument", "service"}:
            self._argument(draft, value, octets)
        else:
            draft.zero(value.offset, value.end, account.PASSWORDS if name == "password" else account.UNKNOWN)

    def _argument(self, draft: RewritePlan, value: FieldValue, octets: bytes) -> None:
        """The name of a service stays where it is known, an argument where it is one letter."""
        name = value.field.name
        known = octets.decode("latin-1") in PI_SERVICES if name == "service" else len(octets.strip(b" \0")) < 2
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
        made = self.scd.inside(octets) if self.scd is not None and self._inside else None
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
    means = value.field.means
    if value.field.name in _TEXTS:
        return _LETTERS.issuperset(octets)
    return means is not None and (means(octets) is not None or value.field.name in {"ports", "state"})
