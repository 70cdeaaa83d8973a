"""The keep-alive probes that were counted of a connection: how many, and the packets they stand in."""

from __future__ import annotations

from mypy_extensions import i64


class Probes:
    """How many probes there were, the packets of the first and the last, and when the last one came; false for none.

    ``filled`` counts those that carry a byte, which was sent before; the others are empty.
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
        """The packets of the first and the last one."""
        first, last = int(self.first_frame), int(self.last_frame)
        return [first] if first == last else [first, last]

    def add(self, frame: i64, time_ns: i64, filled: bool) -> None:
        """Count one, packet ``frame``."""
        if self.count == 0:
            self.first_frame = frame
        self.count += 1
        if filled:
            self.filled += 1
        self.last_frame = frame
        self.last_ns = time_ns

    def join(self, other: Probes | None) -> Probes:
        """Count those of ``other`` as well, and return itself."""
        if other is not None and other.count:
            if self.count == 0 or other.first_frame < self.first_frame:
                self.first_frame = other.first_frame
            self.count += other.count
            self.filled += other.filled
            if other.last_frame > self.last_frame:
                self.last_frame = other.last_frame
                self.last_ns = other.last_ns
        return self
