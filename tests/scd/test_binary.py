"""R13, R16-R18: the compiled file to the octet, its identity, and files that are damaged or hostile."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect import scd
from dissect.scd import binary
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import DictionaryError
from dissect.scd.loading import load_octets
from dissect.scd.records import Body
from dissect.scd.source import parse_toml
from tests.cases import each

PLANT = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
SMALL = """
[dictionary]
name = "Насосная"
[[type]]
index = 0x60
name = "uint12"
base = "uint"
bits = 12
[[type]]
index = 0x40
name = "pump_t"
fields = [{name="run", type="bool"}, {reserved=7, fixed=1}, {name="p", type="uint12", default=5, unit="bar"}]
[[object]]
index = 0x6000
name = "Насос"
class = "RECORD"
type = "pump_t"
[[object]]
index = 0x6001
name = "Имя"
type = "string"
size = 12
default = "Насос"
"""
OD = parse_toml(SMALL)
FILE = OD.octets


def sealed(octets: bytes, identity: bytes = bytes(32), minor: int = 0) -> bytes:
    """A file around any body, its size and CRC right."""
    return (
        binary._HEADER.pack(binary.MAGIC, 1, minor, 64, 64 + len(octets), zlib.crc32(octets), bytes(12), identity)
        + octets
    )


def error_of(octets: bytes) -> DictionaryError:
    with pytest.raises(DictionaryError) as caught:
        load_octets(octets, "x.scd")
    assert caught.value.path == "x.scd"
    return caught.value


@pytest.mark.requirement("R16")
def test_the_header_to_the_octet() -> None:
    assert FILE[:8] == bytes.fromhex("89 53 43 44 0D 0A 1A 0A")
    assert FILE[8:12] == bytes.fromhex("01 00 40 00")
    assert struct.unpack_from("<II", FILE, 12) == (len(FILE), zlib.crc32(FILE[64:]))
    assert FILE[20:32] == bytes(12)
    assert FILE[32:64] == OD.wire_id
    assert OD.file_id == sha256(FILE).digest()
    assert msgspec.msgpack.decode(FILE[64:])[:3] == ["Насосная", "", "utc"]


@pytest.mark.requirement("R13", "R17", "R18")
def test_loading_gives_the_same(tmp_path: Path) -> None:
    plant = scd.compile(PLANT)
    plant.save(tmp_path / "plant.scd")
    loaded = scd.load(tmp_path / "plant.scd")
    assert (loaded.octets, loaded.wire_id, loaded.file_id) == (plant.octets, plant.wire_id, plant.file_id)
    assert loaded.variable("Насос 1.run").address == (0x6000, 1)
    assert scd.load(PLANT).octets == plant.octets


def test_the_suffix_of_a_source_is_that_in_capitals_too(tmp_path: Path) -> None:
    (tmp_path / "PLANT.TOML").write_bytes(PLANT.read_bytes())
    (tmp_path / "SMALL.JSON").write_text('{"dictionary": {"name": "small"}}')
    assert scd.load(tmp_path / "PLANT.TOML").octets == scd.load(PLANT).octets
    assert scd.load(tmp_path / "SMALL.JSON").name == scd.compile(tmp_path / "SMALL.JSON").name == "small"


def test_a_file_of_another_kind_is_told_by_what_it_may_be(tmp_path: Path) -> None:
    (tmp_path / "plant.txt").write_bytes(PLANT.read_bytes())
    with pytest.raises(DictionaryError) as text:
        scd.load(tmp_path / "plant.txt")
    assert "nor, by its suffix, a source: .toml, .json, .eds, .dcf, .xdd, .xdc" in str(text.value)
    (tmp_path / "plant.scd").write_bytes(FILE)
    with pytest.raises(DictionaryError) as compiled:
        scd.compile(tmp_path / "plant.scd")
    assert (
        str(compiled.value)
        == f"{tmp_path / 'plant.scd'}: file: is compiled already; `s7dissect scd dump` makes a source of it"
    )


@pytest.mark.requirement("R18")
def test_the_same_octets_whatever_the_hash_seed() -> None:
    """Dictionaries are identical at all participants."""
    code = f"from dissect import scd; print(scd.compile({str(PLANT)!r}).octets.hex())"
    found = {
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=PLANT.parents[2],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
        ).stdout.strip()
        for seed in ("0", "1", "4711")
    }  # fmt: skip
    assert found == {scd.compile(PLANT).octets.hex()}


@pytest.mark.requirement("R18")
@pytest.mark.parametrize(
    ("old", "new", "wire"),
    [
        ("Насосная", "Станция", False),
        ('name = "Имя"', 'name = "Другое"', False),
        ('unit="bar"', 'unit="kPa"', False),
        ("bits = 12", "bits = 13", True),
        ("default=5", "default=6", True),
        ("fixed=1", "fixed=2", True),
        ("size = 12", "size = 13", True),
        ("0x6001", "0x6002", True),
    ],
)
def test_wire_id_is_of_what_decides_decoding(old: str, new: str, wire: bool) -> None:
    """C5."""
    other = parse_toml(SMALL.replace(old, new))
    assert (other.wire_id != OD.wire_id, other.file_id != OD.file_id) == (wire, True)


@each("cut", range(len(FILE)))
def test_cut_at_every_octet(cut: int) -> None:
    assert error_of(FILE[:cut]).where


@each("cut", range(1, len(FILE) - 64))
def test_a_body_cut_at_every_octet_with_all_sums_right(cut: int) -> None:
    body = FILE[64:][:-cut]
    error = error_of(sealed(body, OD.wire_id))
    assert error.where == f"body, byte {64 + len(body)}"


@pytest.mark.parametrize(
    ("place", "where"),
    [(0, "byte 0"), (4, "byte 0"), (8, "byte 8"), (10, "byte 10"), (12, "byte 12"), (16, "byte 16"), (20, "byte 20"),
     (32, "byte 32"), (64, "byte 16"), (len(FILE) - 1, "byte 16")],
)  # fmt: skip
def test_one_octet_differs(place: int, where: str) -> None:
    damaged = bytearray(FILE)
    damaged[place] ^= 0x40
    assert error_of(bytes(damaged)).where == f"header, {where}"


def test_text_mode_damage_is_named() -> None:
    assert "text-mode" in str(error_of(FILE.replace(b"\r\n", b"\n")))


def test_trailing_octets() -> None:
    assert error_of(FILE + b"\0").where == "header, byte 12"
    assert "malformed" in str(error_of(sealed(FILE[64:] + b"\0", OD.wire_id)))


def test_a_later_minor_version_may_add_fields() -> None:
    body = [*msgspec.msgpack.decode(FILE[64:]), "utf-8", "new"]
    octets = msgspec.msgpack.encode(body)
    assert load_octets(sealed(octets, OD.wire_id, minor=2)).wire_id == OD.wire_id
    assert "one form" in str(error_of(sealed(octets, OD.wire_id)))


def test_too_large(tmp_path: Path) -> None:
    with (tmp_path / "large.scd").open("wb") as stream:
        stream.truncate((64 << 20) + 1)
    with pytest.raises(DictionaryError, match="67108864"):
        scd.load(tmp_path / "large.scd")


def changed(change: Callable[[list[Any]], object]) -> bytes:
    """A file whose records are changed, its sums and its wire id right."""
    records = msgspec.msgpack.decode(FILE[64:])
    change(records)
    octets = msgspec.msgpack.encode(records)
    try:
        identity = binary.wire_id(msgspec.msgpack.decode(octets, type=Body))
    except (msgspec.DecodeError, UnicodeDecodeError):
        identity = bytes(32)
    return sealed(octets, identity)


def test_changing_nothing_is_fine() -> None:
    assert load_octets(changed(lambda _: None)).octets == FILE


@pytest.mark.requirement("R57", "R62", "R71", "R72", "R73")
@pytest.mark.parametrize(
    ("change", "where", "rule"),
    [
        pytest.param(lambda r: r[5].reverse(), "object 0x6000", "R57", id="descending"),
        pytest.param(lambda r: r[5].append(r[5][1]), "object 0x6001", "R57", id="twice"),
        pytest.param(lambda r: r[5][0].__setitem__(0, 70000), "object 70000", "R57", id="index"),
        pytest.param(lambda r: r[5][0].__setitem__(0, -1), "object -1", "R57", id="negative"),
        pytest.param(lambda r: r[5][1].__setitem__(2, "Насос"), "object 0x6001", "R71", id="names"),
        pytest.param(lambda r: r[5][1].__setitem__(2, "\x1b[0m"), "object 0x6001", "R71", id="control"),
        pytest.param(lambda r: r[5][0].__setitem__(3, 0x41), "object 0x6000", "R72", id="no-type"),
        pytest.param(lambda r: r[5][1].__setitem__(3, 0x40), "object 0x6001", "R73, C34", id="struct-as-variable"),
        pytest.param(lambda r: r[4][0][2][0].__setitem__(1, 0x40), "type 0x0040", "R73", id="cycle"),
        pytest.param(lambda r: r[3][0].__setitem__(2, 77), "type 0x0060", "R66", id="kind"),
        pytest.param(lambda r: r[3][0].__setitem__(3, 2**40), "type 0x0060", "R34, R37", id="wide"),
        pytest.param(lambda r: r[5][1].__setitem__(1, 8) or r[5][1].__setitem__(8, 2**60), "object 0x6001", "R62, R69",
                     id="huge-array"),
        pytest.param(lambda r: r[5][1].__setitem__(4, 2**62), "object 0x6001", "R42, R53", id="huge-string"),
        pytest.param(lambda r: r[4][0][2][1].__setitem__(2, 2**62), "type 0x0040", "R31", id="huge-gap"),
        pytest.param(lambda r: r[5][1].__setitem__(10, [b"\xff"]), "object 0x6001", "R72", id="default-utf8"),
        pytest.param(lambda r: r[5][1].__setitem__(10, [5]), "object 0x6001", "R72", id="default-kind"),
        pytest.param(lambda r: r[4][0][2].extend([[f"f{n}", 5, 0, None, "", None, None, None] for n in range(255)]),
                     "type 0x0040", "R60, R62", id="fields"),
    ],
)  # fmt: skip
def test_hostile_records(change: Callable[[list[Any]], object], where: str, rule: str) -> None:
    error = error_of(changed(change))
    assert error.where.startswith(where)
    assert error.rule == rule


def test_records_of_other_types() -> None:
    assert error_of(changed(lambda records: records[5][0].__setitem__(2, 5))).where == "body $[5][0][2]"
    assert error_of(changed(lambda records: records[5][0].__setitem__(1, 5))).where == "body $[5][0][1]"


@pytest.mark.requirement("R42", "R71")
def test_a_name_that_is_no_utf8() -> None:
    at = FILE.index("Насос".encode(), 100)
    octets = FILE[64:at] + b"\xff" + FILE[at + 1 :]
    error = error_of(sealed(octets, OD.wire_id))
    assert (error.where, error.rule) == (f"body, byte {at}", "R42")


def test_a_huge_count_allocates_nothing() -> None:
    """Under a limit of memory far below what the count asks for."""
    code = """
import resource
from dissect.scd import binary
from dissect.scd.errors import DictionaryError
resource.setrlimit(resource.RLIMIT_AS, (400 << 20, 400 << 20))
import zlib
for body in (b"\\xdd" + b"\\xff" * 4,
             b"\\x98\\xa1a\\xa0\\xa3utc\\xdd" + b"\\xff" * 4, b"\\x98\\xdb" + b"\\xff" * 4, b"\\x91" * 100000):
    head = binary._HEADER.pack(binary.MAGIC, 1, 0, 64, 64 + len(body), zlib.crc32(body), bytes(12), bytes(32))
    try:
        binary.parse_file(head + body)
    except DictionaryError as error:
        print("refused")
"""
    ran = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=PLANT.parents[2],
        env={"PYTHONPATH": ":".join(sys.path)},
    )  # fmt: skip
    assert ran.stdout.split() == ["refused"] * 4


@given(st.data())
@settings(max_examples=300)
def test_mutated_files_raise_nothing_else(data: st.DataObject) -> None:
    octets = bytearray(FILE[64:])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(octets) - 1))
        octets[at] = data.draw(st.integers(0, 255))
    try:
        identity = binary.wire_id(msgspec.msgpack.decode(octets, type=Body))
    except (msgspec.DecodeError, UnicodeDecodeError):
        identity = bytes(32)
    try:
        found = load_octets(sealed(bytes(octets), identity))
    except DictionaryError as error:
        assert error.where  # noqa: PT017 - the only kind of error is the point
    else:
        assert isinstance(found, Dictionary)
        assert found.octets[64:] == octets


@given(st.binary(max_size=200))
def test_any_octets(octets: bytes) -> None:
    for file in (octets, binary.MAGIC + octets, sealed(octets)):
        with pytest.raises(DictionaryError):
            load_octets(file)
