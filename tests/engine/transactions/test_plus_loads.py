"""Loads of S7comm-plus: blocks at any depth of the objects of a request, and all that a session loads as one operation."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import dissect
from dissect.engine.program.carved import carve
from dissect.engine.transactions import operation as kinds
from dissect.meaning.report.operations import operation_json
from dissect.meaning.report.words import Places
from dissect.protocols.s7plus.assembly import MAX_PDU
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.ids import BLOCK_CLASSES
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB, BOOL, UINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Value
from dissect.wire.text import Clock
from tests.engine.findings.test_plus_rules import DENIED, NOTHING, begun, block, do
from tests.engine.transactions.talk import Talk
from tests.engine.transactions.test_plus_operations import log_in
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told

OB = block(0x8A320001, 2647, "Main", 4)
DB = block(0x8A0E0003, 2574, "tank", 5)
HARDWARE = PlusObject(2, 2496, 0, 0, 0, [])


def within(depth: int, *these: PlusObject) -> PlusObject:
    """Objects inside ``depth`` others, of classes that mean nothing here."""
    outer = PlusObject(0x50, 1234, 0, 0, 0, list(these))
    for number in range(1, depth):
        outer = PlusObject(0x50 + number, 1235, 0, 0, 0, [Attribute(233, Value(0, WSTRING, "x")), outer])
    return outer


def create(talk: Talk, number: int, parent: int, *objects: PlusObject, answer: bytes = b"\0\0") -> None:
    do(talk, number, CREATE_OBJECT, bodies.create_object(parent, NOTHING, *objects, integrity_id=number), answer)


def downloads(talk: Talk) -> list[tuple[str, str, int]]:
    talk.close()
    return [(one.subject, one.result, int(one.parts)) for one in talk.operations if one.kind == kinds.DOWNLOAD]


def carried(talk: Talk) -> list[tuple[str, str]]:
    return [(one.label, one.missing) for made in talk.operations if made.kind == kinds.DOWNLOAD for one in carve(made)]


def changes(talk: Talk) -> list[str]:
    return [one.detail.partition(": ")[2] for one in talk.findings if one.slug == "security.program_change"]


@pytest.mark.parametrize("frames", [1, 2, 7])
@pytest.mark.parametrize("depth", [1, 2, 5, 20])
@pytest.mark.parametrize("parent", [1, 3, 7, 0x70000001])
def test_a_block_at_any_depth_is_loaded(parent: int, depth: int, frames: int) -> None:
    """Wherever the objects are created, however deep the block is in them, in however many frames they come."""
    talk = begun()
    data = asked(1, CREATE_OBJECT, body=bodies.create_object(parent, NOTHING, within(depth, OB, DB), integrity_id=1))
    size = -(-len(data) // frames)
    for at in range(0, len(data), size):
        talk.ask(framed(data[at : at + size], 2, trailer=at + size >= len(data)))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\0\0" + bodies.FILL), 2))
    assert downloads(talk) == [("2 blocks: OB1 'Main' (SCL), DB3 'tank' (DB)", "done", 1)]
    assert carried(talk) == [("OB1", ""), ("DB3", "")]
    assert changes(talk) == ["load 2 blocks: OB1 'Main' (SCL), DB3 'tank' (DB), accepted"]


@pytest.mark.parametrize("class_id", sorted(BLOCK_CLASSES))
def test_the_class_says_what_a_block_is_whatever_its_id_is(class_id: int) -> None:
    talk = begun()
    made = PlusObject(211, class_id, 0, 0, 0, [Attribute(2521, Value(0, UINT, 17))])
    create(talk, 1, 1, within(3, made))
    kind = BLOCK_CLASSES[class_id]
    assert downloads(talk) == [(f"{kind}17", "done", 1)]
    assert carried(talk) == [(f"{kind}17", "")]


def test_blocks_of_the_library_have_ids_of_their_own() -> None:
    talk = begun()
    create(talk, 1, 1, within(1, block(0x8A20043C, 2578, "MB_CLIENT", 4), block(0x8A24026C, 3932, "Req", 0)))
    do(talk, 2, DELETE_OBJECT, bodies.delete_object(0x8A20043C), b"\0" + bodies.rid(0x8A20043C))
    assert downloads(talk) == [("1 block and 1 type: FB1084 'MB_CLIENT' (SCL), UDT620 'Req'", "done", 1)]
    assert changes(talk)[1] == "delete FB1084, accepted"


def test_objects_without_a_block_load_nothing() -> None:
    talk = begun()
    create(talk, 1, 1, within(4, PlusObject(12, 3942, 0, 0, 0, [])))
    assert downloads(talk) == []
    assert changes(talk) == []


def test_a_whole_program_says_what_is_in_it() -> None:
    """Its texts and types too; it is named before the blocks, of which some are."""
    talk = begun()
    blocks = [block(0x8A0E0000 + number, 2574, f"d{number}", 5) for number in range(1, 9)]
    inside = [*blocks, OB, block(0x8A240001, 3932, "T", 0), PlusObject(0x9001, 4672, 0, 0, 0, [])]
    create(talk, 1, 1, PlusObject(3, 2520, 0, 0, 0, [*inside]))
    (text,) = [one[0] for one in downloads(talk)]
    assert text == (
        "the program, 1 text container, 9 blocks and 1 type: OB1 'Main' (SCL), DB1 'd1' (DB), DB2 'd2' (DB), DB3 'd3' (DB), "
        "DB4 'd4' (DB) and 5 more"
    )
    assert len(carried(talk)) == 10


def sequence(number: int, *objects: PlusObject) -> bytes:
    head = b"\1\0\1\0" if objects else b"\1\0\0" + bodies.rid(0x387)
    return head + b"".join([build_object(one) for one in objects]) + bodies.end(number)


def begin(talk: Talk, number: int, *objects: PlusObject) -> None:
    do(talk, number, BEGIN_SEQUENCE, sequence(number, *objects), b"\0\0\1" + bodies.rid(0x387))


def end(talk: Talk, number: int, answer: bytes = b"\0") -> None:
    do(talk, number, END_SEQUENCE, b"\0\0" + bodies.end(number), answer)


def test_what_a_sequence_loads_is_one_download() -> None:
    talk = begun()
    begin(talk, 1, PlusObject(0x7FFFC001, 1700, 0, 0, 0, []))
    begin(talk, 2)
    create(talk, 3, 3, OB)
    create(talk, 4, 3, DB)
    end(talk, 5)
    create(talk, 6, 1, HARDWARE)
    end(talk, 7)
    create(talk, 8, 3, DB)  # another load
    assert downloads(talk) == [
        ("OB1 'Main' (SCL), DB3 'tank' (DB), the hardware configuration", "done", 4),
        ("DB3 'tank' (DB)", "done", 1),
    ]
    first = talk.operations[0]
    assert (first.first_frame, first.last_frame) == (
        talk.transactions[2].request_frame,
        talk.transactions[6].response_frame,
    )
    assert first.octets == sum(
        [int(one.request_size) for one in talk.transactions[2:6] if one.function == CREATE_OBJECT]
    )
    assert carried(talk) == [("OB1", ""), ("DB3", ""), ("DB3", "")]
    assert len(changes(talk)) == 4


def test_objects_that_begin_a_sequence_may_be_blocks() -> None:
    talk = begun()
    begin(talk, 1, within(2, OB))
    end(talk, 2)
    assert downloads(talk) == [("OB1 'Main' (SCL)", "done", 2)]
    assert carried(talk) == [("OB1", "")]


def test_without_a_sequence_a_load_lasts_as_long_as_its_session() -> None:
    talk = begun()
    log_in(talk)
    create(talk, 2, 3, OB)
    create(talk, 3, 3, DB)
    do(talk, 4, DELETE_OBJECT, bodies.delete_object(0x387), b"\0" + bodies.rid(0x387))
    create(talk, 5, 3, DB)
    assert downloads(talk) == [("OB1 'Main' (SCL), DB3 'tank' (DB)", "done", 2), ("DB3 'tank' (DB)", "done", 1)]


@pytest.mark.parametrize(
    ("answers", "ending", "result", "missing"),
    [
        ((b"\0\0", DENIED), b"\0", "failed", ["", "transfer refused"]),
        ((DENIED, DENIED), b"\0", "refused", ["transfer refused"] * 2),
        ((b"\0\0", b"\0\0"), DENIED, "failed", ["transfer failed"] * 2),
        ((b"\0\0", b"\0\0"), b"", "unfinished", ["transfer unfinished"] * 2),
    ],
)
def test_what_becomes_of_a_load(answers: tuple[bytes, bytes], ending: bytes, result: str, missing: list[str]) -> None:
    """By what becomes of each of its requests, and of the end of its sequence, whose answer may stay away."""
    talk = begun()
    begin(talk, 1)
    for number, (one, answer) in enumerate(zip((OB, DB), answers, strict=True), 2):
        talk.ask(
            framed(asked(number, CREATE_OBJECT, body=bodies.create_object(3, NOTHING, one, integrity_id=number)), 3)
        )
        talk.tell(framed(told(number, CREATE_OBJECT, answer + bodies.end(9)), 3))
    talk.ask(framed(asked(4, END_SEQUENCE, body=b"\0\0" + bodies.end(4)), 3))
    if ending:
        talk.tell(framed(told(4, END_SEQUENCE, ending + bodies.end(9)), 3))
    assert [one[1] for one in downloads(talk)] == [result]
    assert [one[1] for one in carried(talk)] == missing


def test_a_request_of_a_load_that_nobody_answers() -> None:
    talk = begun()
    create(talk, 1, 3, OB)
    talk.ask(framed(asked(2, CREATE_OBJECT, body=bodies.create_object(3, NOTHING, DB, integrity_id=2)), 3))
    assert downloads(talk) == [("OB1 'Main' (SCL), DB3 'tank' (DB)", "unfinished", 2)]
    assert carried(talk) == [("OB1", ""), ("DB3", "transfer unfinished")]
    assert changes(talk) == ["load OB1 'Main' (SCL), accepted", "load DB3 'tank' (DB), not answered"]


def test_a_sequence_that_does_not_end_loads_nothing_for_sure() -> None:
    talk = begun()
    begin(talk, 1)
    create(talk, 2, 3, OB)
    assert downloads(talk) == [("OB1 'Main' (SCL)", "unfinished", 1)]
    assert carried(talk) == [("OB1", "transfer unfinished")]


def test_what_was_loaded_is_called_consistent() -> None:
    """The flag belongs to the load; alone, taken back or refused it is none."""
    talk = begun()
    flag = bodies.set_variable(2, [2458], Value(0, BOOL, True))
    do(talk, 1, SET_VARIABLE, flag)
    do(talk, 2, SET_VARIABLE, bodies.set_variable(2, [2458], Value(0, BOOL, False)))
    create(talk, 3, 1, HARDWARE)
    do(talk, 4, SET_VARIABLE, bodies.set_variable(2, [2458], Value(0, BOOL, False)))
    do(talk, 5, SET_VARIABLE, flag, DENIED)
    do(talk, 6, SET_VARIABLE, flag)
    do(talk, 7, SET_VARIABLE, flag)
    assert downloads(talk) == [("the hardware configuration, consistent", "done", 3)]


@pytest.mark.parametrize("attribute", [2533, 2580, 2544, 4578])
@pytest.mark.parametrize("several", [False, True])
def test_code_that_is_written_into_a_block_is_a_load(attribute: int, several: bool) -> None:
    """Also after values were written and reported; values alone are none."""
    talk = begun()
    code = Value(0, BLOB, Blob(0, b"code"))
    level = VariableAddress(0, 0x8A0E0003, 2550, [1])
    for number, area in enumerate((level, VariableAddress(0, 81, 3736, [1])), 1):
        do(talk, number, SET_MULTI_VARIABLES, bodies.set_multi([(area, Value(0, UINT, 1))]), b"\0\0\0")
    if several:
        pairs = [(level, Value(0, UINT, 1)), (VariableAddress(0, 0x8A120007, attribute, []), code)]
        do(talk, 3, SET_MULTI_VARIABLES, bodies.set_multi(pairs), b"\0\0\0")
    else:
        do(talk, 3, SET_VARIABLE, bodies.set_variable(0x8A120007, [attribute], code))
    (found,) = downloads(talk)
    assert found[0].startswith("FB7 (")
    assert len(changes(talk)) == 1


@pytest.mark.parametrize(("object_id", "name"), [(3, "the program"), (2, "the hardware configuration")])
def test_a_program_that_is_deleted(object_id: int, name: str) -> None:
    for answer, result in ((b"\0", "done"), (DENIED, "refused")):
        talk = begun()
        do(talk, 1, DELETE_OBJECT, bodies.delete_object(object_id), answer + bodies.rid(object_id))
        talk.close()
        assert [(one.kind, one.subject, one.result) for one in talk.operations if one.kind == kinds.DELETE] == [
            ("delete", name, result)
        ]
        assert changes(talk)[0].startswith(f"delete {name}, ")


def test_a_request_that_was_kept_in_part_leaves_the_others_whole() -> None:
    long = block(0x8A0E0004, 2574, "archive", 5)
    long.elements.append(Attribute(2580, Value(0, BLOB, Blob(0, bytes(MAX_PDU)))))
    talk = begun()
    begin(talk, 1)
    data = asked(2, CREATE_OBJECT, body=bodies.create_object(3, NOTHING, within(1, DB, long), integrity_id=2))
    for at in range(0, len(data), 60_000):
        talk.ask(framed(data[at : at + 60_000], 3, trailer=at + 60_000 >= len(data)))
    talk.tell(framed(told(2, CREATE_OBJECT, b"\0\0" + bodies.end(9)), 3))
    create(talk, 3, 3, OB)
    end(talk, 4)
    talk.close()
    (operation,) = [one for one in talk.operations if one.kind == kinds.DOWNLOAD]
    assert operation.dropped > 0
    assert operation.octets > MAX_PDU
    assert [(label, not missing) for label, missing in carried(talk)] == [("DB3", True), ("DB4", False), ("OB1", True)]


def test_a_shared_capture(corpus: Path) -> None:
    """A whole program in one object, in the root of an S7-1200."""
    found = dissect.blocks(corpus / "turn3" / "plus_program_download.pcapng")
    labels = {block.label for block in found if not block.label.startswith("UDT")}
    assert labels == {"OB1", "FB1084", "FB1085", *[f"DB{number}" for number in (1, 2, 3, 5, 6, 16, 17, 333, 334)]}
    assert len(found) == 22
    assert all([block.complete for block in found])
    assert {block.language for block in found if block.label.startswith("FB")} == {"SCL"}


def test_the_blocks_of_a_load_are_in_json() -> None:
    """Of S7comm-plus, where one operation carries many; a deletion carries none."""
    talk = begun()
    begin(talk, 1)
    create(talk, 2, 1, within(3, OB, DB))
    create(talk, 3, 3, block(0x8A24026C, 3932, "Req", 0))
    end(talk, 4)
    do(talk, 5, DELETE_OBJECT, bodies.delete_object(0x8A0E0003), b"\0" + bodies.rid(0x8A0E0003))
    talk.close()
    told_ = [json.loads(operation_json(one, Clock(), Places([], False))) for one in talk.operations]
    assert [(one["kind"], one.get("blocks")) for one in told_] == [
        ("download", ["OB1", "DB3", "UDT620"]),
        ("delete", None),
    ]
