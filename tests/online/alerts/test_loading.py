"""A file of rules: what is right is taken, what is wrong is told with file, line, table and key."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.online.alerts import RuleError, load_rules
from dissect.online.alerts.command import Command
from dissect.online.alerts.loading import parse_rules
from dissect.online.alerts.syslog import Syslog
from dissect.online.alerts.webhook import Webhook
from dissect.scd.errors import DictionaryError
from tests.cases import each

DOCUMENT = Path(__file__).parents[3] / "docs" / "alerts.md"
S = 1_000_000_000
FINDING = '[[rule]]\nname = "r"\nwhen = "finding"\nfinding = "error"\n'
RATE = '[[rule]]\nname = "r"\nwhen = "rate"\nabove = 1\n'
RULE = "[[rule]] 1, "
ACT = "[[action]] 1, "
ACTION = FINDING + '[[action]]\nname = "a"\n'


def saved(directory: Path, text: str) -> Path:
    path = directory / "alerts.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_is_usual() -> None:
    rule = parse_rules(RATE).rules[0]
    assert (rule.cooldown_ns, rule.for_ns, rule.window_ns, rule.once) == (60 * S, 0, 10 * S, False)
    assert (rule.actions, rule.per, rule.of, rule.severity) == (("stderr",), "pair", "transactions", "")


def test_defaults_hold_for_all() -> None:
    text = (
        '[defaults]\ncooldown = "5min"\nactions = ["a"]\n'
        + ACTION
        + 'command = ["true"]\n'
        + RATE.replace('"r"', '"s"')
    )
    rules = parse_rules(text + "cooldown = 0\nactions = []\n")
    assert [rule.cooldown_ns for rule in rules.rules] == [300 * S, 0]
    assert [rule.actions for rule in rules.rules] == [("a",), ()]


@pytest.mark.parametrize(
    ("written", "ns"),
    [
        ('"500ms"', S // 2),
        ('"30s"', 30 * S),
        ('"1.5 min"', 90 * S),
        ('"2h"', 7200 * S),
        ('"1d"', 86400 * S),
        ("2", 2 * S),
    ],
)
def test_durations(written: str, ns: int) -> None:
    assert parse_rules(FINDING + f"cooldown = {written}\n").rules[0].cooldown_ns == ns


def test_findings_by_slug_prefix_and_severity() -> None:
    rule = parse_rules(FINDING.replace('"error"', '["transaction.slow", "tpkt.*"]')).rules[0]
    assert rule.slugs == {"transaction.slow"} | {slug for slug in CATALOGUE if slug.startswith("tpkt.")}


def test_actions() -> None:
    actions = parse_rules(
        'allow_hosts = ["logs.example"]\n'
        + ACTION
        + 'command = ["true", "{rule}"]\ntimeout = "3s"\nparallel = 2\n'
        + '[[action]]\nname = "b"\nsyslog = "logs.example:1514"\nfacility = "local3"\n'
        + '[[action]]\nname = "c"\nwebhook = "http://[::1]:80/x"\n'
    ).actions
    assert {name: type(action) for name, action in actions.items()} == {"a": Command, "b": Syslog, "c": Webhook}
    assert actions["a"].parallel == 2


@each(('text', 'told'), [
        ("", "[[rule]]: is missing: a rules file"),
        ("[rule]\n", "[rule]: must be written as [[rule]]"),
        ("[[rules]]\n", "file, rules: no such key here; close to it: 'rule'"),
        ('[[rule]]\nwhen = "new"\n', RULE + "name: is missing"),
        ('[[rule]]\nname = "a\\u001b"\n', RULE + "name: 'a\\x1b' is not a name"),
        ('[[rule]]\nname = "a"\nwhen = "ever"\n', RULE + "when: 'ever' is not one of finding, new, rate"),
        (FINDING + FINDING, "[[rule]] 2, name: 'r' is already the name of a rule"),
        (FINDING + "above = 1\n", RULE + "above: no such key here"),
        (FINDING + 'for = "3s"\n', RULE + "for: what 'finding' reports is momentary and does not last"),
        (FINDING + 'cooldown = "soon"\n', RULE + "cooldown: 'soon' is not a duration"),
        (FINDING + "cooldown = -1\n", RULE + "cooldown: -1 is not a duration"),
        (FINDING + 'cooldown = "999d"\n', RULE + "cooldown: is more than a year"),
        (FINDING + "cooldown = inf\n", RULE + "cooldown: inf is not a duration"),
        (FINDING + 'actions = ["a"]\n', RULE + "actions: 'a' names no [[action]]; known actions: stderr"),
        (FINDING + 'client = "plc"\n', RULE + "client: 'plc' is neither an address such as"),
        (FINDING + 'client = "10.0.0.1/8"\n', RULE + "client: '10.0.0.1/8' is neither"),
        (FINDING + 'severity = "bad"\n', RULE + "severity: 'bad' is not one of error, warning, note"),
        (FINDING.replace('"error"', "[]"), RULE + "finding: is missing"),
        (FINDING.replace('"error"', "[3]"), RULE + "finding: 3 is not a string"),
        (FINDING.replace('"error"', '"transaction.slo"'), RULE + "finding: 'transaction.slo' is neither a severity"),
        (RATE.replace("above = 1", ""), RULE + "above: is missing, or below or above_learned"),
        (RATE + 'per = "connection"\n', RULE + "per: 'connection' is not one of pair, all"),
        (RATE + 'window = "1ms"\n', RULE + "window: is less than 10ms"),
        (RATE + 'above_learned = 2\nwindow = "5s"\n', RULE + "above_learned: a baseline has"),
        (RATE + 'above_learned = 2\nper = "all"\n', RULE + "above_learned: a baseline is kept per pair"),
        (RATE.replace("= 1", "= nan"), RULE + "above: nan is not a finite number"),
        (RATE.replace("= 1", "= -1"), RULE + "above: -1 is below 0"),
        (FINDING.replace('when = "finding"\nfinding = "error"', 'when = "new"\nof = ["db"]'), RULE + "of: must be a list of"),
        (RATE.replace("rate", "outcome").replace("above = 1", ""), RULE + "above: is missing: the number per minute"),
        (RATE.replace("rate", "latency") + "above_learned = 3\n", RULE + "above_learned: and above exclude"),
        (RATE.replace("rate", "silence"), RULE + "longer: is missing, or longer_than_learned"),
        (RATE.replace("rate", "silence").replace("above", "longer") + "for = 1\n", RULE + "for: a silence has"),
        (ACTION, ACT + "command, syslog, webhook: is missing"),
        (ACTION + 'command = ["true"]\nsyslog = "/dev/log"\n', ACT + "command, syslog: exclude each other"),
        (ACTION + 'command = "true"\n', ACT + "command: must be a list of texts"),
        (ACTION + "command = []\n", ACT + "command: must be a list of 1 to 64 texts"),
        (ACTION + 'command = ["true", 1]\n', ACT + "command: entry 2 is not a text"),
        (ACTION + 'command = ["no-such-program"]\n', ACT + "command: 'no-such-program' is not an executable program"),
        (ACTION + 'command = ["true", "{text}"]\n', ACT + "command: {text} is not a placeholder; known: {rule}"),
        (ACTION + 'command = ["true"]\nparallel = 9\n', ACT + "parallel: 9 is outside 1 to 8"),
        (ACTION + 'command = ["true"]\ntimeout = 0\n', ACT + "timeout: must be more than 0 and at most an hour"),
        (ACTION + 'command = ["true"]\nshell = true\n', ACT + "shell: no such key here"),
        (ACTION.replace('"a"', '"stderr"') + 'command = ["true"]\n', ACT + "name: 'stderr' exists already"),
        (ACTION + 'syslog = "/no/such/socket"\n', ACT + "syslog: there is no '/no/such/socket'"),
        (ACTION + 'syslog = "10.0.0.9:514"\n', ACT + "syslog: 10.0.0.9 is not this machine: name it in allow_hosts"),
        (ACTION + 'syslog = "a b"\n', ACT + "syslog: 'a b' is neither the path"),
        (ACTION + 'webhook = "http://10.0.0.9/x"\n', ACT + "webhook: 10.0.0.9 is not this machine"),
        (ACTION + 'webhook = "http://localhost.evil.example/"\n', ACT + "webhook: localhost.evil.example is not"),
        (ACTION + 'webhook = "http://127.0.0.1@evil.example/"\n', ACT + "webhook: contains a user name or password"),
        (ACTION + 'webhook = "file:///etc/passwd"\n', ACT + "webhook: is not an address"),
        (ACTION + 'webhook = "http://127.0.0.1:x/"\n', ACT + "webhook: is not an address"),
        (ACTION + 'webhook = "http://127.0.0.1/\\r\\nX: y"\n', ACT + "webhook: "),
        (ACTION + 'webhook = "http://127.0.0.1/"\nspool = "here"\n', ACT + "spool: 'here' is not an absolute path"),
        (FINDING + "burst = 0\n", RULE + "burst: 0 is outside 1 to 10000"),
    ])  # fmt: skip
def test_what_is_wrong_is_told(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(RuleError) as error:
        load_rules(saved(tmp_path, text))
    said = str(error.value).removeprefix(f"{tmp_path}/alerts.toml:").lstrip("0123456789").removeprefix(":").strip()
    assert said[: len(told)] == told
    lines = text.splitlines()
    key = told.partition(": ")[0].rpartition(", ")[2]
    stands = [number for number, line in enumerate(lines, 1) if line.startswith(f"{key} = ")]
    if stands and "exclude each other" not in told:
        assert error.value.line == stands[-1], "the line of the key"


def test_a_trial_needs_neither_programs_nor_sockets(tmp_path: Path) -> None:
    tables = (
        ('command = ["no-such-program"]', "is not an executable program"),
        ('syslog = "/no/such/socket"', "there is no"),
    )
    for line, told in tables:
        path = saved(tmp_path, f"{ACTION}{line}\n")
        assert len(load_rules(path, trial=True).actions) == 1
        with pytest.raises(RuleError, match=told):
            load_rules(path)


@given(
    st.sampled_from(["", FINDING, RATE, ACTION]),
    st.sampled_from(["", "cooldown = ", "window = ", "per = ", "command = ", "webhook = ", "of = "]),
    st.text() | st.integers().map(str) | st.floats().map(str) | st.text().map(repr),
)
def test_any_text_is_taken_or_refused(begin: str, key: str, end: str) -> None:
    with suppress(DictionaryError):
        parse_rules(begin + key + end)


def test_the_examples_of_the_document_are_right(tmp_path: Path) -> None:
    examples = re.findall(r"```toml\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    rules = [example for example in examples if "[[rule]]" in example]
    assert len(rules) >= 1
    for rule_file in rules:
        example = rule_file.replace("/usr/local/bin/page-operator", "true").replace("/dev/log", "127.0.0.1")
        whens = {rule.when for rule in load_rules(saved(tmp_path, example)).rules}
        assert whens == {"finding", "new", "rate", "latency", "silence", "outcome", "problem"}
