"""Tables with a header: our own CSV, python-snap7, Node-RED, Kepware, ENLYZE, KICS, and the rows of XLSX (sheet 2.1, 5)."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from dissect.meaning.tags.symbol_tables import add_constant
from dissect.meaning.tags.tag_file import Row, Scale, TagFile, parse_scale
from dissect.meaning.tags.types import TypeNameError, tag_type
from dissect.wire.config.hints import close_names
from dissect.wire.text import uncell

_DELIMITERS: Final = (",", ";", "\t")
#: The meaning of a column, by its header in lower case.
COLUMNS: Final[dict[str, str]] = {
    **dict.fromkeys(("name", "tag", "tag name", "varname", "variable", "symbol"), "name"),
    **dict.fromkeys(("address", "addr", "logical address", "adresse", "logische adresse", "operand", "code"), "address"),
    **dict.fromkeys(("type", "data type", "datatype", "datentyp", "typ"), "type"),
    **dict.fromkeys(("comment", "description", "kommentar", "beschreibung", "remark"), "comment"),
    **dict.fromkeys(("unit", "eng units", "einheit"), "unit"),
    **dict.fromkeys(("scale", "factor", "skalierung", "faktor"), "scale"),
    "db": "db",
    "offset": "offset",
    "bit": "bit",
    "block": "block",
    "value": "value",
    "scaling": "scaling",
    "raw low": "raw low",
    "raw high": "raw high",
    "scaled low": "scaled low",
    "scaled high": "scaled high",
}
#: Columns in files of other tools that are not needed.
_OTHERS: Final = frozenset(
    (
        "path", "pfad", "hmi visible", "hmi accessible", "hmi writeable", "typeobject id", "version id", "id", "connection",
        "device", "respect data type", "client access", "scan rate", "scaled data type", "clamp low", "clamp high",
        "negate value",
    )
)  # fmt: skip
_KEPWARE: Final = frozenset(("tag name", "address", "respect data type"))
_ENLYZE: Final = frozenset(("device", "block", "variable", "code"))
_BLOCK_NAME: Final = re.compile(r"DB(\d+)\s*\((.*)\)")
#: A first line by which spreadsheets tell the separator: ``sep=;``.
_SEPARATOR: Final = re.compile(r'"?sep=.?"?\s*$', re.IGNORECASE)
_SPOILED: Final = re.compile(r"\d{1,2}[.-](?:[A-Za-z]{3}|\d{1,2}[.-]\d{2,4})")


class Head(NamedTuple):
    """The header of a table: the index of each column, and the tool that the table is from."""

    places: dict[str, int]
    format: str

    def cell(self, row: Sequence[str], column: str) -> str:
        """Return the cell of a column; empty if the table does not have this column."""
        at = self.places.get(column, -1)
        return row[at].strip() if 0 <= at < len(row) else ""


def delimiter_of(line: str) -> str:
    """Return the delimiter of a line: the one that splits it into an address and a name, else the most frequent one."""
    for mark in _DELIMITERS[1:]:
        cells = line.split(mark)
        if len(cells) > 1 and _pair(cells) is not None:
            return mark
    return max(_DELIMITERS, key=lambda mark: (line.count(mark), -_DELIMITERS.index(mark)))


def first_line(text: str) -> str:
    """Return the first line that is neither empty, nor a comment, nor ``sep=``."""
    return next((line for line in text.splitlines() if line.strip() and not _aside(line)), "")


def _aside(line: str) -> bool:
    return line.lstrip().startswith("#") or _SEPARATOR.match(line) is not None


def has_header(line: str) -> bool:
    """Return whether a line has names of columns."""
    return _known(_cells(line)) >= 2


def looks_like_table(line: str) -> bool:
    """Return whether a line is the header of a table of tags, or has two cells of which one is an address."""
    return has_header(line) or _pair(_cells(line)) is not None


def _cells(line: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter_of(line)), [])
    except csv.Error:
        return []


def _known(cells: Iterable[str]) -> int:
    return len([cell for cell in cells if cell.strip().lower() in COLUMNS])


def _pair(cells: list[str]) -> tuple[int, int] | None:
    """Return the indexes of address and name in a line of a table without a header; None if neither cell is an address.

    A line with a type in its second cell and more after it is from a table whose header is missing: return None.
    """
    from dissect.meaning.tags.address import AddressError, parse_tag_address

    if len(cells) < 2 or (len(cells) > 2 and cells[2].strip() and _is_type(cells[1])):
        return None
    for at in (0, 1):
        try:
            parse_tag_address(cells[at])
        except (AddressError, TypeNameError):
            continue
        return at, 1 - at
    return None


def _is_type(cell: str) -> bool:
    try:
        tag_type(cell)
    except TypeNameError:
        return False
    return True


def read_csv(text: str, into: TagFile) -> None:
    """Read a table of text."""
    try:
        _read_csv(text, into)
    except csv.Error as error:
        into.problems.error(0, f"cannot be read as a table: {error}; is a quote missing that ends a cell?")


def _read_csv(text: str, into: TagFile) -> None:
    first = first_line(text)
    delimiter = delimiter_of(first)
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)  # comments may contain other line ends
    numbered = ((rows.line_num, row) for row in rows if row and not _aside(row[0]))
    if delimiter == ";":
        into.problems.note(1, "cells are separated by semicolons; decimal commas are read as points")
    pair = _pair(_cells(first)) if not has_header(first) else None
    if pair is not None:
        into.format = "list of addresses and names"
        address, name = pair
        for line, row in numbered:
            if len(row) > 1 and any([cell.strip() for cell in row]):
                into.add(Row(line, row[name].rstrip(","), row[address]))  # spreadsheets leave commas
        return
    read_rows(numbered, into, decimal_comma=delimiter != ",")


def read_rows(rows: Iterable[tuple[int, Sequence[str]]], into: TagFile, *, decimal_comma: bool = False) -> None:
    """Read the rows of a table, each (line, cells); the first row that is not empty is the header."""
    head: Head | None = None
    columns = 0
    for line, row in rows:
        if not any([cell.strip() for cell in row]):
            continue
        if head is None:
            head = find_head(row, line, into)
            if head is None:
                return
            columns = len(row)
            continue
        if any([cell.strip() for cell in row[columns:]]):
            into.problems.warning(
                line,
                f"{len(row)} cells where the header has {columns}: is a cell that holds a separator without quotes? "
                f"{row[columns].strip()[:40]!r} and what follows was left out",
            )
        _take(head, row, line, into, decimal_comma)


def find_head(row: Sequence[str], line: int, into: TagFile) -> Head | None:
    """Return the header of a table; None, and a problem is noted, if needed columns are missing."""
    names = [cell.strip().strip("\ufeff").lower() for cell in row]
    places: dict[str, int] = {}
    for at, name in enumerate(names):
        if name in COLUMNS:
            places.setdefault(COLUMNS[name], at)
    found = set(names)
    if found >= _KEPWARE:
        kind = "Kepware tag list"
    elif found >= _ENLYZE:
        kind = "ENLYZE S7-Project-Explorer list"
    elif {"tag", "db", "offset", "type"} <= found:
        kind = "python-snap7 tag list"
    elif "logical address" in found or "logische adresse" in found:
        kind = "TIA tag table"
    else:
        kind = "tag list"
    into.format = into.format or kind
    offset = "db" in places and "offset" in places
    if "name" not in places or not ("address" in places or offset):
        listed = ", ".join([cell.strip()[:30] for cell in row if cell.strip()][:12])
        into.problems.error(
            line, f"the header is {listed!r}: expected columns Name and Address (or Logical Address), or tag, db, offset, type"
        )
        return None
    for at, name in enumerate(names):
        if name and name not in COLUMNS and name not in _OTHERS:
            near = close_names(name, COLUMNS)
            hint = f"; close to it: {', '.join(near)}" if near else ""
            into.problems.warning(line, f"column {row[at].strip()[:40]!r} is not known and was left out{hint}")
    return Head(places, kind)


def _take(head: Head, row: Sequence[str], line: int, into: TagFile, decimal_comma: bool) -> None:
    kepware = head.format.startswith("Kepware")
    name, address, type_ = head.cell(row, "name"), head.cell(row, "address"), head.cell(row, "type")
    if "address" not in head.places:
        offset, _, bit = head.cell(row, "offset").partition(".")
        bit = head.cell(row, "bit") or bit
        address = f"DB{head.cell(row, 'db')}:{offset}{f'.{bit}' if bit else ''}"
    if _SPOILED.fullmatch(address):
        into.problems.error(line, f"{address!r} is a date: a spreadsheet changed the address; format its column as text")
        return
    if head.format.startswith("ENLYZE"):
        if not address:
            into.problems.warning(line, f"a warning of the exporting program: {row[-1].strip()[:80]}")
            return
        block = _BLOCK_NAME.fullmatch(head.cell(row, "block"))
        name = f"{block[2]}.{name}" if block else name
    if not address:
        into.problems.error(line, f"{name[:60]!r} has no address")
        return
    try:
        scale = _scale(head, row, decimal_comma)
    except ValueError as error:
        into.problems.error(line, f"{name[:60]}: {error}")
        return
    if into.name_block(name, address, type_, line):
        return
    comment, unit = uncell(head.cell(row, "comment")), uncell(head.cell(row, "unit"))
    into.add(Row(line, uncell(name), address, "" if kepware else type_, comment, unit, scale), foreign=kepware)


def _scale(head: Head, row: Sequence[str], decimal_comma: bool) -> Scale:
    """Return the scale of a row; in Kepware it is linear between two ranges. Raises ValueError."""
    text = head.cell(row, "scale")
    if head.cell(row, "scaling").lower() == "linear":
        ranges = [head.cell(row, name) for name in ("raw low", "raw high", "scaled low", "scaled high")]
        text = f"{ranges[0]}..{ranges[1]}={ranges[2]}..{ranges[3]}"
    return parse_scale(text.replace(",", ".") if decimal_comma else text)


def read_constants(rows: Iterable[tuple[int, Sequence[str]]], into: TagFile) -> None:
    """Read the constants of a tag table, whose rows have a name and a value."""
    head: Head | None = None
    for _, row in rows:
        if head is None:
            names = [cell.strip().lower() for cell in row]
            head = Head({COLUMNS[name]: at for at, name in enumerate(names) if name in COLUMNS}, "constants")
        elif head.cell(row, "name"):
            add_constant(into, head.cell(row, "name"), head.cell(row, "value"))
