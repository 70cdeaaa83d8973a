"""The contents of a synthetic capture, counted while it is written: the reference for every engine."""

from __future__ import annotations

from array import array


class Deal:
    """A transaction as it really was: when its halves were completely captured, and whether the answer reported an error."""

    __slots__ = ("answered_ns", "asked_ns", "failed")

    def __init__(self) -> None:
        self.asked_ns = -1
        self.answered_ns = -1
        self.failed = False


class Unit:
    """One TPKT on its way into the capture: ``parts`` is the number of segments that still have octets of it.

    ``tpdu`` is the name of the TPDU; ``rosctr`` is 0 if it carries no S7 PDU; ``function`` is -1 if the PDU has none. ``items``
    counts requested or written variables, ``refusals`` the item return codes other than success.
    """

    __slots__ = ("answers", "deal", "function", "items", "parts", "refusals", "rosctr", "tpdu")

    def __init__(self, tpdu: str, rosctr: int = 0, function: int = -1, deal: Deal | None = None) -> None:
        self.tpdu = tpdu
        self.rosctr = rosctr
        self.function = function
        self.deal = deal
        self.answers = False
        self.items = 0
        self.refusals = 0
        self.parts = 0


class Truth:
    """Counts the contents of the capture.

    ``lost`` counts segments that are missing from the capture although the far end got them.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.octets = 0
        self.empty_segments = 0
        self.connections = 0
        self.tpdus: dict[str, int] = {}
        self.s7_pdus = 0
        self.rosctr: dict[int, int] = {}
        self.functions: dict[int, int] = {}
        self.asked = 0
        self.answers = 0
        self.answered = 0
        self.unsolicited = 0
        self.with_errors = 0
        self.items = 0
        self.refusals = 0
        self.lost_segments = 0
        self.lost_octets = 0
        self.events: dict[str, int] = {}
        self._latencies = array("q")

    def happened(self, event: str) -> None:
        """Count one change of the traffic (a split, a swap ...), for the reader of the truth file."""
        self.events[event] = self.events.get(event, 0) + 1

    def take(self, time_ns: int, size: int, units: tuple[Unit, ...]) -> None:
        """Note a packet that goes into the capture, with the TPKTs that have octets in it."""
        self.packets += 1
        self.octets += size
        for unit in units:
            unit.parts -= 1
            if unit.parts == 0:
                self._whole(unit, time_ns)

    def _whole(self, unit: Unit, time_ns: int) -> None:
        self.tpdus[unit.tpdu] = self.tpdus.get(unit.tpdu, 0) + 1
        if not unit.rosctr:
            return
        self.s7_pdus += 1
        self.rosctr[unit.rosctr] = self.rosctr.get(unit.rosctr, 0) + 1
        if unit.function >= 0:
            self.functions[unit.function] = self.functions.get(unit.function, 0) + 1
        self.items += unit.items
        self.refusals += unit.refusals
        deal = unit.deal
        if deal is None:
            self.unsolicited += 1
        elif unit.answers:
            deal.answered_ns = time_ns
            self.answers += 1
            if deal.failed:
                self.with_errors += 1
            self._pair(deal)
        else:
            deal.asked_ns = time_ns
            self.asked += 1
            self._pair(deal)

    def _pair(self, deal: Deal) -> None:
        if deal.asked_ns >= 0 and deal.answered_ns >= 0:
            self.answered += 1
            self._latencies.append(deal.answered_ns - deal.asked_ns)

    def as_dict(self) -> dict[str, object]:
        """Return the truth as JSON-ready values. Latencies are nearest-rank percentiles in nanoseconds."""
        ranked = sorted(self._latencies)
        last = len(ranked) - 1
        names = (("min", 0.0), ("median", 0.5), ("p95", 0.95), ("p99", 0.99), ("max", 1.0))
        return {
            "packets": self.packets,
            "octets": self.octets,
            "empty_segments": self.empty_segments,
            "connections": self.connections,
            "tpdus": dict(sorted(self.tpdus.items())),
            "s7": {
                "pdus": self.s7_pdus,
                "rosctr": {str(code): n for code, n in sorted(self.rosctr.items())},
                "functions": {f"0x{code:02x}": n for code, n in sorted(self.functions.items())},
            },
            "transactions": {
                "answered": self.answered,
                "unanswered": self.asked - self.answered,
                "orphan_answers": self.answers - self.answered,
                "unsolicited": self.unsolicited,
                "with_errors": self.with_errors,
            },
            "items": self.items,
            "item_refusals": self.refusals,
            "latency_ns": {name: ranked[round(part * last)] for name, part in names} if ranked else {},
            "lost": {"segments": self.lost_segments, "octets": self.lost_octets},
            "events": dict(sorted(self.events.items())),
        }
