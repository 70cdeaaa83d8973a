from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.message import (
    DIGEST_SIZE,
    PlusPdu,
    fixed_part,
    is_beginning,
    parse_plus,
)
from tests.protocols.s7plus.pdus import (
    GET_MULTI,
    KEEP_ALIVE,
    NOTIFICATION_V3,
    RESPONSE_V3,
    asked,
    event,
    framed,
    notified,
    told,
)

EXAMPLES = [
    *[framed(data, version) for version in (1, 2, 3) for data in (asked(1), told(1), notified())],
    framed(asked(7, body=bytes(20)), 2, trailer=False) + framed(b"\x31" * 30, 2),
    framed(asked(7, body=bytes(20)), 3, trailer=False) + framed(b"more", 3, trailer=False) + framed(b"end", 3),
    event(1234),
    event(1234, b"LOGOUT"),
    KEEP_ALIVE,
    RESPONSE_V3,
    NOTIFICATION_V3,
]


def reasons(pdu: PlusPdu) -> list[tuple[str, str]]:
    return [(fact.reason, fact.field) for fact in pdu.malformed]


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_request(version: int) -> None:
    pdu = parse_plus(framed(asked(513, body=b"abc"), version), 3, 4, 5, 1)
    assert (pdu.frame, pdu.time_ns, pdu.connection, pdu.side) == (3, 4, 5, 1)
    assert (pdu.version, pdu.kind, pdu.function, pdu.function_name) == (
        version,
        "Request",
        GET_MULTI,
        "GetMultiVariables",
    )
    assert (pdu.sequence, pdu.session_id, pdu.transport_flags, pdu.body) == (513, 0x386, 0x34, b"abc")
    assert (pdu.return_value, pdu.return_code, pdu.subscription_id) == (-1, -1, -1)
    assert pdu.integrity == (b"\x5a" * 32 if version == 3 else b"")
    assert (pdu.whole, pdu.frames, pdu.wants_response, pdu.readable, pdu.malformed) == (True, 1, True, True, [])
    assert pdu.octets[pdu.data_offset :].startswith(pdu.data)


def test_a_request_that_wants_no_response() -> None:
    assert not parse_plus(framed(asked(1, flags=0x74))).wants_response
    assert not parse_plus(framed(told(1))).wants_response


@pytest.mark.parametrize(
    ("body", "value", "code"),
    [
        (b"\x00", 0, 0),
        (b"\x13", 19, 19),
        (b"\x81\xff\x74", 0x7FF4, 0x7FF4),
        (b"\xff" * 8 + b"\xf4", 0xFFFFFFFFFFFFFFF4, 0xFFF4),
        (b"\x80", -1, -1),
        (b"", -1, -1),
    ],
)
def test_the_return_value_of_a_response(body: bytes, value: int, code: int) -> None:
    pdu = parse_plus(framed(told(1, body=body)))
    assert (pdu.return_value, pdu.return_code, pdu.malformed) == (value, code, [])


def test_an_unknown_function_has_no_return_value() -> None:
    pdu = parse_plus(framed(told(1, 0x1234)))
    assert (pdu.function_name, pdu.return_value, pdu.sequence) == ("0x1234", -1, 1)


def test_pdus_of_captures() -> None:
    answer = parse_plus(RESPONSE_V3)
    assert (answer.kind, answer.sequence, answer.function_name) == ("Response", 33565, "GetMultiVariables")
    assert (answer.return_value, answer.whole, answer.malformed) == (0, True, [])
    assert answer.integrity.hex().startswith("3dcac8ee")
    assert len(answer.integrity) == DIGEST_SIZE
    push = parse_plus(NOTIFICATION_V3)
    assert (push.kind, push.subscription_id, push.credit_tick) == ("Notification", 0x70000E51, 0xD2)
    assert (push.sequence, push.function, push.readable, push.malformed) == (237777, -1, False, [])


def test_a_notification_of_version_1_has_another_form() -> None:
    pdu = parse_plus(framed(notified(), 1))
    assert (pdu.kind, pdu.subscription_id, pdu.sequence, pdu.malformed) == ("Notification", -1, -1, [])
    assert fixed_part(pdu) is layouts.NOTIFICATION_V1


def test_a_pdu_in_several_frames() -> None:
    pdu = parse_plus(EXAMPLES[10])
    assert (pdu.frames, pdu.whole, pdu.malformed) == (3, True, [])
    assert pdu.data == asked(7, body=bytes(20)) + b"moreend"
    assert pdu.integrity == b"\x5a" * 32
    cut = parse_plus(EXAMPLES[10][:-4], cut=True)
    assert (cut.frames, cut.whole, cut.sequence, cut.malformed) == (3, False, 7, [])


def test_without_opcode() -> None:
    told_event = parse_plus(event(77, b"LOGOUT"))
    assert (told_event.kind, told_event.number, told_event.message) == ("system event", 77, b"LOGOUT")
    assert (told_event.opcode, told_event.whole, told_event.malformed) == (-1, True, [])
    alive = parse_plus(KEEP_ALIVE)
    assert (alive.kind, alive.number, alive.whole, alive.malformed) == ("keep-alive", 7, True, [])


@pytest.mark.parametrize(
    ("octets", "told_of"),
    [
        (b"", ("too_short", "header")),
        (b"\x72\x02\x00", ("too_short", "header")),
        (b"\x72\x02\x00\x00", ("too_short", "opcode")),
        (framed(asked(1))[:-5], ("length_beyond", "length")),
        (framed(asked(1), trailer=False), ("too_short", "trailer")),
        (framed(asked(1)) + b"x", ("trailing_octets", "pdu")),
        (framed(asked(1), trailer=False) + b"\x72\x03\x00\x00", ("trailing_octets", "pdu")),
        (framed(asked(1)[:-1]), ("too_short", "S7comm-plus request")),
        (framed(told(1, body=b"")[:-1]), ("too_short", "S7comm-plus response")),
        (framed(notified()[:9]), ("too_short", "notification")),
        (framed(b"\x44abc"), ("unknown_type", "opcode")),
        (b"\x72\x09" + framed(asked(1))[2:-4] + b"\x72\x09\x00\x00", ("unknown_type", "version")),
        (b"\x72\x03\x00\x05\x05abcd\x72\x03\x00\x00", ("bad_value", "digest_length")),
        (b"\x72\xfe\x00\x09123456789", ("too_short", "system event")),
        (event(1)[:-1], ("length_beyond", "length")),
        (event(1) + b"??", ("trailing_octets", "system event")),
        (KEEP_ALIVE + b"?", ("trailing_octets", "keep-alive")),
    ],
)
def test_what_does_not_fit_is_told(octets: bytes, told_of: tuple[str, str]) -> None:
    assert reasons(parse_plus(octets))[0] == told_of


def test_a_missing_end_is_no_fault_when_it_was_cut() -> None:
    assert parse_plus(framed(asked(1), trailer=False), cut=True).malformed == []
    cut = parse_plus(framed(asked(1))[:10], cut=True)
    assert cut.malformed[0].limit == "snaplen"


@pytest.mark.parametrize(
    ("data", "begins"),
    [
        (asked(1), True),
        (told(1), True),
        (told(1, opcode=2), True),
        (notified(), True),
        (asked(1, 0x9999), True),
        (b"\x31\x55\x55\x99\x99\x00\x00\x00\x01" + bytes(5), False),
        (b"\x31\x55\x55\x05\x4c\x00\x00\x00\x01" + bytes(5), True),
        (b"\x44" + bytes(20), False),
        (b"\x31", False),
    ],
)
def test_the_rest_of_a_pdu_is_no_beginning(data: bytes, begins: bool) -> None:
    assert is_beginning(parse_plus(framed(data))) is begins


@pytest.mark.parametrize("octets", [framed(asked(9)), framed(told(9)), framed(notified()), event(9, b"x")])
def test_the_parser_reads_what_the_layout_says(octets: bytes) -> None:
    pdu = parse_plus(octets)
    layout = fixed_part(pdu)
    assert layout is not None
    found = {value.field.name: value.value for value in layout.read(pdu.data)}
    for name in ("opcode", "function", "sequence", "session_id", "transport_flags", "subscription_id", "credit_tick"):
        assert found.get(name, getattr(pdu, name) if name == "sequence" else -1) == getattr(pdu, name), name
    assert found.get("confirmed_octets", pdu.number) == pdu.number
    assert pdu.data[layout.size :] == (pdu.body or pdu.message)
    head = {value.field.name: value.value for value in layouts.HEADER.read(octets)}
    assert head == {"protocol_id": 0x72, "version": pdu.version, "length": len(pdu.data)}


def test_where_the_octets_of_several_frames_stand() -> None:
    pdu = parse_plus(framed(b"\x31abcd", 3, trailer=False) + framed(b"efgh", 3, trailer=False) + framed(b"ij", 3))
    assert pdu.data == b"\x31abcdefghij"
    assert pdu.frame_starts == {5: 79, 9: 120}
    assert [pdu.octets[pdu.place(at)] for at in range(len(pdu.data))] == list(pdu.data)


@pytest.mark.parametrize("octets", EXAMPLES)
def test_cut_at_every_octet(octets: bytes) -> None:
    whole = parse_plus(octets)
    assert whole.whole
    assert not whole.malformed
    for size in range(len(octets)):
        for cut in (False, True):
            pdu = parse_plus(octets[:size], cut=cut)
            assert pdu.octets == octets[:size]
            assert not pdu.whole
            assert pdu.malformed or cut
    tailed = parse_plus(octets + b"tail")
    assert tailed.data == whole.data
    assert tailed.malformed


@given(st.one_of(st.binary(max_size=80), st.tuples(st.sampled_from(EXAMPLES), st.binary(max_size=9)).map(b"".join)))
def test_never_raises(octets: bytes) -> None:
    pdu = parse_plus(b"\x72" + octets)
    is_beginning(pdu)
    fixed_part(pdu)
    assert len(pdu.body) <= len(pdu.data) <= len(octets)
    assert all(0 <= fact.offset <= len(octets) + 1 for fact in pdu.malformed)


def test_layouts_have_the_sizes_the_sources_give() -> None:
    sizes = [layouts.HEADER, layouts.REQUEST, layouts.RESPONSE, layouts.NOTIFICATION, layouts.EVENT, layouts.KEEP_ALIVE]
    assert [layout.size for layout in sizes] == [4, struct.calcsize(">BHHHHIB"), 10, 12, 16, 4]
