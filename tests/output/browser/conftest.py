"""The page and a browser for all tests of the browser edition: both take seconds to make."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.output.browser.support import NOWHERE, Opened, make_page
from tests.output.page.browser import start_chromium


@pytest.fixture(scope="session")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_page(tmp_path_factory.mktemp("browser"))


@pytest.fixture(scope="session")
def opened(page: Path) -> Iterator[Opened]:
    driver = start_chromium(NOWHERE)
    try:
        one = Opened(driver, page)
        one.open()
        yield one
    finally:
        driver.quit()
