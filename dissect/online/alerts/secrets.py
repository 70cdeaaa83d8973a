"""Secrets of receivers: from a file, the credentials of a systemd service, or the environment; and addresses without them.

No secret is ever printed. The path and the query of a webhook are secrets, too: whoever has ``…?token=…`` may post.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from dissect.scd.errors import DictionaryError, shown
from dissect.scd.reading import Table
from dissect.wire.text import reason

#: Octets of a secret.
MAX_SECRET: Final = 16 * 1024
MAX_HEADERS: Final = 32
_TOKEN: Final = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]{1,100}")
_REFERENCE: Final = re.compile(r"\{(file|credential|env):([^{}]+)\}")
#: Headers that the program sets, or that would change what a request is.
_OURS: Final = frozenset(("content-type", "content-length", "transfer-encoding", "host", "connection", "user-agent"))


def address_shown(url: str) -> str:
    """Return an address as it may be printed: its scheme, host and port."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        return "(an address)"
    if not host:
        return "(an address)"
    name = f"[{host}]" if ":" in host else host
    return f"{parts.scheme}://{name}{f':{port}' if port is not None else ''}"


def headers_of(table: Table) -> dict[str, str]:
    """Return the ``headers`` of an action, with its secrets put in. Raises `DictionaryError`, which never has a secret."""
    if not table.has("headers"):
        table.mark("headers")
        return {}
    given = table.content.get("headers")
    table.mark("headers")
    if not isinstance(given, dict) or len(given) > MAX_HEADERS:
        raise table.fail(
            "headers",
            f'must be a table of at most {MAX_HEADERS}, such as {{ Authorization = "Bearer {{file:/etc/token}}" }}',
        )
    found: dict[str, str] = {}
    for name, value in given.items():
        if not _TOKEN.fullmatch(name) or name.lower() in _OURS:
            raise table.fail("headers", f"{shown(name)} is not a header that can be set")
        if not isinstance(value, str):
            raise table.fail("headers", f"{name}: expected a text")
        made = filled(table, "headers", value)
        if not made.isascii() or not made.isprintable():
            raise table.fail("headers", f"{name}: a header is printable ASCII on one line")
        found[name] = made
    return found


def filled(table: Table, key: str, text: str) -> str:
    """Return a text with ``{file:PATH}``, ``{credential:NAME}`` and ``{env:NAME}`` replaced by the secrets they name."""
    return _REFERENCE.sub(lambda found: _secret(table, key, found[1], found[2]), text)


def _secret(table: Table, key: str, kind: str, name: str) -> str:
    """Return a secret, without the line end of its file."""
    if kind == "env":
        value = os.environ.get(name)
        if not value:
            raise table.fail(key, f"there is no {shown(name)} in the environment")
        return value
    path = Path(name)
    if kind == "credential":
        folder = os.environ.get("CREDENTIALS_DIRECTORY", "")
        if not folder or path.name != name or name in {".", ".."}:
            raise table.fail(key, f"there is no credential {shown(name)}: a systemd unit names it with LoadCredential=")
        path = Path(folder) / name
    elif not path.is_absolute():
        raise table.fail(key, f"{shown(name)} is not an absolute path")
    return _content(table, key, path)


def _content(table: Table, key: str, path: Path) -> str:
    trouble: DictionaryError
    try:
        with path.open("rb") as file:
            octets = file.read(MAX_SECRET + 1)
        if len(octets) <= MAX_SECRET:
            return octets.decode("utf-8").rstrip("\r\n")
        trouble = table.fail(key, f"{shown(str(path))} has more than {MAX_SECRET} bytes")
    except UnicodeDecodeError:
        trouble = table.fail(key, f"{shown(str(path))} is not UTF-8")
    except OSError as error:
        trouble = table.fail(key, f"{reason(error)}")
    raise trouble from None
