from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.packet import Packet, Raw

from dissect.layers import (
    COTP_DT,
    S7,
    TPKT,
    S7_Answer,
    S7_Any,
    S7_Body,
    S7_Data,
    S7_Function,
    S7_FunctionOnly,
    S7_Job,
    S7_Octets,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_Setup,
    S7_UserdataExtended,
    S7_UserdataShort,
    S7_WriteVarAnswer,
    S7_WriteVarRequest,
)
from dissect.layers.s7 import is_s7
from tests.cases import each
from tests.layers.examples import BY_NUMBER, EXAMPLES
from tests.layers.support import mutated, shown, survives

BODIES: list[Any] = [
    S7_Setup,
    S7_ReadVarRequest,
    S7_ReadVarAnswer,
    S7_WriteVarRequest,
    S7_WriteVarAnswer,
    S7_Function,
    S7_Job,
    S7_Answer,
    S7_Data,
    S7_UserdataShort,
    S7_UserdataExtended,
]


def pdu(number: int) -> Packet:
    """The S7 layer of a worked example."""
    packet = TPKT(BY_NUMBER[number].octets)[S7]
    assert isinstance(packet, S7)
    return packet


@pytest.mark.parametrize(
    ("number", "values"),
    [
        (
            26,
            {
                "protocol_id": 0x32,
                "rosctr": 1,
                "redundancy_id": 0,
                "pdu_ref": 0x0100,
                "param_length": 8,
                "data_length": 0,
            },
        ),
        (29, {"rosctr": 3, "pdu_ref": 0x0200, "param_length": 2, "data_length": 10, "error_class": 0, "error_code": 0}),
        (
            44,
            {"rosctr": 2, "pdu_ref": 0x0901, "param_length": 0, "data_length": 0, "error_class": 0x81, "error_code": 4},
        ),
        (68, {"rosctr": 7, "pdu_ref": 0x1500, "param_length": 8, "data_length": 8}),
    ],
)
def test_the_header(number: int, values: dict[str, int]) -> None:
    header = pdu(number)
    assert {name: header.getfieldval(name) for name in values} == values


def test_only_an_answer_has_error_octets() -> None:
    assert len(bytes(S7(rosctr=1))) == len(bytes(S7(rosctr=7))) == 10
    assert len(bytes(S7(rosctr=2))) == len(bytes(S7(rosctr=3))) == 12
    assert "error_class" not in shown(pdu(28))
    assert "error_class" in shown(pdu(29))


@pytest.mark.parametrize(
    ("number", "values"),
    [
        (26, {"function": 0xF0, "reserved": 0, "max_amq_calling": 1, "max_amq_called": 1, "pdu_length": 480}),
        (27, {"function": 0xF0, "reserved": 0, "max_amq_calling": 1, "max_amq_called": 1, "pdu_length": 240}),
    ],
)
def test_setup(number: int, values: dict[str, int]) -> None:
    setup = pdu(number).payload
    assert isinstance(setup, S7_Setup)
    assert {name: setup.getfieldval(name) for name in values} == values


def test_setup_is_built_from_its_values() -> None:
    asked = TPKT() / COTP_DT() / S7(pdu_ref=0x0100) / S7_Setup()
    granted = TPKT() / COTP_DT() / S7(rosctr="Ack_Data", pdu_ref=0x0100) / S7_Setup(pdu_length=240)
    assert bytes(asked) == BY_NUMBER[26].octets
    assert bytes(granted) == BY_NUMBER[27].octets


def test_a_refusal_is_built_from_its_values() -> None:
    assert (
        bytes(TPKT() / COTP_DT() / S7(rosctr=2, pdu_ref=0x0901, error_class=0x81, error_code=4)) == BY_NUMBER[44].octets
    )


@each("number", range(45, 68))
def test_other_functions_are_lists_of_parts(number: int) -> None:
    header = pdu(number)
    body = header.payload
    if header.param_length == 0:
        assert not isinstance(body, S7_Body)
        return
    octets = BY_NUMBER[number].octets
    start = 7 + (10 if header.rosctr == 1 else 12)
    assert type(body) is (S7_Job if header.rosctr == 1 else S7_Answer)
    assert body.function == octets[start]
    assert b"".join(bytes(part) for part in body.parameters) == octets[start : start + header.param_length]
    assert b"".join(bytes(part) for part in body.data) == octets[start + header.param_length :]


def test_a_function_that_is_not_known_keeps_its_octets() -> None:
    packet = survives(S7, bytes.fromhex("32010000000100040002 2a010203 aabb"))
    assert [type(part) for part in packet.parameters] == [S7_FunctionOnly, S7_Octets]
    assert (packet.payload.function, packet.parameters[1].octets) == (0x2A, b"\x01\x02\x03")
    assert packet.data[0].octets == b"\xaa\xbb"
    assert packet.summary() == "S7 Job 0x2a ref=0x0001"


def test_a_function_may_be_built_from_octets() -> None:
    stop = S7(pdu_ref=0x1400) / S7_Job(parameters=[Raw(b"\x29" + bytes(5) + b"\x09P_PROGRAM")])
    assert bytes(TPKT() / COTP_DT() / stop) == BY_NUMBER[66].octets
    piece = S7(pdu_ref=0x0165) / S7_Answer(
        parameters=[S7_FunctionOnly(function="Download block"), S7_Octets(octets=b"\x01")],
        data=[S7_Octets(octets=bytes.fromhex("000600fb7070010105aa"))],
    )
    assert bytes(TPKT() / COTP_DT() / piece) == BY_NUMBER[55].octets


def test_a_raw_body_is_parameters() -> None:
    assert bytes(S7() / Raw(b"\x04\x00"))[6:10] == b"\x00\x02\x00\x00"


@pytest.mark.parametrize(
    ("octets", "cls"),
    [
        ("32030000020000010000000004", S7_Answer),  # an answer too short for its function
        ("3201000002000002000004 00", S7_ReadVarRequest),
        ("3202000002000002000081040400", S7_ReadVarAnswer),
        ("32010000020000000002 abcd", S7_Data),
        ("32010000020000070000 f0000001000101", S7_Job),  # Setup with seven octets
        ("320100000200000a0000 f0000001000100f0aabb", S7_Setup),  # and with ten
        ("32040000020000020000 0400", S7_ReadVarRequest),
        ("32010000020000000000 abcd", Raw),  # octets that no length names
        ("32010000020000080000 f000", S7_Job),  # a length that lies
    ],
)  # fmt: skip
def test_odd_pdus_survive(octets: str, cls: type[Packet]) -> None:
    packet = survives(S7, bytes.fromhex(octets))
    assert type(packet.payload) is cls


def test_octets_left_over_in_the_blocks_are_kept_apart() -> None:
    packet = survives(S7, bytes.fromhex("320100000200000a0002f0000001000100f0aabbccddee"))
    assert packet.parameter_rest == b"\xaa\xbb"
    assert packet.data_rest == b"\xcc\xdd"
    assert packet[Raw].load == b"\xee"
    assert "parameter_rest= aabb" in shown(packet)
    assert "parameter_rest" not in shown(pdu(26))


@pytest.mark.parametrize("octets", ["3201", "320100000200000000", "3203000002000000000000"])
def test_a_header_that_is_not_whole_stays_raw(octets: str) -> None:
    assert type(survives(S7, bytes.fromhex(octets))) is Raw
    assert S7 not in survives(COTP_DT, b"\x02\xf0\x80" + bytes.fromhex(octets))


def test_what_is_s7() -> None:
    assert all(is_s7(bytes((0x32, rosctr))) for rosctr in (1, 2, 3, 7))
    assert not any(is_s7(octets) for octets in (b"", b"\x32", b"\x32\x00", b"\x32\x04", b"\x32\x08", b"\x72\x01"))


# ---- answers ---------------------------------------------------------------------------------------------------------

#: Each answer among the worked examples and its request; the requests of some are not written out.
PAIRS = {
    14: 13, 16: 15, 17: 15, 27: 26, 29: 28, 31: 30, 33: 32, 35: 34, 37: 36, 41: 40, 43: 42, 46: 45, 48: 47, 50: 49, 53: 52,
    55: 54, 57: 56, 59: 58, 67: 66, 69: 68, 72: 71, 75: 74, 77: 76, 79: 78, 81: 80, 83: 82, 85: 84, 88: 87, 93: 92, 98: 97,
    19: 13,
}  # fmt: skip


@each("answer", [example.number for example in EXAMPLES])
def test_each_worked_example_answers_its_request_and_no_other(answer: int) -> None:
    packet = TPKT(BY_NUMBER[answer].octets)
    answered = [
        example.number
        for example in EXAMPLES
        if (example.from_client != BY_NUMBER[answer].from_client)
        and packet.hashret() == TPKT(example.octets).hashret()
        and packet.answers(TPKT(example.octets))
    ]
    assert answered == ([PAIRS[answer]] if answer in PAIRS else [])


def test_the_client_answers_jobs_of_the_plc() -> None:
    assert BY_NUMBER[54].from_client is False
    assert pdu(55).answers(pdu(54))
    assert pdu(55).hashret() == pdu(54).hashret()


def test_what_makes_an_answer() -> None:
    request = S7(pdu_ref=7) / S7_ReadVarRequest(items=[S7_Any()])
    assert (S7(pdu_ref=7, rosctr=2)).answers(request)  # an Ack without a function
    assert (S7(pdu_ref=7) / S7_ReadVarAnswer()).answers(request)  # its ROSCTR is filled in
    assert not (S7(pdu_ref=8) / S7_ReadVarAnswer()).answers(request)
    assert not (S7(pdu_ref=7) / S7_WriteVarAnswer()).answers(request)
    assert not (S7(pdu_ref=7) / S7_ReadVarRequest()).answers(request)
    assert not request.answers(S7(pdu_ref=7) / S7_ReadVarAnswer())
    assert not (S7(pdu_ref=7) / S7_UserdataExtended()).answers(request)
    assert not request.answers(Raw(b"x"))


def test_a_userdata_answer_has_its_own_references() -> None:
    job, userdata = S7(rosctr=1, pdu_ref=7), S7(rosctr=7, pdu_ref=7)
    assert job.hashret() != userdata.hashret()


# ---- any octets ------------------------------------------------------------------------------------------------------


@given(st.binary(min_size=1, max_size=80), st.sampled_from((1, 2, 3, 7)))
def test_any_octets_survive(octets: bytes, rosctr: int) -> None:
    survives(S7, octets)
    survives(S7, bytes((0x32, rosctr)) + octets)
    for body in BODIES:
        survives(body, octets)


@given(
    rosctr=st.sampled_from((1, 2, 3, 7)),
    lengths=st.tuples(st.integers(0, 40), st.integers(0, 40)),
    function=st.sampled_from((0, 1, 4, 5, 0x1A, 0x1D, 0x28, 0x29, 0xF0)),
    octets=st.binary(max_size=60),
)
def test_any_body_survives(rosctr: int, lengths: tuple[int, int], function: int, octets: bytes) -> None:
    header = bytes((0x32, rosctr, 0, 0, 0, 1, 0, lengths[0], 0, lengths[1])) + bytes(2 if rosctr in {2, 3} else 0)
    packet = survives(S7, header + bytes((function,)) + octets)
    assert isinstance(packet, S7)


@given(mutated())
def test_any_mutation_survives(octets: bytes) -> None:
    if octets[7:]:
        survives(S7, octets[7:])
