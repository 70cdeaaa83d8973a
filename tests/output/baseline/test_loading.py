"""A baseline that somebody edited: what is wrong is told with file, line, table and key."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.output.baseline import BaselineError, load_baseline
from dissect.output.baseline.loading import parse_baseline
from dissect.scd.errors import DictionaryError

PAIR = 'format = 1\n\n[[pair]]\nclient = "10.0.0.5"\nserver = "10.0.0.1"\n'


def saved(directory: Path, text: str) -> Path:
    path = directory / "plant.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_is_left_out_is_not_watched(tmp_path: Path) -> None:
    norm = load_baseline(saved(tmp_path, PAIR)).pairs["10.0.0.5", "10.0.0.1"]
    assert norm.functions is norm.reads is norm.writes is norm.tsaps is None
    assert norm.server_ports is None
    assert norm.longest_silence is norm.highest_1s is None


def test_addresses_are_taken_as_traffic_is_told(tmp_path: Path) -> None:
    text = PAIR.replace("10.0.0.5", "FE80:0:0:0:0:0:0:1")
    assert list(load_baseline(saved(tmp_path, text)).pairs) == [("fe80::1", "10.0.0.1")]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "plant.toml: file, format: is missing"),
        ("format = 2\n", "plant.toml:1: file, format: 2 is unknown, expected format 1"),
        ("format = 1\nname = 3\n", "plant.toml:2: file, name: no such key here"),
        ("format = 1\n[pair]\n", "plant.toml:2: [pair]: must be written as [[pair]]"),
        (PAIR + "reads = [1]\n", "plant.toml:6: [[pair]] 1, reads: 1 is not a string of 1 to 200 characters"),
        (
            PAIR + 'functions = ["ReadVar"]\n',
            "plant.toml:6: [[pair]] 1, functions: 'ReadVar' is not how a function is written: 'Read Var'",
        ),
        (
            PAIR + 'functions = ["read var"]\n',
            "plant.toml:6: [[pair]] 1, functions: 'read var' is not how a function is written: 'Read Var'",
        ),
        (PAIR + 'reads = ["db2"]\n', "plant.toml:6: [[pair]] 1, reads: 'db2' is not how an area is written: 'DB2'"),
        (
            PAIR + 'writes = ["M", "DB 2"]\n',
            "plant.toml:6: [[pair]] 1, writes: 'DB 2' is not how an area is written: 'DB2'",
        ),
        (
            PAIR + 'writes = ["DB2.DBW4"]\n',
            "plant.toml:6: [[pair]] 1, writes: 'DB2.DBW4' is not how an area is written: 'DB2'",
        ),
        (PAIR + 'writes = ["mw10"]\n', "plant.toml:6: [[pair]] 1, writes: 'mw10' is not how an area is written: 'M'"),
        (PAIR + 'reads = "M"\n', "plant.toml:6: [[pair]] 1, reads: 'M' is not an array"),
        (PAIR + "read = []\n", "plant.toml:6: [[pair]] 1, read: no such key here"),
        (PAIR + "server_ports = [true]\n", "plant.toml:6: [[pair]] 1, server_ports: True is not a port"),
        (PAIR + "transactions = -1\n", "plant.toml:6: [[pair]] 1, transactions: -1 is below 0"),
        (PAIR + "longest_silence = nan\n", "plant.toml:6: [[pair]] 1, longest_silence: nan is not a finite number"),
        (PAIR + "rate = { peak = 1 }\n", "plant.toml:6: [[pair]] 1, rate, peak: no such key here"),
        (PAIR + "rate = 3\n", "plant.toml:6: [[pair]] 1, rate: 3 is not a table"),
        (
            PAIR + PAIR[12:],
            "plant.toml:7: [[pair]] 2, client: 10.0.0.5 and 10.0.0.1 are already defined: [[pair]] 1, line 3",
        ),
        (PAIR.replace("10.0.0.5", "plc"), "plant.toml:4: [[pair]] 1, client: 'plc' is not an address"),
        ("format = 1\n[[pair]\n", "plant.toml:2: TOML: "),
        ("format = 1\n# \x00\n", "plant.toml:2: TOML: "),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(BaselineError) as error:
        load_baseline(saved(tmp_path, text))
    assert str(error.value).removeprefix(f"{tmp_path}/").startswith(told)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load_baseline(tmp_path / "no.toml")


@given(st.text() | st.sampled_from(["client", "reads", "rate"]).map(lambda key: f"{PAIR}{key} = "), st.text())
def test_any_text_is_taken_or_refused(begin: str, end: str) -> None:
    with suppress(DictionaryError):
        parse_baseline(begin + end)
