"""Reads a baseline, which users may have edited: every key and value is checked, and errors name the place."""

from __future__ import annotations

import os
from functools import cache
from ipaddress import ip_address
from typing import Final

from dissect.engine.acts.tables import ACTS
from dissect.output.baseline.norms import MAX_CAPTURES, NAME_KEYS, Baseline, PairNorm
from dissect.output.baseline.subjects import Pair
from dissect.output.baseline.writing import FORMAT
from dissect.packets.tcp.stream import address_text
from dissect.protocols.s7.tables import AREA_LETTERS, DB_AREAS
from dissect.scd.errors import shown
from dissect.scd.reading import Table
from dissect.scd.user_file import FileError, UserFile, names_of, read_file
from dissect.wire.config.hints import close_to

#: Maximum number of pairs, more than a learner keeps: several baselines may have been merged.
MAX_PAIRS: Final = 16384
_MAX_PORT: Final = 0xFFFF
_RATE: Final = ("highest_1s", "highest_10s")
_ANSWER: Final = {"median": "median_ms", "p99": "p99_ms", "longest": "longest_ms"}

_LETTERS: Final = frozenset(AREA_LETTERS.values()) - {AREA_LETTERS[area] for area in DB_AREAS}


class BaselineError(FileError):
    """A baseline cannot be used."""


def load_baseline(path: str | os.PathLike[str]) -> Baseline:
    """Return the baseline of a file. Raises `BaselineError`, OSError if the file cannot be read."""
    return read_file(path, parse_baseline, BaselineError)


def parse_baseline(text: str) -> Baseline:
    """Return the baseline in a text. Raises `DictionaryError`, which has all errors with table, key and line."""
    file = UserFile(text, ("pair",), ("learned",))
    number = file.top.number("format")
    if number != FORMAT:
        raise file.top.fail("format", f"{number} is unknown, expected format {FORMAT}")
    baseline = Baseline()
    learned = file.single("learned")
    if learned is not None:
        with file.troubles:
            baseline.captures = tuple(sorted(names_of(learned, "captures") or ()))[:MAX_CAPTURES]
            baseline.begin = learned.text("begin", "")
            baseline.end = learned.text("end", "")
            learned.done()
    lines: dict[Pair, Table] = {}
    for table in file.tables("pair", MAX_PAIRS):
        with file.troubles:
            norm = _norm(table)
            pair = (norm.client, norm.server)
            if pair in lines:
                first = lines[pair]
                told = f"{pair[0]} and {pair[1]} are already defined: {first.where}, line {first.line}"
                raise table.fail("client", told)
            lines[pair] = table
            baseline.pairs[pair] = norm
    file.done()
    return baseline


def _address(table: Table, key: str) -> str:
    """Return an address in the form that the analysis uses."""
    written = table.text(key)
    try:
        return address_text(ip_address(written).packed)
    except ValueError:
        raise table.fail(key, f'{shown(written)} is not an address such as "10.0.0.5"') from None


def _norm(table: Table) -> PairNorm:
    norm = PairNorm(_address(table, "client"), _address(table, "server"))
    norm.server_ports = _ports(table)
    for key in NAME_KEYS:
        setattr(norm, key, names_of(table, key))
    for name in sorted(norm.functions or ()):
        meant = _function_meant(name)
        if meant:
            raise table.fail("functions", f"{shown(name)} is not how a function is written: {shown(meant)}")
    for name in sorted(norm.acts or ()):
        if name not in ACTS:
            raise table.fail("acts", f"{shown(name)} is not an act{close_to(name, ACTS)}")
    for key, areas in (("reads", norm.reads), ("writes", norm.writes)):
        for name in sorted(areas or ()):
            meant = _area_meant(name)
            if meant:
                raise table.fail(key, f"{shown(name)} is not how an area is written: {shown(meant)}")
    norm.connections = _count(table, "connections") or 0
    norm.transactions = _count(table, "transactions") or 0
    norm.seconds = _measure(table, "seconds") or 0.0
    norm.longest_silence = _measure(table, "longest_silence")
    rate = _inline(table, "rate")
    if rate is not None:
        for key in _RATE:
            setattr(norm, key, _count(rate, key))
        _measure(rate, "mean")  # only for readers of the file: it follows from transactions and seconds
        rate.done()
    answers = _inline(table, "answer_ms")
    if answers is not None:
        for key, name in _ANSWER.items():
            setattr(norm, name, _measure(answers, key))
        answers.done()
    table.done()
    return norm


@cache
def _functions() -> dict[str, list[str]]:
    """Return the names of functions by their letters only, because some are written in two ways; those of S7comm come first."""
    from dissect.meaning.select.getters import function_names  # imported late, because few commands load a baseline

    found: dict[str, list[str]] = {}
    for name in function_names():
        found.setdefault(_letters(name), []).append(name)
    return found


def _letters(name: str) -> str:
    return "".join(filter(str.isalnum, name.lower()))


def _function_meant(name: str) -> str:
    """Return the right spelling of a function; empty if the name is already right.

    A name that is only similar to another one may belong to a dictionary or to a subfunction: USEND is not BSEND misspelt.
    """
    meant = _functions().get(_letters(name), [name])
    return "" if name in meant else meant[0]


def _area_meant(name: str) -> str:
    """Return the area of an address, or the notation of areas; empty if the text is an area, or may be one."""
    from dissect.meaning.select.literals import place_of

    plain = name.replace(" ", "").upper()
    place = place_of(plain)
    if plain in _LETTERS or (place is not None and place.whole):
        return plain if plain != name else ""
    if place is None or place.area < 0:
        return ""
    letters = AREA_LETTERS[place.area]
    return f"{letters}{place.db}" if place.area in DB_AREAS else letters


def _inline(table: Table, key: str) -> Table | None:
    table.mark(key)
    return table.inside(table.content[key], key, key) if table.has(key) else None


def _ports(table: Table) -> frozenset[int] | None:
    if not table.has("server_ports"):
        table.mark("server_ports")
        return None
    ports = table.items("server_ports")
    for port in ports:
        if not isinstance(port, int) or isinstance(port, bool) or not 0 <= port <= _MAX_PORT:
            raise table.fail("server_ports", f"{shown(port)} is not a port")
    return frozenset(ports)


def _count(table: Table, key: str) -> int | None:
    if not table.has(key):
        table.mark(key)
        return None
    number = table.number(key)
    if number < 0:
        raise table.fail(key, f"{number} is below 0")
    return number


def _measure(table: Table, key: str) -> float | None:
    measure = table.real(key)
    if measure is not None and measure < 0:
        raise table.fail(key, f"{measure} is below 0")
    return None if measure is None else float(measure)
