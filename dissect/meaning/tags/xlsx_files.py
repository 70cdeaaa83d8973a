"""Tag tables of TIA as XLSX (sheet 2.1), read by python-calamine."""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from typing import Any, Final

from dissect.meaning.tags.csv_tables import read_constants, read_rows
from dissect.meaning.tags.tag_file import TagFile

#: A workbook is a ZIP of XML files. Limits against ZIP bombs: members, octets when unpacked, and the ratio of unpacking, which
#: is not checked below `_SMALL` octets.
_MAX_MEMBERS: Final = 2000
_MAX_UNPACKED: Final = 512 << 20
_MAX_RATIO: Final = 200
_SMALL: Final = 4 << 20
#: Maximum number of cells of a sheet, empty ones included: before it reads, the library allocates the whole rectangle up to the
#: last cell with content, about 40 bytes for each cell. Half a million tags in the columns of TIA stay below it.
_MAX_CELLS: Final = 8_000_000
_CHUNK: Final = 1 << 20
#: The beginnings of rows and cells, with their places. The first alternative matches a cell with only a place and a style,
#: which the library ignores; one that is longer than the overlap of two pieces counts as a cell with content.
_SIGNS: Final = re.compile(
    rb"""<(?:[\w.-]{1,64}:)?c(?P<empty>(?: [rs] ?= ?(?:"\w{0,16}"|'\w{0,16}')){0,3}) ?(?:/>|></(?:[\w.-]{1,64}:)?c ?>)"""
    rb"""|<(?:[\w.-]{1,64}:)?(?P<tag>row|c)(?=[ />])"""
    rb"""|(?<![\w:.-])r ?= ?["'] ?(?P<letters>[A-Za-z]{0,7})(?P<digits>[0-9]{1,13})"""
)
_PLACE: Final = re.compile(rb""" r ?= ?["']([A-Za-z]{1,7})""")
_OVERLAP: Final = 128
_BLANKS: Final = re.compile(rb"\s+")
_TAGS: Final = "PLC Tags"
_CONSTANTS: Final = "Constants"
#: Sheets of other TIA tables, which have no tags.
_OTHERS: Final = {"Hmi Tags": "HMI tags", "DiscreteAlarms": "HMI alarms", "TextListEntry": "text lists"}


def is_workbook(octets: bytes) -> bool:
    """Return whether content is a ZIP with the parts of a workbook."""
    return octets.startswith(b"PK") and b"[Content_Types].xml" in octets


def read_xlsx(octets: bytes, into: TagFile) -> None:
    """Read the sheets ``PLC Tags`` and ``Constants``. Raises ImportError if the library is missing."""
    import python_calamine

    into.format = "TIA tag table (XLSX)"
    trouble = _bomb(octets) or _too_wide(octets)
    if trouble:
        into.problems.error(0, trouble)
        return
    try:
        book = python_calamine.CalamineWorkbook.from_filelike(io.BytesIO(octets))
        sheets = book.sheet_names
        if _TAGS not in sheets:
            kinds = [_OTHERS[name] for name in sheets if name in _OTHERS]
            said = f" ({kinds[0]})" if kinds else ""
            listed = ", ".join(sheets[:8])
            into.problems.error(0, f"has no sheet {_TAGS!r}, but {listed}{said}: export the PLC tag table")
            return
        rows = book.get_sheet_by_name(_TAGS).to_python(skip_empty_area=False)
        constants = book.get_sheet_by_name(_CONSTANTS).to_python(skip_empty_area=False) if _CONSTANTS in sheets else []
    except (python_calamine.CalamineError, OSError, ValueError) as error:
        into.problems.error(0, f"is not a readable workbook: {error}")
        return
    numbers = [number for number, row in enumerate(rows, 1) if any([isinstance(cell, float) for cell in row])]
    if numbers:
        into.problems.warning(
            numbers[0],
            "cells are numbers: a spreadsheet saved this file, and an address such as 0.10 may have become 0.1",
        )
    read_rows(((number, [_text(cell) for cell in row]) for number, row in enumerate(rows, 1)), into)
    read_constants(((number, [_text(cell) for cell in row]) for number, row in enumerate(constants, 1)), into)


def _text(cell: Any) -> str:
    """Return a cell as text; a whole number without a fraction."""
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return str(cell)


def _bomb(octets: bytes) -> str:
    """Return why a workbook must not be unpacked; empty if it may be."""
    try:
        with zipfile.ZipFile(io.BytesIO(octets)) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        return f"is not a readable workbook: {error}"
    size = sum([member.file_size for member in members])
    if len(members) > _MAX_MEMBERS or size > _MAX_UNPACKED or (size > _SMALL and size > _MAX_RATIO * len(octets)):
        return f"unpacks to {size} bytes in {len(members)} parts: too much for a tag table"
    return ""


class _Extent:
    """The extent of the cells of a part of a workbook: by their places or, for cells without a place, by counting."""

    def __init__(self) -> None:
        self.rows = 0
        self.columns = 0
        self._row = 0
        self._column = 0
        self._rest = b""

    def take(self, octets: bytes) -> None:
        """Note the rows and cells that begin in a piece of the part; call it with empty octets at the end."""
        text = _BLANKS.sub(b" ", self._rest + octets)
        end = len(text) - _OVERLAP if octets else len(text)
        for found in _SIGNS.finditer(text):
            if found.start() >= end:
                break
            end = max(end, found.end())
            empty: bytes | None = found["empty"]
            if empty is None:
                self._note(found["tag"], found["letters"], found["digits"])
            else:  # a cell without a place comes after this one
                places = [_column(letters) for letters in _PLACE.findall(empty)]
                self._column = max(places, default=self._column + 1)
        self._rest = text[max(0, end) :]

    def _note(self, tag: bytes | None, letters: bytes, digits: bytes) -> None:
        if tag == b"row":
            self._row += 1
            self._column = 0
            return
        row = int(digits) if digits else self._row
        if tag is None and not letters:
            self._row = row
            return
        self._column = self._column + 1 if tag is not None else _column(letters)
        self.columns = max(self.columns, self._column)
        self.rows = max(self.rows, row)


def _column(letters: bytes) -> int:
    number = 0
    for letter in letters.upper():
        number = 26 * number + letter - 64
    return number


def _too_wide(octets: bytes) -> str:
    """Return why a workbook must not be given to the library; empty if it may be.

    Other parts declare which part is a sheet, and the library accepts much that is not well-formed XML. Therefore all parts are
    searched as they are unpacked, without trusting the sizes in the directory and without parsing the XML.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(octets)) as archive:
            for member in archive.infolist():
                extent = _Extent()
                with archive.open(member) as part:
                    more = True
                    while more:
                        piece = part.read(_CHUNK)
                        more = bool(piece)
                        extent.take(piece)
                        if extent.rows * extent.columns > _MAX_CELLS:
                            return (
                                f"a sheet reaches to row {extent.rows} and column {extent.columns}: more than {_MAX_CELLS} "
                                "cells, too much for a tag table; delete the rows and columns far from the tags"
                            )
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError) as error:
        return f"is not a readable workbook: {error}"
    return ""
