"""Makes the rows of the tables of a report: a transaction, operation or connection, with commands that show it."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

from dissect.engine.program.carved import CarvedBlock
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import ANSWERED, PUSH, Transaction
from dissect.meaning.report import endings, facets, words
from dissect.meaning.report.certainty import mark
from dissect.meaning.report.operations import NAMES as KINDS
from dissect.meaning.report.operations import result as result_of
from dissect.meaning.report.words import Places
from dissect.packets.tcp.link import vlan_ids, within
from dissect.packets.tcp.stream import Endpoint
from dissect.wire.text import Clock, encodable, printable, shortened

#: Greatest number of characters of a cell.
_CELL: Final = 240
#: Maximum number of characters that the names of all files may have in a command.
_NAMES: Final = 160
#: Maximum number of characters of the options in a command.
_OPTIONS: Final = 240
#: Options for the transport of SCD, and commands without them.
SCD_OPTIONS: Final = ("--scd", "--bind")
_NO_SCD: Final = frozenset(("devices", "operations"))
#: Maximum number of packets that a Wireshark filter names.
_FRAMES: Final = 20


#: A machine: its address and its VLAN (`vlan_ids`), because identical machines use the same addresses in different VLANs.
Station: TypeAlias = tuple[str, int]


def station_of(connection: Connection, side: int = -1) -> Station:
    """Return the machine at a side of a connection, by default the server."""
    end = connection.server if side < 0 else connection.tcp.ends[side]
    return str(end.host), int(connection.tcp.vlan)


def selecting(field: str, station: Station) -> str:
    """Return the expression for ``-Y`` that selects things whose ``field`` is the address of a machine, in its VLAN."""
    host, vlan = station
    return " and ".join([f"{field} == {host}", *[f"vlan == {number}" for number in vlan_ids(vlan)]])


def host_filter(*hosts: str) -> str:
    """Return the Wireshark display filter for the traffic between these hosts."""
    return " && ".join([f"{_family(host)}.addr == {host}" for host in dict.fromkeys(hosts)])


def _family(host: str) -> str:
    return "ipv6" if ":" in host else "ip"


def _typed(options: Sequence[tuple[str, str]]) -> str:
    """Return options as they follow a command; if they are too long, only their names, which the reader must complete."""
    full = "".join([f" {name} {shlex.quote(printable(value))}" if value else f" {name}" for name, value in options])
    return (
        full if len(full) <= _OPTIONS else "".join([f" {name} …" if value else f" {name}" for name, value in options])
    )


#: Options whose value is a path, or HOST=PATH.
_PATHS: Final = frozenset(("--scd", "--bind", "--tags", "--tls-keys", "--config"))


def base_name(path: str) -> str:
    """Return the name of a file without its folder.

    An address such as https://host/name stays, because a name alone would open nothing.
    """
    return path if "://" in path else path.rpartition("/")[2].rpartition(os.sep)[2]


def base_names(paths: Sequence[str]) -> list[str]:
    """Return the names of files without their folders; unchanged if two would be equal."""
    names = [base_name(path) for path in paths]
    return names if len(set(names)) == len(set(paths)) else list(paths)


def _without_folder(option: tuple[str, str]) -> tuple[str, str]:
    name, value = option
    if name not in _PATHS:
        return option
    host, equals, path = value.partition("=")
    return (name, f"{host}={base_name(path)}") if equals and "/" not in host else (name, base_name(value))


class Rows:
    """Makes rows. ``files`` are the inputs as the user named them, empty for a live run; ``hosts`` are names by address.

    ``options`` are those of `s7dissect` that determine how the files are read, as they were typed; commands on a file repeat
    them. Files are named without their folder unless ``full_paths``, because a report is given to others. ``places`` names
    packets; it is set once the files are known, before the first packet.
    """

    def __init__(
        self,
        files: list[str],
        clock: Clock,
        hosts: Mapping[str, str],
        options: Sequence[tuple[str, str]] = (),
        full_paths: bool = False,
    ) -> None:
        typed = [printable(name) for name in files]
        self._files = typed if full_paths else base_names(typed)
        self._number = {name: number for number, name in enumerate(typed)}
        renamed = {name: short for name, short in zip(typed, self._files, strict=True) if name != short}
        self._renamed = renamed
        longest = sorted(renamed, key=len, reverse=True)
        self._in_text = re.compile("|".join([re.escape(name) for name in longest])) if renamed else None
        self.places = Places([], len(files) > 1, hosts)
        self.clock = clock
        self._hosts = hosts
        if not full_paths:
            options = [_without_folder(option) for option in options]
        self._options = _typed(options)
        self._without_scd = _typed([one for one in options if one[0] not in SCD_OPTIONS])

    def short(self, text: str) -> str:
        """Return a text in which files are named as in the rest of the report."""
        return self._in_text.sub(lambda found: self._renamed[found[0]], text) if self._in_text is not None else text

    def host(self, address: str) -> str:
        """Return the name of a host from the settings, else its address; escaped."""
        return printable(self._hosts.get(address, address))

    def station(self, station: Station) -> str:
        """Return the name or address of a machine as `host` does, and its VLAN."""
        return within(self.host(station[0]), station[1])

    def searched(self, client: str, server: str, vlan: int) -> str:
        """Return the search text for the connections of two machines; the colon keeps 10.0.0.1: from matching 10.0.0.10:."""
        named = [(host, self.host(host)) for host in (client, server)]
        found = " ".join([f"{name}]:" if name == host and ":" in host else f"{name}:" for host, name in named])
        return within(found, vlan)

    def talk(self, connection: Connection, asked_by: int) -> str:
        """Return who sends requests to whom on a connection, and their VLAN."""
        ends = connection.tcp.ends
        return within(f"{self.host(ends[asked_by].host)} → {self.host(ends[1 - asked_by].host)}", connection.tcp.vlan)

    def end(self, end: Endpoint) -> str:
        """Return an end of a connection, with the name of its host."""
        return self.places.end(end)

    # ---- how to see it elsewhere ------------------------------------------------------------------------------------

    def commands(self) -> dict[str, Any]:
        """Return the parts of a command after ``s7dissect`` and a row's ``show``: the page writes them once, not in each row.

        ``all`` are all files, ``files`` each of them, for a row with a packet of file number ``in``; ``bare`` are the options
        of the commands ``without``, which do not decode SCD. Empty without files.
        """
        quoted = [shlex.quote(name) for name in self._files]
        names = " ".join(quoted)
        return {
            "options": self._options,
            "bare": self._without_scd,
            "without": sorted(_NO_SCD),
            "all": names if len(names) <= _NAMES else "FILE…",
            "files": quoted if self.places.several else [],
        }

    def how(self, what: str, frame: int = 0, display: str = "") -> dict[str, Any]:
        """Return how to see a row: the command for the file with packet ``frame`` (0: for all), and the Wireshark filter."""
        found: dict[str, Any] = {"show": what if self._files else "", "filter": display}
        if frame and self.places.several and self._files:
            name, number = self.places.locate(frame)
            found["show"] = what.replace(f"--frame {frame}", f"--frame {number}")
            found["in"] = self._number.get(printable(name), 0)
        return found

    def packets(self, frames: list[int]) -> dict[str, Any]:
        """Return the way to see packets, as in `how`; empty texts for none."""
        known = sorted({frame for frame in frames if frame})
        if not known or not self._files:
            return {"show": "", "filter": ""}
        shown = " || ".join([f"frame.number == {self.places.number(frame)}" for frame in known[:_FRAMES]])
        return self.how(f"show -V --frame {known[0]}", known[0], shown)

    # ---- rows -------------------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> dict[str, Any]:
        """Return the row of a transaction."""
        frames = [int(transaction.request_frame), int(transaction.response_frame)]
        said = [facets.outcome(transaction), facets.gist(transaction), mark(transaction)]
        return {
            "key": f"t{transaction.number}",
            "cells": [
                int(transaction.number),
                time_of(transaction),
                self.short(self.places.pair(*frames)),
                self.talk(transaction.connection, transaction.asked_by),
                transaction.latency_ns,
                transaction.function_name,
                shortened("; ".join([part for part in said if part]), _CELL),
            ],
            **self.packets(frames),
        }

    def operation(self, operation: Operation) -> dict[str, Any]:
        """Return the row of an operation."""
        return {
            "key": f"o{operation.number}",
            "cells": [
                operation.number,
                operation.begin_ns,
                operation.duration_ns,
                KINDS[operation.kind],
                shortened(operation.subject, _CELL),
                self.talk(operation.connection, operation.asked_by),
                operation.octets or None,
                result_of(operation),
            ],
            **self._carrying(operation),
        }

    def block(self, block: CarvedBlock, operation: Operation, number: int) -> dict[str, Any]:
        """Return the row of a block that was loaded or read out; it may be incomplete."""
        texts = (block.label, block.name, block.language, block.author, block.version, block.code_time)
        label, name, language, author, version, changed = [shortened(text, _CELL) for text in texts]
        return {
            "key": f"b{number}",
            "cells": [
                label,
                name,
                operation.begin_ns,
                operation.kind,
                self.talk(operation.connection, operation.asked_by),
                len(block.octets),
                "complete" if block.complete else f"incomplete: {shortened(block.missing, _CELL)}",
                language,
                author,
                version,
                changed,
            ],
            **self._carrying(operation),
        }

    def _carrying(self, operation: Operation) -> dict[str, Any]:
        """Return the command that shows an operation, and the Wireshark filter for its first and its last packet.

        The command is not `show`, because the first packet may not complete a message.
        """
        display = self.packets([operation.first_frame, operation.last_frame])["filter"]
        return self.how(f"operations -Y 'number == {operation.number}'", 0, display)

    def connection(self, connection: Connection, worst: str) -> dict[str, Any]:
        """Return the row of a connection; ``worst`` is the severity of the gravest finding on it, empty for none."""
        client, server = connection.client, connection.server
        port = "udp.port" if connection.udp else "tcp.port"
        calling, called = connection.tsap_calling, connection.tsap_called
        said = words.tsaps(calling, called, connection.protocol) if calling is not None or called is not None else ""
        return {
            "key": f"c{connection.number}",
            "cells": [
                int(connection.number),
                int(connection.tcp.first_ns),
                self.end(client),
                within(self.end(server), connection.tcp.vlan),
                words.named(connection),
                said,
                int(connection.pdus),
                int(connection.answered),
                int(connection.errors),
                int(connection.missed),
                int(connection.still_open),
                octets_of(connection),
                self.short(connection.refused)
                or (self.short(endings.phrase(connection, self.places)) if connection.ending is not None else "open"),
                worst,
            ],
            "until": int(connection.last_ns),
            **self.how(
                f"{'transactions' if _asks(connection) else 'show'} --connection {connection.number}",
                0,
                f"{host_filter(client.host, server.host)} && {port} == {client.port} && {port} == {server.port}",
            ),
        }


def octets_of(connection: Connection) -> int:
    """Return the number of captured bytes that both sides of a connection sent."""
    return sum([int(stream.octets) for stream in connection.tcp.streams])


def _asks(connection: Connection) -> bool:
    """Return whether a connection has transactions; it may have only other messages."""
    return bool(connection.answered or connection.unanswered or connection.orphans or connection.unsolicited)


def time_of(transaction: Transaction) -> int:
    """Return the time of a transaction's request or, without one, of its answer or push."""
    return int(transaction.request_ns if transaction.request_frame else transaction.response_ns)


# Outcomes of a transaction in the plots.
OK: Final = 0
ERROR: Final = 1
MISSED: Final = 2
PUSHED: Final = 3
OTHER: Final = 4
#: Their names.
OUTCOME_NAMES: Final = ("answered", "with errors", "no answer", "push", "still open, or half of it not captured")


def outcome_of(transaction: Transaction) -> int:
    """Return the outcome of a transaction: one of the numbers above."""
    if transaction.has_errors:
        return ERROR
    outcome = transaction._outcome
    if outcome == ANSWERED:
        return OK
    if outcome == PUSH:
        return PUSHED
    return MISSED if transaction.missed else OTHER


def file_title(files: list[str]) -> str:
    """Return the names of files for the title of a report."""
    names = [encodable(base_name(name)) for name in files]
    return printable(names[0]) if len(names) == 1 else f"{printable(names[0])} and {len(names) - 1} more"
