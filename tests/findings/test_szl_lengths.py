"""An SZL answer that states more records than it has is a finding, not only a line of `show -V`."""

from __future__ import annotations

import struct

import pytest

from tests.transactions.talk import Talk, head, userdata


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
