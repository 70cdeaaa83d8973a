"""Facts about stations, and the book that stores them: the facts of each address, since when, and from which packets.

All sizes are limited: `MAX_STATIONS` stations, `MAX_KEYS` kinds of facts for each, `MAX_STRETCHES` values over time for each
kind, and `MAX_BLOCKS` names of blocks. Facts beyond that are counted.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

from mypy_extensions import mypyc_attr

from dissect.packets.tcp.link import within
from dissect.protocols.s7plus import session
from dissect.wire.copies import leaves

# Keys of facts; JSON and CSV use the same names (docs/devices.md).
ORDER_NUMBER: Final = session.ORDER_NUMBER
HARDWARE: Final = session.HARDWARE
FIRMWARE: Final = session.FIRMWARE
SERIAL_NUMBER: Final = session.SERIAL_NUMBER
OPERATING_MODE: Final = session.OPERATING_MODE
CARD_SERIAL: Final = "memory_card_serial"
MODULE_TYPE: Final = "module_type"
STATION_NAME: Final = "station_name"
MODULE_NAME: Final = "module_name"
PLANT: Final = "plant"
LOCATION: Final = "location"
MODE_SWITCH: Final = "mode_switch"
PROTECTION: Final = "protection_level"
MAX_PDU: Final = "max_pdu_length"
MAX_CONNECTIONS: Final = "max_connections"
INTERFACE: Final = "interface"
MAC: Final = "mac"
CLOCK: Final = "clock"
CLOCK_SET: Final = "clock_set"
BLOCKS: Final = "blocks"
BLOCK: Final = "block"

#: Names of all keys for people, in the order of display.
KEYS: Final[dict[str, str]] = {
    ORDER_NUMBER: "order number",
    HARDWARE: "hardware version",
    FIRMWARE: "firmware version",
    SERIAL_NUMBER: "serial number",
    CARD_SERIAL: "serial number of the memory card",
    MODULE_TYPE: "module type",
    STATION_NAME: "name of the station",
    MODULE_NAME: "name of the module",
    PLANT: "plant designation",
    LOCATION: "location designation",
    OPERATING_MODE: "operating mode",
    MODE_SWITCH: "mode switch",
    PROTECTION: "protection level",
    MAX_PDU: "largest PDU length",
    MAX_CONNECTIONS: "connection resources",
    INTERFACE: "Ethernet interface",
    MAC: "MAC address",
    CLOCK: "clock, as it was read",
    CLOCK_SET: "clock, as it was set",
    BLOCKS: "number of blocks",
    BLOCK: "block",
}
#: Facts that stay the same as long as device and firmware do: a change is a finding.
LASTING: Final = frozenset((ORDER_NUMBER, FIRMWARE, SERIAL_NUMBER, MAC))

#: A clock runs, so only the latest value is kept, both of read clocks and of set clocks.
CLOCKS: Final = frozenset((CLOCK, CLOCK_SET))

#: The key of the MAC address in `Station.facts`; it belongs to no module.
MAC_KEY: Final = ("", MAC)

MAX_STATIONS: Final = 4096
MAX_KEYS: Final = 64
MAX_STRETCHES: Final = 32
MAX_BLOCKS: Final = 1024
#: Characters of the longest value.
MAX_VALUE: Final = 120


class Fact:
    """A fact that a station stated about itself or that was observed about it, in the packets ``frames``.

    ``host`` is the address of the station and ``vlan`` the VLAN key of its network (`link.find_ip`). ``module`` is the rack and
    slot that was addressed ("rack 0 slot 2"), empty if unknown. ``key`` is one of `KEYS`; ``value`` is text from the wire, not
    escaped; ``source`` is where the fact was read ("SZL 0x0011"). ``before`` is the value until then, empty for none; ``after``
    is the next value, which may be known already if files are not read in order of time; ``fresh`` means that ``value`` differs
    from both. ``connection`` is the number of the connection.
    """

    __slots__ = (
        "after",
        "before",
        "connection",
        "frames",
        "fresh",
        "host",
        "key",
        "module",
        "source",
        "time_ns",
        "value",
        "vlan",
    )

    def __init__(
        self,
        host: str,
        module: str,
        key: str,
        value: str,
        source: str,
        connection: int,
        frames: list[int],
        time_ns: int,
        vlan: int = 0,
    ) -> None:
        self.host = host
        self.vlan = vlan
        self.module = module
        self.key = key
        self.value = value[:MAX_VALUE]
        self.source = source
        self.connection = connection
        self.frames = frames
        self.time_ns = time_ns
        self.before = ""
        self.after = ""
        self.fresh = False

    def __repr__(self) -> str:
        return f"Fact({self.host!r}, {self.module!r}, {self.key!r}, {self.value!r})"


@mypyc_attr(acyclic=True)  # many are kept, and each is smaller without the header for the garbage collector
class Stretch:
    """A value and how long it stayed the same: the number of facts, and packet and time of the first and the last of them."""

    __slots__ = ("count", "first_frame", "first_ns", "last_frame", "last_ns", "source", "value")

    def __init__(self, value: str, source: str, frame: int, time_ns: int) -> None:
        self.value = value
        self.source = source
        self.count = 1
        self.first_frame = frame
        self.first_ns = time_ns
        self.last_frame = frame
        self.last_ns = time_ns

    def __repr__(self) -> str:
        return f"Stretch({self.value!r}, {self.count})"

    def again(self, frame: int, time_ns: int) -> None:
        """Take a fact with the same value; it is not older than the first one."""
        self.count += 1
        if time_ns >= self.last_ns:
            self.last_frame = frame
            self.last_ns = time_ns

    def join(self, other: Stretch) -> None:
        """Join with ``other``, which has the same value, and may be earlier or later."""
        self.count += other.count
        if other.last_ns >= self.last_ns:
            self.last_frame = other.last_frame
            self.last_ns = other.last_ns
        if other.first_ns < self.first_ns:
            self.first_frame = other.first_frame
            self.first_ns = other.first_ns


class Station:
    """What is known about an address in one network; the same address in another VLAN is another station.

    ``facts`` has the values by (module, key), in the order in which they were noted; `timeline` sorts them by time, because
    files may be read in any order. ``blocks`` are the names of its blocks. ``not_kept`` counts facts beyond the limits.
    """

    __slots__ = ("blocks", "facts", "host", "not_kept", "vlan")

    def __init__(self, host: str, vlan: int = 0) -> None:
        self.host = host
        self.vlan = vlan
        self.facts: dict[tuple[str, str], list[Stretch]] = {}
        self.blocks: dict[str, Stretch] = {}
        self.not_kept = 0

    def __repr__(self) -> str:
        return f"Station({self.host}{f', VLAN {self.vlan}' if self.vlan else ''}, {len(self.facts)} kinds of facts)"

    def latest(self, key: str) -> str:
        """Return the latest value of a kind, from any module; empty if there is none."""
        found = [last_of(stretches) for (_, own), stretches in self.facts.items() if own == key]
        return max(found, key=lambda stretch: stretch.last_ns).value if found else ""

    def note(self, fact: Fact) -> None:
        """Take a fact, and set its ``before``, ``after`` and ``fresh``."""
        frame = fact.frames[-1] if fact.frames else 0
        if fact.key == BLOCK:
            self._note_block(fact, frame)
            return
        key = (fact.module, fact.key)
        stretches = self.facts.get(key) if self.facts else None
        if stretches is None:
            fact.fresh = True
            self._begin(key, fact.value, fact.source, frame, fact.time_ns)
            return
        last = stretches[-1]
        if fact.key in CLOCKS:
            if fact.time_ns >= last.last_ns:
                last.value = fact.value
            last.again(frame, fact.time_ns)
        elif fact.time_ns < last.first_ns:
            self._note_earlier(fact, frame, stretches)
        elif fact.value == last.value:
            last.again(frame, fact.time_ns)
        elif agree(fact.key, last.value, fact.value):
            last.value = max(last.value, fact.value, key=len)
            last.again(frame, fact.time_ns)
        else:
            fact.before = last.value
            fact.fresh = True
            source = last.source if last.source == fact.source else fact.source  # one shared object for equal texts
            stretches.append(Stretch(_known(fact.value, stretches), source, frame, fact.time_ns))
            self._bound(stretches)

    def _note_earlier(self, fact: Fact, frame: int, stretches: list[Stretch]) -> None:
        """Take a fact that is older than the latest one: its file is read after a later file."""
        before = after = ""
        for one in timeline(fact.key, stretches):
            if one.first_ns <= fact.time_ns:
                before = one.value
            elif not after:
                after = one.value
        if not agree(fact.key, before, fact.value) and not agree(fact.key, after, fact.value):
            fact.before = before
            fact.after = after
            fact.fresh = True
        stretches.append(Stretch(_known(fact.value, stretches), fact.source, frame, fact.time_ns))
        self._bound(stretches)

    def _bound(self, stretches: list[Stretch]) -> None:
        if len(stretches) > MAX_STRETCHES:
            del stretches[1]  # keep the first one, which is the initial value
            self.not_kept += 1

    def again(self, key: tuple[str, str], value: str, source: str, frame: int, time_ns: int) -> bool:
        """Take a value that is the first of its kind or the same as before; False for a new value, which needs a `Fact`."""
        stretches = self.facts.get(key) if self.facts else None
        if stretches is None:
            self._begin(key, value, source, frame, time_ns)
            return True
        last = stretches[-1]
        if last.value != value or time_ns < last.first_ns:
            return False
        last.again(frame, time_ns)
        return True

    def _begin(self, key: tuple[str, str], value: str, source: str, frame: int, time_ns: int) -> None:
        if len(self.facts) >= MAX_KEYS:
            self.not_kept += 1
        else:
            self.facts[key] = [Stretch(value, source, frame, time_ns)]

    def merge(self, later: Station) -> None:
        """Add what was noted about the same address in other packets; ``later`` must not be used afterwards."""
        self.not_kept += later.not_kept
        for (module, key), stretches in later.facts.items():
            known = self.facts.get((module, key))
            if known is not None:
                self._append(key, known, stretches)
            elif len(self.facts) < MAX_KEYS:
                self.facts[module, key] = stretches
            else:
                self.not_kept += sum([stretch.count for stretch in stretches])
        for name, stretch in later.blocks.items():
            block = self.blocks.get(name)
            if block is not None:
                block.join(stretch)
            elif len(self.blocks) < MAX_BLOCKS:
                self.blocks[name] = stretch
            else:
                self.not_kept += stretch.count

    def _append(self, key: str, known: list[Stretch], later: list[Stretch]) -> None:
        for stretch in later:
            last = known[-1]
            if key in CLOCKS:
                if stretch.last_ns >= last.last_ns:
                    last.value = stretch.value
                last.join(stretch)
            elif stretch.first_ns >= last.first_ns and agree(key, last.value, stretch.value):
                last.value = max(last.value, stretch.value, key=len)
                last.join(stretch)
            else:
                known.append(stretch)
                self._bound(known)

    def _note_block(self, fact: Fact, frame: int) -> None:
        known = self.blocks.get(fact.value)
        if known is not None:
            known.again(frame, fact.time_ns)
        elif len(self.blocks) >= MAX_BLOCKS:
            self.not_kept += 1
        else:
            fact.fresh = True
            self.blocks[fact.value] = Stretch(fact.value, fact.source, frame, fact.time_ns)


def last_of(stretches: list[Stretch]) -> Stretch:
    """Return the stretch with the value that was stated last."""
    found = stretches[0]
    for one in stretches:
        if one.last_ns >= found.last_ns:
            found = one
    return found


def timeline(key: str, stretches: list[Stretch]) -> list[Stretch]:
    """Return the values of one kind in order of time; each differs from the one before it.

    Values are noted file by file. If two files state the same value before and after a different one in a third file, it
    appears twice, each time with its own first and last time.
    """
    if all([one.last_ns <= other.first_ns for one, other in pairwise(stretches)]) and not _repeats(key, stretches):
        return stretches
    points: list[tuple[int, int, int, Stretch]] = []  # time, packet, number of facts, value
    for one in stretches:
        apart = one.last_ns > one.first_ns
        points.append((one.first_ns, one.first_frame, one.count - 1 if apart else one.count, one))
        if apart:
            points.append((one.last_ns, one.last_frame, 1, one))
    found: list[Stretch] = []
    for time_ns, frame, count, one in sorted(points, key=lambda point: (point[0], point[1])):
        if found and agree(key, found[-1].value, one.value):
            found[-1].value = max(found[-1].value, one.value, key=len)
            found[-1].count += count - 1
            found[-1].again(frame, time_ns)
        else:
            found.append(Stretch(one.value, one.source, frame, time_ns))
            found[-1].count = count
    return found


def _repeats(key: str, stretches: list[Stretch]) -> bool:
    return any([agree(key, one.value, other.value) for one, other in pairwise(stretches)])


def _known(value: str, stretches: list[Stretch]) -> str:
    """Return ``value``, or the equal text before the last one: most values alternate, so one object is enough."""
    if len(stretches) > 1 and stretches[-2].value == value:
        return stretches[-2].value
    return value


class Book:
    """Stations by address and VLAN (`within`). ``not_kept`` counts facts about stations beyond `MAX_STATIONS`.

    With ``filled`` the engine notes all facts in this book, so its owner need not do so.
    """

    def __init__(self) -> None:
        self.filled = False
        self.stations: dict[str, Station] = {}
        self.not_kept = 0

    def note(self, fact: Fact) -> None:
        """Take a fact (`Station.note`)."""
        station = self._of(fact.host, fact.vlan)
        if station is not None:
            station.note(fact)

    def again(
        self, host: str, vlan: int, key: tuple[str, str], value: str, source: str, frame: int, time_ns: int
    ) -> bool:
        """Take a value of ``host`` without making a `Fact`, if possible (`Station.again`)."""
        station = self._of(host, vlan)
        return station is None or station.again(key, value, source, frame, time_ns)

    def _of(self, host: str, vlan: int) -> Station | None:
        """Return the station with this address; None if there is no room for it, which is then counted."""
        name = within(host, vlan) if vlan else host
        station = self.stations.get(name)
        if station is None:
            if len(self.stations) >= MAX_STATIONS:
                self.not_kept += 1
                return None
            station = Station(host, vlan)
            self.stations[name] = station
        return station

    def stating(self, keys: frozenset[str]) -> list[Station]:
        """Return the stations with any of these kinds of facts, in the order in which they first stated something."""
        found: list[Station] = []
        for station in self.stations.values():
            for _, key in station.facts:
                if key in keys and station.latest(key):
                    found.append(station)
                    break
        return found

    def merge(self, later: Book) -> None:
        """Add what was noted in later packets; ``later`` must not be used afterwards."""
        self.not_kept += later.not_kept
        for theirs in later.stations.values():
            self.take(theirs)

    def take(self, theirs: Station) -> None:
        """Add what was noted about a station in later packets; ``theirs`` must not be used afterwards."""
        name = within(theirs.host, theirs.vlan)
        station = self.stations.get(name)
        if station is not None:
            station.merge(theirs)
        elif len(self.stations) < MAX_STATIONS:
            self.stations[name] = theirs
        else:
            facts = [stretch for stretches in theirs.facts.values() for stretch in stretches]
            self.not_kept += theirs.not_kept + sum([one.count for one in (*facts, *theirs.blocks.values())])


def agree(key: str, one: str, other: str) -> bool:
    """Return whether two values may mean the same: "V4.3" and "V4.3.1" may, because one source can be less exact."""
    if one == other:
        return True
    if key == FIRMWARE:
        return one.startswith(f"{other}.") or other.startswith(f"{one}.")
    return False


def _taken(found: Stretch) -> tuple[str, str, int, int]:
    return found.value, found.source, 0, 0


leaves(Fact, Station, Book)
leaves(Stretch, taken=_taken)
