"""The fields of selections: one table of name, type, meaning, example, and getters for each kind of thing.

`s7dissect fields`, docs/select.md, completion and the predicates read this table. ``also`` are further names: if the JSON
contract has a longer name for the same fact, both can be typed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from dissect.engine.findings.catalogue import CATALOGUE, NOTE, SEVERITIES
from dissect.engine.findings.catalogue import KINDS as FINDING_KINDS
from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.operation import KINDS as OPERATION_KINDS
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.transaction import OUTCOMES, REASON_TEXTS
from dissect.meaning.facts import fact as kinds
from dissect.meaning.facts.connection import CONNECTION as CONNECTION_FACTS
from dissect.meaning.facts.fact import Fact
from dissect.meaning.facts.finding import FINDING as FINDING_FACTS
from dissect.meaning.facts.operation import OPERATION as OPERATION_FACTS
from dissect.meaning.facts.transaction import ITEM
from dissect.meaning.facts.transaction import TRANSACTION as TRANSACTION_FACTS
from dissect.meaning.report.writer import COTP, NETLINK
from dissect.meaning.select import getters as of
from dissect.meaning.select.getters import Getter, OfItem
from dissect.meaning.select.items import ItemFacts
from dissect.meaning.select.literals import (
    AnyValue,
    Code,
    CodeValue,
    Duration,
    Host,
    Kind,
    Number,
    Octets,
    S7Address,
    Text,
    Time,
    Truth,
)
from dissect.meaning.select.things import CONNECTION, FINDING, KINDS, MESSAGE, OPERATION, PACKET, TRANSACTION, Context
from dissect.protocols.iso.upper import UPPER_NAMES
from dissect.protocols.s7.errors import ERROR_CODES, class_names
from dissect.protocols.s7.tables import (
    AREA_LETTERS,
    AREAS,
    LETTER_AREAS,
    RETURN_CODES,
    ROSCTR,
    TRANSPORT_SIZES,
    USERDATA_GROUPS,
    USERDATA_SUBFUNCTIONS,
    USERDATA_TYPES,
)
from dissect.protocols.s7plus.tables import NOTIFIED, OPCODES
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.scd.wording import json_value


class Field:
    """A field: its names, the type of its values, its meaning, a condition as an example, and the things that have it.

    ``getters`` are by kind of thing (`dissect.meaning.select.things.KINDS`). ``of_item`` returns the value for one item; a
    field that has it may be followed by an index in brackets; ``with_items`` are the kinds of things whose items have it.
    ``decided``: the value depends only on the ends and the number of a connection, so connections that are not selected need
    not be read.
    """

    __slots__ = ("about", "also", "decided", "example", "getters", "kind", "name", "of_item", "with_items")

    def __init__(
        self,
        name: str,
        kind: Kind,
        about: str,
        example: str,
        getters: Mapping[str, Getter],
        also: tuple[str, ...] = (),
        of_item: OfItem | None = None,
        with_items: frozenset[str] = frozenset(),
        decided: bool = False,
    ) -> None:
        self.name = name
        self.kind = kind
        self.about = about
        self.example = example
        self.getters = getters
        self.also = also
        self.of_item = of_item
        self.with_items = with_items
        self.decided = decided

    def __repr__(self) -> str:
        return f"Field({self.name!r})"

    @property
    def things(self) -> tuple[str, ...]:
        """The kinds of things that have this field."""
        return tuple([kind for kind in KINDS if kind in self.getters])


def _all(getter: Getter, kinds: Iterable[str] = KINDS) -> dict[str, Getter]:
    return dict.fromkeys(kinds, getter)


def _fact(
    of_name: str,
    example: str,
    things: tuple[str, ...] = KINDS,
    also: tuple[str, ...] = (),
    name: str = "",
    decided: bool = False,
    getter: Getter | None = None,
) -> Field:
    """Return the field of a fact of connections; ``things`` also have it, through ``getter`` if not by their connection."""
    fact = CONNECTION_FACTS[of_name]
    getters = _all(getter or of.of_fact(fact, of.connection_of), things)
    return Field(name or of_name, _kind(fact), fact.about, example, getters, also, decided=decided)


def _own(
    of_name: str,
    example: str,
    *things: str,
    name: str = "",
    kind: Kind | None = None,
    also: tuple[str, ...] = (),
) -> Field:
    """Return the field of a fact that each of ``things`` has in its own table."""
    facts = [_TABLES[thing][of_name] for thing in things]
    getters = {
        thing: of.of_fact(fact, of.finding_of if thing == FINDING else of.itself)
        for thing, fact in zip(things, facts, strict=True)
    }
    return Field(name or of_name, kind or _kind(facts[0]), facts[0].about, example, getters, also)


def _kind(fact: Fact[Any]) -> Kind:
    """Return the type in which a fact is compared."""
    return Code(lambda: fact.codes) if fact.kind == kinds.CODE else _KINDS[fact.kind]


_TABLES: Final[Mapping[str, Mapping[str, Fact[Any]]]] = {
    TRANSACTION: TRANSACTION_FACTS,
    OPERATION: OPERATION_FACTS,
    FINDING: FINDING_FACTS,
}
_KINDS: Final[Mapping[str, Kind]] = {
    kinds.COUNT: Number(),
    kinds.COUNTS: Number(),
    kinds.END: Host(),
    kinds.TEXT: Text(),
    kinds.TSAP: Text(),
    kinds.FRAME: Number(),
    kinds.TIME: Time(),
    kinds.INSTANT: Time(),
    kinds.DURATION: Duration(bare=True),
    kinds.FLAG: Truth(),
}
_TALK: Final = (TRANSACTION, OPERATION)
_PDUS: Final = (TRANSACTION, MESSAGE)


def _item(
    name: str,
    kind: Kind,
    of_name: str,
    example: str,
    get: OfItem,
    kinds: Iterable[str] = _PDUS,
    others: Mapping[str, Getter] | None = None,
) -> Field:
    """Return a field with a separate value for each item; ``others`` are getters for further kinds, without items."""

    def got(thing: Any, context: Context) -> list[Any]:
        found: list[Any] = []
        for item in of.items(thing, context):
            value = get(item, context)
            if isinstance(value, list):
                found += value
            elif value is not None:
                found.append(value)
        return found

    also = "items.transport_size" if name == "type" else f"items.{name}"
    further = others or {}
    own = frozenset(kinds) - further.keys()
    return Field(name, kind, ITEM[of_name].about, example, {**dict.fromkeys(kinds, got), **further}, (also,), get, own)


def _attribute(name: str) -> OfItem:
    return lambda item, _context: getattr(item, name)


def _text(get: Getter, kinds: Iterable[str]) -> dict[str, Getter]:
    return _all(lambda thing, context: get(thing, context) or None, kinds)


def _thing(name: str) -> Getter:
    """Return a getter that returns the attribute ``name`` of a thing, a number."""
    return lambda thing, _context: int(getattr(thing, name))


def _word(name: str) -> Getter:
    """Return a getter that returns the attribute ``name`` of a thing, a word; None for an empty one."""

    def got(thing: Any, _context: Context) -> CodeValue | None:
        word = getattr(thing, name)
        return of.name_code(word) if word else None

    return got


def _severity(finding: Finding) -> CodeValue:
    return CodeValue(_WEIGHTS[finding.severity], (finding.severity,))


#: Severities with a rank, so that they can be compared: `severity >= warning`.
_WEIGHTS: Final = {severity: len(SEVERITIES) - at for at, severity in enumerate(SEVERITIES)}


def _subfunctions() -> Iterable[str]:
    return [name for table in USERDATA_SUBFUNCTIONS.values() for name in table.names().values()]


def _areas() -> Iterable[str]:
    return [*AREA_LETTERS.values(), *LETTER_AREAS, *AREAS.names().values()]


def _area(item: ItemFacts, _context: Context) -> CodeValue | None:
    area = item.area
    if area is None:
        return None
    german = [letter for letter, number in LETTER_AREAS.items() if number == area.number and letter not in area.names]
    return CodeValue(area.number, (*area.names, *german)) if german else area


def _error_names() -> Iterable[str]:
    for table in (ERROR_CODES, RETURN_CODES, PLUS_CODES, NOTIFIED):
        yield from table.names().values()
    yield from class_names()
    yield from ("abort", "error")  # of SCD


def _return_names() -> Iterable[str]:
    for table in (RETURN_CODES, PLUS_CODES, NOTIFIED):
        yield from table.names().values()


def _tags(item: ItemFacts, _context: Context) -> list[str]:
    return [named.name for named in item.tags]


def _scd_values(get: Any) -> Any:
    return lambda found: [value for row in found.values if (value := get(row)) not in {None, ""}]


def _scd_error(found: ScdMessage) -> str | None:
    return found.message.error.code if found.message.error is not None else None


_ROWS: Final = (
    # ---- who
    Field("host", Host(), "Either end of the connection: an address, a network, or an address with its port.",
          "host == 192.168.0.0/24", _all(of.ends), decided=True),
    _fact("client", "client == 192.168.0.10", getter=of.client),
    _fact("server", "server in {192.168.0.1, 192.168.0.2}", getter=of.server),
    Field("port", Number(), "Either TCP or UDP port.", "port == 102", _all(of.ports), decided=True),
    Field("src", Host(), "Sender of the message or packet.", "src == 192.168.0.1",
          {MESSAGE: lambda thing, _context: thing.ends[0],
           PACKET: lambda thing, _context: thing.ends[0] if thing.ends else None}),
    Field("dst", Host(), "Receiver of the message or packet.", "dst == 192.168.0.1",
          {MESSAGE: lambda thing, _context: thing.ends[1],
           PACKET: lambda thing, _context: thing.ends[1] if thing.ends else None}),
    _own("asked_by", "asked_by == 192.168.0.10", *_TALK),
    _own("answered_by", "answered_by == 192.168.0.1", *_TALK),
    _fact("number", "connection in {1, 3}", name="connection", decided=True),
    Field("protocol", Code(lambda: [*UPPER_NAMES, "ibh_netlink", COTP, NETLINK]), "The protocol.",
          "protocol == s7comm_plus", _all(of.protocol, (TRANSACTION, CONNECTION, MESSAGE))),
    _fact("calling_tsap", 'calling_tsap == "01.00"', also=("calling_tsap.text",)),
    _fact("called_tsap", 'called_tsap == "01.02"', also=("called_tsap.text",)),
    _fact("rack", "rack == 0", also=("called_tsap.rack",)),
    _fact("slot", "slot == 2", also=("called_tsap.slot",)),
    _fact("vlan", "vlan == 100"),
    _fact("pdu_length", "pdu_length < 480"),
    _fact("ended", "ended == reset", (CONNECTION,), ("ending.how",)),
    _fact("pdus", "pdus > 1000", (CONNECTION,)),

    # ---- when
    Field("frame", Number(), "Number of a packet: request or answer, first or last packet, packets of a finding.",
          "frame in {100..200}", _all(of.frames), ("frames",)),
    _own("request_frame", "request_frame == 17", TRANSACTION),
    _own("response_frame", "response_frame == 18", TRANSACTION),
    _own("first_frame", "first_frame < 100", OPERATION),
    _own("last_frame", "last_frame > 100", OPERATION),
    Field("time", Time(), "Time of it, or of its begin: date and time (UTC), time of day, or a time after the first packet.",
          "time >= 14:51:37", _all(of.time), ("begin_time",)),
    _own("request_time", "request_time < 2016-02-08T14:51:37.5", TRANSACTION),
    _own("response_ns", "response_time > 90s", TRANSACTION, name="response_time"),
    _own("latency_ns", "latency > 20ms", TRANSACTION, name="latency", kind=Duration()),
    _own("latency_ns", "latency_ns > 20000000", TRANSACTION),
    _own("sent_again_times", "sent_again > 0", TRANSACTION, name="sent_again"),
    Field("duration", Duration(), "Time from the first packet to the last.", "duration > 5s",
          _all(of.duration, (OPERATION, CONNECTION))),
    Field("duration_ns", Duration(bare=True), "The same; a number without a unit counts nanoseconds.",
          "duration_ns > 5000000000", _all(of.duration, (OPERATION, CONNECTION))),

    # ---- what
    Field("number", Number(), "Number of the transaction or operation in the run.", "number in {1..20}",
          _all(_thing("number"), _TALK)),
    Field("function", Code(of.function_names, also="scd"), "The function; `read` and `write` are those of any protocol.",
          'function == "Read Var"', _all(of.function, _PDUS), ("function.code", "function.name")),
    Field("userdata.group", Code(lambda: USERDATA_GROUPS.names().values()), "Function group of userdata.",
          'userdata.group == "CPU functions"', _all(of.group, _PDUS), ("userdata.group_name",)),
    Field("userdata.subfunction", Code(_subfunctions), "Subfunction of userdata.", 'userdata.subfunction == "read SZL"',
          _all(of.subfunction, _PDUS), ("userdata.subfunction_name",)),
    Field("userdata.type", Code(lambda: USERDATA_TYPES.names().values()), "Request, response or indication of userdata.",
          "userdata.type == 0", _all(of.userdata_type, _PDUS), ("userdata.type_name",)),
    Field("rosctr", Code(lambda: ROSCTR.names().values()), "Kind of the S7 PDU; of a transaction that of its request.",
          "rosctr == Job", _all(of.rosctr, _PDUS), ("rosctr_name",)),
    Field("pdu_ref", Number(), "Reference by which request and answer belong together.", "pdu_ref == 0x0105",
          _all(of.pdu_ref, _PDUS)),
    Field("subject", Text(), "Its subject, in words; the words may change.", 'subject contains "OB1"',
          _text(of.subject, _TALK)),
    Field("kind", Code(lambda: [*OPERATION_KINDS, *FINDING_KINDS]), "Kind of the operation or finding.", "kind == download",
          {OPERATION: _word("kind"), FINDING: of.of_finding(lambda finding: of.name_code(finding.rule.kind))}),

    # ---- what became of it
    _own("outcome", "outcome == unanswered", TRANSACTION, kind=Code(lambda: OUTCOMES)),
    Field("reason", Code(lambda: REASON_TEXTS, also=""), "Why there is no answer, or why the end is missing.",
          "reason == connection_closed", _all(_word("reason"), _TALK)),
    _own("certainty_said", "certainty == likely", TRANSACTION, name="certainty"),
    _own("doubt_said", "doubt == gaps", TRANSACTION, name="doubt"),
    _own("failed", "failed", *_TALK),
    Field("error", Code(_error_names), "Errors of the answer, by name or code; the name alone: any error.", "error == 0x0a",
          _all(of.errors, (TRANSACTION, OPERATION, MESSAGE)), ("errors.code", "errors.name", "error.code", "error.name")),
    Field("error.where", Text(), "The part of the answer that has the error.", 'error.where == "header"',
          {TRANSACTION: of.error_text("where")}, ("errors.where",)),
    Field("error.text", Text(), "The sentence about an error.", 'error.text contains "protected"',
          {TRANSACTION: of.error_text("text")}, ("errors.text",)),
    _own("result", "result != done", OPERATION),
    _own("transaction_count", "transaction_count > 10", OPERATION),
    _own("pushes", "pushes > 0", OPERATION),
    _own("octets", "octets > 10000", OPERATION),
    Field("malformed", Truth(), "The message contradicts itself.", "malformed", {MESSAGE: of.malformed}),
    Field("behind_malformed", Truth(), "The message, or one of the transaction, is behind the malformed header of a TPDU.",
          "behind_malformed", _all(lambda thing, _context: thing.is_behind, _PDUS)),
    Field("cut", Truth(), "The capture kept only the beginning of the message.", "cut",
          {MESSAGE: lambda thing, _context: thing.cut}),

    # ---- items
    _item("address", S7Address(), "label", "address overlaps DB10.DBW4", _attribute("place")),
    _item("db", Number(), "db_number", "db in {10, 20}", _attribute("db")),
    _item("area", Code(_areas), "area_name", "area == M", _area),
    _item("type", Code(lambda: TRANSPORT_SIZES.names().values(), also=""), "type_name", "type == REAL", _attribute("type")),
    _item("count", Number(), "count", "count > 100", _attribute("count")),
    _item("tag", Text(), "name", 'tag == "Tank.Level"', _tags),
    _item("value", AnyValue(), "value", "value[DB10.DBD16] > 80", lambda item, _context: item.values, (TRANSACTION,)),
    _item("data", Octets(), "data", "data contains 00:01", _attribute("data"), (TRANSACTION,)),
    _item("return_code", Code(_return_names), "return_name", "return_code != 0xff", _attribute("return_code"),
          (TRANSACTION,), {MESSAGE: of.return_codes}),
    Field("items", Number(), "Number of items.", "items > 20", _all(of.item_count, _PDUS)),

    # ---- findings
    _own("slug", 'slug matches "^security"', FINDING, kind=Code(lambda: CATALOGUE)),
    Field("severity", Code(lambda: SEVERITIES, ranks=_WEIGHTS), f"Weight of the finding, from {NOTE} to {SEVERITIES[0]}.",
          "severity >= warning", {FINDING: of.of_finding(_severity)}),
    _own("detail", 'detail contains "OB1"', FINDING),
    Field("technique", Text(), "MITRE ATT&CK techniques of the finding, by name or id.", "technique == T0858",
          {FINDING: of.of_finding(of.techniques)}),
    _own("because_of", 'because_of == "s7.malformed"', FINDING, kind=Code(lambda: CATALOGUE)),

    # ---- S7comm-plus
    Field("s7plus.version", Number(), "Version of the header: 1, 2, 3; 254 system event, 255 keep-alive.",
          "s7plus.version == 3", _all(of.of_plus(lambda pdu: of.known(pdu.version)), _PDUS)),
    Field("s7plus.opcode", Code(lambda: OPCODES.names().values()), "Request, response or notification.",
          "s7plus.opcode == notification",
          _all(of.of_plus(lambda pdu: CodeValue(pdu.opcode, (OPCODES.name(pdu.opcode),)) if pdu.opcode >= 0 else None), _PDUS)),
    Field("s7plus.session_id", Number(), "Session of the request.", "s7plus.session_id == 0x3a2",
          _all(of.of_plus(lambda pdu: of.known(pdu.session_id)), _PDUS)),
    Field("s7plus.subscription_id", Number(), "Subscription that sends the notification.", "s7plus.subscription_id",
          _all(of.of_plus(lambda pdu: of.known(pdu.subscription_id)), _PDUS)),
    Field("s7plus.return_value", Number(), "Return value of the response, 0 for success.", "s7plus.return_value != 0",
          _all(of.of_plus(lambda pdu: of.known(pdu.return_value)), _PDUS)),

    # ---- SCD
    Field("scd.binding", Text(), "Name of the binding that found the message.", 'scd.binding == "pump"',
          _all(of.of_scd(lambda found: found.binding), _PDUS)),
    Field("scd.service", Code(lambda: ("read", "write", "pdo")), "Service of the message.", "scd.service == write",
          _all(of.of_scd(lambda found: of.name_code(found.message.service) if found.message.service else None), _PDUS)),
    Field("scd.phase", Code(lambda: ("request", "response", "abort", "push")), "Role of the message in its service.",
          "scd.phase == abort",
          _all(of.of_scd(lambda found: of.name_code(found.message.phase) if found.message.phase else None), _PDUS)),
    *[Field(f"scd.{role}", Number(), about, example, _all(of.of_scd(of.scd_number(role)), _PDUS)) for role, about, example in (
        ("tid", "Transaction number; for a PDO its counter.", "scd.tid == 7"),
        ("err", "`scd_err_t`: 0 good, below 0 an error.", "scd.err < 0"),
        ("index", "Index of the object.", "scd.index == 0x6001"),
        ("sub", "Sub-index.", "scd.sub == 1"),
    )],
    Field("scd.pdo", Text(), "The PDO.", "scd.pdo == T1", _all(of.of_scd(lambda found: found.message.pdo or None), _PDUS)),
    Field("scd.name", Text(), "Names of the values in the dictionary.", 'scd.name contains "pump"',
          _all(of.of_scd(_scd_values(lambda row: row.name)), _PDUS)),
    Field("scd.value", AnyValue(), "Values of the message, with scale and shift.", "scd.value > 50",
          _all(of.of_scd(_scd_values(lambda row: json_value(row.physical))), _PDUS)),
    Field("scd.unit", Text(), "Units of the values.", 'scd.unit == "kPa"',
          _all(of.of_scd(_scd_values(lambda row: row.unit)), _PDUS)),
    Field("scd.flags", Text(), "Irregularities of the message.", "scd.flags == limits",
          _all(of.of_scd(lambda found: list(found.message.flags)), _PDUS)),
    Field("scd.error", Text(), "Why the message was not decoded.", "scd.error == E_CRC", _all(of.of_scd(_scd_error), _PDUS)),
)  # fmt: skip

#: The fields by name, in the order of the table.
FIELDS: Final[Mapping[str, Field]] = {field.name: field for field in _ROWS}

#: The fields by each name that can be typed.
NAMES: Final[Mapping[str, Field]] = {
    **{also: field for field in _ROWS for also in field.also},
    **FIELDS,
}

#: Wireshark's names of some fields, to suggest ours to users who type those.
WIRESHARK: Final[Mapping[str, str]] = {
    "ip.addr": "host",
    "ip.host": "host",
    "ipv6.addr": "host",
    "ip.src": "src",
    "ip.dst": "dst",
    "tcp.port": "port",
    "tcp.stream": "connection",
    "frame.number": "frame",
    "frame.time": "time",
    "frame.time_relative": "time",
    "s7comm.header.pduref": "pdu_ref",
    "s7comm.header.rosctr": "rosctr",
    "s7comm.param.func": "function",
    "s7comm.param.item.db": "db",
    "s7comm.param.item.area": "area",
    "s7comm.param.item.address": "address",
    "s7comm.param.userdata.funcgroup": "userdata.group",
    "s7comm.data.returncode": "return_code",
}
