"""The sections of a dictionary and its formulas (R57, R77-R96, R105-R108): the purpose and the device of each index.

Devices are counted 0..7, PDO numbers 1..512 (C46, C47).
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.scd.errors import E_INDEX, E_PDO_NUMBER, Error

DEVICES: Final = 8
DEVICE_SPACE: Final = 0x800
TYPE_SPACE: Final = 0x40
PDOS_OF_DEVICE: Final = 64
MAX_PDO: Final = DEVICES * PDOS_OF_DEVICE
MAX_SUB: Final = 254
#: The sub-index with the class of an object (bits 0-7) and its type (bits 8-23), C33.
STRUCTURE_SUB: Final = 255

#: (direction, kind of object) → index of the first PDO's object (R107, R108, C48).
PDO_BASES: Final[dict[tuple[str, str], int]] = {
    ("R", "comm"): 0x1400,
    ("R", "map"): 0x1600,
    ("T", "comm"): 0x1800,
    ("T", "map"): 0x1A00,
}


class Section(NamedTuple):
    """A row of the table in 3.2.3: it ``holds`` types ("static", "complex"), objects ("object") or nothing ("")."""

    first: int
    last: int
    name: str
    holds: str


SECTIONS: Final = (
    Section(0x0000, 0x0000, "unused", ""),
    Section(0x0001, 0x001F, "standard static types", "static"),
    Section(0x0020, 0x003F, "common complex types", "complex"),
    Section(0x0040, 0x005F, "manufacturer's complex types", "complex"),
    *(
        section
        for device in range(DEVICES)
        for section in (
            Section(0x60 + 0x40 * device, 0x7F + 0x40 * device, f"static types of device {device}", "static"),
            Section(0x80 + 0x40 * device, 0x9F + 0x40 * device, f"complex types of device {device}", "complex"),
        )
    ),
    Section(0x0260, 0x03FF, "reserved", ""),
    Section(0x0400, 0x041F, "static types of the network", "static"),
    Section(0x0420, 0x0FFF, "reserved", ""),
    Section(0x1000, 0x1FFF, "communication parameters", "object"),
    Section(0x2000, 0x5FFF, "manufacturer's objects", "object"),
    Section(0x6000, 0x9FFF, "device profiles", "object"),
    Section(0xA000, 0xBFFF, "interface profiles", "object"),
    Section(0xC000, 0xFFFF, "reserved", ""),
)


def section_of(index: int) -> Section:
    """Return the section of ``index``; raises `Error` E_INDEX if it is not a 16-bit index (R57)."""
    for section in SECTIONS:
        if section.first <= index <= section.last:
            return section
    raise Error(E_INDEX, hex(index), "an index has 16 bits")


def is_static_type(index: int) -> bool:
    """Return whether ``index`` is a type that is only referred to, never read or written (R87, R90)."""
    return 0 < index < 0x1000 and section_of(index).holds == "static"


def own_static_type(index: int) -> bool:
    """Return whether a dictionary may define a DEFTYPE at ``index``: 60h-7Fh, and the same for devices 1..7 (C15)."""
    return 0x60 <= index <= 0x25F and (index - 0x60) % TYPE_SPACE < 0x20


def own_complex_type(index: int) -> bool:
    """Return whether a dictionary may define a DEFSTRUCT at ``index``: 20h-5Fh, 80h-9Fh, and the same for devices 1..7."""
    return 0x20 <= index <= 0x5F or (0x80 <= index <= 0x25F and (index - 0x60) % TYPE_SPACE >= 0x20)


def type_of_device(index: int, device: int) -> int:
    """Return where device ``device`` has the type that device 0 has at ``index`` 60h-9Fh (R81).

    Raises `Error` for another index or device.
    """
    if not 0x60 <= index <= 0x9F:
        raise Error(E_INDEX, hex(index), "types of device 0 must be at 0x60 to 0x9f")
    return index + TYPE_SPACE * _device(device)


def object_of_device(index: int, device: int) -> int:
    """Return where device ``device`` has the object that device 0 has at ``index`` 6000h-67FFh (R94).

    Raises `Error` for another index or device.
    """
    if not 0x6000 <= index <= 0x67FF:
        raise Error(E_INDEX, hex(index), "objects of device 0 must be at 0x6000 to 0x67ff")
    return index + DEVICE_SPACE * _device(device)


def device_of_object(index: int) -> tuple[int, int]:
    """Return the device of an object at 6000h-9FFFh and the index it would have on device 0 (R93, R94).

    Raises `Error` for another index.
    """
    if not 0x6000 <= index <= 0x9FFF:
        raise Error(E_INDEX, hex(index), "objects of devices must be at 0x6000 to 0x9fff")
    device, offset = divmod(index - 0x6000, DEVICE_SPACE)
    return device, 0x6000 + offset


def pdo_index(direction: str, part: str, number: int) -> int:
    """Return the index of a PDO's object: direction "R" or "T", part "comm" or "map", number 1..512 (R107, R108).

    Raises `Error` for another number.
    """
    if not 1 <= number <= MAX_PDO:
        raise Error(E_PDO_NUMBER, f"{direction}PDO {number}", f"PDOs are numbered 1 to {MAX_PDO}")
    return PDO_BASES[direction, part] + number - 1


def pdo_of_index(index: int) -> tuple[str, str, int]:
    """Return direction, part and number of the PDO that the object at ``index`` describes.

    Raises `Error` if it describes none.
    """
    for (direction, part), first in PDO_BASES.items():
        if first <= index < first + MAX_PDO:
            return direction, part, index - first + 1
    raise Error(E_INDEX, hex(index), "PDOs are described at 0x1400 to 0x1bff")


def is_mapping(index: int) -> bool:
    """Whether the object at ``index`` is a PDO's mapping parameter (R106)."""
    return 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00


def is_communication(index: int) -> bool:
    """Whether the object at ``index`` is a PDO's communication parameter (R106)."""
    return 0x1400 <= index < 0x1600 or 0x1800 <= index < 0x1A00


def device_of_pdo(number: int) -> tuple[int, int]:
    """Return the device 0..7 of PDO ``number`` and its own number 1..64 there (R95). Raises `Error` for an invalid number."""
    if not 1 <= number <= MAX_PDO:
        raise Error(E_PDO_NUMBER, f"PDO {number}", f"PDOs are numbered 1 to {MAX_PDO}")
    device, local = divmod(number - 1, PDOS_OF_DEVICE)
    return device, local + 1


def pdo_of_device(device: int, number: int) -> int:
    """Return the number of the PDO that ``device`` counts as ``number`` 1..64 (R95). Raises `Error` for other numbers."""
    if not 1 <= number <= PDOS_OF_DEVICE:
        raise Error(E_PDO_NUMBER, f"PDO {number}", f"a device has the PDOs 1 to {PDOS_OF_DEVICE}")
    return PDOS_OF_DEVICE * _device(device) + number


def _device(device: int) -> int:
    if not 0 <= device < DEVICES:
        raise Error(E_INDEX, f"device {device}", f"devices are numbered 0 to {DEVICES - 1} (R93)")
    return device
