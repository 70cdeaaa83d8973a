"""Writes a baseline as TOML: in a stable order, long sets with an entry on each line; equal baselines make equal files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from ipaddress import ip_address
from typing import Final

from dissect.output.baseline.norms import NAME_KEYS, Baseline, PairNorm
from dissect.output.baseline.subjects import Pair
from dissect.wire.text import count, encodable

FORMAT: Final = 1

_HEAD: Final = """\
# What is normal on this network: which client requests what from which PLC, and how often. `s7dissect baseline` learned
# it from captures; review it and adapt it to your plant. Anything that is not in here is reported by alerts
# `when = "new"` and by `s7dissect baseline --against THIS_FILE CAPTURE`.
#
# A missing key is not checked: without `writes` a pair may write anything. An empty list allows nothing.
# Acts, such as a stop, a download or a password, are never learned as normal: what was captured of them stands in comments,
# with the functions that served them. Remove the first # of a line to allow what it names.
# rate: transactions in any second and in any ten; answer_ms: milliseconds; longest_silence: seconds between transactions.
"""
#: Greatest width of a line.
_WIDTH: Final = 110
_PLAIN: Final = re.compile(r"[ !#-\[\]-~]*")
#: Digits that are sorted as one number; a name from the wire may have more digits than Python converts.
_DIGITS: Final = re.compile(r"([0-9]{1,18})")


def baseline_toml(baseline: Baseline) -> str:
    """Return a baseline as the file that `load_baseline` reads."""
    return "\n".join(_lines(baseline)) + "\n"


def _lines(baseline: Baseline) -> Iterator[str]:
    yield from _HEAD.splitlines()
    if baseline.left_out:
        yield f"# NOT COMPLETE: {baseline.left_out} entries exceeded the limits of the learner and are missing here."
    yield ""
    yield f"format = {FORMAT}"
    yield ""
    yield "[learned]"
    yield from _list("captures", [toml_text(name) for name in baseline.captures])
    if baseline.begin:
        yield f"begin = {toml_text(baseline.begin)}"
        yield f"end = {toml_text(baseline.end)}"
    for pair in sorted(baseline.pairs, key=_by_address):
        yield ""
        yield from _pair(baseline.pairs[pair])


def _pair(norm: PairNorm) -> Iterator[str]:
    yield "[[pair]]"
    yield f"client = {toml_text(norm.client)}"
    yield f"server = {toml_text(norm.server)}"
    if norm.server_ports is not None:
        yield from _list("server_ports", [str(port) for port in sorted(norm.server_ports)])
    for key in NAME_KEYS:
        names: frozenset[str] | None = getattr(norm, key)
        if names is not None:
            entries = [toml_text(name) for name in sorted(names, key=_naturally)]
            yield from _list(key, entries, _commented(norm, key, names))
    yield f"connections = {norm.connections}"
    yield f"transactions = {norm.transactions}"
    seconds = _number(norm.seconds)
    yield f"seconds = {seconds}"
    # Computed from the rounded seconds, so that a file that is read and written again stays the same.
    mean = norm.transactions / float(seconds) if float(seconds) > 0 else None
    yield from _table("rate", [("mean", mean), ("highest_1s", norm.highest_1s), ("highest_10s", norm.highest_10s)])
    yield from _table("answer_ms", [("median", norm.median_ms), ("p99", norm.p99_ms), ("longest", norm.longest_ms)])
    if norm.longest_silence is not None:
        yield f"longest_silence = {_seconds(norm.longest_silence)}"


def _table(key: str, values: Iterable[tuple[str, float | None]]) -> Iterator[str]:
    """Yield an inline table of the known values; nothing if none is known."""
    known = [f"{name} = {_number(value)}" for name, value in values if value is not None]
    if known:
        yield f"{key} = {{ {', '.join(known)} }}"


def _commented(norm: PairNorm, key: str, allowed: frozenset[str]) -> list[str]:
    """Return the entries of a list that were learned and are not allowed, each with a comment."""
    if key == "acts":
        left = [(toml_text(kind), count(times, "time")) for kind, times in sorted(norm.acts_seen.items())]
        return [f"{kind},  # {times} in what was learned" for kind, times in left if kind[1:-1] not in allowed]
    if key == "functions":
        served = sorted(norm.functions_seen - allowed, key=_naturally)
        return [f"{toml_text(name)},  # only of acts" for name in served]
    return []


def _list(key: str, entries: list[str], commented: list[str] | None = None) -> Iterator[str]:
    """Yield a list on one line or, if that is too long or entries are ``commented`` out, on several."""
    line = f"{key} = [{', '.join(entries)}]"
    if len(line) <= _WIDTH and not commented:
        yield line
        return
    yield f"{key} = ["
    row = "   "
    for entry in entries:
        if len(row) + len(entry) + 2 > _WIDTH and row.strip():
            yield row
            row = "   "
        row += f" {entry},"
    if row.strip():
        yield row
    for entry in commented or ():
        yield f"    # {entry}"
    yield "]"


def _number(value: float) -> str:
    """Return a number with six significant digits, never with an exponent."""
    if isinstance(value, int):
        return str(value)
    text = f"{value:.9f}" if abs(value) < 1000 else f"{value:.3f}"
    whole, _, part = text.partition(".")
    keep = max(6 - len(whole.lstrip("-0")), 0)
    zeros = len(part) - len(part.lstrip("0")) if whole in {"0", "-0"} else 0
    return f"{whole}.{part[: keep + zeros].rstrip('0') or '0'}"


def _seconds(value: float) -> str:
    """Return seconds with microseconds: a silence must not count as longer because of rounding."""
    whole, _, part = f"{value:.6f}".partition(".")
    return f"{whole}.{part.rstrip('0') or '0'}"


def toml_text(text: str) -> str:
    """Return a TOML string on one line, in ASCII, everything else escaped; text that UTF-8 cannot encode as by `encodable`."""
    if _PLAIN.fullmatch(text):
        return f'"{text}"'
    return '"' + "".join([_escaped(character) for character in encodable(text)]) + '"'


def _escaped(character: str) -> str:
    code = ord(character)
    if character in '"\\':
        return "\\" + character
    if 0x20 <= code < 0x7F:
        return character
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _by_address(pair: Pair) -> tuple[tuple[int, int, bytes, str], ...]:
    """Return the sort key of a pair: by server, then by client, IPv4 before IPv6, addresses by number."""
    return tuple([_address_key(host) for host in reversed(pair)])


def _address_key(host: str) -> tuple[int, int, bytes, str]:
    try:
        address = ip_address(host)
    except ValueError:
        return 1, 0, b"", host
    return 0, address.version, address.packed, ""


def _naturally(name: str) -> list[tuple[int, str]]:
    """Return the sort key of a name, by which DB2 comes before DB10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in _DIGITS.split(name)]
