"""The parts of programmer commands (userdata group 1) as layouts (reference section 4.8)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.tables import (
    BLOCK_KINDS,
    CALL_CONDITIONS,
    CALL_ENVIRONMENTS,
    EXIT_HOLD,
    TEST_AREAS,
    TEST_FREQUENCIES,
    TEST_TRIGGER_EVENTS,
    TEST_TRIGGER_TYPES,
    USERDATA_SUBFUNCTIONS,
)
from dissect.protocols.s7.values import date_and_time
from dissect.wire.layout import HOLDS_FLAGS, HOLDS_TIME, HOLDS_VALUE, REST, Field, Layout, plain

_SOURCE: Final = "reference section 4.8"
_JOBS: Final = USERDATA_SUBFUNCTIONS[1]

_SIZES: Final = [
    Field("parameter_size", 2, "Bytes of the parameter block.", "s7comm.tis.parametersize", decimal=True),
    Field("data_size", 2, "Bytes of the data block.", "s7comm.tis.datasize", decimal=True),
]
#: Precedes the parameter block and the data block of every programmer command.
TEST_HEAD: Final = Layout("programmer command", _SOURCE, [*_SIZES])
#: The same sizes, within the data block of a job that is read or replaced.
JOB_SIZES: Final = Layout("job", _SOURCE, [*_SIZES])

#: The part of a request's parameter block that all requests have.
TEST_REQUEST: Final = Layout(
    "trigger",
    _SOURCE,
    [
        Field("parameter_1", 2, "0 in captures.", "s7comm.tis.param1"),
        Field("trigger_type", 2, "What the trigger does.", "s7comm.tis.param2", TEST_TRIGGER_TYPES),
        Field("frequency", 2, "How often.", "s7comm.tis.param3", TEST_FREQUENCIES),
        Field("answer_size", 2, "Bytes expected in the answer.", "s7comm.tis.answersize", decimal=True),
        Field("parameter_5", 2, "0 or 1 in captures.", "s7comm.tis.param5"),
        Field("parameter_6", 2, "1 in captures.", "s7comm.tis.param6"),
        Field("parameter_7", 2, "1 in captures.", "s7comm.tis.param7"),
        Field("parameter_8", 2, "1 in captures.", "s7comm.tis.param8"),
        Field("parameter_9", 2, "1 in captures.", "s7comm.tis.param9"),
        Field("trigger_event", 2, "When.", "s7comm.varstat.trgevent", TEST_TRIGGER_EVENTS),
    ],
)
TEST_BLOCK: Final = Layout(
    "block",
    _SOURCE,
    [
        Field("block_type", 2, "Of the block under test.", "s7comm.diagdata.req.blocktype", BLOCK_KINDS),
        Field("block_number", 2, "Its number.", "s7comm.diagdata.req.blocknumber", decimal=True),
        Field("start_address", 2, "Where the test begins.", "s7comm.diagdata.req.startaddr_awl"),
    ],
)
TEST_STEP: Final = Layout(
    "step address counter", _SOURCE, [Field("step_address", 2, "Step address counter.", "s7comm.diagdata.req.saz")]
)
TEST_ENVIRONMENT: Final = Layout(
    "call environment",
    _SOURCE,
    [
        Field("environment", 2, "What follows.", "s7comm.tis.callenv_setup", CALL_ENVIRONMENTS),
        Field("condition", 2, "When the test is to work.", "s7comm.tis.callenv_cond", CALL_CONDITIONS),
    ],
)
TEST_ENVIRONMENT_DBS: Final = Layout(
    "open data blocks",
    _SOURCE,
    [
        Field("db1", 2, "Number of the DB.", "s7comm.tis.db1.number", decimal=True),
        Field("db2", 2, "Number of the DI.", "s7comm.tis.db2.number", decimal=True),
    ],
)
TEST_ENVIRONMENT_BLOCK: Final = Layout(
    "calling block",
    _SOURCE,
    [
        Field("block_type", 2, "Its type.", "s7comm.tis.callenv_cond_blocktype", BLOCK_KINDS),
        Field("block_number", 2, "Its number.", "s7comm.tis.callenv_cond_blocknumber", decimal=True),
    ],
)
TEST_ENVIRONMENT_ADDRESS: Final = Layout(
    "calling address", _SOURCE, [Field("address", 2, "Code address.", "s7comm.tis.callenv_cond_blockaddress")]
)
#: The parameter block of an answer or push.
TEST_ANSWER: Final = Layout(
    "answer parameters",
    _SOURCE,
    [
        Field("parameter_1", 2, "Unknown.", "s7comm.tis.res.param1"),
        Field("parameter_2", 2, "Unknown.", "s7comm.tis.res.param2"),
    ],
)

TEST_VARIABLES: Final = Layout(
    "variables", _SOURCE, [Field("item_count", 2, "Variables that follow.", "s7comm.varstat.item_count")]
)
_AREA: Final = Field("area", 1, "Area and width.", "s7comm.varstat.req.memory_area", TEST_AREAS)
_PLACE: Final = [
    Field("db", 2, "DB number, 0 outside data blocks.", "s7comm.varstat.req.db_number"),
    Field(
        "octet", 2, "Byte address, or number of a timer or counter.", "s7comm.varstat.req.startaddress", decimal=True
    ),
]
#: A variable; the low nibble of ``area`` is its width.
TEST_ADDRESS: Final = Layout(
    "variable",
    _SOURCE,
    [_AREA, Field("count", 1, "How many one after another.", "s7comm.varstat.req.repetition_factor"), *_PLACE],
)
#: A variable of one bit: the low nibble of ``area`` is 0.
TEST_BIT: Final = Layout("variable", _SOURCE, [_AREA, Field("bit", 1, "Bit.", "s7comm.varstat.req.bitpos"), *_PLACE])

#: Identifies a job by the subfunction that started it and the sequence number of its answer.
JOB: Final = Layout(
    "job",
    _SOURCE,
    [
        Field("function", 1, "Subfunction that made it.", "s7comm.tis.job.function", _JOBS),
        Field("job", 1, "Sequence number of its answer.", "s7comm.tis.job.response_seq_num", decimal=True),
    ],
)
JOB_RESERVED: Final = Layout("reserved", _SOURCE, [Field("reserved", 2, "0.", "s7comm.tis.job.reserved", means=plain)])
JOB_LIST_RESERVED: Final = Layout(
    "reserved",
    _SOURCE,
    [
        Field("reserved_1", 2, "0.", "s7comm.tis.job.reserved", means=plain),
        Field("reserved_2", 2, "0.", "s7comm.tis.job.reserved", means=plain),
    ],
)
#: An entry of the job list.
JOB_STATE: Final = Layout(
    "job",
    _SOURCE,
    [
        *JOB.fields,
        Field("state", 2, "Perhaps whether it is active.", "s7comm.tis.job.reserved", means=plain, holds=HOLDS_FLAGS),
    ],
)
#: The data of a job that is read; the answer does not state the type of the job.
JOB_DATA: Final = Layout(
    "data of the job",
    _SOURCE,
    [Field("job_data", REST, "As the job was made.", "s7comm.tis.job.reserved", holds=HOLDS_VALUE)],
)

_REGISTERS: Final = [
    Field("unknown", 1, "0.", bits=(0x80, 7)),
    Field("db2", 1, "DI register.", "s7comm.diagdata.register.db2", bits=(0x40, 6), shares=True),
    Field("db1", 1, "DB register.", "s7comm.diagdata.register.db1", bits=(0x20, 5), shares=True),
    Field("ar2", 1, "Address register 2.", "s7comm.diagdata.register.ar2", bits=(0x10, 4), shares=True),
    Field("ar1", 1, "Address register 1.", "s7comm.diagdata.register.ar1", bits=(0x08, 3), shares=True),
    Field("accu2", 1, "Accumulator 2.", "s7comm.diagdata.register.accu2", bits=(0x04, 2), shares=True),
    Field("accu1", 1, "Accumulator 1.", "s7comm.diagdata.register.accu1", bits=(0x02, 1), shares=True),
    Field("stw", 1, "Status word.", "s7comm.diagdata.register.stw", bits=(0x01, 0), shares=True),
]
_LINE_RESERVED: Final = Field("reserved", 1, "0.", "s7comm.tis.blockstat.reserved", means=plain)
_LINE_ADDRESS: Final = Field("address", 2, "Code address of the line.", "s7comm.tis.blockstat.line_address")
#: The registers that block status requests.
BLOCK_STATUS: Final = Layout("block status", _SOURCE, [_LINE_RESERVED, *_REGISTERS])
BLOCK_STATUS_LINE: Final = Layout("line", _SOURCE, [_LINE_RESERVED, *_REGISTERS])
#: The same in block status v2, which identifies lines by their addresses.
BLOCK_STATUS_2: Final = Layout(
    "block status",
    _SOURCE,
    [
        Field("flags", 1, "Unknown.", "s7comm.tis.blockstat.flagsunknown"),
        Field("lines", 1, "Lines that follow.", "s7comm.tis.blockstat.number_of_lines", counts="line"),
        _LINE_RESERVED,
        *_REGISTERS,
    ],
)
BLOCK_STATUS_LINE_2: Final = Layout("line", _SOURCE, [_LINE_ADDRESS, _LINE_RESERVED, *_REGISTERS])
BLOCK_STATUS_START: Final = Layout(
    "block status values",
    _SOURCE,
    [Field("start_address", 2, "Code address of the first line.", "s7comm.diagdata.req.startaddr_awl")],
)
#: The values of registers; the request states which registers and how many lines.
BLOCK_STATUS_DATA: Final = Layout(
    "registers", _SOURCE, [Field("registers", REST, "As requested.", "s7comm.tis.blockstat.data", holds=HOLDS_VALUE)]
)

_DB_TYPES: Final = [
    Field("db1_type", 1, "What the DB register holds.", "s7comm.tis.db1.type", BLOCK_KINDS),
    Field("db2_type", 1, "What the DI register holds.", "s7comm.tis.db2.type", BLOCK_KINDS),
    Field("db1", 2, "Number in the DB register.", "s7comm.tis.db1.number", decimal=True),
    Field("db2", 2, "Number in the DI register.", "s7comm.tis.db2.number", decimal=True),
]
_INTERRUPTED: Final = [
    Field("block_type", 2, "Of the interrupted block.", "s7comm.tis.interrupted.blocktype", BLOCK_KINDS),
    Field("block_number", 2, "Its number.", "s7comm.tis.interrupted.blocknumber", decimal=True),
    Field("address", 2, "Code address in it.", "s7comm.tis.interrupted.address"),
]
_PRIORITY: Final = Field("priority", 1, "Priority class.", "s7comm.tis.interrupted.priorityclass", decimal=True)
_ACCU1: Final = Field("accu1", 4, "Accumulator 1.", "s7comm.tis.accu1", holds=HOLDS_VALUE)
_ACCU2: Final = Field("accu2", 4, "Accumulator 2.", "s7comm.tis.accu2", holds=HOLDS_VALUE)
_AR1: Final = Field("ar1", 4, "Address register 1.", "s7comm.tis.ar1")
_AR2: Final = Field("ar2", 4, "Address register 2.", "s7comm.tis.ar2")
_STW: Final = Field("stw", 2, "Status word.", "s7comm.tis.stw")
_TIME: Final = Field("time", 8, "DATE_AND_TIME in BCD.", "s7comm.data.ts", means=date_and_time, holds=HOLDS_TIME)

ISTACK_REQUEST: Final = Layout(
    "ISTACK", _SOURCE, [Field("reserved", 2, "0.", "s7comm.tis.istack.reserved", means=plain)]
)
ISTACK: Final = Layout(
    "ISTACK",
    _SOURCE,
    [
        Field("continued_type", 2, "Block that goes on.", "s7comm.tis.continued.blocktype", BLOCK_KINDS),
        Field("continued_number", 2, "Its number.", "s7comm.tis.continued.blocknumber", decimal=True),
        Field("continued_address", 2, "Code address in it.", "s7comm.tis.continued.address"),
        *_DB_TYPES,
        Field("reserved_1", 4, "Unknown.", "s7comm.tis.istack.reserved", means=plain),
        _ACCU1,
        _ACCU2,
        Field("accu3", 4, "Accumulator 3.", "s7comm.tis.accu3", holds=HOLDS_VALUE),
        Field("accu4", 4, "Accumulator 4.", "s7comm.tis.accu4", holds=HOLDS_VALUE),
        _AR1,
        _AR2,
        Field("reserved_2", 2, "Unknown.", "s7comm.tis.istack.reserved", means=plain),
        _STW,
        *_INTERRUPTED,
        Field("reserved_3", 2, "Unknown.", "s7comm.tis.istack.reserved", means=plain),
        Field("reserved_4", 4, "Unknown.", "s7comm.tis.istack.reserved", means=plain),
    ],
)
BSTACK_REQUEST: Final = Layout(
    "BSTACK", _SOURCE, [Field("reserved", 2, "0.", "s7comm.tis.bstack.reserved", means=plain)]
)
BSTACK_ENTRY: Final = Layout(
    "BSTACK entry",
    _SOURCE,
    [
        *_INTERRUPTED,
        *_DB_TYPES,
        Field("reserved", 4, "Unknown.", "s7comm.tis.bstack.reserved", means=plain),
    ],
)
#: Follows the entry of an OB.
BSTACK_CLASS: Final = Layout(
    "priority class",
    _SOURCE,
    [
        _PRIORITY,
        Field("reserved_1", 1, "Unknown.", "s7comm.tis.bstack.reserved", means=plain),
        Field("reserved_2", 2, "Unknown.", "s7comm.tis.bstack.reserved", means=plain),
    ],
)
BSTACK_TIME: Final = Layout("start time", _SOURCE, [_TIME])
#: The rest of a start time if the data size is too small by four, as one firmware sends it.
BSTACK_REST: Final = Layout(
    "start time, cut", _SOURCE, [Field("rest", REST, "First bytes of the time.", "s7comm.tis.bstack.reserved")]
)

LSTACK_REQUEST: Final = Layout(
    "LSTACK",
    _SOURCE,
    [_PRIORITY, Field("depth", 1, "Nesting depth.", "s7comm.tis.bstack.neting_depth", decimal=True)],
)
LSTACK: Final = Layout(
    "LSTACK",
    _SOURCE,
    [*_INTERRUPTED, Field("size", 2, "Bytes of local data.", "s7comm.tis.lstack.size", counts="local data")],
)
LSTACK_DATA: Final = Layout(
    "local data", _SOURCE, [Field("local_data", REST, "As on the wire.", "s7comm.tis.lstack.data", holds=HOLDS_VALUE)]
)
LSTACK_CLASS: Final = Layout(
    "priority class",
    _SOURCE,
    [
        _PRIORITY,
        Field("reserved_1", 1, "Unknown.", "s7comm.tis.lstack.reserved", means=plain),
        Field("reserved_2", 2, "Unknown.", "s7comm.tis.lstack.reserved", means=plain),
        _TIME,
    ],
)

EXIT_HOLD_REQUEST: Final = Layout(
    "exit HOLD",
    _SOURCE,
    [
        Field("until", 1, "Where the CPU stops next.", "s7comm.tis.exithold_until", EXIT_HOLD),
        Field("reserved", 1, "Unknown.", "s7comm.tis.exithold_res1"),
    ],
)
BREAKPOINT_REQUEST: Final = Layout(
    "breakpoint", _SOURCE, [Field("reserved", 2, "0.", "s7comm.tis.breakpoint.reserved", means=plain)]
)
BREAKPOINT: Final = Layout(
    "breakpoint",
    _SOURCE,
    [
        *_INTERRUPTED,
        Field("breakpoint_type", 2, "Block that the CPU stands in.", "s7comm.tis.breakpoint.blocktype", BLOCK_KINDS),
        Field("breakpoint_number", 2, "Its number.", "s7comm.tis.breakpoint.blocknumber", decimal=True),
        Field("breakpoint_address", 2, "Code address in it.", "s7comm.tis.breakpoint.address"),
        Field("reserved", 2, "Unknown.", "s7comm.tis.breakpoint.reserved", means=plain),
        _STW,
        _ACCU1,
        _ACCU2,
        _AR1,
        _AR2,
        *_DB_TYPES,
    ],
)
