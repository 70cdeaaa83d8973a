"""The facts that `-e` and `-Y` show in addition to the other tables: items as lists, both PDUs, the connection of a thing.

A list has a value for each item that has one, in the form of JSON, separated by commas. ``link`` is the row of the connection
in the table of connections; later agreements are unknown when a transaction ends, so a field may be empty.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, Final

from dissect.protocols.s7.tables import ACK_DATA, AREA_LETTERS, AREAS, DB_AREAS, RETURN_CODES, TRANSPORT_SIZES
from dissect.protocols.s7plus.tables import NOTIFIED, OPCODES
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES
from tests.faces.cells import Cell, Fact, Rows, ends
from tests.faces.kinds import COUNT, END, UNTOLD, WORD
from tests.faces.records import Record

# A row for a fact, with as many cells on a line as fit.
# fmt: off
# ---- items as lists -------------------------------------------------------------------------------------------------


def _all(one: Callable[[Record], Any]) -> Cell:
    """Return a cell with a list over all items, including SCD, with a place for each item."""

    def made(value: Any, record: Record) -> Any:
        if record.get("protocol") == "s7comm_plus" and value is None:
            return UNTOLD  # `show` decodes those of S7comm-plus with -V only
        scd = [{**row, "scd": half} for half in record.get("scd", []) for row in half["values"]]
        found: list[Any] = []
        for item in [*(value or []), *scd]:
            told = one(item)
            several = told if isinstance(told, list) else [] if told is None else [told]
            found.append(";".join([_shown(each) for each in several]))
        return ",".join(found) or None

    return Cell("items", made)


def _shown(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _label(item: Record) -> Any:
    count = item.get("count")
    address = item["address"]
    return f"{address} x{count}" if address is not None and count is not None and count != 1 else address


def _code(item: Record) -> Any:
    code = item.get("return_code")
    if code is None:
        return None
    return (PLUS_CODES if code > 0xFF else NOTIFIED if "path" in item and code in NOTIFIED else RETURN_CODES).name(code)


def _of_area(item: Record) -> Any:
    area = item.get("area")
    return AREA_LETTERS.get(area, AREAS.name(area)) if area is not None else None


def _db(item: Record) -> Any:
    return item.get("db") if item.get("area") in DB_AREAS else None


def _of_type(item: Record) -> Any:
    size = item.get("transport_size")
    return TRANSPORT_SIZES.name(size) if size is not None else item.get("type")


def _content(item: Record) -> Any:
    """Return the value of an item; a structure, or no element of a list, cannot be compared."""
    value = item["physical"] if "scd" in item else item["value"]
    if isinstance(value, list):
        return [one for one in value if one is not None]
    return value


def _values(record_value: Any, record: Record) -> Any:
    """Return the values of all items; if a structure or text is among them, they are written in other ways."""
    cell = _all(_content)
    assert cell.read is not None
    plain = all([not isinstance(item["value"], (dict, str)) for item in record_value]) and "scd" not in record
    return cell.read(record_value, record) if plain else UNTOLD


def _places(value: Any, record: Record) -> Any:
    """Return the number of places that a list of the items of a read or write must have: one for each."""
    whole = record["function"]["code"] in {4, 5} and record.get("protocol") is None
    return len(value) if whole and value and "scd" not in record else UNTOLD


def _counted(value: Any, _: Record) -> Any:
    """Return the number of places of a list; an empty one may belong to one item without a value."""
    return len(value.split(",")) if value else UNTOLD


def _rows(record: str) -> Rows:
    """Return the rows that transactions and messages share."""
    rows = Rows(record)
    rows("item_addresses", WORD, jsonl=_all(_label), fields="address")
    rows("item_dbs", WORD, jsonl=_all(_db), fields="db")
    rows("item_areas", WORD, jsonl=_all(_of_area), fields="area")
    rows("item_types", WORD, jsonl=_all(_of_type), fields="type")
    rows("item_counts", WORD, jsonl=_all(lambda item: item.get("count")), fields="count")
    return rows


_transaction = _rows("transaction")
_transaction("item_values", WORD, jsonl=Cell("items", _values), fields="value")
_transaction("item_data", WORD, jsonl=_all(lambda item: item.get("data")), fields="data")
_transaction("item_return_codes", WORD, jsonl=_all(_code), fields="return_code")
_transaction("places_of_data", COUNT, jsonl=Cell("items", _places), fields=Cell("data", _counted))
_transaction("places_of_return_codes", COUNT, jsonl=Cell("items", _places), fields=Cell("return_code", _counted))
_transaction("words", WORD, fields="subject", text=Cell("rest", None, lambda value, told: value is None or value in told))

# ---- both PDUs of S7comm-plus, and SCD ------------------------------------------------------------------------------


def _halves(name: str, show: Callable[[Any], Any] = str) -> Cell:
    """Return a cell with the values of request and response of S7comm-plus under a name."""

    def made(value: Any, record: Record) -> Any:
        both = record.get("s7plus") or {}
        found = [half.get(name) for half in (both.get("request"), both.get("response")) if half]
        return ",".join([str(show(one)) for one in found if one is not None]) or None

    return Cell("s7plus", made)


def _scd(name: str, show: Callable[[Any], Any] = str) -> Cell:
    """Return a cell with the values of the SCD messages under a name."""

    def made(value: Any, record: Record) -> Any:
        found = [half[name] for half in record.get("scd", [])]
        flat = [one for told in found for one in (told if isinstance(told, list) else [told])]
        return ",".join([str(show(one)) for one in flat if one is not None]) or None

    return Cell("scd", made)


def _scd_values(name: str) -> Cell:
    def made(value: Any, record: Record) -> Any:
        rows = [row for half in record.get("scd", []) for row in half["values"]]
        return ",".join([_shown(row[name]) for row in rows if row[name] not in {None, ""}]) or None

    return Cell("scd", made)


_transaction("s7plus_version", WORD, jsonl=_halves("version"), fields="s7plus.version")
_transaction("s7plus_opcode", WORD, jsonl=_halves("opcode", OPCODES.name), fields="s7plus.opcode")
_transaction("s7plus_session", WORD, jsonl=_halves("session_id"), fields="s7plus.session_id")
_transaction("s7plus_subscription", WORD, jsonl=_halves("subscription_id"), fields="s7plus.subscription_id")
_transaction("s7plus_return_value", WORD, jsonl=_halves("return_value", lambda text: int(text, 16)),
             fields="s7plus.return_value")
_transaction("scd_error", WORD, jsonl=_scd("error", lambda error: error["code"]), fields="scd.error")
for _name in ("binding", "service", "phase", "tid", "err", "index", "sub", "pdo", "flags"):
    _transaction(f"scd_{_name}", WORD, jsonl=_scd(_name), fields=f"scd.{_name}")
_transaction("scd_names", WORD, jsonl=_scd_values("name"), fields="scd.name")
_transaction("scd_values", WORD, jsonl=_scd_values("physical"), fields="scd.value")
_transaction("scd_units", WORD, jsonl=_scd_values("unit"), fields="scd.unit")

def _codes_of(value: Any, record: Record) -> Any:
    """Return the names of the return codes of an answer, of a write or of the items of a read."""
    codes = value if value is not None else [one["return_code"] for one in record.get("data_items", [])]
    return ",".join([RETURN_CODES.name(one) for one in codes]) or None if record["rosctr"] == ACK_DATA else UNTOLD


_pdu = _rows("pdu")
_pdu("s7plus_version", WORD, jsonl=Cell("s7plus.version", lambda value, _: str(value) if value is not None else None),
     fields="s7plus.version")
_pdu("s7plus_opcode", WORD, jsonl=Cell("s7plus.opcode", lambda value, _: OPCODES.name(value) if value is not None else None),
     fields="s7plus.opcode")
_pdu("s7plus_session", WORD, jsonl=Cell("s7plus.session_id", lambda value, _: str(value) if value is not None else None),
     fields="s7plus.session_id")
_pdu("s7plus_subscription", WORD,
     jsonl=Cell("s7plus.subscription_id", lambda value, _: str(value) if value is not None else None),
     fields="s7plus.subscription_id")
_pdu("s7plus_return_value", WORD,
     jsonl=Cell("s7plus.return_value", lambda value, _: str(int(value, 16)) if value is not None else None),
     fields="s7plus.return_value")
_pdu("items", COUNT,
     jsonl=Cell("items", lambda value, record: len(value or []) if record["protocol"] == "s7comm" else UNTOLD),
     fields="items")
_pdu("return_codes", WORD,
     jsonl=Cell("return_codes", _codes_of), fields="return_code")

# ---- the connection of a thing --------------------------------------------------------------------------------------


def _if_known(value: Any, told: Any) -> bool:
    return told is None or value == told


def _link(rows: Rows, *faces: str) -> None:
    """Add the facts of the connection of a kind of record, which ``faces`` show in the fields of `-e` and `-Y`."""
    for name, kind, column in (
        ("calling_tsap", WORD, "tsap_calling"), ("called_tsap", WORD, "tsap_called"), ("rack", COUNT, "rack"),
        ("slot", COUNT, "slot"),
    ):  # fmt: skip
        rows(f"link_{name}", kind, link=column, **{face: Cell(name, None, _if_known) for face in faces})
    rows(
        "link_vlan",
        WORD,
        link=Cell("vlans", lambda value, _: ",".join(map(str, value)) or None),
        **dict.fromkeys(faces, "vlan"),
    )
    rows("link_ends", WORD, link=Cell("client_host", _both), **{face: Cell("host", _in_order) for face in faces})
    rows(
        "link_ports",
        WORD,
        link=Cell(
            "client_port",
            lambda value, record: _in_order(
                ",".join([str(one) for one in (value, record["server_port"]) if one is not None]), record
            ),
        ),
        **{face: Cell("port", _in_order) for face in faces},
    )


def _in_order(value: Any, _: Record) -> Any:
    return ",".join(sorted(value.split(","))) if value else None


def _both(value: Any, record: Record) -> Any:
    client, server = ends("client_host", "client_port"), ends("server_host", "server_port")
    assert client.read is not None
    assert server.read is not None
    return ",".join(sorted([client.read(value, record), server.read(record["server_host"], record)]))


_operation, _finding = Rows("operation"), Rows("finding")
_link(_transaction, "fields")
_link(_pdu, "fields")
_link(_operation, "fields")
_link(_finding, "where")
_transaction("uid", WORD, link="uid", zeek="uid")
_transaction("community_id", WORD, link="community_id", zeek="community_id", ecs="network.community_id")
_transaction("transport", WORD, link="transport", ecs="network.transport")
_transaction("link_protocol", WORD, link="protocol", ecs=Cell("network.protocol", None, _if_known))
_pdu("uid", WORD, link="uid", zeek="uid")
_pdu("client", END, tables=ends("client_host", "client_port"), fields="client", zeek=ends("id.orig_h", "id.orig_p"))
_pdu("server", END, tables=ends("server_host", "server_port"), fields="server", zeek=ends("id.resp_h", "id.resp_p"))
_finding("community_id", WORD, link="community_id", ecs="network.community_id",
         stix=Cell("content", lambda value, _: found[1] if (found := re.search(r"Community ID (\S+)\. ", value)) else UNTOLD))
_finding("transport", WORD, link="transport", ecs="network.transport")
_finding("link_protocol", WORD, link="protocol", ecs=Cell("network.protocol", None, _if_known))

ROWS: Final[list[Fact]] = [*_transaction.rows, *_pdu.rows, *_operation.rows, *_finding.rows]
