"""TPDUs without an S7 PDU as JSON: connects with their TSAPs, disconnects and errors with reasons.

They are rare, so the json module is fast enough.
"""

from __future__ import annotations

import json
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.meaning.report.words import Places, carried
from dissect.protocols.iso.cotp import Tpdu
from dissect.protocols.iso.tables import DT, ED
from dissect.protocols.iso.tsap import Tsap
from dissect.wire.text import Clock

PDU_SCHEMA: Final = "s7dissect.pdu/1"

#: Header fields of S7comm, which a TPDU does not have.
_NOT_S7 = (
    "rosctr",
    "rosctr_name",
    "redundancy_id",
    "pdu_ref",
    "param_length",
    "data_length",
    "error_class",
    "error_code",
)


def tpdu_json_line(tpdu: Tpdu, frame: int, time_ns: int, connection: Connection, side: int, places: Places) -> str:
    """Return a TPDU as the line of `show -T jsonl`, without a line end."""
    ends = connection.tcp.ends
    values: dict[str, object] = {"schema": PDU_SCHEMA, "frame": places.number(frame)}
    if places.several:
        values["file"] = places.locate(frame)[0]
    values.update(
        time=Clock().iso(time_ns),
        connection=int(connection.number),
        src=str(ends[side]),
        dst=str(ends[1 - side]),
        protocol="cotp",
        **dict.fromkeys(_NOT_S7),
        function={"code": None, "name": None},
        cotp=_facts(tpdu),
        cut=False,
        malformed=[fact.as_dict() for fact in tpdu.malformed],
    )
    return json.dumps(values, separators=(",", ":")).replace("\x7f", "\\u007f")


def _facts(tpdu: Tpdu) -> dict[str, object]:
    """Return the type, the fields of the fixed part by name, and the contents of the variable part."""
    facts: dict[str, object] = {"type": tpdu.name}
    facts["fields"] = {value.field.label: int(value.value) for value in tpdu.fields if value.octets is None}
    why = [value for value in tpdu.fields if value.field.name in {"reason", "cause"}]
    facts["reason"] = {"code": int(why[0].value), "name": why[0].meaning or None} if why else None
    facts["calling_tsap"] = _tsap(tpdu.tsap(0xC1))
    facts["called_tsap"] = _tsap(tpdu.tsap(0xC2))
    facts["tpdu_size"] = int(tpdu.tpdu_size) or None
    if tpdu.type in {DT, ED}:
        facts["carries"] = carried(tpdu) or None
        facts["octets"] = len(tpdu.data)
    return facts


def _tsap(tsap: Tsap | None) -> dict[str, object] | None:
    return tsap.as_dict() if tsap is not None else None
