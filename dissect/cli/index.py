"""`s7dissect index`: a catalogue of a folder of captures, and which of its files can answer a question."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect import __version__
from dissect.cli.display import clock
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.options.select import where_option
from dissect.cli.run import drive
from dissect.meaning.report import words
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import Outcome
from dissect.meaning.report.styled import DIM, FAILED, HEADING, PLAIN, Line
from dissect.packets.source.packet import CaptureError
from dissect.wire.text import Clock, duration_text, encodable, printable, some

if TYPE_CHECKING:
    from dissect.files.index.facts import FileFacts
    from dissect.files.index.possible import Possible
    from dissect.files.index.store import Store
    from dissect.files.index.update import Changes

INDEX_SCHEMA: Final = "s7dissect.index/1"
#: Findings that a line names.
_NAMED: Final = 3


@click.command(
    "index",
    epilog="Exit code: 0 success, 2 wrong use or an unreadable folder, 3 a file that cannot be read or is damaged, 5 the index "
    "or the output could not be written, 130 interrupted.",
)
@click.argument("folder", type=click.Path(file_okay=False, readable=False), metavar="DIR")
@where_option(help="Only the names of the files from which this expression can select something, one per line.")
@format_option(OUTCOME)
@click.option("-0", "--null", is_flag=True, help="With -Y: the names alone, each ended by a NUL byte, for xargs -0.")
@click.option("--no-update", is_flag=True, help="Use the index as it is, without looking at the files.")
@click.option(
    "--file",
    "index_file",
    type=click.Path(dir_okay=False, readable=False),
    metavar="INDEX",
    help="Keep the index here.  [default: in the cache of the user]",
)
@click.option("--here", is_flag=True, help="Keep the index in DIR, where it is used from then on.")
def command(
    folder: str,
    where: str | None,
    format_: Format,
    null: bool,
    no_update: bool,
    index_file: str | None,
    here: bool,
) -> int:
    """Keep an index of the captures in a folder: what each holds, and which of them can answer a question.

    A file is read once, and again only after it changed. For each file the index has the time range, the addresses of the
    connections, the number of messages, transactions and errors, and the findings. With -Y it names the files from which the
    expression can select something, so that other commands need not open the rest; addresses, ports, times and findings rule
    files out, whatever else the expression says.
    """
    from dissect.files.index.facts import continued
    from dissect.files.index.place import index_of, made_room
    from dissect.files.index.store import NAME, Store, StoreError

    if here and index_file is not None:
        raise click.UsageError("--here and --file cannot be combined.")
    if null and where is None:
        raise click.UsageError("-0 needs -Y.")
    if not folder:  # `Path` would take it for the current folder
        raise click.ClickException("the name of the folder is empty; was a variable of the shell not set?")
    possible = _possible(where)
    place = Path(folder)
    if not place.is_dir():
        raise click.ClickException(f"{printable(folder)}: no such folder")
    path = Path(index_file) if index_file is not None else place / NAME if here else index_of(place)
    if no_update and not path.is_file():
        raise click.ClickException(f"{printable(str(path))}: there is no index yet; run without --no-update.")
    try:
        if not here and index_file is None and not no_update:
            made_room(path)
        with Store(path, __version__, changes=not no_update) as store:
            changes = None if no_update else _updated(store, place)
            code = _complain(changes)
            known = list(store.files())
            files = [facts for facts in known if possible is None or possible(facts)]
            if null:
                _write_raw(folder, files)
            else:
                listing = IndexListing(folder, files, changes, clock(), possible is not None, continued(known))
                write_outcome(format_, OUTCOME, listing)
            return code
    except StoreError as error:
        if error.full:
            raise OSError(error.full, "No space left on device", str(path)) from None
        raise click.ClickException(printable(str(error))) from None


def _possible(where: str | None) -> Possible | None:
    if where is None:
        return None
    from dissect.files.index.possible import Possible
    from dissect.meaning.select import SelectError

    try:
        return Possible(where, clock().local)
    except SelectError as error:
        raise click.BadParameter(str(error), param_hint="'-Y' / '--where'") from None


def _updated(store: Store, folder: Path) -> Changes:
    from dissect.files.index.facts import filled, watched
    from dissect.files.index.update import update

    def read(path: str, facts: FileFacts) -> FileFacts | str | None:
        run, seen = watched(path)
        try:
            code = drive(run, (path,))
        except CaptureError as error:
            return str(error).removeprefix(f"{printable(path)}: ")  # the report names it
        return None if code == EXIT_INTERRUPTED else filled(facts, run, seen)

    return update(store, folder, read)


def _complain(changes: Changes | None) -> int:
    """Report on stderr the files that could not be read; return the exit code."""
    if changes is None:
        return EXIT_OK
    for name, why in sorted({**changes.unreadable, **changes.damaged}.items()):
        click.echo(f"s7dissect: {printable(name)}: {printable(why)}", err=True)
    if not changes.whole:
        click.echo("s7dissect: interrupted; the index covers the files that were read so far", err=True)
        return EXIT_INTERRUPTED
    return EXIT_DAMAGED if changes.unreadable or changes.damaged else EXIT_OK


def _write_raw(folder: str, files: list[FileFacts]) -> None:
    """Write the names unchanged, each ended by a NUL."""
    sys.stdout.buffer.write(b"".join([os.fsencode(_path(folder, facts)) + b"\0" for facts in files]))
    sys.stdout.buffer.flush()


def _path(folder: str, facts: FileFacts) -> str:
    """Return the path of a file, its folder as the user wrote it."""
    return os.path.join(folder, facts.name)  # noqa: PTH118


class IndexListing(Outcome):
    """Files of an index, and the changes by the update, None without one; as text only ``names``.

    ``continued`` are files that continue another one, each with that one.
    """

    def __init__(
        self,
        folder: str,
        files: list[FileFacts],
        changes: Changes | None,
        clock: Clock,
        names: bool = False,
        continued: Mapping[str, str] | None = None,
    ) -> None:
        self._names = names
        self._folder = folder
        self._files = files
        self._continued = {} if continued is None else continued
        self._changes = changes
        self._clock = clock

    def text(self) -> Iterator[Line]:
        """Return a line or two for each file, and the changes; or only the names."""
        if self._names:
            for facts in self._files:
                yield Line(printable(_path(self._folder, facts)), PLAIN)
            return
        for facts in self._files:
            yield Line(printable(facts.name), HEADING, 4)
            before = self._continued.get(facts.name)
            goes_on = f"; continues {printable(before)}" if before is not None else ""
            yield Line(f"  {_contents(facts, self._clock)}{goes_on}", PLAIN, 6)
            if facts.findings:
                yield Line(f"  {_findings(facts)}", PLAIN, 6)
            if facts.damage:
                yield Line(f"  {printable(facts.damage)}", FAILED, 6)
        total = words.count(len(self._files), "file")
        changes = self._changes
        if changes is not None:
            total += f": {len(changes.read)} read, {changes.unchanged} unchanged since the last time"
            if changes.gone:
                total += f", {len(changes.gone)} gone"
            folders = len([name for name in changes.unreadable if name.endswith("/")])
            kinds = {"file": len(changes.unreadable) - folders, "folder": folders}
            unread = " and ".join([words.count(count, kind) for kind, count in kinds.items() if count])
            if unread:
                total += f"; {unread} could not be read"
        yield Line(total, DIM, 4)

    def as_dict(self) -> Mapping[str, object]:
        """Return the object of the JSON contract."""
        changes = self._changes
        return {
            "schema": INDEX_SCHEMA,
            "folder": encodable(self._folder),
            "files": [_as_dict(facts, self._continued.get(facts.name)) for facts in self._files],
            "update": None
            if changes is None
            else {
                "whole": changes.whole,
                "read": [encodable(name) for name in changes.read],
                "unchanged": changes.unchanged,
                "gone": [encodable(name) for name in changes.gone],
                "unreadable": [
                    {"name": encodable(name), "reason": encodable(why)} for name, why in changes.unreadable.items()
                ],
            },
        }


def _contents(facts: FileFacts, clock: Clock) -> str:
    if not facts.packets:
        return "no packets"
    texts = [
        f"from {clock.moment(facts.first_ns)}, {duration_text(max(0, facts.last_ns - facts.first_ns))}",
        words.count(facts.packets, "packet"),
        words.count(facts.connections, "connection"),
        words.count(facts.transactions, "transaction"),
    ]
    if facts.errors:
        texts.append(f"{facts.errors} with errors")
    if facts.unanswered:
        texts.append(f"{facts.unanswered} unanswered")
    return ", ".join(texts)


def _findings(facts: FileFacts) -> str:
    from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES

    known = [slug for slug in facts.findings if slug in CATALOGUE]
    known.sort(key=lambda slug: (SEVERITIES.index(CATALOGUE[slug].severity), slug))
    return some([f"{slug} ({facts.findings[slug]})" for slug in known], _NAMED)


def _as_dict(facts: FileFacts, before: str | None) -> dict[str, object]:
    from dissect.packets.tcp.stream import address_text

    clock = Clock()
    return {
        "name": encodable(facts.name),
        "octets": facts.size,
        "packets": facts.packets,
        "first_time": clock.iso(facts.first_ns) if facts.packets else None,
        "last_time": clock.iso(facts.last_ns) if facts.packets else None,
        "pdus": facts.pdus,
        "connections": facts.connections,
        "transactions": facts.transactions,
        "with_errors": facts.errors,
        "unanswered": facts.unanswered,
        "findings": dict(facts.findings),
        "hosts": sorted({address_text(end) for pair in facts.pairs for end in (pair[0], pair[2])}),
        "all_hosts": facts.all_pairs,
        "damage": encodable(facts.damage) or None,
        "continues": None if before is None else encodable(before),
    }
