"""The comparison sees what it is there to see: whatever one side is made to say otherwise is a difference, and the only one."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import zip_longest
from pathlib import Path
from random import Random
from typing import Final

import pytest

from dissect.protocols.tls.key_log import KeyLog
from dissect.testing.oracle import compare as comparison_module
from dissect.testing.oracle.compare import Comparison, FieldDifference, compare
from dissect.testing.oracle.facts import IN_BODY, IN_JOINED, NAMES, PDU, TPDU, FieldPlace, LocatedValue, Record, Value
from dissect.testing.oracle.ours import Witness
from dissect.testing.oracle.theirs import Frame
from dissect.testing.oracle.tshark import Reader, read_tshark
from tests.build import dt, pdu, tpdu
from tests.cases import each
from tests.examples import S7
from tests.testing.oracle.traffic import PUSH_ACK, Connection, connect, other_tpdu, setup, userdata, write_capture

READ: Final = pdu(1, 0x0102, b"\x04\x01\x12\x0a\x10\x02\x00\x03\x00\x09\x84\x00\x00\x28")
ANSWER: Final = pdu(3, 0x0102, b"\x04\x02", b"\xff\x09\x00\x03abc\x00\xff\x04\x00\x10de", error=0)
SZL: Final = userdata(Random(2), 5, 2, 0x0401, 3, short=False)
NAMED: Final = {name: part for part, names in NAMES.items() for name in names}


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One connection with a message of every kind."""
    rng = Random(11)
    connection = Connection(rng, 1)
    connection.open()
    connection.put(0, PUSH_ACK, connect(Random(1), 0xE0, 0))
    connection.put(1, PUSH_ACK, connect(Random(1), 0xD0, 1))
    connection.put(0, PUSH_ACK, dt(setup(rng, 1, 1)))
    connection.put(1, PUSH_ACK, dt(setup(rng, 3, 1)))
    connection.put(0, PUSH_ACK, dt(READ))
    connection.put(1, PUSH_ACK, dt(ANSWER))
    connection.put(0, PUSH_ACK, dt(pdu(1, 9, b"\x05" + READ[11:], b"\x00\x09\x00\x03abc")))
    connection.put(1, PUSH_ACK, dt(SZL) + dt(ANSWER))
    connection.put(0, PUSH_ACK, tpdu(b"\x70\x00\x01\x02"))
    for _ in range(40):
        connection.put(1, PUSH_ACK, other_tpdu(rng))
    return write_capture(tmp_path_factory.mktemp("made") / "made.pcap", connection.packets)


@pytest.fixture(scope="module")
def frames(capture: Path) -> list[Frame]:
    return list(read_tshark(str(capture)))


def says(frames: list[Frame]) -> Reader:
    """A reader for which Wireshark says this."""

    def read(path: str, ports: Iterable[int] = (), reorder: bool = False) -> Iterator[Frame]:
        return iter(frames)

    return read


def changed(frames: list[Frame], change: Callable[[list[Frame]], None]) -> list[Frame]:
    """Frames of which some records were changed; the given ones stay."""
    copies = [copy.copy(frame) for frame in frames]
    for frame in copies:
        frame.tpdus = [copied(record) for record in frame.tpdus]
        frame.pdus = [copied(record) for record in frame.pdus]
    change(copies)
    return copies


def copied(record: Record) -> Record:
    return Record(record.kind, record.frame, record.octets, dict(record.facts))


def told(comparison: Comparison) -> list[tuple[int, str, str]]:
    return [(one.frame, one.kind, one.field) for one in comparison.unexplained]


def first(frames: list[Frame], name: str) -> tuple[Record, FieldPlace]:
    """The first record that has a field of this name, and the field's place."""
    for frame in frames:
        for record in (*frame.tpdus, *frame.pdus):
            for place in record.facts:
                if place.name == name:
                    return record, place
    message = f"no message has {name}"
    raise AssertionError(message)


def other(value: Value) -> Value:
    return value + b"\x00" if isinstance(value, bytes) else value + 1


def test_both_sides_agree(capture: Path, frames: list[Frame]) -> None:
    comparison = compare(str(capture), says(frames))
    assert comparison.unexplained == []
    assert comparison.compared == {TPDU: 50, PDU: 7}
    assert comparison.fields > 480
    assert set(comparison.known) <= {
        "userdata-type-of-four-bits",
        "length-in-octets",
        "rejection-refused",
        "last-part-alone",
    }


def present() -> list[str]:
    """Every name that is compared but those that only newer versions and rarer messages have."""
    absent = {"s7comm.param.modetrans.subfunc", "cotp.preferred_maximum_tpdu_size", "tpkt.continuation_data"}
    return sorted(NAMED.keys() - absent)


@each("name", present())
def test_a_changed_value_is_a_difference(capture: Path, frames: list[Frame], name: str) -> None:
    def change(copies: list[Frame]) -> None:
        record, place = first(copies, name)
        fact = record.facts[place]
        record.facts[place] = LocatedValue(other(fact.value), fact.offset)

    record, place = first(frames, name)
    comparison = compare(str(capture), says(changed(frames, change)))
    assert told(comparison) == [(record.frame, record.kind, str(place))]


@each("name", present())
def test_a_changed_position_is_a_difference(capture: Path, frames: list[Frame], name: str) -> None:
    def change(copies: list[Frame]) -> None:
        record, place = first(copies, name)
        fact = record.facts[place]
        record.facts[place] = LocatedValue(fact.value, fact.offset + 1)

    record, place = first(frames, name)
    comparison = compare(str(capture), says(changed(frames, change)))
    where = FieldPlace(place.part, place.number, f"position of {place.name}")
    assert told(comparison) == [(record.frame, record.kind, str(where))]


@each("name", present())
def test_a_missing_field_is_a_difference(capture: Path, frames: list[Frame], name: str) -> None:
    def change(copies: list[Frame]) -> None:
        record, place = first(copies, name)
        del record.facts[place]

    record, place = first(frames, name)
    comparison = compare(str(capture), says(changed(frames, change)))
    assert told(comparison) == [(record.frame, record.kind, str(place))]


@pytest.fixture(scope="module")
def worked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Frame]]:
    """The worked examples of the reference in one connection, and what Wireshark says of them."""
    connection = Connection(Random(11), 1)
    connection.open()
    for example in S7:
        connection.put(0 if example.from_client else 1, PUSH_ACK, example.octets)
    path = write_capture(tmp_path_factory.mktemp("worked") / "worked.pcap", connection.packets)
    return path, list(read_tshark(str(path)))


@pytest.mark.parametrize("change", ["elsewhere", "otherwise", "gone"])
def test_each_field_of_a_body_counts(worked: tuple[Path, list[Frame]], change: str) -> None:
    """Whatever field of a body is told at another octet, with another value, or not at all: it is found."""
    path, shown = worked
    before = compare(str(path), says(shown))
    assert before.unexplained == []
    known = {(one.frame, one.field) for one in before.differences}
    first: dict[str, FieldPlace] = {}
    where: dict[int, list[FieldPlace]] = {}
    for number, frame in enumerate(shown):
        for place in (place for record in frame.pdus for place in record.facts if place.part in {IN_BODY, IN_JOINED}):
            if (frame.number, str(place)) not in known and first.setdefault(place.name, place) is place:
                where.setdefault(number, []).append(place)
    assert len(first) > 120
    # One field of every frame at a time: frames are compared each for itself.
    for row in zip_longest(*where.values()):
        told = {number: place for number, place in zip(where, row, strict=True) if place is not None}
        altered = [
            changed([frame], partial(CHANGES[change], told[number]))[0] if number in told else frame
            for number, frame in enumerate(shown)
        ]
        found: dict[int, set[str]] = {}
        for one in compare(str(path), says(altered)).unexplained:
            found.setdefault(one.frame, set()).add(one.field.split(" at ")[0])
        assert found.keys() == {shown[number].number for number in told}
        for number, place in told.items():
            assert place.name in found[shown[number].number], str(place)


def elsewhere(place: FieldPlace, frames: list[Frame]) -> None:
    facts = frames[0].pdus[0].facts
    fact = facts.pop(place)
    facts[place._replace(number=place.number + 7)] = LocatedValue(fact.value, fact.offset + 7)


def otherwise(place: FieldPlace, frames: list[Frame]) -> None:
    facts = frames[0].pdus[0].facts
    facts[place] = LocatedValue(other(facts[place].value), facts[place].offset)


def gone(place: FieldPlace, frames: list[Frame]) -> None:
    del frames[0].pdus[0].facts[place]


CHANGES: Final = {"elsewhere": elsewhere, "otherwise": otherwise, "gone": gone}


def test_a_field_too_many_is_a_difference(capture: Path, frames: list[Frame]) -> None:
    def change(copies: list[Frame]) -> None:
        record, place = first(copies, "s7comm.param.item.db")
        record.facts[place._replace(number=2)] = LocatedValue(1, 30)

    comparison = compare(str(capture), says(changed(frames, change)))
    assert [str(one) for one in comparison.unexplained] == [
        "frame 8 PDU s7comm.param.item.db of item 2: ours nothing, theirs 1 (0x01) (unexplained)"
    ]


def test_a_message_only_wireshark_shows_is_a_difference(capture: Path, frames: list[Frame]) -> None:
    def change(copies: list[Frame]) -> None:
        frame = next(frame for frame in copies if frame.number == 9)
        frame.pdus.append(copied(frame.pdus[0]))

    comparison = compare(str(capture), says(changed(frames, change)))
    assert [(one.frame, one.field, one.ours, one.theirs) for one in comparison.unexplained] == [
        (9, "(whole)", None, ANSWER)
    ]


def test_a_message_shown_in_another_packet_is_a_difference(capture: Path, frames: list[Frame]) -> None:
    def change(copies: list[Frame]) -> None:
        here, there = (next(frame for frame in copies if frame.number == number) for number in (9, 13))
        there.pdus.append(here.pdus.pop())
        there.pdus[-1].frame = 13

    comparison = compare(str(capture), says(changed(frames, change)))
    assert [(one.frame, one.field, one.ours, one.theirs) for one in comparison.unexplained] == [(9, "(packet)", 9, 13)]


def test_a_message_tshark_does_not_show_is_explained_by_the_stream_it_stands_in(
    capture: Path, frames: list[Frame]
) -> None:
    def change(copies: list[Frame]) -> None:
        next(frame for frame in copies if frame.number == 9).pdus.clear()

    comparison = compare(str(capture), says(changed(frames, change)))
    assert comparison.unexplained == []
    assert comparison.known["lost-by-tcp"] == 1


def test_a_message_we_count_twice_is_a_difference(
    capture: Path, frames: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Generous(Witness):
        def __init__(self, path: str, tls_keys: KeyLog | None = None) -> None:
            super().__init__(path, tls_keys)
            found = self.messages[PDU]
            found.insert(3, found[2])

    monkeypatch.setattr(comparison_module, "Witness", Generous)
    comparison = compare(str(capture), says(frames))
    assert [(one.frame, one.field, one.theirs) for one in comparison.unexplained] == [(8, "(whole)", None)]


def test_a_message_we_lose_is_a_difference(capture: Path, frames: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    class Careless(Witness):
        def __init__(self, path: str, tls_keys: KeyLog | None = None) -> None:
            super().__init__(path, tls_keys)
            del self.messages[PDU][2]

    monkeypatch.setattr(comparison_module, "Witness", Careless)
    comparison = compare(str(capture), says(frames))
    assert [(one.frame, one.field, one.ours, one.theirs) for one in comparison.unexplained] == [
        (8, "(whole)", None, READ)
    ]


@pytest.mark.parametrize(
    ("at", "field"),
    [
        (5, "s7comm.header.pduref"),
        (3, "s7comm.header.redid"),
        (15, "s7comm.param.item.transp_size of item 1"),
        (19, "s7comm.param.item.db of item 1"),
        (20, "s7comm.param.item.area of item 1"),
        (23, "s7comm.param.item.address of item 1"),
    ],
)
def test_an_octet_that_only_we_read_otherwise_is_a_difference(
    capture: Path, frames: list[Frame], tmp_path: Path, at: int, field: str
) -> None:
    octets = bytearray(capture.read_bytes())
    octets[octets.find(READ) + at] ^= 0x01
    path = tmp_path / "made.pcap"
    path.write_bytes(octets)
    comparison = compare(str(path), says(frames))
    assert told(comparison) == [(8, PDU, "(octets)"), (8, PDU, field)]


@pytest.mark.parametrize(
    ("ours", "theirs", "text"),
    [
        (16, 17, "frame 3 PDU name: ours 16 (0x10), theirs 17 (0x11) (unexplained)"),
        (b"\x01\x02", None, "frame 3 PDU name: ours 0102, theirs nothing (unexplained)"),
        (None, b"", "frame 3 PDU name: ours nothing, theirs empty (unexplained)"),
    ],
)
def test_a_difference_reads_well(ours: Value | None, theirs: Value | None, text: str) -> None:
    difference = FieldDifference(PDU, 3, "name", ours, theirs, "")
    assert str(difference) == text
    assert repr(difference) == f"<{text}>"
    assert str(FieldDifference(PDU, 3, "name", 1, 2, "some-entry")).endswith("(some-entry)")


def test_what_both_sides_have_is_told_in_the_same_order_every_time(capture: Path, frames: list[Frame]) -> None:
    def change(copies: list[Frame]) -> None:
        for frame in copies:
            for record in frame.pdus:
                record.facts = {
                    place: LocatedValue(other(fact.value), fact.offset) for place, fact in record.facts.items()
                }

    altered = changed(frames, change)
    once, twice = (compare(str(capture), says(altered)) for _ in range(2))
    assert [str(one) for one in once.differences] == [str(one) for one in twice.differences]
    assert told(once) == sorted(told(once))
