"""The script of the report is checked by the compiler of TypeScript; its parts are those that the page is made of."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

import pytest

from dissect.output.page.rendering import SCRIPT
from tests.meaning.report.schemas import ROOT

FOLDER: Final = ROOT / "dissect" / "output" / "page" / "script"
TYPES: Final = FOLDER / "types.d.ts"


def tools() -> Path:
    """Return where the tools for the page are installed; the test is skipped where they are not."""
    folder = Path(sys.prefix) / "page-tools"
    if not (folder / "installed").is_file():
        pytest.skip(
            f"the tools for the page are not installed: VENV={sys.prefix} scripts/install-page-tools.sh does it"
        )
    return folder


def test_the_page_is_made_of_all_parts() -> None:
    assert sorted([path.stem for path in FOLDER.glob("*.js")]) == sorted(SCRIPT)
    for part in SCRIPT:
        text = files("dissect.output.page").joinpath("script", f"{part}.js").read_text(encoding="utf-8")
        assert text.startswith("// @ts-check\n"), part


def checked(folder: Path, code: Sequence[Path], **more: object) -> subprocess.CompletedProcess[str]:
    """Run the compiler over files, which together are one script; ``more`` are options of it."""
    options = json.loads((ROOT / "tests" / "output" / "page" / "tools" / "tsconfig.json").read_text(encoding="utf-8"))
    options["compilerOptions"].update(more)
    options["files"] = [str(path) for path in code]
    (folder / "tsconfig.json").write_text(json.dumps(options), encoding="utf-8")
    program = [str(tools() / "node"), str(tools() / "node_modules" / "typescript" / "bin" / "tsc"), "-p", str(folder)]
    return subprocess.run(program, capture_output=True, text=True, check=False, timeout=300)


def test_the_script_has_no_type_errors(tmp_path: Path) -> None:
    ran = checked(tmp_path, [TYPES, *[FOLDER / f"{part}.js" for part in SCRIPT]])
    assert (ran.returncode, ran.stdout) == (0, "")


def test_a_wrong_name_in_the_data_would_be_found(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.js"
    wrong.write_text("// @ts-check\nconst wide_ = sessions[0].rates.wdith;\nplain(wide_);\n", encoding="utf-8")
    ran = checked(
        tmp_path, [TYPES, *[FOLDER / f"{part}.js" for part in ("elements", "numbers", "words", "scales")], wrong]
    )
    assert "Property 'wdith' does not exist" in ran.stdout
