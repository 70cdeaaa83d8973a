"""What a transaction holds of SCD."""

from __future__ import annotations

from copy import copy

from dissect.engine.transactions.open_requests import SCD_KEY, key_of
from dissect.engine.transactions.payloads import SCD, ScdMessage, ScdParameters, is_scd_key
from dissect.engine.transactions.results import mismatch
from dissect.protocols.s7.parameters import Parameters
from dissect.scd.messages import Message
from tests.meaning.bindings import plant


def found(octets: bytes) -> ScdMessage:
    return ScdMessage(plant.codec().parse_message(octets), plant.dictionary(), "обмен", octets)


def parameters(key: int, name: str, octets: bytes) -> ScdParameters:
    made = ScdParameters(key, name, found(octets))
    made.index, made.sub = made.scd.message.index, made.scd.message.sub
    return made


def test_a_message_says_what_it_is() -> None:
    one = found(plant.tell("Режим 1", 8))
    assert (one.subject, [(row.name, row.value, row.text) for row in one.values]) == (
        "read 0x6061:0 Режим 1",
        [("Режим 1", 8, "автомат")],
    )
    assert repr(one) == "ScdMessage('обмен', 'read 0x6061:0 Режим 1')"
    assert (one.frame, one.offset, one.place, one.mapping) == (0, 0, "", None)


def test_parameters_name_their_function() -> None:
    one = parameters(3, "read", plant.ask("Режим 1"))
    assert (one.rosctr, one.function_name, one.subject) == (SCD, "SCD read", "SCD read 0x6061:0 Режим 1")
    assert one.octets == b""


def test_parameters_address_nothing_and_refuse_nothing_until_told() -> None:
    one = ScdParameters(3, "read", found(plant.ask("Режим 1")))
    assert (one.index, one.sub, one.err, one.refused) == (-1, -1, 0, False)


def test_functions_of_scd_equal_no_others() -> None:
    """The row of statistics of the function with the number 0 is none of S7comm, userdata or S7comm-plus."""
    assert is_scd_key(ScdParameters(0, "read", found(b"")).function)
    assert not any(is_scd_key(key) for key in (0xFF, 0xFFFF, 0x10000 | 0xFFFF, 0x3FFFF))


def test_an_answer_about_something_else_does_not_fit() -> None:
    asked = parameters(1, "read", plant.ask("Режим 1"))
    assert not mismatch(asked, parameters(1, "read", plant.tell("Режим 1", 8)))
    assert mismatch(asked, parameters(1, "read", plant.tell("Режим 2", 8)))
    assert mismatch(asked, parameters(2, "write", plant.tell("Режим 1")))


def test_references_have_a_place_of_their_own() -> None:
    assert key_of(SCD, 7) == SCD_KEY | 7
    assert len({key_of(rosctr, 7) for rosctr in (1, 7, SCD)}) == 3


def test_a_message_that_is_none_has_nothing_to_say() -> None:
    one = ScdMessage(Message(), plant.dictionary(), "x", b"")
    assert (one.subject, one.values) == ("message", [])


def test_a_message_is_decoded_once_and_only_when_it_is_needed() -> None:
    asked: list[tuple[bytes, int]] = []
    octets = plant.tell("Режим 1", 8)

    def later(these: bytes, tid: int) -> Message:
        asked.append((these, tid))
        return plant.codec().parse_message(these)

    one = ScdMessage(None, plant.dictionary(), "x", octets, later, 7)
    assert asked == []
    assert one.message is one.message
    assert asked == [(octets, 7)]
    assert one.subject == "read 0x6061:0 Режим 1"


def test_copies_are_equal_and_need_no_decoder() -> None:
    octets = plant.tell("Режим 1", 8)
    one = ScdMessage(None, plant.dictionary(), "x", octets, lambda these, _tid: plant.codec().parse_message(these), 7)
    one.frame, one.offset, one.place, one.side = 9, 3, "DB1", 1
    other = copy(one)
    assert (other.subject, other.octets, other.binding) == (one.subject, octets, "x")
    assert (other.frame, other.offset, other.place, other.side) == (9, 3, "DB1", 1)
    asked = parameters(3, "read", plant.ask("Режим 1"))
    asked.err, asked.refused, asked.settled = -5, True, True
    again = copy(asked)
    assert (again.function, again.function_name, again.index, again.sub) == (
        asked.function,
        "SCD read",
        asked.index,
        asked.sub,
    )
    assert (again.err, again.refused, again.settled, again.scd) == (-5, True, True, asked.scd)


def test_an_answer_about_another_part_of_the_object_does_not_fit() -> None:
    asked, told = (parameters(1, "read", plant.ask("Режим 1")) for _ in range(2))
    assert not mismatch(asked, told)
    told.sub = asked.sub + 1
    assert mismatch(asked, told)
    told.index, told.sub = asked.index + 1, asked.sub
    assert mismatch(asked, told)
    assert mismatch(Parameters(b"\x04", 1), told)
