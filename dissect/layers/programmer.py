"""Programmer commands as Scapy packets (`dissect.s7.programmer`)."""

from __future__ import annotations

from scapy.packet import Packet

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import programmer_layouts
from dissect.wire.layout import Field

__all__ = [
    "S7_ISTACK",
    "S7_LSTACK",
    "S7_BSTACKClass",
    "S7_BSTACKEntry",
    "S7_BSTACKRequest",
    "S7_BSTACKRest",
    "S7_BSTACKTime",
    "S7_BlockStatus",
    "S7_BlockStatus2",
    "S7_BlockStatusData",
    "S7_BlockStatusLine",
    "S7_BlockStatusLine2",
    "S7_BlockStatusStart",
    "S7_Breakpoint",
    "S7_BreakpointRequest",
    "S7_ExitHoldRequest",
    "S7_ISTACKRequest",
    "S7_JobData",
    "S7_LSTACKClass",
    "S7_LSTACKData",
    "S7_LSTACKRequest",
    "S7_TestAddress",
    "S7_TestAnswer",
    "S7_TestBit",
    "S7_TestBlock",
    "S7_TestEnvironment",
    "S7_TestEnvironmentAddress",
    "S7_TestEnvironmentBlock",
    "S7_TestEnvironmentDBS",
    "S7_TestHead",
    "S7_TestJob",
    "S7_TestJobListReserved",
    "S7_TestJobReserved",
    "S7_TestJobSizes",
    "S7_TestJobState",
    "S7_TestRequest",
    "S7_TestStep",
    "S7_TestVariables",
]

#: Parts of the parameter block; everything else is the data block.
_PARAMETERS = (
    "S7_TestRequest",
    "S7_TestBlock",
    "S7_TestStep",
    "S7_TestEnvironment",
    "S7_TestEnvironmentDBS",
    "S7_TestEnvironmentBlock",
    "S7_TestEnvironmentAddress",
    "S7_TestAnswer",
)


def block_size(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return the octets of the parameter block, which the parts ``behind`` begin with, or those of the data block."""
    names = [type(part).__name__ for part in behind]
    count = next((number for number, name in enumerate(names) if name not in _PARAMETERS), len(names))
    return sum(sizes[:count] if field.name == "parameter_size" else sizes[count:])


class S7_TestHead(S7_Part):
    """Before the parameter block and the data block of every programmer command.

    ``parameter_size`` and ``data_size`` are filled in when left out.
    """

    name = "S7 programmer command"
    layout = programmer_layouts.TEST_HEAD
    fields_desc = header_fields(programmer_layouts.TEST_HEAD, {"parameter_size": None, "data_size": None})

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return the size of the parameter block or of the data block."""
        return block_size(field, behind, sizes)


class S7_TestJobSizes(S7_Part):
    """The same within the data block of a job that is read or replaced.

    ``parameter_size`` and ``data_size`` are filled in when left out.
    """

    name = "S7 job"
    layout = programmer_layouts.JOB_SIZES
    fields_desc = header_fields(programmer_layouts.JOB_SIZES, {"parameter_size": None, "data_size": None})

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return the size of the parameter block or of the data block."""
        return block_size(field, behind, sizes)


class S7_TestRequest(S7_Part):
    """The parameter block of a request, as far as all have it."""

    name = "S7 trigger"
    layout = programmer_layouts.TEST_REQUEST
    fields_desc = header_fields(programmer_layouts.TEST_REQUEST, {"trigger_type": 1})


class S7_TestBlock(S7_Part):
    """Block and address that a test is about."""

    name = "S7 block"
    layout = programmer_layouts.TEST_BLOCK
    fields_desc = header_fields(programmer_layouts.TEST_BLOCK)


class S7_TestStep(S7_Part):
    """Step address counter of a test."""

    name = "S7 step address counter"
    layout = programmer_layouts.TEST_STEP
    fields_desc = header_fields(programmer_layouts.TEST_STEP)


class S7_TestEnvironment(S7_Part):
    """When a test is to work: call environment and condition."""

    name = "S7 call environment"
    layout = programmer_layouts.TEST_ENVIRONMENT
    fields_desc = header_fields(programmer_layouts.TEST_ENVIRONMENT)


class S7_TestEnvironmentDBS(S7_Part):
    """Data blocks that are to be open."""

    name = "S7 open data blocks"
    layout = programmer_layouts.TEST_ENVIRONMENT_DBS
    fields_desc = header_fields(programmer_layouts.TEST_ENVIRONMENT_DBS)


class S7_TestEnvironmentBlock(S7_Part):
    """Block that is to call."""

    name = "S7 calling block"
    layout = programmer_layouts.TEST_ENVIRONMENT_BLOCK
    fields_desc = header_fields(programmer_layouts.TEST_ENVIRONMENT_BLOCK)


class S7_TestEnvironmentAddress(S7_Part):
    """Address that is to call."""

    name = "S7 calling address"
    layout = programmer_layouts.TEST_ENVIRONMENT_ADDRESS
    fields_desc = header_fields(programmer_layouts.TEST_ENVIRONMENT_ADDRESS)


class S7_TestAnswer(S7_Part):
    """The parameter block of an answer or push."""

    name = "S7 answer parameters"
    layout = programmer_layouts.TEST_ANSWER
    fields_desc = header_fields(programmer_layouts.TEST_ANSWER)


class S7_TestVariables(S7_Part):
    """How many variables of a test function follow. ``item_count`` is filled in when left out."""

    name = "S7 variables"
    layout = programmer_layouts.TEST_VARIABLES
    fields_desc = header_fields(programmer_layouts.TEST_VARIABLES, {"item_count": None})

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return how many addresses follow, or values, or return codes where there are no addresses."""
        names = [type(part).__name__ for part in behind]
        addresses = names.count("S7_TestAddress") + names.count("S7_TestBit")
        return addresses or names.count("S7_DataItem") or names.count("S7_ReturnCode")


class S7_TestAddress(S7_Part):
    """A variable; the low nibble of the area is the width."""

    name = "S7 variable"
    layout = programmer_layouts.TEST_ADDRESS
    fields_desc = header_fields(programmer_layouts.TEST_ADDRESS, {"area": 0x02, "count": 1})


class S7_TestBit(S7_Part):
    """A variable of one bit: the low nibble of the area is 0."""

    name = "S7 variable"
    layout = programmer_layouts.TEST_BIT
    fields_desc = header_fields(programmer_layouts.TEST_BIT)


class S7_TestJob(S7_Part):
    """Names a job by the subfunction that made it and the sequence number of its answer."""

    name = "S7 job"
    layout = programmer_layouts.JOB
    fields_desc = header_fields(programmer_layouts.JOB)


class S7_TestJobReserved(S7_Part):
    """What precedes the job to delete or replace."""

    name = "S7 reserved"
    layout = programmer_layouts.JOB_RESERVED
    fields_desc = header_fields(programmer_layouts.JOB_RESERVED)


class S7_TestJobListReserved(S7_Part):
    """What a request of the job list has."""

    name = "S7 reserved"
    layout = programmer_layouts.JOB_LIST_RESERVED
    fields_desc = header_fields(programmer_layouts.JOB_LIST_RESERVED)


class S7_TestJobState(S7_Part):
    """An entry of the job list."""

    name = "S7 job"
    layout = programmer_layouts.JOB_STATE
    fields_desc = header_fields(programmer_layouts.JOB_STATE)


class S7_JobData(S7_Part):
    """The data of a job that is read; the answer does not say which kind of job it is."""

    name = "S7 data of the job"
    layout = programmer_layouts.JOB_DATA
    fields_desc = header_fields(programmer_layouts.JOB_DATA)


class S7_BlockStatus(S7_Part):
    """Registers asked for, in block status."""

    name = "S7 block status"
    layout = programmer_layouts.BLOCK_STATUS
    fields_desc = header_fields(programmer_layouts.BLOCK_STATUS)


class S7_BlockStatusLine(S7_Part):
    """A line of a block to watch."""

    name = "S7 line"
    layout = programmer_layouts.BLOCK_STATUS_LINE
    fields_desc = header_fields(programmer_layouts.BLOCK_STATUS_LINE)


class S7_BlockStatus2(S7_Part):
    """The same in block status v2, which knows the lines by their addresses. ``lines`` is filled in when left out."""

    name = "S7 block status"
    layout = programmer_layouts.BLOCK_STATUS_2
    fields_desc = header_fields(programmer_layouts.BLOCK_STATUS_2)


class S7_BlockStatusLine2(S7_Part):
    """A line of a block to watch, by its address."""

    name = "S7 line"
    layout = programmer_layouts.BLOCK_STATUS_LINE_2
    fields_desc = header_fields(programmer_layouts.BLOCK_STATUS_LINE_2)


class S7_BlockStatusStart(S7_Part):
    """Where the values of a block status begin."""

    name = "S7 block status values"
    layout = programmer_layouts.BLOCK_STATUS_START
    fields_desc = header_fields(programmer_layouts.BLOCK_STATUS_START)


class S7_BlockStatusData(S7_Part):
    """What the registers held; which ones and in how many lines stands in the request."""

    name = "S7 registers"
    layout = programmer_layouts.BLOCK_STATUS_DATA
    fields_desc = header_fields(programmer_layouts.BLOCK_STATUS_DATA)


class S7_ISTACKRequest(S7_Part):
    """Asks for the interrupt stack."""

    name = "S7 ISTACK"
    layout = programmer_layouts.ISTACK_REQUEST
    fields_desc = header_fields(programmer_layouts.ISTACK_REQUEST)


class S7_ISTACK(S7_Part):
    """The interrupt stack."""

    name = "S7 ISTACK"
    layout = programmer_layouts.ISTACK
    fields_desc = header_fields(programmer_layouts.ISTACK)


class S7_BSTACKRequest(S7_Part):
    """Asks for the block stack."""

    name = "S7 BSTACK"
    layout = programmer_layouts.BSTACK_REQUEST
    fields_desc = header_fields(programmer_layouts.BSTACK_REQUEST)


class S7_BSTACKEntry(S7_Part):
    """An open block of the block stack."""

    name = "S7 BSTACK entry"
    layout = programmer_layouts.BSTACK_ENTRY
    fields_desc = header_fields(programmer_layouts.BSTACK_ENTRY)


class S7_BSTACKClass(S7_Part):
    """Follows the entry of an OB."""

    name = "S7 priority class"
    layout = programmer_layouts.BSTACK_CLASS
    fields_desc = header_fields(programmer_layouts.BSTACK_CLASS)


class S7_BSTACKTime(S7_Part):
    """Start time of an OB in the block stack."""

    name = "S7 start time"
    layout = programmer_layouts.BSTACK_TIME
    fields_desc = header_fields(programmer_layouts.BSTACK_TIME)


class S7_BSTACKRest(S7_Part):
    """What is left of a start time when the data size is too small by four, as one firmware tells it."""

    name = "S7 start time, cut"
    layout = programmer_layouts.BSTACK_REST
    fields_desc = header_fields(programmer_layouts.BSTACK_REST)


class S7_LSTACKRequest(S7_Part):
    """Asks for the local data stack."""

    name = "S7 LSTACK"
    layout = programmer_layouts.LSTACK_REQUEST
    fields_desc = header_fields(programmer_layouts.LSTACK_REQUEST)


class S7_LSTACK(S7_Part):
    """The local data stack of a block. ``size`` is filled in when left out."""

    name = "S7 LSTACK"
    layout = programmer_layouts.LSTACK
    fields_desc = header_fields(programmer_layouts.LSTACK)

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return the octets of the local data."""
        return sum([size for part, size in zip(behind, sizes, strict=True) if isinstance(part, S7_LSTACKData)])


class S7_LSTACKData(S7_Part):
    """Local data of a block."""

    name = "S7 local data"
    layout = programmer_layouts.LSTACK_DATA
    fields_desc = header_fields(programmer_layouts.LSTACK_DATA)


class S7_LSTACKClass(S7_Part):
    """Priority class and start time behind local data."""

    name = "S7 priority class"
    layout = programmer_layouts.LSTACK_CLASS
    fields_desc = header_fields(programmer_layouts.LSTACK_CLASS)


class S7_ExitHoldRequest(S7_Part):
    """Leaves HOLD."""

    name = "S7 exit HOLD"
    layout = programmer_layouts.EXIT_HOLD_REQUEST
    fields_desc = header_fields(programmer_layouts.EXIT_HOLD_REQUEST)


class S7_BreakpointRequest(S7_Part):
    """Sets a breakpoint."""

    name = "S7 breakpoint"
    layout = programmer_layouts.BREAKPOINT_REQUEST
    fields_desc = header_fields(programmer_layouts.BREAKPOINT_REQUEST)


class S7_Breakpoint(S7_Part):
    """Where the CPU stands, and its registers."""

    name = "S7 breakpoint"
    layout = programmer_layouts.BREAKPOINT
    fields_desc = header_fields(programmer_layouts.BREAKPOINT)
