from __future__ import annotations

import math
import random
import struct
from typing import Any

import canopen
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.scd.codec import Codec
from dissect.scd.errors import Error
from dissect.scd.mapping import Entry, pack_entry
from dissect.scd.records import ObjectRecord, Traits
from dissect.scd.values import MAC
from tests.scd import making
from tests.scd.making import (
    BLOCK,
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT32,
    INT64,
    MAC_T,
    NETTIME,
    STRING,
    UINT8,
    UINT12,
    UINT16,
    UINT32,
    UINT64,
    array,
    code,
    keyed,
    pump,
)


@pytest.mark.requirement("R41")
@pytest.mark.parametrize("shift", [0, 1])
def test_r41_infinity_is_not_sent_and_is_flagged_when_received(shift: int) -> None:
    codec = making.pdo(*[BOOL] * shift, FLOAT32)
    last = (0x6000 + shift, 0)
    for number in (3.4028235677973366e38, 1e39, -1e39, math.inf, -math.inf, 10**400):
        with pytest.raises(Error) as error:
            codec.encode("T1", keyed([True] * shift + [number]))
        assert code(error) == "E_RANGE"
    largest = codec.encode("T1", keyed([False] * shift + [3.4028235677973362e38]))
    assert int.from_bytes(largest, "little") >> shift == 0x7F7FFFFF
    octets = (0x7F800000 << shift).to_bytes(4 + shift, "little")
    decoded = codec.decode("T1", octets)
    assert decoded.values[last] == math.inf
    assert decoded.flags == {"nonfinite": (last,)}


@pytest.mark.requirement("R69")
@pytest.mark.parametrize("values", [[], [1, -1], [1, -1, 256, 3]])
def test_an_array_is_sent_whole(values: list[int]) -> None:
    with pytest.raises(Error) as error:
        Codec(making.dictionary([array()])).encode_object("a", values)
    assert code(error) == "E_COUNT"


@pytest.mark.requirement("R32")
def test_r32_bits_of_a_gap_are_any_and_only_strict_pad_tells() -> None:
    parts: tuple[making.Part, ...] = (BOOL, (0, 7), UINT16, FLOAT32)
    octets = bytes.fromhex("AB 34 12 00 00 80 3F")
    lenient = making.pdo(*parts).decode("T1", octets)
    assert lenient.values == keyed([True, 0x1234, 1.0])
    assert lenient.flags == {}
    assert making.pdo(*parts, strict_pad=True).decode("T1", octets).flags == {"pad": ()}
    assert making.pdo(UINT12, strict_pad=True).decode("T1", b"\xff\x1f").flags == {"pad": ()}
    assert making.pdo(UINT12, strict_pad=True).decode("T1", b"\xff\x0f").flags == {}


@pytest.mark.requirement("R32")
def test_r32_reserved_bits_with_a_value_are_sent_as_that() -> None:
    codec = Codec(making.dictionary(structs=[pump()]), strict_pad=True)
    octets = codec.encode_type("pump_t", {"run": True, "level": 0x1234, "flow": 1.0})
    assert octets.hex(" ") == "0b 34 12 00 00 80 3f"
    assert codec.decode_type("pump_t", octets).flags == {}
    other = codec.decode_type("pump_t", b"\x01" + octets[1:])
    assert other.values == {"run": True, "level": 0x1234, "flow": 1.0}
    assert other.flags == {"pad": ()}


@pytest.mark.requirement("R99")
def test_r99_a_bare_struct_is_a_message() -> None:
    codec = Codec(making.dictionary(structs=[pump()]))
    octets = bytes.fromhex("AB 34 12 00 00 80 3F")
    assert codec.decode_type(0x40, octets).values == {"run": True, "level": 0x1234, "flow": 1.0}
    objects = codec.objects()
    codec.decode_type("pump_t", octets, objects)
    assert objects["pump_t.level"] == 0x1234
    assert objects.changed == ("pump_t.run", "pump_t.level", "pump_t.flow")
    objects["pump_t.level"] = 7
    assert codec.encode_type("pump_t", objects)[1:3] == b"\x07\x00"
    for name in ("uint12", "none"):
        with pytest.raises(Error) as error:
            codec.decode_type(name, octets)
        assert code(error) == "E_TYPE"


@pytest.mark.requirement("R70")
def test_r70_the_data_of_a_record_is_without_sub_index_0_and_reserved_fields_have_no_value() -> None:
    record = ObjectRecord(0x2000, 9, "r", 0x40, 0, "rw", False, True)
    codec = Codec(making.dictionary([record], [pump()]))
    octets = codec.encode_object("r", [True, 0x1234, 1.0])
    assert octets == bytes.fromhex("0B 34 12 00 00 80 3F")
    assert codec.decode_object("r", octets).values == {(0x2000, 1): True, (0x2000, 4): 0x1234, (0x2000, 5): 1.0}


def test_c33_sub_index_255_is_class_and_type() -> None:
    codec = Codec(making.dictionary([array()]))
    octets = codec.encode_value((0x2000, 255), 8 | INT16 << 8)
    assert octets.hex(" ") == "08 03 00 00"
    assert codec.decode_value((0x2000, 255), octets).values == {(0x2000, 255): 0x0308}


def test_a_variable_encodes_itself() -> None:
    od = making.dictionary([making.variable(0x6000, UINT12)])
    assert od[0x6000][0].encode(0xABC) == b"\xbc\x0a"
    assert od[0x6000][0].decode(b"\xbc\xfa") == 0xABC


def test_an_error_changes_no_object() -> None:
    codec = making.pdo(UINT8, (STRING, 16), UINT8)
    objects = codec.objects()
    codec.decode("T1", b"\x01AB\x02", objects)
    before, changed = dict(objects), objects.changed
    for octets, wanted in ((b"\x03A", "E_SHORT"), (b"", "E_SHORT")):
        with pytest.raises(Error) as error:
            codec.decode("T1", octets, objects)
        assert code(error) == wanted
        assert (dict(objects), objects.changed) == (before, changed)


def test_surplus_octets_are_kept_and_flagged() -> None:
    decoded = making.pdo(UINT8).decode("T1", memoryview(b"\x01\x02\x03"))
    assert (decoded.values, decoded.flags, decoded.surplus) == ({(0x6000, 0): 1}, {"trailing": ()}, b"\x02\x03")


def test_missing_and_surplus_values() -> None:
    codec = making.pdo(UINT8, (STRING, 16), MAC_T)
    for values in ({}, keyed([1, "A"]), keyed([1, "A", MAC(bytes(6)), 4]), {(0x6000, 0): 1, "v6000": 2}):
        with pytest.raises(Error) as error:
            codec.encode("T1", values)
        assert code(error) in {"E_COUNT", "E_INDEX"}
    assert codec.encode("T1", {"v6001": "A"}, partial=True) == b"\0A\0" + bytes(6)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({1: 5}, "E_INDEX: 1: values go by (index, sub-index), by an address such as '0x6000:1' or by a name"),
        ({(0x6000,): 5}, "E_INDEX: (24576,): values go by (index, sub-index)"),
        ({(0x6000, "x"): 5}, "E_INDEX: (24576, 'x'): values go by (index, sub-index)"),
        ({"0x6000": 1, (0x6000, 0): 1}, "E_COUNT: 0x6000:0: the value of this variable is given twice"),
        ({(0x6000, 0): 1, (0x6000, 255): 1}, "E_SUB: 0x6000:255: "),
    ],
)
def test_a_key_that_names_no_variable_is_told(values: dict[Any, object], said: str) -> None:
    with pytest.raises(Error) as error:
        making.pdo(UINT8).encode("T1", values)
    assert said in str(error.value)


def test_unknown_pdos() -> None:
    codec = making.pdo(UINT8)
    for key in ("T2", "R1", "T513", "pump"):
        with pytest.raises(Error) as error:
            codec.decode(key, b"")
        assert code(error) == "E_PDO_NUMBER"


@pytest.mark.requirement("R104")
def test_r104_a_mapping_rewritten_in_traffic_is_used_from_then_on() -> None:
    codec = making.pdo(UINT8, UINT16)
    assert codec.decode("T1", b"\x01\x02\x03").values == keyed([1, 0x0302])
    new = [pack_entry(Entry(0x6001, 0, 0, 16), True), pack_entry(Entry(0x6000, 0, 16, 8), True)]
    codec.remap(codec.dictionary.with_mapping(0x1A00, new))
    assert codec.decode("T1", b"\x01\x02\x03").values == {(0x6001, 0): 0x0201, (0x6000, 0): 3}


@pytest.mark.requirement("R103")
def test_r103_a_pdo_that_is_off_is_empty() -> None:
    codec = making.pdo()
    assert codec.encode("T1", {}) == b""
    assert codec.decode("T1", b"\x01").flags == {"trailing": ()}


@given(st.binary(max_size=40))
def test_decoding_never_raises_anything_else(octets: bytes) -> None:
    codec = making.pdo(BOOL, UINT12, (STRING, 24), FLOAT64, NETTIME)
    told: object
    try:
        told = list(codec.decode("T1", octets).values)
    except Error as error:
        told = error.code
    assert told in (["E_SHORT"] if len(octets) < codec.pdo("T1").size else [list(keyed([0] * 5)), "E_UTF8"])


def test_aligned_pdos_are_what_struct_makes_of_them() -> None:
    dice = random.Random(1)
    codes = {INT8: "b", INT16: "h", INT32: "i", INT64: "q", UINT8: "B", UINT16: "H", UINT32: "I", UINT64: "Q"}
    for _ in range(50):
        kinds = dice.choices(list(codes), k=dice.randrange(1, 12))
        form = "<" + "".join(codes[kind] for kind in kinds)
        octets = dice.randbytes(struct.calcsize(form))
        codec = making.pdo(*kinds)
        assert list(codec.decode("T1", octets).values.values()) == list(struct.unpack(form, octets))
        assert codec.encode("T1", codec.decode("T1", octets).values) == octets


def test_aligned_pdos_are_what_python_canopen_makes_of_them() -> None:
    """Only aligned: its bit fields are wrong (its own open request #454)."""
    od = canopen.ObjectDictionary()
    od.add_object(canopen.objectdictionary.ODVariable("v", 0x2000))
    kinds = {UINT16: 0x0237, INT32: -1000, INT8: 8, FLOAT32: 1.5}
    codec = making.pdo(*kinds)
    octets = b""
    for kind, value in kinds.items():
        variable = canopen.objectdictionary.ODVariable("v", 0x2000)
        variable.data_type = kind
        octets += variable.encode_raw(value)
    assert codec.encode("T1", keyed(list(kinds.values()))) == octets


def test_the_longest_pdo() -> None:
    codec = making.pdo(BOOL, (BLOCK, 8 * 8191))
    block = random.Random(2).randbytes(8191)
    octets = codec.encode("T1", keyed([True, block]))
    assert len(octets) == 8192
    assert codec.decode("T1", octets).values == keyed([True, block])


LIMITED = making.dictionary(
    [
        ObjectRecord(0x6000, 7, "speed", INT16, 0, "rw", False, True, traits=Traits("rpm", 0.5, 0.0, -3000, 3000)),
        ObjectRecord(0x6001, 7, "level", FLOAT32, 0, "rw", False, True, traits=Traits(high=1.5)),
        making.mapping(0x1A00, "T1 map", [Entry(0x6000, 0, 0, 16), Entry(0x6001, 0, 16, 32)]),
    ]
)


@pytest.mark.parametrize(
    ("values", "said"),
    [([3001, 0.0], "-3000..3000"), ([-3001, 0.0], "-3000..3000"), ([0, 1.5000001], "at most 1.5"), ([3000, 1.5], "")],
)
def test_limits_are_of_the_raw_value_kept_when_sending_and_flagged_when_received(values: list[Any], said: str) -> None:
    codec = Codec(LIMITED)
    free = Codec(LIMITED, limits=False).encode("T1", keyed(values))
    wanted = ((0x6000, 0),) if "30" in said else ((0x6001, 0),)
    assert codec.decode("T1", free).flags == ({"limits": wanted} if said else {})
    key, value = (0x6000, values[0]) if "30" in said else (0x6001, values[1])
    alone = Codec(LIMITED, limits=False).encode_value((key, 0), value)
    for objects in (None, codec.objects()):
        assert codec.decode_value((key, 0), alone, objects).flags == ({"limits": ((key, 0),)} if said else {})
    if not said:
        assert codec.encode("T1", keyed(values)) == free
        return
    for encode in (lambda: codec.encode("T1", keyed(values)), lambda: codec.encode_value((key, 0), value)):
        with pytest.raises(Error, match=f"E_RANGE: .*limits of its raw value, {said}"):
            encode()


def test_a_text_that_is_none_costs_no_other_value() -> None:
    codec = making.pdo(UINT8, (STRING, 16), UINT8, BOOL, (STRING, 16))
    octets = bytes.fromhex("01 FFFE 02 01") + b"\x80\x84"  # the last text begins at bit 33
    decoded = codec.decode("T1", octets)
    assert decoded.values[0x6000, 0] == 1
    assert decoded.values[0x6001, 0] == b"\xff\xfe"
    assert (decoded.values[0x6002, 0], decoded.values[0x6003, 0]) == (2, True)
    assert decoded.flags["encoding"][0] == (0x6001, 0)


def test_numbers_of_numpy_are_numbers() -> None:
    np = pytest.importorskip("numpy")
    codec = making.pdo(UINT8, INT16, FLOAT32, BOOL)
    wanted = codec.encode("T1", keyed([7, -2, 1.5, True]))
    assert codec.encode("T1", keyed([np.uint16(7), np.int64(-2), np.float32(1.5), np.bool_(True)])) == wanted
    for wrong in ([np.int64(256), 0, 0.0, True], [np.float64(1.0), 0, 0.0, True], [1, 0, np.float64("inf"), True],
                  [1, 0, 0.0, np.int8(1)], [np.array([1]), 0, 0.0, True]):  # fmt: skip
        with pytest.raises(Error):
            codec.encode("T1", keyed(wrong))


def test_columns_can_be_sent_again() -> None:
    pytest.importorskip("numpy")
    codec = making.pdo(UINT8, BOOL, INT16, FLOAT32)
    octets = codec.encode("T1", keyed([200, True, -300, 2.5]))
    columns = codec.decode_many("T1", octets, [0])
    assert codec.encode("T1", {key: column[0] for key, column in columns.items()}) == octets


def test_a_pdo_that_is_called_like_a_number_is_found() -> None:
    objects, mapped = making.entries([UINT8])
    od = making.dictionary([making.mapping(0x1600, "T2", mapped), *objects])
    assert repr(od.pdo("T2")).startswith("<Pdo R1")
    assert Codec(od).encode("T2", keyed([9])) == b"\x09"
    both = making.dictionary([making.mapping(0x1600, "T2", mapped), making.mapping(0x1A01, "state", mapped), *objects])
    assert [str(both.pdo(key).number) + both.pdo(key).direction for key in ("T2", "R1", "state")] == ["2T", "1R", "2T"]


KINDS = st.sampled_from([BOOL, INT8, UINT8, INT16, UINT32, FLOAT32, making.UINT12, making.INT10])


@given(st.lists(KINDS, min_size=1, max_size=9), st.data())
def test_the_short_way_gives_the_same_octets_or_leaves_it_to_the_long_one(
    kinds: list[int], data: st.DataObject
) -> None:
    """A value that the plan takes is packed as `Packing.pack` does; every other one is refused or packed by that."""
    codec = making.pdo(*kinds)
    packing = codec.packing("T1")
    odd = st.one_of(
        st.booleans(), st.integers(-(2**33), 2**33), st.floats(), st.none(), st.just("7"), st.floats(width=32),
        st.integers(-130, 260),
    )  # fmt: skip
    values = [data.draw(odd) for _ in kinds]
    short = packing.pack_known(keyed(values))
    try:
        long = packing.pack(values)
    except Error:
        assert short is None
    else:
        assert short in {None, long}
