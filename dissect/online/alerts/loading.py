"""Reads rules and actions from TOML (docs/alerts.md). Errors name file, line, table and key."""

from __future__ import annotations

import os
import re
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import Any, Final

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.meaning.report.slugs import slugs_of
from dissect.online.alerts import states
from dissect.online.alerts.actions import Action
from dissect.online.alerts.problems import HEAD
from dissect.online.alerts.problems import KINDS as PROBLEMS
from dissect.online.alerts.rules import (
    EVENTS,
    FINDING,
    LATENCY,
    NEW,
    OUTCOME,
    PER_ALL,
    PER_CONNECTION,
    PER_PAIR,
    PROBLEM,
    RATE,
    SILENCE,
    STDERR,
    WHENS,
    Rule,
)
from dissect.output.baseline.watch import KINDS
from dissect.scd.errors import DictionaryError, shown
from dissect.scd.reading import Table
from dissect.scd.user_file import MAX_NAME, FileError, UserFile, names_of, network_of, read_file
from dissect.wire.config.hints import close_to

MAX_RULES: Final = 256
MAX_ACTIONS: Final = 32
#: The default and the greatest value of `Rule.burst`.
BURST: Final = 20
MAX_BURST: Final = 10_000

_S: Final = 1_000_000_000
_UNITS: Final = {"ms": 1_000_000, "s": _S, "min": 60 * _S, "h": 3600 * _S, "d": 86400 * _S}
_DURATION: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]{1,9})?) *(ms|s|min|h|d)")
#: No duration is longer than a year.
_LONGEST: Final = 366 * _UNITS["d"]
#: The shortest window: it moves in tenths of itself, which must be at least a millisecond.
_SHORTEST_WINDOW: Final = 10_000_000
_LEARNED_WINDOWS: Final = (_S, 10 * _S)


_KINDS: Final = ("command", "syslog", "webhook")


#: Greatest number of programs or requests of one action at a time.
MAX_PARALLEL: Final = 8


@dataclass(frozen=True, slots=True)
class AlertRules:
    """A file of rules: the rules in their order, and the actions that they name. ``path`` is for error messages."""

    rules: tuple[Rule, ...]
    actions: dict[str, Action] = field(default_factory=dict)
    path: str = ""


class RuleError(FileError):
    """A file of rules cannot be used."""


def load_rules(path: str | os.PathLike[str], trial: bool = False) -> AlertRules:
    """Return the rules of a file. Raises `RuleError`, OSError if the file cannot be read.

    A ``trial`` delivers nothing: the programs and sockets of its actions need not exist.
    """
    return read_file(path, lambda text: parse_rules(text, os.fspath(path), trial), RuleError)


def parse_rules(text: str, path: str = "", trial: bool = False) -> AlertRules:
    """Return the rules of a text; ``trial`` as for `load_rules`.

    Raises `DictionaryError`, which has all errors with table, key and line.
    """
    file = UserFile(text, ("rule", "action"), ("defaults",))
    hosts: frozenset[str] = frozenset()
    with file.troubles:
        hosts = names_of(file.top, "allow_hosts") or hosts
    actions: dict[str, Action] = {}
    named: set[str] = set()  # also the names of invalid actions: a rule that names one is not wrong itself
    for table in file.tables("action", MAX_ACTIONS):
        with file.troubles:
            name = _name(table)
            if name == STDERR or name in named:
                raise table.fail("name", f"{shown(name)} exists already: choose a different name")
            named.add(name)
            actions[name] = action_of(table, name, hosts, seconds(table, "timeout", 10.0), trial)
            table.done()
    usual = Rule("", FINDING)
    with file.troubles:
        defaults = file.single("defaults") or Table({}, "[defaults]")
        usual = _usual(defaults, named)
        defaults.done()
    rules: dict[str, Rule] = {}
    tables = 0
    for table in file.tables("rule", MAX_RULES):
        tables += 1
        with file.troubles:
            rule = _rule(table, usual, named)
            if rule.name in rules:
                raise table.fail("name", f"{shown(rule.name)} is already the name of a rule: choose a different one")
            table.done()
            rules[rule.name] = rule
    file.done()
    if not tables:
        raise DictionaryError("[[rule]]", "is missing: a rules file needs at least one")
    return AlertRules(tuple(rules.values()), actions, path)


# ---- values ---------------------------------------------------------------------------------------------------------


def _name(table: Table) -> str:
    name = table.text("name")
    if not name.strip() or len(name) > MAX_NAME or not name.isprintable():
        raise table.fail("name", f"{shown(name)} is not a name of 1 to {MAX_NAME} printable characters")
    return name


def _duration(table: Table, key: str, default: int | None = None) -> int:
    """Return a duration in nanoseconds: ``"500ms"``, ``"30s"``, ``"5min"``, ``"2h"``, or a number of seconds."""
    if not table.has(key) and default is not None:
        table.mark(key)
        return default
    found: Any = table.content.get(key)
    table.mark(key)
    match = _DURATION.fullmatch(found) if isinstance(found, str) else None
    if match is not None:
        found = round(float(match[1]) * _UNITS[match[2]])
    elif isinstance(found, (int, float)) and not isinstance(found, bool) and 0 <= found <= _LONGEST // _S:
        found = round(found * _S)
    elif found is None:
        raise table.fail(key, "is missing")
    else:
        raise table.fail(key, f'{shown(found)} is not a duration such as "500ms", "30s", "5min", "2h" or 30')
    if found > _LONGEST:
        raise table.fail(key, "is more than a year")
    duration: int = found
    return duration


def seconds(table: Table, key: str, default: float) -> float:
    """Return a duration in seconds, more than 0 and at most an hour."""
    duration = _duration(table, key, round(default * _S))
    if not 0 < duration <= _UNITS["h"]:
        raise table.fail(key, "must be more than 0 and at most an hour")
    return duration / _S


def _positive(table: Table, key: str) -> float | None:
    number = table.real(key)
    if number is not None and number < 0:
        raise table.fail(key, f"{number} is below 0")
    return None if number is None else float(number)


def _usual(table: Table, actions: AbstractSet[str]) -> Rule:
    """Return a rule with the defaults of the file."""
    usual = Rule("", FINDING)
    return Rule("", FINDING, cooldown_ns=_duration(table, "cooldown", usual.cooldown_ns),
                burst=_burst(table, BURST), actions=_actions(table, actions, usual.actions))  # fmt: skip


def _burst(table: Table, usual: int) -> int:
    burst: int = table.number("burst", usual)
    if not 1 <= burst <= MAX_BURST:
        raise table.fail("burst", f"{burst} is outside 1 to {MAX_BURST}")
    return burst


def _actions(table: Table, actions: AbstractSet[str], usual: tuple[str, ...]) -> tuple[str, ...]:
    if not table.has("actions"):
        table.mark("actions")
        return usual
    names = table.items("actions")
    for name in names:
        if name != STDERR and (not isinstance(name, str) or name not in actions):
            known = [STDERR, *sorted(actions)]
            hint = close_to(name, known) if isinstance(name, str) else ""
            raise table.fail("actions", f"{shown(name)} names no [[action]]; known actions: {', '.join(known)}{hint}")
    return tuple(dict.fromkeys(names))


# ---- rules ----------------------------------------------------------------------------------------------------------


def _rule(table: Table, usual: Rule, actions: AbstractSet[str]) -> Rule:
    name = _name(table)
    when = table.choice("when", WHENS)
    values: dict[str, Any] = _READERS[when](table)
    if when in EVENTS:
        if table.has("for"):
            raise table.fail("for", f'what {shown(when)} reports is momentary and does not last: use "cooldown"')
    elif when == SILENCE:
        if table.has("for"):
            raise table.fail("for", 'a silence has "longer"')
    else:
        values["for_ns"] = _duration(table, "for", 0)
    if "severity" not in values:
        values["severity"] = table.choice("severity", SEVERITIES) if table.has("severity") else ""
        table.mark("severity")
    return Rule(
        name, when, client=network_of(table, "client"), server=network_of(table, "server"),
        cooldown_ns=_duration(table, "cooldown", usual.cooldown_ns), once=table.flag("once", False),
        burst=_burst(table, usual.burst), actions=_actions(table, actions, usual.actions), **values,
    )  # fmt: skip


def _finding(table: Table) -> dict[str, Any]:
    written = table.content.get("finding")
    table.mark("finding")
    wanted = [written] if isinstance(written, str) else written
    if not isinstance(wanted, list) or not wanted:
        raise table.fail(
            "finding", 'is missing: a slug, "session.*", or "warning" for that severity or worse; or several'
        )
    slugs: set[str] = set()
    for one in wanted:
        if not isinstance(one, str):
            raise table.fail("finding", f"{shown(one)} is not a string")
        try:
            slugs |= slugs_of(one)
        except ValueError as error:
            raise table.fail("finding", str(error)) from None
    return {"slugs": frozenset(slugs)}


def _new(table: Table) -> dict[str, Any]:
    kinds = names_of(table, "of")
    if kinds is not None and (not kinds or not kinds <= frozenset(KINDS)):
        hints = "".join([close_to(kind, KINDS) for kind in sorted(kinds - frozenset(KINDS))])
        raise table.fail("of", f"must be a list of: {', '.join(KINDS)}{hints}")
    return {"kinds": kinds if kinds is not None else frozenset(KINDS)}


def _per(table: Table, *choices: str) -> str:
    per: str = table.choice("per", choices, PER_PAIR)
    return per


def _window(table: Table, default: int) -> int:
    window = _duration(table, "window", default)
    if window < _SHORTEST_WINDOW:
        raise table.fail("window", "is less than 10ms")
    return window


def _learned(table: Table, key: str, per: str) -> float:
    """Return the factor for the values of the baseline, 0 for none."""
    factor = _positive(table, key) or 0.0
    if factor and per != PER_PAIR:
        raise table.fail(key, 'a baseline is kept per pair: use per = "pair"')
    return factor


def _one_of(table: Table, *keys: str) -> None:
    if not any(table.has(key) for key in keys):
        raise table.fail(keys[0], f"is missing, or {' or '.join(keys[1:])}")


def _rate(table: Table) -> dict[str, Any]:
    _one_of(table, "above", "below", "above_learned")
    per = _per(table, PER_PAIR, PER_ALL)
    of = table.choice("of", (states.TRANSACTIONS, states.MESSAGES), states.TRANSACTIONS)
    window = _window(table, 10 * _S)
    learned = _learned(table, "above_learned", per)
    if learned and (window not in _LEARNED_WINDOWS or of != states.TRANSACTIONS):
        raise table.fail("above_learned", 'a baseline has transactions in windows of "1s" and "10s"')
    return {
        "per": per, "of": of, "window_ns": window, "learned": learned,
        "above": _positive(table, "above"), "below": _positive(table, "below"),
    }  # fmt: skip


def _latency(table: Table) -> dict[str, Any]:
    _one_of(table, "above", "above_learned")
    per = _per(table, PER_PAIR, PER_CONNECTION, PER_ALL)
    learned = _learned(table, "above_learned", per)
    if learned and table.has("above"):
        raise table.fail("above_learned", "and above exclude each other")
    of = table.choice("of", (states.MEDIAN, states.MAX), states.MEDIAN)
    above = float(_duration(table, "above")) if table.has("above") else None
    table.mark("above")
    return {"per": per, "of": of, "window_ns": _window(table, 10 * _S), "learned": learned, "above": above}


def _silence(table: Table) -> dict[str, Any]:
    _one_of(table, "longer", "longer_than_learned")
    if table.content.get("of") == states.INTERFACE:
        return _silent_interface(table)
    per = _per(table, PER_PAIR, PER_CONNECTION, PER_ALL)
    learned = _learned(table, "longer_than_learned", per)
    if learned and table.has("longer"):
        raise table.fail("longer_than_learned", "and longer exclude each other")
    usual = states.TRANSACTIONS if learned else states.PACKETS
    of = table.choice("of", (states.TRANSACTIONS,) if learned else (states.PACKETS, states.TRANSACTIONS), usual)
    return {"per": per, "of": of, "learned": learned, "longer_ns": _duration(table, "longer", 0)}


def _silent_interface(table: Table) -> dict[str, Any]:
    if table.has("longer_than_learned"):
        raise table.fail("longer_than_learned", 'a baseline does not know the interface: use "longer"')
    _of_this_machine(table)
    return {"of": table.choice("of", (states.INTERFACE,), ""), "per": table.choice("per", (PER_ALL,), PER_ALL),
            "learned": 0.0, "longer_ns": _duration(table, "longer", 0)}  # fmt: skip


def _problem(table: Table) -> dict[str, Any]:
    kinds = names_of(table, "of")
    every = (*PROBLEMS, HEAD)
    if kinds is not None and (not kinds or not kinds <= frozenset(every)):
        hints = "".join([close_to(kind, every) for kind in sorted(kinds - frozenset(every))])
        raise table.fail("of", f"must be a list of: {', '.join(every)}{hints}")
    _of_this_machine(table)
    return {"kinds": kinds if kinds is not None else frozenset(PROBLEMS)}


def _of_this_machine(table: Table) -> None:
    """Raise an error if the rule names hosts: it looks for problems of this program, which concern no host of the network."""
    for key in ("client", "server"):
        if table.has(key):
            raise table.fail(key, "does not go with what happens to this program itself")


def _outcome(table: Table) -> dict[str, Any]:
    above = _positive(table, "above")
    if above is None:
        raise table.fail("above", "is missing: the number per minute")
    of = table.choice("of", (states.ERRORS, states.NO_ANSWER, states.FAILED), states.FAILED)
    per = _per(table, PER_PAIR, PER_CONNECTION, PER_ALL)
    return {"per": per, "of": of, "window_ns": _window(table, 60 * _S), "above": above}


_READERS: Final = {
    FINDING: _finding, NEW: _new, RATE: _rate, LATENCY: _latency, SILENCE: _silence, OUTCOME: _outcome,
    PROBLEM: _problem,
}  # fmt: skip


def action_of(table: Table, name: str, hosts: frozenset[str], timeout: float, trial: bool = False) -> Action:
    """Return the action of a table; raises `DictionaryError`. ``hosts`` may get alerts, besides this machine.

    A ``trial`` sends nothing, so neither the program nor the socket has to exist.
    """
    keys = [key for key in _KINDS if table.has(key)]
    if len(keys) != 1:
        told = "is missing" if not keys else "exclude each other: use one table for each"
        raise table.fail(", ".join(keys or _KINDS), told)
    parallel = table.number("parallel", 1)
    if not 1 <= parallel <= MAX_PARALLEL:
        raise table.fail("parallel", f"{parallel} is outside 1 to {MAX_PARALLEL}")
    if keys[0] == "command":
        from dissect.online.alerts.command import command_of

        return command_of(table, name, timeout, parallel, trial)
    if keys[0] == "syslog":
        from dissect.online.alerts.syslog import syslog_of

        return syslog_of(table, name, hosts, trial)
    from dissect.online.alerts.webhook import webhook_of

    return webhook_of(table, name, hosts, timeout, parallel, trial)
