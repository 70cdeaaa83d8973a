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


def alarm_of(values: dict[int, Value]) -> PlusObject:
    elements: list[Element] = [Attribute(id_, value) for id_, value in values.items()]
    return PlusObject(0x70100459, 2681, 0, 0, 0, elements)


def test_zero_is_a_number_like_any_other() -> None:
    """Only what was not sent is missing."""
    zero = Value(0, USINT, 0)
    made = Struct(3473, [(3474, zero), (3475, Value(0, TIMESTAMP, 0)), (3646, Value(0, TIMESTAMP, -1))])
    found = alarm_of(dict.fromkeys((2670, 2671, 2672, 4079), zero) | {2673: Value(0, STRUCT, made)})
    assert alarm_text(found) == "alarm 0x0000000000000000, states 0x00, coming"
    alarm = Alarm(found)
    said = alarm.as_dict()
    assert [said[key] for key in ("id", "states", "domain", "type")] == ["0x0000000000000000", 0, 0, 0]
    (one,) = alarm.events
    assert (one.states, one.time, one.acknowledged, one.values) == (0, 0, 0, [])
    assert one.as_dict()["states"] == 0
    (none,) = Alarm(alarm_of({2677: Value(0, STRUCT, Struct(3473, []))})).events
    assert (none.states, none.time, none.acknowledged, none.text) == (-1, 0, 0, "going")
    assert none.as_dict() == {"kind": "going", "states": None, "time": None, "acknowledged": None, "values": []}


def test_numbers_of_an_alarm_are_those_of_its_attributes() -> None:
    found = Alarm(alarm_of({id_: Value(0, USINT, at) for at, id_ in enumerate((2670, 2671, 2672, 4079), 1)}))
    assert (found.id, found.states, found.domain, found.type) == (1, 2, 3, 4)
    said = found.as_dict()
    assert (said["domain"], said["type"]) == (3, 4)
    other = Alarm(alarm_of({}))
    assert (other.id, other.states, other.domain, other.type, other.texts) == (-1, -1, -1, -1, [])
    assert other.as_dict() == {"id": None, "states": None, "domain": None, "type": None, "events": [], "texts": []}


def test_an_alarm_may_come_and_go_and_one_nanosecond_is_a_time() -> None:
    both = alarm_of({2677: event(1), 2673: event(TIME, 1, ())})
    assert alarm_text(both) == (
        f"alarm, coming {CLOCK}, acknowledged 1970-01-01T00:00:00.000000001Z, "
        "going 1970-01-01T00:00:00.000000001Z, associated values 1: 6f 6e 65; 3: 74 77 6f"
    )


def test_a_line_has_three_texts_and_the_data_all() -> None:
    texts = Value(SPARSE_ARRAY, WSTRING, [(at, f"text {at}") for at in range(1, 6)])
    found = alarm_of({2715: texts})
    assert alarm_text(found) == "alarm, 'text 1', 'text 2', 'text 3'"
    assert Alarm(found).texts == [f"text {at}" for at in range(1, 6)]
    listed = alarm_of({2715: Value(0x10, WSTRING, ["one", "", "two"])})
    assert Alarm(listed).texts == ["one", "two"]
    assert Alarm(alarm_of({2715: Value(SPARSE_ARRAY, USINT, [(1, 5)])})).texts == []
