"""Messages and alarms as Scapy packets (`dissect.s7.alarms`)."""

from __future__ import annotations

from typing import ClassVar

from scapy.packet import Packet

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import alarm_layouts
from dissect.wire.layout import Field

__all__ = [
    "S7_AlarmAcknowledgement",
    "S7_AlarmHead",
    "S7_AlarmMessage",
    "S7_AlarmObjects",
    "S7_AlarmQueryAnswer",
    "S7_AlarmQueryByEvent",
    "S7_AlarmQueryByType",
    "S7_AlarmQueryOther",
    "S7_AlarmSComing",
    "S7_AlarmSGoing",
    "S7_AlarmState",
    "S7_AlarmSubscription",
    "S7_AlarmToLock",
    "S7_Archive",
    "S7_ArchiveCount",
    "S7_ArchiveData",
    "S7_ArchiveLength",
    "S7_EndOfAlarms",
    "S7_MessageAnswer",
    "S7_MessageRequest",
    "S7_MessageReserved",
    "S7_MessageReservedAnswer",
    "S7_Notification",
    "S7_ScanHead",
]

#: What an alarm counts as its objects.
_OBJECTS = (
    "S7_AlarmToLock",
    "S7_AlarmMessage",
    "S7_AlarmAcknowledgement",
    "S7_Notification",
    "S7_AlarmQueryByType",
    "S7_AlarmQueryByEvent",
    "S7_AlarmQueryOther",
    "S7_ReturnCode",
)


class S7_MessageRequest(S7_Part):
    """Subscription of events: which, and the name of who asks."""

    name = "S7 message service"
    layout = alarm_layouts.MESSAGE_REQUEST
    fields_desc = header_fields(alarm_layouts.MESSAGE_REQUEST)


class S7_MessageAnswer(S7_Part):
    """Answer to a subscription of events."""

    name = "S7 message service"
    layout = alarm_layouts.MESSAGE_ANSWER
    fields_desc = header_fields(alarm_layouts.MESSAGE_ANSWER, {"result": 2})


class S7_AlarmSubscription(S7_Part):
    """Which alarms, in a request with the bit of alarms and in its answer."""

    name = "S7 alarm subscription"
    layout = alarm_layouts.ALARM_SUBSCRIPTION
    fields_desc = header_fields(alarm_layouts.ALARM_SUBSCRIPTION)


class S7_MessageReserved(S7_Part):
    """What ends a subscription of alarms."""

    name = "S7 reserved"
    layout = alarm_layouts.MESSAGE_RESERVED
    fields_desc = header_fields(alarm_layouts.MESSAGE_RESERVED)


class S7_MessageReservedAnswer(S7_Part):
    """What ends the answer to a subscription of alarms."""

    name = "S7 reserved"
    layout = alarm_layouts.MESSAGE_RESERVED_ANSWER
    fields_desc = header_fields(alarm_layouts.MESSAGE_RESERVED_ANSWER, {"reserved_2": 1})


class S7_Archive(S7_Part):
    """An archive of AR_SEND by its AR_ID."""

    name = "S7 archive"
    layout = alarm_layouts.ARCHIVE_ITEM
    fields_desc = header_fields(alarm_layouts.ARCHIVE_ITEM, {"length": 7, "syntax_id": 0, "specification": 0x12})


class S7_ArchiveCount(S7_Part):
    """How many archives follow. ``item_count`` is filled in when left out."""

    name = "S7 archives"
    layout = alarm_layouts.ARCHIVE_COUNT
    counted: ClassVar[dict[str, tuple[str, ...]]] = {"item_count": ("S7_Archive", "S7_ReturnCode")}
    fields_desc = header_fields(alarm_layouts.ARCHIVE_COUNT, {"item_count": None})


class S7_ArchiveLength(S7_Part):
    """Octets of an archive, in the first part; the low octet first, unlike everything else."""

    name = "S7 archive length"
    layout = alarm_layouts.ARCHIVE_LENGTH
    fields_desc = header_fields(alarm_layouts.ARCHIVE_LENGTH)


class S7_ArchiveData(S7_Part):
    """The content of an archive."""

    name = "S7 archive data"
    layout = alarm_layouts.ARCHIVE_DATA
    fields_desc = header_fields(alarm_layouts.ARCHIVE_DATA)


class S7_AlarmHead(S7_Part):
    """Time and objects of an alarm, a notification or an acknowledgement. ``objects`` is filled in when left out."""

    name = "S7 alarm"
    layout = alarm_layouts.ALARM_HEAD
    counted: ClassVar[dict[str, tuple[str, ...]]] = {"objects": _OBJECTS}
    fields_desc = header_fields(alarm_layouts.ALARM_HEAD, {"objects": None})


class S7_ScanHead(S7_Part):
    """Head of a push of SCAN. ``objects`` is filled in when left out."""

    name = "S7 alarm"
    layout = alarm_layouts.SCAN_HEAD
    counted: ClassVar[dict[str, tuple[str, ...]]] = {"objects": _OBJECTS}
    fields_desc = header_fields(alarm_layouts.SCAN_HEAD, {"objects": None})


class S7_AlarmObjects(S7_Part):
    """Number of objects where no time is told.

    Locks, acknowledgements, queries. ``objects`` is filled in when left out.
    """

    name = "S7 message objects"
    layout = alarm_layouts.OBJECTS_HEAD
    counted: ClassVar[dict[str, tuple[str, ...]]] = {"objects": _OBJECTS}
    fields_desc = header_fields(alarm_layouts.OBJECTS_HEAD, {"objects": None})


class S7_AlarmToLock(S7_Part):
    """An alarm to lock or unlock, or locked or unlocked. ``length`` and ``values`` are filled in when left out."""

    name = "S7 alarm to lock or unlock"
    layout = alarm_layouts.SYNTAXES[21]
    fields_desc = header_fields(alarm_layouts.SYNTAXES[21], {"syntax_id": 0x15, "specification": 0x12})


class S7_AlarmMessage(S7_Part):
    """An alarm as a push tells it. ``length`` and ``values`` are filled in when left out."""

    name = "S7 message"
    layout = alarm_layouts.SYNTAXES[22]
    fields_desc = header_fields(alarm_layouts.SYNTAXES[22], {"syntax_id": 0x16, "specification": 0x12})


class S7_AlarmAcknowledgement(S7_Part):
    """An alarm to acknowledge, or acknowledged. ``length`` and ``values`` are filled in when left out."""

    name = "S7 acknowledgement"
    layout = alarm_layouts.SYNTAXES[25]
    fields_desc = header_fields(alarm_layouts.SYNTAXES[25], {"syntax_id": 0x19, "specification": 0x12})


class S7_Notification(S7_Part):
    """A notification, with the signals that came and went. ``length`` and ``values`` are filled in when left out."""

    name = "S7 notification"
    layout = alarm_layouts.SYNTAXES[28]
    fields_desc = header_fields(alarm_layouts.SYNTAXES[28], {"syntax_id": 0x1C, "specification": 0x12})


class S7_AlarmQueryByType(S7_Part):
    """Asks for the pending alarms of a kind. ``length`` is filled in when left out."""

    name = "S7 alarm query"
    layout = alarm_layouts.QUERY_BY_TYPE
    fields_desc = header_fields(
        alarm_layouts.QUERY_BY_TYPE, {"syntax_id": 0x1A, "query_type": 1, "specification": 0x12}
    )


class S7_AlarmQueryByEvent(S7_Part):
    """Asks for one alarm by its number. ``length`` is filled in when left out."""

    name = "S7 alarm query"
    layout = alarm_layouts.QUERY_BY_EVENT
    fields_desc = header_fields(
        alarm_layouts.QUERY_BY_EVENT, {"syntax_id": 0x1A, "query_type": 3, "specification": 0x12}
    )


class S7_AlarmQueryOther(S7_Part):
    """An alarm query of an unknown kind. ``length`` is filled in when left out."""

    name = "S7 alarm query"
    layout = alarm_layouts.QUERY_OTHER
    fields_desc = header_fields(alarm_layouts.QUERY_OTHER, {"syntax_id": 0x1A, "specification": 0x12})


class S7_AlarmQueryAnswer(S7_Part):
    """Head of the pending alarms that a query is answered with. ``complete_length`` is filled in when left out."""

    name = "S7 alarms"
    layout = alarm_layouts.ALARM_QUERY_ANSWER
    fields_desc = header_fields(
        alarm_layouts.ALARM_QUERY_ANSWER,
        {"return_code": 0xFF, "transport_size": 9, "complete_length": None, "objects": 1},
    )

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return the octets of all alarms."""
        return sum(sizes)


class S7_AlarmState(S7_Part):
    """A pending alarm. ALARM_S goes on with the two parts after it, each followed by a data item."""

    name = "S7 pending alarm"
    layout = alarm_layouts.ALARM_STATE
    fields_desc = header_fields(alarm_layouts.ALARM_STATE)


class S7_AlarmSComing(S7_Part):
    """When a pending ALARM_S came; a data item follows."""

    name = "S7 came"
    layout = alarm_layouts.ALARM_S_COMING
    fields_desc = header_fields(alarm_layouts.ALARM_S_COMING)


class S7_AlarmSGoing(S7_Part):
    """When a pending ALARM_S went; a data item follows."""

    name = "S7 went"
    layout = alarm_layouts.ALARM_S_GOING
    fields_desc = header_fields(alarm_layouts.ALARM_S_GOING)


class S7_EndOfAlarms(S7_Part):
    """Ends the pending alarms whose length was not told."""

    name = "S7 end of alarms"
    layout = alarm_layouts.END_OF_ALARMS
    fields_desc = header_fields(alarm_layouts.END_OF_ALARMS)
