"""Tag tables of TIA as XLSX (sheet 2.1), read by python-calamine."""

from __future__ import annotations

import io
import zipfile
from typing import Any, Final

from dissect.tags.csv_tables import read_constants, read_rows
from dissect.tags.tag_file import TagFile

#: A workbook is a ZIP of XML: what it may unpack to, in members, octets, and octets for one of the file.
_MAX_MEMBERS: Final = 2000
_MAX_UNPACKED: Final = 512 << 20
_MAX_RATIO: Final = 200
_SMALL: Final = 4 << 20
_TAGS: Final = "PLC Tags"
_CONSTANTS: Final = "Constants"
#: Sheets of other tables of TIA.
_OTHERS: Final = {"Hmi Tags": "HMI tags", "DiscreteAlarms": "HMI alarms", "TextListEntry": "text lists"}


def is_workbook(octets: bytes) -> bool:
    """Tell whether content is a ZIP that has the parts of a workbook."""
    return octets.startswith(b"PK") and b"[Content_Types].xml" in octets


def read_xlsx(octets: bytes, into: TagFile) -> None:
    """Read the sheets ``PLC Tags`` and ``Constants``. Raises ImportError."""
    import python_calamine

    into.format = "TIA tag table (XLSX)"
    trouble = _bomb(octets)
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
    """Return a cell as text; whole numbers without a fraction."""
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return str(cell)


def _bomb(octets: bytes) -> str:
    """Return why a workbook is not unpacked, empty when it may be."""
    try:
        with zipfile.ZipFile(io.BytesIO(octets)) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        return f"is not a readable workbook: {error}"
    size = sum([member.file_size for member in members])
    if len(members) > _MAX_MEMBERS or size > _MAX_UNPACKED or (size > _SMALL and size > _MAX_RATIO * len(octets)):
        return f"unpacks to {size} bytes in {len(members)} parts: too much for a tag table"
    return ""
