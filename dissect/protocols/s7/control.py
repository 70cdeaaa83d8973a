"""Commands to the PLC: PI services 0x28, PLC stop 0x29 and function 0x00 as a job (reference section 3.10)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.block_names import FILE_NAME_FIELDS, block_text, printable
from dissect.protocols.s7.layouts import FUNCTION
from dissect.protocols.s7.services import BLOCK_SERVICES, NC_PREFIX, PI_SERVICES, PROGRAM, SECRET
from dissect.protocols.s7.transfer import take_answer
from dissect.wire.layout import (
    COUNTS_BUT_LAST,
    COUNTS_REST,
    HOLDS_ARGUMENT,
    HOLDS_SECRET,
    HOLDS_SERVICE,
    REST,
    Field,
    Layout,
    latin,
)
from dissect.wire.part import Cursor

_SOURCE: Final = "reference section 3.10"
_UNKNOWN: Final = "s7comm.param.pistart.unknown1"
_SERVICE: Final = Field(
    "service", REST, "Name of the service.", "s7comm.param.pistart.servicename", means=latin, holds=HOLDS_SERVICE
)

#: A PI service job that ends before its parameter block.
PI_SHORT: Final = Layout(
    "PI service", _SOURCE, [FUNCTION.fields[0], Field("unknown", 7, "0x000000000000fd.", _UNKNOWN)]
)
PI_HEAD: Final = Layout(
    "PI service",
    _SOURCE,
    [
        *PI_SHORT.fields,
        Field(
            "block_length",
            2,
            "Bytes of the parameter block.",
            "s7comm.param.pistart.parameterblock_len",
            counts=COUNTS_BUT_LAST,
        ),
    ],
)
#: The name of the service, which follows the parameter block.
PI_NAME: Final = Layout(
    "service name",
    _SOURCE,
    [Field("name_length", 1, "Bytes of the name.", "s7comm.param.pi.n_x.string_len", counts=COUNTS_REST), _SERVICE],
)
#: The parameter block of services about blocks: the list, then each block.
PI_BLOCKS: Final = Layout(
    "list of blocks",
    _SOURCE,
    [
        Field("block_count", 1, "Blocks that follow.", "s7comm.data.plccontrol.block_cnt", counts="listed block"),
        Field("unknown", 1, "0.", "s7comm.param.pi.inse.unknown"),
    ],
)
PI_BLOCK: Final = Layout("listed block", _SOURCE, [*FILE_NAME_FIELDS])
#: The parameter block of the CPU's other services.
PI_ARGUMENT: Final = Layout(
    "argument",
    _SOURCE,
    [
        Field(
            "argument",
            REST,
            "What the service is to do.",
            "s7comm.param.pistart.argument",
            means=latin,
            holds=HOLDS_ARGUMENT,
        )
    ],
)
_STRING_LENGTH: Final = Field(
    "string_length", 1, "Bytes of the text.", "s7comm.param.pi.n_x.string_len", counts=COUNTS_REST
)
#: One argument of a Sinumerik service.
PI_STRING: Final = Layout(
    "string argument",
    _SOURCE,
    [_STRING_LENGTH, Field("text", REST, "Text of the argument.", means=latin, holds=HOLDS_ARGUMENT)],
)
#: An argument that is a password: it is not decoded.
PI_PASSWORD: Final = Layout(
    "password argument",
    _SOURCE,
    [_STRING_LENGTH, Field("password", REST, "Text that is not to be shown.", holds=HOLDS_SECRET)],
)
#: Pads an argument, also the last one, to an even size.
PI_FILL: Final = Layout("argument fill", _SOURCE, [Field("argument_fill", 1, "Makes length and text even.")])

PLC_STOP: Final = Layout(
    "PLC stop",
    _SOURCE,
    [
        FUNCTION.fields[0],
        Field("unknown", 5, "0.", _UNKNOWN),
        Field("name_length", 1, "Bytes of the name.", "s7comm.data.plccontrol.part2_len", counts=COUNTS_REST),
        _SERVICE,
    ],
)


def parse_service(cursor: Cursor, answer: bool) -> None:
    """Parse the parameter block of a PI service, or of its answer."""
    if answer:
        take_answer(cursor)
        return
    if cursor.left <= PI_SHORT.size:
        cursor.take(PI_SHORT)
        return
    head = cursor.take(PI_HEAD)
    if head is None:
        return
    size = head.number("block_length")
    if size > cursor.left:
        cursor.tell("length_beyond", "block_length", size, cursor.left)
        size = cursor.left
    name = _name_behind(cursor, size)
    known = _service_note(name, size > 0)
    head.note = known  # the name comes after the arguments, but determines their meaning
    block = Cursor(cursor.octets, cursor.at, cursor.at + size, "item", cursor.malformed)
    _parameter_block(block, name)
    block.finish()
    cursor.parts.extend(block.parts)
    cursor.at += size
    _take_name(cursor, "" if known else name)


def _name_behind(cursor: Cursor, size: int) -> str:
    """Return the name of the service, which follows a parameter block of ``size`` octets; empty if it is missing."""
    at = cursor.at + size
    return printable(cursor.octets[at + 1 : min(at + 1 + cursor.octets[at], cursor.end)]) if at < cursor.end else ""


def _service_note(name: str, has_block: bool) -> str:
    """Return the name of a service and its effect; empty for an unknown service."""
    if name == PROGRAM:
        return f"{name}: start the CPU" if has_block else f"{name}: start the CPU, warm restart"
    row = PI_SERVICES.get(name)
    return f"{name}: {row.meaning}" if row is not None else ""


def _take_name(cursor: Cursor, note: str) -> None:
    """Parse the name. Only an unknown service gets ``note``: with a wrong length, the name could be part of a password."""
    told = cursor.octets[cursor.at] if cursor.left else 0
    if told >= cursor.left:  # the count of octets left includes the length octet
        cursor.tell("length_beyond", "name_length", told, max(cursor.left - 1, 0))
    if cursor.left:
        cursor.take(PI_NAME, min(1 + told, cursor.left), note)


def _parameter_block(block: Cursor, name: str) -> None:
    if name in BLOCK_SERVICES:
        listed = block.take(PI_BLOCKS)
        for _ in range(listed.number("block_count") if listed is not None else 0):
            part = block.take(PI_BLOCK)
            if part is None:
                break
            part.note = f"block {block_text(block.octets[part.offset : part.end])}"
    elif name.startswith(NC_PREFIX):
        _strings(block, name)
    elif block.left:
        argument = block.take(PI_ARGUMENT)
        if argument is not None:
            text = printable(argument.octets("argument"))
            argument.note = f'"{text}"' + (", cold restart" if name == PROGRAM and text.startswith("C") else "")


def _strings(block: Cursor, name: str) -> None:
    service = PI_SERVICES.get(name)
    number = 0
    while block.left:
        argument = service.argument(number) if service is not None else ""
        size = 1 + block.octets[block.at]
        if size > block.left:
            block.tell("length_beyond", "string_length", size - 1, block.left - 1)
            size = block.left
        if argument == SECRET:
            block.take(PI_PASSWORD, size, f"password ({size - 1} bytes, not shown)")
        else:
            part = block.take(PI_STRING, size)
            if part is not None:
                part.note = f"{argument or 'argument'} {part.text('text')}".rstrip()
        if size & 1 and block.left:
            block.take(PI_FILL)
        number += 1


def parse_stop(cursor: Cursor, answer: bool) -> None:
    """Parse the parameter block of a PLC stop, or of its answer."""
    if answer:
        take_answer(cursor)
        return
    told = cursor.octets[cursor.at + PLC_STOP.size - 1] if cursor.left >= PLC_STOP.size else 0
    if PLC_STOP.size + told > cursor.left >= PLC_STOP.size:
        cursor.tell("length_beyond", "name_length", told, cursor.left - PLC_STOP.size)
        told = cursor.left - PLC_STOP.size
    stop = cursor.take(PLC_STOP, PLC_STOP.size + told)
    if stop is not None:
        stop.note = stop.text("service")


def parse_cpu_services(cursor: Cursor, answer: bool) -> None:
    """Parse function 0x00 outside of userdata: devices answer it, but no source describes its content."""
    cursor.take(FUNCTION)
    cursor.rest("answer without a known layout" if answer else "job without a known layout")
