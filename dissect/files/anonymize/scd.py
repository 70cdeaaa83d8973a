"""Rewrites SCD messages: headers stay, values are treated as chosen, texts are replaced.

With a dictionary the type of every bit is known; bits that it does not describe become zeros. Without one, only messages in the
default envelope are recognised, by their first octet, size and checksum, and all their data become zeros. A correct checksum
stays correct; a wrong one stays wrong by the same difference.
"""

from __future__ import annotations

import math
from ipaddress import ip_network
from typing import TYPE_CHECKING, Final

from dissect.engine.transactions.payloads import ScdMessage
from dissect.files.anonymize import account
from dissect.files.anonymize.account import KEEP, MASK, SCRAMBLE, Account, Choices
from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.texts import replace_octets, replace_text, replace_tsap
from dissect.meaning.bindings.evidence import CONF_ID
from dissect.protocols.iso.tsap import Tsap
from dissect.scd.envelope import Envelope
from dissect.scd.errors import E_CRC, E_LENGTH, E_PROTOCOL, E_SHORT, Error
from dissect.scd.model import StructType, Variable
from dissect.scd.ranges import is_mapping
from dissect.scd.records import Traits
from dissect.scd.types import SIZED, Kind, SimpleType
from dissect.wire.text import encodable

if TYPE_CHECKING:
    from dissect.meaning.bindings.binding import Bindings
    from dissect.meaning.bindings.engine import ScdCarrier
    from dissect.scd.dictionary import Dictionary

#: Sub-index that requests class and type of an object: a fact of the dictionary.
_STRUCTURE: Final = 255
#: Size of a class, and of an entry of a mapping.
_MAX_FACT: Final = 8
#: The exponent bits of a number: if all are set, it is infinity or NaN.
_EXPONENTS: Final = {32: 0xFF << 23, 64: 0x7FF << 52}
_SECONDS: Final = (1 << 32) - 1

#: (first bit, bits, type, its definition in the dictionary) of a value in the data of a message.
_Slot = tuple[int, int, SimpleType, int | None, Traits]


class ScdRules:
    """Rewrites SCD messages. ``carrier`` found them; None without a dictionary."""

    def __init__(
        self, key: Key, addresses: AddressMap, choices: Choices, carrier: ScdCarrier | None, counts: Account
    ) -> None:
        self._key = key
        self._addresses = addresses
        self._values = choices.values
        self._account = counts
        self._dictionary: Dictionary | None = carrier.dictionary if carrier is not None else None
        self._carrier = carrier
        self._holds = {one.name: one.holds for one in carrier.bindings.all} if carrier is not None else {}
        self._envelope = Envelope() if carrier is None else carrier.devices.codec.envelope
        self._default = Envelope()
        #: Possible first octets of a message (`inside`).
        self.openings = (self._envelope.opening, self._default.opening)

    @property
    def described(self) -> bool:
        """Whether there is a dictionary."""
        return self._carrier is not None

    def message(self, scd_message: ScdMessage) -> bytes:
        """Return the rewritten form of a message, of the same size."""
        message, octets = scd_message.message, scd_message.octets
        if not message.numbers:
            if message.phase == "push":  # data without an envelope
                return self._data(scd_message, octets)
            self._account.mask(account.UNKNOWN, octets)
            return bytes(len(octets))
        code = message.error.code if message.error is not None else ""
        head = self._envelope.head_size
        if not message.size or code == E_PROTOCOL:
            self._account.mask(account.UNKNOWN, octets[head:])
            known = code in (E_SHORT, E_LENGTH)
            return (octets[:head] if known else bytes(min(head, len(octets)))) + bytes(max(len(octets) - head, 0))
        return self._wrapped(
            octets, message.numbers, message.data, self._data(scd_message, message.data), code == E_CRC
        )

    def inside(self, octets: bytes) -> bytes | None:
        """Return the rewritten form of messages inside an S7 value; None if it contains none."""
        carrier = self._carrier
        sizes = _messages(self._envelope, octets)
        if not sizes or carrier is None:
            return self.headers(octets)
        rewritten = []
        at = 0
        for size in sizes:
            piece = octets[at : at + size]
            message = ScdMessage(carrier.devices.codec.parse_message(piece), carrier.dictionary, "", piece)
            rewritten.append(self.message(message))
            at += size
        return b"".join(rewritten) + octets[at:]

    def headers(self, octets: bytes) -> bytes | None:
        """Return the rewritten form of messages that no binding claims; None if there are none.

        They are accepted only if all of ``octets`` are messages in the default envelope with a correct checksum.
        """
        rewritten = []
        at = 0
        for size in _messages(self._default, octets):
            header = self._default.parse(octets[at : at + size])
            rewritten.append(self._default.build(header.numbers, bytes(len(header.data))))
            self._account.mask(account.SCD_UNKNOWN, header.data)
            at += size
        return b"".join(rewritten) + octets[at:] if rewritten else None

    def _wrapped(self, octets: bytes, numbers: dict[str, int], old: bytes, new: bytes, wrong: bool) -> bytes:
        """Return the message with different data; ``wrong``: its checksum was wrong."""
        envelope = self._envelope
        try:
            rewritten = bytearray(envelope.build(numbers, new))
            right = envelope.build(numbers, old) if wrong else b""
        except Error:
            return bytes(len(octets))
        if len(rewritten) != len(octets):
            return bytes(len(octets))
        for field, bit, _ in envelope.fields(octets):
            if wrong and field.role == "crc":
                for at in range(bit // 8, (bit + field.bits) // 8):
                    rewritten[at] ^= octets[at] ^ right[at]
        return bytes(rewritten)

    # ---- data -------------------------------------------------------------------------------------------------------

    def _data(self, message: ScdMessage, data: bytes) -> bytes:
        """Return the rewritten data of a message."""
        if not data or self._is_structure(message):
            return data
        try:
            slots = self._slots(message, 8 * len(data))
        except Error:
            slots = []  # the dictionary does not have it
        number = int.from_bytes(data, "little")
        new = valued = 0
        for offset, bits, kind, fixed, traits in slots:
            if not bits or offset + bits > 8 * len(data):
                continue
            ones = (1 << bits) - 1
            if kind.kind is Kind.RESERVED:
                new |= ((fixed or 0) & ones) << offset
                continue
            valued |= ones << offset
            old = number >> offset & ones
            replacement = old if old == fixed else self._value(kind.kind, bits, old)
            new |= (
                replacement if self._values != SCRAMBLE else _within(traits, kind.kind, bits, old, replacement)
            ) << offset
        self._account.mask(account.UNKNOWN, (number & ~valued).to_bytes(len(data), "little").strip(b"\0"))
        return new.to_bytes(len(data), "little")

    def _is_structure(self, scd_message: ScdMessage) -> bool:
        """Return whether the data are facts of the dictionary: the class of an object, the mapping of a PDO."""
        message = scd_message.message
        dictionary = self._dictionary
        if message.service not in ("read", "write") or dictionary is None or message.index not in dictionary.objects:
            return False
        fits = len(message.data) <= _MAX_FACT and message.error is None
        if (message.index, message.sub) == CONF_ID:
            return fits and message.data == dictionary.wire_id[:4]
        return fits and (message.sub == _STRUCTURE or is_mapping(message.index))

    def _slots(self, scd_message: ScdMessage, bits: int) -> list[_Slot]:
        """Return the values in the data; raises `Error` for anything that the dictionary does not have."""
        message, dictionary = scd_message.message, self._dictionary
        if dictionary is None:
            return []
        if message.service == "pdo":
            if not message.pdo:
                return []
            pdo = scd_message.mapping or dictionary.pdo(message.pdo)
            return [
                (row.offset, row.bits, row.variable.type, _known(row.variable), row.variable.traits) for row in pdo.map
            ]
        holds = self._holds.get(scd_message.binding, "messages")
        if holds == "struct":
            struct = dictionary.type(message.index)
            return _fields(struct.fields) if isinstance(struct, StructType) else []
        if holds == "object":
            whole = dictionary[message.index]
            return _fields(whole.fields or (whole[0],))
        variable = dictionary.variable((message.index, message.sub))
        size = bits if variable.type.kind in SIZED else variable.bits  # a text may be shorter than its object
        return [(0, size, variable.type, _known(variable), variable.traits)]

    def _value(self, kind: Kind, bits: int, old: int) -> int:
        """Return the replacement bits for a value."""
        if kind in (Kind.STRING, Kind.MAC, Kind.IP, Kind.BLOCK):
            return int.from_bytes(self._octets(kind, old.to_bytes((bits + 7) // 8, "little")), "little")
        if self._values == KEEP:
            self._account.keep(account.SCD_VALUES)
            return old
        exponent = _EXPONENTS.get(bits, 0) if kind is Kind.REAL else 0
        if exponent and old & exponent == exponent:
            return _not_finite(old, exponent)
        if self._values == MASK:
            self._account.mask(account.SCD_VALUES, old.to_bytes((bits + 7) // 8, "little"))
            return 0
        new = self._scrambled(kind, bits, old, exponent)
        if new != old:
            self._account.replace(account.SCD_VALUES)
        return new

    def _scrambled(self, kind: Kind, bits: int, old: int, exponent: int) -> int:
        if bits == 1:
            return old ^ (self._key.stream("bit", b"", 1)[0] & 1)
        drawn = int.from_bytes(replace_octets(self._key, old.to_bytes((bits + 7) // 8, "little")), "little")
        new = drawn & ((1 << bits) - 1)
        if kind in (Kind.NETTIME, Kind.INTERVAL):
            return new & _SECONDS  # nanoseconds have a range
        if exponent and new & exponent == exponent:
            new ^= exponent & ~(exponent << 1)  # no infinity
        return new

    def _octets(self, kind: Kind, old: bytes) -> bytes:
        """Return the replacement for a text, an address or a block."""
        if kind is Kind.MAC or kind is Kind.IP:
            new = self._addresses.mac(old) if kind is Kind.MAC else self._addresses.ip(old)
            kind_told = account.CONTENT_ADDRESSES
        elif kind is Kind.STRING:
            new = _text(self._key, old)
            kind_told = account.SCD_TEXTS
        elif self._values == KEEP:
            self._account.keep(account.SCD_VALUES)
            return old
        elif self._values == MASK:
            self._account.mask(account.SCD_VALUES, old)
            return bytes(len(old))
        else:
            new = replace_octets(self._key, old)
            kind_told = account.SCD_VALUES
        if new != old:
            self._account.replace(kind_told)
        return new


def _messages(envelope: Envelope, octets: bytes) -> list[int]:
    """Return the sizes of the messages in ``octets``, which may end with zeros; empty if there is anything else.

    Only messages with a checksum can be recognised.
    """
    sizes: list[int] = []
    at = 0
    opening = envelope.opening
    if not octets.startswith(opening):
        return sizes
    if not opening.strip(b"\0") or not envelope.has_crc or not envelope.framed:
        return sizes
    while octets.startswith(opening, at):
        header = envelope.parse(octets, at)
        if header.error is not None:
            return []
        sizes.append(header.size)
        at += header.size
    return sizes if not any(octets[at:]) else []


def bindings_of(bindings: Bindings, key: Key, addresses: AddressMap) -> list[dict[str, str]]:
    """Return the settings that bindings need for the written capture, by their names, if TSAPs and hosts were replaced."""
    settings = []
    for one in bindings.all:
        entry = {}
        tsap = replace_tsap(key, one.tsap)
        if tsap != one.tsap:
            entry["tsap"] = str(Tsap(tsap)) if tsap.isascii() else f"0x{tsap.hex()}"
        network = one.network
        if network is not None:
            bits = network.max_prefixlen - network.prefixlen
            front = int.from_bytes(addresses.ip(network.network_address.packed), "big") >> bits << bits
            host = ip_network((front, network.prefixlen))
            if host != network:
                entry["host"] = str(host)
        if entry:
            settings.append({"name": encodable(one.name), **entry})
    return settings


def _fields(fields: tuple[Variable, ...]) -> list[_Slot]:
    return [(field.offset, field.bits, field.type, _known(field), field.traits) for field in fields]


def _known(variable: Variable) -> int | None:
    """Return the bits that the dictionary itself defines: reserved ones, and a constant with a default."""
    if variable.reserved or variable.access != "const" or variable.default is None:
        return variable.fixed
    return int.from_bytes(variable.encode(variable.default, limits=False), "little")


def _within(traits: Traits, kind: Kind, bits: int, old: int, new: int) -> int:
    """Return the bits of an integer that is within the dictionary's limits if the original was."""
    if kind not in (Kind.INT, Kind.UINT) or (traits.low is None and traits.high is None):
        return new
    sign = 1 << bits - 1 if kind is Kind.INT else 0
    low = -sign if traits.low is None else math.ceil(traits.low)
    high = (sign or 1 << bits) - 1 if traits.high is None else math.floor(traits.high)
    before, after = ((number ^ sign) - sign for number in (old, new))
    if not low <= before <= high or low <= after <= high:
        return new
    return (low + new % (high - low + 1)) & ((1 << bits) - 1)


def _not_finite(old: int, exponent: int) -> int:
    """Return infinity or NaN with the original sign; other bits of a NaN are dropped."""
    lowest = exponent & -exponent
    return old & ~(lowest - 1) | (lowest >> 1 if old & (lowest - 1) else 0)


def _text(key: Key, octets: bytes) -> bytes:
    """Return the replacement for a text; one that is not valid UTF-8 stays invalid."""
    try:
        octets.decode()
    except UnicodeDecodeError:
        return b"\x80" * len(octets)
    return replace_text(key, octets)
