"""Block functions (userdata group 3, reference section 4.6): lists of blocks, and the information about one block."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.block_names import block_text, name_fields, type_text
from dissect.protocols.s7.parameters import REQUEST, RESPONSE, UserdataHead
from dissect.protocols.s7.tables import BLOCK_KINDS, BLOCK_LANGUAGES, BLOCK_SECURITY, BLOCK_TYPES
from dissect.protocols.s7.values import MS_PER_DAY
from dissect.wire.layout import (
    COUNTS_REST,
    HOLDS_BLOCK_TEXT,
    HOLDS_NUMBER,
    HOLDS_PRODUCT,
    HOLDS_TIME,
    Field,
    Layout,
    latin,
)
from dissect.wire.octets import u16, u32
from dissect.wire.part import Cursor, Part
from dissect.wire.text import civil

_SOURCE: Final = "reference section 4.6"
_DAYS_TO_1984: Final = 5113


def block_time(octets: bytes) -> str | None:
    """Return the time in six octets: milliseconds of the day, and days since 1984-01-01; None if it is invalid."""
    ms = u32(octets, 0)
    if ms >= MS_PER_DAY:
        return None
    year, month, day = civil(u16(octets, 4) + _DAYS_TO_1984)
    seconds, rest = divmod(ms, 1000)
    return (
        f"{year:04d}-{month:02d}-{day:02d} {seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{rest:03d}"
    )


def version_text(octets: bytes) -> str | None:
    """Return the version of a block in one octet, for example ``0.1``."""
    return f"{octets[0] >> 4}.{octets[0] & 15}"


_TYPE: Final = Field(
    "block_type", 2, "Two digits as text.", "s7comm.blockinfo.blocktype", means=type_text, holds=HOLDS_NUMBER
)

#: An entry of the answer to list blocks.
BLOCK_COUNT: Final = Layout(
    "blocks of a type",
    _SOURCE,
    [_TYPE, Field("block_count", 2, "Blocks of this type.", "s7comm.blockinfo.block_count", decimal=True)],
)
#: The request to list the blocks of a type.
TYPE_WANTED: Final = Layout("block type", _SOURCE, [_TYPE])
#: An entry of the answer to list blocks of a type.
LISTED_BLOCK: Final = Layout(
    "block",
    _SOURCE,
    [
        Field("block_number", 2, "Number of the block.", "s7comm.blockinfo.block_num", decimal=True),
        Field("flags", 1, "Unknown.", "s7comm.blockinfo.flags"),
        Field("language", 1, "What it was written in.", "s7comm.blockinfo.block_lang", BLOCK_LANGUAGES),
    ],
)
#: The request for block info.
BLOCK_WANTED: Final = Layout(
    "block name",
    _SOURCE,
    name_fields("s7comm.blockinfo.blocktype", "s7comm.data.blockinfo.block_number", "s7comm.data.blockinfo.filesys"),
)


def header_fields(named: bool) -> list[Field]:
    """Return the fields of the first 36 octets of a block; ``named``: with Wireshark's field names where these exist."""

    def name(text: str) -> str:
        return text if named else ""

    flags = "s7comm.param.userdata.blockinfo."
    return [
        Field("mark", 2, "pp.", name("s7comm.blockinfo.res_const3"), means=latin, holds=HOLDS_PRODUCT),
        Field("unknown_mark", 1, "1 in captures.", name("s7comm.blockinfo.res_unknown")),
        Field("flags_rest", 1, "Unknown.", bits=(0xF0, 4)),
        Field("non_retain", 1, "1: loses its values.", name(flags + "nonretain"), bits=(0x08, 3), shares=True),
        Field("flags_middle", 1, "Unknown.", bits=(0x04, 2), shares=True),
        Field("standard", 1, "1: standard block.", name(flags + "standard_block"), bits=(0x02, 1), shares=True),
        Field("linked", 1, "1: linked in.", name(flags + "linked"), bits=(0x01, 0), shares=True),
        Field("language", 1, "What it was written in.", name("s7comm.blockinfo.block_lang"), BLOCK_LANGUAGES),
        Field("block_kind", 1, "Type of the block.", name("s7comm.blockinfo.subblk_type"), BLOCK_KINDS),
        Field("block_number", 2, "Number of the block.", name("s7comm.blockinfo.block_num"), decimal=True),
        Field("load_length", 4, "Bytes in load memory.", name("s7comm.blockinfo.load_mem_len"), decimal=True),
        Field("security", 4, "Protection.", name("s7comm.blockinfo.blocksecurity"), BLOCK_SECURITY),
        Field(
            "code_time",
            6,
            "Last change of the code.",
            name("s7comm.blockinfo.code_timestamp"),
            means=block_time,
            holds=HOLDS_TIME,
        ),
        Field(
            "interface_time",
            6,
            "Last change of the interface.",
            name("s7comm.blockinfo.interface_timestamp"),
            means=block_time,
            holds=HOLDS_TIME,
        ),
        Field("ssb_length", 2, "Bytes of the SSB.", name("s7comm.blockinfo.ssb_len"), decimal=True),
        Field("add_length", 2, "Bytes of the ADD.", name("s7comm.blockinfo.add_len"), decimal=True),
        Field("local_length", 2, "Bytes of local data.", name("s7comm.blockinfo.localdata_len"), decimal=True),
        Field("mc7_length", 2, "Bytes of MC7 code.", name("s7comm.blockinfo.mc7_len"), decimal=True),
    ]


def footer_fields(named: bool) -> list[Field]:
    """Return the fields of the 28 octets with the author of a block; with ``named``, they get Wireshark's field names."""

    def name(text: str) -> str:
        return f"s7comm.blockinfo.{text}" if named else ""

    return [
        Field("author", 8, "Who wrote it.", name("author"), means=latin, holds=HOLDS_BLOCK_TEXT),
        Field("family", 8, "Family of the block.", name("family"), means=latin, holds=HOLDS_BLOCK_TEXT),
        Field("name", 8, "Name of the block.", name("headername"), means=latin, holds=HOLDS_BLOCK_TEXT),
        Field(
            "version",
            1,
            "Major and minor, a nibble each.",
            name("headerversion"),
            means=version_text,
            holds=HOLDS_NUMBER,
        ),
        Field("unknown_version", 1, "0 in captures.", name("res_unknown")),
        Field("checksum", 2, "Checksum of the block.", name("checksum")),
    ]


#: The answer to block info.
INFO: Final = Layout(
    "block info",
    _SOURCE,
    [
        Field("constant", 2, "0x0100 in captures.", "s7comm.blockinfo.blocktype"),
        Field("info_length", 2, "Bytes that follow.", "s7comm.blockinfo.res_infolength", counts=COUNTS_REST),
        Field("unknown_info", 2, "0x2200 in captures.", "s7comm.blockinfo.res_unknown2"),
        *header_fields(True),
        *footer_fields(True),
        Field("reserved_1", 4, "0.", "s7comm.blockinfo.reserved1"),
        Field("reserved_2", 4, "0.", "s7comm.blockinfo.reserved2"),
    ],
)

#: The header of a transferred block; Wireshark does not dissect blocks.
HEADER: Final = Layout("block header", _SOURCE, header_fields(False))
#: The end of a transferred block (reference/mc7 section 2).
FOOTER: Final = Layout("block footer", _SOURCE, [*footer_fields(False), Field("reserved", 8, "0.")])


def parse_list(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the answer to list blocks: the number of blocks of each type."""
    while head.type == RESPONSE and cursor.left:
        part = cursor.take(BLOCK_COUNT)
        if part is not None:
            part.note = f"{part.number('block_count')} {part.text('block_type')}"


def parse_list_of_type(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the request or the answer of list blocks of a type; an answer in several parts is split between two entries."""
    if head.type == REQUEST:
        wanted = cursor.take(TYPE_WANTED)
        if wanted is not None:
            wanted.note = wanted.text("block_type")
    while head.type == RESPONSE and cursor.left:
        part = cursor.take(LISTED_BLOCK)
        if part is not None:
            part.note = f"{part.number('block_number')} ({BLOCK_LANGUAGES.name(part.number('language'))})"


def parse_info(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the request or the answer of block info."""
    if head.type == REQUEST:
        wanted = cursor.take(BLOCK_WANTED)
        if wanted is not None:
            wanted.note = f"block {block_text(cursor.octets[wanted.offset : wanted.end])}"
    elif head.type == RESPONSE:
        info = cursor.take(INFO)
        if info is not None:
            info.note = f"block {header_text(info)}{_about(info)}"


def _about(info: Part) -> str:
    """Return the main facts of block info: protection, version, time of the last code change, size, author."""
    said: list[str] = []
    if info.number("security") > 0:
        said.append(info.text("security") or f"protection 0x{info.number('security'):x}")
    if info.find("version") is not None:
        said.append(f"version {info.text('version')}")
    if info.text("code_time"):
        said.append(f"changed {info.text('code_time')}")
    if info.number("mc7_length") >= 0:
        said.append(f"{info.number('mc7_length')} bytes MC7")
    said += [f"{field} {info.text(field).strip()}" for field in ("author", "name") if info.text(field).strip()]
    return "".join([f", {text}" for text in said])


def header_text(part: Part) -> str:
    """Return the name of the block that a part with `header_fields` describes, for example ``DB 1``."""
    return f"{BLOCK_KINDS.name(part.number('block_kind'))} {part.number('block_number')}"


def is_header(octets: bytes) -> bool:
    """Return whether ``octets`` begin with a block: the mark, a known type, and lengths without contradiction."""
    if len(octets) < HEADER.size or octets[:2] != b"pp" or f"{octets[5]:02X}" not in BLOCK_TYPES:
        return False
    return u32(octets, 8) >= HEADER.size + u16(octets, 34)
