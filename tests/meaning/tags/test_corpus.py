"""The twelve real files of the shared corpus: what each of them holds, counted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

from dissect.meaning.tags.loading import read_tags

#: File: (tags, blocks and tables without a place, blocks of sources, code page).
ROWS: Final = {
    "openness_v16_tag_table.xml": (15, 0, 0, ""),
    "openness_v17_standard_db.xml": (16, 0, 1, ""),
    "step7_v5_german_export.asc": (0, 37, 0, ""),
    "step7_v5_mixer.asc": (145, 27, 0, ""),
    "step7_v5_udt_cp1251.awl": (0, 0, 1, "cp1251"),
    "tia_v14_plctags.xml": (210, 0, 0, ""),
    "tia_v15_plctags.xlsx": (689, 0, 0, ""),
    "tia_v15_plctags_cp1251.sdf": (689, 0, 0, "cp1251"),
}
#: The name of a member that says where it is.
_NAMED: Final = re.compile(r"_at_(\d+)(?:_(\d+))?$")


@pytest.fixture
def tags(corpus: Path) -> Path:
    folder = corpus / "tags"
    if not folder.is_dir():
        pytest.skip("the corpus has no files of tags")
    return folder


@pytest.mark.parametrize("name", ROWS)
def test_every_row_of_a_real_file_is_counted(name: str, tags: Path) -> None:
    found = read_tags([tags / name])
    file = found.files[0]
    read = (len(found.tags), file.skipped["blocks"] + file.skipped["variable tables"], len(file.blocks), file.encoding)
    assert read == ROWS[name]
    assert [str(problem) for problem in found.problems if problem.severity != "note"] == []


def test_the_sheet_and_the_sdf_of_one_project_say_the_same(tags: Path) -> None:
    sheet = read_tags([tags / "tia_v15_plctags.xlsx"])
    sdf = read_tags([tags / "tia_v15_plctags_cp1251.sdf"], encoding="cp1251")
    rows = [[(tag.name, tag.address, tag.type, tag.comment) for tag in found.tags] for found in (sheet, sdf)]
    assert rows[0] == rows[1]
    assert rows[0][0] == ("SW1_1", "I0.0", "BOOL", "Датчик наличия кары")


def test_members_that_are_named_after_their_addresses_are_there(tags: Path) -> None:
    path = tags / "step7_v54_udt_and_db_names_are_offsets.awl"
    found = read_tags([path], numbers={"Data block 1": 1})
    checked = 0
    for tag in found.tags:
        _, parent, *inner = tag.name.split(".")
        base = 36 if parent == "struct_at_36_0" else 0
        named = _NAMED.search((inner or [parent])[-1])
        assert named is not None
        assert divmod(int(tag.start), 8) == (base + int(named[1]), int(named[2] or 0)), tag.name
        checked += 1
    assert checked == 46  # 30 members and two structures of 16, of which the first is among them


def test_a_source_agrees_with_the_address_table_in_its_comment(tags: Path) -> None:
    path = tags / "tia_standard_with_offsets.scl"
    rows = re.findall(r"^//\s+([\d.]+)\s+(\w+)\s+(\w+)\s", path.read_text(encoding="utf-8"), re.MULTILINE)
    table = {name: (float(place), type_.upper()) for place, type_, name in rows}
    found = read_tags([path], numbers={"Read_only": 1, "Data_block_2": 2})
    seen = {1: 0, 2: 0}
    for tag in found.tags:
        place, type_ = table[tag.name.rpartition(".")[2]]
        assert (int(tag.start) // 8 + int(tag.start) % 8 / 10, tag.type) == (place, type_), tag.name
        seen[int(tag.db)] += 1
    assert seen == {1: 22, 2: 22}


def test_a_source_of_scl_takes_its_numbers_from_the_symbol_table_of_its_project(tags: Path) -> None:
    found = read_tags([tags / "step7_v5_mixer.asc", tags / "step7_v5_queue_type_and_db.scl"])
    assert [str(problem) for problem in found.problems if problem.severity == "error"] == []
    assert found.sizes[1] == 86
    where = {tag.name: tag.address for tag in found.tags}
    assert where["Queue.qFIFO[1].silica_kg"] == "DB1.DBD26"
    assert where["Queue.lastDestination"] == "DB1.DBW84"


def test_a_block_exported_without_offsets_is_laid_out(tags: Path) -> None:
    found = read_tags([tags / "openness_v17_standard_db.xml"])
    assert [(tag.name, tag.address) for tag in found.tags[:2]] == [
        ("HMI.sensor", "DB2.DBX0.0"),
        ("HMI.machinePosition", "DB2.DBD2"),
    ]


def test_members_with_quoted_names_are_read(tags: Path) -> None:
    found = read_tags([tags / "tia_standard_quoted_names.db"], numbers={"conveer_status": 4})
    assert found.tags[0].name == "Conveer_status.01_step"
    assert [int(tag.start) // 8 for tag in found.tags[:4]] == [0, 2, 4, 6]
