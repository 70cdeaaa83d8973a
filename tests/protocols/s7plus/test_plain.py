"""The head of a PDU that is read in place says what the PDU that is parsed says."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.plain import Head
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
