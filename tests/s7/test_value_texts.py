from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from librt.strings import BytesWriter

from dissect.s7.singles import real_json
from dissect.s7.tables import BYTE, DINT, DWORD, INT, REAL, WORD
from dissect.s7.values import decode_value, number_texts, numbers_json, write_numbers

NUMBERS = (BYTE, WORD, INT, DWORD, DINT, REAL)


@given(st.sampled_from(NUMBERS), st.binary(max_size=40), st.integers(1, 12))
def test_texts_are_those_of_the_decoded_values(transport_size: int, octets: bytes, most: int) -> None:
    decoded = decode_value(transport_size, octets)
    values = [] if decoded is None else decoded if isinstance(decoded, list) else [decoded]
    assert number_texts(transport_size, octets, most) == [repr(value) for value in values[:most]]


@given(st.sampled_from([-1, *range(256), 256]), st.binary(max_size=40))
def test_numbers_are_written_as_json(transport_size: int, octets: bytes) -> None:
    """Both roads in either build: what is compiled writes into a buffer."""
    wanted = ""
    if transport_size in NUMBERS:
        decoded = decode_value(transport_size, octets)
        values = decoded if isinstance(decoded, list) else [] if decoded is None else [decoded]
        if transport_size == REAL:
            texts = [real_json(octets, at) for at in range(0, 4 * len(values), 4)]
        else:
            texts = [str(value) for value in values]
        wanted = ",".join(texts)
        if len(texts) > 1:
            wanted = f"[{wanted}]"
    assert numbers_json(transport_size, octets) == wanted
    out = BytesWriter()
    assert write_numbers(out, transport_size, b"\xff" + octets + b"\xff", 1, len(octets)) == (wanted != "")
    assert out.getvalue() == wanted.encode("ascii")


def test_other_sizes_have_no_texts() -> None:
    for transport_size in [-1, *range(256), 256]:
        if transport_size not in NUMBERS:
            assert number_texts(transport_size, bytes(8), 8) == []
