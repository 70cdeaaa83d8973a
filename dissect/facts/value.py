"""The facts of a value (`dissect.variables.model.ValueRow`). Its writers are compiled; tests hold them to this table."""

from __future__ import annotations

from typing import Any, Final

from dissect.facts.fact import (
    BYTES,
    CODE,
    COUNT,
    END,
    FILE,
    FLAG,
    FRAME,
    JSON,
    REAL,
    TEXT,
    TIME,
    WORD,
    Fact,
    by_name,
)
from dissect.transactions.transaction import DOUBT_TEXTS, LIKELY
from dissect.wire.text import encodable

_HOWS: Final = ("read", "write", "push", "modify", "force", "notification", "pdo")
_VALUE: Final = {"$ref": "urn:s7dissect:schema:transaction:1#/$defs/value"}

_ROWS: Final[tuple[Fact[Any], ...]] = (
    Fact("time", TIME, "Time of `frame`.", lambda of: int(of.time_ns), column="ts"),
    Fact("frame", FRAME, "The packet that has the value: of a read its response, of a write the request; of a modified or"
         " forced variable the confirmation.", lambda of: int(of.frame)),
    Fact("connection", COUNT, "Number of the connection, that of `connections` in the analysis.",
         lambda of: int(of.connection), least=1),
    Fact("client", WORD, "Address of the host that read, wrote or subscribed.", lambda of: of.host, column="client_host"),
    Fact("plc", END, "The end that has the variable.", lambda of: of.plc),
    Fact("how", CODE, "`push` of a cyclic or change-driven service or of a variable table, `modify` and `force` of a variable"
         " table, `notification` of S7comm-plus, `pdo` of SCD.", lambda of: of.how, column="operation", codes=_HOWS),
    Fact("address", WORD, "Where the value begins, for example `DB10.DBD4`; of S7comm-plus the name or the LIDs, of SCD index"
         " and sub-index.", lambda of: encodable(of.address)),
    Fact("tag", WORD, "Name of the variable, by `--tags` or an SCD dictionary; null where nobody knows one.",
         lambda of: encodable(of.tag) or None, column="name", null=True),
    Fact("type", WORD, "Type of the value, for example `REAL`, `10 x BYTE`, `Array[1..3] of INT`; null for values of SCD.",
         lambda of: encodable(of.type) or None, null=True),
    Fact("unit", WORD, "Its unit, null for none.", lambda of: encodable(of.unit) or None, null=True),
    Fact("value", JSON, "The value in `unit`; null where the bytes have none. Of S7comm-plus also an object with members.",
         None, shape=_VALUE),
    Fact("text", TEXT, "Only where an SCD dictionary, or S7comm-plus, has a text for the value.",
         lambda of: of.text or None, rare=True),
    Fact("previous", JSON, "The value of the variable before this one, whoever read or wrote it; null where none was seen.",
         None, shape=_VALUE),
    Fact("changed", FLAG, "Whether the value is different from the one before; null where none was seen.",
         lambda of: None if of.first else of.changed, null=True),
    Fact("octets", BYTES, "The bytes of the value, of a bit one byte; null for values that have none of their own.",
         lambda of: of.data, column="data", null=True),
    Fact("remark", TEXT, "What is odd about the value, for a person; null for nothing.", None, null=True),
    Fact("certainty", CODE, "Only with `--likely`, of a value from a pair of request and answer that is only likely, as in a"
         " transaction. It is never `previous` of another value.",
         lambda of: LIKELY if of.doubt else None, rare=True, codes=(LIKELY,)),
    Fact("doubt", CODE, "Only with `certainty`: why, as in a transaction.",
         lambda of: of.doubt or None, rare=True, codes=tuple(DOUBT_TEXTS)),
    # ---- what JSON has inside of an object, or not at all
    Fact("file", FILE, "Capture file of the packet.", lambda of: int(of.frame), key=""),
    Fact("server_host", WORD, "Address of the PLC that holds the variable.", lambda of: of.plc.host, key=""),
    Fact("written", FLAG, "The client gave the value.", lambda of: bool(of.writes), key=""),
    Fact("number", REAL, "Value: a number or truth value.", None, key="", unit="unit"),
    Fact("text_value", TEXT, "Value where it is text, several numbers as JSON, an integer beyond 2^53.",
         None, key="", column="text"),
    Fact("previous_number", REAL, "The one before it: a number or truth value.", None, key="", unit="unit"),
    Fact("odd", TEXT, "What is odd about it.", lambda of: of.remark or None, key="", column="remark", null=True),
)  # fmt: skip
#: The facts of a value by their names, in the order of their keys in JSON.
VALUE: Final = by_name(_ROWS)
