"""Connects to the scheduler of a Dask cluster, or says in one line why it cannot."""

from __future__ import annotations

import importlib.util
import logging
import re
import socket
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final
from urllib.parse import urlsplit

from dissect.packets.source.remote import bounded
from dissect.wire.text import reason, shortened

#: Seconds in all to wait for answers from the scheduler and the workers.
ANSWER_S: Final = 8
#: Seconds for closing the connection.
_CLOSE_S: Final = 1
_ADDRESS: Final = re.compile(r"(tcp|tls)://(\[[0-9A-Fa-f:.]+\]|[^\s:/@\[\]]+):(\d{1,5})/?")
_LARGEST_PORT: Final = 65535
_REASON: Final = 200


class ClusterError(Exception):
    """A cluster cannot be used; the message is for users."""


def checked_address(text: str) -> str:
    """Return the address of a scheduler. Raises ValueError, with the expected form, for anything else."""
    match = _ADDRESS.fullmatch(text)
    if match is None or not 0 < int(match[3]) <= _LARGEST_PORT:
        raise ValueError(f"expected tcp://HOST:PORT or tls://HOST:PORT of a Dask scheduler, got {text!r}.")
    return text.rstrip("/")


def brief(error: BaseException) -> str:
    """Return the message of a library's error, shortened to one line."""
    return shortened(reason(error).partition("\\n")[0], _REASON)


class Patience:
    """The time of ``ANSWER_S`` seconds for answers; ``left`` is what remains of it."""

    def __init__(self) -> None:
        self.whole = ANSWER_S
        self._end = time.monotonic() + ANSWER_S

    @property
    def left(self) -> float:
        """The remaining seconds, at least 0."""
        return max(0.0, self._end - time.monotonic())


@contextmanager
def connected(address: str) -> Iterator[tuple[Any, Patience]]:
    """A context with a `distributed.Client` of the scheduler at ``address``, and the remaining time. Raises `ClusterError`.

    In the context, libraries write no log lines to stderr; the caller reports what is important.
    """
    if importlib.util.find_spec("distributed") is None:
        raise ClusterError("a cluster needs Dask: pip install 's7dissect[cluster]'")
    patience = Patience()
    _knock(address, patience)
    disabled = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        client = _client(address, patience)
        try:
            yield client, patience
        finally:
            client.close(timeout=_CLOSE_S)
    finally:
        logging.disable(disabled)


def _client(address: str, patience: Patience) -> Any:
    from distributed import Client

    seconds = patience.left
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # versions of Dask that differ; `cluster-check` reports them
            # The library's own time limit covers only the TCP connection; it would wait for a greeting for ever.
            return bounded(lambda: Client(address, timeout=seconds, set_as_default=False), seconds)
    except TimeoutError:
        raise ClusterError(
            f"{address}: a program listens there, but it did not answer as a Dask scheduler within {patience.whole} seconds"
        ) from None
    except (Exception, SystemExit) as error:  # noqa: BLE001 - each transport has errors of its own
        raise _not_a_scheduler(address, error) from None


def _knock(address: str, patience: Patience) -> None:
    """Fail at once for an unknown name or a closed port, for which Dask would retry for seconds."""
    parts = urlsplit(address)
    try:
        socket.create_connection((parts.hostname or "", parts.port or 0), patience.left).close()
    except OSError as error:
        said = f"no answer within {patience.whole} seconds" if isinstance(error, TimeoutError) else brief(error)
        raise ClusterError(f"{address}: no scheduler can be reached there: {said}") from None


def _not_a_scheduler(address: str, error: BaseException) -> ClusterError:
    cause = error.__cause__ or error
    if address.startswith("tls:") and "TLS" in str(error):
        why = f"{brief(error)}; certificates are those of Dask's own settings (distributed.comm.tls)"
    else:
        said = f" ({brief(cause)})" if isinstance(cause, OSError) else ""
        why = f"it does not answer as a Dask scheduler{said}"
    return ClusterError(f"{address}: {why}")
