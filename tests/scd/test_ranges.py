"""R57, R77-R96, R105-R108: sections and formulas."""

from __future__ import annotations

import pytest

from dissect.scd import ranges
from dissect.scd.errors import Error


@pytest.mark.requirement("R57", "R77")
def test_sections_cover_every_index_once() -> None:
    """C31: 65536 indices, none twice, none left out."""
    end = 0
    for section in ranges.SECTIONS:
        assert section.first == end
        end = section.last + 1
    assert end == 0x10000


@pytest.mark.requirement(
    "R77",
    "R78",
    "R79",
    "R80",
    "R81",
    "R82",
    "R83",
    "R84",
    "R85",
    "R86",
    "R87",
    "R88",
    "R89",
    "R90",
    "R91",
    "R92",
    "R96",
)
@pytest.mark.parametrize(
    ("index", "holds"),
    [
        pytest.param(0x0000, "", id="R77"),
        pytest.param(0x0001, "static", id="R78-R87"),
        pytest.param(0x001F, "static", id="R78-last"),
        pytest.param(0x0020, "complex", id="R88"),
        pytest.param(0x0040, "complex", id="R79-R89"),
        pytest.param(0x0060, "static", id="R80-R90"),
        pytest.param(0x0080, "complex", id="R80-complex"),
        pytest.param(0x00A0, "static", id="R81-C38"),
        pytest.param(0x025F, "complex", id="R81-last"),
        pytest.param(0x0260, "", id="R82-C39"),
        pytest.param(0x0403, "static", id="C30"),
        pytest.param(0x0420, "", id="C30-after"),
        pytest.param(0x1000, "object", id="R83-R91"),
        pytest.param(0x1FFF, "object", id="C40"),
        pytest.param(0x2000, "object", id="R84-R96"),
        pytest.param(0x6000, "object", id="R85-R92"),
        pytest.param(0xA000, "object", id="C41"),
        pytest.param(0xC000, "", id="R86-C42"),
        pytest.param(0xFFFF, "", id="R86-last"),
    ],
)
def test_what_a_section_holds(index: int, holds: str) -> None:
    assert ranges.section_of(index).holds == holds


@pytest.mark.requirement("R57", "R61")
@pytest.mark.parametrize("index", [-1, 0x10000])
def test_an_index_has_16_bits(index: int) -> None:
    with pytest.raises(Error, match="E_INDEX"):
        ranges.section_of(index)


@pytest.mark.requirement("R93", "R94")
@pytest.mark.parametrize(("device", "first"), list(enumerate(range(0x6000, 0xA000, 0x800))))
def test_devices_stand_800h_apart(device: int, first: int) -> None:
    assert ranges.object_of_device(0x6000, device) == first
    assert ranges.device_of_object(first + 0x7FF) == (device, 0x67FF)
    assert ranges.type_of_device(0x60, device) == 0x60 + 0x40 * device
    assert ranges.type_of_device(0x9F, device) == 0x9F + 0x40 * device


@pytest.mark.requirement("R95", "R105", "R106", "R107", "R108")
@pytest.mark.parametrize(
    ("direction", "part", "number", "index"),
    [
        pytest.param("R", "comm", 1, 0x1400, id="R107"),
        pytest.param("R", "map", 1, 0x1600, id="R107-map"),
        pytest.param("T", "comm", 1, 0x1800, id="R108"),
        pytest.param("T", "map", 1, 0x1A00, id="R108-map"),
        pytest.param("R", "comm", 512, 0x15FF, id="C47"),
        pytest.param("T", "map", 512, 0x1BFF, id="C48"),
        pytest.param("T", "comm", 65, 0x1840, id="R95"),
    ],
)
def test_pdo_formulas(direction: str, part: str, number: int, index: int) -> None:
    assert ranges.pdo_index(direction, part, number) == index
    assert ranges.pdo_of_index(index) == (direction, part, number)


@pytest.mark.requirement("R95")
def test_every_pdo_number_comes_back() -> None:
    """C46: the first PDO of the second segment is number 65."""
    for number in range(1, 513):
        device, local = ranges.device_of_pdo(number)
        assert ranges.pdo_of_device(device, local) == number
        assert (0 <= device <= 7, 1 <= local <= 64) == (True, True)
    assert ranges.device_of_pdo(65) == (1, 1)
    assert ranges.device_of_pdo(512) == (7, 64)


@pytest.mark.parametrize("number", [0, 513, -1])
def test_no_other_pdo_number(number: int) -> None:
    for call in (lambda: ranges.pdo_index("T", "map", number), lambda: ranges.device_of_pdo(number)):
        with pytest.raises(Error, match="E_PDO_NUMBER"):
            call()


def test_formulas_refuse_what_is_outside() -> None:
    for call in (
        lambda: ranges.pdo_of_index(0x1C00),
        lambda: ranges.pdo_of_index(0x13FF),
        lambda: ranges.object_of_device(0x6800, 0),
        lambda: ranges.object_of_device(0x6000, 8),
        lambda: ranges.device_of_object(0xA000),
        lambda: ranges.type_of_device(0xA0, 1),
    ):
        with pytest.raises(Error, match="E_INDEX"):
            call()
    with pytest.raises(Error, match="E_PDO_NUMBER"):
        ranges.pdo_of_device(0, 65)
