"""Rows of values as text, JSON lines and CSV (docs/values.md), put together from texts that are cached for each variable."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.report import words
from dissect.report.certainty import doubt_mark
from dissect.report.item_json import value_text
from dissect.report.styled import HANG, PLAIN, Line
from dissect.report.words import Places
from dissect.report.writer import Writer
from dissect.report.writers.csv import json_cell, quoted
from dissect.s7plus.value_showing import members_said
from dissect.transactions.connection import Connection
from dissect.variables.model import ValueRow, Variable
from dissect.wire.text import Clock, cell, json_text, shortened

if TYPE_CHECKING:
    from dissect.variables.summary import Summary

VALUE_SCHEMA: Final = "s7dissect.value/1"
_HEAD: Final = f'{{"schema":"{VALUE_SCHEMA}","time":"'
#: Columns of the table of rows; with several files `FILE_COLUMN` follows ``frame``.
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
    "certainty",
    "doubt",
]
FILE_COLUMN: Final = "file"
#: Bytes as JSON numbers: most lists are lists of bytes.
_SMALL: Final = [str(number) for number in range(256)]
#: A cache with so many entries is emptied.
_MAX_CACHED: Final = 8192
_NAME: Final = 100
_STRUCT: Final = 200
#: The S7comm-plus type whose values are octets, and their form in JSON.
_BLOB: Final = "Blob"
_HEXADECIMAL: Final = re.compile(r"([0-9a-f]{2})*")
#: The remark on a value of which only a part was transferred.
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
        members = value.get("members")
        text_of = (
            members_said(members) if isinstance(members, dict) else json.dumps(value, ensure_ascii=False, default=str)
        )
        said = shortened(text_of, _STRUCT)
    elif variable.type == _BLOB and isinstance(value, str):
        said = words.octets(bytes.fromhex(value)) if _HEXADECIMAL.fullmatch(value) else words.value(value)
    elif isinstance(value, (bool, int, float, str, list)):
        said = words.value(value, data if data is not None else b"")
    else:
        said = shortened(str(value), _STRUCT)
    if variable.unit:
        said += f" {shortened(variable.unit, 20)}"
    return f"{said} ({shortened(text, _NAME)})" if text else said


class Beginnings:
    """The beginning that the rows of a transaction share: time, packet, both ends, and how the values were transferred."""

    __slots__ = ("_frame", "_how", "_link", "_side", "_time_ns", "text")

    def __init__(self) -> None:
        self.text: str = ""
        self._link: Connection | None = None
        self._side: i64 = 0
        self._how: str = ""
        self._time_ns: i64 = 0
        self._frame: i64 = 0

    def fits(self, row: ValueRow) -> bool:
        """Return whether ``text`` is the beginning of ``row``; if not, remember ``row``: the caller has to set its text."""
        if (
            row.link is self._link
            and row.time_ns == self._time_ns
            and row.frame == self._frame
            and row.side == self._side
            and row.how == self._how
        ):
            return True
        self._link = row.link
        self._side = row.side
        self._how = row.how
        self._time_ns = row.time_ns
        self._frame = row.frame
        return False


class Written:
    """What a writer keeps for a variable: its ``names`` as they are written, and its latest value with the text.

    ``repeated`` is the end of a row without a change, for octets ``data``; empty if no such row was written yet.
    """

    __slots__ = ("data", "names", "repeated", "text", "value")

    def __init__(self, names: str) -> None:
        self.names: str = names
        self.value: object = None
        self.text: str = ""
        self.data: bytes | None = None
        self.repeated: str = ""

    def repeats(self, row: ValueRow) -> bool:
        """Return whether ``repeated`` is the end of ``row``."""
        return bool(
            self.repeated
            and not row.changed
            and row.value is self.value
            and row.data == self.data
            and not row.pieced
            and not row.text
            and not row.remark
            and not row.doubt
        )

    def keep(self, row: ValueRow, repeated: str) -> None:
        """Keep the end of a row without a change, unless it has a text or remark of its own."""
        if not (row.pieced or row.text or row.remark or row.doubt):
            self.data = row.data
            self.repeated = repeated


class RowWriter(ValueWriter):
    """Writes a row as a beginning, which the rows of a transaction share, and an end, which repeats with the same value."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._beginnings: Beginnings = Beginnings()
        self._written: dict[Variable, Written] = {}
        self._ends: dict[int, str] = {}

    def ends(self, row: ValueRow) -> str:
        """Return `between`, which is made once for each connection and direction."""
        key: i64 = row.link.number * 2 + row.side
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MAX_CACHED:
                self._ends.clear()
            found = self.between(row)
            self._ends[key] = found
        return found

    def texts(self, rows: list[ValueRow]) -> list[str]:
        """Return the text of each row."""
        texts: list[str] = []
        beginnings = self._beginnings
        for row in rows:
            if not beginnings.fits(row):
                beginnings.text = self.beginning(row)
            written = self._written.get(row.variable)
            if written is None:
                if len(self._written) >= _MAX_CACHED:
                    self._written.clear()
                written = Written(self.names(row.variable))
                self._written[row.variable] = written
            if not written.repeats(row):
                written.repeated = ""
                end = self.end(row, written)
                if not row.changed:
                    written.keep(row, end)
                texts.append(beginnings.text + end)
            else:
                texts.append(beginnings.text + written.repeated)
        return texts

    def names(self, variable: Variable) -> str:
        """Return the part of its rows that names a variable."""
        return ""

    def beginning(self, row: ValueRow) -> str:
        """Return the part that the rows of a transaction share: time, packet, both ends, how the value was transferred."""
        return ""

    def between(self, row: ValueRow) -> str:
        """Return the client and the PLC of a row."""
        return ""

    def end(self, row: ValueRow, written: Written) -> str:
        """Return the rest of a row, and remember the value in ``written``."""
        return ""


class ValueText(RowWriter):
    """Writes a line for each row: time, packet, both ends, how, the value, and a different value before it."""

    def values(self, rows: list[ValueRow]) -> None:
        """Add the lines of rows."""
        self.lines += [Line(text, PLAIN, HANG) for text in self.texts(rows)]

    def names(self, variable: Variable) -> str:
        """Return a variable and its type."""
        return typed_text(variable)

    def beginning(self, row: ValueRow) -> str:
        """Return what the lines of a transaction share."""
        return line_beginning(row, self.clock, self.places, self.ends(row))

    def between(self, row: ValueRow) -> str:
        """Return both ends."""
        return ends_text(row, self.places)

    def end(self, row: ValueRow, written: Written) -> str:
        """Return the variable with its value."""
        written.value = row.value
        return line_end(row, written.names)

    def summary(self, summary: Summary) -> None:
        """Add a table with a line for each variable."""
        from dissect.variables.summary import text_lines

        self.lines += text_lines(summary, self.clock, self.places)


def value_line(row: ValueRow, clock: Clock, places: Places) -> str:
    """Return one value on one line."""
    return line_beginning(row, clock, places, ends_text(row, places)) + line_end(row, typed_text(row.variable))


def ends_text(row: ValueRow, places: Places) -> str:
    """Return the client that read, wrote or subscribed, and the PLC."""
    return f"{places.host(row.client)} → {places.end(row.variable.plc)}"


def line_beginning(row: ValueRow, clock: Clock, places: Places, ends: str) -> str:
    """Return time, packet, both ends, and how a value was transferred."""
    return f"{clock.moment(row.time_ns)}  {places.mark(int(row.frame)):>6}  {ends}  {row.how:<5}  "


def typed_text(variable: Variable) -> str:
    """Return a variable and its type for a person."""
    return f"{place_text(variable)} {variable.type}" if variable.type else place_text(variable)


def line_end(row: ValueRow, what: str) -> str:
    """Return the value of a row, and the value before it if that was different."""
    variable = row.variable
    was = ""
    if row.changed and not row.first:
        was = f"  was {shown(variable, row.previous, row.before, row.previous_text)}"
    # The remark on an SCD value is only shown if there is no value: it has no ``data``.
    odd = row.remark and (row.value is None or row.data is not None)
    remark = f"  [{shortened(row.remark, _NAME)}]" if odd else ""
    if row.pieced:
        remark = f"  [{PIECED}]"
    mark = f"  {doubt_mark(row.doubt)}" if row.doubt else ""
    return f"{what} = {shown(variable, row.value, row.data, row.text)}{was}{remark}{mark}"


# ---- JSON -----------------------------------------------------------------------------------------------------------


def any_text(value: object) -> str:
    """Return any value as JSON, also an S7comm-plus value with members."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value_text(value)
    if isinstance(value, list):
        return f"[{','.join([_element_text(element) for element in value])}]"
    return json.dumps(value, separators=(",", ":"), default=str).replace("\x7f", "\\u007f")


def _element_text(element: object) -> str:
    """Return an element of a list as JSON; most are bytes."""
    if isinstance(element, int) and not isinstance(element, bool) and 0 <= element < 256:
        return _SMALL[element]
    return any_text(element)


def names_json(variable: Variable) -> str:
    """Return the keys of a variable, from ``address`` to ``unit``."""
    return (
        f',"address":{json_text(variable.address)},"tag":{_or_null(variable.tag)}'
        f',"type":{_or_null(variable.type)},"unit":{_or_null(variable.unit)}'
    )


def _or_null(text: str) -> str:
    return json_text(text) if text else "null"


class ValueJsonl(RowWriter):
    """Writes a JSON object for each row, on a line."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self.joint = b""

    def values(self, rows: list[ValueRow]) -> None:
        """Add the lines of rows."""
        self.lines += self.texts(rows)

    def names(self, variable: Variable) -> str:
        """Return the keys of a variable."""
        return names_json(variable)

    def summary(self, summary: Summary) -> None:
        """Add an object for each variable."""
        from dissect.variables.summary import json_lines

        self.lines += json_lines(summary)

    def beginning(self, row: ValueRow) -> str:
        """Return the keys from ``schema`` to ``how``."""
        frame = str(row.frame)
        if self.places.several:
            name, number = self.places.locate(int(row.frame))
            frame = f'{number},"file":{json_text(name)}'
        return f'{_HEAD}{self.clock.iso(row.time_ns)}","frame":{frame}{self.ends(row)},"how":"{row.how}"'

    def between(self, row: ValueRow) -> str:
        """Return the keys of the connection and its ends."""
        return (
            f',"connection":{row.link.number},"client":{json_text(row.host)},"plc":{json_text(str(row.variable.plc))}'
        )

    def end(self, row: ValueRow, written: Written) -> str:
        """Return the remaining keys."""
        known: bool = written.text != ""
        before = written.text
        same: bool = known and row.previous is written.value
        if not known or row.value is not written.value:
            written.text = any_text(row.value)
            written.value = row.value
        value = was = written.text
        changed = "false"
        if row.first:
            was = changed = "null"
        elif row.changed:
            was = before if same else any_text(row.previous)
            changed = "true"
        data = row.data
        octets = f'"{data.hex()}"' if data is not None else "null"
        remark = _or_null(row.remark) if not row.pieced else f'"{PIECED}"'
        text = f',"text":{json_text(row.text)}' if row.text else ""
        likely = f',"certainty":"{row.certainty}","doubt":"{row.doubt}"' if row.doubt else ""
        return (
            f'{written.names},"value":{value}{text},"previous":{was},"changed":{changed}'
            f',"octets":{octets},"remark":{remark}{likely}}}'
        )


# ---- CSV ------------------------------------------------------------------------------------------------------------


class ValueCsv(RowWriter):
    """Writes the names of the columns, then a row for each value, or each variable of a summary."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self.joint = b""
        self._begun: bool = False

    def values(self, rows: list[ValueRow]) -> None:
        """Add the rows; the first call adds the heading, even without rows."""
        if not self._begun:
            self._begun = True
            self.lines.append(",".join(self.columns()))
        self.lines += self.texts(rows)

    def names(self, variable: Variable) -> str:
        """Return the cells of a variable, which are the same in all of its rows."""
        return ",".join([quoted(cell(text)) for text in (variable.address, variable.tag, variable.type)])

    def summary(self, summary: Summary) -> None:
        """Add a row for each variable."""
        from dissect.variables.summary import csv_rows

        self.lines += [",".join([quoted(text) for text in row]) for row in csv_rows(summary)]

    def columns(self) -> list[str]:
        """Return the names of the columns."""
        return [*CSV_COLUMNS[:2], FILE_COLUMN, *CSV_COLUMNS[2:]] if self.places.several else list(CSV_COLUMNS)

    def beginning(self, row: ValueRow) -> str:
        """Return the cells from ``time`` to ``how``. Numbers, times and addresses need no quotes."""
        frame = str(row.frame)
        if self.places.several:
            name, number = self.places.locate(int(row.frame))
            frame = f"{number},{quoted(cell(name))}"
        return f"{self.clock.iso(row.time_ns)},{frame},{self.ends(row)},{row.how},"

    def between(self, row: ValueRow) -> str:
        """Return the cells of the connection and its ends."""
        return f"{row.link.number},{row.host},{row.variable.plc}"

    def end(self, row: ValueRow, written: Written) -> str:
        """Return the remaining cells."""
        variable = row.variable
        data = row.data
        before = ""
        if row.changed:
            known: bool = written.text != "" and row.previous is written.value and row.before == written.data
            before = written.text if known else quoted(value_cell(variable, row.previous, row.before))
        written.text = quoted(value_cell(variable, row.value, data))
        written.value = row.value
        written.data = data
        was = before if row.changed else written.text
        changed = "" if row.first else "true" if row.changed else "false"
        unit = quoted(cell(variable.unit)) if variable.unit else ""
        text = quoted(cell(row.text)) if row.text else ""
        remark = PIECED if row.pieced else quoted(cell(row.remark)) if row.remark else ""
        octets = data.hex() if data is not None else ""
        likely = f"{row.certainty},{row.doubt}"
        return f"{written.names},{written.text},{text},{unit},{was},{changed},{octets},{remark},{likely}"


def value_cell(variable: Variable, value: object, data: bytes | None) -> str:
    """Return the cell of a value; octets of unknown meaning in hexadecimal."""
    if value is None:
        return ""
    if variable.bytes_only and data is not None and isinstance(value, list):
        return data.hex(" ")
    return json_cell(value)
