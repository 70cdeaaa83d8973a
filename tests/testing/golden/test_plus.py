"""S7comm-plus in goldens: what one recording has of its own is left out, and differences are told in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB, DINT, INT, UDINT, USINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Value, build_value
from dissect.testing.golden import diff_sessions, golden_text, parse_golden, read_session
from dissect.testing.golden.masking import mask_plus
from tests.meaning.report.support import begun
from tests.properties.messages import dt
from tests.properties.packets import Flow, Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.testing.golden import support

LEVEL = VariableAddress(0, 82, 3736, [3, 100, 2])
SPEED = VariableAddress(0, 82, 3736, [3, 102, 2])
HMI = "HMI RT \x1b[2J"


def session(
    value: int = 5, wanted: tuple[VariableAddress, ...] = (LEVEL, SPEED), first: int = 1, ids: int = 100
) -> Talk:
    """A client that says who it is, reads two variables and writes one; the numbers begin where a recording began them."""
    talk = begun()
    one = PlusObject(211, 287, 0, 0, 0, [Attribute(297, Value(0, WSTRING, HMI)), Attribute(299, Value(0, UDINT, 2))])
    send(talk, 0, asked(first, CREATE_OBJECT, 288, 0x36, bodies.create_object(285, Value(0, UDINT, 0), one)), 1)
    send(talk, 1, told(first, CREATE_OBJECT, b"\0\1" + bodies.number(0x386) + bodies.FILL), 1)
    number = first + 1
    send(talk, 0, asked(number, GET_MULTI_VARIABLES, body=bodies.get_multi(*wanted, integrity_id=ids)), 3)
    answer = bodies.multi_got([(1, Value(0, INT, value)), (2, Value(0, DINT, 70000))], [], ids + number)
    send(talk, 1, told(number, GET_MULTI_VARIABLES, answer), 3)
    number += 1
    body = bodies.set_multi([(SPEED, Value(0, INT, value + 1))], ids + 1)
    send(talk, 0, asked(number, SET_MULTI_VARIABLES, body=body), 3)
    send(talk, 1, told(number, SET_MULTI_VARIABLES, b"\0\0" + bodies.end(ids + 1 + number)), 3)
    return talk.close()


def send(talk: Talk, side: int, data: bytes, version: int) -> None:
    talk.send(side, dt(framed(data, version)))


def text_of(talk: Talk) -> str:
    return golden_text(support.session(talk.packets()))


def differences(one: Talk, other: Talk) -> list[str]:
    return support.told(parse_golden(text_of(one)), parse_golden(text_of(other)))


def test_remarks_say_what_the_octets_mean() -> None:
    text = text_of(session())
    for remark in ("# M" + "W100", "# 1: Int 5", "# MW102 = Int 6", "# ClassServerSession"):
        assert remark in text
    assert "\x1b" not in text
    assert parse_golden(text).links[0].transactions[2].exchange.function_name == "S7comm-plus GetMultiVariables"


def test_what_counts_from_one_recording_to_the_next_makes_no_difference() -> None:
    assert differences(session(first=1, ids=100), session(first=40, ids=101)) == []


def test_a_value_that_differs_is_told_with_both() -> None:
    assert differences(session(5), session(7)) == [
        "transaction 3, S7comm-plus GetMultiVariables MW100, MW102: answer: was item 1: Int 5, is item 1: Int 7",
        "transaction 4, S7comm-plus SetMultiVariables MW102 = Int 6: request: was item 1: Int 6, is item 1: Int 8",
    ]


def test_another_variable_is_told_by_its_address() -> None:
    said = differences(session(), session(wanted=(LEVEL, VariableAddress(0, 82, 3736, [3, 104, 2]))))
    assert any("MW102" in text and "MW104" in text for text in said), said


def test_a_long_list_shows_where_it_begins_to_differ() -> None:
    """The lists of two subscriptions are the same up to a variable that no short form of them shows."""

    def listed(last: int) -> Talk:
        talk = begun()
        value = Value(0x10, UDINT, [*range(60), last])
        send(talk, 0, asked(1, SET_VARIABLE, body=bodies.set_variable(0x386, [1048], value)), 3)
        send(talk, 1, told(1, SET_VARIABLE, b"\0\0" + bodies.end(10)), 3)
        return talk.close()

    (said,) = differences(listed(61), listed(62))
    was, is_ = said.split("was ")[1].split(", is ")
    assert was != is_
    assert ("3d at byte" in was, "3e at byte" in is_) == (True, True), said


def test_a_connection_without_tsaps_is_called_as_people_call_its_protocol() -> None:
    """Its beginning was not captured."""
    late = Talk(Flow(ports=(50001, 102)))
    for number in (7, 8, 9):
        send(late, 0, asked(number, GET_MULTI_VARIABLES, body=bodies.get_multi(LEVEL)), 3)
    one = session()
    both = support.session(one.packets() + late.packets())
    said = support.told(both, support.session(one.packets()))
    assert any("is missing: S7comm-plus, 3 transactions" in text for text in said), said


def test_secrets_that_are_read_back_are_not_kept() -> None:
    secret = Value(0x10, USINT, [7, 8, 9, 10])
    one = begun()
    for number, id_ in ((1, 304), (2, 305)):
        send(one, 0, asked(number, GET_VAR_SUBSTREAMED, body=bodies.get_stream(0x386, [id_]) + bodies.end(3)), 3)
        send(one, 1, told(number, GET_VAR_SUBSTREAMED, b"\0\0" + build_value(secret) + bodies.end(3)), 3)
    text = text_of(one.close())
    assert text.count("# not shown") == 1
    assert text.count("04 07 08 09 0a") == 1  # of the attribute that is none
    assert golden_text(parse_golden(text)) == text


def test_secrets_are_not_kept() -> None:
    body = bodies.set_variable(0x386, [304], Value(0x10, USINT, [7, 8, 9, 10]))
    octets = framed(asked(1, SET_VARIABLE, body=body), 3)
    assert b"\x07\x08\x09\x0a" in octets
    assert b"\x07\x08\x09\x0a" not in mask_plus(octets)
    blob = framed(asked(1, SET_VARIABLE, body=bodies.set_variable(0x386, [9999], Value(0, BLOB, Blob(0, b"kept")))), 3)
    assert b"kept" in mask_plus(blob)


@pytest.mark.parametrize("name", ["TEST.pcapng", "S7-1511_db2_var1_HMI.pcap", "S7-1200-Uploading-OB1-TIAV12.pcap"])
def test_shared_captures_are_as_their_goldens(corpus: Path, name: str) -> None:
    made = read_session(corpus / "s7plus" / name)
    again = parse_golden(golden_text(made))
    assert golden_text(again) == golden_text(made)
    assert diff_sessions(again, made) == []


WATCHED = [(7, LEVEL), (8, SPEED)]


def subscribed(
    session_id: int,
    subscription: int,
    values: dict[int, int | None],
    watched: list[tuple[int, VariableAddress]] = WATCHED,
) -> Talk:
    """A client gets a session, subscribes to variables, is told some of them (None: refused), and ends all of it."""
    talk = begun()
    one = PlusObject(211, 287, 0, 0, 0, [Attribute(297, Value(0, WSTRING, HMI))])
    send(talk, 0, asked(1, CREATE_OBJECT, 288, 0x36, bodies.create_object(285, Value(0, UDINT, 0), one)), 1)
    send(talk, 1, told(1, CREATE_OBJECT, b"\0\1" + bodies.number(session_id) + bodies.FILL), 1)
    numbers = [0x80010000, 0, len(watched)]
    for reference, address in watched:
        count = 0x80040000 | (1 + len(address.lids))
        numbers += [count, reference, 0, address.area, address.crc, address.sub_area, *address.lids]
    watches = PlusObject(0x7FFFC001, 1001, 0, 0, 0, [Attribute(1048, Value(0x20, UDINT, numbers))])
    body = bodies.create_object(session_id, Value(0, UDINT, 0), watches, integrity_id=5)
    send(talk, 0, asked(2, CREATE_OBJECT, session_id, body=body), 3)
    send(talk, 1, told(2, CREATE_OBJECT, b"\0\1" + bodies.number(subscription) + bodies.end(7)), 3)
    items = b""
    for reference, value in values.items():
        kind = b"\x13" if value is None else b"\x92"
        items += kind + bodies.rid(reference) + (b"" if value is None else build_value(Value(0, INT, value)))
    send(talk, 1, b"\x33" + bodies.rid(subscription) + b"\4\0\0\0\0\0\1\1\1" + items + b"\0" + bytes(4), 3)
    send(talk, 0, asked(3, DELETE_OBJECT, session_id, body=bodies.delete_object(subscription)), 3)
    send(talk, 1, told(3, DELETE_OBJECT, b"\0" + bodies.rid(subscription) + bodies.end(12)), 3)
    return talk.close()


def test_ids_that_a_device_gives_anew_make_no_difference() -> None:
    one = subscribed(0x386, 0x70000E51, {7: 5, 8: 6})
    assert differences(one, subscribed(0x3F1, 0x70000F77, {7: 5, 8: 6})) == []
    # Of another size it is another device, and stays one that is told.
    assert any("object id" in text for text in differences(one, subscribed(0x70000001, 0x70000F77, {7: 5, 8: 6})))


def test_another_object_is_still_told() -> None:
    """The subscription that is deleted is not the one that was made."""

    def deleted(object_id: int) -> Talk:
        talk = begun()
        send(talk, 0, asked(3, DELETE_OBJECT, 0x386, body=bodies.delete_object(object_id)), 3)
        send(talk, 1, told(3, DELETE_OBJECT, b"\0" + bodies.rid(object_id) + bodies.end(12)), 3)
        return talk.close()

    (said, *_) = differences(deleted(0x70000E51), deleted(0x70000E52))
    assert ("0x70000e51" in said, "0x70000e52" in said) == (True, True), said


def test_items_of_notifications_are_told_by_the_names_of_their_subscription() -> None:
    """Whatever numbers the clients gave to them."""
    one = subscribed(0x386, 0x70000E51, {7: 5, 8: 6})
    other = subscribed(0x3F1, 0x70000F77, {7: 4, 8: None})
    about = "transaction 4, S7comm-plus Notification: answer: was "
    assert differences(one, other) == [
        about + "MW100 = Int 5, is MW100 = Int 4",
        about + "MW102 = Int 6, is MW102 refused",
    ]
    (missing,) = differences(one, subscribed(0x3F1, 0x70000F77, {7: 5}))
    assert missing == about + "MW102 = Int 6, is without MW102"
    swapped = differences(one, subscribed(0x386, 0x70000E51, {7: 6, 8: 5}, [(8, LEVEL), (7, SPEED)]))
    assert not any("Notification" in text for text in swapped), swapped


def test_items_without_their_subscription_are_told_by_their_reference() -> None:
    def notified(value: int) -> Talk:
        talk = begun()
        item = b"\x92" + bodies.rid(7) + build_value(Value(0, INT, value))
        send(talk, 1, b"\x33" + bodies.rid(0x70000E51) + b"\4\0\0\0\0\0\1\1\1" + item + b"\0" + bytes(4), 3)
        return talk.close()

    assert differences(notified(5), notified(9)) == [
        "transaction 2, S7comm-plus Notification: answer: was item 7 = Int 5, is item 7 = Int 9"
    ]


def test_objects_of_notifications_are_compared_one_by_one() -> None:
    def notified(*names: str) -> Talk:
        talk = begun()
        objects = [PlusObject(7, 8, 0, 0, 0, [Attribute(233, Value(0, WSTRING, name))]) for name in names]
        item = b"\x81" + b"".join([build_object(one) for one in objects])
        send(talk, 1, b"\x33" + bodies.rid(0x70000E51) + b"\4\0\0\0\0\0\1\1\1" + item + b"\0" + bytes(4), 3)
        return talk.close()

    one = notified("pump", "tank")
    assert differences(one, one) == []
    (said,) = differences(one, notified("pump", "valve"))
    assert ("'pump'" in said, "was object 2 = " in said, "'tank', is object 2 = " in said, "'valve'" in said) == (
        False, True, True, True
    )  # fmt: skip
    (said,) = differences(one, notified("pump"))
    assert said.endswith("'tank', is without object 2")


def test_a_shared_capture_differs_by_what_the_plant_did(corpus: Path) -> None:
    """Two recordings of the same panel: in the second a variable has a different symbol, and is refused."""
    folder = corpus / "s7plus"
    name = "V13_1200_TP1200sim_MW100_Int_SPS_5s_MW102_Int_SPS_10s_MW102_ab_1000_Timer_sync"
    said = support.told(read_session(folder / f"{name}.pcapng"), read_session(folder / f"{name}_FehlerbeiMW100.pcapng"))
    changes = [text for text in said if ": request: " in text]
    assert len(changes) == 1
    assert "SubscriptionReferenceList" in changes[0]
    assert any("is M LID 9 [CRC 0x446d2a0b] refused" in text for text in said)
    assert not any("object id" in text for text in said)
