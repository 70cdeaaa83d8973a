"""Why a session without S7comm can be neither served nor replayed."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.layouts import DIGEST
from dissect.protocols.s7plus.message import parse_plus
from dissect.testing.golden.exchange import PLUS
from dissect.testing.golden.model import Link, Session

#: Why messages with digests are not served.
DIGESTS: Final = "its messages carry digests, which cannot be computed without the session key"


def has_digest(octets: bytes) -> bool:
    """Return whether a PDU of S7comm-plus carries a digest, which cannot be computed without the session's key."""
    if not octets:
        return False
    pdu = parse_plus(octets)
    return bool(pdu.digest_places) or any([part.layout is DIGEST for part in parse_contents(pdu).parts])


def link_has_digests(link: Link) -> bool:
    """Return whether a recorded message on a connection carries a digest."""
    exchanges = [one.exchange for one in link.transactions if one.exchange.kind == PLUS]
    return any([has_digest(one.request) or has_digest(one.response) for one in exchanges])


def plus_hint(session: Session) -> str:
    """Return the end of the sentence that there is nothing to play, if the session is S7comm-plus; otherwise an empty text."""
    links = [link for link in session.links if any([one.exchange.kind == PLUS for one in link.transactions])]
    if not links:
        return ""
    why = DIGESTS if any([link_has_digests(link) for link in links]) else "it carries no digests and can be served"
    return f": it speaks S7comm-plus; {why}"
