"""S7comm-plus PDUs and transactions in reports: as text and as JSON (docs/json.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.facet import Facet
from dissect.meaning.report.words import NAMED
from dissect.protocols.iso.upper import S7COMM_PLUS, UPPER_NAMES
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7plus.alarms import ALARM, Alarm
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.hiding import shown_contents, without_secrets
from dissect.protocols.s7plus.ids import plain_id
from dissect.protocols.s7plus.items import Half, PlusItem, join_items
from dissect.protocols.s7plus.message import PlusPdu
from dissect.protocols.s7plus.parameters import PlusParameters, names_function
from dissect.protocols.s7plus.summary import summary
from dissect.protocols.s7plus.tables import CREATE_OBJECT, KEEP_ALIVE, NOTIFICATION, REQUEST, RETURN_CODES, SYSTEM_EVENT
from dissect.wire.part import Part
from dissect.wire.text import count, hex_number, json_text, shortened, some

#: Name of the protocol in JSON.
PROTOCOL: Final = UPPER_NAMES[S7COMM_PLUS]

_MESSAGE: Final = 100
#: Maximum number of characters of the summary of a PDU, and of items named on a line.
_SUMMARY: Final = 200
#: Maximum number of characters of the value of an item: enough for six members of a structure.
_VALUE: Final = 160
_ITEMS: Final = 20
#: Area numbers of S7comm by those of S7comm-plus.
S7_AREAS: Final = {80: 0x81, 81: 0x82, 82: 0x83, 83: 0x1C, 84: 0x1D}
DB_AREA: Final = 0x84

#: Functions that are described by their notes and their items; others with items are described only by the items.
_ITEMS_BESIDE: Final = frozenset((CREATE_OBJECT,))

#: Cache of the beginning of `head_json`, by version and opcode, for PDUs in one frame.
_BEGINNINGS: Final[dict[int, str]] = {}
#: Cache of the same for requests, up to the digest, by session, transport flags and version; and its maximum size.
_REQUESTS: Final[dict[int, str]] = {}
_MAX_REQUESTS: Final = 4096

_ENCODER: Final = json.JSONEncoder(separators=(",", ":"))
_NO_FUNCTION: Final[dict[str, object]] = {"code": None, "name": None}
#: A notification has no number of a function.
_NOTIFIED: Final[dict[str, object]] = {"code": None, "name": "notification"}


class PlusFacet(Facet):
    """S7comm-plus."""

    def reference(self, transaction: Transaction) -> str:
        """Return the sequence number; a notification has none."""
        return str(transaction.pdu_ref) if transaction.function >= 0 else ""

    def items(self, transaction: Transaction) -> list[str]:
        """Return each item with its value or error, in wire order."""
        return [item_text(item) for item in transaction.plus_results]

    def subject(self, transaction: Transaction) -> str:
        """Return the subject of a transaction: its items, notes on request and answer, or a subscription."""
        return plus_subject(transaction)

    def notes(self, transaction: Transaction) -> str:
        """Return the subject with only a few items: the refused ones, or if none was refused the first ones, without values."""
        return plus_subject(transaction, in_short)

    def statistics(self, code: int) -> dict[str, object]:
        """Return the function code, None for rows of several functions."""
        return {"code": f"0x{code & 0xFFFF:04x}" if names_function(code) else None, "protocol": PROTOCOL}


def plus_function(parameters: Parameters) -> str:
    """Return the ``function`` object of a transaction, and the protocol after it."""
    if not parameters.fragment:
        function = _NO_FUNCTION
        if isinstance(parameters, PlusParameters) and parameters.code >= 0:
            function = {"code": int(parameters.code), "name": parameters.code_name}
        elif isinstance(parameters, PlusParameters):
            function = _NOTIFIED
        parameters.fragment = f'{_json(function)},"protocol":"{PROTOCOL}"'
    return parameters.fragment


def plus_alarms(contents: Contents) -> str:
    """Return a comma and the key ``alarms``; empty if there are none."""
    alarms = ",".join([as_text(Alarm(one).as_dict()) for one in contents.objects if one.class_id == ALARM])
    return f',"alarms":[{alarms}]' if alarms else ""


def plus_notes(pdu: PlusPdu) -> list[str]:
    """Return notes on the head of a PDU, without its function: session, subscription, return value …; escaped."""
    said = []
    if pdu.session_id >= 0:
        said.append(f"session {plain_id(pdu.session_id)}")  # a session is an object: named as objects are
    if pdu.opcode == REQUEST and not pdu.wants_response:
        said.append("expects no response")
    if pdu.subscription_id >= 0:
        said.append(subscription_note(pdu.subscription_id))
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


def subscription_note(subscription: int) -> str:
    """Return the subscription that a notification belongs to."""
    return f"subscription {hex_number(subscription, 8)}"


def plus_summary(pdu: PlusPdu, found: Contents) -> list[str]:
    """Return the contents of a PDU in short texts, safe to show."""
    return [shortened(text, _VALUE) for text in summary(pdu, found)]


def plus_subject(transaction: Transaction, itemized: Callable[[list[PlusItem]], list[str]] | None = None) -> str:
    """Return the subject of an S7comm-plus transaction: its items, notes on request and answer, or a subscription.

    ``itemized`` makes texts of the items; by default each item is shown with its value or error, up to `_ITEMS` of them.
    """
    told_of = itemized if itemized is not None else _in_full
    asked, told = transaction._plus_halves(said=True)
    half = asked if asked is not None else told
    if half is None:
        return ""
    if half.pdu.opcode == NOTIFICATION:
        said = plus_notes(half.pdu)
    else:
        one_way = asked is not None and told is None and not asked.pdu.wants_response
        said = ["expects no response"] if one_way else []
    answer = "" if half.pdu.opcode == NOTIFICATION else "response: "
    wrong = (malformed_note(asked, "request: ") + malformed_note(told, answer))[:1]
    wrong += _lost_note(asked, "request") + _lost_note(told, answer.removesuffix(": ") or "notification")
    items = join_items(asked, told, transaction.connection.plus)
    if items and half.pdu.function not in _ITEMS_BESIDE:
        return ", ".join(said + told_of(items) + wrong)
    texts = [", ".join(summary(one.pdu, one.contents)) for one in (asked, told) if one is not None]
    said += [" → ".join([shortened(text, _SUMMARY) for text in texts if text])]
    if items:
        said.append("subscribes to " + ", ".join(told_of(items)))
    return ", ".join(([text for text in said if text] or plus_notes(half.pdu)) + wrong)


def item_text(item: PlusItem) -> str:
    """Return an item with its value or error: ``DB3."tank".level = Int 5``, ``MW100: refused``; escaped."""
    label = shortened(item.label, _MESSAGE)
    if item.return_code > 0:
        return f"{label}: {item.codes.name(item.return_code)}"
    text = item.text
    note = f" ({shortened(item.note, _MESSAGE)})" if item.note else ""
    return f"{label} = {shortened(text, _VALUE)}{note}" if text else f"{label}{note}"


def in_short(items: list[PlusItem]) -> list[str]:
    """Return a summary of items, in the form of S7comm's (`dissect.meaning.report.facets.items_in_short`)."""
    refused = [item_text(item) for item in items if item.return_code > 0]
    if not refused:
        names = [shortened(item.label, _MESSAGE) for item in items]
        return [some(names, NAMED)]
    total = f"{len(refused)} of {count(len(items), 'item')} refused: " if len(items) > 1 else ""
    return [total + ", ".join(refused[:NAMED]) + (", …" if len(refused) > NAMED else "")]


def _in_full(items: list[PlusItem]) -> list[str]:
    texts = [item_text(item) for item in items]
    return texts if len(texts) <= _ITEMS else [*texts[:_ITEMS], f"and {len(texts) - _ITEMS} more"]


def head_begin(pdu: PlusPdu) -> str:
    """Return the beginning of `head_json`, up to the digest."""
    if pdu.opcode == REQUEST and pdu.session_id >= 0:
        return _known_request(pdu)
    return _beginning(pdu) + _other_head(pdu)


def head_json(pdu: PlusPdu, integrity_id: int = -1) -> str:
    """Return the object with the keys that only S7comm-plus has, without keys that the PDU lacks.

    ``integrity_id`` is -1 for none.
    """
    digest = f',"integrity":"{pdu.integrity.hex()}"' if pdu.integrity else ""
    message = f',"message":{json_text(pdu.message.decode("latin-1"))}' if pdu.message else ""
    id_ = f',"integrity_id":{integrity_id}' if integrity_id >= 0 else ""
    return f"{head_begin(pdu)}{digest}{message}{id_}}}"


def notification_begin(pdu: PlusPdu) -> str:
    """Return the beginning of a notification's `head_json`, up to the numbers that differ in each notification."""
    return f'{_beginning(pdu)},"subscription_id":{pdu.subscription_id}'


def _beginning(pdu: PlusPdu) -> str:
    """Return the beginning of `head_json`, up to the opcode."""
    opcode = pdu.opcode
    key = pdu.version << 8 | opcode if pdu.frames == 1 and opcode >= 0 else -1
    said = _BEGINNINGS.get(key, "")
    if not said:
        version = str(pdu.version) if pdu.version >= 0 else "null"
        said = f'{{"kind":{json_text(pdu.kind)},"version":{version},"frames":{pdu.frames}'
        if opcode >= 0:
            said += f',"opcode":{opcode}'
        if key >= 0:
            _BEGINNINGS[key] = said
    return said


def _known_request(pdu: PlusPdu) -> str:
    """Return `head_begin` of a request with a complete head, from the cache: it is the same for the requests of a session."""
    key = -1
    if pdu.frames == 1 and 0 <= pdu.transport_flags <= 0xFF:
        key = (pdu.session_id << 8 | pdu.transport_flags) << 8 | pdu.version
    said = _REQUESTS.get(key, "")
    if not said:
        wants = "true" if pdu.wants_response else "false"
        said = f'{_beginning(pdu)},"session_id":{pdu.session_id},"transport_flags":{pdu.transport_flags}'
        said += f',"wants_response":{wants}'
        if key >= 0:
            if len(_REQUESTS) >= _MAX_REQUESTS:
                _REQUESTS.clear()
            _REQUESTS[key] = said
    return said


def _other_head(pdu: PlusPdu) -> str:
    """Return the keys of `head_json` between opcode and digest, for any PDU except a request with a complete head."""
    opcode = pdu.opcode
    said = ""
    if pdu.subscription_id >= 0:
        said += f',"subscription_id":{pdu.subscription_id}'
    number = pdu.sequence if opcode == NOTIFICATION else pdu.number
    if number >= 0:
        said += f',"number":{number}'
    if pdu.credit_tick >= 0:
        said += f',"credit_tick":{pdu.credit_tick}'
    if pdu.transport_flags >= 0:
        said += f',"transport_flags":{pdu.transport_flags}'
    if opcode == REQUEST:
        said += ',"wants_response":true' if pdu.wants_response else ',"wants_response":false'
    if pdu.return_value >= 0:
        said += f',"return_value":"0x{pdu.return_value:x}"' if pdu.return_value else ',"return_value":"0x0"'
    return said


def malformed_note(half: Half | None, which: str = "") -> list[str]:
    """Return a note if the contents of a whole PDU are malformed, or of an unknown kind, with the place in the PDU.

    ``which`` precedes the fault.
    """
    if half is None or half.pdu.cut or half.pdu.malformed or not half.contents.malformed:
        return []
    fact = half.contents.malformed[0]
    return [f"{fact.word} {which}{fact.at(half.pdu.place(fact.offset))}"]


def _lost_note(half: Half | None, which: str) -> list[str]:
    """Return a note if the end of a PDU is missing, so that only its beginning could be described."""
    return [f"{which} incomplete"] if half is not None and not half.pdu.whole else []


def as_text(value: object) -> str:
    """Return a value as JSON. For small values, which most are, this is several times faster than the json module."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, str):
        return json_text(value)
    if isinstance(value, list):
        return f"[{','.join([as_text(one) for one in value])}]"
    if isinstance(value, dict):
        return f"{{{','.join([f'{json_text(key)}:{as_text(one)}' for key, one in value.items()])}}}"
    return repr(value) if isinstance(value, float) and math.isfinite(value) else _json(value)


def plus_pdu_line(pdu: PlusPdu, time: str, connection: Connection, place: tuple[str, int] | None) -> str:
    """Return a PDU as a line of JSON, with the keys of S7comm PDUs, too; those that S7comm-plus does not have are null.

    ``place`` is (file, number of the packet in it), None if there is only one file.
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
    parts: dict[str, object] = {}
    if found.parts:
        parts["parts"] = [_part_as_dict(part, pdu, hidden) for part in found.parts]
    parts["octets"] = without_secrets(pdu, hidden).hex()
    parts["cut"] = pdu.cut
    facts = [fact.as_dict() for fact in pdu.malformed]
    parts["malformed"] = facts + [fact.as_dict() | {"offset": pdu.place(fact.offset)} for fact in found.malformed]
    return f'{_json(values)[:-1]},"s7plus":{head_json(pdu, found.integrity_id)},{_json(parts)[1:]}'


def _part_as_dict(part: Part, pdu: PlusPdu, hidden: list[tuple[int, int]]) -> dict[str, object]:
    """Return a part with its fields, as for S7comm PDUs, and ``depth``, the number of parts that enclose it.

    Octets in the ranges of ``hidden`` (begin, end in the PDU) are secrets and written as zeros.
    """
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
    """Return JSON in ASCII. The json module does not escape DEL; here it is escaped like any other control character."""
    return _ENCODER.encode(values).replace("\x7f", "\\u007f")
