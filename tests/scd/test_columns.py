from __future__ import annotations

import math
import random
import sys
from ipaddress import IPv4Address
from typing import Any

import pytest

from dissect.scd.errors import Error
from dissect.scd.values import MAC
from tests.scd import making
from tests.scd.making import (
    BLOCK,
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT64,
    INTERVAL,
    IP_T,
    MAC_T,
    NETTIME,
    STRING,
    UINT12,
    UINT32,
    UINT64,
    keyed,
)


def test_columns_have_the_types_of_the_variables() -> None:
    codec = making.pdo(BOOL, UINT12, INT16, FLOAT32, UINT64, making.INT12)
    octets = b"".join(
        codec.encode("T1", keyed(values))
        for values in ([True, 0xABC, -2, 1.5, 2**64 - 1, -2048], [False, 0, 3, 0.0, 0, 2047])
    )
    size = codec.pdo("T1").size
    columns = codec.decode_many("T1", octets, [size, 0])
    assert [str(column.dtype) for column in columns.values()] == [
        "bool",
        "uint16",
        "int16",
        "float32",
        "uint64",
        "int16",
    ]
    assert [column.tolist() for column in columns.values()] == [
        [False, True], [0, 0xABC], [3, -2], [0.0, 1.5], [0, 2**64 - 1], [2047, -2048],
    ]  # fmt: skip


def plain(value: Any) -> Any:
    """A value of the codec as it stands in a column."""
    if isinstance(value, str):
        return value.encode()
    if isinstance(value, IPv4Address):
        return list(value.packed)
    if isinstance(value, bytes):
        return list(value)
    return value


@pytest.mark.parametrize("shift", range(8))
def test_columns_hold_what_single_decoding_gives(shift: int) -> None:
    """Every kind at every place in an octet; 64 bits at a shifted one reach into a ninth octet."""
    dice = random.Random(shift)
    codec = making.pdo(
        *[BOOL] * shift,
        INT64,
        UINT64,
        FLOAT64,
        FLOAT32,
        INT8,
        MAC_T,
        IP_T,
        NETTIME,
        INTERVAL,
        (BLOCK, 24),
        (STRING, 32),
        UINT32,
    )
    size, rows = codec.pdo("T1").size, 40
    sheet = bytearray(dice.randbytes(size * rows))
    text_at = codec.pdo("T1").map[-2].offset
    for row in range(rows):  # a text has to be one
        number = int.from_bytes(sheet[row * size : (row + 1) * size], "little")
        number = (
            number & ~(0xFFFFFFFF << text_at) | int.from_bytes(b"pump"[: row % 5].ljust(4, b"\0"), "little") << text_at
        )
        sheet[row * size : (row + 1) * size] = number.to_bytes(size, "little")
    octets = dice.randbytes(3) + bytes(sheet)
    offsets = [3 + size * row for row in range(rows)]
    dice.shuffle(offsets)
    columns = codec.decode_many("T1", octets, offsets)
    for at, offset in enumerate(offsets):
        for key, value in codec.decode("T1", octets[offset : offset + size]).values.items():
            found = columns[key][at].tolist()
            wanted = plain(value)
            assert found == wanted or (wanted != wanted and found != found), (key, offset)  # noqa: PLR0124


def test_infinities_are_received_as_such() -> None:
    codec = making.pdo(BOOL, FLOAT32)
    octets = (0x7F800000 << 1).to_bytes(5, "little")
    assert codec.decode_many("T1", octets, [0])[0x6001, 0].tolist() == [math.inf]


def test_a_mac_is_a_row_of_octets() -> None:
    codec = making.pdo(BOOL, MAC_T)
    address = MAC("00:1B:44:11:3A:B7")
    columns = codec.decode_many("T1", codec.encode("T1", keyed([True, address])), [0])
    assert columns[0x6001, 0].tobytes() == address


@pytest.mark.parametrize("offsets", [[-1], [0, 6], [10**9]])
def test_payloads_outside_of_the_buffer(offsets: list[int]) -> None:
    with pytest.raises(Error) as error:
        making.pdo(UINT32, BOOL).decode_many("T1", bytes(10), offsets)
    assert error.value.code == "E_SHORT"


def test_no_payloads_and_payloads_of_nothing() -> None:
    codec = making.pdo(UINT32)
    assert codec.decode_many("T1", b"", [])[0x6000, 0].tolist() == []
    assert making.pdo().decode_many("T1", b"abc", [0, 1]) == {}


def test_no_payloads_of_any_kind_of_variable() -> None:
    codec = making.pdo(BOOL, UINT12, INT16, FLOAT32, UINT64, INT8, (STRING, 16), NETTIME, MAC_T, (BLOCK, 16))
    for octets in (b"", bytes(100)):
        columns = codec.decode_many("T1", octets, [])
        some = codec.decode_many("T1", bytes(100), [0])
        assert [(column.dtype, len(column)) for column in columns.values()] == [
            (column.dtype, 0) for column in some.values()
        ]


def test_without_numpy_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numpy", None)
    with pytest.raises(ImportError, match=r"pip install 's7dissect\[scd\]'"):
        making.pdo(UINT32).decode_many("T1", bytes(4), [0])
