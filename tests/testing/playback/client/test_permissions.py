"""What a request does, and what may be sent: every function of the tables has its kind, and what is unknown is control."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.tables import CONTROL, FUNCTIONS, READ, USERDATA_SUBFUNCTIONS, WRITE
from dissect.testing.playback.client.permissions import (
    DOWNLOAD,
    HARMLESS,
    NO_CONTROL,
    NO_WRITE,
    Permissions,
    kind_of,
)
from tests.cases import each
from tests.meaning.report.support import WORD
from tests.properties import messages

_NONE = Permissions()
_WRITES = Permissions(write=True)
_CONTROLS = Permissions(control=True)
_ALL = Permissions(write=True, control=True)

READING = {0x04, 0x1D, 0x1E, 0x1F, 0xF0}
READING_GROUPS = {
    0x02: {0x01, 0x04, 0x05, 0x08},
    0x03: {0x01, 0x02, 0x03},
    0x04: {0x01, 0x02, 0x13},
    0x07: {0x01, 0x03},
}


def job(function: int) -> bytes:
    """Return a job of a function with parameters that do for any of them."""
    if function == 0x04:
        return messages.read_job(1, [WORD])
    if function == 0x05:
        return messages.write_job(1, [WORD], [b"\0\7"])
    if function == 0xF0:
        return messages.setup(messages.JOB, 1)
    bodies = {
        0x1D: b"\0\0\0" + bytes(4) + b"\x09_0A00010A",
        0x1E: b"\0\0\0\0\0\0\7",
        0x1F: b"\0\0\0\0\0\0\7",
        0x28: b"\0\0\0\0\0\0\xfd\0\0\x09P_PROGRAM",
        0x29: b"\0\0\0\0\0\x09P_PROGRAM",
    }
    return messages.pdu(messages.JOB, 1, bytes((function,)) + bodies.get(function, bytes(17)))


@each("function", range(256))
def test_a_job_is_control_unless_it_is_known_to_read_or_write(function: int) -> None:
    expected = READ if function in READING else WRITE if function == 0x05 else CONTROL
    assert kind_of(job(function)) == expected, FUNCTIONS.name(function)


@each("group", range(64))
def test_userdata_is_control_unless_it_is_known_to_read(group: int) -> None:
    for subfunction in {*range(32), *[row.number for row in USERDATA_SUBFUNCTIONS.get(group, ())], 0xFF}:
        octets = messages.userdata(1, 1, group, subfunction, b"\x00\x11\x00\x00")
        expected = READ if subfunction in READING_GROUPS.get(group, ()) else CONTROL
        assert kind_of(octets) in {expected, CONTROL}


@pytest.mark.parametrize(
    ("group", "subfunction", "payload"),
    [(4, 1, b"\x00\x11\x00\x00"), (3, 1, b""), (3, 2, b"0A"), (3, 3, b"0A00001A"), (7, 1, b"")],
)
def test_what_tells_of_a_device_is_reading(group: int, subfunction: int, payload: bytes) -> None:
    assert kind_of(messages.userdata(1, 1, group, subfunction, payload)) == READ


@pytest.mark.parametrize("kind", [0, 2, 3])
def test_a_push_or_an_answer_is_no_request_and_so_control(kind: int) -> None:
    assert kind_of(messages.userdata(1, kind, 4, 1, b"\x00\x11\x00\x00")) == CONTROL


@pytest.mark.parametrize("rosctr", [0, 2, 3, 4, 255])
def test_what_is_no_job_is_control(rosctr: int) -> None:
    octets = bytearray(messages.read_job(1, [WORD]))
    octets[1] = rosctr
    assert kind_of(bytes(octets)) == CONTROL


def test_a_read_with_something_behind_its_end_is_control() -> None:
    octets = messages.read_job(1, [WORD])
    assert kind_of(octets) == READ
    assert kind_of(octets + job(0x29)) == CONTROL
    assert kind_of(octets + b"\0") == CONTROL


@pytest.mark.parametrize("function", [0x04, 0x05, 0xF0])
def test_a_request_cut_anywhere_is_control(function: int) -> None:
    octets = job(function)
    for size in range(len(octets)):
        assert kind_of(octets[:size]) == CONTROL


@given(st.binary(max_size=80))
def test_nothing_sent_without_permission_is_anything_but_a_whole_read(octets: bytes) -> None:
    if not _NONE.refusal(octets):
        assert octets[:2] in {b"\x32\x01", b"\x32\x07"}
        assert len(octets) == 10 + sum(struct.unpack(">HH", octets[6:10]))
        assert octets[1] == 7 or octets[10] in READING


@given(st.binary(max_size=40), st.sampled_from([_NONE, _WRITES]))
def test_any_job_that_is_no_read_is_refused_without_control(rest: bytes, permissions: Permissions) -> None:
    octets = messages.pdu(messages.JOB, 1, b"\x29" + rest)
    assert permissions.refusal(octets) == NO_CONTROL


@pytest.mark.parametrize(
    ("permissions", "read", "write", "control"),
    [
        (_NONE, "", NO_WRITE, NO_CONTROL),
        (_WRITES, "", "", NO_CONTROL),
        (_CONTROLS, "", NO_WRITE, ""),
        (_ALL, "", "", ""),
    ],
)
def test_writes_and_control_are_allowed_each_for_itself(
    permissions: Permissions, read: str, write: str, control: str
) -> None:
    assert permissions.refusal(job(0x04)) == read
    assert permissions.refusal(job(0x05)) == write
    for function in (0x28, 0x29, 0x77):
        assert permissions.refusal(job(function)) == control
    for group, subfunction in ((5, 1), (5, 2), (7, 2), (7, 4), (1, 8), (1, 9), (1, 0x0C), (4, 0x0B), (6, 1), (0x3F, 6)):
        octets = messages.userdata(1, 1, group, subfunction, bytes(8))
        assert permissions.refusal(octets) == control, (group, subfunction)


@pytest.mark.parametrize("permissions", [_NONE, _WRITES, _CONTROLS, _ALL])
def test_a_download_is_control_and_no_permission_lets_that_of_an_nc_begin(permissions: Permissions) -> None:
    assert permissions.refusal(job(0x1A)) == ("" if permissions.control else NO_CONTROL)
    assert permissions.refusal(messages.userdata(1, 1, 0x3F, 1, bytes(8))) == DOWNLOAD


@pytest.mark.parametrize("permissions", [_NONE, _WRITES, _CONTROLS, _ALL])
def test_only_jobs_of_a_download_may_be_answered_and_with_control_only(permissions: Permissions) -> None:
    answered = {function for function in range(256) if permissions.answers(job(function))}
    assert answered == ({0x1B, 0x1C} if permissions.control else set())
    assert not permissions.answers(job(0x1B) + b"\0")
    assert not permissions.answers(messages.userdata(1, 1, 4, 1, b"\x00\x11\x00\x00"))
    assert not permissions.answers(b"")


@pytest.mark.parametrize("group", sorted(USERDATA_SUBFUNCTIONS))
def test_what_the_tables_say_to_change_something_is_control(group: int) -> None:
    """Also in each form that a request has: plain, and extended with the sequence of another message."""
    for row in USERDATA_SUBFUNCTIONS[group]:
        if row.number in READING_GROUPS.get(group, ()):
            assert row.effect in HARMLESS, row.name
            continue
        for extended in (False, True):
            head = b"\0\1\x12" + bytes((8 if extended else 4, 0x12 if extended else 0x11, 0x40 | group, row.number, 1))
            parameters = head + (bytes(4) if extended else b"")
            octets = messages.pdu(messages.USERDATA, 1, parameters, b"\xff\x09\0\4\0\x11\0\0")
            assert kind_of(octets) == CONTROL, row.name
            assert _WRITES.refusal(octets) in {NO_CONTROL, DOWNLOAD}
