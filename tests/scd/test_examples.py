"""The worked examples of the reference, to the octet: values and PDOs (its §2), messages (its §3.3). They are kept here."""

from __future__ import annotations

import math
import struct
import sys
from datetime import UTC, datetime
from ipaddress import IPv4Address
from typing import Any, Final

import pytest

from dissect.scd.codec import Codec
from dissect.scd.errors import Error
from dissect.scd.messages import Message
from dissect.scd.packing import Flags, decode_value, encode_value
from dissect.scd.records import FieldRecord, ObjectRecord, StructRecord
from dissect.scd.source import parse_toml
from dissect.scd.types import STANDARD, STANDARD_NAMES, SimpleType, Value, integer
from dissect.scd.values import MAC, Interval, NetTime
from tests.cases import each
from tests.scd import making
from tests.scd.making import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT32,
    INTERVAL,
    IP_T,
    MAC_T,
    NETTIME,
    STRING,
    UINT4,
    UINT8,
    UINT12,
    UINT16,
    UINT32,
    WIRE,
    array,
    keyed,
    plant,
)

UNIX_2015: Final = int(datetime(2015, 10, 18, tzinfo=UTC).timestamp())
UINT10: Final = integer(10, signed=False)
INT10: Final = integer(10, signed=True)
INT12: Final = integer(12, signed=True)


def sent(kind: SimpleType, value: object, bits: int = 0) -> str:
    return encode_value(kind, value, bits=bits).hex(" ").upper()


def received(kind: SimpleType, octets: str, bits: int = 0) -> tuple[Value, Flags]:
    flags: Flags = {}
    return decode_value(kind, bytes.fromhex(octets), flags, bits=bits), flags


def named(name: str) -> SimpleType:
    return STANDARD[STANDARD_NAMES[name]]


#: Single values, both ways.
VALUES: Final[list[tuple[str, SimpleType, int, object, str]]] = [
    ("text: uint32", STANDARD[UINT32], 0, 0xA1B2C3D4, "D4 C3 B2 A1"),
    ("text: uint10", UINT10, 0, 0x021C, "1C 02"),
    ("Boolean alone, true", STANDARD[BOOL], 0, True, "01"),
    ("Boolean alone, false", STANDARD[BOOL], 0, False, "00"),
    ("int10 -1", INT10, 0, -1, "FF 03"),
    ("int10 -512", INT10, 0, -512, "00 02"),
    ("int10 -300", INT10, 0, -300, "D4 02"),
    ("int12 2047", INT12, 0, 2047, "FF 07"),
    ("int12 -1", INT12, 0, -1, "FF 0F"),
    ("int8 low", STANDARD[INT8], 0, -128, "80"),
    ("int8 high", STANDARD[INT8], 0, 127, "7F"),
    ("float32 1.0", STANDARD[FLOAT32], 0, 1.0, "00 00 80 3F"),
    ("float32 -2.5", STANDARD[FLOAT32], 0, -2.5, "00 00 20 C0"),
    ("float32 -0.0", STANDARD[FLOAT32], 0, -0.0, "00 00 00 80"),
    ("float32 max", STANDARD[FLOAT32], 0, (2 - 2.0**-23) * 2.0**127, "FF FF 7F 7F"),
    ("float32 2^-149", STANDARD[FLOAT32], 0, 2.0**-149, "01 00 00 00"),
    ("float64 0.1", STANDARD[FLOAT64], 0, 0.1, "9A 99 99 99 99 99 B9 3F"),
    ("float64 max", STANDARD[FLOAT64], 0, sys.float_info.max, "FF FF FF FF FF FF EF 7F"),
    ("string[10]", STANDARD[STRING], 80, "Насос", "D0 9D D0 B0 D1 81 D0 BE D1 81"),
    ("string[8]", STANDARD[STRING], 64, "ABC", "41 42 43 00 00 00 00 00"),
    ("nettime", STANDARD[NETTIME], 0, NetTime(UNIX_2015, 123456789), "00 E1 22 56 15 CD 5B 07"),
    ("nettime max", STANDARD[NETTIME], 0, NetTime(2**31 - 1, 999999999), "FF FF FF 7F FF C9 9A 3B"),
    ("nettime before epoch", STANDARD[NETTIME], 0, NetTime(-1, 0), "FF FF FF FF 00 00 00 00"),
    ("interval of one sign", STANDARD[INTERVAL], 0, Interval(-1, -500_000_000), "FF FF FF FF 00 9B 32 E2"),
    ("interval of two signs", STANDARD[INTERVAL], 0, Interval(1, -1), "01 00 00 00 FF FF FF FF"),
    ("MAC", STANDARD[MAC_T], 0, MAC("00:1B:44:11:3A:B7"), "00 1B 44 11 3A B7"),
    ("IP", STANDARD[IP_T], 0, IPv4Address("192.168.100.1"), "C0 A8 64 01"),
    ("err", named("scd_err_t"), 0, -1, "FF"),
    ("crc", named("scd_crc_t"), 0, 0x31C3, "C3 31"),
    ("size", named("scd_size_t"), 0, 258, "02 01"),
    ("port", named("scd_port_t"), 0, 200, "C8"),
]  # fmt: skip


@pytest.mark.requirement(
    "R22", "R23", "R25", "R27", "R29", "R30", "R37", "R38", "R39", "R40", "R41", "R42", "R43", "R44", "R45", "R46", "R48",
    "R49", "R50", "R52",
)  # fmt: skip
@each(("kind", "bits", "value", "octets"), [row[1:] for row in VALUES])
def test_single_values(kind: SimpleType, bits: int, value: object, octets: str) -> None:
    assert sent(kind, value, bits) == octets
    found, flags = received(kind, octets, bits)
    assert (found, type(found), flags) == (value, type(value), {})
    assert math.copysign(1, found) == math.copysign(1, value) if isinstance(found, float) else True  # type: ignore[arg-type]


#: What is received with bits that a sender of ours does not set, and never sent so.
RECEIVED: Final[list[tuple[str, SimpleType, str, Value, Flags]]] = [
    ("uint10, bits 10-15 any", UINT10, "1C FE", 0x021C, {}),
    ("Boolean FF", STANDARD[BOOL], "FF", True, {}),
    ("Boolean FE", STANDARD[BOOL], "FE", False, {}),
    ("int12: the sign is bit 11", INT12, "FF F7", 2047, {}),
    ("float32 infinity", STANDARD[FLOAT32], "00 00 80 7F", math.inf, {"nonfinite": ("",)}),
]


@pytest.mark.requirement("R26", "R29", "R37", "R41")
@pytest.mark.parametrize(
    ("kind", "octets", "value", "flags"), [row[1:] for row in RECEIVED], ids=[row[0] for row in RECEIVED]
)
def test_values_as_received(kind: SimpleType, octets: str, value: Value, flags: Flags) -> None:
    assert received(kind, octets) == (value, flags)


@pytest.mark.requirement("R41")
def test_nan_has_one_form_when_sent_and_any_when_received() -> None:
    minus_payload = struct.unpack("<d", bytes.fromhex("01 00 00 00 00 00 F8 FF"))[0]
    assert sent(STANDARD[FLOAT32], math.nan) == sent(STANDARD[FLOAT32], minus_payload) == "00 00 C0 7F"
    assert sent(STANDARD[FLOAT64], minus_payload) == "00 00 00 00 00 00 F8 7F"
    found, flags = received(STANDARD[FLOAT32], "01 00 80 7F")
    assert isinstance(found, float)
    assert (math.isnan(found), flags) == (True, {})


@pytest.mark.requirement("R37", "R41", "R42", "R48")
@pytest.mark.parametrize(
    ("kind", "bits", "value", "wanted"),
    [
        (STANDARD[INT8], 0, 128, "E_RANGE"),
        (STANDARD[FLOAT32], 0, 3.4028235677973366e38, "E_RANGE"),
        (STANDARD[FLOAT32], 0, 1e39, "E_RANGE"),
        (STANDARD[FLOAT32], 0, math.inf, "E_RANGE"),
        (STANDARD[STRING], 72, "Насос", "E_LENGTH"),
        (named("scd_port_t"), 0, 502, "E_RANGE"),
    ],
)
def test_values_that_are_refused(kind: SimpleType, bits: int, value: object, wanted: str) -> None:
    with pytest.raises(Error) as error:
        encode_value(kind, value, bits=bits)
    assert error.value.code == wanted


@pytest.mark.requirement("R39")
def test_the_last_float_that_rounds_down_is_sent() -> None:
    assert sent(STANDARD[FLOAT32], 3.4028235677973362e38) == "FF FF 7F 7F"


#: Several variables: PDOs, both ways.
PDOS: Final[list[tuple[str, tuple[making.Part, ...], list[Any], str]]] = [
    ("eight Booleans", (BOOL,) * 8, [True, False, True, True, False, False, False, True], "8D"),
    ("three uint12", (UINT12,) * 3, [0x123, 0x456, 0x789], "23 61 45 89 07"),
    ("bool, uint12, int32", (BOOL, UINT12, INT32), [True, 0xABC, -2], "79 D5 FF FF FF 1F"),
    ("47 bits", (BOOL, BOOL, UINT12, INT32, BOOL), [True, False, 0xABC, -2, True], "F1 AA FF FF FF 7F"),
    ("bool, float32", (BOOL, FLOAT32), [True, 1.0], "01 00 00 7F 00"),
    ("uint4, string", (UINT4, (STRING, 16)), [0xF, "AB"], "1F 24 04"),
    ("bool, MAC", (BOOL, MAC_T), [True, MAC("00:1B:44:11:3A:B7")], "01 36 88 22 74 6E 01"),
    ("aligned record", (BOOL, (0, 7), UINT16, FLOAT32), [True, 0x1234, 1.0], "01 34 12 00 00 80 3F"),
    ("u16, i32, i8", (UINT16, INT32, INT8), [0x0237, -1000, 8], "37 02 18 FC FF FF 08"),
    ("offsets 0/16/40", (UINT8, (0, 8), UINT16, (0, 8), UINT8), [0x11, 0x2233, 0x44], "11 00 33 22 00 44"),
]  # fmt: skip


@pytest.mark.requirement("R20", "R22", "R24", "R25", "R33", "R102", "R103")
@pytest.mark.parametrize(("parts", "values", "octets"), [row[1:] for row in PDOS], ids=[row[0] for row in PDOS])
def test_pdos(parts: tuple[making.Part, ...], values: list[Any], octets: str) -> None:
    codec = making.pdo(*parts)
    assert codec.encode("T1", keyed(values)).hex(" ").upper() == octets
    decoded = codec.decode("T1", bytes.fromhex(octets))
    assert decoded.values == keyed(values)
    assert [type(value) for value in decoded.values.values()] == [type(value) for value in values]
    assert (decoded.flags, decoded.surplus) == ({}, b"")


@pytest.mark.requirement("R32", "R33")
def test_a_record_whose_gap_holds_anything() -> None:
    found = making.pdo(BOOL, (0, 7), UINT16, FLOAT32).decode("T1", bytes.fromhex("AB 34 12 00 00 80 3F"))
    assert (found.values, found.flags) == (keyed([True, 0x1234, 1.0]), {})


@pytest.mark.requirement("R69")
def test_the_data_of_an_array_is_without_sub_index_0() -> None:
    codec = Codec(making.dictionary([array()]))
    octets = bytes.fromhex("01 00 FF FF 00 01")
    assert codec.encode_object("a", [1, -1, 256]) == octets
    assert codec.decode_object(0x2000, octets).values == {(0x2000, 1): 1, (0x2000, 2): -1, (0x2000, 3): 256}
    assert codec.encode_value((0x2000, 0), 3) == b"\x03"
    assert codec.decode_value("0x2000:0", b"\x03").values == {(0x2000, 0): 3}


@pytest.mark.requirement("R59")
def test_the_structure_of_a_struct_is_read_at_its_index() -> None:
    fields = [FieldRecord(name, kind, 0) for name, kind in (("a", BOOL), ("b", UINT16), ("c", FLOAT32), ("d", MAC_T))]
    codec = Codec(making.dictionary(structs=[StructRecord(0x41, "s", fields)]))
    values = [variable.default for variable in codec.dictionary[0x41]]
    assert values == [4, 1, 6, 8, 0x0401]
    for sub, octets in enumerate(("04", "01 00", "06 00", "08 00", "01 04")):
        assert codec.encode_value((0x41, sub), values[sub]).hex(" ") == octets
        assert codec.decode_value((0x41, sub), bytes.fromhex(octets)).values == {(0x41, sub): values[sub]}


#: The source of the reference's §3.1, but for the comments.
STATION: Final = """
[dictionary]
name = "Насосная"
version = "1.0.0"
[[type]]
index = 0x0060
name = "uint12"
base = "uint"
bits = 12
[[type]]
index = 0x0040
name = "pump_t"
fields = [{name="run", type="bool"}, {name="fault", type="bool"}, {reserved=6}, {name="speed", type="int16"}]
[[object]]
index = 0x6000
name = "Насос 1"
class = "RECORD"
type = "pump_t"
mandatory = true
[[object]]
index = 0x6001
name = "Давление"
class = "VAR"
type = "uint12"
access = "ro"
[[pdo]]
dir = "T"
number = 1
name = "Состояние"
map = ["0x6000:1", "0x6000:2", {reserved=2}, "0x6001:0", "0x6000:4"]
"""


@pytest.mark.requirement("R31", "R103", "R106", "R108")
def test_the_pdo_of_the_example_dictionary() -> None:
    codec = Codec(parse_toml(STATION))
    values = {"Насос 1.run": True, "Насос 1.fault": False, "Давление": 0xABC, "Насос 1.speed": -1500}
    octets = codec.encode("T1", values)
    assert octets.hex(" ").upper() == "C1 AB 24 FA"
    objects = codec.objects()
    assert codec.decode("T1", octets, objects).flags == {}
    assert objects.named() == values
    assert codec.dictionary[0x1A00].name == "Состояние"


@pytest.mark.requirement("R11", "R12", "R52", "R61", "R101")
@pytest.mark.parametrize(("octets", "what", "wanted"), WIRE, ids=[row[1] for row in WIRE])
def test_messages(octets: str, what: str, wanted: dict[str, Any]) -> None:
    codec = _pump() if wanted["index"] == 0x6000 else plant()
    whole = bytes.fromhex(octets)
    objects = codec.objects()
    message = codec.decode_message(whole, objects)
    assert f"{message.service} {message.phase}" == what
    assert (message.size, message.flags) == (len(whole), {})
    default = Message()
    for name in ("tid", "err", "index", "sub", "port", "pdo", "values"):
        assert getattr(message, name) == wanted.get(name, getattr(default, name)), name
    assert dict(objects) == wanted.get("values", {})
    again = Message(service=message.service, phase=message.phase, **wanted)
    assert codec.encode_message(again) == whole


def _pump() -> Codec:
    struct_type = StructRecord(0x40, "pump_t", [making.field("run", BOOL), making.field("", 0, 7)])
    return Codec(making.dictionary([ObjectRecord(0x6000, 9, "pump", 0x40, 0, "rw", False, True)], [struct_type]))
