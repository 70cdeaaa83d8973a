"""Rows of values as text, JSON lines and CSV (docs/values.md). A row is written with what its variable has cached."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.report import words
from dissect.report.styled import HANG, PLAIN, Line
from dissect.report.words import Places
from dissect.report.writer import Writer
from dissect.report.writers.csv import plain_cell, quoted
from dissect.report.writers.jsonl import json_text, value_text
from dissect.variables.model import ValueRow, Variable
from dissect.wire.text import Clock, cell, shortened

if TYPE_CHECKING:
    from dissect.variables.summary import Summary

VALUE_SCHEMA: Final = "s7dissect.value/1"
_HEAD: Final = f'{{"schema":"{VALUE_SCHEMA}","time":"'
#: Columns of the table of rows; with several files `FILE_COLUMN` stands behind ``frame``.
CSV_COLUMNS: Final[list[str]] = [
    "time",
    "frame",
    "connection",
    "client",
    "plc",
    "how",
    "address",
    "tag",
    "type",
    "value",
    "value_text",
    "unit",
    "previous",
    "changed",
    "octets",
    "remark",
]
FILE_COLUMN: Final = "file"
#: Cached pieces are forgotten together when there are this many.
_MAX_CACHED: Final = 8192
_NAME: Final = 100
_STRUCT: Final = 200
#: The remark of a value of which a part passed.
PIECED: Final = "only a part of its bytes passed"


class ValueWriter(Writer):
    """Writes rows of values, or a summary of them, in one format."""

    def values(self, rows: list[ValueRow]) -> None:
        """Add the lines of rows."""

    def summary(self, summary: Summary) -> None:
        """Add the lines of a summary."""


# ---- text -----------------------------------------------------------------------------------------------------------


def place_text(variable: Variable) -> str:
    """Return a variable for a person: ``Tank.Level (DB1.DBD0)``, ``DB1.DBW4``."""
    address = shortened(variable.address, _NAME)
    return f"{shortened(variable.tag, _NAME)} ({address})" if variable.tag else address


def shown(variable: Variable, value: object, data: bytes | None, text: str = "") -> str:
    """Return a value for a person, with its unit."""
    if value is None or variable.bytes_only:
        return words.octets(data) if data is not None else "-"
    said: str
    if isinstance(value, dict):
        said = shortened(json.dumps(value, ensure_ascii=False, default=str), _STRUCT)
    elif isinstance(value, (bool, int, float, str, list)):
        said = words.value(value)
    else:
        said = shortened(str(value), _STRUCT)
    if variable.unit:
        said += f" {shortened(variable.unit, 20)}"
    return f"{said} ({shortened(text, _NAME)})" if text else said


class ValueText(ValueWriter):
    """Writes a line for each row: when, which packet, who, how, what, and the value before where that was different."""

    def values(self, rows: list[ValueRow]) -> None:
        """Add the lines of rows."""
        for row in rows:
            self.lines.append(Line(value_line(row, self.clock, self.places), PLAIN, HANG))

    def summary(self, summary: Summary) -> None:
        """Add a table with a line for each variable."""
        from dissect.variables.summary import text_lines

        self.lines += text_lines(summary, self.clock, self.places)


def value_line(row: ValueRow, clock: Clock, places: Places) -> str:
    """Return one value on one line."""
    variable = row.variable
    type_ = f" {variable.type}" if variable.type else ""
    was = ""
    if row.changed and not row.first:
        was = f"  was {shown(variable, row.previous, row.before)}"
    remark = f"  [{shortened(row.remark, _NAME)}]" if row.remark and row.value is None else ""
    if row.pieced:
        remark = f"  [{PIECED}]"
    return (
        f"{clock.moment(row.time_ns)}  {places.mark(int(row.frame)):>6}  {places.host(row.client)} → "
        f"{places.end(variable.plc)}  {row.how:<5}  {place_text(variable)}{type_} = "
        f"{shown(variable, row.value, row.data, row.text)}{was}{remark}"
    )


# ---- JSON -----------------------------------------------------------------------------------------------------------


def any_text(value: object) -> str:
    """Return a value as JSON, one of S7comm-plus that has members included."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value_text(value)
    if isinstance(value, list):
        return f"[{','.join([any_text(element) for element in value])}]"
    return json.dumps(value, separators=(",", ":"), default=str).replace("\x7f", "\\u007f")


def names_json(variable: Variable) -> str:
    """Return the keys of a variable, from ``address`` to ``unit``."""
    if not variable.fragment:
        variable.fragment = (
            f',"address":{json_text(variable.address)},"tag":{_or_null(variable.tag)}'
            f',"type":{_or_null(variable.type)},"unit":{_or_null(variable.unit)}'
        )
    return variable.fragment


def _or_null(text: str) -> str:
    return json_text(text) if text else "null"


class ValueJsonl(ValueWriter):
    """Writes an object for each row, on a line."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._ends: dict[int, str] = {}

    def values(self, rows: list[ValueRow]) -> None:
        """Add the lines of rows."""
        lines = self.lines
        clock = self.clock
        several: bool = self.places.several
        for row in rows:
            variable = row.variable
            value = any_text(row.value)
            if row.first:
                was = "null"
                changed = "null"
            elif row.changed:
                was = any_text(row.previous)
                changed = "true"
            else:
                was = value
                changed = "false"
            data = row.data
            octets = f'"{data.hex()}"' if data is not None else "null"
            remark = _or_null(row.remark) if not row.pieced else f'"{PIECED}"'
            text = f',"text":{json_text(row.text)}' if row.text else ""
            frame = str(row.frame)
            if several:
                name, number = self.places.locate(int(row.frame))
                frame = f'{number},"file":{json_text(name)}'
            lines.append(
                f'{_HEAD}{clock.iso(row.time_ns)}","frame":{frame}{self._who(row)},"how":"{row.how}"'
                f'{names_json(variable)},"value":{value}{text},"previous":{was},"changed":{changed}'
                f',"octets":{octets},"remark":{remark}}}'
            )

    def summary(self, summary: Summary) -> None:
        """Add an object for each variable."""
        from dissect.variables.summary import json_lines

        self.lines += json_lines(summary)

    def _who(self, row: ValueRow) -> str:
        key: i64 = row.link.number * 2 + row.side
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MAX_CACHED:
                self._ends.clear()
            found = f',"connection":{row.link.number},"client":{json_text(row.host)},"plc":{json_text(str(row.variable.plc))}'
            self._ends[key] = found
        return found


# ---- CSV ------------------------------------------------------------------------------------------------------------


class ValueCsv(ValueWriter):
    """Writes the names of the columns, then a row for each value, or each variable of a summary."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._begun: bool = False
        self._names: dict[Variable, str] = {}
        self._ends: dict[int, str] = {}

    def values(self, rows: list[ValueRow]) -> None:
        """Add the rows; the first time with the names of the columns in front, also where there are none."""
        if not self._begun:
            self._begun = True
            self.lines.append(",".join(self.columns()))
        for row in rows:
            self.lines.append(self._row(row))

    def summary(self, summary: Summary) -> None:
        """Add a row for each variable."""
        from dissect.variables.summary import csv_rows

        self.lines += [",".join([quoted(text) for text in row]) for row in csv_rows(summary)]

    def columns(self) -> list[str]:
        """Return the names of the columns."""
        return [*CSV_COLUMNS[:2], FILE_COLUMN, *CSV_COLUMNS[2:]] if self.places.several else list(CSV_COLUMNS)

    def _row(self, row: ValueRow) -> str:
        """Return the line of a row. Numbers, times and addresses are safe as they are."""
        variable = row.variable
        data = row.data
        frame = str(row.frame)
        if self.places.several:
            name, number = self.places.locate(int(row.frame))
            frame = f"{number},{quoted(cell(name))}"
        value = quoted(value_cell(variable, row.value, data))
        was = quoted(value_cell(variable, row.previous, row.before)) if row.changed else value
        changed = "" if row.first else "true" if row.changed else "false"
        unit = quoted(cell(variable.unit)) if variable.unit else ""
        text = quoted(cell(row.text)) if row.text else ""
        remark = PIECED if row.pieced else quoted(cell(row.remark)) if row.remark else ""
        return (
            f"{self.clock.iso(row.time_ns)},{frame},{self._who(row)},{row.how},{self._named(variable)},{value},{text},{unit}"
            f",{was},{changed},{data.hex() if data is not None else ''},{remark}"
        )

    def _named(self, variable: Variable) -> str:
        """Return the cells of a variable, which are the same in all of its rows."""
        found = self._names.get(variable)
        if found is None:
            if len(self._names) >= _MAX_CACHED:
                self._names.clear()
            found = ",".join([quoted(cell(text)) for text in (variable.address, variable.tag, variable.type)])
            self._names[variable] = found
        return found

    def _who(self, row: ValueRow) -> str:
        key: i64 = row.link.number * 2 + row.side
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MAX_CACHED:
                self._ends.clear()
            found = f"{row.link.number},{row.host},{row.variable.plc}"
            self._ends[key] = found
        return found


def value_cell(variable: Variable, value: object, data: bytes | None) -> str:
    """Return the cell of a value; octets without a meaning as hexadecimal."""
    if value is None:
        return ""
    if variable.bytes_only and data is not None and isinstance(value, list):
        return data.hex(" ")
    if isinstance(value, (bool, int, float, str, list)):
        return plain_cell(value)
    return cell(json.dumps(value, ensure_ascii=False, default=str))
