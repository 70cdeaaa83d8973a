"""The parts of the result of `devices`: devices, their talks, reads and writes, and the reasons for their roles."""

from __future__ import annotations

from bisect import insort
from collections.abc import Container
from ipaddress import ip_address
from typing import Final

from dissect.engine.program.carved import CarvedBlock
from dissect.engine.stations import facts
from dissect.engine.stations.facts import Fact, Station, Stretch
from dissect.meaning.report.latencies import Latencies
from dissect.packets.tcp.link import within
from dissect.wire.copies import leaves
from dissect.wire.text import printable

# Roles.
CPU: Final = "CPU"
ENGINEERING: Final = "engineering"
OPC: Final = "OPC"
PANEL: Final = "panel"
#: It answers S7 requests, and there is no evidence of its kind.
SERVER: Final = "S7 server"
UNKNOWN: Final = "unknown"
#: Roles, in order of preference if their evidence has the same weight.
ROLES: Final = (CPU, ENGINEERING, OPC, PANEL, SERVER, UNKNOWN)
#: The same, in the order in which devices are listed.
_ORDER: Final = (CPU, SERVER, ENGINEERING, OPC, PANEL, UNKNOWN)

# How certain a role is: the device states it; it behaves as only such a device does; its TSAP is that of such a device.
STATED: Final = "stated"
BEHAVIOUR: Final = "behaviour"
TSAP: Final = "tsap"
#: The same, the most certain first.
CERTAINTIES: Final = (STATED, BEHAVIOUR, TSAP)

MAX_REASONS: Final = 32
MAX_AREAS: Final = 128
#: Maximum number of tags and separate pieces of an area that are kept, for reads and for writes.
MAX_TAGS: Final = 64
MAX_PIECES: Final = 16
MAX_NAMES: Final = 16
MAX_BLOCKS: Final = 1024
#: Maximum number of distinct texts beyond the other limits that are counted.
MAX_BEYOND: Final = 4096


class Beyond:
    """Counts distinct texts that had no room elsewhere; up to `MAX_BEYOND`."""

    __slots__ = ("_texts",)

    def __init__(self) -> None:
        self._texts: set[str] = set()

    def __repr__(self) -> str:
        return f"Beyond({len(self)})"

    def __len__(self) -> int:
        return len(self._texts)

    def add(self, text: str) -> None:
        """Count a text, unless it was counted before."""
        if len(self._texts) < MAX_BEYOND:
            self._texts.add(text)

    def merge(self, later: Beyond, known: Container[str]) -> None:
        """Count the texts that ``later`` counted, unless they are in ``known``."""
        for text in later._texts:
            if text not in known:
                self.add(text)


class Names:
    """A few distinct texts in order; ``more`` counts those beyond `MAX_NAMES`."""

    __slots__ = ("more", "texts")

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.more = Beyond()

    def __repr__(self) -> str:
        return f"Names({printable(', '.join(self.texts))}{f' and {len(self.more)} more' if self.more else ''})"

    def add(self, text: str) -> None:
        """Add a text, unless it is there already."""
        if not text or text in self.texts:
            return
        if len(self.texts) < MAX_NAMES:
            insort(self.texts, text)
        else:
            self.more.add(text)

    def merge(self, later: Names) -> None:
        """Add the texts of ``later``."""
        for text in later.texts:
            self.add(text)
        self.more.merge(later.more, self.texts)


class Reason:
    """A reason for the role of a device: the certainty that it gives, a short text, and a packet that shows it.

    ``count`` is the number of connections that show it. ``hint``: other devices sometimes do the same, so it counts less than
    other reasons of the same certainty.
    """

    __slots__ = ("certainty", "count", "frame", "hint", "role", "text")

    def __init__(self, role: str, certainty: str, text: str, frame: int, hint: bool = False) -> None:
        self.role = role
        self.certainty = certainty
        self.text = text
        self.frame = frame
        self.hint = hint
        self.count = 1

    def __repr__(self) -> str:
        return f"Reason({self.role}, {self.certainty}: {printable(self.text)}, packet {self.frame})"

    @property
    def weight(self) -> tuple[int, bool, int, str]:
        """Sort key: the most important reason comes first."""
        return CERTAINTIES.index(self.certainty), self.hint, ROLES.index(self.role), self.text


class Use:
    """The reads or the writes of an area: the number of requests, the bytes, and the tags.

    ``pieces`` are the (first, last) bytes of separate pieces, in order; empty if no byte is known (symbols of S7comm-plus).
    More than `MAX_PIECES` pieces are joined into one that spans all; ``joined`` says that it may contain unused bytes.
    ``count`` does not include requests that were ``refused``.
    """

    __slots__ = ("count", "joined", "more_tags", "pieces", "refused", "tags")

    def __init__(self) -> None:
        self.count = 0
        self.refused = 0
        self.pieces: list[tuple[int, int]] = []
        self.joined = False
        self.tags: list[str] = []
        self.more_tags = Beyond()

    @property
    def whole(self) -> bool:
        """True if all of it is one piece."""
        return len(self.pieces) == 1 and not self.joined

    def reach(self, low: int, high: int) -> None:
        """Add the bytes ``low`` to ``high``."""
        apart: list[tuple[int, int]] = []
        for first, last in self.pieces:
            if last < low - 1 or first > high + 1:
                apart.append((first, last))
            else:
                low, high = min(low, first), max(high, last)
        insort(apart, (low, high))
        if len(apart) > MAX_PIECES:
            apart = [(apart[0][0], apart[-1][1])]
            self.joined = True
        self.pieces = apart

    def tag(self, name: str) -> None:
        """Add a tag."""
        if name in self.tags:
            return
        if len(self.tags) < MAX_TAGS:
            self.tags.append(name)
        else:
            self.more_tags.add(name)

    def merge(self, later: Use) -> None:
        """Add the reads or writes in later packets."""
        self.count += later.count
        self.refused += later.refused
        self.joined = self.joined or later.joined
        for low, high in later.pieces:
            self.reach(low, high)
        for name in later.tags:
            self.tag(name)
        self.more_tags.merge(later.more_tags, self.tags)


class Area:
    """A data block or another area of a device: its ``read`` and ``written`` parts; the other numbers are for both together.

    ``low`` and ``high`` are the first and the last byte; -1 if no byte is known (symbols of S7comm-plus).
    """

    __slots__ = ("name", "read", "written")

    def __init__(self, name: str) -> None:
        self.name = name
        self.read = Use()
        self.written = Use()

    def __repr__(self) -> str:
        return f"Area({self.name}, {self.reads} reads, {self.writes} writes)"

    @property
    def reads(self) -> int:
        """Number of requests that read from it, without refused ones."""
        return self.read.count

    @property
    def writes(self) -> int:
        """Number of requests that wrote to it, without refused ones."""
        return self.written.count

    @property
    def refused(self) -> int:
        """Number of requests that were refused, completely or in part."""
        return self.read.refused + self.written.refused

    @property
    def low(self) -> int:
        """The first known byte."""
        return min([low for low, _ in self.read.pieces + self.written.pieces], default=-1)

    @property
    def high(self) -> int:
        """The last known byte."""
        return max([high for _, high in self.read.pieces + self.written.pieces], default=-1)

    @property
    def tags(self) -> list[str]:
        """The tags that were read or written."""
        return list(dict.fromkeys(self.read.tags + self.written.tags))

    @property
    def more_tags(self) -> Beyond:
        """Further tags, beyond the limits."""
        found, known = Beyond(), self.tags
        for use in (self.read, self.written):
            found.merge(use.more_tags, known)
        return found

    def merge(self, later: Area) -> None:
        """Add the reads and writes of the same area in later packets."""
        self.read.merge(later.read)
        self.written.merge(later.written)


class Asked:
    """The results of requests: how many were answered, how many lack an answer, and how many got an error.

    ``likely`` counts those of the answered that are only likely pairs, which are in no answer time.
    """

    __slots__ = ("answered", "errors", "likely", "missed")

    def __init__(self) -> None:
        self.answered = 0
        self.errors = 0
        self.likely = 0
        self.missed = 0

    def __repr__(self) -> str:
        return f"Asked({self.answered} answered, {self.errors} with errors, {self.missed} missed)"

    def add(self, other: Asked, sign: int = 1) -> None:
        """Add the counts of ``other``; subtract them if ``sign`` is -1."""
        self.answered += sign * other.answered
        self.errors += sign * other.errors
        self.likely += sign * other.likely
        self.missed += sign * other.missed

    def __bool__(self) -> bool:
        return bool(self.answered or self.errors or self.missed)


class Seen:
    """What was seen in packets from ``first_frame`` to ``last_frame``, each with its time; 0 for none."""

    __slots__ = ("first_frame", "first_ns", "last_frame", "last_ns")

    def __init__(self) -> None:
        self.first_frame = 0
        self.first_ns = 0
        self.last_frame = 0
        self.last_ns = 0

    def seen(self, first: tuple[int, int], last: tuple[int, int]) -> None:
        """Note that it was seen from the packet ``first`` to ``last``, each with its time; files may come in any order."""
        if not self.first_frame or first[::-1] < (self.first_ns, self.first_frame):
            self.first_frame, self.first_ns = first
        if last[::-1] > (self.last_ns, self.last_frame):
            self.last_frame, self.last_ns = last

    def seen_as(self, other: Seen) -> None:
        """Note that it was also seen in all packets that showed ``other``."""
        if other.first_frame:
            self.seen((other.first_frame, other.first_ns), (other.last_frame, other.last_ns))


class Talk(Seen):
    """All connections between a client and a server together.

    ``client`` and ``server`` are addresses, ``vlan`` is the VLAN key of both. ``back`` counts requests by the server, such as
    those that fetch a download.
    """

    __slots__ = (
        "answered", "areas", "back", "client", "connections", "errors", "likely", "missed", "more_areas", "operations",
        "protocols", "pushes", "reads", "server", "transactions", "vlan", "writes",
    )  # fmt: skip

    def __init__(self, client: str, server: str, vlan: int = 0) -> None:
        super().__init__()
        self.client = client
        self.server = server
        self.vlan = vlan
        self.connections = 0
        self.protocols = Names()
        self.transactions = 0
        self.reads = 0
        self.writes = 0
        self.answered = 0
        self.errors = 0
        self.likely = 0
        self.missed = 0
        self.pushes = 0
        self.back = Asked()
        self.operations: dict[str, int] = {}
        self.areas: dict[str, Area] = {}
        self.more_areas = Beyond()

    def __repr__(self) -> str:
        return f"Talk({self.client} → {self.server}, {self.transactions} transactions)"

    @property
    def ends(self) -> tuple[str, str]:
        """The names of client and server (`Device.name`)."""
        return within(self.client, self.vlan), within(self.server, self.vlan)

    def area(self, name: str) -> Area | None:
        """Return an area by name; a new one if there is room, else None."""
        found = self.areas.get(name)
        if found is None:
            if len(self.areas) >= MAX_AREAS:
                self.more_areas.add(name)
                return None
            found = self.areas[name] = Area(name)
        return found

    def merge(self, later: Talk) -> None:
        """Add what the same two ends did in later packets."""
        self.connections += later.connections
        self.protocols.merge(later.protocols)
        self.transactions += later.transactions
        self.reads += later.reads
        self.writes += later.writes
        self.answered += later.answered
        self.errors += later.errors
        self.likely += later.likely
        self.missed += later.missed
        self.pushes += later.pushes
        self.back.add(later.back)
        for kind, count in later.operations.items():
            self.operations[kind] = self.operations.get(kind, 0) + count
        for name, theirs in later.areas.items():
            area = self.area(name)
            if area is not None:
                area.merge(theirs)
        self.more_areas.merge(later.more_areas, self.areas)
        self.seen_as(later)


class Device(Seen):
    """One station: an address in the network ``vlan``, a VLAN key (`link.find_ip`).

    ``station`` has its facts, each with source, packets and times. ``reasons`` are the reasons for its role. ``latencies`` are
    its answer times in nanoseconds. ``asked_by`` are the talks in which it is the server, ``asks`` those in which it is the
    client. ``sessions`` are its statements about itself as an S7comm-plus client. Texts are from the wire, not escaped.
    """

    def __init__(self, address: str, vlan: int = 0) -> None:
        super().__init__()
        self.address = address
        self.vlan = vlan
        self.station = Station(address, vlan)
        self.reasons: dict[tuple[str, str], Reason] = {}
        self.latencies = Latencies()
        self.asked_by: list[Talk] = []
        self.asks: list[Talk] = []
        self.sessions = Names()
        self.sent_to: Fact | None = None  # the MAC address of packets to it, if it was not seen to send any
        self.tsaps = Names()
        self.pdu_lengths = Names()
        self.parallel_jobs = Names()
        self.blocks: dict[str, Names] = {}
        self.more_blocks = Beyond()
        self.code: list[CarvedBlock] = []  # blocks with instructions, as loaded or read out
        self.more_code = 0

    def __repr__(self) -> str:
        return f"Device({self.address!r}, {self.role!r}, {self.get(facts.ORDER_NUMBER)!r})"

    @property
    def name(self) -> str:
        """Its unique name: the address, with the VLAN if it has one."""
        return within(self.address, self.vlan)

    @property
    def sort_key(self) -> tuple[int, int, int, int]:
        """CPUs and other servers come first; devices of the same role are sorted by address."""
        address = ip_address(self.address)
        return _ORDER.index(self.role), address.version, int(address), self.vlan

    @property
    def role(self) -> str:
        """The role with the best evidence."""
        return self._best.role if self.reasons else UNKNOWN

    @property
    def certainty(self) -> str:
        """How certain the role is; empty if it is unknown."""
        return self._best.certainty if self.reasons else ""

    @property
    def _best(self) -> Reason:
        return min(self.reasons.values(), key=lambda reason: reason.weight)

    @property
    def asked(self) -> Asked:
        """The results of the requests that it got: from its clients, and from servers on connections that it opened itself."""
        found = Asked()
        for talk in self.asked_by:
            found.answered += talk.answered
            found.errors += talk.errors
            found.likely += talk.likely
            found.missed += talk.missed
            found.add(talk.back, -1)
        for talk in self.asks:
            found.add(talk.back)
        return found

    def _because(self, role: str, certainty: str, text: str, frame: int, hint: bool = False) -> None:
        """Add a reason for a role."""
        known = self.reasons.get((role, text))
        if known is not None:
            known.count += 1
        elif len(self.reasons) < MAX_REASONS:
            self.reasons[role, text] = Reason(role, certainty, text, frame, hint)

    def _block(self, name: str) -> Names | None:
        """Return the record of the actions on a block, a new one if there is room; else None."""
        found = self.blocks.get(name)
        if found is None:
            if len(self.blocks) >= MAX_BLOCKS:
                self.more_blocks.add(name)
                return None
            found = self.blocks[name] = Names()
        return found

    def _addressed(self, fact: Fact | None) -> None:
        """Packets for it went to the MAC address in ``fact``; keep the earliest such fact."""
        if fact is not None and (self.sent_to is None or self.sent_to.time_ns > fact.time_ns):
            self.sent_to = fact

    def _merge(self, later: Device) -> None:
        """Add what was seen of the same device in later packets; neither may have ``station``, ``code`` and talks yet."""
        for key, reason in later.reasons.items():
            known = self.reasons.get(key)
            if known is not None:
                known.count += reason.count
            elif len(self.reasons) < MAX_REASONS:
                self.reasons[key] = reason
        self.latencies.merge(later.latencies)
        self.sessions.merge(later.sessions)
        self._addressed(later.sent_to)
        self.tsaps.merge(later.tsaps)
        self.pdu_lengths.merge(later.pdu_lengths)
        self.parallel_jobs.merge(later.parallel_jobs)
        for name, done in later.blocks.items():
            names = self._block(name)
            if names is not None:
                names.merge(done)
        self.more_blocks.merge(later.more_blocks, self.blocks)
        self.more_code += later.more_code
        self.seen_as(later)

    def history(self, key: str) -> list[Stretch]:
        """Return the values of a kind of fact over time, of all modules."""
        found = [
            one for (_, own), said in self.station.facts.items() if own == key for one in facts.timeline(key, said)
        ]
        return sorted(found, key=lambda stretch: (stretch.first_ns, stretch.first_frame))

    def get(self, key: str) -> str:
        """Return the latest value of a kind of fact, empty if there is none. For keys see `dissect.engine.stations.facts`."""
        return self.station.latest(key)

    @property
    def modules(self) -> list[str]:
        """Racks and slots that were addressed; an empty text for facts without one."""
        return sorted({module for module, _ in self.station.facts})

    @property
    def clock_offset_ns(self) -> int | None:
        """How far its clock, when it was read, was ahead of that of the capture, in nanoseconds; None if it was not read.

        Its time is taken as UTC.
        """
        text = self.get(facts.CLOCK)
        return int(text) if text else None

    @property
    def clock_set_offset_ns(self) -> int | None:
        """Difference of the time that it was last set to from that of the capture; None if it was not seen to be set."""
        text = self.get(facts.CLOCK_SET)
        return int(text) if text else None

    @property
    def block_counts(self) -> dict[str, int]:
        """Numbers of blocks that it stated, by type."""
        begun = f"{facts.BLOCKS} "
        said = {key: found for (_, key), found in self.station.facts.items() if key.startswith(begun)}
        return {key.removeprefix(begun): int(facts.last_of(found).value) for key, found in sorted(said.items())}


leaves(Area, Asked, Beyond, Device, Names, Reason, Talk, Use)
