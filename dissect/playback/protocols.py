"""Why a session that holds no S7comm can be neither served nor replayed."""

from __future__ import annotations

from dissect.golden.model import Session
from dissect.iso.upper import S7COMM_PLUS, UPPER_NAMES


def plus_hint(session: Session) -> str:
    """Return the end of the sentence that there is nothing to play, where what is there is S7comm-plus; else nothing."""
    if any([link.protocol == UPPER_NAMES[S7COMM_PLUS] for link in session.links]):
        return ": it speaks S7comm-plus, whose digests cannot be made without the key of the session"
    return ""
