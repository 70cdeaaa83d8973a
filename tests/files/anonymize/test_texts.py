"""Replacements: as long as before, of the same kind of characters, the same for the same."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.files.anonymize.key import Key
from dissect.files.anonymize.texts import replace_bit, replace_octets, replace_path, replace_text

KEY = Key(b"secret")


@given(st.binary(max_size=40))
def test_a_text_keeps_its_shape_and_nothing_else(octets: bytes) -> None:
    new = replace_text(KEY, octets)
    assert len(new) == len(octets)
    assert new == replace_text(KEY, octets)
    core = octets.strip(b" \0")
    assert (new != octets) == bool(core)
    assert len(new) - len(new.rstrip(b" \0")) == len(octets) - len(octets.rstrip(b" \0")) or not core
    if any(chr(octet).isalnum() and octet < 0x80 for octet in core):
        for before, after in zip(octets, new, strict=True):
            if before < 0x80:
                assert chr(before).isdigit() == chr(after).isdigit()
                assert chr(before).islower() == chr(after).islower()
                assert chr(before).isupper() == chr(after).isupper()


def test_padding_does_not_change_what_a_text_becomes() -> None:
    assert replace_text(KEY, b"PUMP7   ")[:5] == replace_text(KEY, b"PUMP7\0")[:5] == replace_text(KEY, b"PUMP7")
    assert replace_text(KEY, b"PUMP7") != replace_text(Key(b"other"), b"PUMP7")


def test_one_letter_becomes_another_one() -> None:
    for letter in range(0x41, 0x5B):
        assert replace_text(KEY, bytes((letter,))) != bytes((letter,))


def test_a_path_stays_a_path() -> None:
    new = replace_path(KEY, b"/_N_MPF_DIR/_N_PUMP_MPF")
    assert new.count(b"/") == 2
    assert new.split(b"/")[1] == replace_text(KEY, b"_N_MPF_DIR")
    assert b"PUMP" not in new


@given(st.binary(max_size=100))
def test_octets(octets: bytes) -> None:
    assert len(replace_octets(KEY, octets)) == len(octets)
    assert replace_octets(KEY, octets) == replace_octets(KEY, octets)


def test_bits_stay_bits_and_differ() -> None:
    assert {replace_bit(KEY, b"\0"), replace_bit(KEY, b"\1")} == {b"\0", b"\1"}
    assert replace_bit(KEY, b"") == b""
