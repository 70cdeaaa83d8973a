"""Write the manual pages, one for each command: `python scripts/man_pages.py FOLDER`. setup.py runs this when it builds.

The page itself is click-man's. It treats its input as roff, knows neither the examples nor the exit codes of a help text, and
does not see commands that are imported late; this module adds these three.
"""

from __future__ import annotations

import inspect
import re
import sys
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import click
from click_man.man import ManPage

from dissect import __version__
from dissect.cli.examples import EXAMPLES
from dissect.cli.main import LazyGroup, group

#: The page that describes the codes and the variables; the page of s7dissect itself repeats these tables.
COMMANDS_PAGE = Path(__file__).resolve().parent.parent / "docs" / "commands.md"
#: Characters that groff would show as others, or interpret itself.
ESCAPES = {"\\": r"\e", "-": r"\-", "'": r"\(aq", "`": r"\(ga", "^": r"\(ha", "~": r"\(ti"}
#: The names of an option, before its value.
NAMES = re.compile(r"--?\w[\w-]*(?:(?:, | / )--?\w[\w-]*)*")


def roff(text: str) -> str:
    """Return text as roff source that shows it unchanged, in all encodings of the terminal."""
    shown = "".join([_character(one) for one in text])
    return re.sub(r"^([.'])", r"\\&\1", shown, flags=re.MULTILINE)


def _character(one: str) -> str:
    if one in ESCAPES:
        return ESCAPES[one]
    if one.isascii():
        return one
    # A composed letter has the name of its parts.
    return "\\[u" + "_".join([f"{ord(part):04X}" for part in unicodedata.normalize("NFD", one)]) + "]"


def paragraphs(text: str) -> str:
    """Return the text of a help as roff: paragraphs are filled, except those that click leaves unchanged."""
    pieces = []
    for paragraph in re.split(r"\n\s*\n", inspect.cleandoc(text)):
        kept = paragraph.startswith("\b\n")
        body = roff(paragraph.removeprefix("\b\n"))
        pieces.append(f".nf\n{body}\n.fi" if kept else body)
    return "\n.PP\n".join(pieces)


class Page(ManPage):
    """A page of click-man with further sections after it."""

    def __init__(self, command: str) -> None:
        super().__init__(command)
        self.sections: list[tuple[str, list[str]]] = []

    def __str__(self) -> str:
        """Return the source of the page."""
        # Not click-man's header: it has the date of the build, and no room for names of two words.
        header = f'.TH "{self.command.upper().replace(" ", "-")}" "1" "" "s7dissect {__version__}" "s7dissect"\n.ad l\n'
        more = "".join(["\n".join([f".SH {title}", *lines, ""]) for title, lines in self.sections if lines])
        return header + super().__str__().partition("\n")[2] + more


def page_of(ctx: click.Context, summary: str) -> Page:
    """Return the page of one command; the line is its entry in the list of commands."""
    command, path = ctx.command, ctx.command_path
    page = Page(path)
    page.short_help = roff(summary.removesuffix("."))
    page.synopsis = " ".join(command.collect_usage_pieces(ctx))
    page.description = paragraphs(command.help or "")
    options = [parameter for parameter in command.get_params(ctx) if isinstance(parameter, click.Option)]
    records = [option.get_help_record(ctx) for option in options]
    page.options = [(_option(record[0]), paragraphs(record[1])) for record in records if record is not None]
    name = path.removeprefix("s7dissect").strip()
    if isinstance(command, LazyGroup):
        page.sections.append(("COMMANDS", [*_listed(path, command)]))
    if name in EXAMPLES:
        page.sections.append(("EXAMPLES", [".in 3n", ".nf", *[roff(line) for line in EXAMPLES[name]], ".fi"]))
    page.sections += [
        ("EXIT STATUS", [*_codes(command.epilog or "")] if name else [*_table("Exit codes")]),
        ("ENVIRONMENT", [] if name else [*_table("Environment")]),
        ("SEE ALSO", [*_related(path)]),
    ]
    return page


def _option(declared: str) -> str:
    """Return the names of an option in bold and its value unchanged; click-man puts its first word in bold."""
    names = NAMES.match(declared)
    assert names is not None, declared
    rest = roff(declared[names.end() :]).replace(r"\-", "-")  # click-man escapes these itself
    return re.sub(r"(,| /) ", r"\\fP\1\\~\\fB", names[0]) + " " + rest


def _listed(path: str, command: LazyGroup) -> Iterator[str]:
    """Give each command of a group with its line."""
    for name, summary in command.summaries().items():
        page = roff(f"{path}-{name}".replace(" ", "-"))
        yield from (".TP", rf"\fB{page}\fP(1)", roff(summary))


def _codes(epilog: str) -> Iterator[str]:
    """Yield the exit codes at the end of a help text."""
    said = next((text for text in epilog.split("\n\n") if text.startswith("Exit code: ")), None)
    if said is None:
        return
    listed = " ".join(said.removeprefix("Exit code: ").split())
    first, *pieces = re.split(r"(?:^|[,;] )(?:and )?(\d+) (?=[a-z-])", listed)
    assert not first, said
    for code, meaning in zip(pieces[::2], pieces[1::2], strict=True):
        sentence, _, further = meaning.removesuffix(".").partition(". ")
        yield from (".TP", rf"\fB{code}\fP", roff(sentence))
        if further:
            yield from (".PP", roff(f"{further}."))


def _table(title: str) -> Iterator[str]:
    """Give the rows of a table of the page of commands."""
    section = COMMANDS_PAGE.read_text(encoding="utf-8").split(f"\n## {title}\n", 1)[1].split("\n##", 1)[0]
    rows = re.findall(r"^\| (`?\w+`?) \| (.*) \|$", section, re.MULTILINE)
    assert rows, title
    for term, meaning in rows:
        if term == "variable":
            continue
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", meaning).replace("`", "").replace(r"\|", "|")
        yield from (".TP", rf"\fB{roff(term.strip('`'))}\fP", roff(plain))


def _related(path: str) -> Iterator[str]:
    """Give the pages above a command, and where its subject is described at length."""
    above = [roff("-".join(path.split()[:count])) for count in range(1, len(path.split()))]
    yield from [rf"\fB{name}\fP(1)," for name in above]
    if above:
        yield rf"\fBs7dissect help {path.split()[1]}\fP"
    else:
        yield r"\fBs7dissect help\fP lists further pages"


def write(folder: Path, command: click.Command, name: str, summary: str, parent: click.Context | None = None) -> int:
    """Write the page of a command and of all below it; return their number."""
    ctx = click.Context(command, parent, name, **command.context_settings)
    (folder / f"{ctx.command_path.replace(' ', '-')}.1").write_text(str(page_of(ctx, summary)), encoding="ascii")
    count = 1
    if isinstance(command, LazyGroup):
        for inner, line in command.summaries().items():
            found = command.get_command(ctx, inner)
            assert found is not None
            count += write(folder, found, inner, line, ctx)
    return count


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    print(f"{write(target, group, 's7dissect', group.help or '')} pages in {target}")
