"""`s7dissect scd compile`, `dump`, `check` and `diff`: dictionaries as files."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.display import write_text
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_GATE, EXIT_OK
from dissect.cli.run import write
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import LINE, Outcome, plain
from dissect.meaning.report.styled import FAILED, Line
from dissect.wire.config.saving import save
from dissect.wire.text import count, encodable, printable

if TYPE_CHECKING:
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.difference import Change, Comparison
    from dissect.scd.errors import DictionaryError
    from dissect.scd.foreign import Note

_CHECK_SCHEMA: Final = "s7dissect.scd-check/1"
_DIFF_SCHEMA: Final = "s7dissect.scd-diff/1"
_FILE: Final = click.Path(exists=False, dir_okay=False, readable=False)
#: Exit codes of `diff` by the kind of difference.
_DIFFERENT: Final = {"same": EXIT_OK, "names": EXIT_GATE, "wire": 2}
_LEVELS: Final = {
    "same": "the same bytes",
    "names": "only names, texts, units or limits differ: both decode alike",
    "wire": "they decode differently",
}
#: The end of the help of a command that writes one thing.
WRITING: Final = (
    "Exit code: 0 success, 2 wrong use, or an input that is unreadable or invalid, 5 the output could not be written."
)
encoding_option = click.option(
    "--encoding",
    default="",
    metavar="NAME",
    help="Encoding of an EDS or DCF other than UTF-8 and Latin-1, such as cp1251.",
)

#: The highest node id of POWERLINK; those of CANopen end at 127.
_LAST_NODE: Final = 254
node_option = click.option(
    "--node", type=click.IntRange(1, _LAST_NODE), metavar="N", help="Node id, for an EDS whose values depend on it."
)


def open_dictionary(path: str, encoding: str = "", node: int | None = None) -> tuple[Dictionary, tuple[Note, ...]]:
    """Return the dictionary of a file of any kind, with the notes of an import; raises `DictionaryError`, OSError."""
    from dissect.scd.loading import import_file, is_description, load

    if is_description(path):
        return import_file(path, encoding, node)
    if encoding:
        raise click.UsageError("--encoding applies to EDS and DCF files only.")
    if node is not None:
        raise click.UsageError("--node applies to device descriptions (EDS, DCF, XDD, XDC) only.")
    return load(path), ()


def columns(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows of cells as aligned lines."""
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)] if rows else []
    for row in rows:
        yield "  ".join([cell.ljust(width) for cell, width in zip(row, widths, strict=True)]).rstrip()


def tell_notes(path: str, notes: Sequence[Note]) -> None:
    """Report on stderr the parts that an import does not keep."""
    for note in notes:
        click.echo(f"s7dissect: {printable(path)}: {printable(str(note))}", err=True)


def as_json(values: object) -> str:
    """Return one line of JSON in ASCII."""
    return json.dumps(values, separators=(",", ":")).replace("\x7f", "\\u007f")


# ---- compile --------------------------------------------------------------------------------------------------------


@click.command("compile", epilog=WRITING)
@click.argument("source", type=_FILE, metavar="SRC")
@click.option("-o", "--output", required=True, metavar="OUT", help="The compiled file; - is standard output.")
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never SRC).")
@encoding_option
@node_option
def compile_command(source: str, output: str, force: bool, encoding: str, node: int | None) -> int:
    """Compile SRC: TOML or JSON, EDS or DCF (CANopen), XDD or XDC (POWERLINK, CANopen), by its suffix.

    The same source always gives the same bytes. What SCD cannot represent of a device description is reported on stderr.
    """
    from dissect.cli.second_pass import check_out

    check_out((source,), output, force)
    dictionary, notes = _source(source, encoding, node)
    tell_notes(source, notes)
    if output == "-":
        sys.stdout.buffer.write(dictionary.octets)
        sys.stdout.buffer.flush()
        return EXIT_OK
    save(output, dictionary.octets)
    write_text([f"{printable(output)}: {len(dictionary.octets)} bytes", *_summary(dictionary)])
    return EXIT_OK


def _source(path: str, encoding: str, node: int | None) -> tuple[Dictionary, tuple[Note, ...]]:
    from dissect.scd.loading import compile_source, is_description

    if is_description(path) or encoding or node is not None:
        return open_dictionary(path, encoding, node)
    return compile_source(path), ()


def _summary(od: Dictionary) -> Iterator[str]:
    own = len(od.body.types) + len(od.body.structs)
    envelope = "an envelope of its own" if od.envelope is not None else "the default envelope"
    name = printable(f"{od.name} {od.version}".strip())
    numbers = ((len(od), "object"), (own, "type"), (len(od.tpdo), "TPDO"), (len(od.rpdo), "RPDO"))
    yield f"  {name}: {', '.join([count(number, one) for number, one in numbers])}, {envelope}"
    yield f"  file id  {od.file_id.hex()}"
    yield f"  wire id  {od.wire_id.hex()}"


# ---- dump -----------------------------------------------------------------------------------------------------------


@click.command("dump", epilog=WRITING)
@click.argument("file", type=_FILE, metavar="FILE")
@click.option("--toml", "form", flag_value="toml", default="toml", help="TOML (default).")
@click.option("--json", "form", flag_value="json", help="JSON with the same structure.")
@encoding_option
@node_option
def dump_command(file: str, form: str, encoding: str, node: int | None) -> int:
    """Write a dictionary as a source that compiles to the same bytes."""
    from dissect.scd.dump import dump_json, dump_toml

    dictionary, notes = open_dictionary(file, encoding, node)
    tell_notes(file, notes)
    text = dump_json(dictionary) if form == "json" else dump_toml(dictionary)
    write([text.removesuffix("\n")])
    return EXIT_OK


# ---- check ----------------------------------------------------------------------------------------------------------


@click.command(
    "check",
    epilog="Exit code: 0 all dictionaries are valid, 1 one is not, 2 wrong use or an unreadable file, 5 the output could not "
    "be written.",
)
@click.argument("files", nargs=-1, required=True, type=_FILE, metavar="FILE...")
@format_option(OUTCOME)
@encoding_option
@node_option
def check_command(files: tuple[str, ...], format_: Format, encoding: str, node: int | None) -> int:
    """Check dictionaries of any kind and list their contents: PDOs with their sizes, and identities.

    Every broken rule is reported with its place (line of the key, index, byte) and the requirement that it breaks.
    """
    from dissect.scd.errors import DictionaryError

    code = EXIT_OK
    for file in files:
        try:
            dictionary, notes = open_dictionary(file, encoding, node)
        except DictionaryError as error:
            code = EXIT_GATE
            write_outcome(format_, OUTCOME, _Broken(file, (error, *error.others)))
            continue
        write_outcome(format_, OUTCOME, _CheckedDictionary(file, dictionary, notes))
    return code


class _Broken(Outcome):
    """A dictionary that breaks rules."""

    layout = LINE

    def __init__(self, file: str, errors: Sequence[DictionaryError]) -> None:
        self._file = file
        self._errors = errors

    def text(self) -> list[str | Line]:
        """Return a line for each error."""
        return [Line(printable(str(one)), FAILED, 4) for one in self._errors]

    def as_dict(self) -> dict[str, object]:
        """Return the errors with their places."""
        return _error_json(self._file, self._errors)


class _CheckedDictionary(Outcome):
    """A dictionary that keeps all rules."""

    layout = LINE

    def __init__(self, file: str, dictionary: Dictionary, notes: Sequence[Note]) -> None:
        self._what = file, dictionary, notes

    def text(self) -> Iterator[Line]:
        """Return its contents, and the parts of its source that were not kept."""
        file, dictionary, notes = self._what
        lost = [f"  not kept: {printable(str(note))}" for note in notes]
        return plain([f"{printable(file)}: valid", *_summary(dictionary), *_pdos(dictionary), *lost])

    def as_dict(self) -> dict[str, object]:
        """Return its contents."""
        return _check_json(*self._what)


def _pdos(od: Dictionary) -> Iterator[str]:
    rows = []
    for pdo in (*od.tpdo.values(), *od.rpdo.values()):
        size = count(pdo.size, "byte") if pdo.map else "off"
        rows.append([f"  {pdo.direction}{pdo.number}", f"0x{pdo.mapping.index:04x}", size, printable(pdo.name)])
    yield from columns(rows)


def _check_json(file: str, od: Dictionary, notes: Sequence[Note]) -> dict[str, object]:
    pdos = [
        {
            "pdo": f"{pdo.direction}{pdo.number}",
            "name": encodable(pdo.name),
            "mapping": pdo.mapping.index,
            "bits": pdo.bits,
            "variables": [list(row.variable.address) for row in pdo.map],
        }
        for pdo in (*od.tpdo.values(), *od.rpdo.values())
    ]
    return {
        "schema": _CHECK_SCHEMA, "file": encodable(file), "error": None, "name": encodable(od.name),
        "version": encodable(od.version), "objects": len(od), "types": len(od.body.types) + len(od.body.structs),
        "pdos": pdos, "file_id": od.file_id.hex(), "wire_id": od.wire_id.hex(),
        "notes": [{"text": encodable(note.text), "places": list(note.places)} for note in notes],
    }  # fmt: skip


def _error_json(file: str, errors: Sequence[DictionaryError]) -> dict[str, object]:
    rows = [
        {
            "code": error.code, "where": encodable(error.where), "detail": encodable(error.detail),
            "rule": error.rule or None, "line": error.line or None, "index": error.index if error.index >= 0 else None,
        }
        for error in errors
    ]  # fmt: skip
    return {"schema": _CHECK_SCHEMA, "file": encodable(file), "error": rows[0], "errors": rows}


# ---- diff -----------------------------------------------------------------------------------------------------------


@click.command(
    "diff",
    epilog="Exit code: 0 identical bytes, 1 only names, texts, units or limits differ, 2 they decode differently, or (with a "
    "line on stderr) wrong use or an unreadable file, 5 the output could not be written.",
)
@click.argument("first", type=_FILE, metavar="A")
@click.argument("second", type=_FILE, metavar="B")
@format_option(OUTCOME)
@encoding_option
@node_option
def diff_command(first: str, second: str, format_: Format, encoding: str, node: int | None) -> int:
    """Report how two dictionaries differ, and whether they decode differently ("wire")."""
    from dissect.scd.difference import compare
    from dissect.scd.loading import is_description

    given = [(path, (encoding, node) if is_description(path) else ("", None)) for path in (first, second)]
    before, after = [open_dictionary(path, *how)[0] for path, how in given]
    comparison = compare(before, after)
    write_outcome(format_, OUTCOME, _Compared(comparison, (first, second), (before, after)))
    return _DIFFERENT[comparison.level]


class _Compared(Outcome):
    """The differences of two dictionaries, whose names are ``names``."""

    layout = LINE

    def __init__(self, comparison: Comparison, names: tuple[str, str], both: tuple[Dictionary, Dictionary]) -> None:
        self._comparison = comparison
        self._names = names
        self._both = both

    def text(self) -> Iterator[Line]:
        """Return a line for each change, and the consequences."""
        first, second = self._names
        last = f"{printable(first)} and {printable(second)}: {_LEVELS[self._comparison.level]}"
        return plain([*columns([_change(change) for change in self._comparison.changes]), last])

    def as_dict(self) -> dict[str, object]:
        """Return the changes."""
        return _diff_json(self._comparison, *self._both)


def _change(change: Change) -> list[str]:
    what = f"{_shown(change.before)} → {_shown(change.after)}"
    if not change.key:
        what = f"only in {'B' if change.before is None else 'A'}: {_shown(change.after or change.before)}"
    return ["wire" if change.wire else "names", change.place, change.key, what]


def _shown(text: str | None) -> str:
    return "nothing" if text is None else printable(text) or '""'


def _diff_json(comparison: Comparison, before: Dictionary, after: Dictionary) -> dict[str, object]:
    changes = [
        {
            "wire": change.wire,
            "place": change.place,
            "key": change.key or None,
            "before": None if change.before is None else encodable(change.before),
            "after": None if change.after is None else encodable(change.after),
        }
        for change in comparison.changes
    ]
    return {
        "schema": _DIFF_SCHEMA, "level": comparison.level, "wire_ids": [before.wire_id.hex(), after.wire_id.hex()],
        "file_ids": [before.file_id.hex(), after.file_id.hex()], "changes": changes,
    }  # fmt: skip
