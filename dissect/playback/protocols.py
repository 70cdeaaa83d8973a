"""Why a session that holds no S7comm can be neither served nor replayed."""

from __future__ import annotations

from typing import Final

from dissect.golden.exchange import PLUS
from dissect.golden.model import Link, Session
from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.layouts import DIGEST
from dissect.s7plus.message import parse_plus

#: Why messages with digests are not served.
DIGESTS: Final = "its messages carry digests, which cannot be made without the key of the session"


def has_digest(octets: bytes) -> bool:
    """Tell whether a PDU of S7comm-plus carries a digest, which nobody can make without the key of the session."""
    if not octets:
        return False
    pdu = parse_plus(octets)
    return bool(pdu.digest_places) or any([part.layout is DIGEST for part in parse_contents(pdu).parts])


def link_has_digests(link: Link) -> bool:
    """Tell whether a message on a connection carries a digest, as the recording shows it."""
    exchanges = [one.exchange for one in link.transactions if one.exchange.kind == PLUS]
    return any([has_digest(one.request) or has_digest(one.response) for one in exchanges])


def plus_hint(session: Session) -> str:
    """Return the end of the sentence that there is nothing to play, where what is there is S7comm-plus; else nothing."""
    links = [link for link in session.links if any([one.exchange.kind == PLUS for one in link.transactions])]
    if not links:
        return ""
    why = DIGESTS if any([link_has_digests(link) for link in links]) else "it carries no digests and can be served"
    return f": it speaks S7comm-plus; {why}"
