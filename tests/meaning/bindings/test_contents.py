"""What octets at a bound place are; nothing that is received raises."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect import scd
from dissect.meaning.bindings.binding import Binding, CarrierName
from dissect.meaning.bindings.bindings_file import find_content
from dissect.meaning.bindings.contents import MAX_MESSAGES, decode
from dissect.scd.envelope import PROTOCOL

OD: Final = scd.compile(Path(__file__).resolve().parents[3] / "captures" / "scd" / "plant.toml")
CODEC: Final = scd.Codec(OD)
HOLDS: Final = (
    "messages",
    "T1",
    "T2",
    "pump_t",
    "alarm_t",
    "0x6001",
    "Насос 1",
    "Пороги давления",
    "Имя станции",
    "Журнал",
)
READ: Final = bytes.fromhex("DC02070041600000 0000D5D2")
ANSWER: Final = bytes.fromhex("DC820700416000000200 3702 1F30")


def bound(holds: str, carrier: CarrierName = "udp", size: int = 0) -> Binding:
    found = find_content(OD, holds)
    return Binding(
        "x", carrier, found.holds, found.key, found.title, found.address, size or found.size, port=1 if carrier == "udp" else 0
    )  # fmt: skip


def test_messages_of_a_unit() -> None:
    one, two = decode(CODEC, bound("messages"), READ + ANSWER)
    assert (one.service, one.phase, one.tid, one.size) == ("read", "request", 7, len(READ))
    assert (two.service, two.phase, two.values) == ("read", "response", {(0x6041, 0): 0x0237})
    assert decode(CODEC, bound("messages"), b"") == []


def test_bare_pdo() -> None:
    """R99, profile 3.1: T/F/ABCh/-1500 in the mapping of T2."""
    (message,) = decode(CODEC, bound("T2"), bytes.fromhex("C1AB24FA"))
    assert (message.service, message.phase, message.pdo, message.size, message.error) == ("pdo", "push", "T2", 4, None)
    assert list(message.values.values()) == [True, False, 0xABC, -1500]
    assert (message.data, message.content, message.numbers) == (bytes.fromhex("C1AB24FA"), "", {})


@pytest.mark.parametrize(
    ("holds", "octets", "content", "values"),
    [
        ("pump_t", "0124FA", "pump_t", {"run": True, "fault": False, "speed": -1500}),
        ("0x6001", "BC0A", "0x6001:0 Давление 1", {(0x6001, 0): 0xABC}),
        ("Насос 1.speed", "24FA", "0x6000:4 Насос 1.speed", {(0x6000, 4): -1500}),
        ("Насос 1", "0124FA", "0x6000 Насос 1", {(0x6000, 1): True, (0x6000, 2): False, (0x6000, 4): -1500}),
        (
            "Пороги давления",
            "0100FFFF0001",
            "0x2001 Пороги давления",
            {(0x2001, 1): 1, (0x2001, 2): -1, (0x2001, 3): 256},
        ),
        ("Журнал", "0102", "0x2003:0 Журнал", {(0x2003, 0): b"\1\2"}),
    ],
)
def test_other_bare_contents(holds: str, octets: str, content: str, values: dict[object, object]) -> None:
    (message,) = decode(CODEC, bound(holds), bytes.fromhex(octets))
    assert (message.service, message.phase, message.content, message.error) == ("", "push", content, None)
    assert message.values == values
    assert message.size == len(octets) // 2


@pytest.mark.parametrize("holds", ["T1", "T2", "pump_t", "0x6001", "Насос 1"])
def test_cut_at_every_octet_and_with_octets_behind(holds: str) -> None:
    binding = bound(holds)
    for size in range(binding.size):
        (message,) = decode(CODEC, binding, bytes(size))
        assert message.error is not None
        assert (message.error.code, message.values, message.data) == ("E_SHORT", {}, bytes(size))
    (message,) = decode(CODEC, binding, bytes(binding.size + 1))
    if binding.holds == "value":
        assert message.error is not None
        assert message.error.code == "E_LONG"
    else:
        assert message.error is None
        assert "trailing" in message.flags


def test_an_area_is_filled_up_with_zeros() -> None:
    area = bound("messages", "s7", 64)
    unit = (READ + ANSWER).ljust(64, b"\0")
    assert [message.error for message in decode(CODEC, area, unit)] == [None, None]
    assert decode(CODEC, area, bytes(64)) == []
    assert decode(CODEC, area, unit[:-1] + b"\1")[-1].error is not None
    assert decode(CODEC, bound("messages"), unit)[-1].error is not None  # a datagram has no fill


def test_a_checksum_of_zeros_belongs_to_the_message() -> None:
    """The last octets of a message may be zero: it is not cut with the fill behind it."""
    area = bound("messages", "s7", 64)
    made = [
        (value, CODEC.encode_message(scd.Message("write", "request", index=0x6041, values={(0x6041, 0): value})))
        for value in range(0x4000)
    ]
    value, octets = next((value, octets) for value, octets in made if octets.endswith(b"\0"))
    (found,) = decode(CODEC, area, octets.ljust(64, b"\0"))
    assert (found.error, found.values) == (None, {(0x6041, 0): value})


def test_messages_of_a_unit_have_a_bound_that_is_told() -> None:
    found = decode(CODEC, bound("messages"), READ * (MAX_MESSAGES + 3))
    assert len(found) == MAX_MESSAGES + 1
    assert [message.error for message in found[:-1]] == [None] * MAX_MESSAGES
    assert str(found[-1].error) == "E_LONG: unit: more than 4096 messages, the last 36 bytes were not decoded"
    assert found[-1].data == READ * 3
    assert len(decode(CODEC, bound("messages"), READ * MAX_MESSAGES)) == MAX_MESSAGES


@given(st.sampled_from(HOLDS), st.sampled_from(("udp", "s7")), st.binary(max_size=80), st.booleans())
def test_nothing_received_raises(holds: str, carrier: CarrierName, octets: bytes, header: bool) -> None:
    unit = bytes((PROTOCOL, 0x10)) + octets if header else octets
    for message in decode(CODEC, bound(holds, carrier), unit):
        assert not (message.error and message.values)
