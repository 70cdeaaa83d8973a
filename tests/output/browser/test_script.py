"""The scripts of the page are checked by the compiler of TypeScript."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.output.browser.page import SCRIPTS, SHARED
from tests.meaning.report.schemas import ROOT
from tests.output.page.test_script import checked

FOLDER = ROOT / "dissect" / "output" / "browser"


@pytest.mark.parametrize(
    ("paths", "library"),
    [
        (
            [ROOT / "dissect" / "output" / "page" / SHARED, *[FOLDER / name for name in SCRIPTS]],
            ["dom", "dom.iterable"],
        ),
        ([FOLDER / "worker.js"], ["webworker"]),
    ],
)
def test_scripts_have_no_type_errors(tmp_path: Path, paths: list[Path], library: list[str]) -> None:
    ran = checked(tmp_path, paths, lib=["es2022", *library], module="es2022")
    assert (ran.returncode, ran.stdout) == (0, "")


def test_every_script_is_in_the_page_and_says_that_it_is_checked() -> None:
    found = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.js")}
    assert set(found) == {*SCRIPTS, "worker.js"}
    assert [name for name, text in found.items() if not text.startswith("// @ts-check\n")] == []
    # It would end the element of the page that holds it.
    assert [name for name, text in found.items() if "</script" in text] == []
