"""The meaning of S7comm-plus contents: the kinds of events, `Event`, and the `Facts` of a request and its response."""

from __future__ import annotations

from typing import Final

from mypy_extensions import mypyc_attr

from dissect.wire.malformed import Malformed

# Kinds of events.
STOP: Final = "stop"
START: Final = "start"
RESET: Final = "reset"
ORDERED: Final = "unknown state request"
STOPPED: Final = "stopped"
RUNNING: Final = "running"
REMOVED: Final = "delete"
CONFIRMED: Final = "consistent"
SEQUENCE_BEGUN: Final = "sequence begun"
SEQUENCE_ENDED: Final = "sequence ended"
READ_OUT: Final = "program read"
WRITTEN: Final = "write"
WRITTEN_OUTPUTS: Final = "write outputs"
PASSWORD: Final = "password"  # noqa: S105 - the name of a kind, no secret
TEST_JOB: Final = "test job"
STREAMED: Final = "stream"
REPLAYED: Final = "replay"
SESSION: Final = "session"
SUBSCRIBED: Final = "subscription"
SUBSCRIBED_ALARMS: Final = "alarm subscription"
LISTED: Final = "subscription list"
DELETED: Final = "deleted object"


@mypyc_attr(acyclic=True)
class Event:
    """The object of the event, as text.

    ``refusal`` is the error of its own item in a write of several (lower 16 bits of the return value): 0 if the item was
    written, -1 if only the return value of the whole response counts. Text from the wire is not escaped.
    """

    __slots__ = ("_text", "kind", "object_id", "refusal")

    def __init__(self, kind: str, text: str, object_id: int = 0) -> None:
        self.kind = kind
        self._text = text
        self.object_id = object_id
        self.refusal = -1

    @property
    def text(self) -> str:
        """What the event is about."""
        return self._text


@mypyc_attr(acyclic=True, free_list_len=1)
class Facts:
    """The result of `take`: events, and faults of the contents, with offsets from the beginning of the PDU.

    ``exhausted``: a PDU needs more work than `MAX_WORK`, so its content is unknown. The first ``in_request`` faults in
    ``malformed`` are in the request; the others are in its response, or in a notification.
    """

    __slots__ = ("events", "exhausted", "in_request", "malformed")

    def __init__(self) -> None:
        self.exhausted = False
        self.in_request = 0
        self.events: list[Event] = []
        self.malformed: list[Malformed] = []
