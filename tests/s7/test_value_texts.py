from __future__ import annotations

import json
import math

from hypothesis import given
from hypothesis import strategies as st

from dissect.s7.tables import BYTE, DINT, DWORD, INT, REAL, WORD
from dissect.s7.values import decode_value, number_json, number_texts

NUMBERS = (BYTE, WORD, INT, DWORD, DINT, REAL)


@given(st.sampled_from(NUMBERS), st.binary(max_size=40), st.integers(1, 12))
def test_texts_are_those_of_the_decoded_values(transport_size: int, octets: bytes, most: int) -> None:
    decoded = decode_value(transport_size, octets)
    values = [] if decoded is None else decoded if isinstance(decoded, list) else [decoded]
    assert number_texts(transport_size, octets, False, most) == [repr(value) for value in values[:most]]
    told = [json.loads(text) for text in number_texts(transport_size, octets, True, most)]
    wanted = [repr(value) if isinstance(value, float) and not math.isfinite(value) else value for value in values]
    assert told == wanted[:most]
    assert [type(value) for value in told] == [type(value) for value in wanted[:most]]


@given(st.sampled_from([-1, *range(256), 256]), st.binary(max_size=9))
def test_a_single_number_is_the_only_text(transport_size: int, octets: bytes) -> None:
    texts = number_texts(transport_size, octets, True, 9)
    assert number_json(transport_size, octets) == (texts[0] if len(texts) == 1 else "")


def test_other_sizes_have_no_texts() -> None:
    for transport_size in [-1, *range(256), 256]:
        if transport_size not in NUMBERS:
            assert number_texts(transport_size, bytes(8), True, 8) == []
