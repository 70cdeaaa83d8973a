"""Renders the page: template, style, script and data in one file, with a policy that lets nothing else run or load."""

from __future__ import annotations

import base64
import functools
import hashlib
import importlib.util
import json
import re
from importlib.resources import files
from typing import Any, Final

from dissect.engine.transactions.operation import CONNECT
from dissect.meaning.report import words
from dissect.meaning.report.certainty import left_out, not_captured
from dissect.meaning.report.text import completeness
from dissect.output.page.data import Data
from dissect.output.page.findings import findings_of
from dissect.output.page.gathered import Gathered
from dissect.output.page.numbers import counted, grouped
from dissect.output.page.rows import Rows, file_title
from dissect.output.page.verdict import verdict
from dissect.wire.text import Clock, printable

#: The message if the template engine is missing.
NEEDS: Final = "reports need jinja2: pip install 's7dissect[report]'"
#: The parts of the script in the order in which they run, as one function: none of their names is seen outside.
SCRIPT: Final = (
    "elements", "numbers", "words", "scales", "figures", "times", "rows", "hosts", "cards", "tags", "tables", "moving", "page",
)  # fmt: skip
#: Maximum number of differences of two sessions that are listed.
MAX_DIFFERENCES: Final = 200


def is_installed() -> bool:
    """Return whether the template engine is installed."""
    return importlib.util.find_spec("jinja2") is not None


class Side:
    """One session of a page: the gathered data, and the names of its files."""

    def __init__(self, gathered: Gathered, names: list[str]) -> None:
        self.gathered = gathered
        self.names = names

    @property
    def title(self) -> str:
        """The name of the file; if there are several, that of the first and the number of others."""
        return file_title(self.names)

    def template_values(self, letter: str, prefix: str) -> dict[str, Any]:
        """Return the values that the template shows without a script."""
        gathered = self.gathered
        said = verdict(gathered)
        frames = list(said.finding.frames) if said.finding is not None else []
        return {
            "letter": letter,
            "prefix": prefix,
            "number": "AB".find(letter) if letter else 0,
            "name": self.title,
            "about": self._about(),
            "verdict": said,
            **gathered.rows.packets(frames),
            "findings": findings_of(gathered),
            "completeness": list(self._completeness()),
        }

    def _about(self) -> str:
        pipeline = self.gathered.analysis.pipeline
        if pipeline is None or not pipeline.frames:
            return "no packets"
        clock = self.gathered.rows.clock
        analysis = self.gathered.analysis
        parts = [
            f"from {words.span(clock, self.gathered.start_ns, self.gathered.end_ns)}",
            # With a selection, only selected things are counted; packets cannot be.
            *([counted(int(pipeline.frames), "packet")] if analysis.part is None else []),
            counted(self.gathered.connections.total, "connection"),
            counted(int(analysis.total), "transaction"),
        ]
        if analysis.part is not None:
            parts.append(f"selected by {printable(analysis.part.where)}")
        return ", ".join(parts)

    def _completeness(self) -> list[str]:
        gathered = self.gathered
        analysis = gathered.analysis
        told: list[str] = []
        for file in analysis.files:
            name = gathered.rows.short(printable(file.name))
            told.append(f"{name}: {counted(int(file.packets), 'packet')}, {words.size(file.octets)}")
            if file.damage:
                told.append(f"DAMAGED: {printable(file.damage)}")
            told += [printable(note) for note in file.notes[:10]]
        if analysis.pipeline is not None:
            told += [grouped(text) for text, _ in completeness(analysis.pipeline, gathered.rows.places)]
        if analysis.not_captured:
            told.append(grouped(not_captured(int(analysis.not_captured), analysis.unanswered_reasons)))
        if analysis.likely:
            told.append(left_out(analysis.likely))
        limits = (
            (gathered.gaps_not_drawn, "gap that is not drawn", "gaps that are not drawn"),
            (
                gathered.spreads_not_told_apart,
                "transaction of further functions, in no distribution and not in the table of functions",
                "transactions of further functions, in no distribution and not in the table of functions",
            ),
            (
                gathered.requests.not_followed,
                "request of too many distinct ones, not followed as a poll",
                "requests of too many distinct ones, not followed as polls",
            ),
            (
                gathered.talks.not_told_apart,
                "connection of further pairs of hosts, not in the graph",
                "connections of further pairs of hosts, not in the graph",
            ),
        )
        told += [counted(number, one, many) for number, one, many in limits if number]
        set_up = sum(analysis.operations.get(CONNECT, {}).values())
        if set_up:
            told.append(f"{counted(set_up, 'operation')} to set up a connection: in the table of connections only")
        if not gathered.requests.looked_at_all:
            told.append("too many transactions were refused: the variables are known of the first 20,000 only")
        return told


def render(sides: list[Side], version: str, differences: list[str] | None = None, left_out: int = 0) -> str:
    """Return the page of one session, or of two with their ``differences``; ``left_out`` is the number of those not listed.

    Raises ImportError with a hint when the template engine is missing.
    """
    if not is_installed():
        raise ImportError(NEEDS)
    from markupsafe import Markup

    template, style, code = _parts()
    several = len(sides) > 1
    letters = "AB" if several else [""]
    values = [
        side.template_values(letter, f"{letter.lower()}-" if several else "")
        for side, letter in zip(sides, letters, strict=True)
    ]
    made = [Data(side.gathered, side.title) for side in sides]
    if several:
        made[0].match(made[1])
        made[1].match(made[0])
    data = {"sessions": [one.as_dict() for one in made]}
    page: str = template.render(
        title=" and ".join([side.title for side in sides]),
        sides=values,
        differences=differences,
        differences_left_out=left_out,
        version=version,
        policy=policy(style, code),
        # Both are our own and contain no end tag. The data contain text from the wire, which must not end the element.
        style=Markup(style),  # noqa: S704 - see above
        script=Markup(code),  # noqa: S704
        data=Markup(embedded(data)),  # noqa: S704
    )
    return page


def prepare() -> None:
    """Read and import now everything that a page needs: a process that gives up its privileges may not be able to do so later.

    Raises ImportError with a hint when the template engine is missing.
    """
    render([Side(Gathered(Rows([], Clock(), {})), [""])], "")


@functools.cache
def _parts() -> tuple[Any, str, str]:
    """Return the template, the style and the script."""
    import jinja2

    folder = files("dissect.output.page")
    template, style = [folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.html.j2", "page.css")]
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(template), style, script()


def script() -> str:
    """Return the script of the page, made of its parts, without whole-line comments."""
    folder = files("dissect.output.page").joinpath("script")
    parts = [folder.joinpath(f"{part}.js").read_text(encoding="utf-8") for part in SCRIPT]
    bare = re.sub(r"^ *(?:/\*\*.*?\*/|//[^\n]*)\n", "", "\n".join(parts), flags=re.DOTALL | re.MULTILINE)
    return f'"use strict";\n(() => {{\n{bare}}})();\n'


def policy(style: str, script: str) -> str:
    """Return the Content-Security-Policy, which allows only this style and this script."""
    return f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; base-uri 'none'; form-action 'none'"


def shipped_policy() -> str:
    """Return the policy of the pages that this version makes, for a page that contains them."""
    _, style, script = _parts()
    return policy(style, script)


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def embedded(data: object) -> str:
    """Return data as JSON for a script element: escaped so that it can neither end the element nor begin a comment."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026").replace("\x7f", "\\u007f")
