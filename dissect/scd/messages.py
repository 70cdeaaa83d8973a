"""Messages: the content of an envelope, decoded by a dictionary (profile, reference 3.3)."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Final, Literal

import msgspec

from dissect.scd.errors import E_COUNT, E_INDEX, E_KIND, E_PDO_NUMBER, E_VALUE, Error
from dissect.scd.layout import Key
from dissect.scd.packing import ACCESS, TRAILING, VERSION, Flags, Octets, flag
from dissect.scd.ranges import STRUCTURE_SUB, is_mapping, pdo_of_index, section_of
from dissect.scd.types import Value

if TYPE_CHECKING:
    from dissect.scd.codec import Codec
    from dissect.scd.model import Pdo

#: Headers of messages that a codec remembers; each device with its own mappings has its own codec.
MOST_HEADS: Final = 256

Service = Literal["", "read", "write", "pdo"]
#: A PDO is always a "push".
Phase = Literal["", "request", "response", "abort", "push"]


class Message(msgspec.Struct):
    """A message. Fields that the envelope does not have are 0; ``values`` are by (index, sub).

    ``service`` and ``phase`` are empty if the kind is unknown. ``pdo`` is "T1" or "R65". ``data`` are the octets between header
    and tail, ``numbers`` all fields of the envelope by role, ``size`` the octets of the whole message (0: its end is unknown).
    ``content`` names the struct, object or variable if the octets are a bare one. ``error`` says what is wrong with a received
    message; then ``values`` is empty.
    """

    service: Service = ""
    phase: Phase = ""
    tid: int = 0
    err: int = 0
    index: int = 0
    sub: int = 0
    port: int = 0
    values: dict[Key, Value] = {}
    flags: Flags = {}
    pdo: str = ""
    data: bytes = b""
    src: int = 0
    dst: int = 0
    seq: int = 0
    size: int = 0
    error: Error | None = None
    numbers: dict[str, int] = {}
    content: str = ""


class Head:
    """A header seen in an earlier sound message, without the transaction number.

    ``template`` is such a message without data, of ``size`` octets; its data are from ``begin`` to ``end``. For a PDO there are
    also its ``packing``, and ``version``: its mapping has a version that the dictionary does not have. ``numbered``: each
    message has its own transaction number. A bare PDO has no header; it is only data.
    """

    __slots__ = ("_strict_pad", "begin", "end", "numbered", "packing", "size", "template", "version")

    def __init__(self, codec: Codec, message: Message, begin: int = 0, tail: int = 0) -> None:
        self.template = template = copy(message)
        template.values, template.flags, template.data, template.numbers = {}, {}, b"", message.numbers.copy()
        self.size = message.size
        self.begin = begin
        self.end = message.size - tail
        self.packing = codec.packing(message.pdo) if message.service == "pdo" else None
        self.version = VERSION in message.flags
        self.numbered = bool(message.numbers and codec.envelope.tid_mask)
        self._strict_pad = codec.strict_pad

    def odd(self, whole: bytes) -> bool:
        """Return whether the PDO in ``whole`` has flags."""
        packing = self.packing
        return self.version or (packing is not None and packing.odd(whole[self.begin : self.end], self._strict_pad))

    def message(self, whole: bytes, tid: int) -> Message:
        """Return the message of ``size`` octets, with the values of a PDO."""
        message: Message = self.template.__copy__()  # type: ignore[attr-defined]  # what `copy` calls
        message.numbers = numbers = message.numbers.copy()
        if self.numbered:
            message.tid = numbers["tid"] = tid
        message.data = data = whole[self.begin : self.end]
        flags: Flags = {}
        message.flags = flags
        packing = self.packing
        if packing is None:
            message.values = {}
        else:
            message.values = dict(zip(packing.keys, packing.unpack(data, flags, self._strict_pad)))  # noqa: B905 - as many
            if self.version:
                flag(flags, VERSION)
        return message


def parse_message(codec: Codec, octets: Octets, at: int = 0) -> Message:
    """Return the message that begins at ``at``; a fault is its ``error``."""
    envelope = codec.envelope
    if not envelope.told_by_head:
        return _parse(codec, octets, at)
    head = int.from_bytes(octets[at : at + envelope.head_size], "little")
    key = head & envelope.repeated
    known = codec.heads.get(key)
    if known is not None:
        tid = head >> envelope.tid_at & envelope.tid_mask
        return _again(codec, known, octets, at, tid) or _parse(codec, octets, at)
    message = _parse(codec, octets, at)
    if message.error is None and message.numbers:
        if len(codec.heads) >= MOST_HEADS:
            codec.heads.clear()
        codec.heads[key] = Head(codec, message, envelope.head_size, envelope.tail_size)
    return message


def _again(codec: Codec, known: Head, octets: Octets, at: int, tid: int) -> Message | None:
    """Return a message with a known header; None if it is not complete and sound, and needs a closer look."""
    envelope = codec.envelope
    whole = bytes(octets[at : at + known.size])
    if len(whole) != known.size or envelope.checked(whole, known.end) is not None:
        return None
    packing = known.packing
    if packing is not None:
        return known.message(whole, tid) if known.end - known.begin == packing.size else None
    message = known.message(whole, tid)
    try:
        _decode(codec, message)
    except Error:
        return None
    return message


def _parse(codec: Codec, octets: Octets, at: int) -> Message:
    wrapped = codec.envelope.parse(octets, at)
    numbers = wrapped.numbers
    read = numbers.get
    message = Message(
        tid=read("tid", 0), err=read("err", 0), index=read("index", 0), sub=read("sub", 0), port=read("port", 0),
        src=read("src", 0), dst=read("dst", 0), seq=read("seq", 0),
        data=wrapped.data, size=wrapped.size, error=wrapped.error, numbers=numbers,
    )  # fmt: skip
    if not numbers:
        return message
    try:
        kind = numbers.get("kind"), numbers.get("response"), numbers.get("abort")
        known = codec.kinds.get(kind)
        if known is None:
            known = _kind(codec, numbers)
            if kind[0] is not None:
                codec.kinds[kind] = known
        message.service, message.phase = known
        if message.error is None:
            _decode(codec, message)
    except Error as error:
        message.values = {}
        message.error = message.error or error
    return message


def build_message(codec: Codec, message: Message) -> bytes:
    """Return the octets of a message. Raises `Error` for parts that the envelope or the dictionary does not have."""
    roles = codec.envelope.roles
    numbers = {
        "tid": message.tid, "err": message.err, "index": message.index, "sub": message.sub, "port": message.port,
        "src": message.src, "dst": message.dst, "seq": message.seq,
        "response": int(message.phase == "response" or (message.phase == "abort" and "response" in roles)),
        "abort": int(message.phase == "abort"),
    }  # fmt: skip
    if message.phase not in ({"push"} if message.service == "pdo" else {"request", "response", "abort"}):
        raise Error(
            E_KIND, "message", f"a {message.service or 'message without service'} is no {message.phase or 'phase'!r}"
        )
    if "kind" in roles:
        number = next((number for number, service in codec.envelope.record.kinds if service == message.service), None)
        if number is None:
            raise Error(E_KIND, "message", f"the envelope has no kind for {message.service!r}")
        numbers["kind"] = number
    if message.pdo:
        pdo = codec.pdo(message.pdo)
        if "pdo" in roles:
            numbers["pdo"] = pdo.number
        elif "index" in roles:
            numbers["index"] = pdo.mapping.index
    return codec.envelope.build(numbers, message.data or _data(codec, message))


def _kind(codec: Codec, numbers: dict[str, int]) -> tuple[Service, Phase]:
    """Return service and phase; raises `Error` E_KIND for numbers that no message has."""
    kinds = codec.envelope.record.kinds
    response, abort = numbers.get("response", 0), numbers.get("abort", 0)
    shown = f"kind {numbers.get('kind', 0):#04x}, response {response}, abort {abort}"
    service: Service | None
    if "kind" in numbers:
        service = dict(kinds).get(numbers["kind"])
        if service is None:
            raise Error(E_KIND, "envelope", f"{shown}: no such kind")
    elif len(kinds) == 1:
        service = kinds[0][1]
    else:
        service = "pdo" if "pdo" in numbers else "write"
    if service == "pdo":
        if response or abort:
            raise Error(E_KIND, "envelope", f"{shown}: a PDO has no answer")
        return service, "push"
    if abort:
        if not response and "response" in numbers:
            raise Error(E_KIND, "envelope", f"{shown}: an abort is an answer")
        return service, "abort"
    return service, "response" if response else "request"


def _decode(codec: Codec, message: Message) -> None:
    """Fill in values and flags; raises `Error`."""
    if message.service == "pdo":
        _decode_pdo(codec, message)
        return
    carries = message.phase == ("response" if message.service == "read" else "request")
    expects = carries and "index" in message.numbers and (not message.err or bool(message.data))
    if "index" in message.numbers:
        _judge_access(codec, message)
    if expects:
        decoded = codec.decode_value((message.index, message.sub), message.data)
        message.values = decoded.values
        if decoded.flags:
            message.flags.update(decoded.flags)
    elif message.data and not carries:
        flag(message.flags, TRAILING)


def _judge_access(codec: Codec, message: Message) -> None:
    """Flag violations of access attributes and index ranges (R74, R87); raises `Error` E_INDEX or E_SUB if it is missing."""
    dictionary, key = codec.dictionary, (message.index, message.sub)
    if message.index not in dictionary.objects and section_of(message.index).holds in {"", "static"}:
        flag(message.flags, ACCESS, key)
        raise Error(E_INDEX, f"{message.index:#06x}", "indices of this section cannot be addressed")
    if message.sub == STRUCTURE_SUB and message.index in dictionary.objects:
        allowed = message.service == "read"
    else:
        try:
            variable = codec.variable(key)
        except Error:
            if message.phase == "abort":
                return  # the missing object may be the reason for the abort
            raise
        allowed = variable.readable if message.service == "read" else variable.writable
    if not allowed:
        flag(message.flags, ACCESS, key)


def _decode_pdo(codec: Codec, message: Message) -> None:
    numbers = message.numbers
    known = codec.mapped.get(numbers.get("index", -1)) if "pdo" not in numbers else None
    if known is None:
        pdo = _find_pdo(codec, numbers)
        known = f"{pdo.direction}{pdo.number}", pdo
        if "pdo" not in numbers:
            codec.mapped[pdo.mapping.index] = known
    message.pdo, pdo = known
    decoded = codec.decode(message.pdo, message.data)
    message.values = decoded.values
    if decoded.flags:
        message.flags.update(decoded.flags)
    # A PDO has the version of its mapping in place of a sub-index, 0 for none.
    if "index" in numbers and message.sub and pdo.version and message.sub != pdo.version:
        flag(message.flags, VERSION)


def _find_pdo(codec: Codec, numbers: dict[str, int]) -> Pdo:
    if "pdo" in numbers:
        number = numbers["pdo"]
        # The number does not include the direction: it is clear only if there is one PDO with this number.
        return codec.pdo(f"{'T' if number in codec.dictionary.tpdo else 'R'}{number}")
    index = numbers.get("index", 0)
    if not is_mapping(index):
        raise Error(E_PDO_NUMBER, f"{index:#06x}", "no index of a mapping object (0x1600 to 0x17ff, 0x1a00 to 0x1bff)")
    direction, _, number = pdo_of_index(index)
    return codec.pdo(f"{direction}{number}")


def _data(codec: Codec, message: Message) -> bytes:
    """Return the data for the values."""
    if message.service == "pdo":
        if not message.pdo:
            raise Error(E_PDO_NUMBER, "message", "name the PDO")
        return codec.encode(message.pdo, message.values)
    carries = message.phase == ("response" if message.service == "read" else "request")
    if not carries or (message.err and not message.values):
        if message.values:
            raise Error(E_COUNT, "message", f"a {message.service} {message.phase} carries no value")
        return b""
    if len(message.values) != 1:
        raise Error(
            E_COUNT, "message", f"a {message.service} {message.phase} carries one value, not {len(message.values)}"
        )
    ((key, value),) = message.values.items()
    address = codec.dictionary.variable(key).address if isinstance(key, str) else key
    if address != (message.index, message.sub):
        raise Error(E_VALUE, "message", f"a value of {key} in a message on ({message.index:#06x}, {message.sub})")
    return codec.encode_value(address, value)
