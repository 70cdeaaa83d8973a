"""Whole messages: what a short way says of reads and writes is what the parts of a message say."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.files.anonymize.account import KEEP, MASK, SCRAMBLE, Account, Choices
from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.messages import plan_tsdu
from dissect.files.anonymize.rules import Rules
from dissect.protocols.s7.build import build_data_item, build_item, build_items, build_variables
from dissect.protocols.s7.tables import ACK_DATA, JOB, READ_VAR, WRITE_VAR
from tests.files.anonymize.support import KEY

#: A place of a return code that is in no value: with one a message is always cut into its parts.
NOWHERE = (-1,)

ITEM = st.tuples(st.sampled_from((0xFF, 0xFF, 0x0A)), st.sampled_from((3, 4, 5, 6, 7, 9)), st.binary(max_size=9))
PDU = st.tuples(
    st.sampled_from(((ACK_DATA, READ_VAR), (JOB, WRITE_VAR), (JOB, READ_VAR), (ACK_DATA, WRITE_VAR))),
    st.lists(ITEM, max_size=4),
)


def built(kind: tuple[int, int], items: list[tuple[int, int, bytes]]) -> bytes:
    rosctr, function = kind
    asked = build_items([build_item(4, 1, 1, 0x84, 8 * at) for at in range(len(items))]) if rosctr == JOB else b""
    if rosctr == ACK_DATA and function == WRITE_VAR:
        return build_variables(rosctr, function, len(items), b"", bytes(code for code, _, _ in items))
    data = [build_data_item(code, size, content) for code, size, content in items]
    return build_variables(
        rosctr, function, len(items), asked, build_items(data) if function != READ_VAR or rosctr != JOB else b""
    )


@given(
    PDU,
    st.sampled_from((MASK, SCRAMBLE, KEEP)),
    st.none() | st.tuples(st.integers(0, 60), st.integers(0, 255)),
    st.binary(max_size=2),
)
def test_both_ways_say_the_same(
    pdu: tuple[tuple[int, int], list[tuple[int, int, bytes]]],
    values: str,
    fault: tuple[int, int] | None,
    behind: bytes,
) -> None:
    whole = built(*pdu)
    octets = bytearray(whole + behind)
    if fault is not None and fault[0] < len(octets):
        octets[fault[0]] = fault[1]
    choices = Choices(values)
    rules = Rules(KEY, AddressMap(KEY), choices)
    plan_tsdu(whole, rules, Account())  # from here on its parameters are known
    told, others = Account(), Account()
    short = plan_tsdu(bytes(octets), rules, told)
    long = plan_tsdu(bytes(octets), Rules(KEY, AddressMap(KEY), choices), others, codes=NOWHERE)
    assert short.pieces == long.pieces
    assert told.as_dict() == others.as_dict()
