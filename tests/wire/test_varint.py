from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.wire.layout import REST, Field, Layout
from dissect.wire.varint import SIGNED, SIGNED64, VLQ, VLQ64, build_varint, read_varint

BITS = {VLQ: 32, VLQ64: 64, SIGNED: 32, SIGNED64: 64}


@pytest.mark.parametrize(
    ("octets", "small", "large"),
    [
        ("", (-1, -1), (-1, -1)),
        ("7f", (127, 1), (127, 1)),
        ("8ec151", (237777, 3), (237777, 3)),
        ("8080", (-1, -1), (-1, -1)),
        ("8fffffff7f", (0xFFFFFFFF, 5), (0xFFFFFFFF, 5)),
        ("ffffffff7f", (0xFFFFFFFF, 5), (2**35 - 1, 5)),
        ("ff" * 9, (-1, -1), (2**64 - 1, 9)),
        ("ff" * 8, (-1, -1), (-1, -1)),
        ("8084808080808080ff", (-1, -1), (4 << 50 | 0xFF, 9)),
    ],
)
def test_unsigned(octets: str, small: tuple[int, int], large: tuple[int, int]) -> None:
    wire = bytes.fromhex(octets)
    assert read_varint(wire, 0, len(wire), VLQ) == small
    assert read_varint(wire, 0, len(wire), VLQ64) == large


@pytest.mark.parametrize(
    ("octets", "value"),
    [
        ("3f", 63),
        ("40", -64),
        ("7f", -1),
        ("8040", 64),
        ("ff3f", -65),
        ("87ffffff7f", 2**31 - 1),
        ("f880808000", -(2**31)),
    ],
)
def test_signed(octets: str, value: int) -> None:
    wire = bytes.fromhex(octets)
    assert read_varint(wire, 0, len(wire), SIGNED) == (value, len(wire))
    assert read_varint(wire, 0, len(wire), SIGNED64) == (value, len(wire))
    assert build_varint(value, SIGNED) == wire


def test_the_ninth_octet_has_eight_bits() -> None:
    assert read_varint(b"\xbf" + b"\xff" * 8, 0, 9, SIGNED64) == (2**63 - 1, 9)
    assert read_varint(b"\xc0" + b"\x80" * 7 + b"\0", 0, 9, SIGNED64) == (-(2**63), 9)
    assert build_varint(2**56, VLQ64) == b"\x80\xc0" + b"\x80" * 6 + b"\0"


def test_bits_beyond_32_are_dropped() -> None:
    for wire, signed, unsigned in (
        ("c080808000", 0, 0),
        ("bfffffff7f", -1, 0xFFFFFFFF),
        ("cb80808001", -1342177279, 0xB0000001),
    ):
        octets = bytes.fromhex(wire)
        assert read_varint(octets, 0, 5, SIGNED) == (signed, 5)
        assert read_varint(octets, 0, 5, VLQ) == (unsigned, 5)


@pytest.mark.parametrize("kind", [VLQ, VLQ64, SIGNED, SIGNED64])
@given(data=st.data())
def test_what_was_built_reads_back(kind: int, data: st.DataObject) -> None:
    bits = BITS[kind]
    bounds = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if kind in {SIGNED, SIGNED64} else (0, 2**bits - 1)
    value = data.draw(st.integers(*bounds))
    wire = build_varint(value, kind)
    assert len(wire) <= (5 if bits == 32 else 9)
    assert read_varint(b"x" + wire + b"tail", 1, len(wire) + 5, kind) == (value, len(wire) + 1)
    for size in range(len(wire)):
        assert read_varint(wire, 0, size, kind) == (-1, -1)
    for wrong in (bounds[0] - 1, bounds[1] + 1):
        with pytest.raises(ValueError, match=f"does not fit into {bits} bits"):
            build_varint(wrong, kind)


@given(st.binary(max_size=12), st.integers(0, 14), st.integers(0, 12), st.sampled_from(sorted(BITS)))
def test_never_raises(octets: bytes, at: int, end: int, kind: int) -> None:
    stop = min(end, len(octets))
    _, behind = read_varint(octets, at, stop, kind)
    assert behind == -1 or at < behind <= stop


def test_a_field_of_variable_size() -> None:
    layout = Layout(
        "drawn",
        "a test",
        [Field("a", 1, ""), Field("b", VLQ, ""), Field("c", 2, ""), Field("d", VLQ64, ""), Field("e", REST, "")],
    )
    assert (layout.size, layout.open) == (3, True)
    octets = bytes.fromhex("ee 05 8102 0102 7f 6162")
    assert [(value.field.name, value.value, value.octets) for value in layout.read(octets, 1)] == [
        ("a", 5, None),
        ("b", 130, None),
        ("c", 0x0102, None),
        ("d", 127, None),
        ("e", 0, b"ab"),
    ]
    assert [value.field.name for value in layout.read(octets, 1, 3)] == ["a"]
