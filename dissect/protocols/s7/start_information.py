"""The start information of an OB: the first 20 octets of its local data, as in the ISTACK (reference section 4.8).

Head and time are the same for every OB; the eight octets between them follow the Siemens documentation of each OB.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.values import date_and_time
from dissect.wire.layout import HOLDS_TIME, HOLDS_VALUE, Field, Layout, plain

_OB: Final = "s7comm.ob."
_RESERVED_1: Final = Field("reserved_1", 1, "Unknown.", f"{_OB}reserved_1")
_RESERVED_2: Final = Field("reserved_2", 1, "Unknown.", f"{_OB}reserved_2")
_RESERVED_3: Final = Field("reserved_3", 2, "Unknown.", f"{_OB}reserved_3")
_RESERVED_4: Final = Field("reserved_4", 2, "Unknown.", f"{_OB}reserved_4")
_RESERVED_4_WIDE: Final = Field("reserved_4", 4, "Unknown.", f"{_OB}reserved_4_dw")
_IO_FLAG: Final = Field("io_flag", 1, "0x54 input, 0x55 output module.", f"{_OB}io_flag")
_MODULE: Final = Field("module_address", 2, "Address of the module.", f"{_OB}mdl_addr", decimal=True)
_CAUSE: Final = [
    Field("cause_class", 1, "Class of the event that caused it.", f"{_OB}err_ev_class"),
    Field("cause", 1, "Its number.", f"{_OB}err_ev_num"),
    Field("cause_priority", 1, "Priority class of the OB in which it happened.", f"{_OB}err_ob_priority", decimal=True),
    Field("cause_ob", 1, "Number of that OB.", f"{_OB}err_ob_num", decimal=True),
]
_BLOCK_TYPE: Final = Field("block_type", 1, "Type of the block with the fault.", f"{_OB}blk_type")
_BLOCK: Final = [
    Field("block_number", 2, "Number of the block with the fault.", f"{_OB}flt_blk_num", decimal=True),
    Field("address", 2, "Code address in it.", f"{_OB}prg_addr"),
]


def _start(event: str, fields: list[Field]) -> Layout:
    """Return the layout with ``fields`` as its eight octets; ``event`` is Wireshark's name of the event field."""
    return Layout(
        "start information",
        "reference section 4.8",
        [
            Field("event_class", 1, "Event class, and 1 in bits 3-0 for coming.", f"{_OB}ev_class"),
            Field("event", 1, "Number of the event that started the OB.", f"{_OB}{event}" if event else ""),
            Field("priority", 1, "Priority class.", f"{_OB}priority", decimal=True),
            Field("ob", 1, "OB number.", f"{_OB}number", decimal=True),
            *fields,
            Field("time", 8, "DATE_AND_TIME in BCD.", "s7comm.data.ts", means=date_and_time, holds=HOLDS_TIME),
        ],
    )


#: For an OB that is not in `START_INFORMATION`.
OTHER_START: Final = _start("", [Field("details", 8, "Depends on the OB.", means=plain, holds=HOLDS_VALUE)])

_CYCLE: Final = _start(
    "scan_1",
    [
        _RESERVED_1,
        _RESERVED_2,
        Field("previous_cycle", 2, "Last cycle in ms.", f"{_OB}prev_cycle", decimal=True),
        Field("shortest_cycle", 2, "Shortest cycle in ms.", f"{_OB}min_cycle", decimal=True),
        Field("longest_cycle", 2, "Longest cycle in ms.", f"{_OB}max_cycle", decimal=True),
    ],
)
_TIME_OF_DAY: Final = _start(
    "strt_info",
    [
        _RESERVED_1,
        _RESERVED_2,
        Field("period", 2, "How often it runs.", f"{_OB}period_exe"),
        _RESERVED_3,
        _RESERVED_4,
    ],
)
#: Wireshark is off by one octet here: it expects another octet before the OB number.
_DELAY: Final = _start(
    "",
    [
        Field("reserved_1", 1, "Unknown."),
        Field("reserved_2", 1, "Unknown."),
        Field("sign", 2, "SIGN of SRT_DINT."),
        Field("delay", 4, "DTIME of SRT_DINT in ms.", decimal=True),
    ],
)
_CYCLIC_INTERRUPT: Final = _start(
    "strt_info",
    [
        _RESERVED_1,
        _RESERVED_2,
        Field("phase_offset", 2, "Phase offset in ms.", f"{_OB}phase_offset", decimal=True),
        _RESERVED_3,
        Field("interval", 2, "Interval in ms.", f"{_OB}exec_freq", decimal=True),
    ],
)
_HARDWARE_INTERRUPT: Final = _start(
    "strt_info",
    [_RESERVED_1, _IO_FLAG, _MODULE, Field("point", 4, "What on the module caused it.", f"{_OB}point_addr")],
)
_DP_INTERRUPT: Final = _start(
    "strt_info",
    [
        _RESERVED_1,
        _IO_FLAG,
        _MODULE,
        Field("length", 1, "Bytes of the additional information.", f"{_OB}inf_len", decimal=True),
        Field("type", 1, "Type of the interrupt.", f"{_OB}alarm_type"),
        Field("slot", 1, "Slot.", f"{_OB}alarm_slot", decimal=True),
        Field("specifier", 1, "Specifier.", f"{_OB}alarm_spec"),
    ],
)
_RESTART: Final = _start(
    "strtup",
    [
        _RESERVED_1,
        _RESERVED_2,
        Field("stop", 2, "Event that stopped the CPU.", f"{_OB}stop"),
        Field("start", 4, "More about the start.", f"{_OB}strt_info"),
    ],
)

#: Layouts by OB number.
START_INFORMATION: Final[dict[int, Layout]] = {
    1: _CYCLE,
    **dict.fromkeys(range(10, 18), _TIME_OF_DAY),
    **dict.fromkeys(range(20, 24), _DELAY),
    **dict.fromkeys(range(30, 39), _CYCLIC_INTERRUPT),
    **dict.fromkeys(range(40, 49), _HARDWARE_INTERRUPT),
    **dict.fromkeys(range(55, 58), _DP_INTERRUPT),
    80: _start(
        "flt_id", [_RESERVED_1, _RESERVED_2, Field("information", 2, "About the event.", f"{_OB}error_info"), *_CAUSE]
    ),
    81: _start(
        "flt_id",
        [_RESERVED_1, _RESERVED_2, Field("rack", 2, "Rack or CPU.", f"{_OB}rack_cpu"), _RESERVED_3, _RESERVED_4],
    ),
    82: _start(
        "flt_id",
        [
            _RESERVED_1,
            _IO_FLAG,
            _MODULE,
            Field("fault_1", 1, "Fault bits.", f"{_OB}8x_fault_flags"),
            Field("module_type", 1, "Type of the module.", f"{_OB}mdl_type_b"),
            Field("fault_2", 1, "Fault bits.", f"{_OB}8x_fault_flags"),
            Field("fault_3", 1, "Fault bits.", f"{_OB}8x_fault_flags"),
        ],
    ),
    83: _start(
        "flt_id",
        [
            _RESERVED_1,
            _IO_FLAG,
            _MODULE,
            Field("rack", 2, "Rack of the module.", f"{_OB}rack_num", decimal=True),
            Field("module_type", 2, "Type of the module.", f"{_OB}mdl_type_w"),
        ],
    ),
    84: _start("flt_id", [_RESERVED_1, _RESERVED_2, _RESERVED_3, _RESERVED_4_WIDE]),
    85: _start("flt_id", [_RESERVED_1, _RESERVED_2, _RESERVED_3, *_CAUSE]),
    86: _start(
        "flt_id", [_RESERVED_1, _RESERVED_2, _MODULE, Field("racks", 4, "Racks with the fault.", f"{_OB}racks_flt")]
    ),
    87: _start("flt_id", [_RESERVED_1, _RESERVED_2, _RESERVED_3, *_CAUSE]),
    90: _start("strt_info", [_RESERVED_1, _RESERVED_2, _RESERVED_3, _RESERVED_4_WIDE]),
    **dict.fromkeys(range(100, 103), _RESTART),
    121: _start(
        "sw_flt",
        [
            _BLOCK_TYPE,
            _RESERVED_1,
            Field("register", 2, "Register or number with the fault.", f"{_OB}flt_reg"),
            *_BLOCK,
        ],
    ),
    122: _start(
        "sw_flt",
        [
            _BLOCK_TYPE,
            Field("area", 1, "Memory area and kind of access.", f"{_OB}mem_area"),
            Field("memory_address", 2, "Address that was accessed.", f"{_OB}mem_addr", decimal=True),
            *_BLOCK,
        ],
    ),
}
