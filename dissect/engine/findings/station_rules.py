"""Remembers what stations state about themselves; a contradiction to an earlier statement is a finding."""

from __future__ import annotations

from typing import Final

from dissect.engine.findings.reporter import Reporter
from dissect.engine.stations.evidence import Evidence, module_asked
from dissect.engine.stations.facts import (
    FIRMWARE,
    KEYS,
    LASTING,
    MAC,
    MAC_KEY,
    MAX_STATIONS,
    ORDER_NUMBER,
    SERIAL_NUMBER,
    Book,
    Fact,
)
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.link import within
from dissect.protocols.s7plus.session import Identity
from dissect.wire.text import printable

#: The finding for each fact that contradicts the earlier one.
_SLUGS: Final[dict[str, str]] = {
    ORDER_NUMBER: "device.order_number_changed",
    FIRMWARE: "device.firmware_changed",
    SERIAL_NUMBER: "device.serial_changed",
    MAC: "device.mac_changed",
}

#: The source of facts from the Ethernet header.
_ETHERNET: Final = "Ethernet"


class StationWatch:
    """Reads facts, stores them in ``book`` and judges them; its methods return them for the observer. One object per analysis.

    Each VLAN is judged separately: identical machines may use the same addresses, each in its own VLAN. ``book`` is the
    observer's book, which then already has the facts (`Book.filled`); with None this object makes its own.
    """

    def __init__(self, reporter: Reporter, book: Book | None = None) -> None:
        self.book = Book() if book is None else book
        self.book.filled = True
        self._reporter = reporter
        self._evidence = Evidence()
        self._macs: dict[bytes, str] = {}  # texts of MAC addresses: most calls need one that exists already

    def opened(self, connection: Connection, wanted: bool = True) -> list[Fact]:
        """Take the source MAC addresses of both ends of a connection, once it is recognised.

        A destination address proves nothing: packets to a redundant router use its shared address, but packets from it have its
        own. If facts are not ``wanted``, return only those that contradict earlier ones.
        """
        tcp = connection.tcp
        found: list[Fact] = []
        ends = tcp.ends
        if ends[0].address == ends[1].address:
            return found  # loopback has no network card, and captures of it may show any address for each side
        vlan = int(tcp.vlan)
        for side in range(2):
            if tcp.heard >> side & 1 and (mac := tcp.mac(side)):
                host = ends[side].host
                text = self._mac_text(mac)
                # not "*place": a call with a tuple of arguments takes several times as long, and each connection needs two
                number, frame, time_ns = int(connection.number), int(tcp.last_frame), int(tcp.last_ns)
                if wanted or not self.book.again(host, vlan, MAC_KEY, text, _ETHERNET, frame, time_ns):
                    found.append(Fact(host, "", MAC, text, _ETHERNET, number, [frame], time_ns, vlan))
        return self._noted(found, vlan) if found else found

    def _mac_text(self, mac: bytes) -> str:
        text = self._macs.get(mac)
        if text is None:
            if len(self._macs) >= MAX_STATIONS:
                self._macs.clear()
            text = self._macs[mac] = mac.hex(":")
        return text

    def take(self, transaction: Transaction) -> list[Fact]:
        """Take the facts of an S7comm userdata transaction."""
        return self._noted(self._evidence.of_transaction(transaction), int(transaction.connection.tcp.vlan))

    def joined(self, operation: Operation) -> list[Fact]:
        """Take the facts from an answer in several parts that is complete."""
        return self._noted(self._evidence.of_operation(operation), int(operation.connection.tcp.vlan))

    def identified(self, identity: Identity, transaction: Transaction, wanted: bool = True) -> list[Fact]:
        """Take what a CPU stated about itself in S7comm-plus. ``wanted`` as for `opened`."""
        told = identity.told
        identity.told = []
        frames = transaction.frames
        frame = frames[-1] if frames else 0
        time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
        connection = transaction.connection
        asked_by = int(transaction.asked_by)
        host = connection.tcp.ends[1 - asked_by].host
        module = module_asked(connection, asked_by)
        number, vlan = int(connection.number), int(connection.tcp.vlan)
        found: list[Fact] = []
        for key, value, where in told:
            # after a new value all are noted in their order
            if wanted or found or not self.book.again(host, vlan, (module, key), value, where, frame, time_ns):
                found.append(Fact(host, module, key, value, where, number, frames, time_ns))
        return self._noted(found, vlan) if found else found

    def _noted(self, found: list[Fact], vlan: int) -> list[Fact]:
        for fact in found:
            fact.vlan = vlan
            self.book.note(fact)
            if fact.key in LASTING and (fact.before or fact.after):
                self._contradicts(fact, within(fact.host, vlan))
        return found

    def _contradicts(self, fact: Fact, where: str) -> None:
        slug = _SLUGS[fact.key]
        if self._reporter.wants(slug, fact.connection, fact.frames[0], fact.frames[-1], fact.time_ns):
            where = f"{where}, {fact.module}" if fact.module else where
            other = f"before {printable(fact.before)}" if fact.before else f"later {printable(fact.after)}"
            detail = f"{where}: {KEYS[fact.key]} {printable(fact.value)}, {other} ({fact.source})"
            self._reporter.detail(slug, fact.connection, list(fact.frames), fact.time_ns, detail)
