"""The identification record of a module (I&M0), as IEC 61158-6-10 lays it out."""

from __future__ import annotations

from typing import Final

#: The attribute of every module that contains its record.
IDENTIFICATION: Final = 3753
#: Attributes with a record: the actual identity of a module, and the identity expected by the project.
RECORDS: Final = frozenset((IDENTIFICATION, 4114))
#: The record: head, vendor, order number, serial number, hardware revision, software revision.
IM0_HEAD: Final = bytes.fromhex("002000380100")
IM0_SIZE: Final = 60


def is_record(octets: bytes) -> bool:
    """Return whether octets are a whole identification record."""
    return len(octets) == IM0_SIZE and octets.startswith(IM0_HEAD)


def read_record(octets: bytes) -> tuple[str, str, str, str]:
    """Return order number, serial number, hardware and firmware of a record, empty if missing. Not escaped."""
    prefix, major, minor, patch = octets[46:50]
    return (
        octets[8:28].decode("latin-1").strip(" \0"),
        octets[28:44].decode("latin-1").strip(" \0"),
        str(int.from_bytes(octets[44:46], "big") or ""),
        f"{chr(prefix)}{major}.{minor}.{patch}",
    )


def record_text(octets: bytes) -> str:
    """Return the content of a record in the form of lines about devices; text from the wire, not escaped."""
    order_number, serial_number, hardware, firmware = read_record(octets)
    said = [order_number] if order_number else []
    if hardware:
        said.append(f"hardware {hardware}")
    said.append(f"firmware {firmware}")
    if serial_number:
        said.append(f"serial number {serial_number}")
    return ", ".join(said)
