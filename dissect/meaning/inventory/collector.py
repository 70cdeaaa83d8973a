"""Builds devices from the events of a run: facts, transactions, operations, connections.

All sizes are limited: `MAX_DEVICES` devices, `MAX_TALKS` pairs of client and server, `MAX_TARGETS` distinct requests whose
addresses are examined. The `Inventory` counts everything beyond these limits. A transaction costs one or two look-ups; its
request is parsed only once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from dissect.engine.acts import tables as kinds
from dissect.engine.acts.act import Act
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.program.carved import CarvedBlock, carve
from dissect.engine.stations.facts import MAC, Book, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.naming import named_items
from dissect.engine.transactions.operation import NAMELESS, Operation
from dissect.engine.transactions.plus_operations import addresses_in
from dissect.engine.transactions.transaction import ANSWERED, PUSH, Transaction
from dissect.meaning.inventory.model import Asked, Device, Talk, Use
from dissect.meaning.inventory.roles import Deeds, judge_client, judge_server
from dissect.meaning.report.analysis import Part
from dissect.meaning.report.latencies import Latencies
from dissect.packets.source.packet import SourceFile
from dissect.packets.tcp.link import within
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.tables import (
    AREA_LETTERS,
    CODE_BLOCKS,
    DB_AREAS,
    JOB,
    NUMBERED_AREAS,
    READ_VAR,
    USERDATA,
    WRITE_VAR,
)
from dissect.protocols.s7plus.ids import AREAS, BLOCK_KINDS
from dissect.protocols.s7plus.items import READS, WRITES

MAX_DEVICES: Final = 4096
MAX_TALKS: Final = 16_384
MAX_TARGETS: Final = 65_536
#: Maximum size of the blocks of all devices whose code is examined.
MAX_CODE: Final = 1024 * 1024

_VARIABLES: Final = frozenset((READ_VAR, WRITE_VAR))
#: Outcomes of acts that leave blocks as they were.
_NOT_DONE: Final = frozenset((kinds.REFUSED, kinds.FAILED, kinds.UNANSWERED))
#: Actions on a block.
_BLOCKS: Final = {kinds.DOWNLOAD: "loaded", kinds.UPLOAD: "read out", kinds.DELETE: "deleted"}


class Target:
    """The subject of requests with the same parameters; ``count`` of them were carried out, and ``refused`` were refused."""

    __slots__ = ("count", "places", "refused", "tags", "writes")

    def __init__(self, writes: bool) -> None:
        self.writes = writes
        self.count = 0
        self.refused = 0
        self.places: list[tuple[str, int, int]] = []  # area, first and last byte
        self.tags: list[tuple[str, str]] = []  # area and tag


class Traffic:
    """What was transferred on an open connection. Lists have one entry per side."""

    __slots__ = (
        "answer_frames",
        "asked",
        "deeds",
        "latencies",
        "operations",
        "pushes",
        "targets",
        "transactions",
    )

    def __init__(self, latencies: list[Latencies | None]) -> None:
        self.latencies = latencies
        self.transactions = 0
        self.asked = [Asked(), Asked()]  # by the side that asked
        self.pushes = 0
        self.answer_frames = [0, 0]  # the first answer of each side
        self.deeds = Deeds()
        self.targets: dict[tuple[int, bytes], Target] = {}
        self.operations: dict[str, int] = {}  # by kind: how many


class Inventory(Observer):
    """The devices of a run. Give it to a pipeline as observer, then call `take`.

    ``devices`` are sorted, CPUs first; ``talks`` are sorted by their ends. The other numbers count what exceeds the limits.
    """

    def __init__(self) -> None:
        super().__init__()
        self.devices: list[Device] = []
        self.talks: list[Talk] = []
        self.files: list[SourceFile] = []
        self.part: Part | None = None
        self.pipeline: Pipeline | None = None
        self.devices_not_listed = 0
        self.talks_not_listed = 0
        self.requests_not_looked_at = 0
        self.facts_not_kept = 0
        self._book = Book()
        self._found: dict[str, Device] = {}
        self._talks: dict[tuple[str, str], Talk] = {}  # by the names of their ends
        # By (address, VLAN): the VLAN in which the same station was found before.
        self._joined: dict[tuple[str, int], int] = {}
        self._open: dict[int, Traffic] = {}
        self._targets = 0
        self._code = 0

    def __repr__(self) -> str:
        return f"Inventory({len(self.devices)} devices, {len(self.talks)} talks)"

    def take(self, pipeline: Pipeline, files: list[SourceFile]) -> None:
        """The run is over: store the list of read files, and sort the devices."""
        self.pipeline = pipeline
        self.files = files
        self.facts_not_kept = self._book.not_kept
        self._join()
        for name, device in self._found.items():
            if device.sent_to is not None and not any(key == MAC for _, key in self._facts_of(name)):
                self._book.note(device.sent_to)
            station = self._book.stations.get(name)
            if station is not None:
                device.station = station
                self.facts_not_kept += station.not_kept
            judge_server(device)
        self.devices = sorted(self._found.values(), key=lambda device: device.sort_key)
        order = {device.name: place for place, device in enumerate(self.devices)}
        self.talks = sorted(self._talks.values(), key=lambda talk: [order.get(name, 0) for name in talk.ends])
        for talk in self.talks:
            client, server = talk.ends
            self._found[client].asks.append(talk)
            self._found[server].asked_by.append(talk)

    @property
    def finding_counts(self) -> dict[str, int]:
        """How often each finding was made, by slug; with a selection, those of the selected part. Empty before `take`."""
        if self.part is not None:
            return self.part.finding_counts
        return self.pipeline.finding_counts if self.pipeline is not None else {}

    def merge(self, later: Inventory) -> None:
        """Add what ``later`` found in later packets; call this before `take` of either.

        ``later`` must not be used afterwards.
        """
        self._book.merge(later._book)
        for theirs in later._found.values():
            device = self._device(theirs.address, theirs.vlan)
            if device is not None:
                device._merge(theirs)
                for block in theirs.code:
                    self._keep_code(device, block)
        for talk in later._talks.values():
            self._add_talk(talk)
        for (address, vlan), other in later._joined.items():
            self._same(address, vlan, other)
        self.devices_not_listed += later.devices_not_listed
        self.talks_not_listed += later.talks_not_listed
        self.requests_not_looked_at += later.requests_not_looked_at
        if self.part is None:
            self.part = later.part
        elif later.part is not None:
            self.part.merge(later.part)

    def _add_talk(self, talk: Talk) -> None:
        """Add a talk; its ends may have talked before."""
        if not all(name in self._found for name in talk.ends):
            self.devices_not_listed += talk.connections
            return
        known = self._talk(talk.client, talk.server, talk.vlan)
        if known is not None:
            known.merge(talk)
        else:
            self.talks_not_listed += talk.connections

    def _same(self, address: str, one: int, other: int) -> None:
        """A connection of a station was seen in two VLANs: they are one station, listed with the lower number."""
        low, high = sorted((self._root(address, one), self._root(address, other)))
        if low != high and len(self._joined) < MAX_DEVICES:
            self._joined[address, high] = low

    def _root(self, address: str, vlan: int) -> int:
        while (found := self._joined.get((address, vlan))) is not None:
            vlan = found
        return vlan

    def _join(self) -> None:
        """Join the cards of stations that were seen in several VLANs."""
        if not self._joined:
            return
        found, talks, stations = self._found, self._talks, self._book.stations
        self._found, self._talks = {}, {}
        for theirs in found.values():
            device = self._device(theirs.address, self._root(theirs.address, theirs.vlan))
            if device is not None:
                device._merge(theirs)
                device.code += theirs.code
        for talk in talks.values():
            talk.vlan = self._root(talk.server, talk.vlan)
            self._add_talk(talk)
        self._book.stations = {}
        for station in stations.values():
            station.vlan = self._root(station.host, station.vlan)
            self._book.take(station)

    def _facts_of(self, name: str) -> Iterable[tuple[str, str]]:
        station = self._book.stations.get(name)
        return station.facts if station is not None else ()

    # ---- observer ---------------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction; examine its reads or writes if they are new."""
        traffic = self._open.get(transaction.connection.number)
        if traffic is None:
            traffic = self._begin(transaction.connection)
        traffic.transactions += 1
        asked = traffic.asked[transaction.asked_by]
        outcome = transaction._outcome
        if outcome == ANSWERED:
            asked.answered += 1
            answering = 1 - transaction.asked_by
            latencies = traffic.latencies[answering]
            if transaction.is_likely:
                asked.likely += 1
            elif latencies is not None:
                latencies.add(transaction.response_ns - transaction.request_ns)
            if not traffic.answer_frames[answering]:
                traffic.answer_frames[answering] = transaction.response_frame
        elif outcome == PUSH:
            traffic.pushes += 1
        elif transaction.missed:
            asked.missed += 1
        if transaction.has_errors:
            asked.errors += 1
        function = transaction.parameters.function
        if transaction.rosctr == JOB:
            if function not in _VARIABLES:
                return
            key = transaction.asked_by, transaction.parameters.octets
        elif transaction.rosctr == USERDATA:
            traffic.deeds.asks(transaction)
            return
        elif transaction.is_plus:
            if transaction.function not in READS and transaction.function not in WRITES:
                return
            key = transaction.asked_by, _plus_body(transaction)
        else:
            return
        target = traffic.targets.get(key)
        if target is None:
            if self._targets >= MAX_TARGETS:
                self.requests_not_looked_at += 1
                return
            target = self._target(transaction)
            traffic.targets[key] = target
        if transaction.has_errors:
            target.refused += 1
        else:
            target.count += 1

    def operation(self, operation: Operation) -> None:
        """Count an operation, and note what it shows about its client."""
        traffic = self._traffic(operation.connection)
        traffic.operations[operation.kind] = traffic.operations.get(operation.kind, 0) + 1
        traffic.deeds.does(operation, operation.first_frame)

    def act(self, act: Act) -> None:
        """Note what an act shows about its client, and the blocks that it loads, reads out or deletes."""
        self._traffic(act.connection).deeds.did(act)
        done = _BLOCKS.get(act.kind)
        operation = act.operation
        if done is None or act.outcome in _NOT_DONE:
            return
        if act.outcome == kinds.NOT_CAPTURED and (operation is None or not operation.content):
            return  # it may have been refused
        device = self._device(act.server, int(act.connection.tcp.vlan))
        if device is None:
            return
        if operation is not None and operation.content:
            self._take_code(device, operation)
        if act.outcome == kinds.UNFINISHED:
            done += " in part"
        for name in _blocks_of(act):
            names = device._block(name)
            if names is not None:
                names.add(f"{done} (only likely)" if act.likely else done)

    def _traffic(self, connection: Connection) -> Traffic:
        traffic = self._open.get(connection.number)
        return traffic if traffic is not None else self._begin(connection)

    def _take_code(self, device: Device, operation: Operation) -> None:
        for block in carve(operation):
            if block.classic is not None and block.kind in CODE_BLOCKS and block.complete:
                self._keep_code(device, block)

    def _keep_code(self, device: Device, block: CarvedBlock) -> None:
        if self._code + len(block.octets) > MAX_CODE:
            device.more_code += 1
        else:
            self._code += len(block.octets)
            device.code.append(block)

    def fact(self, fact: Fact) -> None:
        """Keep a fact that a station stated about itself."""
        self._book.note(fact)

    def connection_closed(self, connection: Connection) -> None:
        """Add a closed connection to the talk of its ends, and to the evidence about both ends."""
        traffic = self._open.pop(connection.number, None)
        if traffic is None:
            traffic = self._begin(connection, keep=False)
        self._targets -= len(traffic.targets)
        client_side = int(connection.client_side)
        tcp = connection.tcp
        vlan = int(tcp.vlan)
        client, server = (self._device(str(end.host), vlan) for end in (connection.client, connection.server))
        if client is None or server is None:
            self.devices_not_listed += 1
            return
        for other in tcp.also:
            for device in (client, server):
                self._same(device.address, vlan, other)
        for device, side in ((client, client_side), (server, 1 - client_side)):
            mac = tcp.mac(side)
            if mac:
                place = (int(connection.number), [int(tcp.first_frame)], int(tcp.first_ns))
                device._addressed(Fact(device.address, "", MAC, mac.hex(":"), "Ethernet, as receiver", *place, vlan))
            device.seen((int(tcp.first_frame), int(tcp.first_ns)), (int(tcp.last_frame), int(tcp.last_ns)))
        talk = self._talk(client.address, server.address, vlan)
        if talk is None:
            self.talks_not_listed += 1
        else:
            _add(talk, connection, traffic)
            self._add_areas(talk, traffic, client_side)
        _negotiated(connection, client, server)
        judge_client(client, server, connection, traffic.deeds, traffic.answer_frames)

    # ---- parts ------------------------------------------------------------------------------------------------------

    def _begin(self, connection: Connection, keep: bool = True) -> Traffic:
        tcp = connection.tcp
        found = [self._device(str(end.host), int(tcp.vlan)) for end in tcp.ends]
        traffic = Traffic([device.latencies if device is not None else None for device in found])
        if keep:
            self._open[int(connection.number)] = traffic
        return traffic

    def _device(self, address: str, vlan: int) -> Device | None:
        name = within(address, vlan)
        device = self._found.get(name)
        if device is None:
            if len(self._found) >= MAX_DEVICES:
                return None
            device = self._found[name] = Device(address, vlan)
        return device

    def _talk(self, client: str, server: str, vlan: int) -> Talk | None:
        ends = within(client, vlan), within(server, vlan)
        talk = self._talks.get(ends)
        if talk is None and len(self._talks) < MAX_TALKS:
            talk = self._talks[ends] = Talk(client, server, vlan)
        return talk

    def _target(self, transaction: Transaction) -> Target:
        """Examine the reads or writes of a request that is the first with these parameters on its connection."""
        self._targets += 1
        if transaction.is_plus:
            return _plus_target(transaction)
        target = Target(transaction.function == WRITE_VAR)
        named = named_items(transaction)
        for number, result in enumerate(transaction.s7_results):
            item = result.item
            if item is None:
                continue
            for one in item.areas or [item]:
                target.places.append(_place(one))
            if named:
                area = target.places[-1][0]
                target.tags += [(area, value.name) for value in named[number] if value.name]
        return target

    def _add_areas(self, talk: Talk, traffic: Traffic, client_side: int) -> None:
        """Add reads and writes to the talks of the sides that sent the requests."""
        for (asked_by, _), target in traffic.targets.items():
            whose: Talk | None = talk
            if asked_by != client_side:
                whose = self._talk(talk.server, talk.client, talk.vlan)
            if whose is None or not target.places:
                continue
            if target.writes:
                whose.writes += target.count + target.refused
            else:
                whose.reads += target.count + target.refused
            uses: dict[str, Use] = {}
            for name, low, high in target.places:
                area = whose.area(name)
                if area is not None:
                    uses[name] = use = area.written if target.writes else area.read
                    if low >= 0:
                        use.reach(low, high)
            for name, tag in target.tags:
                if name in uses:
                    uses[name].tag(tag)
            for use in uses.values():
                use.count += target.count
                use.refused += target.refused


def _blocks_of(act: Act) -> list[str]:
    """Return the names of the blocks of an act; a transfer in S7comm-plus may carry several."""
    name = act.subject.removeprefix("block ")
    if act.connection.plus is None:
        name = name.partition(",")[0]  # without ", active" or ", passive": both are the same block
    else:
        named = [f"{block.label}{f' {block.name!r}' if block.name else ''}" for block in act.blocks()]
        if named:
            return named
    return [name] if name and name != NAMELESS else []


def _place(item: Item) -> tuple[str, int, int]:
    """Return the area of an item with its first and last byte (or timer or counter); -1 if unknown."""
    area = int(item.area)
    if area < 0:
        return item.address.partition(" ")[0], -1, -1
    name = f"DB{item.db}" if area in DB_AREAS else AREA_LETTERS.get(area, f"area 0x{area:02x}")
    if area in NUMBERED_AREAS:
        return name, int(item.start_bit), int(item.start_bit) + max(1, int(item.count)) - 1
    first = int(item.start_bit) // 8
    return name, first, first + max(1, int(item.size)) - 1


def _plus_body(transaction: Transaction) -> bytes:
    """Return the part of a request that stays the same in repetitions: the function, and the body without numbers and ids."""
    return transaction.function.to_bytes(2, "big") + addresses_in(transaction.request_octets)


def _plus_target(transaction: Transaction) -> Target:
    target = Target(transaction.function in WRITES)
    for item in transaction.plus_results:
        address = item.address
        if address is None or (address.area not in AREAS and address.area >> 16 not in BLOCK_KINDS):
            continue  # an object of the CPU itself, such as its session
        label = item.label
        area = label.partition(".")[0]
        target.places.append((area, -1, -1))
        if area != label:
            target.tags.append((area, label))
    return target


def _add(talk: Talk, connection: Connection, traffic: Traffic) -> None:
    tcp = connection.tcp
    talk.connections += 1
    talk.protocols.add(connection.protocol)
    talk.transactions += traffic.transactions
    for asked in traffic.asked:
        talk.answered += asked.answered
        talk.errors += asked.errors
        talk.likely += asked.likely
        talk.missed += asked.missed
    talk.back.add(traffic.asked[1 - connection.client_side])
    talk.pushes += traffic.pushes
    for kind, count in traffic.operations.items():
        talk.operations[kind] = talk.operations.get(kind, 0) + count
    talk.seen((int(tcp.first_frame), int(tcp.first_ns)), (int(tcp.last_frame), int(tcp.last_ns)))


def _negotiated(connection: Connection, client: Device, server: Device) -> None:
    """Note the values negotiated with the server, and the TSAPs of both ends."""
    granted = connection.granted
    if granted is not None:
        server.pdu_lengths.add(str(granted.pdu_length))
        server.parallel_jobs.add(str(connection.jobs_allowed(connection.client_side)))
    if connection.tsap_calling is not None:
        client.tsaps.add(connection.tsap_calling.means(connection.protocol, False))
    if connection.tsap_called is not None:
        server.tsaps.add(connection.tsap_called.means(connection.protocol))


def talks_between(talks: Sequence[Talk], clients: Sequence[str], servers: Sequence[str]) -> list[list[int]]:
    """Return the number of transactions of each client with each server, by name; one row for each client."""
    known = {talk.ends: talk.transactions for talk in talks}
    return [[known.get((client, server), 0) for server in servers] for client in clients]
