"""The facts of a value, whose compiled writers are compared with this table by tests, and of a variable over all its values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from dissect.engine.transactions.transaction import DOUBT_TEXTS, LIKELY
from dissect.meaning.facts.fact import (
    BYTES,
    CODE,
    COUNT,
    COUNTS,
    DURATION,
    END,
    FILE,
    FLAG,
    FRAME,
    JSON,
    REAL,
    RECORDS,
    TEXT,
    TIME,
    VLANS,
    WORD,
    Fact,
    by_name,
)
from dissect.packets.tcp.link import vlan_ids
from dissect.wire.text import encodable

_HOWS: Final = ("read", "write", "push", "modify", "force", "notification", "pdo")
_VALUE: Final = {"$ref": "urn:s7dissect:schema:transaction:1#/$defs/value"}

_ROWS: Final[tuple[Fact[Any], ...]] = (
    Fact("time", TIME, "Time of `frame`.", lambda of: int(of.time_ns), column="ts"),
    Fact("frame", FRAME, "The packet that has the value: for a read its response, for a write the request; for a modified or"
         " forced variable the confirmation.", lambda of: int(of.frame)),
    Fact("connection", COUNT, "Number of the connection, that of `connections` in the analysis.",
         lambda of: int(of.connection), least=1),
    Fact("client", WORD, "Address of the host that read, wrote or subscribed.", lambda of: of.host, column="client_host"),
    Fact("plc", END, "The end that has the variable.", lambda of: of.plc),
    Fact("how", CODE, "`push` of a cyclic or change-driven service or of a variable table, `modify` and `force` of a variable"
         " table, `notification` of S7comm-plus, `pdo` of SCD.", lambda of: of.how, column="operation", codes=_HOWS),
    Fact("address", WORD, "Begin of the value, for example `DB10.DBD4`; for S7comm-plus the name or the LIDs, for SCD index"
         " and sub-index.", lambda of: encodable(of.address)),
    Fact("tag", WORD, "Name of the variable, by `--tags` or an SCD dictionary; null if none is known.",
         lambda of: encodable(of.tag) or None, column="name", null=True),
    Fact("type", WORD, "Type of the value, for example `REAL`, `10 x BYTE`, `Array[1..3] of INT`; null for values of SCD.",
         lambda of: encodable(of.type) or None, null=True),
    Fact("unit", WORD, "Its unit, null for none.", lambda of: encodable(of.unit) or None, null=True),
    Fact("value", JSON, "The value in `unit`; null where the bytes have none. For S7comm-plus also an object with members.",
         None, shape=_VALUE),
    Fact("text", TEXT, "Only where an SCD dictionary, or S7comm-plus, has a text for the value.",
         lambda of: of.text or None, rare=True),
    Fact("previous", JSON, "The value of the variable before this one, whoever read or wrote it; null where none was seen.",
         None, shape=_VALUE),
    Fact("changed", FLAG, "Whether the value is different from the one before; null where none was seen.",
         lambda of: None if of.first else of.changed, null=True),
    Fact("octets", BYTES, "The bytes of the value, for a bit one byte; null for values without bytes of their own.",
         lambda of: of.data, column="data", null=True),
    Fact("remark", TEXT, "A remark on an odd value, for a person; null for none.", None, null=True),
    Fact("certainty", CODE, "Only with `--likely`, of a value from a pair of request and answer that is only likely, as in a"
         " transaction. It is never `previous` of another value.",
         lambda of: LIKELY if of.doubt else None, rare=True, codes=(LIKELY,)),
    Fact("doubt", CODE, "Only with `certainty`: why, as in a transaction.",
         lambda of: of.doubt or None, rare=True, codes=tuple(DOUBT_TEXTS)),
    # ---- what JSON has inside of an object, or not at all
    Fact("file", FILE, "Capture file of the packet.", lambda of: int(of.frame), key=""),
    Fact("server_host", WORD, "Address of the PLC that has the variable.", lambda of: of.plc.host, key=""),
    Fact("written", FLAG, "The client gave the value.", lambda of: bool(of.writes), key=""),
    Fact("number", REAL, "Value: a number or truth value.", None, key="", unit="unit"),
    Fact("text_value", TEXT, "Value where it is text, several numbers as JSON, an integer beyond 2^53.",
         None, key="", column="text"),
    Fact("previous_number", REAL, "The value before it: a number or truth value.", None, key="", unit="unit"),
    Fact("odd", TEXT, "Remark on an odd value.", lambda of: of.remark or None, key="", column="remark", null=True),
)  # fmt: skip
#: The facts of a value by their names, in the order of their keys in JSON.
VALUE: Final = by_name(_ROWS)


def _of(name: str, nothing: Any, counts: str = "") -> Callable[[Any], Any]:
    """Return a getter of a statistic of a variable; ``nothing`` if there are no statistics, or its number ``counts`` is 0."""

    def got(of: Any) -> Any:
        found = of.statistics
        return nothing if found is None or (counts and not getattr(found, counts)) else getattr(found, name)

    return got


_CLIENT: Final[tuple[Fact[Any], ...]] = (
    Fact("client", TEXT, "Address of the host.", lambda of: of[0]),
    Fact("count", COUNT, "Number of values.", lambda of: int(of[1].count), least=1),
    Fact("period_ns", DURATION, "Mean time between two of them, null for fewer.", lambda of: of[1].period_ns, null=True),
    Fact("jitter_ns", DURATION, "Standard deviation of that time, null for fewer than three values.",
         lambda of: of[1].jitter_ns, null=True),
)  # fmt: skip
#: The facts of a client of a variable: its address and the pace of its values.
CLIENT: Final = by_name(_CLIENT)

_VARIABLE: Final[tuple[Fact[Any], ...]] = (
    Fact("plc", END, "The end that has the variable.", lambda of: of.plc),
    Fact("vlan", COUNTS, "The VLAN ids of its network, the outer tag first; the same address in another VLAN is another PLC.",
         lambda of: vlan_ids(of.vlan), shape=VLANS),
    Fact("address", TEXT, "Begin of the variable, as in a value.", lambda of: of.address),
    Fact("tag", TEXT, "Its name, null if none is known.", lambda of: of.tag or None, null=True),
    Fact("type", TEXT, "Its type, as in a value.", lambda of: of.type or None, null=True),
    Fact("unit", TEXT, "Its unit, null for none.", lambda of: of.unit or None, null=True),
    Fact("count", COUNT, "Values: reads, writes and pushes that were not refused.", _of("count", 0)),
    Fact("changes", COUNT, "Number of values that differ from the one before.", _of("changes", 0)),
    Fact("distinct", COUNT, "Distinct values, counted up to 20.", _of("distinct_count", 0)),
    Fact("distinct_more", FLAG, "True if there were more.", _of("more_distinct", False)),
    Fact("first_time", TIME, "Time of the first value, null without one.", _of("first_ns", None, "count"), null=True),
    Fact("first", JSON, "The first value.", None, shape=_VALUE),
    Fact("last_time", TIME, "Time of the last value, null without one.", _of("last_ns", None, "count"), null=True),
    Fact("last", JSON, "The last value.", None, shape=_VALUE),
    Fact("min", REAL, "The least number, of a truth value 0 or 1; null without numbers.",
         _of("least", None, "numbers"), null=True),
    Fact("max", REAL, "The greatest number.", _of("most", None, "numbers"), null=True),
    Fact("mean", REAL, "The mean of all numbers, whatever time lies between them.", _of("mean", None), null=True),
    Fact("period_ns", DURATION, "Mean time between two values for the client that reads most often, or without readers writes"
         " most often; null without two values.", lambda of: getattr(_of("pace", None)(of), "period_ns", None), null=True),
    Fact("jitter_ns", DURATION, "Standard deviation of that time, null without three values.",
         lambda of: getattr(_of("pace", None)(of), "jitter_ns", None), null=True),
    Fact("readers", RECORDS, "Hosts that read it or were sent it, 8 at most.",
         lambda of: list(_of("readers", {})(of).items()), records=CLIENT),
    Fact("writers", RECORDS, "Hosts that wrote it, 8 at most.",
         lambda of: list(_of("writers", {})(of).items()), records=CLIENT),
    Fact("other_clients", COUNT, "Values of further hosts.", _of("others", 0)),
    Fact("refused_reads", COUNT, "Reads that the PLC refused.", lambda of: int(of.refused_reads)),
    Fact("refused_writes", COUNT, "Writes that the PLC refused; they are no values.", lambda of: int(of.refused_writes)),
    Fact("unconfirmed_writes", COUNT, "Writes of which the capture does not show what became; they are no values either.",
         lambda of: int(of.unconfirmed)),
    Fact("likely", COUNT, "Only where there are any: values and refusals of pairs that are only likely (`certainty` of a"
         " transaction). No other key counts them.", lambda of: int(of.likely) or None, rare=True, least=1),
)  # fmt: skip
#: The facts of a variable (`dissect.output.variables.model.Variable`) over all its values, in the order of their keys in JSON.
VARIABLE: Final = by_name(_VARIABLE)
