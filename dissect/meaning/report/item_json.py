"""Values, items, functions and setups as JSON, for the lines of transactions and PDUs and for other outputs with values.

The beginning of an item's object is made once and stored at the item, which all polling transactions share. Values of the usual
types are written straight from their octets, without Python objects in between.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64, u8

from dissect.engine.transactions.naming import NamedValue
from dissect.engine.transactions.results import TransactionError, known_code
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.parameters import Parameters, Setup, UserdataHead
from dissect.protocols.s7.tables import BIT, BYTE, CHAR, FUNCTIONS, SUCCESS, USERDATA_TYPES, WCHAR
from dissect.protocols.s7.values import (
    LEAST_TEXT,
    Value,
    decode_value,
    numbers_json,
    spelled,
    write_numbers,
    write_times,
)
from dissect.wire.digits import write_escape, write_hexadecimal
from dissect.wire.text import SHORT, JsonTexts, hexadecimal, json_text

#: The return code of an item without an error, and the text before its octets.
_GOOD: Final = f'{SUCCESS},"data":"'
CODE: Final = f',"return_code":{_GOOD}'
_NO_ITEM: Final = (
    '{"address":null,"syntax_id":null,"area":null,"db":null,"start_bit":null,"transport_size":null,"count":null' + CODE
)

#: The text between the octets of an item and their value, and the text that closes its object.
VALUE: Final = '","value":'
_VALUE_OCTETS: Final = VALUE.encode("ascii")
_CLOSE: Final = 0x7D
_QUOTE: Final = 0x22
#: By ASCII code: whether JSON escapes the character.
_ESCAPED: Final = bytes([len(json_text(chr(code))) > 3 for code in range(128)])
#: A UTF-16 unit is a surrogate (one half of a character) if ``unit & _SURROGATES == _SURROGATE``.
_SURROGATES: Final = 0xF800
_SURROGATE: Final = 0xD800


def decoded_json(value: Value) -> str:
    """Return a decoded value as JSON; NaN and the infinities, which JSON numbers cannot represent, as strings."""
    if value is None:
        return "null"
    if value is True:
        return "true"
    if value is False:
        return "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        text = repr(value)
        return f'"{text}"' if text in {"nan", "inf", "-inf"} else text
    if isinstance(value, str):
        return json_text(value)
    return f"[{','.join([decoded_json(element) for element in value])}]"


def octets_value(transport_size: i64, octets: bytes) -> str:
    """Return the JSON of ``decode_value(transport_size, octets)``; bits and numbers are written without decoding them."""
    if transport_size == BIT and len(octets) == 1:
        return "true" if octets[0] & 1 else "false"
    return numbers_json(transport_size, octets) or decoded_json(decode_value(transport_size, octets))


#: The rest of the object of an item that is a single bit or byte, by its octet.
_BITS: Final = [f"{octet:02x}{VALUE}{octets_value(BIT, bytes([octet]))}}}".encode("ascii") for octet in range(256)]
_BYTES: Final = [f"{octet:02x}{VALUE}{octets_value(BYTE, bytes([octet]))}}}".encode("ascii") for octet in range(256)]


def userdata_text(head: UserdataHead) -> str:
    """Return a userdata head as a JSON object."""
    text = (
        f'{{"type":{head.type},"type_name":{json_text(USERDATA_TYPES.name(head.type))}'
        f',"group":{head.group},"group_name":{json_text(head.group_name)}'
        f',"subfunction":{head.subfunction},"subfunction_name":{json_text(head.subfunction_name)}'
        f',"sequence":{head.sequence}'
    )
    if head.extended:
        text += f',"data_unit_ref":{head.data_unit_ref},"last_data_unit":{head.last_data_unit},"error_code":{head.error_code}'
    return text + "}"


def item_text(item: Item) -> str:
    """Return the beginning of an item's object, up to and including the return code for success (`_GOOD`)."""
    if not item.fragment:
        item.fragment = _item_beginning(item)
    return item.fragment


def _item_beginning(item: Item) -> str:
    if item.transport_size < 0:
        text = '"area":null,"db":null,"start_bit":null,"transport_size":null,"count":null'
    else:
        text = (
            f'"area":{item.area},"db":{item.db},"start_bit":{item.start_bit}'
            f',"transport_size":{item.transport_size},"count":{item.count}'
        )
    syntax = str(item.syntax_id) if item.syntax_id >= 0 else "null"
    return f'{{"address":{json_text(item.address)},"syntax_id":{syntax},{text}{CODE}'


def item_json(item: Item | None, code: i64, data: bytes | None) -> str:
    """Return one item of a transaction as a JSON object, with its return code (-1 for none) and its octets."""
    head = item_text(item) if item is not None else _NO_ITEM
    if data is None or code != SUCCESS:
        told = SHORT[code] if code >= 0 else "null"
        head = f'{head[: -len(_GOOD)]}{told},"data":'
        if data is None:
            return f'{head}null,"value":null}}'
        head += '"'
    value = value_json(item, data) if item is not None else "null"
    return f"{head}{hexadecimal(data)}{VALUE}{value}}}"


def write_good_item(out: BytesWriter, item: Item, octets: bytes, at: i64, size: i64) -> None:
    """Write what `item_json` returns for an item without an error, whose data are ``octets[at:at + size]``."""
    head = item.head
    if len(head) == 0:  # quicker than the truth of bytes (mypyc)
        head = _item_beginning(item).encode("ascii")
        item.head = head
    out.write(head)
    kind: i64 = item.transport_size
    fits: bool = item.size == size or item.fits(size)
    if size == 1 and fits:
        if kind == BYTE:
            out.write(_BYTES[octets[at]])
            return
        if kind == BIT:
            out.write(_BITS[octets[at]])
            return
    write_hexadecimal(out, octets, at, at + size)
    out.write(_VALUE_OCTETS)
    if not fits:
        out.write(b"null")
    elif write_numbers(out, kind, octets, at, size):
        text = spelled(octets[at : at + size]) if kind == BYTE and size >= LEAST_TEXT else ""
        if text:
            out.write(f',"text":{json_text(text)}'.encode("ascii"))
    elif not write_times(out, kind, octets, at, size) and not _write_text(out, kind, octets, at, size):
        out.write(decoded_json(decode_value(kind, octets[at : at + size])).encode("ascii"))
    out.append(_CLOSE)


def _write_text(out: BytesWriter, kind: i64, octets: bytes, at: i64, size: i64) -> bool:
    """Write characters as a JSON string. Return False and write nothing for other types and if there are surrogates."""
    step: i64 = 0
    if kind == CHAR:
        step = 1
    elif kind == WCHAR:
        step = 2
    if step == 0 or size % step:
        return False
    begin = len(out)
    out.append(_QUOTE)
    end: i64 = at + size
    while at < end:
        unit: i64 = octets[at]
        if step == 2:
            unit = unit << 8 | octets[at + 1]
        at += step
        if unit >= 0x7F:
            if unit & _SURROGATES == _SURROGATE:
                out.truncate(begin)
                return False
            write_escape(out, unit)
        elif _ESCAPED[unit]:
            out.write(json_text(chr(unit))[1:-1].encode("ascii"))
        else:
            out.append(u8(unit))
    out.append(_QUOTE)
    return True


def value_json(item: Item, data: bytes) -> str:
    """Return the value of an item, then key ``text`` if its bytes spell one; null if ``data`` do not match the item."""
    if item.size != len(data) and not item.fits(len(data)):
        return "null"
    value = octets_value(item.transport_size, data)
    if item.transport_size == BYTE:
        text = spelled(data)
        if text:
            return f'{value},"text":{json_text(text)}'
    return value


def json_code(error: TransactionError) -> str:
    """Return the code of an error as JSON."""
    code = known_code(error)
    return "null" if code is None else str(code)


def errors_json(transaction: Transaction, texts: JsonTexts) -> str:
    """Return the errors of a transaction as JSON, without the brackets of their array."""
    return ",".join(
        [
            f'{{"where":"{error.where}","code":{json_code(error)}'
            f',"name":{texts.of(error.name)},"text":{texts.of(error.text)}}}'
            for error in transaction.errors
        ]
    )


def with_tags(item: str, known: list[NamedValue]) -> str:
    """Return the object of an item with its tags, and with the octets that no tag covers."""
    tags = ",".join([_tag(value) for value in known if value.name])
    free = ",".join(
        [
            f'{{"address":{json_text(value.address)},"offset":{value.offset},"data":"{value.data.hex()}"}}'
            for value in known
            if not value.name
        ]
    )
    return f'{item[:-1]},"tags":[{tags}],"untagged":[{free}]}}'


def _tag(known: NamedValue) -> str:
    raw = f',"raw":{decoded_json(known.raw)}' if known.raw is not known.value and known.raw != known.value else ""
    remark = f',"remark":{json_text(known.remark)}' if known.remark else ""
    comment = f',"comment":{json_text(known.comment)}' if known.comment else ""
    data = f',"data":"{known.data.hex()}"' if known.value is None and known.data else ""
    return (
        f'{{"name":{json_text(known.name)},"address":{json_text(known.address)},"type":{json_text(known.type)}'
        f',"value":{decoded_json(known.value)},"unit":{json_text(known.unit) if known.unit else "null"}'
        f',"whole":{"true" if known.whole else "false"},"offset":{known.offset}{raw}{data}{remark}{comment}}}'
    )


def function_text(parameters: Parameters) -> str:
    """Return the ``function`` object of a parameter block of S7comm, and for userdata the ``userdata`` object after it."""
    if not parameters.fragment:
        code: i64 = parameters.function
        text = (
            '{"code":null,"name":null}' if code < 0 else f'{{"code":{code},"name":{json_text(FUNCTIONS.name(code))}}}'
        )
        userdata = parameters.userdata
        if userdata is not None:
            text += f',"userdata":{userdata_text(userdata)}'
        parameters.fragment = text
    return parameters.fragment


def setup_text(setup: Setup | None) -> str:
    """Return `Setup.as_dict` as JSON."""
    if setup is None:
        return "null"
    if not setup.fragment:
        setup.fragment = (
            f'{{"max_amq_calling":{setup.max_amq_calling},"max_amq_called":{setup.max_amq_called}'
            f',"pdu_length":{setup.pdu_length}}}'
        )
    return setup.fragment
