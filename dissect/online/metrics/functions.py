"""`Functions`: counts transactions by function, for functions that have a name.

Each value of a label makes a series that has to be stored, so unknown functions are counted together as ``other``.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.payloads import SCD, ScdParameters
from dissect.engine.transactions.transaction import OUTCOMES
from dissect.protocols.s7.parameters import Parameters, UserdataHead
from dissect.protocols.s7.tables import FUNCTIONS, USERDATA_GROUPS, USERDATA_SUBFUNCTIONS
from dissect.protocols.s7plus.parameters import PLUS, PlusParameters
from dissect.protocols.s7plus.tables import FUNCTIONS as PLUS_FUNCTIONS
from dissect.protocols.s7plus.tables import NOTIFICATION, OPCODES
from dissect.wire.text import encodable

#: Upper bounds of the buckets of answer times, in nanoseconds; a last bucket has no bound.
BOUNDS_NS: Final[list[int]] = [
    1_000_000,
    2_500_000,
    5_000_000,
    10_000_000,
    25_000_000,
    50_000_000,
    100_000_000,
    250_000_000,
    500_000_000,
    1_000_000_000,
    2_500_000_000,
    5_000_000_000,
    10_000_000_000,
]

S7COMM: Final = "s7comm"
S7COMM_PLUS: Final = "s7comm_plus"
SCD_PROTOCOL: Final = "scd"
OTHER: Final = "other"

#: At most this many SCD functions are counted separately: the user's dictionary may have any number of names.
MAX_SCD: Final = 64

#: Key of a USEND, which has no subfunction; the only negative function code is -1.
_USEND_KEY: Final = -2


class FunctionCounts:
    """The transactions of one function: by outcome (`OUTCOMES`), with errors, and answer times by bucket."""

    __slots__ = ("buckets", "errors", "name", "outcomes", "protocol", "sum_ns")

    def __init__(self, protocol: str, name: str) -> None:
        self.protocol: str = protocol
        self.name: str = name
        self.outcomes: list[int] = [0] * len(OUTCOMES)
        self.errors: i64 = 0
        self.buckets: list[int] = [0] * (len(BOUNDS_NS) + 1)
        self.sum_ns: i64 = 0

    def add_latency(self, latency_ns: i64) -> None:
        """Count an answer time; a negative one (packets captured out of order) counts as 0."""
        latency: int = max(0, latency_ns)
        bucket = bisect_left(BOUNDS_NS, latency)
        self.buckets[bucket] = self.buckets[bucket] + 1
        self.sum_ns += latency


class Functions:
    """The counts of all functions, found by parameter block; the tables of names bound how many there are."""

    def __init__(self) -> None:
        self.rows: dict[str, FunctionCounts] = {}  # by protocol and name
        self._by_key: dict[int, FunctionCounts] = {}

    def of(self, parameters: Parameters) -> FunctionCounts:
        """Return the counts of the function in ``parameters``."""
        userdata = parameters.userdata
        key: i64 = parameters.function
        if userdata is not None:
            key = _USEND_KEY if userdata.usend else 0x10000 | (userdata.group << 8) | userdata.subfunction
        found = self._by_key.get(key)
        return found if found is not None else self._find(parameters, userdata, key)

    def _find(self, parameters: Parameters, userdata: UserdataHead | None, key: i64) -> FunctionCounts:
        protocol = S7COMM
        if parameters.rosctr == PLUS:
            protocol = S7COMM_PLUS
        elif parameters.rosctr == SCD:
            protocol = SCD_PROTOCOL
        name, known = _name(parameters, userdata)
        if protocol == SCD_PROTOCOL and known:
            known = sum([row.protocol == protocol for row in self.rows.values()]) < MAX_SCD
            name = name if known else OTHER
        label = f"{protocol} {name}"
        row = self.rows.get(label)
        if row is None:
            row = FunctionCounts(protocol, name)
            self.rows[label] = row
        if known:
            self._by_key[key] = row
        return row


def _name(parameters: Parameters, userdata: UserdataHead | None) -> tuple[str, bool]:
    """Return the label of a function, and whether its code has a name of its own."""
    if isinstance(parameters, PlusParameters):
        if parameters.code < 0:
            return OPCODES.name(NOTIFICATION).lower(), True
        known: bool = parameters.code in PLUS_FUNCTIONS
        return parameters.code_name if known else OTHER, known
    if isinstance(parameters, ScdParameters):
        return encodable(parameters.name), True
    if userdata is not None:
        return _userdata_name(userdata)
    if parameters.function < 0:
        return parameters.function_name, True
    known = parameters.function in FUNCTIONS
    return parameters.function_name if known else OTHER, known


def _userdata_name(head: UserdataHead) -> tuple[str, bool]:
    table = USERDATA_SUBFUNCTIONS.get(head.group)
    if head.usend or (table is not None and head.subfunction in table):
        return head.name, True
    group = head.group_name if head.group in USERDATA_GROUPS else "userdata"
    return f"{group}: {OTHER}", False
