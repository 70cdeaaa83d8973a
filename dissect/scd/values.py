"""Values for which Python has no type: network time, time interval, MAC address (R43-R45)."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple, Self

from dissect.scd.errors import shown

_SECOND: Final = 1_000_000_000
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
#: Follows a time of the TAI scale, for which ISO 8601 has no sign.
_TAI: Final = "TAI"
_DURATION: Final = re.compile(
    r"([+-]?)P(?:([0-9]{1,10})D)?(?:T(?:([0-9]{1,10})H)?(?:([0-9]{1,10})M)?(?:([0-9]{1,10})(?:[.,]([0-9]{1,9}))?S)?)?"
)


class NetTime(NamedTuple):
    """Network time (R43): seconds and nanoseconds since 1970-01-01 00:00, both as on the wire (int32).

    Nanoseconds outside 0..999 999 999 may be received, so that they are allowed here; they are never sent.
    """

    seconds: int
    nanoseconds: int

    @property
    def total_ns(self) -> int:
        """Nanoseconds since the epoch."""
        return self.seconds * _SECOND + self.nanoseconds

    @classmethod
    def from_ns(cls, total_ns: int) -> Self:
        """Return the time ``total_ns`` after the epoch; nanoseconds are positive even before it."""
        return cls(*divmod(total_ns, _SECOND))

    @classmethod
    def from_isoformat(cls, text: str) -> Self:
        """Return the time of a text: ``2015-10-18T00:00:00.123456789Z``; without an offset it is UTC. Raises ValueError."""
        if text.endswith(_TAI):
            raise ValueError(f"{shown(text)} is a TAI time, and this dictionary has UTC times")
        return cls(*_moment(text))

    def isoformat(self) -> str:
        """Return the ISO 8601 text in UTC, with nine digits after the point."""
        return f"{_iso(self.total_ns)}Z"

    def minus(self, earlier: NetTime) -> Interval:
        """Return the interval since ``earlier``: the difference of each field (R44)."""
        return Interval(self.seconds - earlier.seconds, self.nanoseconds - earlier.nanoseconds)

    def __str__(self) -> str:
        return self.isoformat()


class TaiTime(NetTime):
    """Network time of a dictionary with ``time_scale = "tai"``: leap seconds are counted, so it is ahead of UTC (C21).

    A codec does not know the leap seconds: the time is shown and accepted as it is, marked ``TAI``.
    """

    __slots__ = ()

    @classmethod
    def from_isoformat(cls, text: str) -> Self:
        """Return the time in a text such as ``2015-10-18T00:00:36.5 TAI``. Raises ValueError, also for a UTC time."""
        bare = text.removesuffix(_TAI).rstrip()
        if bare.endswith(("Z", "z")) or re.search(r"[+-]\d\d:?\d\d$", bare):
            raise ValueError(f"{shown(text)} is a UTC time, and this dictionary has TAI times: 2015-10-18T00:00:36 TAI")
        return cls(*_moment(bare))

    def isoformat(self) -> str:
        """Return the text on the TAI scale, with nine digits after the point, followed by ``TAI``."""
        return f"{_iso(self.total_ns)} {_TAI}"


def _moment(text: str) -> tuple[int, int]:
    """Return seconds and nanoseconds since 1970 for an ISO 8601 text. Raises ValueError."""
    whole, point, rest = text.partition(".")
    digits = rest[: len(rest) - len(rest.lstrip("0123456789"))]
    if point and not 1 <= len(digits) <= 9:
        raise ValueError(f"{shown(text)} does not have one to nine digits after the point")
    try:
        moment = datetime.fromisoformat(whole + rest[len(digits) :])
    except ValueError:
        raise ValueError(f"{shown(text)} is not a moment such as 2015-10-18T00:00:00Z") from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return (moment - _EPOCH) // timedelta(seconds=1), int(digits.ljust(9, "0"))


def _iso(total_ns: int) -> str:
    seconds, nanoseconds = divmod(total_ns, _SECOND)
    return f"{_EPOCH + timedelta(seconds=seconds):%Y-%m-%dT%H:%M:%S}.{nanoseconds:09d}"


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

    @classmethod
    def from_isoformat(cls, text: str) -> Self:
        """Return the interval of an ISO 8601 duration such as ``-PT1.5S`` or ``P1DT2H``. Raises ValueError."""
        match = _DURATION.fullmatch(text.strip().upper())
        if match is None or not any(match.group(2, 3, 4, 5)) or text.strip().upper().endswith("T"):
            raise ValueError(f"{shown(text)} is not an interval such as PT1.5S, or seconds and nanoseconds")
        days, hours, minutes, seconds = [int(part or 0) for part in match.group(2, 3, 4, 5)]
        whole = ((24 * days + hours) * 60 + minutes) * 60 + seconds
        total_ns = whole * _SECOND + int((match[6] or "").ljust(9, "0"))
        return cls.from_ns(-total_ns if match[1] == "-" else total_ns)

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
            raise ValueError(f"{shown(address)} is not a MAC address of six bytes")
        return super().__new__(cls, octets)

    def __str__(self) -> str:
        return self.hex(":").upper()

    def __repr__(self) -> str:
        return f"MAC({str(self)!r})"


def _mac_octets(text: str) -> bytes:
    parts = text.replace("-", ":").split(":")
    if [len(part) for part in parts] != [2] * 6:
        raise ValueError(f"{shown(text)} is not a MAC address such as 00:1B:44:11:3A:B7")
    return bytes.fromhex("".join(parts))
