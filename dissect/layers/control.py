"""PI services and PLC stop as Scapy packets (`dissect.s7.control`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import control

__all__ = [
    "S7_PIArgument",
    "S7_PIBlock",
    "S7_PIBlocks",
    "S7_PIFill",
    "S7_PIHead",
    "S7_PIName",
    "S7_PIPassword",
    "S7_PIShort",
    "S7_PIString",
    "S7_PLCStop",
]


class S7_PIShort(S7_Part):
    """A job without a parameter block and a name."""

    name = "S7 PI service"
    layout = control.PI_SHORT
    fields_desc = header_fields(control.PI_SHORT, {"function": 0x28, "unknown": 0xFD})


class S7_PIHead(S7_Part):
    """A PI service: the head, before the parameter block and the name. ``block_length`` is filled in when left out."""

    name = "S7 PI service"
    layout = control.PI_HEAD
    fields_desc = header_fields(control.PI_HEAD, {"function": 0x28, "unknown": 0xFD})


class S7_PIName(S7_Part):
    """The name of a PI service, behind the parameter block. ``name_length`` is filled in when left out."""

    name = "S7 service name"
    layout = control.PI_NAME
    fields_desc = header_fields(control.PI_NAME, {"service": b"P_PROGRAM"})


class S7_PIBlocks(S7_Part):
    """Parameter block of a PI service about blocks: how many follow. ``block_count`` is filled in when left out."""

    name = "S7 list of blocks"
    layout = control.PI_BLOCKS
    fields_desc = header_fields(control.PI_BLOCKS)


class S7_PIBlock(S7_Part):
    """A block that a PI service is about."""

    name = "S7 listed block"
    layout = control.PI_BLOCK
    fields_desc = header_fields(control.PI_BLOCK, {"block_type": b"0A", "block_number": b"00001", "file_system": b"P"})


class S7_PIArgument(S7_Part):
    """Parameter block of other services of the CPU."""

    name = "S7 argument"
    layout = control.PI_ARGUMENT
    fields_desc = header_fields(control.PI_ARGUMENT)


class S7_PIString(S7_Part):
    """An argument of a Sinumerik service. ``string_length`` is filled in when left out."""

    name = "S7 string argument"
    layout = control.PI_STRING
    fields_desc = header_fields(control.PI_STRING)


class S7_PIPassword(S7_Part):
    """A password among the arguments of a Sinumerik service. ``string_length`` is filled in when left out."""

    name = "S7 password argument"
    layout = control.PI_PASSWORD
    fields_desc = header_fields(control.PI_PASSWORD)


class S7_PIFill(S7_Part):
    """The octet that makes an argument even; it stands behind the last one too."""

    name = "S7 argument fill"
    layout = control.PI_FILL
    fields_desc = header_fields(control.PI_FILL)


class S7_PLCStop(S7_Part):
    """PLC stop with the name of the program. ``name_length`` is filled in when left out."""

    name = "S7 PLC stop"
    layout = control.PLC_STOP
    fields_desc = header_fields(control.PLC_STOP, {"function": 0x29, "service": b"P_PROGRAM"})
