"""Shared by the tests of the browser edition: the page, made once, and a browser that has opened it."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from dissect import __version__
from dissect.output.browser.contents import Contents
from dissect.output.browser.page import made
from dissect.output.browser.parts import Parts, PartsError
from tests.meaning.report.schemas import ROOT
from tests.output.page.browser import Driven

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver

OWN: Final = ROOT / "captures"
#: Where the packages of npm and PyPI are kept: beside the environment, so that they are fetched once.
PACKAGES: Final = Path(os.environ.get("S7DISSECT_BROWSER_PACKAGES", Path(sys.prefix) / "browser"))
#: Seconds that a page may take for one step on a busy machine.
PATIENCE: Final = 120
#: An argument for Chromium: every name of a host leads nowhere.
NOWHERE: Final = "--host-resolver-rules=MAP * ~NOTFOUND"
#: Runs command lines in the page, one after the other: what each wrote, and its exit code.
_RUN: Final = """
const done = arguments[arguments.length - 1];
(async () => {
  const told = [];
  for (const argv of arguments[0]) {
    const result = await engine.run(argv);
    engine.known.clear();
    told.push([result.code, await result.out.text(), result.errors]);
  }
  return told;
})().then(done, (error) => done(String(error)));
"""


def captures() -> list[Path]:
    """Return all captures of the project."""
    return sorted([path for path in OWN.rglob("*") if path.suffix in {".pcap", ".pcapng", ".gz"}])


def make_page(folder: Path) -> Path:
    """Write the page. Without the packages and their registries the tests are skipped."""
    parts = Parts(PACKAGES)
    try:
        parts.fetch()
    except PartsError as error:
        pytest.skip(f"the packages of the browser edition: {error}")
    path = folder / "s7dissect.html"
    path.write_bytes(made(Contents(parts), __version__))
    return path


class Opened(Driven):
    """The page in Chromium."""

    def __init__(self, driver: WebDriver, page: Path) -> None:
        super().__init__(driver)
        driver.set_script_timeout(PATIENCE)
        self.page = page

    def open(self, fragment: str = "") -> None:
        """Open the page anew and wait until Python is there."""
        self.driver.get("about:blank")
        self.driver.get_log("browser")
        self.driver.get_log("performance")
        self.driver.get(self.page.as_uri() + fragment)
        self.until("document.documentElement.dataset.ready === 'yes'")

    def until(self, condition: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.script(f"return {condition}"):
            assert time.monotonic() < end, (condition, self.texts("#state"), self.console())
            time.sleep(0.05)

    def choose(self, *files: Path) -> None:
        """Choose files as a person does, in place of the earlier ones."""
        self.script("held = []; select('files', '', ''); changed()")
        field = self.driver.find_element("id", "choose")
        field.send_keys("\n".join(map(str, files)))
        self.until(f"document.documentElement.dataset.files === '{len(files)}'")

    def select(self, tab: str, row: str = "", where: str = "") -> None:
        """Go to a tab and wait until all its data are there."""
        self.script("select(arguments[0], arguments[1], arguments[2])", tab, row, where)
        self.drawn()

    def drawn(self) -> None:
        """Wait until the view is drawn."""
        self.until("document.getElementById('panel')?.dataset.drawn === 'yes' && !engine.waiting.size")

    def run(self, lines: Sequence[Sequence[str]]) -> list[tuple[int, str, str]]:
        """Run command lines in the page; return exit code, output and errors of each."""
        told = self.driver.execute_async_script(_RUN, [list(line) for line in lines])
        assert isinstance(told, list), told
        return [(code, out, errors) for code, out, errors in told]

    def click(self, selector: str) -> None:
        """Click on an element."""
        self.script("document.querySelector(arguments[0]).click()", selector)
