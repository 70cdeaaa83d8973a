"""Which act an event of S7comm-plus is (`dissect.protocols.s7plus.events` recognises events by what requests carry)."""

from __future__ import annotations

from typing import Final

from dissect.engine.acts import tables as kinds
from dissect.engine.acts.act import Act, act_of
from dissect.engine.transactions.operation import CONTROL, TEST_JOB
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7plus import event as events
from dissect.protocols.s7plus import loads
from dissect.protocols.s7plus.event import Event
from dissect.wire.text import shortened

_ACTS: Final[dict[str, str]] = {
    events.STOP: kinds.STOP,
    events.START: kinds.START,
    events.RESET: kinds.RESET,
    events.ORDERED: kinds.UNKNOWN,
    loads.LOADED: kinds.DOWNLOAD,
    events.READ_OUT: kinds.UPLOAD,
    events.REMOVED: kinds.DELETE,
    events.PASSWORD: kinds.PASSWORD,
    events.TEST_JOB: kinds.TEST,
    loads.PROTECTED: kinds.PROTECTION,
    loads.FIRMWARE: kinds.FIRMWARE,
}
#: Kinds of operations that differ from the kind of the act.
_COMMANDS: Final[dict[str, str]] = {events.ORDERED: CONTROL, events.TEST_JOB: TEST_JOB}
#: The client's action on the object that the text of an event names.
_VERBS: Final[dict[str, str]] = {loads.LOADED: "load ", events.REMOVED: "delete ", loads.PROTECTED: "write "}
#: Longest text of an event in a finding, in characters.
TEXT: Final = 200


def act_of_event(event: Event, transaction: Transaction, code: int) -> Act | None:
    """Return the act of an event; None if there is none. ``code`` is its error, 0 for none."""
    kind = _ACTS.get(event.kind, "")
    if not kind:
        return None
    act = act_of(kind, transaction, event.text, code)
    act.command = _COMMANDS.get(event.kind, act.row.operation)
    act.text = shortened(f"{_VERBS.get(event.kind, '')}{event.text}", TEXT)
    return act
