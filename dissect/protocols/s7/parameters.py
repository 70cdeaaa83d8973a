"""The parts that are read of every S7 PDU: its header, and its parameter block (function, items, userdata group).

Clients that poll repeat a few hundred distinct request blocks for hours. So `ParameterCache` parses each distinct block once;
all PDUs with the same block share one `Parameters` object.
"""

from __future__ import annotations

import struct
from typing import Final

from librt.strings import read_i64_be
from mypy_extensions import i64

from dissect.protocols.s7.items import (
    DATA_HEAD,
    SPECIFICATION,
    Item,
    answer_layout,
    item_fill,
    parse_items,
    written_area,
    written_areas,
)
from dissect.protocols.s7.plain_items import plain_area, plain_octets, plain_size
from dissect.protocols.s7.tables import (
    ACK,
    ACK_DATA,
    CPU_SERVICES,
    FUNCTIONS,
    GROUP_NC,
    GROUP_PBC,
    JOB,
    MODE_TRANSITION,
    PARAMETER_EXTENDED,
    PARAMETER_SHORT,
    PBC_R_ID,
    READ_VAR,
    SETUP_COMMUNICATION,
    USERDATA,
    USERDATA_GROUPS,
    USERDATA_SUBFUNCTIONS,
    WRITE_VAR,
)
from dissect.wire.build import COMPILED
from dissect.wire.copies import leaves
from dissect.wire.malformed import Malformed
from dissect.wire.octets import same, u16
from dissect.wire.text import printable

PROTOCOL_ID: Final = 0x32
HEADER_SIZE: Final = 10
ACK_HEADER_SIZE: Final = 12

#: Where the data of an answer begin if its parameter block has only function and item count.
_ANSWER_DATA_AT: Final = ACK_HEADER_SIZE + 2

_HEADER: Final = struct.Struct(">BxxHHH")

#: Userdata types (bits 7-6 of the type and group octet).
PUSH: Final = 0
REQUEST: Final = 1
RESPONSE: Final = 2

#: Size of the parameter block of a job with one S7ANY item, which has twelve octets.
_ONE_ITEM: Final = 14
_SHORT: Final = 8
_EXTENDED: Final = 12
#: Positions of type and group in a userdata PDU.
_TYPE_AT: Final = HEADER_SIZE + 5
#: Number of distinct blocks with only function and item count in answers to reads and writes: 2 x 256.
_SHORT_BLOCKS: Final = 512
_USEND_SIZE: Final = 10
#: Groups whose pushes go in either direction: BSEND and USEND (PBC), data record routing, and NC programming.
_EITHER_WAY: Final = frozenset((GROUP_PBC, 0x20, GROUP_NC))


def read_header(octets: bytes, at: i64) -> tuple[i64, i64, i64, i64]:
    """Return (ROSCTR, PDU reference, parameter length, data length) of the header at ``at``; needs ten octets there."""
    if COMPILED:
        rosctr: i64 = octets[at + 1]
        return rosctr, u16(octets, at + 4), u16(octets, at + 6), u16(octets, at + 8)
    return _HEADER.unpack_from(octets, at + 1)


def header_size(rosctr: i64) -> i64:
    """Return the size of the header: 12 octets for Ack and Ack_Data, else 10."""
    return ACK_HEADER_SIZE if rosctr == ACK or rosctr == ACK_DATA else HEADER_SIZE


def is_request(octets: bytes) -> bool:
    """Return whether a PDU is a request, judged by its first octets: a job, or userdata of that type."""
    if len(octets) < 2:
        return False
    rosctr: i64 = octets[1]
    return rosctr == JOB or (rosctr == USERDATA and len(octets) > _TYPE_AT and octets[_TYPE_AT] >> 6 == REQUEST)


class Setup:
    """Setup communication: the open jobs allowed in each direction and the PDU length, requested or granted (reference 3.4)."""

    __slots__ = ("_text", "fragment", "max_amq_called", "max_amq_calling", "pdu_length")

    def __init__(self, max_amq_calling: int, max_amq_called: int, pdu_length: int) -> None:
        self.max_amq_calling = max_amq_calling
        self.max_amq_called = max_amq_called
        self.pdu_length = pdu_length
        self._text: str = ""  # made at the first access, because connections share `Setup` objects
        self.fragment: str = ""  # a report's cached text

    def __repr__(self) -> str:
        return f"Setup({self.max_amq_calling}, {self.max_amq_called}, {self.pdu_length})"

    def __str__(self) -> str:
        """Return the text for reports: ``PDU 480, AmQ 1/1``, first the jobs of the calling side."""
        if not self._text:
            self._text = f"PDU {self.pdu_length}, AmQ {self.max_amq_calling}/{self.max_amq_called}"
        return self._text

    def as_dict(self) -> dict[str, object]:
        """Return the three values, JSON-ready."""
        return {
            "max_amq_calling": self.max_amq_calling,
            "max_amq_called": self.max_amq_called,
            "pdu_length": self.pdu_length,
        }


class UserdataHead:
    """The parameter head of a userdata PDU (reference 4.1). If it is not ``extended``, its last three fields are 0."""

    __slots__ = (
        "data_unit_ref",
        "error_code",
        "extended",
        "group",
        "last_data_unit",
        "sequence",
        "subfunction",
        "type",
        "usend",
    )

    def __init__(self, type_: int, group: int, subfunction: int, sequence: int) -> None:
        self.type = type_
        self.group = group
        self.subfunction = subfunction
        self.sequence = sequence
        self.extended = False
        self.data_unit_ref = 0
        self.last_data_unit = 0
        self.error_code = 0
        self.usend = False  # a USEND has no subfunction

    def __repr__(self) -> str:
        return f"UserdataHead({self.name})"

    @property
    def more(self) -> bool:
        """True if the answer continues in another PDU (reference 4.3)."""
        return self.data_unit_ref != 0 and self.last_data_unit != 0

    @property
    def continues(self) -> bool:
        """True for the last part of an answer in several parts: its payload continues the parts before (reference 4.3)."""
        return self.data_unit_ref != 0 and self.last_data_unit == 0

    @property
    def group_name(self) -> str:
        """Name of the function group, or its number."""
        return USERDATA_GROUPS.name(self.group)

    @property
    def subfunction_name(self) -> str:
        """Name of the subfunction within its group, or its number."""
        if self.usend:
            return "USEND"
        table = USERDATA_SUBFUNCTIONS.get(self.group)
        return table.name(self.subfunction) if table is not None else f"0x{self.subfunction:02x}"

    @property
    def name(self) -> str:
        """Group and subfunction for a person, for example ``CPU functions: read SZL``."""
        return f"{self.group_name}: {self.subfunction_name}"


#: Used by most blocks, which have no items and no faults. All share these lists, which must not be changed.
_NO_ITEMS: Final[list[Item]] = []
_NOTHING_WRONG: Final[list[Malformed]] = []


class Parameters:
    """A parsed parameter block. ``function`` is -1 if the block is empty, ``item_count`` is -1 if the block has none.

    If it is ``plain`` (`dissect.protocols.s7.plain_items`), its `items` are made at the first access, because most runs need
    none.
    """

    __slots__ = (
        "_items",
        "answer_size",
        "answer_unjudged",
        "fragment",
        "function",
        "good_answer",
        "good_heads",
        "good_layout",
        "item_count",
        "malformed",
        "octets",
        "plain",
        "rosctr",
        "setup",
        "unjudged",
        "userdata",
        "written",
    )

    def __init__(self, octets: bytes, rosctr: i64) -> None:
        self.octets: bytes = octets
        self.rosctr: i64 = rosctr
        self.function: i64 = octets[0] if len(octets) else -1
        self.item_count: i64 = -1
        self.plain: bool = False
        self._items: list[Item] | None = _NO_ITEMS
        self.setup: Setup | None = None
        self.userdata: UserdataHead | None = None
        self.malformed: list[Malformed] = _NOTHING_WRONG
        self.written: i64 = (
            0  # of a write: the kinds of areas that it writes to (`dissect.protocols.s7.items.written_areas`)
        )
        self.fragment: str = ""  # a report's cached text
        self.answer_size: i64 = 0  # of a read: size of the smallest PDU that answers all items, as far as known
        # Of a read: `item_heads` of a good answer, for comparison with the next answers
        # (`dissect.engine.transactions.transaction`). It is one bytes object, because separate items are spread over the
        # memory.
        self.good_answer: bytes = b""
        # The same for interpreted code, in which calls are slow: a struct that reads a whole answer, and the values of the good
        # one.
        self.good_layout: struct.Struct | None = None
        self.good_heads: tuple[int, ...] = ()
        self.unjudged: bool = True  # codes and addresses are not judged yet
        self.answer_unjudged: bool = False  # of a read: the transport sizes of a good answer are not judged yet

    def __repr__(self) -> str:
        return f"{type(self).__name__}({printable(self.function_name)})"

    @property
    def items(self) -> list[Item]:
        """The items of a Read Var or Write Var request; always the same list, which must not be changed."""
        items = self._items
        if items is None:
            items = self._items = parse_items(self.octets, 2, len(self.octets), self.item_count, [])
        return items

    @property
    def known_items(self) -> i64:
        """Number of `items`: ``item_count``, unless the block is malformed."""
        if self.plain:
            return self.item_count
        return len(self.items)

    def size_of(self, index: i64) -> i64:
        """Return the `Item.size` of the item ``index``, from 0."""
        if self.plain:
            return plain_size(self.octets, index)
        return self.items[index].size

    def take_items(self) -> None:
        """Read the items of a job; for a plain block the `Item` objects are made later, and there is nothing to judge."""
        octets = self.octets
        count: i64 = self.item_count
        answered: i64 = plain_octets(octets, count)
        if answered >= 0:
            self.plain = True
            self._items = None
            self.unjudged = False
        else:
            wrong: list[Malformed] = []
            self._items = parse_items(octets, 2, len(octets), count, wrong)
            if wrong:
                self.malformed = wrong
        if self.function == READ_VAR:
            self.answer_unjudged = True
            if answered < 0:
                answered = self._answered_octets()
            self.answer_size = _ANSWER_DATA_AT + answered
        elif self.plain:
            index: i64 = 0
            while index < count:
                self.written |= written_area(plain_area(octets, index))
                index += 1
        else:
            self.written = written_areas(self.items)

    def _answered_octets(self) -> i64:
        """Return the size of the data items that answer a read, as far as known (reference 3.5)."""
        total: i64 = 0
        left: i64 = len(self.items)
        for item in self.items:
            left -= 1
            size: i64 = max(item.size, 0)
            total += DATA_HEAD + size + item_fill(size, left == 0)
        return total

    def note(self, wrong: Malformed) -> None:
        """Add a fault to ``malformed``."""
        if not self.malformed:
            self.malformed = []
        self.malformed.append(wrong)

    def keep_layout(self, buf: bytes, at: i64, data_at: i64) -> None:
        """Prepare `like_good` from the good answer at ``at`` of ``buf``; ``good_answer`` is set already.

        This is done only for answers whose parameter block has just function and item count, and whose header has no error.
        """
        if data_at == at + _ANSWER_DATA_AT and buf[at + HEADER_SIZE] == 0 and buf[at + HEADER_SIZE + 1] == 0:
            self.good_layout = answer_layout(self.good_answer)
            self.good_heads = self.good_layout.unpack_from(buf, at + HEADER_SIZE)

    def like_good(self, buf: bytes, at: i64, size: i64, data_at: i64) -> bool:
        """Return whether an Ack_Data that answers a read is good, because its fixed octets equal those of the last good answer.

        The interpreted code uses this, as calls are slow there, in place of `dissect.engine.transactions.checks.check_answer`.
        """
        layout = self.good_layout
        return (
            layout is not None
            and layout.size == size - HEADER_SIZE
            and data_at - at == _ANSWER_DATA_AT
            and layout.unpack_from(buf, at + HEADER_SIZE) == self.good_heads
        )

    @property
    def function_name(self) -> str:
        """Name of the function; for userdata the group and subfunction."""
        if self.userdata is not None:
            return self.userdata.name
        return FUNCTIONS.name(self.function) if self.function >= 0 else "no function"

    @property
    def subject(self) -> str:
        """The function and the first three items, each with address and length, for a person."""
        items = self.items
        if not items:
            return self.function_name
        shown = ", ".join([item.label for item in items[:3]])
        more = f" and {len(items) - 3} more" if len(items) > 3 else ""
        return f"{self.function_name} {shown}{more}"


def is_plc_push(parameters: Parameters) -> bool:
    """Return whether this is a userdata push that only PLCs send; pushes of `_EITHER_WAY` also come from clients."""
    head = parameters.userdata
    if head is None or parameters.function != CPU_SERVICES:
        return False
    return head.type == PUSH and head.group not in _EITHER_WAY and not head.usend


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
            if rosctr == ACK:
                return parameters  # normally an Ack has no parameters; a function alone contradicts nothing
            _wrong_size(parameters, "item_count", 2, size)
            return parameters
        parameters.item_count = octets[1]
        if rosctr == JOB:
            parameters.take_items()
        elif size > 2:
            _wrong_size(parameters, "item_count", 2, size)
    return parameters


def _wrong_size(parameters: Parameters, field: str, needed: i64, available: i64) -> None:
    reason = "too_short" if available < needed else "trailing_octets"
    parameters.note(Malformed("s7", reason, field, min(needed, available), needed, available, "param"))


def _parse_userdata(parameters: Parameters, octets: bytes, size: i64) -> None:
    function: i64 = octets[0]
    if function == MODE_TRANSITION and size >= _SHORT:
        # A special layout (reference 4.9): the mode is in octet 6.
        parameters.userdata = UserdataHead(PUSH, 0, octets[6], 0)
        if size != _SHORT:
            _wrong_size(parameters, "mode transition", _SHORT, size)
        return
    if size < _SHORT:
        _wrong_size(parameters, "userdata head", _SHORT, size)
        return
    parameters.item_count = octets[1]
    if octets[4] == PBC_R_ID and octets[3] == _USEND_SIZE - 4:
        # Another special layout (reference 4.10): the R_ID is where other PDUs have type, group and subfunction.
        parameters.userdata = UserdataHead(PUSH, GROUP_PBC, 0, 0)
        parameters.userdata.usend = True
        if size != _USEND_SIZE:
            _wrong_size(parameters, "USEND", _USEND_SIZE, size)
        return
    type_and_group: i64 = octets[5]
    head = UserdataHead(type_and_group >> 6, type_and_group & 0x3F, octets[6], octets[7])
    parameters.userdata = head
    rest: i64 = octets[3]
    # A damaged USEND has its R_ID in the place of an error code.
    if size >= _EXTENDED and rest >= 8 and octets[4] != PBC_R_ID:
        head.extended = True
        head.data_unit_ref = octets[8]
        head.last_data_unit = octets[9]
        head.error_code = u16(octets, 10)
    _check_head(parameters, octets, size)


def _check_head(parameters: Parameters, octets: bytes, size: i64) -> None:
    """Check that a userdata head has one of the two forms of reference 4.1; note only the first fault."""
    rest: i64 = octets[3]
    if octets[0] != CPU_SERVICES:
        _bad_head(parameters, "bad_value", "function", 0, CPU_SERVICES, octets[0])
    elif octets[1] != 1:
        _bad_head(parameters, "bad_value", "item_count", 1, 1, octets[1])
    elif octets[2] != SPECIFICATION:
        _bad_head(parameters, "bad_value", "specification", 2, SPECIFICATION, octets[2])
    elif rest + 4 > size:
        _bad_head(parameters, "length_beyond", "length", 3, rest, size - 4)
    elif rest + 4 < size:
        _bad_head(parameters, "trailing_octets", "length", 3, rest, size - 4)
    elif rest != 4 and rest != 8:
        _bad_head(parameters, "bad_value", "length", 3, 4 if rest < 8 else 8, rest)
    elif octets[4] != (PARAMETER_SHORT if rest == 4 else PARAMETER_EXTENDED):
        _bad_head(
            parameters, "bad_value", "syntax_id", 4, PARAMETER_SHORT if rest == 4 else PARAMETER_EXTENDED, octets[4]
        )


def _bad_head(parameters: Parameters, reason: str, field: str, offset: i64, needed: i64, available: i64) -> None:
    parameters.note(Malformed("s7", reason, f"userdata head.{field}", offset, needed, available, "param"))


class ParameterCache:
    """Parses each distinct parameter block once, and remembers it while it keeps coming.

    There are two generations, each bounded in blocks and octets. When the younger one is full, it becomes the older one, and
    the former older one is forgotten. A block that is found in the older generation moves to the younger one. So blocks that
    come only once (userdata requests have increasing numbers) do not displace blocks that are polled.
    """

    #: Limits of one generation: number of blocks, and their size in octets. A parsed item takes some thirty times its octets in
    #: memory.
    CAPACITY: Final = 8192
    OCTETS: Final = 512 * 1024
    #: Places for blocks of jobs that are found without a dictionary; a power of two.
    PLACES: Final = 8192

    def __init__(self) -> None:
        self._young: list[dict[bytes, Parameters]] = [{} for _ in range(8)]
        self._old: list[dict[bytes, Parameters]] = [{} for _ in range(8)]
        self._blocks: i64 = 0
        self._octets: i64 = 0
        #: Half of all PDUs have a block with only function and item count: these blocks, by function and count.
        self._short: list[Parameters | None] = [None] * _SHORT_BLOCKS
        #: For each place, the latest block of a job that belongs there (`_asked`); only blocks of the younger generation.
        self._latest: list[Parameters | None] = [None] * self.PLACES

    def clear(self) -> None:
        """Forget every block."""
        self._young = [{} for _ in range(8)]
        self._old = [{} for _ in range(8)]
        self._blocks = 0
        self._octets = 0
        self._short = [None] * _SHORT_BLOCKS
        self._latest = [None] * self.PLACES

    def get(self, buf: bytes, at: i64, end: i64, rosctr: i64) -> Parameters:
        """Return the parsed block ``buf[at:end]`` of a PDU with ROSCTR 0 to 7."""
        if rosctr == ACK_DATA and end - at == 2:
            function: i64 = buf[at]
            place: i64 = (function - READ_VAR) * 256 + buf[at + 1]
            if 0 <= place < _SHORT_BLOCKS:
                short = self._short[place]
                if short is None:
                    short = parse_parameters(buf[at:end], rosctr)
                    self._short[place] = short
                return short
        if COMPILED and rosctr == JOB and end - at >= _ONE_ITEM:  # the interpreted code is faster with the dictionary
            return self._asked(buf, at, end)
        octets = buf[at:end]
        parameters = self._young[rosctr].get(octets)
        return self._distinct(octets, rosctr) if parameters is None else parameters

    def _asked(self, buf: bytes, at: i64, end: i64) -> Parameters:
        """Return the parsed block of a job with items; DB and address of its last item usually distinguish the blocks."""
        last: i64 = read_i64_be(buf, end - 8)  # six of these octets are DB, area and address of an S7ANY item
        place: i64 = ((last & 0xFFFFFFFF) + (last >> 28 & 0xFFFF0) + (end - at << 1)) & (self.PLACES - 1)
        latest = self._latest[place]
        if latest is not None and same(latest.octets, buf, at, end):
            return latest
        parameters = self._distinct(buf[at:end], JOB)
        self._latest[place] = parameters
        return parameters

    def _distinct(self, octets: bytes, rosctr: i64) -> Parameters:
        parameters = self._young[rosctr].get(octets)
        if parameters is None:
            parameters = self._old[rosctr].pop(octets, None)
            if parameters is None:
                parameters = parse_parameters(octets, rosctr)
            self._keep(parameters, rosctr)
        return parameters

    def _keep(self, parameters: Parameters, rosctr: i64) -> None:
        size: i64 = len(parameters.octets)
        if self._blocks >= self.CAPACITY or self._octets + size > self.OCTETS:
            self._old = self._young
            self._young = [{} for _ in range(8)]
            self._latest = [None] * self.PLACES
            self._blocks = 0
            self._octets = 0
        self._young[rosctr][parameters.octets] = parameters
        self._blocks += 1
        self._octets += size


def _taken(head: UserdataHead) -> tuple[int, int, int, int]:
    return head.type, head.group, head.subfunction, head.sequence


leaves(Parameters, without=("good_answer", "good_heads", "good_layout"))
leaves(Setup)
leaves(UserdataHead, taken=_taken)
