"""Shared by the tests of tags: a conversation about a tank, and files that name its variables."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from typing import Final

from tests.meaning.report.support import begun, read, saved
from tests.properties.messages import Item, dt, write_answer, write_job

TANK: Final = """address,type,name,unit,scale,comment
DB1.DBD0,REAL,Tank.Level,m,,level
DB1.DBX4.0,BOOL,Tank.Pump,,,
DB1.DBW6,INT,Tank.Temp,°C,0.1,
"""


def tank_file(folder: Path, text: str = TANK, name: str = "tank.csv") -> Path:
    """Write a file of tags."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def tank_capture(folder: Path) -> Path:
    """Write a capture in which the tank is read: whole, its pump, and a missing block."""
    talk = begun()
    read(talk, 2, Item(2, 10, 1, 0x84, 0), struct.pack(">fBxhh", 3.5, 1, 215, 7))
    read(talk, 3, Item(1, 1, 1, 0x84, 32), b"\x01")
    read(talk, 4, Item(8, 1, 1, 0x84, 0), 0x0A)
    return saved(folder / "tank.pcapng", talk.packets())


#: A block of the tank in AWL, with a type of its own.
TANK_AWL: Final = """TYPE "Motor"
VERSION : 0.1
  STRUCT
   speed : REAL ;	//rpm
   on : BOOL ;
  END_STRUCT ;
END_TYPE

DATA_BLOCK "Tank"
TITLE =the tank's block
VERSION : 0.1
  STRUCT
   level : REAL ;	//in metres
   pump : "Motor" ;
   curve : ARRAY [1 .. 3 ] OF INT ;
  END_STRUCT ;
BEGIN
   level := 0.000000e+000;
END_DATA_BLOCK
"""

_SHEET: Final = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_PARTS: Final = "http://schemas.openxmlformats.org/package/2006"
_OFFICE: Final = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"


def asc_line(symbol: str, operand: str, number: str, type_: str, comment: str = "") -> str:
    """Return a line of an ASC symbol table; ``number`` is right-justified, a bit in the columns after it."""
    whole, dot, bit = number.partition(".")
    address = f"{operand:<4}{whole:>5}{f'.{bit}' if dot else '':<2}"
    return f"126,{symbol:<24}{address} {type_:<9} {comment:<80}"


def sdf_line(name: str, address: str, type_: str, comment: str = "", value: str = "") -> str:
    """Return a line of the SDF of a TIA tag table."""
    return f'"{name}","{address}","{type_}","True","True","False","{comment}","{value}","True"'


def workbook(path: Path, rows: list[list[str]], sheet: str = "PLC Tags", more: str = "") -> Path:
    """Write a workbook as the TIA portal does: a prefix on every name, one part called sheet.xml, shared strings.

    ``more`` is XML after the last row.
    """
    texts = sorted({cell for row in rows for cell in row})
    cells = "".join(
        [
            f'<x:row r="{number}">'
            + "".join(
                [
                    f'<x:c r="{chr(65 + at)}{number}" t="s"><x:v>{texts.index(cell)}</x:v></x:c>'
                    for at, cell in enumerate(row)
                ]
            )
            + "</x:row>"
            for number, row in enumerate(rows, 1)
        ]
    )
    shared = "".join([f"<x:si><x:t>{text}</x:t></x:si>" for text in texts])
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{_PARTS}/content-types"><Default Extension="xml" ContentType="application/xml"/>'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{_PARTS}/relationships"><Relationship Type="{_OFFICE}/officeDocument" '
        'Target="/xl/workbook.xml" Id="R1"/></Relationships>',
        "xl/workbook.xml": f'<x:workbook xmlns:x="{_SHEET}" xmlns:r="{_OFFICE}"><x:sheets><x:sheet name="{sheet}" sheetId="1" '
        'r:id="R1"/></x:sheets></x:workbook>',
        "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{_PARTS}/relationships"><Relationship Type="{_OFFICE}/worksheet" '
        f'Target="/xl/worksheets/sheet.xml" Id="R1"/><Relationship Type="{_OFFICE}/sharedStrings" '
        'Target="/xl/sharedStrings.xml" Id="R2"/></Relationships>',
        "xl/worksheets/sheet.xml": f'<x:worksheet xmlns:x="{_SHEET}"><x:sheetData>{cells}{more}</x:sheetData></x:worksheet>',
        "xl/sharedStrings.xml": f'<x:sst xmlns:x="{_SHEET}">{shared}</x:sst>',
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in parts.items():
            archive.writestr(name, "\ufeff" + text)
    return path


#: The header of a tag table as the portal writes it, and rows of it.
TIA_HEAD: Final = [
    "Name", "Path", "Data Type", "Logical Address", "Comment", "Hmi Visible", "Hmi Accessible", "Hmi Writeable",
    "Typeobject ID", "Version ID",
]  # fmt: skip


def tia_row(name: str, type_: str, address: str, comment: str = "") -> list[str]:
    """Return a row of such a table."""
    return [name, "Default tag table", type_, address, comment, "True", "True", "True", "", ""]


def example_files(folder: Path) -> None:
    """Write the files that are named in the examples of help texts."""
    workbook(
        folder / "plc_tags.xlsx", [TIA_HEAD, tia_row("Start", "Bool", "%I0.0"), tia_row("Speed", "Real", "%MD4", "rpm")]
    )
    (folder / "tank.awl").write_text(TANK_AWL.replace('"Tank"', "DB 10"), encoding="utf-8")
    table = [asc_line("Tank", "DB", "10", "DB     10"), asc_line("Start", "I", "0.0", "BOOL", "start")]
    (folder / "symbols.asc").write_text("".join([f"{line}\r\n" for line in table]), encoding="utf-8")
    lines = [sdf_line("Start", "%I0.0", "Bool", "кнопка"), sdf_line("Limit", "CONSTANT", "Int", "", "5")]
    (folder / "plc_tags.sdf").write_bytes("".join([f"{line}\r\n" for line in lines]).encode("cp1251"))


def write_captures(folder: Path) -> tuple[Path, Path]:
    """Write two captures of one session; they differ in the level read, the bytes after it, and the written setpoint."""
    paths = []
    for name, level, setpoint, rest in (("a", 3.5, 80, 7), ("b", 4.0, 95, 9)):
        talk = begun()
        read(talk, 2, Item(2, 10, 1, 0x84, 0), struct.pack(">fBxhh", level, 1, 215, rest))
        item = Item(4, 1, 1, 0x84, 48)
        talk.send(0, dt(write_job(3, [item], [struct.pack(">h", setpoint * 10)]))).send(1, dt(write_answer(3, [0xFF])))
        paths.append(saved(folder / f"{name}.pcapng", talk.packets()))
    return paths[0], paths[1]
