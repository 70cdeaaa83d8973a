from __future__ import annotations

import pytest

from dissect.protocols.s7plus.alarms import Alarm, alarm_text
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject
from dissect.protocols.s7plus.summary import object_text
from dissect.protocols.s7plus.value_tables import BLOB, LWORD, SPARSE_ARRAY, STRUCT, TIMESTAMP, USINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Struct, Value

TIME = 1646059034529997000
CLOCK = "2022-02-28T14:37:14.529997000Z"


def event(time: int, acknowledged: int = 0, values: tuple[bytes, ...] = (b"one", b"", b"two")) -> Value:
    blobs = [Blob(0, octets) for octets in values]
    members = [
        (3474, Value(0, USINT, 135)),
        (3475, Value(0, TIMESTAMP, time)),
        (3476, Value(0x10, BLOB, list(blobs))),
        (3646, Value(0, TIMESTAMP, acknowledged)),
    ]
    return Value(0, STRUCT, Struct(3473, members))


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (
            {2670: Value(0, LWORD, 0x8A7E0001), 2673: event(TIME)},
            f"alarm 0x000000008a7e0001, coming {CLOCK}, associated values 1: 6f 6e 65; 3: 74 77 6f",
        ),
        (
            {2670: Value(0, LWORD, 7), 2677: event(TIME, TIME, (b"one",))},
            f"alarm 0x0000000000000007, going {CLOCK}, acknowledged {CLOCK}, associated values 1: 6f 6e 65",
        ),
        ({2673: event(0, values=())}, "alarm, coming"),
        (
            {2671: Value(0, USINT, 135), 2673: event(0, values=(b"1", b"2", b"3", b"4", b"5"))},
            "alarm, states 0x87, coming, associated values 1: 31; 2: 32; 3: 33 and 2 more",
        ),
        (
            {2670: Value(0, LWORD, 7), 2715: Value(SPARSE_ARRAY, WSTRING, [(1, "pump"), (2, ""), (3, "hot")])},
            "alarm 0x0000000000000007, 'pump', 'hot'",
        ),
        ({2670: Value(0, WSTRING, "no number"), 2673: Value(0, USINT, 5), 2715: Value(0, USINT, 5)}, "alarm"),
    ],
)
def test_an_alarm(values: dict[int, Value], text: str) -> None:
    elements: list[Element] = [Attribute(id_, value) for id_, value in values.items()]
    alarm = PlusObject(0x70100459, 2681, 0, 0, 0, elements)
    assert alarm_text(alarm) == object_text(alarm) == text


def test_an_alarm_as_data() -> None:
    texts = Value(SPARSE_ARRAY, WSTRING, [(1, "pump\x1b")])
    values = {2670: Value(0, LWORD, 7), 2671: Value(0, USINT, 135), 2673: event(TIME, 0, (b"one", b"")), 2715: texts}
    elements: list[Element] = [Attribute(id_, value) for id_, value in values.items()]
    assert Alarm(PlusObject(0x70100459, 2681, 0, 0, 0, elements)).as_dict() == {
        "id": "0x0000000000000007",
        "states": 135,
        "domain": None,
        "type": None,
        "events": [{"kind": "coming", "states": 135, "time": CLOCK, "acknowledged": None, "values": ["6f6e65", ""]}],
        "texts": ["pump\x1b"],
    }
    assert Alarm(PlusObject(1, 2681, 0, 0, 0, [])).as_dict()["events"] == []
