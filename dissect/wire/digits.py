"""Numbers as text by table: most of what the bulk outputs write are digits, and `str` takes several times as long."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.build import COMPILED

#: Numbers below 1000, as they are and with three digits.
SHORT: Final[list[str]] = [str(number) for number in range(1000)]
THREE: Final[list[str]] = [f"{number:03d}" for number in range(1000)]
#: Bytes as two hexadecimal digits.
_HEX: Final[list[str]] = [f"{number:02x}" for number in range(256)]


def decimal(number: i64) -> str:
    """Return ``str(number)``."""
    if not COMPILED or number < 0 or number >= 1_000_000_000:
        return str(number)
    if number < 1000:
        return SHORT[number]
    if number < 1_000_000:
        return SHORT[number // 1000] + THREE[number % 1000]
    return f"{SHORT[number // 1_000_000]}{THREE[number // 1000 % 1000]}{THREE[number % 1000]}"


def hexadecimal(octets: bytes) -> str:
    """Return ``octets.hex()``."""
    if COMPILED:
        size: i64 = len(octets)
        if size == 1:
            return _HEX[octets[0]]
        if size == 2:
            return _HEX[octets[0]] + _HEX[octets[1]]
        if size == 4:
            return f"{_HEX[octets[0]]}{_HEX[octets[1]]}{_HEX[octets[2]]}{_HEX[octets[3]]}"
    return octets.hex()
