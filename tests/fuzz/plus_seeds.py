"""The seeds for S7comm-plus contents: bodies of captures, and synthetic ones of each function and type of value."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Final

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.message import fixed_part, parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, Relation, build_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    INVOKE,
    OPCODES,
    REQUEST,
    RESPONSE,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.values import Blob, Packed, Rows, Struct, Value
from dissect.protocols.s7plus.variables import NameList, Variable, VariableList
from tests.fuzz.plus import written
from tests.protocols.s7plus import bodies

_LEVEL: Final = VariableAddress(7, 0x8A0E0003, 2550, [14])
_WORD: Final = VariableAddress(0, 82, 3736, [3, 0, 2])
#: Values of every type and form of S7comm-plus, and a block with everything that an object may contain.
VALUES: Final[tuple[tuple[int, int, object], ...]] = (
    (0, 0, None), (0, 1, True), (0x10, 2, [1, 2, 3]), (0, 3, 7), (0x20, 4, [1, 300]), (0, 5, 1 << 60), (0, 6, -1), (0, 7, -2),
    (0, 8, -70000), (0, 9, -1 << 40), (0, 10, 1), (0, 11, 2), (0, 12, 3), (0, 13, 4), (0, 14, 1.5),
    (0x10, 15, [2.5]), (0, 16, 5), (0, 17, -5), (0, 18, 3), (0, 19, 7), (0, 20, Blob(0, b"blob")),
    (0x40, 20, [(1, Blob(0, b"a")), (0x80000001, Blob(0, b"b"))]),
    (0, 20, Blob(7, b"", bytes(8), 0, [(1, Value(0, 1, True))])), (0, 20, Blob(7, b"abc", bytes(8), 3)), (0, 21, "text"),
    (0x40, 22, [(1, 7)]), (0, 22, Value(0, 7, 5)), (0, 23, Struct(314, [(319, Value(0, 21, "1;6ES7;V4.3"))])),
    (0x10, 23, Rows(8, [[(1, Value(0, 2, 1))], []])), (0x40, 23, [(1, Struct(9, [(1, Value(0, 2, 1))]))]),
    (0, 23, Packed(0x02000043, 5, 0x400, bytes(12))), (0, 23, Packed(0x91000007, 5, 2, b"abc")),
)  # fmt: skip
_COMPRESSED: Final = Blob(0, b"\x98\0\0\2" + zlib.compress(b"<Comment>" + bytes(50) + b"</Comment>"))
BLOCK: Final = PlusObject(0x8A0E0003, 2574, 0, 0, 0, [
    Attribute(233, Value(0, 21, "tank")), Attribute(2544, Value(0, 20, _COMPRESSED)), Relation(4, 0x92000003),
    PlusObject(0x92000003, 511, 0, 7, 8, [
        VariableList(0x02000080, [[Variable(9, 7, 5, 0x8000, 0, 0, 0, []), Variable(10, 7, 5, 0xA000, 0, 0, 0, [0, 0, 1, 8])]]),
        NameList([[b"level", b"history"]]),
    ]),
])  # fmt: skip


def plus_seeds(pdus: Iterable[bytes]) -> list[bytes]:
    """Return the inputs: one of each kind from PDUs of captures, and synthetic ones."""
    made = [body for octets in pdus if (body := _plus_body(octets))]
    kinds = {(body[:2], len(body) // 32): body for body in made}
    asked = [
        (
            GET_MULTI_VARIABLES,
            REQUEST,
            bodies.get_multi(_LEVEL, _WORD),
        ),
        (SET_MULTI_VARIABLES, REQUEST, bodies.set_multi([(_WORD, Value(0, 2, 1))])),
        (SET_VARIABLE, REQUEST, bodies.set_variable(52, [2167], Value(0, 8, 1))),
        (GET_VAR_SUBSTREAMED, REQUEST, bodies.get_stream(50, [7])),
        (CREATE_OBJECT, REQUEST, bodies.create_object(3, Value(0, 4, 0), BLOCK, integrity_id=9)),
        (DELETE_OBJECT, REQUEST, bodies.delete_object(0x8A0E0003)),
        (EXPLORE, REQUEST, bytes.fromhex("0000000300010001") + b"\1\1\x17\0\0\0\7\0\2\0\0\7" + bytes(5)),
        (EXPLORE, RESPONSE, b"\0\0\0\0\3\7" + build_object(BLOCK) + bytes(4)),
        (GET_LINK, REQUEST, bytes.fromhex("0000000387760000") + bytes(4)),
        (INVOKE, REQUEST, bytes(8) + b"\1\0\4\5\0\0" + bytes(4)),
    ]
    values = [Value(flags, kind, content) for flags, kind, content in VALUES]
    answers = [bodies.multi_got([(1, value), (2, value)], [(3, 0x8020AB0019D9FFF4)]) for value in values]
    return [
        *kinds.values(),
        *[written(function, opcode, version, body) for function, opcode, body in asked for version in (1, 2, 3)],
        *[written(GET_MULTI_VARIABLES, RESPONSE, 3, body) for body in answers],
    ]


def _plus_body(octets: bytes) -> bytes:
    """Return the input of the target ``plus`` for a PDU of a capture, empty for one without contents."""
    if octets[:1] != b"\x72":
        return b""
    pdu = parse_plus(octets)
    head = fixed_part(pdu)
    if head is None or pdu.version > 3 or pdu.opcode not in OPCODES:
        return b""
    return written(pdu.function, pdu.opcode, pdu.version, pdu.data[head.size :])
