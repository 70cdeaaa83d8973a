"""Of which parts the body of each function consists, with their sizes and notes, and what of it is kept."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import is_known, parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.tables import FUNCTIONS
from tests.protocols.s7plus.bodies import number
from tests.protocols.s7plus.pdus import asked, event, framed, notified, told
from tests.protocols.s7plus.test_check_results import sound

_QUALIFIER: Final = [
    (4, "qualifier", ""),
    (8, "member", "1257 ParentRID = RID 0"),
    (5, "member", "1258 CompositionAID = AID 0"),
    (5, "member", "1259 KeyQualifier = UDInt 0"),
    (1, "end of list", ""),
]
_END: Final = [(1, "integrity id", ""), (4, "fill", "")]
_OK: Final = (1, "return value", "0 OK")
_OBJECT: Final = [
    (8, "object", "9 NativeObjects.theASLog_Rid, 7 NativeObjects.theTisJobCont_Rid"),
    (10, "attribute", "233 ObjectVariableTypeName = WString 'pump'"),
    (7, "relation", "300 ServerSessionClientRID → 5 NativeObjects.theLogs_Rid"),
    (1, "end of object", ""),
]
_FILTERED: Final = [
    (5, "filter", ""),
    (5, "member", "7 NativeObjects.theTisJobCont_Rid = Int 5"),
    (9, "member", "300 ServerSessionClientRID = WString 'pump'"),
    (1, "end of list", ""),
]
_JOBS: Final = "7 NativeObjects.theTisJobCont_Rid"

_PARTS: Final = {
    "request, explore": [
        (9, "explore", "3 NativeObjects.thePLCProgram_Rid"), (2, "group", ""), *_FILTERED, *_FILTERED,
        (2, "attribute id", "904"), (2, "group", ""), (5, "filter", ""), (1, "end of list", ""), (2, "group", ""),
        (1, "attribute id", _JOBS), (1, "attribute id", "8 NativeObjects.theAlarmSubsystem_Rid"),
        (1, "attribute id", "9 NativeObjects.theASLog_Rid"), *_END,
    ],
    "request, write of attributes": [
        (6, "items", "50 NativeObjects.theCPUcommon_Rid"), (2, "attribute id", "2237 HWObject.DIS"),
        (2, "attribute id", "3451 CPUcommon.CPUProtectionLevel"), (5, "item", "2: Int 5"), (8, "item", "1: WString 'pump'"),
        (1, "reserved", ""), *_QUALIFIER, *_END,
    ],
    "request, call": [
        (8, "call", "9 NativeObjects.theASLog_Rid"), (8, "item", "1: WString 'pump'"), (5, "item", "7: Int 5"),
        (1, "end of list", ""), (1, "reserved", ""), *_END,
    ],
    "request, sequence": [(1, "sequence", ""), (2, "sequence kind", ""), (0, "reserved", ""), *_OBJECT, *_END],
    "request, sequence, one octet": [(1, "sequence", ""), (2, "sequence kind", ""), (1, "reserved", ""), *_OBJECT, *_END],
    "request, sequence, two octets": [
        (1, "sequence", ""), (2, "sequence kind", ""), (2, "reserved", ""), *_OBJECT, *_OBJECT, *_END
    ],
    "request: sequence": [(1, "sequence", ""), (2, "sequence kind", ""), (4, "object id", _JOBS), *_END],
    "request, create several": [
        (4, "object id", "285 ObjectServerSessionContainer"), (7, "value", "WString 'pump'"), (4, "reserved", ""),
        (1, "integrity id", ""), *_OBJECT, *_OBJECT, (4, "fill", ""),
    ],
    "request, link": [(8, "link", f"{_JOBS} 137"), *_END],
    "request: delete": [(4, "object id", "0x70000001"), (1, "reserved", ""), *_QUALIFIER, *_END],
    "request: read of one, old": [
        (4, "object id", "5 NativeObjects.theLogs_Rid"), (1, "count", ""), (1, "attribute id", _JOBS),
        (1, "attribute id", "8 NativeObjects.theAlarmSubsystem_Rid"), *_QUALIFIER, *_END,
    ],
    "request: read of a stream": [
        (4, "object id", "49 NativeObjects.theCPUproxy_Rid"), (5, "value", "UDInt[1] 3753"), *_QUALIFIER, (2, "reserved", ""),
        *_END,
    ],
    "request: write of a stream": [
        (4, "object id", _JOBS), (5, "value", "UDInt[1] 300"), *_QUALIFIER, (2, "reserved", ""), (4, "value", "Int 5"), *_END
    ],
    "request: end of a sequence": [(2, "reserved", ""), *_END],
    "response, created": [
        _OK, (1, "count", ""), (1, "object id", _JOBS), (2, "object id", "904"), (5, "object id", "0xffffffff"), *_END
    ],
    "response, linked": [_OK, (1, "count", ""), *[(4, "object id", _JOBS)] * 3, *_END],
    "response, deleted, with details": [
        (9, "return value",
         "0x4000000000000011 Message session pre-legitimated; from object management, line 0; details follow"),
        (4, "object id", "902"), *_OBJECT, *_END,
    ],
    "response, called": [
        _OK, _OK, _OK, (5, "item", "1: Int 5"), (8, "item", "2: WString 'pump'"), (1, "end of list", ""), (1, "reserved", ""),
        *_END,
    ],
    "response, called, a return value more": [
        _OK, _OK, _OK, (2, "return value", "0x387 (unknown code)"), (5, "item", "1: Int 5"), (1, "end of list", ""),
        (1, "reserved", ""), *_END,
    ],
    "response: sequence": [_OK, (2, "sequence kind", ""), (4, "object id", _JOBS), *_END],
    "response: read of a stream": [_OK, (1, "reserved", ""), (7, "value", "Blob 61 62 63"), *_END],
    "notification, kinds": [
        (2, "notification head", ""), (10, "notified value", "904: WString 'pump'"), (5, "refused item", ""),
        (8, "notified value", "WString 'pump'"), (9, "notified value", "7: Int 5"), (1, "notified objects", ""), *_OBJECT,
        *_OBJECT, (1, "end of list", ""), (4, "fill", ""),
    ],
    "notification, two parts": [
        (2, "notification head", ""), (9, "notified value", "7: Int 5"), (1, "end of list", ""), (6, "second part", ""),
        (9, "notified value", "7: Int 5"), (5, "refused item", "8: refused"), (1, "end of list", ""), (3, "fill", ""),
    ],
}  # fmt: skip


def contents(name: str, version: int = 3, shown: bool = True) -> Contents:
    return parse_contents(parse_plus(framed(sound()[name], version)), shown)


@pytest.mark.parametrize("name", _PARTS)
def test_the_parts_of_a_body(name: str) -> None:
    found = contents(name)
    assert [(part.end - part.offset, part.layout.name, part.note) for part in found.parts] == _PARTS[name]
    assert found.whole
    assert found.malformed == []
    levels = {"member": 1, "attribute": 1, "relation": 1}
    for part in found.parts:
        assert part.depth == (levels.get(part.layout.name, 0) if part.layout.name != "end of list" else part.depth)


@pytest.mark.parametrize(
    ("name", "object_id", "method", "ids", "listed"),
    [
        ("request, explore", 3, -1, [904, 7, 8, 9], [7, 300, 7, 300]),
        ("request, write of attributes", 50, -1, [2237, 3451], []),
        ("request, call", 7, 9, [], []),
        ("request: sequence", 7, -1, [], []),
        ("request, sequence", -1, -1, [], []),
        ("request, create several", 285, -1, [], []),
        ("request, link", 7, -1, [137], []),
        ("request: read of a stream", 49, -1, [3753], []),
        ("response, created", -1, -1, [7, 904, 2**32 - 1], []),
        ("response, linked", -1, -1, [7, 7, 7], []),
        ("response, deleted, with details", 902, -1, [], []),
        ("response: sequence", 7, -1, [], []),
    ],
)
@pytest.mark.parametrize("shown", [True, False])
def test_what_is_kept_of_a_body(
    name: str, object_id: int, method: int, ids: list[int], listed: list[int], shown: bool
) -> None:
    found = contents(name, shown=shown)
    assert (found.object_id, found.method, found.ids) == (object_id, method, ids)
    assert [id_ for id_, _ in found.list] == listed
    assert [one.class_id for one in found.objects] == [9] * sum(
        "9 NativeObjects.theASLog_Rid," in part[2] for part in _PARTS[name]
    )
    assert bool(found.parts) == shown
    assert found.expected == (2 if name == "request, write of attributes" else 0)
    assert (found.items_left_out, found.exhausted, found.pieces) == (0, False, [])


@pytest.mark.parametrize("name", _PARTS)
def test_nothing_is_noted_where_nothing_is_shown(name: str) -> None:
    shown, quiet = contents(name), contents(name, shown=False)
    assert (quiet.parts, quiet.notes) == ([], [])
    assert shown.notes == [part[2] for part in _PARTS[name] if part[2]]
    assert (quiet.items, quiet.refusals, quiet.value, quiet.expected) == (
        shown.items, shown.refusals, shown.value, shown.expected
    )  # fmt: skip
    assert quiet.sequence == shown.sequence == (5 if name.startswith("notification") else -1)


def test_a_function_is_known_if_its_body_is_or_if_it_has_no_name() -> None:
    """What has neither may be anything; of a name without a body it is known that nobody knows more."""
    without = {"Error", "AddLink", "RemoveLink", "GetVariablesAddress", "Abort", "Error2", "InitSSL"}
    for row in FUNCTIONS:
        for data in (asked(1, row.number), told(1, row.number)):
            pdu = parse_plus(framed(data, 3))
            assert is_known(pdu) == (row.name not in without), row.name
    assert is_known(parse_plus(framed(asked(1, 0x9999), 3)))


@pytest.mark.parametrize("opcode", [0x30, 0x34, 0x00, 0xFF])
def test_a_pdu_of_another_kind_stays_octets(opcode: int) -> None:
    found = parse_contents(parse_plus(framed(bytes((opcode,)) + told(1)[1:], 3)))
    assert (found.malformed, found.whole, [part.layout.name for part in found.parts]) == ([], False, ["octets"])


def test_versions_without_contents() -> None:
    assert parse_contents(parse_plus(event(5))).whole
    for version in (0, 4, 5, 0xFD):
        assert parse_contents(parse_plus(framed(asked(1, body=bytes(4)), version))).parts == []
    long = notified()[:-2] + number(300)
    assert parse_contents(parse_plus(framed(long, 2))).whole is False
