"""What the tests of tags share: a conversation about a tank, and files that name what is in it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

from tests.properties.messages import Item
from tests.report.support import begun, read, saved

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
    """Write a capture in which the tank is read: whole, its pump, and a block that is not there."""
    talk = begun()
    read(talk, 2, Item(2, 10, 1, 0x84, 0), struct.pack(">fBxhh", 3.5, 1, 215, 7))
    read(talk, 3, Item(1, 1, 1, 0x84, 32), b"\x01")
    read(talk, 4, Item(8, 1, 1, 0x84, 0), 0x0A)
    return saved(folder / "tank.pcapng", talk.packets())
