from __future__ import annotations

import pytest

from dissect.s7plus.alarms import alarm_text
from dissect.s7plus.objects import Attribute, Element, PlusObject
from dissect.s7plus.summary import object_text
from dissect.s7plus.value_tables import BLOB, LWORD, SPARSE_ARRAY, STRUCT, TIMESTAMP, USINT, WSTRING
from dissect.s7plus.values import Blob, Struct, Value

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
            f"alarm 0x000000008a7e0001, coming {CLOCK}, 2 associated values",
        ),
        (
            {2670: Value(0, LWORD, 7), 2677: event(TIME, TIME, (b"one",))},
            f"alarm 0x0000000000000007, going {CLOCK}, acknowledged {CLOCK}, 1 associated value",
        ),
        ({2673: event(0, values=())}, "alarm, coming"),
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
