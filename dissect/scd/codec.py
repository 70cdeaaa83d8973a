"""The codec: converts information objects to octets and back, by a dictionary (R8-R15, R97-R108).

A payload is a bare PDO, a bare struct (R99), the value of one variable (of an SDO), or a message in an envelope, which itself
names its content; a dictionary does not say which of them is used where. Decoding is all or nothing: if octets are wrong,
`Error` is raised and no object has changed.

`decode_columns` decodes many payloads of the same kind at once, into one numpy array for each variable (extra "scd"), for
captures with millions of PDOs. The payloads stay in one buffer; the caller says where each begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import msgspec

from dissect.scd.dictionary import Dictionary
from dissect.scd.envelope import DEFAULT, Envelope
from dissect.scd.errors import E_COUNT, E_INDEX, E_SHORT, E_TYPE, E_VALUE, Error, shown
from dissect.scd.layout import Key, Slot, address_text
from dissect.scd.messages import Head, Message, Phase, Service, build_message, parse_message
from dissect.scd.model import Pdo, StructType, Variable
from dissect.scd.objects import Objects
from dissect.scd.packing import (
    LIMITS,
    TRAILING,
    Flags,
    Octets,
    Packing,
    decode_value,
    encode_value,
    flag,
    single,
)
from dissect.scd.ranges import STRUCTURE_SUB
from dissect.scd.types import SIZED, UINT32, Kind, Value
from dissect.wire.text import count

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

#: How many octets a row is longer than its payload, so that nine octets can be read from each of its octets on.
_SPARE = 9


def decode_columns(packing: Packing, octets: Octets, offsets: ArrayLike | Sequence[int]) -> dict[Key, NDArray[Any]]:
    """Return one array for each variable, an element for each of ``offsets`` into ``octets``.

    ====================  ==============================================================
    Boolean               bool
    Integer, Unsigned N   the smallest of int8..int64, uint8..uint64 that holds N bits
    Real                  float32, float64 (an infinity is received as such: ``numpy.isinf``)
    String                ``S`` of its octets, UTF-8, without the U+0000 that fill it up
    Time, interval        records of int32 ``seconds`` and ``nanoseconds``
    Block, MAC, IP        rows of uint8
    ====================  ==============================================================

    Raises `Error` E_SHORT when a payload begins outside of the buffer or does not end in it, ImportError without numpy.
    """
    np = _numpy()
    data = np.frombuffer(octets, np.uint8)
    starts = np.asarray(offsets, np.int64)
    if not len(starts):
        rows = np.zeros((0, packing.size + _SPARE), np.uint8)
    else:
        low, high = int(starts.min()), int(starts.max())
        if low < 0 or high + packing.size > len(data):
            at = low if low < 0 else high
            raise Error(E_SHORT, packing.where, f"{count(packing.size, 'byte')} at {at} of {len(data)}")
        rows = np.zeros((len(starts), packing.size + _SPARE), np.uint8)
        if packing.size:
            rows[:, : packing.size] = np.lib.stride_tricks.sliding_window_view(data, packing.size)[starts]
    return {slot.key: _column(rows, slot) for slot in packing.slots}


def _numpy() -> Any:
    try:
        import numpy as np
    except ImportError:
        raise ImportError("decoding into columns needs numpy: pip install 's7dissect[scd]'") from None
    return np


def _column(rows: NDArray[np.uint8], slot: Slot) -> NDArray[Any]:
    """Return the array of one variable."""
    np = _numpy()
    kind = slot.type.kind
    if kind is Kind.STRING:
        texts: NDArray[Any] = _octets(rows, slot).view(f"S{slot.bits // 8}").reshape(-1)
        return texts
    if kind in {Kind.NETTIME, Kind.INTERVAL}:
        times: NDArray[Any] = _octets(rows, slot).view([("seconds", "<i4"), ("nanoseconds", "<i4")]).reshape(-1)
        return times
    if kind in {Kind.BLOCK, Kind.MAC, Kind.IP}:
        return _octets(rows, slot)
    if slot.offset % 8 == 0 and slot.bits in {8, 16, 32, 64}:
        code = {Kind.INT: "i", Kind.UINT: "u", Kind.REAL: "f"}[kind]
        return _strided(rows, f"<{code}{slot.bits // 8}", slot.offset // 8).copy()
    words = _words(rows, slot)
    if kind is Kind.BOOL:
        return words.astype(np.bool_)
    if kind is Kind.REAL:
        reals: NDArray[Any] = words.astype(f"<u{slot.bits // 8}").view(f"<f{slot.bits // 8}")
        return reals
    width = next(width for width in (1, 2, 4, 8) if slot.bits <= 8 * width)
    if kind is Kind.INT:
        spare = np.int64(64 - slot.bits)
        signed: NDArray[Any] = ((words << spare.astype(np.uint64)).view("<i8") >> spare).astype(f"<i{width}")
        return signed
    return words.astype(f"<u{width}")


def _strided(rows: NDArray[np.uint8], code: str, at: int) -> NDArray[Any]:
    """Return the numbers of dtype ``code`` that begin at octet ``at`` of each row, as a view."""
    np = _numpy()
    if not len(rows):  # numpy rejects an offset into an empty buffer, even for no numbers
        none: NDArray[Any] = np.zeros(0, code)
        return none
    numbers: NDArray[Any] = np.ndarray((len(rows),), code, buffer=rows, offset=at, strides=(rows.shape[1],))
    return numbers


def _words(rows: NDArray[np.uint8], slot: Slot) -> NDArray[Any]:
    """Return the bits of the variable as 64-bit numbers, with bits from a ninth octet if it reaches that."""
    np = _numpy()
    at, shift = divmod(slot.offset, 8)
    words: NDArray[Any] = _strided(rows, "<u8", at) >> np.uint64(shift)
    if shift + slot.bits > 64:
        words |= rows[:, at + 8].astype(np.uint64) << np.uint64(64 - shift)
    words &= np.uint64((1 << slot.bits) - 1)
    return words


def _octets(rows: NDArray[np.uint8], slot: Slot) -> NDArray[Any]:
    """Return the octets of the variable, one row for each payload."""
    np = _numpy()
    at, shift = divmod(slot.offset, 8)
    size = slot.bits // 8
    own: NDArray[Any] = rows[:, at : at + size]
    if shift:
        own = (own >> np.uint8(shift)) | (rows[:, at + 1 : at + size + 1] << np.uint8(8 - shift))
    whole: NDArray[Any] = np.ascontiguousarray(own)
    return whole


#: How many spellings of PDOs and structs are remembered.
_MOST_SPELLINGS: Final = 4096


class Decoded(msgspec.Struct, frozen=True):
    """The result of decoding: ``values`` by (index, sub), for a bare struct by the name of the field.

    ``flags`` map what was noticed to the variables (see `packing`); ``surplus`` are octets after the payload.
    """

    values: dict[Key, Value]
    flags: Flags
    surplus: bytes = b""


class Codec:
    """Encodes and decodes by one dictionary. With ``strict_pad``, undefined bits that are not zero are flagged.

    Values outside the dictionary's limits are flagged when received and refused (E_RANGE) when encoded. With ``limits`` False
    they are encoded, too, for tests of devices.
    """

    def __init__(self, dictionary: Dictionary, *, strict_pad: bool = False, limits: bool = True) -> None:
        self.dictionary: Final = dictionary
        self.strict_pad: Final = strict_pad
        self.limits: Final = limits
        self._pdos: dict[str, Pdo] = {}
        self._packings: dict[str, Packing] = {}
        self._variables: dict[tuple[int, int], tuple[Variable, Packing | None]] = {}
        #: Results for earlier messages: service and phase by (kind, response, abort); PDOs by the index of their mapping
        #: object; whole headers by their bits without the transaction number.
        self.kinds: Final[dict[tuple[int | None, int | None, int | None], tuple[Service, Phase]]] = {}
        self.mapped: Final[dict[int, tuple[str, Pdo]]] = {}
        self.heads: Final[dict[int, Head]] = {}

    @cached_property
    def envelope(self) -> Envelope:
        """The dictionary's envelope, or the default one."""
        return Envelope(self.dictionary.envelope or DEFAULT)

    def objects(self, message: str = "") -> Objects:
        """Return an empty collection of information objects."""
        return Objects(self.dictionary, message)

    # PDOs

    def pdo(self, key: str) -> Pdo:
        """Return the PDO "T1" or "R65", or the one with this name, with its current mapping; raises `Error` E_PDO_NUMBER."""
        if key in self._pdos:
            return self._pdos[key]
        found = self.dictionary.pdo(key)
        return self._pdos.get(f"{found.direction}{found.number}", found)

    def remap(self, pdo: Pdo) -> None:
        """Use another mapping for a PDO from now on, as `Dictionary.with_mapping` returns it for a rewritten mapping object."""
        self._pdos[f"{pdo.direction}{pdo.number}"] = pdo
        self._packings.clear()
        self.mapped.clear()
        self.heads.clear()

    def encode(self, pdo: str, values: Mapping[Any, object], *, partial: bool = False) -> bytes:
        """Return the payload of a PDO. ``values`` are by (index, sub), name or "object.field".

        A missing value raises `Error` E_COUNT; with ``partial`` it is the variable's default, or zero. A value that is not in
        the PDO raises E_COUNT as well, except in `Objects`.
        """
        packing = self._packings.get(pdo) or self.packing(pdo)
        octets = None
        if type(values) is dict:
            octets = packing.pack_known(values) if len(values) == len(packing.keys) else None
        elif isinstance(values, Objects):
            octets = packing.pack_known(values.known)
        return packing.pack(self._collect(packing, values, partial=partial)) if octets is None else octets

    def decode(self, pdo: str, octets: Octets, objects: Objects | None = None) -> Decoded:
        """Return the values of a PDO's payload, and put them into ``objects`` (R15). Raises `Error` E_SHORT.

        Octets after the payload are kept, and flagged ``trailing``.
        """
        packing = self._packings.get(pdo) or self.packing(pdo)
        if objects is None and type(octets) is bytes and len(octets) == packing.size:  # the usual case
            flags: Flags = {}
            values = packing.unpack(octets, flags, self.strict_pad)
            return Decoded(dict(zip(packing.keys, values)), flags)  # noqa: B905 - as many
        decoded = self._decode(packing, octets)
        if objects is not None:
            objects.merge(decoded.values)
        return decoded

    def decode_many(self, pdo: str, octets: Octets, offsets: ArrayLike | Sequence[int]) -> dict[Key, NDArray[Any]]:
        """Return the values of a PDO's payloads at ``offsets`` in ``octets``, one numpy array for each variable.

        For the types see `decode_columns`. Raises `Error` E_SHORT, ImportError without numpy.
        """
        return decode_columns(self.packing(pdo), octets, offsets)

    # Structs and objects as a whole

    def encode_type(self, name: str | int, values: Mapping[Any, object], *, partial: bool = False) -> bytes:
        """Return the octets of a bare struct; ``values`` are by the names of its fields, or "struct.field"."""
        struct, packing = self._struct(name)
        own = {f"{struct.name}.{field.name}": field.name for field in struct.fields}
        if isinstance(values, Objects):
            given: dict[Any, object] = {key: values[full] for full, key in own.items() if full in values}
        else:
            given = {own.get(key, key): value for key, value in values.items()}
        fields = {field.name: field for field in struct.fields}
        return packing.pack(_gather(packing, given, fields.__getitem__, partial=partial))

    def decode_type(self, name: str | int, octets: Octets, objects: Objects | None = None) -> Decoded:
        """Return the fields of a bare struct (R99) by name."""
        struct, packing = self._struct(name)
        decoded = self._decode(packing, octets)
        if objects is not None:
            objects.merge({f"{struct.name}.{key}": value for key, value in decoded.values.items()})
        return decoded

    def encode_object(self, key: int | str, values: Sequence[object] | Mapping[Any, object]) -> bytes:
        """Return the data of a whole ARRAY or RECORD, without sub-index 0 (R69, R70); reserved fields have no value."""
        packing = self._object(key)
        if not isinstance(values, Mapping):
            return packing.pack(list(values))
        return packing.pack(self._collect(packing, values, partial=False))

    def decode_object(self, key: int | str, octets: Octets, objects: Objects | None = None) -> Decoded:
        """Return the values in the data of a whole ARRAY or RECORD, or of a VAR of fixed width."""
        packing = self._object(key)
        decoded = self._decode(packing, octets)
        if objects is not None:
            objects.merge(decoded.values)
        return decoded

    # Single values, as SDOs carry them

    def encode_value(self, key: str | tuple[int, int], value: object) -> bytes:
        """Return the octets of one variable's value."""
        if self._asks_structure(key):
            return encode_value(UINT32, value, where=str(key))
        variable = self.dictionary.variable(key)
        return variable.encode(value, limits=self.limits)

    def decode_value(self, key: str | tuple[int, int], octets: Octets, objects: Objects | None = None) -> Decoded:
        """Return one variable's value. Raises `Error` E_SHORT, E_LONG, E_LENGTH, E_UTF8, E_INDEX or E_SUB.

        Sub-index 255 is a 32-bit number: the object's class in bits 0-7, its type in bits 8-23 (C33).
        """
        flags: Flags = {}
        if isinstance(key, tuple):
            if self._asks_structure(key):
                return Decoded({key: decode_value(UINT32, octets, flags, where=str(key))}, flags)
            self.variable(key)
            variable, packing = self._variables[key]
            if packing is not None and len(octets) == packing.size and objects is None and not self.strict_pad:
                (found,) = packing.unpack(bytes(octets), flags)
                return Decoded({key: found}, flags)
        else:
            variable = self.dictionary.variable(key)
        at = variable.address
        value = decode_value(
            variable.type, octets, flags, bits=variable.bits, key=at, where=variable.label, strict_pad=self.strict_pad
        )
        if variable.outside(value):
            flag(flags, LIMITS, at)
        decoded = Decoded({at: value}, flags)
        if objects is not None:
            objects.merge(decoded.values)
        return decoded

    def variable(self, key: tuple[int, int]) -> Variable:
        """Return the variable at an address; repeated calls are faster than the dictionary. Raises `Error`."""
        known = self._variables.get(key)
        if known is None:
            variable = self.dictionary.variable(key)
            packing = None
            if variable.bits and variable.type.kind not in SIZED:
                slot = _slot(variable.address, variable, variable.bits, 0)
                packing = Packing([slot], variable.bits, variable.label)
            if len(self._variables) >= _MOST_SPELLINGS:
                self._variables.clear()
            known = self._variables[key] = variable, packing
        return known[0]

    def _asks_structure(self, key: str | tuple[int, int]) -> bool:
        return isinstance(key, tuple) and key[1] == STRUCTURE_SUB and key[0] in self.dictionary.objects

    # Messages

    def decode_message(self, octets: Octets, objects: Objects | None = None) -> Message:
        """Return the message in ``octets``, with its envelope; raises `Error`. Octets after it are flagged ``trailing``."""
        message = parse_message(self, octets)
        if message.error is not None:
            raise message.error
        if message.size < len(octets):
            flag(message.flags, TRAILING)
        if objects is not None:
            objects.merge({key: value for key, value in message.values.items() if key[1] != STRUCTURE_SUB})
        return message

    def parse_message(self, octets: Octets, at: int = 0) -> Message:
        """Return the message that begins at ``at``. Never raises: a fault is the ``error`` of the result."""
        return parse_message(self, octets, at)

    def parse_messages(self, octets: Octets) -> Iterator[Message]:
        """Yield all messages of a unit (datagram, TSDU), one after another; stop after a broken one."""
        at = 0
        while at < len(octets):
            message = parse_message(self, octets, at)
            yield message
            if message.size <= 0:
                return
            at += message.size

    def encode_message(self, message: Message) -> bytes:
        """Return the octets of a message: its ``data`` if there are any, else its ``values``. Raises `Error`."""
        return build_message(self, message)

    # Packings

    def _decode(self, packing: Packing, octets: Octets) -> Decoded:
        if type(octets) is not bytes:
            octets = bytes(memoryview(octets))
        flags: Flags = {}
        surplus = b""
        if len(octets) != packing.size:
            if len(octets) < packing.size:
                raise Error(E_SHORT, packing.where, f"{count(len(octets), 'byte')} of {packing.size}")
            surplus = octets[packing.size :]
            flags[TRAILING] = ()
        values = packing.unpack(octets, flags, self.strict_pad)
        return Decoded(dict(zip(packing.keys, values)), flags, surplus)  # noqa: B905 - as many, and on the hot path

    def packing(self, key: str) -> Packing:
        """Return the packing of a PDO's payload, with its current mapping; raises `Error` E_PDO_NUMBER."""
        packing = self._packings.get(key)
        if packing is None:
            pdo = self.pdo(key)
            slots = [_slot(row.variable.address, row.variable, row.bits, row.offset) for row in pdo.map]
            where = f"{pdo.direction}{pdo.number} {pdo.name}".rstrip()
            packing = self._remember(key, Packing(slots, pdo.bits, where, enforce=self.limits))
        return packing

    def _struct(self, name: str | int) -> tuple[StructType, Packing]:
        found = self.dictionary.type(name)
        if not isinstance(found, StructType):
            raise Error(E_TYPE, str(name), f"{found.name} is a simple type, not a struct")
        key = f"type {found.index}"
        packing = self._packings.get(key)
        if packing is None:
            packing = self._remember(key, self._fields(found.fields, found.bits, found.name, named=True))
        return found, packing

    def _object(self, key: int | str) -> Packing:
        obj = self.dictionary[key]
        if isinstance(obj, Variable):
            raise Error(E_VALUE, str(key), "this is a variable, not a whole object")
        known = f"object {obj.index}"
        packing = self._packings.get(known)
        if packing is None:
            fields = (obj.head,) if obj.single and obj.head is not None else obj.fields
            packing = self._remember(known, self._fields(fields, obj.bits, obj.name, named=False))
        return packing

    def _fields(self, fields: Sequence[Variable], bits: int, where: str, *, named: bool) -> Packing:
        slots = [_slot(row.name if named else row.address, row, row.bits, row.offset) for row in fields]
        return Packing(slots, bits, where, enforce=self.limits)

    def _remember(self, key: str, packing: Packing) -> Packing:
        if len(self._packings) >= _MOST_SPELLINGS:
            self._packings.clear()
        self._packings[key] = packing
        return packing

    def _collect(self, packing: Packing, values: Mapping[Any, object], *, partial: bool) -> list[object]:
        """Return the values for the slots of a packing, however they are addressed."""
        given: Mapping[Any, object] = values
        if isinstance(values, Objects):
            given = values.take(packing.keys)
        elif values.keys() != packing.key_set:
            found: dict[Any, object] = {}
            for key, value in values.items():
                known = key if key in packing.key_set else self._addressed(key)
                if known in found:
                    raise Error(E_COUNT, _called(key), "the value of this variable is given twice")
                found[known] = value
            given = found
        return _gather(packing, given, self.dictionary.variable, partial=partial)

    def _addressed(self, key: object) -> tuple[int, int]:
        """Return the address for a key of values; raises `Error`."""
        if isinstance(key, str):
            return self.dictionary.variable(key).address
        if isinstance(key, tuple) and len(key) == 2 and all(isinstance(number, int) for number in key):
            return self.dictionary.variable(key).address
        raise Error(
            E_INDEX, shown(key), "values go by (index, sub-index), by an address such as '0x6000:1' or by a name"
        )


def _called(key: object) -> str:
    """Return the text of a key of values for an error."""
    return address_text(key) if isinstance(key, tuple) else str(key)


def _slot(key: Key, variable: Variable, bits: int, offset: int) -> Slot:
    traits = variable.traits
    return Slot(key, variable.type, bits, offset, variable.label, variable.fixed, traits.low, traits.high)


def _gather(
    packing: Packing, given: Mapping[Any, object], variable: Callable[[Any], Variable], *, partial: bool
) -> list[object]:
    """Return one value for each slot; raises `Error` E_COUNT for missing values, and for values without a slot."""
    if given.keys() == packing.key_set:
        return [given[key] for key in packing.keys]
    surplus = [_called(key) for key in given if key not in packing.key_set]
    if surplus:
        raise Error(E_COUNT, packing.where, f"no place for a value of {', '.join(surplus)}")
    missing = [slot.where for slot in packing.slots if slot.key not in given]
    if missing and not partial:
        raise Error(E_COUNT, packing.where, f"no value for {', '.join(missing)}")
    return [given[slot.key] if slot.key in given else _fallback(slot, variable(slot.key)) for slot in packing.slots]


def _fallback(slot: Slot, variable: Variable) -> Value:
    """Return the default of a variable, or the value of all bits zero."""
    if variable.default is not None:
        return variable.default
    if slot.type.kind in SIZED:
        return decode_value(slot.type, bytes(slot.bits // 8), {}, bits=slot.bits)
    return single(slot.type, slot.bits).unpack(bytes((slot.bits + 7) // 8), {})[0]
