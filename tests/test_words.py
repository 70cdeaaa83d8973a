"""The words of a text for people: phrases that no user should meet, looked for in literals, help, pages and schemas."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
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
    for path in sorted((ROOT / "dissect" / "schema").glob("*.json")):
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
    assert wrong("dissect/report/text.py", text)
