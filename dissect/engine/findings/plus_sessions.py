"""Findings about S7comm-plus sessions: whether clients authenticate themselves, use TLS, and keep to their own session."""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.security_rules import SecurityWatch
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import ANSWERED, Transaction
from dissect.packets.tcp.link import within
from dissect.protocols.s7plus.ids import plain_id
from dissect.protocols.s7plus.plain import REQUEST_SIZE, SESSION_AT, data_of
from dissect.protocols.s7plus.session import PANEL, Identity, PlusSession
from dissect.protocols.s7plus.tables import CREATE_OBJECT, DELETE_OBJECT, INIT_SSL, SET_MULTI_VARIABLES, V3
from dissect.wire.octets import u32
from dissect.wire.text import printable

#: Ids up to this one are not sessions: a client without a session sends 288.
_NO_SESSION: Final = 288
#: Maximum number of sessions that are remembered; beyond that the oldest is forgotten.
MAX_GIVEN: Final = 4096
#: The first firmware with secure PG/HMI communication (TIA Portal V17), by the beginning of the order number.
_TLS_SINCE: Final[dict[str, tuple[int, int]]] = {"6ES7 21": (4, 5), "6ES7 51": (2, 9)}
#: Longest number in a firmware version that is accepted, in digits.
_VERSION_DIGITS: Final = 4
_ERROR: Final = 0x8000


class PlusSessions:
    """Judges sessions. One object per analysis: a session must not be used on a connection other than its own."""

    def __init__(self, security: SecurityWatch) -> None:
        self._security = security
        self._given: OrderedDict[tuple[str, int], int] = (
            OrderedDict()
        )  # the number of the connection, by CPU and session
        self._judged: tuple[str, str] = ("", "")  # order number and firmware of the CPU that was checked last
        self._offers_tls = False  # whether that CPU offers TLS

    def take(self, session: PlusSession, transaction: Transaction) -> None:
        """Judge the use of a session; call this before judging the contents of the transaction."""
        octets = transaction.request_octets
        if transaction.function == INIT_SSL:
            session.tls = transaction._outcome == ANSWERED and transaction.error_code < _ERROR
        data, at, end = data_of(octets)
        at += SESSION_AT
        if at + 4 > end:
            return
        number: i64 = u32(data, at)
        if number > _NO_SESSION and number != session.latest:
            if len(session.given) > 0 and number in session.given:
                session.latest = number
            else:
                self._judge_owner(number, transaction)
        if session.challenged and not session.authenticated and not _in_tls(session, transaction.connection):
            self._judge_authentication(session, number, transaction)

    def opened(self, session: PlusSession, number: int, transaction: Transaction) -> None:
        """Take note that a client got the session ``number``, or was refused a session (0)."""
        connection = transaction.connection
        if number:
            if len(self._given) >= MAX_GIVEN:
                del self._given[next(iter(self._given))]
            self._given[server_of(connection), number] = int(connection.number)
        identity = session.identity
        if (
            not _in_tls(session, connection)
            and self._offers(identity)
            and self._security.first_of(transaction, "security.clear_text")
        ):
            text = f"no TLS, though {identity.order_number} {identity.firmware} offers it"
            self._security.tell("security.clear_text", transaction, text)

    def _offers(self, identity: Identity) -> bool:
        """Return whether a CPU offers TLS; in most calls it has the same order number and firmware as in the call before."""
        if identity.firmware != self._judged[1] or identity.order_number != self._judged[0]:
            self._judged = (identity.order_number, identity.firmware)
            self._offers_tls = _offers_tls(identity)
        return self._offers_tls

    def _judge_owner(self, number: i64, transaction: Transaction) -> None:
        """Report a session that was given to a different connection.

        Report nothing if the capture began in the middle of this connection or has a gap, because the connection may have got
        the session there.
        """
        connection = transaction.connection
        if len(self._given) == 0 or _incomplete(connection):
            return
        owner = self._given.get((server_of(connection), int(number)), 0)
        if not owner or owner == int(connection.number):
            return
        if self._security.first_of(transaction, "security.session_reused"):
            text = f"{transaction.function_name} in session {plain_id(number)}, which connection {owner} got"
            self._security.tell("security.session_reused", transaction, text)

    def _judge_authentication(self, session: PlusSession, number: i64, transaction: Transaction) -> None:
        """Report a request that the CPU carried out without authentication; requests that set up or end a session need none."""
        octets = transaction.request_octets
        if transaction.function in {CREATE_OBJECT, DELETE_OBJECT, INIT_SSL} or octets[1] == V3:
            return
        if transaction._outcome != ANSWERED or transaction.error_code >= _ERROR or _incomplete(transaction.connection):
            return
        data, at, end = data_of(octets)
        at += REQUEST_SIZE
        if transaction.function == SET_MULTI_VARIABLES and at + 4 <= end and u32(data, at) == number:
            return  # it writes attributes of the session itself
        if self._security.first_of(transaction, "security.unauthenticated"):
            text = f"{transaction.function_name}, {_ends(session, transaction.connection)}"
            self._security.tell("security.unauthenticated", transaction, text)


def _ends(session: PlusSession, connection: Connection) -> str:
    """Return what the client and the server of a session are, if they state it: ``engineering to panel``."""
    called = connection.tsap_called
    server = session.identity.kind or (PANEL if called is not None and called.of_panel else "")
    if not server:
        server = f"CPU {session.identity.order_number}" if session.identity.order_number else "device of unknown kind"
    return f"{session.client_kind or 'client of unknown kind'} to {printable(server)}"


def _in_tls(session: PlusSession, connection: Connection) -> bool:
    """Return whether the connection uses TLS: the client requested it, or TLS was seen (InitSSL may not have been captured)."""
    return session.tls or connection.tls is not None


def _offers_tls(identity: Identity) -> bool:
    for prefix, since in _TLS_SINCE.items():
        if identity.order_number.startswith(prefix):
            words = identity.firmware.removeprefix("V").split(".")
            version = (_part(words[0]), _part(words[1])) if len(words) >= 2 else (-1, -1)
            return min(version) >= 0 and version >= since
    return False


def _part(digits: str) -> int:
    """Return one number of a firmware version, -1 if the text is not a plausible number."""
    return int(digits) if digits.isascii() and digits.isdecimal() and len(digits) <= _VERSION_DIGITS else -1


def _incomplete(connection: Connection) -> bool:
    return bool(connection.mid_stream or connection.tcp.has_holes)


def server_of(connection: Connection) -> str:
    """Return the address of the CPU of a connection, with its VLAN if it has one."""
    return within(connection.server.host, connection.tcp.vlan)
