"""What reports say of an S7comm-plus PDU beside its function: in words, and as JSON-ready values (docs/json.md)."""

from __future__ import annotations

import json
from typing import Final

from dissect.iso.upper import S7COMM_PLUS, UPPER_NAMES
from dissect.s7plus.message import PlusPdu
from dissect.s7plus.parameters import PlusParameters
from dissect.s7plus.tables import KEEP_ALIVE, NOTIFICATION, REQUEST, RETURN_CODES, SYSTEM_EVENT
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import Transaction
from dissect.wire.text import shortened

#: Name of the protocol in JSON.
PROTOCOL: Final = UPPER_NAMES[S7COMM_PLUS]

_MESSAGE: Final = 100
_NO_FUNCTION: Final = {"code": None, "name": None}


def plus_notes(pdu: PlusPdu) -> list[str]:
    """Return what a PDU says beside its function, in a few words each, safe to show."""
    said = []
    if pdu.session_id >= 0:
        said.append(f"session 0x{pdu.session_id:08x}")
    if pdu.opcode == REQUEST and not pdu.wants_response:
        said.append("wants no response")
    if pdu.subscription_id >= 0:
        said.append(f"subscription 0x{pdu.subscription_id:08x}")
        if pdu.sequence >= 0:
            said.append(f"number {pdu.sequence}")
    if pdu.return_code > 0:
        said.append(f"return value 0x{pdu.return_value:x} {RETURN_CODES.name(pdu.return_code)}")
    if pdu.version == SYSTEM_EVENT and pdu.number >= 0:
        said.append(f"{pdu.number} octets confirmed")
    elif pdu.version == KEEP_ALIVE and pdu.number >= 0:
        said.append(f"number {pdu.number}")
    if pdu.message:
        said.append(shortened(pdu.message.decode("latin-1"), _MESSAGE))
    return said


def plus_subject(transaction: Transaction) -> str:
    """Return what an S7comm-plus transaction is about: the session, or the subscription that tells it."""
    asked = transaction.plus_request
    told = transaction.plus_response if asked is None else None
    pdu = asked if asked is not None else told
    return ", ".join(plus_notes(pdu)) if pdu is not None else ""


def plus_as_dict(pdu: PlusPdu) -> dict[str, object]:
    """Return what only S7comm-plus has; keys that the PDU does not have are left out."""
    values: dict[str, object] = {"kind": pdu.kind, "version": pdu.version if pdu.version >= 0 else None}
    values["frames"] = pdu.frames
    numbers = {
        "opcode": pdu.opcode,
        "session_id": pdu.session_id,
        "subscription_id": pdu.subscription_id,
        "number": pdu.sequence if pdu.opcode == NOTIFICATION else pdu.number,
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
    asked, told = transaction.plus_request, transaction.plus_response
    values = {
        "asks": plus_notes(asked) if asked is not None else [],
        "tells": plus_notes(told) if told is not None else [],
        "s7plus": {
            "request": plus_as_dict(asked) if asked is not None else None,
            "response": plus_as_dict(told) if told is not None else None,
        },
    }
    return "," + _json(values)[1:-1]


def plus_function_json(parameters: PlusParameters) -> str:
    """Return the ``function`` object of a transaction, and the protocol after it."""
    function = {"code": parameters.code, "name": parameters.code_name} if parameters.code >= 0 else _NO_FUNCTION
    return f'{_json(function)},"protocol":"{PROTOCOL}"'


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
    values["s7plus"] = plus_as_dict(pdu)
    values["octets"] = pdu.octets.hex()
    values["cut"] = pdu.cut
    values["malformed"] = [fact.as_dict() for fact in pdu.malformed]
    return _json(values)


def _json(values: object) -> str:
    """Return JSON in ASCII; DEL, which JSON would leave as it is, is escaped like every other control."""
    return json.dumps(values, separators=(",", ":")).replace("\x7f", "\\u007f")
