"""Blocks as files: safe names, the manifest and back, texts, what is no folder of blocks."""

from __future__ import annotations

import json
import re
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from captures.craft.mc7 import DB2, OB1
from dissect.engine.program.carved import CarvedBlock, block_of, plus_block
from dissect.meaning.report.words import Places
from dissect.output.carve.folder import (
    MANIFEST,
    FolderError,
    Plan,
    file_name,
    occupied,
    read_block,
    read_folder,
    write_folder,
)
from dissect.output.carve.listing import BlockList
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.value_tables import BLOB, SPARSE_ARRAY
from dissect.protocols.s7plus.values import Blob, Value
from dissect.wire.text import Clock

PLUS = Path(__file__).parents[3] / "captures" / "crafted" / "plus-plant.pcapng"
SAFE = re.compile(r"[0-9]{4}-[A-Za-z0-9]+(-(download|upload))?\.(mc7|s7p|bin)")


def written(folder: Path, blocks: list[CarvedBlock], most: int = 1 << 20) -> dict[str, object]:
    told = BlockList(blocks, 0, Places([], False), Clock()).as_dict()
    write_folder(folder, Plan(blocks, {}, most), told)
    return told


@given(kind=st.text(max_size=40), number=st.integers(-1, 1 << 40), name=st.text(max_size=40))
def test_no_name_from_the_wire_reaches_a_path(kind: str, number: int, name: str) -> None:
    block = CarvedBlock(kind, number, b"", "s7comm")
    block.title = name
    assert SAFE.fullmatch(file_name(1, block))
    assert SAFE.fullmatch(file_name(1, block_of(b"", name)))


def test_a_folder_is_read_back(tmp_path: Path) -> None:
    blocks = [block_of(OB1), block_of(DB2), block_of(b"raw", "DB 7, passive"), block_of(b"text", "/_N_MPF_DIR/_N_1")]
    blocks[1].missing, blocks[1].behind_gap = "a part", b"behind"
    written(tmp_path / "new" / "folder", blocks)
    again = read_folder(tmp_path / "new" / "folder")
    assert [(one.label, one.octets, one.missing) for one in again] == [
        ("OB1", OB1, ""), ("DB2", DB2, "a part"), ("DB7", b"raw", ""), ("/_N_MPF_DIR/_N_1", b"text", ""),
    ]  # fmt: skip
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == [
        "0001-OB1.mc7", "0002-DB2-incomplete.mc7", "0002-DB2-incomplete.mc7.behind-gap", "0003-DB7.bin",
        "0004-file.bin", MANIFEST,
    ]  # fmt: skip
    assert [one.behind_gap for one in again] == [b"", b"behind", b"", b""]
    (tmp_path / "new" / "folder" / MANIFEST).unlink()
    assert [one.label for one in read_folder(tmp_path / "new" / "folder")] == ["OB1", "DB2"]


def test_blocks_of_s7comm_plus_are_read_back(tmp_path: Path) -> None:
    blocks = dissect.blocks(PLUS)
    told = written(tmp_path, blocks)
    (again,) = read_folder(tmp_path)
    assert again.parts() == blocks[0].parts()
    assert told["blocks"][0]["file"] == "0001-OB1-download.s7p"  # type: ignore[index]


def plus(*networks: bytes) -> CarvedBlock:
    """A block of S7comm-plus with a body of these networks, compressed."""
    bodies = [(number, Blob(0, b"\0\0\0\x01" + zlib.compress(text))) for number, text in enumerate(networks, 1)]
    code = Attribute(2533, Value(SPARSE_ARRAY, BLOB, bodies))
    block = plus_block(build_object(PlusObject(0x8A320001, 2647, 0, 0, 0, [code])))
    assert block is not None
    return block


def test_texts_of_a_block_lie_beside_it(tmp_path: Path) -> None:
    block = plus(b"<a/>", b"<bc/>")
    plan = Plan([block], {})
    assert {name: octets for name, (_, octets) in plan.files.items() if name.endswith(".xml")} == {
        "0001-OB1.body-1.xml": b"<a/>", "0001-OB1.body-2.xml": b"<bc/>",
    }  # fmt: skip
    small = Plan([block], {}, most=4)
    assert (len(small.files), small.left_out) == (2, {0: 1})
    told = BlockList([block], 0, Places([], False), Clock()).as_dict()
    write_folder(tmp_path, small, told)
    assert told["blocks"][0]["texts"] == ["0001-OB1.body-1.xml"]  # type: ignore[index]
    assert told["blocks"][0]["texts_left_out"] == 1  # type: ignore[index]
    assert (tmp_path / "0001-OB1.body-1.xml").read_bytes() == b"<a/>"


def test_without_a_manifest_every_block_counts(tmp_path: Path) -> None:
    (tmp_path / "b.mc7").write_bytes(DB2)
    (tmp_path / "a.anything").write_bytes(OB1[:-5])
    (tmp_path / "readme.txt").write_text("no block", encoding="utf-8")
    first, second = read_folder(tmp_path)
    assert (first.label, first.missing) == ("OB1", "135 of 140 bytes")
    assert (second.label, second.missing) == ("DB2", "")
    assert read_block(tmp_path / "readme.txt") is None


def test_what_is_no_folder_of_blocks(tmp_path: Path) -> None:
    with pytest.raises(FolderError, match="no block in this folder"):
        read_folder(tmp_path)
    for text, why in (
        ("{", "not a manifest"), ("[]", "not a manifest"), ('{"schema": "other", "blocks": []}', "expected schema"),
        ('{"schema": "s7dissect.blocks/1", "blocks": [{"file": "../../etc/passwd"}]}', "is not a file of this folder"),
        ('{"schema": "s7dissect.blocks/1", "blocks": [{"file": ".."}]}', "is not a file of this folder"),
        ('{"schema": "s7dissect.blocks/1", "blocks": [7]}', "not a manifest"),
    ):  # fmt: skip
        (tmp_path / MANIFEST).write_text(text, encoding="utf-8")
        with pytest.raises(FolderError, match=why) as told:
            read_folder(tmp_path)
        assert "\n" not in str(told.value)


def test_what_is_there_is_known(tmp_path: Path) -> None:
    assert occupied(tmp_path, ["a"]) == []
    (tmp_path / "a").symlink_to(tmp_path / "nowhere")
    (tmp_path / MANIFEST).write_text("", encoding="utf-8")
    assert occupied(tmp_path, ["a", "b"]) == [MANIFEST, "a"]


def test_a_manifest_is_json_without_control_characters(tmp_path: Path) -> None:
    written(tmp_path, [block_of(b"x", "evil\x1b[31m\n../\u202e")])
    text = (tmp_path / MANIFEST).read_text(encoding="ascii")
    assert json.loads(text)["blocks"][0]["title"] == "evil\x1b[31m\n../\u202e"
    assert "\x1b" not in text
