from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import bitstruct
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.scd import packing
from dissect.scd.errors import Error
from dissect.scd.layout import Slot
from dissect.scd.packing import Packing, decode_value, encode_value
from dissect.scd.types import STANDARD, STANDARD_NAMES, Kind, SimpleType, Value, integer
from dissect.scd.values import MAC, Interval, NetTime
from tests.cases import each
from tests.scd import making
from tests.scd.making import (
    BLOCK,
    BOOL,
    FLOAT32,
    INT8,
    INT16,
    INTERVAL,
    IP_T,
    MAC_T,
    NETTIME,
    STRING,
    UINT8,
    UINT32,
    code,
    keyed,
)


def sent(kind: SimpleType, value: object, bits: int = 0) -> str:
    return encode_value(kind, value, bits=bits).hex(" ").upper()


def received(kind: SimpleType, octets: str, bits: int = 0) -> tuple[Value, packing.Flags]:
    flags: packing.Flags = {}
    return decode_value(kind, bytes.fromhex(octets), flags, bits=bits), flags


@pytest.mark.requirement("R35", "R36", "R38", "R47", "R51", "R53", "R54")
@pytest.mark.parametrize(
    ("kind", "bits", "value", "octets"),
    [
        (STANDARD[STANDARD_NAMES["scd_sca_t"]], 0, 255, "FF"),
        (STANDARD[STANDARD_NAMES["scd_protocol_t"]], 0, 0xDC, "DC"),
        (STANDARD[STANDARD_NAMES["scd_uint64_t"]], 0, 2**64 - 1, "FF FF FF FF FF FF FF FF"),
        (STANDARD[STANDARD_NAMES["scd_int32_t"]], 0, -(2**31), "00 00 00 80"),
        (STANDARD[BLOCK], 24, b"\x00\x01\xff", "00 01 FF"),
    ],
)
def test_values_that_no_worked_example_has(kind: SimpleType, bits: int, value: object, octets: str) -> None:
    assert sent(kind, value, bits) == octets
    assert received(kind, octets, bits) == (value, {})


@pytest.mark.requirement("R29", "R34", "R37", "R39", "R42", "R43", "R44", "R45", "R46", "R53")
@pytest.mark.parametrize(
    ("kind", "bits", "value", "wanted"),
    [
        (STANDARD[INT8], 0, 128, "E_RANGE"),
        (STANDARD[UINT8], 0, 502, "E_RANGE"),
        (STANDARD[UINT8], 0, -1, "E_RANGE"),
        (STANDARD[INT16], 0, "12", "E_RANGE"),
        (STANDARD[FLOAT32], 0, "1.5", "E_RANGE"),
        (STANDARD[BOOL], 0, 1, "E_VALUE"),
        (STANDARD[STRING], 72, "Насос", "E_LENGTH"),
        (STANDARD[STRING], 64, "A\0", "E_VALUE"),
        (STANDARD[STRING], 64, "\ud800", "E_UTF8"),
        (STANDARD[STRING], 64, b"A", "E_VALUE"),
        (STANDARD[BLOCK], 16, b"A", "E_LENGTH"),
        (STANDARD[NETTIME], 0, (0, 10**9), "E_RANGE"),
        (STANDARD[NETTIME], 0, (2**31, 0), "E_RANGE"),
        (STANDARD[INTERVAL], 0, (0, -(10**9)), "E_RANGE"),
        (STANDARD[MAC_T], 0, "00:1B:44", "E_VALUE"),
        (STANDARD[IP_T], 0, "1.2.3.400", "E_VALUE"),
    ],
)
def test_values_outside_of_their_type_are_refused(kind: SimpleType, bits: int, value: object, wanted: str) -> None:
    with pytest.raises(Error) as error:
        encode_value(kind, value, bits=bits)
    assert code(error) == wanted


@pytest.mark.parametrize(
    ("kind", "bits", "octets", "wanted"),
    [
        (STANDARD[UINT32], 0, "01 02 03", "E_SHORT"),
        (STANDARD[UINT32], 0, "", "E_SHORT"),
        (STANDARD[BOOL], 0, "01 00", "E_LONG"),
        (STANDARD[STRING], 16, "41 42 43", "E_LENGTH"),
        (STANDARD[BLOCK], 16, "41", "E_LENGTH"),
        (STANDARD[STRING], 0, "C0 80", "E_UTF8"),
        (STANDARD[STRING], 0, "ED A0 80", "E_UTF8"),
        (STANDARD[STRING], 0, "D0", "E_UTF8"),
    ],
)
def test_octets_that_are_no_value(kind: SimpleType, bits: int, octets: str, wanted: str) -> None:
    with pytest.raises(Error) as error:
        received(kind, octets, bits)
    assert code(error) == wanted
    if wanted == "E_UTF8":
        assert octets.lower() in error.value.detail  # the raw octets are kept for display


def test_c19_a_text_may_be_shorter_than_declared_and_of_any_length_without_declaration() -> None:
    assert received(STANDARD[STRING], "41 42", 64)[0] == "AB"
    assert sent(STANDARD[STRING], "AB") == "41 42"
    assert received(STANDARD[STRING], "")[0] == ""
    assert received(STANDARD[BLOCK], "00 00")[0] == b"\0\0"


@pytest.mark.requirement("R43")
def test_r43_nanoseconds_out_of_range_are_shown_and_flagged() -> None:
    assert received(STANDARD[NETTIME], "00 00 00 00 00 CA 9A 3B") == (NetTime(0, 10**9), {"time_ns_range": ("",)})
    assert received(STANDARD[NETTIME], "00 00 00 00 FF FF FF FF")[1] == {"time_ns_range": ("",)}
    assert received(STANDARD[INTERVAL], "00 00 00 00 FF FF FF FF") == (Interval(0, -1), {})
    assert received(STANDARD[INTERVAL], "00 00 00 00 00 36 65 C4")[1] == {"time_ns_range": ("",)}


def _values(kind: SimpleType, bits: int) -> st.SearchStrategy[Any]:
    seconds = st.integers(-(2**31), 2**31 - 1)
    return {
        Kind.BOOL: st.booleans,
        Kind.INT: lambda: st.integers(-(1 << bits - 1), (1 << bits - 1) - 1),
        Kind.UINT: lambda: st.integers(0, (1 << bits) - 1),
        Kind.REAL: lambda: st.floats(width=32 if bits == 32 else 64, allow_infinity=False),
        Kind.STRING: lambda: st.text(max_size=bits // 8).filter(
            lambda text: len(text.encode()) <= bits // 8 and not text.endswith("\0")
        ),
        Kind.BLOCK: lambda: st.binary(min_size=bits // 8, max_size=bits // 8),
        Kind.NETTIME: lambda: st.builds(NetTime, seconds, st.integers(0, 999_999_999)),
        Kind.INTERVAL: lambda: st.builds(Interval, seconds, st.integers(-999_999_999, 999_999_999)),
        Kind.MAC: lambda: st.builds(MAC, st.binary(min_size=6, max_size=6)),
        Kind.IP: lambda: st.ip_addresses(v=4),
    }[kind.kind]()


@st.composite
def layouts(draw: st.DrawFn) -> list[Slot]:
    kinds = [*STANDARD.values(), *(integer(bits, signed=signed) for bits in range(1, 65) for signed in (True, False))]
    slots, at = [], draw(st.integers(0, 9))
    for number in range(draw(st.integers(1, 10))):
        kind = draw(st.sampled_from(kinds))
        bits = kind.bits or 8 * draw(st.integers(1, 6))
        slots.append(Slot(str(number), kind, bits, at, str(number)))
        at += bits + draw(st.sampled_from((0, 0, 0, 1, 7, 8)))
        if draw(st.booleans()):
            at += -at % 8
    return slots


def _same(one: Any, other: Any) -> bool:
    return type(one) is type(other) and (one == other or (one != one and other != other))  # noqa: PLR0124


@pytest.mark.requirement("R20", "R22", "R23", "R24", "R25")
@given(layouts(), st.data())
def test_decode_after_encode_is_the_same_with_each_engine(slots: list[Slot], data: st.DataObject) -> None:
    values = [data.draw(_values(slot.type, slot.bits)) for slot in slots]
    end = slots[-1].offset + slots[-1].bits
    fast = Packing(slots, end, "fast")
    plain = Packing(slots, end, "plain", compiler=bitstruct.compile)
    octets = fast.pack(values)
    assert len(octets) == fast.size == (end + 7) // 8
    assert plain.pack(values) == octets
    # Bits by arithmetic alone, for what is a number: bit i of a number at offset o is bit o + i of the payload (R20, R23).
    whole = int.from_bytes(octets, "little")
    for slot, value in zip(slots, values, strict=True):
        if slot.type.kind in {Kind.BOOL, Kind.INT, Kind.UINT}:
            assert whole >> slot.offset & ((1 << slot.bits) - 1) == value & ((1 << slot.bits) - 1)
    for engine in (fast, plain):
        flags: packing.Flags = {}
        found = engine.unpack(octets, flags, strict_pad=True)
        assert flags == {}
        assert all(_same(one, other) for one, other in zip(found, values, strict=True)), (found, values)


@given(layouts(), st.data())
def test_any_octets_decode_or_raise_an_error_of_ours(slots: list[Slot], data: st.DataObject) -> None:
    end = slots[-1].offset + slots[-1].bits
    engine = Packing(slots, end, "any")
    octets = data.draw(st.binary(min_size=engine.size, max_size=engine.size))
    told: object
    flags: packing.Flags = {}
    try:
        told = len(engine.unpack(octets, flags, strict_pad=True))
    except Error as error:
        told = error.code
    assert told in {len(slots), "E_UTF8"}
    assert engine.odd(octets, strict_pad=True) == bool(flags)
    assert engine.odd(octets) == bool(flags.keys() - {packing.PAD})


def test_octets_are_odd_where_decoding_them_notices_something() -> None:
    for first, second in ((0, 16), (3, 19)):  # on whole bytes, and not
        slots = [
            Slot("level", STANDARD[INT16], 16, first, "level", low=-10, high=100),
            Slot("speed", STANDARD[FLOAT32], 32, second, "speed"),
        ]
        engine = Packing(slots, second + 32, "limits", enforce=False)
        for level, speed, odd in ((100, 1.5, False), (-10, -0.0, False), (101, 1.5, True), (-11, 1.5, True)):
            octets = engine.pack([level, speed])
            flags: packing.Flags = {}
            engine.unpack(octets, flags)
            assert engine.odd(octets) is odd is bool(flags), (first, level)
        whole = int.from_bytes(engine.pack([5, 0.0]), "little") | 0x7F800000 << second
        assert engine.odd(whole.to_bytes(engine.size, "little"))  # infinite


def test_without_the_c_extension_the_python_form_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "bitstruct.c", None)
    monkeypatch.delattr(bitstruct, "c", raising=False)
    assert packing.bit_engine() is bitstruct.compile
    codec = making.pdo(BOOL, FLOAT32)
    assert codec.encode("T1", keyed([True, 1.0])).hex(" ") == "01 00 00 7f 00"


def test_big_endian_machines_get_the_python_form(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "byteorder", "big")
    assert packing.bit_engine() is bitstruct.compile


@pytest.mark.parametrize(
    ("slots", "bits"),
    [
        ([Slot("a", STANDARD[UINT8], 8, 0, "a"), Slot("b", STANDARD[UINT8], 8, 7, "b")], 16),
        ([Slot("a", STANDARD[UINT8], 8, 1, "a")], 8),
        ([Slot("a", STANDARD[STRING], 0, 0, "a")], 8),
    ],
)
def test_places_that_cannot_be(slots: list[Slot], bits: int) -> None:
    with pytest.raises(Error) as error:
        Packing(slots, bits, "x")
    assert code(error) == "E_MAP"


@pytest.mark.requirement("R22", "R25")
@each("bits", range(1, 65))
def test_r22_r25_n_bits_travel_in_k_octets(bits: int) -> None:
    octets = encode_value(integer(bits, signed=False), (1 << bits) - 1)
    assert 8 * (len(octets) - 1) < bits <= 8 * len(octets)
    assert int.from_bytes(octets, "little") == (1 << bits) - 1
    for number in (-(1 << bits - 1), (1 << bits - 1) - 1):  # R37: two's complement, nothing above the sign
        signed = encode_value(integer(bits, signed=True), number)
        assert int.from_bytes(signed, "little") == number & ((1 << bits) - 1)
        assert decode_value(integer(bits, signed=True), signed, {}) == number


@pytest.mark.requirement("R21", "R28")
def test_r21_r28_void_has_no_bits_and_no_value() -> None:
    void = SimpleType(0, "void", Kind.RESERVED, 0)
    empty = Packing([Slot("a", void, 0, 0, "a")], 0, "x")
    assert (empty.size, empty.pack([]), list(empty.unpack(b"", {}))) == (0, b"", [])


def test_octets_do_not_hang_on_the_hash_seed() -> None:
    program = (
        "from tests.scd import making as m; c = m.pdo(*[m.BOOL, m.UINT12, m.FLOAT32, (m.STRING, 24)] * 3);"
        "print(c.encode('T1', m.keyed([True, 5, 1.5, 'a'] * 3)).hex(), list(c.decode('T1', bytes(30)).values))"
    )
    root = str(Path(__file__).resolve().parents[2])
    told = set()
    for seed in ("0", "1", "77"):
        path = os.pathsep.join(part for part in (os.environ.get("PYTHONPATH", ""), root) if part)
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": path}
        run = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        told.add(run.stdout)
    assert len(told) == 1
