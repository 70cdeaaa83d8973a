"""Octets of PDUs, made with the package's Scapy layers; a request and its answer by the same PDU reference."""

from __future__ import annotations

from typing import Any

from scapy.packet import Packet as Layer

from dissect.layers import (
    COTP_CC,
    COTP_CR,
    COTP_DT,
    S7,
    TPKT,
    COTP_Parameter,
    S7_Any,
    S7_DataItem,
    S7_Function,
    S7_Octets,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_Setup,
    S7_UserdataExtended,
    S7_UserdataShort,
    S7_WriteDataItem,
    S7_WriteVarAnswer,
    S7_WriteVarRequest,
    at,
)

USERDATA, MODE, READ, WRITE, SETUP = 0x00, 0x01, 0x04, 0x05, 0xF0
REQUEST_DOWNLOAD, DOWNLOAD_BLOCK, DOWNLOAD_ENDED = 0x1A, 0x1B, 0x1C
PI_SERVICE, PLC_STOP = 0x28, 0x29
"""Functions."""
NO_FUNCTION = -1
ACK, ACK_DATA = 2, 3
BYTES, OCTET_STRING = 4, 9
"""Transport sizes of data items."""
PUSH, ASKED, TOLD = 0, 1, 2
"""Types of userdata: a push, a request, a response."""


def cr(src_ref: int = 1, tpdu_size: int = 1024, called: str = "01.02") -> bytes:
    """A connect request of class 0."""
    parameters = [
        COTP_Parameter.tpdu_size(tpdu_size),
        COTP_Parameter.calling("01.00"),
        COTP_Parameter.called(called),
    ]
    return bytes(TPKT() / COTP_CR(src_ref=src_ref, parameters=parameters))


def cc(dst_ref: int = 1, tpdu_size: int = 1024, called: str = "01.02") -> bytes:
    """The connect confirm to `cr`."""
    parameters = [
        COTP_Parameter.tpdu_size(tpdu_size),
        COTP_Parameter.calling("01.00"),
        COTP_Parameter.called(called),
    ]
    return bytes(TPKT() / COTP_CC(dst_ref=dst_ref, src_ref=0x4431, parameters=parameters))


def dt(data: bytes = b"", end: bool = True, number: int = 0) -> bytes:
    """A TPKT with a DT of class 0; without ``data`` and ``end`` it is the acknowledgement of Siemens stacks."""
    return bytes(TPKT() / COTP_DT(eot=int(end), tpdu_nr=number) / data)


def s7(pdu_ref: int, body: Layer, **header: Any) -> bytes:
    """An S7 PDU; given header fields are used unchanged."""
    return bytes(S7(pdu_ref=pdu_ref, **header) / body)


def setup(pdu_ref: int, pdu_length: int, calling: int, called: int, answer: bool = False) -> bytes:
    """Setup communication, or its answer: ``calling`` and ``called`` are the jobs each side may have open."""
    body = S7_Setup(pdu_length=pdu_length, max_amq_calling=calling, max_amq_called=called)
    return s7(pdu_ref, body, rosctr=ACK_DATA) if answer else s7(pdu_ref, body)


def item(address: str | S7_Any, count: int = 1) -> S7_Any:
    """A request item of an address as people write it."""
    return at(address, count) if isinstance(address, str) else address


def read(pdu_ref: int, *addresses: str | S7_Any, count: int = 1) -> bytes:
    """Read Var."""
    return s7(pdu_ref, S7_ReadVarRequest(items=[item(address, count) for address in addresses]))


def read_bytes(pdu_ref: int, count: int) -> bytes:
    """Read Var of the first ``count`` octets of DB1."""
    return read(pdu_ref, "DB1.DBB0", count=count)


def values(pdu_ref: int, *octets: bytes) -> bytes:
    """The answer to a Read Var of octets or words, each as a good item."""
    return s7(pdu_ref, S7_ReadVarAnswer(data=[S7_DataItem(octets=one) for one in octets]))


def write(pdu_ref: int, octets: bytes) -> bytes:
    """Write Var of the first octets of DB1."""
    return s7(
        pdu_ref,
        S7_WriteVarRequest(items=[at("DB1.DBB0", len(octets))], data=[S7_WriteDataItem(octets=octets)]),
    )


def written(pdu_ref: int, *codes: int) -> bytes:
    """The answer to a Write Var."""
    return s7(pdu_ref, S7_WriteVarAnswer(return_codes=list(codes or (0xFF,))))


def job(pdu_ref: int, function: int, parameters: bytes = b"", data: bytes = b"") -> bytes:
    """A job whose parameters are given as octets."""
    return s7(pdu_ref, blocks(function, parameters, data))


def ack_data(pdu_ref: int, function: int, parameters: bytes = b"", data: bytes = b"", error: int = 0) -> bytes:
    """An Ack_Data whose parameters are given as octets."""
    body = blocks(function, parameters, data)
    return s7(pdu_ref, body, rosctr=ACK_DATA, error_class=error >> 8, error_code=error & 0xFF)


def blocks(function: int, parameters: bytes, data: bytes) -> S7_Function:
    """The two blocks of a function, given as octets."""
    return S7_Function(parameters=[S7_Octets(octets=bytes([function]) + parameters)], data=[S7_Octets(octets=data)])


def ack(pdu_ref: int, error: int) -> bytes:
    """An Ack: an answer without parameters and data."""
    return bytes(S7(rosctr=ACK, pdu_ref=pdu_ref, error_class=error >> 8, error_code=error & 0xFF))


def ask(pdu_ref: int, group: int, subfunction: int, payload: bytes = b"") -> bytes:
    """A userdata request."""
    return s7(pdu_ref, S7_UserdataShort(group=group, subfunction=subfunction, data=[userdata_item(payload)]))


def tell(pdu_ref: int, group: int, subfunction: int, payload: bytes = b"", kind: int = TOLD, **head: Any) -> bytes:
    """A userdata response, or a push with the extended head."""
    body = S7_UserdataExtended(type=kind, group=group, subfunction=subfunction, data=[userdata_item(payload)], **head)
    return s7(pdu_ref, body)


def userdata_item(payload: bytes) -> S7_DataItem:
    """The data head of userdata with its payload; 0x0A means that there is none and is not an error."""
    if not payload:
        return S7_DataItem(return_code=0x0A, transport_size=0)
    return S7_DataItem(transport_size=OCTET_STRING, octets=payload)


def pattern(size: int, first: int = 0) -> bytes:
    """Octets from which their own position can be seen."""
    return bytes((first + index) % 251 for index in range(size))
