"""Round trips: source → binary → dump → binary."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect import scd
from dissect.scd.dictionary import Dictionary
from dissect.scd.dump import dump_json, dump_toml
from dissect.scd.loading import load_octets
from dissect.scd.source import parse_json, parse_toml

PLANT = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
EVERYTHING = r"""
[dictionary]
name = "all \"of\" it \\"
version = "2"
time_scale = "tai"
[errors]
"-5" = "нет объекта"
[envelope]
crc = {poly=0x8005, init=0xFFFF, refin=true, refout=true, covers="data"}
fields = [
 {role="src", type="sca"}, {role="dst", type="sca"}, {role="const", bits=8, value=0x55},
 {role="kind", bits=6}, {role="response", bits=1}, {role="abort", bits=1},
 {role="size", type="size", counts="rest"}, {role="index", type="uint16", big=true}, {role="sub", type="uint8"},
 {role="err", type="err"}, {role="data"}, {role="crc", type="crc"}]
kinds = [{value=2, service="read"}, {value=1, service="write"}, {value=16, service="pdo"}]
[[type]]
index = 0x60
name = "name_t"
base = "string"
size = 10
[[object]]
index = 0x2000
name = "r"
default = nan
type = "float64"
[[object]]
index = 0x2001
name = "n.a"
type = "name_t"
default = "Насос"
[[object]]
index = 0x2002
name = "times"
class = "RECORD"
fields = [{name="t", type="nettime", default="2015-10-18T00:00:36 TAI"}, {name="i", type="interval", default=[-1, -5]},
 {name="m", type="mac", default="00:1B:44:11:3A:B7"}, {name="a", type="ip", default="192.168.100.1", access="ro"},
 {name="b", type="block", size=2, default="00 ff", mappable=false}, {reserved=0}, {reserved=5, fixed=3},
 {name="q", type="bool", texts={0="нет", 1="да"}}]
values = {q = true}
[[object]]
index = 0x2003
name = "null"
class = "NULL"
[[object]]
index = 0x2004
name = "big"
type = "uint64"
high = 9.5
scale = -0.1
shift = 3
unit = "°C"
"""


@pytest.mark.parametrize("source", [PLANT.read_text("utf-8"), EVERYTHING], ids=["plant", "all"])
def test_source_binary_dump_binary(source: str) -> None:
    octets = parse_toml(source).octets
    loaded = load_octets(octets)
    assert loaded.octets == octets
    assert parse_toml(dump_toml(loaded)).octets == octets
    assert parse_json(dump_json(loaded)).octets == octets
    assert dump_toml(parse_toml(dump_toml(loaded))) == dump_toml(loaded)


def test_values_are_what_was_written() -> None:
    od = load_octets(parse_toml(EVERYTHING).octets)
    times = od[0x2002]
    assert [str(field.default) for field in times] == [
        "8", "2015-10-18T00:00:36.000000000 TAI", "-PT1.000000005S", "00:1B:44:11:3A:B7", "192.168.100.1", "b'\\x00\\xff'",
        "True",
    ]  # fmt: skip
    assert times["q"].desc(True) == "да"
    assert (od.variable("big").phys(10), od.variable("big").unit) == (2.0, "°C")
    assert (od.errors[-5], od.errors[0], od.time_scale) == ("нет объекта", "good", "tai")
    assert od.variable("n.a").default == "Насос"


NAMES = st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "S"]), min_size=1, max_size=12)


@given(NAMES, st.text(max_size=10), st.integers(0, 2**32 - 1), st.floats(allow_infinity=False))
def test_any_name_and_value_comes_back(name: str, text: str, number: int, real: float) -> None:
    tables = {
        "dictionary": {"name": name, "version": text},
        "object": [
            {"index": 0x2000, "name": name, "type": "uint32", "default": number},
            {"index": 0x2001, "name": f"{name}2", "type": "string", "default": text.rstrip("\0")},
            {"index": 0x2002, "name": f"{name}3", "type": "float64", "default": "nan" if math.isnan(real) else real},
        ],
    }
    od: Dictionary = parse_json(json.dumps(tables))
    assert parse_toml(dump_toml(od)).octets == od.octets == load_octets(od.octets).octets


def test_the_example_is_what_the_docs_say() -> None:
    assert len(scd.compile(PLANT)) == 24


def test_mappings_that_no_map_can_say_are_written_in_hexadecimal() -> None:
    """A PDO that is off keeps the entries it has; an address that is also a name would mean something else."""
    text = (
        '[dictionary]\nname="t"\n[[object]]\nindex=0x6000\nname="a"\ntype="uint8"\n'
        '[[object]]\nindex=0x1a00\nname="off"\nclass="ARRAY"\ntype="uint64"\nused=0\nvalues=[0x0008000000006000]\n'
        '[[object]]\nindex=0x1a01\nname="narrow"\nclass="ARRAY"\ntype="uint32"\nused=1\ncount=3\nvalues=[0x60000008]\n'
    )
    od = parse_toml(text)
    told = dump_toml(od)
    assert "values = [0x0008000000006000]" in told
    assert "values = [0x60000008]" in told
    assert parse_toml(told).octets == parse_json(dump_json(od)).octets == od.octets
