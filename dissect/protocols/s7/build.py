"""Builds octets of S7 PDUs that `dissect.protocols.s7` reads, in the usual form of devices (reference sections 3 and 4).

PDUs are built with reference 0; `with_reference` sets another one.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from dissect.protocols.s7.items import SPECIFICATION, item_fill
from dissect.protocols.s7.layouts import S7ANY_ITEM, USERDATA_EXTENDED, USERDATA_SHORT
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE, PROTOCOL_ID, Setup
from dissect.protocols.s7.tables import (
    ACK,
    ACK_DATA,
    DATA_BIT,
    LENGTH_IN_BITS,
    OBJECT_DOES_NOT_EXIST,
    OCTET_STRING,
    PARAMETER_EXTENDED,
    PARAMETER_SHORT,
    S7ANY,
    SETUP_COMMUNICATION,
    SUCCESS,
)

#: The data block of userdata without payload. It is also the data item of a read whose object does not exist.
NO_PAYLOAD: Final = bytes((OBJECT_DOES_NOT_EXIST, 0, 0, 0))

#: Octets of the largest PDU: the PDU length of Setup communication has 16 bits.
MAX_PDU: Final = 0xFFFF

#: Octets that the length in an item or in a userdata head does not count: the length octet itself and those before it.
_ITEM_HEAD: Final = 2
_USERDATA_HEAD: Final = 4


def build_pdu(rosctr: int, parameters: bytes, data: bytes = b"", error: int = 0) -> bytes:
    """Return a PDU with reference 0. ``error`` is used for answers only. Raises ValueError if it would be too long."""
    if max(len(parameters), len(data), len(parameters) + len(data) + ACK_HEADER_SIZE) > MAX_PDU:
        raise ValueError(f"a PDU of {len(parameters)} and {len(data)} bytes: no PDU has more than {MAX_PDU}")
    head = struct.pack(">BBHHHH", PROTOCOL_ID, rosctr, 0, 0, len(parameters), len(data))
    if rosctr in {ACK, ACK_DATA}:
        head += error.to_bytes(2, "big")
    return head + parameters + data


def with_reference(pdu: bytes, reference: bytes) -> bytes:
    """Return a PDU with another reference (two octets); a PDU without a whole header is returned unchanged."""
    return pdu[:4] + reference + pdu[6:] if len(pdu) >= HEADER_SIZE else pdu


def build_setup(rosctr: int, setup: Setup) -> bytes:
    """Return a Setup communication job (``rosctr`` Job) or its answer (Ack_Data)."""
    sizes = struct.pack(">HHH", setup.max_amq_calling, setup.max_amq_called, setup.pdu_length)
    return build_pdu(rosctr, bytes((SETUP_COMMUNICATION, 0)) + sizes)


# ---- variables ------------------------------------------------------------------------------------------------------


def build_item(transport_size: int, count: int, db: int, area: int, address: int) -> bytes:
    """Return a request item of syntax S7ANY; ``address`` is octet times 8 plus bit, or the number of a timer or counter."""
    head = struct.pack(">BBBBHHB", SPECIFICATION, S7ANY_ITEM.size - _ITEM_HEAD, S7ANY, transport_size, count, db, area)
    return head + address.to_bytes(3, "big")


def build_data_item(code: int, transport_size: int, data: bytes) -> bytes:
    """Return a data item; its length counts bits or octets, by the transport size. For BIT, one octet counts as one bit."""
    in_bits = transport_size in LENGTH_IN_BITS and transport_size != DATA_BIT
    return struct.pack(">BBH", code, transport_size, (len(data) * 8 if in_bits else len(data)) & 0xFFFF) + data


def build_items(items: Sequence[bytes]) -> bytes:
    """Join request items or data items, with the fill octets between them."""
    last = len(items) - 1
    return b"".join([item + bytes(int(item_fill(len(item), at == last))) for at, item in enumerate(items)])


def build_variables(rosctr: int, function: int, count: int, items: bytes, data: bytes = b"") -> bytes:
    """Return a Read Var, a Write Var or its answer with ``count`` items: request ``items``, and items with ``data``."""
    return build_pdu(rosctr, bytes((function, count & 0xFF)) + items, data)


# ---- userdata -------------------------------------------------------------------------------------------------------


def build_userdata_head(
    type_: int, group: int, subfunction: int, sequence: int = 0, extended: bool = True, error: int = 0
) -> bytes:
    """Return the parameter head of userdata: the extended form of answers and pushes, or the short form of most requests."""
    size = (USERDATA_EXTENDED if extended else USERDATA_SHORT).size - _USERDATA_HEAD
    method = PARAMETER_EXTENDED if extended else PARAMETER_SHORT
    kind = type_ << 6 | group & 0x3F
    head = bytes((0, 1, SPECIFICATION, size, method, kind, subfunction, sequence & 0xFF))
    return head + struct.pack(">BBH", 0, 0, error) if extended else head


def build_payload(payload: bytes) -> bytes:
    """Return the data block of userdata: a data head and the payload; `NO_PAYLOAD` if the payload is empty."""
    return struct.pack(">BBH", SUCCESS, OCTET_STRING, len(payload)) + payload if payload else NO_PAYLOAD
