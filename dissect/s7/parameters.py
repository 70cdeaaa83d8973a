"""The parameter block of an S7 PDU: which function, which items, which userdata group.

Polling repeats a few hundred distinct request blocks for hours, so `ParameterCache` parses each distinct block once and every
PDU that carries it refers to the same object.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7.items import Item, parse_items
from dissect.s7.tables import (
    CPU_SERVICES,
    FUNCTIONS,
    MODE_TRANSITION,
    READ_VAR,
    SETUP_COMMUNICATION,
    USERDATA,
    USERDATA_GROUPS,
    USERDATA_SUBFUNCTIONS,
    WRITE_VAR,
)
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16

#: Userdata types (bits 7-6 of the type and group octet).
PUSH: Final = 0
REQUEST: Final = 1
RESPONSE: Final = 2

_SHORT: Final = 8
_EXTENDED: Final = 12
_USEND: Final = 0x13
_GROUP_PBC: Final = 6


class Setup:
    """Setup communication: open jobs allowed each way and the PDU length, asked for or granted (reference 3.4)."""

    __slots__ = ("max_amq_called", "max_amq_calling", "pdu_length")

    def __init__(self, max_amq_calling: int, max_amq_called: int, pdu_length: int) -> None:
        self.max_amq_calling = max_amq_calling
        self.max_amq_called = max_amq_called
        self.pdu_length = pdu_length

    def as_dict(self) -> dict[str, object]:
        """Return the three values, JSON-ready."""
        return {
            "max_amq_calling": self.max_amq_calling,
            "max_amq_called": self.max_amq_called,
            "pdu_length": self.pdu_length,
        }


class UserdataHead:
    """The parameter head of a userdata PDU (reference 4.1). ``extended`` heads carry the last three fields, others 0."""

    __slots__ = ("data_unit_ref", "error_code", "extended", "group", "last_data_unit", "sequence", "subfunction", "type")

    def __init__(self, type_: int, group: int, subfunction: int, sequence: int) -> None:
        self.type = type_
        self.group = group
        self.subfunction = subfunction
        self.sequence = sequence
        self.extended = False
        self.data_unit_ref = 0
        self.last_data_unit = 0
        self.error_code = 0

    @property
    def group_name(self) -> str:
        """Name of the function group, or its number."""
        return USERDATA_GROUPS.name(self.group)

    @property
    def subfunction_name(self) -> str:
        """Name of the subfunction within its group, or its number."""
        table = USERDATA_SUBFUNCTIONS.get(self.group)
        return table.name(self.subfunction) if table is not None else f"0x{self.subfunction:02x}"

    @property
    def name(self) -> str:
        """Group and subfunction for a person, for example ``CPU functions: read SZL``."""
        return f"{self.group_name}: {self.subfunction_name}"


class Parameters:
    """A parsed parameter block. ``function`` is -1 when the block is empty; ``item_count`` -1 when it has none."""

    __slots__ = (
        "answer_size",
        "fragment",
        "function",
        "item_count",
        "items",
        "malformed",
        "octets",
        "rosctr",
        "setup",
        "userdata",
    )

    def __init__(self, octets: bytes, rosctr: i64) -> None:
        self.octets: bytes = octets
        self.rosctr: i64 = rosctr
        self.function: i64 = octets[0] if len(octets) else -1
        self.item_count: i64 = -1
        self.items: list[Item] = []
        self.setup: Setup | None = None
        self.userdata: UserdataHead | None = None
        self.malformed: list[Malformed] = []
        self.answer_size: i64 = -1
        self.fragment: str = ""  # a report's cached text

    @property
    def function_name(self) -> str:
        """Name of the function; for userdata the group and subfunction."""
        if self.userdata is not None:
            return self.userdata.name
        return FUNCTIONS.name(self.function) if self.function >= 0 else "no function"


def parse_parameters(octets: bytes, rosctr: i64) -> Parameters:
    """Read a parameter block of a PDU with this ROSCTR. Never raises; offsets in ``malformed`` are within the block."""
    parameters = Parameters(octets, rosctr)
    size: i64 = len(octets)
    if size == 0:
        return parameters
    function: i64 = parameters.function
    if rosctr == USERDATA:
        _parse_userdata(parameters, octets, size)
    elif function == SETUP_COMMUNICATION:
        if size >= 8:
            parameters.setup = Setup(u16(octets, 2), u16(octets, 4), u16(octets, 6))
        if size != 8:
            _wrong_size(parameters, "setup", 8, size)
    elif function == READ_VAR or function == WRITE_VAR:
        if size < 2:
            _wrong_size(parameters, "item_count", 2, size)
            return parameters
        parameters.item_count = octets[1]
        if rosctr == 1:
            parameters.items = parse_items(octets, 2, size, parameters.item_count, parameters.malformed)
            parameters.answer_size = _answer_size(parameters)
        elif size > 2:
            _wrong_size(parameters, "item_count", 2, size)
    return parameters


def _wrong_size(parameters: Parameters, field: str, needed: i64, available: i64) -> None:
    reason = "too_short" if available < needed else "trailing_octets"
    parameters.malformed.append(Malformed("s7", reason, field, min(needed, available), needed, available, "param"))


def _answer_size(parameters: Parameters) -> i64:
    """Return the octets of the S7 PDU that a wholly good answer to a read has, -1 when an item's size is unknown."""
    if parameters.function != READ_VAR:
        return -1
    size: i64 = 14
    left: i64 = len(parameters.items)
    for item in parameters.items:
        left -= 1
        if item.size < 0:
            return -1
        size += 4 + item.size + (item.size & 1 if left else 0)
    return size


def _parse_userdata(parameters: Parameters, octets: bytes, size: i64) -> None:
    function: i64 = octets[0]
    if function == MODE_TRANSITION and size >= 7:  # a layout of its own (reference 4.9): the mode stands in octet 6
        parameters.userdata = UserdataHead(PUSH, 0, octets[6], 0)
        return
    if size < _SHORT:
        _wrong_size(parameters, "userdata head", _SHORT, size)
        return
    parameters.item_count = octets[1]
    type_and_group: i64 = octets[5]
    head = UserdataHead(type_and_group >> 6, type_and_group & 0x3F, octets[6], octets[7])
    parameters.userdata = head
    rest: i64 = octets[3]
    if size >= _EXTENDED and rest >= 8 and octets[4] != _USEND:
        head.extended = True
        head.data_unit_ref = octets[8]
        head.last_data_unit = octets[9]
        head.error_code = u16(octets, 10)
    if octets[4] == _USEND and head.group == _GROUP_PBC:
        return  # USEND puts its R_ID where others have the head
    if function != CPU_SERVICES or octets[2] != 0x12 or rest + 4 != size or (rest != 4 and rest != 8):
        parameters.malformed.append(Malformed("s7", "bad_value", "userdata head", 3, size - 4, rest, "param"))


class ParameterCache:
    """Distinct parameter blocks, each parsed once. Bounded: when it is full it starts anew."""

    CAPACITY: Final = 4096

    def __init__(self) -> None:
        self._by_octets: list[dict[bytes, Parameters]] = [{}, {}, {}, {}, {}, {}, {}, {}]

    def get(self, octets: bytes, rosctr: i64) -> Parameters:
        """Return the parsed block for ``octets`` of a PDU with ROSCTR 0 to 7."""
        known = self._by_octets[rosctr]
        parameters = known.get(octets)
        if parameters is None:
            if len(known) >= self.CAPACITY:
                known.clear()
            parameters = parse_parameters(octets, rosctr)
            known[octets] = parameters
        return parameters
