"""The fields of `SCD`, made from the description of the default envelope, and the display of names and values."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from scapy.fields import BitField, ByteField, EnumField, Field, LEShortField, XByteField
from scapy.packet import Packet

from dissect.layers.fields import BitEnumField, Named, OctetsField, ScapyField, settled
from dissect.scd.envelope import DEFAULT, Envelope, crc_function
from dissect.scd.errors import E_CRC, ERROR_TEXTS, Error
from dissect.scd.layout import address_text
from dissect.scd.records import CrcRecord, EnvelopeField
from dissect.wire.text import count, printable, shortened

if TYPE_CHECKING:
    from dissect.layers.scd import SCD
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.layout import Key
    from dissect.scd.messages import Message
    from dissect.scd.model import Variable
    from dissect.scd.types import Value

ENVELOPE: Final = Envelope(DEFAULT)
#: Service of each kind number.
KINDS: Final[dict[int, str]] = dict(DEFAULT.kinds)
NUMBERS: Final = {service: number for number, service in KINDS.items()}

_FORMATS: Final = {8: "B", 16: "H", 32: "I", 64: "Q"}
_PLAIN: Final[dict[str, type[ScapyField]]] = {"B": ByteField, "<H": LEShortField}
_crc: Final = crc_function(DEFAULT.crc or CrcRecord())
_LONGEST_TEXT: Final = 60
_LONGEST_BLOCK: Final = 16


class SCDIndexField(Field[int, int]):
    """An index, shown with the name it has in the dictionary."""

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return number and name (Scapy's interface)."""
        if not isinstance(x, int):
            return repr(x)
        name = name_of_index(_layer(pkt), x)
        return f"0x{x:0{2 * self.sz}x} {name}".rstrip()


class SCDErrField(Named, EnumField[int]):
    """An ``scd_err_t``, shown with the dictionary's own text; takes the usual texts too."""

    taken = EnumField.any2i

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return text and number (Scapy's interface)."""
        return error_text(_layer(pkt), x) if isinstance(x, int) else repr(x)


class SCDSizeField(LEShortField):
    """The octets of ``data``, counted when left out."""

    def i2m(self, pkt: Packet | None, x: int | None) -> int:
        """Return the number to send (Scapy's interface)."""
        if x is not None or pkt is None:
            return x or 0
        size = len(pkt.getfieldval("data"))
        if size >> 8 * self.sz:
            message = f"the size would be {size}, more than its {self.sz} bytes can say: send less, or set it yourself"
            raise ValueError(message)
        return size


class SCDDataField(OctetsField):
    """The data, shown with the names and values in it."""

    def __init__(self, name: str) -> None:
        super().__init__(name, lambda pkt, _rest: pkt.getfieldval("size"))

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return octets, then names and values, or the error (Scapy's interface)."""
        octets = x.hex() if isinstance(x, bytes) else repr(x)
        layer = _layer(pkt)
        if layer is None or not settled(layer):
            return octets
        message = readable(layer)
        if message is None or (message.error is not None and message.error.code == E_CRC):  # shown with the crc itself
            return octets
        text = printable(str(message.error)) if message.error is not None else joined(value_texts(layer, message))
        return f"{octets} ({text})" if octets and text else octets or text


class SCDCrcField(Field[Any, Any]):
    """The checksum: a number, computed if omitted. If the message was cut, it is the captured octets of the checksum."""

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, Any]:
        """Take the number, or its captured octets (Scapy's interface)."""
        return super().getfield(pkt, s) if len(s) >= self.sz else (b"", s)

    def addfield(self, pkt: Packet, s: bytes, val: Any) -> bytes:
        """Append it; ``s`` are the octets of the message before it (Scapy's interface)."""
        if isinstance(val, bytes):
            return s + val
        return super().addfield(pkt, s, _crc(s) if val is None else val)

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return the number, and the right one if it differs (Scapy's interface)."""
        if isinstance(x, bytes):
            return f"{x.hex()} (cut)".lstrip()
        if not isinstance(x, int) or pkt is None or not settled(pkt):
            return repr(x)
        octets = built(pkt)
        if octets is None:
            return repr(x)
        wanted = _crc(octets[: -self.sz])
        return f"0x{x:04x}" if x == wanted else f"0x{x:04x} (wrong: 0x{wanted:04x} computed)"


def _fields() -> Iterator[ScapyField]:
    """Give the fields in Scapy's order: as on the wire, but the bits of an octet from the highest down."""
    bits: list[ScapyField] = []
    held = 0
    for field in DEFAULT.fields:
        if field.bits % 8:
            held += field.bits
            bits.insert(0, _bits_field(field))
            if held % 8 == 0:
                yield from bits
                bits.clear()
        else:
            yield _whole_field(field)


def _bits_field(field: EnvelopeField) -> ScapyField:
    if field.role == "kind":
        return BitEnumField(field.role, NUMBERS["read"], field.bits, KINDS)
    return BitField(field.role, 0, field.bits)


def _whole_field(field: EnvelopeField) -> ScapyField:
    if field.role == "data":
        return SCDDataField(field.role)
    code = _FORMATS[field.bits].lower() if field.signed else _FORMATS[field.bits]
    layout = code if field.bits == 8 else (">" if field.big else "<") + code
    match field.role:
        case "protocol":
            return XByteField(field.role, field.value)
        case "err":
            return SCDErrField(field.role, 0, dict(ERROR_TEXTS), layout)
        case "index":
            return SCDIndexField(field.role, 0, layout)
        case "size":
            return SCDSizeField(field.role, None)
        case "crc":
            return SCDCrcField(field.role, None, layout)
    return _PLAIN[layout](field.role, 0)


def _layer(pkt: Packet | None) -> SCD | None:
    """Return the packet as its layer; Scapy also calls fields without one."""
    return pkt  # type: ignore[return-value]  # these fields are in no other layer


def built(layer: Packet) -> bytes | None:
    """Return the layer's own octets, None while a field has a value that cannot be sent: such a packet can still be shown."""
    try:
        octets: bytes = layer.self_build()
    except (ValueError, TypeError, struct.error):
        return None
    return octets


def readable(layer: SCD) -> Message | None:
    """Return the message decoded by the dictionary, None without one or while the message cannot be built."""
    octets = None if layer.codec is None else built(layer)
    return None if layer.codec is None or octets is None else layer.codec.parse_message(octets)


def error_text(layer: SCD | None, number: int) -> str:
    """Return an ``scd_err_t`` in words, by the dictionary of ``layer`` if it has one."""
    texts = ERROR_TEXTS if layer is None or layer.codec is None else layer.codec.dictionary.errors
    text = texts.get(number, "")
    return f"{printable(text)} ({number})" if text else str(number)


def name_of_index(layer: SCD | None, index: int) -> str:
    """Return the name of an object, of a PDO for a mapping object; empty without a dictionary or a name."""
    if layer is None or layer.codec is None:
        return ""
    entry = layer.codec.dictionary.objects.get(index)
    return printable(entry.name) if entry is not None else ""


def key_name(dictionary: Dictionary, key: Key) -> str:
    """Return the name of a variable if it is unique, otherwise its address."""
    if isinstance(key, str):
        return key
    variable = _variable(dictionary, key)
    address = address_text(key)
    if variable is None:
        return address
    try:
        return variable.label if dictionary.variable(variable.label).address == key else address
    except Error:
        return address


def _variable(dictionary: Dictionary, key: Key) -> Variable | None:
    try:
        return dictionary.variable(key)
    except Error:
        return None


def value_texts(layer: SCD, message: Message) -> list[tuple[str, str]]:
    """Return name and text of each value of a message, in the order of the message."""
    if layer.codec is None:
        return []
    od = layer.codec.dictionary
    return [(printable(key_name(od, key)), value_with_unit(od, key, value)) for key, value in message.values.items()]


def joined(texts: list[tuple[str, str]]) -> str:
    """Return names and values on one line."""
    return ", ".join([f"{name} = {text}" for name, text in texts])


def value_with_unit(dictionary: Dictionary, key: Key, value: Value) -> str:
    """Return a value for people: the physical one with its unit, or its text and the number."""
    if isinstance(value, str):
        return f'"{shortened(value, _LONGEST_TEXT)}"'
    if type(value) is bytes:
        return value.hex() if len(value) <= _LONGEST_BLOCK else count(len(value), "byte")
    variable = _variable(dictionary, key)
    if variable is None:
        return str(value)
    text = printable(variable.desc(value))
    physical = value if text else variable.phys(value)
    shown = f"{physical:.12g}" if isinstance(physical, float) else str(physical)
    return f"{text} ({shown})" if text else f"{shown} {printable(variable.unit)}".rstrip()


SCD_FIELDS: Final = list(_fields())
