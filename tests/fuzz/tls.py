"""Fuzz target ``tls``: the data of the two sides of a TLS session, as records, handshake messages and certificates.

The first octet chooses the key log: none, or one whose secrets belong to the suites of `tests.protocols.tls.sealing` and to the
session of ``captures/s7plus/s7commplus-tls.pcapng``. Pieces follow: the side, whether octets are missing before it, its length,
its octets.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Final

from dissect.engine.observer import Observer
from dissect.engine.transactions.side import Side
from dissect.files.session import Run
from dissect.protocols.tls.handshake import MAX_MESSAGE
from dissect.protocols.tls.key_log import KeyLog, KeyRing
from dissect.protocols.tls.records import HEADER, MAX_BODY
from dissect.protocols.tls.session import MAX_WAITING, TlsSession
from tests.fuzz.checks import check_line
from tests.protocols.tls.sealing import ALERT, FINISHED, HANDSHAKE, KEY_UPDATE, Pair

CAPTURE: Final = Path(__file__).resolve().parents[2] / "captures" / "s7plus" / "s7commplus-tls.pcapng"
SUITES: Final = (0x1301, 0x1302, 0x1303, 0x1304, 0x1305)
#: Maximum size of an unfinished record and an unfinished message of either side, and of waiting records.
MOST_HELD: Final = MAX_WAITING + 2 * (HEADER + MAX_BODY + 2 * MAX_MESSAGE)
_LOST: Final = 1000
_IN_FRONT: Final = 7  # TPKT and COTP header
_WITH_KEYS: Final = 1

Flights = list[tuple[int, bytes]]


class _Film(Observer):
    """Collects the contents of the COTP messages of a capture, in order."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.flights: Flights = []

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.flights.append((int(side.index), octets[_IN_FRONT:]))


@cache
def recorded() -> tuple[Flights, bytes]:
    """Return the messages of our recording, and its key log."""
    film = _Film()
    run = Run([CAPTURE], film)
    while run.step():
        pass
    octets = CAPTURE.read_bytes()
    begin = octets.index(b"KSLT") + 8
    return film.flights, octets[begin : begin + int.from_bytes(octets[begin - 4 : begin], "little")]


@cache
def _ring(suite: int) -> KeyRing:
    keys = KeyLog()
    keys.add(Pair(suite).keys())
    keys.add(recorded()[1])
    return KeyRing(keys)


def written(flights: Iterable[tuple[int, bytes]], kind: int, lost: int = -1) -> bytes:
    """Return the input for these messages; octets are missing before piece ``lost``."""
    pieces = [
        bytes((side | (2 if number == lost else 0),)) + len(octets).to_bytes(2, "big") + octets
        for number, (side, octets) in enumerate(flights)
    ]
    return bytes((kind,)) + b"".join(pieces)


def _pieces(octets: bytes) -> Iterator[tuple[int, bool, bytes]]:
    at = 1
    while at + 3 <= len(octets):
        end = at + 3 + int.from_bytes(octets[at + 1 : at + 3], "big")
        yield octets[at] & 1, bool(octets[at] & 2), octets[at + 3 : end]
        at = end


def _held(octets: bytes) -> tuple[TlsSession, Flights]:
    """Run the session; return it and the decrypted contents."""
    kind = octets[0] if octets else 0
    keys = _ring(SUITES[(kind >> 1) % len(SUITES)]) if kind & _WITH_KEYS else KeyRing()
    session = TlsSession(keys)
    found: Flights = []
    for side, lost, piece in _pieces(octets):
        if lost:
            session.lose(side, _LOST)
        found += [(content.index, content.octets) for content in session.feed(side, piece, 1, 1)]
        assert session.held <= MOST_HELD
    session.close()
    return session, found


def tls(octets: bytes) -> None:
    """Any data from two sides: accounted for, limited, the same each time, decrypted only by keys, shown safely."""
    session, found = _held(octets)
    for direction in session.directions:
        assert direction.opened + direction.shut <= direction.records
        for certificate in direction.certificates:
            for line in (certificate.subject, certificate.issuer, certificate.unread, certificate.validity_fault(1)):
                check_line(line)
    for line in (session.server_name, session.why_closed, session.version_name, session.suite_name):
        check_line(line)
    assert sum([len(text) for _, text in found]) <= len(octets)
    if not octets or not octets[0] & _WITH_KEYS:
        assert session.opened == 0
        assert not session.why_closed
    again, same = _held(octets)
    assert same == found
    assert (again.opened, again.shut, again.malformed) == (session.opened, session.shut, session.malformed)


def tls_seeds() -> list[bytes]:
    """Return the inputs: our recording, and sessions of every suite, whole, cut, with gaps, with and without keys."""
    flights, _ = recorded()
    made = [written(flights[:count], kind) for kind in (0, _WITH_KEYS) for count in (4, 8, len(flights))]
    for number, suite in enumerate(SUITES):
        pair = Pair(suite)
        client, server = pair.ends
        said = [*pair.begun, (0, client.seal(b"one")), (1, server.seal(b"two" * 40, padding=9))]
        said += [(1, server.seal(KEY_UPDATE, HANDSHAKE)), (0, client.seal(FINISHED, HANDSHAKE))]
        server.update()
        said += [(1, server.seal(b"three")), (0, client.seal(b"\1\0", ALERT))]
        cut = [(side, octets[at : at + 31]) for side, octets in said for at in range(0, len(octets), 31)]
        for kind in (0, number << 1 | _WITH_KEYS):
            made += [
                written(said, kind),
                written(cut, kind),
                written(said[2:], kind),
                written(said[:3] + said[4:], kind),
            ]
            made += [written(said, kind, lost) for lost in (1, 4, 5)]
    return made
