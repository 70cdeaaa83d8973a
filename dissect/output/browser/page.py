"""Builds the page of the browser edition: one file, with a policy that lets nothing else run, load or connect."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from importlib.resources import files
from typing import Final

from dissect.output.browser.contents import Contents
from dissect.output.browser.parts import info
from dissect.output.page.rendering import shipped_policy

#: Maximum size of the page, so that it can be mailed.
MAX_OCTETS: Final = 12_000_000
#: The scripts of the page in the order in which they are joined.
SCRIPTS: Final = ("kit.js", "plot.js", "views.js", "app.js")
#: One of the report's scripts, put before them, so that numbers look alike in both.
SHARED: Final = "script/numbers.js"
_WIDTH: Final = 32_768


class TooLargeError(Exception):
    """The page has more bytes than it may have."""


def made(contents: Contents, version: str) -> bytes:
    """Return the page. Raises `TooLargeError` if it is larger than `MAX_OCTETS`."""
    folder = files("dissect.output.browser")
    names = ("shell.css", "worker.js", "shell.html")
    style, worker, shell = [folder.joinpath(name).read_text(encoding="utf-8") for name in names]
    parts = [files("dissect.output.page").joinpath(SHARED), *[folder.joinpath(name) for name in SCRIPTS]]
    script = "\n".join(['"use strict";', *[part.read_text(encoding="utf-8") for part in parts]])
    values = {
        "policy": policy(style, script),
        "style": style,
        "script": script,
        "worker": worker,
        "version": html.escape(version),
        "lock": json.dumps({"info": info(), "packages": {}}),  # Pyodide's own packages are not included
        "licences": _licences(contents),
        "pieces": "".join([_element(name, octets) for name, octets in contents.pieces().items()]),
    }
    page = re.sub(r"\{\{ (\w+) \}\}", lambda found: values[found[1]], shell).encode()
    if len(page) > MAX_OCTETS:
        raise TooLargeError(f"the page has {len(page):,} bytes, more than {MAX_OCTETS:,}")
    return page


def policy(style: str, script: str) -> str:
    """Return the Content-Security-Policy: this script and style, those of the report, a worker; no connection."""
    report = shipped_policy()
    styles = [_hash(style), *re.findall(r"style-src ('sha256-[^']+')", report)]
    scripts = [_hash(script), *re.findall(r"script-src ('sha256-[^']+')", report)]
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(scripts)} 'wasm-unsafe-eval' blob:",
            f"style-src {' '.join(styles)}",
            "worker-src blob:",
            "frame-src blob:",
            "connect-src 'none'",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _element(name: str, octets: bytes) -> str:
    """Return bytes as an element that does not run; in lines, because editors and mail filters dislike endless ones."""
    text = base64.b64encode(octets).decode()
    lines = "\n".join([text[at : at + _WIDTH] for at in range(0, len(text), _WIDTH)])
    return f'<script type="text/plain" id="piece-{name}">\n{lines}\n</script>\n'


def _licences(contents: Contents) -> str:
    told = []
    for part, text in contents.licences():
        about = f"{html.escape(part.name)} {html.escape(part.version)}: {html.escape(part.licence)}"
        body = (
            f"<pre>{html.escape(text.strip())}</pre>"
            if text
            else "<p>Its source and licence: the npm package of this name.</p>"
        )
        told.append(f"<details><summary>{about}</summary>{body}</details>")
    vendors = "Vendors of network cards: Wireshark's list of manufacturers, as Scapy ships it: GPL-2.0-only"
    told.append(f"<details><summary>{vendors}</summary><p>A prefix and a name in each row.</p></details>")
    return "\n".join(told)
