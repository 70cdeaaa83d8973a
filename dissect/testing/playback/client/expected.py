"""The session to expect if the server answers as recorded: it is compared with the session that took place.

Left out are requests that were withheld, and facts that the recording does not have: the end of a connection after the
recording, a missing answer. Numbers are those of the recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dissect.engine.transactions.ending import FIN
from dissect.engine.transactions.transaction import CONNECTION_CLOSED
from dissect.testing.golden.model import Link, Session, Transaction
from dissect.testing.playback.client.permissions import NO_ANSWER
from dissect.testing.playback.client.plan import ASK, SERVER_ASKED
from dissect.testing.playback.client.player import PartPlayer


def expected_session(
    name: str, players: Sequence[PartPlayer], came: Session, links: Mapping[int, Link]
) -> tuple[Session, list[tuple[Session, Session]]]:
    """Return the expected session, and each of its connections with the actual one, None if it did not take place.

    ``links`` are the connections of ``came`` by their first packet. Transactions without a recorded counterpart are removed
    from ``came``.
    """
    session = Session(name)
    pairs = []
    for player in sorted(players, key=lambda player: player.part.link.number):
        if player.first_frame:
            other = links.get(player.first_frame)
            link = _expected_link(player, other)
            session.links.append(link)
            pairs.append((_alone(name, link), _alone(came.name, other)))
    return session, pairs


def _alone(name: str, link: Link | None) -> Session:
    """Return a session of one connection, which keeps its numbers."""
    session = Session(name)
    session.links = [link] if link is not None else []
    return session


def _expected_link(player: PartPlayer, came: Link | None) -> Link:
    part, recorded = player.part, player.part.link
    link = Link()
    link.number = recorded.number
    link.protocol = recorded.protocol
    link.carrier = recorded.carrier
    link.calling, link.called = part.calling, part.called
    link.begun = True
    link.tpdu_size_asked = part.tpdu_size
    link.tpdu_size = recorded.tpdu_size if recorded.tpdu_size or recorded.refused or came is None else came.tpdu_size
    link.refused = recorded.refused
    if part.end_known:
        link.ended, link.ended_by, link.farewell = recorded.ended, recorded.ended_by, recorded.farewell
    else:
        link.ended, link.ended_by = FIN, "client"
    if came is not None:
        _leave_out(came, player)
    _take(link, player, came)
    return link


def _leave_out(came: Link, player: PartPlayer) -> None:
    """Remove transactions without a recorded counterpart: our own Setup, and requests of the server in both sessions."""
    if player.setup_reference:
        ours = [each for each in came.transactions if each.asked_by == "client"]
        setup = [each for each in ours if each.pdu_ref == player.setup_reference]
        came.transactions = [each for each in came.transactions if each not in setup]
    if any([one.reason in {SERVER_ASKED, NO_ANSWER} for one in player.withheld]):
        answered = {"unsolicited", "answered"}  # an answered one belongs to a download
        came.transactions = [
            each for each in came.transactions if each.asked_by != "server" or each.outcome in answered
        ]


def _take(link: Link, player: PartPlayer, came: Link | None) -> None:
    ours = [each for each in came.transactions if each.asked_by == "client"] if came is not None else []
    by_reference = {each.pdu_ref: each for each in ours if each.request}
    references = {id(transaction): number for number, transaction in player.sent.items()}
    left = {id(transaction) for transaction in player.not_sent}
    began = False
    for step in player.part.steps:
        transaction = step.transaction
        reference = references.get(id(transaction))
        if step.kind != ASK and began and id(transaction) not in player.unheard:
            link.transactions.append(_copy(transaction, link, transaction))
        elif step.kind == ASK and (reference is not None or id(transaction) in left):
            began = True
            answer = by_reference.get(reference) if reference is not None else None
            source = answer if step.unknown else None
            if answer is not None and reference is not None and answer.reason and source is None:
                # If we gave up, that is why the connection ended.
                answer.reason = player.given_up(reference) or answer.reason
            link.transactions.append(_copy(transaction, link, source or transaction))


def _copy(transaction: Transaction, link: Link, source: Transaction) -> Transaction:
    """Return a copy of a transaction with the answer of ``source``; without an answer it ends with the connection."""
    reason = CONNECTION_CLOSED if source.reason and source.outcome == "unanswered" else source.reason
    copy = Transaction(link, transaction.asked_by, source.exchange, source.outcome, reason)
    copy.number = transaction.number
    copy.time_ns, copy.latency_ns = transaction.time_ns, transaction.latency_ns
    copy.doubt = source.doubt
    return copy
