"""Rewrites S7comm-plus PDUs: protocol fields stay, plant data are replaced; sizes and positions do not change.

Each part of a PDU is treated by its layout; parts that no table here names become zeros.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.engine.transactions.open_requests import PLUS_KEY
from dissect.engine.transactions.side import Side
from dissect.files.anonymize import account
from dissect.files.anonymize.account import Account
from dissect.files.anonymize.plus_contents import PROCESS, PlusContents
from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents, VariableAddress
from dissect.protocols.s7plus.ids import AREAS, BLOCK_KINDS
from dissect.protocols.s7plus.message import PlusPdu, fixed_part, parse_plus
from dissect.protocols.s7plus.summary import single_address
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    GET_VAR_SUBSTREAMED,
    KEEP_ALIVE,
    NOTIFICATION,
    REQUEST,
    SET_VAR_SUBSTREAMED,
    V1,
)
from dissect.wire.layout import Layout
from dissect.wire.part import Part
from dissect.wire.varint import VLQ, build_varint

#: Parts with only protocol numbers: ids, counts, return values, ends.
_STAY: Final = frozenset(id(layout) for layout in (
    layouts.ATTRIBUTE_ID, layouts.COUNT, layouts.COUNT_OCTET, layouts.EXPLORE_FILTER, layouts.EXPLORE_GROUP,
    layouts.EXPLORE_HEAD, layouts.INTEGRITY_ID, layouts.INVOKE_HEAD, layouts.ITEM_COUNTS, layouts.ITEM_ERROR,
    layouts.LINK_REQUEST, layouts.LIST_BLOCK, layouts.LIST_END, layouts.LIST_ID, layouts.NAME_LIST, layouts.NOTIFICATION_HEAD,
    layouts.NOTIFICATION_HEAD_SHORT, layouts.NOTIFICATION_HEAD_TIMED, layouts.NOTIFIED_KIND, layouts.NOTIFIED_REFUSAL,
    layouts.OBJECT, layouts.OBJECT_END, layouts.OBJECT_HELD, layouts.OBJECT_ID, layouts.OBJECT_ID_VLQ,
    layouts.QUALIFIER, layouts.RELATION, layouts.RETURN_VALUE, layouts.ROW, layouts.SECOND_PART, layouts.SEQUENCE_KIND,
    layouts.SEQUENCE_TYPE, layouts.TAG_DESCRIPTION_END, layouts.TAG_VARIABLE, layouts.VARIABLE_LIST,
))  # fmt: skip
#: Parts that end with a value.
_VALUES: Final = frozenset(id(layout) for layout in (
    layouts.ATTRIBUTE, layouts.ITEM_VALUE, layouts.MEMBER, layouts.NOTIFIED_PLAIN, layouts.NOTIFIED_VALUE,
    layouts.NOTIFIED_VALUE_VLQ, layouts.VALUE,
))  # fmt: skip
#: Functions whose first value lists the requested attributes.
_LISTED: Final = frozenset((GET_VAR_SUBSTREAMED, SET_VAR_SUBSTREAMED))
#: Texts of system events.
_EVENTS: Final = frozenset((b"LOGOUT",))
#: The end of a request for a list of attributes.
_LISTED_END: Final = b"\0\1"
#: Position of the checksum of a variable in its description.
_CRC: Final = slice(4, 8)


class PlusRules:
    """Rewrites whole PDUs."""

    def __init__(self, contents: PlusContents, counts: Account) -> None:
        self._contents = contents
        self._account = counts
        self._others: dict[int, Callable[[bytes, Part], bytes]] = {
            id(layouts.ADDRESS): self._address,
            id(layouts.VARIABLE): self._variable,
            id(layouts.VARIABLE_NAME): self._name,
            id(layouts.TAG_DESCRIPTION): self._tag,
            id(layouts.PACKED): self._packed,
            id(layouts.PACKED_TWICE): self._packed,
            id(layouts.PIECE): self._counted,
            id(layouts.DIGEST): self._counted,
            id(layouts.EVENT_VALUE): self._event,
            id(layouts.FILL): self._fill,
            id(layouts.RESERVED): self._fill,
        }

    def message(self, octets: bytes, side: Side) -> bytes | None:
        """Return the rewritten form of a whole PDU, whose frames follow one another; ``side`` sent it.

        None if it cannot be read to its end.
        """
        pdu = parse_plus(octets)
        head = fixed_part(pdu)
        if not pdu.whole or pdu.malformed or pdu.version == KEEP_ALIVE or head is None:
            return None
        contents = parse_contents(pdu)
        if contents.malformed or not contents.parts:
            return None
        data = self._parts(pdu, contents, head, _Meaning(pdu, contents, side))
        return self._frames(pdu, data)

    def _frames(self, pdu: PlusPdu, data: bytes) -> bytes:
        """Put the data back between the headers of the frames; digests become zeros, because their keys are unknown."""
        new = bytearray(pdu.octets)
        starts = [(0, pdu.data_offset), *pdu.frame_starts.items()]
        for (taken, offset), (end, _) in zip(starts, [*starts[1:], (len(data), 0)], strict=True):
            new[offset : offset + end - taken] = data[taken:end]
        for begin, end in pdu.digest_places:
            self._account.mask(account.PLUS, pdu.octets[begin:end])
            new[begin:end] = bytes(end - begin)
        return bytes(new)

    def _parts(self, pdu: PlusPdu, contents: Contents, head: Layout, meaning: _Meaning) -> bytes:
        """Return the data; octets outside all parts, or in parts of unknown layout, become zeros."""
        data = pdu.data
        new = bytearray(len(data))
        new[: head.size] = data[: head.size]
        for part in contents.parts:
            octets = data[part.offset : part.end]
            layout = id(part.layout)
            if layout in _STAY:
                rewritten = octets
                if part.layout is layouts.QUALIFIER:
                    meaning.ends()
            elif layout in _VALUES:
                rewritten = self._value(octets, part, meaning.of(part))
            elif layout in self._others:
                rewritten = self._others[layout](octets, part)
            else:
                self._account.mask(account.UNKNOWN, octets)
                continue
            if len(rewritten) == len(octets):  # otherwise a number was longer than necessary: it becomes zeros
                new[part.offset : part.end] = rewritten
        return bytes(new)

    # ---- parts of one layout each -----------------------------------------------------------------------------------

    def _value(self, octets: bytes, part: Part, about: int | None) -> bytes:
        content = part.find("content")
        if about is None or content is None:
            return octets
        begin, end = int(content.offset) - part.offset, int(content.end) - part.offset
        new = self._contents.value(octets[begin:end], part.number("flags"), part.number("type"), about)
        return octets[:begin] + new + octets[end:]

    def _address(self, octets: bytes, part: Part) -> bytes:
        crc = part.find("crc")
        if crc is None:
            return octets
        return build_varint(self._contents.crc(crc.value), VLQ) + octets[int(crc.end) - part.offset :]

    def _variable(self, octets: bytes, _: Part) -> bytes:
        crc = self._contents.crc(int.from_bytes(octets[_CRC], "little"))
        return octets[: _CRC.start] + crc.to_bytes(4, "little") + octets[_CRC.stop :]

    def _name(self, octets: bytes, _: Part) -> bytes:
        return octets[:1] + self._contents.name(octets[1:-1]) + octets[-1:]

    def _tag(self, octets: bytes, part: Part) -> bytes:
        """Replace the name in the description of a tag."""
        size = part.find("name_length")
        if size is None:
            return octets
        begin = int(size.end) - part.offset
        end = begin + size.value
        return octets[:begin] + self._contents.name(octets[begin:end]) + octets[end:]

    def _packed(self, octets: bytes, part: Part) -> bytes:
        """Rewrite a structure of the program like a value."""
        content = part.find("octets")
        if content is None:
            return octets
        begin, end = int(content.offset) - part.offset, int(content.end) - part.offset
        return octets[:begin] + self._contents.packed(octets[begin:end]) + octets[end:]

    def _counted(self, octets: bytes, part: Part) -> bytes:
        """Keep a length; the bytes it counts become zeros."""
        content = part.values[-1]
        begin = int(content.offset) - part.offset
        self._account.mask(account.PLUS, octets[begin:])
        return octets[:begin] + bytes(len(octets) - begin)

    def _event(self, octets: bytes, _: Part) -> bytes:
        if octets in _EVENTS:
            return octets
        self._account.mask(account.PLUS, octets)
        return bytes(len(octets))

    def _fill(self, octets: bytes, _: Part) -> bytes:
        if octets == _LISTED_END:
            return octets
        self._account.mask(account.UNKNOWN, octets)
        return bytes(len(octets))


class _Meaning:
    """The meaning of the values of a PDU: the id of an attribute, a process variable, or None for a list of ids."""

    def __init__(self, pdu: PlusPdu, contents: Contents, side: Side) -> None:
        self._pdu = pdu
        self._contents = contents
        self._side = side
        self._first = True
        self._process = False  # the current members are those of a variable
        self._addresses: list[VariableAddress] = []
        if pdu.opcode == REQUEST:
            self._addresses = _addresses(contents)
        elif pdu.opcode != NOTIFICATION:
            self._addresses = _requested(side, pdu)

    def of(self, part: Part) -> int | None:
        """Return the meaning of a value. Must be called for all values of a PDU, in order."""
        layout = part.layout
        if layout is layouts.ATTRIBUTE:
            self.ends()
            return part.number("id")
        if layout is layouts.MEMBER:
            return PROCESS if self._process else part.number("id")
        first, self._first = self._first, False
        pdu = self._pdu
        if layout is layouts.VALUE and pdu.opcode == REQUEST and first:
            if pdu.function in _LISTED:
                return None
            if pdu.function == CREATE_OBJECT:
                return None  # a number for the kind of object that is created
        about = self._item(part)
        self._process = about == PROCESS
        return about

    def ends(self) -> None:
        """End the value: the next part is not a member of it."""
        self._process = False

    def _item(self, part: Part) -> int:
        if part.layout is layouts.VALUE:
            return _about(self._addresses[0]) if len(self._addresses) == 1 else PROCESS
        if part.layout is layouts.ITEM_VALUE:
            number = part.number("number")
            return _about(self._addresses[number - 1]) if 0 < number <= len(self._addresses) else PROCESS
        session = self._side.connection.plus
        if session is None or self._pdu.version == V1 or part.layout is layouts.NOTIFIED_PLAIN:
            return PROCESS
        address = session.address_of(self._pdu.subscription_id, part.number("reference"))
        return _about(address) if address is not None else PROCESS


def _about(address: VariableAddress) -> int:
    if address.area in AREAS or address.area >> 16 in BLOCK_KINDS:
        return PROCESS
    return address.lids[-1] if address.lids else address.sub_area


def _addresses(contents: Contents) -> list[VariableAddress]:
    single = single_address(contents)
    return [single] if single is not None else contents.addresses


def _requested(side: Side, pdu: PlusPdu) -> list[VariableAddress]:
    """Return the subject of a response's request, which is still pending when the response is rewritten."""
    request = side.connection.open_requests[1 - side.index].find(PLUS_KEY | pdu.sequence)
    if request is None or not request.request_octets:
        return []
    return _addresses(parse_contents(parse_plus(request.request_octets), shown=False))
