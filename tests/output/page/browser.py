"""Chromium for the tests of pages: one without a window, which notes its messages and requests."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver


class Driven:
    """Chromium, with the functions that tests of any page need."""

    def __init__(self, driver: WebDriver) -> None:
        self.driver = driver

    def script(self, script: str, *arguments: object) -> Any:
        """Return the result of a script."""
        return self.driver.execute_script(script, *arguments)

    def count(self, selector: str) -> int:
        """Return the number of elements."""
        return int(self.script("return document.querySelectorAll(arguments[0]).length", selector))

    def texts(self, selector: str) -> list[str]:
        """Return the text of each element."""
        found: list[str] = self.script(
            "return [...document.querySelectorAll(arguments[0])].map((one) => one.textContent)", selector
        )
        return found

    def console(self) -> list[str]:
        """Return the messages in the console: errors of scripts, violations of the policy."""
        return [str(entry["message"]) for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Return the addresses that were asked for since the page was opened."""
        told = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        return [one["params"]["request"]["url"] for one in told if one["method"] == "Network.requestWillBeSent"]


class Browser(Driven):
    """Chromium, with the functions that a test of a report needs."""

    def open(self, page: Path, width: int = 1280, fragment: str = "") -> None:
        """Open a page from the disk, in a window of this width."""
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False},
        )
        self.driver.get("about:blank")
        self.driver.get_log("browser")
        self.driver.get_log("performance")
        self.driver.get(page.as_uri() + fragment)
        assert self.script("return document.documentElement.dataset.ready") == "yes", self.console()

    def run(self, script: str, *arguments: object) -> Any:
        """Return the result of a script."""
        return self.script(script, *arguments)

    def click(self, selector: str) -> None:
        """Click on an element."""
        self.script(
            "document.querySelector(arguments[0]).dispatchEvent(new MouseEvent('click', {bubbles: true}))", selector
        )

    def overflow(self) -> int:
        """Return how much wider the page is than its window."""
        return int(self.script("return document.documentElement.scrollWidth - innerWidth"))


def start_chromium(*more: str) -> WebDriver:
    """Start Chromium with ``more`` arguments; the test is skipped if it is not installed."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("chromium or its driver is not installed (scripts/install-tools.sh)")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    usual = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu", "--hide-scrollbars")
    for argument in (*usual, *more):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    return webdriver.Chrome(options=options, service=Service(driver))


@contextmanager
def started() -> Iterator[Browser]:
    """Start Chromium, and end it."""
    running = start_chromium()
    running.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "deny"})  # nothing into the home folder
    try:
        yield Browser(running)
    finally:
        running.quit()
