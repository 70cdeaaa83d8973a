"""Envelopes: the fields around the values of a message, which say what these are (profile, reference 3.3).

The text describes no message (C3, C51). Here are this project's own envelope "1", and a way to describe another one in the
dictionary: fields of bits before and after the data, in the order in which they are sent.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Final, NamedTuple

from dissect.scd.errors import E_CRC, E_DICTIONARY, E_LENGTH, E_PROTOCOL, E_RANGE, E_SHORT, E_VALUE, Error, shown
from dissect.scd.packing import Octets
from dissect.scd.records import CrcRecord, EnvelopeField, EnvelopeRecord
from dissect.scd.types import MAX_OCTETS
from dissect.wire.text import count

#: The first octet of the default envelope: TPKT (03), S7 (32, 72) and text begin with other octets.
PROTOCOL: Final = 0xDC

#: Envelope "1", for dictionaries that describe none: 10 octets, data, CRC-16/XMODEM. The kind octet is that of POWERLINK: the
#: command in the low six bits, 40h abort, 80h response.
DEFAULT: Final = EnvelopeRecord(
    fields=[
        EnvelopeField("protocol", 8, value=PROTOCOL),
        EnvelopeField("kind", 6),
        EnvelopeField("abort", 1),
        EnvelopeField("response", 1),
        EnvelopeField("tid", 8),
        EnvelopeField("err", 8, signed=True),
        EnvelopeField("index", 16),
        EnvelopeField("sub", 8),
        EnvelopeField("port", 8),
        EnvelopeField("size", 16, counts="data"),
        EnvelopeField("data"),
        EnvelopeField("crc", 16),
    ],
    kinds=[(0x01, "write"), (0x02, "read"), (0x10, "pdo")],
    crc=CrcRecord(),
)

#: Roles of fields that are not numbers of the message itself.
_UNNUMBERED: Final = frozenset(("reserved", "const", "data", "crc", "size"))


class Wrapped(NamedTuple):
    """A message whose data are not decoded: numbers by role, ``data``, and ``size`` of the whole message in octets.

    ``error`` says what is wrong with it; numbers and data are then the parts that could still be read (``size`` 0: nothing).
    """

    numbers: dict[str, int]
    data: bytes
    size: int
    error: Error | None


class _Place(NamedTuple):
    """A field, and where it begins: in bits from the beginning of the head or of the tail."""

    field: EnvelopeField
    offset: int

    def read(self, octets: bytes) -> int:
        """Return the number at this place of the head or tail ``octets``."""
        if self.field.big:
            first = self.offset // 8
            number = int.from_bytes(octets[first : first + self.field.bits // 8], "big")
        else:
            number = int.from_bytes(octets, "little") >> self.offset & ((1 << self.field.bits) - 1)
        if self.field.signed and number >> (self.field.bits - 1):
            number -= 1 << self.field.bits
        return number

    def write(self, number: int) -> int:
        """Return the number's bits at their place within the bits of the head or tail. Raises `Error` E_RANGE."""
        bits, signed = self.field.bits, self.field.signed
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        if not low <= number <= high:
            raise Error(E_RANGE, f"envelope field {self.field.role}", f"{shown(number)} is outside {low}..{high}")
        number &= (1 << bits) - 1
        if self.field.big:
            number = int.from_bytes(number.to_bytes(bits // 8, "big"), "little")
        return number << self.offset


class _HeadPlan:
    """Reads all numbers of a complete head at once: as one number, in which each field has some bits."""

    def __init__(self, places: list[_Place]) -> None:
        self._places = places
        numbered = [place for place in places if place.field.role not in _UNNUMBERED]
        self._big = any(place.field.big for place in numbered)
        self._bits = [(place.field.role, place.offset, (1 << place.field.bits) - 1) for place in numbered]
        self._signed = [(place.field.role, 1 << place.field.bits - 1) for place in numbered if place.field.signed]
        fixed = [place for place in places if place.field.value is not None and place.field.role != "reserved"]
        # A constant that its field cannot hold never matches; the slow way reports it.
        self._sound = all(0 <= (place.field.value or 0) < 1 << place.field.bits for place in fixed)
        self._mask = sum(((1 << place.field.bits) - 1) << place.offset for place in fixed)
        self._value = sum(place.write(place.field.value or 0) for place in fixed) if self._sound else -1

    def numbers(self, head: bytes) -> dict[str, int]:
        """Return the numbers of a whole head by role, in the order of its fields."""
        if self._big:
            found: dict[str, int] = {}
            _read_all(self._places, head, found)
            return found
        bits = int.from_bytes(head, "little")
        numbers: dict[str, int] = {role: bits >> offset & mask for role, offset, mask in self._bits}
        for role, sign in self._signed:
            if numbers[role] & sign:
                numbers[role] -= sign << 1
        return numbers

    def signed_by(self, head: bytes) -> bool:
        """Return whether all constant fields of a complete head have their values."""
        return int.from_bytes(head, "little") & self._mask == self._value


class Envelope:
    """An envelope, ready to wrap and unwrap messages. Raises `Error` E_DICTIONARY for a description that cannot work."""

    def __init__(self, record: EnvelopeRecord = DEFAULT) -> None:
        roles = [field.role for field in record.fields]
        if roles.count("data") != 1:
            raise Error(E_DICTIONARY, "envelope", f"exactly one field must be the data, got {roles.count('data')}")
        at = roles.index("data")
        self.record = record
        self.roles = frozenset(roles)
        self._head, self.head_size = _places(record.fields[:at], "before")
        self._tail, self.tail_size = _places(record.fields[at + 1 :], "after")
        self._size = next((place for place in self._head if place.field.role == "size"), None)
        if self._size is None and "size" in roles:
            raise Error(E_DICTIONARY, "envelope", "the size must come before the data that it counts")
        self._crc_in_head = any(place.field.role == "crc" for place in self._head)
        crcs = [place.field for place in self._head + self._tail if place.field.role == "crc"]
        if len(crcs) > 1 or (crcs and crcs[0].bits != 16):
            raise Error(E_DICTIONARY, "envelope", "at most one crc is allowed, of 16 bits")
        self._crc_size = 2 * len(crcs)
        self._crc = crc_function(record.crc) if crcs and record.crc else None
        self._crc_place = next((place for place in self._head + self._tail if place.field.role == "crc"), None)
        self._plan = _HeadPlan(self._head)
        self._covers_data = record.crc is not None and record.crc.covers == "data"
        #: Whether the head has everything but the data of a message, including its size, and no checksum of the data.
        self.told_by_head = (
            self._size is not None
            and not self._crc_in_head
            and all(place.field.role in {"crc", "reserved"} for place in self._tail)
        )
        #: Position of the transaction number in the bits of the head, if it can be read there directly; mask of all other bits.
        self.tid_at, self.tid_mask = self._tid()
        self.repeated = ((1 << 8 * self.head_size) - 1) & ~(self.tid_mask << self.tid_at)

    def _tid(self) -> tuple[int, int]:
        places = [place for place in self._head if place.field.role == "tid"]
        if len(places) != 1 or places[0].field.big or places[0].field.signed or places[0].field.value is not None:
            return 0, 0
        return places[0].offset, (1 << places[0].field.bits) - 1

    @cached_property
    def opening(self) -> bytes:
        """The octets that every message begins with; empty if the first octet may vary."""
        bits = known = 0
        for place in self._head:
            if place.field.value is None or place.field.role == "reserved" or place.offset != known:
                break
            bits |= place.write(place.field.value)
            known += place.field.bits
        whole = known // 8
        return (bits & ((1 << 8 * whole) - 1)).to_bytes(whole, "little")

    @property
    def framed(self) -> bool:
        """Whether messages contain their size, so that a stream can be split into them."""
        return self._size is not None

    @property
    def has_crc(self) -> bool:
        """Whether messages have a checksum."""
        return self._crc is not None

    def frame_size(self, octets: Octets, at: int = 0) -> int:
        """Return the size of the message that begins at ``at``, 0 while its header is incomplete.

        Raises `Error` E_PROTOCOL or E_LENGTH if it is not a message, E_DICTIONARY if messages do not contain their size.
        """
        size, error = self.frame(octets, at)
        if error is not None:
            raise error
        return size

    def frame(self, octets: Octets, at: int = 0) -> tuple[int, Error | None]:
        """Like `frame_size`, but return the error instead of raising it."""
        head = bytes(octets[at : at + self.head_size])
        error = None
        if len(head) < self.head_size or not self._plan.signed_by(head):
            error = self._signature(head, self._head)
        if error is not None:
            return 0, error
        if self._size is None:
            return 0, Error(E_DICTIONARY, "envelope", "without a size field a stream cannot be cut into messages")
        if len(head) < self.head_size:
            return 0, None
        return self._total(head)

    def parse(self, octets: Octets, at: int = 0) -> Wrapped:
        """Return the message at ``at``. Never raises: a fault is the ``error`` of the result.

        Without a size field the message extends to the end of ``octets``.
        """
        head = bytes(octets[at : at + self.head_size])
        if len(head) < self.head_size:
            detail = f"{count(len(head), 'byte')}, the header has {self.head_size}"
            return Wrapped({}, b"", 0, Error(E_SHORT, "envelope", detail))
        numbers = self._plan.numbers(head)
        there = len(octets) - at
        total, error = (there, None) if self._size is None else self._total(head)
        if error is None and total > there:
            error = Error(E_SHORT, "envelope", f"{count(there, 'byte')} of {total}")
        elif error is None and total < self.head_size + self.tail_size:
            error = Error(
                E_SHORT, "envelope", f"{count(total, 'byte')}, without data there are {self.head_size + self.tail_size}"
            )
        if error is not None:
            return Wrapped(numbers, bytes(octets[at + self.head_size :]), 0, self._signature(head, self._head) or error)
        message = bytes(octets[at : at + total])
        tail_at = total - self.tail_size
        tail = message[tail_at:]
        _read_all(self._tail, tail, numbers)
        if not self._plan.signed_by(head):
            error = self._signature(head, self._head)
        error = error or self._signature(tail, self._tail) or self.checked(message, tail_at)
        return Wrapped(numbers, message[self.head_size : tail_at], total, error)

    def fields(self, message: bytes) -> Iterator[tuple[EnvelopeField, int, int]]:
        """Yield each available field of a message: its description, its first bit, its number (0 for the data)."""
        for place in self._head:
            if place.offset + place.field.bits > 8 * len(message):
                return
            yield place.field, place.offset, place.read(message[: self.head_size])
        tail_at = len(message) - self.tail_size
        if tail_at < self.head_size:
            return
        yield next(field for field in self.record.fields if field.role == "data"), 8 * self.head_size, 0
        for place in self._tail:
            yield place.field, 8 * tail_at + place.offset, place.read(message[tail_at:])

    def _not_taken(self, unknown: list[str]) -> str:
        """Return the sentence for numbers without a field: ``unknown`` ones, else those that are filled in automatically."""
        if not unknown:
            return f"{', '.join(sorted(_UNNUMBERED))} are filled in and cannot be given"
        there = [row.role for row in self.record.fields if row.role not in _UNNUMBERED and row.value is None]
        return f"it has no field {', '.join(unknown)}, only {', '.join(there)}"

    def build(self, numbers: Mapping[str, int], data: bytes) -> bytes:
        """Return the message with these numbers (by role, 0 if missing) around ``data``.

        Raises `Error` E_RANGE for a number that its field cannot hold, E_LENGTH for more data than the size field allows,
        E_VALUE for a number without a field.
        """
        unknown = sorted(role for role, number in numbers.items() if number and role not in self.roles)
        if unknown or not _UNNUMBERED.isdisjoint(numbers):
            raise Error(E_VALUE, "envelope", self._not_taken(unknown))
        if len(data) > MAX_OCTETS:
            raise Error(E_LENGTH, "envelope", f"{len(data)} bytes of data, a message has at most {MAX_OCTETS} (C27)")
        given = dict(numbers)
        if self._size is not None:
            given["size"] = self._counted(len(data))
            if given["size"] >> self._size.field.bits:
                raise Error(E_LENGTH, "envelope", f"{len(data)} bytes of data are more than the size field can hold")
        head = _write_all(self._head, given, self.head_size)
        tail = _write_all(self._tail, given, self.tail_size)
        if self._crc is None:
            return head + data + tail
        assert self._crc_place is not None
        before = self._crc_place.offset // 8
        part = head[:before] if self._crc_in_head else head + data + tail[:before]
        given["crc"] = self._crc(data if self._covers_data else part)
        head = _write_all(self._head, given, self.head_size)
        return head + data + _write_all(self._tail, given, self.tail_size)

    def _counted(self, data: int) -> int:
        assert self._size is not None
        counts = self._size.field.counts
        if counts == "total":
            return self.head_size + data + self.tail_size
        if counts == "rest":
            return self.head_size - self._after_size() + data + self.tail_size
        return data + (self._crc_size if counts == "data+crc" else 0)

    def _after_size(self) -> int:
        assert self._size is not None
        return (self._size.offset + self._size.field.bits + 7) // 8

    def _total(self, head: bytes) -> tuple[int, Error | None]:
        """Return the octets of the whole message by the size field of ``head``, and an error if that is impossible."""
        assert self._size is not None
        told = self._size.read(head)
        data = told - self._counted(0)
        if 0 <= data <= MAX_OCTETS:
            return self.head_size + data + self.tail_size, None
        return 0, Error(E_LENGTH, "envelope", f"a size of {told} leaves {data} bytes for the data, not 0..{MAX_OCTETS}")

    def _signature(self, octets: bytes, places: list[_Place]) -> Error | None:
        """Return an error if a constant field has another value."""
        for place in places:
            wanted = place.field.value
            if wanted is None or place.field.role == "reserved" or place.offset + place.field.bits > 8 * len(octets):
                continue
            found = place.read(octets)
            if found != wanted:
                return Error(E_PROTOCOL, f"envelope field {place.field.role}", f"{found:#x} instead of {wanted:#x}")
        return None

    def checked(self, message: bytes, tail_at: int) -> Error | None:
        """Return an error if the checksum of a complete message differs; its tail begins at ``tail_at``."""
        place = self._crc_place
        if self._crc is None or place is None:
            return None
        at = (0 if self._crc_in_head else tail_at) + place.offset // 8
        found = int.from_bytes(message[at : at + 2], "big" if place.field.big else "little")
        covered = message[self.head_size : tail_at] if self._covers_data else message[:at]
        wanted = self._crc(covered)
        return None if found == wanted else Error(E_CRC, "envelope", f"{found:#06x} received, {wanted:#06x} computed")


def _places(fields: list[EnvelopeField], side: str) -> tuple[list[_Place], int]:
    """Return the fields on one side of the data with their offsets, and the octets that they take."""
    places, offset = [], 0
    for field in fields:
        where = f"envelope field {field.role}"
        if not 0 < field.bits <= 64 and field.role != "reserved":
            raise Error(E_DICTIONARY, where, f"it has 1 to 64 bits, not {field.bits}")
        if (field.big or field.role == "crc") and (offset % 8 or field.bits % 8):
            raise Error(E_DICTIONARY, where, "a big-endian field or a crc begins and ends with a byte")
        if field.role == "size" and field.counts == "rest" and (offset + field.bits) % 8:
            raise Error(E_DICTIONARY, where, "a size that counts the rest ends with a byte")
        places.append(_Place(field, offset))
        offset += field.bits
    if offset % 8:
        raise Error(E_DICTIONARY, "envelope", f"{offset} bits are {side} the data: fill them up with reserved ones")
    return places, offset // 8


def _read_all(places: list[_Place], octets: bytes, numbers: dict[str, int]) -> None:
    for place in places:
        if place.field.role not in _UNNUMBERED:
            numbers[place.field.role] = place.read(octets)


def _write_all(places: list[_Place], numbers: Mapping[str, int], size: int) -> bytes:
    bits = 0
    for place in places:
        fixed = place.field.value
        bits |= place.write(numbers.get(place.field.role, 0) if fixed is None else fixed)
    return bits.to_bytes(size, "little")


def crc_function(record: CrcRecord) -> Callable[[bytes], int]:
    """Return a function that computes the checksum: from the standard library if possible, else anycrc (extra "scd").

    Raises `Error` if that package is needed and missing.
    """
    if record.poly == 0x1021 and not record.refin and not record.refout:
        init, xorout = record.init, record.xorout
        return lambda octets: crc_hqx(octets, init) ^ xorout
    try:
        import anycrc
    except ImportError:
        hint = "a CRC with these parameters needs the package anycrc: pip install 's7dissect[scd]'"
        raise Error(E_DICTIONARY, "envelope crc", hint) from None
    crc = anycrc.CRC(
        width=16, poly=record.poly, init=record.init, refin=record.refin, refout=record.refout, xorout=record.xorout
    )
    calculate: Callable[[bytes], int] = crc.calc
    return calculate
