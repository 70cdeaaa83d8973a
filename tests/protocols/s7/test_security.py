from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.security import ENCODED_PASSWORD, decode_password, encode_password, password_text
from dissect.wire.part import SURPLUS
from tests.protocols.s7.userdata_pdus import (
    REQUEST,
    RESPONSE,
    body,
    has_surplus,
    payload_parts,
    stands_cuts,
    trailing,
    userdata,
)

ENCODED = "1110090a6d6d0b0c"  # DEMO1234, reference section 8.11


def test_a_password_is_there_and_not_read_out() -> None:
    octets = userdata(REQUEST, 5, 1, ENCODED)
    found = body(octets)
    assert found.malformed == []
    (part,) = payload_parts(found)
    assert part.layout is ENCODED_PASSWORD
    assert part.note == "password (8 bytes, not shown)"
    assert [value.meaning for value in part.values] == [""]
    assert part.octets("password") == bytes.fromhex(ENCODED)
    stands_cuts(octets)
    assert has_surplus(trailing(octets))


def test_who_asks_gets_it() -> None:
    assert password_text(bytes.fromhex(ENCODED)) == "DEMO1234"
    assert password_text(encode_password(b"AB")) == "AB"
    assert encode_password(b"DEMO1234").hex() == ENCODED
    assert len(encode_password(b"")) == 8


def test_a_password_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="up to 8 bytes, this one has 9: give a shorter one"):
        encode_password(bytes(9))


@pytest.mark.parametrize(("kind", "subfunction"), [(RESPONSE, 1), (REQUEST, 2), (RESPONSE, 2)])
def test_nothing_else_carries_anything(kind: int, subfunction: int) -> None:
    found = body(userdata(kind, 5, subfunction, ""))
    assert (found.malformed, payload_parts(found)) == ([], [])
    assert body(userdata(kind, 5, subfunction, "00")).find(ENCODED_PASSWORD) is None


@given(st.binary(max_size=8))
def test_encoding_is_reversible(password: bytes) -> None:
    assert decode_password(encode_password(password)) == password.ljust(8)


@given(st.integers(0, 3), st.integers(1, 2), st.binary(max_size=20))
def test_never_raises(kind: int, subfunction: int, payload: bytes) -> None:
    found = body(userdata(kind, 5, subfunction, payload.hex()))
    assert found.malformed or SURPLUS not in [part.layout for part in found.parts]
    password_text(payload)
