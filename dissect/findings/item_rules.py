"""What is worth saying about parameter blocks and their items: codes nobody knows, addresses that cannot be (reference 7.3).

A parameter block is judged where it is seen first (`Parameters.unjudged`), so that polling the same items for hours costs
nothing.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.findings.reporter import Reporter
from dissect.s7.items import Item
from dissect.s7.parameters import Parameters
from dissect.s7.tables import (
    ACK_DATA,
    AREAS,
    BIT,
    CPU_SERVICES,
    DB_AREAS,
    FUNCTIONS,
    GROUP_PBC,
    JOB,
    NUMBERED_AREAS,
    RECORD_AREA,
    S7ANY,
    SYNTAX_IDS,
    TRANSPORT_SIZES,
    USERDATA_GROUPS,
    USERDATA_SUBFUNCTIONS,
)
from dissect.transactions.table import Side

#: Areas that have an element of their own, by the transport size of the same number.
_OWN_SIZE: Final = frozenset((0x1C, 0x1D))
#: Faults of a block that a finding names.
_NAMED: Final = 3


def judge_parameters(judge: Reporter, side: Side, parameters: Parameters, frame: i64, time_ns: i64) -> None:
    """Look at a parameter block that was not seen before."""
    parameters.unjudged = False
    if parameters.malformed:
        return
    unknown = _unknown_codes(parameters)
    odd: list[str] = []
    for item in parameters.items:
        if item.syntax_id == S7ANY and item.transport_size >= 0:
            what = odd_address(item)
            if what:
                odd.append(f"{item.address}: {what}")
    _note(judge, "s7.unknown_code", side, parameters, unknown, frame, time_ns)
    _note(judge, "s7.odd_address", side, parameters, odd, frame, time_ns)


def _note(
    judge: Reporter, slug: str, side: Side, parameters: Parameters, faults: list[str], frame: i64, time_ns: i64
) -> None:
    if faults:
        more = f" and {len(faults) - _NAMED} more" if len(faults) > _NAMED else ""
        begun = f"{parameters.function_name}: " if parameters.items else ""
        detail = f"{begun}{'; '.join(faults[:_NAMED])}{more}"
        judge.note(slug, side.connection.number, [frame], time_ns, detail)


def _unknown_codes(parameters: Parameters) -> list[str]:
    """Name every code of a block that no table knows."""
    found: list[str] = []
    function: i64 = parameters.function
    head = parameters.userdata
    if head is not None:
        if head.group not in USERDATA_GROUPS:
            found.append(f"userdata group 0x{head.group:02x}")
        elif head.group != GROUP_PBC or function != CPU_SERVICES:  # PBC has a PDU of its own in place of a subfunction
            subfunctions = USERDATA_SUBFUNCTIONS.get(head.group)
            if subfunctions is not None and head.subfunction not in subfunctions:
                found.append(f"subfunction 0x{head.subfunction:02x} of {head.group_name}")
        return found
    if function >= 0 and (parameters.rosctr == JOB or parameters.rosctr == ACK_DATA) and function not in FUNCTIONS:
        found.append(f"function 0x{function:02x}")
    for number, item in enumerate(parameters.items, 1):
        if item.syntax_id not in SYNTAX_IDS:
            found.append(f"item {number}: syntax 0x{item.syntax_id:02x}")
        elif item.transport_size >= 0:
            if item.area not in AREAS:
                found.append(f"item {number}: area 0x{item.area:02x}")
            if item.transport_size not in TRANSPORT_SIZES:
                found.append(f"item {number}: transport size 0x{item.transport_size:02x}")
    return found


def odd_address(item: Item) -> str:
    """Say what is odd about the address of an S7ANY item, empty when nothing is (reference 3.5)."""
    area: i64 = item.area
    if area == RECORD_AREA or area not in AREAS:
        return ""  # a record has a logical id for an address, and of an area nobody knows nobody knows the rules
    if item.db and area not in DB_AREAS:
        return f"DB number {item.db} outside a DB"
    if area in NUMBERED_AREAS:
        own = area in _OWN_SIZE and item.transport_size != area
        return f"transport size {TRANSPORT_SIZES.name(item.transport_size)}" if own else ""
    if item.start_bit >> 19:
        return "bits above the address are set"
    if item.start_bit & 7 and item.transport_size != BIT:
        return f"bit {item.start_bit & 7} in the address of a {TRANSPORT_SIZES.name(item.transport_size)}"
    return ""
