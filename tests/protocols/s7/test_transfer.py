from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.transfer import (
    CONTENT,
    FILE_NAME,
    LENGTHS,
    PIECE,
    PLAIN_FILE_NAME,
    SHORT_FILE_NAME,
    STATUS,
    UPLOAD_HEAD,
    UPLOAD_LENGTH,
)
from dissect.wire.part import OCTETS, SURPLUS
from tests.protocols.s7.job_pdus import Rows, answer, job, said, stands_cuts
from tests.protocols.s7.userdata_pdus import body, has_surplus

NAME = "09 5f3041303030303150"
SHORT = "08 3041303030303150"
STATUS_ROWS: Rows = [("status_rest", 0), ("error", 0), ("more", 0)]
NAME_ROWS: Rows = [
    ("name_length", 9),
    ("identifier", "_ complete module"),
    ("block_type", "DB"),
    ("block_number", "1"),
    ("file_system", "passive"),
]
#: The 36 octets that a block begins with (reference section 4.6).
HEADER = "7070 01 01 05 0a 0001 000000d8 00000003 02395d992d70 03a1638321a7 0038 0000 0000 0058"

#: (parameters, is an answer, data, fields, notes): reference sections 3.7, 3.8, 8.5 and 8.6.
EXAMPLES: list[tuple[str, bool, str, Rows, list[str]]] = [
    (
        "1a 00 0100 00000000" + NAME + "0d 31 303030323136 303030303838", False, "",
        [
            ("function", "Request download"), *STATUS_ROWS, ("unknown", 0x0100), ("unknown_id", 0), *NAME_ROWS,
            ("lengths_length", 13), ("unknown_digit", "1"), ("load_length", "216"), ("mc7_length", "88"),
        ],
        ["DB 1, passive", "216 bytes, 88 of them MC7 code"],
    ),
    (
        "1b 00 0000 00000000" + NAME, False, "",
        [("function", "Download block"), *STATUS_ROWS, ("unknown", 0), ("unknown_id", 0), *NAME_ROWS],
        ["DB 1, passive"],
    ),
    (
        "1c 00 d209 00000000" + NAME, False, "",
        [("function", "Download ended"), *STATUS_ROWS, ("error_code", "Block not found"), ("unknown_id", 0), *NAME_ROWS],
        ["error 0xd209 Block not found", "DB 1, passive"],
    ),
    (
        "1d 00 0000 00000000" + NAME, False, "",
        [("function", "Start upload"), *STATUS_ROWS, ("unknown", 0), ("upload_id", 0), *NAME_ROWS],
        ["DB 1, passive"],
    ),
    (
        "1d 00 0100 00000007 07 30303030323136", True, "",
        [
            ("function", "Start upload"), *STATUS_ROWS, ("unknown", 0x0100), ("upload_id", 7),
            ("length_length", 7), ("total", "216"),
        ],
        ["upload 7", "216 bytes"],
    ),
    (
        "1d 00 0100 00000007", True, "",
        [("function", "Start upload"), *STATUS_ROWS, ("unknown", 0x0100), ("upload_id", 7)],
        ["upload 7"],
    ),
    (
        "1e 00 0000 00000007", False, "",
        [("function", "Upload"), *STATUS_ROWS, ("unknown", 0), ("upload_id", 7)],
        ["upload 7"],
    ),
    (
        "1e 01", True, "0008 00fb 70700101 05080001",
        [
            ("function", "Upload"), ("status_rest", 0), ("error", 0), ("more", 1),
            ("length", 8), ("unknown", 0xFB), ("content", "7070010105080001"),
        ],
        ["more to come", "8 bytes"],
    ),
    (
        "1f 00 0000 00000007", False, "",
        [("function", "End upload"), *STATUS_ROWS, ("error_code", "No error"), ("upload_id", 7)],
        ["upload 7"],
    ),
    (
        "1f 00 d280 00000007", False, "",
        [("function", "End upload"), *STATUS_ROWS, ("error_code", "Block compile error"), ("upload_id", 7)],
        ["upload 7, error 0xd280 Block compile error"],
    ),
    ("1a", True, "", [("function", "Request download")], []),
    ("1c 02", True, "", [("function", "Download ended"), ("status_rest", 0), ("error", 1), ("more", 0)], ["error"]),
]  # fmt: skip


@pytest.mark.parametrize(("parameters", "is_answer", "data", "fields", "notes"), EXAMPLES)
def test_examples(parameters: str, is_answer: bool, data: str, fields: Rows, notes: list[str]) -> None:
    octets = answer(parameters, data) if is_answer else job(parameters, data)
    found = body(octets)
    assert found.malformed == []
    assert said(octets) == fields
    assert found.notes == notes
    stands_cuts(parameters, data, octets[1])


@pytest.mark.parametrize("parameters", [row[0] for row in EXAMPLES if not row[1]])
def test_octets_behind_a_job_are_surplus(parameters: str) -> None:
    assert has_surplus(body(job(parameters + "beef")))


@pytest.mark.parametrize("parameters", ["1a 00", "1e 01", "1d 00 0100 00000007 07 30303030323136"])
def test_octets_behind_an_answer_are_surplus(parameters: str) -> None:
    assert has_surplus(body(answer(parameters + "beef")))


def test_octets_behind_a_piece_are_surplus() -> None:
    assert has_surplus(body(answer("1e 00", "0002 00fb 0102 03")))


def test_a_piece_shorter_than_it_says() -> None:
    found = body(answer("1e 00", "0009 00fb 0102"))
    assert [(fault.reason, fault.needed, fault.available) for fault in found.malformed] == [("length_beyond", 9, 2)]
    assert found.number("length") == 9
    assert found.data[-1].layout is CONTENT


def test_the_first_piece_has_the_header_of_the_block() -> None:
    found = body(answer("1b 01", "0028 00fb" + HEADER + "aabbccdd"))
    assert found.malformed == []
    assert [part.layout.name for part in found.data] == [PIECE.name, "block header", CONTENT.name]
    assert found.data[1].note == "block DB 1, DB, 216 bytes, know-how protected"
    assert found.text("code_time") == "2015-11-06 10:21:53.945"
    assert (found.number("mc7_length"), found.number("linked"), found.number("load_length")) == (88, 1, 216)
    stands_cuts("1b 01", "0028 00fb" + HEADER + "aabbccdd", 3)


@pytest.mark.parametrize(
    "begins", [HEADER.replace("7070", "7071"), HEADER.replace("05 0a", "05 77"), HEADER.replace("000000d8", "00000058")]
)
def test_what_only_looks_like_a_header_is_content(begins: str) -> None:
    found = body(answer("1e 01", "0024 00fb" + begins))
    assert [part.layout for part in found.data] == [PIECE, CONTENT]


@pytest.mark.parametrize(
    ("name", "layout", "note"),
    [
        (NAME, FILE_NAME, "DB 1, passive"),
        ("09 243038 3030303335 41", FILE_NAME, "OB 35, active, header alone"),
        ("09 5f3042 3939393939 42", FILE_NAME, "SDB 99999, active and passive"),
        ("09 5f3143 3030303031 58", FILE_NAME, "1C 1, X"),
        (SHORT, SHORT_FILE_NAME, "DB 1, passive"),
        ("0c 2f5f4e5f46494c455f4d5046", PLAIN_FILE_NAME, "/_N_FILE_MPF"),
        ("09 5f3041 3030304131 50", PLAIN_FILE_NAME, "_0A000A1P"),
        ("00", PLAIN_FILE_NAME, ""),
    ],
)
def test_names(name: str, layout: object, note: str) -> None:
    found = body(job("1d 00 0000 00000000" + name))
    assert found.malformed == []
    assert found.parameters[-1].layout is layout
    assert found.parameters[-1].note == note


@pytest.mark.parametrize("name", ["", "0a 5f30"])
def test_a_name_that_is_missing_or_short_is_told(name: str) -> None:
    found = body(job("1b 00 0000 00000000" + name))
    assert len(found.malformed) == 1
    assert found.malformed[0].reason in {"too_short", "length_beyond"}


@pytest.mark.parametrize("size", [12, 14])
def test_lengths_of_another_size_are_told_and_not_read(size: int) -> None:
    found = body(job("1a 00 0100 00000000" + NAME + f"{size:02x}" + "31" * size))
    assert [fault.field for fault in found.malformed] == ["lengths_length"]
    assert found.find(LENGTHS) is None
    assert found.find(OCTETS) is not None


def test_a_client_that_asks_for_blocks_itself_may_send_data_with_the_job() -> None:
    found = body(job("1b 00 0000 00000000" + SHORT, "0002 00fb aabb"))
    assert found.malformed == []
    assert found.data[0].note == "2 bytes, sent with the job"


def test_an_answer_of_another_size() -> None:
    assert body(answer("1d 02")).parameters[0].layout is STATUS
    assert body(answer("1d 00 0100 00000007 00")).find(UPLOAD_LENGTH) is not None
    short = body(answer("1d 00 0100"))
    assert (short.parameters[0].layout, short.malformed[0].reason) == (UPLOAD_HEAD, "too_short")


@given(st.integers(0x1A, 0x1F), st.sampled_from([1, 2, 3]), st.binary(max_size=60), st.binary(max_size=60))
def test_never_raises(function: int, rosctr: int, parameters: bytes, data: bytes) -> None:
    found = body(job(bytes([function]).hex() + parameters.hex(), data.hex(), rosctr))
    assert found.malformed or SURPLUS not in [part.layout for part in found.parts]


@given(st.binary(max_size=80))
def test_never_raises_on_any_octets(octets: bytes) -> None:
    parse_body(parse_pdu(b"\x32\x01" + octets))
    parse_body(parse_pdu(b"\x32\x03" + octets))
