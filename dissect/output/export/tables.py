"""The tables: one definition of names, columns, types, units and meanings, for all forms of export and docs/tables.md.

A row is a tuple of the columns that are not derived, in their order; `dissect.output.export.rows` makes it. Times are integers,
nanoseconds since 1970 in UTC, because only integers are exact in every reader. Beside each there is a derived column with the
same time as a timestamp.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from dissect.meaning.facts import fact as kinds
from dissect.meaning.facts.connection import CONNECTION
from dissect.meaning.facts.counted import COUNTED
from dissect.meaning.facts.device import DEVICE
from dissect.meaning.facts.fact import Fact
from dissect.meaning.facts.finding import FINDING
from dissect.meaning.facts.operation import ACT, OPERATION
from dissect.meaning.facts.pdu import PDU
from dissect.meaning.facts.transaction import ITEM, TRANSACTION
from dissect.meaning.facts.value import VALUE
from dissect.wire.config.hints import close_names
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
    """A column: ``source`` is its fact; ``of`` is the column that it is derived from."""

    name: str
    type: str
    unit: str
    about: str
    source: str
    of: str = ""


class Table(NamedTuple):
    """A table: a row for each ``about``, in the order of completion; ``time`` is the column with the time of a row.

    ``facts`` are those from which its columns and the values of a row are made.
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
    kinds.INSTANT: INT,
    kinds.REAL: REAL,
    kinds.BYTES: BYTES,
    kinds.COUNTS: INTS,
    kinds.WORDS: WORDS,
}
#: The count that the numbers of packets refer to.
_UNITS: Final[Mapping[str, str]] = {
    kinds.FRAME: "packet of its file",
    kinds.FRAMES: "packets of their files",
    kinds.INSTANT: "ns since 1970, UTC",
}


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

TRANSACTIONS: Final = _of_facts(
    "transactions",
    "request with its response, response without request, or message sent unasked",
    TRANSACTION,
    (
        "number", "connection", "file", "request_frame", "response_frame", "response_file", "begin_time", "response_ns",
        "latency_ns", "client", "server", "from_client", "protocol_name", "rosctr_name", "pdu_ref", "function_code",
        "function_name", "userdata_group", "subfunction", "about", "outcome", "reason", "certainty_said", "doubt_said",
        "failed", "error_code", "error_names", "item_count", "request_bytes", "response_bytes",
    ),
)  # fmt: skip

ITEMS: Final = _of_facts(
    "items",
    "item of a read, write, subscription or test function, with its outcome",
    ITEM,
    (
        "transaction", "item", "connection", "request_frame", "response_frame", "begin_time", "server_host", "client_host",
        "operation", "certainty", "name", "area_name", "db_number", "byte", "bit", "label", "type_name", "count",
        "return_code", "return_name", "refused", "number_value", "text_value", "spelled", "data",
    ),
)  # fmt: skip

VALUES: Final = _of_facts(
    "values",
    "value of a variable that was read, written or pushed, tag by tag where tags are given, without what is only likely",
    VALUE,
    (
        "connection", "file", "frame", "time", "client", "server_host", "how", "written", "address", "tag", "type", "unit",
        "number", "text_value", "octets", "changed", "previous_number", "odd",
    ),
)  # fmt: skip

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

PDUS: Final = _of_facts(
    "pdus",
    "message of S7comm, S7comm-plus or SCD, paired or not",
    PDU,
    (
        "pdu", "connection", "file", "frame", "time", "client", "server", "from_client", "protocol_name", "kind", "pdu_ref",
        "function_code", "function_name", "userdata_group", "subfunction", "error", "announced", "size", "cut",
        "malformations",
    ),
)  # fmt: skip

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
