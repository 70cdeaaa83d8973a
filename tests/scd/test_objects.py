from __future__ import annotations

import pytest

from dissect.scd.errors import Error
from tests.scd import making
from tests.scd.making import (
    FLOAT32,
    UINT8,
    code,
)


@pytest.mark.requirement("R15")
def test_r15_objects_are_updated_and_say_what_changed() -> None:
    codec = making.pdo(UINT8, FLOAT32)
    objects = codec.objects()
    nan = bytes.fromhex("07 00 00 C0 7F")
    codec.decode("T1", nan, objects)
    seen = [objects.changed]
    codec.decode("T1", nan, objects)
    seen.append(objects.changed)  # NaN again is no change
    codec.decode("T1", b"\x08" + nan[1:], objects)
    seen.append(objects.changed)
    assert seen == [((0x6000, 0), (0x6001, 0)), (), ((0x6000, 0),)]
    assert objects["v6000"] == objects["0x6000"] == objects[0x6000, 0] == 8
    assert objects.named()["v6000"] == 8
    assert codec.encode("T1", objects) == b"\x08" + nan[1:]


def test_objects_check_what_is_set() -> None:
    objects = making.pdo(UINT8).objects()
    objects["v6000"] = 255
    assert dict(objects) == {(0x6000, 0): 255}
    assert "0x6000:0" in objects
    assert "nothing" not in objects
    for key, value, wanted in (("v6000", 256, "E_RANGE"), ("v6001", 1, "E_INDEX"), ((0x6000, 1), 1, "E_SUB")):
        with pytest.raises(Error) as error:
            objects[key] = value
        assert code(error) == wanted
    del objects["v6000"]
    assert len(objects) == 0
