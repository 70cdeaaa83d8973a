"""Firefox, driven by WebDriver BiDi, which it supports itself: the distribution has no geckodriver."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import pytest
from websocket import create_connection

#: Seconds that Firefox may take to start, and for one answer.
PATIENCE: Final = 120
#: It connects nowhere by itself, and every host name leads nowhere.
_PREFERENCES: Final = """
user_pref("app.normandy.enabled", false);
user_pref("app.update.auto", false);
user_pref("browser.safebrowsing.downloads.remote.enabled", false);
user_pref("browser.shell.checkDefaultBrowser", false);
user_pref("browser.startup.homepage_override.mstone", "ignore");
user_pref("datareporting.policy.dataSubmissionEnabled", false);
user_pref("network.proxy.type", 1);
user_pref("network.proxy.socks", "127.0.0.1");
user_pref("network.proxy.socks_port", 9);
user_pref("network.proxy.no_proxies_on", "");
user_pref("services.settings.server", "data:,");
user_pref("toolkit.telemetry.enabled", false);
"""


class Firefox:
    """A Firefox without a window and with a profile of its own, and its first tab."""

    def __init__(self, profile: Path) -> None:
        program = shutil.which("firefox-esr") or shutil.which("firefox")
        if program is None:
            pytest.skip("firefox is not installed (scripts/install-tools.sh)")
        profile.mkdir()
        (profile / "user.js").write_text(_PREFERENCES, encoding="utf-8")
        self._told = profile / "told.txt"
        self._number = 0
        self._context = ""
        with self._told.open("wb") as told:
            command = [program, "--headless", "--no-remote", "--profile", str(profile), "--remote-debugging-port", "0"]
            self._process = subprocess.Popen(
                [*command, "about:blank"], stdin=subprocess.DEVNULL, stdout=told, stderr=subprocess.STDOUT
            )

    def __enter__(self) -> Self:
        self._socket = create_connection(f"{self._address()}/session", timeout=PATIENCE, suppress_origin=True)
        self._ask("session.new", capabilities={})
        self._context = self._ask("browsingContext.getTree")["contexts"][0]["context"]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(PATIENCE)

    def _address(self) -> str:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            found = re.search(r"BiDi listening on (ws://\S+)", self._told.read_text(encoding="utf-8", errors="replace"))
            if found:
                return found[1]
            time.sleep(0.1)
        raise AssertionError(self._told.read_text(encoding="utf-8", errors="replace"))

    def _ask(self, method: str, **parameters: object) -> Any:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv())
            if answer.get("id") == self._number:
                assert answer["type"] == "success", answer
                return answer["result"]

    def open(self, page: Path) -> None:
        """Open a page from the disk."""
        self._ask("browsingContext.navigate", context=self._context, url=page.as_uri(), wait="complete")

    def script(self, expression: str) -> str:
        """Return the text value of an expression, or of its promise."""
        told = self._ask("script.evaluate", expression=expression, target={"context": self._context}, awaitPromise=True)
        assert told["type"] == "success", told
        return str(told["result"].get("value", ""))

    def until(self, condition: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE
        while self.script(f"String(Boolean({condition}))") != "true":
            assert time.monotonic() < end, (condition, self.script("document.getElementById('state').textContent"))
            time.sleep(0.1)

    def choose(self, selector: str, files: list[Path]) -> None:
        """Choose files in a field, as a person does."""
        told = self._ask(
            "script.evaluate",
            expression=f"document.querySelector({json.dumps(selector)})",
            target={"context": self._context},
            awaitPromise=False,
        )
        element = {"sharedId": told["result"]["sharedId"]}
        self._ask("input.setFiles", context=self._context, element=element, files=[str(path) for path in files])

    def picture(self, path: Path) -> None:
        """Save a picture of the page."""
        import base64

        told = self._ask("browsingContext.captureScreenshot", context=self._context)
        path.write_bytes(base64.b64decode(told["data"]))
