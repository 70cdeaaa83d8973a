from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.control import PI_ARGUMENT, PI_FILL, PI_HEAD, PI_NAME, PI_PASSWORD, PI_SHORT, PI_STRING
from dissect.protocols.s7.services import PI_SERVICES
from dissect.wire.part import OCTETS
from tests.protocols.s7.job_pdus import Rows, answer, job, said, stands_cuts
from tests.protocols.s7.userdata_pdus import body, has_surplus


def service(name: str, block: str = "") -> str:
    """Return the parameters of a PI service with this parameter block."""
    octets = bytes.fromhex(block)
    return f"28 000000000000fd {len(octets):04x} {octets.hex()} {len(name):02x} {name.encode().hex()}"


def strings(*texts: str) -> str:
    """Return the parameter block of a Sinumerik service (reference section 3.10)."""
    block = b""
    for text in texts:
        block += bytes([len(text)]) + text.encode() + (b"" if len(text) % 2 else b"\0")
    return block.hex()


HEAD: Rows = [("function", "PI service"), ("unknown", 0xFD)]

#: (parameters, fields, notes): reference sections 3.10 and 8.7.
EXAMPLES: list[tuple[str, Rows, list[str]]] = [
    (
        service("_INSE", "0100 3041303030303150"),
        [
            *HEAD, ("block_length", 10), ("block_count", 1), ("unknown", 0),
            ("block_type", "DB"), ("block_number", "1"), ("file_system", "passive"),
            ("name_length", 5), ("service", "_INSE"),
        ],
        ["_INSE: link in (activate) blocks loaded to the passive file system", "block DB 1, passive"],
    ),
    (
        service("_DELE", "0200 3041303030303141 3043303030313241"),
        [
            *HEAD, ("block_length", 18), ("block_count", 2), ("unknown", 0),
            ("block_type", "DB"), ("block_number", "1"), ("file_system", "active"),
            ("block_type", "FC"), ("block_number", "12"), ("file_system", "active"),
            ("name_length", 5), ("service", "_DELE"),
        ],
        ["_DELE: delete blocks", "block DB 1, active", "block FC 12, active"],
    ),
    (
        service("P_PROGRAM"),
        [*HEAD, ("block_length", 0), ("name_length", 9), ("service", "P_PROGRAM")],
        ["P_PROGRAM: start the CPU, warm restart"],
    ),
    (
        service("P_PROGRAM", "4320"),
        [*HEAD, ("block_length", 2), ("argument", "C"), ("name_length", 9), ("service", "P_PROGRAM")],
        ["P_PROGRAM: start the CPU", '"C ", cold restart'],
    ),
    (
        service("_MODU", "4550"),
        [*HEAD, ("block_length", 2), ("argument", "EP"), ("name_length", 5), ("service", "_MODU")],
        ["_MODU: copy RAM to ROM", '"EP"'],
    ),
    (
        service("_GARB"),
        [*HEAD, ("block_length", 0), ("name_length", 5), ("service", "_GARB")],
        ["_GARB: compress memory"],
    ),
    ("28 000000000000fd", HEAD, []),
    (
        service("_N_F_OPER", strings("P01", "/_N_FILE_MPF", "WIN")),
        [
            *HEAD, ("block_length", 22),
            ("string_length", 3), ("text", "P01"),
            ("string_length", 12), ("text", "/_N_FILE_MPF"), ("argument_fill", 0),
            ("string_length", 3), ("text", "WIN"),
            ("name_length", 9), ("service", "_N_F_OPER"),
        ],
        ["_N_F_OPER: open a file read-only", "address P01", "file /_N_FILE_MPF", "window WIN"],
    ),
    (
        "29 0000000000 09 505f50524f4752414d",
        [("function", "PLC stop"), ("unknown", 0), ("name_length", 9), ("service", "P_PROGRAM")],
        ["P_PROGRAM"],
    ),
]  # fmt: skip


@pytest.mark.parametrize(("parameters", "fields", "notes"), EXAMPLES)
def test_examples(parameters: str, fields: Rows, notes: list[str]) -> None:
    found = body(job(parameters))
    assert found.malformed == []
    # Octets that no field reads as a number show as they are; the two unknown ones are numbers of several octets.
    assert said(job(parameters)) == fields
    assert found.notes == notes
    stands_cuts(parameters)
    if parameters != "28 000000000000fd":
        assert has_surplus(body(job(parameters + "beef")))


@pytest.mark.parametrize("function", [0x28, 0x29])
def test_answers(function: int) -> None:
    assert said(answer(f"{function:02x}"))[1:] == []
    refused = body(answer(f"{function:02x} 02"))
    assert (refused.malformed, refused.notes, refused.number("error")) == ([], ["error"], 1)
    assert has_surplus(body(answer(f"{function:02x} 02 00")))


def test_a_password_is_not_read_out() -> None:
    found = body(job(service("_N_LOGIN_", strings("P01", "SUNRISE"))))
    assert found.malformed == []
    password = found.find(PI_PASSWORD)
    assert password is not None
    assert (password.note, password.text("password"), password.octets("password")) == (
        "password (7 bytes, not shown)",
        "",
        b"SUNRISE",
    )
    assert not any("SUNRISE" in value.meaning for part in found.parts for value in part.values)


def test_strings_without_names_of_their_own() -> None:
    found = body(job(service("_N_TSEARC", strings("P01", "5"))))
    assert found.notes == ["_N_TSEARC: complex tool search", "address P01", "argument 5"]
    found = body(job(service("_N_UNKNOWN", strings("P01", "12"))))
    assert found.notes == ["argument P01", "argument 12", "_N_UNKNOWN"]
    assert found.parameters[-2].layout is PI_FILL


def test_a_string_longer_than_the_parameter_block_is_told() -> None:
    found = body(job(service("_N_F_OPEN", "09 5030")))
    assert [(fault.reason, fault.field, fault.needed, fault.available) for fault in found.malformed] == [
        ("length_beyond", "string_length", 9, 2)
    ]
    assert found.find(PI_STRING) is not None
    assert found.find(PI_NAME) is not None


def test_more_blocks_than_there_are_is_told() -> None:
    found = body(job(service("_INSE", "0300 3041303030303150")))
    assert [fault.reason for fault in found.malformed] == ["too_short"]
    assert found.text("service") == "_INSE"


def test_blocks_nobody_counted_are_told() -> None:
    assert has_surplus(body(job(service("_INSE", "0000 3041303030303150"))))


def test_a_service_nobody_knows_keeps_its_argument() -> None:
    found = body(job(service("_XYZ_", "414243")))
    assert (found.malformed, found.notes) == ([], ['"ABC"', "_XYZ_"])
    assert found.find(PI_ARGUMENT) is not None


@pytest.mark.parametrize(
    ("parameters", "field"),
    [
        ("28 000000000000fd 0009 4142", "block_length"),
        ("28 000000000000fd 0000 09 41", "name_length"),
        ("28 000000000000fd 0000", "name_length"),
        ("29 0000000000 09 50", "name_length"),
    ],
)
def test_lengths_that_lie_are_told(parameters: str, field: str) -> None:
    told = {fault.field: fault.reason for fault in body(job(parameters)).malformed}
    assert told[field] == "length_beyond"


def test_heads() -> None:
    assert body(job("28 000000000000fd")).parameters[0].layout is PI_SHORT
    assert body(job(service("_GARB"))).parameters[0].layout is PI_HEAD


def test_cpu_services_as_a_job_stay_octets() -> None:
    found = body(job("00 010203"))
    assert [part.layout.name for part in found.parameters] == ["function", OCTETS.name]
    assert found.notes == ["job without a known layout"]
    assert body(answer("00 01")).notes == ["answer without a known layout"]


NAMES = st.one_of(st.sampled_from(sorted(PI_SERVICES)), st.text(st.characters(max_codepoint=127), max_size=9))


@given(NAMES, st.binary(max_size=60))
def test_any_parameter_block_is_cut(name: str, block: bytes) -> None:
    parameters = service(name, block.hex())
    assert body(job(parameters)).parameters[-1].layout is PI_NAME


@given(st.sampled_from([0, 0x28, 0x29]), st.sampled_from([1, 2, 3]), st.binary(max_size=60), st.binary(max_size=9))
def test_never_raises(function: int, rosctr: int, parameters: bytes, data: bytes) -> None:
    body(job(bytes([function]).hex() + parameters.hex(), data.hex(), rosctr))
