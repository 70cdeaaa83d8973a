"""Write docs/tables.md from the definition of the tables: `python scripts/tables_doc.py > docs/tables.md`."""

from __future__ import annotations

from dissect.output.export.questions import QUESTIONS
from dissect.output.export.tables import BOOL, BYTES, INT, INTS, REAL, TABLES, TEXT, TIME, WORD, WORDS, Table

HEAD = """\
# Tables

What `s7dissect export` writes, `s7dissect sql` queries and `dissect.frames` returns ([export.md](export.md)): the same tables
with the same columns in every form. This page is made by `scripts/tables_doc.py` from
`dissect/output/export/tables.py` and `dissect/meaning/facts`; `from` is the fact or the attribute.

Tables join by `connection` and `transaction`, numbers that count within one run of the tool; `uid` and `community_id` of a
connection are the same in every run. Packets (`frame` and what ends in `_frame`) are counted within their `file`. A cell
without a value is null. A later version may add columns and tables; what is here keeps its name and meaning as long as the
version of the tables, in the metadata of every file, stays 2.

| table | a row for each |
|---|---|"""

TYPES = {
    INT: ("int64", "BIGINT", "INTEGER", "a number"),
    REAL: ("double", "DOUBLE", "REAL; NaN is null", "a number"),
    BOOL: ("bool", "BOOLEAN", "INTEGER, 0 or 1", "`true`, `false`"),
    TEXT: ("string", "VARCHAR", "TEXT", "text, defused"),
    WORD: ("dictionary of strings", "VARCHAR", "TEXT", "text, defused"),
    BYTES: ("binary", "BLOB", "BLOB", "hexadecimal"),
    TIME: ("timestamp[ns, tz=UTC]", "TIMESTAMPTZ_NS", "TEXT, generated", "ISO 8601, `Z`"),
    INTS: ("list of int64", "BIGINT[]", "TEXT, JSON", "JSON"),
    WORDS: ("list of strings", "VARCHAR[]", "TEXT, JSON", "JSON, defused"),
}

AFTER_TYPES = """
Times are integers of nanoseconds since 1970 in UTC, because many readers cut timestamps to microseconds. Beside each is a
timestamp with the time zone UTC: DuckDB and others show it in the zone of the session, which `s7dissect sql` sets to UTC, and
`ts AT TIME ZONE 'Europe/Berlin'` is local time. Subtract the integers. Arrow IPC files hold repeated texts as plain strings.

Version 1 of the tables had timestamps without a zone, and the same integers. For those write `ts AT TIME ZONE 'UTC'`;
a query that said `ts AT TIME ZONE 'UTC' AT TIME ZONE 'Europe/Berlin'` leaves the first half out. DuckDB has the type since 2.0.
"""

QUESTIONS_HEAD = """
## Questions

Each of these is asked by its name, `s7dissect sql slowest trace.pcapng`, and is an example of what can be asked; `s7dissect
sql --questions` lists them.
"""


def main() -> None:
    print(HEAD)
    for table in TABLES.values():
        print(f"| [{table.name}](#{table.name}) | {table.about} |")
    print("\n## Types\n\n| type | Arrow, Parquet | DuckDB | SQLite | CSV |\n|---|---|---|---|---|")
    for name, cells in TYPES.items():
        print(f"| {' | '.join([name, *cells])} |")
    print(AFTER_TYPES, end="")
    for table in TABLES.values():
        section(table)
    print(QUESTIONS_HEAD, end="")
    for question in QUESTIONS.values():
        words = "".join([f" `{one.name}`: {one.about}." for one in question.parameters])
        print(
            f"\n### {question.name}\n\n{question.sentence} {question.note}{words}\n\n```sql\n{question.sql.strip()}\n```"
        )


def section(table: Table) -> None:
    print(f"\n## {table.name}\n\nA row for each {table.about}.\n")
    print("| column | type | unit | meaning | from |\n|---|---|---|---|---|")
    for column in table.columns:
        print(f"| `{column.name}` | {column.type} | {column.unit} | {column.about} | `{column.source}` |")


if __name__ == "__main__":
    main()
