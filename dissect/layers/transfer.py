"""Blocks on their way to the PLC and from it, as Scapy packets (`dissect.s7.transfer`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import transfer

__all__ = [
    "S7_BlockContent",
    "S7_Download",
    "S7_DownloadEnded",
    "S7_DownloadLengths",
    "S7_EndUpload",
    "S7_FileName",
    "S7_FunctionStatus",
    "S7_Piece",
    "S7_PlainFileName",
    "S7_ShortFileName",
    "S7_Upload",
    "S7_UploadLength",
]


class S7_FunctionStatus(S7_Part):
    """The function and its status: the answer to request download, download block, upload and PI services."""

    name = "S7 function status"
    layout = transfer.STATUS
    fields_desc = header_fields(transfer.STATUS, {"function": 0x1B})


class S7_Download(S7_Part):
    """Head of a job to request download or download block."""

    name = "S7 download"
    layout = transfer.DOWNLOAD
    fields_desc = header_fields(transfer.DOWNLOAD, {"function": 0x1A, "unknown": 0x0100})


class S7_DownloadEnded(S7_Part):
    """Head of a job that ends a download."""

    name = "S7 download ended"
    layout = transfer.DOWNLOAD_END
    fields_desc = header_fields(transfer.DOWNLOAD_END, {"function": 0x1C})


class S7_Upload(S7_Part):
    """Head of a job to start upload or upload, and of the answer to start upload."""

    name = "S7 upload"
    layout = transfer.UPLOAD_HEAD
    fields_desc = header_fields(transfer.UPLOAD_HEAD, {"function": 0x1E})


class S7_EndUpload(S7_Part):
    """Head of a job to end upload."""

    name = "S7 end upload"
    layout = transfer.UPLOAD_END
    fields_desc = header_fields(transfer.UPLOAD_END, {"function": 0x1F})


class S7_FileName(S7_Part):
    """The name of a block as a file, as devices write it. ``name_length`` is filled in when left out."""

    name = "S7 file name"
    layout = transfer.FILE_NAME
    fields_desc = header_fields(
        transfer.FILE_NAME, {"identifier": b"_", "block_type": b"0A", "block_number": b"00001", "file_system": b"A"}
    )


class S7_ShortFileName(S7_Part):
    """The same without the first character, as one client writes it. ``name_length`` is filled in when left out."""

    name = "S7 short file name"
    layout = transfer.SHORT_FILE_NAME
    fields_desc = header_fields(
        transfer.SHORT_FILE_NAME, {"block_type": b"0A", "block_number": b"00001", "file_system": b"A"}
    )


class S7_PlainFileName(S7_Part):
    """Any other name; NC files have a path. ``name_length`` is filled in when left out."""

    name = "S7 plain file name"
    layout = transfer.PLAIN_FILE_NAME
    fields_desc = header_fields(transfer.PLAIN_FILE_NAME)


class S7_DownloadLengths(S7_Part):
    """What a request download says of the size. ``lengths_length`` is filled in when left out."""

    name = "S7 lengths"
    layout = transfer.LENGTHS
    fields_desc = header_fields(
        transfer.LENGTHS, {"unknown_digit": b"1", "load_length": b"000000", "mc7_length": b"000000"}
    )


class S7_UploadLength(S7_Part):
    """What the answer to start upload says of the size. ``length_length`` is filled in when left out."""

    name = "S7 upload length"
    layout = transfer.UPLOAD_LENGTH
    fields_desc = header_fields(transfer.UPLOAD_LENGTH)


class S7_Piece(S7_Part):
    """Before a piece of a block. ``length`` is filled in when left out."""

    name = "S7 piece of a block"
    layout = transfer.PIECE
    fields_desc = header_fields(transfer.PIECE, {"unknown": 0x00FB})


class S7_BlockContent(S7_Part):
    """Code, interface and values; a piece may begin and end anywhere."""

    name = "S7 block content"
    layout = transfer.CONTENT
    fields_desc = header_fields(transfer.CONTENT)
