"""What is learned of a line, and how much at most."""

from __future__ import annotations

import pytest

from dissect.baseline import Baseline, Learner, baseline_toml, learn, merged
from dissect.baseline.loading import parse_baseline
from tests.baseline.wire import Client, Wire
from tests.properties.messages import Item

MARKER = Item(0x02, 1, 0, 0x83, 0)
BLOCK = Item(0x04, 1, 12, 0x84, 0)


def learned(*clients: str) -> Learner:
    learner = Learner()
    wire = Wire(learner)
    for number, address in enumerate(clients):
        client = Client(wire, 0.0, address, ports=(5000 + number, 102))
        for second in range(5):
            client.read(second + 0.5, answer=0.002)
        client.read(9.0, MARKER, b"\x01", answer=0.2)
        client.write(9.5, BLOCK)
    wire.finish()
    return learner


def test_a_pair_is_learned() -> None:
    baseline = learned("10.0.0.1").baseline(("a.pcap",))
    norm = baseline.pairs["10.0.0.1", "10.0.0.2"]
    assert norm.functions == {"Setup communication", "Read Var", "Write Var"}
    assert norm.reads == {"DB10", "M"}
    assert norm.writes == {"DB12"}
    assert norm.server_ports == {102}
    assert norm.tsaps == {"01.00 > 01.02"}
    assert (norm.connections, norm.transactions) == (1, 8)
    assert norm.seconds == pytest.approx(9.5)
    assert norm.mean == pytest.approx(8 / 9.5)
    assert norm.longest_silence == pytest.approx(9.2 - 4.502)
    assert (norm.highest_1s, norm.highest_10s) == (2, 8)
    assert norm.median_ms == pytest.approx(2.0, rel=1 / 100)
    assert norm.longest_ms == pytest.approx(200.0)


def test_pairs_are_kept_apart() -> None:
    assert set(learned("10.0.0.1", "10.0.0.3").baseline().pairs) == {("10.0.0.1", "10.0.0.2"), ("10.0.0.3", "10.0.0.2")}


def test_between_captures_is_no_silence() -> None:
    learner = Learner()
    for beginning in (0.0, 5000.0):
        wire = Wire(learner)
        client = Client(wire, beginning)
        client.read(beginning + 1)
        wire.finish()
        learner.restart()
    norm = learner.baseline().pairs["10.0.0.1", "10.0.0.2"]
    assert norm.longest_silence == pytest.approx(1.001)
    assert norm.seconds == pytest.approx(2.002)


@pytest.mark.parametrize(
    ("bound", "kept"), [("MAX_PAIRS", {"10.0.0.1"}), ("MAX_ENTRIES", {"10.0.0.1", "10.0.0.3"}), ("MAX_SET", None)]
)
def test_memory_is_bounded_and_told(monkeypatch: pytest.MonkeyPatch, bound: str, kept: set[str] | None) -> None:
    monkeypatch.setattr(learn, bound, 1)
    learner = learned("10.0.0.1", "10.0.0.3")
    baseline = learner.baseline()
    assert learner.left_out > 0
    assert kept is None or {client for client, _ in baseline.pairs} == kept
    if bound == "MAX_SET":
        assert all(len(norm.functions or ()) == 1 for norm in baseline.pairs.values())
    assert "# NOT COMPLETE" in baseline_toml(baseline)
    assert "# NOT COMPLETE" not in baseline_toml(learned("10.0.0.1").baseline())


def test_merging_adds_and_keeps_the_higher() -> None:
    one, other = learned("10.0.0.1").baseline(("a",)), learned("10.0.0.1", "10.0.0.3").baseline(("a", "b"))
    pair = ("10.0.0.1", "10.0.0.2")
    one.pairs[pair].longest_ms = 7000.0
    one.pairs[pair].reads = frozenset(("T",))
    one.pairs[pair].writes = None
    both = merged(one, other)
    norm = both.pairs[pair]
    assert both.captures == ("a", "b")
    assert len(both.pairs) == 2
    assert norm.transactions == 16
    assert norm.longest_ms == 7000.0
    assert norm.reads == {"T", "DB10", "M"}
    assert norm.writes is None  # anything was allowed, and still is


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


def test_long_lists_take_several_lines() -> None:
    baseline = learned("10.0.0.1").baseline()
    names = frozenset(f"DB{number}" for number in range(300))
    baseline.pairs["10.0.0.1", "10.0.0.2"].reads = names
    text = baseline_toml(baseline)
    assert max(map(len, text.splitlines())) <= 128
    assert parse_baseline(text).pairs["10.0.0.1", "10.0.0.2"].reads == names
