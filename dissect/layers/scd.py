"""SCD as a Scapy layer: messages in the default envelope (docs/scd.md), with names and values by a dictionary.

SCD has no port of its own, so nothing is bound until `bind_scd` is called. A dictionary belongs to a class:
``SCD.using(dictionary)`` is `SCD` that reads by it, `bind_scd` binds such a class to a port, and ``packet[SCD]`` finds them
all. So dictionaries on different ports never mix. A datagram with several messages gives a chain.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import lru_cache
from types import new_class
from typing import Any, ClassVar, Final, cast

from scapy.layers.inet import TCP, UDP
from scapy.packet import Packet, Padding, Raw

from dissect.layers.fields import WireLayer
from dissect.layers.scd_fields import (
    ENVELOPE,
    KINDS,
    NUMBERS,
    SCD_FIELDS,
    error_text,
    joined,
    key_name,
    readable,
    value_texts,
)
from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.envelope import DEFAULT
from dissect.scd.errors import E_DICTIONARY, Error
from dissect.scd.loading import load
from dissect.scd.messages import Message
from dissect.scd.ranges import is_mapping, pdo_of_index
from dissect.scd.types import Value
from dissect.wire.text import count, printable

#: Messages of one unit that become layers; those after them stay octets, because Scapy walks a chain by recursion.
CHAIN_LIMIT: Final = 32
#: Classes that are kept for the dictionaries they were made for.
_MOST_CLASSES: Final = 64
#: Maximum number of values in a summary, and of octets of data without a dictionary.
_MOST_VALUES: Final = 8
_MOST_OCTETS: Final = 16

_CARRIERS: Final[dict[str, type[Packet]]] = {"udp": UDP, "tcp": TCP}


class SCD(WireLayer):
    """A message. ``size`` and ``crc`` are filled in if left out; ``data`` are octets, which a dictionary encodes and decodes.

    On a bound port, octets that do not begin like a message stay `Raw`; under TCP the message must also be complete. Called on
    octets of your own, ``SCD(octets)`` reads any ten octets as the header. In a message that was cut, ``crc`` has the captured
    octets of the checksum, often none.
    """

    name = "SCD"
    least = ENVELOPE.head_size
    match_subclass = True
    codec: ClassVar[Codec | None] = None
    fields_desc = SCD_FIELDS

    @classmethod
    def dispatch_hook(
        cls, _pkt: bytes | None = None, *_args: Any, _underlayer: Packet | None = None, **_kwargs: Any
    ) -> Any:
        """Return the class for the octets: recognised by their beginning under another layer, by size alone elsewhere."""
        if not _pkt:
            return cls
        if len(_pkt) < cls.least:
            return Raw
        if _underlayer is None:
            return cls
        size, error = ENVELOPE.frame(_pkt)
        carrier: Packet | None = _underlayer
        while isinstance(carrier, SCD):
            carrier = carrier.underlayer
        cut = isinstance(carrier, TCP) and size > len(_pkt)
        return Raw if error is not None or cut else cls

    @classmethod
    def tcp_reassemble(cls, data: bytes, _metadata: dict[str, Any], _session: dict[str, Any]) -> Packet | None:
        """Cut one message off a stream, for `StreamSocket` and Scapy's ``TCPSession``; None while it is not whole."""
        size, error = ENVELOPE.frame(data)
        if error is not None:
            return Raw(data)
        if not size or len(data) < size:
            return None
        packet: Packet = cls(data[:size])
        if len(data) > size:
            packet.add_payload(Padding(data[size:]))
        return packet

    @classmethod
    def using(cls, dictionary: Dictionary | Codec | str | os.PathLike[str]) -> type[SCD]:
        """Return `SCD` for a dictionary, a codec, or the file of a dictionary, compiled or source.

        Raises `Error` for a dictionary with its own envelope, `DictionaryError` and OSError for a file.
        """
        return _class_of(load(dictionary) if isinstance(dictionary, (str, os.PathLike)) else dictionary)

    @classmethod
    def pdo(
        cls,
        dictionary: Dictionary | Codec,
        pdo: str,
        values: Mapping[Any, object],
        partial: bool = False,
        **fields: Any,
    ) -> SCD:
        """Return a PDO ("T1", "R65" or its name) with ``values`` by name or address; ``fields`` are those of the layer.

        Raises `Error` as `Codec.encode` does: a missing value is E_COUNT; with ``partial``, its default is used.
        """
        layer, codec = _layer_of(dictionary)
        data = codec.encode(pdo, values, partial=partial)
        fields = {"kind": NUMBERS["pdo"], "index": codec.pdo(pdo).mapping.index, "data": data, **fields}
        return layer(**fields)

    @classmethod
    def read(cls, dictionary: Dictionary | Codec, variable: str | tuple[int, int], **fields: Any) -> SCD:
        """Return the request to read a variable; raises `Error` for an unknown one."""
        layer, codec = _layer_of(dictionary)
        index, sub = codec.dictionary.variable(variable).address
        return layer(**{"kind": NUMBERS["read"], "index": index, "sub": sub, **fields})

    @classmethod
    def write(
        cls, dictionary: Dictionary | Codec, variable: str | tuple[int, int], value: object, **fields: Any
    ) -> SCD:
        """Return the request to write ``value`` to a variable; raises `Error` for an impossible value."""
        layer, codec = _layer_of(dictionary)
        index, sub = codec.dictionary.variable(variable).address
        data = codec.encode_value((index, sub), value)
        return layer(**{"kind": NUMBERS["write"], "index": index, "sub": sub, "data": data, **fields})

    def respond(self, value: object = None, **fields: Any) -> SCD:
        """Return the positive answer to this request; for a read with ``value`` (or ``data=`` octets).

        Raises ValueError if this is not a request, and for a value without a dictionary or in the answer to a write; `Error`
        for an impossible value of the variable.
        """
        echoed = self._echoed()
        if value is not None:
            if self.codec is None or self.kind != NUMBERS["read"]:
                message = "a value needs a read request made or dissected with a dictionary: give data= bytes instead"
                raise ValueError(message)
            echoed["data"] = self.codec.encode_value((self.index, self.sub), value)
        return type(self)(**{**echoed, **fields})

    def refuse(self, err: int | str = -1, **fields: Any) -> SCD:
        """Return the abort of this request; ``err`` is a number or its text. Raises ValueError if this is not a request."""
        return type(self)(**{**self._echoed(), "abort": 1, "err": err, **fields})

    def _echoed(self) -> dict[str, Any]:
        """Return the fields of an answer that the request decides."""
        if self.kind == NUMBERS["pdo"] or self.response or self.abort:
            message = "only a request has an answer"
            raise ValueError(message)
        return {"response": 1} | {name: self.getfieldval(name) for name in ("kind", "tid", "index", "sub", "port")}

    @property
    def message(self) -> Message | None:
        """The message decoded by the dictionary: values by address, flags, errors. None without a dictionary."""
        return None if self.codec is None else self.codec.parse_message(self.self_build())

    @property
    def values(self) -> dict[str, Value]:
        """The decoded values by name; empty without a dictionary, and for a message that is wrong or has none."""
        message = self.message
        if self.codec is None or message is None:
            return {}
        return {key_name(self.codec.dictionary, key): value for key, value in message.values.items()}

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Return this class while the chain is not too long; `dispatch_hook` checks whether it fits (Scapy's interface)."""
        depth, under = 1, self.underlayer
        while isinstance(under, SCD):
            depth, under = depth + 1, under.underlayer
        return type(self) if depth < CHAIN_LIMIT else Raw

    def hashret(self) -> bytes:
        """Return a key that a request shares with its answer (Scapy's interface)."""
        return bytes((self.tid & 0xFF, self.index & 0xFF, self.index >> 8 & 0xFF, self.sub & 0xFF))

    def answers(self, other: Packet) -> int:
        """Return whether this answers the request ``other``: same kind, tid, index and sub (Scapy's interface)."""
        if not isinstance(other, SCD) or not self.response or other.response or other.abort:
            return 0
        mine, theirs = ((one.kind, one.tid, one.index, one.sub) for one in (self, other))
        return int(mine == theirs and self.kind != NUMBERS["pdo"])

    def line(self) -> tuple[str, list[type[Packet]]]:
        """Return the message in one line (``SCD read response tid=7 0x6041:0 Status = 567``), without others in its chain."""
        service = KINDS.get(self.kind, f"kind 0x{self.kind:02x}")
        phase = " abort" if self.abort else " response" if self.response else ""
        text = f"SCD {service}{phase} tid={self.tid} {self._place()}{self._content()}"
        if self.err or self.abort:
            text += f": {error_text(self, self.err)}"
        return text, [type(self)]

    def _place(self) -> str:
        if self.kind == NUMBERS["pdo"]:
            if not is_mapping(self.index):
                return f"0x{self.index:04x}"
            direction, _, number = pdo_of_index(self.index)
            pdo = f"{direction}{number}"
            try:
                return printable(f"{pdo} {self.codec.pdo(pdo).name}".rstrip()) if self.codec is not None else pdo
            except Error:
                return pdo
        place = f"0x{self.index:04x}:{self.sub}"
        name = place if self.codec is None else key_name(self.codec.dictionary, (self.index, self.sub))
        return place if name == place else f"{place} {printable(name)}"

    def _content(self) -> str:
        message = readable(self)
        if message is None or self.codec is None:
            octets = self.data.hex() if len(self.data) <= _MOST_OCTETS else count(len(self.data), "byte")
            return f" data={octets}" if self.data else ""
        if message.error is not None:
            return f" [{printable(str(message.error))}]"
        texts = value_texts(self, message)
        if not message.pdo:
            return f" = {texts[0][1]}" if texts else ""
        more = f", … ({len(texts)} values)" if len(texts) > _MOST_VALUES else ""
        return f": {joined(texts[:_MOST_VALUES])}{more}" if texts else ""


@lru_cache(maxsize=_MOST_CLASSES)
def _class_of(dictionary: Dictionary | Codec) -> type[SCD]:
    """Return the class of a dictionary. A leading ``_`` keeps it out of Scapy's lists."""
    # a test program may send anything
    codec = dictionary if isinstance(dictionary, Codec) else Codec(dictionary, limits=False)
    if codec.envelope.record != DEFAULT:
        raise Error(
            E_DICTIONARY, codec.dictionary.name, "it describes its own envelope, but the layer has the default one"
        )
    hook = SCD.__dict__["dispatch_hook"]  # Scapy looks for it in the class itself
    body = {"__doc__": SCD.__doc__, "__module__": SCD.__module__, "codec": codec, "dispatch_hook": hook}
    made = cast("type[SCD]", new_class("_SCD", (SCD,), exec_body=lambda names: names.update(body)))
    made.__name__ = made.__qualname__ = SCD.__name__
    return made


def _layer_of(dictionary: Dictionary | Codec) -> tuple[type[SCD], Codec]:
    layer = _class_of(dictionary)
    assert layer.codec is not None
    return layer, layer.codec


def bind_scd(
    port: int, transport: str = "udp", dictionary: Dictionary | Codec | str | os.PathLike[str] | None = None
) -> type[SCD]:
    """Make Scapy recognise messages to and from ``port``, before its own layers, and return the class for them.

    ``transport`` is "udp" or "tcp". A dictionary bound to the port earlier is replaced. Raises ValueError for an invalid port
    or transport, and the errors of `SCD.using`.
    """
    if not 0 < port < 65536:
        message = f"{port} is not a port: give one of 1 to 65535"
        raise ValueError(message)
    carrier = _carrier(transport)
    layer = SCD if dictionary is None else SCD.using(dictionary)
    unbind_scd(port, transport)
    bound: list[tuple[dict[str, int], type[Packet]]] = [({"dport": port}, layer), ({"sport": port}, layer)]
    carrier.payload_guess = [*bound, *carrier.payload_guess]
    return layer


def unbind_scd(port: int, transport: str | None = None) -> None:
    """Undo `bind_scd` for ``port``, for both transports if none is named; without a binding this does nothing."""
    for carrier in _CARRIERS.values() if transport is None else (_carrier(transport),):
        carrier.payload_guess = [
            (values, layer)
            for values, layer in carrier.payload_guess
            if not (issubclass(layer, SCD) and values in ({"dport": port}, {"sport": port}))
        ]


def _carrier(transport: str) -> type[Packet]:
    if transport not in _CARRIERS:
        message = f"{transport!r} is not a transport of SCD: give one of {', '.join(_CARRIERS)}"
        raise ValueError(message)
    return _CARRIERS[transport]
