from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st
from librt.strings import BytesWriter

from dissect.protocols.s7.singles import real_json
from dissect.protocols.s7.tables import BYTE, DINT, DWORD, INT, REAL, WORD
from dissect.protocols.s7.values import decode_value, number_texts, numbers_json, write_numbers, write_times

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


TIMES = (0x0B, 0x0C, 0x1D)


def written_times(transport_size: int, octets: bytes) -> str:
    out = BytesWriter()
    written = write_times(out, transport_size, b"\xff" + octets + b"\xff", 1, len(octets))
    assert written == (len(out) > 0)
    return out.getvalue().decode("ascii")


@given(st.sampled_from([-1, *range(256), 256, *TIMES * 50]), st.binary(max_size=40))
def test_times_are_written_as_json(transport_size: int, octets: bytes) -> None:
    wanted = ""
    if transport_size in TIMES:
        decoded = decode_value(transport_size, octets)
        if decoded is not None or len(octets) == 2:  # two octets may be no S5TIME
            wanted = json.dumps(decoded, separators=(",", ":"))
        if len(octets) % (4 if transport_size == 0x0B else 2) or not octets:
            wanted = ""
    assert written_times(transport_size, octets) == wanted


def test_every_s5time() -> None:
    for word in range(0x10000):
        octets = word.to_bytes(2, "big")
        assert written_times(0x0C, octets) == json.dumps(decode_value(0x0C, octets))


def test_times_at_the_ends_of_units() -> None:
    for unit in (1, 1000, 60_000, 3_600_000, 86_400_000, 2**31):
        for ms in (unit - 1, unit, min(unit + 1, 2**31 - 1), -unit):
            octets = min(ms, 2**31 - 1).to_bytes(4, "big", signed=True)
            assert written_times(0x0B, octets) == json.dumps(decode_value(0x0B, octets))


def test_other_sizes_have_no_texts() -> None:
    for transport_size in [-1, *range(256), 256]:
        if transport_size not in NUMBERS:
            assert number_texts(transport_size, bytes(8), 8) == []
