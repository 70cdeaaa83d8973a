"""The rules of a described envelope (profile: the text gives messages no header, C3)."""

from __future__ import annotations

from collections import Counter
from typing import Final

from dissect.scd.errors import DictionaryError
from dissect.scd.records import CrcRecord, EnvelopeField, EnvelopeRecord

MAX_FIELDS: Final = 64


def check_envelope(record: EnvelopeRecord) -> None:
    """Raise `DictionaryError` for an envelope that cannot be parsed, or not unambiguously."""
    fields = record.fields
    if len(fields) > MAX_FIELDS:
        raise _fail(f"{len(fields)} fields, at most {MAX_FIELDS} are possible")
    times: Counter[str] = Counter(field.role for field in fields)
    for role, count in times.items():
        if count > 1 and role not in ("reserved", "const"):
            raise _fail(f"the role {role} is there {count} times")
    if not times["data"]:
        raise _fail("one field has the role data")
    bit = 0
    for number, field in enumerate(fields, 1):
        bit = _check_field(field, bit, f"envelope, field {number} ({field.role})")
    if bit % 8:
        raise _fail(f"{bit} bits beside the data, which is not a whole number of bytes")
    roles = [field.role for field in fields]
    if times["size"] and roles.index("size") > roles.index("data"):
        raise _fail("size must come before the data that it counts")
    if times["crc"] != (record.crc is not None):
        raise _fail("a field of the role crc and a table crc belong together")
    if record.crc is not None:
        _check_crc(record.crc)
    _check_kinds(record, times)


def _fail(detail: str, where: str = "envelope") -> DictionaryError:
    return DictionaryError(where, detail, rule="profile 3.3")


def _check_field(field: EnvelopeField, bit: int, where: str) -> int:
    """Check a field that begins at ``bit``, not counting the data; return where the next one begins."""
    if field.role == "data":
        if bit % 8:
            raise _fail("data begins at a whole byte", where)
        if field != EnvelopeField("data"):
            raise _fail("data has no type of its own", where)
        return bit
    if not 1 <= field.bits <= 64:
        raise _fail(f"{field.bits} bits, a field has 1 to 64", where)
    if field.big and (bit % 8 or field.bits % 8):
        raise _fail("a big-endian field begins and ends at whole bytes", where)
    if field.role in ("response", "abort") and field.bits != 1:
        raise _fail("has one bit", where)
    if field.role == "crc" and (field.bits != 16 or bit % 8):
        raise _fail("has the two bytes of scd_crc_t, at whole bytes", where)
    if field.counts == "rest" and (bit + field.bits) % 8:
        raise _fail("a size that counts the rest ends at a whole byte", where)
    if (field.role == "size") != bool(field.counts):
        raise _fail("size says what it counts (data, data+crc, rest, total), and nothing else does", where)
    if field.signed and field.role != "err":
        raise _fail("only err is signed", where)
    if field.value is not None and field.role not in ("protocol", "const", "reserved"):
        raise _fail("only protocol, const and reserved have a value", where)
    if field.value is None and field.role == "const":
        raise _fail("needs a value", where)
    if field.value is not None and not 0 <= field.value < 1 << field.bits:
        raise _fail(f"{field.value} does not fit {field.bits} bits", where)
    return bit + field.bits


def _check_crc(crc: CrcRecord) -> None:
    for name, number in (("poly", crc.poly), ("init", crc.init), ("xorout", crc.xorout)):
        if not 0 <= number <= 0xFFFF:
            raise _fail(f"{name} {number} does not fit the 16 bits of scd_crc_t", "envelope crc")


def _check_kinds(record: EnvelopeRecord, times: Counter[str]) -> None:
    if times["kind"] != bool(record.kinds):
        raise _fail("a field of the role kind and the list kinds belong together")
    numbers = [number for number, _ in record.kinds]
    services = [service for _, service in record.kinds]
    if numbers != sorted(set(numbers)) or len(set(services)) != len(services):
        raise _fail("kinds ascend by their values; no value and no service is there twice")
    bits = next((field.bits for field in record.fields if field.role == "kind"), 0)
    for number in numbers:
        if not 0 <= number < 1 << bits:
            raise _fail(f"{number} does not fit the {bits} bits of kind", "envelope kinds")
