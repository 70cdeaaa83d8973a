"""`s7dissect tags check`, `list` and `convert`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_GATE, EXIT_OK
from dissect.cli.options.tags import guarded, load, tag_reading_options
from dissect.cli.run import complain, drive, write
from dissect.meaning.report import words
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import Outcome
from dissect.meaning.report.styled import FAILED, HEADING, PLAIN, Line
from dissect.wire.config.saving import save
from dissect.wire.text import encodable, printable, shortened

if TYPE_CHECKING:
    from dissect.meaning.tags.coverage import Coverage
    from dissect.meaning.tags.loading import TagSet
    from dissect.meaning.tags.model import Tag
    from dissect.meaning.tags.problems import Problem
    from dissect.meaning.tags.tag_file import TagFile
    from dissect.protocols.s7plus.program import Symbol

_CHECK_SCHEMA: Final = "s7dissect.tags-check/1"
_LIST_SCHEMA: Final = "s7dissect.tags-list/1"
_FILE: Final = click.Path(dir_okay=False, readable=False)
files_argument = click.argument("files", nargs=-1, required=True, type=_FILE, metavar="FILE...")
#: Overlaps, addresses without a tag and characters of a name that a text shows.
_SHOWN: Final = 20
_NAME: Final = 60
_STYLES: Final = {"error": FAILED, "warning": "warning", "note": PLAIN}
_WRITING: Final = "Exit code: 0 success, 2 wrong use, or tags that cannot be used, 5 the output could not be written."


# ---- check ----------------------------------------------------------------------------------------------------------


@click.command(
    "check",
    epilog="Exit code: 0 the files can be used, 1 they have errors, 2 wrong use or an unreadable file, 5 the output could not "
    "be written.",
)
@files_argument
@format_option(OUTCOME)
@click.option(
    "--capture",
    "captures",
    multiple=True,
    type=click.Path(readable=False),
    metavar="CAPTURE",
    help="Also report how much of the traffic in this capture the tags cover. Repeatable.",
)
@tag_reading_options
def check_command(
    files: tuple[str, ...], format_: Format, captures: tuple[str, ...], encoding: str, numbers: dict[str, int]
) -> int:
    """Check tag files together: every mistake with its line and remedy, overlaps, and which tags a capture uses.

    Files are joined: a source takes the number of its block from a symbol table, a block its types from other files.
    """
    from dissect.meaning.tags.loading import TagError, read_tags

    tags: TagSet = guarded(lambda: read_tags(files, encoding, numbers), TagError)
    coverage = _covered(tags, captures) if captures else None
    outcome = _CheckedTags(tags, coverage)
    write_outcome(format_, OUTCOME, outcome)
    return EXIT_GATE if outcome.broken else EXIT_OK


def _covered(tags: TagSet, captures: tuple[str, ...]) -> Coverage:
    from dissect.files.session import Run
    from dissect.meaning.tags.coverage import Coverage

    coverage = Coverage(tags)
    run = Run(captures, coverage)
    complain(run, drive(run, captures))
    return coverage


class _CheckedTags(Outcome):
    """The results of checking files of tags."""

    def __init__(self, tags: TagSet, coverage: Coverage | None) -> None:
        from dissect.meaning.tags.checks import overlaps

        self._tags = tags
        self._coverage = coverage
        self._overlaps, self._overlapping = overlaps(tags.tags)
        self.broken = any([problem.severity == "error" for problem in tags.problems])

    def text(self) -> Iterator[Line]:
        """Return files, problems, overlaps and coverage."""
        for file in self._tags.files:
            yield Line(f"{printable(file.path)}: {_summary(file)}", HEADING, 4)
            problems = sorted(file.problems.found, key=lambda row: row.line)
            for problem in problems:
                line = f"line {problem.line}: " if problem.line else ""
                yield Line(f"  {problem.severity}: {line}{shortened(problem.text, 1000)}", _STYLES[problem.severity], 6)
            if file.problems.more:
                yield Line(f"  and {file.problems.more} more problems", PLAIN, 6)
        for overlap in self._overlaps[:_SHOWN]:
            yield Line(f"  note: {printable(str(overlap))}", PLAIN, 6)
        if self._overlapping > _SHOWN:
            yield Line(f"  note: and {self._overlapping - _SHOWN} more overlaps", PLAIN, 6)
        errors = len([problem for problem in self._tags.problems if problem.severity == "error"])
        state = f"{words.count(errors, 'error')}: fix them to use these tags" if errors else "no errors"
        yield Line(f"{words.count(len(self._tags.tags), 'tag')}, {state}", FAILED if errors else PLAIN, 4)
        if self._coverage is not None:
            yield from _coverage_lines(self._coverage, len(self._tags.tags))

    def as_dict(self) -> dict[str, object]:
        """Return the same as values."""
        return {
            "schema": _CHECK_SCHEMA,
            "valid": not self.broken,
            "tags": len(self._tags.tags),
            "files": [_file_json(file) for file in self._tags.files],
            "overlaps": {"count": self._overlapping, "listed": [encodable(str(each)) for each in self._overlaps]},
            "coverage": _coverage_json(self._coverage, len(self._tags.tags)) if self._coverage is not None else None,
        }


def _summary(file: TagFile) -> str:
    kind = file.format or "unknown format"
    texts = [kind, words.count(len(file.tags), "tag")]
    if file.blocks:
        texts.append(words.count(len(file.blocks), "block"))
    if file.programs:
        texts.append(words.count(sum([one.count for one in file.programs.values()]), "variable") + " of S7comm-plus")
    for what, count in file.skipped.items():
        texts.append(
            f"{count} {what}"
            if what == "repeated"
            else f"{words.count(count, what.removesuffix('s'))} without an address"
        )
    if file.encoding:
        texts.append(f"read as {file.encoding}")
    return printable(", ".join(texts))


def _problem_json(problem: Problem) -> dict[str, object]:
    return {"severity": problem.severity, "line": problem.line or None, "text": encodable(problem.text)}


def _file_json(file: TagFile) -> dict[str, object]:
    return {
        "file": encodable(file.path),
        "format": file.format,
        "encoding": file.encoding or None,
        "tags": len(file.tags),
        "blocks": len(file.blocks),
        "skipped": dict(file.skipped),
        "problems": [_problem_json(problem) for problem in sorted(file.problems.found, key=lambda row: row.line)],
        "not_listed": file.problems.more,
    }


def _coverage_lines(coverage: Coverage, tags: int) -> Iterator[Line]:
    from dissect.protocols.s7.tables import AREA_LETTERS

    yield Line("", PLAIN)
    yield Line(
        f"{words.count(coverage.items, 'item')} of the capture, {len(coverage.seen)} of {tags} tags seen", HEADING, 4
    )
    for _, row in sorted(coverage.areas.items()):
        letters = AREA_LETTERS.get(row.area, f"0x{row.area:02x}")
        place = f"{letters}{row.db}" if row.db else letters
        share = 100 * row.covered // row.octets if row.octets else 0
        yield Line(
            f"  {place:<8}  {row.named} of {words.count(row.items, 'item')} named, {share} % of their bytes", PLAIN, 6
        )
    for text in coverage.disagreements():
        yield Line(f"  warning: {printable(text)}", "warning", 6)
    ranked = sorted(coverage.unknown.items(), key=lambda pair: (-pair[1], pair[0]))
    for label, count in ranked[:_SHOWN]:
        yield Line(f"  no tag: {shortened(label, _NAME)} ({words.count(count, 'time')})", PLAIN, 6)
    if len(ranked) > _SHOWN or coverage.lost:
        yield Line(f"  and {len(ranked) - _SHOWN + coverage.lost} more addresses without a tag", PLAIN, 6)


def _coverage_json(coverage: Coverage, tags: int) -> dict[str, object]:
    return {
        "items": coverage.items,
        "tags_seen": len(coverage.seen),
        "tags_not_seen": tags - len(coverage.seen),
        "areas": [
            {
                "area": row.area,
                "db": row.db,
                "items": row.items,
                "named": row.named,
                "bytes": row.octets,
                "covered": row.covered,
                "beyond": row.beyond,
            }
            for _, row in sorted(coverage.areas.items())
        ],
        "disagreements": [encodable(text) for text in coverage.disagreements()],
        "without_tag": {
            encodable(label): count
            for label, count in sorted(coverage.unknown.items(), key=lambda pair: (-pair[1], pair[0]))
        },
        "not_listed": coverage.lost,
    }


# ---- list -----------------------------------------------------------------------------------------------------------


@click.command("list", epilog=_WRITING)
@files_argument
@format_option(OUTCOME)
@tag_reading_options
def list_command(files: tuple[str, ...], format_: Format, encoding: str, numbers: dict[str, int]) -> int:
    """List tags in the order of their addresses: address, type, name, unit, comment, and what is not certain.

    A capture that holds declarations of S7comm-plus is a tag file as well: its variables are listed last, each with the address
    it has in transactions.
    """
    write_outcome(format_, OUTCOME, _TagListing(load(files, encoding, numbers)))
    return EXIT_OK


def _ordered(tags: TagSet) -> list[Tag]:
    return sorted(tags.tags, key=lambda tag: (tag.area, tag.db, tag.start, tag.name))


class _TagListing(Outcome):
    """Tags as a table."""

    def __init__(self, tags: TagSet) -> None:
        self._tags = _ordered(tags)
        self._symbols = [(host, one) for host, program in tags.programs.items() for one in program.symbols()]

    def text(self) -> Iterator[Line]:
        """Return a line for each tag."""
        rows = [(tag.address, tag.declared, shortened(_name(tag), _NAME), tag) for tag in self._tags]
        widths = [max([len(str(row[at])) for row in rows], default=0) for at in (0, 1, 2)]
        for address, type_, name, tag in rows:
            scale = f"x{tag.factor:g}{tag.shift:+g}" if tag.shift else f"x{tag.factor:g}" if tag.scaled else ""
            texts = [
                scale,
                shortened(tag.unit, 20),
                shortened(tag.comment, 80),
                f"({tag.remark})" if tag.remark else "",
            ]
            rest = "  ".join([printable(text) for text in texts if text])
            line = f"{address.ljust(widths[0])}  {type_.ljust(widths[1])}  {name.ljust(widths[2])}  {rest}"
            yield Line(line.rstrip(), PLAIN, 4)
        for host, one in self._symbols:
            yield Line(f"{host}  {one.address}  {one.declared}  {shortened(one.name, _NAME)}", PLAIN, 4)

    def as_dict(self) -> dict[str, object]:
        """Return the tags as values."""
        symbols = [_symbol_json(host, one) for host, one in self._symbols]
        return {"schema": _LIST_SCHEMA, "tags": [_tag_json(tag) for tag in self._tags], "symbols": symbols}


def _symbol_json(host: str, one: Symbol) -> dict[str, object]:
    crc = one.variable.crc
    return {
        "host": host,
        "name": encodable(one.name),
        "address": one.address,
        "type": one.declared,
        "crc": f"0x{crc:08x}" if crc else None,
    }


def _name(tag: Tag) -> str:
    return f"{tag.name}[{tag.prefix}*]" if tag.prefix else tag.name


def _tag_json(tag: Tag) -> dict[str, Any]:
    return {
        "name": encodable(_name(tag)),
        "address": tag.address,
        "type": tag.declared,
        "area": int(tag.area),
        "db": int(tag.db),
        "start_bit": int(tag.start),
        "bits": int(tag.end - tag.start),
        "count": int(tag.count),
        "unit": encodable(tag.unit) or None,
        "factor": tag.factor,
        "shift": tag.shift,
        "comment": encodable(tag.comment) or None,
        "remark": tag.remark or None,
        "file": encodable(tag.file),
        "line": int(tag.line) or None,
    }


# ---- convert --------------------------------------------------------------------------------------------------------


@click.command("convert", epilog=_WRITING)
@files_argument
@click.option(
    "-o", "--output", default="-", type=_FILE, metavar="OUT", help="Where to write the table; default: standard output."
)
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never a FILE).")
@tag_reading_options
def convert_command(files: tuple[str, ...], output: str, force: bool, encoding: str, numbers: dict[str, int]) -> int:
    """Write the tags of all files as one CSV table (address, type, name, unit, scale, comment) that every command reads."""
    from dissect.cli.second_pass import check_out
    from dissect.meaning.tags.converting import table_lines

    check_out(files, output, force)
    tags = load(files, encoding, numbers)
    if tags.programs and not tags.tags:
        raise click.ClickException(
            "the captures name variables of S7comm-plus, which have no address for a table: see 's7dissect tags list'"
        )
    lines = list(table_lines(_ordered(tags)))
    if output == "-":
        write(lines)
    else:
        save(output, ("\n".join(lines) + "\n").encode("utf-8"))
    return EXIT_OK
