"""Diagnostic messages: the example of the reference, whole, cut and with more behind it."""

from __future__ import annotations

from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.bodies import parse_joined
from dissect.protocols.s7.diagnostics import DIAGNOSTIC_EVENT, DIRECTIONS, event_id, event_note
from dissect.protocols.s7.parameters import PUSH, REQUEST
from dissect.protocols.s7.tables import DIAGNOSTIC_MESSAGE
from dissect.wire.malformed import Malformed
from dissect.wire.part import OCTETS, SURPLUS, Part

#: Reference section 8.12, "Push: diagnostic message".
STOP: Final = bytes.fromhex("4304 ff 84 0000 0000 00000000 2311 1422 1530 6213")


def cut(octets: bytes, type_: int = PUSH) -> tuple[list[Part], list[str]]:
    told: list[Malformed] = []
    return parse_joined(4, DIAGNOSTIC_MESSAGE, type_, octets, told), [fact.reason for fact in told]


def test_the_example() -> None:
    (event,), told = cut(STOP)
    assert told == []
    assert event.layout is DIAGNOSTIC_EVENT
    assert event.note == "0x4304 STOP by a PG or by SFB 20, DT#2023-11-14-22:15:30.621"
    assert event_id(event) == 0x4304
    assert event.text("event_class") == "mode transition"
    assert event.text("coming") == "coming"
    assert [event.number(name) for name in ("external_error", "internal_error", "in_buffer", "coming")] == [0, 0, 1, 1]
    assert [event.number(name) for name in ("event_number", "priority_class", "ob")] == [4, 255, 132]


def test_directions() -> None:
    """One digit: the field is a bit."""
    assert [DIRECTIONS.name(number) for number in range(3)] == ["going", "coming", "0x2"]


@pytest.mark.parametrize("number", [0x0000, 0x1381, 0x39C4, 0x8F54, 0xFFFF])
def test_the_bits_make_the_event_id(number: int) -> None:
    (event,), _ = cut(number.to_bytes(2, "big") + STOP[2:])
    assert event_id(event) == number
    assert event.note.startswith(f"0x{number:04x} ")


def test_no_time() -> None:
    (event,), _ = cut(STOP[:12] + b"\xff" * 8)
    assert event.note == "0x4304 STOP by a PG or by SFB 20"


@pytest.mark.parametrize("size", range(1, len(STOP)))
def test_cut(size: int) -> None:
    (event,), told = cut(STOP[:size])
    assert told == ["too_short"]
    assert event.end == size
    assert event_id(event) == (0x4304 if size >= 2 else -1)
    assert (event_note(event) == "") == (size < 2)


def test_more_behind() -> None:
    parts, told = cut(STOP + b"\0")
    assert [part.layout for part in parts] == [DIAGNOSTIC_EVENT, SURPLUS]
    assert told == ["trailing_octets"]


def test_nobody_asks_for_one() -> None:
    parts, told = cut(STOP, REQUEST)
    assert [part.layout for part in parts] == [OCTETS]
    assert told == []


@given(st.binary(max_size=64), st.integers(0, 3))
def test_never_raises(octets: bytes, type_: int) -> None:
    parts, _ = cut(octets, type_)
    assert b"".join(octets[part.offset : part.end] for part in parts) == octets
