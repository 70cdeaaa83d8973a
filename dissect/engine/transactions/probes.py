"""`Probes`: the number of keep-alive probes of a connection, with the first and the last packet."""

from __future__ import annotations

from mypy_extensions import i64


class Probes:
    """The number of probes, the first and last packet, and the time of the last; false if there are none.

    ``filled`` counts the probes that repeat an octet; the others are empty.
    """

    __slots__ = ("count", "filled", "first_frame", "last_frame", "last_ns")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.filled: i64 = 0
        self.first_frame: i64 = 0
        self.last_frame: i64 = 0
        self.last_ns: i64 = 0

    def __bool__(self) -> bool:
        return self.count > 0

    @property
    def frames(self) -> list[int]:
        """The packets of the first and the last probe."""
        first, last = int(self.first_frame), int(self.last_frame)
        return [first] if first == last else [first, last]

    def add(self, frame: i64, time_ns: i64, filled: bool) -> None:
        """Count the probe in packet ``frame``; ``filled``: it has an octet."""
        if self.count == 0:
            self.first_frame = frame
        self.count += 1
        if filled:
            self.filled += 1
        self.last_frame = frame
        self.last_ns = time_ns

    def join(self, other: Probes | None) -> Probes:
        """Add the probes of ``other``, and return ``self``."""
        if other is not None and other.count:
            if self.count == 0 or other.first_frame < self.first_frame:
                self.first_frame = other.first_frame
            self.count += other.count
            self.filled += other.filled
            if other.last_frame > self.last_frame:
                self.last_frame = other.last_frame
                self.last_ns = other.last_ns
        return self
