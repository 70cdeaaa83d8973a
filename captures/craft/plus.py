"""S7comm-plus: a panel and an engineering station with one CPU, in the forms of public captures (docs/s7plus.md)."""

from __future__ import annotations

import struct
from typing import Final

from captures.craft.case import Case, crafts
from captures.craft.pdus import dt
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, build_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    AID,
    ARRAY,
    BLOB,
    BOOL,
    DINT,
    INT,
    REAL,
    RID,
    STRUCT,
    UDINT,
    UINT,
    USINT,
    WSTRING,
)
from dissect.protocols.s7plus.values import Blob, Struct, Value, build_members, build_value
from dissect.protocols.s7plus.variables import NameList, Variable, VariableList
from dissect.wire.varint import VLQ, build_varint

CPU: Final = "192.0.2.20"
VERSION: Final = "1;6ES7 215-1AG40-0XB0 ;V4.3"
DB: Final = 0x8A0E0001
TYPE: Final = 0x92000001
VALUES: Final = 2550
#: The variables of DB1: name, LID, datatype in the program.
LEVEL: Final = ("level", 9, 8)
PUMP: Final = ("pump", 10, 1)
SETPOINT: Final = ("setpoint", 11, 5)
QUALIFIER: Final = b"\0\0\x04\xe8" + build_members(
    [(1257, Value(0, RID, 0)), (1258, Value(0, AID, 0)), (1259, Value(0, UDINT, 0))]
)
FILL: Final = bytes(4)
#: The refusal of an item: the object was not found.
NOT_FOUND: Final = bytes.fromhex("ffffffffffffffff f4")
OPERATING_STATE: Final = [0x80150002, 4, 48, 52, 0, 2237, 3486]


def number(value: int) -> bytes:
    """A number of variable size."""
    return build_varint(value, VLQ)


def address(lid: int) -> bytes:
    """The address of a variable of DB1."""
    return b"".join([number(one) for one in (0, DB, 2, VALUES, lid)])


def addresses(*lids: int) -> bytes:
    """The addresses of variables of DB1, with their counts."""
    return bytes(4) + number(len(lids)) + number(5 * len(lids)) + b"".join([address(lid) for lid in lids])


def text(id_: int, value: str) -> Attribute:
    """An attribute that is a text."""
    return Attribute(id_, Value(0, WSTRING, value))


class Session:
    """A client with a session: request numbers, integrity ids, and the answers that depend on them."""

    def __init__(self, case: Case, client: str, port: int, id_: int) -> None:
        self.case = case
        self.talk = Talk(case, client, CPU, client_port=port)
        self.id = id_
        self.sequence = 0
        self.integrity = 0
        self.notified = 0
        self.talk.open()
        self.talk.connect()

    def send(self, side: int, data: bytes, version: int = 3) -> None:
        """Capture a PDU in one frame; from version 3 on with a digest, which no reader can check here."""
        content = b"\x20" + b"\x5a" * 32 + data if version == 3 else data
        frame = bytes((0x72, version)) + len(content).to_bytes(2, "big") + content + bytes((0x72, version, 0, 0))
        self.talk.send(side, dt(frame))

    def ask(self, function: int, body: bytes, flags: int = 0x34, version: int = 3, session: int = 0) -> None:
        """Capture a request with the next number."""
        self.sequence += 1
        head = struct.pack(">BHHHHIB", 0x31, 0, function, 0, self.sequence, session or self.id, flags)
        self.send(CLIENT, head + body, version)

    def tell(self, function: int, body: bytes, version: int = 3) -> None:
        """Capture the answer to the latest request."""
        self.case.pause(8)
        self.send(SERVER, struct.pack(">BHHHHB", 0x32, 0, function, 0, self.sequence, 0x34) + body, version)
        self.case.count(answered=1)
        self.case.pause(30)

    def begin(self, name: str, application: str, host: str, user: str, role: int) -> None:
        """Open a session; the client authenticates itself."""
        elements: list[Element] = [text(233, name), text(296, user), text(297, application), text(298, host)]
        client = PlusObject(211, 287, 0, 0, 0, [*elements, Attribute(299, Value(0, UDINT, role))])
        body = struct.pack(">I", 285) + build_value(Value(0, UDINT, 0)) + bytes(4) + build_object(client) + FILL
        self.ask(CREATE_OBJECT, body, 0x36, 1, 288)
        version = Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, VERSION))]))
        challenge = Value(ARRAY, USINT, list(range(20)))
        told = PlusObject(self.id, 287, 0, 0, 0, [text(233, name), Attribute(303, challenge), Attribute(306, version)])
        self.tell(CREATE_OBJECT, b"\0\1" + number(self.id) + build_object(told) + FILL, 1)
        key = Value(0, BLOB, Blob(0, bytes.fromhex("addee1fe") + b"\x5a" * 176))
        values = number(1) + build_value(version) + number(2) + build_value(key)
        head = self.id.to_bytes(4, "big") + number(2) + number(2) + number(306) + number(1830)
        self.ask(SET_MULTI_VARIABLES, head + values + b"\0" + QUALIFIER + FILL, version=2)
        self.tell(SET_MULTI_VARIABLES, b"\0\0\0" + FILL, 2)

    def end(self, answer: bool = False) -> bytes:
        """The end of a PDU of version 3: the next integrity id, or that of an answer."""
        if answer:
            return number(self.integrity + self.sequence) + FILL
        self.integrity += 1
        return number(self.integrity) + FILL

    def set(self, object_id: int, attribute: int, value: Value, answered: bool = True) -> None:
        """Write an attribute, with or without an answer."""
        body = object_id.to_bytes(4, "big") + number(1) + number(attribute) + build_value(value) + QUALIFIER + b"\0"
        self.ask(SET_VARIABLE, body + self.end(), 0x34 if answered else 0x74)
        if answered:
            self.tell(SET_VARIABLE, b"\0" + self.end(True))
        else:
            self.case.count(unsolicited=1)

    def create(self, parent: int, one: PlusObject, id_: int) -> None:
        """Create an object."""
        self.integrity += 1
        head = parent.to_bytes(4, "big") + build_value(Value(0, UDINT, 0)) + bytes(4) + number(self.integrity)
        self.ask(CREATE_OBJECT, head + build_object(one) + FILL, 0x36)
        self.tell(CREATE_OBJECT, b"\0\1" + number(id_) + self.end(True))

    def leave(self) -> None:
        """Delete the session, and close the connection."""
        self.ask(DELETE_OBJECT, self.id.to_bytes(4, "big") + b"\0" + QUALIFIER + self.end())
        self.tell(DELETE_OBJECT, b"\0" + self.id.to_bytes(4, "big") + FILL)
        self.talk.close()

    def notify(self, subscription: int, *items: tuple[int, Value | None]) -> None:
        """Let the CPU send values by the numbers of their items; None for a refused one."""
        self.notified += 1
        head = struct.pack(">BIHHHB", 0x33, subscription, 0x0400, 0, 0, self.notified & 0xFF)
        body = b"".join([
            b"\x92" + reference.to_bytes(4, "big") + build_value(value) if value is not None
            else b"\x13" + reference.to_bytes(4, "big")
            for reference, value in items
        ])  # fmt: skip
        self.send(SERVER, head + number(self.notified) + b"\1" + body + b"\0" + FILL)
        self.case.count(unsolicited=1)


def declaration() -> PlusObject:
    """The type of DB1: its variables, and their names."""
    rows = (LEVEL, PUMP, SETPOINT)
    variables = [Variable(lid, 0, datatype, 8 << 12, 0, 0, 0, []) for _, lid, datatype in rows]
    names = NameList([[name.encode() for name, _, _ in rows]])
    return PlusObject(TYPE, 511, 0, 0, 0, [VariableList(0x02000080, [variables]), names])


def block(rid: int, class_id: int, name: str, number_: int, language: int) -> PlusObject:
    """A block with empty code."""
    code = Attribute(2533, Value(0, BLOB, Blob(0, b"\x5a" * 300)))
    numbers = [Attribute(2521, Value(0, UINT, number_)), Attribute(2523, Value(0, UINT, language))]
    return PlusObject(rid, class_id, 0, 0, 0, [text(233, name), *numbers, code])


@crafts(
    "S7comm-plus of one CPU: a panel opens a session, reads the declaration of DB1, subscribes to two of its variables and the "
    "operating state, polls a third, and is refused one; an engineering station stops the CPU, loads OB1 and starts it again."
)
def plus_plant(case: Case) -> None:
    panel = Session(case, "192.0.2.30", 49210, 0x386)
    panel.begin("ServerSession_10000000", "HMI RT OMS+", "PANEL-3", "operator", 2)
    explore(panel)
    wanted = [
        one for at, lid in enumerate((LEVEL[1], PUMP[1], 99), 1) for one in (0x80040002, at, 0, DB, 0, VALUES, lid)
    ]
    references = Value(ADDRESS_ARRAY, UDINT, [0x80010000, 0, 4, *wanted, *OPERATING_STATE])
    attributes: list[Element] = [text(233, "Tank"), Attribute(1048, references), Attribute(1049, Value(0, UDINT, 500))]
    panel.create(
        panel.id, PlusObject(0x7FFFC001, 1001, 0, 0, 0, [*attributes, Attribute(1053, Value(0, INT, 5))]), 0x70400010
    )
    panel.notify(0x70400010, (1, Value(0, REAL, 42.5)), (2, Value(0, BOOL, True)), (3, None), (4, Value(0, DINT, 8)))
    case.count(item_errors=1)
    case.find("transaction.item_error")
    for step in range(4):
        case.pause(440)
        poll(panel, 60)
        panel.notify(0x70400010, (1, Value(0, REAL, 42.5 + step)))
    panel.set(0x70400010, 1053, Value(0, INT, 10), answered=False)
    station = Session(case, "192.0.2.10", 49320, 0x38A)
    station.begin("ServerSession_2DC6C3", "TIA Portal", "ES-07", "", 1)
    station.set(52, 2167, Value(0, DINT, 1))
    case.find("security.plc_stop")
    panel.notify(0x70400010, (4, Value(0, DINT, 4)))
    case.find("security.stopped")
    station.create(3, block(0x8A320001, 2647, "Main", 1, 4), 0x8A320001)
    case.find("security.program_change")
    case.pause(700)
    station.set(52, 2167, Value(0, DINT, 3))
    case.find("security.plc_start")
    panel.notify(0x70400010, (2, Value(0, BOOL, False)), (4, Value(0, DINT, 8)))
    case.find("security.mode_changed")
    station.leave()
    write(panel, 75)
    case.find("security.write")
    panel.leave()


@crafts(
    "Answers of an S7comm-plus CPU that do not fit: a read and a write are answered with items that nobody asked for, one item "
    "comes twice, one is left out; two values contradict the declaration that passed, by their type and by their size. The "
    "client ends its session by deleting object 0, as s7commplus does."
)
def plus_answers(case: Case) -> None:
    panel = Session(case, "192.0.2.31", 49230, 0x390)
    panel.begin("ServerSession_10000001", "HMI RT OMS+", "PANEL-4", "operator", 2)
    explore(panel)
    asked = (SETPOINT[1], LEVEL[1])
    values = (Value(0, INT, 60), Value(0, REAL, 42.5))
    answers: list[list[tuple[int, Value]]] = [
        [(1, values[0]), (2, values[1])],
        [(1, values[0]), (2, values[1]), (3, values[0])],
        [(1, values[0]), (1, values[0]), (2, values[1])],
        [(2, values[1])],
        [(1, Value(0, DINT, 70000)), (2, Value(ARRAY, REAL, [42.5, 1.0]))],
    ]
    for items in answers:
        panel.ask(GET_MULTI_VARIABLES, addresses(*asked) + QUALIFIER + panel.end())
        said = b"".join([number(at) + build_value(value) for at, value in items])
        panel.tell(GET_MULTI_VARIABLES, b"\0" + said + b"\0\0" + panel.end(True))
        if sorted([at for at, _ in items]) != [1, 2]:
            case.find("transaction.count_mismatch")
    panel.ask(
        SET_MULTI_VARIABLES,
        addresses(SETPOINT[1]) + number(1) + build_value(values[0]) + b"\0" + QUALIFIER + panel.end(),
    )
    panel.tell(SET_MULTI_VARIABLES, b"\x13" + number(7) + NOT_FOUND + b"\0" + panel.end(True))
    case.count(item_errors=1)
    case.find("transaction.item_error")
    case.find("transaction.count_mismatch")
    case.find("security.write")
    panel.ask(DELETE_OBJECT, bytes(4) + b"\0" + QUALIFIER + panel.end())
    panel.tell(DELETE_OBJECT, b"\0" + bytes(4) + FILL)
    panel.talk.close()


def explore(panel: Session) -> None:
    """Read the declaration of DB1."""
    panel.integrity += 1
    panel.ask(EXPLORE, DB.to_bytes(4, "big") + b"\0\1\1\0\0\0" + number(panel.integrity) + FILL + b"\0")
    integrity = number(panel.integrity + panel.sequence)
    panel.tell(EXPLORE, b"\0" + DB.to_bytes(4, "big") + integrity + build_object(declaration()) + FILL)


def poll(panel: Session, value: int) -> None:
    """Read the setpoint."""
    panel.ask(GET_MULTI_VARIABLES, addresses(SETPOINT[1]) + QUALIFIER + panel.end())
    panel.tell(GET_MULTI_VARIABLES, b"\0\1" + build_value(Value(0, INT, value)) + b"\0\0" + panel.end(True))


def write(panel: Session, value: int) -> None:
    """Write the setpoint."""
    values = number(1) + build_value(Value(0, INT, value))
    panel.ask(SET_MULTI_VARIABLES, addresses(SETPOINT[1]) + values + b"\0" + QUALIFIER + panel.end())
    panel.tell(SET_MULTI_VARIABLES, b"\0\0" + panel.end(True))
