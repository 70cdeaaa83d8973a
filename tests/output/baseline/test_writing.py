"""A baseline as TOML: read again it is the same, in an order that people expect."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.output.baseline import Baseline, baseline_toml
from dissect.output.baseline.loading import parse_baseline
from dissect.output.baseline.norms import PairNorm
from tests.output.baseline.wire import learned


def test_what_is_written_is_read_again() -> None:
    baseline = learned("10.0.0.1", "10.0.0.3", "fe80::1").baseline(('odd "name"\x1b\udcff.pcap',))
    text = baseline_toml(baseline)
    again = parse_baseline(text)
    assert text.isascii()
    assert baseline_toml(again) == baseline_toml(parse_baseline(baseline_toml(again)))
    assert again.pairs.keys() == baseline.pairs.keys()
    for pair, norm in baseline.pairs.items():
        for key in ("server_ports", "tsaps", "functions", "reads", "writes", "transactions", "highest_10s"):
            assert getattr(again.pairs[pair], key) == getattr(norm, key)
        assert again.pairs[pair].longest_silence == pytest.approx(norm.longest_silence, rel=1e-5)
        assert again.pairs[pair].p99_ms == pytest.approx(norm.p99_ms, rel=1e-5)


def test_the_order_is_that_of_people() -> None:
    baseline = learned("10.0.0.10", "10.0.0.9").baseline()
    for norm in baseline.pairs.values():
        norm.reads = frozenset(("DB10", "DB2", "M", "DB1"))
    text = baseline_toml(baseline)
    assert 'reads = ["DB1", "DB2", "DB10", "M"]' in text
    assert text.index("10.0.0.9") < text.index("10.0.0.10")
    assert text == baseline_toml(Baseline(dict(reversed(baseline.pairs.items())), (), baseline.begin, baseline.end))


def test_a_name_of_many_digits_is_one_as_any_other() -> None:
    """Python makes no number of more than 4300 digits."""
    names = frozenset(("DB10", "DB9", "DB" + "7" * 5000))
    text = baseline_toml(Baseline({("a", "b"): PairNorm("a", "b", functions=names)}))
    assert text.index('"DB9"') < text.index('"DB10"') < text.index('"DB77')


def test_long_lists_take_several_lines() -> None:
    baseline = learned("10.0.0.1").baseline()
    names = frozenset(f"DB{number}" for number in range(300))
    baseline.pairs["10.0.0.1", "10.0.0.2"].reads = names
    text = baseline_toml(baseline)
    assert max(map(len, text.splitlines())) <= 128
    assert parse_baseline(text).pairs["10.0.0.1", "10.0.0.2"].reads == names


@given(transactions=st.integers(0, 10**9), seconds=st.floats(0, 10**7))
@example(transactions=6, seconds=0.2094776)
def test_what_is_read_back_is_written_the_same(transactions: int, seconds: float) -> None:
    norm = PairNorm("10.0.0.1", "10.0.0.2", transactions=transactions, seconds=seconds)
    text = baseline_toml(Baseline({("10.0.0.1", "10.0.0.2"): norm}))
    assert baseline_toml(parse_baseline(text)) == text
    said = tomllib.loads(text)["pair"][0]
    if "rate" in said:
        assert said["rate"]["mean"] == pytest.approx(transactions / said["seconds"], rel=1e-5, abs=1e-9)
    else:
        assert said["seconds"] == 0
