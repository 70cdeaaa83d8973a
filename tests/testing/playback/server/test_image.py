"""The memory: bits and octets, across its pages, and no more of them than there is room for."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.items import Item
from dissect.protocols.s7.message import parse_pdu
from dissect.testing.playback.server import Recording, answer_index, image
from dissect.testing.playback.server.image import Image, holds
from dissect.testing.playback.server.player import Stage
from dissect.testing.talk import Talk, items, octets, read, refused, values, words


def item(address: str) -> Item:
    return parse_pdu(read(address).octets).parameters.items[0]


def begun(*pairs: tuple[str, bytes]) -> Image:
    talk = Talk()
    for address, content in pairs:
        talk >> read(address) << octets(content)
    return Image(talk.recording())


@given(st.lists(st.tuples(st.integers(0, 600), st.binary(min_size=1, max_size=300)), max_size=8))
def test_it_holds_what_was_written_last(writes: list[tuple[int, bytes]]) -> None:
    expected = bytearray(900)
    memory = begun(*[(f"DB1.DBB{at} x300", bytes(300)) for at in (0, 300, 600)])
    for at, content in writes:
        assert memory.write(item(f"DB1.DBB{at} x{len(content)}"), content)
        expected[at : at + len(content)] = content
    assert [memory.get(item(f"DB1.DBB{at} x300")) for at in (0, 300, 600)] == [
        bytes(expected[at : at + 300]) for at in (0, 300, 600)
    ]
    assert memory.get(item("DB1.DBX255.3")) == bytes((expected[255] >> 3 & 1,))


def test_the_first_that_was_seen_counts() -> None:
    memory = begun(("MW0", b"\x01\x02"), ("MB1 x2", b"\xff\xee"))
    assert memory.get(item("MB0 x3")) == b"\x01\x02\xee"


def test_one_bit_more_is_known_than_was_read() -> None:
    memory = begun(("M0.3", b"\x01"))
    assert memory.get(item("M0.3")) == b"\x01"
    assert [memory.get(item(address)) for address in ("M0.2", "MB0", "M1.3", "DB1.DBX0.3")] == [None] * 4
    assert memory.write(item("M0.3"), b"\x00")
    assert not memory.write(item("M0.2"), b"\x01")
    assert memory.read(item("M0.3")) == b"\xff\x03\x00\x01\x00"


def test_nothing_is_written_when_not_all_is_known() -> None:
    memory = begun(("MB255", b"\x07"))
    assert not memory.write(item("MB255 x2"), b"\x01\x01")
    assert memory.get(item("MB255")) == b"\x07"


@pytest.mark.parametrize("address", ["M0.0 x2", "RECORD1@0 BYTE", "DB1.DBB0 0x1f", "MB0 x0"])
def test_some_items_are_no_octets(address: str) -> None:
    assert not holds(item(address))
    assert begun().get(item(address)) is None


def test_octets_that_begin_at_a_bit_are_none() -> None:
    one = item("MB0")
    one.start_bit = 3
    assert not holds(one)


def test_refused_items_and_those_of_another_size_teach_nothing() -> None:
    talk = Talk()
    talk >> read("MB0", "MB1") << items(refused(), values(1))
    memory = Image(talk.recording())
    assert [memory.get(item("MB0")), memory.get(item("MB1"))] == [None, b"\x01"]


def test_pages_are_bounded_and_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image, "MAX_PAGES", 1)
    talk = Talk()
    talk >> read("MW0") << words(1)
    talk >> read("MW256") << words(2)
    stage = Stage(talk.recording(), memory=True)
    assert stage.image is not None
    assert [stage.image.get(item(address)) for address in ("MW0", "MW256")] == [b"\x00\x01", None]
    assert "more memory than is kept" in stage.troubles[0]
    assert Stage(Recording()).troubles == []


def test_items_are_bounded_and_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answer_index, "MAX_ITEMS", 1)
    talk = Talk()
    talk >> read("MW0") << words(1)
    talk >> read("MW2") << words(2)
    stage = Stage(talk.recording())
    assert len(stage.all.items(b"\x04" + item("MW0").octets)) == 1
    assert stage.all.items(b"\x04" + item("MW2").octets) == []
    assert "more items than are kept" in stage.troubles[0]
