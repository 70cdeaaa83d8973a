"""Symbol tables of STEP 7 V5 (ASC, SDF, SEQ, DIF) and the SDF of TIA tag tables (sheet 1, 2.2)."""

from __future__ import annotations

import re
from typing import Final

from dissect.meaning.tags.tag_file import Row, TagFile
from dissect.meaning.tags.types import whole_number

#: Columns of an ASC line after its prefix: symbol, address, type, comment.
_ASC_LINE: Final = 130
_ASC_LEAST: Final = 41
_PREFIX: Final = re.compile(r"(\d{1,4}),")
_ASC_PREFIX: Final = "126"
#: Number of fields of an SDF row, in STEP 7 V5 and in TIA.
V5_FIELDS: Final = 4
TIA_FIELDS: Final = 9
_TIA_COMMENT: Final = 6
_BETWEEN: Final = re.compile(r'"\s*,\s*"')
_CONSTANT: Final = "CONSTANT"


def is_asc(first: str) -> bool:
    """Return whether a line looks like ASC: a length, a comma, columns."""
    return _PREFIX.match(first) is not None and len(first) >= _ASC_LEAST and '"' not in first[:6]


def read_asc(text: str, into: TagFile) -> None:
    """Read lines of fixed columns."""
    into.format = "STEP 7 V5 symbol table (ASC)"
    for line, row in enumerate(text.splitlines(), 1):
        if not row.strip("\x1a "):
            continue
        prefix = _PREFIX.match(row)
        if "\t" in row:
            into.problems.error(line, "tabs instead of blanks: an editor changed the columns; export the table again")
            continue
        if prefix is None or prefix[1] != _ASC_PREFIX:
            found = row[:8].strip()
            into.problems.error(
                line, f"begins with {found!r} instead of '126,': the file ends being ASC here; is it CSV?"
            )
            return
        cells = row.ljust(_ASC_LINE)
        symbol, address, type_, comment = cells[4:28].strip(), cells[28:39].strip(), cells[40:49], cells[50:130].strip()
        if len(row) > _ASC_LINE or (len(row) < _ASC_LEAST and not address):
            into.problems.error(
                line, f"has {len(row)} characters instead of {_ASC_LINE}: expected an address in columns 29 to 39"
            )
            continue
        _v5_row(into, line, symbol, address, " ".join(type_.split()), comment)


def read_sdf(text: str, into: TagFile) -> None:
    """Read rows of quoted fields: four fields are STEP 7 V5, nine are TIA."""
    fields = 0
    for line, written in enumerate(text.splitlines(), 1):
        if not written.strip("\x1a "):
            continue
        row = _quoted(written.strip())
        if not fields:
            fields = len(row)
            into.format = "TIA tag table (SDF)" if fields == TIA_FIELDS else "STEP 7 V5 symbol table (SDF)"
            if [cell.strip().lower() for cell in row[:2]] == ["name", "address"]:
                continue
        if len(row) not in {V5_FIELDS, TIA_FIELDS}:
            into.problems.error(line, f"{len(row)} fields: a row has 4 (STEP 7 V5) or 9 (TIA)")
            continue
        if len(row) != fields:
            which = "this is the TIA format" if len(row) == TIA_FIELDS else "this is the format of STEP 7 V5"
            into.problems.warning(line, f"{len(row)} fields where the first row has {fields}: {which}, read as that")
        cells = [cell.strip() for cell in row]
        if len(row) == TIA_FIELDS:
            _tia_row(into, line, cells)
        else:
            _v5_row(into, line, cells[0], cells[1], cells[2], cells[3])


def _quoted(line: str) -> list[str]:
    """Return the fields of a line of quoted fields.

    TIA does not double a quote inside a comment (seen in a file of V15), so CSV readers get such lines wrong. A comment that
    contains ``","`` makes too many fields: the surplus ones belong to the comment.
    """
    cells = _BETWEEN.split(line.removeprefix('"').removesuffix('"'))
    if len(cells) > TIA_FIELDS:
        end = len(cells) - (TIA_FIELDS - _TIA_COMMENT - 1)
        cells = [*cells[:_TIA_COMMENT], '","'.join(cells[_TIA_COMMENT:end]), *cells[end:]]
    return [cell.replace('""', '"') for cell in cells]


def _tia_row(into: TagFile, line: int, cells: list[str]) -> None:
    name, address, type_, comment = cells[0], cells[1], cells[2], cells[_TIA_COMMENT]
    if address.upper() == _CONSTANT:
        add_constant(into, name, cells[7])
        return
    into.add(Row(line, name, address, type_, comment))


def add_constant(into: TagFile, name: str, value: str) -> None:
    """Take a constant of a tag table, and count it as a row that is not a tag."""
    into.skipped["constants"] += 1
    take_constant(into, name, value)


def take_constant(into: TagFile, name: str, value: str) -> None:
    """Remember a constant if it is a whole number: it may be a bound of an array."""
    number = whole_number(value)
    if number is not None:
        into.constants[name.strip().lower()] = number


def _v5_row(into: TagFile, line: int, symbol: str, address: str, type_: str, comment: str) -> None:
    if not address:
        into.problems.error(line, f"{symbol!r} has no address")
    elif not into.name_block(symbol, address, type_, line):
        into.add(Row(line, symbol, address, type_, comment))


def read_seq(text: str, into: TagFile) -> None:
    """Read lines of address, symbol and comment, each after a tab; there are no types."""
    into.format = "STEP 7 V5 symbol table (SEQ)"
    for line, row in enumerate(text.splitlines(), 1):
        if not row.strip("\x1a \t") or row.lstrip().startswith(";"):
            continue
        cells = row.split("\t")
        if cells[0].strip() or len(cells) < 3:
            into.problems.error(line, "expected a tab, an address, a tab and a symbol")
            continue
        comment = cells[3].strip().lstrip(";") if len(cells) > 3 else ""
        _v5_row(into, line, cells[2].strip(), cells[1].strip(), "", comment)


def read_dif(text: str, into: TagFile) -> None:
    """Read DIF: a header, then rows of four texts."""
    into.format = "STEP 7 V5 symbol table (DIF)"
    lines = text.splitlines()
    at = next((number for number, line in enumerate(lines) if line.strip().upper() == "DATA"), len(lines)) + 3
    row: list[str] = []
    begun = 0
    ended = False
    while at + 1 < len(lines):
        kind, value = lines[at].strip(), lines[at + 1].strip()
        if kind.startswith("-1") or value.upper() == "EOD":
            if row:
                _dif_row(into, begun, row)
            row, begun = [], at + 1
            if value.upper() == "EOD":
                ended = True
                break
        elif kind.startswith("1"):
            row.append(value[1:-1].replace('""', '"') if value.startswith('"') else value)
        else:
            row.append(kind.partition(",")[2])
        at += 2
    if not ended:
        into.problems.error(len(lines), "the file ends without EOD: it was cut off; export it again")


def _dif_row(into: TagFile, line: int, row: list[str]) -> None:
    if len(row) < 2:
        into.problems.error(line, f"{len(row)} field in a row: expected symbol, address, type and comment")
        return
    cells = [" ".join(cell.split()) for cell in [*row, "", ""]]
    _v5_row(into, line, cells[0], cells[1], cells[2], cells[3])
