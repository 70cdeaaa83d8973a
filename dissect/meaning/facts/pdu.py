"""The facts of a PDU.

`dissect.meaning.report.pdu_json` and `dissect.output.export.pdu_columns` write them, each directly from octets.
"""

from __future__ import annotations

from typing import Any, Final

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
    JSON,
    RECORDS,
    TEXT,
    TIME,
    WORD,
    WORDS,
    Fact,
    by_name,
)

_TRANSACTION: Final = "urn:s7dissect:schema:transaction:1#/$defs"

_ASKED: Final[tuple[Fact[Any], ...]] = (
    Fact("address", TEXT, "The address in the usual notation.", None),
    Fact("syntax_id", COUNT, "How the address is written, 16 for S7ANY.", None, most=255),
    Fact("area", COUNT, "Memory area.", None, null=True, most=255),
    Fact("db", COUNT, "Number of the data block.", None, null=True, most=65535),
    Fact("start_bit", COUNT, "The address field as it is on the wire.", None, null=True, most=16777215),
    Fact("transport_size", COUNT, "Type of one element.", None, null=True, most=255),
    Fact("count", COUNT, "Elements.", None, null=True, most=65535),
)
#: The facts of an item of a request.
ASKED: Final = by_name(_ASKED)

_ROWS: Final[tuple[Fact[Any], ...]] = (
    Fact("frame", FRAME, "Number of the packet that completed the PDU, from 1, within its file.", None),
    Fact("time", TIME, "Time of that packet.", None, column="ts"),
    Fact("connection", COUNT, "Number of the connection, that of `connections` in the analysis.", None, least=1),
    Fact("src", END, "Who sent it.", None),
    Fact("dst", END, "To whom.", None),
    Fact("protocol", CODE, "The protocol. S7comm-plus and SCD have none of the header fields below but `pdu_ref`; they are"
         " null. `cotp` is a TPDU that carries neither: a connect, disconnect or error, or data of another protocol; with"
         " `--tpdus` it is any TPDU. All header fields are null.", None, codes=("s7comm", "s7comm_plus", "scd", "cotp")),
    Fact("cotp", JSON, "COTP only: the TPDU.", None, rare=True, shape={"$ref": "#/$defs/cotp"}),
    Fact("rosctr", COUNT, "Kind of the PDU: 1 Job, 2 Ack, 3 Ack_Data, 7 Userdata. This and every header field below is null"
         " when the capture cut the PDU before it.", None, null=True, most=255),
    Fact("rosctr_name", TEXT, "Its name; for an unknown one its number.", None, null=True),
    Fact("redundancy_id", COUNT, "Redundancy identification, 0 in practice.", None, null=True, most=65535),
    Fact("pdu_ref", DURATION, "PDU reference, read in network order; for SCD the transaction number.", None, null=True),
    Fact("param_length", COUNT, "Bytes of the parameter block, as stated in the header.", None, null=True, most=65535),
    Fact("data_length", COUNT, "Bytes of the data block, as stated in the header.", None, null=True, most=65535),
    Fact("error_class", COUNT, "Ack and Ack_Data: error class, 0 when all is well; null for other kinds.",
         None, null=True, most=255),
    Fact("error_code", COUNT, "Ack and Ack_Data: error code within the class; null for other kinds.",
         None, null=True, most=255),
    Fact("function", JSON, "The function byte.", None, shape={"$ref": f"{_TRANSACTION}/function"}),
    Fact("userdata", JSON, "Userdata only: the content of the parameter header.",
         None, rare=True, shape={"$ref": f"{_TRANSACTION}/userdata"}),
    Fact("s7plus", JSON, "S7comm-plus only: the content of its header.",
         None, rare=True, shape={"$ref": f"{_TRANSACTION}/s7plus"}),
    Fact("scd", JSON, "SCD only: the message.", None, rare=True, shape={"$ref": f"{_TRANSACTION}/scd"}),
    Fact("item_count", COUNT, "Number of items, where the parameters state one.", None, rare=True, most=255),
    Fact("setup", JSON, "Setup communication: the request or the grant.",
         None, rare=True, shape={"$ref": f"{_TRANSACTION}/setup"}),
    Fact("items", RECORDS, "Read Var and Write Var jobs: the items, with the keys of the same name in a transaction.",
         None, rare=True, records=ASKED),
    Fact("data_items", JSON, "Answers to Read Var and jobs of Write Var: the data items, in wire order.",
         None, rare=True, shape={"$ref": "#/$defs/data_items"}),
    Fact("return_codes", COUNTS, "Answers to Write Var: the return codes, in wire order.", None, rare=True, most=255),
    Fact("parameters", BYTES, "The parameter block in hexadecimal, where it is more than a function and its item count and was"
         " not decoded above.", None, rare=True),
    Fact("data", BYTES, "The data block in hexadecimal, where there is one and it was not decoded above.", None, rare=True),
    Fact("parts", JSON, "PDUs other than reads, writes and Setup, and all of S7comm-plus: the structures after the header, in"
         " wire order and without gaps.", None, rare=True, shape={"$ref": "#/$defs/parts"}),
    Fact("octets", BYTES, "The whole PDU in hexadecimal, passwords as zeros as in `parameters` and `parts`; only when it is"
         " cut or malformed.", None, rare=True),
    Fact("cut", FLAG, "True when the capture kept only the beginning of the PDU (snaplen).", None),
    Fact("malformed", JSON, "Malformed parts of this PDU; empty for none.", None, shape={"$ref": "#/$defs/malformed"}),
    Fact("tpdu", JSON, "Only where the header of the TPDU that carries the PDU is irregular.",
         None, rare=True, shape={"$ref": "#/$defs/tpdu"}),
    # ---- what JSON has inside of an object, or not at all
    Fact("pdu", COUNT, "Number of the message in the run, in the order of completion.", None, key="", least=1),
    Fact("file", FILE, "Capture file of the packet.", None, key=""),
    Fact("client", END, "The client of the connection.", None, key=""),
    Fact("server", END, "The server, usually the PLC.", None, key=""),
    Fact("from_client", FLAG, "The client sent it.", None, key=""),
    Fact("protocol_name", WORD, "The protocol: s7comm, s7comm_plus or scd.", None, key="", column="protocol"),
    Fact("kind", WORD, "ROSCTR, such as Job or Ack_Data; for S7comm-plus request, response or notification.", None, key=""),
    Fact("function_code", COUNT, "Function code.", None, key="", column="function"),
    Fact("function_name", WORD, "Its name; of userdata group and subfunction.", None, key=""),
    Fact("userdata_group", COUNT, "Function group of userdata.", None, key=""),
    Fact("subfunction", COUNT, "Subfunction of userdata.", None, key=""),
    Fact("error", COUNT, "Error of header or parameter.", None, key="", column="error_code"),
    Fact("announced", COUNT, "Items that its parameters announce.", None, key="", column="item_count"),
    Fact("size", COUNT, "Size of the message.", None, key="", column="bytes", unit="bytes"),
    Fact("malformations", WORDS, "Malformed parts of the PDU.", None, key="", column="malformed"),
)  # fmt: skip
#: The facts of a PDU by their names, in the order of their keys in JSON.
PDU: Final = by_name(_ROWS)
