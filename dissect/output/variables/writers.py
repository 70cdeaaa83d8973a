"""Rows of values as text, JSON lines and CSV (docs/values.md), put together from texts that are cached for each variable."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.transactions.transaction import SURE
from dissect.meaning.report import words
from dissect.meaning.report.certainty import doubt_mark
from dissect.meaning.report.item_json import decoded_json
from dissect.meaning.report.line_octets import ERRORS
from dissect.meaning.report.styled import HANG, PLAIN, Line
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import Writer
from dissect.meaning.report.writers.csv import json_cell, quoted
from dissect.output.variables.model import UNTOLD, SharedValue, ValueRow, Variable
from dissect.output.variables.value_octets import write_cell, write_hex, write_json, write_shown
from dissect.protocols.s7plus.value_showing import members_said
from dissect.wire.digits import Moments, Times, write_aligned, write_decimal, write_hexadecimal
from dissect.wire.text import Clock, cell, json_text, shortened

if TYPE_CHECKING:
    from dissect.output.variables.summary import Summary

VALUE_SCHEMA: Final = "s7dissect.value/1"
_HEAD: Final = f'{{"schema":"{VALUE_SCHEMA}","time":"'.encode("ascii")
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
#: A cache with this many entries is emptied.
_MAX_CACHED: Final = 8192
_NAME: Final = 100
_STRUCT: Final = 200
#: The S7comm-plus type whose values are octets, and their form in JSON.
_BLOB: Final = "Blob"
_HEXADECIMAL: Final = re.compile(r"([0-9a-f]{2})*")
#: The remark on a value of which only a part was transferred.
PIECED: Final = "only a part of its bytes passed"
#: The last cells of a row without a remark that is certain.
_SURE: Final = f",,{SURE},".encode("ascii")
#: Minimum width of the number of a packet in a line.
_FRAME_WIDTH: Final = 6
_QUOTE: Final = 0x22
_COMMA: Final = 0x2C


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

    __slots__ = ("_frame", "_how", "_side", "octets")

    def __init__(self) -> None:
        self.octets: bytes = b""
        self._side: i64 = 0
        self._how: str = ""
        self._frame: i64 = 0

    def fits(self, row: ValueRow) -> bool:
        """Return whether ``octets`` are the beginning of ``row``; if not, remember ``row``, and the caller must set them.

        A packet has one time, and is of one connection.
        """
        if row.frame == self._frame and row.side == self._side and row.how == self._how:
            return True
        self._side = row.side
        self._how = row.how
        self._frame = row.frame
        return False


class Written:
    """The texts that a writer keeps for a variable: its ``names``, and its latest value with the text written for it.

    ``repeated`` is the end of a row without a change; empty if no such row was written yet.
    """

    __slots__ = ("names", "repeated", "shown", "told")

    def __init__(self, names: bytes) -> None:
        self.names: bytes = names
        self.told: SharedValue = UNTOLD
        self.shown: bytes = b""
        self.repeated: bytes = b""


class RowWriter(ValueWriter):
    """Writes a row as a beginning, which the rows of a transaction share, and an end, which repeats with the same value.

    Rows are octets in UTF-8, written into one buffer; usual values are written from their octets (`value_octets`).
    """

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._out: BytesWriter = BytesWriter()
        self._begin: i64 = 0  # position in ``_out`` of the value that was just written
        self._end: i64 = 0
        self._beginnings: Beginnings = Beginnings()
        self._written: dict[Variable, Written] = {}
        self._ends: dict[int, bytes] = {}

    def _ends_of(self, row: ValueRow) -> bytes:
        """Return `between`, which is made once for each connection and direction."""
        key: i64 = row.link.number * 2 + row.side
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MAX_CACHED:
                self._ends.clear()
            found = self.between(row).encode("utf-8", ERRORS)
            self._ends[key] = found
        return found

    def _names_of(self, variable: Variable) -> Written:
        """Return the kept texts of a variable that has no row yet."""
        if len(self._written) >= _MAX_CACHED:
            self._written.clear()
        written = Written(self.names(variable).encode("utf-8", ERRORS))
        self._written[variable] = written
        return written

    def octets(self, rows: list[ValueRow]) -> list[bytes]:
        """Return the octets of each row."""
        found: list[bytes] = []
        beginnings = self._beginnings
        out = self._out
        for row in rows:
            if not beginnings.fits(row):
                out.truncate(0)
                self.beginning(out, row)
                beginnings.octets = out.getvalue()
            written = self._written.get(row.variable)
            if written is None:
                written = self._names_of(row.variable)
            plain: bool = not row.changed and not row.pieced and not row.remark and not row.doubt
            if plain and row._told is written.told and written.repeated:
                found.append(beginnings.octets + written.repeated)
                continue
            out.truncate(0)
            out.write(beginnings.octets)
            self.end(out, row, written)
            octets = out.getvalue()
            found.append(octets)
            written.told = row._told
            written.shown = octets[self._begin : self._end]
            written.repeated = octets[len(beginnings.octets) :] if plain else b""
        return found

    def _show(self, out: BytesWriter, row: ValueRow, written: Written) -> None:
        """Write the value of a row."""
        self._begin = len(out)
        self.show(out, row.variable, row._told)
        self._end = len(out)

    def _show_previous(self, out: BytesWriter, row: ValueRow, written: Written) -> None:
        """Write the value before that of a row: mostly the one that was written last."""
        if row._was is written.told:
            out.write(written.shown)
        else:
            self.show(out, row.variable, row._was)

    def names(self, variable: Variable) -> str:
        """Return the part of its rows that names a variable."""
        return ""

    def beginning(self, out: BytesWriter, row: ValueRow) -> None:
        """Write the part that the rows of a transaction share: time, packet, both ends, how the value was transferred."""

    def between(self, row: ValueRow) -> str:
        """Return the client and the PLC of a row."""
        return ""

    def show(self, out: BytesWriter, variable: Variable, told: SharedValue) -> None:
        """Write a value."""

    def end(self, out: BytesWriter, row: ValueRow, written: Written) -> None:
        """Write the rest of a row."""


class ValueText(RowWriter):
    """Writes a line for each row: time, packet, both ends, how, the value, and a different value before it."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._moments: Moments = Moments(self.clock)

    def values(self, rows: list[ValueRow]) -> None:
        """Add the lines of rows."""
        lines = self.octets(rows)
        if self.plain:
            self.lines += lines
        else:
            self.lines += [Line(octets.decode("utf-8"), PLAIN, HANG) for octets in lines]

    def names(self, variable: Variable) -> str:
        """Return a variable and its type."""
        return typed_text(variable)

    def beginning(self, out: BytesWriter, row: ValueRow) -> None:
        """Write the part that the lines of a transaction share."""
        if self.places.several:
            ends = self._ends_of(row).decode("utf-8")
            out.write(line_beginning(row, self.clock, self.places, ends).encode("utf-8", ERRORS))
            return
        self._moments.write(out, row.time_ns)
        out.write(b"  ")
        write_aligned(out, row.frame, _FRAME_WIDTH)
        out.write(b"  ")
        out.write(self._ends_of(row))
        out.write(f"  {row.how:<5}  ".encode("ascii"))

    def between(self, row: ValueRow) -> str:
        """Return both ends."""
        return ends_text(row, self.places)

    def show(self, out: BytesWriter, variable: Variable, told: SharedValue) -> None:
        """Write a value for a person."""
        # Values with a name or a unit are decoded already: `write_shown` leaves them to the slow way.
        data = told.data
        if variable.bytes_only:
            if data is not None and write_hex(out, data):
                return
        elif write_shown(out, told):
            return
        out.write(shown(variable, told.value, told.data, told.text).encode("utf-8", ERRORS))

    def end(self, out: BytesWriter, row: ValueRow, written: Written) -> None:
        """Write the variable with its value, and a value before it that was different."""
        out.write(written.names)
        out.write(b" = ")
        self._show(out, row, written)
        if row.changed and not row.first:
            out.write(b"  was ")
            self._show_previous(out, row, written)
        if row.remark or row.pieced or row.doubt:
            out.write(line_remarks(row).encode("utf-8", ERRORS))

    def summary(self, summary: Summary) -> None:
        """Add a table with a line for each variable."""
        from dissect.output.variables.summary import text_lines

        self.lines += text_lines(summary, self.clock, self.places)


def value_line(row: ValueRow, clock: Clock, places: Places) -> str:
    """Return one value on one line."""
    return line_beginning(row, clock, places, ends_text(row, places)) + line_end(row, typed_text(row.variable))


def ends_text(row: ValueRow, places: Places) -> str:
    """Return the client that read, wrote or subscribed, and the PLC."""
    return f"{places.host(row.client)} → {places.end(row.variable.plc)}"


def line_beginning(row: ValueRow, clock: Clock, places: Places, ends: str) -> str:
    """Return time, packet, both ends, and how a value was transferred."""
    return f"{clock.moment(row.time_ns)}  {places.mark(int(row.frame)):>{_FRAME_WIDTH}}  {ends}  {row.how:<5}  "


def typed_text(variable: Variable) -> str:
    """Return a variable and its type for a person."""
    return f"{place_text(variable)} {variable.type}" if variable.type else place_text(variable)


def line_end(row: ValueRow, what: str) -> str:
    """Return the value of a row, and the value before it if that was different."""
    variable = row.variable
    was = ""
    if row.changed and not row.first:
        was = f"  was {shown(variable, row.previous, row.before, row.previous_text)}"
    return f"{what} = {shown(variable, row.value, row.data, row.text)}{was}{line_remarks(row)}"


def line_remarks(row: ValueRow) -> str:
    """Return the oddity of a value, for the end of its line; empty for none."""
    # The remark on an SCD value is only shown if there is no value: it has no ``data``.
    odd = row.remark and (row.value is None or row.data is not None)
    remark = f"  [{shortened(row.remark, _NAME)}]" if odd else ""
    if row.pieced:
        remark = f"  [{PIECED}]"
    return f"{remark}  {doubt_mark(row.doubt)}" if row.doubt else remark


# ---- JSON -----------------------------------------------------------------------------------------------------------


def any_text(value: object) -> str:
    """Return any value as JSON, also an S7comm-plus value with members."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return decoded_json(value)
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
        self._times: Times = Times()

    def values(self, rows: list[ValueRow]) -> None:
        """Add the lines of rows."""
        self.lines += self.octets(rows)

    def names(self, variable: Variable) -> str:
        """Return the keys of a variable."""
        return names_json(variable)

    def summary(self, summary: Summary) -> None:
        """Add an object for each variable."""
        from dissect.output.variables.summary import json_lines

        self.lines += json_lines(summary)

    def beginning(self, out: BytesWriter, row: ValueRow) -> None:
        """Write the keys from ``schema`` to ``how``."""
        out.write(_HEAD)
        self._times.write(out, row.time_ns)
        out.write(b'","frame":')
        if self.places.several:
            name, number = self.places.locate(int(row.frame))
            out.write(f'{number},"file":{json_text(name)}'.encode("utf-8", ERRORS))
        else:
            write_decimal(out, row.frame)
        out.write(self._ends_of(row))
        out.write(f',"how":"{row.how}"'.encode("ascii"))

    def between(self, row: ValueRow) -> str:
        """Return the keys of the connection and its ends."""
        return (
            f',"connection":{row.link.number},"client":{json_text(row.host)},"plc":{json_text(str(row.variable.plc))}'
        )

    def show(self, out: BytesWriter, variable: Variable, told: SharedValue) -> None:
        """Write a value as JSON."""
        if not write_json(out, told):
            out.write(any_text(told.value).encode("utf-8", ERRORS))

    def end(self, out: BytesWriter, row: ValueRow, written: Written) -> None:
        """Write the remaining keys."""
        out.write(written.names)
        out.write(b',"value":')
        self._show(out, row, written)
        told = row._told
        if told.text:
            out.write(f',"text":{json_text(told.text)}'.encode("utf-8", ERRORS))
        out.write(b',"previous":')
        if row.first:
            out.write(b'null,"changed":null,"octets":')
        elif row.changed:
            self._show_previous(out, row, written)
            out.write(b',"changed":true,"octets":')
        else:
            self.show(out, row.variable, told)
            out.write(b',"changed":false,"octets":')
        data = told.data
        if data is None:
            out.write(b"null")
        else:
            out.append(_QUOTE)
            write_hexadecimal(out, data, 0, len(data))
            out.append(_QUOTE)
        if not row.remark and not row.pieced and not row.doubt:
            out.write(b',"remark":null}')
            return
        remark = _or_null(row.remark) if not row.pieced else f'"{PIECED}"'
        likely = f',"certainty":"{row.certainty}","doubt":"{row.doubt}"' if row.doubt else ""
        out.write(f',"remark":{remark}{likely}}}'.encode("utf-8", ERRORS))


# ---- CSV ------------------------------------------------------------------------------------------------------------


class ValueCsv(RowWriter):
    """Writes the names of the columns, then a row for each value, or each variable of a summary."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self.joint = b""
        self._times: Times = Times()
        self._begun: bool = False

    def values(self, rows: list[ValueRow]) -> None:
        """Add the rows; the first call adds the heading, even without rows."""
        if not self._begun:
            self._begun = True
            self.lines.append(",".join(self.columns()).encode("ascii"))
        self.lines += self.octets(rows)

    def names(self, variable: Variable) -> str:
        """Return the cells of a variable, which are the same in all of its rows."""
        return ",".join([quoted(cell(text)) for text in (variable.address, variable.tag, variable.type)])

    def summary(self, summary: Summary) -> None:
        """Add a row for each variable."""
        from dissect.output.variables.summary import csv_rows

        self.lines += [",".join([quoted(text) for text in row]) for row in csv_rows(summary)]

    def columns(self) -> list[str]:
        """Return the names of the columns."""
        return [*CSV_COLUMNS[:2], FILE_COLUMN, *CSV_COLUMNS[2:]] if self.places.several else list(CSV_COLUMNS)

    def beginning(self, out: BytesWriter, row: ValueRow) -> None:
        """Write the cells from ``time`` to ``how``. Numbers, times and addresses need no quotes."""
        self._times.write(out, row.time_ns)
        out.append(_COMMA)
        if self.places.several:
            name, number = self.places.locate(int(row.frame))
            out.write(f"{number},{quoted(cell(name))}".encode("utf-8", ERRORS))
        else:
            write_decimal(out, row.frame)
        out.append(_COMMA)
        out.write(self._ends_of(row))
        out.write(f",{row.how},".encode("ascii"))

    def between(self, row: ValueRow) -> str:
        """Return the cells of the connection and its ends."""
        return f"{row.link.number},{row.host},{row.variable.plc}"

    def show(self, out: BytesWriter, variable: Variable, told: SharedValue) -> None:
        """Write the cell of a value."""
        if variable.bytes_only or not write_cell(out, told):
            out.write(quoted(value_cell(variable, told.value, told.data)).encode("utf-8", ERRORS))

    def end(self, out: BytesWriter, row: ValueRow, written: Written) -> None:
        """Write the remaining cells."""
        variable = row.variable
        told = row._told
        out.write(written.names)
        out.append(_COMMA)
        self._show(out, row, written)
        if told.text or variable.unit:
            text = quoted(cell(told.text)) if told.text else ""
            out.write(f",{text},{quoted(cell(variable.unit))},".encode("utf-8", ERRORS))
        else:
            out.write(b",,,")
        if not row.changed:
            self.show(out, variable, told)
        elif not row.first:
            self._show_previous(out, row, written)
        out.write(b",," if row.first else b",true," if row.changed else b",false,")
        data = told.data
        if data is not None:
            write_hexadecimal(out, data, 0, len(data))
        if not row.remark and not row.pieced and not row.doubt:
            out.write(_SURE)
            return
        remark = PIECED if row.pieced else quoted(cell(row.remark)) if row.remark else ""
        out.write(f",{remark},{row.certainty},{row.doubt}".encode("utf-8", ERRORS))


def value_cell(variable: Variable, value: object, data: bytes | None) -> str:
    """Return the cell of a value; octets of unknown meaning in hexadecimal."""
    if value is None:
        return ""
    if variable.bytes_only and data is not None and isinstance(value, list):
        return data.hex(" ")
    return json_cell(value)
