"""Where passwords stand, and that nothing else is hidden."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.hiding import secret_spans, without_secrets
from dissect.protocols.s7.security import encode_password
from tests.properties.messages import JOB, pdu, userdata

REQUEST = userdata(1, 1, 5, 1, encode_password(b"geheim"))
LOGIN = b"\x28" + bytes(6) + b"\xfd\x00\x08\x011\x05nc-pw" + b"\x09_N_LOGIN_"


def test_a_session_password_is_all_behind_the_data_head() -> None:
    assert secret_spans(REQUEST) == [(22, 30)]
    assert without_secrets(REQUEST) == REQUEST[:22] + bytes(8)
    longer = userdata(1, 1, 5, 1, encode_password(b"geheim") + b"more")
    assert secret_spans(longer) == [(22, 34)]
    for size in range(len(REQUEST)):
        hidden = without_secrets(REQUEST[:size])
        assert hidden == REQUEST[: min(size, 22)] + bytes(max(0, size - 22))


def test_a_password_among_the_arguments_of_a_service() -> None:
    login = pdu(JOB, 1, LOGIN)
    at = login.index(b"nc-pw")
    assert secret_spans(login) == [(at, at + 5)]
    assert without_secrets(login) == login.replace(b"nc-pw", bytes(5))


def spoilt(octets: bytes, at: int, value: int) -> bytes:
    return octets[:at] + bytes((value,)) + octets[at + 1 :]


#: Length fields of a request that may lie: of the PDU, of the head of the parameter, of the data.
LENGTHS = (6, 7, 8, 9, 11, 12, 13, 20, 21)


@pytest.mark.parametrize("at", LENGTHS)
def test_no_length_that_lies_shows_a_session_password(at: int) -> None:
    secret = encode_password(b"geheim")
    for value in range(256):
        hidden = without_secrets(spoilt(REQUEST, at, value))
        assert hidden[22:30] == bytes(8) != secret


@pytest.mark.parametrize("at", [6, 7, 8, 9, 18, 19, 20, 22, 28])
def test_no_length_that_lies_shows_the_password_of_a_service(at: int) -> None:
    login = pdu(JOB, 1, LOGIN)
    for value in range(256):
        assert b"nc-pw" not in without_secrets(spoilt(login, at, value))


def test_a_password_in_what_was_cut_is_hidden() -> None:
    login = pdu(JOB, 1, LOGIN)
    for size in range(login.index(b"nc-pw") + 2, len(login)):
        assert b"nc" not in without_secrets(login[:size])


def test_the_name_of_the_service_and_the_other_arguments_stay_where_all_fits() -> None:
    assert b"_N_LOGIN_" in without_secrets(spoilt(pdu(JOB, 1, LOGIN), 18, 99))
    other = pdu(JOB, 1, b"\x28" + bytes(6) + b"\xfd\x00\x06\x01P\x03new\x09_N_F_DELE")
    assert without_secrets(other) == other


def test_everything_else_stays() -> None:
    others = [
        userdata(1, 2, 5, 1, b"12345678"),  # an answer carries none
        userdata(1, 1, 5, 2),
        userdata(1, 1, 4, 1, b"\x00\x1c\x00\x00"),
        pdu(JOB, 1, b"\x28" + bytes(6) + b"\xfd\x00\x00\x09P_PROGRAM"),
        pdu(JOB, 1, b"\x29" + LOGIN[1:]),
        b"\x33" + REQUEST[1:],
    ]
    for octets in others:
        assert secret_spans(octets) == []
        assert without_secrets(octets) is octets


@given(st.binary(max_size=60), st.sampled_from((REQUEST, pdu(JOB, 1, LOGIN))), st.integers(0, 40), st.integers(0, 255))
def test_whatever_octets(octets: bytes, known: bytes, at: int, value: int) -> None:
    for one in (octets, known[:10] + octets, spoilt(known, at % len(known), value)):
        spans = secret_spans(one)
        assert all(0 <= begin < end <= len(one) for begin, end in spans)
        hidden = without_secrets(one)
        assert len(hidden) == len(one)
        assert secret_spans(hidden) == spans
