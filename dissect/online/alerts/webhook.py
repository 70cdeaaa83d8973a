"""The action that posts JSON by HTTP: to this machine or an allowed host, without proxies and redirections."""

from __future__ import annotations

import ssl
import urllib.error
import urllib.request
from collections.abc import Mapping
from email.message import Message
from http.client import HTTPException
from pathlib import Path
from typing import IO, Final
from urllib.parse import urlsplit

from dissect.online.alerts.actions import DeliveryError, Posting, RefusedError
from dissect.online.alerts.hosts import allowed
from dissect.online.alerts.secrets import address_shown, filled, headers_of
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
        self,
        name: str,
        url: str,
        timeout: float = 10.0,
        parallel: int = 1,
        spool: Path | None = None,
        headers: Mapping[str, str] | None = None,
        trusted: ssl.SSLContext | None = None,
    ) -> None:
        super().__init__(name, parallel, spool)
        self._url = url
        self._shown = address_shown(url)
        self._timeout = timeout
        self._headers = dict(headers or {})
        handlers: list[urllib.request.BaseHandler] = [urllib.request.ProxyHandler({}), _NoRedirect()]
        if trusted is not None:
            handlers.append(urllib.request.HTTPSHandler(context=trusted))
        self._opener = urllib.request.build_opener(*handlers)

    def post(self, content: bytes) -> None:
        """Post an alert as JSON. Raises `DeliveryError`, `RefusedError`."""
        request = urllib.request.Request(  # noqa: S310 - the scheme was looked at
            self._url,
            content,
            {**self._headers, "Content-Type": "application/json", "User-Agent": "s7dissect"},
            method="POST",
        )
        try:
            with self._opener.open(request, timeout=self._timeout):
                pass
        except urllib.error.HTTPError as error:
            code = error.code
            error.close()
            kind = RefusedError if code in _REFUSED else DeliveryError
            raise kind(f"{self._shown}: HTTP {code}") from None
        except (OSError, HTTPException, ValueError) as error:
            why = getattr(error, "reason", error)
            said = reason(why) if isinstance(why, BaseException) else str(why)
            raise DeliveryError(printable(f"{self._shown}: {self._without(said)}")) from None

    def _without(self, said: str) -> str:
        """Return an error of the library without the address and the headers, which may hold secrets."""
        parts = urlsplit(self._url)
        for secret in (self._url, f"{parts.path}?{parts.query}", parts.query, parts.path, *self._headers.values()):
            if len(secret) > 1:
                said = said.replace(secret, "…")
        return said


def webhook_of(
    table: Table, name: str, hosts: frozenset[str], timeout: float, parallel: int, trial: bool = False
) -> Webhook:
    """Return the action of a table; raises `DictionaryError`. For a ``trial``, the secrets need not be there."""
    if not isinstance(table.content.get("webhook"), str):  # the value may hold a token, so it is not printed
        raise table.fail("webhook", 'must be a text such as "http://127.0.0.1:8080/alerts"')
    written = table.text("webhook")
    url = written if trial else filled(table, "webhook", written)
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
        raise table.fail("webhook", 'is not an address such as "http://127.0.0.1:8080/alerts"')
    if parts.username is not None or parts.password is not None:
        raise table.fail("webhook", "contains a user name or password: remove it from the address")
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
    if trial:
        for key in ("headers", "ca_file"):
            table.mark(key)
        return Webhook(name, url, timeout, parallel, spool)
    return Webhook(name, url, timeout, parallel, spool, headers_of(table), _trusted(table))


def _trusted(table: Table) -> ssl.SSLContext | None:
    """Return the trusted certificates: only those of ``ca_file``, or None for those of the system."""
    if not table.has("ca_file"):
        table.mark("ca_file")
        return None
    path = table.text("ca_file")
    try:
        return ssl.create_default_context(cafile=path)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        raise table.fail("ca_file", f"{shown(path)} contains no certificates: {reason(error)}") from None
