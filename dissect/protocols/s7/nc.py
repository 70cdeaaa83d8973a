"""NC programming and data record routing (userdata groups 0x3f and 0x20, reference section 4.4).

The reference only has their names. The fields of NC files are those of Wireshark (versions after 4.0, which interpret the group
as other functions); there was no capture of them. For data record routing only names are published, so its payload is shown as
octets.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.block_names import number_text, printable
from dissect.protocols.s7.parameters import PUSH, REQUEST, RESPONSE, UserdataHead
from dissect.protocols.s7.tables import (
    NC_CONTINUE_DOWNLOAD,
    NC_CONTINUE_UPLOAD,
    NC_DOWNLOAD_BLOCK,
    NC_REQUEST_DOWNLOAD,
    NC_START_UPLOAD,
    NC_UPLOAD_BLOCK,
)
from dissect.wire.layout import HOLDS_CODE, HOLDS_NUMBER, HOLDS_PATH, HOLDS_TIME, REST, Field, Layout, latin
from dissect.wire.part import Cursor

#: Every subfunction of data record routing.
ROUTING: Final = (1, 2, 3)

_SOURCE: Final = "reference section 4.4"
_WINDOW: Final = [
    Field("unacknowledged", 1, "PDUs sent without an acknowledgement.", "s7comm.data.ncprg.unackcount", decimal=True),
    Field("unknown", 1, "Unknown.", "s7comm.data.blockcontrol.unknown1"),
]
_PATH: Final = Field(
    "file_name", REST, "Name or path.", "s7comm.param.blockcontrol.filename", means=latin, holds=HOLDS_PATH
)

NC_FILE: Final = Layout("NC file", _SOURCE, [_PATH])
NC_UPLOAD: Final = Layout("NC upload", _SOURCE, [*_WINDOW, _PATH])
#: The number of PDUs that may be sent, or were sent, without an acknowledgement.
NC_WINDOW: Final = Layout("NC window", _SOURCE, [*_WINDOW])
#: Comes before a piece of a file; used alone if nothing more is known.
NC_PIECE: Final = Layout("NC piece", _SOURCE, [Field("unknown", 2, "Unknown.", "s7comm.data.blockcontrol.unknown1")])
#: The beginning of a file.
NC_HEADER: Final = Layout(
    "NC file header",
    _SOURCE,
    [
        Field(
            "file_length",
            8,
            "Bytes as text; blank for a folder.",
            "s7comm.data.ncprg.filelength",
            means=number_text,
            holds=HOLDS_NUMBER,
        ),
        Field("file_time", 16, "Time as text.", "s7comm.data.ncprg.filetime", means=latin, holds=HOLDS_TIME),
    ],
)
NC_PATH: Final = Layout(
    "NC path",
    _SOURCE,
    [Field("path", REST, "Up to a line feed.", "s7comm.data.ncprg.filepath", means=latin, holds=HOLDS_PATH)],
)
NC_DATA: Final = Layout(
    "NC file data", _SOURCE, [Field("file_data", REST, "The file.", "s7comm.data.ncprg.filedata", holds=HOLDS_CODE)]
)

_PIECES: Final = frozenset((NC_DOWNLOAD_BLOCK, NC_START_UPLOAD, NC_UPLOAD_BLOCK))
_LINE_FEED: Final = b"\n"
#: Characters of a length that is given as text.
_DIGITS: Final = frozenset(b" 0123456789")


def parse_nc(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the payload of an NC programming function."""
    function = head.subfunction
    if head.type == REQUEST and function == NC_REQUEST_DOWNLOAD:
        cursor.take(NC_FILE, note=printable(cursor.octets[cursor.at : cursor.end]))
    elif head.type == REQUEST and function == NC_START_UPLOAD:
        part = cursor.take(NC_UPLOAD)
        if part is not None:
            part.note = part.text("file_name")
    elif (head.type == RESPONSE and function == NC_REQUEST_DOWNLOAD) or (
        head.type == PUSH and function in {NC_CONTINUE_DOWNLOAD, NC_CONTINUE_UPLOAD}
    ):
        window = cursor.take(NC_WINDOW)
        if window is not None:
            window.note = f"{window.number('unacknowledged')} without an acknowledgement"
    elif cursor.left >= NC_PIECE.size:
        cursor.take(NC_PIECE)
        if function in _PIECES and head.type != REQUEST:
            _take_piece(cursor)
    cursor.rest("not known")  # no source describes more


def _take_piece(cursor: Cursor) -> None:
    start = cursor.octets[cursor.at : cursor.end]
    if len(start) < NC_HEADER.size or not _DIGITS.issuperset(start[:8]) or not start[: NC_HEADER.size].isascii():
        if start:
            cursor.take(NC_DATA, note="continuation")  # a piece, but not the first one of a file
        return
    header = cursor.take(NC_HEADER)
    if header is not None:
        header.note = f"{header.text('file_length').strip() or 'no'} bytes"
    path = cursor.octets.find(_LINE_FEED, cursor.at, cursor.end)
    if path >= 0:
        cursor.take(NC_PATH, path + 1 - cursor.at, printable(cursor.octets[cursor.at : path]).rstrip("\r"))
    if cursor.left:
        cursor.take(NC_DATA)


def parse_routing(cursor: Cursor, head: UserdataHead) -> None:
    """Take the payload of a data record routing function as octets; its structure is not published."""
    cursor.rest(head.subfunction_name)
