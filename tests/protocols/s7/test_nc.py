from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.nc import NC_DATA, NC_FILE, NC_HEADER, NC_PATH, NC_PIECE, NC_UPLOAD, NC_WINDOW
from dissect.wire.part import OCTETS, SURPLUS
from tests.protocols.s7.userdata_pdus import PUSH, REQUEST, RESPONSE, body, payload_parts, stands_cuts, userdata

NAME = b"/_N_MPF_DIR/_N_FILE_MPF"
PATH = b";$PATH=/_N_MPF_DIR\r\n"
FILE = b"      35" + b"20110914 1200000"
PIECE = b"\0\xfb"


@pytest.mark.parametrize(
    ("kind", "subfunction", "payload", "layouts", "notes"),
    [
        (REQUEST, 1, NAME, [NC_FILE], [NAME.decode()]),
        (RESPONSE, 1, b"\x03\0", [NC_WINDOW], ["3 without an acknowledgement"]),
        (
            PUSH,
            2,
            PIECE + FILE + PATH + b"G00 X0",
            [NC_PIECE, NC_HEADER, NC_PATH, NC_DATA],
            ["35 bytes", ";$PATH=/_N_MPF_DIR"],
        ),
        (PUSH, 2, PIECE + FILE, [NC_PIECE, NC_HEADER], ["35 bytes"]),
        (PUSH, 2, PIECE + FILE + b"G00", [NC_PIECE, NC_HEADER, NC_DATA], ["35 bytes"]),
        (PUSH, 7, PIECE + b"        " + FILE[8:], [NC_PIECE, NC_HEADER], ["no bytes"]),
        (RESPONSE, 7, PIECE + b"G01 X12.5 Y3 the program goes on here", [NC_PIECE, NC_DATA], ["continuation"]),
        (PUSH, 3, b"\x08\0", [NC_WINDOW], ["8 without an acknowledgement"]),
        (PUSH, 8, b"\x08\0", [NC_WINDOW], ["8 without an acknowledgement"]),
        (REQUEST, 4, b"\0\0", [NC_PIECE], []),
        (RESPONSE, 4, b"\0\0\1\2", [NC_PIECE, OCTETS], ["not known"]),
        (REQUEST, 6, b"\x03\0" + NAME, [NC_UPLOAD], [NAME.decode()]),
        (RESPONSE, 6, PIECE + FILE, [NC_PIECE, NC_HEADER], ["35 bytes"]),
        (REQUEST, 4, b"\0", [OCTETS], ["not known"]),
    ],
)
def test_programs(kind: int, subfunction: int, payload: bytes, layouts: list[object], notes: list[str]) -> None:
    octets = userdata(kind, 0x3F, subfunction, payload.hex())
    found = body(octets)
    assert found.malformed == []
    assert [part.layout for part in payload_parts(found)] == layouts
    assert found.notes == notes
    stands_cuts(octets)


def test_a_window_is_two_octets() -> None:
    assert body(userdata(PUSH, 0x3F, 3, "0800ff")).notes[-1] == "not known"


@pytest.mark.parametrize(("subfunction", "name"), [(1, "DRR init"), (2, "DRR finish"), (3, "DRR data")])
def test_data_record_routing_has_names_alone(subfunction: int, name: str) -> None:
    found = body(userdata(REQUEST, 0x20, subfunction, "010203040506"))
    assert ([part.layout for part in payload_parts(found)], found.notes) == ([OCTETS], [name])


@given(st.integers(0, 3), st.integers(1, 8), st.binary(max_size=60))
def test_never_raises(kind: int, subfunction: int, payload: bytes) -> None:
    for found in (
        body(userdata(kind, 0x3F, subfunction, payload.hex())),
        body(userdata(kind, 0x3F, subfunction, (PIECE + FILE + payload).hex())),
        body(userdata(kind, 0x20, subfunction, payload.hex())),
    ):
        assert found.malformed or SURPLUS not in [part.layout for part in found.parts]
