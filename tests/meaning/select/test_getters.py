"""What each field says of things of every kind, and that it says nothing of those that do not have it."""

from __future__ import annotations

from typing import Any, Final

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.meaning.select import Where, getters
from dissect.meaning.select.fields import FIELDS, Field
from dissect.meaning.select.things import (
    CONNECTION,
    FINDING,
    MESSAGE,
    OPERATION,
    PACKET,
    TRANSACTION,
    Context,
    Found,
    Message,
    Packet,
)
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from tests.cases import each
from tests.engine.findings import events
from tests.engine.findings import plus_scenarios as plus
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import SERVER, START_NS, Talk, dbw, read
from tests.meaning.bindings import plant
from tests.protocols.s7plus.pdus import asked, event, framed, notified

Said = dict[str, list[str]]


class Heard(Talk):
    """A talk that keeps its messages as well."""

    def __init__(self, decoder: Any = None) -> None:
        super().__init__()
        self.wants_pdus = True
        self.pipeline = Pipeline(self, Options(strict=True, decoder=decoder))
        self.said: list[Message] = []

    def _keep(
        self, protocol: str, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool, found: Any = None
    ) -> None:
        self.said.append(
            Message(protocol, int(frame), int(time_ns), side.connection, int(side.index), octets, cut, found)
        )

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self._keep("s7comm", frame, time_ns, side, octets, cut)

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self._keep("s7comm_plus", frame, time_ns, side, octets, cut)

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        self._keep("scd", frame, time_ns, side, found.octets, False, found)


def values(field: Field, kind: str, thing: Any, context: Context) -> list[str]:
    get = field.getters.get(kind)
    found = get(thing, context) if get is not None else None
    some = [] if found is None else list(found) if type(found) in (list, tuple) else [found]
    return [field.kind.shown(one) for one in some]


def said(kind: str, thing: Any, context: Context | None = None, but: str = "") -> Said:
    """Return what each field says, without fields that say nothing and those named in ``but``."""
    told = {field.name: values(field, kind, thing, context or Context()) for field in FIELDS.values()}
    return {name: texts for name, texts in told.items() if texts and name not in but.split()}


def at(milliseconds: int) -> str:
    return f"2020-09-13T12:26:40.{milliseconds:03}000000Z"


CLIENT_END, SERVER_END = "10.0.0.1:50000", "10.0.0.2:102"
ENDS: Final[Said] = {
    "host": [CLIENT_END, SERVER_END], "client": [CLIENT_END], "server": [SERVER_END], "port": ["50000", "102"],
}  # fmt: skip
LINE: Final[Said] = {
    **ENDS, "connection": ["1"], "calling_tsap": ["01.00"], "called_tsap": ["01.02"], "rack": ["0"], "slot": ["2"],
    "pdu_length": ["240"],
}  # fmt: skip


def talked() -> Heard:
    """Transactions: a setup (6, 7), a refused read (8, 9), userdata (10, 11), two lost halves (12 and 13)."""
    talk = Heard()
    talk.hello()
    talk.connect()
    talk.ask(line.setup(1))
    talk.tell(line.granted(1))
    talk.ask(read(2, dbw(9, 0), dbw(1, 2)))
    talk.tell(line.ack_data(2, b"\x04\x02", line.refused(0x0A) + line.good(4, b"\0\7")))
    talk.ask(events.stop(3), after_ns=3_000_000)
    talk.tell(line.ack_data(3, b"\x29", code=0x8104), after_ns=2_000_000)
    talk.ask(line.userdata(4, line.head(1, 4, 1), b"\xff\x09\0\4\0\x11\0\0"))
    talk.tell(line.userdata(4, line.head(2, 4, 1, 0, 0), b"\xff\x09\0\x08\0\x11\0\0\0\x1c\0\0"))
    talk.ask(read(5, dbw(1, 0)))
    talk.tell(line.words(6, 1))
    talk.close()
    return talk


TALK: Final = talked()


def of_ref(ref: int) -> Any:
    return next(one for one in TALK.transactions if one.pdu_ref == ref)


def test_a_read() -> None:
    assert said(TRANSACTION, of_ref(2), but="error.text") == {
        **LINE, "asked_by": [CLIENT_END], "answered_by": [SERVER_END], "protocol": ["s7comm"], "frame": ["8", "9"],
        "request_frame": ["8"], "response_frame": ["9"], "time": [at(8)], "request_time": [at(8)], "response_time": [at(9)],
        "latency": ["1000000"], "latency_ns": ["1000000"], "sent_again": ["0"], "number": ["2"], "function": ["Read Var"],
        "rosctr": ["Job"], "pdu_ref": ["2"], "subject": ["DB9.DBW0: Object does not exist, DB1.DBW2 = 7"],
        "outcome": ["answered"], "certainty": ["sure"], "failed": ["true"], "error": ["Object does not exist"],
        "error.where": ["item 1"], "behind_malformed": ["false"], "address": ["DB9.DBW0", "DB1.DBW2"], "db": ["9", "1"],
        "area": ["DB", "DB"], "type": ["WORD", "WORD"], "count": ["1", "1"], "value": ["7"], "data": ["0007"],
        "return_code": ["Object does not exist", "Success"], "items": ["2"],
    }  # fmt: skip


def test_a_refused_job_and_userdata() -> None:
    stop = said(TRANSACTION, of_ref(3), but="error.text subject")
    assert {name: stop[name] for name in stop.keys() - LINE.keys()} == {
        "asked_by": [CLIENT_END], "answered_by": [SERVER_END], "protocol": ["s7comm"], "frame": ["10", "11"],
        "request_frame": ["10"], "response_frame": ["11"], "time": [at(12)], "request_time": [at(12)],
        "response_time": [at(14)], "latency": ["2000000"], "latency_ns": ["2000000"], "sent_again": ["0"], "number": ["3"],
        "function": ["PLC stop"], "rosctr": ["Job"], "pdu_ref": ["3"], "outcome": ["answered"], "certainty": ["sure"],
        "failed": ["true"], "error": stop["error"], "error.where": ["header"], "behind_malformed": ["false"], "items": ["0"],
    }  # fmt: skip
    assert Where("error == 0x8104").transaction(of_ref(3))
    szl = said(TRANSACTION, of_ref(4), but="subject")
    assert {name: texts for name, texts in szl.items() if name.startswith(("userdata", "function", "rosctr"))} == {
        "userdata.group": ["CPU functions"], "userdata.subfunction": ["read SZL"], "userdata.type": ["request"],
        "function": ["CPU functions: read SZL"], "rosctr": ["Userdata"],
    }  # fmt: skip


def test_an_answer_without_a_code_for_an_item_is_an_error_without_a_number() -> None:
    talk = Talk()
    talk.open()
    talk.ask(line.write(1, [dbw(1, 0), dbw(1, 2)], line.written(4, b"\0\1") + line.written(4, b"\0\2")))
    talk.tell(line.ack_data(1, b"\x05\x02", b"\xff"))
    (one,) = talk.transactions
    assert Where("error and items == 2").transaction(one)
    assert not Where("error >= -1").transaction(one)
    assert not Where("error in {-1, 0}").transaction(one)


def test_a_request_and_an_answer_alone() -> None:
    lost = said(TRANSACTION, of_ref(5), but="subject reason doubt certainty")
    assert {name: texts for name, texts in lost.items() if "frame" in name or "time" in name or "latency" in name} == {
        "frame": ["14"], "request_frame": ["14"], "time": [at(17)], "request_time": [at(17)],
    }  # fmt: skip
    assert "return_code" not in lost
    assert lost["items"] == ["1"]
    orphan = said(TRANSACTION, of_ref(6), but="subject reason doubt certainty")
    assert {name: texts for name, texts in orphan.items() if "frame" in name or "time" in name or "latency" in name} == {
        "frame": ["15"], "response_frame": ["15"], "time": [at(18)], "response_time": [at(18)],
    }  # fmt: skip
    assert (orphan["data"], orphan["return_code"]) == (["0001"], ["Success"])
    assert not orphan.keys() & {"value", "address"}  # nobody knows of what


def test_an_operation() -> None:
    stop = next(one for one in TALK.operations if one.kind == "control")
    told = said(OPERATION, stop, but="subject error")
    assert {name: told[name] for name in told.keys() - LINE.keys()} == {
        "asked_by": [CLIENT_END], "answered_by": [SERVER_END], "frame": ["10", "11"], "first_frame": ["10"],
        "last_frame": ["11"],
        "time": [at(12)], "duration": ["2000000"], "duration_ns": ["2000000"], "number": [str(int(stop.number))],
        "kind": ["control"],
        "failed": ["true"], "result": ["refused"], "transaction_count": ["1"], "pushes": ["0"], "octets": ["0"],
    }  # fmt: skip
    assert Where("error == 0x8104").operation(stop)
    good = next(one for one in TALK.operations if one.kind == "connect")
    assert "error" not in said(OPERATION, good)
    assert said(OPERATION, good)["failed"] == ["false"]


def test_a_connection() -> None:
    told = said(CONNECTION, TALK.connections[0])
    assert {name: told[name] for name in told.keys() - LINE.keys()} == {
        "protocol": ["s7comm"], "frame": ["1", "18"], "time": [at(1)], "duration": ["20000000"], "duration_ns": ["20000000"],
        "ended": ["fin"], "pdus": ["10"],
    }  # fmt: skip
    assert {name: told[name] for name in LINE} == LINE


def test_a_connection_whose_protocol_is_unknown_has_none() -> None:
    first, second = TALK.connections[0].tcp.ends
    fresh = Connection(9, TcpConnection(first, second, 0, 1, 0))
    assert fresh.protocol == ""
    assert not Where("protocol").connection(fresh)
    assert Where("connection == 9 and not protocol == s7comm").connection(fresh)


def test_a_finding() -> None:
    finding = next(one for one in TALK.findings if one.slug == "security.plc_stop")
    told = said(FINDING, Found(finding, TALK.connections[0]), but="technique")
    assert told == {
        **LINE, "frame": ["10", "11"], "time": [at(14)], "slug": ["security.plc_stop"],
        "severity": [finding.severity], "kind": ["security"], "detail": [finding.detail],
    }  # fmt: skip
    rule = CATALOGUE["security.plc_stop"]
    techniques = said(FINDING, Found(finding, None))["technique"]
    assert techniques == [text for one in rule.techniques for text in (one.name, one.v18, one.v19) if text]
    assert techniques


def test_severities_have_an_order() -> None:
    rules = {rule.severity: rule for rule in CATALOGUE.values()}
    assert rules.keys() == {"error", "warning", "note"}
    for expression, expected in (
        ("severity >= warning", ["error", "warning"]), ("severity > warning", ["error"]),
        ("severity < error", ["note", "warning"]),
        ("severity <= note", ["note"]), ("severity == warning", ["warning"]), ("severity > error", []),
        ("severity in {note}", ["note"]),
    ):  # fmt: skip
        judge = Where(expression).predicate(FINDING)
        found = [severity for severity, rule in rules.items() if judge(Found(Finding(rule, 0, [], 0, ""), None))]
        assert sorted(found) == expected, expression


@each(
    ("area", "names"),
    [
        (0x81, ["I", "E", "0x81"]), (0x82, ["Q", "A"]), (0x83, ["M", "flags"]), (0x84, ["DB"]), (0x85, ["DI"]),
        (0x1C, ["C", "Z"]),
        (0x1D, ["T"]), (0x80, ["P"]), (0x87, ["V"]), (0x03, ["SI200"]),
    ],
)  # fmt: skip
def test_an_area_has_its_english_and_its_german_letter_and_no_other(area: int, names: list[str]) -> None:
    one = Message("s7comm", 5, 0, TALK.connections[0], 0, read(1, line.item(area, 1, 0, 2)))
    letters = ["I", "E", "Q", "A", "M", "DB", "DI", "C", "Z", "T", "P", "V", "L", "SI200", "0x81"]
    assert [letter for letter in letters if Where(f"area == {letter}").message(one)] == [
        letter for letter in letters if letter in names
    ]


def test_a_finding_between_hosts_and_one_about_the_capture() -> None:
    between = Finding(CATALOGUE["transaction.slow"], 0, [], 5, "")
    between.client, between.server = "10.0.0.1 VLAN 5", "2001:db8::1"
    told = said(FINDING, Found(between, None))
    assert told == {
        "host": ["10.0.0.1", "2001:db8::1"], "client": ["10.0.0.1"], "server": ["2001:db8::1"], "slug": ["transaction.slow"],
        "severity": ["warning"], "kind": told["kind"],
    }  # fmt: skip
    assert getters.ports(Found(between, None), Context()) == []
    for expression in ("port", "port == 65535", "host == 10.0.0.1:0"):
        assert not Where(expression).predicate(FINDING)(Found(between, None))
    between.client = ""
    assert said(FINDING, Found(between, None))["host"] == ["2001:db8::1"]
    between.server = ""
    assert said(FINDING, Found(between, None)).keys() == {"slug", "severity", "kind"}


def test_packets() -> None:
    end, other = Endpoint(bytes((10, 0, 0, 1)), 50000), Endpoint(bytes((10, 0, 0, 2)), -1)
    assert said(PACKET, Packet(7, START_NS, None, None)) == {"frame": ["7"], "time": [at(0)]}
    assert said(PACKET, Packet(7, START_NS, (end, other), None)) == {
        "frame": ["7"], "time": [at(0)], "host": [CLIENT_END, "10.0.0.2"], "port": ["50000"], "src": [CLIENT_END],
        "dst": ["10.0.0.2"],
    }  # fmt: skip
    told = said(PACKET, Packet(7, START_NS, (end, other), TALK.connections[0]))
    assert told["client"] == [CLIENT_END]
    assert told["connection"] == ["1"]


# ---- messages -------------------------------------------------------------------------------------------------------

UNDAMAGED: Final[Said] = {"malformed": ["false"], "behind_malformed": ["false"], "cut": ["false"]}


def message(frame: int, of: Heard = TALK) -> Said:
    """Return what fields of a message say that its connection does not."""
    told = said(MESSAGE, next(one for one in of.said if one.frame == frame), but="time")
    return {name: texts for name, texts in told.items() if name not in LINE}


def test_messages_of_s7comm() -> None:
    there, back = {"src": [CLIENT_END], "dst": [SERVER_END]}, {"src": [SERVER_END], "dst": [CLIENT_END]}
    assert message(8) == {
        **there, **UNDAMAGED, "protocol": ["s7comm"], "frame": ["8"], "function": ["Read Var"], "rosctr": ["Job"],
        "pdu_ref": ["2"],
        "address": ["DB9.DBW0", "DB1.DBW2"], "db": ["9", "1"], "area": ["DB", "DB"], "type": ["WORD", "WORD"],
        "count": ["1", "1"],
        "items": ["2"],
    }  # fmt: skip
    assert message(9) == {
        **back, **UNDAMAGED, "protocol": ["s7comm"], "frame": ["9"], "function": ["Read Var"], "rosctr": ["Ack_Data"],
        "pdu_ref": ["2"], "error": ["Object does not exist"], "return_code": ["Object does not exist", "Success"],
        "items": ["0"],
    }  # fmt: skip
    refused = message(11)
    assert (refused["function"], refused["rosctr"], len(refused["error"])) == (["PLC stop"], ["Ack_Data"], 1)
    assert Where("error == 0x8104").message(next(one for one in TALK.said if one.frame == 11))
    assert message(12)["userdata.type"] == ["request"]
    assert message(13)["userdata.type"] == ["response"]
    assert message(13)["userdata.group"] == ["CPU functions"]
    assert message(13)["userdata.subfunction"] == ["read SZL"]
    assert "error" not in message(13)
    assert "return_code" not in message(8)
    for frame in (8, 9, 12):
        time = next(one for one in TALK.said if one.frame == frame).time_ns
        assert values(FIELDS["time"], MESSAGE, next(one for one in TALK.said if one.frame == frame), Context()) == [
            at((time - START_NS) // 1_000_000)
        ]


def test_userdata_that_refuses_has_its_code() -> None:
    """The data of a refusal begin with a return code of their own."""
    code = 0xD401
    octets = line.userdata(4, line.head(2, 4, 1, 0, code), b"\x0a\0\0\0")
    told = Message("s7comm", 5, 0, TALK.connections[0], SERVER, octets)
    assert len(values(FIELDS["error"], MESSAGE, told, Context())) == 1
    assert Where(f"error == {code}").message(told)


@each(
    ("octets", "expected"),
    [
        (b"", {"malformed": ["true"]}),
        (b"\x32\x01", {"malformed": ["true"]}),
        (read(7, dbw(1, 0))[:12], {"malformed": ["true"], "function": ["Read Var"]}),
    ],
)
def test_a_message_that_is_cut_short(octets: bytes, expected: Said) -> None:
    told = said(MESSAGE, Message("s7comm", 5, START_NS, TALK.connections[0], 0, octets), but="pdu_ref rosctr")
    shown = {name: texts for name, texts in told.items() if name in {"malformed", "function", "address", "error"}}
    assert shown == expected
    told = said(MESSAGE, Message("s7comm", 5, START_NS, TALK.connections[0], 0, octets))
    assert told.get("pdu_ref", []) == (["7"] if len(octets) == 12 else [])
    cut = said(MESSAGE, Message("s7comm", 5, START_NS, TALK.connections[0], 0, octets, True))
    assert cut["cut"] == ["true"]


def test_messages_of_other_protocols_have_no_fields_of_s7() -> None:
    for protocol in ("cotp", "ibh_netlink"):
        told = said(MESSAGE, Message(protocol, 5, START_NS, TALK.connections[0], 1, b"\3\0\0\7\2\xf0\x80"))
        assert {name: told[name] for name in told.keys() - LINE.keys()} == {
            "protocol": [protocol], "frame": ["5"], "time": [at(0)], "src": [SERVER_END], "dst": [CLIENT_END], **UNDAMAGED,
            "items": ["0"],
        }  # fmt: skip


# ---- S7comm-plus ----------------------------------------------------------------------------------------------------


def of_plus() -> Heard:
    """Opens a session (6, 7), reads MW100 (8, 9), writes (10, 11), notifies (12)."""
    talk = Heard()
    plus.begun(talk)
    plus.opened(talk)
    plus.read(talk, 2)
    plus.write(talk, 3, 100)
    talk.tell(framed(notified(5)))
    talk.close()
    return talk


PLUS: Final = of_plus()


def test_transactions_of_s7comm_plus() -> None:
    _, reading, writing, push = [
        {
            name: texts
            for name, texts in said(TRANSACTION, one, but="subject certainty doubt").items()
            if name not in LINE
        }
        for one in PLUS.transactions
    ]
    assert {name: texts for name, texts in reading.items() if "time" not in name and "latency" not in name} == {
        "asked_by": [CLIENT_END], "answered_by": [SERVER_END], "protocol": ["s7comm_plus"], "frame": ["8", "9"],
        "request_frame": ["8"], "response_frame": ["9"], "sent_again": ["0"], "number": ["2"],
        "function": ["GetMultiVariables"],
        "pdu_ref": ["2"], "outcome": ["answered"], "failed": ["false"], "behind_malformed": ["false"], "address": ["MW100"],
        "area": ["M"], "type": ["Int"], "value": ["5"], "data": ["0005"], "return_code": ["Success"], "items": ["1"],
        "s7plus.version": ["2", "2"], "s7plus.opcode": ["Request", "Response"], "s7plus.session_id": ["902"],
        "s7plus.return_value": ["0"],
    }  # fmt: skip
    assert (writing["function"], writing["value"], writing["s7plus.version"]) == (["SetVariable"], ["3"], ["3", "3"])
    assert {name: push[name] for name in push if name.startswith(("s7plus", "func", "pdu", "frame"))} == {
        "function": ["notification"], "frame": ["12"], "s7plus.version": ["2"], "s7plus.opcode": ["Notification"],
        "s7plus.subscription_id": [str(0x70000E51)],
    }  # fmt: skip


@each(
    ("expression", "numbers"),
    [
        ("function == read", [2]), ("function == write", [3]), ("function == notification", [4]), ("function == 0x54c", [2]),
        ('function == "S7comm-plus SetVariable"', [3]), ("function == CreateObject", [1]), ("rosctr", []),
        ("userdata.group", []),
        ("s7plus.session_id == 288", [1]), ("pdu_ref", [1, 2, 3]), ("function < 0", []),
        ("protocol == s7comm_plus", [1, 2, 3, 4]),
    ],
)  # fmt: skip
def test_functions_of_s7comm_plus_have_the_names_of_any_protocol(expression: str, numbers: list[int]) -> None:
    assert [int(one.number) for one in PLUS.transactions if Where(expression).transaction(one)] == numbers


def test_messages_of_s7comm_plus() -> None:
    assert message(8, PLUS) == {
        **UNDAMAGED, "src": [CLIENT_END], "dst": [SERVER_END], "protocol": ["s7comm_plus"], "frame": ["8"], "pdu_ref": ["2"],
        "function": ["GetMultiVariables"], "address": ["MW100"], "area": ["M"], "items": ["1"], "s7plus.version": ["2"],
        "s7plus.opcode": ["Request"], "s7plus.session_id": ["902"],
    }  # fmt: skip
    answer, push = message(9, PLUS), message(12, PLUS)
    assert (answer["s7plus.opcode"], answer["s7plus.return_value"], answer["pdu_ref"]) == (["Response"], ["0"], ["2"])
    assert "s7plus.session_id" not in answer
    assert (push["s7plus.opcode"], push["s7plus.subscription_id"]) == (["Notification"], [str(0x70000E51)])
    assert not push.keys() & {"pdu_ref", "function", "s7plus.return_value"}
    assert not message(8).keys() & {name for name in FIELDS if name.startswith("s7plus")}
    short = Message("s7comm_plus", 5, 0, PLUS.connections[0], 0, b"\x72\x02\0\1")
    assert values(FIELDS["malformed"], MESSAGE, short, Context()) == ["true"]
    assert values(FIELDS["pdu_ref"], MESSAGE, short, Context()) == []


def test_numbers_that_are_zero_are_there() -> None:
    """Nothing is -1; 0 is a number."""
    line_ = TALK.connections[0]
    zero = said(MESSAGE, Message("s7comm", 5, 0, line_, 0, read(0, dbw(0, 0))))
    assert (zero["pdu_ref"], zero["db"]) == (["0"], ["0"])
    request = said(MESSAGE, Message("s7comm_plus", 5, 0, line_, 0, framed(asked(0, 0, 0), 0)))
    names = ("pdu_ref", "s7plus.session_id", "s7plus.version")
    assert [request[name] for name in names] == [["0"], ["0"], ["0"]]
    assert Where("function == 0").message(Message("s7comm_plus", 5, 0, line_, 0, framed(asked(0, 0))))
    push = said(MESSAGE, Message("s7comm_plus", 5, 0, line_, 1, framed(notified(0, 0))))
    assert push["s7plus.subscription_id"] == ["0"]
    odd = Message("s7comm_plus", 5, 0, line_, 1, framed(bytes(20)))
    assert Where("s7plus.opcode == 0").message(odd)
    event_ = said(MESSAGE, Message("s7comm_plus", 5, 0, line_, 1, event(7)))
    assert event_["s7plus.version"] == ["254"]
    assert not event_.keys() & {"s7plus.opcode", "s7plus.session_id", "pdu_ref", "function", "s7plus.return_value"}
    for ref, selected in ((4, True), (2, False)):  # userdata has no function of its own: its number is 0
        assert Where("function == 0").transaction(of_ref(ref)) is selected
    nothing = Message("s7comm", 5, 0, line_, 0, line.job(1, b"\0\1"))
    assert Where("function == 0").message(nothing)
    ends = (Endpoint(bytes((10, 0, 0, 1)), 0), Endpoint(bytes((10, 0, 0, 2)), 1))
    assert said(PACKET, Packet(7, 0, ends, None))["port"] == ["0", "1"]
    rosctr = Message("s7comm", 5, 0, line_, 0, b"\x32\0" + read(1, dbw(1, 0))[2:])
    assert Where("rosctr == 0").message(rosctr)


# ---- SCD ------------------------------------------------------------------------------------------------------------


def of_scd() -> Heard:
    """Reads the pressure (1, 2), answers a write that nobody saw with an error (3), a message that is cut off (4)."""
    talk = Heard(plant.carrier())
    talk.datagram(0, plant.ask("0x6001:0", tid=7))
    talk.datagram(1, plant.tell("0x6001:0", 50, tid=7))
    talk.datagram(1, plant.tell("0x6001:0", err=-2, tid=9))
    talk.datagram(0, plant.ask("0x6001:0")[:-3])
    talk.finish()
    return talk


PUMPS: Final = of_scd()


def test_transactions_of_scd() -> None:
    done, refused = [said(TRANSACTION, one) for one in PUMPS.transactions]
    assert {name: texts for name, texts in done.items() if name.startswith("scd.")} == {
        "scd.binding": ["обмен", "обмен"], "scd.service": ["read", "read"], "scd.phase": ["request", "response"],
        "scd.tid": ["7", "7"], "scd.err": ["0", "0"], "scd.index": [str(0x6001)] * 2, "scd.sub": ["0", "0"],
        "scd.name": ["Давление 1"], "scd.value": ["25.0"], "scd.unit": ["кПа"],
    }  # fmt: skip
    names = ("protocol", "function", "pdu_ref", "address", "value", "items", "outcome")
    assert [done[name] for name in names] == [["scd"], ["SCD read"], ["7"], ["0x6001:0"], ["25.0"], ["1"], ["answered"]]
    assert {name: refused[name] for name in ("scd.err", "scd.flags", "failed", "error", "error.where", "pdu_ref", "items")} == {
        "scd.err": ["-2"], "scd.flags": ["access"], "failed": ["true"], "error": ["error"], "error.where": ["message"],
        "pdu_ref": ["9"], "items": ["0"],
    }  # fmt: skip
    assert not refused.keys() & {"scd.value", "scd.name", "scd.unit", "rosctr", "userdata.type"}
    for expression, selected in (("error == -2", True), ("error == 0", False), ("error == error", True)):
        assert Where(expression).transaction(PUMPS.transactions[1]) is selected
    for expression in ("function == read", 'function == "SCD read"', "function != write"):
        assert [Where(expression).transaction(one) for one in PUMPS.transactions] == [True, False]


def test_minus_one_is_an_error_of_scd() -> None:
    """It is the general error, and not the lack of a code."""
    talk = Heard(plant.carrier())
    talk.datagram(0, plant.ask("0x6001:0", tid=7))
    talk.datagram(1, plant.refuse("0x6001:0", -1, tid=7))
    talk.finish()
    (one,) = talk.transactions
    assert Where("error == -1 and error == abort").transaction(one)
    assert [error.as_dict()["code"] for error in one.errors] == [-1]


def test_messages_of_scd() -> None:
    asked, answer, error, short = [message(frame, PUMPS) for frame in (1, 2, 3, 4)]
    place = {"protocol": ["scd"], **UNDAMAGED}
    there, back = (
        {"src": ["10.0.0.1:49200"], "dst": ["10.0.0.2:5600"]},
        {"src": ["10.0.0.2:5600"], "dst": ["10.0.0.1:49200"]},
    )
    assert asked == {
        **place, **there, "frame": ["1"], "function": ["SCD read"], "pdu_ref": ["7"], "items": ["0"], "scd.binding": ["обмен"],
        "scd.service": ["read"], "scd.phase": ["request"], "scd.tid": ["7"], "scd.err": ["0"], "scd.index": [str(0x6001)],
        "scd.sub": ["0"],
    }  # fmt: skip
    assert answer == {
        **asked, **back, "frame": ["2"], "scd.phase": ["response"], "address": ["0x6001:0"], "items": ["1"],
        "scd.name": ["Давление 1"], "scd.value": ["25.0"], "scd.unit": ["кПа"],
    }  # fmt: skip
    assert (error["scd.err"], error["scd.service"], error["pdu_ref"]) == (["-2"], ["write"], ["9"])
    assert short == {
        **place, **there, "frame": ["4"], "items": ["0"], "scd.binding": ["обмен"], "scd.error": ["E_SHORT"],
    }  # fmt: skip


# ---- numbers of packets, and memory ---------------------------------------------------------------------------------


def test_packets_are_numbered_in_their_file() -> None:
    context = Context()
    context.number = lambda frame: frame - 5
    told = said(TRANSACTION, of_ref(2), context)
    assert (told["frame"], told["request_frame"], told["response_frame"]) == (["3", "4"], ["3"], ["4"])
    assert said(TRANSACTION, of_ref(5), context)["frame"] == ["9"]


def test_functions_are_remembered_for_a_bounded_number_of_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(getters, "_MAX_KNOWN", 2)
    for _ in range(2):
        for ref, name in ((1, "Setup communication"), (2, "Read Var"), (3, "PLC stop"), (4, "CPU functions: read SZL")):
            assert said(TRANSACTION, of_ref(ref))["function"] == [name]


def test_names_of_functions_are_those_of_all_protocols() -> None:
    names = list(getters.function_names())
    for name in (
        "Read Var",
        "read",
        "write",
        "notification",
        "pdo",
        "CPU functions",
        "read SZL",
        "CPU functions: read SZL",
    ):
        assert name in names
    assert {"GetMultiVariables", "S7comm-plus GetMultiVariables", "S7comm-plus notification"} <= set(names)
    assert repr(FIELDS["host"]) == "Field('host')"
