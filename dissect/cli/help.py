"""`s7dissect help`: the manual pages. They are docs/*.md of the project, which setup.py packs into the package."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from typing import Final

import click

from dissect.cli.display import coloured
from dissect.cli.main import COMMANDS, EXIT_OK, group
from dissect.cli.options.completing import from_table
from dissect.cli.run import write

_PACKAGE: Final = Path(__file__).resolve().parent.parent
#: The folders of the pages in an installed package, and in the source tree.
_FOLDERS: Final = (_PACKAGE / "help", _PACKAGE.parent / "docs")
_SUFFIX: Final = ".md"
#: The list of the pages, in groups: the contents of `s7dissect help`, and the order in README and on the site.
_LIST: Final = "index"
#: A group of that list, and a page in it.
_GROUP: Final = re.compile(r"^## (.+)$", re.MULTILINE)
_LISTED: Final = re.compile(r"^- \[[^\]]+\]\((\S+)\.md\): (.+)$", re.MULTILINE)
#: Commands that are described together, and the page.
_PAGES: Final = {
    "analyze": "commands",
    "transactions": "commands",
    "operations": "commands",
    "show": "commands",
    "verify": "commands",
    "cut": "evidence",
    "open": "wireshark",
    "extcap": "wireshark",
    "alerts": "alerts",
    "baseline": "alerts",
    "diff": "golden",
    "fields": "select",
    "index": "folders",
    "cluster-check": "scale",
    "interfaces": "live",
    "schema": "json",
}
#: A link to a page or another file of the project, which leads nowhere outside the repository.
_LINK: Final = re.compile(r"\[([^\]]+)\]\((?!https?:)([^)#]*)(?:#[^)]*)?\)")
#: A picture, which a terminal does not show.
_PICTURE: Final = re.compile(r"^!\[[^\]]*\]\([^)]*\)\n\n?", re.MULTILINE)
#: A table: its head, the line below that, its rows. And the border between two cells.
_TABLE: Final = re.compile(r"^(\|.+)\n\|[-:| ]+\|\n((?:\|.+\n?)*)", re.MULTILINE)
_BORDER: Final = re.compile(r"(?<!\\)\|")
#: Width of long texts that can be read side by side.
_TEXTS: Final = 2
#: Columns beyond which text is hard to read.
_WIDEST: Final = 110


def _folder() -> Path:
    return next((folder for folder in _FOLDERS if folder.is_dir()), _FOLDERS[0])


def pages() -> dict[str, Path]:
    """Return each topic and the file that holds its page."""
    return {path.stem: path for path in sorted(_folder().glob(f"*{_SUFFIX}")) if path.stem != _LIST}


def groups() -> dict[str, dict[str, str]]:
    """Return the groups of topics in the order of the list, each with its topics and their descriptions."""
    path = _folder() / f"{_LIST}{_SUFFIX}"
    _, *pieces = _GROUP.split(path.read_text(encoding="utf-8") if path.is_file() else "")
    return {title: dict(_LISTED.findall(body)) for title, body in zip(pieces[::2], pieces[1::2], strict=True)}


def page(topic: str) -> str:
    """Return a page as Markdown, with its links replaced by the commands to type; raises KeyError for an unknown topic."""
    text = _PICTURE.sub("", pages()[topic].read_text(encoding="utf-8"))
    return _LINK.sub(_typed, text)


def unfolded(text: str, columns: int) -> str:
    """Return a page whose tables fit into this number of columns: a wider table becomes a list of terms and descriptions."""
    return _TABLE.sub(lambda table: table[0] if _fits(table, columns) else _rows(table), text)


def _fits(table: re.Match[str], columns: int) -> bool:
    """Return whether a table can be read in this width: no word is cut off, and texts have room for a few words a line."""
    rows = [_cells(line) for line in (table[1], *table[2].splitlines())]
    texts = sum(max(map(len, column)) > columns // 2 for column in zip(*rows, strict=True))
    return (texts < _TEXTS or len(rows[0]) <= _TEXTS + 1) and formatted(table[0], columns).count("…") == table[0].count(
        "…"
    )


def _rows(table: re.Match[str]) -> str:
    _, *names = _cells(table[1])
    lines = []
    for row in table[2].splitlines():
        term, *others = [cell.replace("\\|", "|") for cell in _cells(row)]
        lines += [f"**{term or '-'}**", ""]
        lines += [f"- {f'{name}: ' if name else ''}{cell}" for name, cell in zip(names, others, strict=True) if cell]
        lines.append("")
    return "\n".join(lines)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in _BORDER.split(line.strip().strip("|"))]


def _typed(link: re.Match[str]) -> str:
    text, target = link.groups()
    name = Path(target).name
    if not name.endswith(_SUFFIX) or name.removesuffix(_SUFFIX) not in pages() or "/" in target.removeprefix("../"):
        return text
    typed = f"`s7dissect help {name.removesuffix(_SUFFIX)}`"
    return typed if text.endswith(_SUFFIX) else f"{text} ({typed})"


def _sentences() -> dict[str, str]:
    return {topic: sentence for topics in groups().values() for topic, sentence in topics.items()}


@click.command("help", epilog="Exit code: 0 success, 2 wrong use, 5 the output could not be written.")
@click.argument(
    "topic", required=False, metavar="[TOPIC]", shell_complete=from_table(lambda: {**COMMANDS, **_sentences()})
)
@click.pass_context
def command(ctx: click.Context, topic: str | None) -> int:
    """Show the manual page of a command or topic; without one, list the commands and topics.

    On a terminal the page is formatted and shown in a pager (PAGER); otherwise it is written as Markdown.
    """
    if topic is None:
        root = ctx.find_root()
        write([*group.get_help(root).split("\n"), "", "Topics of s7dissect help:", *_topics()])
        return EXIT_OK
    known = pages()
    name = _PAGES.get(topic, topic)
    if name in known:
        _show(page(name))
    elif (subcommand := group.get_command(ctx, topic)) is not None:
        with click.Context(subcommand, ctx.find_root(), topic) as inner:
            write([subcommand.get_help(inner)])
    else:
        import difflib  # late: a run without this mistake does not need it

        near = difflib.get_close_matches(topic, [*known, *COMMANDS], n=2)
        hint = f"did you mean {' or '.join(near)}?" if near else "`s7dissect help` lists the topics."
        raise click.UsageError(f"no help on {topic!r}; {hint}")
    return EXIT_OK


def _topics() -> list[str]:
    listed = groups()
    width = max([len(topic) for topics in listed.values() for topic in topics], default=0)
    lines = []
    for title, topics in listed.items():
        lines += ["", f"{title}:", *[f"  {topic.ljust(width)}  {about}" for topic, about in topics.items()]]
    return lines


def _show(text: str) -> None:
    if not sys.stdout.isatty():
        write([text.rstrip("\n")])
        return
    width = min(shutil.get_terminal_size().columns, _WIDEST)
    colours = coloured(True)
    click.echo_via_pager(formatted(unfolded(text, width), width, colours), color=colours)


def formatted(text: str, columns: int, colours: bool = False) -> str:
    """Return Markdown as a terminal with this number of columns shows it."""
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console(
        width=columns, force_terminal=colours, no_color=not colours, color_system="standard" if colours else None
    )
    with console.capture() as captured:
        console.print(Markdown(text, hyperlinks=False))
    return captured.get()
