"""Messages that the fake PLC makes itself if the recording has none that fits: confirmations, setups, refusals, items."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU
from dissect.protocols.iso.build import (
    LARGEST_TPDU,
    MAX_HEADER,
    build_connect,
    build_dr,
    build_er,
    coded_size,
    connect_size,
)
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, PREFERRED_SIZE, TPDU_SIZE, Tpdu, parse_tpdu
from dissect.protocols.iso.tables import CC, DR_REASONS, ER_CAUSES
from dissect.protocols.s7.build import (
    NO_PAYLOAD,
    build_items,
    build_pdu,
    build_setup,
    build_userdata_head,
    build_variables,
    with_reference,
)
from dissect.protocols.s7.layouts import PDU_REF
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import RESPONSE, Setup
from dissect.protocols.s7.tables import ACK, ACK_DATA, OBJECT_DOES_NOT_EXIST, USERDATA, WRITE_VAR

#: "Function not available": a CPU's answer to an unknown job (reference 3.3).
NOT_AVAILABLE: Final = 0x8104
#: "Wrong PDU size": the answer is larger than the PDU length of this client.
WRONG_PDU_SIZE: Final = 0x8500

#: Granted if no setup was recorded.
USUAL_SETUP: Final = Setup(8, 8, 480)

_USUAL_SIZE: Final = 1024
_OWN_REFERENCE: Final = 1
_NORMAL: Final = 0x80  # reason of a DR: ended by the user


class Confirmation(NamedTuple):
    """A CC, and the largest TPDU that may be sent afterwards."""

    tpdu: bytes
    tpdu_size: int


def confirm(request: Tpdu, recorded: bytes) -> Confirmation:
    """Return the confirmation of a connect request as recorded, with the reference, TSAPs and size of this client.

    A recorded parameter that this client did not send is left out; the size is the smaller of both.
    """
    model = parse_tpdu(recorded) if recorded else None
    if model is None or model.type != CC:
        size = request.tpdu_size or _USUAL_SIZE
        parameters = [(TPDU_SIZE, coded_size(size))]
        parameters += [(code, request.parameter(code) or b"") for code in (CALLING_TSAP, CALLED_TSAP)]
        own, options = _OWN_REFERENCE, 0
    else:
        parameters = [(parameter.code, parameter.value) for parameter in model.parameters]
        own = max(model.field("src_ref"), 0)
        options = recorded[6] if len(recorded) > 6 else 0
    granted = min([size for size in (request.tpdu_size, model.tpdu_size if model else 0) if size] or [0])
    granted_parameters: list[tuple[int, bytes]] = []
    for code, recorded_value in parameters:
        value = recorded_value
        if code in {CALLING_TSAP, CALLED_TSAP}:
            theirs = request.parameter(code)
            if theirs is None:
                continue
            value = theirs
        elif code == TPDU_SIZE and granted:
            value = coded_size(granted)
        elif code == PREFERRED_SIZE and granted:
            value = (granted // 128).to_bytes(max(len(value), 1), "big")
        if (
            connect_size([*granted_parameters, (code, value)]) <= MAX_HEADER
        ):  # TSAPs may leave no room for our parameters
            granted_parameters.append((code, value))
    tpdu = build_connect(CC, max(request.field("src_ref"), 0), own, granted_parameters, options)
    return Confirmation(tpdu, parse_tpdu(tpdu).tpdu_size or LARGEST_TPDU)


def farewell(how: str, reason_name: str = "") -> bytes:
    """Return the TPDU of an end by DR or ER, with the reason as findings and goldens name it; empty for any other end."""
    if how == DISCONNECT:
        reason = next((number for number in range(256) if DR_REASONS.name(number) == reason_name), _NORMAL)
        return build_dr(0, _OWN_REFERENCE, reason)
    if how == ERROR_TPDU:
        cause = next((number for number in range(256) if ER_CAUSES.name(number) == reason_name), 0)
        return build_er(0, cause)
    return b""


def refuse(request: Pdu, code: int = NOT_AVAILABLE) -> bytes:
    """Return the answer that refuses a request as a whole: an Ack without parameters, or userdata with an error code."""
    reference = request.octets[PDU_REF]
    head = request.parameters.userdata
    if request.rosctr != USERDATA:
        return with_reference(build_pdu(ACK, b"", b"", code), reference)
    group, subfunction, sequence = (head.group, head.subfunction, head.sequence) if head is not None else (0, 0, 0)
    parameters = build_userdata_head(RESPONSE, group, subfunction, sequence, error=code)
    return with_reference(build_pdu(USERDATA, parameters, NO_PAYLOAD), reference)


def grant(request: Pdu, recorded: bytes) -> bytes:
    """Return the answer to a setup that differs from the recorded one: the recorded values, but no more than requested.

    Without a recorded answer, `USUAL_SETUP` is granted; a recorded refusal is repeated.
    """
    setup = request.parameters.setup
    if setup is None:
        return refuse(request)
    granted = USUAL_SETUP
    if recorded:
        model = parse_pdu(recorded).parameters.setup
        if model is None:
            return with_reference(recorded, request.octets[PDU_REF])
        granted = model
    least = Setup(
        min(setup.max_amq_calling, granted.max_amq_calling),
        min(setup.max_amq_called, granted.max_amq_called),
        min(setup.pdu_length, granted.pdu_length),
    )
    return with_reference(build_setup(ACK_DATA, least), request.octets[PDU_REF])


def answer_items(request: Pdu, items: Sequence[bytes]) -> bytes:
    """Return the answer to a read or write, built from data items or return codes, one for each requested item."""
    function = request.parameters.function
    data = b"".join(items) if function == WRITE_VAR else build_items(items)
    return with_reference(build_variables(ACK_DATA, function, len(items), b"", data), request.octets[PDU_REF])


def missing_item(writes: bool) -> bytes:
    """Return the answer for an item that was not recorded."""
    return bytes((OBJECT_DOES_NOT_EXIST,)) if writes else NO_PAYLOAD
