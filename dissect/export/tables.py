"""The tables: one definition of names, columns, types, units and meanings, for all forms of export and docs/tables.md.

A row is a tuple of the columns that are not derived, in their order; `dissect.export.rows` makes it. Times are integers,
nanoseconds since 1970 in UTC, because only integers are exact in every reader. Beside each there is a derived column with the
same time as a timestamp.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from dissect.config.hints import close_names
from dissect.facts import fact as kinds
from dissect.facts.connection import CONNECTION
from dissect.facts.counted import COUNTED
from dissect.facts.device import DEVICE
from dissect.facts.fact import Fact
from dissect.facts.finding import FINDING
from dissect.facts.operation import ACT, OPERATION
from dissect.wire.errors import Error

# Types of columns. Each form of export maps them to types of its format (docs/tables.md).
INT: Final = "integer"
REAL: Final = "real"
BOOL: Final = "boolean"
TEXT: Final = "text"
WORD: Final = "word"  # a text that repeats: dictionary-encoded if the format can do that
BYTES: Final = "bytes"
TIME: Final = "time"  # derived from the column of the same name with _ns
INTS: Final = "integers"
WORDS: Final = "words"
TYPES: Final = (INT, REAL, BOOL, TEXT, WORD, BYTES, TIME, INTS, WORDS)


class Column(NamedTuple):
    """A column: ``source`` is its fact, or says where its values come from; ``of`` is the column that it is derived from."""

    name: str
    type: str
    unit: str
    about: str
    source: str
    of: str = ""


class Table(NamedTuple):
    """A table: a row for each ``about``, in the order of completion; ``time`` is the column with the time of a row.

    ``facts`` are those that its columns and the values of a row are made of; empty where columns are written one by one.
    """

    name: str
    about: str
    columns: tuple[Column, ...]
    time: str = "ts_ns"
    facts: tuple[Fact[Any], ...] = ()

    @property
    def stored(self) -> list[Column]:
        """The columns that are not derived: a row has their values."""
        return [column for column in self.columns if not column.of]

    def named(self, row: Sequence[Any]) -> dict[str, Any]:
        """Return the values of a row by their columns."""
        return dict(zip([column.name for column in self.stored], row, strict=True))

    def position(self, name: str) -> int:
        """Return the index of a column's value in a row. Raises KeyError for an unknown column."""
        for index, column in enumerate(self.stored):
            if column.name == name:
                return index
        raise KeyError(name)


class UnknownTableError(Error, ValueError):
    """There is no table with this name."""


def _time(name: str, about: str, source: str) -> tuple[Column, Column]:
    stored = Column(f"{name}_ns", INT, "ns since 1970, UTC", about, source)
    return Column(name, TIME, "UTC", f"the same as {stored.name}, as a timestamp", source, stored.name), stored


#: The type of the column by the kind of a fact; times and ends have two columns each.
_TYPES: Final[Mapping[str, str]] = {
    kinds.COUNT: INT,
    kinds.SERIAL: INT,
    kinds.DURATION: INT,
    kinds.FLAG: BOOL,
    kinds.TEXT: TEXT,
    kinds.WORD: WORD,
    kinds.CODE: WORD,
    kinds.TSAP: TEXT,
    kinds.FRAME: INT,
    kinds.FRAMES: INTS,
    kinds.FILE: WORD,
    kinds.COUNTS: INTS,
    kinds.WORDS: WORDS,
}
#: What the numbers of packets count.
_UNITS: Final[Mapping[str, str]] = {kinds.FRAME: "packet of its file", kinds.FRAMES: "packets of their files"}


def _of_facts(name: str, about: str, facts: Mapping[str, Fact[Any]], order: tuple[str, ...]) -> Table:
    """Return a table whose columns are facts of a record, in this order."""
    chosen = tuple([facts[one] for one in order])
    return Table(name, about, tuple([column for fact in chosen for column in _columns(fact)]), facts=chosen)


def _columns(fact: Fact[Any]) -> tuple[Column, ...]:
    if fact.kind == kinds.TIME:
        return _time(fact.column, fact.about, fact.name)
    if fact.kind == kinds.END:
        return (
            Column(f"{fact.column}_host", WORD, "", fact.about, fact.name),
            Column(f"{fact.column}_port", INT, "", "Its TCP or UDP port.", fact.name),
        )
    return (Column(fact.column, _TYPES[fact.kind], fact.unit or _UNITS.get(fact.kind, ""), fact.about, fact.name),)


_FILE: Final = Column("file", WORD, "", "capture file of the (first) packet", "SourceFile.name")
_CONNECTION: Final = Column("connection", INT, "", "number of the connection, as analyze lists it", "Connection.number")
_ENDS: Final = (
    Column("client_host", WORD, "", "address of the client of the connection", "Connection.client"),
    Column("client_port", INT, "", "its TCP or UDP port", "Connection.client"),
    Column("server_host", WORD, "", "address of the server, usually the PLC", "Connection.server"),
    Column("server_port", INT, "", "its TCP or UDP port", "Connection.server"),
)

CONNECTIONS: Final = _of_facts(
    "connections",
    "transport connection, when it is over or the capture ends",
    CONNECTION,
    (
        "number", "uid", "community_id", "file", "first_frame", "last_frame", "first_time", "last_time", "client", "server",
        "client_known", "transport", "vlan", "protocol", "start", "calling_tsap", "called_tsap", "rack", "slot", "tpdu_size",
        "pdu_length", "max_amq_calling", "max_amq_called", "packets", "client_bytes", "server_bytes", "missing_bytes", "pdus",
        "answered", "unanswered", "orphan_answers", "unsolicited", "with_errors", "ended", "ended_role", "open_at_end",
    ),
)  # fmt: skip

TRANSACTIONS: Final = Table(
    "transactions",
    "request with its response, response without request, or message sent unasked",
    (
        Column("transaction", INT, "", "number of the transaction in the run", "Transaction.number"),
        _CONNECTION,
        _FILE,
        Column("request_frame", INT, "packet of its file", "packet that completed the request", "Transaction.request_frame"),
        Column("response_frame", INT, "packet of its file", "packet that completed the response", "Transaction.response_frame"),
        Column("response_file", WORD, "", "capture file of the response", "SourceFile.name"),
        *_time("ts", "time of the request, or of the response where there is no request", "Transaction.request_ns"),
        Column("response_ns", INT, "ns since 1970, UTC", "time of the response", "Transaction.response_ns"),
        Column("latency_ns", INT, "ns", "response time, null unless a pair is sure", "Transaction.latency_ns"),
        *_ENDS,
        Column("from_client", BOOL, "", "the client asked, or an unasked message went to it", "Transaction.asked_by"),
        Column("protocol", WORD, "", "s7comm, s7comm-plus or scd", "Transaction.rosctr"),
        Column("rosctr", WORD, "", "kind of the S7 PDU: Job, Userdata …", "Transaction.rosctr"),
        Column("pdu_ref", INT, "", "number that pairs request and response", "Facet.reference"),
        Column("function", INT, "", "function code", "Transaction.function"),
        Column("function_name", WORD, "", "its name; of userdata group and subfunction", "Transaction.function_name"),
        Column("userdata_group", INT, "", "function group of userdata", "UserdataHead.group"),
        Column("subfunction", INT, "", "subfunction of userdata", "UserdataHead.subfunction"),
        Column("about", TEXT, "", "what a request without items is about, for example the SZL", "Facet.subject_whole"),
        Column("outcome", WORD, "", "its outcome, such as answered or unanswered (docs/json.md)", "Transaction.outcome"),
        Column("reason", WORD, "", "why there is no answer; hole, one_sided: it was not captured", "Transaction.reason"),
        Column("certainty", WORD, "", "sure or likely: of a pair, push or answer not captured", "Transaction.certainty"),
        Column("doubt", WORD, "", "why a pair or push is only likely: gaps, or alike (docs/json.md)", "Transaction.doubt"),
        Column("failed", BOOL, "", "refused in whole or in part, or without the answer that was due", "Transaction.failed"),
        Column("error_code", INT, "", "error of header or parameter, 0 for none", "Transaction.error_code"),
        Column("errors", WORDS, "", "every error: place, name", "Transaction.errors"),
        Column("item_count", INT, "", "items of it in the table items", "Transaction.items"),
        Column("request_bytes", INT, "bytes", "size of the request PDU", "Transaction.request_size"),
        Column("response_bytes", INT, "bytes", "size of the response PDU", "Transaction.response_size"),
    ),
)

ITEMS: Final = Table(
    "items",
    "item of a read, write, subscription or test function, with what became of it",
    (
        Column("transaction", INT, "", "number of the transaction", "Transaction.number"),
        Column("item", INT, "", "number of the item, from 1", "Transaction.items"),
        _CONNECTION,
        *_time("ts", "time of the request, or of the message sent unasked", "Transaction.request_ns"),
        Column("server_host", WORD, "", "address of the server, usually the PLC", "Connection.server"),
        Column("client_host", WORD, "", "address of the client", "Connection.client"),
        Column("operation", WORD, "", "read, write, or notify for what is sent unasked", "Transaction.function"),
        Column("certainty", WORD, "", "that of the transaction: sure or likely", "Transaction.certainty"),
        Column("name", WORD, "", "tags in the item, with --tags, or the variable's name", "Naming.named"),
        Column("area", WORD, "", "area: DB, M, I, Q …", "Item.area"),
        Column("db", INT, "", "number of the data block", "Item.db"),
        Column("byte", INT, "", "byte address; of timers and counters their number", "Item.start_bit"),
        Column("bit", INT, "", "bit within the byte", "Item.start_bit"),
        Column("address", WORD, "", "address as people write it, DB10.DBW4", "Item.address"),
        Column("type", WORD, "", "transport size of the request", "Item.transport_size"),
        Column("count", INT, "", "elements", "Item.count"),
        Column("return_code", INT, "", "return code, null without an answer", "ItemResult.return_code"),
        Column("return_name", WORD, "", "its name", "dissect.s7.tables.RETURN_CODES"),
        Column("refused", BOOL, "", "the answer refuses this item, or the whole request", "ItemResult.refused"),
        Column("number", REAL, "", "value: a number or truth value; of a single tag in its unit", "ItemResult.value"),
        Column("text", TEXT, "", "value where it is text, several numbers as JSON, an integer beyond 2^53", "ItemResult.value"),
        Column("spelled", TEXT, "", "text that several bytes seem to spell, a guess", "dissect.s7.values.spelled"),
        Column("data", BYTES, "", "the bytes read or written", "ItemResult.data"),
    ),
)

VALUES: Final = Table(
    "values",
    "value of a variable that was read, written or pushed, tag by tag where tags are given, without what is only likely",
    (
        _CONNECTION,
        _FILE,
        Column("frame", INT, "packet of its file", "packet with the value", "ValueRow.frame"),
        *_time("ts", "time of that packet", "ValueRow.time_ns"),
        Column("client_host", WORD, "", "address of who read, wrote or subscribed", "ValueRow.client"),
        Column("server_host", WORD, "", "address of the PLC that holds the variable", "Variable.plc"),
        Column("operation", WORD, "", "read, write, push, modify, force, notification or pdo", "ValueRow.how"),
        Column("written", BOOL, "", "the client gave the value", "ValueRow.writes"),
        Column("address", WORD, "", "where the variable begins", "Variable.address"),
        Column("name", WORD, "", "tag, or the name that the program gives it", "Variable.tag"),
        Column("type", WORD, "", "type of the variable", "Variable.type"),
        Column("unit", WORD, "", "unit of the value", "Variable.unit"),
        Column("number", REAL, "unit", "value: a number or truth value", "ValueRow.value"),
        Column("text", TEXT, "", "value where it is text, several numbers as JSON, an integer beyond 2^53", "ValueRow.value"),
        Column("data", BYTES, "", "its bytes", "ValueRow.data"),
        Column("changed", BOOL, "", "different from the one before, whoever gave that; null for the first", "ValueRow.changed"),
        Column("previous_number", REAL, "unit", "the one before it: a number or truth value", "ValueRow.previous"),
        Column("remark", TEXT, "", "what is odd about it", "ValueRow.remark"),
    ),
)

OPERATIONS: Final = _of_facts(
    "operations",
    "operation: several transactions that belong together, such as a download",
    OPERATION,
    (
        "number", "connection", "file", "first_frame", "last_frame", "begin_time", "end_time", "client", "server",
        "from_client", "kind", "subject", "result", "reason", "error_code", "error_name", "transaction_count", "transactions",
        "pushes", "likely_count", "octets", "announced", "odd",
    ),
)  # fmt: skip

ACTS: Final = _of_facts(
    "acts",
    "act: what a client did to a device, or tried to: stop, download, force, password …",
    ACT,
    tuple(ACT),
)

FINDINGS: Final = _of_facts(
    "findings",
    "finding in detail (at most 100 a slug and pair of hosts, 1000 a slug, and the first of each pair); finding_counts has all",
    FINDING,
    (
        "number", "slug", "severity", "kind", "connection", "file", "frames", "time", "client_host", "server_host", "sentence",
        "detail", "advice", "techniques_v18", "techniques_v19", "technique_names", "explained_by", "because_of",
    ),
)  # fmt: skip

FINDING_COUNTS: Final = _of_facts(
    "finding_counts",
    "rule that applied, and each pair of hosts it applied between: the facts of all its events, also of those that are not in"
    " findings; rows come when everything was read",
    COUNTED,
    (
        "scope", "slug", "severity", "kind", "reported", "client_host", "server_host", "because_of", "events", "reports",
        "connections", "connections_at_least", "hosts", "in_last_tenth", "file", "first_frame", "first_time", "last_file",
        "last_frame", "last_time",
    ),
)  # fmt: skip

DEVICES: Final = _of_facts(
    "devices",
    "station: what it is and said of itself (docs/devices.md); rows come when everything was read",
    DEVICE,
    (
        "address", "vlan", "role", "certainty", "host_name", "mac", "vendor", "order_number", "hardware", "firmware",
        "serial_number", "station_name", "module_name", "module_type", "plant", "location", "operating_mode",
        "protection_level", "pdu_lengths_said", "asked_by_said", "asks_said", "connections", "transactions", "answered",
        "unanswered", "with_errors", "median_ns", "p95_ns", "likely_count", "file", "first_frame", "last_frame", "first_time",
        "last_time",
    ),
)  # fmt: skip

PDUS: Final = Table(
    "pdus",
    "message of S7comm, S7comm-plus or SCD, paired or not",
    (
        Column("pdu", INT, "", "number of the message in the run", "order of completion"),
        _CONNECTION,
        _FILE,
        Column("frame", INT, "packet of its file", "packet that completed it", "Observer.pdu"),
        *_time("ts", "time of that packet", "Observer.pdu"),
        *_ENDS,
        Column("from_client", BOOL, "", "the client sent it", "Side.index"),
        Column("protocol", WORD, "", "s7comm, s7comm-plus or scd", "Observer.pdu"),
        Column("kind", WORD, "", "ROSCTR (Job, Ack_Data …); S7comm-plus: request, response …", "Pdu.rosctr"),
        Column("pdu_ref", INT, "", "number that pairs request and response", "Pdu.pdu_ref"),
        Column("function", INT, "", "function code", "Parameters.function"),
        Column("function_name", WORD, "", "its name; of userdata group and subfunction", "Parameters.function_name"),
        Column("userdata_group", INT, "", "function group of userdata", "UserdataHead.group"),
        Column("subfunction", INT, "", "subfunction of userdata", "UserdataHead.subfunction"),
        Column("error_code", INT, "", "error of header or parameter", "Pdu.header"),
        Column("item_count", INT, "", "items that its parameters announce", "Parameters.item_count"),
        Column("bytes", INT, "bytes", "size of the message", "Observer.pdu"),
        Column("cut", BOOL, "", "the capture cut it short", "Observer.pdu"),
        Column("malformed", WORDS, "", "what is malformed in it", "Pdu.malformed"),
    ),
)

#: Every table by its name, in the order in which they are listed.
TABLES: Final[dict[str, Table]] = {
    table.name: table
    for table in (CONNECTIONS, TRANSACTIONS, ITEMS, VALUES, OPERATIONS, ACTS, FINDINGS, FINDING_COUNTS, DEVICES, PDUS)
}


def chosen_tables(names: Iterable[str]) -> list[Table]:
    """Return the tables with these names, in the order of `TABLES`; all for no names. Raises `UnknownTableError`."""
    wanted = list(names)
    for name in wanted:
        if name not in TABLES:
            near = close_names(name, TABLES)
            hint = f"Did you mean {' or '.join(near)}?" if near else f"Tables are {', '.join(TABLES)}."
            raise UnknownTableError(f"no table {name!r}. {hint}")
    return [table for table in TABLES.values() if not wanted or table.name in wanted]
