"""The documentation as a site: every page in a group, one order everywhere, every link leads somewhere, it builds strictly."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Final

import pytest

from dissect.cli import help as manual
from tests.output.page.browser import started

ROOT: Final = Path(__file__).resolve().parent.parent
DOCS: Final = ROOT / "docs"
GROUPS: Final = ["Tutorials", "How-to guides", "Reference", "Explanation"]
LINK: Final = re.compile(r"\]\(([^)\s]+)\)|<(?:img|a) [^>]*(?:src|href)=\"([^\"]+)\"")
#: Starts MkDocs with nothing to connect to.
OFFLINE: Final = """
import socket

def refused(*_):
    raise OSError("no network in this test")

socket.socket.connect = socket.getaddrinfo = refused
from mkdocs.__main__ import cli
cli()
"""


def pages() -> list[Path]:
    """Return every Markdown file a reader may be sent to."""
    roots = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "captures/README.md")]
    return [*roots, *sorted(DOCS.rglob("*.md"))]


def prose(page: Path) -> str:
    """Return a page without its blocks of code, and without code in a line."""
    text = re.sub(r"^(```|~~~).*?^\1", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`\n]*`(?!\])", "", text)


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page: those of its headings, as forges make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    found: set[str] = set()
    for heading in re.findall(r"^#{1,6} (.+)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
        found.add(slug if slug not in found else f"{slug}-1")
    return found


def links() -> Iterator[tuple[Path, str]]:
    """Give every link that leads to a file or a heading, with the page it stands on."""
    for page in pages():
        for markdown, html in LINK.findall(prose(page)):
            target = markdown or html
            if not re.match(r"[a-z]+:", target):
                yield page, target


def test_every_link_leads_to_a_file_and_to_a_heading_that_is_there() -> None:
    found = list(links())
    assert len(found) > 200
    assert sum("#" in target for _, target in found) > 20
    wrong = []
    for page, target in found:
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        if not file.exists() or (anchor and anchor not in anchors(file)):
            wrong.append((page.relative_to(ROOT).as_posix(), target))
    assert wrong == []


def test_addresses_of_the_world_are_whole() -> None:
    """They are not fetched: a test may not depend on somebody's server."""
    found = {target for page in pages() for target in re.findall(r"\]\((\w+:[^)\s]*)\)", prose(page))}
    assert len(found) > 5
    assert [target for target in sorted(found) if not re.fullmatch(r"https://[\w.-]+\.[a-z]+(/\S*)?", target)] == []


def test_every_page_is_in_one_group() -> None:
    groups = manual.groups()
    assert list(groups) == GROUPS
    listed = [topic for topics in groups.values() for topic in topics]
    assert sorted(listed) == sorted(manual.pages())


def test_readme_lists_the_pages_in_the_same_order() -> None:
    more = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## More\n", 1)[1]
    rows = dict(re.findall(r"^\* ([^:]+): (.*)$", more, re.MULTILINE))
    shown = {title: re.findall(r"\(docs/([a-z0-9-]+)\.md\)", row) for title, row in rows.items()}
    assert {title: shown[title] for title in GROUPS} == {
        title: list(topics) for title, topics in manual.groups().items()
    }


# ---- the site -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """The hooks of the site as a module."""
    spec = importlib.util.spec_from_file_location("docs_site", ROOT / "scripts" / "docs_site.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def definition(script: ModuleType, module: str, name: str) -> ast.ClassDef | ast.FunctionDef | None:
    """Return what a public name stands for, found as it is imported; None for what is no class and no function."""
    for node in ast.walk(script.source_of(module)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name:
            return node
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("dissect"):
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return definition(script, node.module, alias.name)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Name):
            if [target.id for target in node.targets if isinstance(target, ast.Name)] == [name]:
                return definition(script, module, node.value.id)
    return None


def test_every_public_name_says_what_it_is(script: ModuleType) -> None:
    silent = []
    count = 0
    for _, module in script.API:
        assert ast.get_docstring(script.source_of(module)), module
        for name in script.public(module):
            found = definition(script, module, name)
            if found is None:
                assert name.isupper(), f"{module}.{name} is neither a class nor a function, nor a constant"
                continue
            count += 1
            methods = [
                node
                for node in found.body
                if isinstance(node, ast.FunctionDef)
                and not node.name.startswith("_")
                and isinstance(found, ast.ClassDef)
            ]
            silent += [f"{module}.{name}.{node.name}" for node in methods if not ast.get_docstring(node)]
            if not ast.get_docstring(found):
                silent.append(f"{module}.{name}")
    assert count > 150
    assert silent == []


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site with one part of the API: the whole takes six times as long and shows no more."""
    folder = tmp_path_factory.mktemp("site")
    sources = folder / "sources"
    shutil.copytree(ROOT / "dissect" / "meaning" / "tags", sources / "dissect" / "meaning" / "tags")
    shutil.copy(ROOT / "dissect" / "__init__.py", sources / "dissect")
    shutil.copy(ROOT / "dissect" / "meaning" / "__init__.py", sources / "dissect" / "meaning")
    environment = {
        **os.environ, "PYTHONPATH": "", "NO_MKDOCS_2_WARNING": "1", "DOCS_MODULES": "dissect.meaning.tags",
        "DOCS_SOURCES": str(sources),
    }  # fmt: skip
    ran = subprocess.run(
        [sys.executable, "-c", OFFLINE, "build", "--quiet", "--strict", "--site-dir", folder / "site"],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
    return folder / "site"


def test_the_site_builds_without_warnings_and_without_network(site: Path) -> None:
    for topic in manual.pages():
        assert (site / f"{topic}.html").is_file(), topic
    api = (site / "api" / "dissect.meaning.tags.html").read_text(encoding="utf-8")
    assert 'id="dissect.meaning.tags.load_tags"' in api
    assert "Raises <code>TagError</code>" in api
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert re.findall(r"<(?:script|link|img|iframe)\b[^>]*(?:src|href)=\"?https?:[^>]*", text) == [], page.name
    home = (site / "index.html").read_text(encoding="utf-8")
    assert [home.index(title) for title in GROUPS] == sorted(home.index(title) for title in GROUPS)


def test_the_site_can_be_searched_where_it_is_opened_as_files(site: Path) -> None:
    """A worker may not be started there, and no index fetched; a decision, one folder deeper, is searched as well."""
    from selenium.webdriver.support.ui import WebDriverWait

    typed = """const box = document.querySelector('input[name=query]'); box.focus(); box.value = 'retransmission';
        box.dispatchEvent(new KeyboardEvent('keyup', {bubbles: true}));"""
    found = "return [...document.querySelectorAll('.md-search-result__link')].map((one) => one.getAttribute('href'))"
    with started() as browser:
        for page in ("report.html", "decisions/0008-retransmissions-that-differ.html"):
            browser.driver.get((site / page).as_uri())
            browser.run(typed)
            WebDriverWait(browser.driver, 20).until(lambda _: browser.run(found))
            assert any("0008-retransmissions-that-differ.html" in one for one in browser.run(found))
        assert browser.console() == []
        assert [one for one in browser.requests() if not one.startswith(("file:", "data:", "about:"))] == []
