"""Checksums of changed packets, held to a plain computation (RFC 1071)."""

from __future__ import annotations

from hypothesis import assume, given
from hypothesis import strategies as st

from dissect.files.anonymize.checksum import renewed, total

OCTETS = st.binary(min_size=2, max_size=60)


def plain(octets: bytes) -> int:
    """Return the sum of RFC 1071, word by word."""
    if len(octets) % 2:
        octets += b"\0"
    number = 0
    for at in range(0, len(octets), 2):
        number += octets[at] << 8 | octets[at + 1]
        number = (number & 0xFFFF) + (number >> 16)
    return number


def is_right(stored: int, octets: bytes) -> bool:
    return plain(stored.to_bytes(2, "big") + octets) in {0, 0xFFFF}


@given(st.binary(max_size=60))
def test_the_sum(octets: bytes) -> None:
    assert total(octets) == plain(octets)


@given(st.data())
def test_right_stays_right_and_wrong_stays_wrong(data: st.DataObject) -> None:
    old = data.draw(OCTETS)
    new = data.draw(st.binary(min_size=len(old), max_size=len(old)))
    right = plain(old) ^ 0xFFFF
    assert is_right(renewed(right, old, new, b"", b""), new)
    wrong = data.draw(st.integers(1, 0xFFFF))
    assume(not is_right(wrong, old))
    assert not is_right(renewed(wrong, old, new, b"", b""), new)


@given(OCTETS, OCTETS)
def test_none_stays_none(old: bytes, new: bytes) -> None:
    assume(plain(old) not in {0, 0xFFFF})
    assert renewed(0, old, new, b"", b"") == 0


def test_what_the_card_was_to_finish_is_still_to_be_finished() -> None:
    old_pseudo, new_pseudo = b"\x0a\x00\x00\x01", b"\x0a\x07\x00\x09"
    stored = plain(old_pseudo)
    assert renewed(stored, b"content!", b"CONTENT?", old_pseudo, new_pseudo) == plain(new_pseudo)
