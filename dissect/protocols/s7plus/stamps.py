"""Unique numbers that change with a program or with subscriptions, so that cached results can be checked."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64


class _Stamps:
    """The latest number that was given out."""

    __slots__ = ("latest",)

    def __init__(self) -> None:
        self.latest: i64 = 0


_STAMPS: Final = _Stamps()


def next_stamp() -> i64:
    """Return a number above 0 that was not given out before."""
    _STAMPS.latest += 1
    return _STAMPS.latest
