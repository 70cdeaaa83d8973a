"""The fake PLC of S7comm-plus: recorded answers for requests of versions without digests.

A request is looked up by its octets without counters (sequence number, session id, integrity id); then, if it writes or
creates, also without its values. An answer gets the sequence number of the request, and, if the recorded one has an integrity
id, the matching one (response id = request id + sequence number). Session ids stay those of the recording: the answer to
CreateObject tells the client its session id.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    GET_MULTI_VARIABLES,
    REQUEST,
    RESPONSE,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.testing.golden.exchange import PLUS, Exchange
from dissect.testing.golden.keys import subject
from dissect.testing.golden.masking import mask_plus
from dissect.testing.golden.plus import plus_subject
from dissect.testing.playback.plus_octets import PROTOCOL_ID, with_integrity, with_sequence
from dissect.testing.playback.server.model import RecordedStep, Script
from dissect.wire.varint import VLQ, VLQ64, build_varint

#: The return value "Service unknown request" (docs/s7plus.md): no such request was recorded.
UNKNOWN_REQUEST: Final = 0xFF89
#: Requests whose values may differ from the recorded ones.
_VALUED: Final = frozenset((CREATE_OBJECT, SET_MULTI_VARIABLES, SET_VARIABLE))
#: Functions whose answers have a list of values, a list of errors, or both, each ended by a zero.
_LISTS: Final = {GET_MULTI_VARIABLES: 2, SET_MULTI_VARIABLES: 1}
_FLAGS: Final = 0x34


def renewed(answer: bytes, request: PlusPdu) -> bytes:
    """Return a recorded answer adapted to ``request``: with its sequence number and the resulting integrity id."""
    octets = with_sequence(answer, request.sequence)
    return with_integrity(octets, max(parse_contents(request).integrity_id, 0) + request.sequence)


def refuse_plus(request: PlusPdu, value: int = UNKNOWN_REQUEST) -> bytes:
    """Return the answer that refuses a request as a whole."""
    return answer_with(request, value, bytes(_LISTS.get(request.function, 0)))


def answer_with(request: PlusPdu, value: int, body: bytes) -> bytes:
    """Return an answer with a return value and the data after it."""
    id_ = parse_contents(request).integrity_id
    tail = build_varint((id_ + request.sequence) & 0xFFFFFFFF, VLQ) if id_ >= 0 else b""
    head = (
        bytes((RESPONSE, 0, 0)) + request.function.to_bytes(2, "big") + bytes(2) + request.sequence.to_bytes(2, "big")
    )
    rest = bytes((_FLAGS,)) + build_varint(value, VLQ64) + body + tail + bytes(4)
    data = head + rest
    trailer = bytes((PROTOCOL_ID, request.version, 0, 0))
    return bytes((PROTOCOL_ID, request.version)) + len(data).to_bytes(2, "big") + data + trailer


def plus_keys(octets: bytes, pdu: PlusPdu) -> tuple[bytes, bytes]:
    """Return the keys of a request: without counters, then also without values; empty if values must not differ."""
    about = repr((pdu.function, plus_subject(octets))).encode() if pdu.function in _VALUED else b""
    return mask_plus(octets), about


def plus_name(octets: bytes) -> str:
    """Return the name of a request, safe to show."""
    return subject(Exchange(PLUS, octets, b""))


class PlusIndex:
    """The requests of recorded connections by their keys, in recorded order."""

    def __init__(self, scripts: Sequence[Script]) -> None:
        self.requests = [step.request for script in scripts for step in script.steps]
        self._steps: tuple[dict[bytes, list[RecordedStep]], dict[bytes, list[RecordedStep]]] = ({}, {})
        for script in scripts:
            for step in script.steps:
                for steps, key in zip(self._steps, plus_keys(step.request, parse_plus(step.request)), strict=True):
                    if key:
                        steps.setdefault(key, []).append(step)

    def steps(self, level: int, key: bytes) -> list[RecordedStep]:
        """Return the recorded requests that are equal at a level."""
        return self._steps[level].get(key, [])


def wants_answer(request: PlusPdu) -> bool:
    """Return whether a message is a request that needs an answer."""
    return request.opcode == REQUEST and request.readable and request.wants_response
