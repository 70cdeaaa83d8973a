"""One TLS session, both directions: its handshake, and its content if the session keys are known.

Octets are fed as the transport delivers them; content is returned as `Content`, in the order in which it was sent. Nothing from
the wire raises. Records that cannot be decrypted are counted, and `TlsSession.why_closed` gives the reason.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.tls import aead, key_log
from dissect.protocols.tls.aead import NEEDS, Opener
from dissect.protocols.tls.certificate import read_certificate
from dissect.protocols.tls.direction import EARLY, HANDSHAKING, TRAFFIC, Direction
from dissect.protocols.tls.handshake import certificates_of, parse_hello
from dissect.protocols.tls.key_log import KeyRing
from dissect.protocols.tls.key_schedule import TrafficSecrets, key_block, traffic_keys
from dissect.protocols.tls.records import begins_record
from dissect.protocols.tls.tables import (
    ALERT,
    ALERT_LEVELS,
    ALERTS,
    APPLICATION_DATA,
    CERTIFICATE,
    CHANGE_CIPHER_SPEC,
    CIPHER_SUITES,
    CLIENT_HELLO,
    END_OF_EARLY_DATA,
    FINISHED,
    HANDSHAKE,
    KEY_UPDATE,
    SERVER_HELLO,
    TLS_1_2,
    TLS_1_3,
    TLS_VERSIONS,
    Suite,
    suite_of,
)
from dissect.wire.copies import leaves

#: Limits for encrypted records that wait for their key, in octets: for a session, and for all sessions of a run together.
MAX_WAITING: Final = 128 * 1024
MAX_WAITING_ALL: Final = 16 * 1024 * 1024
#: Maximum number of KeyUpdates that are followed; each needs a step of the key schedule.
_MAX_UPDATES: Final = 10_000


class Content:
    """Decrypted application data that side ``index`` sent, and the packet that completed the record."""

    __slots__ = ("frame", "index", "octets", "time_ns")

    def __init__(self, index: int, octets: bytes, frame: int, time_ns: int) -> None:
        self.index = index
        self.octets = octets
        self.frame = frame
        self.time_ns = time_ns


class Waiting:
    """Counts the ``octets`` of all sessions that wait for keys."""

    __slots__ = ("octets",)

    def __init__(self) -> None:
        self.octets = 0


class TlsSession:
    """A TLS session, as far as captured. ``directions`` are by side of the connection; ``client`` is the side of the client.

    ``version`` and ``suite_code`` are the server's choice, 0 and -1 while unknown. ``server_name`` is the name that the client
    requested. ``why_closed`` is set at the end: why records stayed encrypted although there is a key log. ``malformed`` counts
    messages and records that contradict themselves. ``shown`` are the sides whose certificates were read since it was last
    emptied.
    """

    def __init__(self, keys: KeyRing, waiting: Waiting | None = None) -> None:
        self.directions = (Direction(), Direction())
        self.client = -1
        self.version = 0
        self.suite_code = -1
        self.server_name = ""
        self.why_closed = ""
        self.malformed = 0
        self.shown: list[int] = []
        self._keys = keys
        self._all = waiting if waiting is not None else Waiting()
        self._suite: Suite | None = None
        self._client_random = b""
        self._server_random = b""
        self._secrets: dict[str, bytes] = {}
        self._traffic = (TrafficSecrets(), TrafficSecrets())
        self._revision = -1
        self._retried = False
        self._installed = True
        self._waiting: list[tuple[int, bytes, int, int]] = []
        self._waits = 0  # octets of the waiting records
        self._overflown = False

    # ---- what came in -----------------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        return f"TlsSession({self.version_name or 'version unknown'})"

    @property
    def held(self) -> int:
        """Number of kept octets: unfinished records and messages, and records that wait for their key."""
        return self._waits + sum([one.reader.held + one.messages.held for one in self.directions])

    def wants(self, index: int, octets: bytes, start: int, end: int) -> bool:
        """Return whether a message of side ``index`` belongs to the session: it continues a record or begins with one."""
        return self.directions[index].reader.held > 0 or begins_record(octets, start, end)

    def feed(self, index: int, octets: bytes, frame: int, time_ns: int) -> list[Content]:
        """Take the next octets of side ``index``; return the content that can be decrypted now."""
        direction = self.directions[index]
        found: list[Content] = []
        skipped = direction.reader.skipped
        records = direction.reader.push(octets)
        for record in records:
            direction.count(record, time_ns)
            self._take(index, record, frame, time_ns, found)
        if direction.reader.skipped > skipped:
            direction.lose(direction.reader.skipped - skipped)
        return found

    def lose(self, index: int, size: int) -> None:
        """``size`` octets of side ``index`` are missing here."""
        self.directions[index].lose(size)

    def close(self) -> None:
        """The session is over: find out why records stayed encrypted, and forget the secrets."""
        self._give_up_waiting()
        self.why_closed = self._why()
        self._secrets = {}
        for secrets in self._traffic:
            secrets.forget()
        for direction in self.directions:
            direction.renew(direction.stage)

    def _give_up_waiting(self) -> None:
        """Count the records that still wait for a key as not decrypted, and drop them."""
        for index, _, _, _ in self._waiting:
            self.directions[index].shut += 1
        self._drop_waiting()

    def _take(self, index: int, record: bytes, frame: int, time_ns: int, found: list[Content]) -> None:
        direction = self.directions[index]
        kind = record[0]
        if self.version == TLS_1_3 or not self.version:
            sealed = kind == APPLICATION_DATA or (direction.changed and not self.version)
        else:
            sealed = direction.changed or kind == APPLICATION_DATA
        if not sealed:
            self._content(index, kind, record[5:], frame, time_ns, found, False)
            return
        self._look(found)
        if self._opened(index, record, frame, time_ns, found):
            return
        if self._may_open(direction) and self._wait(index, record, frame, time_ns):
            return
        direction.shut += 1

    # ---- records that wait ------------------------------------------------------------------------------------------

    def _look(self, found: list[Content]) -> None:
        """Look for further secrets while some are missing; decrypt the records that waited for them."""
        if not self._keys.asked or all([one.content for one in self.directions]):
            return
        self._keys.look()
        if self._revision != self._keys.revision:
            self._revision = self._keys.revision
            self._secrets = self._keys.find(self._client_random)
        if not self._waiting or not self._secrets or not self.version:
            return
        waiting = self._waiting
        self._drop_waiting()
        for index, record, frame, time_ns in waiting:
            if not self._opened(index, record, frame, time_ns, found):
                self._wait(index, record, frame, time_ns)

    def _may_open(self, direction: Direction) -> bool:
        """Return whether a key for a record may still turn up."""
        if not self._keys.asked or self._overflown or not self._client_random or direction.given_up:
            return False
        if not self.version:
            return True  # early data: the ServerHello comes later
        if self._suite is None or not self._installed:
            return False
        if self.version == TLS_1_3:
            return self._missing(self.directions.index(direction), direction.stage) != ""
        return key_log.MASTER not in self._secrets

    def _wait(self, index: int, record: bytes, frame: int, time_ns: int) -> bool:
        size = len(record)
        if self._waits + size > MAX_WAITING or self._all.octets + size > MAX_WAITING_ALL:
            self._overflown = True
            self._give_up_waiting()
            return False
        self._waiting.append((index, record, frame, time_ns))
        self._waits += size
        self._all.octets += size
        return True

    def _drop_waiting(self) -> None:
        self._waiting = []
        self._all.octets -= self._waits
        self._waits = 0

    # ---- decryption -------------------------------------------------------------------------------------------------

    def _opened(self, index: int, record: bytes, frame: int, time_ns: int, found: list[Content]) -> bool:
        """Decrypt a record and take its content; return False if no key fits."""
        if not self._secrets or not self._installed:
            return False
        direction = self.directions[index]
        try:
            if self.version == TLS_1_3:
                plain = direction.open_1_3(record, lambda stage: self._opener_1_3(index, stage))
            elif self.version == TLS_1_2 and direction.changed:
                plain = direction.open_1_2(record, lambda: self._opener_1_2(index))
            else:
                return False
        except ImportError:
            self._installed = False
            return False
        if plain is None:
            return False
        direction.opened += 1
        kind = record[0]
        if self.version == TLS_1_3:
            plain = plain.rstrip(b"\0")
            if not plain:
                self.malformed += 1
                return True
            kind = plain[-1]
            plain = plain[:-1]
        self._content(index, kind, plain, frame, time_ns, found, True)
        return True

    def _opener_1_3(self, index: int, stage: int) -> Opener | None:
        secret = self._secrets.get(self._label(index, stage))
        if secret is None or self._suite is None:
            return None
        if stage == TRAFFIC:
            secret = self._traffic[index].after(self._suite, secret, self.directions[index].updates)
        return Opener(self._suite, traffic_keys(self._suite, secret))

    def _label(self, index: int, stage: int) -> str:
        if stage == EARLY:
            return key_log.EARLY
        labels = key_log.HANDSHAKE_OF if stage == HANDSHAKING else key_log.TRAFFIC_OF
        return labels[0 if index == self.client else 1]

    def _opener_1_2(self, index: int) -> Opener | None:
        master = self._secrets.get(key_log.MASTER)
        if master is None or self._suite is None:
            return None
        client, server = key_block(self._suite, master, self._client_random, self._server_random)
        return Opener(self._suite, client if index == self.client else server)

    # ---- content ----------------------------------------------------------------------------------------------------

    def _content(
        self, index: int, kind: int, octets: bytes, frame: int, time_ns: int, found: list[Content], opened: bool
    ) -> None:
        direction = self.directions[index]
        if kind == APPLICATION_DATA:
            if opened:
                direction.content += 1
                if octets:
                    found.append(Content(index, octets, frame, time_ns))
        elif kind == HANDSHAKE:
            for type_, body in direction.messages.push(octets):
                self._message(index, type_, body, opened)
        elif kind == ALERT:
            if len(octets) == 2:
                direction.alert = f"{ALERT_LEVELS.name(octets[0])} {ALERTS.name(octets[1])}"
        elif kind == CHANGE_CIPHER_SPEC and self.version != TLS_1_3:
            direction.changed = True
            direction.renew(HANDSHAKING)
            direction.messages.drop()

    def _message(self, index: int, type_: int, body: bytes, opened: bool) -> None:
        direction = self.directions[index]
        if type_ == CLIENT_HELLO:
            self._client_hello(index, body, opened)
        elif type_ == SERVER_HELLO:
            self._server_hello(index, body)
        elif type_ == CERTIFICATE:
            direction.certificates = [read_certificate(der) for der in certificates_of(body, self.version)]
            if direction.certificates:
                self.shown.append(index)
        elif self.version == TLS_1_3 and opened:
            if type_ == FINISHED:
                direction.renew(TRAFFIC)
            elif type_ == END_OF_EARLY_DATA:
                direction.renew(HANDSHAKING)
            elif type_ == KEY_UPDATE and direction.stage == TRAFFIC and direction.updates < _MAX_UPDATES:
                direction.updates += 1
                direction.renew(TRAFFIC)

    def _client_hello(self, index: int, body: bytes, opened: bool) -> None:
        hello = parse_hello(body, True)
        if not hello.random:
            self.malformed += 1
            return
        if self.version and not opened and not self._retried:
            self._begin_anew()
        self.client = index
        self.server_name = hello.server_name or self.server_name
        self._client_random = hello.random
        self._revision = -1
        self._secrets = {}
        if hello.early_data and not self._retried:
            self.directions[index].renew(EARLY)

    def _begin_anew(self) -> None:
        """Another session begins on the connection: keep only the counts of the old one."""
        self._give_up_waiting()
        self.version = 0
        self._overflown = False
        for direction in self.directions:
            direction.changed = False
            direction.updates = 0
            direction.given_up = False
            direction.messages.drop()
            direction.renew(HANDSHAKING)

    def _server_hello(self, index: int, body: bytes) -> None:
        hello = parse_hello(body, False)
        if not hello.suites:
            self.malformed += 1
            return
        if self.client < 0:
            self.client = 1 - index
        self._retried = hello.retry
        if hello.retry:
            self.directions[1 - index].renew(HANDSHAKING)  # the server refused early data
            return
        self.version = hello.version
        self.suite_code = hello.suites[0]
        self._suite = suite_of(self.suite_code)
        self._server_random = hello.random

    # ---- what to say of it ------------------------------------------------------------------------------------------

    @property
    def version_name(self) -> str:
        """The version that the server chose; empty while unknown."""
        return TLS_VERSIONS.name(self.version) if self.version else ""

    @property
    def suite_name(self) -> str:
        """The cipher suite that the server chose; empty while unknown."""
        return CIPHER_SUITES.name(self.suite_code) if self.suite_code >= 0 else ""

    @property
    def shut(self) -> int:
        """Number of encrypted records that were not decrypted."""
        return sum([one.shut for one in self.directions])

    @property
    def opened(self) -> int:
        """Number of encrypted records that were decrypted."""
        return sum([one.opened for one in self.directions])

    @property
    def is_open(self) -> bool:
        """True if application data were decrypted."""
        return any([one.content for one in self.directions])

    def _missing(self, index: int, first: int) -> str:
        """Return the label of a missing secret that records of side ``index`` need from stage ``first`` on."""
        if self.version != TLS_1_3:
            return "" if key_log.MASTER in self._secrets else key_log.MASTER
        for stage in range(first, TRAFFIC + 1):
            label = self._label(index, stage)
            if label not in self._secrets:
                return label
        return ""

    def _why(self) -> str:
        """Return why records stayed encrypted although there is a key log, as half a sentence; empty if none did."""
        if not self._keys.asked or not self.shut:
            return ""
        if not self._client_random:
            return "its ClientHello was not captured, and only that tells which keys are its own"
        if not self._keys.find(self._client_random):
            return self._keys.lacks
        if not self.version:
            return "its ServerHello was not captured, and only that names the cipher suite"
        if self._suite is None or self.version not in {TLS_1_2, TLS_1_3}:
            return (
                f"{self.version_name} with {self.suite_name} is not decrypted, only the AEAD suites of TLS 1.2 and 1.3"
            )
        if not (self._installed and aead.is_installed()):
            return f"decrypting {NEEDS}"
        shut = [index for index in (0, 1) if self.directions[index].shut]
        stages = [min(self.directions[index].stage, HANDSHAKING) for index in shut]
        missing = [label for label in map(self._missing, shut, stages) if label]
        if missing:
            return f"the key log lacks {' and '.join(missing)} of its session"
        if any([self.directions[index].opened for index in shut]):
            return "records are missing from the capture, and those after them fit no record number that was tried"
        return "the secrets given for it do not open the records: they belong to another session, or the records were changed"


def _taken(_session: TlsSession) -> tuple[KeyRing]:
    return (KeyRing(),)


#: Session keys stay where they are, and what only they can open.
leaves(TlsSession, without=("_all", "_keys", "_secrets", "_suite", "_traffic", "_waiting"), taken=_taken)
