"""Captures on other machines: ``sftp://HOST/DIR/FILE``, ``https://…``, ``s3://BUCKET/KEY`` and whatever else fsspec opens.

They are read as a stream, a few MiB ahead, and never stored. Credentials come only from where the transport's own tools keep
them: keys, agent, configuration and known hosts of SSH, the profiles of a cloud. fsspec is imported only for remote names.
"""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from datetime import date, timedelta
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar
from urllib.parse import urlsplit

from dissect.packets.source.packet import READING_FAILED, CaptureError
from dissect.wire.text import printable, shortened

if TYPE_CHECKING:
    import ssl

#: Time limit for a machine that does not answer, in seconds: while connecting, and between two pieces.
CONNECT_S: Final = 8
READ_S: Final = 30
#: How many octets are requested at once where a transport reads in pieces.
_AHEAD: Final = 4 * 1024 * 1024
#: Days that a range of dates may have.
MAX_DAYS: Final = 3660

_SCHEME: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
# These are strings, which `re` compiles and keeps at their first use, because most runs use none.
_PATTERN: Final = r"[*?\[]"
_DAYS: Final = r"\{(\d{4}-\d\d-\d\d|\d{8})\.\.(\d{4}-\d\d-\d\d|\d{8})\}"
#: Parts of URLs that are hidden in messages of other programs: a password, and a query, which may be a signature.
_SECRETS: Final = r"(?<=//)[^/@\s]*:[^/@\s]*(?=@)|(?<=\?)[^\s'\")]+"
#: Transports whose names have no query, so a question mark belongs to the name or to a pattern.
_SSH: Final = frozenset(("sftp", "ssh"))
#: Transports whose names have the host after the two slashes.
_OF_HOST: Final = _SSH | {"http", "https"}
_REASON: Final = 200
_NOT_FOUND: Final = 404
_NO_FILE: Final = "no such file"
_REFUSED: Final = (401, 403, 407)

T = TypeVar("T")


class _Stream(Protocol):
    def read(self, size: int, /) -> bytes: ...

    def close(self) -> None: ...


def is_remote(name: str) -> bool:
    """Return whether a name is the URL of a file on another machine."""
    return _SCHEME.match(name) is not None


def shown(name: str) -> str:
    """Return a name in a form safe to show: without the password and the query, which may be a signature."""
    if not is_remote(name):
        return name
    scheme, _, rest = name.partition("://")
    host, slash, path = rest.partition("/")
    user, at, machine = host.rpartition("@")
    mark = ""
    if scheme.lower() not in _SSH:
        path, mark, _ = path.partition("?")
    return f"{scheme}://{user.partition(':')[0]}{at}{machine}{slash}{path}{'?…' if mark else ''}"


class RemoteSource:
    """The octets of a file on another machine."""

    def __init__(self, stream: _Stream) -> None:
        self.damage = ""
        self._stream = stream
        self._taken = 0

    def read(self, size: int) -> bytes:
        """Return up to ``size`` octets; none at the end, or once the connection is lost (see ``damage``)."""
        if self.damage:
            return b""
        try:
            piece = bytes(self._stream.read(size))
        except Exception as error:  # noqa: BLE001 - each transport has errors of its own
            self.damage = f"{READING_FAILED} {self._taken}: {_reason(error)}"
            return b""
        self._taken += len(piece)
        return piece

    def close(self) -> None:
        """Release the connection. May be called twice."""
        try:
            self._stream.close()
        except Exception:  # noqa: BLE001 - an error while closing loses nothing
            return


def open_remote(name: str, seconds: float = READ_S) -> RemoteSource:
    """Open a file on another machine. Raises `CaptureError`, with one line that names host and file, if it cannot be read.

    A server that accepts but stays silent is given up after ``seconds``, however often a transport would try.
    """
    return _asked(name, lambda: RemoteSource(bounded(lambda: _fetched(name), seconds)))


def bounded(ask: Callable[[], T], seconds: float) -> T:
    """Return the result of ``ask``, or raise its exception; TimeoutError if that takes longer, however it waits."""
    from concurrent.futures import Future  # late: few runs read from other machines

    answer: Future[T] = Future()

    def work() -> None:
        try:
            answer.set_result(ask())
        except BaseException as error:  # noqa: BLE001 - of any kind: it is raised by who waits
            answer.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    return answer.result(seconds)


def _fetched(name: str) -> _Stream:
    files, path = file_system(name)
    if not name.startswith("http") and files.isdir(path):
        raise IsADirectoryError
    # A web server need not support ranges: one request for the whole file, read while it arrives.
    stream: _Stream = files.open(path, "rb", block_size=0 if name.startswith("http") else _AHEAD)
    return stream


def file_system(name: str) -> tuple[Any, str]:
    """Return the file system of fsspec for a name, and the path in it. Raises whatever the transport raises."""
    from fsspec.core import url_to_fs

    scheme, _, rest = name.partition("://")
    scheme = scheme.lower()
    if scheme in _OF_HOST:
        parts = urlsplit(name)
        if not parts.hostname:
            raise ValueError("the address names no host")
        if parts.port == 0:  # reading it refuses other invalid port numbers
            raise ValueError("Port out of range 1-65535")
    host, slash, path = rest.partition("/")
    # Only the host goes to `url_to_fs`, because that would take some characters of a file name for a query or a fragment.
    found: tuple[Any, str] = url_to_fs(f"{scheme}://{host}/" if scheme in _SSH else name, **_patience(scheme))
    return (found[0], slash + path) if scheme in _SSH else found


def _patience(scheme: str) -> Mapping[str, object]:
    """Return the options of a transport that set its timeouts, and make SSH check the host's key."""
    if scheme in _SSH:
        return {
            "known_hosts": (),  # the user's own file: an unknown host is refused
            "connect_timeout": CONNECT_S,
            "login_timeout": CONNECT_S,
            "keepalive_interval": READ_S // 3,
        }
    if scheme in {"http", "https"}:
        from aiohttp import ClientTimeout

        return {"client_kwargs": {"timeout": ClientTimeout(total=None, sock_connect=CONNECT_S, sock_read=READ_S)}}
    if scheme in {"s3", "s3a"}:
        retries = {"max_attempts": 1}
        return {"config_kwargs": {"connect_timeout": CONNECT_S / 2, "read_timeout": READ_S, "retries": retries}}
    return {}


def _asked(name: str, ask: Callable[[], T]) -> T:
    """Return the result of ``ask``; turn any exception into a `CaptureError` of one line."""
    try:
        return ask()
    except IsADirectoryError:
        reason = "a directory, not a capture file"
    except Exception as error:  # noqa: BLE001 - each transport has errors of its own
        reason = explained(error)
        if reason == _NO_FILE and name.startswith("http") and re.search(_PATTERN, name.partition("?")[0]):
            reason += "; a web server lists no folders, so a name there is no pattern"
    raise CaptureError(f"{printable(shown(name))}: {reason}") from None


def explained(error: Exception, writing: bool = False) -> str:
    """Return why reading (or ``writing``) a file on another machine failed, and what to do about it if that is known."""
    if isinstance(error, ImportError):
        if (error.name or "").partition(".")[0] in {"fsspec", "aiohttp"}:
            return "a file of another machine, which needs more packages: pip install 's7dissect[remote]'"
        return f"needs one more package: {_reason(error)}"
    cause = error.__cause__  # the error of the transport itself
    kind = type(cause or error).__name__
    said = _reason(cause if isinstance(cause, Exception) else error)
    status = getattr(cause or error, "status", 0)
    if "HostKey" in kind:
        return (
            f"the host is not known, or is not the known one ({said}); connect once with ssh, check its key and keep it"
        )
    if status in _REFUSED:  # of a web server
        return f"access refused ({said}); credentials are what the address holds: https://USER:PASSWORD@HOST/…"
    if kind in {"PermissionDenied", "NoCredentialsError", "ClientError"}:
        return f"access refused ({said}); credentials are those of the transport's own tools"
    if isinstance(error, PermissionError):
        return "no permission to write it" if writing else "no permission to read it"
    # For a web server this error is also raised for every failure before there was an answer.
    of_web = type(cause).__module__.startswith("aiohttp") or isinstance(cause, OSError)
    if isinstance(error, FileNotFoundError) and (status == _NOT_FOUND or not of_web):
        return "no such place" if writing else _NO_FILE
    if isinstance(error, ValueError) and "rotocol" in said:
        return f"{said}; known ones are https, sftp, s3 and the others of fsspec"
    return f"cannot be written: {said}" if writing else f"cannot be read: {said}"


def _reason(error: Exception) -> str:
    """Return the message of an error in one line, without control characters; the error's name where it has no message."""
    import socket  # imported late, like ssl: this module is read at every start, and few runs read from other machines
    import ssl

    if isinstance(error, ssl.SSLError):  # its number is not one of the system's error numbers
        return _reason_of_tls(error)
    if isinstance(error, OSError) and error.errno is not None and error.errno > 0:
        return os.strerror(error.errno)
    if isinstance(error, socket.gaierror) and error.strerror:  # its number means nothing to a person
        return error.strerror
    if isinstance(error, TimeoutError):  # some have no text, some name a function
        return "no answer in time"
    return shortened(re.sub(_SECRETS, "…", " ".join(str(error).split())) or type(error).__name__, _REASON)


def _reason_of_tls(error: ssl.SSLError) -> str:
    """Return the reason of a TLS error, or of a transport's error that was raised from one."""
    for each in (error, error.__cause__):
        refused = getattr(each, "verify_message", "").rstrip(".")
        if refused:
            return f"its certificate is not accepted: {refused}; SSL_CERT_FILE names others to trust"
    why = getattr(error, "reason", "") or getattr(error.__cause__, "reason", "") or "no reason given"
    return f"TLS failed: {str(why).lower().replace('_', ' ')}"


# ---- several files by one name --------------------------------------------------------------------------------------


def expand(names: Iterable[str]) -> list[str]:
    """Return the files that names denote: patterns (``*``, ``?``, ``[…]``) and days (``{2026-11-01..2026-11-30}``).

    The files of a pattern come in the order of their packets' time, remote ones by name. If a local file has the pattern itself
    as its name, only that file is meant. Days of a range without a file are left out. `CaptureError` when a pattern or a range
    finds no file, or the range is invalid.
    """
    found: list[str] = []
    for name in names:
        days = [name] if _is_here(name) else _days(name)
        if len(days) == 1:
            found += _matches(days[0]) or _nothing(name)
        else:
            found += [file for day in days for file in _matches(day, must=False)] or _nothing(name)
    return found


def _nothing(name: str) -> list[str]:
    raise CaptureError(f"{printable(shown(name))}: no file has such a name")


def _matches(name: str, must: bool = True) -> list[str]:
    """Return the files of one pattern. A name without a pattern is returned if the file exists or ``must`` is set."""
    if is_remote(name):
        scheme, _, rest = name.partition("://")
        path = rest if scheme.lower() in _SSH else rest.partition("?")[0]
        if not re.search(_PATTERN, path) or name.startswith("http"):
            return [name] if must or _exists(name) else []
        return _asked(name, lambda: _globbed(name))
    if name == "-" or _is_here(name):
        return [name]
    if not re.search(_PATTERN, name):
        return [name] if must else []
    return _local(name)


def _is_here(name: str) -> bool:
    return not is_remote(name) and Path(name).exists()


def _local(name: str) -> list[str]:
    """Return the local files of a pattern. As in a shell, names that begin with a dot are found only by a pattern that does."""
    anchor = Path(name).anchor
    # Only as a whole part of the path does ** mean all folders; elsewhere `glob` refuses it, and a shell takes it for *.
    parts = [part if part == "**" else re.sub(r"\*{2,}", "*", part) for part in Path(name[len(anchor) :]).parts]
    dotted = [part for part in parts if part.startswith(".")]

    def is_meant(path: Path) -> bool:
        hidden = [part for part in path.parts if part.startswith(".")]
        return all([any([fnmatchcase(part, each) for each in dotted]) for part in hidden])

    from dissect.packets.source.order import by_time

    return by_time([os.fspath(path) for path in Path(anchor).glob(str(Path(*parts))) if is_meant(path)])


def _globbed(name: str) -> list[str]:
    files, path = file_system(name)
    root = (
        f"{name.partition('://')[0]}://{urlsplit(name).netloc}"
        if path.startswith("/")
        else f"{name.partition('://')[0]}://"
    )
    return [root + str(found) for found in sorted(files.glob(path))]


def _exists(name: str) -> bool:
    def ask() -> bool:
        files, path = file_system(name)
        return bool(files.exists(path))

    return _asked(name, lambda: bounded(ask, READ_S))


def _days(name: str) -> list[str]:
    """Return a name once for each day of the range in it, in order; just the name if it has no range."""
    match = re.search(_DAYS, name)
    if match is None:
        return [name]
    dashed = "-" in match[1]
    try:
        first, last = (date.fromisoformat(text) for text in match.groups())
    except ValueError as error:
        raise CaptureError(f"{printable(shown(name))}: {error}") from None
    count = (last - first).days + 1
    if dashed != ("-" in match[2]) or not 0 < count <= MAX_DAYS:
        raise CaptureError(
            f"{printable(shown(name))}: not a range of days: both are written alike, the first is not after the last, "
            f"and there are at most {MAX_DAYS}"
        )
    form = "%Y-%m-%d" if dashed else "%Y%m%d"
    days = [(first + timedelta(number)).strftime(form) for number in range(count)]
    return [name[: match.start()] + day + name[match.end() :] for day in days]
