"""What reports say of an S7comm-plus PDU beside its function: in words, and as JSON-ready values (docs/json.md)."""

from __future__ import annotations

import json
from typing import Final

from dissect.iso.upper import S7COMM_PLUS, UPPER_NAMES
from dissect.report.facet import Facet
from dissect.s7.parameters import Parameters
from dissect.s7.tables import SUCCESS
from dissect.s7plus.alarms import ALARM, Alarm
from dissect.s7plus.contents import Contents
from dissect.s7plus.hiding import shown_contents, without_secrets
from dissect.s7plus.ids import DATA_BLOCK
from dissect.s7plus.items import REFUSED, Half, PlusItem, join_items
from dissect.s7plus.message import PlusPdu
from dissect.s7plus.parameters import PlusParameters, names_function
from dissect.s7plus.summary import summary
from dissect.s7plus.tables import CREATE_OBJECT, KEEP_ALIVE, NOTIFICATION, REQUEST, RETURN_CODES, SYSTEM_EVENT
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import Transaction
from dissect.wire.part import Part
from dissect.wire.text import shortened

#: Name of the protocol in JSON.
PROTOCOL: Final = UPPER_NAMES[S7COMM_PLUS]

_MESSAGE: Final = 100
#: Characters of what a PDU is about, and items that a line names.
_SUMMARY: Final = 200
_ITEMS: Final = 20
#: Areas as S7comm numbers them, by those of S7comm-plus.
S7_AREAS: Final = {80: 0x81, 81: 0x82, 82: 0x83, 83: 0x1C, 84: 0x1D}
DB_AREA: Final = 0x84

#: Functions whose items stand beside what else they are about.
_ITEMS_BESIDE: Final = frozenset((CREATE_OBJECT,))

_NO_FUNCTION: Final[dict[str, object]] = {"code": None, "name": None}


class PlusFacet(Facet):
    """S7comm-plus."""

    def reference(self, transaction: Transaction) -> str:
        """Return the sequence number; a notification has none."""
        return str(transaction.pdu_ref) if transaction.function >= 0 else ""

    def items(self, transaction: Transaction) -> list[str]:
        """Return every item with what became of it, in wire order."""
        return [item_text(item) for item in transaction.plus_items()]

    def subject(self, transaction: Transaction) -> str:
        """Return what a transaction is about: the session, or the subscription that tells it."""
        return plus_subject(transaction)

    def function_json(self, parameters: Parameters) -> str:
        """Return the ``function`` object of a transaction, and the protocol after it."""
        function = _NO_FUNCTION
        if isinstance(parameters, PlusParameters) and parameters.code >= 0:
            function = {"code": int(parameters.code), "name": parameters.code_name}
        return f'{_json(function)},"protocol":"{PROTOCOL}"'

    def body_json(self, transaction: Transaction) -> str:
        """Return the keys that only transactions of S7comm-plus have, and the items."""
        return plus_json(transaction)

    def statistics(self, code: int) -> dict[str, object]:
        """Return the function code, None for rows of several functions."""
        return {"code": f"0x{code & 0xFFFF:04x}" if names_function(code) else None, "protocol": PROTOCOL}


def plus_notes(pdu: PlusPdu) -> list[str]:
    """Return what a PDU says beside its function, in a few words each, safe to show."""
    said = []
    if pdu.session_id >= 0:
        said.append(f"session 0x{pdu.session_id:08x}")
    if pdu.opcode == REQUEST and not pdu.wants_response:
        said.append("expects no response")
    if pdu.subscription_id >= 0:
        said.append(f"subscription 0x{pdu.subscription_id:08x}")
        if pdu.sequence >= 0:
            said.append(f"number {pdu.sequence}")
    if pdu.return_code > 0:
        said.append(f"return value 0x{pdu.return_value:x} {RETURN_CODES.name(pdu.return_code)}")
    if pdu.version == SYSTEM_EVENT and pdu.number >= 0:
        said.append(f"{pdu.number} bytes confirmed")
    elif pdu.version == KEEP_ALIVE and pdu.number >= 0:
        said.append(f"number {pdu.number}")
    if pdu.message:
        said.append(shortened(pdu.message.decode("latin-1"), _MESSAGE))
    return said


def plus_summary(pdu: PlusPdu, found: Contents) -> list[str]:
    """Return what the contents of a PDU say, in a few words each, safe to show."""
    return [shortened(text, _MESSAGE) for text in summary(pdu, found)]


def plus_subject(transaction: Transaction) -> str:
    """Return what an S7comm-plus transaction is about: the session, or the subscription that tells it."""
    asked, told = transaction.plus_halves()
    half = asked if asked is not None else told
    if half is None:
        return ""
    if half.pdu.opcode == NOTIFICATION:
        said = plus_notes(half.pdu)
    else:
        said = ["expects no response"] if asked is not None and not asked.pdu.wants_response else []
    items = join_items(asked, told, transaction.connection.plus)
    if items and half.pdu.function not in _ITEMS_BESIDE:
        return ", ".join(said + _some([item_text(item) for item in items]))
    texts = [", ".join(summary(one.pdu, one.contents)) for one in (asked, told) if one is not None]
    said += [" → ".join([shortened(text, _SUMMARY) for text in texts if text])]
    if items:
        said.append("subscribes to " + ", ".join(_some([item_text(item) for item in items])))
    return ", ".join([text for text in said if text]) or ", ".join(plus_notes(half.pdu))


def item_text(item: PlusItem) -> str:
    """Return an item with what became of it: ``DB3."tank".level = Int 5``, ``MW100: refused``; safe to show."""
    label = shortened(item.label, _MESSAGE)
    if item.return_code > 0:
        return f"{label}: {'refused' if item.return_code == REFUSED else RETURN_CODES.name(item.return_code)}"
    text = item.text
    note = f" ({shortened(item.note, _MESSAGE)})" if item.note else ""
    return f"{label} = {shortened(text, _MESSAGE)}{note}" if text else f"{label}{note}"


def _some(texts: list[str]) -> list[str]:
    return texts if len(texts) <= _ITEMS else [*texts[:_ITEMS], f"and {len(texts) - _ITEMS} more"]


def plus_as_dict(pdu: PlusPdu) -> dict[str, object]:
    """Return what only S7comm-plus has; keys that the PDU does not have are left out."""
    values: dict[str, object] = {"kind": pdu.kind, "version": pdu.version if pdu.version >= 0 else None}
    values["frames"] = pdu.frames
    numbers = {
        "opcode": pdu.opcode,
        "session_id": pdu.session_id,
        "subscription_id": pdu.subscription_id,
        "number": pdu.sequence if pdu.opcode == NOTIFICATION else pdu.number,
        "credit_tick": pdu.credit_tick,
        "transport_flags": pdu.transport_flags,
    }
    values |= {name: value for name, value in numbers.items() if value >= 0}
    if pdu.opcode == REQUEST:
        values["wants_response"] = pdu.wants_response
    if pdu.return_value >= 0:
        values["return_value"] = f"0x{pdu.return_value:x}"
    if pdu.integrity:
        values["integrity"] = pdu.integrity.hex()
    if pdu.message:
        values["message"] = pdu.message.decode("latin-1")
    return values


def plus_json(transaction: Transaction) -> str:
    """Return the keys that only transactions of S7comm-plus have, behind a comma."""
    asked, told = transaction.plus_halves()
    halves: dict[str, object] = {"request": _half_as_dict(asked), "response": _half_as_dict(told)}
    alarms = (
        [Alarm(one).as_dict() for one in told.contents.objects if one.class_id == ALARM] if told is not None else []
    )
    if alarms:
        halves["alarms"] = alarms
    values = {
        "asks": _noted(asked),
        "tells": _noted(told),
        "s7plus": halves,
        "items": [_item_as_dict(item) for item in join_items(asked, told, transaction.connection.plus)],
    }
    return "," + _json(values)[1:-1]


def _noted(half: Half | None) -> list[str]:
    return plus_notes(half.pdu) + summary(half.pdu, half.contents) if half is not None else []


def _half_as_dict(half: Half | None) -> dict[str, object] | None:
    if half is None:
        return None
    values = plus_as_dict(half.pdu)
    if half.contents.integrity_id >= 0:
        values["integrity_id"] = half.contents.integrity_id
    return values


def _item_as_dict(item: PlusItem) -> dict[str, object]:
    """Return an item with the keys that those of S7comm have, and its own behind them.

    Success is 255 there as well, so that one question finds refusals in both protocols.
    """
    address = item.address
    value = item.value
    db = address.area & 0xFFFF if address is not None and address.area >> 16 == DATA_BLOCK else None
    area = None
    if address is not None:
        area = DB_AREA if db is not None else S7_AREAS.get(address.area)
    return {
        "address": item.label if address is not None else None,
        "syntax_id": None,
        "area": area,
        "db": db if db is not None else (0 if area is not None else None),
        "start_bit": address.start_bit if address is not None and address.start_bit >= 0 else None,
        "transport_size": None,
        "count": None,
        "return_code": SUCCESS if item.return_code == 0 else (item.return_code if item.return_code > 0 else None),
        "data": item.data.hex() if item.data is not None else None,
        "value": item.json_value,
        "number": item.number,
        "type": value.type_name if value is not None else None,
        "crc": f"0x{address.crc:08x}" if address is not None and address.crc else None,
        "path": [address.area, address.sub_area, *address.lids] if address is not None else None,
        **({"note": item.note} if item.note else {}),
    }


def plus_pdu_line(pdu: PlusPdu, time: str, connection: Connection, place: tuple[str, int] | None) -> str:
    """Return a PDU as a line of JSON: the keys of an S7 PDU, null where S7comm-plus has nothing like them.

    ``place`` is the file of its packet and the number within it; None where there is only one file.
    """
    ends = connection.tcp.ends
    values: dict[str, object] = {"schema": "s7dissect.pdu/1", "frame": pdu.frame}
    if place is not None:
        values |= {"frame": place[1], "file": place[0]}
    values |= {"time": time, "connection": pdu.connection, "src": str(ends[pdu.side]), "dst": str(ends[1 - pdu.side])}
    values["protocol"] = PROTOCOL
    values |= {"rosctr": None, "rosctr_name": None, "redundancy_id": None}
    values["pdu_ref"] = pdu.sequence if pdu.readable else None
    values |= {"param_length": None, "data_length": None, "error_class": None, "error_code": None}
    values["function"] = {"code": pdu.function, "name": pdu.function_name} if pdu.function >= 0 else _NO_FUNCTION
    found, hidden = shown_contents(pdu)
    head = plus_as_dict(pdu)
    if found.integrity_id >= 0:
        head["integrity_id"] = found.integrity_id
    values["s7plus"] = head
    if found.parts:
        values["parts"] = [_part_as_dict(part, pdu, hidden) for part in found.parts]
    values["octets"] = without_secrets(pdu, hidden).hex()
    values["cut"] = pdu.cut
    facts = [fact.as_dict() for fact in pdu.malformed]
    values["malformed"] = facts + [fact.as_dict() | {"offset": pdu.place(fact.offset)} for fact in found.malformed]
    return _json(values)


def _part_as_dict(part: Part, pdu: PlusPdu, hidden: list[tuple[int, int]]) -> dict[str, object]:
    """Return a part with its fields, as those of S7 PDUs; ``depth`` is how many parts enclose it."""
    fields: list[dict[str, object]] = []
    for value in part.values:
        offset = pdu.place(int(value.offset))
        said: object = value.value if value.octets is None else value.octets.hex()
        if value.octets is not None and any([begin <= offset < end for begin, end in hidden]):
            said = bytes(len(value.octets)).hex()
        size = int(value.end) - int(value.offset)
        text = value.meaning or None
        fields.append({"name": value.field.name, "offset": offset, "size": size, "value": said, "text": text})
    return {
        "name": part.layout.name,
        "block": "data",
        "depth": part.depth,
        "offset": pdu.place(part.offset),
        "size": part.end - part.offset,
        "note": part.note or None,
        "fields": fields,
    }


def _json(values: object) -> str:
    """Return JSON in ASCII; DEL, which JSON would leave as it is, is escaped like every other control."""
    return json.dumps(values, separators=(",", ":")).replace("\x7f", "\\u007f")
