"""Foreign pytest plugins that are installed beside ours, as files in a folder."""

from __future__ import annotations

from pathlib import Path


def install(folder: Path, **plugins: str) -> Path:
    """Install plugins, each by its name and its source, as packages that pytest finds by their entry points."""
    for name, source in plugins.items():
        module, about = f"foreign_{name}", folder / f"foreign_{name}-1.0.dist-info"
        about.mkdir(parents=True)
        (about / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: foreign-{name}\nVersion: 1.0\n", encoding="utf-8"
        )
        (about / "entry_points.txt").write_text(f"[pytest11]\n{name} = {module}\n", encoding="utf-8")
        (folder / f"{module}.py").write_text(source, encoding="utf-8")
    return folder
