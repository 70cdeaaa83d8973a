"""Alarms in notifications: objects of class 2681 (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.value_showing import iso_time, octets_text
from dissect.protocols.s7plus.values import Blob, Struct
from dissect.wire.text import some

#: Class of an alarm.
ALARM: Final = 2681
_CPU_ALARM_ID: Final = 2670
_STATES: Final = 2671
_DOMAIN: Final = 2672
_TYPE: Final = 4079
_COMING: Final = 2673
_GOING: Final = 2677
_TEXTS: Final = 2715
_EVENT_STATES: Final = 3474
_TIME: Final = 3475
_VALUES: Final = 3476
_ACKNOWLEDGED: Final = 3646
#: The attributes that form an alarm.
ATTRIBUTES: Final = frozenset((_CPU_ALARM_ID, _STATES, _DOMAIN, _TYPE, _COMING, _GOING, _TEXTS))
#: How many texts and associated values of an alarm a line shows.
_SHOWN: Final = 3


class AlarmEvent:
    """An alarm that comes or goes: its states as sent, times in ns since 1970 (0 for none), associated values.

    ``values`` are the associated values in order; a value without content is empty.
    """

    __slots__ = ("acknowledged", "kind", "states", "time", "values")

    def __init__(self, kind: str, struct: Struct) -> None:
        self.kind = kind
        self.states = _number(struct, _EVENT_STATES)
        self.time = max(0, _number(struct, _TIME))
        self.acknowledged = max(0, _number(struct, _ACKNOWLEDGED))
        value = struct.find(_VALUES)
        content = value.content if value is not None else None
        self.values = (
            [one.octets if isinstance(one, Blob) else b"" for one in content] if isinstance(content, list) else []
        )

    @property
    def text(self) -> str:
        """The event as a short text."""
        text = f"{self.kind} {iso_time(self.time)}" if self.time else self.kind
        if self.acknowledged:
            text += f", acknowledged {iso_time(self.acknowledged)}"
        held = [f"{at}: {octets_text(octets)}" for at, octets in enumerate(self.values, 1) if octets]
        return f"{text}, associated values {some(held, _SHOWN, '; ')}" if held else text

    def as_dict(self) -> dict[str, object]:
        """Return the event as JSON-ready data."""
        return {
            "kind": self.kind,
            "states": self.states if self.states >= 0 else None,
            "time": iso_time(self.time) if self.time else None,
            "acknowledged": iso_time(self.acknowledged) if self.acknowledged else None,
            "values": [octets.hex() for octets in self.values],
        }


class Alarm:
    """An alarm. Numbers that were not sent are -1; texts come from the wire and are not escaped."""

    __slots__ = ("domain", "events", "id", "states", "texts", "type")

    def __init__(self, found: PlusObject) -> None:
        self.id = found.number(_CPU_ALARM_ID)
        self.states = found.number(_STATES)
        self.domain = found.number(_DOMAIN)
        self.type = found.number(_TYPE)
        self.events: list[AlarmEvent] = []
        for id_, kind in ((_COMING, "coming"), (_GOING, "going")):
            value = found.find(id_)
            content = value.content if value is not None else None
            if isinstance(content, Struct):
                self.events.append(AlarmEvent(kind, content))
        self.texts = _texts(found)

    def as_dict(self) -> dict[str, object]:
        """Return the alarm as JSON-ready data, with the texts as sent."""
        return {
            "id": f"0x{self.id:016x}" if self.id >= 0 else None,
            "states": self.states if self.states >= 0 else None,
            "domain": self.domain if self.domain >= 0 else None,
            "type": self.type if self.type >= 0 else None,
            "events": [event.as_dict() for event in self.events],
            "texts": self.texts,
        }


def alarm_text(found: PlusObject) -> str:
    """Return an alarm as a short text: id and states, whether and when (CPU time) it comes or goes, its texts.

    Text from the wire is not escaped.
    """
    alarm = Alarm(found)
    said = [f"alarm 0x{alarm.id:016x}" if alarm.id >= 0 else "alarm"]
    if alarm.states >= 0:
        said.append(f"states 0x{alarm.states:02x}")
    said += [event.text for event in alarm.events]
    return ", ".join(said + [repr(text) for text in alarm.texts[:_SHOWN]])


def _number(event: Struct, id_: int) -> int:
    value = event.find(id_)
    return value.content if value is not None and isinstance(value.content, int) else -1


def _texts(alarm: PlusObject) -> list[str]:
    """Return the texts of an alarm, if the subscription requested them."""
    value = alarm.find(_TEXTS)
    content = value.content if value is not None else None
    found: list[str] = []
    for one in content if isinstance(content, list) else []:
        text = one[1] if isinstance(one, tuple) else one
        if isinstance(text, str) and text:
            found.append(text)
    return found
