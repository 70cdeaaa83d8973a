"""An SZL answer that states more records than it has is a finding, not only a line of `show -V`."""

from __future__ import annotations

import struct

import pytest

from tests.build import userdata_head
from tests.engine.transactions.talk import Talk, head, userdata


def szl(length: int, count: int, records: int) -> bytes:
    payload = struct.pack(">HHHH", 0x0111, 1, length, count) + bytes(records)
    return userdata(1, head(2, 4, 1, 1, 0), b"\xff\x09" + struct.pack(">H", len(payload)) + payload)


@pytest.mark.parametrize(
    ("length", "count", "records", "found"), [(28, 1, 28, 0), (28, 2, 56, 0), (28, 9, 28, 1), (200, 1, 28, 1)]
)
def test_a_lying_szl_length_is_a_finding(length: int, count: int, records: int, found: int) -> None:
    talk = Talk()
    talk.open()
    talk.ask(userdata(1, head(1, 4, 1), b"\xff\x09\x00\x04\x01\x11\x00\x01"))
    talk.tell(szl(length, count, records))
    talk.close()
    details = [one.detail for one in talk.findings if one.slug == "s7.malformed"]
    assert len(details) == found
    assert all(f"states {count} records of {length} bytes, 28 bytes are there" in detail for detail in details)


def test_an_answer_whose_parts_stop_is_a_finding() -> None:
    talk = Talk()
    talk.open()
    talk.ask(userdata(1, head(1, 4, 1), b"\xff\x09\x00\x04\x01\x11\x00\x01"))
    more = bytes((0, 1, 0x12, 8, 0x12, 0x84, 1, 1, 0, 1, 0, 0))
    payload = struct.pack(">HHHH", 0x0111, 1, 28, 9) + bytes(28)
    talk.tell(userdata(1, more, b"\xff\x09" + struct.pack(">H", len(payload)) + payload))
    talk.close()
    assert "operation.unfinished" in talk.slugs()


def test_an_answer_nobody_asked_for_names_one_packet() -> None:
    talk = Talk()
    talk.open()
    frame = talk.tell(szl(28, 9, 28))
    talk.close()
    assert [one.frames for one in talk.findings if one.slug == "s7.malformed"] == [[frame]]


@pytest.mark.parametrize(
    ("sequence", "reference", "last", "found"),
    [(0, 0, 0, 1), (0, 7, 1, 0), (0, 7, 0, 0), (0, 0, 1, 0), (1, 7, 0, 0), (1, 7, 1, 0)],
    ids=["whole", "first", "last by its reference", "more by its mark", "last", "middle"],
)
def test_a_part_of_a_list_is_not_short(sequence: int, reference: int, last: int, found: int) -> None:
    """Only a whole answer has to hold all records: the first part of a chain has fewer, later parts begin amid records."""
    talk = Talk()
    talk.open()
    asked = head(1, 4, 1, sequence) if not sequence else userdata_head(1, 4, 1, sequence, unit=reference)
    talk.ask(userdata(1, asked, b"\xff\x09\x00\x04\x01\x11\x00\x01"))
    payload = struct.pack(">HHHH", 0x0111, 1, 28, 9) + bytes(28)
    part = userdata_head(2, 4, 1, 1, reference, last)
    talk.tell(userdata(1, part, b"\xff\x09" + struct.pack(">H", len(payload)) + payload))
    assert talk.slugs().count("s7.malformed") == found


def test_the_last_part_after_its_own_request_is_not_short() -> None:
    """Its head may name no reference; that the request continued one says enough."""
    talk = Talk()
    talk.open()
    talk.ask(userdata(1, userdata_head(1, 4, 1, 1, 7), b"\x0a\x00\x00\x00"))
    talk.tell(szl(28, 9, 28))
    assert "s7.malformed" not in talk.slugs()
