"""Values written as texts."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect import scd
from dissect.scd.errors import Error
from dissect.scd.model import Variable
from dissect.scd.records import Traits
from dissect.scd.source import parse_toml
from dissect.scd.types import STANDARD
from dissect.scd.values import MAC, Interval, NetTime
from dissect.scd.written import parse_written, whole
from tests.cases import each
from tests.scd.test_dump import PLANT

ALL = """
[dictionary]
name = "all"
[[type]]
index = 0x60
name = "int12"
base = "int"
bits = 12
""" + "".join(
    f"[[object]]\nindex = {0x2000 + number}\nname = '{name}'\ntype = '{name}'\n"
    for number, name in enumerate(
        ("bool", "int8", "int12", "uint64", "float32", "float64", "string", "block", "nettime", "interval", "mac", "ip")
    )
)
OD = parse_toml(ALL)


@each(
    ("name", "text", "value"),
    [
        ("bool", "true", True),
        ("bool", "FALSE", False),
        ("bool", "1", True),
        ("bool", "0x0", False),
        ("int8", "-128", -128),
        ("int8", "0x80", -128),
        ("int8", " 0x7f ", 127),
        ("int8", "+5", 5),
        ("int8", "005", 5),
        ("int12", "0x800", -2048),
        ("int12", "-0x1", -1),
        ("uint64", "0xFFFFFFFFFFFFFFFF", 2**64 - 1),
        ("uint64", "1 000", 1000),
        ("float32", "0x3F800000", 1.0),
        ("float32", "-2.5", -2.5),
        ("float64", "0x3FF0000000000000", 1.0),
        ("string", " Насос ", " Насос "),
        ("string", "", ""),
        ("block", "0x01FF", b"\x01\xff"),
        ("block", "01 ff", b"\x01\xff"),
        ("block", "", b""),
        ("nettime", "2015-10-18T00:00:00.5Z", NetTime(1445126400, 500000000)),
        ("nettime", "-1, 5", NetTime(-1, 5)),
        ("nettime", "0x0000000500000001", NetTime(1, 5)),
        ("interval", "[-1, -500]", Interval(-1, -500)),
        ("interval", "1;2", Interval(1, 2)),
        ("mac", "00:1b:44:11:3a:b7", MAC("00:1B:44:11:3A:B7")),
        ("mac", "0x001B44113AB7", MAC("00:1B:44:11:3A:B7")),
        ("ip", "192.168.100.1", "192.168.100.1"),
        ("ip", "0xC0A86401", "192.168.100.1"),
    ],
)
def test_value(name: str, text: str, value: object) -> None:
    found = parse_written(text, OD.variable(name))
    assert (str(found) if name == "ip" else found) == value


def test_nan() -> None:
    found = parse_written("nan", OD.variable("float32"))
    assert isinstance(found, float)
    assert math.isnan(found)


@pytest.mark.parametrize(
    ("name", "text", "code", "told"),
    [
        ("bool", "yes", "E_VALUE", "'yes' is not a whole number"),
        ("bool", "2", "E_VALUE", "neither true nor false"),
        ("int8", "128", "E_RANGE", "outside"),
        ("int8", "0x100", "E_RANGE", "outside"),
        ("int8", "1e3", "E_VALUE", "not a whole number"),
        ("int8", "9" * 5000, "E_VALUE", "not a whole number"),
        ("uint64", "-1", "E_RANGE", "outside"),
        ("float32", "one", "E_VALUE", "is not a number"),
        ("float32", "inf", "E_RANGE", "infinity"),
        ("float32", "0x7F800000", "E_RANGE", "infinity"),
        ("float32", "0x100000000", "E_VALUE", "does not fit 32 bits"),
        ("block", "0x123", "E_VALUE", "not hexadecimal"),
        ("nettime", "yesterday", "E_VALUE", "yesterday"),
        ("nettime", "1,1000000000", "E_RANGE", "outside"),
        ("interval", "soon", "E_VALUE", "not an interval"),
        ("mac", "00:1B", "E_VALUE", "not a MAC"),
        ("mac", "0x1000000000000", "E_VALUE", "does not fit 48 bits"),
        ("ip", "1.2.3", "E_VALUE", "not an IP address"),
    ],
)
def test_what_is_no_value_is_told(name: str, text: str, code: str, told: str) -> None:
    with pytest.raises(Error) as error:
        parse_written(text, OD.variable(name))
    assert error.value.code == code
    assert told in str(error.value)
    assert len(str(error.value)) < 300


def test_what_the_dictionary_calls_a_value() -> None:
    mode = scd.compile(PLANT).variable("0x6061")
    assert (parse_written("автомат", mode), parse_written("8", mode), parse_written("0xFF", mode)) == (8, 8, -1)


@pytest.mark.parametrize("text", ["", "x", "0x", "--1", "1.0", "0b1", "١"])
def test_no_whole_number(text: str) -> None:
    with pytest.raises(ValueError, match="is not a whole number"):
        whole(text)


PRESSURE = Variable(
    0x6001, 0, "p", "p", STANDARD[6], 16, 0, "rw", False, True, None, None, Traits("кПа", 0.5, 10.0, texts=[(7, "hoch")])
)  # fmt: skip
SPEED = Variable(0x6002, 0, "n", "n", STANDARD[3], 16, 0, "rw", False, True, None, None, Traits("об/мин"))


@pytest.mark.parametrize(
    ("variable", "text", "raw"),
    [
        (PRESSURE, "1374 кПа", 2728),
        (PRESSURE, "1374.5кПа", 2729),
        (PRESSURE, "1 374 кПа", 2728),
        (PRESSURE, "phys:1374", 2728),
        (PRESSURE, "phys:1.374e3 кПа", 2728),
        (PRESSURE, "raw:1374", 1374),
        (PRESSURE, "0x55e", 1374),
        (PRESSURE, "hoch", 7),
        (SPEED, "-1500", -1500),
        (SPEED, "-1500 об/мин", -1500),
        (SPEED, "raw:0xfa24", -1500),
    ],
)
def test_raw_and_physical_values(variable: Variable, text: str, raw: int) -> None:
    assert parse_written(text, variable) == raw


@pytest.mark.parametrize(
    ("variable", "text", "said"),
    [
        (PRESSURE, "1374", "may be the raw or the physical value: write raw:1374 or '1374 кПа'"),
        (PRESSURE, "1374.3 кПа", "lies between two values that can be sent, 1374 and 1374.5 кПа"),
        (PRESSURE, "1374 бар", "is in 'бар', the unit is 'кПа'"),
        (PRESSURE, "9 кПа", "E_RANGE"),
        (PRESSURE, "phys:1e999 кПа", "E_RANGE"),
        (PRESSURE, "phys:1e9999 кПа", "is not a number of at most 40 digits"),
        (PRESSURE, "raw:70000", "outside 0..65535"),
        (PRESSURE, "raw:", "whole number"),
        (SPEED, "1 м/с", "the unit is 'об/мин'"),
    ],
)
def test_what_is_not_surely_one_of_them_is_refused(variable: Variable, text: str, said: str) -> None:
    with pytest.raises(Error, match=re.escape(said)):
        parse_written(text, variable)


@pytest.mark.requirement("R44")
@given(st.integers(-(10**18), 10**18))
def test_an_interval_is_taken_as_it_is_shown(total_ns: int) -> None:
    interval = Interval.from_ns(total_ns)
    assert STANDARD[13].check(str(interval)) == interval


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("PT1.5S", (1, 500_000_000)),
        ("-PT1.500000000S", (-1, -500_000_000)),
        ("P1DT2H3M4S", (93784, 0)),
        ("pt0s", (0, 0)),
    ],
)
def test_durations_of_iso_8601(text: str, wanted: tuple[int, int]) -> None:
    assert STANDARD[13].check(text) == wanted


@pytest.mark.parametrize("text", ["", "P", "PT", "P1DT", "1.5", "PT1.5", "PT1.0000000001S", "P1Y", "PT9999999999S"])
def test_what_is_no_duration(text: str) -> None:
    with pytest.raises(Error, match=r"E_VALUE|E_RANGE"):
        STANDARD[13].check(text)
