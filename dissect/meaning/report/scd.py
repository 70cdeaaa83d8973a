"""SCD messages and transactions in reports: as text and as JSON (docs/json.md, docs/scd-traffic.md)."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from dissect.engine.transactions.payloads import ScdMessage, ScdParameters
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.facet import Facet, Locate
from dissect.protocols.iso.upper import SCD, UPPER_NAMES
from dissect.protocols.s7.parameters import Parameters
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from dissect.engine.transactions.connection import Connection

_ENCODER: Final = json.JSONEncoder(separators=(",", ":"))
#: Name of the protocol in JSON.
PROTOCOL: Final = UPPER_NAMES[SCD]


class ScdFacet(Facet):
    """SCD in connections of its own. SCD in the items of S7comm is described with the S7comm transaction."""

    def reference(self, transaction: Transaction) -> str:
        """Return the transaction number (tid), empty where the envelope has none."""
        found = transaction.scd
        return str(found[0].message.tid) if found and "tid" in found[0].message.numbers else ""

    def function_number(self, transaction: Transaction) -> str:
        """Return an empty text: SCD services have names, but no function codes."""
        return ""

    def subject(self, transaction: Transaction) -> str:
        """Return objects, values and errors."""
        return scd_subject(transaction)

    def function_json(self, parameters: Parameters) -> str:
        """Return the ``function`` object of a transaction, and the protocol after it."""
        name = encodable(parameters.name) if isinstance(parameters, ScdParameters) else None
        return f'{_json({"code": None, "name": name})},"protocol":"{PROTOCOL}"'

    def tail_json(self, transaction: Transaction, locate: Locate | None) -> str:
        """Return the messages."""
        return scd_json(transaction, locate)

    def statistics(self, code: int) -> dict[str, object]:
        """Return the protocol; there is no function code."""
        return {"code": None, "protocol": PROTOCOL}


def scd_subject(transaction: Transaction) -> str:
    """Return the SCD of a transaction as text: objects, values and errors."""
    found = transaction.scd
    if not transaction.is_scd:
        return "; ".join([f"SCD {printable(one.binding)}: {_content(one)}" for one in found])
    said = [_said(one) for one in found]
    if len(found) == 2 and found[0].subject == found[1].subject:
        # a text that request and answer have in common is shown once
        texts = list(dict.fromkeys([text for text in said if text]))
        if len(texts) == 2 and texts[0].endswith(texts[1]):
            texts.pop()
        return _joined(_object(found[0]), ", ".join(texts))
    return " → ".join([_joined(_object(one), text) for one, text in zip(found, said, strict=True)])


def _joined(what: str, said: str) -> str:
    """Return an object and its text, two blanks between them; one blank before "=": "0x1000:0 Тип = 7"."""
    gap = " " if said.startswith("=") else "  "
    return f"{what}{gap}{said}".strip()


def _object(found: ScdMessage) -> str:
    """Return the object without the service, which the line shows before it as the function."""
    message = found.message
    text = found.subject
    if message.service == "pdo":
        return text.removeprefix("PDO ").removeprefix(message.pdo).strip()
    if message.content:
        return ""
    return text.removeprefix(message.service).strip()


def _content(found: ScdMessage) -> str:
    return _joined(found.subject, _said(found))


def _said(found: ScdMessage) -> str:
    """Return values, status and oddities of a message."""
    from dissect.scd.wording import physical_text, values_text

    message = found.message
    rows = found.values
    said = []
    if len(rows) == 1 and message.service in {"read", "write"}:
        said.append(f"= {physical_text(rows[0])}")
    elif rows:
        said.append(values_text(rows))
    if message.err and message.phase not in {"response", "abort"}:
        said.append(f"err {message.err} {printable(found.dictionary.error_text(message.err))}")
    if message.error is not None:
        said.append(f"NOT DECODED {message.error.code} {printable(message.error.detail)}")
    flags = [flag for flag in message.flags if not any(flag in row.flags for row in rows)]
    if flags:
        said.append(f"[{', '.join(flags)}]")
    return "  ".join(said)


def scd_summary(found: ScdMessage) -> str:
    """Return a message on one line, without packet, time and ends."""
    message = found.message
    parts = [f"SCD {message.phase or 'data':<8}"]
    if "tid" in message.numbers:
        parts.append(f"tid {message.tid:<3}")
    parts.append(found.subject)
    if message.err and message.phase in {"response", "abort"}:
        parts.append(f"err {message.err} {printable(found.dictionary.error_text(message.err))}")
    said = _said(found)
    if said.startswith("="):
        parts[-1] += f" {said}"
    elif said:
        parts.append(said)
    if found.place:
        parts.append(f"in {found.place}")
    return "  ".join(parts)


def scd_as_dict(found: ScdMessage, asked_by: int, place: tuple[str, int] | None) -> dict[str, object]:
    """Return a message as JSON-ready values.

    ``asked_by`` is the side whose messages are requests, -1 to omit whether it is one. ``place`` is (file, number of the packet
    in it), None if there is only one file.
    """
    from dissect.scd.wording import known_text, row_json

    message = found.message
    has = message.numbers
    error = message.error
    values: dict[str, object] = {}
    if asked_by >= 0:
        values["half"] = "request" if found.side == asked_by else "response"
    values |= {
        "binding": known_text(found.binding),
        "place": found.place or None,
        "offset": found.offset,
        "frame": found.frame if place is None else place[1],
        "service": message.service or None,
        "phase": message.phase or None,
        "tid": message.tid if "tid" in has else None,
        "err": message.err if "err" in has else None,
        "err_text": encodable(found.dictionary.error_text(message.err)) if message.err else None,
        "index": message.index if "index" in has else None,
        "sub": message.sub if "sub" in has else None,
        "pdo": message.pdo or None,
        "content": known_text(message.content) or None,
    }
    if place is not None:
        values["file"] = encodable(place[0])
    values["values"] = [row_json(row) for row in found.values]
    values["flags"] = list(message.flags)
    values["error"] = None
    if error is not None:
        values["error"] = {"code": error.code, "where": encodable(error.where), "detail": encodable(error.detail)}
    values["octets"] = found.octets.hex()
    return values


def scd_json(transaction: Transaction, locate: Locate | None) -> str:
    """Return a comma and the ``scd`` key of a transaction; empty if it has no SCD."""
    found = transaction.scd
    if not found:
        return ""
    asked_by = int(transaction.asked_by)
    told = [scd_as_dict(one, asked_by, None if locate is None else locate(int(one.frame))) for one in found]
    return f',"scd":{_json(told)}'


def scd_line_json(found: ScdMessage, time: str, connection: Connection, place: tuple[str, int] | None) -> str:
    """Return the line that `show -T jsonl` writes for a message; ``place`` is (file, packet) if there are several files."""
    ends = connection.tcp.ends
    values: dict[str, object] = {"schema": "s7dissect.pdu/1", "frame": found.frame}
    if place is not None:
        values |= {"frame": place[1], "file": encodable(place[0])}
    values |= {"time": time, "connection": found.connection}
    values |= {"src": str(ends[found.side]), "dst": str(ends[1 - found.side]), "protocol": PROTOCOL}
    values |= {"rosctr": None, "rosctr_name": None, "redundancy_id": None}
    values["pdu_ref"] = found.message.tid if "tid" in found.message.numbers else None
    values |= {"param_length": None, "data_length": None, "error_class": None, "error_code": None}
    values["function"] = {"code": None, "name": found.message.service or None}
    values["scd"] = scd_as_dict(found, -1, place)
    values["octets"] = found.octets.hex()
    values["cut"] = False
    values["malformed"] = []
    return _json(values)


def _json(values: object) -> str:
    """Return JSON in ASCII. The json module does not escape DEL; here it is escaped like any other control character."""
    return _ENCODER.encode(values).replace("\x7f", "\\u007f")
