"""Values of items as text that reads back to the same octets.

Numbers, bits, texts and lists of numbers are written as such if that is exact; everything else, and several octets, in
hexadecimal in angle brackets. To find out whether a text is exact, it is parsed and compared.
"""

from __future__ import annotations

import json
import struct
from typing import Final

from dissect.protocols.s7.tables import BIT, BYTE, CHAR
from dissect.protocols.s7.values import Value, decode_value

#: How scalars of a transport size are packed, if text and octets correspond one to one.
_DOUBLE: Final = ">d"
_PACKED: Final = {0x02: ">B", 0x04: ">H", 0x05: ">h", 0x06: ">I", 0x07: ">i", 0x08: ">f", 0x30: _DOUBLE}
_FLOATS: Final = frozenset((0x08, 0x30))


def quoted(text: str) -> str:
    """Return a text in double quotes on one line, with number signs escaped: they would begin a comment."""
    inner = (
        json.dumps(text, ensure_ascii=True)[1:-1]
        .replace('\\"', "\\u0022")
        .replace("#", "\\u0023")
        .replace("\x7f", "\\u007f")
    )
    return f'"{inner}"'


def unquoted(text: str) -> str:
    """Return the text that `quoted` was given. Raises ValueError."""
    if not text.startswith('"'):
        raise ValueError(f"{text} is not a string in double quotes")
    return str(json.loads(text))


def hex_text(octets: bytes) -> str:
    """Return octets in angle brackets."""
    return f"<{octets.hex(' ')}>"


def hex_octets(text: str) -> bytes:
    """Return the octets of `hex_text`. Raises ValueError."""
    if not (text.startswith("<") and text.endswith(">")):
        raise ValueError(f"{text} is not a list of bytes in angle brackets")
    try:
        return bytes.fromhex(text[1:-1])
    except ValueError:
        raise ValueError(f"{text} is not hexadecimal") from None


def shown_value(transport_size: int, data: bytes, fits: bool) -> tuple[str, str]:
    """Return the text of ``data``, and a remark with its value if the text does not show it.

    ``fits`` tells whether the data are as long as requested; otherwise they have no value.
    """
    value = decode_value(transport_size, data) if fits else None
    if value is not None and not (transport_size == BYTE and len(data) > 1):
        form = _PACKED.get(transport_size, _DOUBLE)
        if form != _DOUBLE and _is_packed(
            value, form, data
        ):  # NaN has several encodings, which the text does not distinguish
            return _exact(value), ""
        text = _exact(value)
        try:
            if text and value_octets(text, transport_size) == data:
                return text, ""
        except ValueError:
            pass
    remark = value if isinstance(value, (str, float)) and transport_size != CHAR else ""
    return hex_text(data), str(remark)


def _is_packed(value: Value, form: str, data: bytes) -> bool:
    """Return whether ``data`` is written as numbers that are packed: the text is then known to be exact without parsing it."""
    try:
        if isinstance(value, list):
            return struct.pack(f">{len(value)}{form[1]}", *value) == data
        return isinstance(value, (int, float)) and struct.pack(form, value) == data
    except (struct.error, OverflowError):
        return False


def _exact(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, list):
        return f"[{', '.join([_exact(element) or '?' for element in value])}]"
    return "" if value is None else str(value)


def value_octets(text: str, transport_size: int) -> bytes:
    """Return the octets for the text of a value. Raises ValueError if the type has no such value."""
    if text.startswith("<"):
        return hex_octets(text)
    if text.startswith('"'):
        if transport_size != CHAR:
            raise ValueError(f"{text} is a string, which only CHAR allows")
        try:
            return unquoted(text).encode("latin-1")
        except UnicodeEncodeError:
            raise ValueError(f"{text} has characters that CHAR cannot hold") from None
    elements = text[1:-1].split(", ") if text.startswith("[") else [text]
    form = _PACKED.get(transport_size)
    if form is not None and len(elements) > 1:
        try:
            numbers = map(float if transport_size in _FLOATS else int, elements)
            return struct.pack(f">{len(elements)}{form[1]}", *numbers)
        except (struct.error, OverflowError):
            pass  # pack them one by one to find the wrong one
    return b"".join([_element(element, transport_size) for element in elements])


def _element(text: str, transport_size: int) -> bytes:
    if transport_size == BIT:
        if text not in {"true", "false"}:
            raise ValueError(f"{text} is neither true nor false")
        return b"\x01" if text == "true" else b"\x00"
    form = _PACKED.get(transport_size)
    if form is None:
        raise ValueError(f"{text}: values of this type are written as bytes, such as <00 01>")
    try:
        return struct.pack(form, float(text) if transport_size in _FLOATS else int(text))
    except (struct.error, OverflowError):
        raise ValueError(f"{text} is out of range for the type") from None
