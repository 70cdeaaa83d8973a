"""The head of a PDU that is read in place says what the PDU that is parsed says."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.plain import Head, data_of, one_frame
from dissect.protocols.s7plus.tables import EXPLORE, GET_MULTI_VARIABLES
from dissect.wire.varint import VLQ64, build_varint
from tests.cases import each
from tests.protocols.s7plus.bodies import number
from tests.protocols.s7plus.pdus import KEEP_ALIVE, asked, event, framed, notified, told

SMALL = st.binary(max_size=12)
FUNCTION_CODES = st.sampled_from([GET_MULTI_VARIABLES, EXPLORE, 0x9999])
DATA = st.one_of(
    st.builds(lambda number, function, body, flags: asked(number, function, flags, body=body),
              st.integers(0, 65535), FUNCTION_CODES, SMALL, st.sampled_from([0x34, 0x74])),
    st.builds(told, st.integers(0, 65535), FUNCTION_CODES, SMALL),
    st.builds(lambda subscription, rest: notified(subscription=subscription) + rest,
              st.sampled_from([0x386, 0x70000E51]), SMALL),
    st.binary(max_size=30),
)  # fmt: skip
#: What becomes of the octets: some are lost at the end, and one is another.
DAMAGE = st.tuples(st.integers(0, 20), st.integers(0, 60), st.integers(0, 255))


def facts(octets: bytes) -> tuple[list[object], list[object]]:
    """What is read in place, and what the parsed PDU says; the second twice for what is no plain PDU."""
    pdu = parse_plus(octets)
    head = Head()
    parsed: list[object] = [
        pdu.version, pdu.frames, pdu.opcode, pdu.function, pdu.sequence, pdu.subscription_id, pdu.wants_response,
    ]  # fmt: skip
    if not head.read_plain(octets):
        other = Head()
        other.take(pdu)
        assert (other.frames, other.sequence, other.wants_response) == (pdu.frames, pdu.sequence, pdu.wants_response)
        return parsed, parsed
    assert pdu.whole
    assert not pdu.malformed
    assert octets[head.at : head.end] == pdu.data
    taken = Head()
    taken.take(pdu)
    assert (head.begins, head.return_code(octets)) == (taken.begins, pdu.return_code)
    numbers = [head.version, head.frames, head.opcode, head.function, head.sequence, head.subscription_id]
    return [*numbers, head.wants_response], parsed


@given(DATA, st.sampled_from([1, 2, 3]), st.booleans(), DAMAGE)
def test_a_head_in_place_is_that_of_the_pdu(
    data: bytes, version: int, sound: bool, damage: tuple[int, int, int]
) -> None:
    octets = framed(data, version)
    if not sound:
        lost, at, other = damage
        octets = octets[: len(octets) - lost]
        octets = octets[:at] + bytes((other,)) + octets[at + 1 :] if at < len(octets) else octets
    found, parsed = facts(octets)
    assert found == parsed


def test_plain_pdus_are_read_in_place() -> None:
    for data in (asked(1), told(1), notified(), notified(subscription=0x386)):
        for version in (2, 3):
            assert Head().read_plain(framed(data, version)), data.hex()
    for octets in (b"", b"\x72", KEEP_ALIVE, event(5), framed(asked(1), trailer=False), framed(b"")):
        assert not Head().read_plain(octets), octets.hex()


@each("value", [0, 1, 127, 128, 129, 255, 16_383, 16_384, 16_511, 2_097_151, 2_097_152, 2**28, 2**32 - 1])
def test_numbers_of_notifications_and_return_values_of_any_length(value: int) -> None:
    """Whole, cut off behind each of their octets, and with anything behind them: in place as in the PDU that is parsed."""
    long = notified()[:-3]
    for written in (number(value), number(value) + b"\x01\0", number(value) + b"\xff"):
        for cut in range(len(number(value)) + 1):
            for data in (long + written, long + written[:cut]):
                found, parsed = facts(framed(data, 2))
                assert found == parsed, (value, cut)
    head = Head()
    assert head.read_plain(framed(long + number(value) + b"\x01\0", 2))
    assert head.sequence == value
    for written in (build_varint(value, VLQ64), build_varint(value, VLQ64)[:-1], build_varint(value, VLQ64) + b"\x80"):
        found, parsed = facts(framed(told(1, body=written), 2))
        assert found == parsed, value


#: Messages of each kind, with numbers that fill their fields.
KINDS = [
    asked(0xFEDC, session=0x89ABCDEF, flags=0xFF),
    asked(0xFEDC, session=0x89ABCDEF, flags=0xBF),
    asked(1, 0x9999),
    told(0xFEDC),
    told(0xFEDC, 0x9999),
    told(1, body=b"\x81\xff\x74"),
    told(1, opcode=2),
    notified(5, 0x70000000),
    notified(5, 0x6FFFFFFF),
    notified(5, 0xFFFFFFFF)[:-3] + number(300) + b"\1\0",
    b"\x44" + bytes(20),
]


@each("version", [0, 1, 2, 3, 4, 0xFE, 0xFF])
def test_whatever_is_wrong_with_a_message_its_head_is_that_of_the_pdu(version: int) -> None:
    """Cut off or longer, or with another octet: in its header, its head, and its trailer."""
    for data in KINDS:
        octets = framed(data, version)
        begin = len(octets) - len(data) - 4
        for cut in range(len(octets)):
            found, parsed = facts(octets[:cut])
            assert found == parsed, (data, cut)
        for size in range(len(data)):
            found, parsed = facts(framed(data[:size], version))
            assert found == parsed, (data, size)
        for behind in (b"\0", b"\x72", bytes(4), octets[-4:]):
            found, parsed = facts(octets + behind)
            assert found == parsed, (data, behind)
        for at in sorted(
            {*range(5), *range(begin, min(begin + 16, len(octets))), *range(len(octets) - 4, len(octets))}
        ):
            for octet in {0, 1, 3, 0x72, 0x7F, 0x80, 0xFF, octets[at] ^ 1, octets[at] ^ 0x40}:
                changed = octets[:at] + bytes((octet,)) + octets[at + 1 :]
                found, parsed = facts(changed)
                assert found == parsed, (data, at, octet)


@each("version", [1, 2, 3])
def test_the_data_of_a_message_are_found_in_any_frames(version: int) -> None:
    for octets in (
        framed(asked(1), version),
        framed(asked(1), version, trailer=False),
        framed(asked(1), version, trailer=False) + framed(b"more", version),
        framed(b"", version),
        framed(b"\x31", version),
        framed(asked(1), version)[:20],
        framed(asked(1), version) + b"behind",
        framed(asked(1), 9),
    ):
        buffer, at, end = data_of(octets)
        assert buffer[at:end] == parse_plus(octets).data
    assert data_of(framed(asked(1), version))[0] == framed(asked(1), version)  # not copied
    for octets in (b"", b"\x72", KEEP_ALIVE):
        assert data_of(octets) == (b"", 0, 0)


def test_one_frame_with_its_trailer_is_taken_as_it_is() -> None:
    for version, at in ((1, 4), (2, 4), (3, 37)):
        assert one_frame(framed(b"\x31", version)) == (at, at + 1)
        for wrong in (
            framed(b"\x31", version, trailer=False),
            framed(b"\x31", version)[:-1],
            framed(b"\x31", version) + b"\0",
            b"\x73" + framed(b"\x31", version)[1:],
            framed(b"\x31", version)[:-4] + b"\x72" + bytes((version ^ 3, 0, 0)),
            framed(b"\x31", version)[:-4] + b"\x72" + bytes((version, 0, 1)),
        ):
            assert one_frame(wrong) == (-1, -1)
    assert one_frame(framed(b"\x31", 3).replace(b"\x20\x5a", b"\x1f\x5a")) == (-1, -1)
    assert one_frame(b"\x72\3\0\x20" + bytes(32) + b"\x72\3\0\0") == (-1, -1)  # a digest without its last octet
    for version in (0, 4, 0xFE, 0xFF):
        assert one_frame(framed(b"\x31", version)) == (-1, -1)
    # The frame says that it is longer, or shorter, than it is.
    assert one_frame(b"\x72\2\0\2\x31\x72\2\0\0") == one_frame(b"\x72\2\0\0\x31\x72\2\0\0") == (-1, -1)


NAMES = (
    "at", "begins", "end", "frames", "function", "opcode", "sequence", "subscription_id", "version", "wants_response",
)  # fmt: skip


def test_a_head_keeps_nothing_of_the_message_before() -> None:
    head = Head()
    assert (head.begins, head.wants_response, head.sequence, head.version, head.frames) == (False, False, -1, -1, 0)
    assert (head.opcode, head.function, head.subscription_id) == (-1, -1, -1)
    for data in KINDS[:-1]:
        if head.read_plain(framed(data, 2)):
            once = Head()
            assert once.read_plain(framed(data, 2))
            for name in NAMES:
                assert getattr(head, name) == getattr(once, name), (data, name)


def test_the_return_value_is_one_of_a_response_with_a_name() -> None:
    for data, code in (
        (told(1, body=b"\x13"), 0x13),
        (told(1, body=b"\xff" * 8 + b"\xf4"), 0xFFF4),
        (told(1, body=b"\x84\x80\0"), 0),  # only the lower 16 bits count
        (told(1, body=b"\x80"), -1),
        (told(1, body=b""), -1),
        (told(1, 0x9999, b"\x13"), -1),
        (told(1, body=b"\x13", opcode=2), 0x13),
        (asked(1, body=b"\x13"), -1),
        (notified(0x13), -1),
    ):
        for version in (2, 3):
            head = Head()
            octets = framed(data, version)
            assert head.read_plain(octets)
            assert head.return_code(octets) == code
            assert parse_plus(octets).return_code == code
