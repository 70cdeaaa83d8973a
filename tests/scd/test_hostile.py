"""Dictionaries made to break something: `DictionaryError` with the place, little memory, and never another exception.

Files cut at each octet, single damaged octets and records are in test_binary; here is what is made on purpose, and made-up
dictionaries with all that can be done to them (`benchmarks.scd_fuzz` runs the same for as long as one likes).
"""

from __future__ import annotations

import json
import struct
import tomllib
import tracemalloc
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.scd_damage import nested, sealed
from benchmarks.scd_fuzz import main, run_case
from dissect import scd
from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.dump import dump_json, dump_tables, dump_toml
from dissect.scd.errors import DictionaryError, Error, shown
from dissect.scd.loading import load_octets
from dissect.scd.service import decode_named, encode_named
from dissect.scd.source import parse_json, parse_toml
from dissect.wire.config.hostile import MAX_DEPTH, long_key_line
from tests.cases import each
from tests.growth import assert_growth
from tests.scd.test_dump import EVERYTHING

PLANT: Final = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
HEAD: Final = '[dictionary]\nname = "t"\n'
OD: Final = parse_toml(EVERYTHING)
PLANT_OD: Final = scd.compile(PLANT)
FILE: Final = OD.octets
OBJECT: Final = HEAD + '[[object]]\nindex = 0x2000\nname = "x"\n'


def refused(octets: bytes) -> DictionaryError:
    with pytest.raises(DictionaryError) as caught:
        load_octets(octets, "x.scd")
    assert caught.value.where
    assert caught.value.path == "x.scd"
    return caught.value


def toml_error(text: str) -> DictionaryError:
    with pytest.raises(DictionaryError) as caught:
        parse_toml(text, "x.toml").octets  # noqa: B018 - it is made when it is asked for
    assert caught.value.path == "x.toml"
    assert len(str(caught.value)) < 1000
    return caught.value


# The header


@pytest.mark.parametrize(
    ("form", "at", "wrong", "where"),
    [
        ("B", 8, (0, 2, 255), "byte 8"),
        ("<H", 10, (0, 63, 65, 0xFFFF), "byte 10"),
        ("<I", 12, (0, 64, len(FILE) - 1, len(FILE) + 1, 2**32 - 1), "byte 12"),
        ("<I", 16, (0, zlib.crc32(FILE[64:]) ^ 1), "byte 16"),
        ("12s", 20, (b"\1" + bytes(11), bytes(11) + b"\1"), "byte 20"),
        ("32s", 32, (bytes(32), FILE[33:64] + b"\0"), "byte 32"),
    ],
)
def test_every_field_of_the_header(form: str, at: int, wrong: tuple[object, ...], where: str) -> None:
    for value in wrong:
        octets = bytearray(FILE)
        struct.pack_into(form, octets, at, value)
        assert refused(bytes(octets)).where == f"header, {where}"


@each("bit", range(8 * 64))
def test_every_bit_of_the_header(bit: int) -> None:
    """Only the minor version may be another one; what a later one adds is not there, so the rest is as it was."""
    octets = bytearray(FILE)
    octets[bit // 8] ^= 1 << bit % 8
    if bit // 8 == 9 and bit % 8:  # version 1 is known, and has a field that is not there
        assert load_octets(bytes(octets)).octets == FILE
    else:
        refused(bytes(octets))


def test_a_file_larger_than_any_is_not_read(tmp_path: Path) -> None:
    for name in ("large.scd", "large.toml", "large.json"):
        path = tmp_path / name
        with path.open("wb") as stream:
            stream.write(FILE)
            stream.truncate(1 << 40)
        tracemalloc.start()
        with pytest.raises(DictionaryError, match="67108864"):
            scd.load(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 1 << 20


# The body

#: Heads of MessagePack that promise four milliards of what follows, or a quarter, or 65535.
CLAIMS: Final = (
    b"\xdd\xff\xff\xff\xff", b"\xdc\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xda\xff\xff", b"\xc6\xff\xff\xff\xff",
    b"\xc5\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xde\xff\xff", b"\xc9\xff\xff\xff\xff\1", b"\xdd\x3f\xff\xff\xff",
)  # fmt: skip


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: str(claim.hex()))
def test_counts_of_what_is_not_there_allocate_nothing(claim: bytes) -> None:
    """At every place of the body, with what was there after it and with nothing."""
    body = FILE[64:]
    files = [sealed(body[:at] + claim + rest) for at in range(0, len(body), 3) for rest in (b"", body[at:])]
    tracemalloc.start()
    for octets in files:
        refused(octets)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2 << 20


@pytest.mark.parametrize("opener", [b"\x91", b"\x81\xa1a", b"\xdc\x00\x01", b"\xdd\x00\x00\x00\x01"])
@pytest.mark.parametrize("depth", [10, 500, 1000, 100_000])
def test_nesting_without_end(opener: bytes, depth: int) -> None:
    """In the place of the body, of a record, of a value, and of a field that only a later version has."""
    content = opener * depth + b"\xc0"
    records = msgspec.msgpack.decode(FILE[64:])
    added = b"\x99" + FILE[65:] + content
    for body in (content, b"\x98\xa1a\xa0\xa3utc" + content, b"\x98\xa1a\xa0\xa3utc\x90\x90" + content, added):
        refused(sealed(body))
    records[5][0][10] = nested(min(depth, 400))
    assert refused(sealed(msgspec.msgpack.encode(records))).where.startswith("body $[5][0][10]")


def text_places() -> list[int]:
    """Return where each text of the body begins."""
    words = ("all", "tai", "нет объекта", "name_t", "times", "да", "°C", "read", "src", "rw")
    return [FILE.index(word.encode(), 64) - 64 for word in words]


@each("at", text_places())
@each("octet", [0x80, 0xC0, 0xED, 0xFF])
def test_texts_that_are_no_utf8(at: int, octet: int) -> None:
    body = FILE[64:]
    error = refused(sealed(body[:at] + bytes([octet]) + body[at + 1 :]))
    assert error.where.startswith("body")


CYCLES: Final[dict[str, tuple[list[Any], list[Any], str]]] = {
    "a struct of itself": ([], [[0x40, "a", [["f", 0x40, 0, None, "", None, None, None]]]], "R73"),
    "two of each other": (
        [],
        [[0x40, "a", [["f", 0x41, 0, None, "", None, None, None]]], [0x41, "b", [["f", 0x40, 0, None, "", None, None, None]]]],
        "R73",
    ),
    "a static type in its own place": ([[0x60, "a", 0x60, 8]], [], "R66"),
    "a type that nobody defines": ([], [[0x40, "a", [["f", 0x61, 0, None, "", None, None, None]]]], "R72"),
}  # fmt: skip


@pytest.mark.requirement("R73")
@pytest.mark.parametrize("name", CYCLES)
def test_types_made_of_each_other(name: str) -> None:
    types, structs, rule = CYCLES[name]
    error = refused(sealed(msgspec.msgpack.encode(["t", "", "utc", types, structs, [], None, []])))
    assert error.rule == rule


@pytest.mark.requirement("R57")
@pytest.mark.parametrize("kind", [3, 4, 5])
@pytest.mark.parametrize(("first", "second"), [(0, 0), (1, 0), (0, -1), (0, 0x10000), (0, 2**63)])
def test_indices_that_do_not_ascend(kind: int, first: int, second: int) -> None:
    bases: dict[int, list[Any]] = {
        3: [0x60, "", 3, 5],
        4: [0x40, "", [["f", 1, 0, None, "", None, None, None]]],
        5: [0x2000, 7, "", 1, 0, "rw", False, True, 0, 0, [], [], None],
    }
    rows = []
    for number, shift in enumerate((first, second)):
        row = list(bases[kind])
        row[0] = row[0] + shift if 0 <= shift < 2 else shift
        row[2 if kind == 5 else 1] = f"name {number}"
        rows.append(row)
    records: list[Any] = ["t", "", "utc", [], [], [], None, []]
    records[kind] = rows
    error = refused(sealed(msgspec.msgpack.encode(records)))
    assert error.rule == "R57"


@pytest.mark.parametrize(
    ("at", "value", "rule"),
    [
        ((5, 1, 10), [None], "C36"),
        ((4,), [[0x41, "s", [["named", 0, 3, None, "", None, None, None]]]], "R31"),
        ((4,), [[0x41, "s", [["", 0, -3, 0, "", None, None, None]]]], "R31"),
        ((5, 4, 12), ["", 1.0, -0.0, None, None, [[1, "x"]]], "C36"),
    ],
    ids=["a default that says nothing", "a name of nothing", "less than no bits", "a shift of minus nothing"],
)
def test_what_no_source_writes_is_refused(at: tuple[int, ...], value: Any, rule: str) -> None:
    """It would be dumped as something else."""
    records = msgspec.msgpack.decode(FILE[64:])
    content = records
    for key in at[:-1]:
        content = content[key]
    content[at[-1]] = value
    assert refused(sealed(msgspec.msgpack.encode(records))).rule == rule


# Sources


@each("depth", [MAX_DEPTH + 1, 100, 400, 600, 950, 990, 100_000])
@each("key", ["index", "name", "fields", "default", "texts", "access", "mandatory", "devices", "low"])
def test_a_source_that_nests_without_end(depth: int, key: str) -> None:
    """Depths near the limit of Python's own recursion are where a second walk would fail that the parser did not."""
    deep = "[" * depth + "]" * depth
    tables = "{" + '"a":{' * depth + "}" * depth + "}"
    for content in (deep, tables):
        with pytest.raises(DictionaryError):
            parse_json(
                f'{{"dictionary": {{"name": "t"}}, "object": [{{"index": 8192, "name": "x", "{key}": {content}}}]}}'
            )
    toml_error(f"{OBJECT}{key} = {deep}\n")
    toml_error(f"{OBJECT}{key} = {'{a=' * depth}1{'}' * depth}\n")


@pytest.mark.parametrize("parts", [MAX_DEPTH + 1, 1000, 50_000])
@pytest.mark.parametrize("part", ["a", '"a b"', "'й'", '"."'])
def test_a_key_of_many_parts_is_refused_before_it_is_read(parts: int, part: str) -> None:
    """tomllib takes memory by the square of them."""
    text = f"{OBJECT}{' . '.join([part] * parts)} = 1\n"
    tracemalloc.start()
    error = toml_error(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 << 20
    assert (error.line, "parts" in error.detail) == (6, True)


def test_looking_for_such_a_key_does_not_grow_faster_than_the_text() -> None:
    for form in ("a", ".", "a.", '"', "'", "a ", "\t", "a-"):
        few, many = (f"{OBJECT}unit = {form * size}\n{'a' * size}" for size in (5_000, 20_000))
        if form != "a.":
            assert long_key_line(few) == 0
        assert_growth(partial(long_key_line, few), partial(long_key_line, many), 8)  # 16 by the square


HUGE: Final = {
    "digits": "9" * 100_000,
    "hex": "0x" + "f" * 100_000,
    "65 bits": "0x1" + "0" * 16,
    "low": "-0x8" + "0" * 15 + "1",
}


@each("key", ["index", "name", "size", "default", "low", "scale", "count", "type", "mandatory", "other"])
@each("form", ["digits", "hex", "65 bits"])
def test_numbers_that_no_field_holds(form: str, key: str) -> None:
    text = OBJECT.replace("index = 0x2000\n", "" if key == "index" else "index = 0x2000\n")
    text = text.replace('name = "x"\n', "" if key == "name" else 'name = "x"\n')
    error = toml_error(f"{text}{key} = {HUGE[form]}\n")
    assert error.line
    written = {"digits": HUGE["digits"], "hex": int(HUGE["hex"], 16) if key == "x" else 2**70, "65 bits": 2**64}[form]
    for value in (str(written), json.dumps(str(written)), json.dumps(HUGE[form])):
        if key in {"name", "other"} or (key == "default" and value.startswith('"')):
            continue
        with pytest.raises(DictionaryError):
            parse_json(
                f'{{"dictionary": {{"name": "t"}}, "object": [{{"index": 8192, "name": "x", "{key}": {value}}}]}}'
            )


@pytest.mark.parametrize(
    "number", ["0x" + "f" * 5000, "9" * 5000, str(2**64), str(-(2**63) - 1), "1.5", "", "x", "\ud800"], ids=range(8)
)
def test_texts_given_by_numbers_that_are_none(number: str) -> None:
    for tables in (
        {"errors": {number: "x"}},
        {"object": [{"index": 8192, "name": "x", "type": "uint8", "texts": {number: "x"}}]},
        {
            "object": [
                {"index": 8192, "name": "x", "type": "uint8", "class": "ARRAY", "count": 2, "values": {number: 1}}
            ]
        },
        {
            "object": [{"index": 8192, "name": "x", "type": "uint8"}],
            "pdo": [{"dir": "T", "number": 1, "map": [f"x.{number}"]}],
        },
    ):
        with pytest.raises(DictionaryError) as caught:
            parse_json(json.dumps({"dictionary": {"name": "t"}, **tables}))
        str(caught.value).encode()


@pytest.mark.parametrize("text", ["name = 1\nname = 2\n", "[a]\n[a]\n", "a.b = 1\na.b.c = 2\n", "a = {b=1, b=2}\n"])
def test_keys_that_are_there_twice(text: str) -> None:
    assert toml_error(f"{OBJECT}{text}").line in {6, 7}


@pytest.mark.requirement("R93")
@pytest.mark.parametrize("devices", ["[0, 1, 0]", f"[{'3, ' * 100_000}]"])
def test_a_template_is_one_device_once(devices: str) -> None:
    """So that a source of some size makes at most eight times as much."""
    template = '[[object]]\nindex = 0x6000\nname = "{device}"\ntype = "bool"\ndevice = "p"\n'
    assert "already" in toml_error(f'{HEAD}{template}[[instance]]\nof = "p"\ndevices = {devices}\n').detail
    again = "".join(f'[[instance]]\nof = "p"\ndevices = [{number}]\n' for number in (1, 2, 1))
    assert "already" in toml_error(f"{HEAD}{template}{again}").detail


#: What stands in the place of each key of a source that has them all.
WRONG: Final[tuple[Any, ...]] = (
    None, True, -1, 0, 3, 70000, 2**64, 10**400, 0.5, float("nan"), float("inf"), "", "x", "0x" + "f" * 5000, "\0", "\ud800",
    "\u202e", "x" * 70000, [], [1], [[]], [{}], {}, {"x": 1}, {"": {}}, nested(30),
)  # fmt: skip


def places(content: Any) -> list[tuple[Any, Any]]:
    keys = range(len(content)) if isinstance(content, list) else list(content) if isinstance(content, dict) else []
    return [pair for key in keys for pair in ((content, key), *places(content[key]))]


@pytest.mark.parametrize("source", ["plant", "everything"])
def test_a_wrong_value_for_every_key(source: str) -> None:
    """Either it is refused, or it makes a dictionary that comes back from its file and from its dump."""
    tables = tomllib.loads(PLANT.read_text("utf-8")) if source == "plant" else json.loads(json.dumps(dump_tables(OD)))
    octets = parse_json(json.dumps(tables)).octets
    taken = Counter[str]()
    for number, (content, key) in enumerate(places(tables)):
        kept = content[key]
        for wrong in WRONG[number % 2 :: 2]:
            content[key] = wrong
            text = json.dumps(tables)
            try:
                found = parse_json(text, "x.json")
            except DictionaryError as error:
                told = (bool(error.where), error.path, len(str(error).encode()) < 2000)
                taken["refused" if told == (True, "x.json", True) else str(error)] += 1
            else:
                assert load_octets(found.octets).octets == found.octets
                taken["accepted"] += 1
        content[key] = kept
    assert taken.keys() == {"refused", "accepted"}
    assert taken["refused"] > 10 * taken["accepted"]
    assert parse_json(json.dumps(tables)).octets == octets


@pytest.mark.parametrize("bits", [-1, 0, 65, 2**40, 2**62])
def test_a_width_that_no_type_has_is_refused_before_a_value_is_tried(bits: int) -> None:
    text = f'[[type]]\nindex = 0x60\nname = "t"\nbase = "int"\nbits = {bits}\n'
    error = toml_error(f'{OBJECT}type = "t"\ndefault = 0\n{text}')
    assert (error.rule, error.line) == ("R34, R37", 12)


def test_the_widest_constants_come_back() -> None:
    """All 64 bits of a fixed value, of a limit, of a number with a text."""
    text = OBJECT + (
        'class = "RECORD"\nfields = [{reserved=64, fixed=0xffffffffffffffff}, {name="a", type="uint64", '
        "high=0xffffffffffffffff, texts={0xffffffffffffffff='x'}}, "
        "{name='b', type='int64', low=-9223372036854775808}]\n"
    )
    od = parse_toml(text)
    assert od[0x2000].fields[0].fixed == 2**64 - 1
    assert parse_toml(dump_toml(od)).octets == parse_json(dump_json(od)).octets == od.octets


def test_defaults_of_some_elements_come_back() -> None:
    od = parse_toml(OBJECT + 'class = "ARRAY"\ntype = "uint8"\ncount = 4\nvalues = {2 = 7, 4 = 9}\n')
    assert [variable.default for variable in od[0x2000].fields] == [None, 7, None, 9]
    assert parse_toml(dump_toml(od)).octets == parse_json(dump_json(od)).octets == od.octets
    assert "R62" in str(toml_error(OBJECT + 'class = "ARRAY"\ntype = "uint8"\ncount = 4\nvalues = {0 = 7}\n'))


def test_reading_a_source_does_not_grow_faster_than_the_source() -> None:
    """Lines of tables, missing values, names: each was once looked up from the beginning."""

    def made(size: int) -> str:
        objects = "".join(f'[[object]]\nindex = {0x2000 + at}\nname = "o{at}"\ntype = "uint8"\n' for at in range(size))
        gaps = ", ".join(["{reserved=1}"] * size)
        return f'{HEAD}{objects}[[object]]\nindex = 0x9000\nname = "r"\nclass = "RECORD"\nfields = [{gaps}]\n'

    def read(text: str) -> None:
        with pytest.raises(DictionaryError, match="1 to 254 are possible"):
            parse_toml(text)

    few, many = made(300), made(1200)
    assert_growth(partial(read, few), partial(read, many), 8)  # 16 by the square


@pytest.mark.requirement("R64")
def test_nothing_in_the_place_of_a_mapping_is_no_pdo() -> None:
    od = parse_toml(OBJECT.replace("0x2000", "0x1A00") + 'class = "NULL"\n')
    assert (list(od.tpdo), load_octets(od.octets).octets) == ([], od.octets)
    with pytest.raises(Error, match="E_INDEX"):
        od.with_mapping(0x1A00, [])


# Sentences about somebody's data


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (5, "5"),
        ("Насос", "'Насос'"),
        (10**5000, "a number of 16610 bits"),
        ([10**5000], "a list that cannot be shown"),
        (nested(5000), "a list that cannot be shown"),
        ("x" * 101, f"'{'x' * 100}'... (101 in all)"),
        (list(range(100)), f"{str(list(range(100)))[:100]}..."),
    ],
    ids=["number", "text", "huge", "huge inside", "deep", "long", "many"],
)
def test_what_is_shown_of_it(value: object, text: str) -> None:
    assert shown(value) == text


@pytest.mark.parametrize(
    "value",
    [10**5000, -(10**5000), [10**5000, 0], (0, 10**5000), "9" * 5000, nested(3000)],
    ids=["number", "less than nothing", "seconds", "nanoseconds", "digits", "arrays"],
)
def test_values_that_cannot_be_shown_are_refused_all_the_same(value: object) -> None:
    od = scd.compile(PLANT)
    for variable in (row for obj in od for row in obj):
        if variable.type.name == "string" and isinstance(value, str) and variable.bits == 0:
            continue
        with pytest.raises(Error):
            variable.encode(value)


@pytest.mark.parametrize("key", ["0x2000:01", "0x2000:001", "0x2000.0x1", "0x2000:0X01"])
def test_a_sub_index_may_have_zeros_in_front(key: str) -> None:
    """2000h:01 is how the models write it."""
    od = parse_toml(OBJECT + 'class = "ARRAY"\ntype = "uint8"\ncount = 9\n')
    assert od.variable(key).address == (0x2000, 1)


NAMES: Final = (
    st.text(max_size=20)
    | st.from_regex(r"0[xX][0-9a-fA-F]{1,5}([:.](0[xX])?[0-9a-fA-F]{0,5})?", fullmatch=True)
    | st.from_regex(r"[RTrt](PDO\s*)?[0-9]{0,6}", fullmatch=True)
    | st.sampled_from(
        ["Насос 1.", ".run", "Насос 1.run", "pump_t", "pump_t.run", "Пороги давления.2", "Пороги давления.count"]
    )
)


@given(NAMES, st.binary(max_size=9), st.integers() | st.text(max_size=3))
def test_any_name_is_known_or_refused(name: str, octets: bytes, value: int | str) -> None:
    codec = Codec(PLANT_OD)
    objects = codec.objects(name)
    calls: list[Callable[[], object]] = [
        lambda: PLANT_OD[name], lambda: PLANT_OD.variable(name), lambda: PLANT_OD.type(name), lambda: PLANT_OD.pdo(name),
        lambda: codec.decode(name, octets), lambda: codec.decode_type(name, octets),
        lambda: codec.decode_object(name, octets), lambda: codec.decode_value(name, octets),
        lambda: codec.encode_value(name, value), lambda: codec.encode(name, {name: value}),
        lambda: codec.encode("T1", {name: value}, partial=True), lambda: codec.encode_type("pump_t", {name: value}),
        lambda: objects.__setitem__(name, value), lambda: decode_named(codec, octets, objects),
        lambda: encode_named(codec, objects), lambda: PLANT_OD[0x6000][value],
    ]  # fmt: skip
    for call in calls:
        with suppress(Error):
            call()
    assert name not in objects or objects[name] in objects.values()


# Made-up dictionaries and everything that can be done with them


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_made_up_dictionaries_in_and_out(seed: int) -> None:
    """Round trips, values there and back, payloads and messages of any octets, damaged files and sources."""
    run_case(seed, 0, Counter())


def test_the_long_run_tells_what_it_did(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--seed", "7", "--case", "3"]) == 0
    told = capsys.readouterr().out
    assert "seed 7" in told
    assert "1 cases, seed 7: " in told
    assert "0 other exceptions" in told


def test_the_long_run_fails_when_something_else_comes_out(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(od: Dictionary) -> str:
        raise KeyError(od.name)

    monkeypatch.setattr("benchmarks.scd_fuzz.dump_toml", broken)
    assert main(["--seed", "7", "--case", "3"]) == 1
    told = capsys.readouterr().out
    assert "1 other exceptions" in told
    assert "KeyError" in told
