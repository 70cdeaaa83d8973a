"""The words of texts for people: banned phrases in literals, help, pages and schemas; markers in docstrings and comments."""

from __future__ import annotations

import ast
import io
import json
import re
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[1]
ROOMS: Final = (
    "cli",
    "findings",
    "report",
    "monitor",
    "alerts",
    "baseline",
    "playback",
    "golden",
    "metrics",
    "testing",
    "tags",
    "config",
)
#: Phrases of translated English, and words that are not the field's.
BANNED: Final = re.compile(
    r"\b(?:[Oo]ctets?|[Ss]omebody|[Tt]old once|[Ss]aid once|unless said|not any more|not believed|no hole|holes in the"
    r"|other octets than|who sits|is to deceive|cannot be meant|go on as nobody|so many times|without a word"
    r"|[Aa]new|any ?more|no reading (?:the|a) file|(?:[Ii]s|was|are) told|told (?:of|twice|a single time)|tells besides"
    r"|nobody asked|holds? against|stands? (?:beside|behind|for itself))\b"
)
#: What may stand: file or room, a piece of the text, and why.
ALLOWED: Final = (
    ("golden/", "octets", "a keyword of the golden format, which has to be read back"),
    ("cli/scd_encode", "octets", "a name of a key"),
    ("layers", "octets", "names of fields and classes"),
)


def literals(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the line and text of every literal of a module with a space in it, docstrings only of commands."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docstrings = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.body:
            first = node.body[0]
            command = isinstance(node, ast.FunctionDef) and any(
                ["command" in ast.unparse(decorator) for decorator in node.decorator_list]
            )
            if isinstance(first, ast.Expr) and not command:
                docstrings.add(id(first.value))
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            if id(node) not in docstrings:
                yield node.lineno, node.value


def descriptions(value: object) -> Iterator[str]:
    """Yield every title and description of a schema."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key in {"title", "description"} and isinstance(inner, str):
                yield inner
            else:
                yield from descriptions(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from descriptions(inner)


def prose(text: str) -> str:
    """Return a page without its code: blocks, indented lines, names in backticks, targets of links."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^ {4}.*$", "", text, flags=re.MULTILINE)
    return re.sub(r"`[^`]*`|\]\([^)]*\)", "", text)


def wrong(where: str, text: str) -> list[str]:
    """Return the banned phrases of a text that no row of `ALLOWED` excuses."""
    return [
        found[0]
        for found in BANNED.finditer(text)
        if not any(place in where and piece in found[0] for place, piece, _ in ALLOWED)
    ]


@pytest.mark.parametrize("room", ROOMS)
def test_literals(room: str) -> None:
    found = [
        (str(path.relative_to(ROOT)), line, phrase)
        for path in sorted((ROOT / "dissect" / room).rglob("*.py"))
        for line, text in literals(path)
        for phrase in wrong(str(path), text)
    ]
    assert found == []


def test_pages() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    assert len(pages) > 20
    found = [(page.name, phrase) for page in pages for phrase in wrong(str(page), prose(page.read_text("utf-8")))]
    assert found == []


def test_schemas() -> None:
    found = []
    for path in sorted((ROOT / "dissect" / "meaning" / "schema").glob("*.json")):
        texts = list(descriptions(json.loads(path.read_text("utf-8"))))
        assert texts, path
        found += [(path.name, phrase) for text in texts for phrase in wrong(path.name, re.sub(r"`[^`]*`", "", text))]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "3 octets left",
        "Somebody told a PLC to stop.",
        "was not believed",
        "said once for a connection",
        "2 unless said",
        "is written anew",
        "or OSError where there is no reading the file",
        "a finding is told",
        "what nobody asked for",
        "what stands behind the packet",
    ],
)
def test_a_banned_phrase_is_found(text: str) -> None:
    assert wrong("dissect/meaning/report/text.py", text)


# ---- docstrings and comments ----------------------------------------------------------------------------------------

#: Marks of sentences that were thought in another language: verbs of speech for data, riddles with pronouns, odd prepositions.
#: A sentence with one may be good English. A room in which they are frequent is not.
MARKERS: Final = re.compile(
    r"\b(?:[Tt]ells?|[Tt]old|telling"
    r"|(?:is|was|are|were|be) said|said (?:of|by|on|once)|[Ss]a(?:ys?|id) (?:of|no|the same|all|nothing|something|less|more|so)"
    r"|[Ss]t(?:ands?|ood)|behind(?! (?:(?:a|the) )?malformed)|beside|[Ss]omebody|[Nn]obody|whoever|any ?more|anew"
    r"|(?:[Ww]hat|that) (?:is|are|was) (?:no|none|nothing|about|asked|told|said|wanted|left|there)"
    r"|in the place of|takes? the place|another (?:one|than)|other \w+ than"
    r"|(?:[Ww]hat|of) (?:be)?(?:comes?|came|became) of|(?:becomes?|became|comes?) of"
    r"|go(?:es|ing)? on|went on|gone through|look(?:s|ed)? at|[Aa]sk(?:s|ed)? (?:for|of)|given (?:up|away)|in the midst"
    r"|as (?:they|it) (?:are|is|stands?|stood|came|comes)(?! (?:possible|needed))|[Tt]he least (?:that|of)"
    r"|for (?:it|them)sel(?:f|ves)|none of (?:it|them)|nothing of|what no|such a one|no more(?! than)|the same of"
    r"|of which (?:everything|nothing|a)|which there|how-?manieth)\b"
    r"|(?<!\b[Tt]here )\b(?:is|are) (?:no|none)\b(?! (?:longer|such|other|more))"
)
#: The most sentences of a room that may have one.
MOST: Final = 0.05
#: Comments for tools.
_TOOLS: Final = re.compile(r"#:?\s*(?:noqa|type:|ruff|mypy|fmt|pragma|-{4})")


def prose_of(source: str) -> Iterator[str]:
    """Yield the docstrings and comments of a module, comments in adjacent lines as one."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text is not None:
                yield text
    last = -1
    lines: list[str] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not _TOOLS.match(token.string):
            if token.start[0] != last + 1:
                yield " ".join(lines)
                lines = []
            last = token.start[0]
            lines.append(token.string.lstrip("#: "))
    yield " ".join(lines)


def sentences(text: str) -> list[str]:
    """Return the sentences of a text, what is in backticks replaced; half sentences at colons and semicolons count as well."""
    text = re.sub(r"``?[^`]*``?", "X", text)
    parts = re.split(r"(?<=[.!?;:])\s+|\n\s*\n", text)
    return [part for part in parts if re.search(r"[A-Za-z]{2,}.*\s", part)]


def marked(texts: Iterable[str]) -> tuple[list[str], int]:
    """Return the sentences that have a marker, and how many there are in all."""
    every = [sentence for text in texts for sentence in sentences(text)]
    return [sentence for sentence in every if MARKERS.search(" ".join(sentence.split()))], len(every)


def rooms() -> list[str]:
    """Return the folders of the package that hold modules, those of the folders in them included."""
    package = ROOT / "dissect"
    return sorted({path.parent.relative_to(package).as_posix() for path in package.rglob("*.py")} - {"."})


@pytest.mark.parametrize("room", rooms())
def test_few_sentences_of_a_room_sound_translated(room: str) -> None:
    paths = sorted((ROOT / "dissect" / room).glob("*.py"))
    found, total = marked([text for path in paths for text in prose_of(path.read_text("utf-8"))])
    assert len(found) <= max(MOST * total, 1), "\n".join(found)


@pytest.mark.parametrize(
    "text",
    [
        "Tell whether an item is asked for.",
        "What stands behind the header.",
        "A PDU that is none stays as it is.",
        "Say what became of it.",
        "An octet that nothing is known of, in the place of another one.",
        "It is given up when nobody asks for it any more.",
        "An answer has other octets than its copy.",
        "The text is no\nnumber.",
    ],
)
def test_a_marker_is_found(text: str) -> None:
    assert marked([text]) == ([text], 1)


@pytest.mark.parametrize(
    "text",
    [
        "Return whether an item is requested.",
        "Return None if there is none.",
        "The bytes after the header.",
        "It is no longer needed.",
        "Names such as `told` and ``behind`` are names.",
        "A request behind a malformed header.",
    ],
)
def test_plain_english_has_no_marker(text: str) -> None:
    assert marked([text]) == ([], 1)


def test_docstrings_and_comments_are_prose() -> None:
    source = '"""One."""\n# two\n# three\nx = 1  # four\n\n#: five\n\n\ndef f():  # noqa: X\n    """Six."""\n'
    assert [text for text in prose_of(source) if text] == ["One.", "Six.", "two three four", "five"]
