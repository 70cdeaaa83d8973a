"""A connection of S7comm-plus whose transactions are judged one after another, as tests need it."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import (
    Facts,
)
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, build_object
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
)
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, BLOB, DINT, INT, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Struct, Value, build_value
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told

SESSION_ID: Final = 0x386
DB3: Final = 0x8A0E0003
CREATED: Final = 0x70400001
#: The execution unit, its condition, and the operating state in it; what the state may be.
STATE: Final = VariableAddress(0, 52, 2237, [3486])
CONDITION: Final = VariableAddress(0, 52, 2237, [])
WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
STOPS, RUNS = 4, 8
FIVE: Final = Value(0, INT, 5)
NONE: Final = Value(0, UDINT, 0)
#: Return values: not allowed, and an error of some items only.
REFUSED: Final = build_varint(0x8022C4000F6EFF95, VLQ64)
PARTLY: Final = b"\x13"
RECORD: Final = bytes.fromhex("002000380100") + b"\0*6ES7 214-1HE30-0XB0 SZVBDYXX017685  \0\2V\2\2\0" + bytes(10)


def text(value: str) -> Value:
    return Value(0, WSTRING, value)


def condition(state: int) -> Value:
    return Value(0, STRUCT, Struct(3481, [(3482, Value(0, DINT, 0)), (3486, Value(0, DINT, state))]))


def new_object(class_id: int, *elements: Element, object_id: int = 211) -> PlusObject:
    return PlusObject(object_id, class_id, 0, 0, 0, list(elements))


def block(db: int = 3, *elements: Element) -> PlusObject:
    return new_object(2574, *elements, object_id=0x8A0E0000 + db)


def with_code(db: int = 3) -> PlusObject:
    return block(db, Attribute(2533, Value(0, BLOB, Blob(0, b"code"))))


def subscription(addresses: list[VariableAddress], *elements: Element) -> PlusObject:
    """The reference of the first address is 1."""
    items: list[int] = []
    for reference, one in enumerate(addresses, 1):
        items += [0x80040000 | len(one.lids) + 1, reference, 0, one.area, one.crc, one.sub_area, *one.lids]
    listed = Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, len(addresses), *items])
    return new_object(1001, Attribute(1048, listed), *elements)


class Line:
    """A connection of version 3 whose client has the session `SESSION_ID`."""

    def __init__(self) -> None:
        self.session = PlusSession(Program(), Identity())
        self.number = 0

    def facts(self, function: int, body: bytes = b"", answer: bytes = b"", version: int = 3) -> Facts | None:
        """Take a transaction; without a body or an answer it lacks this half."""
        self.number += 1
        request = framed(asked(self.number, function, SESSION_ID, body=body), version) if body else b""
        response = framed(told(self.number, function, answer), version) if answer else b""
        return take(self.session, function, request, response)

    def take(
        self, function: int, body: bytes = b"", answer: bytes = b"", version: int = 3
    ) -> list[tuple[str, str, int]]:
        """Give the events of a transaction without faults."""
        facts = self.facts(function, body, answer, version)
        if facts is None:
            return []
        assert facts.malformed == []
        assert not facts.exhausted
        return [(event.kind, event.text, event.object_id) for event in facts.events]

    def create(self, *objects: PlusObject, parent: int = 285, result: bytes = b"\0") -> list[tuple[str, str, int]]:
        """Create objects; the first one gets the id `CREATED`."""
        body = bodies.create_object(parent, NONE, integrity_id=self.number + 1)[:-4]
        body += b"".join([build_object(one) for one in objects]) + bodies.FILL
        ids = b"".join([number(CREATED + index) for index in range(len(objects))])
        return self.take(CREATE_OBJECT, body, result + bytes((len(objects),)) + ids + end(9))

    def delete(self, object_id: int, result: bytes = b"\0") -> list[tuple[str, str, int]]:
        return self.take(DELETE_OBJECT, bodies.delete_object(object_id), result + rid(object_id) + end(9))

    def explore(self, *objects: PlusObject, result: bytes = b"\0") -> list[tuple[str, str, int]]:
        held = b"".join([build_object(one) for one in objects])
        body = rid(3) + b"\0\1\1\0" + b"\0\0" + end(4) + b"\0"
        return self.take(EXPLORE, body, result + rid(3) + number(9) + held + end())

    def notify(self, *items: tuple[int, Value], behind: bytes = b"") -> list[tuple[str, str, int]]:
        held = b"".join([b"\x92" + rid(reference) + build_value(value) for reference, value in items])
        facts = take(self.session, -1, b"", framed(notified(7, CREATED)[:-1] + held + behind + b"\0" + bytes(4), 3))
        return [(event.kind, event.text, event.object_id) for event in facts.events] if facts is not None else []
