"""Alarms, as notifications carry them: objects of class 2681 (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.s7plus.objects import PlusObject
from dissect.s7plus.value_showing import iso_time
from dissect.s7plus.values import Blob, Struct

#: Class of an alarm.
ALARM: Final = 2681
_CPU_ALARM_ID: Final = 2670
_COMING: Final = 2673
_GOING: Final = 2677
_TEXTS: Final = 2715
_TIME: Final = 3475
_VALUES: Final = 3476
_ACKNOWLEDGED: Final = 3646
#: Texts of an alarm that are shown.
_SHOWN: Final = 3


def alarm_text(alarm: PlusObject) -> str:
    """Return an alarm in few words: its id, whether it comes or goes and when (clock of the CPU), its texts.

    Text from the wire is not escaped.
    """
    number = alarm.number(_CPU_ALARM_ID)
    said = [f"alarm 0x{number:016x}" if number >= 0 else "alarm"]
    for id_, word in ((_COMING, "coming"), (_GOING, "going")):
        value = alarm.find(id_)
        event = value.content if value is not None else None
        if isinstance(event, Struct):
            said.append(_event(event, word))
    return ", ".join(said + _texts(alarm))


def _event(event: Struct, word: str) -> str:
    time = _number(event, _TIME)
    acknowledged = _number(event, _ACKNOWLEDGED)
    value = event.find(_VALUES)
    content = value.content if value is not None else None
    held = [one for one in content if isinstance(one, Blob) and one.octets] if isinstance(content, list) else []
    text = f"{word} {iso_time(time)}" if time > 0 else word
    if acknowledged > 0:
        text += f", acknowledged {iso_time(acknowledged)}"
    return f"{text}, {len(held)} associated value{'s' * (len(held) != 1)}" if held else text


def _number(event: Struct, id_: int) -> int:
    value = event.find(id_)
    return value.content if value is not None and isinstance(value.content, int) else -1


def _texts(alarm: PlusObject) -> list[str]:
    """Return the texts that come with an alarm, where the subscription asked for them."""
    value = alarm.find(_TEXTS)
    content = value.content if value is not None else None
    found: list[str] = []
    for one in content if isinstance(content, list) else []:
        text = one[1] if isinstance(one, tuple) else one
        if isinstance(text, str) and text:
            found.append(repr(text))
    return found[:_SHOWN]
