"""Session keys from an SSLKEYLOGFILE (draft-ietf-tls-keylogfile), by the random of the ClientHello.

Secrets are only given to code that decrypts; nothing here writes one as text.
"""

from __future__ import annotations

import re
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Final, Protocol

MASTER: Final = "CLIENT_RANDOM"
EARLY: Final = "CLIENT_EARLY_TRAFFIC_SECRET"
HANDSHAKE_OF: Final = ("CLIENT_HANDSHAKE_TRAFFIC_SECRET", "SERVER_HANDSHAKE_TRAFFIC_SECRET")
TRAFFIC_OF: Final = ("CLIENT_TRAFFIC_SECRET_0", "SERVER_TRAFFIC_SECRET_0")

#: Labels of secrets that open records; the other labels of the format (exporters, ECH) are known, but not kept.
_KEPT: Final = frozenset((MASTER, EARLY, *HANDSHAKE_OF, *TRAFFIC_OF))
_KNOWN: Final = frozenset(("EARLY_EXPORTER_SECRET", "EXPORTER_SECRET", "ECH_SECRET", "ECH_CONFIG", "RSA"))
# Patterns are texts, which `re` compiles and caches at their first use: most runs use none.
_LINE: Final = rb"([A-Z][A-Z0-9_]{1,63}) ([0-9A-Fa-f]{2,512}) ([0-9A-Fa-f]{2,512})"
_BEGINNING: Final = rb"[A-Z][A-Z0-9_]{0,63}( [0-9A-Fa-f]{0,512}( [0-9A-Fa-f]{0,512})?)?"
_RANDOM: Final = 32
_SECRETS: Final = frozenset((32, 48, 64))

#: Maximum number of sessions that are kept; a machine that logs for weeks may have more, then the oldest are dropped.
MAX_SESSIONS: Final = 200_000
#: Maximum size of an unfinished line that is kept; the format needs some three hundred octets.
_MAX_LINE: Final = 4096


class Growing(Protocol):
    """A file that another program writes: `more` returns the new data, ``begun`` counts how often the file was restarted."""

    begun: int

    def more(self) -> bytes:
        """Return what was written since the last call."""


class KeyLog:
    """Secrets from key logs: given to `add`, or read from ``sources`` and ``files``, which may grow.

    ``lines`` counts lines that are not comments, ``wrong`` those of another form, ``forgotten`` sessions that were dropped.
    ``revision`` grows with each new secret.
    """

    def __init__(self, sources: Sequence[Callable[[], bytes]] = (), files: Sequence[Growing] = ()) -> None:
        self._sources = [*[_Source(more) for more in sources], *[_Source(file.more, file) for file in files]]
        self._sessions: OrderedDict[bytes, dict[str, bytes]] = (
            OrderedDict()
        )  # a dict searches for its first key from the start
        self.lines = 0
        self.wrong = 0
        self.forgotten = 0
        self.revision = 0

    def __repr__(self) -> str:
        return f"KeyLog({len(self._sessions)} sessions)"  # without any secret

    def __len__(self) -> int:
        return len(self._sessions)

    def add(self, text: bytes) -> None:
        """Take whole lines of a key log; count those of another form."""
        for piece in _lines(text):
            line = _stripped(piece)
            if not _says_nothing(line):
                self.lines += 1
                self.wrong += not self._line(line)

    def _line(self, line: bytes) -> bool:
        """Take a line; return False if it has another form."""
        found = re.fullmatch(_LINE, line)
        if found is None:
            return False
        label = found[1].decode("ascii")
        if label not in _KEPT:
            return label in _KNOWN
        if len(found[2]) != 2 * _RANDOM or len(found[3]) % 2 or len(found[3]) // 2 not in _SECRETS:
            return False
        random = bytes.fromhex(found[2].decode("ascii"))
        secret = bytes.fromhex(found[3].decode("ascii"))
        session = self._sessions.get(random)
        if session is None:
            if len(self._sessions) >= MAX_SESSIONS:
                self._sessions.popitem(last=False)
                self.forgotten += 1
            session = {}
            self._sessions[random] = session
        if session.get(label) != secret:
            session[label] = secret
            self.revision += 1
        return True

    def look(self) -> None:
        """Read what was added to the sources, because key logs grow during a live capture.

        The last line may be unfinished. It is used as soon as it could be complete, and counted as wrong as soon as it cannot
        become valid.
        """
        for source in self._sources:
            text = source.text()
            if text:
                *whole, rest = _lines(source.rest + text)
                source.rest = rest[:_MAX_LINE]
                self.add(b"\n".join(whole))
                end = _stripped(rest)
                source.unfinished = not (_says_nothing(end) or self._line(end))
                if source.unfinished and re.fullmatch(_BEGINNING, end) is None:
                    self.add(rest)
                    source.rest, source.unfinished = b"", False

    @property
    def unfinished(self) -> int:
        """Number of sources that end with an unfinished line, which gives no secret yet."""
        return sum([source.unfinished for source in self._sources])

    def find(self, random: bytes) -> dict[str, bytes]:
        """Return the secrets of the session with this ClientHello ``random``, by label; empty if there are none."""
        return self._sessions.get(random, {})


class _Source:
    """A source of lines, and the unfinished line at its end; ``unfinished``: that line gives no secret yet."""

    __slots__ = ("_begun", "_file", "_more", "rest", "unfinished")

    def __init__(self, more: Callable[[], bytes], file: Growing | None = None) -> None:
        self._more = more
        self._file = file
        self._begun = file.begun if file is not None else 0
        self.rest = b""
        self.unfinished = False

    def text(self) -> bytes:
        """Return what was written since the last call. If the file was restarted, the unfinished line is dropped."""
        text = self._more()
        if self._file is not None and self._file.begun != self._begun:
            self._begun = self._file.begun
            self.rest = b""
            self.unfinished = False
        return text


def _stripped(line: bytes) -> bytes:
    return line.strip(b" \t\xef\xbb\xbf\0")


def _says_nothing(line: bytes) -> bool:
    """Return whether a line is a comment, or empty."""
    stripped = _stripped(line)
    return not stripped or stripped.startswith(b"#")


def _lines(text: bytes) -> list[bytes]:
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")


class KeyRing:
    """All key logs of a run: those ``given`` by the user, and those ``found`` in the capture."""

    def __init__(self, given: KeyLog | None = None) -> None:
        self.given = given
        self.found = KeyLog()

    def __len__(self) -> int:
        return len(self.found) + (len(self.given) if self.given is not None else 0)

    @property
    def asked(self) -> bool:
        """True if sessions are to be decrypted: there is a key log, even an empty one."""
        return self.given is not None or self.found.lines > 0

    @property
    def lacks(self) -> str:
        """Return, as half a sentence, the content of the key logs if they lack the secrets of a session."""
        logs = (self.found,) if self.given is None else (self.found, self.given)
        count = len(self)
        others = f"only keys of {count} other session{'s' if count > 1 else ''}" if count else ""
        begun = "the beginning of a line that is cut off" if any([log.unfinished for log in logs]) else ""
        if others or begun:
            said = " and ".join([one for one in (others, begun) if one])
            return f"the key log holds {said if others else 'only ' + said}"
        if any([log.wrong for log in logs]):
            return "no line of the key log has the form LABEL CLIENT_RANDOM SECRET"
        lines = any([log.lines for log in logs])
        return "the key log holds nothing that opens records" if lines else "the key log is empty"

    @property
    def revision(self) -> int:
        """Grows with each new secret."""
        return self.found.revision + (self.given.revision if self.given is not None else 0)

    def look(self) -> None:
        """Read what was added to the key logs."""
        if self.given is not None:
            self.given.look()

    def find(self, random: bytes) -> dict[str, bytes]:
        """Return the secrets of a session by label; empty if there are none."""
        found = self.found.find(random)
        given = self.given.find(random) if self.given is not None else {}
        return {**found, **given} if found else given
