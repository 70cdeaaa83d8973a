"""Which connections were open when another one was refused: a CPU has few of them, and some clients never close theirs."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.table import ConnectionTable
from dissect.packets.tcp.stream import Endpoint
from dissect.wire.text import count

#: A client with this many connections or more probably does not close them: small CPUs do not have more.
PILED_UP: Final = 8


def beside(table: ConnectionTable, connection: Connection) -> str:
    """Return how many other connections to the server of ``connection`` are open, as text for a finding."""
    return open_to(table, connection.client, connection.server, connection.tcp.vlan)


def open_to(table: ConnectionTable, client: Endpoint, server: Endpoint, vlan: i64) -> str:
    """Return how many connections to a server are open, from a client and in all, as text for a finding; empty for none.

    This examines each connection of the table, so call it only for detailed findings.
    """
    of_client: i64 = 0
    of_all: i64 = 0
    for side in table.all_open():
        connection = side.connection
        tcp = side.tcp
        if tcp.closed or not connection.established or tcp.vlan != vlan:
            continue
        end = connection.server
        if end.port == server.port and end.address == server.address:
            of_all += 1
            if connection.client.address == client.address:
                of_client += 1
    if of_all == 0:
        return ""
    said = f"; {_were(of_client, client.host)} open to it" if of_client else ""
    if of_all > of_client:
        said += f", {of_all} of all clients" if of_client else f"; {_were(of_all, 'other clients')} open to it"
    if of_client >= PILED_UP:
        said += KNOWN_BUGS["piled_up"].note
    return said


def _were(number: i64, whose: str) -> str:
    return f"{count(int(number), 'connection')} of {whose} {'was' if number == 1 else 'were'}"
