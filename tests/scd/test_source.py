"""R58-R76, R103-R106: sources that are right, and every rule broken once, told with its line and its name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect import scd
from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.dump import dump_toml
from dissect.scd.envelope import DEFAULT
from dissect.scd.envelope_rules import check_envelope
from dissect.scd.errors import DictionaryError, Error
from dissect.scd.loading import load_octets
from dissect.scd.model import StructType
from dissect.scd.source import parse_json, parse_toml

PLANT = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
HEAD = '[dictionary]\nname = "t"\n'
PUMP = """
[[type]]
index = 0x40
name = "pump_t"
fields = [{name="run", type="bool"}, {name="fault", type="bool"}, {reserved=6}, {name="speed", type="int16"}]
"""


def obj(more: str, index: int = 0x2000, name: str = "x") -> str:
    return f'[[object]]\nindex = {index}\nname = "{name}"\n{more}\n'


@pytest.fixture(scope="module")
def plant() -> Dictionary:
    return scd.compile(PLANT)


@pytest.mark.requirement("R56", "R58", "R61", "R62", "R71")
def test_objects_are_found_in_every_way(plant: Dictionary) -> None:
    run = plant[0x6000][1]
    assert plant["Насос 1.run"] is run
    assert plant.variable("0x6000:1") is plant.variable("0x6000.1") is plant.variable((0x6000, 1)) is run
    pump = plant["Насос 1"]
    assert pump is plant[0x6000]
    assert pump["run"] is run
    assert plant.variable("0x6001") is plant.variable("Давление 1") is plant[0x6001][0]
    assert (run.type.name, run.access, run.mandatory, run.bits) == ("bool", "rw", True, 1)
    assert plant[0x6000]["fault"].access == "ro"
    assert plant[0x2001][2].default == 250
    assert (plant["Насос 1.speed"] in plant, 0x6000 in plant, 0x6002 in plant) == (False, True, False)


@pytest.mark.requirement("R62")
@pytest.mark.parametrize(
    ("key", "code"), [("0x6002", "E_INDEX"), ("0x6000:9", "E_SUB"), ("0x6000:3", "E_SUB"), ("Насос 9", "E_INDEX")]
)
def test_what_is_not_there(plant: Dictionary, key: str, code: str) -> None:
    """A reserved field keeps its number and cannot be addressed."""
    with pytest.raises(Error) as caught:
        plant.variable(key)
    assert caught.value.code == code


@pytest.mark.requirement("R60", "R69", "R70")
def test_sub_index_0_is_no_data(plant: Dictionary) -> None:
    """C32."""
    for index, count, bits in ((0x2001, 3, 48), (0x6000, 4, 24)):
        head = plant[index][0]
        assert (head.type.name, head.default, head.access) == ("uint8", count, "const")
        assert head not in plant[index].fields
        assert plant[index].bits == bits


@pytest.mark.requirement("R59", "R67")
def test_structure_of_a_struct_is_readable(plant: Dictionary) -> None:
    """Number of fields, then their type codes as UNSIGNED16."""
    struct = plant.type("pump_t")
    assert isinstance(struct, StructType)
    assert struct.readout() == (4, 1, 1, 0, 3)
    assert [variable.default for variable in plant[0x40]] == [4, 1, 1, 0, 3]
    assert [variable.type.name for variable in plant[0x40]] == ["uint8", *["uint16"] * 4]
    assert [field.offset for field in struct.fields] == [0, 1, 2, 8]


@pytest.mark.requirement("R66", "R87", "R90")
def test_a_static_type_is_only_a_reference(plant: Dictionary) -> None:
    for index in (1, 0x1B, 0x60, 0x403):
        assert list(plant[index]) == []
        assert plant[index].object_class == 5


@pytest.mark.requirement("R93", "R94", "R95")
def test_devices_are_instances(plant: Dictionary) -> None:
    assert plant[0x6800].name == "Насос 2"
    assert [pdo.device for pdo in plant.tpdo.values()] == [0, 0, 1, 1]
    assert plant.tpdo[65].local_number == 1
    assert [row.variable.index for row in plant.tpdo[65].map] == [0x6841, 0x6844, 0x6861]
    assert plant.tpdo[65].mapping.index == 0x1A40


@pytest.mark.requirement("R98", "R103", "R105", "R106")
def test_pdos_come_from_their_mapping_objects(plant: Dictionary) -> None:
    """C49: entry = index, sub, 0, offset, length."""
    pdo = plant.tpdo[2]
    assert [(row.variable.label, row.offset, row.bits) for row in pdo.map] == [
        ("Насос 1.run", 0, 1),
        ("Насос 1.fault", 1, 1),
        ("Давление 1", 4, 12),
        ("Насос 1.speed", 16, 16),
    ]
    assert (pdo.size, pdo.bits, pdo.name) == (4, 32, "Насос и давление 1")
    third = plant[0x1A01][3].default
    assert isinstance(third, int)
    assert third.to_bytes(8, "little") == bytes.fromhex("01 60 00 00 04 00 0C 00")
    assert (plant.tpdo[1].version, plant.tpdo[1].node) == (1, 0)
    assert plant.pdo("T1") is plant.pdo("TPDO 1") is plant.pdo("Состояние 1") is plant.tpdo[1]


@pytest.mark.requirement("R104")
def test_a_mapping_can_be_rewritten(plant: Dictionary) -> None:
    """An SDO write to 1A00h gives another PDO; the dictionary stays."""
    entry = 0x6041 | 16 << 48
    pdo = plant.with_mapping(0x1A00, [entry])
    assert [(row.variable.index, row.offset, row.bits) for row in pdo.map] == [(0x6041, 0, 16)]
    assert plant.with_mapping(0x1A00, []).map == ()
    assert len(plant.tpdo[1].map) == 3
    for wrong in ([entry, entry], [0x6041 | 8 << 48], [0x9999 | 8 << 48], [entry] * 9, [entry | 1 << 24]):
        with pytest.raises(Error, match="E_MAP"):
            plant.with_mapping(0x1A00, wrong)


def test_canopen_entries_follow_each_other() -> None:
    """C49: UNSIGNED32, a static type index is a gap."""
    od = parse_toml(
        HEAD + obj('type="uint8"') + obj('type="uint16"', 0x2001, "y")
        + '[[pdo]]\ndir="T"\nnumber=3\nentries="uint32"\nmap=["x", {reserved=4}, "y"]\n'
    )  # fmt: skip
    assert [(row.variable.name, row.offset, row.bits) for row in od.tpdo[3].map] == [("x", 0, 8), ("y", 12, 16)]
    assert od[0x1A02][1].default == 0x20000008


@pytest.mark.requirement("R74", "R75")
@pytest.mark.parametrize("access", ["rw", "wo", "ro", "const"])
def test_access(access: str) -> None:
    variable = parse_toml(HEAD + obj(f'type="uint8"\naccess="{access}"'))[0x2000][0]
    assert (variable.readable, variable.writable) == (access != "wo", access in {"rw", "wo"})


@pytest.mark.requirement("R63", "R64", "R65", "R68", "R69", "R70", "R72")
def test_classes() -> None:
    od = parse_toml(
        HEAD + PUMP + obj('class="NULL"') + obj('class="DOMAIN"', 0x2001, "d") + obj('class="VAR"\ntype="mac"', 0x2002, "v")
        + obj('class="ARRAY"\ntype="ip"\ncount=2', 0x2003, "a") + obj('class="RECORD"\ntype="pump_t"', 0x2004, "r")
    )  # fmt: skip
    assert [row.object_class for row in od] == [0, 2, 7, 8, 9]
    assert (list(od[0x2000]), od[0x2001][0].bits, od[0x2001][0].type.name) == ([], 0, "block")
    assert len(od[0x2003].fields) == 2
    assert od[0x2004].type is od.types[0x40]


WRONG = [
    ("R57", obj('type="uint8"') + obj('type="uint8"', name="y"), 8, "already"),
    ("R57", obj('type="uint8"', 0x10000), 3, "16 bits"),
    ("R71", obj('type="uint8"') + obj('type="uint8"', 0x2001), 9, "already"),
    ("R71", obj('type="uint8"', name=""), 3, "name"),
    ("R72", obj('type="nothing"'), 6, "no type"),
    ("R73, C34", PUMP + obj('class="ARRAY"\ntype="pump_t"\ncount=2'), 12, "no arrays of records"),
    ("R73, C34", PUMP + obj('type="pump_t"'), 11, "RECORD"),
    ("R73", PUMP + PUMP.replace("0x40", "0x41").replace("pump_t", "q").replace('"bool"', '"pump_t"'), 12, "records of"),
    ("R70, C34", obj('class="RECORD"\ntype="uint8"'), 7, "DEFSTRUCT"),
    ("", obj('type="uint8"\naccess="wr"'), 7, "not one of rw"),
    ("", obj('type="uint8"\nclas="VAR"'), 7, "no such key"),
    ("", obj('type="uint8"\nclass="VARIABLE"'), 7, "not one of"),
    ("R72", obj('type="uint8"\ndefault=256'), 7, "outside 0..255"),
    ("R72", obj('type="uint8"\nsize=2'), 3, "no size of its own"),
    ("R77", obj('type="uint8"', 0xC000), 3, "has no objects"),
    ("R77", obj('type="uint8"', 0x260), 3, "has no objects"),
    ("R90, R81", '[[type]]\nindex=0x80\nname="u"\nbase="uint"\nbits=3\n', 3, "DEFTYPE must be"),
    ("R34, R37", '[[type]]\nindex=0x60\nname="u"\nbase="uint"\nbits=65\n', 7, "1 to 64"),
    ("R55", '[[type]]\nindex=0x60\nname="int8"\nbase="uint"\nbits=3\n', 3, "of the text"),
    ("R66", '[[type]]\nindex=0x60\nname="u"\nbase="u"\n', 6, "not a kind"),
    ("R88, R89, R81", PUMP.replace("0x40", "0x60"), 4, "DEFSTRUCT must be"),
    ("R60, R62", PUMP.split("fields", maxsplit=1)[0] + "fields=[]\n", 4, "0 fields"),
    ("R31", PUMP.replace("reserved=6", "reserved=6, fixed=64"), 4, "does not fit"),
    ("R42, R53", PUMP.replace('type="int16"', 'type="string"'), 4, "needs its size"),
    ("R71", PUMP.replace('"fault"', '"run"'), 4, "twice"),
    ("R106", obj('type="uint8"', 0x1400), 3, "RECORD"),
    ("R106, C49", obj('class="ARRAY"\ntype="uint8"\ncount=1', 0x1A00), 3, "uint64 or uint32"),
    ("R103", obj('type="uint8"') + '[[pdo]]\ndir="T"\nnumber=1\nmap=["y"]\n', 10, "no object"),
    ("R95, C47", '[[pdo]]\ndir="T"\nnumber=513\nmap=[]\n', 5, "1 to 512"),
    ("R103", obj('type="uint8"\naccess="wo"') + '[[pdo]]\ndir="T"\nnumber=1\nmap=["x"]\n', 8, "cannot be read"),
    ("R103", obj('type="uint8"\naccess="ro"') + '[[pdo]]\ndir="R"\nnumber=1\nmap=["x"]\n', 8, "cannot be written"),
    ("R103", obj('type="uint8"\nmappable=false') + '[[pdo]]\ndir="T"\nnumber=1\nmap=["x"]\n', 8, "cannot be mapped"),
    ("R103", obj('type="string"') + '[[pdo]]\ndir="T"\nnumber=1\nmap=["x"]\n', 7, "whole bytes"),
    ("R93", obj('type="uint8"\ndevice="p"', 0x6000), 7, "no \\[\\[instance\\]\\]"),
    ("R93", obj('type="uint8"\ndevice="p"', 0x6000) + '[[instance]]\nof="p"\ndevices=[8]\n', 10, "not a device 0 to 7"),
    ("R93", '[[instance]]\nof="p"\ndevices=[1]\n', 4, "device = 'p'"),
    ("R52", '[errors]\n"-129"="x"\n', 3, "8 bits"),
    ("profile 3.3", '[envelope]\nfields=[{role="index", type="uint16"}]\n', 3, "role data"),
    ("profile 3.3", '[envelope]\nfields=[{role="data"}, {role="crc", type="crc"}]\n', 3, "belong together"),
    ("profile 3.3", '[envelope]\nfields=[{role="kind", bits=4}, {role="data"}]\n', 3, "whole byte"),
    ("C36", obj('type="uint8"\nlow=3\nhigh=2'), 3, "above the upper"),
]  # fmt: skip


@pytest.mark.requirement(
    "R31", "R34", "R37", "R42", "R52", "R53", "R55", "R57", "R60", "R62", "R66", "R70", "R71", "R72", "R73", "R77", "R81",
    "R88", "R89", "R90", "R93", "R95", "R103", "R106",
)  # fmt: skip
@pytest.mark.parametrize(
    ("rule", "text", "line", "said"),
    [pytest.param(*row, id=f"{row[0]}-{row[3]}-{number}") for number, row in enumerate(WRONG)],
)
def test_a_broken_rule_is_told_with_its_place(rule: str, text: str, line: int, said: str) -> None:
    with pytest.raises(DictionaryError, match=said) as caught:
        parse_toml(HEAD + text, "t.toml")
    assert (caught.value.rule, caught.value.line, caught.value.path) == (rule, line, "t.toml")
    assert str(caught.value).startswith(f"t.toml:{line}: ")


@pytest.mark.parametrize(
    ("text", "line"),
    [("[dictionary\n", 1), ("[dictionary]\nname=1\n", 2), ("x = 1\n", 1), ("[object]\n", 1), ("a = 1\na = 2\n", 2)],
)
def test_toml_that_is_none(text: str, line: int) -> None:
    with pytest.raises(DictionaryError) as caught:
        parse_toml(text, "t.toml")
    assert (caught.value.line, caught.value.path) == (line, "t.toml")


@pytest.mark.parametrize("text", ["", "[]", "{", '{"dictionary": {"name": "a", "name": "b"}}', "[" * 100000])
def test_json_that_is_none(text: str) -> None:
    with pytest.raises(DictionaryError):
        parse_json(text, "t.json")


@pytest.mark.requirement("R22", "R24", "R25")
def test_octets_of_a_value(plant: Dictionary) -> None:
    """C7, C56: N bits are the fewest octets that hold them; nothing is aligned unless it is written."""
    assert [
        (plant.variable(key).bits, plant.variable(key).size) for key in ("0x6000:1", "0x6001", "0x6044", "0x2003")
    ] == [
        (1, 1),
        (12, 2),
        (32, 4),
        (0, 0),
    ]
    packed = parse_toml(
        HEAD
        + obj(
            'class="RECORD"\nfields=[{name="a", type="bool"}, {name="b", type="mac"}, {reserved=0}, {name="c", type="bool"}]'
        )
    )[0x2000]
    assert ([field.offset for field in packed.fields], packed.bits, packed.size) == ([0, 1, 49, 49], 50, 7)


@pytest.mark.requirement("R31", "R32", "R33")
def test_reserved_bits_are_defined_or_any(plant: Dictionary) -> None:
    """A gap in a struct, its bits given with ``fixed`` or any."""
    od = parse_toml(HEAD + PUMP.replace("reserved=6", "reserved=6, fixed=63"))
    assert [(row.reserved, row.fixed) for row in od.types[0x40].fields[2:]] == [  # type: ignore[union-attr]
        (True, 63),
        (False, None),
    ]
    assert plant[0x6000].fields[2].fixed is None


@pytest.mark.requirement("R76")
def test_mandatory(plant: Dictionary) -> None:
    """C37."""
    assert [row.mandatory for row in plant if row.index in {0x1000, 0x1020, 0x6000, 0x6800}] == [
        True,
        False,
        True,
        True,
    ]


@pytest.mark.requirement("R5", "R72")
def test_a_user_extends_the_library_of_types(plant: Dictionary) -> None:
    """C15: widths the text has no index for are types of the dictionary."""
    kind = plant.type("uint12")
    assert (kind, plant[0x6001].type) == (plant.types[0x60], plant.types[0x60])
    with pytest.raises(Error, match="E_TYPE"):
        plant.type("uint13")


def test_the_default_envelope_keeps_the_rules() -> None:
    check_envelope(DEFAULT)
    assert sum(field.bits for field in DEFAULT.fields) == 8 * (10 + 2)


@pytest.mark.requirement("R103")
def test_overlong_pdo() -> None:
    """Offset and length are 16 bits, a PDO ends before bit 65535."""
    text = HEAD + obj('type="block"\nsize=5000') + obj('type="block"\nsize=5000', 0x2001, "y")
    with pytest.raises(DictionaryError, match="65535"):
        parse_toml(text + '[[pdo]]\ndir="T"\nnumber=1\nmap=["x", "y"]\n')


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
KEYS = st.sampled_from(
    [
        "index",
        "name",
        "class",
        "type",
        "access",
        "fields",
        "size",
        "default",
        "values",
        "count",
        "used",
        "map",
        "dir",
        "number",
        "base",
        "bits",
        "device",
        "of",
        "devices",
        "role",
        "texts",
        "scale",
        "low",
        "reserved",
        "fixed",
        "kinds",
        "crc",
        "var",
        "offset",
    ]
)
WORDS = st.sampled_from(
    ["uint8", "string", "VAR", "ARRAY", "RECORD", "rw", "T", "data", "x", "0x2000:1", "block", "mac"]
)
ROWS = st.dictionaries(
    KEYS, JSON | WORDS | st.integers(-1, 0x10001) | st.lists(st.dictionaries(KEYS, JSON | WORDS), max_size=2)
)


@given(
    st.dictionaries(
        st.sampled_from(["dictionary", "type", "object", "pdo", "instance", "envelope", "errors"]),
        st.lists(ROWS, max_size=3) | ROWS | JSON,
    )
)
def test_no_source_raises_anything_else(tables: dict[str, object]) -> None:
    tables.setdefault("dictionary", {"name": "x"})
    try:
        parse_json(json.dumps(tables))
    except DictionaryError as error:
        assert error.where  # noqa: PT017 - the only kind of error is the point


def errors_of_text(text: str) -> list[DictionaryError]:
    with pytest.raises(DictionaryError) as caught:
        parse_toml(HEAD + text, "t.toml")
    return [caught.value, *caught.value.others]


@pytest.mark.parametrize(("entries", "bits"), [("uint64", 40), ("uint32", 40)])
def test_a_gap_at_the_end_of_a_map_counts(entries: str, bits: int) -> None:
    text = obj('type="uint8"') + (
        f'[[pdo]]\ndir="T"\nnumber=1\nentries="{entries}"\nmap=[{{reserved=8}}, "x", {{reserved=8}}, {{reserved=16}}]\n'
    )
    od = parse_toml(HEAD + text)
    assert (od.tpdo[1].bits, [row.offset for row in od.tpdo[1].map]) == (bits, [8])
    assert Codec(od).encode("T1", {"x": 5}).hex() == "0005000000"
    assert parse_toml(dump_toml(od)).octets == load_octets(od.octets).octets == od.octets


def test_every_error_is_reported_at_once_with_the_line_of_its_key() -> None:
    text = (
        '[[type]]\nindex=0x60\nname="u9"\nbase="unit"\nbits=9\n'  # 3 to 7
        '[[object]]\nindex=0x2000\nnmae="x"\ntype="u9"\n'  # 8 to 11
        '[[object]]\nindex=0x2001\nname="y"\nclass="RECORD"\nfields=[\n'  # 12 to 16
        '  {name="a", type="int61"},\n  {name="b", type="bool", scael=2},\n]\n'  # 17, 18
        '[[object]]\nindex=0x2002\nname="z"\ntype="u9"\n'  # 20 to 23: of a type that is reported already
        '[[pdo]]\ndir="T"\nnumber=1\nmap=[\n  "y.a",\n  "zz",\n]\n'  # 24 to 30: y could not be read, zz is nothing
        '[[object]]\nindex=0x2003\nname="w"\ntype="int8"\ntexts={300 = "much"}\n'  # 31 to 35
    )
    found = [(error.line, error.detail.split(";")[0]) for error in errors_of_text(text)]
    assert [line for line, _ in found] == [6, 10, 17, 18, 29, 31]
    told = [str(error) for error in errors_of_text(text)]
    assert "'unit' is not a kind" in told[0]
    assert "close to it: 'uint" in told[0]
    assert "name is missing; 'nmae' is there" in told[1]
    assert "no type 'int61'; close to it: 'int64', 'int16'" in told[2]
    assert "scael: no such key here; close to it: 'scale'" in told[3]
    assert "no object 'zz'" in told[4]
    assert "'much' is for 300, outside -128..127" in told[5]


def test_a_json_source_reports_all_errors_too() -> None:
    with pytest.raises(DictionaryError) as caught:
        parse_json('{"dictionary": {"name": "a"}, "object": [{"index": 1}, {"index": 2}]}', "t.json")
    assert [caught.value, *caught.value.others] != [caught.value]
    assert caught.value.line == 0


@pytest.mark.requirement("R73")
def test_structs_in_a_cycle_are_records_of_records() -> None:
    one = '[[type]]\nindex=0x40\nname="a_t"\nfields=[{name="b", type="b_t"}]\n'
    other = '[[type]]\nindex=0x41\nname="b_t"\nfields=[{name="a", type="a_t"}]\n'
    own = '[[type]]\nindex=0x42\nname="c_t"\nfields=[{name="c", type="c_t"}]\n'
    found = errors_of_text(one + other + own)
    assert [(error.rule, error.line) for error in found] == [("R73", 6), ("R73", 10), ("R73", 14)]
    assert "b_t is not a simple type: no records of records" in found[0].detail


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("high=40000", "high 40000 is outside -32768..32767"),
        ("low=-40000", "low -40000 is outside"),
        ("texts={-32769='x'}", "is for -32769, outside"),
    ],
)
def test_limits_and_texts_of_values_that_no_variable_has(more: str, said: str) -> None:
    (error,) = errors_of_text(obj(f'type="int16"\n{more}'))
    assert said in error.detail
    assert (
        parse_toml(HEAD + obj('type="int16"\nlow=-32768\nhigh=32767\ntexts={32767="x"}'))[0x2000][0].traits.high
        == 32767
    )


def test_times_of_a_tai_dictionary_are_marked_and_taken_as_such() -> None:
    head = '[dictionary]\nname="t"\ntime_scale="tai"\n'
    text = head + obj('type="nettime"\ndefault="2015-10-18T00:00:36.5 TAI"')
    od = parse_toml(text)
    codec = Codec(od)
    octets = codec.encode_value("x", "2015-10-18T00:00:36 TAI")
    assert octets == Codec(parse_toml(HEAD + obj('type="nettime"'))).encode_value("x", "2015-10-18T00:00:36Z")
    value = codec.decode_value("x", octets).values[0x2000, 0]
    assert (str(value), str(od[0x2000][0].default)) == (
        "2015-10-18T00:00:36.000000000 TAI",
        "2015-10-18T00:00:36.500000000 TAI",
    )
    for scale, wrong in ((od, "2015-10-18T00:00:00Z"), (od, "2015-10-18T00:00:00+03:00"),
                         (parse_toml(HEAD + obj('type="nettime"')), "2015-10-18T00:00:00 TAI")):  # fmt: skip
        with pytest.raises(Error, match="E_VALUE"):
            Codec(scale).encode_value("x", wrong)


def test_strings_of_another_encoding() -> None:
    text = '[dictionary]\nname="t"\nencoding="cp1251"\n' + obj('type="string"\nsize=6\ndefault="Насос"')
    od = parse_toml(text)
    assert Codec(od).encode_value("x", "Насос") == b"\xcd\xe0\xf1\xee\xf1\0"
    assert Codec(od).decode_value("x", b"\xcd\xe0\xf1\xee\xf1\0").values == {(0x2000, 0): "Насос"}
    assert load_octets(od.octets).encoding == parse_toml(dump_toml(od)).encoding == "cp1251"
    assert parse_toml(dump_toml(od)).octets == od.octets
    utf8 = parse_toml(text.replace("cp1251", "utf-8").replace("size=6", "size=10"))
    assert (utf8.octets[9], od.octets[9]) == (0, 1)  # an old reader takes the one and refuses to guess at the other
    assert utf8.wire_id != od.wire_id
    with pytest.raises(Error, match="has no CP1251 form"):
        Codec(od).encode_value("x", "日")
    with pytest.raises(DictionaryError, match="'cp1250' is not one of utf-8, cp1251"):
        parse_toml(text.replace("cp1251", "cp1250"))
