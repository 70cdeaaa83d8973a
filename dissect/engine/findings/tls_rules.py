"""Findings about TLS: weak versions, certificates (judged at the time of the capture), records that stay encrypted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dissect.engine.findings.reporter import Reporter
from dissect.engine.transactions.connection import Connection
from dissect.protocols.tls.tables import TLS_1_2, WEAK_WORDS

if TYPE_CHECKING:
    from dissect.protocols.tls.certificate import Certificate
    from dissect.protocols.tls.session import TlsSession


def judge_session(reporter: Reporter, connection: Connection, session: TlsSession, frame: int, time_ns: int) -> None:
    """Judge version and cipher suite once the server has chosen them."""
    name = session.suite_name
    if session.version < TLS_1_2 or not WEAK_WORDS.isdisjoint(name.split("_")):
        reporter.note("security.tls_weak", connection.number, [frame], time_ns, f"{session.version_name} with {name}")


def judge_certificates(
    reporter: Reporter, connection: Connection, session: TlsSession, frame: int, time_ns: int
) -> None:
    """Judge the certificates that the two ends have shown; only their own certificates, not those of the issuers."""
    shown = session.shown
    session.shown = []
    for index in shown:
        own = session.directions[index].certificates[0]
        fault = own.validity_fault(time_ns)
        if fault:
            said = f"{_named(own, connection, index)}: {fault}"
            reporter.note("security.certificate_expired", connection.number, [frame], time_ns, said)
        if own.weak:
            said = f"{_named(own, connection, index)}: {', '.join(own.weak)}"
            reporter.note("security.certificate_weak", connection.number, [frame], time_ns, said)


def _named(certificate: Certificate, connection: Connection, index: int) -> str:
    who = f"{connection.role(index)} {connection.tcp.ends[index]}"
    return f"{who}, {certificate.subject}" if certificate.subject else who


def judge_closed(reporter: Reporter, connection: Connection, session: TlsSession, frame: int, time_ns: int) -> None:
    """A connection is over: if keys were given, report why records stay encrypted."""
    why = session.why_closed
    if why:
        detail = f"{session.shut} of {session.shut + session.opened} encrypted records stay closed: {why}"
        reporter.note("session.tls_closed", connection.number, [frame], time_ns, detail)
