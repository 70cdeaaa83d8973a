"""Messages the fake PLC makes itself, where the recording has none that fits: confirmations, setups, refusals, items."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from dissect.iso.cotp import CALLED_TSAP, CALLING_TSAP, PREFERRED_SIZE, TPDU_SIZE, Tpdu, parse_tpdu
from dissect.iso.tables import CC, DR, DR_REASONS, ER, ER_CAUSES
from dissect.iso.tpkt import HEADER
from dissect.s7.items import item_fill
from dissect.s7.message import HEADER_SIZE, PROTOCOL_ID, Pdu, parse_pdu
from dissect.s7.parameters import RESPONSE, Setup
from dissect.s7.tables import ACK, ACK_DATA, OBJECT_DOES_NOT_EXIST, SETUP_COMMUNICATION, USERDATA
from dissect.transactions.ending import DISCONNECT, ERROR_TPDU

#: "Function not available": what a CPU answers a job that it does not know with (reference 3.3).
NOT_AVAILABLE: Final = 0x8104
#: "Wrong PDU size": the answer is larger than this client agreed to.
WRONG_PDU_SIZE: Final = 0x8500

#: What is granted where no setup was recorded.
USUAL_SETUP: Final = Setup(8, 8, 480)

_MAX_CODED: Final = 13  # 8192 octets, the most that class 0 may ask for by code (X.224 13.3.4)
_USUAL_SIZE: Final = 1024
_OWN_REFERENCE: Final = 1
_NORMAL: Final = 0x80  # reason of a DR: ended by the user
_NO_PAYLOAD: Final = bytes((OBJECT_DOES_NOT_EXIST, 0, 0, 0))


def tpkt(tpdu: bytes) -> bytes:
    """Return a TPDU in its TPKT."""
    return struct.pack(">BBH", 3, 0, HEADER + len(tpdu)) + tpdu


def data_tpdus(tsdu: bytes, tpdu_size: int) -> bytes:
    """Return a TSDU as DTs in TPKTs, none of them with a TPDU larger than ``tpdu_size``."""
    room = max(tpdu_size - 3, 1)
    pieces = [tsdu[at : at + room] for at in range(0, len(tsdu), room)]
    last = len(pieces) - 1
    return b"".join(
        [tpkt(bytes((2, 0xF0, 0x80 if index == last else 0)) + piece) for index, piece in enumerate(pieces)]
    )


class Confirmation(NamedTuple):
    """A CC, and the largest TPDU that may be sent afterwards."""

    tpdu: bytes
    tpdu_size: int


def confirm(request: Tpdu, recorded: bytes) -> Confirmation:
    """Return the confirmation of a connect request: as it was recorded, for the reference, TSAPs and size of this client.

    A recorded parameter that this client did not send is left out; the size is the smaller of both.
    """
    model = parse_tpdu(recorded) if recorded else None
    if model is None or model.type != CC:
        size = request.tpdu_size or _USUAL_SIZE
        parameters = [(TPDU_SIZE, _coded(min(size, 1 << _MAX_CODED)))]
        parameters += [(code, request.parameter(code) or b"") for code in (CALLING_TSAP, CALLED_TSAP)]
        own, options = _OWN_REFERENCE, 0
    else:
        parameters = [(parameter.code, parameter.value) for parameter in model.parameters]
        own = max(model.field("src_ref"), 0)
        options = recorded[6] if len(recorded) > 6 else 0
    granted = min([size for size in (request.tpdu_size, model.tpdu_size if model else 0) if size] or [0])
    variable = b""
    for code, recorded_value in parameters:
        value = recorded_value
        if code in {CALLING_TSAP, CALLED_TSAP}:
            theirs = request.parameter(code)
            if theirs is None:
                continue
            value = theirs
        elif code == TPDU_SIZE and granted:
            value = _coded(granted)
        elif code == PREFERRED_SIZE and granted:
            value = (granted // 128).to_bytes(max(len(value), 1), "big")
        variable += bytes((code, len(value))) + value
    reference = max(request.field("src_ref"), 0)
    fixed = struct.pack(">BHHB", CC << 4, reference, own, options)
    tpdu = bytes((len(fixed) + len(variable),)) + fixed + variable
    return Confirmation(tpdu, parse_tpdu(tpdu).tpdu_size or 65_531)


def farewell(how: str, said: str = "") -> bytes:
    """Return the TPDU of an end by DR or ER, its reason as findings and goldens name it; empty for another end."""
    if how == DISCONNECT:
        reason = next((number for number in range(256) if DR_REASONS.name(number) == said), _NORMAL)
        return struct.pack(">BBHHB", 6, DR << 4, 0, _OWN_REFERENCE, reason)
    if how == ERROR_TPDU:
        cause = next((number for number in range(256) if ER_CAUSES.name(number) == said), 0)
        return struct.pack(">BBHB", 4, ER << 4, 0, cause)
    return b""


def to_reference(tpdu: bytes, reference: int) -> bytes:
    """Return a CC, DR or ER for the reference of another client."""
    return tpdu[:2] + reference.to_bytes(2, "big") + tpdu[4:]


def _coded(size: int) -> bytes:
    """Return a TPDU size as the power of two that is not larger."""
    return bytes((min(max(size.bit_length() - 1, 7), _MAX_CODED),))


def with_reference(octets: bytes, reference: bytes) -> bytes:
    """Return a PDU with another reference."""
    return octets[:4] + reference + octets[6:] if len(octets) >= HEADER_SIZE else octets


def _pdu(rosctr: int, reference: bytes, parameters: bytes, data: bytes, error: int = 0) -> bytes:
    head = struct.pack(">BBH2sHH", PROTOCOL_ID, rosctr, 0, reference, len(parameters), len(data))
    if rosctr in {ACK, ACK_DATA}:
        head += error.to_bytes(2, "big")
    return head + parameters + data


def refuse(asked: Pdu, code: int = NOT_AVAILABLE) -> bytes:
    """Return the answer that refuses a request as a whole: an Ack without parameters, or userdata with an error code."""
    reference = asked.octets[4:6]
    head = asked.parameters.userdata
    if asked.rosctr != USERDATA:
        return _pdu(ACK, reference, b"", b"", code)
    group, subfunction, sequence = (head.group, head.subfunction, head.sequence) if head is not None else (0, 0, 0)
    parameters = struct.pack(
        ">BBBBBBBBBBH", 0, 1, 0x12, 8, 0x12, RESPONSE << 6 | group, subfunction, sequence & 0xFF, 0, 0, code
    )
    return _pdu(USERDATA, reference, parameters, _NO_PAYLOAD)


def grant(asked: Pdu, recorded: bytes) -> bytes:
    """Return the answer to a setup that asks otherwise than the recorded one: what was granted, but no more than is asked.

    Without a recorded answer `USUAL_SETUP` is; one that refused refuses again.
    """
    setup = asked.parameters.setup
    if setup is None:
        return refuse(asked)
    granted = USUAL_SETUP
    if recorded:
        model = parse_pdu(recorded).parameters.setup
        if model is None:
            return with_reference(recorded, asked.octets[4:6])
        granted = model
    parameters = struct.pack(
        ">BBHHH",
        SETUP_COMMUNICATION,
        0,
        min(setup.max_amq_calling, granted.max_amq_calling),
        min(setup.max_amq_called, granted.max_amq_called),
        min(setup.pdu_length, granted.pdu_length),
    )
    return _pdu(ACK_DATA, asked.octets[4:6], parameters, b"")


def answer_items(asked: Pdu, items: Sequence[bytes]) -> bytes:
    """Return the answer to a read or write made of data items or of return codes, one for each item asked for."""
    last = len(items) - 1
    data = b"".join([item + bytes(int(item_fill(len(item), at == last))) for at, item in enumerate(items)])
    if asked.parameters.function == 0x05:
        data = b"".join(items)
    return _pdu(ACK_DATA, asked.octets[4:6], bytes((asked.parameters.function, len(items) & 0xFF)), data)


def missing_item(writes: bool) -> bytes:
    """Return what an item is answered with that nobody knows."""
    return bytes((OBJECT_DOES_NOT_EXIST,)) if writes else _NO_PAYLOAD
