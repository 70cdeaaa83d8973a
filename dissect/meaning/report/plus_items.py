"""Items of S7comm-plus as JSON: first the keys that S7comm items have, then those that only S7comm-plus has.

``return_code`` is 255 for success, as in S7comm, so that one query finds refusals in both protocols.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter

from dissect.meaning.report.plus import DB_AREA, S7_AREAS, as_text
from dissect.protocols.s7.singles import write_real_repr
from dissect.protocols.s7.tables import SUCCESS
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.ids import DATA_BLOCK
from dissect.protocols.s7plus.items import PlusItem
from dissect.protocols.s7plus.value_showing import value_json
from dissect.protocols.s7plus.value_tables import REAL, VALUE_TYPES
from dissect.protocols.s7plus.values import Value
from dissect.wire.build import COMPILED
from dissect.wire.digits import write_decimal, write_hexadecimal
from dissect.wire.text import hex_number, json_text

_SUCCESS: Final = str(SUCCESS)
#: Size of a REAL, and its exponent bits in its first and second octet: all are set in NaN and infinities.
_SINGLE: Final = 4
_EXPONENT: Final = 0x7F
_LAST_OF_EXPONENT: Final = 0x80
_QUOTE: Final = 0x22
_CLOSE: Final = 0x7D


def write_item(out: BytesWriter, item: PlusItem) -> None:
    """Write an item as a JSON object."""
    address = item.address
    value = item.value
    fragment = _NOWHERE
    if address is not None:
        if address.fragment is None:
            address.fragment = _address_octets(address)
        fragment = address.fragment
    begin, label, where, path = fragment
    if item.return_code or item.found is not None:
        if item.found is not None:
            label = json_text(item.label)
        code = str(item.return_code) if item.return_code > 0 else "null" if item.return_code else _SUCCESS
        begin = _item_begin(label, where, code)
    out.write(begin)
    data = item.data
    if data is not None:
        out.append(_QUOTE)
        write_hexadecimal(out, data, 0, len(data))
        out.append(_QUOTE)
    else:
        out.write(b"null")
    out.write(b',"value":')
    if value is not None and item.fits and item.is_plain:
        _write_value(out, value, data)
    else:
        out.write(as_text(item.json_value).encode("ascii"))
    out.write(b',"number":')
    write_decimal(out, item.number)
    out.write(_TYPES[value.type] if value is not None else _NO_TYPE)
    out.write(path)
    if item.note:
        out.write(f',"note":{json_text(item.note)}'.encode("ascii"))
    out.append(_CLOSE)


def _write_value(out: BytesWriter, value: Value, data: bytes | None) -> None:
    """Write a value without further information from the program; ``data`` are its octets without the type."""
    content = value.content
    if (
        COMPILED
        and data is not None
        and value.type == REAL
        and isinstance(content, float)
        and len(data) == _SINGLE
        and not (data[0] & _EXPONENT == _EXPONENT and data[1] & _LAST_OF_EXPONENT)
    ):
        write_real_repr(out, data, 0)
    else:
        out.write(value_json(value).encode("ascii"))


def _address_octets(address: VariableAddress) -> tuple[bytes, str, str, bytes]:
    """Return (beginning of the item's object for success, its label, the keys up to the return code, crc and path)."""
    start = str(address.start_bit) if address.start_bit >= 0 else "null"
    area = db = crc = "null"
    if address.area >> 16 == DATA_BLOCK:
        area, db = str(DB_AREA), str(address.area & 0xFFFF)
    elif address.area in S7_AREAS:
        area, db = str(S7_AREAS[address.area]), "0"
    if address.crc:
        crc = f'"{hex_number(address.crc, 8)}"'
    path = ",".join([str(id_) for id_ in (address.area, address.sub_area, *address.lids)])
    label, where = json_text(address.label), _where(area, db, start)
    return _item_begin(label, where, _SUCCESS), label, where, f',"crc":{crc},"path":[{path}]'.encode("ascii")


def _where(area: str, db: str, start: str) -> str:
    return f',"syntax_id":null,"area":{area},"db":{db},"start_bit":{start},"transport_size":null,"count":null,"return_code":'


def _item_begin(label: str, where: str, code: str) -> bytes:
    return f'{{"address":{label}{where}{code},"data":'.encode("ascii")


def _nowhere() -> tuple[bytes, str, str, bytes]:
    where = _where("null", "null", "null")
    return _item_begin("null", where, _SUCCESS), "null", where, b',"crc":null,"path":null'


#: The result of `_address_octets` for an item whose address is unknown.
_NOWHERE: Final = _nowhere()
_TYPES: Final[list[bytes]] = [f',"type":{json_text(VALUE_TYPES.name(type_))}'.encode("ascii") for type_ in range(256)]
_NO_TYPE: Final = b',"type":null'
