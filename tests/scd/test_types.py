"""R19-R55: every type, its index, its width, the values it takes. Texts of tests name the requirement."""

from __future__ import annotations

import math
from ipaddress import IPv4Address

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.scd.errors import ERROR_TEXTS, Error
from dissect.scd.types import MAX_OCTETS, STANDARD, STANDARD_NAMES, VOID, Kind, integer, reserved, width_trouble
from dissect.scd.values import MAC, Interval, NetTime
from tests.cases import each


def code_of(call: object, *arguments: object) -> str:
    assert callable(call)
    with pytest.raises(Error) as caught:
        call(*arguments)
    return caught.value.code


@pytest.mark.requirement(
    "R19",
    "R29",
    "R30",
    "R35",
    "R36",
    "R38",
    "R39",
    "R40",
    "R42",
    "R43",
    "R44",
    "R45",
    "R46",
    "R47",
    "R48",
    "R49",
    "R50",
    "R51",
    "R52",
    "R53",
    "R55",
)
@pytest.mark.parametrize(
    ("name", "index", "kind", "bits"),
    [
        pytest.param("bool", 1, Kind.BOOL, 1, id="R29-R30"),
        pytest.param("int8", 2, Kind.INT, 8, id="R38-int8"),
        pytest.param("int16", 3, Kind.INT, 16, id="R38-int16"),
        pytest.param("int32", 4, Kind.INT, 32, id="R38-int32"),
        pytest.param("uint8", 5, Kind.UINT, 8, id="R36-uint8"),
        pytest.param("uint16", 6, Kind.UINT, 16, id="R36-uint16"),
        pytest.param("uint32", 7, Kind.UINT, 32, id="R36-uint32"),
        pytest.param("float32", 8, Kind.REAL, 32, id="R39"),
        pytest.param("string", 10, Kind.STRING, 0, id="R42"),
        pytest.param("interval", 13, Kind.INTERVAL, 64, id="R44"),
        pytest.param("block", 15, Kind.BLOCK, 0, id="R53"),
        pytest.param("float64", 17, Kind.REAL, 64, id="R40"),
        pytest.param("int64", 21, Kind.INT, 64, id="R55-int64"),
        pytest.param("uint64", 27, Kind.UINT, 64, id="R55-uint64"),
        pytest.param("mac", 0x401, Kind.MAC, 48, id="R45"),
        pytest.param("ip", 0x402, Kind.IP, 32, id="R46"),
        pytest.param("nettime", 0x403, Kind.NETTIME, 64, id="R43"),
        pytest.param("scd_sca_t", 5, Kind.UINT, 8, id="R47"),
        pytest.param("scd_port_t", 5, Kind.UINT, 8, id="R48"),
        pytest.param("scd_crc_t", 6, Kind.UINT, 16, id="R49"),
        pytest.param("scd_size_t", 6, Kind.UINT, 16, id="R50"),
        pytest.param("scd_protocol_t", 5, Kind.UINT, 8, id="R51"),
        pytest.param("scd_err_t", 2, Kind.INT, 8, id="R52"),
        pytest.param("scd_uint32_t", 7, Kind.UINT, 32, id="R35-R36"),
        pytest.param("scd_int32_t", 4, Kind.INT, 32, id="C14"),
        pytest.param("scd_float_t", 8, Kind.REAL, 32, id="R39-name"),
        pytest.param("scd_double_t", 17, Kind.REAL, 64, id="R40-name"),
    ],
)
def test_standard_types(name: str, index: int, kind: Kind, bits: int) -> None:
    row = STANDARD[STANDARD_NAMES[name]]
    assert (row.index, row.kind, row.bits) == (index, kind, bits)


@pytest.mark.requirement("R55")
def test_the_table_has_no_other_index() -> None:
    assert sorted(STANDARD) == [1, 2, 3, 4, 5, 6, 7, 8, 10, 13, 15, 17, 21, 27, 1025, 1026, 1027]


@pytest.mark.requirement("R21", "R28")
def test_void_is_no_bits() -> None:
    """The empty sequence; C11: Void is Reserved 0."""
    assert (VOID.bits, VOID.index, VOID.kind) == (0, 0, Kind.RESERVED)
    assert reserved(0) is VOID


@pytest.mark.requirement("R31", "R33")
@pytest.mark.parametrize("bits", [1, 6, 64, 300])
def test_reserved_has_bits_and_no_value(bits: int) -> None:
    assert reserved(bits).bits == bits
    assert code_of(reserved(bits).check, 0) == "E_VALUE"


@pytest.mark.requirement("R20", "R34")
@each("bits", range(1, 65))
def test_every_unsigned_width(bits: int) -> None:
    """0..2^N-1."""
    kind = integer(bits, signed=False)
    assert [kind.check(0), kind.check(2**bits - 1)] == [0, 2**bits - 1]
    assert [code_of(kind.check, -1), code_of(kind.check, 2**bits)] == ["E_RANGE", "E_RANGE"]


@pytest.mark.requirement("R37")
@each("bits", range(1, 65))
def test_every_integer_width(bits: int) -> None:
    """-2^(N-1)..2^(N-1)-1."""
    kind = integer(bits, signed=True)
    half = 2 ** (bits - 1)
    assert [kind.check(-half), kind.check(half - 1)] == [-half, half - 1]
    assert [code_of(kind.check, -half - 1), code_of(kind.check, half)] == ["E_RANGE", "E_RANGE"]


@pytest.mark.parametrize("bits", [0, 65, -1])
def test_no_other_width(bits: int) -> None:
    """C15: N is at most 64."""
    with pytest.raises(Error):
        integer(bits, signed=False)
    assert width_trouble(Kind.INT, bits)


@pytest.mark.requirement("R29")
@pytest.mark.parametrize("value", [0, 1, 2, "true", None, 1.0])
def test_boolean_takes_only_booleans(value: object) -> None:
    assert STANDARD[1].check(True) is True
    assert STANDARD[1].check(False) is False
    assert code_of(STANDARD[1].check, value) == "E_VALUE"


@pytest.mark.parametrize("value", [1.5, "1", True, None, b"1"])
def test_a_number_is_a_number(value: object) -> None:
    assert code_of(STANDARD[3].check, value) == "E_RANGE"


@pytest.mark.requirement("R41")
@pytest.mark.parametrize(
    ("bits", "value"),
    [(32, math.inf), (64, -math.inf), (32, 1e39), (32, 3.4028235677973366e38), (64, 10**400), (32, "1"), (64, True)],
)
def test_reals_are_finite(bits: int, value: object) -> None:
    """C17."""
    assert code_of(STANDARD[8 if bits == 32 else 17].check, value) == "E_RANGE"


@pytest.mark.requirement("R39", "R40", "R41")
def test_reals_that_are_values() -> None:
    """Finite, zero included, or NaN."""
    assert STANDARD[8].check(3.4028235677973362e38) == 3.4028235677973362e38
    assert STANDARD[17].check(1.7976931348623157e308) == 1.7976931348623157e308
    assert math.copysign(1, STANDARD[8].check(-0.0)) == -1  # type: ignore[arg-type]
    assert math.isnan(STANDARD[8].check(math.nan))  # type: ignore[arg-type]
    assert STANDARD[8].check(1) == 1.0


@pytest.mark.requirement("R42")
@pytest.mark.parametrize(
    ("value", "octets", "code"),
    [
        ("Насос", 9, "E_LENGTH"),
        ("A\0", 9, "E_VALUE"),
        (b"A", 9, "E_VALUE"),
        ("\ud800", 9, "E_UTF8"),
        ("a" * (MAX_OCTETS + 1), 0, "E_LENGTH"),
    ],
)
def test_strings_that_do_not_fit(value: object, octets: int, code: str) -> None:
    """C18, C19: the length is that of the octets."""
    assert STANDARD[10].check("Насос", 80) == "Насос"
    assert code_of(STANDARD[10].check, value, 8 * octets) == code


@pytest.mark.requirement("R53", "R54")
def test_blocks() -> None:
    """Any octets; of a declared size exactly."""
    assert STANDARD[15].check(b"\xff\0") == b"\xff\0"
    assert STANDARD[15].check(bytearray(b"ab"), 16) == b"ab"
    assert code_of(STANDARD[15].check, b"a", 16) == "E_LENGTH"
    assert code_of(STANDARD[15].check, "ab", 16) == "E_VALUE"


@pytest.mark.requirement("R43")
def test_network_time() -> None:
    """C21."""
    kind = STANDARD[1027]
    time = kind.check("2015-10-18T00:00:00.123456789Z")
    assert time == NetTime(0x5622E100, 123456789)
    assert str(time) == "2015-10-18T00:00:00.123456789Z"
    assert kind.check((2**31 - 1, 999999999)) == NetTime(2**31 - 1, 999999999)
    assert str(NetTime(2**31 - 1, 0)) == "2038-01-19T03:14:07.000000000Z"
    assert str(NetTime(-1, 0)) == "1969-12-31T23:59:59.000000000Z"
    for wrong in ((2**31, 0), (0, 10**9), (0, -1), (0.5, 0)):
        assert code_of(kind.check, wrong) == "E_RANGE"
    for nonsense in ("yesterday", 5, (1, 2, 3), Interval(1, 1), "2015-10-18T00:00:00.1234567891Z"):
        assert code_of(kind.check, nonsense) == "E_VALUE"


@pytest.mark.requirement("R44")
def test_interval() -> None:
    """C22: the difference of each field; from one number both have its sign."""
    kind = STANDARD[13]
    assert kind.check(Interval(1, -1)).total_ns == 999999999  # type: ignore[union-attr]
    assert Interval.from_ns(-1_500_000_000) == Interval(-1, -500_000_000)
    assert NetTime(5, 1).minus(NetTime(4, 2)) == Interval(1, -1)
    assert str(Interval(-1, -500_000_000)) == "-PT1.500000000S"
    assert code_of(kind.check, (0, 10**9)) == "E_RANGE"
    assert code_of(kind.check, NetTime(0, 0)) == "E_VALUE"


@given(st.integers(-(2**31) * 10**9, (2**31 - 1) * 10**9))
def test_times_keep_their_nanoseconds(total: int) -> None:
    assert NetTime.from_ns(total).total_ns == Interval.from_ns(total).total_ns == total
    assert NetTime.from_isoformat(NetTime.from_ns(total).isoformat()).total_ns == total


@pytest.mark.requirement("R45", "R46")
def test_addresses() -> None:
    """C24."""
    mac = STANDARD[0x401].check("00:1B:44:11:3A:B7")
    assert (mac, str(mac)) == (MAC(b"\x00\x1b\x44\x11\x3a\xb7"), "00:1B:44:11:3A:B7")
    assert STANDARD[0x402].check("192.168.100.1") == IPv4Address("192.168.100.1")
    for wrong in ("00:1B:44:11:3A", "00:1B:44:11:3A:GG", b"12345", 5):
        assert code_of(STANDARD[0x401].check, wrong) == "E_VALUE"
    for wrong in ("1.2.3", "::1", b"123", 5):
        assert code_of(STANDARD[0x402].check, wrong) == "E_VALUE"


@pytest.mark.requirement("R47", "R48", "R51", "R52")
def test_small_aliases_hold_one_octet() -> None:
    """C25: a port of this stack has 8 bits."""
    port = STANDARD[STANDARD_NAMES["scd_port_t"]]
    assert port.check(200) == 200
    assert code_of(port.check, 502) == "E_RANGE"
    assert STANDARD[STANDARD_NAMES["scd_err_t"]].check(-1) == -1
    assert STANDARD[STANDARD_NAMES["scd_size_t"]].check(258) == 258


@pytest.mark.requirement("R52")
def test_error_numbers_fit_their_type() -> None:
    """C28."""
    for number in ERROR_TEXTS:
        assert STANDARD[2].check(number) == number
    assert sorted(ERROR_TEXTS) == list(range(-21, 1))
