"""Draw the pictures of the README from shipped captures: ``python scripts/pictures.py``; it takes chromium and its driver."""

from __future__ import annotations

import asyncio
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from selenium import webdriver

ROOT: Final = Path(__file__).resolve().parents[1]
DOCS: Final = ROOT / "docs"
PLANT: Final = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
#: The visible part of the page, and its reduction.
WIDTH: Final = 1280
HEIGHT: Final = 2400
SCALE: Final = 0.7


def started() -> webdriver.Chrome:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        sys.exit("pictures: chromium and chromedriver are needed (scripts/install-tools.sh)")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    return webdriver.Chrome(options=options, service=Service(driver))


def report(target: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder, "report.html")
        plots = ["--plot", 'DB1."level"', "--plot", 'DB1."setpoint"']
        subprocess.run(
            [sys.executable, "-m", "dissect", "report", PLANT.relative_to(ROOT), *plots, "-o", page],
            cwd=ROOT,
            check=True,
        )
        chromium = started()
        try:
            size = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": SCALE, "mobile": False}
            chromium.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            chromium.get(page.as_uri())
            chromium.save_screenshot(str(target))
        finally:
            chromium.quit()


def browser(target: Path) -> None:
    """The analyzer in one file, with a transaction taken apart; its parts are kept beside the environment."""
    from dissect import __version__
    from dissect.output.browser.contents import Contents
    from dissect.output.browser.page import made
    from dissect.output.browser.parts import Parts

    parts = Parts(Path(sys.prefix, "browser"))
    parts.fetch()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder, "s7dissect.html")
        page.write_bytes(made(Contents(parts), __version__))
        chromium = started()
        try:
            size = {"width": WIDTH, "height": 1000, "deviceScaleFactor": SCALE, "mobile": False}
            chromium.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            chromium.get(page.as_uri() + "#transactions/12")
            chromium.find_element("id", "choose").send_keys(str(PLANT))
            until(chromium, "document.querySelectorAll('.dump').length === 2")
            chromium.execute_script("document.querySelectorAll('.field')[9].focus(); scrollTo(0, 90)")
            chromium.save_screenshot(str(target))
        finally:
            chromium.quit()


def until(driver: webdriver.Chrome, condition: str) -> None:
    end = time.monotonic() + 120
    while not driver.execute_script(f"return {condition}"):
        if time.monotonic() > end:
            sys.exit(f"pictures: {condition} did not come true")
        time.sleep(0.1)


def screens(target: Path) -> None:
    from dissect.engine.pipeline import Options
    from dissect.online.live.session import Session
    from dissect.online.monitor.app import MonitorApp
    from dissect.packets.source.files import open_capture

    session = Session(lambda: open_capture(str(PLANT)), Options(), name=PLANT.name)
    app = MonitorApp(session)

    async def drawn() -> str:
        async with app.run_test(size=(130, 32)) as pilot:
            await pilot.pause(1.5)
            return app.export_screenshot(title="s7dissect monitor")

    session.start()
    try:
        picture = asyncio.run(drawn())
    finally:
        session.close()
    # The fonts that it names are on the network; every system has one of its own.
    target.write_text(re.sub(r"@font-face \{.*?\}\s*", "", picture, flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    report(DOCS / "report.png")
    screens(DOCS / "monitor.svg")
    browser(DOCS / "browser.png")
