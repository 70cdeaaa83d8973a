"""How far the clock of this machine is off, as its time service (NTP, PTP) told the kernel: adjtimex(2), Linux only."""

from __future__ import annotations

import ctypes
import functools
import sys
from typing import Any, Final

_UNSYNCHRONIZED: Final = 0x0040
_NANOSECONDS: Final = 0x2000


class _Times(ctypes.Structure):
    """``struct timex`` (linux/timex.h), with the fields that are read here, and room for the rest."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("frequency", ctypes.c_long),
        ("greatest_error", ctypes.c_long),
        ("estimated_error", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 256),
    )


@functools.cache
def _adjtimex() -> Any:
    try:
        return ctypes.CDLL(None).adjtimex if sys.platform == "linux" else None
    except (OSError, AttributeError):
        return None


def clock_offset() -> float | None:
    """Return the offset of this machine's clock in seconds; None if it is not synchronized, or that is not known."""
    ask = _adjtimex()
    times = _Times()  # modes 0: only query, which every user may do
    if ask is None or ask(ctypes.byref(times)) < 0 or times.status & _UNSYNCHRONIZED:
        return None
    return float(times.offset) / (1e9 if times.status & _NANOSECONDS else 1e6)
