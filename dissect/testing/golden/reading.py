"""Reads a session from a capture or a golden."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final

from mypy_extensions import i64, mypyc_attr

from dissect.engine.exchange import PayloadDecoder
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.ending import OPEN
from dissect.engine.transactions.transaction import Transaction as Seen
from dissect.files.session import Reading
from dissect.packets.source.packet import CaptureError
from dissect.protocols.ibh.tables import IBH_NETLINK
from dissect.protocols.iso.tables import CC, DR, ER
from dissect.protocols.iso.tpkt import HEADER
from dissect.testing.golden.exchange import PLUS, S7, SCD, Exchange
from dissect.testing.golden.model import GoldenError, Link, Session, Span, Tpdus, Transaction
from dissect.testing.golden.order import settle_places
from dissect.testing.golden.parsing import MAGIC, MAX_LINE, read_golden
from dissect.testing.golden.scd_lines import scd_lines
from dissect.testing.golden.writing import link_lines

if TYPE_CHECKING:
    from dissect.engine.transactions.side import Side
    from dissect.meaning.select import Where
    from dissect.protocols.iso.tsap import Tsap

#: Maximum size of a golden; a larger one is refused.
MAX_SIZE: Final = 1 << 30


class _Entry:
    """A transaction with its first packet and its number, which determine the order."""

    __slots__ = ("asked_by", "has_request", "place", "transaction")

    def __init__(self, seen: Seen, transaction: Transaction) -> None:
        self.asked_by: int = seen.asked_by
        self.has_request = bool(seen.request_frame)
        self.place: tuple[int, int] = (seen.request_frame or seen.response_frame, seen.number)
        self.transaction = transaction


class _SortKey:
    """Sort key of a connection: its text, produced only as far as a comparison needs."""

    def __init__(self, link: Link) -> None:
        self._addresses = link.addresses
        self._written: list[str] = []
        self._left = link_lines(link)

    def line(self, at: int) -> str | None:
        """Return a line, None after the last one; lines are requested in ascending order."""
        if at == len(self._written):
            line = next(self._left, None)
            if line is None:
                return None
            self._written.append(line)
        return self._written[at]

    def __lt__(self, other: _SortKey) -> bool:
        at = 0
        while (line := self.line(at)) == (its := other.line(at)):
            if line is None:
                return self._addresses < other._addresses
            at += 1
        return line is None or (its is not None and line < its)


def content_order(links: list[Link]) -> list[Link]:
    """Return connections in the order of their texts; those with equal texts in the order of their addresses."""
    return sorted(links, key=_SortKey)


@mypyc_attr(allow_interpreted_subclasses=True)
class SessionReader(Observer):
    """Gathers the results of a pipeline; `finish` returns the session.

    ``messages`` also keeps what a golden leaves out: PDUs with their references, and the TPDUs around them (`Tpdus`).
    ``too_long`` is the reason why gathering stopped, None as long as it continues: an exception inside a pipeline would only be
    reported as the fault of an observer.
    """

    def __init__(self, name: str = "", messages: bool = False) -> None:
        super().__init__()
        self.wants_tpdus = messages
        self.too_long: GoldenError | None = None
        self._session = Session(name)
        self._links: dict[int, Link] = {}
        self._entries: dict[int, list[_Entry]] = {}
        self._confirmed: dict[int, bytes] = {}  # by connection
        self._farewells: dict[tuple[int, int], bytes] = {}  # by connection and side

    def _link(self, connection: Connection) -> Link:
        number = connection.number
        link = self._links.get(number)
        if link is None:
            link = Link()
            self._links[number] = link
            self._entries[number] = []
        return link

    def connection_opened(self, connection: Connection) -> None:
        """Make an entry for the connection: it may end without a transaction."""
        self._link(connection)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Keep the answer to the connect request, and the last TPDU that may end the connection."""
        kind = octets[HEADER + 1] >> 4
        if kind not in {CC, DR, ER}:
            return
        connection = side.connection
        number = int(connection.number)
        self._link(connection)
        if not self._entries[number] and connection.role(side.index) == "server":
            self._confirmed.setdefault(number, octets[HEADER:])
        if kind != CC:
            self._farewells[number, int(side.index)] = octets[HEADER:]

    def transaction(self, transaction: Seen) -> None:
        """Keep a transaction, without the octets around its PDUs."""
        if self.too_long is not None:
            return
        connection = transaction.connection
        link = self._link(connection)
        try:
            exchange = self._session.share(_exchange(transaction))
            kept = Transaction(link, "", exchange, transaction.outcome, transaction.reason)
            kept.certainty, kept.doubt = transaction.certainty, transaction.doubt
            if self.wants_tpdus and exchange.kind != SCD:
                request, response = transaction.request_octets, transaction.response_octets
                kept.recorded = (self._session.keep(request), self._session.keep(response))
        except GoldenError as error:
            self.too_long = error
            return
        asked_at, told_at = transaction.request_frame, transaction.response_frame
        kept.time_ns = transaction.request_ns if asked_at else transaction.response_ns
        kept.latency_ns = transaction.latency_ns
        kept.frame = asked_at or told_at
        kept.last_frame = told_at or asked_at
        if exchange.kind != SCD:
            kept.pdu_ref = transaction.pdu_ref
        self._entries[connection.number].append(_Entry(transaction, kept))

    def connection_closed(self, connection: Connection) -> None:
        """Order the transactions and keep the facts of the connection, which are complete now."""
        link = self._link(connection)
        link.protocol = connection.protocol
        link.carrier = "udp" if connection.udp else "ibh" if connection.protocol == IBH_NETLINK else "tcp"
        link.begun = not connection.udp and (connection.cr_seen or connection.tcp.known_start)
        link.calling = _octets(connection.tsap_calling)
        link.called = _octets(connection.tsap_called)
        link.addresses = (str(connection.client), str(connection.server))
        link.tpdu_size = int(connection.tpdu_size)
        link.tpdu_size_asked = int(connection.tpdu_size_asked)
        link.refused = _by_role(connection.refused, connection)
        ending = connection.ending
        if ending is not None and ending.how != OPEN:
            link.ended = ending.how
            link.ended_by = connection.role(ending.side) if ending.side >= 0 else ""
            link.farewell = _by_role(connection.iso_ended, connection)
        link.span = _span(connection)
        number = int(connection.number)
        if self.wants_tpdus:
            ended_by = int(ending.side) if ending is not None else -1
            link.tpdus = Tpdus(
                connection.cr_seen,
                self._confirmed.pop(number, b""),
                self._farewells.get((number, ended_by), b""),
                int(connection.pdu_length),
            )
            for side in (0, 1):
                self._farewells.pop((number, side), None)
        entries = self._entries.pop(number, [])
        settle_places(entries)
        entries.sort(key=lambda entry: entry.place)
        for entry in entries:  # only now: the client may have been identified after the first request
            entry.transaction.asked_by = connection.role(entry.asked_by)
            entry.transaction.place = entry.place[0]
        link.transactions = [entry.transaction for entry in entries]

    def finish(self, damage: Sequence[str] = ()) -> Session:
        """Return the session; the order of its connections depends only on their contents.

        Raises GoldenError if the session is too long to be kept.
        """
        if self.too_long is not None:
            raise self.too_long
        session = self._session
        session.damage = list(damage)
        links = [link for link in self._links.values() if link.protocol or link.begun or link.transactions]
        session.arrange(content_order(links))
        return session


def _span(connection: Connection) -> Span:
    tcp, ending = connection.tcp, connection.ending
    last = (int(tcp.last_frame), int(tcp.last_ns))
    if ending is not None and ending.how != OPEN and ending.frame:
        last = (int(ending.frame), int(ending.time_ns))
    return Span(int(connection.number), int(tcp.first_frame), int(tcp.first_ns), *last)


def _by_role(text: str, connection: Connection) -> str:
    """Return a text of a connection with roles instead of addresses and ports."""
    for end, role in ((connection.client, "client"), (connection.server, "server")):
        text = text.replace(str(end), f"the {role}")
    return text


def _octets(tsap: Tsap | None) -> bytes | None:
    return tsap.octets if tsap is not None else None


def _exchange(seen: Seen) -> Exchange:
    scd = scd_lines(seen)
    if seen.is_scd:
        return Exchange(SCD, b"", b"", scd, (bool(seen.request_frame), bool(seen.response_frame)))
    subscribed = seen.subscribed.request if seen.subscribed is not None else b""
    return Exchange(PLUS if seen.is_plus else S7, seen.request_octets, seen.response_octets, scd, subscribed=subscribed)


def is_golden(path: str | os.PathLike[str]) -> bool:
    """Return whether a file begins like a golden; False if it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC.encode()
    except OSError:
        return False


def load_golden(path: str | os.PathLike[str]) -> Session:
    """Read a golden. Raises GoldenError, which names file and line."""
    name = os.fspath(path)
    try:
        with Path(path).open("rb") as file:
            return read_golden(_text_lines(file, name), name)
    except OSError as error:
        raise GoldenError(f"{path}: {error.strerror}") from None


def _text_lines(file: BinaryIO, name: str) -> Iterator[str]:
    """Yield the lines of a golden without their ends, one at a time. Raises GoldenError for any other file."""
    size = 0
    while octets := file.readline(MAX_LINE + 1):
        size += len(octets)
        if size > MAX_SIZE:
            raise GoldenError(f"{name}: larger than {MAX_SIZE >> 20} MiB: not a golden")
        if len(octets) > MAX_LINE:
            raise GoldenError(f"{name}: a line is longer than {MAX_LINE >> 10} KiB: not a golden")
        if b"\0" in octets:
            raise GoldenError(f"{name}: byte {size - len(octets) + octets.index(0)} is NUL: not a golden")
        try:
            yield octets.decode("utf-8").removesuffix("\n")
        except UnicodeDecodeError as error:
            raise GoldenError(f"{name}: byte {size - len(octets) + error.start} is not UTF-8") from None


def read_session(
    path: str | os.PathLike[str],
    *more: str | os.PathLike[str],
    decoder: PayloadDecoder | None = None,
    messages: bool = False,
    where: str | Where | None = None,
) -> Session:
    """Return the session of a capture (or of several, as `dissect.open` reads them) or of a golden; the content decides.

    ``decoder`` decodes SCD (`dissect.meaning.bindings.load_carrier`); ``messages`` as for `SessionReader`. ``where`` selects
    transactions of a capture (docs/select.md).

    Raises `CaptureError` for a file that is no capture, GoldenError for a wrong golden or a session that is too long,
    `SelectError` for a wrong expression, and ValueError for an expression together with a golden. ``damage`` lists damage
    inside a capture.
    """
    if not more and os.fspath(path) != "-" and Path(path).is_file() and is_golden(path):
        if where is not None:
            raise ValueError(f"{os.fspath(path)} is a golden: where works only for captures")
        return load_golden(path)
    reader = SessionReader(os.fspath(path), messages)
    run = Reading([os.fspath(one) for one in (path, *more)], Options(decoder=decoder), where).run(reader)
    while run.step() and reader.too_long is None:
        pass
    run.finish()
    return reader.finish([f"{file.name}: {file.loss}" for file in run.files if file.loss])


__all__ = ["CaptureError", "SessionReader", "is_golden", "load_golden", "read_session"]
