"""PDUs as lines of JSON: header, items and parts, and faults (docs/json.md)."""

from __future__ import annotations

import json

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import ScdMessage
from dissect.meaning.report.facet import Locate
from dissect.meaning.report.headers import Header
from dissect.meaning.report.item_json import CODE, function_text, item_text, setup_text, value_json
from dissect.meaning.report.plus import plus_pdu_line
from dissect.meaning.report.scd import scd_line_json
from dissect.meaning.report.tpdu_json import PDU_SCHEMA
from dissect.protocols.s7.items import DataItem
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.tables import ROSCTR
from dissect.protocols.s7plus.message import PlusPdu
from dissect.wire.layout import FieldValue
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part
from dissect.wire.text import Clock, json_text


class PduLines:
    """Makes the JSON lines of PDUs. With ``locate``, a packet's number is that within its file, and the file is named."""

    def __init__(self) -> None:
        self._clock: Clock = Clock()
        self.locate: Locate | None = None

    def line(self, pdu: Pdu, connection: Connection) -> str:
        """Return the line of one PDU, without a line end."""
        ends = connection.tcp.ends
        frame = str(pdu.frame)
        if self.locate is not None:
            name, number = self.locate(pdu.frame)
            frame = f'{number},"file":{json_text(name)}'
        error = f'{pdu.error_class},"error_code":{pdu.error_code}' if pdu.error_class >= 0 else 'null,"error_code":null'
        faults: list[Malformed] = []
        carried = _body(pdu, faults)
        told = ",".join([_malformed(fact) for fact in [*pdu.malformed, *faults]])
        return (
            f'{{"schema":"{PDU_SCHEMA}","frame":{frame},"time":"{self._clock.iso(pdu.time_ns)}"'
            f',"connection":{pdu.connection},"src":{json_text(str(ends[pdu.side]))},"dst":{json_text(str(ends[1 - pdu.side]))}'
            f',"protocol":"s7comm",{_header(pdu)}'
            f',"error_class":{error},"function":{function_text(pdu.parameters)}'
            f"{carried}"
            f',"cut":{"true" if pdu.cut else "false"},"malformed":[{told}]}}'
        )

    def scd_line(self, found: ScdMessage, connection: Connection) -> str:
        """Return the line of one SCD message, without a line end."""
        place = self.locate(found.frame) if self.locate is not None else None
        return scd_line_json(found, self._clock.iso(found.time_ns), connection, place)

    def plus_line(self, pdu: PlusPdu, connection: Connection) -> str:
        """Return the line of one S7comm-plus PDU, without a line end."""
        place = self.locate(pdu.frame) if self.locate is not None else None
        return plus_pdu_line(pdu, self._clock.iso(pdu.time_ns), connection, place)


def with_header(line: str, header: Header | None) -> str:
    """Return the line of a PDU with the irregularities of its TPDU header; nearly always the line unchanged."""
    if header is None:
        return line
    told = ",".join([_malformed(fact) for fact in header.faults])
    behind = "true" if header.behind else "false"
    return f'{line[:-1]},"tpdu":{{"behind_malformed":{behind},"malformed":[{told}]}}}}'


def _header(pdu: Pdu) -> str:
    """Return the fields of the header; null for those that a cut header lacks."""
    rosctr = f'{pdu.rosctr},"rosctr_name":{json_text(ROSCTR.name(pdu.rosctr))}'
    if pdu.rosctr < 0:
        rosctr = 'null,"rosctr_name":null'
    if pdu.pdu_ref < 0:
        return f'"rosctr":{rosctr},"redundancy_id":null,"pdu_ref":null,"param_length":null,"data_length":null'
    return (
        f'"rosctr":{rosctr},"redundancy_id":{pdu.redundancy_id},"pdu_ref":{pdu.pdu_ref}'
        f',"param_length":{pdu.param_length},"data_length":{pdu.data_length}'
    )


def _malformed(fact: Malformed) -> str:
    return json.dumps(fact.as_dict(), separators=(",", ":"))


def _body(pdu: Pdu, faults: list[Malformed]) -> str:
    """Return the contents of the PDU: setup, request items, data items, return codes, parts, and undecoded octets.

    Contradictions within its parts are added to ``faults``, unless the capture cut the PDU.
    """
    parameters = pdu.parameters
    text = ""
    if parameters.item_count >= 0:
        text += f',"item_count":{parameters.item_count}'
    if parameters.setup is not None:
        text += f',"setup":{setup_text(parameters.setup)}'
    if parameters.items:
        items = ",".join([item_text(item)[: -len(CODE)] + "}" for item in parameters.items])
        text += f',"items":[{items}]'
    data_items = pdu.data_items()
    if data_items:
        text += f',"data_items":[{",".join([_data_item(pdu, index, item) for index, item in enumerate(data_items)])}]'
    elif codes := pdu.return_codes():
        text += f',"return_codes":[{",".join([str(code) for code in codes])}]'
    else:
        if parameters.setup is None and not parameters.items and len(parameters.octets) > 2:
            text += f',"parameters":"{parameters.octets.hex()}"'
        if pdu.data:
            text += f',"data":"{pdu.data.hex()}"'
        if parameters.setup is None and not parameters.items:
            body = pdu.body
            if not pdu.cut:
                faults += body.malformed
            parts = [_part("parameters", part) for part in body.parameters] + [
                _part("data", part) for part in body.data
            ]
            text += f',"parts":[{",".join(parts)}]'
    if pdu.malformed or pdu.cut:
        text += f',"octets":"{pdu.octets.hex()}"'  # some of them may not have been decoded
    return text


def _part(block: str, part: Part) -> str:
    """Return a part of a body with its fields."""
    note = json_text(part.note) if part.note else "null"
    return (
        f'{{"name":{json_text(part.layout.name)},"block":"{block}","offset":{part.offset}'
        f',"size":{part.end - part.offset},"note":{note},"fields":[{",".join([_field(value) for value in part.values])}]}}'
    )


def _field(value: FieldValue) -> str:
    said = str(value.value) if value.octets is None else f'"{value.octets.hex()}"'
    meaning = value.meaning
    text = json_text(meaning) if meaning else "null"
    return (
        f'{{"name":{json_text(value.field.name)},"offset":{value.offset},"size":{value.end - value.offset}'
        f',"value":{said},"text":{text}}}'
    )


def _data_item(pdu: Pdu, index: int, answer: DataItem) -> str:
    """Return a data item; in a write request with its value, because the request item states the type of the data."""
    text = (
        f'{{"return_code":{answer.return_code},"transport_size":{answer.transport_size},"length":{answer.length}'
        f',"data":"{answer.data.hex()}"'
    )
    if index < len(pdu.parameters.items):
        item = pdu.parameters.items[index]
        text += f',"value":{value_json(item, answer.data)}'
    return text + "}"
