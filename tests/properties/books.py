"""The engine's results for packets, as plain values to compare, and the accounts that it must keep."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from tests.properties.packets import Packet
from tests.properties.traffic import Conversation

#: A transaction by content: side, function, reference, octets of both PDUs, outcome, items with codes and values, errors.
Facts = tuple[object, ...]


class Record(Observer):
    """Remembers everything that is reported."""

    def __init__(self) -> None:
        super().__init__()
        self.transactions: list[Transaction] = []
        self.findings: list[Finding] = []
        self.opened: list[Connection] = []
        self.closed: list[Connection] = []

    def connection_opened(self, connection: Connection) -> None:
        self.opened.append(connection)

    def connection_closed(self, connection: Connection) -> None:
        self.closed.append(connection)

    def transaction(self, transaction: Transaction) -> None:
        self.transactions.append(transaction)

    def finding(self, finding: Finding) -> None:
        self.findings.append(finding)


class Result:
    """A pipeline after some packets, with the record of its reports."""

    def __init__(
        self,
        packets: Iterable[Packet],
        options: Options | None = None,
        *,
        finish: bool = True,
        record: Record | None = None,
    ) -> None:
        self.record = record if record is not None else Record()
        self.pipeline = Pipeline(self.record, options if options is not None else Options(strict=True))
        for packet in packets:
            self.feed(packet)
        self.before_the_end = len(self.record.transactions)
        if finish:
            self.pipeline.finish()

    def feed(self, packet: Packet) -> None:
        """Give one packet to the pipeline."""
        self.pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)

    @property
    def transactions(self) -> list[Transaction]:
        """Every reported transaction, in order."""
        return self.record.transactions

    @property
    def counts(self) -> dict[str, int]:
        """The findings by slug."""
        return self.pipeline.finding_counts

    @property
    def packets(self) -> dict[str, int]:
        """The treatment of the packets, without the empty categories."""
        return {name: count for name, count in self.pipeline.counters.packet_counts().items() if count}

    @property
    def outcomes(self) -> list[str]:
        """The outcome of each transaction, in order."""
        return [transaction.outcome for transaction in self.transactions]

    def details(self, slug: str) -> list[str]:
        """Return the details of the findings of one kind."""
        return [finding.detail for finding in self.record.findings if finding.slug == slug]


def check_books(pipeline: Pipeline, record: Record | None = None) -> None:
    """Check the accounts of a finished pipeline: every packet, octet, PDU and connection is reported exactly once.

    Without ``record`` our bugs may have occurred; then their octets are accounted for as such.
    """
    counts = pipeline.counters.packet_counts()
    assert sum(counts.values()) == pipeline.frames, counts
    assert min(counts.values()) >= 0, counts
    octets = pipeline.counters.octets
    assert octets.delivered == octets.framed + octets.skipped + octets.buffered + octets.failed
    assert octets.failed == 0 or (record is None and "internal.bug" in pipeline.finding_counts)
    assert min(octets.as_dict().values()) >= 0, octets.as_dict()
    assert pipeline.iso.tsdus.counts()[0] == pipeline.s7.pdus == sum(pipeline.s7.rosctrs.counts())
    if record is None:
        return
    halves = sum([bool(one.request_frame) + bool(one.response_frame) for one in record.transactions])
    behind = pipeline.s7.behind_malformed + pipeline.plus.behind_malformed
    assert halves + pipeline.s7.unpaired + pipeline.plus.unpaired == pipeline.s7.pdus + pipeline.plus.pdus + behind
    assert len({one.number for one in record.transactions}) == len(record.transactions)
    assert sorted([one.number for one in record.opened]) == sorted([one.number for one in record.closed])
    for finding in record.findings:
        assert finding.slug in pipeline.finding_counts or finding.because
        assert all([0 < frame <= pipeline.frames for frame in finding.frames])


def facts(transaction: Transaction) -> Facts:
    """Return the content of a transaction, without what depends on packets: frames, times and numbers."""
    connection = transaction.connection
    ends = connection.tcp.ends
    asker = ends[transaction.asked_by]
    results = [
        (
            result.item.octets if result.item is not None else b"",
            result.item.address if result.item is not None else "",
            result.return_code,
            result.data,
            repr(result.value),
        )
        for result in transaction.s7_results
    ]
    errors = [(error.where, error.code, error.address) for error in transaction.errors]
    return (
        str(asker),
        str(ends[1 - transaction.asked_by]),
        transaction.function,
        transaction.function_name,
        transaction.pdu_ref,
        transaction.request_octets,
        transaction.response_octets,
        transaction.outcome,
        tuple(results),
        tuple(errors),
    )


def by_connection(transactions: Iterable[Transaction]) -> dict[str, list[Facts]]:
    """Return the facts of transactions in order, separately for each connection."""
    found: dict[str, list[Facts]] = {}
    for transaction in transactions:
        first, second = transaction.connection.tcp.ends
        found.setdefault(" ".join(sorted((str(first), str(second)))), []).append(facts(transaction))
    return found


def sorted_by_connection(transactions: Iterable[Transaction]) -> dict[str, list[Facts]]:
    """Return the facts of transactions in an order that depends only on themselves."""
    return {name: sorted(told, key=repr) for name, told in by_connection(transactions).items()}


#: A transaction as its conversation knows it: side, reference, octets of both PDUs, outcome.
Known = tuple[str, int, bytes, bytes, str]


def told(transactions: Iterable[Transaction]) -> list[Known]:
    """Return transactions in the form of `true`, sorted."""
    return sorted(
        [
            (
                str(one.connection.tcp.ends[one.asked_by]),
                int(one.pdu_ref),
                one.request_octets,
                one.response_octets,
                one.outcome,
            )
            for one in transactions
        ]
    )


def true(conversations: Sequence[Conversation]) -> list[Known]:
    """Return the deals of conversations as they were made, sorted."""
    known = []
    for made in conversations:
        for deal in made.deals:
            address, port = made.flow.addresses[deal.asked_by], made.flow.ports[deal.asked_by]
            asker = f"[{address}]:{port}" if address.version == 6 else f"{address}:{port}"
            known.append((asker, deal.ref, deal.request, deal.response, deal.outcome))
    return sorted(known)
