"""Things for selections: the contents of a few captures of the repository, read once."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.bindings import load_carrier
from dissect.meaning.select.things import CONNECTION, FINDING, MESSAGE, OPERATION, TRANSACTION, Context, Found, Message

CAPTURES: Final = Path(__file__).resolve().parents[3] / "captures"
ERRORS: Final = str(CAPTURES / "item-errors.pcapng")
#: Reads, writes, refusals, missing answers, pairs that are only likely, transfers, SZL, cyclic services, causes, SCD.
NAMES: Final = (
    "item-errors",
    "answer-lost",
    "transfer",
    "szl",
    "many-open",
    "password",
    "read-areas",
    "crafted/causes",
    "crafted/certainty",
    "scd/plant",
)


class Gathered(Observer):
    """All results of a run, by kind."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.context = Context()
        self.things: dict[str, list[Any]] = {
            kind: [] for kind in (TRANSACTION, OPERATION, FINDING, CONNECTION, MESSAGE)
        }

    def connection_opened(self, connection: Connection) -> None:
        self.context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        self.context.closed(connection)
        self.things[CONNECTION].append(connection)

    def transaction(self, transaction: Transaction) -> None:
        self.things[TRANSACTION].append(transaction)

    def operation(self, operation: Operation) -> None:
        self.things[OPERATION].append(operation)

    def finding(self, finding: Finding) -> None:
        self.things[FINDING].append(Found(finding, self.context.connection(int(finding.connection))))

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self._message("s7comm", frame, time_ns, side, octets, cut)

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self._message("s7comm_plus", frame, time_ns, side, octets, cut)

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        self._message("scd", frame, time_ns, side, found.octets, False, found)

    def _message(
        self,
        protocol: str,
        frame: int,
        time_ns: int,
        side: Side,
        octets: bytes,
        cut: bool,
        scd: ScdMessage | None = None,
    ) -> None:
        message = Message(protocol, int(frame), int(time_ns), side.connection, int(side.index), octets, cut, scd)
        self.things[MESSAGE].append(message)


@cache
def gathered(*names: str) -> Gathered:
    """Return the contents of these captures."""
    found = Gathered()
    for name in names:
        decoder = None
        if name.startswith("scd/"):
            decoder = load_carrier(CAPTURES / "scd" / "plant.toml", CAPTURES / "scd" / "plant.bind.toml")
        run = Run([CAPTURES / f"{name}.pcapng"], found, Options(decoder=decoder))
        while run.step():
            pass
        found.context.start = lambda first_ns=int(run.pipeline.first_ns): first_ns  # type: ignore[misc]
    return found
