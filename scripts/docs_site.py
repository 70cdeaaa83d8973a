"""What `make docs` adds to docs/: the order of the pages, the API reference, README and the other pages of the root.

MkDocs calls the functions `on_…` (mkdocs.yml names this file as a hook). DOCS_MODULES restricts the API to some modules.
"""

from __future__ import annotations

import ast
import os
import posixpath
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
#: Files of the root, and their places in the site.
OUTER = {
    "README.md": "project/README.md",
    "CHANGELOG.md": "project/CHANGELOG.md",
    "CONTRIBUTING.md": "project/CONTRIBUTING.md",
    "captures/README.md": "project/captures.md",
}
#: The parts of the API: title and module. Its public names are those of its `__all__` or `_PUBLIC`, otherwise all that it
#: defines.
API = (
    ("Captures in Python", "dissect"),
    ("Tags", "dissect.meaning.tags"),
    ("Goldens and diffs", "dissect.testing.golden"),
    ("Baselines", "dissect.output.baseline"),
    ("Alerts", "dissect.online.alerts"),
    ("Live sessions", "dissect.online.live.session"),
    ("Recordings played as a server", "dissect.testing.playback.server"),
    ("Recordings played as a client", "dissect.testing.playback.client"),
    ("SCD", "dissect.scd"),
    ("SCD in traffic", "dissect.meaning.bindings"),
    ("Conversations by hand", "dissect.testing.talk"),
    ("pytest fixtures", "dissect.testing.plugin"),
    ("Scapy layers", "dissect.layers"),
)
LINK = re.compile(r"(!?\[[^\]]*\])\(([^)\s#]+)(#[^)\s]*)?\)")
PICTURE = re.compile(r'(<img src=")([^"]+)')


def modules() -> list[tuple[str, str]]:
    """Return the selected parts of the API."""
    wanted = os.environ.get("DOCS_MODULES", "").split()
    return [(title, module) for title, module in API if not wanted or module in wanted]


def source_of(module: str) -> ast.Module:
    """Return the source of a module: compiled ones have no docstrings, and nothing need be imported."""
    path = ROOT.joinpath(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(file.read_text(encoding="utf-8"))


def public(module: str) -> list[str]:
    """Return the public names of a module, in their order there."""
    tree = source_of(module)
    for node in tree.body:
        target = (
            node.target
            if isinstance(node, ast.AnnAssign)
            else node.targets[0]
            if isinstance(node, ast.Assign)
            else None
        )
        if isinstance(target, ast.Name) and target.id in {"__all__", "_PUBLIC"}:
            listed = getattr(node, "value", None)
            if isinstance(listed, ast.Dict):
                return [ast.literal_eval(key) for key in listed.keys if key is not None]
            if isinstance(listed, ast.List):
                return [ast.literal_eval(one) for one in listed.elts if isinstance(one, ast.Constant)]
    kinds = (ast.ClassDef, ast.FunctionDef)
    return [node.name for node in tree.body if isinstance(node, kinds) and not node.name.startswith("_")]


def groups() -> list[tuple[str, list[tuple[str, str]]]]:
    """Return the groups of docs/index.md, each with the titles and files of its pages."""
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)[1:]
    return [
        (title, re.findall(r"^- \[([^\]]+)\]\(([^)#]+)\)", body, re.MULTILINE))
        for title, body in zip(parts[::2], parts[1::2], strict=True)
    ]


def on_config(config: Any) -> Any:
    """Give the site the order of docs/index.md, followed by the API, the decisions and the pages of the root."""
    decisions = sorted(
        path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs" / "decisions").glob("*.md")
    )
    config.nav = [
        {"Documentation": "index.md"},
        *[{title: [{name: page} for name, page in pages]} for title, pages in groups()],
        {"API": [{title: f"api/{module}.md"} for title, module in modules()]},
        {"Decisions": decisions},
        {"Project": list(OUTER.values())},
    ]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are not in docs/."""
    from mkdocs.structure.files import File

    for name, place in OUTER.items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / name)))
    for title, module in modules():
        files.append(File.generated(config, f"api/{module}.md", content=api_page(title, module)))
    return files


def api_page(title: str, module: str) -> str:
    """Return the page of a module: its own text, then each public name."""
    intro = ast.get_docstring(source_of(module)) or ""
    lines = [f"# {title}", "", f"`{module}`", "", intro, ""]
    for name in public(module):
        lines += [f"::: {module}.{name}", ""]
    return "\n".join(lines)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Point links to the places of their files in the site; targets outside of the site are named without a link."""
    place = page.file.src_uri
    origin = next((name for name, moved in OUTER.items() if moved == place), f"docs/{place}")

    def there(target: str) -> str | None:
        """Return the target in the form for the page, None if it is not in the site."""
        whole = posixpath.normpath(posixpath.join(posixpath.dirname(origin), target))
        inside = OUTER.get(whole, whole.removeprefix("docs/"))
        if files.get_file_from_path(inside) is None:
            return None
        return posixpath.relpath(inside, posixpath.dirname(place) or ".")

    def link(found: re.Match[str]) -> str:
        text, target, anchor = found[1], found[2], found[3] or ""
        if "://" in target:
            return found[0]
        moved = there(target)
        return f"{text}({moved}{anchor})" if moved else text.removeprefix("!")[1:-1]

    # HTML is not converted: its paths are those of the written files.
    return PICTURE.sub(lambda found: found[1] + (there(found[2]) or found[2]), LINK.sub(link, markdown))
