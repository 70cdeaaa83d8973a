"""The facts of a transaction and of its items.

Their writers are written by hand for compilation; tests compare them with these tables.
"""

from __future__ import annotations

from typing import Any, Final

from dissect.engine.transactions.transaction import (
    CERTAINTIES,
    DOUBT_TEXTS,
    LIKELY,
    OUTCOMES,
    REASON_TEXTS,
    Transaction,
)
from dissect.meaning.facts.fact import (
    BYTES,
    CODE,
    COUNT,
    COUNTS,
    DURATION,
    END,
    FILE,
    FLAG,
    FRAME,
    INSTANT,
    JSON,
    REAL,
    RECORDS,
    TEXT,
    TIME,
    WORD,
    WORDS,
    Fact,
    by_name,
)
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES
from dissect.protocols.s7.tables import JOB, NUMBERED_AREAS, ROSCTR, SUCCESS, USERDATA
from dissect.wire.text import encodable


def _protocol(of: Transaction) -> str:
    return UPPER_NAMES[S7COMM_PLUS if of.is_plus else SCD if of.is_scd else S7COMM]


def _response_time(of: Transaction) -> int | None:
    return int(of.response_ns) if of.response_frame and (not of.request_frame or of.is_likely) else None


def _head(of: Transaction, name: str) -> int | None:
    head = of.parameters.userdata
    return int(getattr(head, name)) if head is not None else None


def _errors(of: Transaction) -> list[str]:
    return [encodable(f"{f'{one.where} {one.address}' if one.address else one.where}: {one.name}") for one in of.errors]


def _at(of: Any, bit: bool) -> int | None:
    """Return the byte at which an item begins, or the bit in it; timers and counters have a number and no bits."""
    place = of.place
    if place is None or place.area < 0:
        return None
    if place.area in NUMBERED_AREAS:
        return None if bit else int(place.start)
    return int(place.start & 7 if bit else place.start >> 3)


_ITEM: Final[tuple[Fact[Any], ...]] = (
    Fact("address", TEXT, "The address in the usual notation, for example `DB10.DBW4`; for syntaxes other than S7ANY the name"
         " of the syntax and the bytes. Null when the answer has more items than the request, or there is no request."
         " S7comm-plus: with the names of the program where they passed in the capture, else the LIDs.", None, null=True),
    Fact("syntax_id", COUNT, "How the address is written, 16 for S7ANY; null for a variable of a test function.",
         None, null=True, most=255),
    Fact("area", COUNT, "Memory area, for example 132 (0x84) for data blocks. This and the four keys below it are null for"
         " syntaxes other than S7ANY.", None, null=True, most=255),
    Fact("db", COUNT, "Number of the data block; for other areas the number in its place in the request, usually 0.",
         None, null=True, most=65535),
    Fact("start_bit", COUNT, "The address field as it is on the wire: byte times 8 plus bit; the plain number of a timer or"
         " counter.", None, null=True, most=16777215),
    Fact("transport_size", COUNT, "Requested type of one element, for example 4 for WORD.", None, null=True, most=255),
    Fact("count", COUNT, "Requested elements.", lambda of: of.count, null=True, most=65535),
    Fact("return_code", COUNT, "255 success, otherwise the reason for the refusal; null without an answer; in an indication"
         " 254 for an unchanged value. S7comm-plus: 255 success as well, else the lower 16 bits of the return value, in a"
         " notification 19 or 3, for which it gives no reason.",
         lambda of: of.return_code.number if of.return_code is not None else None, null=True, most=65535),
    Fact("data", BYTES, "Bytes read or written, in hexadecimal; null when there are none.", lambda of: of.data, null=True),
    Fact("value", JSON, "`data` decoded by `transport_size`; null when there is none, it does not have the requested size, or"
         " the meaning of the type is unknown. S7comm-plus values carry their own type; null for one that contradicts its"
         " declaration.", None, shape={"$ref": "#/$defs/value"}),
    Fact("text", TEXT, "Only where an array of bytes spells one of four characters or more: ASCII that can be printed, filled"
         " up with NULs or blanks, or the content of an S7 STRING. `value` keeps the numbers.", None, rare=True),
    Fact("tags", JSON, "Only with `--tags`: the tags that the item covers, in the order of their places; empty for none.",
         None, rare=True, shape={"type": "array", "items": {"$ref": "#/$defs/tag"}}),
    Fact("untagged", JSON, "Only with `--tags`: the bytes of an item with tags that none of them covers; empty for an item"
         " without tags.", None, rare=True, shape={"type": "array", "items": {"$ref": "#/$defs/untagged"}}),
    Fact("number", COUNT, "S7comm-plus only: number of the item, in a notification its reference.", None, rare=True),
    Fact("type", TEXT, "S7comm-plus only: type of the value, or of its elements.",
         None, rare=True, shape={"type": ["string", "null"]}),
    Fact("crc", TEXT, "S7comm-plus only: checksum of the symbol that the item is addressed by; null for none.",
         None, rare=True, shape={"type": ["string", "null"], "pattern": "^0x[0-9a-f]{8}$"}),
    Fact("path", COUNTS, "S7comm-plus only: area or object, attribute, and LIDs; null when the subscription of a notification"
         " was not captured.", None, rare=True, shape={"type": ["array", "null"], "items": {"type": "integer", "minimum": 0}}),
    Fact("note", TEXT, "S7comm-plus only: in what the value, or the checksum of the symbol, contradicts the declaration that"
         " passed in the capture, and the name that the address would have; or that the answer leaves the item out, or has it"
         " though the request does not.", None, rare=True),
    # ---- what JSON has inside of an object, or not at all
    Fact("transaction", COUNT, "Number of the transaction.", None, key="", least=1),
    Fact("item", COUNT, "Number of the item, from 1; for S7comm-plus its own.", None, key="", least=1),
    Fact("connection", COUNT, "Number of the connection.", None, key="", least=1),
    Fact("begin_time", TIME, "Time of the request, or of the message sent unasked.", None, key="", column="ts"),
    Fact("request_frame", FRAME, "Packet that completed the request.", None, key=""),
    Fact("response_frame", FRAME, "Packet that completed the response.", None, key=""),
    Fact("server_host", WORD, "Address of the server, usually the PLC.", None, key=""),
    Fact("client_host", WORD, "Address of the client.", None, key=""),
    Fact("operation", WORD, "read, write, or notify for values that are sent unasked.", None, key=""),
    Fact("certainty", WORD, "Certainty of the transaction: sure or likely.", None, key=""),
    Fact("name", WORD, "Tags in the item, with --tags, or the variable's name.", lambda of: of.name, key=""),
    Fact("area_name", WORD, "Area, such as DB, M, I or Q.",
         lambda of: of.area.names[0] if of.area is not None else None, key="", column="area"),
    Fact("db_number", COUNT, "Number of the data block.", lambda of: of.db, key="", column="db"),
    Fact("byte", COUNT, "Byte address; for timers and counters their number.",
         lambda of: _at(of, False), key=""),
    Fact("bit", COUNT, "Bit within the byte.", lambda of: _at(of, True), key=""),
    Fact("label", WORD, "Address as people write it, DB10.DBW4; `overlaps` compares bits.",
         lambda of: encodable(of.place.text) if of.place is not None else None, key="", column="address"),
    Fact("type_name", WORD, "Requested type, the transport size.",
         lambda of: of.type.names[0] if of.type is not None else None, key="", column="type"),
    Fact("return_name", WORD, "Its return code, by name.",
         lambda of: of.return_code.names[0] if of.return_code is not None else None, key=""),
    Fact("refused", FLAG, "The answer refuses this item, or the whole request.",
         lambda of: of.return_code is not None and of.return_code.number not in {0, SUCCESS}, key=""),
    Fact("number_value", REAL, "Value: a number or truth value; for a single tag in its unit.", None, key="", column="number"),
    Fact("text_value", TEXT, "Value where it is text, several numbers as JSON, an integer beyond 2^53.",
         None, key="", column="text"),
    Fact("spelled", TEXT, "Text that several bytes seem to spell, a guess.", None, key=""),
)  # fmt: skip
#: The facts of an item (`dissect.meaning.select.items.ItemFacts`), in the order of their keys in JSON.
ITEM: Final = by_name(_ITEM)

_ROWS: Final[tuple[Fact[Transaction], ...]] = (
    Fact("number", COUNT, "Number of the transaction in the run, in the order in which requests were read; a request behind a"
         " gap is read when the gap is given up, an indication and an answer without request get theirs when they are"
         " reported. It identifies the transaction; the order of the capture is that of the lines.",
         lambda of: int(of.number), column="transaction", least=1),
    Fact("connection", COUNT, "Number of the connection, that of `connections` in the analysis.",
         lambda of: int(of.connection.number), least=1),
    Fact("asked_by", END, "The end that sent the request, or that received an unsolicited message.",
         lambda of: of.connection.tcp.ends[of.asked_by]),
    Fact("answered_by", END, "The other end.", lambda of: of.connection.tcp.ends[1 - of.asked_by]),
    Fact("pdu_ref", DURATION, "PDU reference, read in network order; for S7comm-plus the sequence number, null in its"
         " notifications; for SCD the transaction number, null where the envelope has none.", None, null=True),
    Fact("rosctr", JSON, "Kind of the request: 1 Job, 7 Userdata; null for S7comm-plus, which has none.",
         lambda of: int(of.rosctr) if of.rosctr <= USERDATA else None, shape={"enum": [JOB, USERDATA, None]}),
    Fact("function", JSON, "The function byte; of the answer when there is no request.",
         None, shape={"$ref": "#/$defs/function"}),
    Fact("protocol", CODE, "Only transactions of S7comm-plus and SCD; all others are S7comm.",
         lambda of: None if _protocol(of) == UPPER_NAMES[S7COMM] else _protocol(of), rare=True, codes=("s7comm_plus", "scd")),
    Fact("userdata", JSON, "Userdata only: the content of the parameter header.",
         None, rare=True, shape={"$ref": "#/$defs/userdata"}),
    Fact("request_frame", FRAME, "Packet that completed the request, null when there is none.",
         lambda of: int(of.request_frame), null=True),
    Fact("response_frame", FRAME, "Packet that completed the answer, null when there is none.",
         lambda of: int(of.response_frame), null=True),
    Fact("request_time", TIME, "Time of `request_frame`, null when there is no request.",
         lambda of: int(of.request_ns) if of.request_frame else None, null=True),
    Fact("response_time", TIME, "Time of `response_frame`; only where there is no request, or the pair is only likely and has"
         " no `latency_ns`. Elsewhere it is `request_time` plus `latency_ns`.", _response_time, rare=True),
    Fact("latency_ns", DURATION, "Time from `request_frame` to `response_frame`, in nanoseconds; null unless both were captured"
         " and surely belong together (`certainty`). Negative when the capture shows the answer first, by order or by time: a"
         " finding `transaction.reordered` or `capture.time_backwards` says so.",
         lambda of: of.latency_ns, unit="ns", null=True),
    Fact("outcome", CODE, "Its outcome. `behind_malformed`: a request, an answer or a push behind a TPDU header that cannot"
         " hold data (`malformed_header`), which belongs to nothing else: the receiver may have dropped it, and nothing is"
         " missed.", lambda of: of.outcome, codes=tuple(OUTCOMES[1:])),
    Fact("reason", CODE, "Why a request has no answer here. `hole`: it was answered, but the answer was not captured; with"
         " `certainty` `likely` perhaps answered: bytes of the answering side are missing, which may be something else."
         " `one_sided`: only the direction of the requests was captured. On an answer without request `hole` means that the"
         " request may be in a gap. `malformed_header`, whatever the outcome: the request or the answer is behind the"
         " malformed header of a TPDU. Otherwise null.", lambda of: of.reason or None, null=True, codes=tuple(REASON_TEXTS)),
    Fact("certainty", CODE, "Only where it is not certain that request and answer belong together, or that a request with"
         " `reason` `hole` was answered. Without this key the pair, or the `hole`, is sure. A push has it where it is not"
         " certain which request began its job, and so what its items are.",
         lambda of: LIKELY if of.certainty == LIKELY else None, rare=True, codes=(LIKELY,)),
    Fact("doubt", CODE, "The reason if a pair or a push is only likely. `gaps`: bytes of both directions are missing from"
         " the capture between request and answer (of a push: of the request that began its job). `alike`: the answer fits"
         " several pending requests with the same reference. It is in no answer time, mismatch or history of values.",
         lambda of: of.doubt or None, rare=True, codes=tuple(DOUBT_TEXTS)),
    Fact("sent_again", JSON, "Only for a request that TCP sent more than once: packets were lost, or nobody took them. Copies"
         " within 10 ms are taken for packets that were captured twice.",
         None, rare=True, shape={"$ref": "#/$defs/sent_again"}),
    Fact("setup", JSON, "Setup communication only: the request and the grant.",
         None, rare=True, shape={"$ref": "#/$defs/both_setups"}),
    Fact("asks", WORDS, "Functions other than reads, writes and Setup: what the request is about, in a few words for a person;"
         " not stable texts.", None, rare=True),
    Fact("tells", WORDS, "The same for the answer, or for an unsolicited message.", None, rare=True),
    Fact("s7plus", JSON, "S7comm-plus only: the headers of request and response.",
         None, rare=True, shape={"$ref": "#/$defs/both_headers"}),
    Fact("scd", JSON, "Only where a binding points: the SCD messages of the transaction, its request and answer, or those that"
         " stood in S7 items.", None, rare=True, shape={"type": "array", "items": {"$ref": "#/$defs/scd"}}),
    Fact("items", RECORDS, "Reads and writes: every item of the request joined with its own answer, in wire order. Cyclic"
         " services and test functions on variables as well; in an indication the items of the request that subscribed to it,"
         " their addresses null where that was not captured; S7comm-plus notifications: the reported values. A DBREAD item is"
         " one entry for each of its areas, as bytes. Empty for other functions.", None, records=ITEM),
    Fact("errors", JSON, "All errors of the answer, in wire order; empty if there are none.",
         None, shape={"type": "array", "items": {"$ref": "#/$defs/one_error"}}),
    # ---- what JSON has inside of an object, or not at all
    Fact("file", FILE, "Capture file of the request, or of the response where there is no request.",
         lambda of: int(of.request_frame or of.response_frame), key=""),
    Fact("response_file", FILE, "Capture file of the response.", lambda of: int(of.response_frame), key=""),
    Fact("begin_time", TIME, "Time of the request, or of the response where there is no request.",
         lambda of: int(of.request_ns if of.request_frame else of.response_ns), key="", column="ts"),
    Fact("response_ns", INSTANT, "Time of the response.",
         lambda of: int(of.response_ns) if of.response_frame else None, key="", null=True),
    Fact("client", END, "The client of the connection.", lambda of: of.connection.client, key=""),
    Fact("server", END, "The server, usually the PLC.", lambda of: of.connection.server, key=""),
    Fact("from_client", FLAG, "The client sent the request, or an unasked message went to it.",
         lambda of: of.asked_by == of.connection.client_side, key=""),
    Fact("protocol_name", WORD, "The protocol: s7comm, s7comm_plus or scd.",
         _protocol, key="", column="protocol"),
    Fact("rosctr_name", WORD, "Kind of the S7 PDU, such as Job or Userdata.",
         lambda of: ROSCTR.name(int(of.rosctr)) if of.rosctr <= USERDATA else None, key="", column="rosctr"),
    Fact("function_code", COUNT, "Function code.",
         lambda of: int(of.function) if of.function >= 0 and not of.is_scd else None, key="", column="function"),
    Fact("function_name", WORD, "Its name; of userdata group and subfunction.",
         lambda of: of.function_name if of.function >= 0 or of.rosctr > USERDATA else None, key=""),
    Fact("userdata_group", COUNT, "Function group of userdata.", lambda of: _head(of, "group"), key="", null=True),
    Fact("subfunction", COUNT, "Subfunction of userdata.", lambda of: _head(of, "subfunction"), key="", null=True),
    Fact("about", TEXT, "The subject of a request without items, for example the SZL.", None, key="", null=True),
    Fact("certainty_said", CODE, "Whether request and answer surely belong together, or a push or an answer not captured is"
         " sure.", lambda of: of.certainty or None, key="", column="certainty", null=True, codes=tuple(CERTAINTIES)),
    Fact("doubt_said", CODE, "Why a pair or a push is only likely: gaps, or alike.",
         lambda of: of.doubt or None, key="", column="doubt", null=True, codes=tuple(DOUBT_TEXTS)),
    Fact("failed", FLAG, "Refused in whole or in part, or without the answer that was due.",
         lambda of: bool(of.failed), key=""),
    Fact("error_code", COUNT, "Error of header or parameter, 0 for none.", lambda of: int(of.error_code), key=""),
    Fact("error_names", WORDS, "Every error: place, name.", _errors, key="", column="errors"),
    Fact("item_count", COUNT, "Number of its items in the table items.", None, key=""),
    Fact("request_bytes", COUNT, "Size of the request PDU.",
         lambda of: int(of.request_size) if of.request_frame else None, key="", unit="bytes", null=True),
    Fact("response_bytes", COUNT, "Size of the response PDU.",
         lambda of: int(of.response_size) if of.response_frame else None, key="", unit="bytes", null=True),
    Fact("sent_again_times", COUNT, "How often TCP sent the request again, 0 where it did not.",
         lambda of: int(of.again.times) if of.again is not None else 0, key=""),
)  # fmt: skip

#: The facts of a transaction by their names, in the order of their keys in JSON.
TRANSACTION: Final[dict[str, Fact[Transaction]]] = by_name(_ROWS)
