"""Syntaxes of request items other than S7ANY: their fields, and their addresses as text (reference section 3.5, table).

Numbers of drives, NC and symbols have a meaning only for the device, so an address gives only these numbers.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7.alarm_layouts import QUERIES, QUERY_OTHER, QUERY_TYPE_AT
from dissect.protocols.s7.alarm_layouts import SYNTAXES as ALARM_SYNTAXES
from dissect.protocols.s7.layouts import ITEM_HEAD
from dissect.protocols.s7.nck_tables import NCK_MODULES
from dissect.protocols.s7.tables import (
    ALARM_QUERY_ITEM,
    NCK_AREAS,
    PBC_R_ID,
    SYMBOL_AREAS,
    SYMBOL_FLAGS,
    SYMBOL_ROOTS,
    SYNTAX_IDS,
)
from dissect.wire.layout import COUNTS_REST, Field, Layout
from dissect.wire.octets import u16, u32
from dissect.wire.part import OCTETS, Cursor

NCK: Final = 0x82
NCK_M: Final = 0x83
NCK_I: Final = 0x84
DRIVE_ES_ANY: Final = 0xA2
DB_READ: Final = 0xB0
SYMBOL: Final = 0xB2

_SOURCE: Final = "reference section 3.5"
_HEAD_SIZE: Final = 3
_ROOT_DB: Final = 0x8A0E
_ROOT_MEMORY: Final = 0x0000

_HEAD: Final = [
    ITEM_HEAD.fields[0],
    Field("length", 1, "Bytes of the item after this one.", "s7comm.param.item.varspec_length", counts=COUNTS_REST),
    ITEM_HEAD.fields[2],
]
#: The R_ID by which BSEND and USEND identify a connection of a program.
R_ID_FIELDS: Final = [
    Field("unknown", 1, "0x00 or 0xcc in captures.", "s7comm.pbc.bsend.unknown"),
    Field("r_id", 4, "Which of the program's connections.", "s7comm.pbc.req.bsend.r_id"),
]
PBC_ID: Final = Layout("R_ID", "reference section 4.10", [*_HEAD, *R_ID_FIELDS])
#: NCK items: in the units set on the device, in metric units, in inches.
NCK_ITEM: Final = Layout(
    "NCK item",
    _SOURCE,
    [
        *_HEAD,
        Field("nck_area", 1, "Area of the NC.", "s7comm.param.item.nck.area", NCK_AREAS, (0xE0, 5)),
        Field(
            "nck_unit", 1, "Unit within it.", "s7comm.param.item.nck.unit", bits=(0x1F, 0), shares=True, decimal=True
        ),
        Field("column", 2, "Column.", "s7comm.param.item.nck.column", decimal=True),
        Field("line", 2, "Line.", "s7comm.param.item.nck.line", decimal=True),
        Field("module", 1, "Block of the area.", "s7comm.param.item.nck.module", NCK_MODULES),
        Field("line_count", 1, "Lines.", "s7comm.param.item.nck.linecount", decimal=True),
    ],
)
DRIVE_ITEM: Final = Layout(
    "DriveES item",
    _SOURCE,
    [
        *_HEAD,
        Field("unknown_1", 1, "Unknown.", "s7comm.param.item.driveesany.unknown1"),
        Field("unknown_2", 2, "Unknown.", "s7comm.param.item.driveesany.unknown2"),
        Field("unknown_3", 2, "Unknown.", "s7comm.param.item.driveesany.unknown3"),
        Field("parameter", 2, "Parameter.", "s7comm.param.item.driveesany.parameternr", decimal=True),
        Field("parameter_index", 2, "Index of it.", "s7comm.param.item.driveesany.parameteridx", decimal=True),
    ],
)
#: Areas of data blocks that are read as one item. Each area is a `DB_AREA`; the length of the item includes them.
DB_READ_ITEM: Final = Layout(
    "DBREAD item",
    _SOURCE,
    [
        *ITEM_HEAD.fields,
        Field("area_count", 1, "Areas that follow.", "s7comm.param.item.dbread.numareas", counts="DBREAD area"),
    ],
)
DB_AREA: Final = Layout(
    "DBREAD area",
    _SOURCE,
    [
        Field("area_size", 1, "Octets.", "s7comm.param.item.dbread.length", decimal=True),
        Field("db", 2, "DB number.", "s7comm.param.item.dbread.db"),
        Field("start", 2, "First byte.", "s7comm.param.item.dbread.startaddress", decimal=True),
    ],
)
_SYMBOL: Final = [
    *ITEM_HEAD.fields,
    Field("reserved", 1, "0xff.", "s7comm.tiap.item.reserved1"),
    Field("root", 2, "Where the symbol is.", "s7comm.tiap.item.area1", SYMBOL_ROOTS),
]
_CRC: Final = Field("crc", 4, "Check of the symbol.", "s7comm.tiap.item.crc")
#: A symbol of an S7-1200: in a data block, in another area, in an unknown area. The steps to the symbol follow.
SYMBOL_IN_DB: Final = Layout(
    "symbol in a DB",
    _SOURCE,
    [*_SYMBOL, Field("db", 2, "DB number.", "s7comm.tiap.item.dbnumber"), _CRC],
)
SYMBOL_IN_MEMORY: Final = Layout(
    "symbol in memory",
    _SOURCE,
    [*_SYMBOL, Field("memory", 2, "Memory area.", "s7comm.tiap.item.area2", SYMBOL_AREAS), _CRC],
)
SYMBOL_ELSEWHERE: Final = Layout(
    "symbol",
    _SOURCE,
    [*_SYMBOL, Field("memory", 2, "Unknown.", "s7comm.tiap.item.area2unknown"), _CRC],
)
SYMBOL_STEP: Final = Layout(
    "symbol step",
    _SOURCE,
    [
        Field("flags", 4, "What the value is.", "s7comm.tiap.item.lid_flags", SYMBOL_FLAGS, (0xF0000000, 28)),
        Field("value", 4, "Value.", "s7comm.tiap.item.value", bits=(0x0FFFFFFF, 0), shares=True, decimal=True),
    ],
)

#: Items that consist of one part, by syntax id.
_FIXED: Final[dict[int, Layout]] = {
    PBC_R_ID: PBC_ID,
    **ALARM_SYNTAXES,
    NCK: NCK_ITEM,
    NCK_M: NCK_ITEM,
    NCK_I: NCK_ITEM,
    DRIVE_ES_ANY: DRIVE_ITEM,
}


def r_id_text(r_id: int) -> str:
    """Return the R_ID of a connection as text."""
    return f"R_ID 0x{r_id:08x}"


def layout_of(octets: bytes) -> Layout | None:
    """Return the layout of the beginning of an item, head included; None if its syntax is unknown or its size is wrong."""
    size = len(octets)
    if size < _HEAD_SIZE:
        return None
    syntax_id = octets[2]
    if syntax_id == DB_READ:
        return DB_READ_ITEM if size > 3 and size == DB_READ_ITEM.size + octets[3] * DB_AREA.size else None
    if syntax_id == SYMBOL:
        if size < SYMBOL_ELSEWHERE.size or (size - SYMBOL_ELSEWHERE.size) % SYMBOL_STEP.size:
            return None
        root = u16(octets, 4)
        return {_ROOT_DB: SYMBOL_IN_DB, _ROOT_MEMORY: SYMBOL_IN_MEMORY}.get(root, SYMBOL_ELSEWHERE)
    layout = _query(octets) if syntax_id == ALARM_QUERY_ITEM else _FIXED.get(syntax_id)
    return layout if layout is not None and layout.size == size else None


def _query(octets: bytes) -> Layout:
    asked = octets[QUERY_TYPE_AT] if len(octets) > QUERY_TYPE_AT else 0
    return QUERIES.get(asked, QUERY_OTHER)


def take_item(cursor: Cursor, octets: bytes, note: str) -> None:
    """Parse an item that is not S7ANY; ``octets`` are the whole item, which begins at the cursor."""
    end = cursor.at + len(octets)
    layout = layout_of(octets)
    areas = layout is DB_READ_ITEM and layout.size < len(octets)  # each area has its own note
    cursor.take(ITEM_HEAD if layout is None else layout, note="" if areas else note)
    follows = DB_AREA if layout is DB_READ_ITEM else SYMBOL_STEP
    while layout is not None and cursor.at < end:
        at = cursor.at - end + len(octets)
        cursor.take(follows, note=_area(octets, at) if follows is DB_AREA else _step(octets, at))
    if cursor.at < end:
        cursor.take(OCTETS, end - cursor.at)  # an unknown syntax, or a wrong size


def item_text(octets: bytes) -> str:
    """Return the address of an item that is not S7ANY, head included (at least 3 octets), for example ``NCK C1 …``."""
    syntax_id: i64 = octets[2]
    layout = layout_of(octets)
    if layout is None:
        return f"{SYNTAX_IDS.name(syntax_id)}:{octets[3:].hex()}"
    if layout is DB_READ_ITEM:
        return "+".join([_area(octets, at) for at in range(DB_READ_ITEM.size, len(octets), DB_AREA.size)]) or "DBREAD"
    if layout is NCK_ITEM:
        return _nck(octets)
    if layout is DRIVE_ITEM:
        return f"{SYNTAX_IDS.name(syntax_id)} p{u16(octets, 8)}[{u16(octets, 10)}]"
    if layout is PBC_ID:
        return r_id_text(u32(octets, 4))
    if syntax_id == SYMBOL:
        return _symbol(octets)
    if syntax_id == ALARM_QUERY_ITEM:
        return f"{SYNTAX_IDS.name(syntax_id)} {octets[QUERY_TYPE_AT]}:0x{u32(octets, 6):08x}"
    return f"{SYNTAX_IDS.name(syntax_id)} event 0x{u32(octets, 4):08x}"


def _area(octets: bytes, at: int) -> str:
    size = octets[at]
    return f"DB{u16(octets, at + 1)}.DBB{u16(octets, at + 3)}" + (f" x{size}" if size != 1 else "")


def _nck(octets: bytes) -> str:
    area = NCK_AREAS.name(octets[3] >> 5)
    lines = f" x{octets[9]}" if octets[9] != 1 else ""
    return (
        f"{SYNTAX_IDS.name(octets[2])} {area}{octets[3] & 31} module {NCK_MODULES.name(octets[8])}"
        f" column {u16(octets, 4)} line {u16(octets, 6)}{lines}"
    )


def _symbol(octets: bytes) -> str:
    root, second = u16(octets, 4), u16(octets, 6)
    if root == _ROOT_DB:
        place = f"DB{second}"
    elif root == _ROOT_MEMORY:
        place = SYMBOL_AREAS.name(second)
    else:
        place = f"0x{root:04x}:0x{second:04x}"
    steps = [_step(octets, at) for at in range(SYMBOL_ELSEWHERE.size, len(octets), SYMBOL_STEP.size)]
    return " ".join(["SYM", place, *steps])


def _step(octets: bytes, at: int) -> str:
    value = u32(octets, at)
    return f"{SYMBOL_FLAGS.name(value >> 28)} {value & 0x0FFFFFFF}"
