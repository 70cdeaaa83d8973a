"""The identification record of a module: what it consists of, and how it is written in a line."""

from __future__ import annotations

import pytest

from dissect.protocols.s7plus.identification import is_record, read_record, record_text

HEAD = bytes.fromhex("0020 0038 0100 002a")


def record(
    order_number: bytes = b"6ES7 214-1HE30-0XB0 ",
    serial_number: bytes = b"SZVBDYXX017685  ",
    hardware: int = 2,
    firmware: bytes = b"V\2\3\4",
) -> bytes:
    """A record as IEC 61158-6-10 lays it out: block header, vendor, 20 and 16 characters, revisions, ten further octets."""
    return HEAD + order_number.ljust(20) + serial_number.ljust(16) + hardware.to_bytes(2, "big") + firmware + bytes(10)


def test_a_record_has_its_size_and_begins_with_its_head() -> None:
    whole = record()
    assert len(whole) == 60
    assert is_record(whole)
    assert not is_record(whole[:-1])
    assert not is_record(whole + b"\0")
    for at in range(6):
        assert not is_record(whole[:at] + bytes((whole[at] ^ 1,)) + whole[at + 1 :])
    assert is_record(whole[:6] + b"\1\2" + whole[8:])  # the vendor may be any


@pytest.mark.parametrize(
    ("octets", "parts", "text"),
    [
        (
            record(),
            ("6ES7 214-1HE30-0XB0", "SZVBDYXX017685", "2", "V2.3.4"),
            "6ES7 214-1HE30-0XB0, hardware 2, firmware V2.3.4, serial number SZVBDYXX017685",
        ),
        (record(hardware=0), ("6ES7 214-1HE30-0XB0", "SZVBDYXX017685", "", "V2.3.4"),
         "6ES7 214-1HE30-0XB0, firmware V2.3.4, serial number SZVBDYXX017685"),
        (record(b"\0" * 20, b"\0" * 16, 0x102, b"T\xff\0\1"), ("", "", "258", "T255.0.1"),
         "hardware 258, firmware T255.0.1"),
        (record(b"ABCDEFGHIJKLMNOPQRST", b"0123456789abcdef", 1), ("ABCDEFGHIJKLMNOPQRST", "0123456789abcdef", "1", "V2.3.4"),
         "ABCDEFGHIJKLMNOPQRST, hardware 1, firmware V2.3.4, serial number 0123456789abcdef"),
        (record(b"\xe9 \0", b" x"), ("é", "x", "2", "V2.3.4"), "é, hardware 2, firmware V2.3.4, serial number x"),
    ],
)  # fmt: skip
def test_what_a_record_says(octets: bytes, parts: tuple[str, str, str, str], text: str) -> None:
    assert read_record(octets) == parts
    assert record_text(octets) == text
