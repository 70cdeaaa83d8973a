"""The scripts of the page are checked by the compiler of TypeScript."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from dissect.browser.page import SCRIPTS
from tests.report.schemas import ROOT

FOLDER = ROOT / "dissect" / "browser"


@pytest.mark.parametrize(("names", "library"), [(SCRIPTS, ["dom", "dom.iterable"]), (("worker.js",), ["webworker"])])
def test_scripts_have_no_type_errors(tmp_path: Path, names: tuple[str, ...], library: list[str]) -> None:
    tools = Path(sys.prefix) / "page-tools"
    if not (tools / "installed").is_file():
        pytest.skip("the tools for the page are not installed (scripts/install-page-tools.sh)")
    options = json.loads((ROOT / "tests" / "page" / "tools" / "tsconfig.json").read_text(encoding="utf-8"))
    options["compilerOptions"].update(lib=["es2022", *library], module="es2022")
    options["files"] = [str(FOLDER / name) for name in names]
    (tmp_path / "tsconfig.json").write_text(json.dumps(options), encoding="utf-8")
    compiler = tools / "node_modules" / "typescript" / "bin" / "tsc"
    ran = subprocess.run(
        [str(tools / "node"), str(compiler), "-p", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stdout) == (0, "")


def test_every_script_is_in_the_page_and_says_that_it_is_checked() -> None:
    found = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.js")}
    assert set(found) == {*SCRIPTS, "worker.js"}
    assert [name for name, text in found.items() if not text.startswith("// @ts-check\n")] == []
    # It would end the element of the page that holds it.
    assert [name for name, text in found.items() if "</script" in text] == []
