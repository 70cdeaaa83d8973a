"""Transfer of blocks to and from the PLC: functions 0x1a to 0x1f (reference sections 3.7 to 3.9)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.block_names import (
    FILE_NAME_FIELDS,
    block_text,
    identifier_text,
    is_block_name,
    number_text,
    printable,
)
from dissect.protocols.s7.blocks import HEADER, header_text, is_header
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.layouts import FUNCTION
from dissect.protocols.s7.tables import DOWNLOAD_ENDED, END_UPLOAD, REQUEST_DOWNLOAD, START_UPLOAD, UPLOAD
from dissect.wire.layout import (
    COUNTS_PARTS,
    COUNTS_REST,
    HOLDS_CODE,
    HOLDS_NUMBER,
    HOLDS_PATH,
    HOLDS_PRODUCT,
    HOLDS_REFERENCE,
    REST,
    Field,
    Layout,
    latin,
)
from dissect.wire.part import Cursor, Part

_UPLOAD: Final = "reference section 3.7"
_DOWNLOAD: Final = "reference section 3.8"
_FILE_NAMES: Final = "reference section 3.9"
_UNKNOWN: Final = "s7comm.data.blockcontrol.unknown1"

_STATUS: Final = [
    FUNCTION.fields[0],
    Field("status_rest", 1, "Unknown.", bits=(0xFC, 2)),
    Field("error", 1, "1: refused.", "s7comm.param.blockcontrol.functionstatus.error", bits=(0x02, 1), shares=True),
    Field("more", 1, "1: more data follow.", "s7comm.param.blockcontrol.functionstatus.more", bits=(1, 0), shares=True),
]
_ERROR: Final = "error_code", 2, "0, or why it failed.", "s7comm.data.blockcontrol.errorcode"
_UPLOAD_ID: Final = Field(
    "upload_id",
    4,
    "Which upload; the PLC chose it.",
    "s7comm.data.blockcontrol.uploadid",
    decimal=True,
    holds=HOLDS_REFERENCE,
)
_UNKNOWN_2: Final = Field("unknown", 2, "0 or 0x0100 in captures.", _UNKNOWN)
_UNKNOWN_4: Final = Field("unknown_id", 4, "0; the place of the upload id.", _UNKNOWN)

#: Function and status: the answer to request download, download block, upload and PI services.
STATUS: Final = Layout("function status", "reference section 3.10", [*_STATUS])
#: Parameter blocks of jobs: request download and download block; download ended; start upload, upload; end upload.
DOWNLOAD: Final = Layout("download", _DOWNLOAD, [*_STATUS, _UNKNOWN_2, _UNKNOWN_4])
DOWNLOAD_END: Final = Layout(
    "download ended", _DOWNLOAD, [*_STATUS, Field(*_ERROR, errors_of(DOWNLOAD_ENDED)), _UNKNOWN_4]
)
UPLOAD_HEAD: Final = Layout("upload", _UPLOAD, [*_STATUS, _UNKNOWN_2, _UPLOAD_ID])
UPLOAD_END: Final = Layout("end upload", _UPLOAD, [*_STATUS, Field(*_ERROR, errors_of(END_UPLOAD)), _UPLOAD_ID])

_NAME_LENGTH: Final = Field(
    "name_length", 1, "Bytes of the name.", "s7comm.param.blockcontrol.filename_len", counts=COUNTS_REST
)
#: The file name of a block: in the form of devices, and in that of python-snap7.
FILE_NAME: Final = Layout(
    "file name",
    _FILE_NAMES,
    [
        _NAME_LENGTH,
        Field(
            "identifier",
            1,
            "_ complete module, $ module header.",
            "s7comm.data.blockcontrol.file_identifier",
            means=identifier_text,
            holds=HOLDS_NUMBER,
        ),
        *FILE_NAME_FIELDS,
    ],
)
SHORT_FILE_NAME: Final = Layout("short file name", _FILE_NAMES, [_NAME_LENGTH, *FILE_NAME_FIELDS])
#: Any other name; NC files have a path.
PLAIN_FILE_NAME: Final = Layout(
    "plain file name",
    _FILE_NAMES,
    [
        _NAME_LENGTH,
        Field("file_name", REST, "Name or path.", "s7comm.param.blockcontrol.filename", means=latin, holds=HOLDS_PATH),
    ],
)

#: The sizes in a request download.
LENGTHS: Final = Layout(
    "lengths",
    _DOWNLOAD,
    [
        Field("lengths_length", 1, "13.", "s7comm.data.blockcontrol.part2_len", counts=COUNTS_REST),
        Field(
            "unknown_digit", 1, "1 as text.", "s7comm.data.blockcontrol.part2_unknown", means=latin, holds=HOLDS_PRODUCT
        ),
        Field(
            "load_length",
            6,
            "Bytes in load memory.",
            "s7comm.data.blockcontrol.loadmem_len",
            means=number_text,
            holds=HOLDS_NUMBER,
        ),
        Field(
            "mc7_length",
            6,
            "Bytes of MC7 code.",
            "s7comm.data.blockcontrol.mc7code_len",
            means=number_text,
            holds=HOLDS_NUMBER,
        ),
    ],
)
#: The size in the answer to start upload.
UPLOAD_LENGTH: Final = Layout(
    "upload length",
    _UPLOAD,
    [
        Field("length_length", 1, "7.", "s7comm.param.blockcontrol.upl_lenstring_len", counts=COUNTS_REST),
        Field(
            "total",
            REST,
            "Bytes of all pieces.",
            "s7comm.param.blockcontrol.upl_lenstring",
            means=number_text,
            holds=HOLDS_NUMBER,
        ),
    ],
)
#: Precedes a piece of a block.
PIECE: Final = Layout(
    "piece of a block",
    _UPLOAD,
    [
        Field("length", 2, "Bytes of the piece.", "s7comm.data.length", counts=COUNTS_PARTS),
        Field("unknown", 2, "0x00fb.", _UNKNOWN),
    ],
)
#: Code, interface and values; a piece may begin and end anywhere.
CONTENT: Final = Layout(
    "block content", _UPLOAD, [Field("content", REST, "A part of the block.", "s7comm.resp.data", holds=HOLDS_CODE)]
)

_LENGTHS_SIZE: Final = 13


def parse_parameters(cursor: Cursor, answer: bool) -> None:
    """Parse the parameter block of a job with one of these functions, or of its answer."""
    function = cursor.octets[cursor.at]
    if answer:
        if function == START_UPLOAD and cursor.left > STATUS.size:
            _take_upload(cursor, UPLOAD_HEAD)
            if cursor.left:  # the answer about an NC file has no length
                _take_length(cursor)
        else:
            take_answer(cursor)
    elif function == UPLOAD:
        _take_upload(cursor, UPLOAD_HEAD)
    elif function == END_UPLOAD:
        _take_upload(cursor, UPLOAD_END)
    elif function == START_UPLOAD:
        _take_upload(cursor, UPLOAD_HEAD)
        _take_name(cursor)
    else:
        end = cursor.take(DOWNLOAD_END if function == DOWNLOAD_ENDED else DOWNLOAD)
        if end is not None:
            end.note = _why(end)
        _take_name(cursor)
        if function == REQUEST_DOWNLOAD and cursor.left:
            _take_lengths(cursor)


def take_answer(cursor: Cursor) -> None:
    """Parse an answer: the function, and its status if that follows."""
    status = cursor.take(FUNCTION if cursor.left == 1 else STATUS)
    if status is not None and status.number("error") == 1:
        status.note = "error"
    elif status is not None and status.number("more") == 1:
        status.note = "more to come"


def _take_upload(cursor: Cursor, layout: Layout) -> None:
    part = cursor.take(layout)
    if part is not None:
        number, why = part.number("upload_id"), _why(part)
        part.note = f"upload {number}{', ' if why else ''}{why}" if number else why


def _why(part: Part) -> str:
    """Return the error in a download ended or end upload; empty if there is none."""
    code = part.number("error_code")
    codes = errors_of(END_UPLOAD if part.layout is UPLOAD_END else DOWNLOAD_ENDED)
    return f"error {codes.coded(code)}" if code > 0 else ""


def _take_name(cursor: Cursor) -> None:
    size = _told_size(cursor, PLAIN_FILE_NAME, "name_length")
    if size < 0:
        return
    name = cursor.octets[cursor.at + 1 : cursor.at + 1 + size]
    if is_block_name(name[1:]):
        layout, text = FILE_NAME, block_text(name[1:])
        if name[:1] == b"$":
            text += ", header alone"
    elif is_block_name(name):
        layout, text = SHORT_FILE_NAME, block_text(name)
    else:
        layout, text = PLAIN_FILE_NAME, printable(name)
    cursor.take(layout, 1 + size, text)


def _take_lengths(cursor: Cursor) -> None:
    size = _told_size(cursor, LENGTHS, "lengths_length")
    if size == _LENGTHS_SIZE:
        part = cursor.take(LENGTHS)
        if part is not None:
            part.note = f"{part.text('load_length')} bytes, {part.text('mc7_length')} of them MC7 code"
    elif size >= 0:
        cursor.tell("length_below" if size < _LENGTHS_SIZE else "bad_value", "lengths_length", _LENGTHS_SIZE, size)
        cursor.rest()  # no other form of it is known


def _take_length(cursor: Cursor) -> None:
    size = _told_size(cursor, UPLOAD_LENGTH, "length_length")
    part = cursor.take(UPLOAD_LENGTH, 1 + size) if size >= 0 else None
    if part is not None and part.text("total"):
        part.note = f"{part.text('total')} bytes"


def _told_size(cursor: Cursor, layout: Layout, field: str) -> int:
    """Return the size stated by the length octet at the cursor, limited to the remaining octets; -1 if there is none."""
    if not cursor.left:
        cursor.take(layout, layout.size)  # notes that it is missing
        return -1
    size = cursor.octets[cursor.at]
    if size > cursor.left - 1:
        cursor.tell("length_beyond", field, size, cursor.left - 1)
        return cursor.left - 1
    return size


def parse_data(cursor: Cursor, answer: bool) -> None:
    """Parse a piece of a block: the data of the answers to upload and download block (one client sends it in jobs)."""
    piece = cursor.take(PIECE)
    if piece is None:
        return
    size = piece.number("length")
    piece.note = f"{size} bytes" if answer else f"{size} bytes, sent with the job"
    if size > cursor.left:
        cursor.tell("length_beyond", "length", size, cursor.left)
        size = cursor.left
    end = cursor.at + size
    if is_header(cursor.octets[cursor.at : end]):
        header = cursor.take(HEADER)
        if header is not None:
            header.note = _about(header)
    if end > cursor.at:
        cursor.take(CONTENT, end - cursor.at)


def _about(header: Part) -> str:
    protected = ", know-how protected" if header.text("security").startswith("know") else ""
    return f"block {header_text(header)}, {header.text('language')}, {header.number('load_length')} bytes{protected}"
