"""`s7dissect diff`: what changed from one session to another, in words, JSON or JUnit XML."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import click

from dissect.cli.golden import read_capture
from dissect.cli.look import write_text
from dissect.cli.main import EXIT_GATE, EXIT_INTERRUPTED, EXIT_OK, EXIT_USAGE
from dissect.cli.options.scd import scd_options
from dissect.cli.run import format_option, write
from dissect.golden.comparison import differences
from dissect.golden.difference import KINDS, Difference, DiffOptions
from dissect.golden.model import GoldenError, Session
from dissect.golden.reading import is_golden, load_golden
from dissect.report import words
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from dissect.engine.payload import PayloadDecoder

DIFF_SCHEMA = "s7dissect.diff/1"

_EXIT_CODES = (
    "Exit code: 0 no differences, 1 differences, 2 wrong use, an unreadable file, or a damaged one (differences are reported, "
    "but unreliable), 5 the output could not be written, 130 interrupted."
)
_WIDTH = 76
_IGNORABLE = "\n".join(
    [textwrap.fill(f"{name:<11} {text}", _WIDTH, subsequent_indent=" " * 12) for name, text in KINDS.items()]
)


@click.command("diff", epilog=f"{_EXIT_CODES}\n\n\b\nKinds of differences for --ignore:\n{_IGNORABLE}")
@click.argument("first", metavar="A", type=click.Path())
@click.argument("second", metavar="B", type=click.Path())
@format_option("text", "json", "junit")
@click.option(
    "--ignore",
    multiple=True,
    metavar="WHAT",
    help="Ignore this kind of difference: a name from the list below, or NAME:PATTERN with * and ?, such as 'values:DB10.*'; "
    "comma-separated or repeated.",
)
@click.option(
    "--latency",
    metavar="TOLERANCE",
    help="Also compare answer times; shifts up to the tolerance (20%, 5ms or 20%,5ms) are ignored.",
)
@click.option(
    "--max",
    "most",
    type=click.IntRange(min=0),
    default=100,
    show_default=True,
    help="Maximum number of differences.",
)
@scd_options
def command(
    first: str,
    second: str,
    format_: str,
    ignore: tuple[str, ...],
    latency: str | None,
    most: int,
    decoder: PayloadDecoder | None,
) -> int:
    """Report what changed from A to B, each a capture or a golden (see `s7dissect golden`).

    Transactions are matched by their request, not by their position, so one added or missing request is one difference.
    Times, addresses and reference numbers are not compared; answer times only with --latency.
    """
    try:
        options = DiffOptions([part for text in ignore for part in text.split(",") if part], latency)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    if first == "-" and second == "-":
        raise click.UsageError("only one of A and B can be standard input.")
    try:
        a, code_a = _load(first, decoder)
        b, code_b = _load(second, decoder)
    except GoldenError as error:
        raise click.ClickException(printable(str(error))) from None
    if EXIT_INTERRUPTED in {code_a, code_b}:
        return EXIT_INTERRUPTED
    found = differences(a, b, options)
    shown = list(islice(found, most))
    rest = sum([1 for _ in found])
    if format_ == "text":
        write_text(text_lines(a, b, shown, rest))
    else:
        write((_json if format_ == "json" else junit_lines)(a, b, shown, rest))
    if code_a or code_b:
        return EXIT_USAGE
    return EXIT_GATE if shown or rest else EXIT_OK


def _load(path: str, decoder: PayloadDecoder | None) -> tuple[Session, int]:
    if path != "-" and Path(path).is_file() and is_golden(path):
        return load_golden(path), EXIT_OK
    return read_capture((path,), decoder)


def text_lines(_a: Session, _b: Session, shown: list[Difference], rest: int) -> Iterator[str]:
    """Yield the differences as lines; ``rest`` more are not shown."""
    for difference in shown:
        yield difference.text
    if rest:
        yield f"and {words.count(rest, 'further difference')}"


def _json(a: Session, b: Session, shown: list[Difference], rest: int) -> Iterator[str]:
    yield from json_lines({"schema": DIFF_SCHEMA, **json_values(a, b, shown, rest)})


def json_values(a: Session, b: Session, shown: list[Difference], rest: int) -> dict[str, object]:
    """Return the differences as JSON-ready values; ``rest`` more are not shown."""
    return {
        "a": encodable(a.name),
        "b": encodable(b.name),
        "same": not shown and not rest,
        "count": len(shown) + rest,
        "not_shown": rest,
        "damage": [encodable(text) for text in (*a.damage, *b.damage)],
        "differences": [difference.as_dict() for difference in shown],
    }


def json_lines(values: dict[str, object]) -> Iterator[str]:
    """Yield an object as JSON for people."""
    yield json.dumps(values, indent=2).replace("\x7f", "\\u007f")


def junit_lines(
    a: Session, b: Session, shown: list[Difference], rest: int, errors: Iterable[tuple[str, str]] = ()
) -> Iterator[str]:
    """Yield them as JUnit XML: one test case for each connection of A, and one for what only B has.

    Damage of the files and ``errors`` (type, text) are a case each that could not be tried.
    """
    broken = [*[("damaged", text) for text in (*a.damage, *b.damage)], *errors]
    cases: dict[int, list[Difference]] = {link.number: [] for link in a.links}
    for difference in shown:
        cases.setdefault(difference.connection, []).append(difference)
    failed = len([1 for told in cases.values() if told])
    suite = ElementTree.Element(
        "testsuite",
        name=printable(f"s7dissect diff {a.name} {b.name}"),
        tests=str(len(cases) + bool(rest) + len(broken)),
        failures=str(failed + bool(rest)),
        errors=str(len(broken)),
        skipped="0",
    )
    for number, told in sorted(cases.items()):
        name = f"connection {number}" if number else "added connections"
        _case(suite, name, printable(a.name), told)
    if rest:
        case = ElementTree.SubElement(suite, "testcase", classname=printable(a.name), name="further differences")
        ElementTree.SubElement(
            case, "failure", type="more", message=f"{words.count(rest, 'further difference')} not shown"
        )
    for kind, text in broken:
        case = ElementTree.SubElement(suite, "testcase", classname=printable(a.name), name=printable(f"{kind}: {text}"))
        ElementTree.SubElement(case, "error", type=kind, message=printable(text))
    ElementTree.indent(suite)
    yield '<?xml version="1.0" encoding="utf-8"?>'
    yield ElementTree.tostring(suite, encoding="unicode")


def _case(suite: ElementTree.Element, name: str, classname: str, told: Iterable[Difference]) -> None:
    case = ElementTree.SubElement(suite, "testcase", classname=classname, name=name)
    found = list(told)
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        kinds = ",".join(sorted({difference.kind for difference in found}))
        failure = ElementTree.SubElement(case, "failure", type=kinds, message=printable(found[0].text) + more)
        failure.text = "\n".join([printable(difference.text) for difference in found])
