"""Numbers by which it is seen that what was learned of a program or of subscriptions is still what it was."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64


class _Stamps:
    """The latest number that was given."""

    __slots__ = ("latest",)

    def __init__(self) -> None:
        self.latest: i64 = 0


_STAMPS: Final = _Stamps()


def next_stamp() -> i64:
    """Return a number above 0 that was not given before."""
    _STAMPS.latest += 1
    return _STAMPS.latest
