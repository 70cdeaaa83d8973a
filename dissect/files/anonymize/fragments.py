"""IP fragments of TCP segments and datagrams: held until their datagram is complete, then filled from its rewritten payload."""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from dissect.packets.tcp.ip import FRAGMENT_TIMEOUT_NS, FragmentStore

#: Maximum number of incomplete datagrams.
MAX_DATAGRAMS: Final = 256


class Fragment:
    """A fragment with rewritten headers whose payload (from ``start`` to ``end``) is not known yet.

    ``octets`` is the captured payload, ``addresses`` are the captured addresses. When ``settled``, ``result`` is the rewritten
    packet, or None if it is dropped because its datagram stayed incomplete.
    """

    __slots__ = (
        "addresses", "blank", "end", "key", "more", "new", "octets", "offset", "protocol", "result", "settled", "start",
        "vlan",
    )  # fmt: skip

    def __init__(self, new: bytearray, start: int, end: int, octets: bytes) -> None:
        self.new = new
        self.start = start
        self.end = end
        self.octets = octets
        self.key = b""
        self.offset = 0
        self.more = False
        self.addresses = b""
        self.protocol = 0
        self.vlan = 0
        self.blank = False  # written with zeros if its datagram stays incomplete
        self.settled = False
        self.result: bytes | None = None

    def settle(self, datagram: bytes | None) -> None:
        """Set the rewritten payload of the datagram, None if it is unknown."""
        if datagram is not None:
            self.new[self.start : self.end] = datagram[self.offset : self.offset + self.end - self.start]
        if datagram is not None or self.blank:
            self.result = bytes(self.new)
        self.settled = True


class Fragments:
    """Fragments by datagram. ``add`` returns all fragments of a datagram that became complete, and its octets."""

    def __init__(self) -> None:
        self._store = FragmentStore()
        self._groups: OrderedDict[bytes, tuple[int, list[Fragment]]] = OrderedDict()

    def add(self, fragment: Fragment, time_ns: int) -> tuple[list[Fragment], bytes] | None:
        """Add a fragment. If it completes its datagram, return all fragments and the datagram."""
        self._expire(time_ns)
        _, group = self._groups.setdefault(fragment.key, (time_ns, []))
        group.append(fragment)
        whole = self._store.add(fragment.key, fragment.offset, fragment.more, fragment.octets, time_ns)
        if whole is None:
            if len(self._groups) > MAX_DATAGRAMS:
                self.give_up()
            return None
        del self._groups[fragment.key]
        return group, whole

    def _expire(self, time_ns: int) -> None:
        while self._groups:
            since_ns, _ = next(iter(self._groups.values()))
            if time_ns - since_ns <= FRAGMENT_TIMEOUT_NS:
                return
            self.give_up()

    def give_up(self) -> bool:
        """Drop the oldest incomplete datagram; return False if there is none."""
        if not self._groups:
            return False
        _, (_, group) = self._groups.popitem(last=False)
        for fragment in group:
            fragment.settle(None)
        return True
