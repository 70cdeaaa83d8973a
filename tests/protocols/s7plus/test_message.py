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


def test_a_pdu_that_comes_from_nowhere_has_no_packet() -> None:
    pdu = parse_plus(framed(asked(1)))
    assert (pdu.frame, pdu.time_ns, pdu.connection, pdu.side, pdu.cut) == (0, 0, 0, 0, False)
    for octets, version, frames in (
        (b"", -1, 0),
        (b"\x72", -1, 0),
        (b"\x72\2", 2, 0),
        (b"\x72\2\0", 2, 0),
        (KEEP_ALIVE, 0xFF, 1),
    ):
        pdu = parse_plus(octets)
        assert (pdu.version, pdu.frames, pdu.data_offset, pdu.data, pdu.body) == (version, frames, 0, b"", b"")
        assert (pdu.sequence, pdu.session_id, pdu.transport_flags, pdu.credit_tick) == (-1, -1, -1, -1)
        assert pdu.number == (7 if octets == KEEP_ALIVE else -1)


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


@pytest.mark.parametrize(
    ("data", "size"),
    [(asked(0x0102, session=0x03040506, flags=0x74), 14), (told(0x0102), 10), (told(0x0102, opcode=2), 10)],
)
def test_of_a_head_that_ends_too_soon_the_numbers_that_are_there_are_read(data: bytes, size: int) -> None:
    for version in (1, 2, 3):
        for have in range(1, size + 1):
            pdu = parse_plus(framed(data[:have], version))
            assert pdu.opcode == data[0]
            assert pdu.function == (GET_MULTI if have >= 5 else -1)
            assert pdu.sequence == (0x0102 if have >= 9 else -1)
            assert pdu.readable == (have >= 9)
            whole = have == size
            assert pdu.transport_flags == (data[size - 1] if whole else -1)
            assert pdu.session_id == (0x03040506 if whole and size == 14 else -1)
            told_of = [(fact.reason, fact.offset, fact.needed, fact.available) for fact in pdu.malformed]
            assert told_of == ([] if whole else [("too_short", pdu.data_offset, size, have)])
            assert pdu.data_offset == (37 if version == 3 else 4)
            assert is_beginning(pdu) == (have >= 9)


def test_a_notification_that_ends_too_soon() -> None:
    data = notified(5, 0x71020304)
    for have in range(1, 13):
        pdu = parse_plus(framed(data[:have]))
        assert (pdu.subscription_id, pdu.credit_tick) == (0x71020304 if have >= 5 else -1, 1 if have == 12 else -1)
        assert (pdu.sequence, pdu.readable, is_beginning(pdu)) == (-1, False, have == 12)
        told_of = [(fact.reason, fact.field, fact.offset, fact.needed, fact.available) for fact in pdu.malformed]
        assert told_of == ([] if have == 12 else [("too_short", "notification", 4, 12, have)])
    assert parse_plus(framed(data[:13])).sequence == 5


@pytest.mark.parametrize(("subscription", "sequence"), [(0x6FFFFFFF, 1), (0x70000000, 5), (0, 1), (0xFFFFFFFF, 5)])
def test_a_subscription_of_old_firmware_counts_in_its_credit(subscription: int, sequence: int) -> None:
    pdu = parse_plus(framed(notified(5, subscription)))
    assert (pdu.subscription_id, pdu.credit_tick, pdu.sequence) == (subscription, 1, sequence)


def test_the_numbers_of_an_event_that_ends_too_soon() -> None:
    whole = event(0x01020304, b"LOGOUT")
    for have in range(len(whole) - 3):
        data = whole[4 : 4 + have]
        pdu = parse_plus(b"\x72\xfe" + have.to_bytes(2, "big") + data)
        assert (pdu.number, pdu.message) == (0x01020304 if have >= 8 else -1, data[16:])
        assert (pdu.data, pdu.data_offset, pdu.whole, pdu.frames) == (data, 4, True, 1)
        told_of = [(fact.reason, fact.field, fact.offset, fact.needed, fact.available) for fact in pdu.malformed]
        assert told_of == ([] if have >= 16 else [("too_short", "system event", 4, 16, have)])
    for cut in range(4, len(whole)):
        pdu = parse_plus(whole[:cut])
        (fact,) = pdu.malformed
        assert (fact.reason, fact.offset, fact.needed, fact.available) == ("length_beyond", 2, len(whole), cut)
        assert not pdu.whole
    assert parse_plus(whole + b"\x72\xfe\0\0").malformed == []  # a trailer, which none needs
    assert reasons(parse_plus(whole + b"\x72\xfe\0\1")) == [("trailing_octets", "system event")]


@pytest.mark.parametrize(
    ("octets", "faults"),
    [
        (b"\x72\2\0", [("too_short", "header", 0, 4, 3)]),
        (framed(asked(1)) + b"xyz", [("trailing_octets", "pdu", 22, 22, 25)]),
        (framed(asked(1)) + b"wxyz", [("trailing_octets", "pdu", 22, 22, 26)]),
        (framed(asked(1), trailer=False), [("too_short", "trailer", 18, 22, 18)]),
        (
            framed(asked(1), trailer=False)[:-1],
            [("length_beyond", "length", 2, 18, 17), ("too_short", "S7comm-plus request", 4, 14, 13)],
        ),
        (framed(b""), [("too_short", "opcode", 4, 1, 0)]),
        (framed(b"", 3), [("too_short", "opcode", 37, 1, 0)]),  # a digest fills the frame
        (framed(b"\x44abc"), [("unknown_type", "opcode", 4, 0, 0x44)]),
        (KEEP_ALIVE + b"??", [("trailing_octets", "keep-alive", 4, 4, 6)]),
        (b"\x72\3\0\1\x21\x72\3\0\0", [("bad_value", "digest_length", 4, 32, 33), ("length_beyond", "digest", 4, 38, 5)]),
        (b"\x72\3\0\1\x20\x72\3\0\0", [("length_beyond", "digest", 4, 37, 5)]),
        (
            b"\x72\3\0\2\0\x31\x72\3\0\0",
            [("bad_value", "digest_length", 4, 32, 0), ("too_short", "S7comm-plus request", 5, 14, 1)],
        ),
        (framed(asked(1), 9), [("unknown_type", "version", 1, 0, 9)]),
        (framed(asked(1), 0), [("unknown_type", "version", 1, 0, 0)]),
        (framed(asked(1), 4), [("unknown_type", "version", 1, 0, 4)]),
    ],
)  # fmt: skip
def test_faults_are_told_with_their_places(octets: bytes, faults: list[tuple[str, str, int, int, int]]) -> None:
    pdu = parse_plus(octets)
    assert [(one.reason, one.field, one.offset, one.needed, one.available) for one in pdu.malformed] == faults
    assert [one.limit for one in pdu.malformed] == ["tsdu"] * len(faults)


def test_what_the_capture_cut_is_said_to_be_cut() -> None:
    for size in range(4, 26):
        pdu = parse_plus((framed(asked(1)) + b"wxyz")[:size], cut=True)
        assert {one.limit for one in pdu.malformed} <= {"snaplen"}
        # Behind the trailer less than a header may be the beginning of one.
        assert ("trailing_octets" in [one.reason for one in pdu.malformed]) == (size >= 26)
    assert reasons(parse_plus(framed(asked(1)) + b"wxyz", cut=True)) == [("trailing_octets", "pdu")]
    assert reasons(parse_plus(framed(asked(1)) + b"xyz", cut=True)) == []


@pytest.mark.parametrize("version", [1, 2, 3])
def test_each_frame_has_its_places(version: int) -> None:
    pieces = [asked(1), b"abc", b"d"]
    octets = b"".join([framed(piece, version, trailer=piece is pieces[-1]) for piece in pieces])
    pdu = parse_plus(octets)
    places = pdu.frame_places
    assert [octets[begin:end] for _, begin, end in places] == pieces
    assert [octets[at : at + 2] for at, _, _ in places] == [bytes((0x72, version))] * 3
    digests = [octets[begin:end] for begin, end in pdu.digest_places]
    assert digests == ([b"\x5a" * 32] * 3 if version == 3 else [])
    starts = [sum(map(len, pieces[:index])) for index in range(3)]
    assert pdu.frame_starts == {starts[1]: places[1][1], starts[2]: places[2][1]}
    assert (pdu.place(0), pdu.data_offset, pdu.integrity) == (
        places[0][1],
        places[0][1],
        digests[0] if digests else b"",
    )
    for cut in range(len(octets)):
        found = parse_plus(octets[:cut]).frame_places
        assert [one for one in found if one[2] < cut] == [one for one in places if one[2] < cut]
        assert all([at <= begin <= end <= cut or cut < 4 for at, begin, end in found])


def test_a_digest_without_octets_has_no_place() -> None:
    pdu = parse_plus(b"\x72\3\0\x0f\0" + asked(1) + b"\x72\3\0\0")
    assert (pdu.data, pdu.digest_places, pdu.integrity) == (asked(1), [], b"")
    assert reasons(pdu) == [("bad_value", "digest_length")]


def test_of_two_empty_frames_in_a_row_the_second_is_the_trailer() -> None:
    empty = b"\x72\2\0\0"
    first, last = framed(asked(1), trailer=False), framed(b"rest")
    for octets, frames, data, surplus in (
        (first + empty, 1, asked(1), 0),
        (first + empty + empty, 2, asked(1), 0),
        (first + empty + last, 1, asked(1), len(last)),
        (first + empty + empty + last, 2, asked(1), len(last)),
        (empty + first + empty, 2, asked(1), 0),
        (empty + empty + last, 1, b"", len(last)),
    ):
        pdu = parse_plus(octets)
        assert (pdu.frames, pdu.data, pdu.whole) == (frames, data, True)
        places = [fact.offset for fact in pdu.malformed if fact.field == "pdu"]
        assert places == ([len(octets) - surplus] if surplus else [])


def test_how_a_pdu_is_called() -> None:
    said = [
        (framed(asked(7)), "Request", "GetMultiVariables, sequence 7"),
        (framed(told(7, 0x1234)), "Response", "0x1234, sequence 7"),
        (framed(told(7, 0)), "Response", "0x0000, sequence 7"),
        (framed(notified(7)), "Notification", "-, sequence 7"),
        (framed(b"\x44abc"), "0x44", "-, sequence -1"),
        (event(5), "system event", "-, sequence -1"),
        (KEEP_ALIVE, "keep-alive", "-, sequence -1"),
        (b"\x72\2", "?", "-, sequence -1"),
    ]
    for octets, kind, text in said:
        pdu = parse_plus(octets, 3)
        assert (pdu.kind, repr(pdu)) == (kind, f"PlusPdu({kind}, {text}, packet 3)")


@pytest.mark.parametrize(
    ("octets", "layout"),
    [
        (framed(asked(1)), layouts.REQUEST),
        (framed(told(1)), layouts.RESPONSE),
        (framed(told(1, opcode=2)), layouts.RESPONSE),
        (framed(notified()), layouts.NOTIFICATION),
        (framed(notified(), 1), layouts.NOTIFICATION_V1),
        (event(1), layouts.EVENT),
        (framed(b"\x44abc"), None),
        (KEEP_ALIVE, None),
        (b"\x72", None),
    ],
)
def test_the_fixed_part_of_each_kind(octets: bytes, layout: object) -> None:
    assert fixed_part(parse_plus(octets)) is layout


def test_which_messages_want_a_response() -> None:
    for flags, wants in ((0x34, True), (0x74, False), (0x40, False), (0x00, True), (0xBF, True), (0xFF, False)):
        assert parse_plus(framed(asked(1, flags=flags))).wants_response == wants
    assert not parse_plus(framed(notified())).wants_response
    assert parse_plus(framed(asked(1)[:-1])).wants_response  # its flags are not there to say no


def test_reserved_words_tell_a_beginning_only_of_a_function_without_a_name() -> None:
    for at in (1, 2, 5, 6):
        for function, begins in ((GET_MULTI, True), (0x9999, False)):
            data = bytearray(told(1, function))
            data[at] = 1
            assert is_beginning(parse_plus(framed(bytes(data)))) == begins
    assert is_beginning(parse_plus(framed(notified(), 1)))
    assert is_beginning(parse_plus(framed(notified()[:3], 1)))
    assert not is_beginning(parse_plus(framed(notified()[:3], 2)))
