"""NC programming as Scapy packets (`dissect.s7.nc`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import nc

__all__ = ["S7_NCData", "S7_NCFile", "S7_NCHeader", "S7_NCPath", "S7_NCPiece", "S7_NCUpload", "S7_NCWindow"]


class S7_NCFile(S7_Part):
    """Name of an NC file to download."""

    name = "S7 NC file"
    layout = nc.NC_FILE
    fields_desc = header_fields(nc.NC_FILE)


class S7_NCUpload(S7_Part):
    """Name of an NC file to upload."""

    name = "S7 NC upload"
    layout = nc.NC_UPLOAD
    fields_desc = header_fields(nc.NC_UPLOAD)


class S7_NCWindow(S7_Part):
    """How many PDUs may be or were sent without an acknowledgement."""

    name = "S7 NC window"
    layout = nc.NC_WINDOW
    fields_desc = header_fields(nc.NC_WINDOW)


class S7_NCPiece(S7_Part):
    """Before a piece of a file, and alone where nothing else is known."""

    name = "S7 NC piece"
    layout = nc.NC_PIECE
    fields_desc = header_fields(nc.NC_PIECE)


class S7_NCHeader(S7_Part):
    """A file begins with it."""

    name = "S7 NC file header"
    layout = nc.NC_HEADER
    fields_desc = header_fields(nc.NC_HEADER)


class S7_NCPath(S7_Part):
    """Path that an NC file begins with."""

    name = "S7 NC path"
    layout = nc.NC_PATH
    fields_desc = header_fields(nc.NC_PATH)


class S7_NCData(S7_Part):
    """Content of an NC file."""

    name = "S7 NC file data"
    layout = nc.NC_DATA
    fields_desc = header_fields(nc.NC_DATA)
