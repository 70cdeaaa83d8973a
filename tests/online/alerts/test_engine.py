"""Every kind of rule speaks when it should, and is silent when it should be."""

from __future__ import annotations

import json

import pytest

from dissect.online.alerts import RuleError
from dissect.output.baseline import Baseline, PairNorm
from tests.online.alerts.rules_of import Kept
from tests.output.baseline.wire import Client, at_ns
from tests.properties.messages import Item, connect
from tests.properties.packets import Flow, Talk

BLOCK = Item(0x04, 1, 12, 0x84, 0)
PAIR = ("10.0.0.1", "10.0.0.2")


def norm(**measures: float | frozenset[str]) -> Baseline:
    one = PairNorm(*PAIR)
    for key, value in measures.items():
        setattr(one, key, value)
    return Baseline({PAIR: one})


# ---- findings -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "told"),
    [('"security.write"', 1), ('"note"', 1), ('["tpkt.*", "security.*"]', 1), ('"error"', 0), ('"tpkt.*"', 0)],
)
def test_a_finding(wanted: str, told: int) -> None:
    engine = Kept(f'when = "finding"\nfinding = {wanted}')
    client = Client(engine.wire)
    client.write(1.0)
    engine.over()
    assert len(engine.alerts) == told
    for alert in engine.alerts:
        assert alert.severity == "warning"  # the finding's own
        assert alert.pair == PAIR
        values = json.loads(alert.as_json())
        assert values["finding"]["slug"] == "security.write"
        assert values["finding"]["frames"] == [8, 9]
        assert values["connection"] == 1


@pytest.mark.parametrize(
    ("who", "told"),
    [
        ('client = "10.0.0.1"', 1),
        ('client = "10.0.0.0/24"\nserver = "10.0.0.2"', 1),
        ('client = "10.0.0.2"', 0),
        ('server = "10.1.0.0/16"', 0),
        ('server = "fe80::/10"', 0),
    ],
)
def test_only_of_some(who: str, told: int) -> None:
    engine = Kept(f'when = "finding"\nfinding = "security.write"\nseverity = "error"\n{who}')
    Client(engine.wire).write(1.0)
    engine.over()
    assert [alert.severity for alert in engine.alerts] == ["error"] * told


def test_a_finding_at_the_end_of_a_connection_knows_whose_it_is() -> None:
    engine = Kept('when = "finding"\nfinding = "transaction.unanswered"\nclient = "10.0.0.1"')
    client = Client(engine.wire)
    client.read(1.0, answer=None)
    client.close(2.0)
    engine.over()
    assert [alert.pair for alert in engine.alerts] == [PAIR]


# ---- new ------------------------------------------------------------------------------------------------------------


def test_new_needs_a_baseline() -> None:
    with pytest.raises(RuleError, match=r'\[\[rule\]\] 1, when: "new" of \'rule\' needs a baseline: give one'):
        Kept('when = "new"')
    with pytest.raises(RuleError, match="needs a baseline"):
        Kept('when = "rate"\nabove_learned = 2')


@pytest.mark.parametrize(
    ("of", "told"),
    [
        ("", ["first read of DB10 on 10.0.0.2 by 10.0.0.1", "first write of DB12 on 10.0.0.2 by 10.0.0.1"]),
        ('of = ["write"]', ["first write of DB12 on 10.0.0.2 by 10.0.0.1"]),
        ('of = ["client", "pair", "function"]', []),
    ],
)
def test_what_is_new_is_told_once_in_a_while(of: str, told: list[str]) -> None:
    engine = Kept(f'when = "new"\n{of}', norm(reads=frozenset(), writes=frozenset()))
    client = Client(engine.wire)
    client.read(1.0)
    for second in range(10):
        client.write(2.0 + second, BLOCK)
    assert engine.texts == told
    assert [alert.repeated for alert in engine.alerts] == [0] * len(told)
    engine.over()  # what was held back comes at the end
    assert engine.texts[len(told) :] == told[-1:]
    assert [alert.repeated for alert in engine.alerts[len(told) :]] == [8] * len(told[-1:])


def test_a_new_client_is_told_at_once() -> None:
    engine = Kept('when = "new"\nof = ["client"]', norm())
    Client(engine.wire, 0.0, "10.0.0.1", ports=(1, 102)).read(0.5)
    assert engine.alerts == []
    Client(engine.wire, 1.0, "10.0.0.7", ports=(2, 102))
    assert engine.texts == ["new client 10.0.0.7; it talks to 10.0.0.2"]


def test_a_client_that_only_connects_is_told_as_time_passes() -> None:
    engine = Kept('when = "new"\nof = ["client", "tsap"]', norm())
    talk = Talk(Flow("10.0.0.7", "10.0.0.2")).handshake().send(0, connect(0xE0))
    for segment in talk.segments:
        engine.wire.packet(1.0, segment.frame())
    engine.tick(at_ns(1.5))
    assert engine.alerts == []
    engine.tick(at_ns(2.5))
    assert engine.texts == ["new client 10.0.0.7; it talks to 10.0.0.2"]
    engine.over()
    assert len(engine.alerts) == 1


# ---- rates ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "told"),
    [
        ('above = 3\nwindow = "2s"', 1),
        ('above = 6\nwindow = "2s"', 0),
        ('above = 6\nwindow = "2s"\nof = "messages"', 1),
        ('above = 3\nwindow = "2s"\nper = "all"', 1),
        ('above_learned = 2\nwindow = "1s"', 0),
        ("above_learned = 1.5", 1),
        ("above_learned = 1.7", 0),
    ],
)
def test_a_rate_that_is_too_high(rule: str, told: int) -> None:
    engine = Kept(f'when = "rate"\n{rule}', norm(highest_1s=5, highest_10s=12))
    client = Client(engine.wire)
    for number in range(20):
        client.read(20 + number * 0.2)
    assert len(engine.alerts) == told
    engine.over()
    assert len(engine.alerts) == told
    assert all(alert.pair == (None if "all" in rule else PAIR) for alert in engine.alerts)


@pytest.mark.parametrize(("below", "told"), [(0.9, 0), (1.5, 1)])
def test_a_rate_that_is_too_low(below: float, told: int) -> None:
    engine = Kept(f'when = "rate"\nbelow = {below}\nwindow = "10s"')
    client = Client(engine.wire)
    for second in range(1, 20):
        client.read(second)
    assert len(engine.alerts) == told


def test_a_rate_falls_when_nothing_comes() -> None:
    engine = Kept('when = "rate"\nbelow = 0.5\nwindow = "10s"')
    client = Client(engine.wire)
    for second in range(1, 20):
        client.read(second)
    assert engine.alerts == []
    engine.ticks(20, 40)
    assert len(engine.alerts) == 1
    assert engine.alerts[0].text.startswith("10.0.0.1 → 10.0.0.2: ")


# ---- answer times ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "told"),
    [
        ('above = "50ms"', 0),
        ('above = "50ms"\nof = "max"', 1),
        ('above = "500ms"\nof = "max"', 0),
        ('above = "5ms"', 1),
        ('above = "5ms"\nper = "connection"', 1),
        ("above_learned = 2", 0),
        ('above_learned = 2\nof = "max"', 1),
        ('above_learned = 5\nof = "max"', 0),
    ],
)
def test_answers_that_are_late(rule: str, told: int) -> None:
    engine = Kept(f'when = "latency"\n{rule}', norm(median_ms=8.0, p99_ms=50.0))
    client = Client(engine.wire)
    for second in range(1, 9):
        client.read(second, answer=0.2 if second == 4 else 0.01)
    engine.over()
    assert len(engine.alerts) == told


def test_a_late_answer_leaves_the_window() -> None:
    engine = Kept('when = "latency"\nof = "max"\nabove = "100ms"\ncooldown = "3s"')
    client = Client(engine.wire)
    client.read(1.0, answer=0.2)
    engine.ticks(2, 60)
    assert 2 <= len(engine.alerts) <= 4  # at once, then every three seconds while it is within the ten of the window
    assert [alert.repeated for alert in engine.alerts] == [0] * len(engine.alerts)
    assert engine.alerts[-1].message().endswith("s")


# ---- silence --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("per", ["pair", "connection", "all"])
def test_silence_is_told_while_it_lasts(per: str) -> None:
    engine = Kept(f'when = "silence"\nlonger = "5s"\nper = "{per}"\ncooldown = "10s"')
    client = Client(engine.wire)
    client.read(1.0)
    engine.ticks(1.5, 5.5)
    assert engine.alerts == []
    engine.ticks(6, 10)
    assert [alert.time_ns for alert in engine.alerts] == [at_ns(6.5)]
    client.read(10.5)
    engine.ticks(11, 15)
    assert len(engine.alerts) == 1
    engine.over()


def test_packets_without_octets_break_a_silence_of_packets_only() -> None:
    packets = Kept('when = "silence"\nlonger = "5s"')
    transactions = Kept('when = "silence"\nlonger = "5s"\nof = "transactions"')
    for engine in (packets, transactions):
        client = Client(engine.wire)
        client.read(1.0)
        for second in range(2, 20):
            client.keep_alive(second)
            engine.tick(at_ns(second))
    assert packets.alerts == []
    assert transactions.texts == ["10.0.0.1 → 10.0.0.2: no transactions for 6.00 s; more than 5.00 s"]


def test_a_silence_between_transactions_is_told_without_ticks() -> None:
    engine = Kept('when = "silence"\nlonger_than_learned = 3', norm(longest_silence=2.0))
    client = Client(engine.wire)
    for at in (1.0, 6.0, 12.5, 13.0):
        client.read(at)
    assert [alert.time_ns for alert in engine.alerts] == [at_ns(12.501)]
    assert engine.texts[0].endswith("no transactions for 6.50 s; more than 6.00 s")


def test_a_lone_transaction_ends_a_silence() -> None:
    """Without ticks the next look comes with the next transaction, when it has been silent again."""
    engine = Kept('when = "silence"\nlonger = "5s"\nof = "transactions"\ncooldown = "60s"')
    client = Client(engine.wire)
    for at in (1.0, 101.0, 201.0, 301.0):
        client.read(at)
    engine.over()
    assert [alert.time_ns for alert in engine.alerts] == [at_ns(101.001), at_ns(201.001), at_ns(301.001)]
    assert all(text.endswith("no transactions for 100.00 s; more than 5.00 s") for text in engine.texts)


def test_who_is_known_is_waited_for() -> None:
    engine = Kept('when = "silence"\nlonger = "5s"\nclient = "10.0.0.3"\nserver = "10.0.0.2"')
    learned = Kept('when = "silence"\nlonger_than_learned = 3', norm(longest_silence=2.0))
    for one in (engine, learned):
        one.ticks(0, 5)
        assert one.alerts == []
        one.ticks(5.5, 10)
        assert len(one.alerts) == 1


def test_a_connection_that_ended_is_not_silent() -> None:
    engine = Kept('when = "silence"\nlonger = "5s"\nper = "connection"')
    client = Client(engine.wire)
    client.close(1.0)
    client.wire.packet(40.0, client.talk.segments[-1].frame())  # time passes, and the connection with it
    engine.ticks(41, 60)
    assert engine.alerts == []


# ---- outcomes -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("of", "errors", "told"),
    [("errors", 4, 1), ("errors", 3, 0), ("failed", 4, 1), ("unanswered", 9, 0)],
)
def test_errors(of: str, errors: int, told: int) -> None:
    engine = Kept(f'when = "outcome"\nof = "{of}"\nabove = 3')
    client = Client(engine.wire)
    for number in range(12):
        client.read(1.0 + number, content=0x0A if number < errors else b"\x00\x01")
    engine.over()
    assert len(engine.alerts) == told


def test_what_the_capture_does_not_show_is_no_missing_answer() -> None:
    lost = Kept('when = "outcome"\nof = "unanswered"\nabove = 0')
    client = Client(lost.wire)
    client.read(1.0, answer=None)
    lost.over()  # the capture ends
    assert lost.alerts == []


def test_an_answer_that_never_came_counts_when_that_is_certain() -> None:
    engine = Kept('when = "outcome"\nof = "unanswered"\nabove = 0\nwindow = "10s"')
    client = Client(engine.wire)
    client.read(1.0, answer=None)
    client.close(100.0)
    engine.over()
    assert engine.texts == ["10.0.0.1 → 10.0.0.2: 1 unanswered in 10 s, 6 a minute; more than 0"]


# ---- how often ------------------------------------------------------------------------------------------------------


def test_for_waits_until_it_lasts() -> None:
    engine = Kept('when = "rate"\nabove = 3\nwindow = "1s"\nfor = "3s"')
    client = Client(engine.wire)
    for number in range(20):  # two seconds
        client.read(1 + number * 0.1)
    engine.ticks(3.5, 20)
    assert engine.alerts == []
    for number in range(60):  # six seconds
        client.read(30 + number * 0.1)
    assert len(engine.alerts) == 1
    assert engine.alerts[0].time_ns - engine.alerts[0].since_ns >= 3_000_000_000
    assert ", for 3.0" in engine.alerts[0].message()


def test_what_goes_on_is_told_every_cooldown() -> None:
    engine = Kept('when = "silence"\nlonger = "5s"\ncooldown = "20s"')
    Client(engine.wire).read(1.0)
    engine.ticks(1, 60)
    times = [(alert.time_ns - at_ns(0)) / 1e9 for alert in engine.alerts]
    assert times == [6.5, 26.5, 46.5]
    assert engine.alerts[2].message().endswith("for 40.00 s")


def test_what_comes_and_goes_is_counted() -> None:
    engine = Kept('when = "silence"\nlonger = "2s"\ncooldown = "30s"')
    client = Client(engine.wire)
    for number in range(7):
        client.read(number * 5.0 + 1)
        engine.ticks(number * 5.0 + 1.5, number * 5.0 + 5.5)
    assert [alert.repeated for alert in engine.alerts] == [0, 5]
    assert engine.alerts[1].message().endswith(", 5 more")


def test_repetitions_are_told_after_the_cooldown_though_nothing_comes() -> None:
    engine = Kept('when = "finding"\nfinding = "transaction.item_error"\ncooldown = "10s"')
    client = Client(engine.wire)
    for number in range(4):
        client.read(1 + number, content=0x0A)
    assert [alert.repeated for alert in engine.alerts] == [0]
    engine.ticks(5, 60)
    assert [alert.repeated for alert in engine.alerts] == [0, 2]
    engine.over()
    assert len(engine.alerts) == 2


def test_once_is_once() -> None:
    engine = Kept('when = "finding"\nfinding = "transaction.item_error"\ncooldown = 1\nonce = true')
    client = Client(engine.wire)
    for number in range(9):
        client.read(1 + 5 * number, content=0x0A)
    engine.ticks(60, 80)
    engine.over()
    assert len(engine.alerts) == 1


def test_a_clock_that_is_set_back_does_not_make_rules_deaf() -> None:
    engine = Kept('when = "silence"\nlonger = "5s"')
    Client(engine.wire).read(1.0)
    engine.tick(at_ns(5000))
    assert len(engine.alerts) == 1
    engine.tick(at_ns(10))
    engine.ticks(10, 80)
    assert len(engine.alerts) == 2
