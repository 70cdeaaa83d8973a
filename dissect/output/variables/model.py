"""`Variable`, and `ValueRow`: one value of a variable in the traffic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import LIKELY, SURE
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7.values import decode_value
from dissect.wire.copies import leaves

if TYPE_CHECKING:
    from dissect.output.variables.statistics import Statistics

# The ways in which a value is transferred.
READ: Final = "read"
WRITE: Final = "write"
PUSH: Final = "push"  # of a cyclic or change-driven service, or of a variable table
MODIFY: Final = "modify"
FORCE: Final = "force"
NOTIFICATION: Final = "notification"  # of S7comm-plus
PDO: Final = "pdo"  # of SCD
HOWS: Final = (READ, WRITE, PUSH, MODIFY, FORCE, NOTIFICATION, PDO)


class SharedValue:
    """A transferred value, shared by all rows until it changes: its octets ``data`` (None for none) and its name ``text``.

    ``coded`` is the transport size of octets that are not decoded yet, -1 if they are decoded or need no decoding: most outputs
    write values from their octets.
    """

    __slots__ = ("_value", "coded", "data", "text")

    def __init__(self, data: bytes | None, coded: i64 = -1, value: object = None, text: str = "") -> None:
        self.data: bytes | None = data
        self.coded: i64 = coded
        self._value: object = value
        self.text: str = text

    @property
    def value(self) -> object:
        """The value, decoded the first time; None if the octets have none."""
        if self.coded >= 0:
            data = self.data
            if data is not None:
                self._value = decode_value(self.coded, data)
            self.coded = -1
        return self._value


#: In place of an unknown value.
UNTOLD: Final = SharedValue(None)


class Variable:
    """A place in a CPU that was read or written; its rows of values refer to it.

    ``plc`` is the end of the connection that has the variable, in VLAN ``vlan`` (`vlan_ids`). ``address`` is its first address
    ("DB10.DBD4", "0x6041:0"), ``type`` its type ("REAL", "10 x BYTE"), ``tag`` its name, empty if none is known. ``data``,
    ``value`` and ``text`` are the latest ones, once a value was ``seen``. ``refused_reads`` and ``refused_writes`` count
    refusals of the PLC, ``unconfirmed`` writes whose result was not captured. ``likely`` counts values and refusals of
    transactions that are only likely (`Transaction.doubt`), which count for nothing else. Texts are not escaped.
    """

    __slots__ = (
        "_told",
        "address",
        "bytes_only",
        "comment",
        "likely",
        "next_ns",
        "plc",
        "refused_reads",
        "refused_writes",
        "seen",
        "statistics",
        "tag",
        "type",
        "unconfirmed",
        "unit",
        "vlan",
    )

    def __init__(self, plc: Endpoint, vlan: i64, address: str, type_: str, tag: str, unit: str) -> None:
        self.plc: Endpoint = plc
        self.vlan: i64 = vlan
        self.address: str = address
        self.type: str = type_
        self.tag: str = tag
        self.unit: str = unit
        self.comment: str = ""
        self.bytes_only: bool = False  # octets of unknown meaning, shown in hexadecimal
        self._told: SharedValue = UNTOLD
        self.seen: bool = False
        self.refused_reads: i64 = 0
        self.refused_writes: i64 = 0
        self.unconfirmed: i64 = 0
        self.likely: i64 = 0
        self.next_ns: i64 = 0  # with ``--every``: there is no further row before this time
        self.statistics: Statistics | None = None

    @property
    def data(self) -> bytes | None:
        """The octets of the latest value."""
        return self._told.data

    @property
    def value(self) -> object:
        """The latest value."""
        return self._told.value

    @property
    def text(self) -> str:
        """The name of the latest value."""
        return self._told.text

    @property
    def name(self) -> str:
        """The tag, or else the address."""
        return self.tag or self.address

    def __repr__(self) -> str:
        return f"Variable({self.name!r}, {self.type!r})"


class ValueRow:
    """One value of a variable.

    ``time_ns`` (nanoseconds since 1970) and ``frame`` are those of the packet with the value: of a read the response, of a
    write the request. ``side`` of ``link`` is the client, which read, wrote or subscribed. ``how`` is one of `HOWS`, ``writes``
    says whether the client gave the value. ``value`` is as `dissect.protocols.s7.values.Value`, for S7comm-plus any JSON value,
    in the unit of the tag; None if the octets have no value: then ``data`` has them (None for values without octets of their
    own). ``previous`` is the value before it, from any client, ``before`` its octets, ``previous_text`` its name. ``first``:
    there was none. ``changed``: it was different (True for the first). ``pieced``: only a part of the octets was transferred,
    the others are those seen before. ``text`` is the name of the value in an SCD dictionary or in S7comm-plus, ``remark`` says
    what is odd about it. ``doubt`` says why the transaction of the value is only likely (`Transaction.doubt`); it is empty for
    all others.
    """

    __slots__ = (
        "_told",
        "_was",
        "changed",
        "doubt",
        "first",
        "frame",
        "how",
        "link",
        "pieced",
        "remark",
        "side",
        "time_ns",
        "variable",
        "writes",
    )

    def __init__(self, variable: Variable, link: Connection, side: i64, how: str, time_ns: i64, frame: i64) -> None:
        self.variable: Variable = variable
        self.link: Connection = link
        self.side: i64 = side
        self.how: str = how
        self.time_ns: i64 = time_ns
        self.frame: i64 = frame
        self.writes: bool = False
        self._told: SharedValue = UNTOLD
        self._was: SharedValue = UNTOLD
        self.first: bool = False
        self.changed: bool = True
        self.pieced: bool = False
        self.remark: str = ""
        self.doubt: str = ""

    @property
    def value(self) -> object:
        """The value in the unit of the tag; None if the bytes have no value."""
        return self._told.value

    @property
    def data(self) -> bytes | None:
        """The bytes; None for values without bytes of their own."""
        return self._told.data

    @property
    def text(self) -> str:
        """The name of the value in an SCD dictionary or in S7comm-plus."""
        return self._told.text

    @property
    def previous(self) -> object:
        """The value before, whoever read or wrote it."""
        return self._was.value

    @property
    def before(self) -> bytes | None:
        """The bytes before."""
        return self._was.data

    @property
    def previous_text(self) -> str:
        """Name of the value before."""
        return self._was.text

    @property
    def certainty(self) -> str:
        """``likely`` for the value of a transaction that is only likely, ``sure`` for all others."""
        return LIKELY if self.doubt else SURE

    @property
    def connection(self) -> int:
        """The number of the connection."""
        return self.link.number

    @property
    def client(self) -> Endpoint:
        """The end that read, wrote or subscribed."""
        return self.link.tcp.ends[self.side]

    @property
    def host(self) -> str:
        """The address of the client."""
        return self.client.host

    @property
    def plc(self) -> Endpoint:
        """The end that has the variable."""
        return self.variable.plc

    @property
    def address(self) -> str:
        """The address of the variable."""
        return self.variable.address

    @property
    def tag(self) -> str:
        """The name of the variable, empty if none is known."""
        return self.variable.tag

    @property
    def name(self) -> str:
        """The tag, or else the address."""
        return self.variable.name

    @property
    def type(self) -> str:
        """The type of the value."""
        return self.variable.type

    @property
    def unit(self) -> str:
        """The unit of the value, empty for none."""
        return self.variable.unit

    @property
    def refused(self) -> str:
        """Why the PLC refused the item, in a few words; empty for a value. Only rows of refusals have it (`RefusedRow`)."""
        return ""

    def __repr__(self) -> str:
        return f"ValueRow({self.how} {self.name!r} = {self.value!r})"


class RefusedRow(ValueRow):
    """An item that the PLC refused to read or write (``values(…, refusals=True)``): it has no value.

    ``return_code`` is the number of the refusal, ``reason`` its name; time and packet are those of the answer.
    """

    __slots__ = ("reason", "return_code")

    def __init__(self, variable: Variable, link: Connection, side: i64, how: str, time_ns: i64, frame: i64) -> None:
        super().__init__(variable, link, side, how, time_ns, frame)
        self.return_code: i64 = 0
        self.reason: str = ""

    @property
    def refused(self) -> str:
        """Why the PLC refused the item."""
        return self.reason

    def __repr__(self) -> str:
        return f"RefusedRow({self.how} {self.name!r}: {self.reason})"


def _taken(variable: Variable) -> tuple[Endpoint, int, str, str, str, str]:
    return variable.plc, 0, variable.address, variable.type, variable.tag, variable.unit


leaves(Variable, taken=_taken)
leaves(SharedValue, ValueRow, RefusedRow)
