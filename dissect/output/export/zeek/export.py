"""`ZeekExport`: an observer that writes the logs of a run.

By default, rows that ICSNPP loses are written, too: refusals without parameters, SZL answers in parts, S7comm-plus below
version 3. ``strict`` leaves them out, for comparisons with Zeek. A second PDU in one segment, which ICSNPP also loses, is
always written.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, Final

from dissect.engine.acts.act import Act
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import LONG_ANSWER, Operation
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.facts.keys import connection_community_id, connection_uid
from dissect.output.export.forms import Export, ExportRequest
from dissect.output.export.mapping import told
from dissect.output.export.rows import Rows
from dissect.output.export.tables import ACTS, FINDING_COUNTS
from dissect.output.export.zeek.columns import LOGS, OWN
from dissect.output.export.zeek.log import Log
from dissect.output.export.zeek.rows import IDENTIFICATION, S7, cotp_row, identification, plus_row
from dissect.protocols.s7plus.message import parse_plus

#: This many connections are remembered with their uid, device and unfinished answers.
_MOST_KNOWN: Final = 16_384
_TRUSTED_VERSION: Final = 3  # the only version of S7comm-plus that ICSNPP reads


class _Known:
    """The state of a connection: its uid, the names of its device, and data units whose first part was seen."""

    __slots__ = ("device", "parts", "uid")

    def __init__(self, uid: str) -> None:
        self.uid = uid
        self.device: dict[int, str] = {}
        self.parts: set[int] = set()


class ZeekExport(Export, Observer):
    """Writes the logs into a folder."""

    def __init__(self, request: ExportRequest, as_json: bool) -> None:
        Observer.__init__(self)
        self.observer = self
        self.wants_pdus = True
        self.wants_tpdus = True
        names = request.parts or tuple(LOGS)
        self._strict = bool(request.options.get("strict"))
        self._logs = {name: Log(request.path, name, as_json) for name in LOGS if name in names}
        self._known: OrderedDict[int, _Known] = OrderedDict()
        self._run: Run | None = None
        self._made = Rows([])
        self._rows = self._made.transactions

    @property
    def counts(self) -> Mapping[str, int]:
        """The number of rows of each log."""
        return {name: log.rows for name, log in self._logs.items()}

    def begin(self, run: Run) -> None:
        """Set the files of the run, by which packets are named."""
        self._run = run
        self._made = Rows(run.files)
        self._rows = self._made.transactions

    def flush(self) -> None:
        """Do nothing: rows are written as they come."""

    def close(self) -> None:
        """Write the facts that are known at the end and the last lines of the logs, and close the logs."""
        if self._run is not None:
            self._count_findings(self._run.pipeline)
        for log in self._logs.values():
            log.close()

    def abandon(self) -> None:
        """Close the logs, which will be deleted."""
        for log in self._logs.values():
            log.abandon()

    # ---- as an observer ---------------------------------------------------------------------------------------------

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Log a TPDU."""
        row = cotp_row(octets)
        if row is not None:
            self._log("cotp", int(time_ns), side.connection, int(side.index), row)

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Log an S7 PDU in s7comm.log, and in the log for its function if there is one."""
        pdu = S7(octets)
        connection, index = side.connection, int(side.index)
        from_server = index != connection.client_side
        if self._strict and (
            (pdu.rosctr == 2 and not pdu.parameters) or (pdu.is_szl and not pdu.szl_bounded(from_server))
        ):
            return
        at = (int(time_ns), connection, index)
        self._log("s7comm", *at, pdu.row())
        if pdu.is_szl and self._begins_szl(pdu, connection):
            self._log("s7comm_read_szl", *at, pdu.szl_row())
            if from_server:
                self._of(connection).device.update(identification(pdu.data[4:]))
        if pdu.is_transfer:
            self._log("s7comm_upload_download", *at, pdu.transfer_row())

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Log an S7comm-plus PDU."""
        connection = side.connection
        pdu = parse_plus(octets, int(frame), int(time_ns), int(connection.number), int(side.index), cut)
        row = plus_row(pdu)
        if row is not None and (not self._strict or pdu.version == _TRUSTED_VERSION):
            self._log("s7comm_plus", int(time_ns), connection, int(side.index), row)

    def operation(self, operation: Operation) -> None:
        """Remember the names of a device from an SZL answer in several parts."""
        head = operation.content_head
        if self._strict or operation.kind != LONG_ANSWER or head is None or not operation.content:
            return
        if operation.content[:2] == IDENTIFICATION.to_bytes(2, "big"):
            self._of(operation.connection).device.update(identification(operation.content))

    def transaction(self, transaction: Transaction) -> None:
        """Log a transaction."""
        if "s7comm_transaction" not in self._logs:
            return
        asked = bool(transaction.request_frame)
        side = int(transaction.asked_by if asked else 1 - transaction.asked_by)
        connection = transaction.connection
        row = self._rows.row(transaction, self._made.item_count(transaction))
        function = row["function"]
        given = {
            "community_id": connection_community_id(connection),
            "function_code": f"0x{function:02x}" if function is not None else None,
            "errors": [f"{error.where}: {error.name}" for error in transaction.errors],
        }
        self._log("s7comm_transaction", row["ts_ns"], connection, side, _own("s7comm_transaction", row, given))

    def act(self, act: Act) -> None:
        """Log what a client did to a device, or tried to."""
        if "s7comm_act" not in self._logs:
            return
        row = ACTS.named(self._made.act(act))
        given = {"community_id": connection_community_id(act.connection)}
        self._log("s7comm_act", row["ts_ns"], act.connection, int(act.asked_by), _own("s7comm_act", row, given))

    def connection_closed(self, connection: Connection) -> None:
        """Log the device whose names were read on a connection."""
        known = self._known.pop(int(connection.number), None)
        log = self._logs.get("s7comm_known_devices")
        if known is None or not known.device or log is None:
            return
        names = [known.device.get(index) for index in (1, 2, 3, 5)]
        log.add([int(connection.last_ns), known.uid, *_ends(connection), *(None,) * 5, *names])

    def _count_findings(self, pipeline: Pipeline) -> None:
        """Log the facts of each rule, and of each pair of hosts between which it applied."""
        log = self._logs.get("s7comm_finding_count")
        if log is None:
            return
        counters = pipeline.counters
        for one in self._made.finding_counts(pipeline.exchange.ledger, counters.earliest_ns, counters.latest_ns):
            row = FINDING_COUNTS.named(one)
            given: dict[str, Any] = {"ts": row["ts_ns"] or 0}
            given |= {f"{side}_h": _host(row[f"{side}_host"]) for side in ("client", "server")}
            log.add(_own("s7comm_finding_count", row, given))

    # ---- rows -------------------------------------------------------------------------------------------------------

    def _log(self, name: str, time_ns: int, connection: Connection, side: int, row: tuple[Any, ...]) -> None:
        log = self._logs.get(name)
        if log is None:
            return
        ends = _ends(connection)
        is_orig = side == connection.client_side
        sent = ends if is_orig else (*ends[2:], *ends[:2])
        log.add((time_ns, self._of(connection).uid, *ends, is_orig, *sent, *row))

    def _of(self, connection: Connection) -> _Known:
        number = int(connection.number)
        found = self._known.get(number)
        if found is None:
            found = self._known[number] = _Known(connection_uid(connection))
            if len(self._known) > _MOST_KNOWN:
                self._known.popitem(last=False)
        return found

    def _begins_szl(self, pdu: S7, connection: Connection) -> bool:
        """Return whether the data of a Read SZL begins with id and index: only the first part of an answer does."""
        unit, more = pdu.unit
        if self._strict:
            return unit == 0 or more == 1
        if pdu.kind != 8 or not unit:
            return len(pdu.data) >= 8 or pdu.kind == 8
        parts = self._of(connection).parts
        first = unit not in parts
        (parts.add if more else parts.discard)(unit)
        return first


def _own(log: str, row: Mapping[str, Any], given: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple([value for _, value in told(OWN[log], row, given)])


def _host(said: str | None) -> str | None:
    """Return the address of a host, without the VLAN that may follow it."""
    return said.partition(" ")[0] if said is not None else None


def _ends(connection: Connection) -> tuple[str, int, str, int]:
    client, server = connection.client, connection.server
    return client.host, client.port, server.host, server.port


def tsv_export(request: ExportRequest) -> Export:
    """Return an export to logs as tab-separated values."""
    return ZeekExport(request, as_json=False)


def json_export(request: ExportRequest) -> Export:
    """Return an export to logs as JSON lines."""
    return ZeekExport(request, as_json=True)
