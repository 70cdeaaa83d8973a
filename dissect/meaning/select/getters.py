"""The getters of fields: functions of a thing and the `Context` that return the value of a field.

They return one value, or a list of several. None and an empty list both mean that the thing does not have the field.
"""

from __future__ import annotations

import functools
import ipaddress
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage, ScdParameters
from dissect.engine.transactions.results import known_code
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.facts.fact import CODE, FRAME, TEXT, TSAP, WORD, Fact
from dissect.meaning.report import facets
from dissect.meaning.select.items import ItemFacts
from dissect.meaning.select.literals import CodeValue
from dissect.meaning.select.things import Context, Found, Message, Packet
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.message import NOT_REFUSED
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import (
    FUNCTIONS,
    READ_VAR,
    RETURN_CODES,
    ROSCTR,
    USERDATA_GROUPS,
    USERDATA_SUBFUNCTIONS,
    USERDATA_TYPES,
    WRITE_VAR,
)
from dissect.protocols.s7plus.items import READS, WRITES
from dissect.protocols.s7plus.parameters import PlusParameters
from dissect.protocols.s7plus.tables import FUNCTIONS as PLUS_FUNCTIONS
from dissect.protocols.s7plus.tables import NOTIFICATION

Getter = Callable[[Any, Context], Any]
OfItem = Callable[[ItemFacts, Context], Any]

#: Short names of reads and writes, the same for all protocols.
READ: Final = "read"
WRITE: Final = "write"
_MAX_KNOWN: Final = 4096


@functools.cache
def name_code(name: str) -> CodeValue:
    """Return a value that has one name and no number; cached, so only for a small set of names."""
    return CodeValue(None, (name,))


def _some(text: str) -> str | None:
    return text or None


#: By kind of fact: the type in which it is compared, if that differs from the type of its value.
_TOLD: Final[Mapping[str, Callable[[Any], Any]]] = {CODE: name_code, TEXT: _some, TSAP: str, WORD: name_code}

# ---- connections ----------------------------------------------------------------------------------------------------


def connection_of(thing: Any) -> Connection | None:
    """Return the connection of a thing, None if it has none."""
    found: Connection | None = thing if isinstance(thing, Connection) else thing.connection
    return found


def of_fact(fact: Fact[Any], record_of: Callable[[Any], Any]) -> Getter:
    """Return a getter for a fact; ``record_of`` returns the record of a thing that has it, None if there is none."""
    get = fact.get
    told = _TOLD.get(fact.kind)
    framed = fact.kind == FRAME

    def got(thing: Any, context: Context) -> Any:
        record = record_of(thing)
        value = get(record) if record is not None and get is not None else None
        if framed:
            return context.number(value) if value else None
        return told(value) if told is not None and value is not None else value

    return got


def finding_of(found: Found) -> Finding:
    """Return the finding itself."""
    return found.finding


def itself(thing: Any) -> Any:
    """Return the thing."""
    return thing


def ends(thing: Any, _context: Context) -> Iterable[Endpoint] | None:
    """Return both ends of a packet, or of a thing's connection; the hosts of a finding that concerns no connection."""
    if isinstance(thing, Packet):
        return thing.ends
    connection = connection_of(thing)
    if connection is not None:
        return connection.tcp.ends
    hosts = (client(thing, _context), server(thing, _context))
    return [host for host in hosts if host is not None] or None


def client(thing: Any, _context: Context) -> Endpoint | None:
    """Return the client of a thing's connection, or of a finding about two hosts."""
    connection = connection_of(thing)
    if connection is not None:
        return connection.client
    return _host(thing.finding.client) if isinstance(thing, Found) else None


def server(thing: Any, _context: Context) -> Endpoint | None:
    """Return the server, in the same way."""
    connection = connection_of(thing)
    if connection is not None:
        return connection.server
    return _host(thing.finding.server) if isinstance(thing, Found) else None


def _host(said: str) -> Endpoint | None:
    """Return an end without a port from a finding's name of a host: its address, and its VLAN if it has one."""
    return Endpoint(ipaddress.ip_address(said.partition(" ")[0]).packed, -1) if said else None


def ports(thing: Any, context: Context) -> list[int] | None:
    """Return both ports."""
    found = ends(thing, context)
    return [end.port for end in found if end.port >= 0] if found is not None else None


def protocol(thing: Transaction | Message | Connection, _context: Context) -> CodeValue | None:
    """Return the protocol of a message, a transaction or a connection; None while that of a connection is unknown."""
    if isinstance(thing, Message):
        return name_code(thing.protocol)
    if isinstance(thing, Transaction):
        return name_code(UPPER_NAMES[S7COMM_PLUS if thing.is_plus else SCD if thing.is_scd else S7COMM])
    return name_code(thing.protocol) if thing.protocol else None


# ---- packets and times ----------------------------------------------------------------------------------------------


def frames(thing: Any, context: Context) -> list[int]:
    """Return the packets of a thing: those of request and answer, its first and last, or those of a finding."""
    if isinstance(thing, Transaction):
        found = [thing.request_frame, thing.response_frame]
    elif isinstance(thing, Operation):
        found = [thing.first_frame, thing.last_frame]
    elif isinstance(thing, Found):
        found = thing.finding.frames
    elif isinstance(thing, Connection):
        found = [thing.tcp.first_frame, thing.last_frame]
    else:
        found = [thing.frame]
    return [context.number(int(frame)) for frame in found if frame]


def time(thing: Any, _context: Context) -> int | None:
    """Return the time of a thing's first packet; for a transaction that of its request or, without one, of its answer."""
    if isinstance(thing, Transaction):
        return int(thing.request_ns if thing.request_frame else thing.response_ns)
    if isinstance(thing, Operation):
        return thing.begin_ns
    if isinstance(thing, Found):
        return int(thing.finding.time_ns) if thing.finding.frames else None
    if isinstance(thing, Connection):
        return int(thing.tcp.first_ns)
    return int(thing.time_ns)


def duration(thing: Operation | Connection, _context: Context) -> int:
    """Return the duration of an operation or a connection, in nanoseconds."""
    if isinstance(thing, Connection):
        return int(thing.last_ns - thing.tcp.first_ns)
    return thing.duration_ns


# ---- transactions and messages --------------------------------------------------------------------------------------


class _Functions:
    """The functions of parameter blocks, which polling shares."""

    def __init__(self) -> None:
        self._known: dict[Parameters, CodeValue] = {}

    def __call__(self, parameters: Parameters) -> CodeValue | None:
        found = self._known.get(parameters)
        if found is None:
            if len(self._known) >= _MAX_KNOWN:
                self._known.clear()
            found = self._known[parameters] = _function(parameters)
        return found if found.names or found.number is not None else None


_functions: Final = _Functions()


def _function(parameters: Parameters) -> CodeValue:
    if isinstance(parameters, ScdParameters):
        return CodeValue(None, (parameters.function_name, parameters.name))
    if isinstance(parameters, PlusParameters):
        code = int(parameters.code)
        names = [parameters.function_name.removeprefix("S7comm-plus "), parameters.function_name]
        if code in READS | WRITES:
            names.append(READ if code in READS else WRITE)
        return CodeValue(code if code >= 0 else None, tuple(names))
    head = parameters.userdata
    if head is not None:
        return CodeValue(0, (head.name, head.subfunction_name))
    function = int(parameters.function)
    if function < 0:
        return CodeValue(None, ())
    short = {READ_VAR: (READ,), WRITE_VAR: (WRITE,)}.get(function, ())
    return CodeValue(function, (FUNCTIONS.name(function), *short))


def function(thing: Transaction | Message, _context: Context) -> CodeValue | None:
    """Return the function of a transaction or a PDU."""
    if isinstance(thing, Transaction):
        return _functions(thing.parameters)
    if thing.pdu is not None:
        return _functions(thing.pdu.parameters)
    plus = thing.plus
    if plus is not None and plus.function >= 0:
        return _function(PlusParameters(plus.function))
    if thing.scd is not None and thing.scd.message.service:
        return CodeValue(None, (f"SCD {thing.scd.message.service}", thing.scd.message.service))
    return None


def function_names() -> Iterable[str]:
    """Return the names of all functions."""
    yield from FUNCTIONS.names().values()
    yield from (READ, WRITE, "notification", "S7comm-plus notification", "pdo")
    for group, table in USERDATA_SUBFUNCTIONS.items():
        yield USERDATA_GROUPS.name(group)
        for name in table.names().values():
            yield name
            yield f"{USERDATA_GROUPS.name(group)}: {name}"
    for name in PLUS_FUNCTIONS.names().values():
        yield name
        yield f"S7comm-plus {name}"


def _head(thing: Transaction | Message) -> Any:
    if isinstance(thing, Message):
        return thing.pdu.parameters.userdata if thing.pdu is not None else None
    return thing.parameters.userdata


def group(thing: Transaction | Message, _context: Context) -> CodeValue | None:
    """Return the function group of userdata."""
    head = _head(thing)
    return CodeValue(head.group, (head.group_name,)) if head is not None else None


def subfunction(thing: Transaction | Message, _context: Context) -> CodeValue | None:
    """Return the subfunction of userdata."""
    head = _head(thing)
    return CodeValue(head.subfunction, (head.subfunction_name,)) if head is not None else None


def userdata_type(thing: Transaction | Message, _context: Context) -> CodeValue | None:
    """Return whether userdata is a request, a response or an indication."""
    head = _head(thing)
    return CodeValue(head.type, (USERDATA_TYPES.name(head.type),)) if head is not None else None


def rosctr(thing: Transaction | Message, _context: Context) -> CodeValue | None:
    """Return the ROSCTR of an S7 PDU; for a transaction that of its request."""
    if isinstance(thing, Message):
        number = thing.pdu.rosctr if thing.pdu is not None else -1
    else:
        number = -1 if thing.is_plus or thing.is_scd else int(thing.rosctr)
    return CodeValue(number, (ROSCTR.name(number),)) if number >= 0 else None


def pdu_ref(thing: Transaction | Message, _context: Context) -> int | None:
    """Return the number that request and answer have in common."""
    if isinstance(thing, Transaction):
        text = facets.facet_of(thing).reference(thing)
        return int(text) if text else None
    if thing.pdu is not None:
        return thing.pdu.pdu_ref if thing.pdu.pdu_ref >= 0 else None
    if thing.plus is not None:
        paired = thing.plus.opcode != NOTIFICATION  # a notification counts notifications
        return thing.plus.sequence if paired and thing.plus.sequence >= 0 else None
    return thing.scd.message.tid if thing.scd is not None and "tid" in thing.scd.message.numbers else None


def subject(thing: Transaction | Operation, _context: Context) -> str:
    """Return the subject of a transaction or an operation, as text."""
    return thing.subject if isinstance(thing, Operation) else facets.subject(thing)


def errors(thing: Transaction | Operation | Message, _context: Context) -> list[CodeValue]:
    """Return every error of an answer."""
    if isinstance(thing, Transaction):
        return [
            CodeValue(known_code(error), (error.name,)) for error in thing.errors
        ] if thing.has_errors else []  # fmt: skip
    if isinstance(thing, Operation):
        error = thing.error
        return [CodeValue(error.code, (error.name,))] if error is not None else []
    pdu = thing.pdu
    if pdu is None or not pdu.refused:
        return []
    found = [CodeValue(pdu.error, (errors_of(pdu.function).name(pdu.error),))] if pdu.error else []
    if pdu.refusing_code != NOT_REFUSED:
        found.append(CodeValue(pdu.refusing_code, (RETURN_CODES.name(pdu.refusing_code),)))
    return found + [CodeValue(one, (RETURN_CODES.name(one),)) for one in pdu.return_codes() if one != 0xFF]


def error_text(what: str) -> Getter:
    """Return a getter for one text of every error; ``what`` is "where" or "text"."""

    def got(thing: Transaction, _context: Context) -> list[str]:
        return [getattr(error, what) for error in thing.errors] if thing.has_errors else []

    return got


def malformed(thing: Message, _context: Context) -> bool:
    """Return whether a PDU is malformed."""
    found = thing.pdu or thing.plus
    return bool(found.malformed) if found is not None else False


def items(thing: Transaction | Message, context: Context) -> list[ItemFacts]:
    """Return the items of a thing."""
    if isinstance(thing, Message):
        return thing.items(context.reader)
    return context.reader.items(thing)


def item_count(thing: Transaction | Message, context: Context) -> int:
    """Return the number of items."""
    return len(items(thing, context))


def return_codes(thing: Message, _context: Context) -> list[CodeValue]:
    """Return the return codes of an answer."""
    codes = thing.pdu.return_codes() if thing.pdu is not None else []
    return [CodeValue(code, (RETURN_CODES.name(code),)) for code in codes]


def of_finding(get: Callable[[Any], Any]) -> Getter:
    """Return a getter that calls ``get`` with the finding."""
    return lambda found, _context: get(found.finding)


def techniques(finding: Any) -> list[str]:
    """Return the MITRE ATT&CK techniques that a finding may be a sign of, by name and by their ids in both versions."""
    return [text for one in finding.rule.techniques for text in (one.name, one.v18, one.v19) if text]


# ---- S7comm-plus and SCD --------------------------------------------------------------------------------------------


def of_plus(get: Callable[[Any], Any]) -> Getter:
    """Return a getter that calls ``get`` with each S7comm-plus PDU of a thing: request and response, or the message."""

    def got(thing: Transaction | Message, _context: Context) -> list[Any]:
        if isinstance(thing, Message):
            halves = [thing.plus]
        elif thing.is_plus:
            halves = [thing.plus_request, thing.plus_response]
        else:
            return []
        values = [get(half) for half in halves if half is not None]
        return [value for value in values if value is not None]

    return got


def known(value: int) -> int | None:
    """Return a number, None for -1."""
    return value if value >= 0 else None


def of_scd(get: Callable[[ScdMessage], Any]) -> Getter:
    """Return a getter that calls ``get`` with each SCD message of a thing."""

    def got(thing: Transaction | Message, _context: Context) -> list[Any]:
        messages = ([thing.scd] if thing.scd else []) if isinstance(thing, Message) else thing.scd
        found: list[Any] = []
        for message in messages:
            value = get(message)
            if isinstance(value, (list, tuple)) and not isinstance(value, CodeValue):
                found += value
            elif value is not None:
                found.append(value)
        return found

    return got


def scd_number(role: str) -> Callable[[ScdMessage], int | None]:
    """Return a function that returns the number with this role from the envelope; None if the envelope has none."""
    return lambda found: found.message.numbers.get(role)
