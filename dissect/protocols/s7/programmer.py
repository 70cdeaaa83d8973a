"""Programmer commands (userdata group 1, reference section 4.8): watch, modify and force variables, block status.

Such a command starts a job, identified by the sequence number of its answer: pushes carry this number, and commands about jobs
refer to it.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.data_parts import RETURN_CODE, take_data_items
from dissect.protocols.s7.parameters import PUSH, REQUEST, UserdataHead
from dissect.protocols.s7.programmer_layouts import (
    BLOCK_STATUS,
    BLOCK_STATUS_2,
    BLOCK_STATUS_DATA,
    BLOCK_STATUS_LINE,
    BLOCK_STATUS_LINE_2,
    BLOCK_STATUS_START,
    BREAKPOINT,
    BREAKPOINT_REQUEST,
    BSTACK_CLASS,
    BSTACK_ENTRY,
    BSTACK_REQUEST,
    BSTACK_REST,
    BSTACK_TIME,
    EXIT_HOLD_REQUEST,
    ISTACK,
    ISTACK_REQUEST,
    JOB,
    JOB_DATA,
    JOB_LIST_RESERVED,
    JOB_RESERVED,
    JOB_SIZES,
    JOB_STATE,
    LSTACK,
    LSTACK_CLASS,
    LSTACK_DATA,
    LSTACK_REQUEST,
    TEST_ADDRESS,
    TEST_ANSWER,
    TEST_BIT,
    TEST_BLOCK,
    TEST_ENVIRONMENT,
    TEST_ENVIRONMENT_ADDRESS,
    TEST_ENVIRONMENT_BLOCK,
    TEST_ENVIRONMENT_DBS,
    TEST_HEAD,
    TEST_REQUEST,
    TEST_STEP,
    TEST_VARIABLES,
)
from dissect.protocols.s7.start_information import OTHER_START, START_INFORMATION
from dissect.protocols.s7.tables import (
    BLOCK_STATUS_JOB,
    BLOCK_STATUS_V2,
    DELETE_JOB,
    DISABLE_JOB,
    ENABLE_JOB,
    FORCE_VARIABLES,
    LEAVE_HOLD,
    MODIFY_VARIABLE,
    OUTPUT_BSTACK,
    OUTPUT_ISTACK,
    OUTPUT_LSTACK,
    READ_JOB,
    READ_JOB_LIST,
    REPLACE_JOB,
    SET_BREAKPOINT,
    USERDATA_SUBFUNCTIONS,
    VARIABLE_STATUS,
)
from dissect.protocols.s7.watched_items import parse_test_item
from dissect.wire.part import Cursor, Part

#: Commands about jobs, which are not jobs themselves.
JOB_COMMANDS: Final = frozenset((DISABLE_JOB, ENABLE_JOB, DELETE_JOB, READ_JOB_LIST, READ_JOB, REPLACE_JOB))

_OPEN_DBS: Final = 2
_OB: Final = 0x08


def parse_programmer(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the payload of a programmer command: sizes, parameter block, data block."""
    if head.continues:
        cursor.rest("continuation")
        return
    part = cursor.take(TEST_HEAD)
    if part is None:
        return
    if head.type == PUSH:
        part.note = f"job {head.sequence}"
    _blocks(cursor, part, head.type, head.subfunction, head.more)


def _blocks(cursor: Cursor, sizes: Part, type_: int, subfunction: int, more: bool) -> None:
    """Parse the two blocks whose ``sizes`` were read; if there is ``more`` to come, the data block is incomplete."""
    parameters = _block(cursor, sizes.number("parameter_size"), "parameter size", False)
    if type_ == REQUEST:
        _request_parameters(parameters)
    elif parameters.left > 0:
        parameters.take(TEST_ANSWER)
    parameters.rest()  # forms of other sizes are not known
    _join(cursor, parameters)
    data = _block(cursor, sizes.number("data_size"), "data size", more)
    if more:
        data.rest("continues in the next part")
    elif data.left > 0:
        _data(data, type_, subfunction)
        data.finish()
    _join(cursor, data)


def _block(cursor: Cursor, size: int, name: str, cut: bool) -> Cursor:
    """Return a cursor over the next ``size`` octets; note a size that is too large, unless the block is ``cut``."""
    if size > cursor.left and not cut:
        cursor.tell("length_beyond", name, size, cursor.left)
    return Cursor(cursor.octets, cursor.at, min(cursor.at + size, cursor.end), "item", cursor.malformed)


def _join(cursor: Cursor, block: Cursor) -> None:
    cursor.parts.extend(block.parts)
    cursor.at = block.at


def _request_parameters(cursor: Cursor) -> None:
    """Parse the parameter block of a request; each longer form only adds octets at the end."""
    size = cursor.left
    if size < TEST_REQUEST.size:
        return
    cursor.take(TEST_REQUEST)
    if size >= 26:
        block = cursor.take(TEST_BLOCK)
        if block is not None and block.number("block_type"):
            block.note = _block_name(block)
    if size >= 28:
        cursor.take(TEST_STEP)
    if size >= 36:
        environment = cursor.take(TEST_ENVIRONMENT)
        if environment is not None and environment.number("environment") == _OPEN_DBS:
            cursor.take(TEST_ENVIRONMENT_DBS)
            return
        cursor.take(TEST_ENVIRONMENT_BLOCK)
        if size >= 38:
            cursor.take(TEST_ENVIRONMENT_ADDRESS)


def _block_name(part: Part) -> str:
    kind = part.text("block_type") or f"block type {part.number('block_type')}"
    return f"{kind} {part.number('block_number')}"


def _data(cursor: Cursor, type_: int, subfunction: int) -> None:
    """Parse the data block of a programmer command."""
    if subfunction in {VARIABLE_STATUS, MODIFY_VARIABLE, FORCE_VARIABLES}:
        _variables(cursor, type_, subfunction)
    elif subfunction in JOB_COMMANDS:
        _jobs(cursor, type_, subfunction)
    elif subfunction in {BLOCK_STATUS_JOB, BLOCK_STATUS_V2}:
        _block_status(cursor, type_, subfunction)
    elif subfunction == OUTPUT_ISTACK:
        _istack(cursor, type_)
    elif subfunction == OUTPUT_BSTACK:
        _bstack(cursor, type_)
    elif subfunction == OUTPUT_LSTACK:
        _lstack(cursor, type_)
    elif subfunction == SET_BREAKPOINT:
        part = cursor.take(BREAKPOINT_REQUEST if type_ == REQUEST else BREAKPOINT)
        if part is not None and type_ != REQUEST:
            part.note = _block_name(part)
    elif subfunction == LEAVE_HOLD and type_ == REQUEST:
        part = cursor.take(EXIT_HOLD_REQUEST)
        if part is not None:
            part.note = f"until {part.text('until')}" if part.text("until") else ""
    else:
        # Time measurement, force selection, memory reset, flash LED: no source describes their data.
        cursor.rest()


def variable_text(part: Part) -> str:
    """Return the address of a variable of a test function, for example ``MW4``, ``DB10.DBW4 x3`` or ``T5``."""
    number = part.number("bit") if part.layout is TEST_BIT else part.number("count")
    places = part.number("db").to_bytes(2, "big") + part.number("octet").to_bytes(2, "big")
    return parse_test_item(bytes((part.number("area"), number)) + places, 0).label


def _variables(cursor: Cursor, type_: int, subfunction: int) -> None:
    """Parse variables: in a request addresses (with values if they are written), in a push values or return codes."""
    if type_ not in {REQUEST, PUSH}:
        cursor.rest()  # answers have no payload
        return
    head = cursor.take(TEST_VARIABLES)
    if head is None:
        return
    count = head.number("item_count")
    if type_ == REQUEST:
        names = _addresses(cursor, count)
        if subfunction != VARIABLE_STATUS:
            take_data_items(cursor, count, False, names)
    elif subfunction == VARIABLE_STATUS:
        take_data_items(cursor, count, True)
    else:
        taken = min(count, cursor.left)
        for _ in range(taken):
            cursor.take(RETURN_CODE)
        if taken < count:
            cursor.tell("count_mismatch", "variables", count, taken)
        cursor.take_fill(count)


def _addresses(cursor: Cursor, count: int) -> list[str]:
    names: list[str] = []
    for _ in range(count):
        bit = cursor.left > 0 and cursor.octets[cursor.at] & 0x0F == 0
        part = cursor.take(TEST_BIT if bit else TEST_ADDRESS)
        if part is None:
            break
        part.note = variable_text(part)
        names.append(part.note)
    return names


def _jobs(cursor: Cursor, type_: int, subfunction: int) -> None:
    """Parse the request or the answer of a command about jobs."""
    if type_ == REQUEST:
        _job_request(cursor, subfunction)
    elif subfunction == READ_JOB_LIST:
        while cursor.left > 0:
            _name_job(cursor.take(JOB_STATE))
    elif subfunction == READ_JOB:
        sizes = cursor.take(JOB_SIZES)
        if sizes is not None:
            parameters = _block(cursor, sizes.number("parameter_size"), "parameter size", False)
            _request_parameters(parameters)
            parameters.rest()
            _join(cursor, parameters)
            if cursor.left:
                cursor.take(JOB_DATA)
    else:
        cursor.rest()  # the other commands are answered without payload


def _job_request(cursor: Cursor, subfunction: int) -> None:
    if subfunction == READ_JOB_LIST:
        cursor.take(JOB_LIST_RESERVED)
        return
    if subfunction in {DELETE_JOB, REPLACE_JOB}:
        cursor.take(JOB_RESERVED)
    job = cursor.take(JOB)
    _name_job(job)
    if job is None or subfunction != REPLACE_JOB:
        return
    sizes = cursor.take(JOB_SIZES)
    if sizes is None:
        return
    if job.number("function") in JOB_COMMANDS:
        cursor.rest()  # not a job, so it cannot replace one
    else:
        _blocks(cursor, sizes, REQUEST, job.number("function"), False)


def _name_job(part: Part | None) -> None:
    if part is not None:
        part.note = f"job {part.number('job')} of {USERDATA_SUBFUNCTIONS[1].name(part.number('function'))}"


def _block_status(cursor: Cursor, type_: int, subfunction: int) -> None:
    """Parse block status: in a request the registers to watch for each line, in a push their values."""
    second = subfunction == BLOCK_STATUS_V2
    if type_ == REQUEST:
        head = cursor.take(BLOCK_STATUS_2 if second else BLOCK_STATUS)
        if head is None:
            return
        line = BLOCK_STATUS_LINE_2 if second else BLOCK_STATUS_LINE
        lines = head.number("lines") if second else cursor.left // line.size
        for _ in range(lines):
            if cursor.take(line) is None:
                return
        head.note = f"{lines} lines" if lines != 1 else "1 line"
    elif type_ == PUSH:
        part = cursor.take(BLOCK_STATUS_START)
        if part is not None:
            part.note = f"from address 0x{part.number('start_address'):04x}"
            if cursor.left:
                cursor.take(BLOCK_STATUS_DATA)
    else:
        cursor.rest()  # answers have no payload


def _istack(cursor: Cursor, type_: int) -> None:
    part = cursor.take(ISTACK_REQUEST if type_ == REQUEST else ISTACK)
    if part is None or type_ == REQUEST:
        return
    part.note = f"interrupted in {_block_name(part)}"
    at = cursor.at + 3
    ob = cursor.octets[at] if at < cursor.end else -1
    start = cursor.take(START_INFORMATION.get(ob, OTHER_START))
    if start is not None:
        start.note = f"OB {start.number('ob')}"


def _bstack(cursor: Cursor, type_: int) -> None:
    """Parse the block stack: an entry for each open block; after an OB's entry its priority class and start time."""
    if type_ == REQUEST:
        cursor.take(BSTACK_REQUEST)
        return
    while cursor.left > 0:
        entry = cursor.take(BSTACK_ENTRY)
        if entry is None:
            return
        entry.note = _block_name(entry)
        if entry.number("block_type") == _OB:
            cursor.take(BSTACK_CLASS)
            if cursor.left >= BSTACK_TIME.size:
                cursor.take(BSTACK_TIME)
            elif cursor.left:
                cursor.take(BSTACK_REST)


def _lstack(cursor: Cursor, type_: int) -> None:
    if type_ == REQUEST:
        cursor.take(LSTACK_REQUEST)
        return
    part = cursor.take(LSTACK)
    if part is None:
        return
    part.note = f"of {_block_name(part)}"
    size = part.number("size")
    if size and cursor.take(LSTACK_DATA, size) is None:
        return
    cursor.take(LSTACK_CLASS)
