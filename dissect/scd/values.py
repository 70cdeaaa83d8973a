"""The values that Python has no type for: network time, time interval, MAC address (R43-R45)."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple, Self

from dissect.scd.errors import shown

_SECOND: Final = 1_000_000_000
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


class NetTime(NamedTuple):
    """Network time (R43): seconds and nanoseconds since 1970-01-01 00:00, both as they are on the wire (int32).

    Nanoseconds outside 0..999 999 999 can be received, so they can be held; they are never sent.
    """

    seconds: int
    nanoseconds: int

    @property
    def total_ns(self) -> int:
        """Nanoseconds since the epoch."""
        return self.seconds * _SECOND + self.nanoseconds

    @classmethod
    def from_ns(cls, total_ns: int) -> Self:
        """Return the time ``total_ns`` after the epoch; nanoseconds are counted forward also before it."""
        return cls(*divmod(total_ns, _SECOND))

    @classmethod
    def from_isoformat(cls, text: str) -> Self:
        """Return the time ``2015-10-18T00:00:00.123456789Z`` says; without an offset it is UTC. Raises ValueError."""
        whole, point, rest = text.partition(".")
        digits = rest[: len(rest) - len(rest.lstrip("0123456789"))]
        if point and not 1 <= len(digits) <= 9:
            raise ValueError(f"{shown(text)} does not have one to nine digits after the point")
        try:
            moment = datetime.fromisoformat(whole + rest[len(digits) :])
        except ValueError:
            raise ValueError(f"{shown(text)} is no moment such as 2015-10-18T00:00:00Z") from None
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        return cls((moment - _EPOCH) // timedelta(seconds=1), int(digits.ljust(9, "0")))

    def isoformat(self) -> str:
        """Return the ISO 8601 text in UTC, nine digits after the point."""
        seconds, nanoseconds = divmod(self.total_ns, _SECOND)
        return f"{_EPOCH + timedelta(seconds=seconds):%Y-%m-%dT%H:%M:%S}.{nanoseconds:09d}Z"

    def minus(self, earlier: NetTime) -> Interval:
        """Return the interval since ``earlier``: the difference of each field (R44)."""
        return Interval(self.seconds - earlier.seconds, self.nanoseconds - earlier.nanoseconds)

    def __str__(self) -> str:
        return self.isoformat()


class Interval(NamedTuple):
    """Time interval (R44): the difference of seconds and the difference of nanoseconds; their signs may differ."""

    seconds: int
    nanoseconds: int

    @property
    def total_ns(self) -> int:
        """Nanoseconds, negative for an interval into the past."""
        return self.seconds * _SECOND + self.nanoseconds

    @classmethod
    def from_ns(cls, total_ns: int) -> Self:
        """Return ``total_ns`` with the same sign in both fields (C22)."""
        seconds, nanoseconds = divmod(abs(total_ns), _SECOND)
        return cls(-seconds, -nanoseconds) if total_ns < 0 else cls(seconds, nanoseconds)

    def isoformat(self) -> str:
        """Return an ISO 8601 duration in seconds: ``PT1.500000000S``, ``-PT0.000000001S``."""
        seconds, nanoseconds = divmod(abs(self.total_ns), _SECOND)
        return f"{'-' if self.total_ns < 0 else ''}PT{seconds}.{nanoseconds:09d}S"

    def __str__(self) -> str:
        return self.isoformat()


class MAC(bytes):
    """An Ethernet address (R45): six octets, shown ``00:1B:44:11:3A:B7``. Takes octets or such a text."""

    __slots__ = ()

    def __new__(cls, address: bytes | str) -> Self:
        """Take six octets or a text; raises ValueError."""
        octets = _mac_octets(address) if isinstance(address, str) else address
        if len(octets) != 6:
            raise ValueError(f"{shown(address)} is no MAC address of six octets")
        return super().__new__(cls, octets)

    def __str__(self) -> str:
        return self.hex(":").upper()

    def __repr__(self) -> str:
        return f"MAC({str(self)!r})"


def _mac_octets(text: str) -> bytes:
    parts = text.replace("-", ":").split(":")
    if [len(part) for part in parts] != [2] * 6:
        raise ValueError(f"{shown(text)} is no MAC address such as 00:1B:44:11:3A:B7")
    return bytes.fromhex("".join(parts))
