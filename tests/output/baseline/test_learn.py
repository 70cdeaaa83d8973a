"""What is learned of a line, and how much at most."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.files.session import Run
from dissect.online.alerts import Alert, AlertEngine, AlertRules, Rule
from dissect.online.alerts.rules import NEW
from dissect.output.baseline import Learner, baseline_toml, learn
from dissect.output.baseline.loading import parse_baseline
from tests.meaning.report.support import WORD
from tests.output.baseline.wire import Client, Wire, learned
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Flow, Talk

CRAFTED = Path(__file__).parents[3] / "captures" / "crafted"


def test_a_pair_is_learned() -> None:
    baseline = learned("10.0.0.1").baseline(("a.pcap",))
    norm = baseline.pairs["10.0.0.1", "10.0.0.2"]
    assert norm.functions == frozenset(
        (
            "Setup communication",
            "Read Var",
            "Write Var",
        )
    )
    assert norm.reads == frozenset(
        (
            "DB10",
            "M",
        )
    )
    assert norm.writes == frozenset(("DB12",))
    assert norm.server_ports == frozenset((102,))
    assert norm.tsaps == frozenset(("01.00 > 01.02",))
    assert (norm.connections, norm.transactions) == (1, 8)
    assert norm.seconds == pytest.approx(9.5)
    assert norm.longest_silence == pytest.approx(9.2 - 4.502)
    assert (norm.highest_1s, norm.highest_10s) == (2, 8)
    assert norm.median_ms == pytest.approx(2.0, rel=1 / 100)
    assert norm.longest_ms == pytest.approx(200.0)


def test_tsaps_are_learned_as_alerts_see_them_first_and_as_they_become() -> None:
    learner = Learner()
    wire = Wire(learner)
    client = Client(wire)
    client.read(1.0)
    client.talk.send(0, messages.connect(0xE0, called=b"\x01\x05"))
    client.pass_on(2.0)
    wire.finish()
    norm = learner.baseline().pairs["10.0.0.1", "10.0.0.2"]
    assert norm.tsaps == frozenset(("01.00 > 01.02", "01.00 > 01.05"))


def test_ports_are_learned_as_alerts_see_them_first_and_as_they_become() -> None:
    learner = Learner()
    wire = Wire(learner)
    talk = Talk(Flow("10.0.0.1", "10.0.0.2", (49152, 102)))
    talk.send(1, dt(messages.userdata(0, 0, 4, 17, b"\0\0")))  # port 102 pushes: it is the PLC, as far as can be seen
    talk.send(1, dt(messages.read_job(1, [WORD])))  # but it asks, too: it is the client
    for second, segment in enumerate(talk.segments):
        wire.packet(second, segment.frame())
    wire.finish()
    pairs = learner.baseline().pairs
    assert {pair: norm.server_ports for pair, norm in pairs.items()} == {
        ("10.0.0.1", "10.0.0.2"): frozenset((102,)),
        ("10.0.0.2", "10.0.0.1"): frozenset((49152,)),
    }
    assert [norm.connections for norm in pairs.values()] == [0, 1]


def test_what_is_complete_does_not_say_otherwise() -> None:
    assert "# NOT COMPLETE" not in baseline_toml(learned("10.0.0.1").baseline())


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


def stopped(*capture: str) -> str:
    """The baseline of a recorded capture, as a file."""
    learner = Learner()
    Run([str(CRAFTED / name) for name in capture], learner).read()
    return baseline_toml(learner.baseline())


@pytest.mark.parametrize(
    ("capture", "acts"),
    [
        ("plus-plant.pcapng", {"download": 1, "start": 1, "stop": 1}),
        ("coverage-functions.pcapng", {"stop": 1, "copy_ram_to_rom": 1, "compress": 1}),
    ],
)
def test_acts_are_learned_as_comments(capture: str, acts: dict[str, int]) -> None:
    """They are never normal only because they were captured, and neither are functions that served nothing else."""
    text = stopped(capture)
    baseline = parse_baseline(text)
    for norm in baseline.pairs.values():
        assert norm.acts == frozenset()
        assert "PLC stop" not in (norm.functions or ())
    for kind, times in acts.items():
        assert f'    # "{kind}",  # {times} time' in text
    allowed = parse_baseline(text.replace("    # ", "    "))
    assert frozenset(acts) <= frozenset().union(*[norm.acts or frozenset() for norm in allowed.pairs.values()])


def test_a_function_that_served_more_than_an_act_stays() -> None:
    """S7comm-plus asks for acts by the functions that it writes variables with; a write to outputs is a Write Var."""
    text = stopped("plus-plant.pcapng")
    assert '"S7comm-plus SetVariable"' in text
    assert '# "S7comm-plus' not in text


def test_an_act_that_is_not_allowed_is_new() -> None:
    told: list[Alert] = []
    for allowed, count in ((False, 3), (True, 0)):
        text = stopped("plus-plant.pcapng")
        baseline = parse_baseline(text.replace("    # ", "    ") if allowed else text)
        engine = AlertEngine(
            AlertRules((Rule("new", NEW, kinds=frozenset(("act",)), once=True),)), baseline, told.append
        )
        Run([str(CRAFTED / "plus-plant.pcapng")], engine).read()
        engine.finish()
        assert len(told) == count
        if told:
            assert [alert.text for alert in told] == [
                "stop on 192.0.2.20 by 192.0.2.10 (accepted)",
                "start on 192.0.2.20 by 192.0.2.10 (accepted)",
                "download on 192.0.2.20 by 192.0.2.10 (accepted)",
            ]
        told.clear()
