"""The action that posts JSON by HTTP: to this machine or an allowed host, without proxies and redirections."""

from __future__ import annotations

import urllib.error
import urllib.request
from email.message import Message
from http.client import HTTPException
from pathlib import Path
from typing import IO, Final
from urllib.parse import urlsplit

from dissect.alerts.actions import DeliveryError, Posting, RefusedError
from dissect.alerts.hosts import allowed
from dissect.scd.errors import shown
from dissect.scd.reading import Table
from dissect.wire.text import printable, reason

_SCHEMES: Final = ("http", "https")
#: Status codes that refuse the alert itself, so that a retry would not help (RFC 9110, 15.5).
_REFUSED: Final = frozenset((400, 413, 414, 415, 422, 431))


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Treats a redirection as a failure: the user has not allowed its target."""

    def redirect_request(
        self, req: urllib.request.Request, fp: IO[bytes], code: int, msg: str, headers: Message, newurl: str
    ) -> urllib.request.Request | None:
        """Return None: do not follow."""
        return None


class Webhook(Posting):
    """Posts each alert to ``url``. Any 2xx means delivered; an alert that is refused as malformed or too large is dropped."""

    def __init__(
        self, name: str, url: str, timeout: float = 10.0, parallel: int = 1, spool: Path | None = None
    ) -> None:
        super().__init__(name, parallel, spool)
        self._url = url
        self._timeout = timeout
        self._opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), _NoRedirect())

    def post(self, content: bytes) -> None:
        """Post an alert as JSON. Raises `DeliveryError`, `RefusedError`."""
        request = urllib.request.Request(  # noqa: S310 - the scheme was looked at
            self._url,
            content,
            {"Content-Type": "application/json", "User-Agent": "s7dissect"},
            method="POST",
        )
        try:
            with self._opener.open(request, timeout=self._timeout):
                pass
        except urllib.error.HTTPError as error:
            code = error.code
            error.close()
            kind = RefusedError if code in _REFUSED else DeliveryError
            raise kind(f"{self._url}: HTTP {code}") from None
        except (OSError, HTTPException, ValueError) as error:
            why = getattr(error, "reason", error)
            said = reason(why) if isinstance(why, BaseException) else str(why)
            raise DeliveryError(printable(f"{self._url}: {said}")) from None


def webhook_of(table: Table, name: str, hosts: frozenset[str], timeout: float, parallel: int) -> Webhook:
    """Return the action of a table; raises `DictionaryError`."""
    url = table.text("webhook")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port, parts = None, None, urlsplit("")
    if (
        parts.scheme not in _SCHEMES
        or not host
        or port == 0
        or not url.isascii()
        or not url.isprintable()
        or " " in url
    ):
        raise table.fail("webhook", f'{shown(url)} is not an address such as "http://127.0.0.1:8080/alerts"')
    if parts.username is not None or parts.password is not None:
        raise table.fail("webhook", "holds a name or a password, which must not be in the address")
    if not allowed(host, hosts):
        raise table.fail("webhook", f"{host} is not this machine: name it in allow_hosts at the top of the file")
    spool: Path | None = None
    if table.has("spool"):
        spool = Path(table.text("spool"))
        if not spool.is_absolute():
            raise table.fail(
                "spool", f'{shown(str(spool))} is not an absolute path such as "/var/lib/s7dissect/alerts"'
            )
    table.mark("spool")
    return Webhook(name, url, timeout, parallel, spool)
