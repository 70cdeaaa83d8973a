from __future__ import annotations

import pytest

from dissect.scd import service
from dissect.scd.errors import Error
from dissect.scd.mapping import Entry
from dissect.scd.records import ObjectRecord
from tests.scd import making
from tests.scd.making import (
    UINT16,
    array,
    pump,
)


@pytest.mark.requirement("R10", "R13", "R14", "R15")
def test_r10_r13_r14_r15_init_encode_decode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "_codec", None)
    with pytest.raises(Error) as error:
        service.decode(b"", making.pdo().objects())
    assert "init" in error.value.detail
    codec = service.init(making.dictionary([*_plant(), array()], [pump()]))
    objects = codec.objects("T1")
    objects["level"] = 0x1234
    assert service.encode(objects) == b"\x34\x12"
    assert service.decode(b"\x35\x12", objects) == ((0x6000, 0),)
    assert objects["level"] == 0x1235
    objects.message = "level"
    assert service.decode(b"\x36\x12", objects) == ((0x6000, 0),)
    assert service.encode(objects) == b"\x36\x12"
    objects.message = "a"
    assert len(service.decode(bytes.fromhex("01 00 FF FF 00 01"), objects)) == 3
    assert service.encode(objects) == bytes.fromhex("01 00 FF FF 00 01")
    objects.message = "a.2"
    assert service.decode(b"\x05\x00", objects) == ((0x2000, 2),)
    objects.message = "pump_t"
    service.decode(bytes(7), objects)
    assert service.encode(objects) == b"\x0a" + bytes(6)
    objects.message = ""
    message = bytes.fromhex("DC 82 07 00 00 60 00 00 02 00 37 02")
    service.decode(message + crc(message), objects)
    assert objects["level"] == 0x0237


def _plant() -> list[ObjectRecord]:
    level = making.variable(0x6000, UINT16, name="level")
    return [level, making.mapping(0x1A00, "state", [Entry(0x6000, 0, 0, 16)])]


def crc(octets: bytes) -> bytes:
    register = 0
    for octet in octets:  # CRC-16/XMODEM, bit by bit
        register ^= octet << 8
        for _ in range(8):
            register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
    return register.to_bytes(2, "little")
