"""What changed between two sets of blocks."""

from __future__ import annotations

import pytest

from captures.craft.mc7 import DB2, FC3, OB1, OB1_CHANGED
from dissect.engine.program.carved import CarvedBlock, block_of, plus_block
from dissect.engine.program.compare import BlockChange, compare, over_time
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.value_tables import BLOB
from dissect.protocols.s7plus.values import Blob, Value


def said(changes: list[BlockChange]) -> list[tuple[str, str, tuple[str, ...]]]:
    return [(change.state, change.block.label, change.parts) for change in changes]


def blocks(*octets: bytes) -> list[CarvedBlock]:
    return [block_of(each) for each in octets]


def renumbered(octets: bytes, number: int) -> bytes:
    return octets[:6] + number.to_bytes(2, "big") + octets[8:]


def test_the_same() -> None:
    assert compare(blocks(OB1, DB2), blocks(DB2, OB1)) == []
    assert over_time(blocks(OB1, DB2, OB1)) == []


def test_new_gone_changed() -> None:
    assert said(compare(blocks(OB1, DB2), blocks(OB1_CHANGED, FC3))) == [
        ("gone", "DB2", ()), ("changed", "OB1", ("code", "header")), ("new", "FC3", ()),
    ]  # fmt: skip


def test_a_block_under_another_number_is_moved() -> None:
    assert said(compare(blocks(OB1, FC3), blocks(OB1, renumbered(OB1, 35)))) == [
        ("gone", "FC3", ()),
        ("new", "OB35", ()),
    ]
    (gone, moved) = compare(blocks(DB2, FC3), blocks(renumbered(DB2, 9)))
    assert (gone.state, moved.state, moved.was.label if moved.was else "", moved.block.label) == (
        "gone", "moved", "DB2", "DB9",
    )  # fmt: skip


def test_what_a_header_says() -> None:
    later = OB1[:20] + b"\x38\xff" + OB1[22:-36] + b"huber\0\0\0" + OB1[-28:]
    (change,) = compare(blocks(OB1), blocks(later))
    assert change.parts == ("header",)
    assert change.facts == [
        ("author", "meier", "huber"),
        ("code time", "2023-09-13 08:30:00.000", "2023-12-13 08:30:00.000"),
    ]


def test_each_part() -> None:
    (change,) = compare(blocks(DB2), blocks(DB2[:36] + b"\0" + DB2[37:]))
    assert change.parts == ("values",)
    at = 36 + int.from_bytes(OB1[34:36], "big")
    (change,) = compare(blocks(OB1), blocks(OB1[: at + 8] + b"\x01" + OB1[at + 9 :]))
    assert change.parts == ("interface",)


def test_the_latest_whole_version_counts() -> None:
    cut = block_of(OB1_CHANGED[:90])
    cut.missing = "90 of 160 bytes"
    assert compare(blocks(OB1), [block_of(OB1), cut]) == []
    (change,) = compare(blocks(OB1), [cut])
    assert not change.comparable
    assert said(over_time(blocks(OB1, OB1_CHANGED))) == [("changed", "OB1", ("code", "header"))]


def plus(rid: int, **octets: bytes) -> CarvedBlock:
    """A block of S7comm-plus with blobs by the id of their attribute (``a2533``)."""
    attributes = [Attribute(int(id_[1:]), Value(0, BLOB, Blob(0, each))) for id_, each in octets.items()]
    block = plus_block(build_object(PlusObject(rid, 2574, 0, 0, 0, [*attributes])))
    assert block is not None
    return block


OB, DB = 0x8A320001, 0x8A0E0001


@pytest.mark.parametrize(
    ("rid", "id_", "part"),
    [
        (OB, "a2533", "code"), (OB, "a2580", "code"), (OB, "a2591", "code"), (OB, "a2586", "code"),
        (OB, "a2544", "interface"), (OB, "a2584", "header"), (OB, "a2453", "header"),
        (DB, "a2548", "values"), (DB, "a2550", "values"), (DB, "a4578", "interface"), (DB, "a2533", "header"),
    ],
)  # fmt: skip
def test_which_part_of_a_block_of_s7comm_plus_differs(rid: int, id_: str, part: str) -> None:
    """Constants, called blocks: code, though not in it. Values of a data block; comments of networks are no code."""
    (change,) = compare([plus(rid, **{id_: b"before"})], [plus(rid, **{id_: b"after it"})])
    assert change.parts == (part,)


def test_a_data_block_of_s7comm_plus_under_another_number_is_moved() -> None:
    (change,) = compare([plus(DB, a2548=bytes(9))], [plus(DB + 1, a2548=bytes(9))])
    assert (change.state, change.block.label) == ("moved", "DB2")
