"""Texts and values as JSON, written straight where polling needs it."""

from __future__ import annotations

from json.encoder import encode_basestring_ascii
from typing import Final

from mypy_extensions import i64

from dissect.s7.values import Value, decode_value, real_text

#: Octets as numbers.
SMALL: Final = [str(number) for number in range(256)]


def json_text(value: str) -> str:
    """Return a JSON string: ASCII only, and DEL, which JSON would leave as it is, escaped like every other control."""
    return encode_basestring_ascii(value).replace("\x7f", "\\u007f")


def value_text(value: Value) -> str:
    """Return a decoded value as JSON; NaN and the infinities, which JSON has no numbers for, as strings."""
    if value is None:
        return "null"
    if value is True:
        return "true"
    if value is False:
        return "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        text = repr(value)
        return f'"{text}"' if text in {"nan", "inf", "-inf"} else text
    if isinstance(value, str):
        return json_text(value)
    return f"[{','.join([value_text(element) for element in value])}]"


def octets_value(transport_size: i64, octets: bytes) -> str:
    """Return the JSON of ``decode_value(transport_size, octets)``, written straight for the sizes polling is made of."""
    size: i64 = len(octets)
    if transport_size == 0x01 and size == 1:
        return "true" if octets[0] & 1 else "false"
    if transport_size == 0x02:
        if size == 1:
            return SMALL[octets[0]]
        return f"[{','.join([SMALL[octet] for octet in octets])}]" if size else "null"
    if transport_size == 0x08 and size and size % 4 == 0:
        texts = [_real(octets[at : at + 4]) for at in range(0, size, 4)]
        return texts[0] if size == 4 else f"[{','.join(texts)}]"
    return value_text(decode_value(transport_size, octets))


def _real(octets: bytes) -> str:
    text = real_text(octets)
    if "." in text or "e" in text:
        return text
    return f'"{text}"' if "n" in text else text + ".0"
