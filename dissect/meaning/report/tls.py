"""The TLS of a connection in reports: as text, and as values for JSON (docs/tls.md). Keys are never shown."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from dissect.meaning.report import words
from dissect.wire.text import Clock

if TYPE_CHECKING:
    from dissect.engine.transactions.connection import Connection
    from dissect.protocols.tls.certificate import Certificate
    from dissect.protocols.tls.direction import Direction
    from dissect.protocols.tls.session import TlsSession

_ROLES = ("client", "server")


def _directions(connection: Connection, session: TlsSession) -> Iterator[tuple[str, Direction]]:
    """Yield both directions with their roles. The client sent the ClientHello or, without one, opened the connection."""
    client = session.client if session.client >= 0 else int(connection.client_side)
    yield _ROLES[0], session.directions[client]
    yield _ROLES[1], session.directions[1 - client]


# ---- words ----------------------------------------------------------------------------------------------------------


def tls_lines(connection: Connection) -> Iterator[str]:
    """Yield lines on the TLS of a connection; nothing if it has none."""
    session = connection.tls
    if session is None:
        return
    said = [text for text in (session.version_name or "TLS", session.suite_name) if text]
    if session.server_name:
        said.append(f"server name {session.server_name}")
    sealed = session.opened + session.shut
    if session.opened:
        said.append(f"{session.opened} of {words.count(sealed, 'encrypted record')} decrypted")
    yield ", ".join(said)
    if session.why_closed:
        yield f"not decrypted: {session.why_closed}"
    passed = [f"{role} {_passed(direction)}" for role, direction in _directions(connection, session)]
    yield "; ".join(passed)
    for role, direction in _directions(connection, session):
        if direction.certificates:
            yield f"certificate of the {role}: {_certificate(direction.certificates[0])}"


def _passed(direction: Direction) -> str:
    said = f"{words.count(direction.records, 'TLS record')}, {words.size(direction.octets)}"
    if direction.last_ns > direction.first_ns:
        said += f" in {words.duration(direction.last_ns - direction.first_ns)}"
    return f"{said}, alert: {direction.alert}" if direction.alert else said


def _certificate(certificate: Certificate) -> str:
    if certificate.unread and not certificate.subject:
        return certificate.unread
    issuer = "self-signed" if certificate.self_signed else f"issued by {certificate.issuer or 'an unknown issuer'}"
    said = [certificate.subject or "without a name", issuer]
    begins, ends = certificate.not_before_ns, certificate.not_after_ns
    if begins is not None and ends is not None:
        said.append(f"valid {Clock().iso(begins)[:10]} to {Clock().iso(ends)[:10]}")
    return ", ".join([*said, *[text for text in (certificate.key, certificate.signature) if text]])


# ---- JSON -----------------------------------------------------------------------------------------------------------


def tls_as_dict(connection: Connection) -> dict[str, object] | None:
    """Return the ``tls`` of a connection for JSON, None when it has none."""
    session = connection.tls
    if session is None:
        return None
    return {
        "version": session.version_name or None,
        "cipher_suite": session.suite_name or None,
        "server_name": session.server_name or None,
        "records_opened": session.opened,
        "records_closed": session.shut,
        "closed_because": session.why_closed or None,
        "malformed": session.malformed,
        **{role: _direction(direction) for role, direction in _directions(connection, session)},
    }


def _direction(direction: Direction) -> dict[str, object]:
    clock = Clock()
    duration = direction.last_ns - direction.first_ns
    return {
        "records": direction.records,
        "octets": direction.octets,
        "octets_skipped": int(direction.reader.skipped),
        "first_time": clock.iso(direction.first_ns) if direction.records else None,
        "last_time": clock.iso(direction.last_ns) if direction.records else None,
        "octets_per_second": round(direction.octets * 1_000_000_000 / duration, 3) if duration > 0 else None,
        "alert": direction.alert or None,
        "certificates": [_as_dict(certificate) for certificate in direction.certificates],
    }


def _as_dict(certificate: Certificate) -> dict[str, object]:
    return {
        "subject": certificate.subject or None,
        "issuer": certificate.issuer or None,
        "not_before": _time(certificate.not_before_ns),
        "not_after": _time(certificate.not_after_ns),
        "self_signed": certificate.self_signed,
        "key": certificate.key or None,
        "signature": certificate.signature or None,
        "weak": certificate.weak,
        "sha256": certificate.sha256,
        "unread": certificate.unread or None,
    }


def _time(time_ns: int | None) -> str | None:
    return Clock().iso(time_ns) if time_ns is not None else None
